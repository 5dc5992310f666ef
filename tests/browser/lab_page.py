"""The lab as somebody before the screen uses it: a server, a page in a real browser, and what one does there."""

from __future__ import annotations

import base64
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pytest
from tests.browser.chromium import browser
from tests.unit.cli.commands import rotorid

TOKEN = "oneWordForEveryPageOfTheseTests"
WIDTH, HEIGHT = 1300, 900
ENDED = ":is([data-state=done],[data-state=refused],[data-state=failed],[data-state=canceled])"


@contextmanager
def serving(*given: str | Path, private: Path, token: str = "") -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """A lab with its address; its private folder lies in ``private`` and is gone afterwards.

    With a token every browser may come in that knows it, without one the first alone.
    """
    environment = {**os.environ, "TMPDIR": str(private)} | ({"ROTORID_LAB_TOKEN": token} if token else {})
    command = [sys.executable, "-m", "rotorid", "lab", "--no-browser", *map(str, given)]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
    try:
        assert server.stdout is not None
        yield server.stdout.readline().strip(), server
    finally:
        server.terminate()
        server.communicate(timeout=60)
    assert not list(private.glob("rotorid-lab-*")), "the private folder goes away"


@contextmanager
def chromium() -> Iterator[Any]:
    """A browser without a window."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        started = playwright.chromium.launch(
            executable_path=shutil.which("chromium") or browser(), args=["--no-sandbox"]
        )
        yield started
        started.close()


@dataclass
class LabPage:
    """A page of the lab, and all that it wrote to the console."""

    page: Any
    told: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.page.set_default_timeout(90_000)
        self.page.on("console", lambda m: self.told.append(m.text) if m.type in ("error", "warning") else None)
        self.page.on("pageerror", lambda e: self.told.append(str(e)))

    def drop(self, *files: Path) -> None:
        """Let files fall onto the page, as a file manager does."""
        given = [(file.name, base64.b64encode(file.read_bytes()).decode()) for file in files]
        self.page.evaluate(
            """(files) => {
              const transfer = new DataTransfer();
              for (const [name, text] of files) {
                transfer.items.add(new File([Uint8Array.from(atob(text), (sign) => sign.charCodeAt(0))], name));
              }
              for (const kind of ["dragover", "drop"]) {
                document.body.dispatchEvent(
                  new DragEvent(kind, { dataTransfer: transfer, bubbles: true, cancelable: true }));
              }
            }""",
            given,
        )

    def wait_for_tracks(self, count: int = 1) -> None:
        """Until so many tracks are drawn, and the log is inspected."""
        self.page.wait_for_selector(f"#tracks .u-over >> nth={count - 1}")
        self.until("document.querySelectorAll('#models .mark:is(.good,.bad)').length > 0")

    def until(self, expression: str) -> None:
        """Wait for something to hold; the page's own policy forbids Playwright's way of waiting in it."""
        last = time.monotonic() + 90.0
        while not self.page.evaluate(expression):
            assert time.monotonic() < last, expression
            self.page.wait_for_timeout(50)

    def at(self, second: float) -> float:
        """The place of a time on the first track, in pixels."""
        box = self.page.locator("#tracks .u-over").first.bounding_box()
        start, stop = self.view()
        return float(box["x"] + box["width"] * (second - start) / (stop - start))

    def view(self) -> tuple[float, float]:
        """What the tracks show, in seconds."""
        text = self.page.text_content("#spectral-span")
        segments = self.page.evaluate("JSON.parse(sessionStorage.getItem('choices') ?? '{}').segments ?? []")
        assert not segments, "the words are of the last segment where there is one"
        start, stop = re.findall(r"-?[\d.]+", text)
        return float(start), float(stop)

    def drag(self, start: tuple[float, float], stop: tuple[float, float]) -> None:
        """Press, move in steps, and let go."""
        mouse = self.page.mouse
        mouse.move(*start)
        mouse.down()
        for k in range(1, 5):
            mouse.move(*(a + (b - a) * k / 4 for a, b in zip(start, stop, strict=True)))
        mouse.up()

    def choices(self) -> dict[str, Any]:
        """What is chosen."""
        chosen: dict[str, Any] = self.page.evaluate("JSON.parse(sessionStorage.getItem('choices'))")
        return chosen

    def brush(self, start: float, stop: float) -> None:
        """Drag over the first track from one time to another, while no segment is chosen."""
        box = self.page.locator("#tracks .u-over").first.bounding_box()
        self.drag((self.at(start), box["y"] + 40), (self.at(stop), box["y"] + 40))
        self.page.wait_for_selector("#segments li")

    def show(self, log: str) -> None:
        """Look at another log of the session."""
        name = json.dumps(log, ensure_ascii=False)
        self.page.click(f"#logs button:text-is({name})")
        self.until(f"document.querySelector('#logs [data-shown] button')?.textContent === {name}")
        self.wait_for_tracks()

    def fill(self, place: str, text: str) -> None:
        """Type into a field and leave it."""
        self.page.fill(place, text)
        self.page.press(place, "Tab")

    def ended(self, step: int) -> str:
        """Wait for a step; how it ended."""
        self.page.wait_for_selector(f"#step-{step}{ENDED}")
        return str(self.page.get_attribute(f"#step-{step}", "data-state"))

    def document(self, step: int) -> Any:
        """What a step printed."""
        return self.page.evaluate(f"fetch('/api/steps/{step}').then((answer) => answer.json())")["document"]

    def command(self, step: int) -> list[str]:
        """The command line under a step, without the program's name."""
        return shlex.split(str(self.page.text_content(f"#step-{step} code")))[1:]

    def terminal(self, verb: str) -> str:
        """The command line of a button of the panel, as soon as it is that of what is chosen."""
        self.until(f"!document.querySelector('#command-{verb} + button').disabled")
        return str(self.page.text_content(f"#command-{verb}"))

    def violations(self) -> list[str]:
        """What axe-core finds against WCAG 2 A and AA."""
        return violations(self.page)


def example_log(factory: pytest.TempPathFactory) -> Path:
    """The example of PX4, with two axes and half as long; flown once for all workers."""
    from rotorid.flying.examples import example_named
    from rotorid.report.files import write_simulation

    base = factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "lab-example"
    log = folder / "flight.ulg"
    if not log.is_file():
        whole = example_named("px4")
        axes = ("roll", "pitch")
        sweeps, doublets = ({axis: sizes[axis] for axis in axes} for sizes in (whole.sweeps, whole.doublets))
        half = replace(whole, sweeps=sweeps, doublets=doublets, duration_s=20.0)
        made = factory.mktemp("lab-example")
        write_simulation(made, half.choices(), command="example")
        # Another worker may have made it meanwhile: the same bytes.
        folder.mkdir(exist_ok=True)
        (made / log.name).rename(log)
    return log


@contextmanager
def opened(started: Any, address: str) -> Iterator[LabPage]:
    """The lab in a window; whatever a test does, the console stays empty."""
    context = started.new_context(viewport={"width": WIDTH, "height": HEIGHT})
    lab = LabPage(context.new_page())
    lab.page.goto(address)
    yield lab
    context.close()
    assert lab.told == []


def violations(page: Any) -> list[str]:
    """What axe-core finds on a page against WCAG 2 A and AA."""
    from axe_playwright_python.sync_playwright import Axe

    rules = {"runOnly": {"type": "tag", "values": ["wcag2a", "wcag2aa"]}, "resultTypes": ["violations"]}
    found = Axe().run(page, options=rules).response["violations"]
    return [f"{one['id']}: {node['html'][:200]}" for one in found for node in one["nodes"]]


def at_terminal(words: Sequence[str], *, out: Path) -> str:
    """Standard output of a command with another place for its results."""
    command = list(words)
    command[command.index("--out") + 1] = str(out)
    ran = rotorid(*command, "--json", "--quiet")
    assert ran.code == 0, ran.err
    return ran.out
