"""Flights whose gyro is known tone by tone, and whose filters run sample by sample as the firmware runs them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter
from tests.twins.filter_kernels import filtered

from rotorid.autopilots.notches import Motion, MovingNotches
from rotorid.autopilots.registry import autopilot_of
from rotorid.data.axes import RATE_OF
from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Status, Topic
from rotorid.signal.autopilot_filters import controller_filters
from rotorid.typing import FloatArray

SECONDS = 30.0
MOTION_HZ = 1.5
"""Corner of the motion of the vehicle, of second order."""

SPREAD_HZ = (-2.0, -0.7, 0.8, 2.1)
"""Speeds of the four motors around their mean."""


@dataclass(frozen=True, kw_only=True)
class Craft:
    """A vehicle by its noise: amplitudes in rad/s."""

    format: str
    firmware: str
    parameters: Mapping[str, float]
    sensor_hz: float
    log_hz: float
    tones: tuple[float, ...] = (0.35, 0.15)
    """Of each rotor's first, second … harmonic."""
    frame_hz: float = 0.0
    frame: float = 0.0
    white: float = 0.02
    """Standard deviation in each sample of a kilohertz."""
    speeds: bool = True
    slow_hz: float = 60.0
    """Speed of the rotors at no throttle."""
    centers: bool = False
    """Whether the spectrum shows the mean speed, and the log says so: where a notch by the spectrum is."""


SOURCES = {
    "PX4 ULog": "vehicle_angular_velocity.xyz[{}]",
    "ArduPilot DataFlash": "RATE.{}",
    "Betaflight blackbox": "gyroADC[{}]",
}
ROWS = {"ArduPilot DataFlash": ("R", "P", "Y")}


def turns_hz(throttle: FloatArray, craft: Craft) -> FloatArray:
    """Turns per second of the four motors, shape ``(4, n)``; thrust goes with their square."""
    mean = craft.slow_hz + 130.0 * np.sqrt(throttle)
    return np.stack([mean + offset for offset in SPREAD_HZ])


def through_moving(values: FloatArray, notches: MovingNotches) -> FloatArray:
    """Samples of three axes, shape ``(3, n)``, behind notches with other coefficients in each of them."""
    found = np.ascontiguousarray(values)
    for center, alpha, floor in zip(notches.center_hz, notches.damping, notches.floor, strict=True):
        middle = -2.0 * np.cos(2.0 * np.pi * center / notches.rate_hz)
        b0, b2, a0, a2 = 1.0 + alpha * floor, 1.0 - alpha * floor, 1.0 + alpha, 1.0 - alpha
        found = filtered(found, b0, middle, b2, a0, a2)
    return found


def fly(craft: Craft, *, seed: int = 1, seconds: float = SECONDS, **changed: float) -> FlightRecord:
    """The log of a flight with other parameters than the vehicle's own."""
    rng, count = np.random.default_rng(seed), round(seconds * craft.sensor_hz)
    time_s = np.arange(count) / craft.sensor_hz
    throttle = 0.35 + 0.15 * np.sin(2.0 * np.pi * time_s / 11.0 + seed)
    turns = turns_hz(throttle, craft)
    phases = 2.0 * np.pi * np.cumsum(turns, axis=1) / craft.sensor_hz
    gyro = np.empty((3, count))
    for axis in range(3):
        tones = sum(
            size * np.sin((order + 1) * phase + rng.uniform(0.0, 6.28))
            for order, size in enumerate(craft.tones)
            for phase in phases
        )
        # A resonance: noise that rings.
        pole = np.exp(-2.0 * np.pi * 1.5 / craft.sensor_hz) * np.exp(2j * np.pi * craft.frame_hz / craft.sensor_hz)
        rung = lfilter([1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], rng.normal(size=count))
        slow = np.exp(-2.0 * np.pi * MOTION_HZ / craft.sensor_hz)
        motion = lfilter([1.0], [1.0, -2.0 * slow, slow**2], rng.normal(size=count))
        motion *= 0.1 / motion.std()
        noise = craft.white * np.sqrt(craft.sensor_hz / 1000.0) * rng.normal(size=count)
        gyro[axis] = tones + craft.frame * rung / rung.std() + motion + noise
    source = Source(name="flight.log", format=craft.format, sha256="", firmware=craft.firmware)
    parameters = {**craft.parameters, **changed}
    bare = FlightRecord(source=source, topics=(), parameters=parameters)
    rates = gyro
    for known in controller_filters(bare):
        assert known.rate_hz == craft.sensor_hz
        rates = lfilter(known.numerator, known.denominator, rates)
    centers = turns.mean(axis=0)[None]
    motion_of = Motion(turns, throttle, centers if craft.centers else None)
    notches = autopilot_of(bare).log.moving_notches(bare, motion_of)
    assert notches.rate_hz in (1.0, craft.sensor_hz)
    rates = through_moving(rates, notches)
    step = round(craft.sensor_hz / craft.log_hz)
    kept = slice(None, None, step)
    letters = ROWS.get(craft.format, (0, 1, 2))
    of_rates = tuple(
        Channel(name=rate, unit="rad/s", source=SOURCES[craft.format].format(letter))
        for rate, letter in zip(RATE_OF.values(), letters, strict=True)
    )
    names = [f"motor_{k + 1}" for k in range(4)] + ["thrust_command"]
    names += [f"motor_speed_{k + 1}" for k in range(4)] if craft.speeds else []
    names += ["notch_frequency_1"] if craft.centers else []
    others = [throttle] * 5 + ([*(2.0 * np.pi * turns)] if craft.speeds else [])
    others += [*(2.0 * np.pi * centers)] if craft.centers else []
    channels = tuple(Channel(name=name, unit=STANDARD_UNITS[name], source=f"twin.{name}") for name in names)
    topics = (
        Topic(name="gyro", time_s=time_s[kept], channels=of_rates, values=rates[:, kept]),
        Topic(name="twin", time_s=time_s[kept], channels=channels, values=np.stack(others)[:, kept]),
    )
    status = Status(in_air=((0.0, float(time_s[-1])),), flagged_in="twin", modes=(("acro", 0.0, float(time_s[-1])),))
    return FlightRecord(source=source, topics=topics, status=status, parameters=parameters)
