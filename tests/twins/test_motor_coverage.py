"""Intervals of physical.motors on flights of vehicles that are not of its structure, calm and in wind."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from tests.twins.motor_twins import VEHICLES, Twin, truth_of, twin

from rotorid.errors import RotoridError
from rotorid.pipeline.flight_settings import SimulateChoices
from rotorid.pipeline.identification import identify_motors

TWO_SIDED = 1.96
SEEDS = (11, 12, 13)
REPORTED_APART = {("ardupilot_quad", "Z_w")}
"""Drag that grows with the square of the speed: the slope at rest is not what flew."""


class Judged(NamedTuple):
    """A value of a flight: its error, and what was stated, as shares of the stated deviation."""

    vehicle: str
    parameter: str
    error: float
    stated: float


def judged(one: Twin, vehicle: str) -> Iterator[Judged]:
    model = identify_motors([one.record], one.choices)
    assert model.motors is not None
    for name, truth in one.truth.items():
        found = model.parameters.get(name) or model.motors.derived.get(name)
        if found is not None and found.std and (vehicle, name) not in REPORTED_APART:
            yield Judged(vehicle, name, found.value - truth, found.std)


def test_truth_of_a_vehicle_is_what_it_is_made_of() -> None:
    """Slopes by linearization give the inertia that the simulation has."""
    craft = SimulateChoices(vehicle="x500").aircraft
    found, inertia = truth_of(craft), np.diag(craft.vehicle.inertia_kg_m2)
    assert found["I_xx"] == pytest.approx(inertia[0], rel=1e-6)
    assert found["I_yy"] == pytest.approx(inertia[1], rel=1e-6)
    assert found["kappa_per_I_zz"] == pytest.approx(craft.vehicle.rotors.torque_per_thrust_m / inertia[2], rel=1e-6)


@pytest.mark.slow
def test_intervals_hold_what_flew(tmp_path: Path) -> None:
    """42 flights of seven vehicles: pooled, by vehicle, and by parameter."""
    found: list[Judged] = []
    refused: list[str] = []
    flights = [(vehicle, weather, seed) for vehicle in VEHICLES for weather in ("calm", "wind") for seed in SEEDS]
    for vehicle, weather, seed in flights:
        try:
            found += judged(twin(vehicle, weather, seed, tmp_path), vehicle)
        except RotoridError as error:
            refused.append(f"{vehicle} {weather} {seed}: {error}")
    for line in _table(found):
        print(line)
    print(*refused, sep="\n")
    share = {vehicle: _held([one for one in found if one.vehicle == vehicle]) for vehicle in VEHICLES}
    assert all(held >= 0.9 for held in share.values()), share
    ratios = np.array([one.error / one.stated for one in found])
    assert 0.9 <= _held(found) <= 0.999
    assert np.sqrt(np.mean(np.clip(ratios, -10.0, 10.0) ** 2)) <= 1.2
    assert len(refused) <= 0.1 * len(flights), refused


def _held(values: list[Judged]) -> float:
    return float(np.mean([abs(one.error) <= TWO_SIDED * one.stated for one in values]))


def _table(found: list[Judged]) -> Iterator[str]:
    """Of every parameter: how many, how many hold, root mean square of error by stated, and stated by error."""
    groups: dict[str, list[Judged]] = defaultdict(list)
    for one in found:
        groups[one.parameter].append(one)
        groups[one.vehicle].append(one)
    for name, values in groups.items():
        rms = np.sqrt(np.mean([min(abs(one.error / one.stated), 10.0) ** 2 for one in values]))
        wide = np.median([one.stated for one in values]) / np.sqrt(np.mean([one.error**2 for one in values]))
        held = 100.0 * _held(values)
        yield f"{name:16s} {len(values):4d} {held:5.1f} % held, error/stated {rms:.2f}, stated/error {wide:.1f}"
