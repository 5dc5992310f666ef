"""Gains of axes: roll and pitch agree on a shared angle gain, in the proposal and in each point of the filter curve."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from tests.twins.filter_flights import SOURCES, fly
from tests.unit.loops.test_filter_choice import CRAFTS, LETTERS
from tests.unit.proposing.test_shared_filters import known

from rotorid.data.record import FlightRecord, Source
from rotorid.proposing import filter_curve as curves
from rotorid.proposing import new_gains as module
from rotorid.proposing.axis import KnownAxis
from rotorid.proposing.filter_curve import FilterCurve, filter_curve, with_point
from rotorid.proposing.new_gains import AxisGains, agreed_gains, axis_gains, wishes_of
from rotorid.proposing.settings import TuneSettings
from rotorid.tuning import Wishes
from rotorid.typing import Axis


def wishes(one: KnownAxis, noise: float = TuneSettings().noise) -> Wishes:
    return wishes_of(one.controller, TuneSettings(noise=noise))


BLACKBOX = FlightRecord(
    source=Source(name="flight.bbl", format="Betaflight blackbox", sha256="", firmware="Betaflight 4.4.2"),
    topics=(),
    parameters={
        **{f"{axis}PID_P": 60.0 for axis in ("roll", "pitch")},
        **{f"{axis}PID_I": 20.0 for axis in ("roll", "pitch")},
        **{f"{axis}PID_D": 40.0 for axis in ("roll", "pitch")},
        "levelPID_P": 50.0,
        "looptime": 1000.0,
    },
)


def two(late_s: float = 0.01) -> dict[Axis, KnownAxis]:
    """Roll, and a pitch whose plant is later."""
    late: dict[Axis, float] = {"roll": 0.0, "pitch": late_s}
    return {axis: known(axis, {}, record=BLACKBOX, late_s=delay_s) for axis, delay_s in late.items()}


def test_two_axes_fly_one_angle_gain() -> None:
    """The smaller of what they would have alone, and both have the other gains for it."""
    axes = two()
    alone = {axis: axis_gains(axis, one, wishes(one)) for axis, one in axes.items()}
    smaller = min(one.angle_1_s for one in alone.values())
    together, said = agreed_gains(axes, wishes)
    assert {one.angle_1_s for one in alone.values()} != {smaller}
    assert {one.angle_1_s for one in together.values()} == {smaller}
    assert [(one.kind, one.where) for one in said] == [("angle_shared", "angle_level_strength")]
    assert f"both get {10.0 * smaller:.0f}" in said[0].message
    roll = together["roll"].proposal.proposed
    assert np.quantile(roll.whole.sensitivity_peak, 0.9) <= 1.75
    assert roll.gains.P != alone["roll"].proposal.proposed.gains.P


def chosen(free: dict[Axis, float], *, refused: tuple[Axis, ...] = ()) -> tuple[dict[str, float], list[str]]:
    """Angle gains of axes that would have some of their own; refused ones find gains for no other than the flown."""

    def search(axis: Axis, one: KnownAxis, limits: Wishes, why: str = "") -> AxisGains:
        assert bool(why) == (len(free) == 1)
        given = free[axis] if limits.angle_1_s is None else limits.angle_1_s
        gains = replace(one.gains, A=one.gains.A if axis in refused and limits.angle_1_s is not None else given)
        return AxisGains(cast("Any", SimpleNamespace(proposed=SimpleNamespace(gains=gains))), limits)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(module, "_gains", search)
        found, said = agreed_gains({axis: one for axis, one in two().items() if axis in free}, wishes)
    return {axis: one.angle_1_s for axis, one in found.items()}, [one.message for one in said]


@pytest.mark.parametrize(
    ("free", "refused", "flown", "said"),
    [
        ({"roll": 3.0, "pitch": 4.0}, (), 3.0, "30 and 40; both get 30"),
        ({"roll": 4.0, "pitch": 5.0}, ("pitch",), 5.0, "40 and 50; both get 50"),
        ({"roll": 3.0, "pitch": 4.0}, ("pitch",), 5.0, "30 and 40; both get 50"),
        ({"pitch": 7.0}, (), 5.0, "not changed because only pitch was tuned"),
        ({"roll": 6.0, "pitch": 6.0}, (), 6.0, ""),
    ],
)
def test_which_angle_gain_both_fly(free: dict[Axis, float], refused: tuple[Axis, ...], flown: float, said: str) -> None:
    found, words = chosen(free, refused=refused)
    assert found == dict.fromkeys(free, flown)
    assert len(words) == bool(said)
    assert not said or said in words[0]


CUTOFFS = {"PX4": "IMU_DGYRO_CUTOFF", "ArduPilot": "INS_GYRO_FILTER", "Betaflight": "dterm_lpf1_static_hz"}


def curve_of(name: str, monkeypatch: pytest.MonkeyPatch) -> tuple[dict[Axis, KnownAxis], FilterCurve]:
    """The curve of a simulated flight with one set of other filters: roll and a later pitch."""
    record = fly(CRAFTS[name], seconds=15.0)
    letters = LETTERS.get(name, (0, 1))
    late: tuple[tuple[Axis, float], ...] = (("roll", 0.0), ("pitch", 0.006))
    axes = {
        axis: known(axis, {}, record=record, late_s=late_s, source=SOURCES[record.source.format].format(letter))
        for (axis, late_s), letter in zip(late, letters, strict=True)
    }
    other = {CUTOFFS[name]: 45.0}
    sets = [SimpleNamespace(values=values) for values in ({}, other)]
    monkeypatch.setattr(curves, "filter_sets", lambda *_: sets)
    monkeypatch.setattr(curves, "_spread", lambda given: given)
    monkeypatch.setattr(curves, "_undominated", lambda points, _: points)
    return axes, filter_curve(axes, wishes, {})


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name == "Betaflight" else pytest.mark.slow) for name in CRAFTS]
)
def test_a_point_of_the_curve_is_what_is_proposed_with_its_filters(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    axes, curve = curve_of(name, monkeypatch)
    assert curve.point(0).noise_limit == TuneSettings().noise
    assert any(point.filters for point in curve.points)
    for point in curve.points:
        then = with_point(axes, point, {}) if point.filters else axes
        found, _ = agreed_gains(then, partial(wishes, noise=point.noise_limit))
        for axis, one in point.axes.items():
            proposal = found[axis].proposal
            assert one.judged.gains == proposal.proposed.gains
            assert one.attitude_ratio.value == proposal.better
            assert one.judged.noise == proposal.proposed.noise
            np.testing.assert_array_equal(one.judged.whole.sensitivity_peak, proposal.proposed.whole.sensitivity_peak)
    if name == "Betaflight":
        assert curve.point(0).axes["roll"].judged.gains.A == curve.point(0).axes["pitch"].judged.gains.A
        assert curve.point(0).axes["roll"].judged.gains.A != axes["roll"].gains.A


def test_no_point_makes_more_noise_than_the_user_allows(monkeypatch: pytest.MonkeyPatch) -> None:
    record = fly(CRAFTS["ArduPilot"], seconds=15.0)
    axes = {"roll": known("roll", {}, record=record, source="RATE.R")}
    sets = [SimpleNamespace(values={})]
    monkeypatch.setattr(curves, "filter_sets", lambda *_: sets)
    monkeypatch.setattr(curves, "_spread", lambda given: given)
    found = filter_curve(cast("Any", axes), partial(wishes, noise=0.7), {})
    assert found.point(0).noise_limit == 0.7
    assert {point.noise_limit for point in found.points} <= {0.7, 0.5}
