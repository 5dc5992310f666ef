"""The force of flight: what is found of a known truth, and what no flight shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.record import MotorRecord
from rotorid.fitting.flight.force import through_sensor
from rotorid.fitting.flight.ladder import LINE, ForceChoices, ForceFit, _Search, fit_force
from rotorid.fitting.flight.motion import VelocityClass, motion, rotor_speeds
from rotorid.frames import earth_to_body
from rotorid.models.flight import Airframe, felt, flight_loads
from rotorid.typing import FloatArray

RATE_HZ = 200.0
FRAME = Airframe(
    positions=np.array([[0.09, 0.11, 0.0], [-0.09, -0.11, 0.0], [0.09, -0.11, 0.0], [-0.09, 0.11, 0.0]]),
    spins=np.array([1.0, 1.0, -1.0, -1.0]),
    mass_kg=0.8,
    disc_m2=0.0132,
)
TRUTH = {"c_2": 2.2e-6, "c_lambda": 9e-5, "k_d": 4e-5, "x_imu": -0.02, "y_imu": 0.03, "z_imu": -0.025}
OUTPUTS = {"c_1": 3.0, "c_2": 3.0, "c_lambda": 0.15, "k_d": 0.06, "T_motor": 0.05}
CUTOFF_HZ = 12.0


def flown(
    seed: int,
    truth: dict[str, float],
    *,
    speed: float = 4.0,
    wind: tuple[float, float] = (0.0, 0.0),
    drift: tuple[float, float] = (0.0, 0.0),
    seconds: float = 20.0,
    turning: float = 2.0,
) -> MotorRecord:
    """A flight whose force is that of the model behind a low-pass of 12 Hz, with noise."""
    rng = np.random.default_rng(seed)
    count = round(seconds * RATE_HZ)
    rates = turning * np.stack([_colored(rng, count, 5.0) for _ in range(3)])
    attitude = np.stack([0.4 * _colored(rng, count, 0.3), 0.4 * _colored(rng, count, 0.3), np.arange(count) / 600.0])
    ground = speed * np.stack([_colored(rng, count, 0.3) * size for size in (1.0, 1.0, 0.4)])
    ground += earth_to_body(attitude, np.tile(np.array([*drift, 0.0])[:, None], count))
    together, apart = _colored(rng, count, 1.0), np.stack([_colored(rng, count, 4.0) for _ in range(4)])
    by_output = "T_motor" in truth
    outputs = (0.5 if by_output else 1150.0) * (1.0 + (0.08 * together + 0.03 * apart) * min(speed, 1.0))
    record = MotorRecord(
        name=f"flight {seed}",
        sample_rate_hz=RATE_HZ,
        outputs=outputs,
        rates=rates,
        az=np.zeros(count),
        velocity=ground,
        attitude=attitude,
        between="held" if by_output else "lines",
    )
    driven = motion(record, truth, wind=np.array(wind))
    loads = flight_loads(truth, FRAME, speeds=driven.speeds, velocity=driven.velocity, rates=rates)
    force = felt(loads, truth, FRAME.mass_kg, rates, driven.acceleration)
    force = through_sensor(force, record, CUTOFF_HZ) + 0.05 * rng.normal(size=force.shape)
    return replace(record, force=force, az=force[2])


def _colored(rng: np.random.Generator, count: int, high_hz: float) -> FloatArray:
    """Noise up to a frequency, of variance one."""
    from scipy.signal import butter, sosfiltfilt

    row = sosfiltfilt(butter(2, high_hz, fs=RATE_HZ, output="sos"), rng.normal(size=count + 400))[200:-200]
    return np.asarray((row - row.mean()) / row.std())


def fitted(*records: MotorRecord, kind: VelocityClass = "measured", straight: bool = False, **known: float) -> ForceFit:
    choices = ForceChoices(known, None, kind, kind == "measured", None, np.zeros(len(records)), 0.01, straight)
    return fit_force(records, FRAME, choices)


@pytest.fixture(scope="module")
def fast() -> ForceFit:
    return fitted(flown(1, TRUTH), flown(2, TRUTH))


def test_the_truth_comes_back(fast: ForceFit) -> None:
    assert {name: pytest.approx(fast.values[name], rel=0.02, abs=1e-3) for name in TRUTH} == TRUTH
    assert fast.values["k_d"] == pytest.approx(4e-5, rel=0.01)
    assert fast.cutoff_hz == pytest.approx(CUTOFF_HZ, rel=0.1)


def test_nothing_enters_that_was_not_there(fast: ForceFit) -> None:
    assert fast.entered == ()
    assert [rung.terms for rung in fast.ladder if rung.entered] == []
    assert not np.isfinite(fast.winds).any()


def test_what_enters_is_what_was_there() -> None:
    truth = TRUTH | {"d_z": 0.02}
    found = fitted(flown(3, truth, speed=5.0), flown(4, truth, speed=5.0))
    assert found.entered == ("d_z",)
    assert found.values["d_z"] == pytest.approx(0.02, rel=0.05)


def test_every_flight_has_its_wind() -> None:
    winds = ((3.0, -2.0), (-1.0, 4.0))
    found = fitted(*(flown(seed, TRUTH, wind=wind) for seed, wind in enumerate(winds)))
    assert np.abs(found.winds - np.array(winds)).max() < 0.1
    assert np.all(np.abs(found.winds - np.array(winds)) < 3.0 * found.wind_stds)
    assert found.values["k_d"] == pytest.approx(4e-5, rel=0.02)


def test_a_flight_that_its_wind_carries_along_has_drag() -> None:
    # The drag of a mean motion slower than the wind pushes ahead: without a wind, drag would be negative, thus none.
    found = fitted(flown(11, TRUTH, speed=1.0, wind=(3.0, -2.0), drift=(1.8, -1.2)))
    assert [rung.entered for rung in found.ladder if rung.terms == ("wind",)] == [True]
    assert np.abs(found.winds[0] - (3.0, -2.0)).max() < 0.3
    assert found.values["k_d"] == pytest.approx(4e-5, rel=0.1)


def test_outputs_have_a_lag_and_a_curve() -> None:
    found = fitted(flown(5, OUTPUTS))
    assert found.values["T_motor"] == pytest.approx(0.05, rel=0.1)
    assert found.values["c_1"] == pytest.approx(3.0, rel=0.05)
    assert found.values["c_2"] == pytest.approx(3.0, rel=0.05)
    assert found.values["k_d"] == pytest.approx(0.06, rel=0.02)
    assert {"c_1", "c_2", "T_motor"} <= set(found.free)


def test_the_curve_of_demands_is_about_the_line_that_the_autopilot_makes_of_it() -> None:
    hover = flown(7, OUTPUTS, speed=0.1, turning=0.1)
    choices = ForceChoices({}, None, "measured", False, None, np.zeros(1), 0.01)
    priors = {
        straight: _Search((hover,), FRAME, choices._replace(straight=straight)).priors() for straight in (False, True)
    }
    assert priors[False]["c_1"].mean == 0.0
    assert priors[True]["c_1"].mean == priors[True]["c_2"].mean > 0.0


def test_a_line_through_zero_is_fitted_where_it_is_known_to_be_one() -> None:
    truth = {**OUTPUTS, "c_1": 6.0, "c_2": 0.0}
    found = fitted(flown(12, truth), **LINE)
    assert found.values["c_1"] == pytest.approx(6.0, rel=0.03)
    assert (found.values["c_0"], found.values["c_2"]) == (0.0, 0.0)
    assert found.values["k_d"] == pytest.approx(0.06, rel=0.03)
    assert {"c_0", "c_2"}.isdisjoint(found.free)


def test_hover_ties_inflow_to_thrust_and_shows_no_drag() -> None:
    found = fitted(flown(7, TRUTH, speed=0.1, turning=0.1))
    assert {"c_lambda", "k_d", "x_imu"} <= set(found.missing)
    assert found.missing["c_lambda"].endswith(" g, so it is tied to c_2")
    assert found.missing["k_d"].endswith(" m/s (1 needed)")
    assert found.missing["k_w"].endswith(" m/s (8 needed)")
    assert found.free == ("c_2",)
    assert found.values["c_lambda"] > 0.0


def test_without_velocity_its_terms_are_missing() -> None:
    found = fitted(flown(8, TRUTH, speed=1.0), kind="none")
    assert {"c_lambda", "k_d", "d_z"} <= set(found.missing)
    assert "c_lambda" not in found.values


def test_known_numbers_are_held() -> None:
    found = fitted(flown(9, TRUTH), k_d=5e-5)
    assert found.values["k_d"] == 5e-5
    assert "k_d" not in found.free


def test_speeds_of_outputs_follow_their_lag() -> None:
    record = flown(10, OUTPUTS, seconds=5.0)
    early, late = (rotor_speeds(record, OUTPUTS | {"T_motor": lag_s}) for lag_s in (0.0, 0.05))
    assert np.std(late) < np.std(early)
