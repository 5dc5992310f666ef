"""A figure as a notebook shows it: a page of its own, which draws without a network."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tests.browser.chromium import elements

from rotorid.plot import Figure

HOSTILE = "</script><script>document.title = 'run'</script>"


def test_a_figure_draws_itself(alone: Any, tmp_path: Path) -> None:
    figure = Figure(
        data=[{"type": "scatter", "x": [1.0, 2.0], "y": [3.0, 5.0], "name": HOSTILE}], layout={"height": 300}
    )
    drawn = "document.querySelector('.trace') !== null"
    dom, console = elements(alone, figure.to_html(), tmp_path, ready=drawn)
    assert dom.count('class="trace scatter') == 1
    assert "<title>run</title>" not in dom
    assert console == []
