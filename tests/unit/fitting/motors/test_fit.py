"""Fits of the motor chain: values back, invariances, and what is refused."""

from __future__ import annotations

import pickle
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.record import MotorRecord
from rotorid.errors import InsufficientDataError
from rotorid.fitting.least_squares import LevenbergMarquardt
from rotorid.fitting.motors.excitation import excitations, excited_axes
from rotorid.fitting.motors.fit import MotorFit, at_the_best_sample, fit_motors
from rotorid.fitting.motors.problem import MotorProblem
from rotorid.models.motors import motor_parameters
from rotorid.vehicles.motor_flight import TRUTH, Air, flights, levers

LEVERS = levers()


@pytest.fixture(scope="module")
def calm() -> MotorRecord:
    return flights(1, seed=7, duration_s=8.0, air=Air(gyro=1e-4, gust=0.01, accelerometer=0.01))[0]


def fitted(record: MotorRecord, known: Mapping[str, float], levers: np.ndarray = LEVERS) -> MotorFit:
    return fit_motors(MotorProblem(records=(record,), levers=levers, parameters=motor_parameters(known=known)))


@pytest.fixture(scope="module")
def found(calm: MotorRecord) -> MotorFit:
    return fitted(calm, {"m": TRUTH["m"]})


def test_in_calm_air_the_truth_comes_back(found: MotorFit) -> None:
    values = found.parameters.values
    assert found.settled
    for name in ("I_xx", "I_yy", "kappa_per_I_zz", "T_motor", "tau_gyro"):
        assert values[name] == pytest.approx(TRUTH[name], rel=0.02), name


@pytest.mark.parametrize("samples", [-1, 3])
def test_a_delay_of_other_samples_is_left_where_the_right_one_explains_more(found: MotorFit, samples: int) -> None:
    """As where held outputs give the cost a corner, and a search stays on its far side."""
    problem, place = found.problem, found.problem.parameters.free.index("tau_gyro")
    right_s = found.solution.theta[place]
    theta = found.solution.theta.copy()
    theta[place] = max(right_s + samples / problem.records[0].sample_rate_hz, 0.0)
    held = problem.with_parameters(problem.parameters.fix("tau_gyro", float(theta[place])))
    solver = LevenbergMarquardt(iterations=30, tolerance=1e-8)
    late = solver.minimize(held.residuals, np.delete(theta, place), *held.box)
    theta[np.arange(theta.size) != place] = late.theta
    stuck = replace(found.solution, theta=theta, cost=late.cost)
    assert at_the_best_sample(problem, stuck, solver).theta[place] == pytest.approx(right_s, abs=1e-5)


def test_the_end_of_a_search_holds_its_equations(found: MotorFit) -> None:
    made, kept = found.problem.parts(found.solution.theta), found.problem.parts_at(found.solution)
    for one, other in zip(made, kept, strict=True):
        np.testing.assert_array_equal(one.residual, other.residual)
        np.testing.assert_array_equal(one.slopes, other.slopes)


def test_twice_the_mass_is_twice_the_thrust_and_inertia(calm: MotorRecord, found: MotorFit) -> None:
    heavy = fitted(calm, {"m": 2.0 * TRUTH["m"]}).parameters.values
    for name in ("c_1", "c_2", "I_xx", "I_yy"):
        assert heavy[name] == pytest.approx(2.0 * found.parameters.values[name], rel=1e-3), name
    assert heavy["T_motor"] == pytest.approx(found.parameters.values["T_motor"], rel=1e-3)


def test_a_known_inertia_gives_the_mass(calm: MotorRecord, found: MotorFit) -> None:
    values = found.parameters.values
    assert fitted(calm, {"I_xx": values["I_xx"]}).parameters.values["m"] == pytest.approx(TRUTH["m"], rel=1e-3)


def test_the_order_of_the_motors_does_not_matter(calm: MotorRecord, found: MotorFit) -> None:
    order = [1, 3, 2, 0]
    turned = fitted(replace(calm, outputs=calm.outputs[order]), {"m": TRUTH["m"]}, LEVERS[:, order])
    for name, value in found.parameters.values.items():
        assert turned.parameters.values[name] == pytest.approx(value, rel=1e-5, abs=1e-6), name


def test_progress_is_told_round_by_round(calm: MotorRecord) -> None:
    told: list[str] = []
    parameters = motor_parameters(known={"m": TRUTH["m"]}, axes=("az", "p"))
    problem = MotorProblem(records=(calm,), levers=LEVERS, parameters=parameters, axes=("az", "p"))
    rounds = fit_motors(problem, progress=told.append).rounds
    assert len(told) == rounds
    assert told[0].startswith("motors, round 1: values changed by ")


def test_axes_that_nothing_excites_are_refused() -> None:
    (quiet,) = flights(1, seed=8, duration_s=8.0, size=0.0)
    assert excited_axes(excitations([quiet], LEVERS)) == ()
    with pytest.raises(InsufficientDataError, match=r"the motors explain the motion along az, p, q, r in no record"):
        fitted(quiet, {"m": 1.0})


def test_the_weight_alone_gives_the_thrust_of_hover() -> None:
    (quiet,) = flights(1, seed=8, duration_s=8.0, size=0.0)
    parameters = motor_parameters(curve="linear", known={"m": 1.0, "T_motor": 0.03, "tau_accel": 0.0}, axes=())
    problem = MotorProblem(records=(quiet,), levers=LEVERS, parameters=parameters, axes=("weight",))
    value = fit_motors(problem).parameters["c_1"].value
    assert value * quiet.outputs.sum(axis=0).mean() == pytest.approx(-quiet.az.mean(), rel=1e-3)


def test_short_records_are_refused() -> None:
    (short,) = flights(1, seed=9, duration_s=0.25)
    with pytest.raises(InsufficientDataError, match="a record of 50 samples is too short; this needs 60 or more"):
        fitted(short, {"m": 1.0})


def test_fits_can_be_sent(found: MotorFit) -> None:
    again = pickle.loads(pickle.dumps(found))
    assert again.parameters == found.parameters
    assert again.moving == found.moving
