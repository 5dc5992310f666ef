"""What a loop will do with the test inputs of a plan, gusts and noise aside."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.data.channel import Channel
from rotorid.data.history import TimeHistory
from rotorid.design.loop import LoopModel
from rotorid.design.planned import Planned
from rotorid.typing import ComplexArray, FloatArray

_SETTLING_S = 60.0
"""Time after the flight in which its last motion has died out."""


def excited_channels(loop: LoopModel, planned: Planned, omega_rad_s: FloatArray, names: Sequence[str]) -> ComplexArray:
    """Commands and outputs by the test inputs of a plan, the loop closed, shape ``(channels, sources, f)``.

    Raises
    ------
    UsageError
        The loop does not say how the test inputs get to the commands.
    """
    responses = loop.at(omega_rad_s)
    columns = [loop.inputs.index(f"{axis}_command") for axis in planned.axes]
    entered = np.stack(
        [loop.excitation(omega_rad_s, entry)[:, u] for entry, u in zip(planned.entries, columns, strict=True)], axis=1
    )
    commands = np.einsum("ijf,jsf->isf", responses.excited, entered)
    outputs = np.einsum("yuf,usf->ysf", responses.plant, commands)
    return np.asarray(np.concatenate([commands, outputs])[loop_rows(loop, names)])


def loop_rows(loop: LoopModel, names: Sequence[str]) -> list[int]:
    """Rows of commands and outputs of a loop, counted over both."""
    return [(*loop.inputs, *loop.outputs).index(name) for name in names]


def foreseen_flight(loop: LoopModel, planned: Planned, names: Sequence[str], *, highest_rad_s: float) -> TimeHistory:
    """Test inputs, commands and outputs of a whole flight without gusts and noise.

    By the frequency response of the closed loop over the whole flight, with time to settle behind it.

    Parameters
    ----------
    loop, planned
        What will fly, and what.
    names
        Commands and outputs, behind the test inputs.
    highest_rad_s
        What moves faster is left out.
    """
    from scipy.fft import irfft, next_fast_len, rfft

    flight = planned.flight
    samples, rate_hz = flight.values.shape[1], flight.sample_rate_hz
    length = int(next_fast_len(samples + round(_SETTLING_S * rate_hz), real=True))
    omega = np.asarray(2.0 * np.pi * rate_hz / length * np.arange(length // 2 + 1), dtype=np.float64)
    kept = (omega > 0.0) & (omega <= highest_rad_s)
    sources: ComplexArray = rfft(flight.values, n=length, axis=1)
    moved = np.zeros((len(names), omega.size), dtype=np.complex128)
    moved[:, kept] = np.einsum("csf,sf->cf", excited_channels(loop, planned, omega[kept], names), sources[:, kept])
    values = np.concatenate([flight.values, irfft(moved, n=length, axis=1)[:, :samples]])
    return TimeHistory(
        values=values,
        channels=(*flight.channels, *(Channel(name=name, unit="1") for name in names)),
        sample_rate_hz=rate_hz,
        start_s=flight.start_s,
    )
