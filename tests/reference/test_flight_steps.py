"""Many steps ahead on public flights of a quadrotor of 45 g: each run predicted by a fit of the four others.

The errors are those of IDSIA's benchmark: mean norms of position, velocity, attitude and rates after 1 to 50 steps of
10 ms from every sample, summed over the steps, over those of a state that is kept. The runs are those at hand that
have motors in step, not the benchmark's own test runs, on which the best published models reach 0.13, 0.27, 0.62 and
1.0. No number is fitted to these errors. Positions are integrals of the logged velocity, because the logged position
differs from them by 10 to 15 % of its change over 50 steps, whatever the model.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest

import rotorid
from rotorid.data.record import MotorRecord
from rotorid.fitting.flight.fit import FlightChoices, fit_flight
from rotorid.fitting.flight.moment import AIR_TERMS, GAINS, center_of
from rotorid.fitting.flight.motion import motion
from rotorid.flights.motor_stamps import motor_skew
from rotorid.frames import earth_to_body
from rotorid.models.flight import Airframe
from rotorid.models.rotors import RotorLayout
from rotorid.verification.multistep import StepErrors, measured_states, pooled, step_errors

pytestmark = pytest.mark.slow

DOCS = Path(__file__).resolve().parents[2] / "docs"
RUNS = (
    "multisine_20251017_run3",
    "random1_20251017_run4",
    "random2_20251017_run2",
    "square_20251017_run1",
    "square_20251017_run3",
)
ARM_M = 0.0353
FRAME = Airframe(
    positions=ARM_M * np.array([[1.0, 1.0, 0.0], [-1.0, 1.0, 0.0], [-1.0, -1.0, 0.0], [1.0, -1.0, 0.0]]),
    spins=np.array([1.0, -1.0, 1.0, -1.0]),
    mass_kg=0.045,
    disc_m2=np.pi * 0.0275**2,
)
LAYOUT = RotorLayout(name="nanodrone", positions=FRAME.positions, spins=FRAME.spins, arm_known=True)
KNOWN = {"I_zz": 5e-5}
"""Only its ratio to the torque of the rotors acts."""

BARS = {"position": 0.13, "velocity": 0.27, "attitude": 0.62, "rates": 1.0}
VEHICLE = {"position": 0.18, "velocity": 0.53, "attitude": 0.92, "rates": 0.89}
PREDICTOR = {"position": 0.145, "velocity": 0.43, "attitude": 0.79, "rates": 0.72}
"""What was reached, and a sixth more."""

ENDS = slice(60, -10)
"""Without the jolt of take-off."""

STEP_S, STEPS = 0.01, 50


def _read(path: Path, name: str) -> tuple[MotorRecord, float]:
    log = rotorid.read(path, mapping=DOCS / "mappings" / "idsia_nanodrone.toml", sandbox=False)

    def rows(names: str) -> np.ndarray:
        return np.stack([log[channel].values for channel in names.split()])[:, ENDS]

    attitude = rows("phi theta psi")
    force = rows("ax ay az")
    # These tables have it along the axes of the earth; along the body, tilt does not show.
    assert force[0].std() < 1.0
    record = MotorRecord(
        name=name,
        sample_rate_hz=1.0 / STEP_S,
        outputs=rows("motor_speed_1 motor_speed_2 motor_speed_3 motor_speed_4"),
        rates=rows("p q r"),
        az=force[2],
        force=force,
        velocity=earth_to_body(attitude, rows("velocity_north velocity_east velocity_down")),
        attitude=attitude,
        between="lines",
    )
    return record, motor_skew(log, LAYOUT).late_s.value


@pytest.fixture(scope="module")
def runs(unpacked: Callable[[str], Path]) -> dict[str, tuple[MotorRecord, float]]:
    return {name: _read(unpacked(f"flight/idsia_{name}.parquet.xz"), name) for name in RUNS}


def _of_predictor(values: Mapping[str, float], predictor: Mapping[str, float]) -> dict[str, float]:
    """Numbers that make the motion of the predictor: a share of a moment is a larger inertia."""
    gains = [predictor[name] for name in GAINS]
    tilting = float(np.sqrt(gains[0] * gains[1]))
    shares = {"m_fx": gains[1], "x_cg": gains[1], "y_cg": gains[0], "kappa_lambda": gains[2], "k_r": gains[2]}
    bare = {name: value for name, value in values.items() if name not in AIR_TERMS}
    air = {name: value / shares.get(name, tilting) for name, value in predictor.items() if name in AIR_TERMS}
    heavy = zip(("I_xx", "I_yy", "I_zz"), gains, strict=True)
    return {**bare, **air, **{name: values[name] / gain for name, gain in heavy}}


@pytest.fixture(scope="module")
def unseen(runs: dict[str, tuple[MotorRecord, float]]) -> dict[str, StepErrors]:
    """Errors of the vehicle and of the predictor, each run by a fit of the others."""
    found: dict[str, list[StepErrors]] = {"vehicle": [], "predictor": []}
    for name, (record, skew_s) in runs.items():
        fitted = [pair for other, pair in runs.items() if other != name]
        # In a hall, and no run turns its heading: what looks like wind is a bias.
        choices = FlightChoices(values=KNOWN, skews_s=tuple(late_s for _, late_s in fitted), wind=False, predictor=True)
        fit = fit_flight([flight for flight, _ in fitted], FRAME, choices)
        driven = motion(record, fit.values, skew_s=skew_s)
        states = measured_states(record.attitude, record.velocity, record.rates, step_s=STEP_S)
        numbers = {"vehicle": fit.values, "predictor": _of_predictor(fit.values, fit.predictor)}
        for kind, values in numbers.items():
            # Of each run its own, as wind and skew are: the battery is put in anew.
            values = values | center_of(values, FRAME, record, driven)
            found[kind].append(step_errors(values, FRAME, states, driven.speeds, step_s=STEP_S, steps=STEPS))
    return {kind: pooled(parts) for kind, parts in found.items()}


@pytest.mark.parametrize(("kind", "reached"), [("vehicle", VEHICLE), ("predictor", PREDICTOR)])
def test_steps_ahead_are_predicted_as_well_as_before(
    unseen: dict[str, StepErrors], kind: str, reached: dict[str, float]
) -> None:
    ratios = unseen[kind].ratios
    assert {name: ratios[name] for name in BARS if ratios[name] > reached[name]} == {}


def test_rates_are_predicted_better_than_by_keeping_them(unseen: dict[str, StepErrors]) -> None:
    assert all(unseen[kind].ratios["rates"] < BARS["rates"] for kind in unseen)


def test_positions_are_predicted_as_well_as_by_the_best_published_model(unseen: dict[str, StepErrors]) -> None:
    """0.123 of the predictor."""
    assert unseen["predictor"].ratios["position"] <= BARS["position"]


@pytest.mark.xfail(
    raises=AssertionError,
    strict=True,
    reason="0.37 of 0.27 in velocity, all of it by attitude (0.14 with the true one), and 0.68 of 0.62 in attitude: "
    "moments below 1 Hz follow airspeed 40 to 90 ms late, which no inflow of momentum theory does",
)
def test_steps_ahead_are_predicted_as_well_as_by_the_best_published_models(unseen: dict[str, StepErrors]) -> None:
    ratios = unseen["predictor"].ratios
    assert {name: ratios[name] for name, bar in BARS.items() if ratios[name] > bar} == {}
