"""Flights with the sticks of a pilot in wind that turns the vehicle, and a payload, a propeller or gusts that come."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np

from rotorid.data.flight_plan import FlightPlan, PlannedInput, SimulatedFlight
from rotorid.data.record import Channel, FlightRecord, Source, Status, Topic
from rotorid.excitation.sticks import everyday_stick
from rotorid.simulation.multirotor_flight import Aircraft, changed, fly_multirotor, piloted
from rotorid.simulation.wind import Wind
from rotorid.typing import FloatArray
from rotorid.vehicles.catalog import aircraft
from rotorid.verification.tracking import RATE_HZ

LATERAL_1_S2 = -2.0
"""Roll acceleration per m/s of wind from the side (L_v), which the stock vehicle has not."""


@cache
def craft(name: str = "px4_quad") -> Aircraft:
    stock = aircraft(name)
    air = np.array(stock.vehicle.aerodynamics)
    air[3, 1] = LATERAL_1_S2 * stock.vehicle.inertia_kg_m2[0, 0]
    return piloted(replace(stock, vehicle=replace(stock.vehicle, aerodynamics=air)))


def sticks(duration_s: float, level: float, *, seed: int, rate_hz: float, throttle: float = 0.0) -> FlightPlan:
    levels = {"roll": level, "pitch": level, **({"thrust": throttle} if throttle else {})}
    inputs = [
        PlannedInput(
            axis=axis,  # type: ignore[arg-type]
            shape="sticks",
            start_s=0.0,
            values=everyday_stick(
                level=size, duration_s=duration_s, sample_rate_hz=rate_hz, rng=np.random.default_rng([seed, place])
            ),
            sample_rate_hz=rate_hz,
            amplitude=size,
            entry="stick",
        )
        for place, (axis, size) in enumerate(levels.items())
    ]
    return FlightPlan(name="sticks", inputs=tuple(inputs), trim_s=0.0)


def fly(
    duration_s: float,
    *,
    level: float,
    wind: Wind,
    seed: int,
    changes: Mapping[str, float] | None = None,
    throttle: float = 0.0,
    name: str = "px4_quad",
    flying: Aircraft | None = None,
) -> SimulatedFlight:
    flying = changed(flying or craft(name), changes or {})
    plan = sticks(duration_s, level, seed=seed, rate_hz=flying.autopilot.rate_hz, throttle=throttle)
    return fly_multirotor(flying, plan, wind=wind, seed=seed)


def payload(share: float = 0.15, name: str = "px4_quad") -> dict[str, float]:
    """Inertia that a payload adds."""
    inertia = craft(name).vehicle.inertia_kg_m2
    return {"I_xx": (1.0 + share) * float(inertia[0, 0]), "I_yy": (1.0 + share) * float(inertia[1, 1])}


def columns(flight: SimulatedFlight) -> dict[str, FloatArray]:
    """What is followed, at the rate of the tracker: means over its steps."""
    stride = round(flight.sample_rate_hz / RATE_HZ)
    names = ("roll_command", "p", "roll_stick", "thrust_command")
    count = flight.samples // stride * stride
    return {name: np.asarray(flight.columns[name][:count]).reshape(-1, stride).mean(axis=1) for name in names}


def joined(*parts: dict[str, FloatArray]) -> dict[str, FloatArray]:
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def prediction(command: FloatArray, *, gain: float, damping: float, lag_s: float, delay_s: float) -> FloatArray:
    """Roll rate of the model, whose numbers are known."""
    count = 2 * command.size
    omega = np.maximum(2.0 * np.pi * np.fft.rfftfreq(count, 1.0 / RATE_HZ), 1e-6)
    response = gain * np.exp(-1j * omega * delay_s) / ((1j * omega * lag_s + 1.0) * (1j * omega - damping))
    return np.fft.irfft(np.fft.rfft(command, count) * response, count)[: command.size]


def record_of(columns: dict[str, FloatArray], *, rate_hz: float = RATE_HZ) -> FlightRecord:
    """A log of what is followed."""
    time_s = np.arange(columns["p"].size) / rate_hz
    units = {"p": "rad/s"}
    topic = Topic(
        name="loops",
        time_s=time_s,
        channels=tuple(Channel(name=name, unit=units.get(name, "1")) for name in columns),
        values=np.stack(list(columns.values())),
    )
    whole = ((0.0, float(time_s[-1])),)
    status = Status(vehicle="multirotor", armed=whole, in_air=whole, flagged_in="twin")
    return FlightRecord(
        source=Source(name="twin", format="twin", sha256=""),
        topics=(topic,),
        status=status,
        instruments={"roll": ("roll_stick",)},
    )


def with_weak_rotor(share: float, name: str = "px4_quad") -> Aircraft:
    """One propeller with less thrust."""
    flying = craft(name)
    effect = np.array(flying.vehicle.wrench)
    effect[:, 0] *= 1.0 - share
    return replace(flying, vehicle=replace(flying.vehicle, effectiveness=effect))


def with_quadratic_thrust() -> Aircraft:
    """Thrust that grows with the square of the command, and nothing that straightens it."""
    stock = craft()
    rotors = stock.vehicle.rotors
    curved = replace(
        stock, vehicle=replace(stock.vehicle, rotors=replace(rotors, thrust=(0.0, 0.0, sum(rotors.thrust))))
    )
    # Any change makes the autopilot look for its hover anew.
    return changed(curved, {"thrust": 1.0})
