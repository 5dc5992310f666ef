"""Least squares, its errors, and the choice of terms."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fitting.equations.regression import CONSTANT, regress, stepwise
from rotorid.typing import FloatArray

NAMES = ("a", "b", "c", "d", "e")


def columns(n: int, seed: int = 3) -> FloatArray:
    return np.random.default_rng(seed).normal(size=(n, len(NAMES))) * np.array([1.0, 1e-3, 1e3, 1.0, 1.0])


def test_agrees_with_the_pseudoinverse_whatever_the_units() -> None:
    x, rng = columns(80), np.random.default_rng(1)
    y = x @ np.array([1.0, 2e3, 3e-3, 0.0, 0.0]) + rng.normal(size=80)
    found = regress(x, y, NAMES)
    full = np.column_stack([x, np.ones(80)])
    inverse = np.linalg.inv(full.T @ full)
    np.testing.assert_allclose(found.estimates, np.linalg.pinv(full) @ y, rtol=1e-9)
    np.testing.assert_allclose(found.covariance, found.residual_variance * inverse, rtol=1e-8, atol=1e-14)
    assert found.names == (*NAMES, CONSTANT)


def test_press_is_the_error_of_leaving_one_out() -> None:
    x, rng = columns(30), np.random.default_rng(2)
    y = x[:, 0] + rng.normal(size=30)
    left_out = 0.0
    for i in range(30):
        rest = np.arange(30) != i
        fit = regress(x[rest], y[rest], NAMES)
        left_out += float((y[i] - np.append(x[i], 1.0) @ fit.estimates) ** 2)
    assert regress(x, y, NAMES).press == pytest.approx(left_out, rel=1e-9)


def test_partial_f_is_what_leaving_a_term_out_costs() -> None:
    x, rng = columns(60), np.random.default_rng(4)
    y = x[:, 0] - 0.5 * x[:, 3] + rng.normal(size=60)
    full, without = regress(x, y, NAMES), regress(np.delete(x, 3, axis=1), y, ("a", "b", "c", "e"))
    cost = float(without.residual @ without.residual - full.residual @ full.residual)
    assert full.partial_f[3] == pytest.approx(cost / full.residual_variance, rel=1e-9)


def test_standard_errors_of_colored_residuals_cover_and_those_of_white_ones_do_not() -> None:
    n, seeds = 400, 300
    slow = np.sin(2.0 * np.pi * np.arange(n) / 100.0)
    inside_colored = inside_white = 0
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        noise = np.zeros(n)
        for k, drive in enumerate(rng.normal(size=n)):
            noise[k] = 0.9 * noise[k - 1] + drive if k else drive
        fit = regress(slow[:, None], 2.0 * slow + noise, ["a"])
        error = abs(fit.estimates[0] - 2.0)
        inside_colored += error < 1.96 * fit.std[0]
        inside_white += error < 1.96 * np.sqrt(fit.covariance[0, 0])
    # A record of some forty correlation lengths: its own autocorrelation is known to about a tenth.
    assert 0.88 <= inside_colored / seeds <= 0.985
    assert inside_white / seeds < 0.75


@pytest.mark.parametrize(
    ("matrix", "target", "names", "error"),
    [
        (np.ones((5, 1)), np.ones(4), ["a"], UsageError),
        (np.full((5, 1), np.nan), np.ones(5), ["a"], UsageError),
        (np.arange(6.0)[:, None], np.ones(6), ["constant"], UsageError),
        (np.ones((5, 1)), np.ones(5), ["a"], InsufficientDataError),
        (np.zeros((5, 1)), np.ones(5), ["a"], InsufficientDataError),
        (np.arange(4.0).reshape(2, 2), np.ones(2), ["a", "b"], InsufficientDataError),
    ],
    ids=["shapes", "not finite", "name twice", "same as constant", "zero", "too few"],
)
def test_wrong_data_are_refused(
    matrix: FloatArray, target: FloatArray, names: list[str], error: type[Exception]
) -> None:
    with pytest.raises(error):
        regress(matrix, target, names)


def test_stepwise_takes_what_matters_and_shows_its_steps() -> None:
    x, rng = columns(300), np.random.default_rng(5)
    y = 2.0 * x[:, 0] + 4e-3 * x[:, 2] + 0.5 * rng.normal(size=300)
    found = stepwise(x, y, NAMES)
    assert set(found.steps[found.chosen].names) == {"a", "c"}
    assert found.regression.press == min(step.press for step in found.steps)
    entered = [step for step in found.steps if step.action == "enter"]
    assert [step.name for step in entered[:2]] == ["c", "a"]
    assert all(step.partial_f >= 4.0 for step in entered)
    assert np.all(np.diff([step.r_squared for step in entered]) >= 0.0)


def test_stepwise_takes_a_term_out_again_that_others_replace() -> None:
    # The third column is nearly the sum of the first two: best alone, of no use beside them.
    rng = np.random.default_rng(7)
    x = rng.normal(size=(400, 2))
    both = x.sum(axis=1) + 0.3 * rng.normal(size=400)
    y = x[:, 0] + x[:, 1] + 0.05 * rng.normal(size=400)
    found = stepwise(np.column_stack([x, both]), y, ["a", "b", "sum"])
    assert found.steps[1].name == "sum"
    assert ("remove", "sum") in [(step.action, step.name) for step in found.steps]
    assert set(found.regression.names) == {"a", "b", CONSTANT}


def test_stepwise_keeps_what_it_is_told_to() -> None:
    x, rng = columns(200), np.random.default_rng(8)
    found = stepwise(x, x[:, 0] + rng.normal(size=200), NAMES, keep=["e"])
    assert all("e" in step.names for step in found.steps)


@pytest.mark.parametrize("change", [{"keep": ["nobody"]}, {"f_to_enter": 2.0, "f_to_remove": 3.0}])
def test_stepwise_refuses_slips(change: dict[str, object]) -> None:
    with pytest.raises(UsageError):
        stepwise(columns(50), np.ones(50), NAMES, **change)  # type: ignore[arg-type]


def test_stepwise_without_anything_to_find_says_so() -> None:
    rng = np.random.default_rng(9)
    with pytest.raises(InsufficientDataError, match="partial F"):
        stepwise(rng.normal(size=(50, 1)), rng.normal(size=50), ["a"], constant=False, f_to_enter=50.0)
