"""The brief of a review is one small JSON whatever the log holds, and counts what it leaves out."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
from tests.unit.report.made_reviews import made_review, untold_review

from rotorid.data.findings import warn
from rotorid.data.quantity import Quantity
from rotorid.documents.base import to_json
from rotorid.documents.brief import MOST_BYTES, BriefDocument, brief_document
from rotorid.documents.review import review_document
from rotorid.reviewing.missing import Unavailable
from rotorid.reviewing.values import FlightSummary, Review


def text_of(review: Review) -> str:
    return to_json(brief_document(review), indent=None)


def test_a_brief_is_read_back_as_it_was_written() -> None:
    document = brief_document(made_review())
    assert BriefDocument.model_validate_json(to_json(document, indent=None)) == document
    assert not any(document.left_out.model_dump().values())


def test_numbers_are_those_of_the_whole_review() -> None:
    brief, whole = brief_document(made_review()), review_document(made_review())
    for name, number in brief.parts["loops.p"].numbers.items():
        full = getattr(whole.loops["p"], name)
        found = (number.value, number.lower, number.upper)
        np.testing.assert_allclose(found, (full.value, full.lower, full.upper), rtol=1e-4)
        assert number.unit == full.unit
    assert [answer.state for answer in brief.answers] == [card.state for card in whole.cards]


def test_an_end_without_a_bound_is_null() -> None:
    loud = Quantity(value=4.0, std=np.inf, lower=3.0, upper=np.inf, unit="m/s^2")
    review = made_review()
    noise = replace(review.noise, numbers={"vibration_m_s2": loud})
    number = json.loads(text_of(replace(review, noise=noise)))["parts"]["noise"]["numbers"]["vibration_m_s2"]
    assert number == {"value": 4.0, "lower": 3.0, "upper": None, "unit": "m/s^2"}


def test_any_review_is_small_and_says_what_it_leaves_out() -> None:
    review = made_review("f" * 4000 + "\u202e" * 4000)
    words = "ü\x1b" * 3000
    gaps = tuple(Unavailable(what=f"models.m{n}", why=f"{n} {words}", remedy=words) for n in range(100))
    crowded = replace(
        review,
        flight=FlightSummary(flights=tuple((float(n), n + 0.5) for n in range(900)), seen_in=words),
        vehicle=replace(review.vehicle, firmware=words, frame=words),
        cannot_tell=gaps,
        findings=tuple(warn(f"kind_{n}", words, words) for n in range(90)),
        next_commands=(words,) * 70,
    )
    document = brief_document(crowded)
    assert len(to_json(document, indent=None).encode()) < MOST_BYTES
    left_out = document.left_out
    assert left_out.cannot_tell + len(document.cannot_tell) == len(gaps)
    assert left_out.findings + len(document.findings) == 90
    assert left_out.next_commands + len(document.next_commands) == 70
    assert left_out.flights + len(document.flights_s) == 900
    assert len(document.answers) == 7


def test_a_log_without_a_flight_has_no_evidence() -> None:
    document = brief_document(untold_review())
    assert document.flights_s == []
    assert all(answer.state == "cannot" and not answer.evidence_s for answer in document.answers)
