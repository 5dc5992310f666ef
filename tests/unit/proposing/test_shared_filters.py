"""What axes share: a filter of the gyro reaches axes that keep their gains, and Betaflight has one angle gain."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from rotorid.data.record import FlightRecord, Source
from rotorid.errors import InsufficientDataError
from rotorid.flights.controllers import controllers_of
from rotorid.models.autopilots import axis_controller
from rotorid.proposing import proposal
from rotorid.proposing.axis import KnownAxis
from rotorid.proposing.filters import with_filters
from rotorid.proposing.flown_gains import LoggedLoop
from rotorid.proposing.settings import TuneSettings
from rotorid.proposing.shared_filters import require_filters_hold
from rotorid.tuning import Gains, Wishes, frequency_grid, uncertain_plant
from rotorid.typing import Axis, ComplexArray, FloatArray

PARAMETERS = {
    "MC_ROLLRATE_P": 0.15,
    "MC_ROLLRATE_I": 0.2,
    "MC_ROLLRATE_D": 0.003,
    "MC_ROLL_P": 4.0,
    "MC_PITCHRATE_P": 0.15,
    "MC_PITCHRATE_I": 0.2,
    "MC_PITCHRATE_D": 0.003,
    "MC_PITCH_P": 4.0,
    "IMU_DGYRO_CUTOFF": 30.0,
    "IMU_GYRO_CUTOFF": 40.0,
    "IMU_GYRO_RATEMAX": 400.0,
}
LOG = FlightRecord(
    source=Source(name="flight.ulg", format="PX4 ULog", sha256="", firmware="PX4 1.16.0"),
    topics=(),
    parameters=PARAMETERS,
)
SLOW, FAST, OF_D = {"IMU_GYRO_CUTOFF": 5.0}, {"IMU_GYRO_CUTOFF": 60.0}, {"IMU_DGYRO_CUTOFF": 29.0}


def vehicle(w: FloatArray) -> ComplexArray:
    return np.asarray(113.1 / ((0.048j * w + 1.0) * (1j * w + 1.0)) * np.exp(-0.008j * w))


def known(axis: Axis, filters: dict[str, float], *, record: FlightRecord = LOG, late_s: float = 0.0) -> KnownAxis:
    """An axis of the log, as if it had been identified."""
    controller = axis_controller(record.parameters, axis, firmware=record.source.firmware)
    assert controller is not None
    flown = LoggedLoop(
        axis=axis,
        controller=controller,
        record=record,
        source="vehicle_angular_velocity.xyz[0]",
        known=controllers_of(record),
    )
    then = with_filters(record, filters) if filters else None
    omega = frequency_grid(controller.controller)

    def plant(w: FloatArray) -> ComplexArray:
        return np.asarray(vehicle(w) * np.exp(-1j * late_s * w))

    return KnownAxis(
        flown=flown,
        plant=uncertain_plant(plant, None, band_rad_s=(1.0, 100.0), draws=20),
        omega_rad_s=omega,
        flown_parts=flown.parts(omega),
        then=then,
        controller=controller if then is None else flown.with_parameters(then),
        parts=flown.parts(omega, then=then),
    )


def held(filters: dict[str, float], *, staying: tuple[Axis, ...] = (), others: tuple[Axis, ...] = ()) -> list[str]:
    found = require_filters_hold(
        {axis: known(axis, filters) for axis in staying},
        dict.fromkeys(others),
        (),
        (LOG,),
        filters=filters,
        wishes=Wishes(),
        draws=20,
        seed=0,
    )
    return [f"{one.kind} {one.where}" for one in found]


def test_a_filter_that_breaks_an_axis_that_stays_is_refused() -> None:
    with pytest.raises(
        InsufficientDataError, match=r"With IMU_GYRO_CUTOFF = 5 and the flown gains of pitch, M_s .* exceeds"
    ):
        held(SLOW, staying=("pitch",))
    assert held(FAST, staying=("pitch",)) == []


def test_a_loop_that_was_broken_before_may_get_no_worse() -> None:
    """Hot gains are no reason against a filter that does not make them hotter."""
    hot = {**PARAMETERS, "MC_PITCHRATE_P": 0.45, "MC_PITCHRATE_I": 0.6}
    record = replace(LOG, parameters=hot)
    look = {"wishes": Wishes(), "draws": 20, "seed": 0}
    for filters, refused in ((FAST, False), ({"IMU_GYRO_CUTOFF": 25.0}, True)):
        one = {"pitch": known("pitch", filters, record=record)}
        if refused:
            with pytest.raises(InsufficientDataError, match=r"gains of pitch, M_s .* exceeds"):
                require_filters_hold(one, {}, (), (record,), filters=filters, **look)  # type: ignore[arg-type]
        else:
            assert require_filters_hold(one, {}, (), (record,), filters=filters, **look) == []  # type: ignore[arg-type]


def test_axes_that_cannot_be_judged_are_named() -> None:
    """No model of pitch, no gains of yaw; a filter of D that yaw does not have does not reach it."""
    assert held(FAST, others=("pitch", "yaw")) == ["filter_not_judged pitch", "filter_not_judged yaw"]
    assert held(OF_D, others=("pitch", "yaw")) == ["filter_not_judged pitch"]


@pytest.mark.parametrize("filters", [SLOW, FAST], ids=["refused", "held"])
def test_an_axis_that_was_not_asked_for_is_judged(filters: dict[str, float], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rotorid.proposing.shared_filters.known_axis", lambda axis, *_, **__: known(axis, filters))
    if filters is SLOW:
        with pytest.raises(InsufficientDataError, match=r"gains of pitch, M_s .* exceeds"):
            held(filters, others=("pitch",))
    else:
        assert held(filters, others=("pitch",)) == []


def test_gains_that_stay_are_shown_with_the_new_filter() -> None:
    """And the filter of the gyro stands among the parameters of every axis."""
    one = known("roll", SLOW)
    found = proposal._axis("roll", one, TuneSettings(axes=("roll",), filters=SLOW, keep=("P", "I", "A")), None)
    assert found.proposal.proposed.gains == found.proposal.flown.gains == Gains.of(one.flown.controller.controller)
    peaks = [np.median(x.whole.sensitivity_peak) for x in (found.proposal.flown, found.proposal.proposed)]
    assert peaks[1] > 1.2 * peaks[0]
    assert found.parameters["IMU_GYRO_CUTOFF"] == (40.0, 5.0)
    assert not np.allclose(found.loops["flown"], found.loops["proposed"])
    assert not np.allclose(found.steps["flown"], found.steps["proposed"])


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
    alone = {axis: proposal._axis(axis, one, TuneSettings(), None) for axis, one in axes.items()}
    smaller = min(one.proposal.proposed.gains.A for one in alone.values())
    together, said = proposal._axes(axes, TuneSettings(), None)
    assert {one.proposal.proposed.gains.A for one in alone.values()} != {smaller}
    assert {one.proposal.proposed.gains.A for one in together.values()} == {smaller}
    assert [(one.kind, one.where) for one in said] == [("angle_shared", "angle_level_strength")]
    assert f"both get {10.0 * smaller:.0f}" in said[0].message
    roll = together["roll"].proposal.proposed
    assert np.quantile(roll.whole.sensitivity_peak, 0.9) <= 1.75
    assert roll.gains.P != alone["roll"].proposal.proposed.gains.P


def chosen(free: dict[Axis, float], *, refused: tuple[Axis, ...] = ()) -> tuple[dict[str, float], list[str]]:
    """Angle gains of axes that would have some of their own; refused ones find gains for no other than the flown."""

    def axis_of(
        axis: Axis, one: KnownAxis, *_: object, angle_1_s: float | None = None, held: str = ""
    ) -> SimpleNamespace:
        assert bool(held) == (len(free) == 1)
        given = free[axis] if angle_1_s is None else angle_1_s
        gains = replace(one.gains, A=one.gains.A if axis in refused and angle_1_s is not None else given)
        return SimpleNamespace(proposal=SimpleNamespace(proposed=SimpleNamespace(gains=gains)))

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(proposal, "_axis", axis_of)
        found, said = proposal._axes({axis: one for axis, one in two().items() if axis in free}, TuneSettings(), None)
    return {axis: one.proposal.proposed.gains.A for axis, one in found.items()}, [one.message for one in said]


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
