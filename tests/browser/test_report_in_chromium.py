"""The report in a real browser: pictures are drawn, nothing complains, nothing hostile runs."""

from __future__ import annotations

import dataclasses
import shutil
import subprocess
from pathlib import Path

import pytest
from tests.unit.report.sample import HOSTILE, doublet, identification

from rotorid.report.page import render_report

NAMES = ("chromium", "chromium-browser", "google-chrome")
QUIET = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--enable-logging=stderr",
    "--virtual-time-budget=10000",
)


@pytest.fixture(scope="module")
def chromium() -> str:
    found = next((path for name in NAMES if (path := shutil.which(name))), None)
    if found is None:
        pytest.skip(f"no browser: none of {', '.join(NAMES)} is on the path")
    return found


def dump(chromium: str, html: str, folder: Path) -> tuple[str, list[str]]:
    """The page's elements after its scripts ran, and what it wrote to the console."""
    file = folder / "report.html"
    file.write_text(html, encoding="utf-8")
    command = [chromium, *QUIET, f"--user-data-dir={folder / 'profile'}", "--dump-dom", file.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, encoding="utf-8", timeout=120, check=True)
    return done.stdout, [line for line in done.stderr.splitlines() if "CONSOLE" in line]


def test_pictures_are_drawn_and_hostile_text_stays_text(chromium: str, tmp_path: Path) -> None:
    hostile = dataclasses.replace(identification(record=HOSTILE), verifications=(doublet(record=HOSTILE),))
    html = render_report([identification(), hostile], title="<img src=x onerror=document.title='run'>")
    elements, console = dump(chromium, html, tmp_path)
    assert console == []
    assert 'data-pictures="drawn"' in elements
    body = elements[elements.index("<body") :]
    pictures = html.count("data-picture=")
    # Plotly draws each picture in layers; the first of them carries the axes.
    assert body.count('class="cartesianlayer"') == pictures == 6
    assert "<title>run</title>" not in elements


def test_injected_script_would_be_refused(chromium: str, tmp_path: Path) -> None:
    """The policy holds even if escaping failed somewhere."""
    html = render_report([identification()], title="t")
    injected = html.replace("<main>", "<main><script>document.title = 'run'</script>", 1)
    assert injected != html
    elements, console = dump(chromium, injected, tmp_path)
    assert "<title>t</title>" in elements
    assert any("Content Security Policy" in line for line in console)
