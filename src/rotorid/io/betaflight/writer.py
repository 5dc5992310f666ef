"""A simulated flight as the blackbox log that Betaflight would have written of it.

The inverse of :mod:`rotorid.io.betaflight.log`: fields of the vocabulary in the log's units and directions, x forward,
y left, z up. Every frame is an I frame of plain numbers, which any decoder of the format reads; Betaflight writes most
of its frames as differences to predictions, and is shorter by half.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from rotorid.data.flight_plan import SimulatedFlight
from rotorid.errors import UsageError
from rotorid.io.betaflight.log import FRD, STICK_SPAN
from rotorid.io.files import write_atomically
from rotorid.typing import FloatArray, IntArray
from rotorid.units import STANDARD_GRAVITY_M_S2

FIRMWARE = "Betaflight 4.4.3 (rotorid) STM32F7X2"
ONE_G = 2048
MOTOR_RANGE = (158, 2047)
"""Idle and full of a digital motor output."""

_TENTHS = 10.0
"""Logs of high resolution count tenths."""
_DEGREES = 180.0 / math.pi
_MOST_BYTES = 5
_LARGEST = 2**30
_CLOCK_US = 2**32
"""The clock of a log begins anew here."""
_MOTORS = 4


def write_betaflight(path: Path, flight: SimulatedFlight, *, start_s: float = 20.0) -> None:
    """Write a flight as a blackbox log: settings, then a frame for every turn of the loop.

    Gyro, set-points and sticks are in tenths of their units, as ``blackbox_high_resolution`` makes them. What a flight
    does not have is no field; a flight without a stick had it at rest.

    Parameters
    ----------
    path
        File to write or replace, whole or not at all.
    flight
        The flight; its motors are in the order of Betaflight's X, rear right first.
    start_s
        Stamp of the flight's zero, on the clock of the flight controller.

    Raises
    ------
    UsageError
        The flight is empty, another autopilot's, of other than four motors or longer than the clock of a log, a column
        holds NaN or infinity, or the place cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> from rotorid.io.registry import read
    >>> turning = SimulatedFlight(vehicle="demo", autopilot="betaflight", sample_rate_hz=1000.0,
    ...               time_s=[0.0, 0.001], columns={"p": [0.5, 1.0], "q": [0.0, 0.1], "r": [0.0, 0.0]})
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_betaflight(Path(folder, "turning.bbl"), turning)
    ...     np.asarray(read(Path(folder, "turning.bbl"))["p"]).round(2).tolist()
    [0.5, 1.0]
    """
    if not flight.samples:
        raise UsageError("the flight has no samples", needed="at least one")
    motors = sum(name.startswith("motor_") for name in flight.columns)
    if flight.autopilot != "betaflight" or motors not in (0, _MOTORS):
        raise UsageError(
            f"{flight.vehicle} flies {flight.autopilot} with {motors} motors, which no blackbox log can contain",
            needed="Betaflight's own controllers and four motors, in its order",
            remedy="write csv, or the autopilot's own format",
        )
    fields = dict(_fields(flight))
    for name, row in fields.items():
        if not np.all(np.isfinite(row)) or float(np.abs(row).max()) > _LARGEST:
            raise UsageError(f"the field {name} has values that a log cannot store", needed="finite numbers")
    stamps = np.rint((start_s + flight.time_s) * 1e6)
    if not (stamps[0] >= 0.0 and stamps[-1] < _CLOCK_US):
        raise UsageError(
            f"stamps from {1e-6 * stamps[0]:.6g} to {1e-6 * stamps[-1]:.6g} s do not fit a blackbox log",
            needed=f"0 to {1e-6 * _CLOCK_US:.0f} s, after which its clock wraps around",
        )
    counts = np.arange(flight.samples, dtype=np.float64)
    rows = {"loopIteration": counts, "time": stamps, **fields}
    signed = [name in fields for name in rows]
    values = np.stack([np.rint(row) for row in rows.values()], axis=1).astype(np.int64)
    write_atomically(path, _header(flight, list(rows), signed) + _frames(values, np.array(signed)) + _END)


_END = b"E\xffEnd of log\x00"


def _fields(flight: SimulatedFlight) -> Iterator[tuple[str, FloatArray]]:
    """Names of fields with their numbers, before they are rounded."""
    columns = flight.columns

    def vector(field: str, names: str, scale: float) -> Iterator[tuple[str, FloatArray]]:
        for index, name in enumerate(names.split()):
            if name in columns:
                yield f"{field}[{index}]", columns[name] * (scale * FRD[index])

    still = np.zeros(flight.samples)
    for index, axis in enumerate(("roll", "pitch", "yaw")):
        yield f"rcCommand[{index}]", columns.get(f"{axis}_stick", still) * (_TENTHS * STICK_SPAN * FRD[index])
    if "thrust_command" in columns:
        yield "rcCommand[3]", _TENTHS * (1000.0 + 1000.0 * _throttle(columns["thrust_command"], columns))
    yield from vector("setpoint", "p_setpoint q_setpoint r_setpoint", _TENTHS * _DEGREES)
    yield from vector("gyroADC", "p q r", _TENTHS * _DEGREES)
    yield from vector("accSmooth", "ax ay az", ONE_G / STANDARD_GRAVITY_M_S2)
    if "battery_voltage" in columns:
        yield "vbatLatest", 100.0 * columns["battery_voltage"]
    low, high = MOTOR_RANGE
    for number in range(4):
        if f"motor_{number + 1}" in columns:
            yield f"motor[{number}]", low + (high - low) * columns[f"motor_{number + 1}"]


def _throttle(command: FloatArray, columns: Mapping[str, FloatArray]) -> FloatArray:
    """Where the throttle stands: at the command of the hover, and as far beside it as the stick asked.

    What holds the height meanwhile is no part of it, as what holds the place is none of the other sticks.
    """
    stick = columns.get("thrust_stick")
    if stick is None or not np.ptp(stick):
        return np.full(command.shape, float(np.median(command)))
    slope, middle = np.polyfit(stick, command, 1)
    throttle: FloatArray = middle + slope * stick
    return throttle


def _header(flight: SimulatedFlight, names: list[str], signed: list[bool]) -> bytes:
    listed = ",".join
    lines = {
        "Product": "Blackbox flight data recorder by Nicholas Sherlock",
        "Data version": "2",
        "I interval": "1",
        "P interval": "1/1",
        "Field I name": listed(names),
        "Field I signed": listed(str(int(is_signed)) for is_signed in signed),
        "Field I predictor": listed("0" for _ in names),
        "Field I encoding": listed(str(int(not is_signed)) for is_signed in signed),
        "Field P predictor": listed("0" for _ in names),
        "Field P encoding": listed(str(int(not is_signed)) for is_signed in signed),
        "Firmware type": "Cleanflight",
        "Firmware revision": FIRMWARE,
        "Craft name": flight.vehicle,
        "blackbox_high_resolution": "1",
        "gyro_scale": "0x3f800000",
        "acc_1G": str(ONE_G),
        "motorOutput": listed(map(str, MOTOR_RANGE)),
        **_settings(flight.parameters),
    }
    return "".join(f"H {name}:{text}\n" for name, text in lines.items()).encode()


def _settings(parameters: Mapping[str, float]) -> dict[str, str]:
    """Settings as the header has them: numbers of one list, ``rollPID_P`` and the like, on one line."""
    lists: dict[str, list[str]] = {}
    for name, value in parameters.items():
        stem, _, part = name.rpartition("_")
        owner = stem if stem and (part in ("P", "I", "D") or part.isdigit()) else name
        lists.setdefault(owner, []).append(f"{value:.12g}")
    return {name: ",".join(parts) for name, parts in lists.items()}


def _frames(values: IntArray, signed: np.ndarray) -> bytes:
    """Frames of numbers of variable length, seven bits a byte; signs are folded into the lowest bit."""
    folded = np.where(signed, values << 1 ^ values >> 63, values).astype(np.uint64)
    shifts = 7 * np.arange(_MOST_BYTES, dtype=np.uint64)
    parts = folded[:, :, None] >> shifts
    used = parts > 0
    used[:, :, 0] = True
    more = np.zeros_like(used)
    more[:, :, :-1] = used[:, :, 1:]
    packed = (parts & np.uint64(127)).astype(np.uint8) | (more.astype(np.uint8) << 7)
    count = values.shape[0]
    marks = np.full((count, 1), ord("I"), dtype=np.uint8)
    frames = np.concatenate([marks, packed.reshape(count, -1)], axis=1)
    kept = np.concatenate([np.ones((count, 1), dtype=bool), used.reshape(count, -1)], axis=1)
    return bytes(frames[kept].tobytes())
