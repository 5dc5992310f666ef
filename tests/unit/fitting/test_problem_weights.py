"""Weights, pairs and bands of a problem, and responses that are zero."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest
from tests.unit.fitting.known_models import measured, posed

from rotorid.errors import UsageError
from rotorid.fitting.frequency.fit import fit_frequency
from rotorid.fitting.frequency.problem import (
    FrequencyProblem,
    log_error,
    only_pairs,
    pair_costs,
    pair_names,
    point_weights,
    within_bands,
)
from rotorid.fitting.frequency.screening import without_structural_zeros
from rotorid.models.library import library_model
from rotorid.models.toml import from_toml

OMEGA = np.geomspace(1.0, 30.0, 25)
TWO = """
name = "two"
inputs = ["a", "b"]
states = ["x"]
outputs = ["p", "q"]
F = [["d"]]
G = [["g", "h"]]
H0 = [[1], ["k"]]
input_delays = ["t", 0]
[parameters.d]
value = -2.0
[parameters.g]
value = 5.0
[parameters.h]
value = -3.0
[parameters.k]
value = 0.5
[parameters.t]
value = 0.02
"""
STRUCTURE = from_toml(TWO)
TRUTH = STRUCTURE.parameters.values
OFF = np.array([-3.0, 4.0, -2.0, 0.7, 0.01])


def two(**change: object) -> FrequencyProblem:
    return replace(posed(STRUCTURE, TRUTH, OMEGA, noise=0.05), **change)


def test_weights_change_what_is_minimized_and_not_what_is_reported() -> None:
    plain, heavy = two(), two(pair_weights={"q/a": 4.0, "p/b": 0.25})
    np.testing.assert_array_equal(heavy.costs(OFF), plain.costs(OFF))
    residual, _ = heavy.residuals(OFF)
    expected = np.sum(plain.costs(OFF) * np.array([[1.0, 0.25], [4.0, 1.0]]))
    assert residual @ residual == pytest.approx(expected, rel=1e-12)
    heavy_fit, plain_fit = fit_frequency(heavy), fit_frequency(plain)
    assert heavy.costs(heavy_fit.theta)[1, 0] < plain.costs(plain_fit.theta)[1, 0]


def test_the_phase_weight_scales_the_phase_part() -> None:
    plain, heavy = two(), two(phase_weight=3.0 * two().phase_weight)
    half = plain.points.values.size
    one, other = plain.residuals(OFF)[0] ** 2, heavy.residuals(OFF)[0] ** 2
    np.testing.assert_allclose(other[:half], one[:half], rtol=1e-12)
    np.testing.assert_allclose(other[half:], 3.0 * one[half:], rtol=1e-12)
    np.testing.assert_array_equal(heavy.costs(OFF), plain.costs(OFF))


def test_weights_survive_pickling_and_cannot_be_changed() -> None:
    given = {"q/a": 4.0}
    problem = two(pair_weights=given)
    given["q/a"] = 9.0
    again = pickle.loads(pickle.dumps(problem))
    assert dict(again.pair_weights) == {"q/a": 4.0}
    with pytest.raises(TypeError):
        again.pair_weights["q/a"] = 1.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pair_weights": {"q/aa": 2.0}}, "unknown response 'q/aa'; did you mean q/a"),
        (
            {"pair_weights": {"q/a": 0.0}},
            "the weight 0 of q/a is not a positive number; leave the response out",
        ),
        ({"pair_weights": {"q/a": float("nan")}}, "the weight nan of q/a is not a positive number"),
        ({"phase_weight": -1.0}, "the phase weight -1 is not"),
        ({"phase_weight": float("inf")}, "the phase weight inf is not"),
    ],
)
def test_wrong_weights_are_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        two(**change)


def test_pairs_are_chosen_by_name() -> None:
    problem = two()
    assert pair_names(problem.data) == ("p/a", "p/b", "q/a", "q/b")
    kept = only_pairs(problem.used, problem.data, ["q/a", "p/b"])
    assert kept.any(axis=-1).tolist() == [[False, True], [True, False]]
    np.testing.assert_array_equal(kept[1, 0], problem.used[1, 0])
    with pytest.raises(UsageError, match=r"unknown response 'p/c'.*did you mean p/"):
        only_pairs(problem.used, problem.data, ["p/c"])


def test_bands_hold_for_their_pair_alone() -> None:
    problem = two()
    kept = within_bands(problem.used, problem.data, {"q/a": (float(OMEGA[5]), float(OMEGA[20]))})
    assert np.flatnonzero(kept[1, 0]).tolist() == list(range(5, 21))
    assert kept.sum() == problem.used.sum() - (OMEGA.size - 16)
    assert problem.used.all()
    with pytest.raises(UsageError, match="the band 5 to 2 rad/s of q/a is empty"):
        within_bands(problem.used, problem.data, {"q/a": (5.0, 2.0)})


def test_responses_that_no_parameter_makes_are_taken_out() -> None:
    structure = library_model("hover.lateral").select(outputs=("p", "r", "phi"))
    parameters = structure.parameters
    for name in ("L_r", "L_v", "L_yaw", "Y_r", "Y_yaw", "Y_p", "T_motor"):
        parameters = parameters.drop(name)
    truth = dict.fromkeys(structure.parameters.names, 1.0)
    problem = replace(posed(structure, truth, OMEGA), parameters=parameters)
    smaller, names = without_structural_zeros(problem)
    # Without L_r, L_v and L_yaw nothing leads from yaw to p, nor to its integral.
    assert names == ("p/yaw_command", "phi/yaw_command")
    assert not smaller.used[[0, 2], 1].any()
    np.testing.assert_array_equal(smaller.used[:, 0], problem.used[:, 0])
    assert without_structural_zeros(smaller) == (smaller, ())


def test_a_parameter_that_is_zero_now_is_no_structural_zero() -> None:
    problem = two()
    zero = problem.with_parameters(problem.parameters.with_values({"k": 0.0, "h": 0.0}))
    assert without_structural_zeros(zero)[1] == ()
    fixed = problem.with_parameters(problem.parameters.fix("k", 0.0))
    assert without_structural_zeros(fixed)[1] == ("q/a", "q/b")


def test_a_response_of_zero_has_a_finite_cost_and_a_way_out() -> None:
    """No warning (they are errors here), and the slope leads up toward the data."""
    problem = two()
    theta = np.array([-2.0, 0.0, 0.0, 0.0, 0.02])
    residual, jacobian = problem.residuals(theta)
    assert np.isfinite(residual).all()
    assert np.isfinite(jacobian).all()
    assert np.isfinite(problem.costs(theta)).all()
    assert residual @ residual == pytest.approx(float(problem.costs(theta).sum()), rel=1e-12)
    step = -(jacobian.T @ residual)
    assert step[1] > 0.0 > step[2]
    # 20 log10 of 1e-4, and one neper more at the end of the straight line.
    assert log_error(np.zeros(1, dtype=complex), np.ones(1))[0] == pytest.approx(np.log(1e-4) - 1.0)


def test_jacobian_near_zero_is_that_of_the_straight_line() -> None:
    problem = two()
    theta = np.array([-2.0, 1e-5, -2e-5, 1e-3, 0.02])
    _, jacobian = problem.residuals(theta)
    for slot in range(theta.size):
        step = 1e-6 * np.eye(theta.size)[slot] * max(abs(theta[slot]), 1e-4)
        difference = (problem.residuals(theta + step)[0] - problem.residuals(theta - step)[0]) / (2.0 * step[slot])
        # Central differences of a smooth function: rounding is 1e-16 of residuals near 100 over a step of 1e-10.
        np.testing.assert_allclose(jacobian[:, slot], difference, rtol=1e-5, atol=1e-5 * np.abs(difference).max())


def test_a_model_above_the_floor_is_not_touched() -> None:
    rng = np.random.default_rng(0)
    model = (rng.standard_normal(50) + 1j * rng.standard_normal(50)) * 10.0 ** rng.uniform(-3.9, 4.0, 50)
    data = np.exp(1j * rng.uniform(-3.0, 3.0, 50))
    large = np.abs(model) > 1e-4
    np.testing.assert_array_equal(log_error(model, data)[large], np.log(model / data)[large])


def test_points_that_do_not_count_may_be_zero_over_zero() -> None:
    data = measured(STRUCTURE, TRUTH, OMEGA)
    values = data.values.copy()
    values[0, 0, 3] = 0.0
    used = np.ones(values.shape, dtype=np.bool_)
    used[0, 0, 3] = False
    holed = replace(data, values=values)
    np.testing.assert_allclose(pair_costs(values, values, point_weights(holed, used)), 0.0, atol=1e-20)
