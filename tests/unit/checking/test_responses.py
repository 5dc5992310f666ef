"""Responses to set-points on unseen records: what counts, what fails, and what is estimated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.checking.response_flight import flight

from rotorid.checking.responses import estimated_shifts
from rotorid.data.record import FlightRecord
from rotorid.documents.result import result_document
from rotorid.errors import ModelError
from rotorid.fitting.time.output_error import Fitted, TimeData, TimeProblem
from rotorid.identifying.identification import identify
from rotorid.models.library import response_model
from rotorid.results.model import IdentifiedModel
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.parsing import parse_segment
from rotorid.simulation.linear import simulate_linear
from rotorid.typing import FloatArray

FIRST = response_model("response.first_order", [("phi_setpoint", "phi")])
SAMPLES = 800


def identified(
    *verify: FlightRecord, records: tuple[FlightRecord, ...] = (), segment: str | None = None
) -> IdentifiedModel:
    settings = IdentifySettings(segments=(parse_segment(segment),) if segment else ())
    return identify(records or [flight(samples=SAMPLES)], FIRST, settings=settings, verify=verify)


def kinds(found: IdentifiedModel) -> list[str]:
    return [one.kind for one in result_document(found).findings if one.kind in ("not_verified", "seen_data")]


def test_the_log_that_was_fitted_does_not_verify() -> None:
    found = identified(flight(samples=SAMPLES))
    assert found.verifications.maneuvers == ()
    assert result_document(found).verification.records == {}
    assert kinds(found) == ["seen_data"]


def test_a_log_that_was_fitted_in_part_does_not_verify_under_another_name() -> None:
    again = flight(samples=SAMPLES)
    renamed = replace(again, source=replace(again.source, name="copy.csv"))
    found = identified(renamed, segment="roll:4:12")
    assert found.verifications.maneuvers == ()
    assert kinds(found) == ["seen_data"]


def test_an_unseen_log_beside_a_seen_one_counts_alone() -> None:
    found = identified(flight(samples=SAMPLES), flight(seed=7, samples=SAMPLES))
    assert [one.record for one in found.verifications.maneuvers] == ["flight7.csv"]
    assert kinds(found) == ["seen_data"]


def test_a_log_in_which_nothing_moves_says_why_it_does_not_verify() -> None:
    (topic,) = (record := flight(seed=7, samples=SAMPLES)).topics
    still = replace(topic, values=np.stack([np.full(SAMPLES, 0.1), topic.values[1]]))
    found = identified(replace(record, topics=(still,)))
    assert found.verifications.maneuvers == ()
    (finding,) = [one for one in result_document(found).findings if one.kind == "not_verified"]
    assert finding.message == "flight7.csv could not verify the model: phi_setpoint does not move in flight7.csv."


def test_a_model_that_diverges_over_an_unseen_log_stays_identified(monkeypatch: pytest.MonkeyPatch) -> None:
    unseen = flight(seed=7, samples=SAMPLES)
    predicted = TimeProblem.predicted

    def diverging(self: TimeProblem, theta: FloatArray) -> tuple[Fitted, ...]:
        if self.records[0].name == unseen.source.name:
            raise ModelError("the model diverges over a record")
        return predicted(self, theta)

    monkeypatch.setattr(TimeProblem, "predicted", diverging)
    found = identified(unseen)
    assert result_document(found).parameters["K_phi"].value > 0.5
    (finding,) = [one for one in result_document(found).findings if one.kind == "not_verified"]
    assert "diverges over a record" in finding.message


def test_the_shift_that_was_estimated_is_reported() -> None:
    (topic,) = (record := flight(seed=7, samples=SAMPLES)).topics
    shifted = replace(topic, values=topic.values + np.array([[0.0], [0.3]]))
    (before,), (after,) = (
        identified(one).verifications.maneuvers for one in (record, replace(record, topics=(shifted,)))
    )
    assert after.scores["phi"].nrmse_fit_percent == pytest.approx(before.scores["phi"].nrmse_fit_percent, abs=1e-6)
    added = after.scores["phi"].reference_shift - before.scores["phi"].reference_shift
    assert added == pytest.approx(0.3, abs=1e-9)


@pytest.mark.parametrize("start", [0.0, 0.2])
def test_shifts_are_told_from_initial_states(start: float) -> None:
    u = np.repeat(np.random.default_rng(1).choice([-0.1, 0.1], 20), 10)[None]
    values = FIRST.parameters.with_values({"K_phi": 0.9, "T_phi": 0.4})
    system = FIRST.matrices(values.values)
    y = simulate_linear(system, u, sample_rate_hz=20.0, x0=np.array([start]), before=u[:, 0]) + 0.07
    data = TimeData(name="r", inputs=u, outputs=y, sample_rate_hz=20.0)
    problem = TimeProblem(structure=FIRST, parameters=values, records=(data,), hold="zero")
    (shift,) = estimated_shifts(problem, problem.predicted(values.pack()))
    assert shift == pytest.approx([0.07], abs=1e-9)
    bare = replace(problem, unknowns=("initial_state",))
    (none,) = estimated_shifts(bare, bare.predicted(values.pack()))
    assert none == pytest.approx([0.0], abs=0.0)
