"""Pictures of the README: ``make pictures`` flies an example, and takes them of its pages in a real browser."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from rotorid.pipeline.examples import EXAMPLES

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "images"
WIDTH, HEIGHT = 1300, 860
PAGES = {
    "review": ("review/review.html", "body"),
    "model": ("model/rate.roll/report.html", "#s1-responses"),
    "tune": ("gains/report.html", ".pictures"),
}
"""Picture to the page of the example that it shows, and what of it stands at the top."""


def commands(folder: Path) -> list[list[str]]:
    """What makes the pages: the example's own commands, into its folder."""
    program = [sys.executable, "-m", "rotorid"]
    example = EXAMPLES["px4"]
    first = [*program, "example", example.name, "--out", str(folder), "--quiet"]
    told = [one.format(log=folder / example.file, folder=folder).split() for one in example.next[:3]]
    # The review has no folder of its own in the example.
    told[0] += ["--out", str(folder / "review")]
    return [first, *([*program, *words[1:], "--quiet"] for words in told)]


def main() -> None:
    """Make the pages, and take their pictures."""
    from playwright.sync_api import sync_playwright

    browser_path = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if browser_path is None:
        sys.exit("no browser: chromium, chromium-browser or google-chrome is needed on the path")
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "example-px4"
        for command in commands(folder):
            subprocess.run(command, check=True, cwd=scratch)
        with sync_playwright() as play:
            browser = play.chromium.launch(executable_path=browser_path, args=["--no-sandbox"])
            page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
            for name, (place, top) in PAGES.items():
                page.goto((folder / place).as_uri())
                page.wait_for_selector("html[data-pictures=drawn]")
                # The menu that stays would cover what the picture is about.
                page.add_style_tag(content="nav.parts { display: none } html { scroll-behavior: auto }")
                page.locator(top).first.evaluate("one => one.scrollIntoView()")
                page.screenshot(path=FOLDER / f"{name}.png", animations="disabled")
            _lab(page, folder / EXAMPLES["px4"].file)
            browser.close()


def _lab(page: object, log: Path) -> None:
    """The lab with the example's log open."""
    program = [sys.executable, "-m", "rotorid", "lab", str(log), "--no-open", "--port", "0"]
    server = subprocess.Popen(program, stdout=subprocess.PIPE, text=True, env={**os.environ, "PYTHONUNBUFFERED": "1"})
    try:
        assert server.stdout is not None
        page.goto(server.stdout.readline().strip())  # type: ignore[attr-defined]
        page.wait_for_selector("#tracks .u-over", timeout=120_000)  # type: ignore[attr-defined]
        page.screenshot(path=FOLDER / "lab.png")  # type: ignore[attr-defined]
    finally:
        server.terminate()
        server.wait()


if __name__ == "__main__":
    main()
