"""Small pictures beside a number: well-formed SVG whose marks are where the numbers are."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
import pytest

from rotorid.plot.miniatures import HEIGHT, WIDTH, bars, curves, intervals, marks


def parsed(picture: str) -> ElementTree.Element:
    return ElementTree.fromstring(picture)


def test_curves_span_the_picture_and_leave_out_what_is_no_number() -> None:
    x = np.linspace(0.0, 2.0, 500)
    svg = parsed(curves({"roll": (x, x), "pitch": (x, np.full(500, np.nan))}, level=1.0, description="A & B"))
    assert svg.get("aria-label") == "A & B"
    limit, line = svg.findall("polyline")
    assert limit.get("class") == "limit"
    points = np.array([point.split(",") for point in (line.get("points") or "").split()], dtype=float)
    assert (points[0, 0], points[-1, 0]) == (0.0, WIDTH)
    assert points[:, 1].min() >= 0.0
    assert points[:, 1].max() <= HEIGHT
    assert len(points) < 200


@pytest.mark.parametrize(("good", "inside"), [("above", True), ("below", False)])
def test_an_interval_is_over_the_good_side_of_its_limit(good: str, inside: bool) -> None:
    svg = parsed(intervals({"roll": (60.0, 50.0, 70.0)}, limit=40.0, good=good, description=""))  # type: ignore[arg-type]
    rect, dot = svg.find("rect"), svg.find("circle")
    assert rect is not None
    assert dot is not None
    start = float(rect.get("x", 0))
    assert (start <= float(dot.get("cx", 0)) <= start + float(rect.get("width", 0))) == inside


def test_bars_are_as_high_as_their_values_and_marks_carry_their_state() -> None:
    low, high = parsed(bars([0.2, 0.4], description="")).findall("rect")
    assert float(high.get("height", 0)) == pytest.approx(2.0 * float(low.get("height", 0)), abs=0.1)
    (mark,) = parsed(marks({"<rate>": "good"}, description="")).findall("circle")
    assert mark.get("class") == "good"


def test_nothing_to_show_is_no_picture() -> None:
    nothing = np.zeros(0)
    assert curves({"roll": (nothing, nothing)}, description="") == intervals(
        {}, limit=1.0, good="above", description=""
    )
    assert bars([], description="") == marks({}, description="") == ""
