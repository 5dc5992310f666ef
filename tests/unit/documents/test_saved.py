"""Results show themselves, and what a program saves is what the command writes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.unit.report.made_reviews import made_review
from tests.unit.report.verification_sample import verify_document

import rotorid
from rotorid.documents.base import to_json
from rotorid.documents.compare import CompareDocument, ComparedParameterDocument, ComparedValueDocument
from rotorid.documents.review import ReviewDocument, review_arrays, review_document
from rotorid.documents.saved import load_document, save
from rotorid.documents.track import track_document
from rotorid.errors import UsageError
from rotorid.identifying.tracking import FlightTracking
from rotorid.results.provenance import Provenance
from rotorid.verification.tracking import Step, Tracking


def tracked() -> FlightTracking:
    time_s = np.arange(0.5, 100.0, 0.5)
    ones = np.ones_like(time_s)
    return FlightTracking(
        log="flight.ulg",
        model="rate.roll",
        axis="roll",
        parameters={"L_roll": 150.0},
        given=False,
        instrument="roll_stick",
        reference_s=(0.0, 60.0),
        tracking=Tracking(
            time_s=time_s,
            ratio=np.where(time_s > 80.0, 0.7, 1.0),
            std=0.02 * ones,
            cannot_tell=("stick",) * 10 + ("",) * (time_s.size - 10),
            steps=(Step(at_s=82.0, since_s=80.0, ratio=0.7, std=0.02),),
            reference_gain=1.0,
            thrust_exponent=None,
            level=ones,
            rougher=ones,
        ),
        trims=(),
        findings=(),
        provenance=Provenance(settings={"step_share": 0.05}),
    )


def test_a_review_shows_its_answers_and_is_saved_as_the_command_writes_it(tmp_path: Path) -> None:
    review = made_review()
    lines = repr(review).splitlines()
    assert lines[0] == "flight.ulg: X, PX4 1.15, 1 flight, 84 s"
    assert [line.split("  ")[1] for line in lines[1:8]] == [card.word for card in review_document(review).cards]
    assert lines[-1].split() == ["next", *review.next_commands[0].split()]
    assert "<td>warning</td><td>A gap of 0.2 s at 14.2 s.</td>" in review._repr_html_()
    save(review, tmp_path / "out")
    assert (tmp_path / "out" / "review.json").read_text(encoding="utf-8") == to_json(review_document(review))
    assert np.load(tmp_path / "out" / "review.npz").files == list(review_arrays(review))
    loaded = load_document(tmp_path / "out")
    assert isinstance(loaded, ReviewDocument)
    assert loaded == review_document(review)
    assert repr(loaded) == repr(review)


def test_a_tracked_flight_shows_when_it_changed(tmp_path: Path) -> None:
    found = tracked()
    words = repr(found)
    assert words.splitlines()[0] == "flight.ulg: gain of rate.roll in flight"
    assert "changed" in words
    assert "from 80.0 s" in words
    assert "not enough data" in words
    rotorid.save(found, tmp_path)
    assert rotorid.load_document(tmp_path) == track_document(found)
    assert (tmp_path / "track.npz").exists()


def test_a_verification_shows_the_verdict_on_each_maneuver() -> None:
    document = verify_document()
    words = repr(document)
    assert words.splitlines()[0].endswith("on 1 unseen maneuver")
    assert document.maneuvers[0].verdict in words
    assert document._repr_html_().count("<tr>") == len(words.splitlines())


def test_a_dropped_parameter_is_no_zero_in_a_comparison() -> None:
    values = {
        "a": ComparedValueDocument(value=-1.0, std=0.1, status="free"),
        "b": ComparedValueDocument(value=0.0, std=None, status="dropped"),
    }
    shared = ComparedParameterDocument(unit="1/s", values=values)
    document = CompareDocument.model_construct(models=[], parameters={"L_p": shared}, maneuvers=[], findings=[])
    assert [line.split()[:3] for line in repr(document).splitlines()[1:]] == [["L_p", "1/s", "a"]]


def test_what_is_no_result_or_document_is_refused_in_words(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"list cannot be saved; expected a model, Review"):
        save([1.0], tmp_path)  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="has no JSON"):
        load_document(tmp_path)
    (tmp_path / "a.json").write_text('{"schema": "other/3"}', encoding="utf-8")
    with pytest.raises(UsageError, match="its schema is 'other/3'"):
        load_document(tmp_path)
    (tmp_path / "a.json").write_text("[1, 2", encoding="utf-8")
    with pytest.raises(UsageError, match=r"a\.json is no document of this version"):
        load_document(tmp_path)
    (tmp_path / "b.json").write_text("{}", encoding="utf-8")
    with pytest.raises(UsageError, match=r"has a\.json, b\.json; expected one document"):
        load_document(tmp_path)
