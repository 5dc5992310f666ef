"""Rehearsals of a plan: logs of the simulator, and what an identification states of them."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from rotorid.data.flight_plan import FlightPlan
from rotorid.errors import InsufficientDataError, ModelError
from rotorid.excitation.plan import planned, sequence
from rotorid.fitting.frequency.problem import FrequencyProblem
from rotorid.flying import rehearsals
from rotorid.flying.rehearsals import Rehearsal, failed_rehearsals, rehearsed
from rotorid.flying.settings import DesignSettings, PlanSettings
from rotorid.models.library import rate_model
from rotorid.planning.prior import Prior

ROLL = rate_model("rate.roll")
CHOICES = DesignSettings(vehicle="px4_quad", kinds=("pilot_sweep",), plan=PlanSettings(axes=("roll",)))


def sweep() -> FlightPlan:
    one = planned(
        "roll",
        "pilot_sweep",
        start_s=2.0,
        amplitude=0.15,
        duration_s=15.0,
        sample_rate_hz=250.0,
        band_rad_s=(1.5, 40.0),
        entry="attitude_setpoint",
    )
    return sequence("a short sweep", [one])


def test_flights_of_a_plan_are_posed_as_an_identification_poses_them() -> None:
    logs = rehearsed(CHOICES, sweep())
    assert len(logs) == 3
    found = Rehearsal.of(CHOICES, ROLL, logs)
    assert (found.bounds, found.refused) == ((), None)
    assert len(found.errors.rehearsals) == 3
    for problem in found.errors.rehearsals:
        assert isinstance(problem, FrequencyProblem)
        assert problem.data.inputs == ("roll_command",)
        # The log shows how far the vehicle leaned, which is known only after it flew.
        assert problem.data.lean_errors is not None
        assert problem.data.lean_errors.max() > 0.0
    seeds = {float(abs(problem.data.values).sum()) for problem in found.errors.rehearsals}
    assert len(seeds) == 3


def test_a_plan_that_no_identification_supports_is_refused_with_its_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    def unfit(*_: object) -> Any:
        raise InsufficientDataError("too short")

    monkeypatch.setattr(rehearsals, "method_of", lambda *_: SimpleNamespace(prepare=unfit))
    record: Any = None
    assert str(Rehearsal.of(CHOICES, ROLL, [record, record]).refused) == "too short."
    # Without any flight nothing is refused: the linear loop answers.
    assert Rehearsal.of(CHOICES, ROLL, ()).refused is None


def test_rehearsals_that_fail_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    def lost(*_: object) -> Any:
        raise ModelError("upside down")

    monkeypatch.setattr(rehearsals, "fly_run", lost)
    logs = rehearsed(CHOICES, sweep())
    assert logs == ()
    (all_lost,) = failed_rehearsals("pilot_sweep", len(logs), {"rate.roll": Rehearsal.of(CHOICES, ROLL, logs)})
    assert (all_lost.kind, all_lost.severity, all_lost.numbers["failed"]) == ("rehearsal_failed", "warning", 3.0)
    (one_lost,) = failed_rehearsals("pilot_sweep", 2, {})
    assert one_lost.numbers == {"failed": 1.0, "flights": 3.0}
    assert failed_rehearsals("pilot_sweep", 3, {"rate.roll": Rehearsal()}) == []


def test_two_of_three_refused_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    answers = iter([InsufficientDataError("too short"), None, InsufficientDataError("too calm")])

    def prepare(*_: object) -> Any:
        if (error := next(answers)) is not None:
            raise error
        return SimpleNamespace(screened=SimpleNamespace(problem=None))

    monkeypatch.setattr(rehearsals, "method_of", lambda *_: SimpleNamespace(prepare=prepare))
    record: Any = None
    found = Rehearsal.of(CHOICES, ROLL, [record] * 3)
    assert found.refused is None
    (remark,) = failed_rehearsals("pilot_sweep", 3, {"rate.roll": found})
    assert (remark.kind, remark.severity, remark.where) == ("rehearsal_failed", "info", "rate.roll")
    assert "2 of 3" in remark.message
    assert "too calm" in remark.message
    assert failed_rehearsals("pilot_sweep", 3, {"rate.roll": Rehearsal(refused=InsufficientDataError("no"))}) == []


def test_an_earlier_result_gives_the_least_model_error() -> None:
    prior = Prior(structure=ROLL, values={}, source="before", model_error={"p/roll_command": 0.04})
    known = Rehearsal.of(replace(CHOICES, prior=prior), ROLL, ())
    assert known.errors.sizes == {"p/roll_command": 0.04}
