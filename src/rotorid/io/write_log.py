"""A simulated flight as a log file, in the format of an autopilot or as a table."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Literal, TypeAlias, get_args

import numpy as np

from rotorid.data.simulated_flight import SimulatedFlight
from rotorid.errors import UsageError

LogFormat: TypeAlias = Literal["ulg", "bin", "csv"]

START_S: Mapping[LogFormat, float] = MappingProxyType({"ulg": 30.0, "bin": 60.0, "csv": 0.0})
"""Time since boot at which the first sample is stamped: autopilots have run for a while when a flight begins."""

_TABLE_RATE_HZ = 500.0


def format_of(autopilot: str) -> LogFormat:
    """The format in which an autopilot logs; a table for one without a format of its own.

    Examples
    --------
    >>> format_of("px4"), format_of("ardupilot"), format_of("simple")
    ('ulg', 'bin', 'csv')
    """
    formats: Mapping[str, LogFormat] = {"px4": "ulg", "ardupilot": "bin"}
    return formats.get(autopilot, "csv")


def log_rate_hz(format: LogFormat, loop_rate_hz: float) -> float:
    """Rate at which a log holds commands and rates of a loop.

    Examples
    --------
    >>> log_rate_hz("bin", 400.0), log_rate_hz("csv", 1000.0)
    (400.0, 500.0)
    """
    return loop_rate_hz / _stride(loop_rate_hz) if format == "csv" else loop_rate_hz


def _stride(loop_rate_hz: float) -> int:
    return max(1, int(np.ceil(loop_rate_hz / _TABLE_RATE_HZ - 1e-9)))


def write_log(path: Path, flown: SimulatedFlight, *, format: LogFormat) -> None:
    """Write a flight so that :func:`rotorid.io.registry.read` reads it back like any other log.

    Parameters
    ----------
    path
        File to write or replace, whole or not at all.
    flown
        The flight.
    format
        ``ulg`` as PX4 would have logged it, ``bin`` as ArduPilot, or ``csv``: every channel at the rate of the loop, or
        at the next part of it that is 500 Hz or less.

    Raises
    ------
    UsageError
        There is no such format, a signal holds something that is no number, or the place cannot be written.
    """
    if format == "ulg":
        from rotorid.io.px4_write import write_px4

        write_px4(path, flown, start_s=START_S["ulg"])
    elif format == "bin":
        from rotorid.io.ardupilot_write import write_ardupilot

        write_ardupilot(path, flown, start_s=START_S["bin"])
    elif format == "csv":
        from rotorid.io.tabular import write_csv

        stride = _stride(flown.sample_rate_hz)
        write_csv(path, flown.time_s[::stride], {name: row[::stride] for name, row in flown.columns.items()})
    else:
        raise UsageError(f"the format {format!r} of a log came", needed=f"one of {', '.join(get_args(LogFormat))}")
