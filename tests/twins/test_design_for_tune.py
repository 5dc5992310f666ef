"""A flight of `design --for-tune` shows the plant as far as `tune` needs it: through a real format, with its gains."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rotorid.errors import InsufficientDataError, UsageError
from rotorid.flying.designs import plan_with
from rotorid.flying.settings import DesignSettings, PlanSettings
from rotorid.io.registry import read, write_log
from rotorid.models.autopilots.reading import axis_controller
from rotorid.models.autopilots.settings import described
from rotorid.plans.ardupilot import system_id
from rotorid.proposing.bands import designed_for_tune
from rotorid.proposing.proposal import tune
from rotorid.results.summary import ControllerSettings
from rotorid.simulation.multirotor_flight import Aircraft, fly_multirotor
from rotorid.simulation.wind import Wind
from rotorid.vehicles.px4 import with_gains

GUSTY = Wind(north_m_s=3.0, turbulence_m_s=0.5)
SOFT = {
    f"ATC_{name}": value
    for axis in ("RLL", "PIT")
    for name, value in (
        (f"RAT_{axis}_P", 0.0675),
        (f"RAT_{axis}_I", 0.0675),
        (f"RAT_{axis}_D", 0.0018),
        (f"ANG_{axis}_P", 3.0),
    )
}
"""Those of a real flight, in which `tune` asked for sweeps up to 98 rad/s after the usual ones up to 50."""


def logged(craft: Aircraft, choices: DesignSettings, path: Path) -> Path:
    """The log of the plan that is designed, flown in gusts of another draw."""
    plan = plan_with(craft, choices.plan, {"roll": 0.05, "pitch": 0.05})
    write_log(path, fly_multirotor(craft, plan, wind=GUSTY, seed=77), format="bin")
    return path


def bands_asked_for(path: Path) -> dict[str, float]:
    found = tune(records=read(path), axes=("roll", "pitch")).findings
    return {one.where: one.numbers["needed_rad_s"] for one in found if one.kind == "band_below_crossover"}


@pytest.mark.slow
@pytest.mark.parametrize(("gains", "needed_rad_s"), [(SOFT, 115.0), ({}, 120.0)], ids=["soft", "stock"])
def test_tune_asks_for_no_wider_band_after_the_flight_that_was_designed_for_it(
    gains: Mapping[str, float], needed_rad_s: float, tmp_path: Path
) -> None:
    plan = PlanSettings(shape="logarithmic_sweep", axes=("roll", "pitch"), duration_s=40.0, band_rad_s=(0.6, 30.0))
    usual = DesignSettings(vehicle="ardupilot_quad", kinds=("logarithmic_sweep",), plan=replace(plan, wind=GUSTY))
    craft = usual.aircraft
    if gains:
        craft = with_gains(craft, {**craft.autopilot.parameters, **gains}, source="the gains")
    first = logged(craft, usual, tmp_path / "usual.BIN")
    asked = bands_asked_for(first)
    # Stock gains cross over at 135 rad/s, and three times that is beyond any use.
    assert asked
    assert max(asked.values()) < 180.0
    designed = designed_for_tune(usual, record=read(first))
    # Each axis has the band of its own plant, as the flight shows it; axes that are flown together the widest.
    (_, roll), (_, pitch) = designed.plan.band_of("roll"), designed.plan.band_of("pitch")
    assert roll == pytest.approx(pitch, rel=0.05)
    assert designed.plan.band_rad_s[1] == max(roll, pitch)
    assert designed.plan.band_rad_s == (2.0, pytest.approx(needed_rad_s, rel=0.15))
    flown, planned = (one.autopilot.rates.proportional for one in (craft, designed.aircraft))
    assert planned == pytest.approx(flown)
    assert bands_asked_for(logged(craft, designed, tmp_path / "wide.BIN")) == {}


def test_each_axis_has_the_band_of_its_own_loop(tmp_path: Path) -> None:
    plan = PlanSettings(shape="logarithmic_sweep", axes=("roll", "yaw"), duration_s=20.0, wind=GUSTY)
    choices = DesignSettings(vehicle="ardupilot_quad", kinds=("logarithmic_sweep",), plan=plan)
    hover = tmp_path / "hover.BIN"
    write_log(hover, fly_multirotor(choices.aircraft, duration_s=20.0, seed=5), format="bin")
    choices_for_tune = designed_for_tune(choices, record=read(hover))
    assert "tuning_bound" not in {one.kind for one in choices_for_tune.remarks}
    designed = choices_for_tune.plan
    (_, yaw), (_, roll) = designed.band_of("yaw"), designed.band_of("roll")
    assert designed.band_rad_s[1] == roll
    assert yaw < 0.3 * roll
    sweeps = plan_with(choices.aircraft, designed, {"roll": 0.05, "yaw": 0.1}).inputs
    assert [one.band_rad_s for one in sweeps] == [(2.0, roll), (2.0, yaw)]
    # The firmware's own chirp is the planned one, at its fast end too.
    stops_hz = [system_id(one).stop_hz for one in sweeps]
    assert stops_hz == pytest.approx([roll / (2.0 * np.pi), yaw / (2.0 * np.pi)])


def test_an_axis_without_better_gains_has_the_band_of_the_flown_ones(tmp_path: Path) -> None:
    plan = PlanSettings(shape="logarithmic_sweep", axes=("yaw",), duration_s=20.0, wind=GUSTY)
    choices = DesignSettings(vehicle="ardupilot_quad", kinds=("logarithmic_sweep",), plan=plan)
    own = choices.aircraft.autopilot.parameters
    # So soft that no gains within the range of tune keep its limits.
    soft = {name: 0.1 * own[name] for name in ("ATC_RAT_YAW_P", "ATC_RAT_YAW_I")}
    flown = with_gains(choices.aircraft, {**own, **soft}, source="the gains")
    hover = tmp_path / "hover.BIN"
    write_log(hover, fly_multirotor(flown, duration_s=20.0, seed=5), format="bin")
    designed = designed_for_tune(choices, record=read(hover))
    (bound,) = (one for one in designed.remarks if one.kind == "tuning_bound")
    assert bound.where == "yaw"
    _, yaw = designed.plan.band_of("yaw")
    assert bound.numbers["flown_crossover_rad_s"] < yaw < 10.0


def test_set_points_that_are_sent_end_where_a_period_has_ten_of_them(tmp_path: Path) -> None:
    plan = PlanSettings(axes=("roll",), wind=GUSTY)
    choices = DesignSettings(vehicle="px4_quad", kinds=("pilot_sweep",), plan=plan)
    hover = tmp_path / "hover.ulg"
    write_log(hover, fly_multirotor(choices.aircraft, duration_s=20.0, seed=5), format="ulg")
    designed = designed_for_tune(choices, record=read(hover))
    assert designed.plan.band_rad_s == (2.0, 62.0)
    # What tune asks for is more, and that is not hidden.
    short = {one.where: one.numbers for one in designed.remarks if one.kind == "band_below_crossover"}
    assert short["roll"]["planned_to_rad_s"] == 62.0 < short["roll"]["needed_rad_s"]
    inside = replace(choices, plan=replace(plan, entry="command"))
    designed = designed_for_tune(inside, record=read(hover))
    assert designed.plan.band_rad_s[1] > 62.0
    assert "band_below_crossover" not in {one.kind for one in designed.remarks}


def test_the_firmware_of_a_result_is_that_of_the_plan() -> None:
    choices = DesignSettings(vehicle="ardupilot_quad", kinds=("logarithmic_sweep",), plan=PlanSettings(axes=("roll",)))
    flew = axis_controller(choices.aircraft.autopilot.parameters, "roll", firmware="ArduCopter V4.6.2")
    assert flew is not None
    known = ControllerSettings(**described([flew]), settings={"INS_GYRO_FILTER": 47.0})
    model: Any = SimpleNamespace(name="rate.pitch", controller=known, motors=None, rate_axes=("pitch",))
    designed = designed_for_tune(choices, models=(model,))
    assert designed.firmware == "ArduCopter V4.6.2"
    # The filter of the gyro is no part of the controller, and of its loop all the same.
    assert designed.aircraft.autopilot.gyro_cutoff_hz == 47.0 != choices.aircraft.autopilot.gyro_cutoff_hz


def test_what_has_no_gains_is_refused() -> None:
    with pytest.raises(InsufficientDataError, match="contains no gains"):
        designed_for_tune(DesignSettings(vehicle="px4_quad", kinds=("pilot_sweep",), plan=PlanSettings(axes=("roll",))))
    with pytest.raises(UsageError, match="a vehicle with known gains"):
        designed_for_tune(
            DesignSettings(vehicle="px4_quad", kinds=("pilot_sweep",), plan=PlanSettings(axes=("thrust",)))
        )
