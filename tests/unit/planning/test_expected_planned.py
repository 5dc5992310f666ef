"""How a plan will be cut into records."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.planning.plans import BAND, LOG_HZ, sweeps

from rotorid.data.flight_plan import FlightPlan, PlannedInput
from rotorid.data.record import FlightRecord, Source, Topic
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.excitation.plan import planned as make
from rotorid.planning.expected import as_planned
from rotorid.signal.excitations import find_excitations
from rotorid.spectral.windows import grid_rad_s
from rotorid.typing import Axis


def pulse(axis: Axis, start_s: float, *, stop_s: float | None = None) -> PlannedInput:
    samples = round(((stop_s or start_s + 1.0) - start_s) * 20.0)
    values = np.where(np.arange(samples) < samples // 2, 0.1, -0.1)
    return PlannedInput(axis=axis, shape="doublet", start_s=start_s, values=values, sample_rate_hz=20.0, amplitude=0.1)


def test_sweeps_that_touch_with_their_quiet_time_become_one_record() -> None:
    plan = sweeps({"roll": 0.1}, 30.0, count=2, rest_s=5.0)
    planned = as_planned(plan, ["roll"], LOG_HZ)
    # Half of 30 s is taken along, as far as the flight goes: 5 s before and behind, and all between.
    assert planned.spans == ((0, 7500),)
    np.testing.assert_allclose(planned.flight["roll_excitation"][600], plan.inputs[0].at(np.array([6.0]))[0])


def test_maneuvers_of_other_axes_are_barriers() -> None:
    plan = sweeps({"roll": 0.1, "pitch": 0.1}, 30.0, rest_s=5.0)
    assert as_planned(plan, ["roll"], LOG_HZ).spans == ((0, 4000),)
    assert as_planned(plan, ["pitch"], LOG_HZ).spans == ((3500, 7500),)


def test_what_is_logged_only_while_it_is_flown_has_no_quiet_time() -> None:
    plan = sweeps({"roll": 0.1}, 30.0, count=2, rest_s=5.0)
    assert as_planned(plan, ["roll"], LOG_HZ, alone=True).spans == ((500, 3500), (4000, 7000))
    outside = replace(plan, inputs=tuple(replace(one, entry="stick") for one in plan.inputs))
    assert as_planned(outside, ["roll"], LOG_HZ, alone=True).spans == ((0, 7500),)


def test_what_is_flown_at_once_stands_in_the_same_record() -> None:
    first = sweeps({"roll": 0.1}, 30.0).inputs[0]
    plan = FlightPlan(name="both", inputs=(first, pulse("yaw", 10.0), pulse("pitch", 60.0)), trim_s=5.0)
    planned = as_planned(plan, ["roll"], LOG_HZ)
    assert planned.axes == ("roll", "yaw")
    assert np.ptp(planned.records()[0]["yaw_excitation"]) > 0.0


def test_doublets_are_kept_unseen_beside_sweeps_and_fitted_alone() -> None:
    sweep = sweeps({"roll": 0.1}, 30.0).inputs[0]
    plan = FlightPlan(name="both", inputs=(sweep, pulse("roll", 60.0)))
    assert [one.kind for one in as_planned(plan, ["roll"], LOG_HZ).fitted] == ["sweep"]
    alone = FlightPlan(name="alone", inputs=(pulse("roll", 5.0), pulse("roll", 10.0)))
    assert len(as_planned(alone, ["roll"], LOG_HZ).fitted) == 2


def test_the_band_is_that_of_the_sweeps_and_the_grid_what_windows_support() -> None:
    planned = as_planned(sweeps({"roll": 0.1}, 60.0), ["roll"], LOG_HZ)
    assert planned.band_rad_s == pytest.approx(BAND)
    assert planned.excited_to_rad_s("roll") == pytest.approx(BAND[1])
    windows = planned.windows(planned.band_rad_s)
    grid = grid_rad_s(planned.band_rad_s, windows)
    assert grid[0] == pytest.approx(max(BAND[0], windows.lowest_rad_s))
    assert grid[-1] == pytest.approx(BAND[1])
    assert planned.windows(BAND, (8.0, 4.0)).lengths_s == (8.0, 4.0)


def test_a_sweep_from_outside_has_the_band_that_its_signal_shows() -> None:
    """Its fade and its quick first period hide its lowest frequency, and its last half waves the highest one."""
    plan = sweeps({"roll": 0.1}, 30.0)
    outside = replace(plan, inputs=tuple(replace(one, entry="attitude_setpoint") for one in plan.inputs))
    planned = as_planned(outside, ["roll"], LOG_HZ)
    record = FlightRecord(
        source=Source(name="log", format="log", sha256=""),
        topics=(
            Topic(
                name="log",
                time_s=planned.flight.time_s,
                channels=planned.flight.channels,
                values=planned.flight.values,
            ),
        ),
    )
    (found,) = find_excitations(record, "roll")
    assert planned.band_rad_s == found.band_rad_s
    assert planned.band_rad_s[0] > 1.1 * BAND[0]
    assert planned.excited_to_rad_s("roll") == planned.band_rad_s[1] < BAND[1]
    assert as_planned(outside, ["roll"], LOG_HZ, declared=["attitude_setpoint"]).band_rad_s == pytest.approx(BAND)


def test_multisines_end_and_random_signals_do_not() -> None:
    ends = {}
    for shape in ("multisine", "random_binary"):
        one = make(
            "roll",
            shape,
            start_s=3.0,
            amplitude=0.1,
            duration_s=40.0,
            sample_rate_hz=LOG_HZ,
            band_rad_s=(1.0, 30.0),
            entry="attitude_setpoint",
        )
        planned = as_planned(FlightPlan(name=shape, inputs=(one,)), ["roll"], LOG_HZ)
        assert planned.fitted[0].kind == shape
        assert planned.band_rad_s[1] == pytest.approx(0.25 * np.pi * LOG_HZ)
        ends[shape] = planned.excited_to_rad_s("roll")
    assert ends["multisine"] == pytest.approx(30.0, rel=0.01)
    assert ends["random_binary"] == np.inf


def test_steps_leave_the_band_to_the_log() -> None:
    alone = FlightPlan(name="alone", inputs=(pulse("roll", 5.0), pulse("roll", 10.0)))
    planned = as_planned(alone, ["roll"], LOG_HZ)
    assert planned.band_rad_s == pytest.approx((0.5, 0.25 * np.pi * LOG_HZ))
    assert planned.excited_to_rad_s("roll") == np.inf


def test_an_axis_without_test_inputs_is_refused() -> None:
    with pytest.raises(InsufficientDataError, match="yaw"):
        as_planned(sweeps({"roll": 0.1}, 30.0), ["roll", "yaw"], LOG_HZ)


def test_one_axis_has_one_entry() -> None:
    first = sweeps({"roll": 0.1}, 30.0).inputs[0]
    other = PlannedInput(
        axis="roll",
        shape="doublet",
        start_s=50.0,
        values=[0.1, -0.1],
        sample_rate_hz=2.0,
        amplitude=0.1,
        entry="rate_setpoint",
    )
    with pytest.raises(UsageError, match="one entry"):
        as_planned(FlightPlan(name="mixed", inputs=(first, other)), ["roll"], LOG_HZ)
