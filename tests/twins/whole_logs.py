"""Logs from the ground to the ground, or into it: flights, landed hovers, benches and crashes with a known truth.

Each log is that of one of the simulator's vehicles under its own autopilot, in PX4's, ArduPilot's or Betaflight's
format, at 10 to 1000 Hz. Flags of arming and landing are there, late as the autopilots make them, or lost in part, or
absent as in old logs. What is left out: Betaflight's slow frames, whose armed flag covers a whole log; benches whose
motors run without propellers; vehicles of more than four rotors, which outlive the loss of a motor.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
from tests.twins.ground_kernels import FLYING, IDLE, LANDING, OFF, ground_flight

from rotorid.data.flight_plan import SimulatedFlight
from rotorid.excitation.sticks import everyday_stick
from rotorid.io.ardupilot.dataflash_writer import Messages, write_dataflash
from rotorid.io.ardupilot.writer import LAYOUTS as MESSAGES
from rotorid.io.ardupilot.writer import SIGNALS, Logged
from rotorid.io.betaflight.writer import write_betaflight
from rotorid.io.px4.writer import LAYOUTS as TOPICS
from rotorid.io.px4.writer import LoggedTopic, _logged, message_dtype, write_ulog
from rotorid.simulation import multirotor as logged
from rotorid.simulation.multirotor import STATES
from rotorid.simulation.multirotor_flight import Aircraft, _columns, piloted
from rotorid.simulation.wind import CALM, Wind, blown
from rotorid.typing import FloatArray
from rotorid.vehicles.catalog import aircraft

Kind = Literal["flight", "landed", "bench", "crash"]

SUFFIX = {"px4_quad": ".ulg", "x500": ".ulg", "ardupilot_quad": ".bin", "betaflight_quad": ".bbl"}
IDLES = {"px4_quad": 0.08, "x500": 0.08, "ardupilot_quad": 0.1, "betaflight_quad": 0.02}
RATES_HZ = {
    "px4_quad": (10.0, 50.0, 250.0),
    "x500": (10.0, 50.0, 125.0),
    "ardupilot_quad": (10.0, 25.0, 400.0),
    "betaflight_quad": (125.0, 500.0, 1000.0),
}
VARIANTS: dict[Kind, tuple[str, ...]] = {
    "flight": ("sticks", "steps", "punches", "sticks", "dives", "doublets", "gusts", "flips"),
    "landed": ("hover", "sticks", "hover", "hard"),
    "bench": ("still", "idle", "carried", "idle carried", "carried", "idle"),
    "crash": (
        "motor",
        "motor",
        "weak motor",
        "power",
        "motor",
        "collision",
        "brown-out",
        "motor",
        "two motors",
        "motor",
    ),
}
"""What happens in turn in the logs of each kind."""

FLAGS = ("all", "none", "armed", "lost")
BOOT_S = 20.0
"""Stamp at which each log begins."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """One log of the study."""

    kind: Kind
    variant: str
    vehicle: str
    log_hz: float
    flags: str
    wind_m_s: float
    seed: int

    @property
    def file(self) -> str:
        return f"{self.kind}-{self.variant.replace(' ', '-')}-{self.seed}{SUFFIX[self.vehicle]}"


@dataclass(frozen=True, kw_only=True)
class Truth:
    """What was true, on the clock of the log.

    The flight ends where control is lost, or where the vehicle stays on the ground: who bounces has not landed yet.
    """

    flight: tuple[float, float] | None
    lost_s: float | None = None
    ends_in_air: bool = False
    strike_m_s: float = 0.0
    """Speed of the hardest strike on the ground."""


def cases(
    flights: int = 200, landed: int = 60, benches: int = 60, crashes: int = 80, *, seed: int = 44_000
) -> Iterator[Case]:
    """Logs in turn through kinds of events, vehicles, rates, flags and winds."""
    counts: dict[Kind, int] = {"flight": flights, "landed": landed, "bench": benches, "crash": crashes}
    for place, (kind, count) in enumerate(counts.items()):
        rng = np.random.default_rng([seed, place])
        for number in range(count):
            variant = VARIANTS[kind][number % len(VARIANTS[kind])]
            vehicle = "betaflight_quad" if variant == "flips" else str(rng.choice(list(SUFFIX)))
            yield Case(
                kind=kind,
                variant=variant,
                vehicle=vehicle,
                log_hz=float(rng.choice(RATES_HZ[vehicle])),
                flags=str(rng.choice(FLAGS)),
                wind_m_s=6.0 if variant == "gusts" else float(rng.choice([0.0, 2.0, 4.0])),
                seed=seed + 1000 * place + number,
            )


@cache
def craft_of(vehicle: str) -> Aircraft:
    """A vehicle whose sensors shake with its rotors."""
    craft = aircraft(vehicle)
    sensors = replace(craft.sensors, gyro_vibration_rad_s=0.1, accelerometer_vibration_m_s2=1.5)
    return piloted(replace(craft, sensors=sensors))


@dataclass(kw_only=True, eq=False)
class _Script:
    """What pilot, hands and fate do, tick by tick."""

    time_s: FloatArray
    asked: FloatArray
    wanted: FloatArray
    hand: FloatArray
    health: FloatArray
    kicks: FloatArray
    fails_s: float | None = None
    begins_s: float = 0.0
    """Where the log begins; later than zero for one that begins in the air."""
    ends_s: float | None = None


def _script(case: Case, rng: np.random.Generator) -> _Script:
    craft = craft_of(case.vehicle)
    rate_hz = craft.autopilot.rate_hz
    if case.kind == "bench":
        return _bench(case, rng, rate_hz)
    long = case.kind == "landed"
    off_s, idle_s = rng.uniform(8.0, 25.0) if long else rng.uniform(0.5, 5.0), rng.uniform(1.0, 6.0)
    spool_s, air_s = rng.uniform(0.8, 2.5), rng.uniform(12.0, 30.0)
    height = (
        rng.uniform(6.0, 25.0) if case.kind == "crash" or case.variant in ("dives", "flips") else rng.uniform(2.0, 12.0)
    )
    lift_s = off_s + idle_s + spool_s
    top_s = lift_s + height / 1.5
    down_s = top_s + air_s
    # A hard landing goes on at the speed of the descent, without a flare.
    flare_s = down_s + (height - 1.0) / (2.5 if case.variant == "hard" else 1.0)
    ground_s = flare_s + 4.0
    end_s = ground_s + (rng.uniform(8.0, 25.0) if long else rng.uniform(1.0, 5.0))
    time_s = np.arange(round(end_s * rate_hz)) / rate_hz
    size = time_s.size
    phase = np.full(size, float(FLYING))
    phase[time_s < off_s + idle_s] = IDLE
    phase[time_s < off_s] = OFF
    phase[time_s >= down_s] = LANDING
    phase[time_s >= ground_s + 2.0] = IDLE
    phase[time_s >= ground_s + 3.0] = OFF
    wanted_height = np.interp(
        time_s,
        [off_s + idle_s, lift_s, top_s, down_s, flare_s, flare_s + 4.0],
        [-1.0, 0.0, height, height, 1.0, -1.0 if case.variant != "hard" else -9.0],
    )
    if case.kind != "landed" or case.variant == "sticks":
        wanted_height += np.where(
            (time_s > top_s) & (time_s < down_s),
            0.3 * min(height - 1.5, 5.0) * np.sin(0.5 * (time_s - top_s)) * np.clip(time_s - top_s, 0.0, 1.0),
            0.0,
        )
    climb = np.gradient(wanted_height) * rate_hz
    script = _Script(
        time_s=time_s,
        asked=np.zeros((size, 17)),
        wanted=np.stack([phase, wanted_height, np.clip(climb, -3.0, 3.0)], axis=1),
        hand=np.zeros((size, 7)),
        health=np.ones((size, craft.vehicle.rotors.layout.rotors)),
        kicks=np.zeros((size, 3)),
    )
    _stir(case, script, rng, rate_hz, (top_s + 0.5, down_s - 1.0))
    if case.kind == "flight":
        script.begins_s = top_s + 2.0 if rng.random() < 0.2 else 0.0
        script.ends_s = down_s - 1.0 if rng.random() < 0.1 else None
    if case.kind == "crash":
        _fail(case, script, rng, rng.uniform(top_s + 3.0, down_s - 1.0))
    return script


def _stir(case: Case, script: _Script, rng: np.random.Generator, rate_hz: float, span_s: tuple[float, float]) -> None:
    """Sticks and test inputs while the vehicle is up."""
    inside = (script.time_s > span_s[0]) & (script.time_s < span_s[1])
    count = int(inside.sum())
    level = {"hover": 0.05, "flips": 0.3, "steps": 0.15}.get(case.variant, float(rng.choice([0.3, 0.6, 1.0])))
    for column, share in ((12, 1.0), (13, 1.0), (14, 0.5)):
        script.asked[inside, column] = everyday_stick(
            level=share * level, duration_s=count / rate_hz, sample_rate_hz=rate_hz, rng=rng
        )[:count]

    def hold(start_s: float, length_s: float, column: int, value: float) -> None:
        script.asked[(script.time_s >= start_s) & (script.time_s < start_s + length_s), column] += value

    for start_s in np.arange(span_s[0] + 1.0, span_s[1] - 4.0, 5.0):
        axis = int(rng.integers(2))
        if case.variant == "steps":
            hold(start_s, 1.0, 8 + axis, float(rng.choice([-0.5, 0.5])))
        elif case.variant == "doublets":
            hold(start_s, 0.25, 4 + axis, 3.0)
            hold(start_s + 0.25, 0.25, 4 + axis, -3.0)
        elif case.variant == "punches":
            hold(start_s, rng.uniform(0.3, 0.8), 3, 1.0)
        elif case.variant == "dives" and start_s + 4.0 < span_s[1]:
            hold(start_s, rng.uniform(0.3, 0.7), 3, -1.0)
        elif case.variant == "flips":
            hold(start_s - 0.4, 0.4, 3, 0.4)
            hold(start_s, 0.5, 4 + axis, 12.5)


def _fail(case: Case, script: _Script, rng: np.random.Generator, at_s: float) -> None:
    """What ends the flight."""
    after = script.time_s >= at_s
    first = int(after.argmax())
    rotor = int(rng.integers(script.health.shape[1]))
    script.fails_s = float(script.time_s[first])
    script.wanted[after, 0] = FLYING
    script.wanted[after, 1] = script.wanted[first, 1]
    script.wanted[after, 2] = 0.0
    if case.variant == "motor":
        script.health[after, rotor] = 0.0
    elif case.variant == "weak motor":
        script.health[after, rotor] = rng.uniform(0.0, 0.2)
    elif case.variant in ("power", "brown-out"):
        script.health[after] = 0.0
    elif case.variant == "collision":
        script.health[after, rotor] = 0.0
        script.kicks[first, :2] = rng.uniform(4.0, 12.0, 2) * rng.choice([-1.0, 1.0], 2)
    elif case.variant == "two motors":
        script.health[after, rotor] = script.health[after, rotor - 1] = 0.0
    script.wanted[script.time_s >= at_s + rng.uniform(3.0, 6.0), 0] = OFF


def _bench(case: Case, rng: np.random.Generator, rate_hz: float) -> _Script:
    """A vehicle on a table or in a hand; motors off or idle."""
    end_s = rng.uniform(20.0, 60.0)
    time_s = np.arange(round(end_s * rate_hz)) / rate_hz
    size = time_s.size
    phase = np.full(size, float(OFF))
    if "idle" in case.variant:
        phase[(time_s > 3.0) & (time_s < end_s - rng.uniform(-2.0, 4.0))] = IDLE
    hand = np.zeros((size, 7))
    if "carried" in case.variant:
        begin_s, stop_s = rng.uniform(4.0, 8.0), end_s - rng.uniform(-3.0, 6.0)
        inside = (time_s > begin_s) & (time_s < stop_s)
        fade = np.clip(np.minimum(time_s - begin_s, stop_s - time_s), 0.0, 1.0)
        hand[inside, 0] = 1.0
        for axis in range(3):
            for _ in range(4):
                size_rad, omega = rng.uniform(0.02, 0.3), rng.uniform(0.5, 5.0)
                hand[:, 1 + axis] += size_rad * fade * np.sin(omega * time_s + rng.uniform(0.0, 6.0))
        # Small angles: their slopes are the body rates, near enough for a hand.
        hand[:, 4:7] = np.gradient(hand[:, 1:4], axis=0) * rate_hz
    return _Script(
        time_s=time_s,
        asked=np.zeros((size, 17)),
        wanted=np.stack([phase, np.full(size, -1.0), np.zeros(size)], axis=1),
        hand=hand,
        health=np.ones((size, 4)),
        kicks=np.zeros((size, 3)),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class MadeLog:
    """A flight with its truth, before a logger has thinned it out; times from the beginning of the log."""

    case: Case
    flight: SimulatedFlight
    truth: Truth
    armed: tuple[tuple[float, float], ...]
    in_air: tuple[tuple[float, float], ...]
    """As the autopilot finds it out: late."""


def fly(case: Case) -> MadeLog:
    """Fly a case from the ground to the ground."""
    rng = np.random.default_rng([case.seed, 1])
    craft = craft_of(case.vehicle)
    autopilot, vehicle = craft.autopilot, craft.vehicle
    rate_hz = autopilot.rate_hz
    script = _script(case, rng)
    rows = script.time_s.size
    rotors = vehicle.rotors.layout.rotors
    wind = Wind(north_m_s=case.wind_m_s, turbulence_m_s=0.25 * case.wind_m_s) if case.wind_m_s else CALM
    winds = blown(wind, rows, sample_rate_hz=rate_hz, rng=rng)
    noise = rng.standard_normal((rows, 15))
    log, truth = np.zeros((rows, logged.MOTORS + rotors)), np.zeros((rows, STATES + rotors + 6))
    start = vehicle.hovering()
    start[STATES:] = 0.0
    ground_flight(
        start,
        script.asked,
        script.wanted,
        script.hand,
        script.health,
        script.kicks,
        winds,
        noise,
        vehicle.body(),
        craft.sensors.senses(),
        autopilot.control(vehicle, substeps=max(1, round(1000.0 / rate_hz))),
        IDLES[case.vehicle],
        log,
        truth,
    )
    columns = dict(_columns(craft, log, script.asked, None))
    if case.kind != "bench":
        columns |= {f"{axis}_stick": script.asked[:, 12 + place] for place, axis in enumerate(("roll", "pitch", "yaw"))}
        columns["thrust_stick"] = columns["thrust_command"]
    columns |= _battery(case, script, log, vehicle)
    contact = truth[:, STATES + rotors + 3] > 0.0
    strikes = truth[:, STATES + rotors + 5]
    first, last, known = _window(case, script, contact, strikes, rng)
    kept = slice(first, last)
    begin_s = float(script.time_s[first])
    flight = SimulatedFlight(
        vehicle=case.vehicle,
        autopilot=autopilot.kind,
        sample_rate_hz=rate_hz,
        time_s=np.arange(last - first) / rate_hz,
        columns={name: values[kept] for name, values in columns.items()},
        raw={},
        truth={},
        maneuvers=(),
        parameters=autopilot.parameters,
        saturated=0.0,
    )
    armed = _runs(truth[:, STATES + rotors + 4] > OFF, script.time_s, begin_s, float(script.time_s[last - 1]))
    flags_air: tuple[tuple[float, float], ...] = ()
    if known.flight is not None:
        # The detector notices take-off late, and landing later; a crash, only where the motors are stopped.
        on_s = max(known.flight[0] - BOOT_S + rng.uniform(-0.1, 0.3), 0.0) if known.flight[0] > BOOT_S else 0.0
        off_s = flight.samples / rate_hz
        if known.lost_s is None and known.flight[1] - BOOT_S < off_s - 0.5:
            off_s = known.flight[1] - BOOT_S + rng.uniform(0.3, 1.0)
        flags_air = tuple((max(on_s, a), min(off_s, b)) for a, b in armed if max(on_s, a) < min(off_s, b))
    return MadeLog(case=case, flight=flight, truth=known, armed=armed, in_air=flags_air)


def _battery(case: Case, script: _Script, log: FloatArray, vehicle: Any) -> dict[str, FloatArray]:
    """Voltage and current by what the motors draw; where the supply collapses, both do."""
    share = np.clip(log[:, logged.MOTORS :], 0.0, 1.0) * script.health / vehicle.hover_shares[0]
    current = 0.5 + 12.0 * np.mean(share**3, axis=1)
    voltage = 16.4 - 0.02 * current - 0.002 * script.time_s
    if case.variant == "brown-out" and script.fails_s is not None:
        voltage = voltage * np.where(
            script.time_s < script.fails_s, 1.0, np.exp(-(script.time_s - script.fails_s) / 0.2)
        )
    return {"battery_voltage": voltage, "battery_current": current}


def _window(
    case: Case, script: _Script, contact: np.ndarray, strikes: FloatArray, rng: np.random.Generator
) -> tuple[int, int, Truth]:
    """First and last sample of the log, and what is true of it, on its clock."""
    time_s = script.time_s
    first, last = int(np.searchsorted(time_s, script.begins_s)), time_s.size
    if case.kind == "bench":
        return first, last, Truth(flight=None)
    free = np.flatnonzero(~contact)
    up_s = float(time_s[free[0]])
    hit = np.flatnonzero((strikes > 0.0) & (time_s > up_s + 2.0))
    # A vehicle that bounces has not landed yet.
    falls = hit.size and case.kind == "crash"
    down_s = float(time_s[hit[0]]) if falls else float(time_s[free[-1]])
    if case.kind == "crash":
        assert script.fails_s is not None
        fallen_s = max(down_s - script.fails_s, 0.0)
        cut = {"brown-out": 0.8, "power": 0.4}.get(case.variant, 0.35)
        before_s, after_s = script.fails_s + max(0.8 * fallen_s, 0.5), down_s + rng.uniform(0.5, 12.0)
        last_s = before_s if rng.random() < cut else after_s
    else:
        last_s = script.ends_s if script.ends_s is not None else float(time_s[-1])
    last = min(last, int(np.searchsorted(time_s, last_s)))
    begin_s = float(time_s[first])
    lost_s = script.fails_s
    stop_s = min(down_s if lost_s is None else lost_s, float(time_s[last - 1]))
    return (
        first,
        last,
        Truth(
            flight=(BOOT_S + max(up_s - begin_s, 0.0), BOOT_S + stop_s - begin_s),
            lost_s=None if lost_s is None else BOOT_S + lost_s - begin_s,
            ends_in_air=float(time_s[last - 1]) < down_s,
            strike_m_s=float(strikes[first:last].max()),
        ),
    )


def _runs(on: np.ndarray, time_s: FloatArray, begin_s: float, stop_s: float) -> tuple[tuple[float, float], ...]:
    """Intervals in which something is on, on the clock that begins with the log."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], on, [False]]).astype(int)))
    ends = np.append(time_s, time_s[-1])
    pairs = (
        (max(float(ends[a]), begin_s) - begin_s, min(float(ends[b]), stop_s) - begin_s) for a, b in edges.reshape(-1, 2)
    )
    return tuple((start, stop) for start, stop in pairs if start < stop)


def write(made: MadeLog, folder: Path) -> Path:
    """Write the log in the format of its autopilot."""
    path = folder / made.case.file
    {".ulg": _write_px4, ".bin": _write_ardupilot, ".bbl": _write_betaflight}[path.suffix](path, made)
    return path


def _events(made: MadeLog, rng: np.random.Generator) -> list[tuple[float, int]]:
    """ArduPilot's events; some logs have lost some."""
    events = [(at, number) for run in made.armed for at, number in zip(run, (10, 11), strict=True)]
    events += [(at, number) for run in made.in_air for at, number in zip(run, (28, 18), strict=True)]
    stop_s = made.flight.samples / made.flight.sample_rate_hz
    # What holds where the log begins or ends was said before, or will be.
    events = [(at, number) for at, number in sorted(events) if 0.0 < at < stop_s - 0.01]
    return [event for event in events if made.case.flags != "lost" or rng.random() < 0.6]


def _write_ardupilot(path: Path, made: MadeLog) -> None:
    flight, case = made.flight, made.case
    rng = np.random.default_rng([case.seed, 2])
    stamps_us = np.rint((BOOT_S + flight.time_s) * 1e6).astype(np.int64)
    parameters = dict(flight.parameters) | {f"SERVO{n}_FUNCTION": 32.0 + n for n in range(1, 5)}

    def table(name: str, stamps: Any, values: Any) -> Messages:
        zeros = dict.fromkeys(MESSAGES[name].format.columns, 0.0)
        return Messages(layout=MESSAGES[name], values={**zeros, "TimeUS": np.asarray(stamps), **values})

    values = np.array(list(parameters.values()))
    begin = stamps_us[:1]
    tables = [
        table("PARM", begin.repeat(len(parameters)), {"Name": list(parameters), "Value": values, "Default": math.nan}),
        table("MSG", begin, {"Message": ["ArduCopter V4.5.7 (rotorid)"]}),
        table("MODE", begin, {"Mode": np.zeros(1), "ModeNum": np.zeros(1)}),
    ]
    if case.flags in ("all", "lost"):
        events = _events(made, rng)
        if events:
            at = np.rint((BOOT_S + np.array([time_s for time_s, _ in events])) * 1e6).astype(np.int64)
            tables.append(table("EV", at, {"Id": np.array([number for _, number in events])}))
    if case.flags in ("all", "armed"):
        changes = [(at, state) for run in made.armed for at, state in zip(run, (1.0, 0.0), strict=True)]
        changes = [(at, state) for at, state in changes if 0.0 < at < float(flight.time_s[-1])]
        if changes:
            at = np.rint((BOOT_S + np.array([time_s for time_s, _ in changes])) * 1e6).astype(np.int64)
            tables.append(table("ARM", at, {"ArmState": np.array([state for _, state in changes])}))
    slow = {"XKF1": 10.0, "BAT": 10.0, "CTUN": 10.0, "MOTB": 10.0, "RCIN": 10.0, "IMU": max(25.0, case.log_hz)}
    for name, signal in SIGNALS.items():
        if set(signal.needed) <= flight.columns.keys() and not (name == "ANG" and case.log_hz < 400.0):
            picked = _picked(flight, min(slow.get(name, case.log_hz), flight.sample_rate_hz))
            row = dict(
                signal.values(
                    Logged(
                        flight=flight,
                        samples=picked,
                        parameters={"MOT_PWM_MIN": 1000.0, "MOT_PWM_MAX": 2000.0} | parameters,
                    )
                )
            )
            if name == "BAT":
                row["Curr"] = flight.columns["battery_current"][picked]
            tables.append(table(name, stamps_us[picked], row))
    order = list(MESSAGES)
    write_dataflash(path, sorted(tables, key=lambda one: order.index(one.layout.name)))


def _picked(flight: SimulatedFlight, rate_hz: float) -> np.ndarray:
    return np.arange(0, flight.samples, max(round(flight.sample_rate_hz / rate_hz), 1))


def _write_px4(path: Path, made: MadeLog) -> None:
    flight, case = made.flight, made.case
    rng = np.random.default_rng([case.seed, 2])
    stamps = np.rint((BOOT_S + flight.time_s) * 1e6).astype(np.int64)
    topics = []
    for layout in TOPICS:
        usual = {"battery_status": 2.0, "vehicle_local_position": 10.0, "manual_control_setpoint": 5.0}
        rate_hz = min(usual.get(layout.topic, case.log_hz), flight.sample_rate_hz)
        for topic in _logged(flight, layout, stamps, rate_hz):
            if topic.name == "battery_status":
                turns = np.searchsorted(stamps, topic.samples["timestamp"].astype(np.int64))
                topic.samples["current_a"] = flight.columns["battery_current"][turns]
            topics.append(topic)
    if case.flags != "none":
        topics.append(_flag_topic("vehicle_status", "uint8_t arming_state", made.armed, flight, (1, 2), rng, 1.0))
    if case.flags in ("all", "lost"):
        kept = 0.7 if case.flags == "lost" else 1.0
        topics.append(_flag_topic("vehicle_land_detected", "bool landed", made.in_air, flight, (1, 0), rng, kept))
    parameters = {
        name: int(value) if name in ("SYS_AUTOSTART", "MAV_TYPE", "CA_AIRFRAME", "CA_ROTOR_COUNT") else value
        for name, value in flight.parameters.items()
    }
    write_ulog(path, topics, parameters=parameters, information={"sys_name": "PX4", "ver_sw_release": 17825792})


def _flag_topic(
    name: str,
    field: str,
    on: tuple[tuple[float, float], ...],
    flight: SimulatedFlight,
    values: tuple[int, int],
    rng: np.random.Generator,
    kept: float,
) -> LoggedTopic:
    """A flag once a second and wherever it changes; of some, messages are lost."""
    stop_s = float(flight.time_s[-1])
    changes = [at for run in on for at in run if 0.0 < at < stop_s]
    at_s = np.unique(np.concatenate([np.arange(0.0, stop_s, 1.0), changes]))
    at_s = at_s[rng.random(at_s.size) < kept] if kept < 1.0 else at_s
    layout = f"uint64_t timestamp;{field}"
    samples = np.zeros(at_s.size, dtype=message_dtype(layout))
    samples["timestamp"] = np.rint((BOOT_S + at_s) * 1e6)
    is_on = np.zeros(at_s.size, dtype=bool)
    for start_s, end_s in on:
        is_on |= (at_s >= start_s) & ((at_s < end_s) | (end_s >= stop_s))
    samples[field.split()[1]] = np.where(is_on, values[1], values[0])
    return LoggedTopic(name=name, layout=layout, samples=samples)


def _write_betaflight(path: Path, made: MadeLog) -> None:
    flight = made.flight
    picked = _picked(flight, made.case.log_hz)
    thinned = replace(
        flight,
        sample_rate_hz=made.case.log_hz,
        time_s=flight.time_s[picked],
        columns={name: values[picked] for name, values in flight.columns.items()},
    )
    write_betaflight(path, thinned, start_s=BOOT_S)
