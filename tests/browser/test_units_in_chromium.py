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
  const places = Array.from(document.querySelectorAll("[data-picture]")).filter((one) => one.data);
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


def probed(alone: Any, folder: Path, identified: Shown, action: str) -> dict[str, Any]:
    """What the page holds after an action."""
    answer: dict[str, Any]
    answer, console = asked(alone, render_sections([identified], title="t"), folder, PROBE % action)
    assert console == []
    return answer


@pytest.mark.parametrize(
    ("action", "units"),
    [
        ("", "Hz dB"),
        pytest.param("find('rad/s').click();", "rad/s dB", marks=pytest.mark.slow),
        pytest.param("find('linear').click();", "Hz linear", marks=pytest.mark.slow),
        ("find('rad/s').click(); find('linear').click();", "rad/s linear"),
        pytest.param(
            "find('linear').click(); find('rad/s').click(); find('dB').click();",
            "rad/s dB",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_the_page_shows_what_python_would_draw(alone: Any, tmp_path: Path, action: str, units: str) -> None:
    identified = identification()
    shown = probed(alone, tmp_path, identified, action)

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


def test_other_pictures_stay_and_hidden_curves_stay_hidden(alone: Any, tmp_path: Path) -> None:
    hide = """
      const entry = place.querySelector(".legendtoggle");
      for (const kind of ["mousedown", "mouseup"]) entry.dispatchEvent(new MouseEvent(kind, { bubbles: true }));
      await new Promise((done) => setTimeout(done, 800));  // A click is one when no second follows.
    """
    shown = probed(alone, tmp_path, identification(), f"{hide} find('Hz').click();")
    assert shown["same"]
    assert shown["title"] == "Frequency [Hz]"
    hidden = {trace["name"] for trace in shown["data"] if trace.get("visible") == "legendonly"}
    assert hidden == {"± 2 σ random error"}


def test_the_switches_are_seen_and_reached_by_keyboard(alone: Any, tmp_path: Path) -> None:
    shown = probed(alone, tmp_path, identification(), "find('Hz').focus(); document.activeElement.click();")
    assert shown["visible"]
    assert set(shown["reachable"]) == {0}
    assert shown["title"] == "Frequency [Hz]"


WRITTEN = """
<p id='sentence'>Usable from 0.901 to 44 rad/s, crossover at 14.67 ± 0.26 rad/s, 113 ± 2 rad/s², a bias of 0.02 rad/s,
noise 0.077 rad/s a sample, samples outside of -35 to 35 rad/s, the first value is 44 rad/s, speeds of 100 to 900 rad/s;
crossover 7.00 rad/s (6.70 to 7.30 rad/s); <code>--band 3:38 rad/s</code>.</p>
<div class='scroll'><table id='columns'>
<thead><tr><th>Response</th><th>Usable<br>[rad/s]</th><th>Points</th></tr></thead>
<tbody><tr><td>p</td><td>0.901 to 44 <span class='words'>6.70 to 7.30</span></td><td>44</td></tr></tbody></table></div>
<div class='scroll'><table id='rows'><thead><tr><th>Number</th><th>Roll</th><th>Pitch</th></tr></thead><tbody>
<tr><td>crossover [rad/s]</td><td>14.7 <span class='words'>14.2 to 15.2</span></td><td>–</td></tr>
<tr><td>phase margin [°]</td><td>65.0</td><td>60.0</td></tr></tbody></table></div>
<div class='scroll'><table id='units'><thead><tr><th>Number</th><th>Value</th><th>Unit</th></tr></thead><tbody>
<tr><td>Crossover</td><td>(1.467 ± 0.026)·10⁻³</td><td>rad/s</td></tr>
<tr><td><code>h_per_I_zz</code></td><td>14.67</td><td>rad/s</td></tr></tbody></table></div>
"""
READ = """
() => {
  const words = (id) => document.getElementById(id).textContent.replace(/\\s+/g, " ").trim();
  const read = () => Object.fromEntries(["sentence", "columns", "rows", "units"].map((id) => [id, words(id)]));
  const before = read();
  const heads = Array.from(document.querySelectorAll("#rows td, #columns td"), (cell) => cell.dataset.head ?? "");
  document.querySelector("button[value='rad/s']").click();
  return { before, heads, after: read(), said: document.documentElement.dataset.frequency };
}
"""


def test_texts_and_tables_are_in_the_unit_of_the_pictures(alone: Any, tmp_path: Path) -> None:
    html = render_sections([identification()], title="t").replace("</main>", f"{WRITTEN}</main>", 1)
    read, console = asked(alone, html, tmp_path, READ)
    assert console == []
    assert read["said"] == "Hz"
    before = read["before"]
    assert before["sentence"] == (
        "Usable from 0.143 to 7.0 Hz, crossover at 2.335 ± 0.041 Hz, 113 ± 2 rad/s², a bias of 0.02 rad/s, "
        "noise 0.077 rad/s a sample, samples outside of -35 to 35 rad/s, the first value is 44 rad/s, "
        "speeds of 100 to 900 rad/s; crossover 1.114 Hz (1.066 to 1.162 Hz); --band 3:38 rad/s."
    )
    assert "[Hz]Points p0.143 to 7.0 1.066 to 1.16244" in before["columns"]
    assert "crossover [Hz]2.34 2.26 to 2.42– phase margin [°]65.060.0" in before["rows"]
    assert "Crossover(0.2335 ± 0.0041)·10⁻³Hz h_per_I_zz14.67rad/s" in before["units"]
    assert "Usable [Hz]" in read["heads"]
    after = read["after"]
    assert "0.901 to 44 rad/s, crossover at 14.67 ± 0.26 rad/s" in after["sentence"]
    assert "[rad/s]Points p0.901 to 44 6.70 to 7.3044" in after["columns"]
    assert "(1.467 ± 0.026)·10⁻³rad/s" in after["units"]


def test_without_scripts_no_dead_switch_is_shown() -> None:
    html = render_sections([identification()], title="t")
    assert html.count('<div class="choices" hidden>') == 2
