"""The documentation as a site: it builds without a warning, asks the network for nothing, and shows in a browser."""

from __future__ import annotations

import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
from tests.browser.chromium import QUIET, browser
from tests.browser.lab_page import chromium, violations

from rotorid.cli.app import COMMANDS

ROOT = Path(__file__).resolve().parents[2]
WIDTHS = (1300, 400)
LOOKED_AT = ("index.html", "tutorials/my-gains.html", "commands/identify.html", "results.html", "peers.html")
"""A page of each kind: the first one, a tutorial, options of a command, kinds of findings, wide tables."""


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


class Quiet(SimpleHTTPRequestHandler):
    """Serves files, and says nothing of it."""

    def log_message(self, format: str, *args: Any) -> None:
        """Nothing."""


@pytest.fixture(scope="module")
def address(site: Path) -> Iterator[str]:
    """Where the site is served, as it would be published."""
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(site))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()


@pytest.fixture(scope="module")
def window(address: str) -> Iterator[tuple[Any, list[str]]]:
    """A page of a browser, and all that it asked of anybody but the site."""
    pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    browser()
    with chromium() as started:
        context, foreign = started.new_context(viewport={"width": WIDTHS[0], "height": 900}), list[str]()
        own = (address, "data:", "blob:")
        context.on("request", lambda asked: None if asked.url.startswith(own) else foreign.append(asked.url))
        context.route(lambda url: not url.startswith(own), lambda route: route.abort())
        yield context.new_page(), foreign
        context.close()


@pytest.mark.slow
@pytest.mark.parametrize("name", LOOKED_AT)
@pytest.mark.parametrize("width", WIDTHS)
def test_pages_are_for_everybody(window: tuple[Any, list[str]], address: str, name: str, width: int) -> None:
    pytest.importorskip("axe_playwright_python", reason="axe_playwright_python is not installed")
    page, _ = window
    page.set_viewport_size({"width": width, "height": 900})
    page.goto(f"{address}{name}")
    assert violations(page) == []
    assert page.evaluate("document.documentElement.scrollWidth") <= width, "the page is wider than the window"


@pytest.mark.slow
def test_no_page_asks_anybody_but_its_own_site(window: tuple[Any, list[str]], address: str, site: Path) -> None:
    page, foreign = window
    for file in sorted(site.rglob("*.html")):
        page.goto(f"{address}{file.relative_to(site).as_posix()}")
    assert foreign == []
