"""A reader turns the Bode plots of a report to hertz and to plain factors, by mouse or by keyboard."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.browser.chromium import SETTLED, asked
from tests.unit.report.sample import identification

from rotorid.report.identification import render_sections, section
from rotorid.report.parts import Shown

PROBE = (
    f"async () => {{{SETTLED}"
    + """
  const find = (value) => document.querySelector(`button[value="${value}"]`);
  const places = Array.from(document.querySelectorAll("[data-picture]"));
  const place = places.find((one) => one.dataset.picture.includes("response"));
  const before = places.map((one) => one.data.map((trace) => trace.x.length));
  %s
  await settled();
  const kept = places.map((one) => one.data.map((trace) => trace.x.length));
  return {
    data: place.data.map(({ name, x, y, customdata, hovertemplate, visible }) =>
      ({ name, x, y, customdata, hovertemplate, visible })),
    title: place.layout.xaxis.title.text,
    label: place.layout.annotations[0].text,
    pressed: Array.from(document.querySelectorAll('[aria-pressed="true"]'), (one) => one.value),
    reachable: Array.from(document.querySelectorAll("button[data-unit]"), (one) => one.tabIndex),
    visible: find("Hz").checkVisibility(),
    same: JSON.stringify(before) === JSON.stringify(kept),
  };
}
"""
)


def probed(chromium: str, folder: Path, identified: Shown, action: str) -> dict[str, Any]:
    """What the page holds after an action."""
    answer: dict[str, Any]
    answer, console = asked(chromium, render_sections([identified], title="t"), folder, PROBE % action)
    assert console == []
    return answer


@pytest.mark.parametrize(
    ("action", "units"),
    [
        ("", "rad/s dB"),
        pytest.param("find('Hz').click();", "Hz dB", marks=pytest.mark.slow),
        pytest.param("find('linear').click();", "rad/s linear", marks=pytest.mark.slow),
        ("find('Hz').click(); find('linear').click();", "Hz linear"),
        pytest.param(
            "find('Hz').click(); find('linear').click(); find('rad/s').click(); find('dB').click();",
            "rad/s dB",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_the_page_shows_what_python_would_draw(chromium: str, tmp_path: Path, action: str, units: str) -> None:
    identified = identification()
    shown = probed(chromium, tmp_path, identified, action)

    expected = section(identified, anchor="s1", truth={}).responses[0].views[units]

    # Fitted and unseen responses have switches of their own, which move together.
    assert shown["pressed"] == 2 * units.split()
    assert shown["title"] == expected["layout"]["xaxis"]["title"]["text"]
    assert shown["label"] == expected["layout"]["annotations"][0]["text"]
    assert len(shown["data"]) == len(expected["data"])
    for drawn, meant in zip(shown["data"], expected["data"], strict=True):
        assert drawn.get("hovertemplate") == meant.get("hovertemplate")
        for key in ("x", "y", "customdata"):
            # Half a unit of the fifth digit in both, and of decibels: 5e-5 * 100 dB * ln(10) / 20.
            np.testing.assert_allclose(*(np.array(of.get(key, []), dtype=float) for of in (drawn, meant)), rtol=7e-4)


def test_other_pictures_stay_and_hidden_curves_stay_hidden(chromium: str, tmp_path: Path) -> None:
    hide = """
      const entry = place.querySelector(".legendtoggle");
      for (const kind of ["mousedown", "mouseup"]) entry.dispatchEvent(new MouseEvent(kind, { bubbles: true }));
      await new Promise((done) => setTimeout(done, 800));  // A click is one when no second follows.
    """
    shown = probed(chromium, tmp_path, identification(), f"{hide} find('Hz').click();")
    assert shown["same"]
    assert shown["title"] == "Frequency [Hz]"
    hidden = {trace["name"] for trace in shown["data"] if trace.get("visible") == "legendonly"}
    assert hidden == {"± 2 σ random error"}


def test_the_switches_are_seen_and_reached_by_keyboard(chromium: str, tmp_path: Path) -> None:
    shown = probed(chromium, tmp_path, identification(), "find('Hz').focus(); document.activeElement.click();")
    assert shown["visible"]
    assert set(shown["reachable"]) == {0}
    assert shown["title"] == "Frequency [Hz]"


def test_without_scripts_no_dead_switch_is_shown() -> None:
    html = render_sections([identification()], title="t")
    assert html.count('<div class="choices" hidden>') == 2
