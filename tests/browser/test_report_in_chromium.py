"""The report in a real browser: pictures are drawn, nothing complains, nothing hostile runs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tests.browser.chromium import elements
from tests.unit.report.hover_sample import hover_identification
from tests.unit.report.sample import HOSTILE, doublet, identification, shown_with

from rotorid.report.identification import render_sections


def test_pictures_are_drawn_and_hostile_text_stays_text(alone: Any, tmp_path: Path) -> None:
    hostile = shown_with(identification(record=HOSTILE), verifications=(doublet(record=HOSTILE),))
    html = render_sections([identification(), hostile], title="<img src=x onerror=document.title='run'>")
    # Folded pictures are drawn when their part is opened: here all of them are open from the start.
    seen, console = elements(alone, html.replace("<details", "<details open"), tmp_path)
    assert console == []
    assert 'data-pictures="drawn"' in seen
    body = seen[seen.index("<body") :]
    pictures = html.count("data-picture=")
    # Plotly draws each picture in layers; the first of them carries the axes.
    assert body.count('class="cartesianlayer"') == pictures == 10
    assert "<title>run</title>" not in seen


def test_injected_script_would_be_refused(alone: Any, tmp_path: Path) -> None:
    """The policy holds even if escaping failed somewhere."""
    html = render_sections([identification()], title="t")
    injected = html.replace('<main id="main" tabindex="-1">', "<main><script>document.title = 'run'</script>", 1)
    assert injected != html
    seen, console = elements(alone, injected, tmp_path)
    assert "<title>t</title>" in seen
    assert any("Content Security Policy" in line for line in console)


def test_a_hover_model_is_drawn_and_fits_the_window(alone: Any, tmp_path: Path) -> None:
    html = render_sections([hover_identification()], title="Pitch and heave")
    seen, console = elements(alone, html.replace("<details", "<details open"), tmp_path)
    assert console == []
    assert 'data-pictures="drawn"' in seen
    body = seen[seen.index("<body") :]
    assert body.count('class="cartesianlayer"') == html.count("data-picture=") == 14
    # Bars of the map of correlations: one cell for each of 21 pairs.
    assert body.count('<g class="point"') == 21
