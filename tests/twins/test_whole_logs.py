"""Flights, landed hovers, benches and crashes in the formats of three autopilots, against their known truth."""

from __future__ import annotations

import json
from collections import Counter
from functools import cache
from pathlib import Path

import pytest
from tests.twins.whole_log_study import PAGE, Answer, examined, rows, study, wrong
from tests.twins.whole_logs import Case, cases, fly, write

import rotorid
from rotorid.documents.base import to_json
from rotorid.documents.review import review_document
from rotorid.report.review import render_reviews
from rotorid.reviewing.cards import cards

ROUTINE = {"flight": 4, "landed": 2, "bench": 2, "crash": 4}
WINDOWS_RIGHT, LOSSES_FOUND, LOSSES_FALSE = 0.98, 0.95, 0.01


def some() -> list[Case]:
    """The first few of each kind: the whole study flies 400."""
    return list(cases(ROUTINE["flight"], ROUTINE["landed"], ROUTINE["bench"], ROUTINE["crash"]))


@pytest.mark.parametrize("case", some(), ids=lambda case: case.file)
def test_control_is_lost_in_crashes_only(case: Case, tmp_path: Path) -> None:
    answer = examined(fly(case), tmp_path)
    assert answer.loss_is_said == (case.kind == "crash"), wrong(answer)
    assert not answer.green, wrong(answer)
    if case.kind == "crash":
        assert abs(answer.late_s) < 0.5, wrong(answer)


def test_the_review_of_a_crash_says_it_first(tmp_path: Path) -> None:
    made = fly(some()[-4])
    lost_s = made.truth.lost_s
    assert lost_s is not None
    reviewed = rotorid.review(rotorid.read(write(made, tmp_path)), models=False)
    assert reviewed.findings[0].kind == "control_lost"
    assert reviewed.flight.flights[-1][1] == pytest.approx(lost_s, abs=0.5)
    motors = next(card for card in cards(reviewed) if card.key == "motors")
    assert motors.state == "look"
    assert "was at its limit when control was lost" in motors.headline
    document = json.loads(to_json(review_document(reviewed)))
    assert document["control"]["lost_at_s"] == pytest.approx(lost_s, abs=0.5)
    assert (document["control"]["cause"], document["control"]["ends_in_air"]) == ("set-point missed", False)
    assert render_reviews([reviewed]).index("Control was lost at") < render_reviews([reviewed]).index('class="tiles"')


def test_the_review_of_a_landed_flight_has_a_null_control(tmp_path: Path) -> None:
    reviewed = rotorid.review(rotorid.read(write(fly(some()[1]), tmp_path)), models=False)
    assert json.loads(to_json(review_document(reviewed)))["control"] is None


def test_a_log_is_the_same_each_time() -> None:
    case = some()[0]
    assert fly(case).flight.columns["p"].tolist() == fly(case).flight.columns["p"].tolist()


def test_the_study_has_the_kinds_that_it_names() -> None:
    assert Counter(case.kind for case in cases()) == {"flight": 200, "landed": 60, "bench": 60, "crash": 80}
    assert {case.vehicle for case in cases()} == {"px4_quad", "x500", "ardupilot_quad", "betaflight_quad"}
    assert {10.0, 1000.0} <= {case.log_hz for case in cases()}


@cache
def answers() -> tuple[Answer, ...]:
    return tuple(study(cases()))


@pytest.mark.slow
def test_flight_windows_of_400_logs_are_right() -> None:
    bad = [wrong(answer) for answer in answers() if not answer.window_is_right]
    assert len(bad) <= (1.0 - WINDOWS_RIGHT) * len(answers()), "\n".join(bad)


@pytest.mark.slow
def test_losses_of_control_of_400_logs_are_found_and_no_others() -> None:
    crashes = [answer for answer in answers() if answer.case.kind == "crash"]
    others = [answer for answer in answers() if answer.case.kind != "crash"]
    assert sum(answer.loss_is_said for answer in crashes) >= LOSSES_FOUND * len(crashes)
    assert sum(answer.loss_is_said for answer in others) <= LOSSES_FALSE * len(others)


@pytest.mark.slow
def test_no_card_is_green_on_a_bench() -> None:
    assert [wrong(answer) for answer in answers() if answer.green] == []


@pytest.mark.slow
def test_the_page_has_the_table_of_this_study() -> None:
    assert "\n".join(rows(answers())) in PAGE.read_text(encoding="utf-8")
