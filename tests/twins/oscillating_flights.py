"""Flights that oscillate and flights that do not, with the truth: does the vehicle swing in still air, without noise?

Each flight is flown a second time in still air with perfect sensors. A limit cycle goes on there by itself, at the
frequency that is its truth; a stable loop comes to rest, however it shakes in gusts.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from rotorid.data.flight_plan import FlightPlan, PlannedInput, SimulatedFlight
from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Status, Topic
from rotorid.flying.simulation import everyday_plan
from rotorid.signal.oscillations import check_oscillations
from rotorid.simulation.multirotor import PERFECT
from rotorid.simulation.multirotor_flight import Aircraft, LostError, changed, fly_multirotor, piloted
from rotorid.simulation.wind import CALM, Wind
from rotorid.typing import Axis, FloatArray
from rotorid.vehicles.catalog import aircraft

AXES: tuple[Axis, ...] = ("roll", "pitch", "yaw")
COMMANDS = {axis: f"{axis}_command" for axis in AXES}
LOOP_HZ = {"px4": 1000.0, "ardupilot": 400.0, "betaflight": 2000.0}
FIRMWARE = {
    "px4": ("PX4 ULog", "PX4 v1.15.0"),
    "ardupilot": ("ArduPilot DataFlash", "ArduCopter V4.5.7"),
    "betaflight": ("Betaflight blackbox", "Betaflight 4.4.2"),
}
RATES = ("p", "q", "r")
RATE_SOURCES = {"px4": "vehicle_angular_velocity.xyz[0]", "ardupilot": "RATE.R", "betaflight": "gyroADC[0]"}
GAIN_NAMES = {
    "px4": ("MC_{}RATE_{}", {"roll": "ROLL", "pitch": "PITCH", "yaw": "YAW"}),
    "ardupilot": ("ATC_RAT_{}_{}", {"roll": "RLL", "pitch": "PIT", "yaw": "YAW"}),
    "betaflight": ("{}PID_{}", {"roll": "roll", "pitch": "pitch", "yaw": "yaw"}),
}
LOG_RATES_HZ = (10.0, 50.0, 400.0, 2000.0)
CHANNELS = (
    tuple(f"{name}{kind}" for name in ("p", "q", "r", "phi", "theta", "psi") for kind in ("", "_setpoint"))
    + tuple(f"{axis}_command" for axis in (*AXES, "thrust"))
    + tuple(f"motor_{number}" for number in range(1, 5))
)
PILOT_1_S, ACRO_RATE_RAD_S = (2.0, 2.0, 1.0), 4.0
"""Angle loops of a pilot in acro, and the rate that a full stick asks for."""

STILL = 0.02
"""Root mean square of a command, in still air and without noise, above which a vehicle swings by itself."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """One flight.

    Parameters
    ----------
    vehicle, axes
        What flies, and the axes whose gains are changed.
    proportional, integral, derivative
        Factors on the gains of the rate loops of these axes.
    angle
        Factor on the angle gain.
    lag_s, delay_s
        Of motors and commands; those of the vehicle where they are zero.
    wind_m_s, gusts_m_s
        Of the air.
    stick
        Largest deflection of roll and pitch.
    chops
        Whether the throttle is chopped and punched.
    acro
        Whether sticks ask for rates, and a pilot as slow as an angle loop of 2 rad/s levels the vehicle.
    """

    vehicle: str
    axes: tuple[Axis, ...] = ("roll",)
    proportional: float = 1.0
    integral: float = 1.0
    derivative: float = 1.0
    angle: float = 1.0
    lag_s: float = 0.0
    delay_s: float = 0.0
    wind_m_s: float = 0.0
    gusts_m_s: float = 0.0
    stick: float = 0.0
    chops: bool = False
    acro: bool = False
    duration_s: float = 30.0
    seed: int = 1

    @property
    def wind(self) -> Wind:
        return Wind(north_m_s=self.wind_m_s, turbulence_m_s=self.gusts_m_s) if self.wind_m_s else CALM

    @property
    def craft(self) -> Aircraft:
        """What flies, at the rate of a real loop."""
        return piloted(_changed(self))


def _changed(case: Case) -> Aircraft:
    numbers = {name: value for name, value in (("T_motor", case.lag_s), ("tau", case.delay_s)) if value}
    craft = changed(aircraft(case.vehicle), numbers)
    own = craft.autopilot

    def scaled(values: Sequence[float], factor: float) -> tuple[float, float, float]:
        roll, pitch, yaw = (
            value * (factor if axis in case.axes else 1.0) for axis, value in zip(AXES, values, strict=True)
        )
        return roll, pitch, yaw

    rates = replace(
        own.rates,
        proportional=scaled(own.rates.proportional, case.proportional),
        integral=scaled(own.rates.integral, case.integral),
        derivative=scaled(own.rates.derivative, case.derivative),
    )
    autopilot = replace(
        own,
        rates=rates,
        angle_1_s=PILOT_1_S if case.acro else scaled(own.angle_1_s, case.angle),
        rate_hz=LOOP_HZ[own.kind],
        parameters=_parameters(case, own.kind, own.parameters),
    )
    return replace(craft, autopilot=autopilot)


def _parameters(case: Case, kind: str, known: object) -> dict[str, float]:
    """The autopilot's parameters with the gains that fly."""
    parameters = dict(known)  # type: ignore[call-overload]
    pattern, names = GAIN_NAMES[kind]
    factors = {"P": case.proportional, "I": case.integral, "D": case.derivative}
    for axis in case.axes:
        for letter, factor in factors.items():
            name = pattern.format(names[axis], letter)
            parameters[name] = round(factor * parameters[name], 9)
        if kind != "betaflight":
            name = {"px4": "MC_{}_P", "ardupilot": "ATC_ANG_{}_P"}[kind].format(names[axis])
            parameters[name] = case.angle * parameters[name]
    if kind == "betaflight":
        parameters["pid_process_denom"] = 1e6 / (parameters["looptime"] * LOOP_HZ[kind])
    if kind == "ardupilot":
        parameters["SCHED_LOOP_RATE"] = LOOP_HZ[kind]
    return parameters


def _chops(rate_hz: float, duration_s: float, seed: int) -> FloatArray:
    """A throttle stick that is cut and pushed: every few seconds, for a third of a second to a second."""
    rng = np.random.default_rng([seed, 7])
    values = np.zeros(round(duration_s * rate_hz))
    at = 2.0
    while at < duration_s - 2.0:
        long_s = float(rng.uniform(0.3, 1.0))
        values[round(at * rate_hz) : round((at + long_s) * rate_hz)] = float(rng.choice([-0.9, 0.7]))
        at += long_s + float(rng.uniform(0.6, 2.5))
    return values


def plan_of(case: Case, craft: Aircraft) -> FlightPlan | None:
    """Sticks of an ordinary flight, chops of the throttle, or none."""
    inputs: tuple[PlannedInput, ...] = ()
    rate_hz = craft.autopilot.rate_hz
    if case.stick:
        inputs = everyday_plan(craft, duration_s=case.duration_s, level=case.stick, seed=case.seed).inputs
    if case.acro:
        inputs = tuple(
            one if one.axis == "thrust" else replace(one, entry="rate_setpoint", values=ACRO_RATE_RAD_S * one.values)
            for one in inputs
        )
    if case.chops:
        values = _chops(rate_hz, case.duration_s, case.seed)
        chopped = PlannedInput(
            axis="thrust", shape="sticks", start_s=0.0, values=values, sample_rate_hz=rate_hz, amplitude=0.9,
            entry="stick",
        )  # fmt: skip
        inputs = (*(one for one in inputs if one.axis != "thrust"), chopped)
    return FlightPlan(name="ordinary", inputs=inputs, trim_s=0.0) if inputs else None


@cache
def fly(case: Case) -> SimulatedFlight:
    """The flight as the autopilot had it, at every turn of its loop."""
    craft = case.craft
    return fly_multirotor(craft, plan_of(case, craft), duration_s=case.duration_s, wind=case.wind, seed=case.seed)


@cache
def swings(case: Case) -> tuple[Axis, ...]:
    """The axes whose loops swing by themselves: in still air, without sticks and noise, 20 s after the beginning."""
    craft = replace(case.craft, sensors=PERFECT)
    nudge = PlannedInput(
        axis="roll", shape="doublet", start_s=0.0, values=np.full(round(0.1 * craft.autopilot.rate_hz), 0.02),
        sample_rate_hz=craft.autopilot.rate_hz, amplitude=0.02,
    )  # fmt: skip
    nudges = tuple(replace(nudge, axis=axis) for axis in AXES)
    flown = fly_multirotor(craft, FlightPlan(name="nudge", inputs=nudges, trim_s=24.0), seed=0)
    late = flown.time_s > flown.time_s[-1] - 4.0
    return tuple(axis for axis in AXES if float(np.std(flown.columns[f"{axis}_command"][late])) > STILL)


def frequency_hz(flight: SimulatedFlight, axis: Axis) -> float:
    """Of the strongest line of a command above 0.5 Hz, from every turn of the loop."""
    from scipy.signal import welch

    values = flight.columns[f"{axis}_command"]
    rate_hz = flight.sample_rate_hz
    hz, density = welch(values - values.mean(), rate_hz, nperseg=round(4.0 * rate_hz), nfft=round(16.0 * rate_hz))
    kept = hz > 0.5
    return float(hz[kept][np.argmax(density[kept])])


def record_of(case: Case, *, log_hz: float, jitter: float = 0.0, seed: int = 0) -> FlightRecord:
    """The flight as its logger picks it: turns of the loop at or after stamps, which may be late at random.

    Parameters
    ----------
    case
        The flight.
    log_hz
        Rate of the log.
    jitter
        Largest lateness over the step of the log.
    seed
        Of the lateness.
    """
    flight = fly(case)
    kind = flight.autopilot
    step_s = 1.0 / log_hz
    wanted = np.arange(0.0, flight.time_s[-1], step_s)
    wanted = wanted + jitter * step_s * np.random.default_rng(seed).uniform(0.0, 1.0, wanted.size)
    picked = np.unique(np.minimum(np.searchsorted(flight.time_s, wanted - 1e-9), flight.samples - 1))
    rows = [name for name in CHANNELS if name in flight.columns]
    topic = Topic(
        name="loops",
        time_s=flight.time_s[picked],
        channels=tuple(
            Channel(name=row, unit=STANDARD_UNITS[row], source=RATE_SOURCES[kind] if row in RATES else row)
            for row in rows
        ),
        values=np.stack([flight.columns[row][picked] for row in rows]),
    )
    written, firmware = FIRMWARE[kind]
    whole = ((0.0, float(flight.time_s[-1])),)
    return FlightRecord(
        source=Source(name=f"{case.vehicle}-{case.seed}", format=written, sha256="", firmware=firmware),
        topics=(topic,),
        status=Status(vehicle="multirotor", armed=whole, in_air=whole, flagged_in="twin"),
        parameters=flight.parameters,
    )


def with_sticks(case: Case, *, log_hz: float) -> FlightRecord:
    """The log of a flight, with the sticks that moved it."""
    record, flight = record_of(case, log_hz=log_hz), fly(case)
    (topic,) = record.topics
    picked = np.searchsorted(flight.time_s, topic.time_s)
    sticks = [f"{axis}_stick" for axis in (*AXES, "thrust")]
    moved = Topic(
        name="sticks",
        time_s=topic.time_s,
        channels=tuple(Channel(name=name, unit="1") for name in sticks),
        values=np.stack([flight.columns[name][picked] for name in sticks]),
    )
    return replace(record, topics=(topic, moved))


def _numbered(cases: Sequence[Case]) -> Iterator[Case]:
    """The same in calm air, in gusts, and in gusts with moving sticks in turn, each with a seed of its own."""
    for number, case in enumerate(cases):
        gusty, sticks = number % 3 > 0, number % 3 == 2
        yield replace(
            case,
            wind_m_s=4.0 if gusty else 0.0,
            gusts_m_s=0.8 if gusty else 0.0,
            stick=0.4 if sticks else 0.0,
            seed=100 + number,
        )


def limit_cycles() -> tuple[Case, ...]:
    """40 flights whose gains are too high for their vehicle: lags and delays make cycles from 4 to 40 Hz."""
    both: tuple[Axis, ...] = ("roll", "pitch")
    table: tuple[tuple[str, tuple[Axis, ...], float, float, float, float], ...] = (
        # vehicle, axes, factor of P and I, factor of D, lag, delay
        ("x500", ("roll",), 4.0, 0.0, 0.0, 0.0),
        ("x500", ("pitch",), 4.0, 4.0, 0.0, 0.0),
        ("x500", both, 4.0, 4.0, 0.0, 0.0),
        ("x500", ("roll",), 2.8, 5.6, 0.0, 0.0),
        ("x500", ("pitch",), 5.6, 0.0, 0.01, 0.002),
        ("x500", ("roll",), 4.0, 4.0, 0.01, 0.002),
        ("x500", both, 3.0, 6.0, 0.01, 0.002),
        ("x500", ("roll",), 4.0, 4.0, 0.02, 0.005),
        ("x500", ("pitch",), 1.4, 0.0, 0.04, 0.01),
        ("x500", ("roll",), 4.0, 4.0, 0.04, 0.01),
        ("x500", ("roll",), 2.8, 5.6, 0.08, 0.02),
        ("iris", ("pitch",), 8.0, 8.0, 0.0, 0.0),
        ("iris", ("roll",), 8.0, 8.0, 0.02, 0.005),
        ("px4_quad", ("roll",), 8.0, 0.0, 0.02, 0.005),
        ("px4_quad", ("pitch",), 8.0, 8.0, 0.04, 0.01),
        ("ardupilot_quad", ("roll",), 4.0, 0.0, 0.0, 0.0),
        ("ardupilot_quad", ("roll",), 2.0, 2.0, 0.0, 0.0),
        ("ardupilot_quad", ("pitch",), 2.0, 2.0, 0.0, 0.0),
        ("ardupilot_quad", both, 3.0, 3.0, 0.0, 0.0),
        ("ardupilot_quad", ("pitch",), 1.4, 2.8, 0.0, 0.0),
        ("ardupilot_quad", ("roll",), 2.0, 0.0, 0.01, 0.002),
        ("ardupilot_quad", both, 1.4, 1.4, 0.01, 0.002),
        ("ardupilot_quad", ("roll",), 1.4, 1.4, 0.02, 0.005),
        ("ardupilot_quad", ("pitch",), 1.0, 2.0, 0.02, 0.005),
        ("ardupilot_quad", ("roll",), 1.4, 1.4, 0.04, 0.01),
        ("ardupilot_quad", ("pitch",), 1.0, 2.0, 0.04, 0.01),
        ("ardupilot_quad", ("roll",), 1.0, 1.0, 0.08, 0.02),
        ("betaflight_quad", ("roll",), 8.0, 0.0, 0.0, 0.0),
        ("betaflight_quad", ("pitch",), 5.6, 0.0, 0.01, 0.002),
        ("betaflight_quad", ("roll",), 5.6, 5.6, 0.01, 0.0025),
        ("betaflight_quad", ("pitch",), 5.6, 5.6, 0.01, 0.004),
        ("betaflight_quad", both, 5.6, 5.6, 0.01, 0.003),
        ("betaflight_quad", ("roll",), 2.8, 0.0, 0.02, 0.005),
        ("betaflight_quad", ("pitch",), 5.6, 5.6, 0.02, 0.005),
        ("betaflight_quad", both, 4.0, 8.0, 0.02, 0.005),
        ("betaflight_quad", ("roll",), 4.0, 8.0, 0.02, 0.004),
        ("betaflight_quad", ("roll",), 4.0, 4.0, 0.04, 0.01),
        ("betaflight_quad", ("pitch",), 4.0, 8.0, 0.04, 0.01),
        ("betaflight_quad", ("roll",), 0.7, 0.0, 0.04, 0.01),
        ("betaflight_quad", ("pitch",), 1.0, 2.0, 0.08, 0.02),
    )
    cases = [
        Case(vehicle=vehicle, axes=axes, proportional=p, integral=p, derivative=d, lag_s=lag_s, delay_s=delay_s)
        for vehicle, axes, p, d, lag_s, delay_s in table
    ]
    return tuple(_numbered(cases))


def calm_flights() -> tuple[Case, ...]:
    """60 flights in calm air and in gusts, with their own and with softer gains, hands off and with sticks."""
    cases = []
    number = 0
    for vehicle in ("x500", "iris", "px4_quad", "ardupilot_quad", "betaflight_quad"):
        for factor in (0.5, 0.8, 1.0):
            for wind_m_s, gusts_m_s, stick in ((0.0, 0.0, 0.0), (5.0, 1.0, 0.0), (7.0, 2.0, 0.0), (4.0, 0.8, 0.5)):
                cases.append(
                    Case(
                        vehicle=vehicle,
                        axes=("roll", "pitch"),
                        proportional=factor,
                        integral=factor,
                        derivative=factor,
                        wind_m_s=wind_m_s,
                        gusts_m_s=gusts_m_s,
                        stick=stick,
                        seed=500 + number,
                    )
                )
                number += 1
    return tuple(cases)


def hard_flights() -> tuple[Case, ...]:
    """Stable loops in hard use: full sticks, chopped throttle, gains that are nearly too high."""
    cases = []
    number = 0
    for vehicle, factors in (
        ("x500", (1.0, 1.7)),
        ("iris", (1.0, 3.0)),
        ("ardupilot_quad", (0.5, 0.9)),
        ("betaflight_quad", (1.0, 3.5)),
    ):
        for factor in factors:
            for stick, chops in ((1.0, False), (0.0, True), (0.8, True)):
                cases.append(
                    Case(
                        vehicle=vehicle,
                        axes=("roll", "pitch"),
                        proportional=factor,
                        integral=factor,
                        derivative=0.5 * factor if factor > 3.0 else factor,
                        wind_m_s=4.0,
                        gusts_m_s=0.8,
                        stick=stick,
                        chops=chops,
                        seed=800 + number,
                    )
                )
                number += 1
    return tuple(cases)


def slow_swings() -> tuple[Case, ...]:
    """24 flights whose integral or angle loop is too quick for the rate loop, hands off and with sticks."""
    table = (
        # vehicle, factor of P, of I, of D, of the angle gain
        ("x500", 0.1, 10.0, 0.0, 1.0),
        ("x500", 0.2, 3.0, 0.0, 1.0),
        ("x500", 0.2, 1.0, 0.5, 3.0),
        ("px4_quad", 0.05, 3.0, 0.0, 1.0),
        ("px4_quad", 0.1, 3.0, 0.0, 1.0),
        ("px4_quad", 0.2, 10.0, 0.0, 1.0),
        ("px4_quad", 1.0, 20.0, 1.0, 1.0),
        ("ardupilot_quad", 0.05, 3.0, 0.0, 1.0),
        ("ardupilot_quad", 0.1, 10.0, 0.0, 1.0),
        ("betaflight_quad", 0.1, 1.0, 1.0, 1.0),
        ("betaflight_quad", 0.1, 3.0, 0.0, 1.0),
        ("betaflight_quad", 0.2, 10.0, 0.0, 1.0),
    )
    return tuple(
        Case(
            vehicle=vehicle,
            proportional=p,
            integral=i,
            derivative=d,
            angle=a,
            wind_m_s=3.0,
            gusts_m_s=0.5,
            stick=stick,
            seed=700 + number,
        )
        for stick in (0.0, 0.4)
        for number, (vehicle, p, i, d, a) in enumerate(table)
    )


def beyond_the_limit() -> Iterator[Case]:
    """Gains 1.1 and 1.5 times those at which roll begins to swing, of vehicles that served to choose nothing.

    Those of the library with their own and three other lags and delays, each without D, with its own and twice as much;
    what turns over, or swings below 4 Hz, is left out.
    """
    number = 0
    for vehicle in ("px4_quad", "x500", "iris", "ardupilot_quad", "betaflight_quad"):
        for lag_s, delay_s in ((0.0, 0.0), (0.01, 0.002), (0.02, 0.005), (0.04, 0.01)):
            for derivative in (0.0, 1.0, 2.0):
                base = Case(vehicle=vehicle, lag_s=lag_s, delay_s=delay_s, wind_m_s=4.0, gusts_m_s=0.8)
                critical = _critical(replace(base, wind_m_s=0.0), derivative)
                for factor in (1.1, 1.5):
                    gain = factor * critical
                    case = _with_gains(base, gain, derivative)
                    case = replace(case, stick=0.3 * (number % 2), seed=number)
                    number += 1
                    if _flies(case) and frequency_hz(fly(case), "roll") >= 4.0:
                        yield case


def _with_gains(case: Case, gain: float, derivative: float) -> Case:
    return replace(case, proportional=gain, integral=gain, derivative=gain * derivative)


def _critical(case: Case, derivative: float) -> float:
    """Factor on the gains of roll from which it swings, within 4 %."""
    low, high = 0.3, 30.0
    for _ in range(7):
        middle = float(np.sqrt(low * high))
        changed_case = _with_gains(case, middle, derivative)
        if not _flies(changed_case, still=True) or "roll" in swings(changed_case):
            high = middle
        else:
            low = middle
    return high


def _flies(case: Case, *, still: bool = False) -> bool:
    """Whether the vehicle stays in the air."""
    try:
        swings(case) if still else fly(case)
    except LostError:
        return False
    return True


@dataclass(frozen=True, kw_only=True)
class Score:
    """What was said of one record of a flight."""

    right: bool
    frequency_due: bool
    frequency_right: bool


def logged_rates_hz(case: Case) -> tuple[float, ...]:
    """The rates of logs that its autopilot can write."""
    return tuple(rate for rate in LOG_RATES_HZ if rate <= LOOP_HZ[case.craft.autopilot.kind])


def score(case: Case, *, log_hz: float, jitter: float = 0.0) -> Score:
    """Whether the axes that swing by themselves are found, and no others, the strongest with its frequency.

    The frequency is due where the rate of the log exceeds 2.5 times it; a stated one always has to be right.
    """
    check = check_oscillations(record_of(case, log_hz=log_hz, jitter=jitter, seed=case.seed))
    true = swings(case)
    named = {one.axis for one in check.found}
    if not named:
        return Score(right=not true, frequency_due=False, frequency_right=True)
    strongest = max(check.found, key=lambda one: one.rms)
    frequency = frequency_hz(fly(case), strongest.axis)
    stated = strongest.frequency_hz
    due = log_hz > 2.5 * frequency
    near = stated is not None and abs(stated / frequency - 1.0) <= 0.05
    return Score(
        right=strongest.axis in true and named <= set(true),
        frequency_due=due,
        frequency_right=near or (not due and stated is None),
    )


def with_gains_of(case: Case, axis: Axis, gains: dict[str, tuple[float, float]]) -> Case:
    """The case with the gains that were proposed for an axis, as factors."""
    kind = case.craft.autopilot.kind
    pattern, names = GAIN_NAMES[kind]
    proposed = {name: new / old for name, (old, new) in gains.items()}

    def factor(letter: str) -> float:
        own = {pattern.format(names[axis], letter), f"{letter.lower()}_{axis}"}
        return next((value for name, value in proposed.items() if name in own), 1.0)

    angle = next((value for name, value in proposed.items() if name in ANGLE_NAMES), 1.0)
    return replace(
        case,
        proportional=case.proportional * factor("P"),
        integral=case.integral * factor("I"),
        derivative=case.derivative * factor("D"),
        angle=case.angle * angle,
    )


ANGLE_NAMES = (
    "MC_ROLL_P",
    "MC_PITCH_P",
    "ATC_ANG_RLL_P",
    "ATC_ANG_PIT_P",
    "angle_level_strength",
    "levelPID_P",
)
