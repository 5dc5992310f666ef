"""A page in a real browser, without a window and without a network."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome")
ALONE = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    # Nothing but files and the server of a test can be reached: every name resolves to nowhere.
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
)
QUIET = ("--headless", *ALONE, "--enable-logging=stderr", "--virtual-time-budget=10000")
LONGEST_MS = 120_000
DRAWN = 'document.documentElement.dataset.pictures === "drawn"'

SETTLED = """
  const settled = async () => {
    const frame = () => new Promise((done) => requestAnimationFrame(done));
    do { await frame(); await frame(); } while (document.documentElement.dataset.pictures === "drawing");
  };
  const openAll = (found) => Promise.all(Array.from(found).filter((details) => !details.open).map(
    (details) => new Promise((told) => {
      details.addEventListener("toggle", told, { once: true });
      details.open = true;
    })));
"""
"""For a script: ``await settled()`` returns when what was pressed or opened is drawn; ``await openAll(details)`` opens
them and returns when the page was told, which is later than they are open."""


def browser() -> str:
    """Path of the browser, or a skip with the reason."""
    found = next((path for name in NAMES if (path := shutil.which(name))), None)
    if found is None:
        pytest.skip(f"no browser: none of {', '.join(NAMES)} is on the path")
    return found


@contextmanager
def started(chromium: str) -> Iterator[Any]:
    """A browser without a network, for :func:`asked` and :func:`elements`; starting it takes a second."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with playwright.sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=chromium, args=list(ALONE))
        yield opened
        opened.close()


def elements(alone: Any, html: str, folder: Path, *, ready: str = DRAWN) -> tuple[str, list[str]]:
    """The elements of a page that is ``ready``, and all that it wrote to the console."""
    return asked(alone, html, folder, "document.documentElement.outerHTML", ready=ready)


def asked(alone: Any, html: str, folder: Path, script: str, *, ready: str = DRAWN) -> tuple[Any, list[str]]:
    """What a script answers on a page that is ``ready``, and all that the page wrote to the console.

    The page has a session of its own in a browser that is started. However slow the machine is, the script waits for
    the page; the page's own policy holds, and the script, which comes from outside, needs no exception from it.
    """
    file = folder / "page.html"
    file.write_text(html, encoding="utf-8")
    told: list[str] = []
    with alone.new_context() as context:
        page = context.new_page()
        page.set_default_timeout(LONGEST_MS)
        page.on("console", lambda message: told.append(message.text))
        page.on("pageerror", lambda error: told.append(str(error)))
        page.goto(file.as_uri())
        page.wait_for_function(ready)
        answer = page.evaluate(script)
    return answer, told
