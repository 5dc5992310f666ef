"""Which fit of a flight is taken where the curve of outputs is none of a rotor."""

from __future__ import annotations

from typing import Any, cast

import pytest

from rotorid.errors import InsufficientDataError, ModelError
from rotorid.fits.flight import fit
from rotorid.fitting.flight.fit import FlightChoices
from rotorid.fitting.flight.ladder import LINE
from rotorid.flights.flight_data import FlightMotion


class _Nothing:
    findings = ()


def test_a_curve_that_lifts_nothing_gives_way_to_a_square(monkeypatch: pytest.MonkeyPatch) -> None:
    def bounded(_: object, choices: FlightChoices) -> object:
        if choices.terms is None or "c_1" in choices.terms:
            raise ModelError("the rotors of these values cannot carry the weight")
        return "of a square"

    monkeypatch.setattr(fit, "_bounded", bounded)
    assert cast(Any, fit._fitted(cast(FlightMotion, _Nothing()), FlightChoices())) == "of a square"


def test_demands_give_way_to_the_line_that_the_autopilot_states(monkeypatch: pytest.MonkeyPatch) -> None:
    def bounded(_: object, choices: FlightChoices) -> object:
        if not LINE.items() <= choices.values.items():
            raise ModelError("the rotors of these values cannot carry the weight")
        return "of a line"

    monkeypatch.setattr(fit, "_bounded", bounded)
    monkeypatch.setattr(fit, "_rises", lambda *_: True)
    assert cast(Any, fit._fitted(cast(FlightMotion, _Nothing()), FlightChoices(straight=True))) == "of a line"


def test_rotors_that_lift_nothing_at_all_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def bounded(*_: object) -> object:
        raise ModelError("the rotors of these values cannot carry the weight")

    monkeypatch.setattr(fit, "_bounded", bounded)
    with pytest.raises(InsufficientDataError, match="carry the weight") as refused:
        fit._fitted(cast(FlightMotion, _Nothing()), FlightChoices())
    assert [finding.kind for finding in refused.value.findings] == ["impossible_physics"]
