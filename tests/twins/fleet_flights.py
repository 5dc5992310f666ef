"""Logs of a simulated fleet with known changes: vehicles that differ a little, flown again and again in wind."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rotorid import Wind, write_log
from rotorid.flying.designs import plan_with
from rotorid.flying.settings import PlanSettings
from rotorid.simulation.multirotor_flight import Sortie, changed, fly_batch
from rotorid.vehicles.catalog import aircraft

VEHICLE = "px4_quad"
SPREAD = {"I_xx": 0.02, "I_yy": 0.02, "thrust": 0.02, "T_motor": 0.03}
"""Standard deviation between vehicles, as a share."""


@dataclass(frozen=True, kw_only=True)
class Event:
    """What happens to one vehicle: from a flight on, these numbers are multiplied; lag in seconds is added."""

    vehicle: int
    flight: int
    factors: Mapping[str, float]
    lag_s: float = 0.0


def plan() -> Any:
    craft = aircraft(VEHICLE)
    choices = PlanSettings(
        shape="pilot_sweep",
        axes=("roll", "pitch", "thrust"),
        band_rad_s=(0.6, 50.0),
        duration_s=20.0,
        entry="stick",
        doublets=False,
    )
    return plan_with(craft, choices, {"roll": 0.6, "pitch": 0.6, "thrust": 0.5}, doublets={}, name="fleet")


def values_of(vehicle: int, flight: int, events: tuple[Event, ...], *, seed: int) -> dict[str, float]:
    """Numbers of a vehicle at one of its flights, counted from 1."""
    craft = aircraft(VEHICLE).vehicle
    rng = np.random.default_rng([seed, vehicle])
    drawn = {name: 1.0 + std * rng.standard_normal() for name, std in SPREAD.items()}
    lag_s = craft.rotors.lag_up_s * drawn["T_motor"]
    values = {
        "I_xx": float(craft.inertia_kg_m2[0, 0]) * drawn["I_xx"],
        "I_yy": float(craft.inertia_kg_m2[1, 1]) * drawn["I_yy"],
        "thrust": drawn["thrust"],
    }
    for event in events:
        if event.vehicle == vehicle and flight >= event.flight:
            for name, factor in event.factors.items():
                values[name] *= factor
            lag_s += event.lag_s
    return {**values, "T_motor": lag_s}


def write_fleet(
    folder: Path, *, vehicles: int, flights: int, events: tuple[Event, ...] = (), seed: int = 0, workers: int = 2
) -> None:
    """A log for each flight, ``FOLDER/VEHICLE/FLIGHT.ulg``; vehicles and flights are counted from 1."""
    flown = plan()
    numbers = [(vehicle, flight) for vehicle in range(1, vehicles + 1) for flight in range(1, flights + 1)]
    rng = np.random.default_rng([seed, 999])
    winds = [
        Wind(north_m_s=float(x), east_m_s=float(y), turbulence_m_s=float(t))
        for x, y, t in zip(
            rng.normal(0.0, 1.5, len(numbers)),
            rng.normal(0.0, 1.5, len(numbers)),
            rng.uniform(0.0, 0.8, len(numbers)),
            strict=True,
        )
    ]

    def sorties() -> Iterator[Sortie]:
        for (vehicle, flight), wind in zip(numbers, winds, strict=True):
            craft = changed(aircraft(VEHICLE), values_of(vehicle, flight, events, seed=seed))
            yield Sortie(aircraft=craft, plan=flown, wind=wind, seed=seed * 1_000_000 + vehicle * 1000 + flight)

    for (vehicle, flight), outcome in zip(numbers, fly_batch(sorties(), lambda one: one, workers=workers), strict=True):
        if outcome.error is not None:
            raise outcome.error
        place = folder / f"quad-{vehicle:02d}"
        place.mkdir(parents=True, exist_ok=True)
        write_log(place / f"flight-{vehicle:02d}-{flight:03d}.ulg", outcome.result, format="ulg")
