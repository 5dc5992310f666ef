"""The map of correlations: a cell for every two parameters, and nothing twice."""

from __future__ import annotations

import itertools
import json
from typing import Any

import numpy as np
import pytest

from rotorid.errors import UsageError
from rotorid.plot.figure import MEASURED, MODEL, translucent
from rotorid.plot.loops import LABELED, correlation_map

NAMES = ("M_q", "M_u", "M_pitch", "tau_pitch")
MATRIX = np.array([[1.0, 0.93, -0.2, 0.1], [0.93, 1.0, -0.6, np.nan], [-0.2, -0.6, 1.0, 0.0], [0.1, np.nan, 0.0, 1.0]])


def drawn(**changes: Any) -> dict[str, Any]:
    options: dict[str, Any] = {"names": NAMES, "correlation": MATRIX, **changes}
    back: dict[str, Any] = json.loads(json.dumps(correlation_map(**options), allow_nan=False))
    return back


def test_every_two_parameters_have_one_cell_that_says_so() -> None:
    cells, _ = drawn()["data"]
    at = {(NAMES[round(base + 0.47)], NAMES[x]) for x, base in zip(cells["x"], cells["base"], strict=True)}
    assert {frozenset(pair) for pair in at} == {frozenset(pair) for pair in itertools.combinations(NAMES, 2)}
    assert len(cells["x"]) == len(at) == 6
    assert "M_u and M_q: 0.93" in cells["text"]
    assert "tau_pitch and M_u: unknown" in cells["text"]


def test_strong_ones_carry_their_number() -> None:
    _, words = drawn()["data"]
    assert sorted(zip(words["x"], words["y"], words["text"], strict=True)) == [(0, 1, "93"), (1, 2, "−60")]
    assert all(abs(float(one.replace("−", "-"))) >= 100.0 * LABELED for one in words["text"])


def test_color_tells_the_sign_and_its_fill_the_strength() -> None:
    cells, _ = drawn()["data"]
    color = dict(zip(cells["text"], cells["marker"]["color"], strict=True))
    assert color["M_u and M_q: 0.93"].startswith(translucent(MEASURED, 0.5)[:-4])
    assert color["M_pitch and M_u: −0.60"].startswith(translucent(MODEL, 0.5)[:-4])
    opacity = {name: float(one.rstrip(")").split(",")[-1]) for name, one in color.items()}
    assert opacity["M_u and M_q: 0.93"] > opacity["M_pitch and M_u: −0.60"] > opacity["M_pitch and M_q: −0.20"] > 0.0


def test_names_stand_on_both_axes_as_text() -> None:
    layout = drawn(names=("<b>", *NAMES[1:]))["layout"]
    assert layout["xaxis"]["ticktext"] == ["&lt;b&gt;", "M_u", "M_pitch"]
    assert layout["yaxis"]["ticktext"] == ["M_u", "M_pitch", "tau_pitch"]
    low, high = layout["yaxis"]["range"]
    assert low > high, "the first parameter stands on top"


@pytest.mark.parametrize("wrong", [{"names": ["a"], "correlation": np.eye(1)}, {"correlation": np.eye(3)}])
def test_what_makes_no_map_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(UsageError, match="two names and more"):
        drawn(**wrong)
