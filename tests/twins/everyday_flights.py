"""Ordinary flights with the truth of their loops: sticks only, no sweep, in wind; what was true *along* each of them.

The linear model about hover is not the truth of a flight: its −3 dB bandwidth lies up to 8 % off. So each flight is
flown twice more without noise of sensors, once with a multisine of 0.01 rad/s rms on the set-point of the roll rate:
the difference of the two shows the loop along the flight, but for sidebands of gusts, which are smoothed out of its
ratio to hover. The truth of the step is that of the simulator without outer loops, moved by the same difference.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from rotorid.data.flight_plan import FlightPlan, PlannedInput, SimulatedFlight
from rotorid.data.quantity import Quantity
from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Status, Topic
from rotorid.flights.controllers import controller_as_logged, controllers_of
from rotorid.flights.whole_flights import flown
from rotorid.flying.simulation import everyday_plan
from rotorid.models.rotors import library_layout
from rotorid.reviewing.loops import LOOPS, loop_of
from rotorid.reviewing.margins import margins
from rotorid.simulation.autopilot import Autopilot, Guidance, RateLoop
from rotorid.simulation.linearization import hover_derivatives_of
from rotorid.simulation.multirotor import PERFECT, Multirotor, Rotors, Sensors
from rotorid.simulation.multirotor_flight import Aircraft, fly_multirotor, piloted
from rotorid.simulation.wind import CALM, Wind
from rotorid.typing import ComplexArray, FloatArray
from rotorid.vehicles.catalog import aircraft

GAINS: Mapping[str, tuple[float, float, float]] = {
    "px4_quad": (0.6, 1.0, 1.5),
    "x500": (0.6, 1.0, 1.5),
    "ardupilot_quad": (0.35, 0.5, 0.7),
    "acro": (0.6, 1.0, 1.4),
}
"""Factors on the gains of the rate loops; those of the ArduPilot vehicle are near their limit at one."""

WINDS = (0.0, 3.0, 4.0, 6.0)
LEVELS = (0.5, 0.25)
STICK_HZ = {"px4_quad": 5.0, "x500": 50.0, "ardupilot_quad": 10.0}
"""At which each log holds the stick: as PX4's and ArduPilot's usual settings do."""

FIRMWARE = {"px4_quad": "PX4 v1.14.0", "x500": "PX4 v1.14.0", "ardupilot_quad": "ArduCopter V4.5.0"}

ACRO_RATE_RAD_S = 4.0
PERIOD_S, HARMONICS, RMS_RAD_S = 20.0, 110, 0.01
SMOOTHING = 0.12
PERIODS = 2

CHANNELS = (
    tuple(f"{name}{kind}" for name in ("p", "q", "r", "phi", "theta", "psi") for kind in ("", "_setpoint"))
    + tuple(f"{axis}_command" for axis in ("roll", "pitch", "yaw", "thrust"))
    + tuple(f"motor_{n}" for n in range(1, 5))
)


@dataclass(frozen=True, kw_only=True)
class Case:
    """One flight of the study."""

    vehicle: str
    gain: float
    wind_m_s: float
    level: float
    duration_s: float
    seed: int

    @property
    def acro(self) -> bool:
        return self.vehicle == "acro"

    @property
    def wind(self) -> Wind:
        return Wind(north_m_s=self.wind_m_s, turbulence_m_s=0.2 * self.wind_m_s) if self.wind_m_s else CALM


def cases(*, seed: int = 1000, levels: tuple[float, ...] = LEVELS, winds: tuple[float, ...] = WINDS) -> Iterator[Case]:
    """The 96 flights: four vehicles, three gain sets, four winds, two stick levels; 60 and 120 s in turn."""
    number = 0
    for vehicle, gains in GAINS.items():
        for gain in gains:
            for wind_m_s in winds:
                for level in levels:
                    yield Case(
                        vehicle=vehicle,
                        gain=gain,
                        wind_m_s=wind_m_s,
                        level=level,
                        duration_s=60.0 if (number + number // 2) % 2 else 120.0,
                        seed=seed + number,
                    )
                    number += 1


def five_inch() -> Aircraft:
    """An acro quadrotor of five inches at 1 kHz: delay 3 ms, lag 20 ms, and nothing that makes its thrust linear.

    Its pilot is stood in for by an angle loop of 2 rad/s.
    """
    vehicle = Multirotor(
        name="five_inch",
        mass_kg=0.65,
        inertia_kg_m2=np.array([0.0028, 0.0032, 0.0055]),
        rotors=Rotors(
            layout=library_layout("quad.x").scaled(0.11),
            thrust=(0.0, 0.0, 9.0),
            torque_per_thrust_m=0.012,
            lag_up_s=0.02,
        ),
        aerodynamics=np.diag([-0.25, -0.25, -0.25, -0.0005, -0.0005, -0.0005]),
    )
    slack = Autopilot(
        kind="simple",
        rate_hz=1000.0,
        rates=RateLoop(proportional=(0.1, 0.1, 0.1)),
        angle_1_s=(2.0, 2.0, 1.0),
        gyro_cutoff_hz=150.0,
        delay_s=(0.003,) * 4,
        guidance=Guidance(tilt_limit_rad=1.0),
    )
    known = hover_derivatives_of(vehicle, slack)
    roll, pitch, yaw = (abs(known[name]) for name in ("L_roll", "M_pitch", "N_yaw"))
    gains = np.array([55.0 / roll, 55.0 / pitch, 20.0 / yaw])
    rates = RateLoop(
        proportional=tuple(gains.tolist()),
        integral=tuple((2.0 * gains).tolist()),
        derivative=tuple((0.012 * gains * [1.0, 1.0, 0.0]).tolist()),
        derivative_cutoff_hz=(80.0, 80.0, 80.0),
    )
    return Aircraft(vehicle=vehicle, autopilot=replace(slack, rates=rates), sensors=Sensors(gyro_noise_rad_s=0.03))


def _times(values: tuple[float, float, float], factor: float) -> tuple[float, float, float]:
    return values[0] * factor, values[1] * factor, values[2] * factor


@cache
def craft_of(vehicle: str, gain: float) -> Aircraft:
    """A vehicle with all gains of its roll, pitch and yaw rate loops times a factor."""
    craft = five_inch() if vehicle == "acro" else aircraft(vehicle)
    if vehicle == "x500":
        craft = replace(craft, sensors=replace(craft.sensors, gyro_noise_rad_s=0.02))
    craft = replace(craft, sensors=replace(craft.sensors, gyro_vibration_rad_s=0.1))
    rates = craft.autopilot.rates
    rates = replace(
        rates,
        proportional=_times(rates.proportional, gain),
        integral=_times(rates.integral, gain),
        derivative=_times(rates.derivative, gain),
    )
    return piloted(replace(craft, autopilot=replace(craft.autopilot, rates=rates)))


def multisine_input(rate_hz: float, duration_s: float) -> PlannedInput:
    """110 harmonics of a period of 20 s from 0.3 to 280 rad/s on the set-point of the roll rate."""
    lines = harmonics()
    count = round(PERIOD_S * rate_hz)
    phases = -np.pi * np.arange(lines.size) ** 2 / lines.size
    spectrum = np.zeros(count // 2 + 1, dtype=complex)
    spectrum[lines] = np.exp(1j * phases)
    period = np.fft.irfft(spectrum, count)
    period *= RMS_RAD_S / period.std()
    values = np.resize(period, round(duration_s * rate_hz))
    return PlannedInput(
        axis="roll",
        shape="multisine",
        start_s=0.0,
        values=values,
        sample_rate_hz=rate_hz,
        amplitude=float(np.abs(period).max()),
        entry="rate_setpoint",
    )


def harmonics() -> np.ndarray:
    base = 2.0 * np.pi / PERIOD_S
    found = np.geomspace(1.0, 280.0 / base, HARMONICS)
    # Low ones that round to the same line move up to the next free one.
    lines: list[int] = []
    for value in found:
        lines.append(max(round(float(value)), lines[-1] + 1 if lines else 1))
    return np.array(lines)


def stick_plan(case: Case) -> FlightPlan:
    """Sticks; in acro those of roll, pitch and yaw are set-points of rates."""
    craft = craft_of(case.vehicle, case.gain)
    plan = everyday_plan(craft, duration_s=case.duration_s, level=case.level, seed=case.seed)
    if not case.acro:
        return plan
    inputs = tuple(
        one if one.axis == "thrust" else replace(one, entry="rate_setpoint", values=ACRO_RATE_RAD_S * one.values)
        for one in plan.inputs
    )
    return replace(plan, inputs=inputs)


def fly(case: Case, *, quiet: bool = False, disturbed: bool = False) -> SimulatedFlight:
    craft, plan = craft_of(case.vehicle, case.gain), stick_plan(case)
    if quiet:
        craft = replace(craft, sensors=PERFECT)
    if disturbed:
        plan = replace(plan, inputs=(*plan.inputs, multisine_input(craft.autopilot.rate_hz, case.duration_s)))
    return fly_multirotor(craft, plan, wind=case.wind, seed=case.seed)


def record_of(case: Case, flight: SimulatedFlight, *, log_hz: float | None = None) -> FlightRecord:
    """The flight as its autopilot would log it, with the sticks on their own slow clock."""
    stride = 1 if log_hz is None else round(flight.sample_rate_hz / log_hz)
    rows = [name for name in CHANNELS if name in flight.columns]
    main = _topic("loops", flight, rows, stride)
    topics = [main]
    sticks = [f"{axis}_stick" for axis in ("roll", "pitch", "yaw", "thrust") if f"{axis}_stick" in flight.columns]
    if sticks and not case.acro:
        topics.append(_topic("sticks", flight, sticks, round(flight.sample_rate_hz / STICK_HZ[case.vehicle])))
    whole = ((0.0, float(flight.time_s[-1])),)
    status = Status(
        vehicle="multirotor", armed=whole, in_air=whole, flagged_in="twin", direct_rates=whole if case.acro else ()
    )
    source = Source(name="twin", format="twin", sha256="", firmware=FIRMWARE.get(case.vehicle, ""))
    return FlightRecord(source=source, topics=tuple(topics), status=status, parameters=parameters_of(case))


_SCALED = ("P", "I", "D")
_GAINS_OF = {
    "PX4": tuple(f"MC_{axis}RATE_{term}" for axis in ("ROLL", "PITCH", "YAW") for term in _SCALED),
    "ArduCopter": tuple(f"ATC_RAT_{axis}_{term}" for axis in ("RLL", "PIT", "YAW") for term in _SCALED),
}


def parameters_of(case: Case) -> dict[str, float]:
    """Parameters of the autopilot with the gains that flew; none of the acro vehicle, whose controller no log tells."""
    if case.acro:
        return {}
    known = dict(aircraft(case.vehicle).autopilot.parameters)
    scaled = _GAINS_OF["ArduCopter" if case.vehicle == "ardupilot_quad" else "PX4"]
    return known | {name: case.gain * known[name] for name in scaled if name in known}


def _topic(name: str, flight: SimulatedFlight, rows: list[str], stride: int) -> Topic:
    return Topic(
        name=name,
        time_s=flight.time_s[::stride],
        channels=tuple(Channel(name=row, unit=STANDARD_UNITS[row]) for row in rows),
        values=np.stack([flight.columns[row][::stride] for row in rows]),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Truth:
    """What was true along a flight, on the frequencies of the multisine."""

    omega_rad_s: FloatArray
    closed: ComplexArray
    plant: ComplexArray
    time_s: FloatArray
    step: FloatArray

    @property
    def numbers(self) -> dict[str, float]:
        omega = np.geomspace(self.omega_rad_s[0], self.omega_rad_s[-1], 20_000)
        values = smooth_at(self.omega_rad_s, self.closed, omega)
        magnitude, phase = np.abs(values), np.unwrap(np.angle(values))
        bandwidth = _first(omega, phase < -0.5 * math.pi)
        # From a fifth of it on, as it is defined.
        high = omega >= 0.2 * min(bandwidth, omega[-1])
        inside = self.time_s <= 1.0
        fine = np.linspace(0.0, 1.0, 20_001)
        step = np.interp(fine, self.time_s[inside], self.step[inside])
        rise = _first(fine, step >= 0.9) - _first(fine, step >= 0.1)
        return {
            "rise_time_s": rise if math.isfinite(rise) else math.inf,
            "delay_s": _first(fine, step >= 0.5),
            "overshoot_percent": 100.0 * max(float(step.max()) - 1.0, 0.0),
            "bandwidth_90deg_rad_s": bandwidth,
            "bandwidth_3db_rad_s": _first(omega[high], magnitude[high] < 10.0 ** (-0.15)),
            "peak_db": 20.0 * math.log10(float(magnitude[high].max())),
        }


def _first(places: FloatArray, passed: np.ndarray) -> float:
    return float(places[passed.argmax()]) if passed.any() else math.inf


def smooth_at(omega: FloatArray, values: ComplexArray, at: FloatArray) -> ComplexArray:
    """Cubic splines of logarithm and phase: straight lines between 110 points err as much as a review does."""
    from scipy.interpolate import CubicSpline

    logs = np.log(np.abs(values)) + 1j * np.unwrap(np.angle(values))
    spline = CubicSpline(np.log(omega), np.stack([logs.real, logs.imag]), axis=1)
    real, imaginary = spline(np.log(at))
    return np.asarray(np.exp(real + 1j * imaginary))


def _lines_of(flight: SimulatedFlight, name: str, before: FloatArray | float = 0.0) -> ComplexArray:
    """Fourier coefficients of the harmonics over the last two periods."""
    count = PERIODS * round(PERIOD_S * flight.sample_rate_hz)
    signal = (flight.columns[name] - before)[-count:]
    return np.asarray(np.fft.rfft(signal)[PERIODS * harmonics()])


@cache
def hover_truth(vehicle: str, gain: float) -> tuple[ComplexArray, ComplexArray, FloatArray, FloatArray]:
    """Closed loop and plant about hover, and the answer to a step without outer loops: times, values."""
    craft = replace(craft_of(vehicle, gain), sensors=PERFECT)
    rate_hz = craft.autopilot.rate_hz
    plan = FlightPlan(name="lines", inputs=(multisine_input(rate_hz, 60.0),), trim_s=0.0)
    flown = fly_multirotor(craft, plan, seed=0)
    rate, asked, command = (_lines_of(flown, name) for name in ("p", "p_setpoint", "roll_command"))
    guidance = replace(craft.autopilot.guidance, hold_velocity=False)
    free = replace(craft, autopilot=replace(craft.autopilot, angle_1_s=(0.0, 0.0, 0.0), guidance=guidance))
    size, wait_s = 0.05, 0.5
    held = PlannedInput(
        axis="roll",
        shape="doublet",
        start_s=wait_s,
        values=np.full(round(3.0 * rate_hz), size),
        sample_rate_hz=rate_hz,
        amplitude=size,
        entry="rate_setpoint",
    )
    stepped = fly_multirotor(free, FlightPlan(name="step", inputs=(held,), trim_s=0.0), seed=0)
    first = int(np.flatnonzero(np.abs(stepped.columns["p_setpoint"]) > 0.5 * size)[0])
    answer = (stepped.columns["p"][first:] - stepped.columns["p"][first - 1]) / size
    time_s = (np.arange(answer.size) + 0.5) / rate_hz
    return rate / asked, rate / command, np.concatenate([[0.0], time_s]), np.concatenate([[0.0], answer])


@cache
def hover_delay(vehicle: str, gain: float, name: str) -> float:
    """Time to half of a small step of roll angle (``phi``) or yaw rate (``r``) about hover, without outer loops."""
    craft = replace(craft_of(vehicle, gain), sensors=PERFECT)
    rate_hz, angle_1_s = craft.autopilot.rate_hz, craft.autopilot.angle_1_s
    if name == "r":
        angle_1_s = (angle_1_s[0], angle_1_s[1], 0.0)
    guidance = replace(craft.autopilot.guidance, hold_velocity=False)
    # Flights are compared with the set-point that the loop gets: no step may be shaped on its way there.
    plain = replace(craft.autopilot, angle_1_s=angle_1_s, guidance=guidance, parameters={"ATC_RATE_FF_ENAB": 0.0})
    free = replace(craft, autopilot=plain)
    size = 0.03
    held = PlannedInput(
        axis="yaw" if name == "r" else "roll",
        shape="doublet",
        start_s=0.5,
        values=np.full(round(3.0 * rate_hz), size),
        sample_rate_hz=rate_hz,
        amplitude=size,
        entry="rate_setpoint" if name == "r" else "attitude_setpoint",
    )
    stepped = fly_multirotor(free, FlightPlan(name="step", inputs=(held,), trim_s=0.0), seed=0)
    asked, answer = stepped.columns[f"{name}_setpoint"], stepped.columns[name]
    first = int(np.flatnonzero(np.abs(asked - asked[0]) > 0.5 * size)[0])
    share = (answer[first:] - answer[first - 1]) / (asked[first] - asked[first - 1])
    past = int((share >= 0.5).argmax())
    between = (0.5 - share[past - 1]) / (share[past] - share[past - 1])
    return float((past - 1 + between + 0.5) / rate_hz)


def truth_of(case: Case) -> Truth:
    """What was true along the flight of a case."""
    closed, plant, time_s, step = hover_truth(case.vehicle, case.gain)
    plain, moved = fly(case, quiet=True), fly(case, quiet=True, disturbed=True)
    rate, asked, command = (_lines_of(moved, name, plain.columns[name]) for name in ("p", "p_setpoint", "roll_command"))
    omega = 2.0 * np.pi / PERIOD_S * harmonics()
    low = omega < 0.25 * _first(omega, np.unwrap(np.angle(closed)) < -0.5 * math.pi)
    along = closed * _smoothed(omega, rate / asked / closed, low)
    fine = np.linspace(omega[0], omega[-1], 20_000)
    change = smooth_at(omega, along, fine) - smooth_at(omega, closed, fine)
    spacing = fine[1] - fine[0]
    moved_by = np.array([np.sum(change.real * np.sin(fine * t) / fine) * spacing * 2.0 / np.pi for t in time_s])
    return Truth(
        omega_rad_s=omega,
        closed=along,
        plant=plant * _smoothed(omega, rate / command / plant, low),
        time_s=time_s,
        step=step + moved_by,
    )


def _smoothed(omega: FloatArray, ratio: ComplexArray, low: np.ndarray) -> ComplexArray:
    """A ratio to hover, averaged over the logarithm of frequency, and one where sidebands of gusts blur it."""
    logs = np.where(low, 0.0, np.log(ratio))
    distance = np.subtract.outer(np.log(omega), np.log(omega)) / SMOOTHING
    weight = np.exp(-0.5 * distance**2)
    mean = weight @ logs / weight.sum(axis=1)
    return np.asarray(np.exp(np.where(low, 0.0, mean)))


def margins_of(loop: ComplexArray, omega: FloatArray) -> dict[str, float]:
    """Crossover, margins and the peak of the sensitivity of a broken loop, lowest crossovers first."""
    magnitude, phase = np.abs(loop), np.unwrap(np.angle(loop))
    # The phase of a rate loop with integral lies between -180 and 0 degrees where it begins.
    phase -= 2.0 * np.pi * np.round((phase[0] + 0.5 * np.pi) / (2.0 * np.pi))
    crossings = np.flatnonzero((magnitude[:-1] >= 1.0) & (magnitude[1:] < 1.0))
    turns = np.flatnonzero((phase[:-1] >= -np.pi) & (phase[1:] < -np.pi))
    found = {"sensitivity_peak": float(np.abs(1.0 / (1.0 + loop)).max())}
    if crossings.size:
        last = int(crossings[-1])
        found["crossover_rad_s"] = float(omega[last])
        found["phase_margin_deg"] = math.degrees(float(phase[last]) + math.pi)
    if turns.size:
        found["gain_margin_db"] = -20.0 * math.log10(float(magnitude[turns[0]]))
    return found


@dataclass(frozen=True, kw_only=True)
class Score:
    """A number as it was told, or not, and the truth."""

    told: Quantity | None
    truth: float
    by_model: bool = False


def scores(case: Case) -> dict[str, Score]:
    """Numbers of the roll rate loop and of its margins against the truth of the flight."""
    truth = truth_of(case)
    record = record_of(case, fly(case))
    flight = flown(record)
    seen, _ = loop_of(flight, LOOPS[0])
    numbers = {} if seen is None else seen.numbers
    found = {name: Score(told=numbers.get(name), truth=value) for name, value in truth.numbers.items()}
    if case.acro:
        return found
    settings = controllers_of(record).axis("roll")
    assert settings is not None
    controller = controller_as_logged(record, settings.controller.rate_loop, source="")
    omega = np.geomspace(2.0, truth.omega_rad_s[-1], 5_000)
    known = margins_of(smooth_at(truth.omega_rad_s, truth.plant, omega) * controller.response(omega), omega)
    told, _ = margins(flight)
    roll = told.get("roll")
    for name, value in known.items():
        quantity = None if roll is None else roll.numbers.get(name)
        found[name] = Score(told=quantity, truth=value, by_model=roll is not None and name in roll.by_model)
    return found
