"""Pictures of searches: every generation and every acceleration where it belongs."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from rotorid.errors import UsageError
from rotorid.plot.search import ACCELERATIONS, accelerations, clusters, convergence
from rotorid.search.result import Progress

TRACE = (Progress(15, np.inf), Progress(30, 2.0), Progress(45, 0.5))


def drawn(figure: dict[str, Any]) -> dict[str, Any]:
    back: dict[str, Any] = json.loads(json.dumps(figure, allow_nan=False))
    return back


def test_every_generation_with_a_cost_is_a_point() -> None:
    figure = drawn(convergence({"genetic": TRACE, "<b>": TRACE[1:]}, levels={"at the truth": 0.4}))
    first, second, level = figure["data"]
    assert (first["x"], first["y"]) == ([30.0, 45.0], [2.0, 0.5])
    assert second["name"] == "&lt;b&gt;"
    assert (level["x"], level["y"]) == ([0.0, 45.0], [0.4, 0.4])
    axis = figure["layout"]["yaxis"]
    assert axis["type"] == "log"
    assert axis["range"][0] < np.log10(0.4) < np.log10(2.0) < axis["range"][1]
    assert any(0.4 <= tick <= 2.0 for tick in axis["tickvals"])


def test_a_cost_of_zero_has_no_logarithm() -> None:
    figure = drawn(convergence({"exact": [Progress(1, 1.0), Progress(2, 0.0)]}))
    assert "type" not in figure["layout"]["yaxis"]


def test_a_search_is_needed() -> None:
    with pytest.raises(UsageError, match="trace"):
        convergence({})


def test_each_panel_has_what_was_measured_and_what_is_modeled() -> None:
    time_s = np.arange(50) / 100.0
    measured = np.arange(4.0)[:, None] + np.sin(time_s)
    figure = drawn(accelerations(time_s, measured, measured + 1.0))
    for row, (label, factor) in enumerate(ACCELERATIONS):
        axis = "y" if row == 0 else f"y{row + 1}"
        one, other = (trace for trace in figure["data"] if trace["yaxis"] == axis)
        assert (one["name"], other["name"]) == ("measured", "modeled")
        # Five digits are kept.
        np.testing.assert_allclose(one["y"], measured[row] * factor, rtol=1e-4, atol=1e-4)
        np.testing.assert_allclose(other["y"], (measured[row] + 1.0) * factor, rtol=1e-4, atol=1e-4)
        assert figure["layout"]["annotations"][row]["text"] == label


def test_shapes_must_agree() -> None:
    with pytest.raises(UsageError, match="shape"):
        accelerations(np.zeros(5), np.zeros((4, 5)), np.zeros((3, 5)))


def test_points_go_to_the_candidate_that_owns_them() -> None:
    costs = np.array([[9.0, np.inf, 7.0], [3.0, 5.0, 6.0]])
    owners, places = np.array([[0, 2, 2, 0], [0, 1, 2, 0]]), np.array([1.0, 2.0, 4.0, 8.0])
    figure = drawn(clusters(np.where(np.isfinite(costs), costs, np.nan), owners, places=places, place="frequency"))
    for number in range(3):
        trace = figure["data"][number]
        assert trace["name"] == f"candidate {number + 1}"
        assert trace["y"] == [places[point] for row in owners for point in np.flatnonzero(row == number)]
    assert figure["data"][4]["y"] == [None, 5.0]
    with pytest.raises(UsageError, match="owner"):
        clusters(costs, owners, places=places[:3])
