"""Bounds of motor and inertia constants: as wide as the estimates scatter, and without end where nothing is seen."""

from __future__ import annotations

import numpy as np
import pytest
from tests.unit.search.test_acceleration import ALL_FREE, FLIGHT, KAPPA_HELD, LAG_FREE, posed, truth_of

from rotorid.errors import InsufficientDataError
from rotorid.models.parameter import ParameterSet
from rotorid.search.acceleration import acceleration_bounds
from rotorid.uncertainty.identifiability import unseen_combinations
from rotorid.vehicles import hover_quadrotor

RUNS = 100


@pytest.mark.parametrize(
    ("parameters", "error"), [(KAPPA_HELD, "absolute"), (KAPPA_HELD, "squared"), (LAG_FREE, "squared")]
)
def test_standard_deviations_are_those_of_many_flights(parameters: ParameterSet, error: str) -> None:
    problem = posed(parameters, error=error)
    stated = acceleration_bounds(problem, problem.polish(truth_of(problem)).theta)
    ends = []
    for seed in range(RUNS):
        again = posed(parameters, hover_quadrotor.fly(np.random.default_rng(seed + 1)), error=error)
        ends.append(again.polish(truth_of(again)).theta)
    # A standard deviation of 100 runs scatters by 7 %; three of these, and the scatter of the density of errors.
    np.testing.assert_allclose(np.std(ends, axis=0, ddof=1), stated.std, rtol=0.25)
    off = (np.mean(ends, axis=0) - truth_of(problem)) / (stated.std / np.sqrt(RUNS))
    assert np.abs(off).max() < 4.0


@pytest.mark.parametrize("error", ["absolute", "squared"])
def test_what_cannot_be_told_apart_is_said(error: str) -> None:
    problem = posed(ALL_FREE, error=error)
    theta = problem.polish(truth_of(problem)).theta
    (one,) = unseen_combinations(problem.parameters.unpack(theta), acceleration_bounds(problem, theta))
    assert set(one.names) == {"kappa", "I_zz"}
    assert one.words().startswith("The data show only kappa/I_zz = 1.6")
    held = posed(KAPPA_HELD, error=error)
    theta = held.polish(truth_of(held)).theta
    assert unseen_combinations(held.parameters.unpack(theta), acceleration_bounds(held, theta)) == ()


def test_mass_and_thrust_are_one_number() -> None:
    problem = posed(KAPPA_HELD.free_again("m"))
    theta = truth_of(problem)
    names = {
        name
        for one in unseen_combinations(problem.parameters.unpack(theta), acceleration_bounds(problem, theta))
        for name in one.names
    }
    assert {"m", "c_t", "I_xx", "I_yy", "I_zz"} == names


def test_a_parameter_without_effect_is_named() -> None:
    problem = posed(LAG_FREE, motors=np.zeros_like(FLIGHT.motors))
    with pytest.raises(InsufficientDataError, match=r"c_t, .*T_motor"):
        acceleration_bounds(problem, truth_of(problem))


def test_wider_noise_gives_wider_bounds() -> None:
    loud = posed(KAPPA_HELD, hover_quadrotor.fly(np.random.default_rng(0), noise=3.0))
    calm = posed(KAPPA_HELD)
    theta = truth_of(calm)
    np.testing.assert_allclose(
        acceleration_bounds(loud, theta).std, 3.0 * acceleration_bounds(calm, theta).std, rtol=1e-9
    )
