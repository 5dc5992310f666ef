"""Rehearsals of a plan: logs of the simulator, and what an identification states of them."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from rotorid.data.flight_plan import FlightPlan
from rotorid.errors import InsufficientDataError
from rotorid.excitation.plan import planned, sequence
from rotorid.fitting.frequency.problem import FrequencyProblem
from rotorid.flying import rehearsals
from rotorid.flying.rehearsals import Rehearsal, rehearsed
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


def test_an_earlier_result_gives_the_least_model_error() -> None:
    prior = Prior(structure=ROLL, values={}, source="before", model_error={"p/roll_command": 0.04})
    known = Rehearsal.of(replace(CHOICES, prior=prior), ROLL, ())
    assert known.errors.sizes == {"p/roll_command": 0.04}
