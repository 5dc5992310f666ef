"""A flight around hover: two sweeps on every axis, then doublets that the model has not seen."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from rotorid.data.record import Kind, Maneuver
from rotorid.excitation.sweep import pilot_sweep
from rotorid.excitation.switching import doublet
from rotorid.simulation.hover_flight import STEP_RATE_HZ, Excitation
from rotorid.typing import Axis, FloatArray

SWEEP_BAND_RAD_S = (2.0 * math.pi * 0.1, 2.0 * math.pi * 8.0)
SWEEP_S = 50.0
SWEEPS = 2
FADE_S = 0.5
TRIM_S = 3.0
# Short, because an open-loop prediction of an unstable vehicle multiplies every error by ten in 0.8 s.
PULSE_S = 0.3
DOUBLET_TRIM_S = 0.5
# As much as keeps the tilt below 0.4 rad and the commands well inside their limits.
SWEEP_AMPLITUDE: Mapping[Axis, float] = {"roll": 0.035, "pitch": 0.04, "yaw": 0.1, "thrust": 0.1}
DOUBLET_AMPLITUDE: Mapping[Axis, float] = {"roll": 0.045, "pitch": 0.05, "yaw": 0.15, "thrust": 0.15}


def demo_plan(*, rng: np.random.Generator) -> tuple[Excitation, ...]:
    """Test inputs of the demonstration, about eight minutes.

    Every axis is swept twice in a row from 0.1 to 8 Hz, with other noise each time, so that the two add information;
    then every axis gets a doublet of each sign. All are added to the commands after the controller, as ArduPilot's
    system identification mode does, and contain no feedback.

    Parameters
    ----------
    rng
        Random generator of the noise on the sweeps.

    Examples
    --------
    >>> plan = demo_plan(rng=np.random.default_rng(0))
    >>> len(plan), plan[0].maneuver.axis, round(plan[-1].maneuver.stop_s)
    (16, 'roll', 461)
    """
    # The clock counts steps, so that a time is rounded once and not with every maneuver.
    clock = 0
    plan: list[Excitation] = []
    for axis, kind, values in _signals(rng):
        start = clock + round(TRIM_S * STEP_RATE_HZ)
        clock = start + values.size
        maneuver = Maneuver(
            axis=axis,
            kind=kind,
            start_s=start / STEP_RATE_HZ,
            stop_s=clock / STEP_RATE_HZ,
            band_rad_s=SWEEP_BAND_RAD_S if kind == "sweep" else None,
            origin="declared",
            signal=f"{axis}_excitation",
        )
        plan.append(Excitation(maneuver=maneuver, values=values, sample_rate_hz=STEP_RATE_HZ))
    return tuple(plan)


def _signals(rng: np.random.Generator) -> list[tuple[Axis, Kind, FloatArray]]:
    sweeps: list[tuple[Axis, Kind, FloatArray]] = [
        (axis, "sweep", _sweep(amplitude, rng)) for axis, amplitude in SWEEP_AMPLITUDE.items() for _ in range(SWEEPS)
    ]
    doublets: list[tuple[Axis, Kind, FloatArray]] = [
        (axis, "doublet", _doublet(amplitude * sign))
        for axis, amplitude in DOUBLET_AMPLITUDE.items()
        for sign in (1.0, -1.0)
    ]
    return sweeps + doublets


def _sweep(amplitude: float, rng: np.random.Generator) -> FloatArray:
    return pilot_sweep(
        amplitude=amplitude,
        band_rad_s=SWEEP_BAND_RAD_S,
        duration_s=SWEEP_S,
        sample_rate_hz=STEP_RATE_HZ,
        fade_s=FADE_S,
        trim_s=0.0,
        noise_fraction=0.1,
        rng=rng,
    )


def _doublet(amplitude: float) -> FloatArray:
    return doublet(amplitude=amplitude, pulse_s=PULSE_S, sample_rate_hz=STEP_RATE_HZ, trim_s=DOUBLET_TRIM_S)
