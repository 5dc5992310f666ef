"""A review in brief keeps every answer, its doubts, and where in the log it comes from."""

from __future__ import annotations

from dataclasses import replace

from tests.unit.report.made_reviews import made_review, untold_review

from rotorid.data.findings import remark, warn
from rotorid.reviewing.brief import brief_of
from rotorid.reviewing.cards import cards
from rotorid.signal.control import Control

FLIGHTS = ((12.0, 95.5),)


def test_a_brief_has_the_cards_with_the_flights_that_show_them() -> None:
    review = made_review()
    brief = brief_of(review)
    assert tuple(answer.card for answer in brief.answers) == cards(review)
    for answer in brief.answers:
        unknown = answer.card.state == "cannot" and not answer.card.number
        assert answer.evidence == (() if unknown or answer.card.key == "models" else FLIGHTS)


def test_what_was_not_measured_stays_unknown() -> None:
    review = untold_review()
    brief = brief_of(review)
    assert {answer.card.state for answer in brief.answers} == {"cannot"}
    assert all(answer.evidence == () for answer in brief.answers)
    assert [gap.what for gap in brief.cannot_tell] == ["yaw rate loop: rise time"]


def test_numbers_that_answers_judge_by_come_first() -> None:
    parts = brief_of(made_review()).parts
    assert parts["loops.p"].numbers == made_review().loops["p"].numbers
    assert parts["margins.roll"].by_model == ("gain_margin_db",)
    assert {part.evidence for part in parts.values()} == {FLIGHTS}
    assert next(iter(parts["margins.roll"].numbers)) == "phase_margin_deg"


def test_a_loss_of_control_is_shown_by_its_own_end_of_the_log() -> None:
    lost = Control(lost_at_s=80.0, cause="motor at its limit", stop_s=95.5)
    finding = warn("control_lost", "flight", "Control was lost at 80.0 s.", lost_at_s=80.0)
    brief = brief_of(replace(made_review(), control=lost, findings=(finding,)))
    (motors,) = (answer for answer in brief.answers if answer.card.key == "motors")
    assert motors.card.state == "look"
    assert motors.evidence == ((80.0, 95.5),)
    assert brief.findings[0].evidence == ((80.0, 80.0),)


def test_warnings_of_one_kind_are_one_with_a_count_and_notes_are_counted() -> None:
    review = made_review()
    noted = replace(review, findings=(*review.findings, remark("trim", "theta", "It flew forward.")))
    brief = brief_of(noted)
    assert [(found.finding.kind, found.count) for found in brief.findings] == [("gap", 2)]
    assert brief.notes == 1
