"""Every page in a real browser: readable by everybody, on a phone, on paper, and nothing is asked of a network."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from tests.browser.lab_page import chromium, violations

pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
pytest.importorskip("axe_playwright_python", reason="axe_playwright_python is not installed")

MOST_PAGES = {"identify": 10, "review": 8, "tune": 8, "response": 8, "verify": 8, "track": 4, "inspect": 6}
"""Of paper, for a log with sweeps of four axes."""


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """What the commands write of a simulated flight."""
    place = tmp_path_factory.mktemp("pages")

    def run(*words: str) -> None:
        subprocess.run([sys.executable, "-m", "rotorid", *words, "--quiet"], cwd=place, check=True, timeout=300)

    run("example", "px4", "--out", "flown")
    log = "flown/flight.ulg"
    run("identify", log, "--model", "hover.full", "--out", "identify")
    run("identify", log, "--model", "rate.roll,rate.pitch", "--out", "rates")
    run("review", log, "--out", "review")
    run("tune", "rates", log, "--out", "tune")
    run("response", log, "--inputs", "roll_command", "--outputs", "p", "--out", "response")
    run("verify", "rates/rate.roll", log, "--out", "verify")
    run("track", log, "--out", "track")
    run("inspect", log, "--out", "inspect")
    return {name: next((place / name).glob("*.html")) for name in MOST_PAGES}


@pytest.fixture(scope="module")
def started() -> Iterator[Any]:
    with chromium() as browser:
        yield browser


@pytest.mark.parametrize("name", MOST_PAGES)
def test_a_page_is_for_everybody(name: str, pages: dict[str, Path], started: Any) -> None:
    context = started.new_context(viewport={"width": 1300, "height": 900})
    page = context.new_page()
    told: list[str] = []
    page.on("console", lambda message: told.append(message.text))
    page.on(
        "request",
        lambda request: told.append(request.url) if not request.url.startswith(("file:", "data:", "blob:")) else None,
    )
    for theme in ("light", "dark"):
        page.emulate_media(color_scheme=theme)
        page.goto(pages[name].as_uri())
        page.wait_for_selector("html[data-pictures=drawn]")
        assert violations(page) == []
    page.set_viewport_size({"width": 400, "height": 900})
    page.goto(pages[name].as_uri())
    page.wait_for_selector("html[data-pictures=drawn]")
    assert page.evaluate("document.documentElement.scrollWidth") <= 400
    levels = page.evaluate("Array.from(document.querySelectorAll('h1,h2,h3,h4'), (one) => Number(one.tagName[1]))")
    assert levels[0] == 1
    assert all(after - before <= 1 for before, after in pairwise(levels))
    printed = page.pdf(prefer_css_page_size=True)
    assert len(re.findall(rb"/Type\s*/Page[^s]", printed)) <= MOST_PAGES[name]
    assert told == []
    context.close()


def test_tables_are_copied_and_pictures_are_saved_as_lines(pages: dict[str, Path], started: Any) -> None:
    context = started.new_context(viewport={"width": 1300, "height": 900}, accept_downloads=True)
    page = context.new_page()
    page.goto(pages["identify"].as_uri())
    page.wait_for_selector("html[data-pictures=drawn]")
    page.evaluate("navigator.clipboard.writeText = (text) => { window.copied = text; return Promise.resolve(); }")
    page.click("button.copy >> nth=0")
    rows = page.evaluate("window.copied").splitlines()
    assert rows[0].startswith("Parameter,Value,Unit")
    assert any(row.startswith("L_roll") for row in rows)
    page.hover(".picture >> nth=0")
    with page.expect_download() as saved:
        page.click(".picture >> nth=0 >> [data-title*='ownload']")
    assert saved.value.suggested_filename.endswith(".svg")
    context.close()
