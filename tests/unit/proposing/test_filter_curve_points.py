"""Which sets of filters are tried, which points stay on the curve, and which one is recommended."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from rotorid.data.quantity import Quantity
from rotorid.loops.filter_choice import FilterSet
from rotorid.models.controller import RateController
from rotorid.proposing import new_gains
from rotorid.proposing.filter_curve import AxisPoint, FilterPoint, _numbered, _point, _spread, _undominated
from rotorid.tuning import AxisProposal, ControllerParts, Gains, Wishes, frequency_grid


def tried(*sets: tuple[float, float]) -> list[tuple[float, float]]:
    """Of sets by their cost in degrees and their noise, those that are tried with gains; the flown one is first."""
    made = [SimpleNamespace(cost_deg=cost, rms=rms, changes=()) for cost, rms in ((0.0, 1.0), *sets)]
    return [(one.cost_deg, one.rms) for one in _spread(cast("list[FilterSet]", made))][1:]


def test_a_set_that_costs_more_than_gains_can_give_back_is_not_tried() -> None:
    assert tried((3.0, 0.8), (11.9, 0.5), (12.1, 0.2)) == [(3.0, 0.8), (11.9, 0.5)]


def test_a_set_that_costs_more_has_to_be_quieter() -> None:
    assert tried((1.0, 0.8), (2.0, 0.79), (3.0, 0.77)) == [(1.0, 0.8), (3.0, 0.77)]


def test_of_many_sets_four_are_tried_from_loud_to_quiet() -> None:
    found = tried(*((cost, float(np.exp(-0.1 * cost))) for cost in np.linspace(1.0, 10.0, 19)))
    assert [cost for cost, _ in found] == [1.0, 4.0, 7.0, 10.0]


def exact(value: float, unit: str = "1") -> Quantity:
    return Quantity(value=value, std=0.0, lower=value, upper=value, unit=unit)


def point(noise: float, attitude: float, *, filters: bool = True) -> FilterPoint:
    axis = AxisPoint(
        judged=cast("Any", None), parameters={}, sensitivity_peak=exact(1.5), attitude_ratio=exact(attitude)
    )
    return FilterPoint(
        number=0,
        filters={"INS_GYRO_FILTER": (60.0, 90.0)} if filters else {},
        noise_limit=1.0,
        axes={"roll": axis},
        saves_percent=exact(100.0 * (1.0 - noise), "%"),
    )


KEPT = point(1.0, 1.0, filters=False)


def recommended(*points: FilterPoint) -> float | None:
    """Noise of the recommended point; ``None`` where the flown filters are to stay."""
    curve = _numbered([*points, KEPT], KEPT)
    return round(curve.point(curve.recommended).noise, 6) if curve.recommended else None


def test_new_filters_are_recommended_from_a_tenth_of_the_noise() -> None:
    assert recommended(point(0.91, 0.9)) is None
    assert recommended(point(0.89, 0.9)) == 0.89


def test_less_noise_is_not_bought_with_a_softer_attitude() -> None:
    assert recommended(point(0.5, 1.03)) is None
    assert recommended(point(0.5, 1.03), point(0.7, 1.01)) == 0.7


def test_a_point_that_another_one_beats_is_left_out_and_the_flown_filters_stay() -> None:
    points = [point(0.5, 1.2), point(0.6, 1.3), point(0.7, 1.199), point(0.8, 0.9), KEPT]
    found = _undominated(points, KEPT)
    assert [(round(one.noise, 6), one.attitude) for one in found] == [(0.5, pytest.approx(1.2)), (0.8, 0.9), (1.0, 1.0)]


def test_gains_of_a_point_hold_at_both_ends_of_d_or_there_is_no_point(monkeypatch: pytest.MonkeyPatch) -> None:
    controller = RateController(proportional_s=0.1, derivative_s2=0.001, step_s=1.0 / 400.0)
    omega = frequency_grid(controller)
    ones = np.ones(omega.size, dtype=np.complex128)
    parts = ControllerParts(controller=controller, omega_rad_s=omega, filters=ones, logged=ones)
    upper = replace(controller, derivative_s2=0.003)
    settings = SimpleNamespace(controller=controller, ends={"lower": controller, "upper": upper}, axis="roll")
    plant = SimpleNamespace(response=np.ones_like, drawn=np.ones_like)
    known = SimpleNamespace(
        controller=settings, parts=parts, flown_parts=parts, plant=plant, then=None, flown_plant=None
    )
    asked: dict[str, Any] = {}

    def none_holds(*_: object, **given: Any) -> AxisProposal:
        asked.update(given)
        scores = cast("Any", SimpleNamespace(gains=Gains.of(controller), attitude_rms=np.ones(1)))
        return AxisProposal(
            axis="roll", controller=controller, flown=scores, proposed=scores, better=1.0, keeps_limits=False
        )

    monkeypatch.setattr(new_gains, "propose", none_holds)
    monkeypatch.setattr(new_gains, "shares_angle", lambda _: False)
    nothing = cast("Any", None)
    given = cast("Any", {"roll": known})
    assert _point(nothing, nothing, given, nothing, nothing, 0.5, lambda _: Wishes(), np.zeros(1)) is None
    assert [end.controller.derivative_s2 for end in asked["ends"]] == [0.001, 0.003]
    assert asked["wishes"].noise == 0.5
