"""What `rotorid design` foretells of flights that the real ArduPilot flew."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import coherence

import rotorid
from rotorid.data.flight_plan import FlightPlan
from rotorid.data.record import Maneuver
from rotorid.excitation.plan import sequence, together
from rotorid.flying.designs import expected_values
from rotorid.flying.flight_air import logged_air
from rotorid.flying.settings import DesignSettings, PlanSettings
from rotorid.models.library import rate_model
from rotorid.planning.aircraft import aircraft_loop
from rotorid.planning.prediction import predict
from rotorid.proposing.bands import designed_for_tune
from rotorid.simulation.shaping import shaped_plan
from rotorid.typing import FloatArray
from rotorid.vehicles.catalog import aircraft
from rotorid.vehicles.px4 import with_gains

BEGIN_S, AMPLITUDE_RAD = 75.365, 0.4
"""When the script began on the log's clock, and how large its multisine was: 16.1° rms were planned."""

PERIOD_S = 20.0
FIELDS = {"roll": ("phi_setpoint", "p"), "pitch": ("theta_setpoint", "q")}


@pytest.fixture(scope="module")
def guided(unpacked: Callable[[str], Path]) -> rotorid.FlightRecord:
    return rotorid.read(unpacked("real_stacks/ap_x_guided_multisine.BIN.xz"))


@pytest.fixture(scope="module")
def planned() -> FlightPlan:
    inputs = together(
        dict.fromkeys(FIELDS, AMPLITUDE_RAD),
        start_s=0.0,
        band_rad_s=(0.6, 50.0),
        period_s=PERIOD_S,
        periods=2,
        sample_rate_hz=250.0,
        entry="attitude_setpoint",
        seed=0,
    )
    return sequence("multisine", [inputs], trim_s=4.0)


@pytest.fixture(scope="module")
def foretold(guided: rotorid.FlightRecord, planned: FlightPlan) -> FlightPlan:
    craft = with_gains(aircraft("ardupilot_quad"), guided.parameters, source="the log")
    return shaped_plan(planned, craft.autopilot.shaping, craft.autopilot.rate_hz)


def logged(record: rotorid.FlightRecord, name: str, time_s: FloatArray) -> FloatArray:
    topic = next(one for one in record.topics if one.row(name) is not None and one.sample_rate_hz > 100.0)
    return np.interp(time_s, topic.time_s, topic.values[topic.row(name)])


def test_the_set_point_that_flew_is_the_shaped_one(
    guided: rotorid.FlightRecord, planned: FlightPlan, foretold: FlightPlan
) -> None:
    time_s = np.arange(0.0, 48.0, 0.005)
    sizes = []
    for asked, flies in zip(planned.inputs, foretold.inputs, strict=True):
        target = logged(guided, FIELDS[asked.axis][0], BEGIN_S + time_s)
        assert np.degrees(asked.values.std()) > 16.0
        # The hold of the place leans by 2 to 3° rms on top, and is shaped together with the multisine.
        assert np.corrcoef(flies.at(time_s), target)[0, 1] > 0.74
        assert abs(np.corrcoef(asked.at(time_s), target)[0, 1]) < 0.1
        sizes.append(flies.at(time_s).std() / target.std())
    assert np.mean(sizes) == pytest.approx(1.0, abs=0.1)


def test_the_coherence_that_is_foretold_is_flown(guided: rotorid.FlightRecord, foretold: FlightPlan) -> None:
    craft = with_gains(aircraft("ardupilot_quad"), guided.parameters, source="the log")
    loop = aircraft_loop(craft)
    time_s = np.arange(4.0 + BEGIN_S, 44.0 + BEGIN_S, 0.005)
    for axis, (setpoint, rate) in FIELDS.items():
        model = rate_model(f"rate.{axis}")
        prediction = predict(model, expected_values(model, craft), loop, foretold)
        used = prediction.used[0, 0]
        assert np.median(prediction.response.coherence[0, 0][used]) > 0.99
        frequency_hz, seen = coherence(
            logged(guided, setpoint, time_s), logged(guided, rate, time_s), fs=200.0, nperseg=1600
        )
        omega = 2.0 * np.pi * frequency_hz
        band = prediction.response.omega_rad_s[used][[0, -1]]
        inside = (omega >= max(5.0, band[0])) & (omega <= band[1])
        assert np.median(seen[inside]) > 0.99


@pytest.mark.parametrize(
    ("name", "wind_m_s"),
    [
        ("ap_x_guided_multisine", 2.0),
        ("ap_x_wind_soft_wide", 3.3),
        ("ap_x_wind_soft_card_flight", 3.3),
        ("ap_x_wind_soft_tuned_card_flight", 3.3),
    ],
)
def test_the_wind_that_blew_is_that_of_the_next_plan(
    unpacked: Callable[[str], Path], name: str, wind_m_s: float
) -> None:
    record = rotorid.read(unpacked(f"real_stacks/{name}.BIN.xz"))
    air = logged_air(record, with_gains(aircraft("ardupilot_quad"), record.parameters, source=name))
    assert air.wind is not None
    assert air.gyro_noise_rad_s is not None
    assert air.wind.speed_m_s == pytest.approx(wind_m_s, abs=0.3)
    # Flights of one day and one simulator have one noise.
    assert air.gyro_noise_rad_s == pytest.approx(0.023, rel=0.1)


def test_a_limit_cycle_is_no_noise_of_the_gyroscopes(unpacked: Callable[[str], Path]) -> None:
    record = rotorid.read(unpacked("real_stacks/ap_x_wind_limit_cycle.BIN.xz"))
    air = logged_air(record, with_gains(aircraft("ardupilot_quad"), record.parameters, source="the log"))
    assert air.gyro_noise_rad_s is None
    assert "the vehicle oscillates" in air.findings[0].message


@pytest.mark.parametrize("name", ["ap_x_wind_soft_wide", "ap_x_wind_soft_card_flight", "ap_x_wind_ordinary_hard"])
def test_the_band_for_tune_is_one_that_was_flown_and_held(unpacked: Callable[[str], Path], name: str) -> None:
    choices = DesignSettings(
        vehicle="ardupilot_quad",
        kinds=("logarithmic_sweep",),
        plan=PlanSettings(shape="logarithmic_sweep", axes=("roll", "pitch")),
    )
    designed = designed_for_tune(choices, record=rotorid.read(unpacked(f"real_stacks/{name}.BIN.xz")))
    low, high = designed.plan.band_rad_s
    # The sweep after which the foretold margins were those that flew went from 1.9 to 188 rad/s, its loop crosses over
    # at 40; the usual one ends at 50, and of the gains that oscillate three times the crossover is 490.
    assert low == pytest.approx(1.9, abs=0.2)
    assert 1.5 * 40.4 < high < 130.0


def in_flight(guided: rotorid.FlightRecord, foretold: FlightPlan) -> dict[str, float]:
    """Random errors by the linear forecast over those that the flight states."""
    craft = with_gains(aircraft("ardupilot_quad"), guided.parameters, source="the log")
    segment = Maneuver(axis="roll", kind="multisine", start_s=BEGIN_S + 4.0, stop_s=BEGIN_S + 44.0)
    settings = rotorid.IdentifySettings(segments=(segment,), instruments=("phi_setpoint",), estimate="joint")
    found = rotorid.identify(guided, "rate.roll", settings=settings).parameters
    model = rate_model("rate.roll")
    told = predict(model, expected_values(model, craft), aircraft_loop(craft), foretold)
    assert abs(found["L_roll"].value - 437.2) < 2.0 * found["L_roll"].std
    return {name: told[name].std_random / (found[name].std_random or 0.0) for name in ("L_roll", "L_p")}


@pytest.mark.xfail(
    strict=True,
    raises=AssertionError,
    reason="the linear forecast of roll alone leaves out pitch, which moved at the same time: a third of L_roll",
)
def test_the_bounds_that_are_foretold_are_stated_of_the_flight(
    guided: rotorid.FlightRecord, foretold: FlightPlan
) -> None:
    assert all(0.5 < ratio < 2.0 for ratio in in_flight(guided, foretold).values())


def test_the_linear_forecast_is_right_within_a_factor_of_four(
    guided: rotorid.FlightRecord, foretold: FlightPlan
) -> None:
    assert all(0.25 < ratio < 4.0 for ratio in in_flight(guided, foretold).values())
