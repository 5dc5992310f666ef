"""Answers are small, say what they left out, and keep what is unknown unknown."""

from __future__ import annotations

import json
from typing import Any

import pytest

from rotorid.documents.answer import AnswerDocument
from rotorid.mcp.answers import MOST_BYTES, bounded, evidence, not_checked

NUMBER = {"value": 1.23456789, "std": 0.1, "lower": 1.0, "upper": 1.4, "unit": "1/s"}


def answer_of(document: Any, **fields: Any) -> dict[str, Any]:
    text = bounded(AnswerDocument(tool="review", state="done", answer=document, **fields))
    assert len(text.encode()) <= MOST_BYTES
    found: dict[str, Any] = json.loads(text)
    return found


@pytest.mark.parametrize(
    "document",
    [
        {"curve": [0.123456789] * 100_000},
        {f"key-{k}": NUMBER for k in range(3000)},
        {f"key-{k}": {f"inner-{j}": [j] * 50 for j in range(50)} for k in range(50)},
        {"text": "ü\u202e\x1b\U0001f681" * 20_000},
        [{"row": k, "text": "x" * 100} for k in range(2000)],
        {"k" * 15_000: 1, "m" * 15_000: [1]},
        {"a": [{"b": [{"c": ["d" * 30_000]}]}]},
        "x" * 100_000,
        {"findings": [{"kind": f"kind_{k}", "severity": "warning", "message": "m" * 300} for k in range(300)]},
        {"cannot_tell": [{"what": f"w{k}", "why": "y" * 500, "remedy": "r" * 500} for k in range(200)]},
    ],
)
def test_every_answer_fits_and_says_what_it_left_out(document: Any) -> None:
    found = answer_of(
        document,
        evidence=[{"log": "l" * 200, "use": "fitted", "start_s": 0.0, "stop_s": k} for k in range(500)],
        not_checked=["n" * 600] * 100,
        files=["f" * 200] * 500,
    )
    assert found["left_out"]
    assert {"evidence", "not_checked", "files"} <= {row.partition(":")[0] for row in found["left_out"]}


def test_a_number_never_loses_its_interval() -> None:
    found = answer_of({"models": {f"m{k}": {f"p{j}": NUMBER for j in range(20)} for k in range(40)}})
    kept = [number for model in found["answer"]["models"].values() for number in model.values()]
    assert kept
    assert all(number == NUMBER | {"value": 1.23457} for number in kept)


def test_times_keep_their_milliseconds() -> None:
    assert answer_of({"start_s": 1_234_567.8914, "tau_s": 0.0053527})["answer"] == {
        "start_s": 1_234_567.891,
        "tau_s": 0.0053527,
    }


def test_null_stays_null() -> None:
    assert answer_of({"upper": None, "parts": [None], "bad": float("nan")})["answer"] == {
        "upper": None,
        "parts": [None],
        "bad": None,
    }


def test_what_is_unknown_survives_a_document_that_is_cut() -> None:
    gaps = [{"what": f"loops.{k}", "why": "The stick did not move.", "remedy": "Move it."} for k in range(9)]
    document = {"schema": "rotorid.review/1", "cannot_tell": gaps, "loops": {str(k): [k] * 500 for k in range(99)}}
    found = answer_of(document, not_checked=not_checked(document))
    assert found["answer"]["cannot_tell"] == gaps
    assert found["not_checked"] == [f"loops.{k}" for k in range(9)]


def test_warnings_survive_and_notes_go() -> None:
    notes = [{"kind": "airborne", "severity": "info", "message": "m" * 300, "numbers": {}}] * 99
    bad = {"kind": "closed_loop_bias", "severity": "warning", "message": "Biased.", "numbers": {"a": 1.0}}
    open_ = {"kind": "kinematics_unchecked", "severity": "info", "message": "Not checked.", "numbers": {}}
    document = {"findings": [*notes, bad, bad, open_]}
    found = answer_of(document, not_checked=not_checked(document))
    assert [(row["kind"], row["count"]) for row in found["answer"]["findings"]] == [
        ("closed_loop_bias", 2),
        ("kinematics_unchecked", 1),
    ]
    assert found["not_checked"] == ["kinematics_unchecked: Not checked."]


def test_a_model_that_nothing_validated_says_so() -> None:
    result = {"model": "rate.roll", "parameters": {"L_p": NUMBER}, "verification": {"maneuvers": [], "sweeps": []}}
    assert not_checked(result) == ["rate.roll: no unseen maneuver was left to validate it"]


def test_gains_without_enough_data_are_not_checked() -> None:
    document = {"judged": {"verdict": "not_enough_data", "axes": {"yaw": {"verdict": "not_enough_data"}}}}
    assert not_checked(document) == ["yaw: not enough data for a verdict"]


def test_spans_say_what_they_were_used_for() -> None:
    sweep = {"record": "a.ulg", "axis": "roll", "kind": "sweep", "start_s": 1.0, "stop_s": 2.0}
    later = sweep | {"start_s": 5.0, "stop_s": 6.0}
    result = {"provenance": {"maneuvers": [sweep]}, "verification": {"maneuvers": [later], "sweeps": []}}
    assert [(span.use, span.start_s) for span in evidence({"results": [result, result]})] == [
        ("fitted: roll sweep", 1.0),
        ("unseen: roll sweep", 5.0),
    ]
    verified = {"maneuvers": [later], "provenance": {"maneuvers": [later]}}
    assert [span.use for span in evidence(verified)] == ["verified: roll sweep"]
