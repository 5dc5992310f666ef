"""The trim of a vehicle that leans, by attitude where headings differ and by responses elsewhere."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from rotorid.fits.frequency import trim_choice
from rotorid.fits.frequency.trim_choice import Trim, best_trim
from rotorid.models.library import library_model
from rotorid.models.steady_wind import TURNING_DRAG, in_steady_wind
from rotorid.settings.identifying import IdentifySettings

CALM = library_model("hover.full")
TURNING = Trim(structure=CALM, flights=())
PLANE, BODY = (Trim(structure=in_steady_wind(CALM, 1.0, 0.5, heave_share=share), flights=()) for share in (0.0, 1.0))


def chosen(
    monkeypatch: pytest.MonkeyPatch,
    of_wind: bool | None,
    *costs: Mapping[str, float],
    windy: tuple[Trim, ...] = (PLANE,),
) -> Trim:
    trims = (TURNING, *windy)
    found = {id(trim): trim_choice._Fitted(cost) for trim, cost in zip(trims, costs, strict=True)}
    monkeypatch.setattr(trim_choice, "fixed_to_earth", lambda _: of_wind)
    monkeypatch.setattr(trim_choice, "_fitted", lambda trim, _: found[id(trim)])
    return best_trim(trims, IdentifySettings())


def test_headings_decide_before_costs(monkeypatch: pytest.MonkeyPatch) -> None:
    good, poor = {"p/yaw_command": 1.0}, {"p/yaw_command": 50.0}
    assert chosen(monkeypatch, False, poor, good) is TURNING
    assert chosen(monkeypatch, True, good, poor) is PLANE
    assert chosen(monkeypatch, None, good, poor) is TURNING
    assert chosen(monkeypatch, None, poor, good) is PLANE


def test_a_flight_that_one_trim_answers_is_answered(monkeypatch: pytest.MonkeyPatch) -> None:
    good, missed = {"p/yaw_command": 50.0}, dict[str, float]()
    assert chosen(monkeypatch, True, good, missed) is TURNING
    assert chosen(monkeypatch, None, missed, good) is PLANE


def test_heave_decides_where_drag_acts(monkeypatch: pytest.MonkeyPatch) -> None:
    costs = [{"az/thrust_command": cost, "p/yaw_command": 1.0} for cost in (9.0, 2.0, 5.0)]
    assert chosen(monkeypatch, True, *costs, windy=(PLANE, BODY)) is PLANE
    costs[1] = {**costs[1], "az/thrust_command": 4.0}
    assert chosen(monkeypatch, True, *costs, windy=(PLANE, BODY)) is BODY


def test_what_no_response_to_yaw_shows_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    costs = {"p/roll_command": 1.0, "r/yaw_command": 1.0}
    found = chosen(monkeypatch, True, costs, costs)
    assert found.structure.constants == in_steady_wind(CALM, 1.0, 0.5, turning=(0.0, 0.0)).constants
    assert [found.structure.constants[name] for name in (*TURNING_DRAG, "D_x")] == [0.0, 0.0, 1.0]
