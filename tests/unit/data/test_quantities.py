"""A figure of merit has one row: words, unit, factor and limit stand nowhere else."""

from __future__ import annotations

import ast
import math
import re
from dataclasses import replace
from pathlib import Path

import pytest
from tests.sources import nodes
from tests.unit.report.made_reviews import made_review

import rotorid
from rotorid.data.quantities import BY_PART, QUANTITIES, FigureOfMerit, figure, figures_of, require_figures
from rotorid.data.quantity import Quantity
from rotorid.documents.review import LoopReviewDocument, MarginReviewDocument, review_document
from rotorid.errors import UsageError
from rotorid.report.review import render_reviews
from rotorid.reviewing.cards import cards
from rotorid.reviewing.values import LoopReview, MotorReview, NoiseReview, Review

SOURCE = Path(rotorid.__file__).parent
TABLE = SOURCE / "data" / "quantities.py"
DOCS = Path(__file__).resolve().parents[3] / "docs" / "review.md"
CARDS = "\n".join(line for line in DOCS.read_text(encoding="utf-8").splitlines() if line.startswith("|"))
MADE = FigureOfMerit(
    words="jerkiness",
    unit="%",
    factor=100.0,
    short="jerks by",
    good_below=0.2,
    card="tracking",
    trouble="{Axis} jerks.",
    whether="{axis} moves smoothly",
)


def test_a_number_without_a_row_is_no_part_of_a_review() -> None:
    unknown = {"jerkiness": Quantity.normal(0.1, 0.01, "1")}
    for part in (MotorReview, NoiseReview):
        with pytest.raises(UsageError, match="jerkiness"):
            part(numbers=unknown)
    with pytest.raises(UsageError, match="rise_time_s of margins"):
        require_figures("margins", {"rise_time_s": None})
    require_figures("motors", {"motor_3_high_share": None, "imbalance": None})


def test_documents_have_a_field_for_each_figure() -> None:
    assert list(figures_of("loops")) == [name for name in LoopReviewDocument.model_fields if name in QUANTITIES]
    assert list(figures_of("margins")) == [name for name in MarginReviewDocument.model_fields if name in QUANTITIES]


@pytest.mark.parametrize("name", QUANTITIES)
def test_a_row_is_whole(name: str) -> None:
    row = QUANTITIES[name]
    assert row.words
    assert "_" not in row.words.replace("M_s", "")
    assert math.isnan(row.good_above) or math.isnan(row.good_below)
    # A limit without a card judges nothing, and a card without a limit judges by nothing.
    assert bool(row.card) == (not math.isnan(row.limit))
    assert not row.per or any({name, row.per} <= set(rows) for rows in BY_PART.values())


def test_no_other_module_says_what_a_figure_is_called() -> None:
    """A table by names of figures is a second room, wherever it holds words."""
    found = {
        f"{path.relative_to(SOURCE)}:{line}" for path in SOURCE.rglob("*.py") if path != TABLE for line in _tables(path)
    }
    assert not found, f"words of figures belong to rotorid.data.quantities: {sorted(found)}"


def _tables(path: Path) -> list[int]:
    """Lines of dictionaries by two or more figures whose values hold words."""
    return [
        node.lineno
        for node in nodes(path)
        if isinstance(node, ast.Dict)
        and sum(_is_figure(key) for key in node.keys) > 1
        and any(_words(value) for value in node.values)
    ]


def _is_figure(key: ast.expr | None) -> bool:
    return isinstance(key, ast.Constant) and isinstance(key.value, str) and figure(key.value) is not None


def _words(value: ast.expr) -> bool:
    """Whether a value is, or begins with, a text that is more than a unit or a name of a field."""
    first = value.elts[0] if isinstance(value, ast.Tuple) and value.elts else value
    return isinstance(first, ast.Constant) and isinstance(first.value, str) and " " in first.value


@pytest.mark.parametrize("name", [name for name, row in QUANTITIES.items() if row.card and name != "clipping_share"])
def test_the_docs_of_the_cards_name_each_limit(name: str) -> None:
    row = QUANTITIES[name]
    limit = f"{100.0 * row.limit:g} %" if row.per else row.limit_text()
    assert re.search(rf"(?<![\d.]){re.escape(limit)}(?![\d.]\d)", CARDS), (
        f"docs/review.md names {limit}, of {row.words}"
    )


@pytest.fixture
def jerky(monkeypatch: pytest.MonkeyPatch) -> Review:
    """A review with a figure that was made up, which has a row and no other place."""
    table = {**QUANTITIES, "jerkiness": MADE}
    for module in ("data.quantities", "reviewing.card", "reviewing.cards", "report.review"):
        monkeypatch.setattr(f"rotorid.{module}.QUANTITIES", table)
    loops = {**figures_of("loops"), "jerkiness": MADE}
    monkeypatch.setattr("rotorid.data.quantities.BY_PART", {**BY_PART, "loops": loops})
    seen = made_review()
    numbers = {**seen.loops["p"].numbers, "jerkiness": Quantity.normal(0.4, 0.02, "1")}
    return _with_loop(seen, numbers)


def _with_loop(seen: Review, numbers: dict[str, Quantity]) -> Review:
    loop: LoopReview = replace(seen.loops["p"], numbers=numbers)
    return replace(seen, loops={**seen.loops, "p": loop})


def test_a_new_row_is_shown_and_judged_everywhere(jerky: Review) -> None:
    tracking = cards(jerky)[0]
    assert (tracking.state, tracking.number) == ("look", "roll jerks by 40 ± 4 %")
    assert tracking.sentence == "Roll jerks."
    page = render_reviews([jerky, jerky])
    assert "<td>jerkiness [%]</td>" in page
    assert "roll rate: jerkiness [%]" in page
    assert review_document(made_review()).cards[0].state != "look"


@pytest.mark.parametrize(
    ("name", "ends", "judgment"),
    [
        ("sensitivity_peak", (1.6, 1.2, 2.0), "good"),
        ("sensitivity_peak", (1.6, 1.2, 2.04), "good"),
        ("sensitivity_peak", (1.6, 1.2, 2.06), "cannot"),
        ("sensitivity_peak", (2.6, 2.1, 3.1), "look"),
        ("phase_margin_deg", (45.0, 39.6, 50.4), "good"),
        ("phase_margin_deg", (45.0, 39.4, 50.6), "cannot"),
        ("phase_margin_deg", (30.0, 24.0, 36.0), "look"),
    ],
)
def test_a_limit_is_compared_with_what_is_printed(name: str, ends: tuple[float, float, float], judgment: str) -> None:
    value, lower, upper = ends
    shown = Quantity(value=value, std=0.5 * (upper - value), lower=lower, upper=upper, unit="1")
    assert QUANTITIES[name].judged(shown) == judgment
