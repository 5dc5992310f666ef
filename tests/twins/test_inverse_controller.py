"""A yaw loop with a known truth: flown by gusts it shows its controller, flown by a sweep it shows the vehicle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.record import Channel, FlightRecord, Maneuver, Source, Topic
from rotorid.errors import InsufficientDataError
from rotorid.excitation.sweep import pilot_sweep
from rotorid.fits.frequency.inverse import Screened, pose_screened, require_vehicle
from rotorid.fits.time.fit import TimeMethod
from rotorid.flights.flights import Flight
from rotorid.flights.measure import measure
from rotorid.identifying.identification import identify
from rotorid.models.families import named_model
from rotorid.models.library import rate_model
from rotorid.models.structure import LinearStructure
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.parsing import parse_segment
from rotorid.typing import FloatArray

RATE_HZ = 250.0
DURATION_S = 100.0
COUNT = int(DURATION_S * RATE_HZ)
GAIN, DAMPING, DELAY_SAMPLES = 14.0, 1.0, 3
"""Vehicle r' = -r + 14 u(t - 12 ms) + gust, about the yaw of a small quadrotor."""

PROPORTIONAL, INTEGRAL, ANGLE = 0.2, 0.1, 2.0
GUST_RAD_S2 = 3.0
GAINS = {"MC_YAWRATE_P": PROPORTIONAL, "MC_YAWRATE_I": INTEGRAL, "MC_YAWRATE_D": 0.0, "MC_YAW_P": ANGLE}
BAND = (1.0, 60.0)
SETTINGS = IdentifySettings(band_rad_s=BAND, estimate="direct")


def sweep(amplitude: float, highest_rad_s: float) -> FloatArray:
    band = (0.8, highest_rad_s)
    values = pilot_sweep(
        amplitude=amplitude, band_rad_s=band, duration_s=DURATION_S - 10.0, sample_rate_hz=RATE_HZ, trim_s=2.0
    )
    return np.pad(values, (0, COUNT))[:COUNT]


def fly(*, excitation: FloatArray | None = None, gains: dict[str, float] = GAINS) -> FlightRecord:
    """One closed-loop flight: gusts as white angular acceleration, an excitation on top of the command."""
    rng = np.random.default_rng(0)
    gusts = GUST_RAD_S2 * rng.standard_normal(COUNT)
    noise = 1e-4 * rng.standard_normal(COUNT)
    added = np.zeros(COUNT) if excitation is None else excitation
    rates, commands = np.zeros(COUNT), np.zeros(COUNT + DELAY_SAMPLES)
    rate = heading = integral = 0.0
    step_s = 1.0 / RATE_HZ
    for index in range(COUNT):
        rates[index] = rate + noise[index]
        error = -ANGLE * heading - rates[index]
        integral += INTEGRAL * error * step_s
        commands[index + DELAY_SAMPLES] = PROPORTIONAL * error + integral + added[index]
        heading += rate * step_s
        rate += step_s * (-DAMPING * rate + GAIN * commands[index] + gusts[index])
    topic = Topic(
        name="loop",
        time_s=np.arange(COUNT) * step_s,
        channels=(Channel(name="yaw_command", unit="1"), Channel(name="r", unit="rad/s")),
        values=np.stack([commands[DELAY_SAMPLES:], rates]),
    )
    return FlightRecord(source=Source(name="loop", format="twin", sha256="0"), topics=(topic,), parameters=gains)


def screened(record: FlightRecord, *, name: str = "rate.yaw") -> Screened:
    """What the pipeline would fit of a flight; under another name the model need not reach above the speed modes."""
    maneuver = Maneuver(axis="yaw", kind="other", start_s=0.0, stop_s=DURATION_S - 1.0, origin="given")
    flown = (Flight(record, maneuver),)
    measured = measure(flown, inputs=("yaw_command",), outputs=("r",), settings=SETTINGS)
    return pose_screened(replace(rate_model("rate.yaw"), name=name), measured, SETTINGS, flown)


@pytest.mark.parametrize("gains", [GAINS, {}])
def test_flown_by_gusts_alone_it_is_refused_with_or_without_the_gains(gains: dict[str, float]) -> None:
    with pytest.raises(InsufficientDataError, match="inverse of the controller") as refusal:
        screened(fly(gains=gains))
    (finding,) = refusal.value.findings
    assert (finding.kind, finding.severity, finding.where) == ("inverse_controller", "error", "r/yaw_command")
    assert finding.numbers["high_rad_s"] > 50.0
    assert finding.numbers["fitted_cost"] < 10.0
    assert ("known_cost" in finding.numbers) == bool(gains)
    # Above its corner of half a rad/s the controller is its proportional gain, and the angle loop adds to it below 2.
    assert finding.numbers["gain"] == pytest.approx(PROPORTIONAL, rel=0.1)


BLACK_BOX = named_model("black_box:2", inputs=("yaw_command",), outputs=("r",))
IN_TIME = IdentifySettings(band_rad_s=BAND, segments=(parse_segment("yaw:0:89"),))


@pytest.mark.parametrize("model", [BLACK_BOX, "rate.yaw"], ids=["black box", "rate.yaw"])
@pytest.mark.parametrize("method", ["output_error", "prediction_error"])
def test_it_is_refused_by_every_method(model: LinearStructure | str, method: TimeMethod) -> None:
    """What follows the commands of a controller by any model of any order is the controller."""
    with pytest.raises(InsufficientDataError, match="inverse of the controller") as refusal:
        identify([fly()], model, settings=replace(IN_TIME, method=method))
    assert "inverse_controller" in {finding.kind for finding in refusal.value.findings}


def test_a_strong_sweep_is_left_to_the_methods_in_time() -> None:
    flown = (Flight(fly(excitation=sweep(0.3, 60.0)), IN_TIME.segments[0]),)
    measured = measure(flown, inputs=("yaw_command",), outputs=("r",), settings=IN_TIME)
    require_vehicle(measured, IN_TIME, flown)


@pytest.mark.parametrize("gains", [GAINS, {}])
def test_the_same_vehicle_with_the_same_gusts_and_a_strong_sweep_is_left_alone(gains: dict[str, float]) -> None:
    flight = fly(excitation=sweep(0.3, 60.0), gains=gains)
    result = screened(flight)
    assert result.findings == ()
    omega = result.problem.data.omega_rad_s[result.problem.used[0, 0]]
    assert omega[0] < 1.5
    assert omega[-1] > 40.0


def test_where_the_sweep_ends_the_controller_begins_and_only_what_is_below_is_kept() -> None:
    flight = fly(excitation=sweep(0.6, 5.0))
    result = screened(flight, name="low")
    (finding,) = result.findings
    assert finding.severity == "warning"
    used = result.problem.used[0, 0]
    omega, values = result.problem.data.omega_rad_s, result.problem.data.values[0, 0]
    assert omega[used][-1] < finding.numbers["low_rad_s"]
    s = 1j * omega[used]
    vehicle = GAIN * np.exp(-s * DELAY_SAMPLES / RATE_HZ) / (s + DAMPING)
    controller = -1.0 / ((PROPORTIONAL + INTEGRAL / s) * (1.0 + ANGLE / s))
    nearer = np.abs(values[used] / vehicle - 1.0) < np.abs(values[used] / controller - 1.0)
    assert nearer.mean() > 0.8


def test_a_rate_model_is_refused_on_what_is_left_below_the_speed_modes() -> None:
    flight = fly(excitation=sweep(0.6, 2.0))
    with pytest.raises(InsufficientDataError, match="is too little to fit") as refusal:
        screened(flight)
    assert [finding.kind for finding in refusal.value.findings] == ["inverse_controller"]
