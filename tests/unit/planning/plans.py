"""Plans and loops that the tests of this layer share."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from rotorid.data.flight_plan import FlightPlan, PlannedInput
from rotorid.excitation.sweep import pilot_sweep
from rotorid.models.controller import RateController
from rotorid.models.library import rate_model
from rotorid.planning.loop import LoopModel, White, axis_loop
from rotorid.typing import Axis

BAND = (2.0 * math.pi * 0.2, 2.0 * math.pi * 8.0)
STRUCTURE = rate_model("rate.roll")
TRUTH = {"L_roll": 80.0, "L_p": -4.0, "T_motor": 0.05, "tau_roll": 0.006}
LOG_HZ = 100.0


def sweeps(
    amplitudes: Mapping[Axis, float], duration_s: float, *, count: int = 1, rest_s: float = 5.0, name: str = "sweeps"
) -> FlightPlan:
    """Sweeps of each axis, one after the other."""
    rng, start_s, parts = np.random.default_rng(1), rest_s, []
    for axis, amplitude in amplitudes.items():
        for _ in range(count):
            values = pilot_sweep(
                amplitude=amplitude,
                band_rad_s=BAND,
                duration_s=duration_s,
                sample_rate_hz=200.0,
                fade_s=0.5,
                trim_s=0.0,
                noise_fraction=0.1,
                rng=rng,
            )
            parts.append(
                PlannedInput(
                    axis=axis,
                    shape="pilot_sweep",
                    start_s=start_s,
                    values=values,
                    sample_rate_hz=200.0,
                    amplitude=amplitude,
                    band_rad_s=BAND,
                )
            )
            start_s = parts[-1].stop_s + rest_s
    return FlightPlan(name=name, inputs=tuple(parts), trim_s=rest_s)


def roll_loop(noise: float = 0.02, truth: Mapping[str, float] = TRUTH) -> LoopModel:
    """A rate loop with white noise at its output."""
    return axis_loop(
        STRUCTURE,
        truth,
        RateController(proportional_s=0.08, integral=0.1),
        White(std=(noise,), sample_rate_hz=LOG_HZ),
        log_rate_hz=LOG_HZ,
    )
