"""Choices in the lab: they belong to their log, session and command, and no slip of a hand changes them."""

from __future__ import annotations

import json
import shlex
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.browser.lab_page import TOKEN, LabPage, opened, serving

pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
pytest.importorskip("axe_playwright_python", reason="axe_playwright_python is not installed")
pytest.importorskip("fastapi", reason="the extra lab is not installed")

HOSTILE = "it's; a log $(touch x) ü.ulg"

DRAWN_WORDS = """
window.drawn = [];
const fillText = CanvasRenderingContext2D.prototype.fillText;
CanvasRenderingContext2D.prototype.fillText = function (text, ...place) {
  window.drawn.push([text, this.textAlign]);
  return fillText.call(this, text, ...place);
};
window.watchers = new Set();
const { observe, disconnect } = ResizeObserver.prototype;
ResizeObserver.prototype.observe = function (...what) { window.watchers.add(this); return observe.apply(this, what); };
ResizeObserver.prototype.disconnect = function () { window.watchers.delete(this); return disconnect.call(this); };
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, example: Path) -> Path:
    """Two logs: one with words in its name that a shell would take as its own."""
    place = tmp_path_factory.mktemp("flights")
    for name in ("flight.ulg", HOSTILE):
        shutil.copy(example, place / name)
    return place


@pytest.fixture(scope="module")
def served(shared_browser: Any, folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Address of a lab over two logs, of which one is open; only the last test opens the other."""
    with serving(folder, private=tmp_path_factory.mktemp("private"), token=TOKEN) as (address, _):
        with opened(shared_browser, address) as lab:
            lab.page.click("#choices-of-folder button:text-is('flight.ulg')")
            lab.wait_for_tracks()
        yield address


@pytest.fixture
def lab(shared_browser: Any, tmp_path: Path, folder: Path) -> Iterator[LabPage]:
    """A lab over two logs, which shows the first."""
    private = tmp_path / "private"
    private.mkdir()
    with serving(folder, private=private) as (address, _), opened(shared_browser, address) as lab:
        lab.page.click("#choices-of-folder button:text-is('flight.ulg')")
        lab.wait_for_tracks()
        yield lab


def segments(lab: LabPage) -> list[tuple[int, float]]:
    """Which log each segment is of, and where it ends."""
    return [(one["log"], one["stop_s"]) for one in lab.choices()["segments"]]


def focused(lab: LabPage) -> str:
    """What has the focus, by its label."""
    return str(lab.page.evaluate("document.activeElement.getAttribute('aria-label') ?? document.activeElement.id"))


@pytest.mark.slow
def test_a_log_that_is_still_inspected_is_no_obstacle(lab: LabPage) -> None:
    """What somebody asked for last is shown, and a step back leads to a log of which only the channels are known."""
    page = lab.page
    page.click("#opener")
    page.locator("#choices-of-folder button").nth(1).click()
    page.wait_for_selector("#logs button.plain >> nth=2")
    lab.show("flight.ulg")
    held: list[Any] = []
    page.route("**/api/logs/2", lambda route: held.append(route))
    page.reload()
    lab.wait_for_tracks()
    # Slow to come, and no longer wanted when it comes.
    page.click(f"#logs button:text-is({json.dumps(HOSTILE, ensure_ascii=False)})")
    while not held:
        page.wait_for_timeout(20)
    lab.show("flight.ulg")
    held.pop().continue_()
    page.unroute("**/api/logs/2")
    page.wait_for_timeout(300)
    lab.until("document.querySelector('#logs [data-shown] button').textContent === 'flight.ulg'")

    def running(route: Any) -> None:
        told = route.fetch().json()
        told["logs"][1]["state"] = "running"
        route.fulfill(json=told)

    def not_yet(route: Any) -> None:
        route.fulfill(json={**route.fetch().json(), "inspection": None})

    page.route("**/api/state", running)
    page.route("**/api/logs/2", not_yet)
    page.reload()
    lab.wait_for_tracks()
    page.click(f"#logs button:text-is({json.dumps(HOSTILE, ensure_ascii=False)})")
    lab.until("document.querySelector('#logs [data-shown] button').textContent !== 'flight.ulg'")
    page.wait_for_selector("#tracks .u-over")
    page.keyboard.press("s")
    assert [log for log, _ in segments(lab)] == [2]
    lab.show("flight.ulg")
    page.click("#undo")
    lab.until("document.querySelector('#logs [data-shown] button').textContent !== 'flight.ulg'")
    assert segments(lab) == []
    page.unroute_all(behavior="wait")


@pytest.mark.slow
def test_choices_stay_with_their_logs(shared_browser: Any, tmp_path: Path, folder: Path) -> None:
    """Another server at the same address gets nothing of what was chosen on the logs of the one before."""
    private = tmp_path / "private"
    private.mkdir()
    kept = None
    for log in ("flight.ulg", HOSTILE):
        with serving(folder / log, private=private) as (address, _), opened(shared_browser, address) as lab:
            lab.wait_for_tracks()
            if kept is None:
                lab.page.keyboard.press("s")
                assert len(segments(lab)) == 1
                kept = lab.page.evaluate("sessionStorage.getItem('choices')")
            else:
                lab.page.evaluate("(kept) => sessionStorage.setItem('choices', kept)", kept)
                lab.page.reload()
                lab.wait_for_tracks()
                assert segments(lab) == []


def test_a_click_moves_no_edge(looking: LabPage) -> None:
    lab, page = looking, looking.page
    whole = lab.view()
    lab.brush(50.0, 80.0)
    (one,) = lab.choices()["segments"]
    edge = page.locator("#tracks .edge[data-side=stop_s]").first
    place = edge.bounding_box()
    x, y = place["x"] + place["width"] / 2 + 4, place["y"] + 20
    # A press beside the middle of the edge, with a hand that trembles.
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 2, y)
    page.mouse.up()
    assert lab.choices()["segments"] == [one]
    # A drag moves it by what the hand moves, and not to the hand.
    width = page.locator("#tracks .u-over").first.bounding_box()["width"]
    second = (whole[1] - whole[0]) / width
    lab.drag((x, y), (x + 40, y))
    (dragged,) = lab.choices()["segments"]
    assert dragged["stop_s"] == pytest.approx(one["stop_s"] + 40 * second, abs=0.02)
    # What takes the pointer away takes the drag back.
    page.mouse.move(x + 40, y)
    page.mouse.down()
    page.mouse.move(x + 80, y)
    page.mouse.move(x + 90, y)
    # A list that arrives from the server meanwhile redraws the page.
    page.evaluate("document.querySelector('#scale').dispatchEvent(new Event('change'))")
    assert lab.choices()["segments"] == [dragged]
    edge.evaluate("(one) => one.dispatchEvent(new PointerEvent('pointercancel'))")
    page.mouse.move(x + 120, y)
    page.mouse.up()
    assert lab.choices()["segments"] == [dragged]
    page.click("#undo")
    page.click("#undo")
    assert lab.choices()["segments"] == []


def test_keys_and_focus(looking: LabPage) -> None:
    lab, page = looking, looking.page
    started: list[str] = []
    page.route("**/api/steps", lambda route: (started.append(route.request.post_data), route.fulfill(json={"step": 1})))
    # A key that is held says the same again: one command is meant.
    page.click("h1")
    page.keyboard.down("r")
    page.keyboard.down("r")
    page.keyboard.down("r")
    page.keyboard.up("r")
    lab.until("document.querySelector('#message').textContent === ''")
    assert len(started) == 1
    # Segments are made and changed without a mouse, and the focus stays where it was put.
    page.focus("#add-segment")
    page.keyboard.press("Enter")
    page.wait_for_selector("#segments li")
    page.focus("#segments input >> nth=0")
    page.keyboard.type("1")
    page.keyboard.press("Tab")
    assert focused(lab) == "stop of segment 1 in seconds"
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    assert focused(lab) == "add-segment"
    assert lab.choices()["segments"] == []
    page.focus("#models button >> nth=1")
    page.keyboard.press("Enter")
    assert focused(lab).endswith(": " + lab.choices()["model"])


def test_a_segment_that_ends_before_it_starts_is_refused(looking: LabPage) -> None:
    lab, page = looking, looking.page
    page.keyboard.press("s")
    (one,) = lab.choices()["segments"]
    lab.fill("#segments input >> nth=0", str(one["stop_s"] + 1.0))
    assert "before its stop" in page.text_content("#message")
    assert lab.choices()["segments"] == [one]
    assert float(page.input_value("#segments input >> nth=0")) == pytest.approx(one["start_s"], abs=1e-3)


def test_commands_are_those_of_what_is_chosen(looking: LabPage) -> None:
    lab, page = looking, looking.page
    # Each button has its command; a response has the channels of the model that is chosen.
    lab.fill("#model", "rate.pitch")
    lab.until("document.querySelector('#inputs').placeholder.includes('pitch_command')")
    assert lab.terminal("review").startswith("rotorid review ")
    assert "--inputs pitch_command --outputs q" in lab.terminal("response")
    assert "--model rate.pitch" in lab.terminal("identify")
    # What is refused stands in place of the command, and cannot be copied.
    page.click("#more summary")
    lab.fill("#inputs", "roll rate")
    lab.until("document.querySelector('#command-identify').className === 'bad'")
    refused = page.text_content("#command-identify")
    assert "inputs" in refused
    assert page.is_disabled("#command-identify + button")
    page.click("#run-identify")
    lab.until(f"document.querySelector('#message').textContent === {refused!r}")
    # The browser writes down by itself that a request was refused.
    assert all("status of 422" in one for one in lab.told)
    lab.told.clear()
    # A band needs both ends: said where it is typed, and no command leaves it out silently.
    lab.fill("#inputs", "")
    lab.fill("#low", "2")
    assert "two frequencies" in page.text_content("#band-needs")
    assert "two frequencies" in page.text_content("#command-identify")
    page.click("#run-identify")
    assert "two frequencies" in page.text_content("#message")
    lab.fill("#high", "30")
    assert page.text_content("#band-needs") == ""
    assert "--band 2:30" in lab.terminal("identify")
    # An answer that comes late does not take the place of a later one.
    held: list[Any] = []

    def answer(route: Any) -> None:
        if "rate.yaw" in route.request.post_data:
            held.append(route)
        else:
            route.continue_()

    page.route("**/api/preview", answer)
    lab.fill("#model", "rate.yaw")
    lab.fill("#model", "rate.roll")
    assert "--model rate.roll" in lab.terminal("identify")
    assert held
    for route in held:
        with page.expect_response("**/api/preview"):
            route.continue_()
    assert "--model rate.roll" in lab.terminal("identify")
    # What was said goes away with the next thing that is asked for.
    page.unroute("**/api/preview")
    page.fill("#channel", "no_such")
    page.press("#channel", "Enter")
    lab.until("document.querySelector('#message').textContent.includes('no_such')")
    page.fill("#channel", "motor_1")
    page.press("#channel", "Enter")
    lab.until("document.querySelector('#message').textContent === ''")


@pytest.mark.slow
def test_names_are_words_of_a_shell(lab: LabPage) -> None:
    page = lab.page
    page.click("#opener")
    page.locator("#choices-of-folder button").nth(1).click()
    page.wait_for_selector("#logs button.plain >> nth=2")
    lab.show(HOSTILE)
    *_, log, out, step = shlex.split(lab.terminal("review"))
    assert Path(log).name == HOSTILE
    assert (out, step) == ("--out", "step-1")
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    page.click("#command-review + button")
    lab.until("document.querySelector('#message').textContent.includes('Copied')")
    assert page.evaluate("navigator.clipboard.readText()") == page.text_content("#command-review")
    page.click("#run-review")
    page.click("#step-1 button:text-is('Cancel')")
    assert lab.ended(1) == "canceled"
    assert lab.command(1) == ["review", log, "--out", "step-1"]


@pytest.mark.slow
def test_nothing_waits_for_a_list(shared_browser: Any, tmp_path: Path, folder: Path) -> None:
    """A folder that is slow to be read holds up nothing, and models that did not come are asked for again."""
    private = tmp_path / "private"
    private.mkdir()
    asked: list[Any] = []
    with serving(folder, private=private) as (address, _):
        context = shared_browser.new_context()
        context.route("**/api/folder", lambda route: asked.append(route))
        page = context.new_page()
        refusals = iter(range(1))

        def models(route: Any) -> None:
            if next(refusals, None) is None:
                route.continue_()
            else:
                route.fulfill(status=400, json={"sentence": "not now"})

        context.route("**/api/models", models)
        lab = LabPage(page)
        page.goto(address)
        page.evaluate("window.taken = []")
        page.evaluate(
            "new MutationObserver(() => window.taken.push(document.querySelector('#taking').textContent))"
            ".observe(document.querySelector('#taking'), { childList: true, subtree: true, characterData: true })"
        )
        lab.drop(folder / "flight.ulg")
        lab.wait_for_tracks()
        # How much of the log arrived was told meanwhile.
        assert page.evaluate("window.taken.some((text) => /: [0-9.]+ of [0-9.]+ MiB/.test(text))")
        page.click("#run-review")
        page.click("#step-1 button:text-is('Cancel')")
        assert lab.ended(1) == "canceled"
        lab.until("document.querySelectorAll('#models button').length > 20")
        assert len(asked) == 1
        context.close()


def test_what_is_drawn_and_let_go(shared_browser: Any, served: str) -> None:
    """Labels of bands stand in them at the first drawing too, before the plot's own axes align words their way."""
    context = shared_browser.new_context()
    context.add_init_script(DRAWN_WORDS)
    lab = LabPage(context.new_page())
    lab.page.goto(served)
    lab.wait_for_tracks()
    drawn = lab.page.evaluate("window.drawn")
    assert {align for text, align in drawn if text in ("roll", "pitch")} == {"left"}
    # A track that is removed watches its place no more.
    watching = lab.page.evaluate("window.watchers.size")
    lab.page.click("#tracks .head button >> nth=0")
    assert lab.page.evaluate("window.watchers.size") == watching - 1
    context.close()


@pytest.mark.slow
def test_angles_are_shown_in_degrees_where_that_is_preferred(
    shared_browser: Any, tmp_path: Path, example: Path, looking: LabPage, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Tracks and spectra of a rate carry the factor; what has no angle in it stays, and so does what is kept."""
    settings, private = tmp_path / "rotorid.toml", tmp_path / "private"
    settings.write_text('angles = "deg"\n', encoding="utf-8")
    private.mkdir()
    monkeypatch.setenv("ROTORID_SETTINGS", str(settings))
    plots = "document.querySelector('#tracks .track:nth-child({}) .head .soft').textContent"
    with serving(example, private=private) as (address, _), opened(shared_browser, address) as lab:
        lab.wait_for_tracks(3)
        assert str(lab.page.evaluate(plots.format(2))).startswith("deg/s · ")
        assert not str(lab.page.evaluate(plots.format(1))).startswith("deg")
        degrees = pointed(lab)
        lab.page.click("#spectrum")
        lab.page.click("#spectrogram")
        lab.until("document.querySelector('#spectra').textContent.includes('dB of (deg)²/Hz')")
        state = lab.page.evaluate("fetch('/api/state').then((answer) => answer.json())")
        assert state["preferred"] == {"angles": "deg"}
    looking.wait_for_tracks(3)
    assert str(looking.page.evaluate(plots.format(2))).startswith("rad/s · ")
    assert degrees == pytest.approx(np.degrees(pointed(looking)), rel=1e-3)


def pointed(lab: LabPage) -> float:
    """The value of the second track in its middle, as the pointer reads it."""
    lab.page.locator("#tracks .u-over").nth(1).hover()
    text = str(lab.page.locator("#tracks .track").nth(1).locator(".value").text_content())
    return float(text.rpartition(":")[2].replace("−", "-"))


def test_segments_stay_with_their_log(looking: LabPage) -> None:
    lab, page = looking, looking.page
    lab.brush(40.0, 60.0)
    page.click("#opener")
    page.locator("#choices-of-folder button").nth(1).click()
    page.wait_for_selector("#logs button.plain >> nth=2")
    lab.show(HOSTILE)
    assert page.locator("#segments li").count() == 0
    assert "--segment" not in lab.terminal("identify")
    page.keyboard.press("s")
    first, second = segments(lab)
    assert (first[0], second[0]) == (1, 2)
    assert page.locator("#segments li").count() == 1
    lab.show("flight.ulg")
    assert f"--segment roll:40:{first[1]:.12g}" in lab.terminal("response")
    # A step back is shown on the log on which the change was made, and so is the step forth.
    page.click("#undo")
    lab.until("document.querySelector('#logs [data-shown] button')?.textContent !== 'flight.ulg'")
    assert segments(lab) == [first]
    page.click("#redo")
    assert segments(lab) == [first, second]
    lab.until("document.querySelectorAll('#segments li').length === 1")
    # A page that is loaded again shows the log that was looked at, with its own.
    lab.show("flight.ulg")
    page.reload()
    lab.wait_for_tracks()
    lab.until("document.querySelector('#logs [data-shown] button')?.textContent === 'flight.ulg'")
    assert f"--segment roll:40:{first[1]:.12g}" in lab.terminal("identify")
    # Where another log is fitted too, the page says what a list of segments means.
    page.click("#more summary")
    assert not page.is_visible("#shared-segments")
    page.select_option("#others select", "with")
    assert page.is_visible("#shared-segments")
