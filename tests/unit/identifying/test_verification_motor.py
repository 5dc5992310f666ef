"""Results of ``physical.motors`` on logs that they have not seen: ``verify`` and ``compare``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from tests.unit.identifying.motor_logs import ARM_M, flight, with_speeds

from rotorid.data.record import FlightRecord
from rotorid.documents.result import load, save
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.identifying.comparison import compare
from rotorid.identifying.identification import identify_motors
from rotorid.identifying.verification import verify
from rotorid.io.registry import read
from rotorid.results.model import IdentifiedModel
from rotorid.settings.motors import MotorSettings
from rotorid.vehicles.motor_flight import TRUTH

CHOICES = MotorSettings(known={"m": TRUTH["m"]}, layout="quad.x", arm_m=ARM_M, method="accelerations")


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> FlightRecord:
    return read(flight(tmp_path_factory.mktemp("flown") / "flight.csv"))


@pytest.fixture(scope="module")
def model(log: FlightRecord) -> IdentifiedModel:
    return identify_motors([log], CHOICES)


def unseen(log: FlightRecord) -> FlightRecord:
    return replace(log, source=replace(log.source, name="other.csv", sha256="0" * 64))


def test_a_result_predicts_a_log_alone_as_within_its_identification(
    model: IdentifiedModel, log: FlightRecord, tmp_path: Path
) -> None:
    save(model, tmp_path)
    within = identify_motors([log], CHOICES, verify=[unseen(log)])
    (expected,) = within.verification.records.values()
    for judged in (model, tmp_path, load(tmp_path)):
        found = verify(judged, [unseen(log)])
        (one,) = found.maneuvers
        assert set(one.scores) == set(expected)
        for name, score in one.scores.items():
            assert score.tic == pytest.approx(expected[name].tic, rel=1e-6), name


def test_what_was_fitted_is_said(model: IdentifiedModel, log: FlightRecord) -> None:
    assert "seen_data" in {finding.kind for finding in verify(model, [log]).findings}


def test_what_cannot_judge_a_fit_is_said_and_refuses_nothing(log: FlightRecord, tmp_path: Path) -> None:
    speeds = read(with_speeds(tmp_path / "speeds.csv"))
    bare = [replace(one, channels=one.channels[:1], values=one.values[:1]) for one in log.topics]
    nothing = replace(unseen(log), topics=tuple(bare))
    found = identify_motors([log], CHOICES, verify=[log, speeds, nothing, unseen(log)])
    said = {(finding.where, finding.kind): finding.message for finding in found.findings}
    assert ("flight.csv", "seen_data") in said
    assert "logs motors as speed" in said["speeds.csv", "not_verified"]
    assert ("other.csv", "not_verified") in said
    assert {one.record for one in found.verifications.maneuvers} == {"other.csv"}


def test_results_are_scored_side_by_side(model: IdentifiedModel, log: FlightRecord) -> None:
    worse = replace(
        model, parameters={**model.parameters, "I_xx": replace(model["I_xx"], value=3.0 * model["I_xx"].value)}
    )
    found = compare([model, worse], [unseen(log)])
    assert set(found.common_outputs) >= {"p_dot", "q_dot"}
    first, second = (found.on_logs[entry.label].mean_percent for entry in found.entries)
    assert first > second


def test_options_of_responses_do_not_go_with_motors(model: IdentifiedModel, log: FlightRecord) -> None:
    with pytest.raises(UsageError, match="--band does not apply to a result of physical"):
        verify(model, [log], band_rad_s=(1.0, 10.0))


def test_a_log_without_motors_judges_nothing(model: IdentifiedModel, log: FlightRecord) -> None:
    bare = [replace(one, channels=one.channels[:1], values=one.values[:1]) for one in log.topics]
    with pytest.raises(InsufficientDataError, match="was not judged"):
        verify(model, [replace(unseen(log), topics=tuple(bare))])
