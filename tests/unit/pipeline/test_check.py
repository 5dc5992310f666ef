"""What a model is judged on: never on what it was fitted to."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.unit.cli.commands import fly_roll_sweeps

from rotorid.data.record import FlightRecord
from rotorid.io.registry import read
from rotorid.pipeline.document import ResultDocument
from rotorid.pipeline.identify import identify
from rotorid.pipeline.settings import IdentifySettings, parse_segment

BAND = (12.0, 50.0)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("flight") / "sweeps.csv"
    fly_roll_sweeps(path)
    return path


@pytest.fixture(scope="module")
def record(log: Path) -> FlightRecord:
    return read(log)


def kinds(document: ResultDocument) -> set[str]:
    return {finding.kind for finding in document.findings}


def test_the_last_of_several_sweeps_is_held_out(record: FlightRecord) -> None:
    document = identify([record], "rate.roll", settings=IdentifySettings(band_rad_s=BAND)).document
    (held_out,) = (finding for finding in document.findings if finding.kind == "held_out")
    # The second sweep starts at 56 s and fades in.
    assert held_out.where.startswith("sweeps.csv at 56.")
    assert document.verification.frequency.keys() == {"p/roll_command"}
    assert document.verification.frequency["p/roll_command"] < 50.0


def test_a_log_given_again_as_unseen_is_not_taken_for_unseen(record: FlightRecord, log: Path) -> None:
    settings = IdentifySettings(band_rad_s=BAND)
    document = identify([record], "rate.roll", settings=settings, verify=[read(log)]).document
    assert document.verification.frequency == {}
    assert document.verification.records == {}
    assert "not_verified" in kinds(document)


def test_the_part_of_a_log_that_was_not_fitted_is_unseen(record: FlightRecord, log: Path) -> None:
    settings = IdentifySettings(band_rad_s=BAND, segments=(parse_segment("roll:3:53"),))
    document = identify([record], "rate.roll", settings=settings, verify=[read(log)]).document
    assert document.verification.frequency.keys() == {"p/roll_command"}
    assert kinds(document).isdisjoint({"not_verified", "poor_verification"})


def test_a_wrong_model_is_said_to_be_wrong_on_what_was_held_out(record: FlightRecord) -> None:
    # A lag of 0.2 s where there is none: wrong by far more than any noise.
    settings = IdentifySettings(band_rad_s=BAND, fix={"T_motor": 0.2, "L_p": -2.0})
    document = identify([record], "rate.roll", settings=settings).document
    assert {"poor_fit", "poor_verification"} <= kinds(document)
