"""Step responses of the attitude with any gains, on all likely plants."""

from __future__ import annotations

import numpy as np

from rotorid.data.record import FlightRecord
from rotorid.proposing.flown_gains import FlownLoop
from rotorid.tuning.kinds import KINDS
from rotorid.tuning.loops import Gains
from rotorid.tuning.plant import UncertainPlant
from rotorid.typing import FloatArray, LoopName

_SAMPLES = 4096


def step_times_s(loop: LoopName = "roll") -> FloatArray:
    """Seconds of the samples of :func:`attitude_steps`, shape ``(n,)``."""
    kind = KINDS[loop]
    return np.asarray(np.arange(round(kind.step_shown_s * kind.step_rate_hz)) / kind.step_rate_hz, dtype=np.float64)


def attitude_steps(
    flown: FlownLoop, plant: UncertainPlant, gains: Gains, *, then: FlightRecord | None = None
) -> FloatArray:
    """Attitude after a step of its set-point, or the angle after a step of the rate where no angle loop is closed.

    Of an outer loop the position, or the velocity.

    Of loops that are stable: of others the response has no steady state, and the result means nothing.

    Parameters
    ----------
    flown, plant
        The controller as logged, and the plant with its draws.
    gains
        Those of the loop.
    then
        The log with the filters of the loop; by default those that flew.

    Returns
    -------
    array
        Shape ``(draws, n)``.
    """
    rate_hz, shown = KINDS[flown.axis].step_rate_hz, step_times_s(flown.axis).size
    omega = np.asarray(2.0 * np.pi * np.fft.rfftfreq(_SAMPLES, 1.0 / rate_hz), dtype=np.float64)
    omega[0] = omega[1] * 1e-3
    drawn, parts = plant.drawn(omega), flown.parts(omega, then=then)
    by_setpoint = drawn * (parts.angle(gains) if gains.A > 0.0 else parts.rate(gains))
    impulse = np.fft.irfft(by_setpoint / (1.0 + drawn * parts.whole(gains)), n=_SAMPLES, axis=1)
    return np.asarray(np.cumsum(impulse, axis=1)[:, :shown])
