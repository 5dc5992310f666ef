"""Flights as a card asks for them, with the pilot who flies them: trims and corrections, doublets by hand, a landing.

A sweep of roll and one of pitch, then doublets by hand on whatever the wind needs as trim, then the sticks are let go
and the vehicle stands on the ground. The stick is what the pilot asks of the attitude, at 10 Hz in steps of 1/500: it
contains the feedback by which he keeps the place. Records are lost one by one or in rows, from every topic by itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np

from rotorid.data.flight_plan import FlightPlan, PlannedInput, SimulatedFlight
from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Maneuver, Source, Status, Topic
from rotorid.excitation.plan import planned
from rotorid.flying.simulation import truth_of
from rotorid.simulation.multirotor_flight import Aircraft, fly_multirotor, piloted
from rotorid.simulation.wind import CALM, Wind
from rotorid.typing import Axis, BoolArray, FloatArray
from rotorid.vehicles.catalog import aircraft

SWEPT: tuple[Axis, ...] = ("roll", "pitch")
GAIN = {"roll": "L_roll", "pitch": "M_pitch"}
BAND_RAD_S = (0.6, 50.0)
HOVER_S, SWEEP_S, REST_S, DOUBLET_S, LANDED_S = 10.0, 80.0, 4.0, 4.5, 20.0
PULSE_S, PULSE_RAD = 0.3, 0.3
FULL_STICK_RAD = 0.6
LOG_HZ, STICK_HZ, STEPS_OF_STICK = 200.0, 10.0, 500.0

ENTRIES = {"ardupilot_quad": ("command", 0.03), "px4_quad": ("attitude_setpoint", 0.12)}
"""Where the program of each adds its sweep, and how large it is."""

FIRMWARE = {"ardupilot_quad": "ArduCopter V4.5.0", "px4_quad": "PX4 v1.14.0"}
WINDS_M_S = (0.0, 2.0, 4.0, 6.0)
LOST = (0.05, 0.1, 0.2, 0.3)
ROWS_LOST = (1.0, 4.0)


@dataclass(frozen=True, kw_only=True)
class Card:
    """One flight of the study."""

    vehicle: str
    wind_m_s: float
    lost: float
    row: float
    seed: int

    @property
    def wind(self) -> Wind:
        return Wind(north_m_s=0.7 * self.wind_m_s, east_m_s=0.7 * self.wind_m_s, turbulence_m_s=0.2 * self.wind_m_s)

    @property
    def declared(self) -> bool:
        """Whether the log announces its sweeps, as SYSTEMID mode does."""
        return self.vehicle == "ardupilot_quad"


def cards(count: int = 40, *, seed: int = 7000) -> Iterator[Card]:
    """Flights in turn through vehicles, winds and losses."""
    for number in range(count):
        yield Card(
            vehicle=tuple(ENTRIES)[number % 2],
            wind_m_s=WINDS_M_S[number // 2 % 4],
            lost=LOST[number // 3 % 4],
            row=ROWS_LOST[number // 5 % 2],
            seed=seed + number,
        )


@cache
def craft_of(vehicle: str) -> Aircraft:
    return piloted(aircraft(vehicle))


def plan_of(card: Card) -> FlightPlan:
    """Two sweeps, and two doublets by hand of each axis."""
    rate_hz = craft_of(card.vehicle).autopilot.rate_hz
    entry, amplitude = ENTRIES[card.vehicle]
    inputs: list[PlannedInput] = []
    at_s = HOVER_S
    for axis in SWEPT:
        inputs.append(
            planned(
                axis,
                "logarithmic_sweep",
                start_s=at_s,
                amplitude=amplitude,
                duration_s=SWEEP_S,
                sample_rate_hz=rate_hz,
                band_rad_s=BAND_RAD_S,
                entry=entry,  # type: ignore[arg-type]
            )
        )
        at_s = inputs[-1].stop_s + REST_S
    pulse = np.full(round(PULSE_S * rate_hz), PULSE_RAD)
    for number, axis in enumerate((*SWEPT, *SWEPT)):
        values = (-1.0) ** (number // 2) * np.concatenate([pulse, -pulse])
        by_hand = {"values": values, "sample_rate_hz": rate_hz, "amplitude": PULSE_RAD}
        inputs.append(PlannedInput(axis=axis, shape="doublet", start_s=at_s, entry="attitude_setpoint", **by_hand))
        at_s += DOUBLET_S
    return FlightPlan(name="card", inputs=tuple(inputs), trim_s=REST_S)


def fly(card: Card) -> SimulatedFlight:
    wind = card.wind if card.wind_m_s else CALM
    return fly_multirotor(craft_of(card.vehicle), plan_of(card), wind=wind, seed=card.seed)


def truth(card: Card) -> dict[str, float]:
    known = truth_of(craft_of(card.vehicle))
    return {axis: known[name].value for axis, name in GAIN.items()}


RATES = ("roll_command", "pitch_command", "yaw_command", "thrust_command", "p", "q", "r", "p_setpoint", "q_setpoint")
ANGLES = ("phi", "theta", "psi", "phi_setpoint", "theta_setpoint")
SETPOINT = {"roll": "phi_setpoint", "pitch": "theta_setpoint"}


def record_of(card: Card, flight: SimulatedFlight) -> FlightRecord:
    """The log of the flight and of the time on the ground after it, at some 200 Hz."""
    stride = max(round(flight.sample_rate_hz / LOG_HZ), 1)
    rng = np.random.default_rng([card.seed, 5])
    rate_hz = flight.sample_rate_hz / stride
    grounded = round(LANDED_S * rate_hz)
    flown = {name: values[::stride] for name, values in flight.columns.items()}
    size = flown["p"].size
    time_s = 20.0 + np.arange(size + grounded) / rate_hz
    landed_s = float(time_s[size])

    def whole(name: str) -> FloatArray:
        return np.concatenate([flown[name], np.zeros(grounded)])

    def topic(name: str, rows: dict[str, FloatArray], stamps: FloatArray) -> Topic:
        kept = _kept(stamps.size, card, rng)
        channels = tuple(Channel(name=row, unit=STANDARD_UNITS[row]) for row in rows)
        return Topic(name=name, time_s=stamps[kept], channels=channels, values=np.stack([*rows.values()])[:, kept])

    # What the program adds, the pilot does not ask for.
    sent = dict.fromkeys(SWEPT, 0.0)
    if not card.declared:
        sent = {one.axis: one.at(time_s - 20.0) for one in plan_of(card).inputs[: len(SWEPT)]}  # type: ignore[misc]
    sticks = {f"{axis}_stick": _stick(whole(SETPOINT[axis]) - sent[axis]) for axis in SWEPT}
    turns = np.arange(0, time_s.size, round(rate_hz / STICK_HZ))
    topics = [
        topic("RATE", {name: whole(name) for name in RATES if name in flown}, time_s),
        topic("ANG", {name: whole(name) for name in ANGLES if name in flown}, time_s),
        topic("RCIN", {name: values[turns] for name, values in sticks.items()}, time_s[turns]),
    ]
    declared: list[Maneuver] = []
    instruments = {axis: (f"{axis}_stick", SETPOINT[axis]) for axis in SWEPT}
    if card.declared:
        instruments = {axis: (f"{axis}_excitation", f"{axis}_stick") for axis in SWEPT}
        for entered in plan_of(card).inputs[: len(SWEPT)]:
            start_s, stop_s = 20.0 + entered.start_s, 20.0 + entered.stop_s
            inside = (time_s >= start_s) & (time_s <= stop_s)
            added = {f"{entered.axis}_excitation": entered.at(time_s[inside] - 20.0)}
            topics.insert(0, topic(f"SIDD {entered.axis}", added, time_s[inside]))
            declared.append(
                Maneuver(
                    axis=entered.axis,
                    kind="sweep",
                    start_s=start_s,
                    stop_s=stop_s,
                    band_rad_s=BAND_RAD_S,
                    origin="declared",
                    signal=f"{entered.axis}_excitation",
                )
            )
    air = ((20.0, landed_s),)
    return FlightRecord(
        source=Source(name=f"card_{card.seed}", format="twin", sha256="", firmware=FIRMWARE[card.vehicle]),
        topics=tuple(topics),
        parameters=craft_of(card.vehicle).autopilot.parameters,
        declared=tuple(declared),
        instruments=instruments,
        status=Status(vehicle="multirotor", armed=air, in_air=air, flagged_in="twin"),
    )


def _stick(setpoint: FloatArray) -> FloatArray:
    """What the pilot's thumb did to ask for an attitude, as his radio sends it."""
    return np.asarray(np.round(setpoint / FULL_STICK_RAD * STEPS_OF_STICK) / STEPS_OF_STICK)


def _kept(size: int, card: Card, rng: np.random.Generator) -> BoolArray:
    """Records that a card with too little speed wrote: the others are lost in rows of a mean length."""
    begin = card.lost / card.row / (1.0 - card.lost)
    lost = np.zeros(size, dtype=np.bool_)
    at = 0
    while at < size:
        at += int(rng.geometric(min(begin, 1.0)))
        length = int(rng.geometric(1.0 / card.row))
        lost[at : at + length] = True
        at += length
    return ~lost
