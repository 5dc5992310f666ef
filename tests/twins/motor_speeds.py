"""Logs of motors whose lag, curve and voltage are known: outputs as a loop sends them, speeds with a sensor's noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Topic


@dataclass(frozen=True, kw_only=True)
class Motors:
    """Motors of a twin: speed at an output of 0.5, its slope and curve there, lags, voltage and noise."""

    lag_up_s: float = 0.03
    lag_down_s: float = 0.045
    speed: float = 1200.0
    slope: float = 1500.0
    curve: float = -600.0
    factors: tuple[float, ...] = (1.02, 0.98)
    exponent: float = 1.0
    sag: float = 0.0
    noise: float = 5.0
    gusts: float = 0.0


def record_of(motors: Motors, *, rate_hz: float, duration_s: float, seed: int, swing: float = 0.12) -> FlightRecord:
    """Outputs that wander, held until the next sample, and the speeds that follow them by exact exponentials."""
    rng = np.random.default_rng(seed)
    count, size = round(duration_s * rate_hz), len(motors.factors)
    steps = rng.normal(size=(size, count))
    share = -np.expm1(-1.0 / (0.08 * rate_hz))
    outputs = np.empty((size, count))
    state = np.zeros(size)
    for sample in range(count):
        state = state + share * (steps[:, sample] * np.sqrt(2.0 / share) - state)
        outputs[:, sample] = 0.5 + swing * state
    outputs = outputs.clip(0.05, 0.95)
    volts = 16.0 * (1.0 - motors.sag * np.linspace(0.0, 1.0, count))
    pushed = motors.gusts * rng.normal(size=(size, count))
    speeds = np.empty((size, count))
    speed = None
    for sample in range(count):
        wanted = outputs[:, sample] - 0.5
        steady = np.array(motors.factors) * (motors.speed + motors.slope * wanted + motors.curve * wanted**2)
        steady = steady * (volts[sample] / volts.mean()) ** motors.exponent + pushed[:, sample]
        speed = steady if speed is None else speed
        speeds[:, sample] = speed
        lag_s = np.where(steady > speed, motors.lag_up_s, motors.lag_down_s)
        speed = steady + (speed - steady) * np.exp(-1.0 / (rate_hz * lag_s))
    speeds = speeds + motors.noise * rng.normal(size=speeds.shape)
    names = [*(f"motor_{k + 1}" for k in range(size)), *(f"motor_speed_{k + 1}" for k in range(size))]
    names.append("battery_voltage")
    channels = tuple(Channel(name=name, unit=STANDARD_UNITS[name]) for name in names)
    values = np.vstack([outputs, speeds, volts[None]])
    topic = Topic(name="bench", time_s=np.arange(count) / rate_hz, channels=channels, values=values)
    return FlightRecord(source=Source(name=f"bench_{seed}.csv", format="CSV", sha256=f"{seed}"), topics=(topic,))
