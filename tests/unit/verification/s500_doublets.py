"""Doublets of the S500, flown in closed loop, with its right model and with wrong ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rotorid.data.record import STANDARD_UNITS, Channel, Maneuver, TimeHistory
from rotorid.excitation.switching import doublet
from rotorid.models.state_space import StateSpace
from rotorid.simulation.hover_flight import STEP_RATE_HZ, Excitation, Flight, fly
from rotorid.typing import Axis
from rotorid.vehicles import s500
from rotorid.verification.time_domain import verify_in_time
from rotorid.verification.verification import Verification

BAND = (0.6, 50.0)
PULSE_S, START_S, AROUND_S, REST_S = 0.3, 4.0, 3.5, 0.5
STOP_S = START_S + 2.0 * PULSE_S
LONGITUDINAL = ("q", "u", "w", "theta", "ax", "az")
LATERAL = ("p", "r", "v", "phi", "ay")
AMPLITUDES: dict[Axis, float] = {"pitch": 0.1, "thrust": 0.2, "roll": 0.1, "yaw": 0.3}
CALM_M_S = 0.01


def fly_doublet(axis: Axis, *, seed: int = 0, turbulence_m_s: float = CALM_M_S) -> Flight:
    values = doublet(amplitude=AMPLITUDES[axis], pulse_s=PULSE_S, sample_rate_hz=STEP_RATE_HZ, trim_s=0.0)
    maneuver = Maneuver(axis=axis, kind="doublet", start_s=START_S, stop_s=STOP_S, origin="declared")
    part = Excitation(maneuver=maneuver, values=values, sample_rate_hz=STEP_RATE_HZ)
    return fly(s500.vehicle(), (part,), turbulence_m_s=turbulence_m_s, rng=np.random.default_rng(seed))


def history(flight: Flight, names: tuple[str, ...], start_s: float, stop_s: float) -> TimeHistory:
    inside = (flight.time_s >= start_s - 1e-9) & (flight.time_s <= stop_s + 1e-9)
    return TimeHistory(
        values=np.stack([flight.columns[name][inside] for name in names]),
        channels=tuple(Channel(name=name, unit=STANDARD_UNITS[name]) for name in names),
        sample_rate_hz=flight.sample_rate_hz,
        start_s=float(flight.time_s[inside][0]),
    )


def parts(axis: Axis) -> tuple[tuple[str, ...], tuple[str, ...], StateSpace]:
    """Inputs, outputs and the true model of the motion that an axis drives."""
    if axis in ("pitch", "thrust"):
        return ("pitch_command", "thrust_command"), LONGITUDINAL, s500.longitudinal()
    return ("roll_command", "yaw_command"), LATERAL, s500.lateral()


def check(flight: Flight, model: StateSpace, *, rest_s: float = REST_S) -> Verification:
    (maneuver,) = flight.maneuvers
    inputs, outputs, _ = parts(maneuver.axis)
    names = (*inputs, *outputs)
    return verify_in_time(
        model,
        history(flight, names, START_S - rest_s, STOP_S + rest_s),
        inputs=inputs,
        outputs=outputs,
        band_rad_s=BAND,
        record="s500",
        maneuver=maneuver,
        around=history(flight, names, START_S - AROUND_S, STOP_S + AROUND_S),
    )


def scaled(model: StateSpace, *, row: int, column: int, factor: float, of: str = "G") -> StateSpace:
    matrix = getattr(model, of).copy()
    matrix[row, column] *= factor
    return replace(model, **{of: matrix})


def later(model: StateSpace, seconds: float) -> StateSpace:
    return replace(model, input_delays_s=model.input_delays_s + np.array([seconds, 0.0]))
