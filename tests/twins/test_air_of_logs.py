"""Wind and noise that a simulated flight met, back out of its log, and into the plan of the next one."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from rotorid.data.flight_plan import FlightPlan
from rotorid.excitation.plan import planned
from rotorid.flying.flight_air import flown_as, logged_air
from rotorid.flying.settings import DesignSettings, PlanSettings, SimulateSettings
from rotorid.flying.simulation import fly_run, write_run
from rotorid.io.registry import read
from rotorid.simulation.wind import Wind

BLOWS = Wind(north_m_s=4.0, east_m_s=-2.0, turbulence_m_s=0.8)

SWEPT = FlightPlan(
    name="swept",
    inputs=(
        planned(
            "roll",
            "logarithmic_sweep",
            start_s=60.0,
            amplitude=0.05,
            duration_s=20.0,
            sample_rate_hz=250.0,
            band_rad_s=(2.0, 50.0),
            entry="command",
        ),
    ),
)
"""Test inputs are no noise of the gyroscopes."""


def log_of(vehicle: str, wind: Wind, folder: Path) -> Path:
    choices = SimulateSettings(vehicle=vehicle, plan=SWEPT, duration_s=90.0, wind=wind, seed=3)
    path = folder / choices.file_names[0]
    write_run(path, fly_run(choices, 0), choices)
    return path


@pytest.mark.parametrize("vehicle", ["px4_quad", "ardupilot_quad"])
def test_wind_and_noise_come_back_out_of_a_log(vehicle: str, tmp_path: Path) -> None:
    craft = SimulateSettings(vehicle=vehicle, duration_s=90.0).aircraft
    air = logged_air(read(log_of(vehicle, BLOWS, tmp_path)), craft)
    assert air.wind is not None
    # Gusts of 0.8 m/s that last for 15 s leave the mean of 90 s open by some 0.8 / sqrt(90 / 30) m/s.
    assert math.hypot(air.wind.north_m_s - 4.0, air.wind.east_m_s + 2.0) < 1.0
    assert 0.3 < air.wind.turbulence_m_s < 1.1
    assert air.gyro_noise_rad_s == pytest.approx(craft.sensors.gyro_noise_rad_s, rel=0.15)


def test_a_plan_has_the_air_of_the_log_and_a_wind_that_was_given_stays(tmp_path: Path) -> None:
    record = read(log_of("px4_quad", BLOWS, tmp_path))
    choices = DesignSettings(vehicle="px4_quad", kinds=("pilot_sweep",), plan=PlanSettings(axes=("roll",)))
    noisier = replace(choices, gyro_noise_rad_s=0.5)
    found = flown_as(noisier, record)
    assert found.plan.wind.speed_m_s == pytest.approx(4.5, abs=1.2)
    assert found.aircraft.sensors.gyro_noise_rad_s == pytest.approx(0.066, rel=0.15)
    assert [one.kind for one in found.remarks] == ["air_of_log"]
    given = replace(choices, plan=replace(choices.plan, wind=Wind(turbulence_m_s=2.0)))
    assert flown_as(given, record).plan.wind == Wind(turbulence_m_s=2.0)
