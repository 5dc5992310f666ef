"""Filters with gains, proposed from a flight in the simulator and flown there: noise and margins are as predicted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.twins.test_tuned_loops import FIGURES, NAMES, fly, values

import rotorid
from rotorid.data.axes import RATE_OF
from rotorid.flights.filter_effects import command_powers, filtered_density, saved
from rotorid.flights.gyro_noise import gyro_noise
from rotorid.proposing import TuningProposal, tune
from rotorid.simulation.multirotor_flight import Aircraft
from rotorid.typing import FloatArray
from rotorid.vehicles.catalog import aircraft
from rotorid.vehicles.px4 import with_gains

SHAKES_RAD_S = 0.3
ROTORS_RAD_S = 700.0


def shaking(craft: Aircraft) -> Aircraft:
    """The vehicle with rotors that shake its gyro, one cycle a turn."""
    sensors = replace(craft.sensors, gyro_vibration_rad_s=SHAKES_RAD_S, rotor_speed_rad_s=ROTORS_RAD_S)
    return replace(craft, sensors=sensors)


def roll_powers(log: rotorid.FlightRecord, found: TuningProposal) -> FloatArray:
    """Mean square of the roll command by noise, in each part of a flight, with what flew."""
    noise = gyro_noise(log)
    controller = found.axes["roll"].controller.controller
    return command_powers(controller, noise, filtered_density(log, log, noise)[RATE_OF["roll"]])


@pytest.mark.slow
def test_low_passes_that_were_proposed_fly_as_predicted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # The simulator filters at the rate of its loop, a vehicle at that of its sensor; no log says which.
    monkeypatch.setattr("rotorid.autopilots.px4.filters._SENSOR_HZ", aircraft("px4_quad").autopilot.rate_hz)
    craft = shaking(aircraft("px4_quad"))
    log = rotorid.read(fly(craft, tmp_path, seed=3))
    first = tune(records=log, axes=("roll",), filter_choice="1")
    assert first.curve is not None
    point = first.curve.point(1)
    assert point.filters
    new = {name: after for name, (_, after) in first.axes["roll"].parameters.items()}
    gains = with_gains(craft, {name: new[name] for name in NAMES["px4"]}, source="the proposal")
    own = gains.autopilot
    cutoff_hz = new["IMU_DGYRO_CUTOFF"]
    flown = replace(
        own,
        gyro_cutoff_hz=new["IMU_GYRO_CUTOFF"],
        rates=replace(own.rates, derivative_cutoff_hz=(cutoff_hz,) * 3),
        parameters={**own.parameters, "IMU_GYRO_CUTOFF": new["IMU_GYRO_CUTOFF"], "IMU_DGYRO_CUTOFF": cutoff_hz},
    )
    again = rotorid.read(fly(shaking(replace(gains, autopilot=flown)), tmp_path, seed=4))
    second = tune(records=again, axes=("roll",))
    for loop in ("rate", "whole"):
        for figure in FIGURES:
            expected, measured = values(first, "proposed", loop, figure), values(second, "flown", loop, figure)
            low, high = np.quantile(expected, (0.025, 0.975))
            slack = 2.0 * float(np.std(measured))
            assert low - slack <= np.median(measured) <= high + slack, (loop, figure)
    measured_saving = saved(roll_powers(log, first), roll_powers(again, second))
    assert point.saves_percent.lower - 2.0 * measured_saving.std <= measured_saving.value
    assert measured_saving.value <= point.saves_percent.upper + 2.0 * measured_saving.std
