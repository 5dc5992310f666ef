"""The documentation as a site: it builds without a warning, asks the network for nothing, and shows in a browser."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from tests.browser.chromium import QUIET, browser

from rotorid.cli.app import COMMANDS

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    for needed in ("sphinx", "furo", "myst_nb", "latex2mathml"):
        pytest.importorskip(needed)
    out = tmp_path_factory.mktemp("site") / "site"
    made = subprocess.run(
        [sys.executable, ROOT / "docs" / "site" / "build.py", out], capture_output=True, text=True, check=False
    )
    assert made.returncode == 0, made.stderr
    return out / "html"


@pytest.mark.slow
def test_every_command_has_a_page_with_its_options(site: Path) -> None:
    for name in COMMANDS:
        text = (site / "commands" / f"{name}.html").read_text(encoding="utf-8")
        assert f"<h1>rotorid {name}" in text
    assert "--thrust-exponent" in (site / "commands" / "track.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_nothing_is_asked_of_the_network(site: Path) -> None:
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        loaded = re.findall(r"<(?:script|link|img|iframe)[^>]+(?:src|href)=\"(https?:[^\"]+)\"", text)
        assert not loaded, (page.name, loaded)


@pytest.mark.slow
def test_every_picture_has_words(site: Path) -> None:
    for page in site.rglob("*.html"):
        for tag in re.findall(r"<img [^>]*>", page.read_text(encoding="utf-8")):
            assert re.search(r'alt="[^"]', tag), (page.name, tag)


@pytest.mark.slow
def test_mathematics_and_menu_show_in_a_browser(site: Path, tmp_path: Path) -> None:
    page = site / "fleet.html"
    command = [browser(), *QUIET, f"--user-data-dir={tmp_path}", "--dump-dom", page.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    assert "<math" in done.stdout
    assert "sidebar-tree" in done.stdout
    assert "$" not in re.sub(r"<(pre|code|script)[\s\S]*?</\1>", "", done.stdout)
