"""Claims of README, CHANGELOG and docs that the program can confirm or refute."""

from __future__ import annotations

import re

import pytest
from tests.docs.measured import FLIGHTS, ROOT, SAMPLES, Flight, first_command, row_of

from rotorid.models.rotors import layout_names
from rotorid.search.catalog import searches
from rotorid.vehicles.catalog import VEHICLES

NUMBERS = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")


def page(name: str) -> str:
    """A page on one line, so that a sentence is found wherever it is broken."""
    return re.sub(r"\s+", " ", (ROOT / name).read_text(encoding="utf-8"))


def count(name: str, sentence: str) -> int:
    """The number at ``{n}`` in a sentence of a page, in digits or in words."""
    found = re.findall(re.escape(sentence).replace(r"\{n\}", r"(\w+)"), page(name))
    assert len(found) == 1, f"{name} says {len(found)} times: {sentence}"
    return int(found[0]) if found[0].isdigit() else NUMBERS.index(found[0].lower())


FLYING = [name for name in VEHICLES if name != "rig"]


@pytest.mark.parametrize(
    ("name", "sentence", "is_so"),
    [
        ("CHANGELOG.md", "a library of {n}, or a TOML file", len(layout_names())),
        ("CHANGELOG.md", "- {n} searches with one interface", len(searches())),
        ("CHANGELOG.md", "- {n} vehicles with sources", len(FLYING)),
        ("docs/what-it-does.md", "[{n} multirotors](simulation.md)", len(FLYING)),
    ],
)
def test_things_are_as_many_as_is_said(name: str, sentence: str, is_so: int) -> None:
    assert count(name, sentence) == is_so


@pytest.mark.usefixtures("shared_data")
def test_the_readme_shows_what_the_first_command_prints() -> None:
    assert SAMPLES["first command"].shown == first_command(), "renew it with `python -m tests.docs.measured`"


@pytest.mark.parametrize(
    "flight",
    [flight if place == 0 else pytest.param(flight, marks=pytest.mark.slow) for place, flight in enumerate(FLIGHTS)],
    ids=lambda flight: flight.title,
)
@pytest.mark.usefixtures("shared_data")
def test_the_table_of_accuracy_shows_what_is_identified(flight: Flight) -> None:
    assert row_of(flight) in SAMPLES["known truths"].shown, "renew it with `python -m tests.docs.measured`"
