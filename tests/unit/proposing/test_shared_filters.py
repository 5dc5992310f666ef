"""A filter of the gyro reaches axes that keep their gains too."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.record import FlightRecord, Source
from rotorid.errors import InsufficientDataError
from rotorid.flights.controllers import controllers_of
from rotorid.models.autopilots import axis_controller
from rotorid.proposing.axis import KnownAxis
from rotorid.proposing.axis_tuning import axis_tuning
from rotorid.proposing.filters import with_filters
from rotorid.proposing.flown_gains import LoggedLoop
from rotorid.proposing.new_gains import axis_gains
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


def known(
    axis: Axis,
    filters: dict[str, float],
    *,
    record: FlightRecord = LOG,
    late_s: float = 0.0,
    source: str = "vehicle_angular_velocity.xyz[0]",
) -> KnownAxis:
    """An axis of the log, as if it had been identified."""
    controller = axis_controller(record.parameters, axis, firmware=record.source.firmware)
    assert controller is not None
    flown = LoggedLoop(
        axis=axis,
        controller=controller,
        record=record,
        source=source,
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
    gains = axis_gains("roll", one, Wishes(keep=("P", "I", "A")))
    found = axis_tuning("roll", one, gains, SLOW)
    assert found.proposal.proposed.gains == found.proposal.flown.gains == Gains.of(one.flown.controller.controller)
    peaks = [np.median(x.whole.sensitivity_peak) for x in (found.proposal.flown, found.proposal.proposed)]
    assert peaks[1] > 1.2 * peaks[0]
    assert found.parameters["IMU_GYRO_CUTOFF"] == (40.0, 5.0)
    assert not np.allclose(found.loops["flown"], found.loops["proposed"])
    assert not np.allclose(found.steps["flown"], found.steps["proposed"])
