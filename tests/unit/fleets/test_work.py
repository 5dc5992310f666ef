"""Work on one log: each part of its answer fails alone, and is named with the reason."""

from __future__ import annotations

from typing import Any

import pytest
from tests.unit.cli.commands import fly_roll_sweeps

from rotorid.fleets import work
from rotorid.fleets.places import Place
from rotorid.fleets.work import Task


@pytest.fixture(scope="module")
def task(tmp_path_factory: pytest.TempPathFactory) -> Task:
    path = tmp_path_factory.mktemp("fleet") / "flight.csv"
    fly_roll_sweeps(path)
    asked = {"models": ("rate.roll",), "review": False, "seed": 0}
    return Task(place=Place(address=str(path), mark=""), asked=asked, settings="", salt="s")


@pytest.mark.parametrize(("name", "part"), [("board_of", "board"), ("aircraft_of", "vehicle"), ("gains_of", "gains")])
def test_a_part_that_fails_leaves_the_rows_of_the_models(
    task: Task, name: str, part: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("ROTORID_STRICT", raising=False)
    monkeypatch.setattr(work, name, broken)
    monkeypatch.setattr(work, "_model_results", lambda *_: iter([("rate.roll", [NUMBERS])]))
    found = work.answer(task)
    assert [row.model for row in found.rows] == ["rate.roll"]
    (lost,) = found.failed
    assert (lost.model, lost.kind) == (part, "error")
    assert "KeyError" in lost.reason


def test_rows_of_a_model_that_cannot_be_made_leave_those_of_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROTORID_STRICT", raising=False)
    monkeypatch.setattr(work, "_numbers", broken)
    model: Any = None
    said = work._numbers_or_reason("rate.roll", model)
    assert isinstance(said, str)
    assert "KeyError" in said


def broken(*_: object) -> Any:
    raise KeyError("field")


NUMBERS = {"parameter": "L_roll", "unit": "1", "findings": ""} | dict.fromkeys(
    ("value", "std", "std_random", "lower", "upper"), 1.0
)
