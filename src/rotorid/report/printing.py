"""Pages as PDF, printed by a browser that is on this machine anyway.

A page draws its pictures when it is opened, and its style has rules for paper; a browser without a window
prints just that. Nothing of it reaches a network: the page's own policy forbids every request. A typesetter that comes
as a wheel, such as Typst, reads neither HTML nor its drawings: every page would need a second layout.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from rotorid.errors import UsageError

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "msedge")
_PLACES = {
    "darwin": (
        "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
        "/Applications/Chromium.app/Contents/MacOS/Chromium",
        "/Applications/Microsoft Edge.app/Contents/MacOS/Microsoft Edge",
    ),
    "win32": (
        r"C:\Program Files\Google\Chrome\Application\chrome.exe",
        r"C:\Program Files (x86)\Microsoft\Edge\Application\msedge.exe",
    ),
}
_DRAWN_MS = 30_000
_LONGEST_S = 120.0


def require_browser() -> str:
    """Path of a browser that prints.

    Raises
    ------
    UsageError
        There is none.
    """
    found = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    found = found or next((path for path in _PLACES.get(sys.platform, ()) if Path(path).is_file()), None)
    if found is None:
        raise UsageError(
            "no browser was found that can print for --pdf",
            needed="Chromium, Chrome or Edge",
            remedy="install one, or leave --pdf out and print the page from your own browser",
        )
    return found


def print_pages(folder: Path) -> list[Path]:
    """Print every page in a folder and below it as a PDF of the same name, and return the paths.

    Raises
    ------
    UsageError
        There is no browser, or it did not print.
    """
    browser = require_browser()
    return [_printed(browser, page) for page in sorted(folder.rglob("*.html"))]


def _printed(browser: str, page: Path) -> Path:
    target = page.with_suffix(".pdf")
    # The superuser's processes have no sandbox of the browser's kind; the page is our own, and asks for nothing.
    root = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []
    with tempfile.TemporaryDirectory(prefix="rotorid-print-") as profile:
        command = [
            browser,
            "--headless",
            "--disable-gpu",
            "--no-first-run",
            "--disable-background-networking",
            "--host-resolver-rules=MAP * ~NOTFOUND",
            f"--user-data-dir={profile}",
            "--no-pdf-header-footer",
            f"--virtual-time-budget={_DRAWN_MS}",
            *root,
            f"--print-to-pdf={target.resolve()}",
            page.resolve().as_uri(),
        ]
        try:
            subprocess.run(command, capture_output=True, timeout=_LONGEST_S, check=False)
        except (OSError, subprocess.TimeoutExpired):
            target.unlink(missing_ok=True)
    if not target.is_file() or target.stat().st_size == 0:
        raise UsageError(
            f"{Path(browser).name} did not print {page.name}", needed="--pdf left out, and the page printed by hand"
        )
    return target
