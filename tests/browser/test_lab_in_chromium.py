"""The lab in a real browser: from a dropped log to an export, with the numbers of the command line."""

from __future__ import annotations

import json
import math
import os
import re
import signal
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.browser.lab_page import HEIGHT, TOKEN, WIDTH, LabPage, at_terminal, opened, serving
from tests.unit.cli.commands import rotorid

pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
pytest.importorskip("axe_playwright_python", reason="axe_playwright_python is not installed")
pytest.importorskip("fastapi", reason="the extra lab is not installed")

SWEEP_S = (33.0, 55.0)
"""Where the example sweeps roll, on the clock of its log."""

REVIEW = 5
"""The step that reviews the log, in the lab with steps that have ended."""

LINES_OF_CELLS = """
[...new Set([...document.querySelectorAll("#results .scroll td")].filter((cell) => cell.textContent).map((cell) => {
  const range = document.createRange();
  range.selectNodeContents(cell);
  return new Set([...range.getClientRects()].map((one) => one.top)).size;
}))]
"""

MARKER = "document.querySelector('#spectra .u-legend .u-series:last-child .u-marker').style.border"

SHOTS = os.environ.get("ROTORID_SHOTS")


@pytest.fixture
def lab(shared_browser: Any, tmp_path: Path) -> Iterator[LabPage]:
    """An empty lab before the screen."""
    private = tmp_path / "private"
    private.mkdir()
    with serving(private=private) as (address, _), opened(shared_browser, address) as lab:
        yield lab


@pytest.fixture
def with_log(shared_browser: Any, tmp_path: Path, example: Path) -> Iterator[LabPage]:
    """A lab that shows the example."""
    private = tmp_path / "private"
    private.mkdir()
    with serving(example, private=private) as (address, _), opened(shared_browser, address) as lab:
        lab.wait_for_tracks()
        yield lab


@pytest.fixture(scope="module")
def worked(shared_browser: Any, example: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Address of a lab onto which the example was dropped, and in which it went through all steps, a review last."""
    with serving(private=tmp_path_factory.mktemp("private"), token=TOKEN) as (address, _):
        with opened(shared_browser, address) as lab:
            drop_to_export(lab, example, SWEEP_S)
            lab.page.click("#run-review")
            assert lab.ended(REVIEW) == "done"
        yield address


@pytest.fixture
def with_steps(shared_browser: Any, worked: str) -> Iterator[LabPage]:
    """A page of its own, in the lab with steps that have ended."""
    with opened(shared_browser, worked) as lab:
        lab.wait_for_tracks()
        yield lab


@pytest.fixture
def looking(with_steps: LabPage) -> LabPage:
    """The same lab: what is looked at in a log does not depend on the steps that were carried out.

    A page begins with the segment of the last step.
    """
    with_steps.page.click("#segments button")
    assert with_steps.choices()["segments"] == []
    return with_steps


def drop_to_export(lab: LabPage, log: Path, span: tuple[float, float]) -> None:
    """What one does with a log: look, mark, measure, identify, tune, export; steps 1 to 4."""
    lab.drop(log)
    lab.wait_for_tracks()
    lab.brush(*span)
    lab.page.click("#more summary")
    for place, text in (("#inputs", "roll_command"), ("#outputs", "p")):
        lab.fill(place, text)
    lab.page.click("#run-response")
    assert lab.ended(1) == "done"
    for place in ("#inputs", "#outputs"):
        lab.fill(place, "")
    lab.fill("#model", "rate.roll")
    lab.page.click("#run-identify")
    assert lab.ended(2) == "done"
    assert lab.page.locator("#step-2 .bodes .uplot").count() == 4
    lab.page.click("#step-2 button:text-is('Tune')")
    assert lab.ended(3) == "done"
    lab.page.select_option("#step-2 select[aria-label='target of the export']", "json")
    lab.page.click("#step-2 button:text-is('Export')")
    assert lab.ended(4) == "done"


def require_same_at_terminal(lab: LabPage, log: Path, tmp_path: Path) -> None:
    """The same words at a terminal give the same numbers, to the last digit."""
    folders: dict[str, str] = {}
    for step, compared in (
        (1, ("responses", "loops")),
        (2, ("parameters", "cost", "poles", "matrices", "correlation")),
        (3, ("axes", "files")),
        (4, ("quantities", "round_trip")),
    ):
        words = [str(log) if word == log.name else folders.get(word, word) for word in lab.command(step)]
        folders[f"step-{step}"] = str(tmp_path / f"again-{step}")
        again, shown = json.loads(at_terminal(words, out=tmp_path / f"again-{step}")), lab.document(step)
        found = [key for key in compared if key in again]
        assert found
        for key in found:
            assert shown[key] == again[key], (step, key)


def test_from_a_dropped_log_to_an_export(with_steps: LabPage, example: Path, tmp_path: Path) -> None:
    assert with_steps.ended(4) == "done"
    require_same_at_terminal(with_steps, example, tmp_path)


@pytest.mark.slow
def test_from_a_dropped_flight_of_px4_to_an_export(lab: LabPage, shared_data: Path, tmp_path: Path) -> None:
    log = shared_data / "px4_sitl" / "verify.ulg.xz"
    drop_to_export(lab, log, (40.0, 52.0))
    require_same_at_terminal(lab, log, tmp_path)


def test_hands_and_keys(looking: LabPage) -> None:
    lab, page = looking, looking.page
    whole = lab.view()
    over = page.locator("#tracks .u-over").first
    box = over.bounding_box()
    # The wheel zooms about the place under it, and a double click shows the whole log again.
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 30)
    for _ in range(4):
        page.mouse.wheel(0, -100)
    lab.until("document.querySelector('#spectral-span').textContent.length > 0")
    start, stop = lab.view()
    assert (stop - start) / (whole[1] - whole[0]) == pytest.approx(0.8**4, rel=0.02)
    assert start + stop == pytest.approx(sum(whole), abs=0.3)
    over.dblclick()
    assert lab.view() == whole
    over.focus()
    for key in ("+", "ArrowRight", "-", "0"):
        page.keyboard.press(key)
    assert lab.view() == whole
    # A brushed segment has edges for the mouse and for the keyboard; every change is one step back.
    lab.brush(50.0, 80.0)
    (first,) = lab.choices()["segments"]
    assert first["start_s"] == pytest.approx(50.0, abs=0.4)
    edge = page.locator("#tracks .edge[data-side=stop_s]").first
    place = edge.bounding_box()
    middle = place["x"] + place["width"] / 2
    second = (whole[1] - whole[0]) / box["width"]
    lab.drag((middle, place["y"] + 20), (middle + 60, place["y"] + 20))
    (dragged,) = lab.choices()["segments"]
    assert dragged["start_s"] == first["start_s"]
    assert dragged["stop_s"] == pytest.approx(first["stop_s"] + 60 * second, abs=0.3)
    edge.focus()
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("Shift+ArrowLeft")
    assert lab.choices()["segments"][0]["stop_s"] == pytest.approx(dragged["stop_s"] - 1.1, abs=1e-6)
    for _ in range(2):
        page.keyboard.press("Control+z")
    assert lab.choices()["segments"] == [dragged]
    page.click("#undo")
    assert lab.choices()["segments"] == [first]
    page.click("#redo")
    assert lab.choices()["segments"] == [dragged]
    lab.until("document.querySelector('#command-identify').textContent.includes('--segment')")
    # A page that is loaded again knows what was chosen.
    page.reload()
    lab.wait_for_tracks()
    assert lab.choices()["segments"] == [dragged]
    page.click("#segments button")
    assert lab.choices()["segments"] == []


def test_what_is_seen(looking: LabPage) -> None:
    lab, page = looking, looking.page
    page.fill("#channel", "motor_1")
    page.press("#channel", "Enter")
    page.wait_for_selector("#tracks .track:has-text('motor_1')")
    page.click("#spectrum")
    page.wait_for_selector("#spectra .uplot")
    page.click("#spectrogram")
    page.wait_for_selector("#spectra .scale")
    # Other units and another theme draw both anew; the pointer reads the spectrogram.
    page.select_option("#units", "hz")
    assert "Hz" in page.text_content("#spectra .u-legend")
    color = page.evaluate(MARKER)
    page.emulate_media(color_scheme="dark")
    lab.until(f"{MARKER} !== {color!r}")
    page.locator("#spectra .spectral >> nth=0").locator(".u-over").hover()
    assert re.search(r"s, .* Hz: .* dB", page.locator("#spectra .value").text_content())
    page.click("#found summary")
    page.click("#excitations button:text-is('Look') >> nth=0")
    start, stop = lab.view()
    page.click("#whole")
    assert stop - start < lab.view()[1] - lab.view()[0]
    page.fill("#channel", "no_such")
    page.press("#channel", "Enter")
    lab.until("document.querySelector('#message').textContent.includes('unknown channel')")
    page.click("#keys")
    assert page.is_visible("#keyboard")


@pytest.mark.slow
def test_results_beside_each_other_and_units(with_log: LabPage, example: Path) -> None:
    lab, page = with_log, with_log.page
    lab.fill("#model", "rate.roll")
    page.click("#run-identify")
    assert lab.ended(1) == "done"
    # A drag on a response chooses the band, in either unit.
    page.select_option("#units", "hz")
    page.wait_for_selector("#step-1 .u-legend:has-text('Hz')")
    picture = page.locator("#step-1 .bodes .u-over").first
    picture.scroll_into_view_if_needed()
    box = picture.bounding_box()
    lab.drag((box["x"] + 0.35 * box["width"], box["y"] + 50), (box["x"] + 0.75 * box["width"], box["y"] + 50))
    low, high = lab.choices()["band"]
    assert 1.0 < low < high < 120.0
    assert float(page.input_value("#low")) == pytest.approx(low / (2.0 * math.pi), rel=1e-3)
    page.select_option("#units", "rad")
    assert float(page.input_value("#low")) == pytest.approx(low, rel=1e-3)
    # Pictures that are drawn anew let go of what they held, and nothing is asked for again.
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.select_option("#scale", "linear")
    lab.until("document.querySelectorAll('#step-1 .bodes .uplot').length === 4")
    assert page.evaluate("uPlot.sync('step-1').plots.length") == 4
    assert not [url for url in asked if "/api/steps/1" in url]
    # The error is a strip around the curve, and takes no words of the legend.
    labels = page.locator("#step-1 .bodes .uplot >> nth=0").locator(".u-series:visible .u-label").all_text_contents()
    assert "measured ± std" in labels
    assert all(labels)
    assert len(labels) == len(set(labels))
    # Several models of one command: each has its numbers, and its pictures.
    lab.fill("#model", "rate.roll,rate.pitch")
    page.click("body", position={"x": 5, "y": 300})
    page.keyboard.press("i")
    assert lab.ended(2) == "done"
    heads = page.locator("#comparison thead th").all_text_contents()
    assert heads == ["", "1. rate.roll", "2. rate.roll", "2. rate.pitch"]
    assert page.locator("#step-2 h4.model").all_text_contents() == ["rate.roll", "rate.pitch"]
    assert page.locator("#step-2 .bodes .uplot").count() == 8
    # Another log judges the model; closed, it is gone. Gains are those of the log that was fitted.
    lab.fill("#model", "rate.roll")
    lab.drop(example)
    lab.until("document.querySelectorAll('#logs li').length === 2")
    lab.until("document.querySelectorAll('#others select').length === 1")
    lab.show("flight-2.ulg")
    page.locator("#step-1 .terminal summary").first.click()
    lab.until("document.querySelector('#step-1 .terminal code').textContent !== ''")
    assert str(example) in page.locator("#step-1 .terminal code").first.text_content()
    assert page.text_content("#step-1 .verify") == "Verify on flight-2.ulg"
    lab.show("flight.ulg")
    if not page.is_visible("#others select"):
        page.click("#more summary")
    page.select_option("#others select", "unseen")
    assert lab.choices()["unseen"] == [2]
    lab.until("document.querySelector('#command-identify').textContent.includes('--verify')")
    page.click("button[aria-label='close flight-2.ulg']")
    lab.until("document.querySelectorAll('#logs li').length === 1")
    lab.fill("#model", "rate.pitch")
    lab.until("document.querySelector('#command-identify').textContent.includes('rate.pitch')")
    assert "--verify" not in lab.terminal("identify")


def test_everybody_can_use_it(with_steps: LabPage) -> None:
    lab, page = with_steps, with_steps.page
    for theme in ("light", "dark"):
        page.emulate_media(color_scheme=theme)
        page.reload()
        lab.wait_for_tracks()
        lab.ended(REVIEW)
        for width in (WIDTH, 400):
            page.set_viewport_size({"width": width, "height": HEIGHT})
            lab.until("document.documentElement.scrollWidth <= document.documentElement.clientWidth")
            assert lab.violations() == []
            # No number is broken in two.
            assert page.evaluate(LINES_OF_CELLS) == [1]
            if SHOTS:
                page.screenshot(path=f"{SHOTS}/lab-{width}-{theme}.png", full_page=True)
        page.set_viewport_size({"width": WIDTH, "height": HEIGHT})
    # Somebody's own choice goes before the system's, and is kept.
    page.click("#theme")
    assert page.get_attribute("html", "data-theme") == "light"
    page.reload()
    lab.wait_for_tracks()
    assert page.get_attribute("html", "data-theme") == "light"


def test_a_report_opens_in_an_origin_of_its_own(with_steps: LabPage) -> None:
    page = with_steps.page
    with page.context.expect_page() as opened:
        page.click(f"#step-{REVIEW} a:text-is('Open the report')")
    report = opened.value
    report.wait_for_selector("h1")
    assert report.evaluate("self.origin") == "null"
    told = report.evaluate("fetch('/api/state').then((answer) => answer.status, () => 'refused')")
    assert told == "refused"


@pytest.mark.slow
def test_a_killed_worker_and_a_canceled_one_are_said(with_log: LabPage) -> None:
    lab, page = with_log, with_log.page
    lab.fill("#model", "rate.roll,rate.pitch,rate.yaw,axis.roll,axis.pitch,hover.full")
    page.click("#run-identify")
    page.wait_for_selector("#step-1[data-state=running]")
    # Seconds go on beside the words that are read aloud.
    lab.until("/^[1-9]/.test(document.querySelector('#step-1 .since').textContent.trim())")
    assert page.text_content("#step-1 .state") == "running"
    (worker,) = _workers()
    os.kill(worker, signal.SIGKILL)
    assert lab.ended(1) == "failed"
    assert "signal 9" in page.text_content("#step-1 .state")
    page.click("#run-identify")
    page.wait_for_selector("#step-2[data-state=running]")
    page.click("#step-2 button:text-is('Cancel')")
    assert lab.ended(2) == "canceled"
    lab.fill("#model", "rate.roll")
    page.click("#run-identify")
    assert lab.ended(3) == "done"


def _workers() -> list[int]:
    """Process numbers of fits that run in this test's lab: copies of the process that its server has started."""
    found = []
    for place in Path("/proc").glob("[0-9]*"):
        try:
            words = (place / "cmdline").read_bytes().split(b"\0")
            copied = _parent(int(place.name))
            asked_by = _parent(_parent(copied))
        except (OSError, IndexError, ValueError):
            continue
        if b"rotorid.cli.lab_worker" in words and asked_by == os.getpid():
            found.append(int(place.name))
    return found


def _parent(pid: int) -> int:
    return int(Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[1])


@pytest.mark.slow
def test_a_session_is_reopened_and_runs_without_the_page(
    with_log: LabPage, shared_browser: Any, example: Path, tmp_path: Path
) -> None:
    lab, page = with_log, with_log.page
    lab.brush(*SWEEP_S)
    lab.fill("#model", "rate.roll")
    page.click("#run-identify")
    assert lab.ended(1) == "done"
    first = lab.document(1)["parameters"]
    with page.expect_download() as saved:
        page.click("#project")
    place = tmp_path / "again"
    place.mkdir()
    (place / example.name).symlink_to(example)
    saved.value.save_as(place / "rotorid.toml")
    assert tomllib.loads((place / "rotorid.toml").read_text(encoding="utf-8"))["logs"] == [example.name]
    private = tmp_path / "private-2"
    private.mkdir()
    with serving(place / "rotorid.toml", private=private) as (address, _), opened(shared_browser, address) as other:
        other.wait_for_tracks()
        # What was chosen stands in the panel again, and the steps wait where they are seen.
        assert not other.page.is_visible("#open")
        assert other.choices()["segments"] == lab.choices()["segments"]
        assert other.page.input_value("#model") == "rate.roll"
        other.page.click("#waiting")
        # The server runs them, whether or not the page stays.
        other.page.wait_for_selector("#step-1")
        other.page.goto("about:blank")
        other.page.go_back()
        assert other.ended(1) == "done"
        assert other.document(1)["parameters"] == first
        assert not other.page.is_visible("#waiting")
    run = rotorid("run", place / "rotorid.toml", "--out", tmp_path / "ran", "--quiet")
    assert run.code == 0, run.err
    ran = json.loads((tmp_path / "ran" / "step-1" / "result.json").read_text(encoding="utf-8"))
    assert ran["parameters"] == first


@pytest.mark.slow
def test_the_demonstration_is_one_click_away(lab: LabPage) -> None:
    lab.page.click("#demo")
    lab.page.wait_for_selector("#logs progress")
    # It is a log from the start: a page that is loaded again shows it.
    lab.page.reload()
    lab.page.wait_for_selector("#logs progress")
    lab.wait_for_tracks()
    assert "flight.ulg" in lab.page.text_content("#logs")


def test_what_is_being_typed_is_not_taken_away(looking: LabPage) -> None:
    lab, page = looking, looking.page
    page.click("#more summary")
    page.click("#inputs")
    page.keyboard.type("roll_")
    # Another choice and another unit draw the panel anew.
    page.evaluate("document.querySelector('#reduce').click()")
    page.evaluate("document.querySelector('#units').dispatchEvent(new Event('change'))")
    lab.until("document.querySelector('#command-identify').textContent.includes('--reduce')")
    page.keyboard.type("command")
    page.keyboard.press("Tab")
    assert lab.choices()["inputs"] == "roll_command"
