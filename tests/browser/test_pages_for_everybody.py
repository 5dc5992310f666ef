"""Every page in a real browser: readable by everybody, on a phone, on paper, and nothing is asked of a network."""

from __future__ import annotations

import contextlib
import csv
import re
from collections.abc import Iterable, Iterator
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import pytest
from tests.browser.lab_page import violations
from tests.browser.test_fleet_in_chromium import page_of
from tests.browser.test_tuning_in_chromium import proposed
from tests.fleet_logs import table_of
from tests.unit.cli.commands import rotorid
from tests.unit.flying.test_stitching import SPEEDS, both
from tests.unit.report.hover_sample import hover_identification
from tests.unit.report.made_reviews import made_review
from tests.unit.report.test_design_page import CHOICES, designed

from rotorid.documents.stitched import stitched_document
from rotorid.flying.stitching import stitch
from rotorid.report.design import render_design
from rotorid.report.identification import render_sections
from rotorid.report.review import render_reviews
from rotorid.report.stitched import render_stitched
from rotorid.report.tune import render_tune

pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
pytest.importorskip("axe_playwright_python", reason="axe_playwright_python is not installed")

PAPER = {
    "identify": (5, 9),
    "several": (8, 16),
    "review": (4, 8),
    "tune": (3, 8),
    "check": (1, 4),
    "response": (2, 6),
    "verify": (2, 6),
    "track": (1, 4),
    "inspect": (3, 6),
    "compare": (1, 4),
    "flown": (1, 4),
    "design": (2, 8),
    "stitch": (1, 6),
    "fleet": (1, 3),
}
"""Fewest and most pages of paper, for a log with sweeps of four axes."""

COMMANDS = {
    "identify": ("identify", "example/flight.ulg", "--model", "hover.full"),
    "rates": ("identify", "example/flight.ulg", "--model", "rate.roll,rate.pitch", "--tables", "csv"),
    "several": ("identify", "example/flight.ulg", "--model", "rate.roll,rate.pitch,rate.yaw,physical.motors"),
    "review": ("review", "example/flight.ulg"),
    "tune": ("tune", "rates", "example/flight.ulg"),
    "check": ("tune", "--check", "tune", "example/flight.ulg"),
    "response": ("response", "example/flight.ulg", "--inputs", "roll_command", "--outputs", "p"),
    "verify": ("verify", "rates/rate.roll", "example/flight.ulg"),
    "track": ("track", "example/flight.ulg"),
    "inspect": ("inspect", "example/flight.ulg"),
    "compare": ("compare", "rates/rate.roll", "rates/rate.pitch"),
    "flown": ("simulate", "rates/rate.roll", "--log", "example/flight.ulg"),
}


QUICK = ("rates", "inspect", "fleet")
"""Pages of every kind of part, which are looked at each time; all of them in the studies."""


def each(names: Iterable[str]) -> list[Any]:
    """Names of pages, those that take long marked."""
    return [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in names]


@cache
def made(name: str) -> str:
    """A page without any flight."""
    if name == "gains":
        return render_tune(proposed(), title="t")
    if name == "hover":
        return render_sections([hover_identification()], title="t")
    if name == "design":
        return render_design(designed(), CHOICES, title="two plans")
    if name == "stitch":
        stitched = stitch(both(*SPEEDS))
        return render_stitched(stitched, stitched_document(stitched), title="over speed")
    return page_of(table_of([[1.0, 2.0, 1.5, 1.2], [1.1, 1.0, 1.3, 1.4], [9.0, 9.1, 9.2, 9.3]]))


class Pages:
    """Pages of commands on a simulated flight, and of plans, speeds and fleets, each made when it is asked for."""

    def __init__(self, place: Path) -> None:
        self.place = place
        self.run("example", "px4", "--out", "example")

    def run(self, *words: str) -> None:
        with contextlib.chdir(self.place):
            ran = rotorid(*words, "--quiet")
        assert ran.code == 0, ran.err

    def __getitem__(self, name: str) -> Path:
        folder = self.place / name
        if not folder.exists() and name in COMMANDS:
            verb, *words = COMMANDS[name]
            for needed in {word.partition("/")[0] for word in words} & COMMANDS.keys():
                self[needed]
            self.run(verb, *words, "--out", name)
        elif not folder.exists():
            page = made(name)
            folder.mkdir()
            (folder / "report.html").write_text(page, encoding="utf-8")
        return next(folder.glob("*.html"))


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> Pages:
    return Pages(tmp_path_factory.mktemp("pages"))


@pytest.fixture
def page(shared_browser: Any) -> Iterator[Any]:
    context = shared_browser.new_context(viewport={"width": 1300, "height": 900}, accept_downloads=True)
    yield context.new_page()
    context.close()


def shown(page: Any, file: Path) -> None:
    page.goto(file.as_uri())
    page.wait_for_selector("html[data-pictures=drawn]")


CUT = """
Array.from(document.querySelectorAll("td, th"))
  .filter((cell) => cell.checkVisibility() && !cell.closest(".cards thead, .fleet-table"))
  .filter((cell) => cell.scrollWidth > cell.clientWidth)
  .map((cell) => cell.innerText)
"""
SIDEWAYS = """
Array.from(document.querySelectorAll(".scroll"))
  .filter((one) => one.checkVisibility({ contentVisibilityAuto: true }) && one.scrollWidth > one.clientWidth)
  .map((one) => one.innerText.slice(0, 200))
"""
UNFOLD = (
    "(open) => { for (const one of document.querySelectorAll('details:not(:has([data-picture]))')) one.open = open; }"
)
BARE = """
Array.from(document.querySelectorAll(".card"))
  .filter((card) => card.checkVisibility() && card.querySelector("h2, h3"))
  .filter((card) => Array.from(card.children).every((one) => /^H[2-4]$/.test(one.tagName) || !one.checkVisibility()))
  .map((card) => card.innerText)
"""
DEAD = """
Array.from(document.querySelectorAll('a[href^="#"]'), (link) => link.getAttribute("href"))
  .filter((href) => !document.getElementById(href.slice(1)))
"""


@pytest.mark.parametrize("name", each(PAPER))
def test_a_page_is_for_everybody(name: str, pages: Pages, page: Any) -> None:
    told: list[str] = []
    page.on("console", lambda message: told.append(message.text))
    page.on(
        "request",
        lambda request: told.append(request.url) if not request.url.startswith(("file:", "data:", "blob:")) else None,
    )
    shown(page, pages[name])
    for theme in ("light", "dark"):
        page.emulate_media(color_scheme=theme)
        assert violations(page) == []
    assert page.evaluate(SIDEWAYS) == []
    assert page.evaluate(DEAD) == []
    assert page.locator("nav.parts").first.evaluate("(menu) => getComputedStyle(menu).position") == "sticky"
    levels = page.evaluate("Array.from(document.querySelectorAll('h1,h2,h3,h4'), (one) => Number(one.tagName[1]))")
    assert levels[0] == 1
    assert all(after - before <= 1 for before, after in pairwise(levels))
    page.set_viewport_size({"width": 400, "height": 900})
    shown(page, pages[name])
    page.evaluate(UNFOLD, True)
    assert page.evaluate("document.documentElement.scrollWidth") <= 400
    assert page.evaluate(CUT) == []
    assert page.evaluate(SIDEWAYS) == []
    page.evaluate(UNFOLD, False)
    printed = page.pdf(prefer_css_page_size=True)
    fewest, most = PAPER[name]
    assert fewest <= len(re.findall(rb"/Type\s*/Page[^s]", printed)) <= most
    page.emulate_media(media="print")
    page.evaluate("for (const one of document.querySelectorAll('details:not(.reading)')) one.open = true;")
    assert page.evaluate(BARE) == []
    assert told == []


@pytest.mark.parametrize("name", each(COMMANDS))
def test_a_page_links_to_all_that_stands_beside_it(name: str, pages: Pages, page: Any) -> None:
    file = pages[name]
    shown(page, file)
    hrefs = page.evaluate("Array.from(document.querySelectorAll('a[href]'), (one) => one.getAttribute('href'))")
    linked = {unquote(href) for href in hrefs if not href.startswith("#")}
    assert all((file.parent / one).is_file() for one in linked)
    beside = {one.name for one in file.parent.iterdir() if one.is_file()} - {file.name}
    assert beside <= linked
    assert page.locator(".to-files a").first.is_visible()


def test_a_report_links_to_its_tables(pages: Pages, page: Any) -> None:
    file = pages["rates"].parent / "rate.roll" / "report.html"
    shown(page, file)
    linked = page.evaluate("Array.from(document.querySelectorAll('#files a'), (one) => one.getAttribute('href'))")
    tables = {f"tables/{one.name}" for one in (file.parent / "tables").iterdir()}
    assert tables
    assert tables < set(linked)
    assert "rate.roll/report.html" in pages["rates"].read_text(encoding="utf-8")


def test_a_page_without_files_offers_none(pages: Pages, page: Any) -> None:
    shown(page, pages["stitch"])
    assert not page.locator("#files").is_visible()
    assert not page.locator(".to-files").first.is_visible()


INK = """
() => ["body", ".quiet", ".card"].map((name) => {
  const style = getComputedStyle(document.querySelector(name));
  return [style.color, style.backgroundColor];
})
"""


@pytest.mark.parametrize("theme", [None, "dark"])
def test_dark_stays_on_the_screen(theme: str | None, page: Any, tmp_path: Path) -> None:
    file = themed(made("hover"), theme, tmp_path)
    page.emulate_media(color_scheme="dark")
    shown(page, file)
    (ink, _), _, (_, card) = page.evaluate(INK)
    assert (ink, card) == ("rgb(227, 230, 234)", "rgb(25, 29, 34)")
    page.emulate_media(color_scheme="dark", media="print")
    (ink, paper), (quiet, _), (_, card) = page.evaluate(INK)
    assert (ink, paper, quiet, card) == ("rgb(0, 0, 0)", "rgb(255, 255, 255)", "rgb(68, 74, 82)", "rgb(255, 255, 255)")


def themed(html: str, theme: str | None, folder: Path) -> Path:
    """A page of somebody who prefers a theme."""
    file = folder / "page.html"
    root = '<html lang="en"'
    file.write_text(html.replace(root, f'{root} data-theme="{theme}"' if theme else root, 1), encoding="utf-8")
    return file


PICTURES = {"gains": ("roll-step", "roll-by-hand"), "fleet": ("fleet-population", "fleet-history")}


@pytest.mark.parametrize("name", PICTURES)
@pytest.mark.parametrize(("theme", "system", "ink"), [("dark", "light", "#d7dae0"), ("light", "dark", "#24292f")])
def test_the_preferred_theme_is_that_of_every_picture_and_each_is_saved_as_lines(
    name: str, theme: str, system: str, ink: str, page: Any, tmp_path: Path
) -> None:
    page.emulate_media(color_scheme=system)
    shown(page, themed(made(name), theme, tmp_path))
    if name == "gains":
        page.click(".axis > summary")
        page.click(".by-hand .minor > summary")
    for key in PICTURES[name]:
        page.wait_for_selector(f"[data-picture={key}] .main-svg")
        drawn = f"document.querySelector('[data-picture={key}]').layout.template.layout.font.color"
        assert page.evaluate(drawn) == ink
        page.hover(f"[data-picture={key}]")
        with page.expect_download() as saved:
            page.click(f"[data-picture={key}] [data-title*='ownload']")
        assert saved.value.suggested_filename.endswith(f"{key}.svg")


def copied(page: Any, button: str = "button.copy") -> list[list[str]]:
    """What the first table gives to a spreadsheet, or that of another button."""
    page.evaluate("navigator.clipboard.writeText = (text) => { window.copied = text; return Promise.resolve(); }")
    page.locator(button).first.click()
    page.wait_for_function("window.copied !== undefined")
    return list(csv.reader(page.evaluate("window.copied").splitlines()))


def test_a_table_is_copied_as_numbers(page: Any, tmp_path: Path) -> None:
    shown(page, themed(render_reviews([made_review()]), None, tmp_path))
    page.click("#l1-margins > summary")
    table = page.locator("#l1-margins .scroll")
    head = table.locator("th").all_inner_texts()
    first, *rows = copied(page, "#l1-margins .copy")
    ends = ("", " from", " to", " note")
    assert first == ["Number", *(f"{name}{end}" for name in head[1:] for end in ends)]
    seen = table.locator("tbody tr").all_inner_texts()
    assert len(rows) == len(seen) > 3
    for row, words in zip(rows, seen, strict=True):
        name, *cells = row
        assert words.startswith(name)
        assert len(cells) == len(ends) * (len(head) - 1)
        for k in range(0, len(cells), len(ends)):
            value, low, high = (float(cell) for cell in cells[k : k + 3])
            assert low <= value <= high
            assert cells[k + 3] == ("by model" if name.startswith("gain margin") else "")


def test_every_way_of_writing_a_number_is_copied(page: Any, tmp_path: Path) -> None:
    rows = (
        ("a", "−4.31 ± 0.19", "1/s"),
        ("b", "(2.50 ± 0.12)·10⁻⁵", "s"),
        ("c", "1.5·10⁻⁷", ""),
        ("d, of e", "–", "–"),
        ("f", "27 <span class='words'>−3 to 58</span>", "0.5 to 20 rad/s"),
        ("g", "> 1000", "−3.2 ms"),
        ("h", "0.62 (−0.33)", "not seen"),
    )
    cells = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in rows)
    head = "<thead><tr><th>Name</th><th>Value<br>[x]</th><th>More</th></tr></thead>"
    table = f"<div class='scroll'><table>{head}<tbody>{cells}</tbody></table></div>"
    html = re.sub(r"(<main [^>]*>)", rf"\1{table}", render_reviews([made_review()]), count=1)
    shown(page, themed(html, None, tmp_path))
    assert copied(page) == [
        [
            "Name",
            *("Value [x]", "Value [x] ±", "Value [x] from", "Value [x] to", "Value [x] in parentheses"),
            *("More", "More from", "More to", "More unit"),
        ],
        ["a", "-4.31", "0.19", "", "", "", "1/s", "", "", ""],
        ["b", "2.50e-5", "0.12e-5", "", "", "", "s", "", "", ""],
        ["c", "1.5e-7", "", "", "", "", "", "", "", ""],
        ["d, of e", "", "", "", "", "", "", "", "", ""],
        ["f", "27", "", "-3", "58", "", "", "0.080", "3.2", "Hz"],
        ["g", "> 1000", "", "", "", "", "-3.2", "", "", "ms"],
        ["h", "0.62", "", "", "", "-0.33", "not seen", "", "", ""],
    ]


def test_titles_are_not_cut_on_a_phone(page: Any, tmp_path: Path) -> None:
    page.set_viewport_size({"width": 400, "height": 900})
    shown(page, themed(made("hover"), None, tmp_path))
    edges = page.evaluate(
        "Array.from(document.querySelectorAll('.annotation-text, .xtitle'), (one) => one.getBoundingClientRect().right)"
    )
    assert edges
    assert max(edges) <= 400
    assert page.locator(".annotation-text tspan.line").count() > 0


GAPS = """
Array.from(document.querySelectorAll("[data-picture]"))
  .filter((one) => one._fullLayout?.yaxis3 && one.layout.annotations)
  .map(({ _fullLayout: { _size, ...layout } }) => {
    const spans = Object.keys(layout).filter((name) => /^yaxis/.test(name)).map((name) => layout[name].domain);
    spans.sort((a, b) => b[0] - a[0]);
    return Math.min(...spans.slice(1).map((span, k) => (spans[k][0] - span[1]) * _size.h));
  })
"""


def test_folded_parts_are_printed_whole_and_panels_keep_room_for_their_titles(page: Any, tmp_path: Path) -> None:
    shown(page, themed(made("hover"), None, tmp_path))
    page.emulate_media(media="print")
    closed = page.locator("details:not([open])").count()
    assert closed > 0
    assert not page.locator("details:not([open]) > summary").first.is_visible()
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert page.locator("details.fold dl").first.is_visible()
    assert page.locator("details:not([open], .reading, .minor)").count() == 0
    undrawn = "[data-picture]:not(details:not([open]) *, :has(> .plot-container))"
    assert page.locator(undrawn).count() == 0
    gaps = page.evaluate(GAPS)
    assert gaps
    assert min(gaps) >= 9.0
    page.evaluate("window.dispatchEvent(new Event('afterprint'))")
    assert page.locator("details:not([open])").count() == closed


@pytest.mark.slow
def test_the_page_of_the_demo_is_for_everybody(page: Any, tmp_path: Path) -> None:
    assert rotorid("demo", "--out", tmp_path / "demo", "--quiet").code == 0
    for width in (1300, 400):
        page.set_viewport_size({"width": width, "height": 900})
        shown(page, tmp_path / "demo" / "report.html")
        assert violations(page) == []
        assert page.evaluate(CUT) == []
        assert page.evaluate("document.documentElement.scrollWidth") <= width
