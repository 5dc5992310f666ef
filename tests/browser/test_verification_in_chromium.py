"""The page of ``verify`` in a real browser: pictures in nested details are drawn when they open, and fit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tests.browser.chromium import SETTLED, asked, elements
from tests.unit.report.sample import HOSTILE
from tests.unit.report.verification_sample import verified

from rotorid.report.verification import render_checks

PROBE = (
    f"async () => {{{SETTLED}"
    + """
  await openAll(document.querySelectorAll("details"));
  await settled();
  const seen = (place) => [
    place.dataset.picture, Boolean(place.data) && Math.abs(place.clientWidth - place._fullLayout.width) < 2,
  ];
  return Object.fromEntries(Array.from(document.querySelectorAll("[data-picture]"), seen));
}
"""
)


def test_all_pictures_are_drawn_in_their_width(alone: Any, tmp_path: Path) -> None:
    drawn, said = asked(alone, render_checks(*verified(), title="t"), tmp_path, PROBE)
    assert drawn == dict.fromkeys(("check-0", "check-0-ahead", "check-0-loop", "sweeps-0-0"), True)
    assert said == []


ONE_IS_SLOW = """
async () => {
  const told = () => document.documentElement.dataset.pictures;
  const [slow, quick] = document.querySelectorAll("[data-picture]");
  const react = Plotly.react;
  let release;
  const held = new Promise((done) => { release = done; });
  Plotly.react = async (place, ...drawn) => {
    if (place === slow) await held;
    return react(place, ...drawn);
  };
  const last = rotorid.redraw([slow]);
  await rotorid.redraw([quick]);
  const between = told();
  release();
  await last;
  return [between, told()];
}
"""


def test_pictures_are_drawn_when_the_last_of_them_is(alone: Any, tmp_path: Path) -> None:
    """Details that open one inside the other ask for their pictures at once, and the inner may be done first."""
    told, said = asked(alone, render_checks(*verified(), title="t"), tmp_path, ONE_IS_SLOW)
    assert told == ["drawing", "drawn"]
    assert said == []


def test_a_hostile_log_cannot_act(alone: Any, tmp_path: Path) -> None:
    _, said = elements(alone, render_checks(*verified(record=HOSTILE), title=HOSTILE), tmp_path)
    assert said == []
