"""The page of responses in a real browser: pictures in every unit, those in closed details when they open."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.browser.chromium import SETTLED, asked, elements
from tests.unit.report.response_sample import responses
from tests.unit.report.sample import HOSTILE

from rotorid.report.frame import Picture
from rotorid.report.response import bands_picture, loop_pictures, render_responses, response_pictures, window_pictures

PROBE = (
    f"async () => {{{SETTLED}"
    + """
  for (const value of %s) document.querySelector(`button[value="${value}"]`).click();
  const folded = document.querySelectorAll("details:not([open]) [data-picture]");
  const before = Array.from(folded, (place) => Boolean(place.data));
  await openAll(document.querySelectorAll("details"));
  await settled();
  const seen = (place) => [place.dataset.picture, {
    data: place.data.map(({ name, x, y, text }) => ({ name, x, y, text })),
    title: place.layout.xaxis.title.text,
    fits: Math.abs(place.clientWidth - place._fullLayout.width) < 2,
  }];
  return {
    before,
    pictures: Object.fromEntries(Array.from(document.querySelectorAll("[data-picture]"), seen)),
    pressed: Array.from(document.querySelectorAll('[aria-pressed="true"]'), (one) => one.value),
  };
}
"""
)


Probed = Callable[..., dict[str, Any]]


@pytest.fixture(scope="module")
def probed(alone: Any, tmp_path_factory: pytest.TempPathFactory) -> Probed:
    """What the page shows after buttons were pressed, each choice of them once."""

    @cache
    def probe(*buttons: str) -> dict[str, Any]:
        folder, script = tmp_path_factory.mktemp("responses"), PROBE % json.dumps(buttons)
        answer, console = asked(alone, render_responses(responses(), title="t"), folder, script)
        assert console == []
        return dict(answer)

    return probe


def drawn_by_python() -> list[Picture]:
    result = responses()
    return [
        bands_picture(result),
        *response_pictures(result),
        *window_pictures(result),
        *loop_pictures("roll", result.loops["roll"]),
    ]


@pytest.mark.parametrize(
    "buttons", [[], ["rad/s", "linear"], *(pytest.param([one], marks=pytest.mark.slow) for one in ("rad/s", "linear"))]
)
def test_every_picture_is_what_python_would_draw(probed: Probed, buttons: list[str]) -> None:
    shown = probed(*buttons)
    # The log is of an autopilot whose pilots think in Hz.
    frequency, magnitude = "rad/s" if "rad/s" in buttons else "Hz", "linear" if "linear" in buttons else "dB"
    assert set(shown["pressed"]) == {frequency, magnitude}
    for picture in drawn_by_python():
        expected = picture.views.get(f"{frequency} {magnitude}") or picture.views[frequency]
        there = shown["pictures"][picture.key]
        assert there["title"] == expected["layout"]["xaxis"]["title"]["text"] == f"Frequency [{frequency}]"
        for drawn, meant in zip(there["data"], expected["data"], strict=True):
            assert drawn.get("name") == meant.get("name")
            assert drawn.get("text") == meant.get("text")
            for axis in ("x", "y"):
                # Half a unit of the fifth digit in both, and of decibels: 5e-5 * 100 dB * ln(10) / 20.
                np.testing.assert_allclose(*(np.array(of[axis], dtype=float) for of in (drawn, meant)), rtol=7e-4)


def test_pictures_in_closed_details_are_drawn_in_full_width_when_they_open(probed: Probed) -> None:
    shown = probed()
    assert shown["before"]
    assert not any(shown["before"])
    assert all(picture["fits"] for picture in shown["pictures"].values())


def test_a_hostile_log_draws_and_does_nothing_else(alone: Any, tmp_path: Path) -> None:
    title = "<img src=x onerror=document.title='run'>"
    seen, console = elements(alone, render_responses(responses(record=HOSTILE), title=title), tmp_path)
    assert console == []
    assert 'data-pictures="drawn"' in seen
    assert "<title>run</title>" not in seen
