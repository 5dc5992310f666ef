"""What a flight will state as random and model error, with rehearsals and without."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.planning.plans import LOG_HZ, STRUCTURE, TRUTH, roll_loop, sweeps

from rotorid.fitting.frequency.fit import fit_frequency
from rotorid.fitting.frequency.problem import FrequencyProblem
from rotorid.fitting.problem import ResidualErrors
from rotorid.planning.expected import (
    ExpectedFit,
    FitSettings,
    as_planned,
    expected_fit,
    expected_response,
    usable,
)
from rotorid.planning.prediction import scattering_errors
from rotorid.planning.systematic import KnownErrors, stated_bounds
from rotorid.spectral.windows import grid_rad_s
from rotorid.uncertainty.cramer_rao import Bounds, bounds
from rotorid.uncertainty.model_error import SMALLEST_MODEL_ERROR

CHOICES = FitSettings(band_rad_s=(2.0, 40.0))


def fitted(wrong: float = 0.0, *, noise: float = 0.05) -> tuple[ExpectedFit, ResidualErrors]:
    """A fit to an expected response, of a structure whose damping is held at what it is not."""
    loop, planned = roll_loop(noise), as_planned(sweeps({"roll": 0.1}, 40.0), ["roll"], LOG_HZ)
    band = (2.0, 40.0)
    windows = planned.windows(band)
    response = expected_response(
        loop,
        planned,
        inputs=STRUCTURE.inputs,
        outputs=("p",),
        omega_rad_s=grid_rad_s(band, windows),
        windows_s=windows.lengths_s,
    )
    parameters = STRUCTURE.parameters.with_values(TRUTH)
    if wrong:
        parameters = parameters.fix("L_p", TRUTH["L_p"] + wrong)
    used = usable(response, planned, ["roll"], band, CHOICES)
    posed = FrequencyProblem(structure=STRUCTURE, parameters=parameters, data=response, used=used)
    ended = expected_fit(posed, CHOICES)
    return ended, scattering_errors(ended.problem, loop, planned)


def stated(wrong: float = 0.0, *, noise: float = 0.05, known: KnownErrors | None = None) -> Bounds:
    ended, scattering = fitted(wrong, noise=noise)
    return stated_bounds(ended, scattering, known or KnownErrors())


def test_an_exact_structure_has_the_floor_and_the_clocks() -> None:
    ended, scattering = fitted(noise=1e-4)
    found = stated_bounds(ended, scattering, KnownErrors())
    assert found.model_error is not None
    assert found.model_error.deviations["p/roll_command"] <= SMALLEST_MODEL_ERROR
    alone = bounds(ended.problem, ended.solution, weights=ended.weights)
    np.testing.assert_allclose(found.std, alone.std, rtol=0.02)
    # A clock that is late by 0.15 samples is a delay.
    assert found.stds["tau_roll"] > 0.15 / LOG_HZ


def test_random_errors_are_those_of_the_expected_response() -> None:
    ended, scattering = fitted()
    found = stated_bounds(ended, scattering, KnownErrors())
    alone = bounds(ended.problem, ended.solution, weights=ended.weights, model_errors=False)
    np.testing.assert_allclose(found.random_std, alone.random_std)
    assert (found.std > found.random_std).all()


def test_a_wrong_structure_has_a_larger_model_error() -> None:
    exact, wrong = stated(noise=0.01), stated(4.0, noise=0.01)
    assert wrong.stds["L_roll"] > 3.0 * exact.stds["L_roll"]


def test_no_model_error_is_smaller_than_that_of_an_earlier_result() -> None:
    earlier = stated(noise=0.01, known=KnownErrors(sizes={"p/roll_command": 0.03}))
    assert earlier.model_error is not None
    assert earlier.model_error.deviations["p/roll_command"] == pytest.approx(0.03)
    assert earlier.stds["L_roll"] > 2.0 * stated(noise=0.01).stds["L_roll"]


def test_rehearsals_state_what_an_identification_of_them_states() -> None:
    ended, scattering = fitted(noise=0.02)
    rng = np.random.default_rng(1)
    values = ended.problem.data.values * (1.0 + 0.01 * rng.standard_normal(ended.problem.data.values.shape))
    lean = np.full((1, ended.problem.data.omega_rad_s.size), 0.05)
    rehearsal = replace(ended.problem, data=replace(ended.problem.data, values=values, lean_errors=lean))
    found = stated_bounds(ended, scattering, KnownErrors(rehearsals=(rehearsal, rehearsal)))
    own = fit_frequency(rehearsal, starts=[ended.solution.theta])
    np.testing.assert_allclose(found.std, bounds(rehearsal, own, weights=ended.weights).std, rtol=1e-3)
    # Of a plan of another length only errors of known size are taken.
    other = stated_bounds(ended, scattering, KnownErrors(rehearsals=(rehearsal,), of_plan=False))
    np.testing.assert_allclose(other.random_std, stated(noise=0.02).random_std)
    assert other.stds["L_roll"] > 2.0 * stated(noise=0.02).stds["L_roll"]


def test_a_rehearsal_of_other_responses_is_left_out() -> None:
    ended, scattering = fitted()
    other = replace(
        ended.problem,
        structure=replace(ended.problem.structure, outputs=("q",)),
        data=replace(
            ended.problem.data, outputs=("q",), lean_errors=np.full((1, ended.problem.data.omega_rad_s.size), 0.2)
        ),
    )
    found = stated_bounds(ended, scattering, KnownErrors(rehearsals=(other,)))
    np.testing.assert_allclose(found.std, stated().std)
