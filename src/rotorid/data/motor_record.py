"""A flight as the physics of motors needs it: outputs, rates, specific force on one clock."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from rotorid.data.immutable import Immutable, read_only
from rotorid.errors import UsageError
from rotorid.typing import FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class MotorRecord(Immutable):
    """Motor outputs and what the vehicle did, sample by sample.

    Parameters
    ----------
    name
        Where it comes from.
    sample_rate_hz
        Of everything.
    outputs
        Of the motors, each held until the next sample, shape ``(motors, n)``.
    rates
        Body rates p, q, r in rad/s, shape ``(3, n)``.
    az
        Specific force along the body's z axis in m/s², shape ``(n,)``; -9.81 in hover.
    w
        Velocity along the body's z axis in m/s, shape ``(n,)``; empty where it was not logged.
    strength
        Thrust at a given output relative to that at the reference voltage, shape ``(n,)``; one by default.
    gyro_taps, accel_taps
        Impulse responses, at this rate, of known filters that rates and specific force have passed; none by default.
    start_s
        Time of the first sample on the log's own clock.

    Raises
    ------
    UsageError
        Lengths differ, or a sample is no number.
    """

    name: str
    sample_rate_hz: float
    outputs: FloatArray
    rates: FloatArray
    az: FloatArray
    w: FloatArray = field(default_factory=lambda: np.zeros(0))
    strength: FloatArray = field(default_factory=lambda: np.zeros(0))
    gyro_taps: FloatArray = field(default_factory=lambda: np.ones(1))
    accel_taps: FloatArray = field(default_factory=lambda: np.ones(1))
    start_s: float = 0.0

    def __post_init__(self) -> None:
        outputs, rates = (read_only(values, np.float64, ndim=2) for values in (self.outputs, self.rates))
        samples = outputs.shape[1]
        strength = self.strength if self.strength.size else np.ones(samples)
        az, w, strength = (read_only(values, np.float64, ndim=1) for values in (self.az, self.w, strength))
        sizes = {"rates": rates.shape[1], "az": az.size, "w": w.size or samples, "strength": strength.size}
        for name, size in sizes.items():
            if size != samples:
                raise UsageError(f"{self.name} has {size} samples of {name} and {samples} of motor outputs")
        if not all(np.isfinite(values).all() for values in (outputs, rates, az, w, strength)):
            raise UsageError(f"{self.name} holds samples that are no numbers", needed="records without gaps")
        gyro, accel = (read_only(taps, np.float64, ndim=1) for taps in (self.gyro_taps, self.accel_taps))
        self._set(outputs=outputs, rates=rates, az=az, w=w, strength=strength, gyro_taps=gyro, accel_taps=accel)

    @property
    def samples(self) -> int:
        return int(self.outputs.shape[1])

    @property
    def duration_s(self) -> float:
        return self.samples / self.sample_rate_hz

    @property
    def time_s(self) -> FloatArray:
        return self.start_s + np.arange(self.samples) / self.sample_rate_hz
