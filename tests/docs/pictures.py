"""Pictures of the README: ``make pictures`` flies an example, and takes them of its pages in a real browser."""

from __future__ import annotations

import contextlib
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from tests.browser.lab_page import chromium, opened, serving

from rotorid.flying.examples import EXAMPLES

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "images"
WIDTH, HEIGHT = 1300, 860
TRACKS = 3
"""Of what the lab shows first: a command, the rate and the angle that it moves."""
PAGES = {
    "review": ("review/review.html", "body"),
    "model": ("model/rate.roll/report.html", "#s1-responses"),
    "tune": ("gains/report.html", "body"),
}
"""Picture to the page of the example that it shows, and the part at its top."""


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
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "example-px4"
        for command in commands(folder):
            subprocess.run(command, check=True, cwd=scratch)
        with chromium() as browser:
            page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
            for name, (place, top) in PAGES.items():
                page.goto((folder / place).as_uri())
                page.wait_for_selector("html[data-pictures=drawn]")
                # The menu that stays would cover what the picture is about.
                page.add_style_tag(content="nav.parts { display: none } html { scroll-behavior: auto }")
                page.locator(top).first.evaluate("one => one.scrollIntoView()")
                page.screenshot(path=FOLDER / f"{name}.png", animations="disabled")
            _lab(browser, folder / EXAMPLES["px4"].file, Path(scratch) / "private")


def _lab(started: Any, log: Path, private: Path) -> None:
    """The lab with the example's log open: read, inspected and drawn."""
    private.mkdir()
    # From its folder, so that commands name it as a reader would.
    with (
        contextlib.chdir(log.parent),
        serving(log.name, private=private) as (address, _),
        opened(started, address) as lab,
    ):
        lab.page.set_viewport_size({"width": WIDTH, "height": HEIGHT})
        lab.wait_for_tracks(count=TRACKS)
        lab.page.screenshot(path=FOLDER / "lab.png", animations="disabled")


if __name__ == "__main__":
    main()
