"""The noise of commands, from which the noise of a rate behind the filters of its controller follows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rotorid.data.record import FlightRecord
from rotorid.typing import FloatArray

LEAST_NOISE_HZ = 30.0
"""Rates above are noise, if they also lie above the band of the plant."""

_WINDOWS = 4


def command_densities(records: Sequence[FlightRecord], commands: Sequence[str]) -> Mapping[str, FloatArray]:
    """Densities of the commands of rate loops, each from the first log that has the command.

    Parameters
    ----------
    records
        Logs of one vehicle.
    commands
        Inputs of a model, of which only commands of roll, pitch and yaw count.

    Returns
    -------
    Mapping
        Name of the command to rad/s and one-sided density, shape ``(2, n)``; without those that are logged too slowly.
    """
    found = {}
    for command in ("roll_command", "pitch_command", "yaw_command"):
        record = next((record for record in records if command in record.channel_names), None)
        if command in commands and record is not None and (density := command_density(record, command)) is not None:
            found[command] = density
    return found


def command_density(record: FlightRecord, channel: str) -> FloatArray | None:
    """Rad/s and one-sided density of a channel over the whole log, shape ``(2, n)``: the median over windows of 1 s.

    ``None`` where the channel is not logged faster than twice :data:`LEAST_NOISE_HZ`, or only for a few windows.
    """
    from scipy.signal import welch

    for topic, row in record.holding(channel):
        if np.isfinite(topic.sample_rate_hz) and topic.sample_rate_hz > 2.0 * LEAST_NOISE_HZ:
            values = topic.values[row]
            values = values[np.isfinite(values)]
            window = round(topic.sample_rate_hz)
            if values.size < _WINDOWS * window:
                return None
            hz, density = welch(values, fs=topic.sample_rate_hz, nperseg=window, average="median")
            return np.asarray([2.0 * np.pi * hz, density / (2.0 * np.pi)])
    return None
