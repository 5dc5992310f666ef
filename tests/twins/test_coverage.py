"""Intervals of 95 % on flights of the library's vehicles: how many hold, and how wide they are.

Each flight goes the way of a user's log, and every model that it supports is identified. True is the exact
linearization in hover, with what a flight makes of it:

- thrust of rotors whose thrust is quadratic in what is commanded has the slope at the mean command, and the mean
  command of a sweep that holds the height is lower than that of hover,
- drag and speed derivatives of ArduPilot's vehicle have no slope at rest (quadratic drag), couplings of zero are none
  in steady wind, and rate models leave out what turns the S500: these are not judged,
- filters of the autopilot add to delays, which are not judged here.
"""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from tests.twins.motor_twins import VEHICLES, twin

import rotorid
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.pipeline.flight_settings import SimulateChoices
from rotorid.pipeline.simulation import truth_of

MODELS = (
    *(f"rate.{axis}" for axis in ("roll", "pitch", "yaw", "vertical")),
    *(f"axis.{axis}" for axis in ("roll", "pitch", "yaw")),
    "hover.lateral",
    "hover.longitudinal",
)
SEEDS = (1, 11, 21)
SLOPES_OF_SPEED = ("L_p", "M_q", "N_r", "X_u", "Y_v", "Z_w", "M_u", "L_v")
QUADRATIC = ("crazyflie", "hummingbird")


class Judged(NamedTuple):
    """A parameter of one flight: its distance from the truth, and its stated standard deviation."""

    vehicle: str
    family: str
    name: str
    error: float
    std: float


def flown_truth(vehicle: str, record: FlightRecord) -> dict[str, float]:
    """Slopes as the sweeps of a flight show them."""
    craft = SimulateChoices(vehicle=vehicle).aircraft
    truth = {name: true.value for name, true in truth_of(craft).items()}
    if vehicle in QUADRATIC:
        thrust = record["thrust_command"]
        sweep = rotorid.find_excitations(record, "thrust")[0]
        inside = (thrust.time_s >= sweep.start_s) & (thrust.time_s <= sweep.stop_s)
        before = (thrust.time_s >= sweep.start_s - 2.0) & (thrust.time_s < sweep.start_s)
        truth["Z_thrust"] *= float(np.mean(thrust.values[inside]) / np.mean(thrust.values[before]))
    return truth


def judged(vehicle: str, weather: str, record: FlightRecord, model: str) -> list[Judged]:
    truth = flown_truth(vehicle, record)
    found = rotorid.identify(record, model)
    family = model.partition(".")[0]
    if (vehicle, family) == ("s500", "rate"):
        return []
    rows = []
    for name, parameter in found.parameters.items():
        known = parameter.status == "free" and parameter.std and name in truth and not name.startswith("tau_")
        still = vehicle == "ardupilot_quad" and name in SLOPES_OF_SPEED
        if known and not still and not (weather == "wind" and truth[name] == 0.0):
            rows.append(Judged(vehicle, family, name, parameter.value - truth[name], float(parameter.std or 0.0)))
    return rows


@pytest.mark.slow
def test_intervals_hold_on_flights_of_all_vehicles(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows: list[Judged] = []
    flown, refused = 0, []
    for vehicle in VEHICLES:
        for weather in ("calm", "wind"):
            for seed in SEEDS:
                record = twin(vehicle, weather, seed, tmp_path).record
                for model in MODELS:
                    flown += 1
                    try:
                        rows += judged(vehicle, weather, record, model)
                    except InsufficientDataError as error:
                        refused.append(f"{vehicle} {weather} {seed} {model}: {error}")
    pooled: dict[tuple[str, str], list[Judged]] = defaultdict(list)
    for row in rows:
        pooled[row.vehicle, row.family].append(row)
    table, wrong = [], []
    for (vehicle, family), group in sorted(pooled.items()):
        ratio = np.array([row.error / row.std for row in group])
        held, size = float(np.mean(np.abs(ratio) <= 1.96)), float(np.sqrt(np.mean(ratio**2)))
        table.append(f"{vehicle:15s} {family:6s} {len(group):4d} {100.0 * held:5.1f} % {size:5.2f}")
        if held < 0.9 or size > 1.2:
            wrong.append(table[-1])
    with capsys.disabled():
        print(
            "\nvehicle         model     n  hold    rms  width", *table, f"refused {len(refused)} of {flown}", sep="\n"
        )
        print(*refused, sep="\n")
    assert len(refused) <= 0.1 * flown
    assert not wrong
