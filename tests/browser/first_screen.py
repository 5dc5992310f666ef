"""What a reader sees of a page before scrolling, how long the page is while everything is folded, and what is too wide.

A test opens a page with :func:`first_screen`, which answers with a :class:`FirstScreen` of plain numbers and words, so
that it compares and needs no browser of its own::

    seen = first_screen(started, file)
    assert "The loop is well damped" in seen.words
    assert seen.height <= 4000
    assert seen.headings[0] == (1, "Flight of 25 November")
    assert first_screen(started, file, width=400).sideways <= 0
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

WIDTH, HEIGHT, PHONE = 1300, 900, 400
"""Pixels of a usual window, and the width of a phone."""

_LOOK = """
(fold) => {
  const shown = (one) => one.checkVisibility({ contentVisibilityAuto: true, visibilityProperty: true });
  const tidy = (text) => text.replace(/\\s+/g, " ").trim();
  const words = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node = walker.nextNode(); node; node = walker.nextNode()) {
    const { parentElement: parent } = node;
    if (!node.textContent.trim() || parent.closest("script, style, noscript, svg") || !shown(parent)) continue;
    const range = document.createRange();
    range.selectNodeContents(node);
    const { width, left, right, top, bottom } = range.getBoundingClientRect();
    if (width > 0 && right > 0 && left < innerWidth && top >= 0 && bottom <= fold) words.push(node.textContent);
  }
  const body = document.body.innerText;
  return {
    words: tidy(words.join(" ")),
    height: document.documentElement.scrollHeight,
    sideways: document.documentElement.scrollWidth - innerWidth,
    headings: Array.from(document.querySelectorAll("h1, h2, h3, h4, h5, h6")).filter(shown)
      .map((one) => [Number(one.tagName[1]), tidy(one.innerText)]),
    summaries: Array.from(document.querySelectorAll("summary")).filter(shown).map((one) => tidy(one.innerText)),
    drawn: document.querySelectorAll("[data-picture] .main-svg:first-of-type").length,
    count: tidy(body).split(" ").length,
    text: tidy(body),
  };
}
"""


@dataclass(frozen=True, kw_only=True)
class FirstScreen:
    """A page as it opens, with everything folded that the page folds.

    Parameters
    ----------
    words
        Text above the fold, in the order of the page, with single spaces.
    height
        Pixels of the whole page.
    sideways
        Pixels by which the page is wider than the window; none or less where it does not scroll sideways.
    headings
        Level and words of each visible heading, in their order.
    summaries
        Words of each visible line that opens a fold.
    drawn
        How many pictures are drawn.
    count, text
        Number of visible words of the whole page, and these words.
    """

    words: str
    height: int
    sideways: int
    headings: list[tuple[int, str]]
    summaries: list[str]
    drawn: int
    count: int
    text: str

    @property
    def levels_without_gap(self) -> bool:
        """Whether the first heading has level 1 and none is more than one level below the one before it."""
        levels = [0, *(level for level, _ in self.headings)]
        return all(after - before <= 1 for before, after in pairwise(levels))


def first_screen(
    browser: Any, file: Path, *, width: int = WIDTH, height: int = HEIGHT, dark: bool = False
) -> FirstScreen:
    """A page in a new window, after its pictures are drawn.

    Parameters
    ----------
    browser
        A started Chromium of playwright, as the fixtures ``shared_browser`` and ``started`` have it.
    file
        The page.
    width, height
        Size of the window in pixels.
    dark
        Whether the reader's system asks for dark pages.
    """
    context = browser.new_context(viewport={"width": width, "height": height}, color_scheme="dark" if dark else "light")
    try:
        page = context.new_page()
        page.goto(file.as_uri())
        page.wait_for_selector("html[data-pictures=drawn]")
        found = page.evaluate(_LOOK, height)
    finally:
        context.close()
    return FirstScreen(**{**found, "headings": [(level, words) for level, words in found["headings"]]})


def written(html: str, folder: Path) -> Path:
    """A page as a file, for :func:`first_screen`."""
    file = folder / "page.html"
    file.write_text(html, encoding="utf-8")
    return file
