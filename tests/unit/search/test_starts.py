"""Starts of local searches, and the minima they end in."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fitting.least_squares import LevenbergMarquardt, best_of
from rotorid.fitting.problem import StartBox
from rotorid.search.starts import at_random, central_composite, sobol
from rotorid.typing import FloatArray

Design = Callable[[StartBox, np.random.Generator], FloatArray]
BOX = StartBox(lower=np.array([-1.0, 0.01, -100.0]), upper=np.array([3.0, 1.0, -1.0]),
               scales=("linear", "logarithmic", "logarithmic"))  # fmt: skip
DESIGNS: dict[str, Design] = {
    "composite": lambda box, _: central_composite(box),
    "sobol": lambda box, rng: sobol(box, 50, rng=rng),
    "random": lambda box, rng: at_random(box, 50, rng=rng),
}


@pytest.mark.parametrize("design", DESIGNS.values(), ids=DESIGNS)
def test_points_lie_in_the_box_and_repeat_with_the_seed(design: Design) -> None:
    first, again = (design(BOX, np.random.default_rng(5)) for _ in range(2))
    np.testing.assert_array_equal(first, again)
    rounding = 1e-12 * np.abs(BOX.upper - BOX.lower)
    assert np.all(first >= BOX.lower - rounding)
    assert np.all(first <= BOX.upper + rounding)


@pytest.mark.parametrize(("k", "centers", "points"), [(2, 1, 9), (8, 1, 273), (3, 4, 18)])
def test_central_composite_has_its_number_of_points(k: int, centers: int, points: int) -> None:
    box = StartBox(lower=-np.ones(k), upper=np.ones(k), scales=("linear",) * k)
    design = central_composite(box, centers=centers)
    assert design.shape == (points, k)
    assert len(np.unique(design, axis=0)) == points - centers + 1
    # Corners and star of a design that can be rotated stand at 2^(k/4) to 1.
    corners = design[centers : centers + 2**k]
    np.testing.assert_allclose(np.abs(corners), 2.0 ** (-k / 4.0))


def test_central_composite_of_many_parameters_is_refused() -> None:
    box = StartBox(lower=-np.ones(26), upper=np.ones(26), scales=("linear",) * 26)
    with pytest.raises(UsageError, match="67108917"):
        central_composite(box)


def test_logarithmic_sides_are_even_in_their_logarithm() -> None:
    share = sobol(BOX, 256, rng=np.random.default_rng(0))
    assert np.median(np.log10(share[:, 1])) == pytest.approx(-1.0, abs=0.02)
    assert np.median(np.log10(-share[:, 2])) == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize(
    ("lower", "upper", "scale"),
    [(1.0, 1.0, "linear"), (0.0, np.inf, "linear"), (-1.0, 1.0, "logarithmic"), (0.0, 1.0, "logarithmic")],
)
def test_sides_that_cannot_be_divided_are_refused(lower: float, upper: float, scale: str) -> None:
    with pytest.raises(UsageError):
        StartBox(lower=np.array([lower]), upper=np.array([upper]), scales=(scale,))  # type: ignore[arg-type]


def valleys(x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Four minima at (±1, ±1), which differ a little."""
    left = np.concatenate([x**2 - 1.0, 0.1 * (x - np.array([1.0, 2.0]))])
    return left, np.vstack([np.diag(2.0 * x), 0.1 * np.eye(2)])


def test_all_minima_are_kept() -> None:
    wide = np.full(2, np.inf)
    box = StartBox(lower=np.full(2, -2.0), upper=np.full(2, 2.0), scales=("linear", "linear"))
    ends = [LevenbergMarquardt().minimize(valleys, start, -wide, wide) for start in central_composite(box)]
    found = best_of(ends, name="valleys")
    assert np.all(np.sign(found.theta) == [1.0, 1.0])
    corners = {tuple(np.sign(theta)) for _, theta in found.others if abs(theta).min() > 0.5}
    assert corners == {(1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)}
    costs = [found.cost, *(cost for cost, _ in found.others)]
    assert costs == sorted(costs)


def test_no_usable_start_is_said() -> None:
    def nowhere(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        return np.array([np.nan]), np.array([[np.nan]])

    wide = np.array([np.inf])
    with pytest.raises(InsufficientDataError, match="nowhere"):
        best_of([LevenbergMarquardt().minimize(nowhere, np.zeros(1), -wide, wide)], name="nowhere")
