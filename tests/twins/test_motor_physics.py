"""Flights of a known quadrotor in closed loop, and back to its motors, thrust and inertia."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.data.record import MotorRecord
from rotorid.fitting.motors.fit import MotorFit, fit_motors
from rotorid.fitting.motors.inertia import inertia_regressions
from rotorid.fitting.motors.problem import MotorProblem
from rotorid.models.motors import check_motor_constants, motor_parameters, yaw_range
from rotorid.uncertainty.colored import colored_by_part
from rotorid.vehicles.motor_flight import TRUTH, flights, levers

TWO_SIDED = 1.96


def identify(*records: MotorRecord, rounds: int = 15) -> MotorFit:
    parameters = motor_parameters(known={"m": TRUTH["m"]})
    return fit_motors(MotorProblem(records=records, levers=levers(), parameters=parameters), rounds=rounds)


def deviations(fit: MotorFit) -> dict[str, float]:
    """Errors of the values in their standard deviations."""
    spread = np.sqrt(np.diag(colored_by_part(fit.parts()).corrected))
    return {
        name: (fit.parameters[name].value - TRUTH[name]) / size for name, size in zip(fit.moving, spread, strict=True)
    }


@pytest.fixture(scope="module")
def found() -> MotorFit:
    return identify(flights(1, seed=21)[0])


def test_the_truth_comes_back_within_its_uncertainty(found: MotorFit) -> None:
    off = deviations(found)
    assert set(off) == set(TRUTH) - {"m"}
    # Thirteen values, of which one in seven flights has one beyond 2.5 and one in a thousand one beyond four.
    assert max(map(abs, off.values())) < 4.0


def test_it_comes_back_precisely(found: MotorFit) -> None:
    values = found.parameters.values
    for name in ("I_xx", "I_yy", "kappa_per_I_zz"):
        assert values[name] == pytest.approx(TRUTH[name], rel=0.08), name
    assert values["T_motor"] == pytest.approx(TRUTH["T_motor"], rel=0.15)
    flown = np.quantile(found.problem.records[0].outputs, [0.1, 0.5, 0.9])
    curves = [np.polyval([one["c_2"], one["c_1"], one["c_0"]], flown) for one in (values, TRUTH)]
    np.testing.assert_allclose(curves[0], curves[1], rtol=0.03)


def test_physics_allows_what_was_found(found: MotorFit) -> None:
    problem = found.problem
    assert check_motor_constants(found.parameters.values, records=problem.records, levers=levers()) == []
    assert yaw_range(found.parameters.values).kappa.low > 0.0


@pytest.mark.slow
def test_two_flights_know_more_than_one(found: MotorFit) -> None:
    records = flights(2, seed=22, duration_s=20.0)
    off = deviations(identify(*records))
    assert max(map(abs, off.values())) < 4.0


@pytest.mark.slow
def test_plain_regression_is_biased_both_ways_and_the_corrected_one_is_not() -> None:
    ways = [inertia_regressions(identify(record))[0] for record in flights(3, seed=23, duration_s=20.0)]
    direct, reverse = np.mean([one.plain for one in ways], axis=0) / TRUTH["I_xx"] - 1.0
    assert reverse < -0.2
    assert direct > 0.01
    corrected = np.mean([one.corrected for one in ways], axis=0) / TRUTH["I_xx"] - 1.0
    np.testing.assert_allclose(corrected, 0.0, atol=0.04)
    assert all(one.agrees for one in ways)


@pytest.mark.slow
def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    """120 flights of 13 values. Noise of the gyros comes back through the loop, gusts are slow, az is colored."""
    inside: dict[str, list[bool]] = {}
    for record in flights(120, seed=24, duration_s=20.0):
        for name, off in deviations(identify(record)).items():
            inside.setdefault(name, []).append(abs(off) < TWO_SIDED)
    shares = {name: float(np.mean(held)) for name, held in inside.items()}
    assert 0.91 <= np.mean([value for held in inside.values() for value in held]) <= 0.985
    # Of one value, 120 flights tell the share to two percent.
    assert min(shares.values()) > 0.95 - 3.5 * np.sqrt(0.95 * 0.05 / 120.0), shares


@pytest.mark.slow
def test_both_ways_agree_as_often_as_their_intervals_say() -> None:
    """They share most of the motion, so that they agree more often than independent answers would."""
    ways = [one for record in flights(40, seed=25, duration_s=20.0) for one in inertia_regressions(identify(record))]
    assert np.mean([one.agrees for one in ways]) >= 0.95
