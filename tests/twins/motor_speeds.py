"""Logs of motors whose lag, curve and voltage are known: outputs of a loop of 1 kHz, speeds with a sensor's noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Topic

LOOP_HZ = 1000.0
_WANDER_S = 0.08


@dataclass(frozen=True, kw_only=True)
class Motors:
    """Motors of a twin: speed at an output of 0.5, its slope and curve there, lags, voltage, noise and gusts.

    Sensors have a scale of their own for each motor.
    """

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
    scales: tuple[float, ...] = (1.0,)

    def steady(self, output: np.ndarray) -> np.ndarray:
        """Speed of a mean motor at an output and the mean voltage, rad/s."""
        about = output - 0.5
        return self.speed + self.slope * about + self.curve * about**2


def record_of(
    motors: Motors, *, rate_hz: float, duration_s: float, seed: int, swing: float = 0.12, wander_s: float = _WANDER_S
) -> FlightRecord:
    """Outputs that wander, held for a loop, and the speeds that follow them by exact exponentials; logged at a rate."""
    rng = np.random.default_rng(seed)
    count, size, thin = round(duration_s * LOOP_HZ), len(motors.factors), round(LOOP_HZ / rate_hz)
    outputs = (0.5 + swing * _wandering(rng, (size, count), wander_s)).clip(0.05, 0.95)
    volts = 16.0 * (1.0 - motors.sag * np.linspace(0.0, 1.0, count))
    steady = np.array(motors.factors)[:, None] * motors.steady(outputs) * (volts / volts.mean()) ** motors.exponent
    steady = steady + motors.gusts * _wandering(rng, (size, count), 0.1)
    speeds, speed = np.empty((size, count)), steady[:, 0]
    keep_up, keep_down = (np.exp(-1.0 / (LOOP_HZ * lag_s)) for lag_s in (motors.lag_up_s, motors.lag_down_s))
    for sample in range(count):
        speeds[:, sample] = speed
        error = speed - steady[:, sample]
        speed = steady[:, sample] + error * np.where(error < 0.0, keep_up, keep_down)
    speeds = speeds[:, ::thin]
    speeds = speeds * np.array(motors.scales)[:, None] + motors.noise * rng.normal(size=speeds.shape)
    names = [*(f"motor_{k + 1}" for k in range(size)), *(f"motor_speed_{k + 1}" for k in range(size))]
    names.append("battery_voltage")
    channels = tuple(Channel(name=name, unit=STANDARD_UNITS[name]) for name in names)
    values = np.vstack([outputs[:, ::thin], speeds, volts[None, ::thin]])
    topic = Topic(name="bench", time_s=np.arange(values.shape[1]) * thin / LOOP_HZ, channels=channels, values=values)
    return FlightRecord(source=Source(name=f"bench_{seed}.csv", format="CSV", sha256=f"{seed}"), topics=(topic,))


def _wandering(rng: np.random.Generator, shape: tuple[int, int], lag_s: float) -> np.ndarray:
    """Noise behind a first-order lag, of variance one."""
    from scipy.signal import lfilter

    keep = float(np.exp(-1.0 / (LOOP_HZ * lag_s)))
    return np.asarray(lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], rng.normal(size=shape), axis=1))
