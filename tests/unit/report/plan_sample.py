"""Plans and facts that the tests of a plan's files share."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from rotorid.data.flight_plan import Entry, FlightPlan, PlannedInput
from rotorid.excitation import doublet, logarithmic_sweep, pilot_sweep
from rotorid.excitation.plan import planned, sequence
from rotorid.plans.facts import FlightFacts, PredictedBound
from rotorid.typing import Axis

RATE_HZ = 400.0


def hertz(low: float, high: float) -> tuple[float, float]:
    return 2.0 * math.pi * low, 2.0 * math.pi * high


def chirp(
    axis: Axis = "roll",
    *,
    start_s: float = 0.0,
    entry: Entry = "command",
    amplitude: float = 0.15,
    band_hz: tuple[float, float] = (0.1, 20.0),
    duration_s: float = 90.0,
    constant_s: float | None = None,
    fade_in_s: float = 5.0,
    fade_out_s: float = 2.0,
    trim_s: float = 0.0,
    sample_rate_hz: float = RATE_HZ,
    settings: dict[str, float] | None = None,
) -> PlannedInput:
    """A sweep as ArduPilot flies it, unless it is told otherwise."""
    values = logarithmic_sweep(
        amplitude=amplitude,
        band_rad_s=hertz(*band_hz),
        duration_s=duration_s,
        sample_rate_hz=sample_rate_hz,
        constant_s=2.0 / band_hz[0] if constant_s is None else constant_s,
        fade_in_s=fade_in_s,
        fade_out_s=fade_out_s,
        trim_s=trim_s,
    )
    return PlannedInput(
        axis=axis,
        shape="logarithmic_sweep",
        start_s=start_s,
        values=values,
        sample_rate_hz=sample_rate_hz,
        amplitude=amplitude,
        band_rad_s=hertz(*band_hz),
        entry=entry,
        settings={"fade_in_s": fade_in_s, "fade_out_s": fade_out_s} if settings is None else settings,
    )


def step(
    axis: Axis = "roll", *, start_s: float = 0.0, entry: Entry = "command", amplitude: float = 0.1
) -> PlannedInput:
    values = doublet(amplitude=amplitude, pulse_s=1.0, sample_rate_hz=50.0, trim_s=0.0)
    return PlannedInput(
        axis=axis,
        shape="doublet",
        start_s=start_s,
        values=values,
        sample_rate_hz=50.0,
        amplitude=amplitude,
        entry=entry,
        settings={"pulse_s": 1.0},
    )


def by_hand(axis: Axis = "roll", *, start_s: float = 0.0, amplitude: float = 0.3) -> PlannedInput:
    values = pilot_sweep(
        amplitude=amplitude, band_rad_s=hertz(0.2, 4.0), duration_s=40.0, sample_rate_hz=100.0, trim_s=0.0
    )
    return PlannedInput(
        axis=axis,
        shape="pilot_sweep",
        start_s=start_s,
        values=values,
        sample_rate_hz=100.0,
        amplitude=amplitude,
        band_rad_s=hertz(0.2, 4.0),
        entry="stick",
    )


def multisine(axes: Sequence[Axis], *, entry: Entry = "attitude_setpoint") -> tuple[PlannedInput, ...]:
    """All axes at once, each with its own harmonics of the same period."""
    time_s = np.arange(2000) / 100.0
    lines = np.arange(1, 31)
    return tuple(
        PlannedInput(
            axis=axis,
            shape="multisine",
            start_s=2.0,
            values=0.05
            * np.sin(
                2.0 * np.pi * np.outer(time_s, lines[index :: len(axes)]) / 20.0 + 0.7 * lines[index :: len(axes)] ** 2
            ).sum(axis=1)
            / 5.0,
            sample_rate_hz=100.0,
            amplitude=0.05,
            band_rad_s=hertz(0.05, 1.5),
            entry=entry,
        )
        for index, axis in enumerate(axes)
    )


def four_chirps() -> FlightPlan:
    starts = (0.0, 100.0, 200.0, 300.0)
    axes: tuple[Axis, ...] = ("roll", "pitch", "yaw", "thrust")
    sizes = (0.15, 0.15, 0.3, 0.08)
    inputs = tuple(
        chirp(axis, start_s=start_s, amplitude=size) for axis, start_s, size in zip(axes, starts, sizes, strict=True)
    )
    return FlightPlan(name="Hover, four axes", inputs=inputs)


def sweeps_then_doublets(*, repeats: int = 1) -> FlightPlan:
    """What a planner makes for ArduPilot: a sweep of each axis, then doublets of both signs to verify a model on."""
    axes: tuple[Axis, ...] = ("roll", "pitch", "yaw", "thrust")
    parts = [
        planned(
            axis,
            "logarithmic_sweep",
            start_s=0.0,
            amplitude=0.1,
            band_rad_s=hertz(0.2, 12.0),
            duration_s=60.0,
            sample_rate_hz=250.0,
            constant_s=10.0,
            fade_in_s=4.0,
            fade_out_s=2.0,
        )
        for axis in axes
        for _ in range(repeats)
    ]
    parts += [
        planned(axis, "doublet", start_s=0.0, amplitude=sign * 0.12, duration_s=0.6, sample_rate_hz=250.0)
        for axis in axes
        for sign in (1.0, -1.0)
    ]
    return sequence("Sweeps, then doublets", parts)


def facts(autopilot: str = "ArduPilot", **changes: Any) -> FlightFacts:
    names = ("L_p", "L_roll", "M_q", "M_pitch", "N_r", "N_yaw", "Z_w", "Z_thrust", "X_u", "Y_v", "tau_roll", "tau_yaw")
    values = (-1.99, 437.2, -1.99, 437.2, -1.99, 14.18, -0.241, -27.05, -0.241, -0.241, 0.0024, 0.0024)
    bounds = tuple(
        PredictedBound(
            name=name,
            unit="s" if name.startswith("tau") else "1/s" if abs(value) < 3.0 else "rad/s^2",
            value=value,
            std=0.013 * abs(value) * (1 + index % 5),
        )
        for index, (name, value) in enumerate(zip(names, values, strict=True))
    )
    settings: dict[str, Any] = {
        "vehicle": "ArduPilot X quad, 3 kg",
        "autopilot": autopilot,
        "room_m": 7.4,
        "height_m": 20.0,
        "climb_m": 2.6,
        "tilt_rad": math.radians(16.0),
        "rate_rad_s": math.radians(84.0),
        "motors": (0.22, 0.61),
        "bounds": bounds,
    }
    return FlightFacts(**(settings | changes))
