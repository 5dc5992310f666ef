"""The lab in a real browser: from a dropped log to an export, with the numbers of the command line."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.browser.chromium import browser

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
pytest.importorskip("fastapi", reason="the extra lab is not installed")

SHOTS = os.environ.get("ROTORID_SHOTS")


@pytest.fixture
def address(tmp_path: Path) -> Iterator[str]:
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    command = [sys.executable, "-m", "rotorid", "lab", "--no-browser"]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
    try:
        assert server.stdout is not None
        yield server.stdout.readline().strip()
    finally:
        server.terminate()
        server.communicate(timeout=5)
    assert not list(tmp_path.glob("rotorid-lab-*")), "the private folder goes away"


@pytest.mark.slow
def test_from_a_dropped_log_to_an_export(address: str, shared_data: Path, tmp_path: Path) -> None:
    log = shared_data / "px4_sitl" / "verify.ulg.xz"
    told: list[str] = []
    with playwright.sync_playwright() as p:
        chromium = p.chromium.launch(executable_path=shutil.which("chromium") or browser(), args=["--no-sandbox"])
        page = chromium.new_page(viewport={"width": 1300, "height": 900})
        page.set_default_timeout(60000)
        page.on("console", lambda m: told.append(m.text) if m.type in ("error", "warning") else None)
        page.on("pageerror", lambda e: told.append(str(e)))
        page.goto(address)
        page.set_input_files("#file", log)
        page.wait_for_selector("#tracks .u-over >> nth=1")
        box = page.locator("#tracks .u-over").first.bounding_box()
        assert box is not None
        span = 106.412 - 12.008
        for k, second in enumerate((40.0, 52.0)):
            page.mouse.move(box["x"] + box["width"] * (second - 12.008) / span, box["y"] + 40)
            (page.mouse.down if k == 0 else page.mouse.up)()
        page.wait_for_selector("#segments li")
        page.fill("#inputs", "roll_command")
        page.fill("#outputs", "p")
        page.press("#outputs", "Tab")
        page.click("#run-response")
        page.wait_for_selector("#step-1[data-state=done]")
        page.select_option("#model", "rate.roll")
        page.click("#run-identify")
        page.wait_for_selector("#step-2[data-state=done]")
        command = page.text_content("#step-2 code").split()
        page.click("#step-2 button:text-is('Tune')")
        page.wait_for_selector("#step-3[data-state=done]")
        page.click("#step-2 button:text-is('Export')")
        page.wait_for_selector("#step-4[data-state=done]")
        shown = page.evaluate("fetch('/api/steps/2').then(r => r.json())")["document"]
        assert page.locator("#step-2 .uplot").count() == 4
        overflow = "document.documentElement.scrollWidth > document.documentElement.clientWidth"
        for width in (1300, 400):
            page.set_viewport_size({"width": width, "height": 900})
            for theme in ("light", "dark"):
                page.emulate_media(color_scheme=theme)
                if width == 400:
                    page.reload()
                    page.wait_for_selector("#step-4[data-state=done]")
                    assert not page.evaluate(overflow)
                if SHOTS:
                    page.screenshot(path=f"{SHOTS}/lab-{width}-{theme}.png", full_page=True)
        chromium.close()
    assert told == []
    words = [str(log) if word == "verify.ulg.xz" else word for word in command[1:]]
    words[words.index("--out") + 1] = str(tmp_path / "again")
    done = subprocess.run(
        [sys.executable, "-m", "rotorid", *words, "--json", "--quiet"], capture_output=True, text=True, check=True
    )
    again = json.loads(done.stdout)
    for key in ("parameters", "cost", "poles", "matrices"):
        assert shown[key] == again[key]
