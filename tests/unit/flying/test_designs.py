"""Plans from wishes: order, sizes, entries, and the limits that the whole plan keeps."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rotorid.errors import UsageError
from rotorid.flying import designs
from rotorid.flying.designs import default_entry, equal_axes, plan_for, plan_with, sweep_of
from rotorid.flying.rehearsals import Rehearsal
from rotorid.flying.settings import PlanSettings
from rotorid.flying.simulation import truth_of
from rotorid.models.library import library_model, rate_model
from rotorid.planning.amplitude import Limits, reached, usual_reached
from rotorid.plans.ardupilot import system_id
from rotorid.simulation.multirotor_flight import changed, fly_multirotor, piloted
from rotorid.simulation.wind import Wind
from rotorid.vehicles.catalog import aircraft

SIZES = {"roll": 0.1, "pitch": 0.1, "yaw": 0.1, "thrust": 0.1}
SHORT = PlanSettings(shape="pilot_sweep", axes=("roll", "pitch"), band_rad_s=(2.0, 30.0), duration_s=15.0)


def test_inputs_follow_each_other_with_doublets_of_both_signs_at_the_end() -> None:
    plan = plan_with(
        aircraft("px4_quad"), replace(SHORT, repeats=2, doublets=True), SIZES, doublets={"roll": 0.2, "pitch": 0.3}
    )
    assert [(one.axis, one.shape, one.amplitude) for one in plan.inputs] == [
        ("roll", "pilot_sweep", 0.1),
        ("roll", "pilot_sweep", 0.1),
        ("pitch", "pilot_sweep", 0.1),
        ("pitch", "pilot_sweep", 0.1),
        ("roll", "doublet", 0.2),
        ("roll", "doublet", -0.2),
        ("pitch", "doublet", 0.3),
        ("pitch", "doublet", -0.3),
    ]
    starts, stops = [one.start_s for one in plan.inputs], [one.stop_s for one in plan.inputs]
    assert np.all(np.subtract(starts[1:], stops[:-1]) >= 3.9)
    # Repeated sweeps carry other noise, so that the two add information.
    assert not np.array_equal(plan.inputs[0].values, plan.inputs[1].values)


def test_an_autopilot_gets_inputs_where_it_can_take_them() -> None:
    px4, ardupilot = aircraft("px4_quad"), aircraft("ardupilot_quad")
    assert [default_entry(px4, axis) for axis in ("roll", "thrust")] == ["attitude_setpoint", "command"]
    assert default_entry(ardupilot, "roll") == "command"
    assert {default_entry(aircraft("betaflight_quad"), axis) for axis in ("roll", "thrust")} == {"stick"}
    assert (sweep_of(px4), sweep_of(ardupilot)) == ("pilot_sweep", "logarithmic_sweep")


def test_a_chirp_begins_with_two_slow_cycles_as_ardupilots() -> None:
    plan = plan_with(aircraft("ardupilot_quad"), replace(SHORT, shape="logarithmic_sweep", axes=("roll",)), SIZES)
    assert plan.inputs[0].settings["constant_s"] == pytest.approx(2.0 * 2.0 * math.pi / 2.0)
    assert plan.inputs[0].stop_s - plan.inputs[0].start_s == pytest.approx(15.0 + 2.0 * math.pi, abs=0.01)


def test_the_whole_plan_stays_within_the_limits_and_uses_them() -> None:
    craft = piloted(aircraft("px4_quad"))
    limits = Limits(tilt_rad=math.radians(15.0))
    found = plan_for(craft, replace(SHORT, shape="multisine", axes=("roll", "pitch"), duration_s=20.0, limits=limits))
    assert found.reached.beyond(limits) == ()
    flights = [reached(fly_multirotor(craft, found.plan, seed=seed)) for seed in range(4)]
    assert found.reached == usual_reached(flights)
    # Both axes tilt at the same time, so that each alone would stay far from the limit.
    assert found.reached.tilt_rad > 0.7 * limits.tilt_rad
    assert {found.limited_by(one) for one in found.plan.inputs} == {"tilt_rad"}


def test_roll_and_pitch_share_an_amplitude_where_they_are_alike() -> None:
    quad = aircraft("px4_quad")
    assert equal_axes(quad, ("yaw", "roll", "pitch")) == (("roll", "pitch"), ("yaw",))
    assert equal_axes(changed(quad, {"I_yy": 0.03}), ("roll", "pitch")) == (("roll",), ("pitch",))
    assert equal_axes(quad, ("pitch", "yaw")) == (("pitch",), ("yaw",))


def test_equal_axes_get_one_amplitude_that_no_single_draw_of_gusts_decides() -> None:
    craft = piloted(aircraft("ardupilot_quad"))
    gusty = replace(
        SHORT,
        shape="logarithmic_sweep",
        band_rad_s=(2.0, 50.0),
        duration_s=10.0,
        wind=Wind(north_m_s=3.3, turbulence_m_s=1.0),
    )
    sizes, kept = [], 0
    for seed in (0, 100, 200):
        found = plan_for(craft, replace(gusty, seed=seed))
        roll, pitch = (one.amplitude for one in found.plan.inputs)
        assert roll == pitch
        assert found.reached.beyond(gusty.limits) == ()
        smallest, largest = found.amplitudes["logarithmic_sweep of roll"].spread
        # One flight alone would plan anything between these.
        assert largest > 1.3 * smallest
        sizes.append(roll)
        flights = [fly_multirotor(craft, found.plan, wind=gusty.wind, seed=seed + 50 + number) for number in range(8)]
        kept += sum(reached(flight).beyond(gusty.limits) == () for flight in flights)
    assert max(sizes) < 1.2 * min(sizes)
    # Three of four keep the limits in the draws that were looked at, and a tenth was taken off.
    assert kept >= 18


def test_amplitudes_that_are_given_are_flown_as_they_are() -> None:
    found = plan_for(piloted(aircraft("px4_quad")), replace(SHORT, axes=("roll",), amplitudes={"roll": 0.05}))
    assert [one.amplitude for one in found.plan.inputs] == [0.05]
    assert found.limited_by(found.plan.inputs[0]) == ""


def test_a_multisine_of_axes_with_other_entries_names_the_remedy() -> None:
    with pytest.raises(UsageError, match="leave thrust out"):
        plan_with(aircraft("px4_quad"), replace(SHORT, shape="multisine", axes=("roll", "thrust")), SIZES)


def test_steps_last_as_many_units_as_they_have() -> None:
    assert [replace(SHORT, shape=shape, duration_s=None).length_s for shape in ("doublet", "three_two_one_one")] == [
        pytest.approx(0.6),
        pytest.approx(2.1),
    ]


def test_no_axes_is_no_plan() -> None:
    with pytest.raises(UsageError, match="not a list of axes"):
        replace(SHORT, axes=())


@pytest.mark.parametrize("band_rad_s", [(0.6, 50.0), (3.0, 30.0), (1.7, 90.0), (2.0, 200.0)])
@pytest.mark.parametrize("duration_s", [15.0, 20.0, 61.3])
def test_ardupilots_chirp_makes_the_samples_of_every_plan(band_rad_s: tuple[float, float], duration_s: float) -> None:
    """A length that is no whole number of samples cost a plan its files: 1 % of the amplitude at the end."""
    wish = replace(SHORT, shape="logarithmic_sweep", axes=("roll",), band_rad_s=band_rad_s, duration_s=duration_s)
    (sweep,) = plan_with(aircraft("ardupilot_quad"), wish, SIZES).inputs
    settings = system_id(sweep)
    time_s = np.arange(sweep.values.size) / sweep.sample_rate_hz
    # Phases of thousands of radians in double precision.
    assert settings.waveform(time_s) == pytest.approx(sweep.values, abs=1e-9)


def test_a_model_whose_prediction_fails_leaves_the_plan_and_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise KeyError("noise")

    monkeypatch.delenv("ROTORID_STRICT", raising=False)
    monkeypatch.setattr(designs, "expected_values", broken)
    choices: Any = SimpleNamespace(prior=None)
    unused: Any = None
    foretold = designs._predict_plan(choices, unused, unused, rate_model("rate.roll"), unused, Rehearsal())
    assert foretold.prediction is None
    assert "KeyError" in foretold.refused


@pytest.mark.parametrize("name", ["axis.roll", "axis.pitch", "axis.yaw", "axis.vertical"])
def test_models_of_an_axis_are_known_as_those_of_hover(name: str) -> None:
    craft = aircraft("px4_quad")
    place = (0.0, 0.0, -0.03)
    high = replace(craft, sensors=replace(craft.sensors, accelerometer_place_m=place))
    found = designs.expected_values(library_model(name), high)
    truth = truth_of(high)
    assert all(found[key] == pytest.approx(truth[key].value) for key in found if key in truth and key != "T_motor")
    if "z_imu" in found:
        # Above the center of gravity, where the axis points down.
        assert found["z_imu"] == pytest.approx(0.03)
        assert found["tau_ax" if name == "axis.pitch" else "tau_ay"] >= 0.0
