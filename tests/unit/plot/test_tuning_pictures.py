"""Pictures of gains: bands and lines of the one painter of curves, in all units of the page."""

from __future__ import annotations

import json

import numpy as np
import pytest

from rotorid.plot.curves import Magnitude
from rotorid.plot.tuning import by_hand, responses, steps

OMEGA = np.geomspace(1.0, 100.0, 20)


def found(size: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    ones = np.ones(OMEGA.size)
    return 0.9 * size * ones, size * ones, 1.1 * size * ones


@pytest.mark.parametrize(("magnitude", "height"), [("dB", 20.0), ("linear", 10.0)])
def test_sizes_stand_in_the_unit_of_the_page(magnitude: Magnitude, height: float) -> None:
    both = {"flown": found(10.0), "proposed": found(1.0)}
    figure = responses(OMEGA, both, label="Sensitivity", seen_rad_s=(2.0, 20.0), frequency="Hz", magnitude=magnitude)
    assert json.loads(json.dumps(figure, allow_nan=False)) == figure
    drawn = [trace for trace in figure["data"] if "fill" not in trace]
    assert [trace["name"] for trace in drawn if trace["showlegend"]] == ["flown", "proposed"]
    seen = (OMEGA >= 2.0) & (OMEGA <= 20.0)
    flown, beyond = (trace for trace in drawn if trace["name"] == "flown")
    # Solid where the plant was measured, dotted beyond.
    assert [one is not None for one in flown["y"]] == seen.tolist()
    assert [one is not None for one in beyond["y"]] == (~seen).tolist()
    assert (flown["line"]["dash"], beyond["line"]["dash"]) == ("solid", "dot")
    assert [one for one in flown["y"] if one is not None] == pytest.approx([height] * int(seen.sum()))
    assert drawn[0]["x"][0] == pytest.approx(1.0 / (2.0 * np.pi), rel=1e-4)
    assert figure["layout"]["shapes"][0]["x1"] == pytest.approx(20.0 / (2.0 * np.pi))
    assert figure["layout"]["xaxis"]["title"]["text"] == "Frequency [Hz]; shaded where the plant was seen"


def test_an_answer_by_nothing_is_a_gap() -> None:
    figure = responses(OMEGA, {"flown": found(0.0)}, label="Roll over its set-point")
    (drawn,) = figure["data"]
    assert set(drawn["y"]) == {None}
    assert figure["layout"]["shapes"] == []


def test_steps_and_the_picture_by_hand_look_alike() -> None:
    flown = steps(OMEGA, {"flown": found(1.0), "proposed": found(1.0)}, axis="roll")
    chosen = by_hand("roll")
    assert [trace["name"] for trace in chosen["data"]] == ["flown", "chosen"]
    lines = [trace["line"] for trace in flown["data"] if "fill" not in trace]
    assert [trace["line"] for trace in chosen["data"]] == lines
    assert chosen["layout"]["annotations"] == flown["layout"]["annotations"]
