"""Blackbox logs that ``blackbox_decode`` or the Blackbox Explorer wrote as CSV.

The columns are the fields of the main frames, as logged or in a unit that stands behind the name: ``gyroADC[0]``,
``gyroADC[0] (deg/s)``. The settings, without which neither the range of the motors nor the unit of the accelerometer is
known, stand in a second file ``NAME.headers.csv`` (``blackbox_decode --save-headers``), or on top of the same file (the
Explorer). Without them gyro and sticks are read, the motors are not.
"""

from __future__ import annotations

import csv
import io
import math
import re
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from rotorid.data.findings import warn
from rotorid.data.record import FlightRecord, Source
from rotorid.errors import LogError
from rotorid.io.betaflight.blackbox import FRAMES, Damage, Flight, Header, Layout
from rotorid.io.betaflight.log import gyro_scale, record_of
from rotorid.io.tables import csv as table
from rotorid.io.tables.mapping import ChannelMapping
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

FORMAT = "Betaflight blackbox as CSV"

_FIRST, _CLOCK = "loopIteration", "time"
_COLUMN = re.compile(r"(?P<name>\w+(?:\[\d+\])?)(?: \((?P<unit>[^)]*)\))?")
_FIELDS = re.compile(
    r"(axis[PIDFS]|axisSum|axisRate|gyroADC|gyroUnfilt|gyroRaw|accSmooth|attitude|imuQuaternion|motor|eRPM|setpoint|"
    r"rcCommand|debug|navPos|navVel)\[\d+\]|vbat\w*|amperageLatest|amperage"
)
_EXPLORER = re.compile(r'"Product"\s*,\s*"?Blackbox flight data recorder')
_TIMES: Mapping[str, float] = MappingProxyType({"": 1e-6, "us": 1e-6, "ms": 1e-3, "s": 1.0})
_ROTATIONS: Mapping[str, float] = MappingProxyType({"deg/s": math.pi / 180.0, "rad/s": 1.0})
_ACCELERATIONS: Mapping[str, float] = MappingProxyType({"g": 1.0, "m/s2": 1.0 / STANDARD_GRAVITY_M_S2})
_CURRENTS: Mapping[str, float] = MappingProxyType({"A": 100.0, "mA": 0.1})
_MOST_SETTINGS = 5000

_LARGEST_PULSE_US = 2500.0
"""Throttle is 1000 to 2000 µs; a log of high resolution counts tenths of all sticks, rates and set-points."""


def sniff(head: bytes) -> bool:
    """Whether a file that starts like this is a decoded blackbox log.

    Examples
    --------
    >>> sniff(b"loopIteration, time (us), axisP[0]"), sniff(b"time [s],q [rad/s]")
    (True, False)
    """
    line = head.removeprefix(b"\xef\xbb\xbf").lstrip().partition(b"\n")[0].decode("utf-8", errors="replace")
    cells = [cell.strip().strip('"') for cell in line.split(",")]
    return (cells[0] == _FIRST and len(cells) > 1 and cells[1].startswith(_CLOCK)) or bool(_EXPLORER.match(line))


def read(path: Path, source: Source, mapping: ChannelMapping | None = None) -> FlightRecord:
    """Read a log.

    Parameters
    ----------
    path
        The CSV; its settings are looked for beside it.
    source
        What is known of the file; the firmware is filled in.
    mapping
        Which column is which channel, for who wants to say it himself.

    Raises
    ------
    LogError
        The file cannot be read, or its rows are no table of numbers.
    """
    if mapping is not None:
        return table.read(path, source, mapping)
    try:
        text = path.read_text(encoding="utf-8-sig", errors="replace")
    except OSError as error:
        raise LogError(f"{path.name} cannot be read: {error.strerror}", needed="a readable log file") from error
    settings, columns, body = _parts(text, source.name)
    header_file = path.with_suffix(".headers.csv")
    if not settings and header_file.is_file():
        settings = _settings(header_file.read_text(encoding="utf-8-sig", errors="replace").splitlines())
    matches = {place: match for place, cell in enumerate(columns) if (match := _COLUMN.fullmatch(cell)) is not None}
    wanted = [place for place, match in matches.items() if _FIELDS.fullmatch(match["name"])]
    clock = next((place for place, match in matches.items() if match["name"] == _CLOCK), None)
    if clock is None or not wanted:
        raise LogError(
            f"{source.name} has no column of time, gyro or motors",
            needed="a CSV as blackbox_decode writes it",
            remedy="decode the log again, or give the .BBL",
        )
    values = _table(body, [clock, *wanted], len(columns), source.name)
    header = Header(
        # Every firmware that is still decoded logs degrees per second; the oldest ones say so by their settings.
        values=MappingProxyType(settings or {"Firmware type": "", **_resolution(values, wanted, matches)}),
        layouts=_layouts(matches[place]["name"] for place in wanted if settings or not _needs_settings(matches[place])),
        cadence=(1, 1, 1),
        size=0,
    )
    kept = [at for at, place in enumerate(wanted, start=1) if settings or not _needs_settings(matches[place])]
    if not kept:
        raise LogError(
            f"{source.name} has only motors, accelerometer or voltage, which have no unit without the settings of "
            "the flight controller",
            needed="gyros, or the settings",
            remedy=f"give the .BBL, or decode it with --save-headers and keep {header_file.name} in the same folder",
        )
    raw = np.stack([_raw(values[at], matches[wanted[at - 1]], header) for at in kept], axis=1)
    flight = Flight(
        number=1,
        header=header,
        time_s=values[0] * _TIMES.get(matches[clock]["unit"] or "", 1e-6),
        frames=raw,
        fix_time_s=np.zeros(0),
        fixes=np.zeros((0, 0), dtype=np.int64),
        damage=Damage(skipped_bytes=0, places=0, first_byte=0, lost_frames=0, cut_bytes=0, ended=True),
    )
    record = record_of([flight], [], source)
    if settings:
        return record
    scale = (
        ""
        if _THROTTLE in {matches[place]["name"] for place in wanted}
        else (
            f"; without {_THROTTLE} the scale of rates and set-points is unknown, and blackbox_high_resolution "
            "is assumed to be off"
        )
    )
    finding = warn(
        "missing_channel",
        "settings",
        "the CSV has no settings of the flight controller, so that motors, accelerometer and voltage have "
        f"no unit and were left out{scale}; give the .BBL, or "
        f"decode it with --save-headers and keep {header_file.name} "
        "in the same folder",
    )
    return replace(record, findings=(*record.findings, finding))


_THROTTLE = "rcCommand[3]"


def _resolution(values: FloatArray, wanted: Sequence[int], matches: Mapping[int, re.Match[str]]) -> dict[str, str]:
    """The setting of high resolution, where the size of the throttle shows it."""
    names = [matches[place]["name"] for place in wanted]
    high = _THROTTLE in names and float(np.median(values[1 + names.index(_THROTTLE)])) > _LARGEST_PULSE_US
    return {"blackbox_high_resolution": "1"} if high else {}


def _needs_settings(column: re.Match[str]) -> bool:
    """Whether a field means nothing without the settings."""
    return column["name"].startswith(("motor", "eRPM", "vbat")) or (
        column["name"].startswith("accSmooth") and not column["unit"]
    )


def _layouts(names: Iterable[str]) -> dict[str, Layout]:
    return {letter: Layout(names=tuple(names) if letter == "I" else ()) for letter in FRAMES}


def _raw(values: FloatArray, column: re.Match[str], header: Header) -> FloatArray:
    """A field as the flight controller logged it, out of the unit in which it was written."""
    name, unit = column["name"], (column["unit"] or "").replace("s/s", "s2")
    if name.startswith(("gyroADC", "gyroUnfilt", "gyroRaw")) and unit in _ROTATIONS:
        return values * (_ROTATIONS[unit] / gyro_scale(header))
    if name.startswith("accSmooth") and unit in _ACCELERATIONS:
        return values * (_ACCELERATIONS[unit] * header.number("acc_1G"))
    if name.startswith("vbat") and unit == "V":
        firmware, version = header.firmware
        return values * (10.0 if firmware == "Betaflight" and version < (4, 0) else 100.0)
    if name.startswith("amperage") and unit in _CURRENTS:
        return values * _CURRENTS[unit]
    return values


def _parts(text: str, name: str) -> tuple[dict[str, str], list[str], str]:
    """Settings on top of the table, names of its columns, and its rows."""
    lines = iter(text.splitlines(keepends=True))
    above: list[str] = []
    for line in lines:
        cells = next(csv.reader([line], skipinitialspace=True), [])
        if cells and cells[0].strip() == _FIRST:
            return _settings(above), [cell.strip() for cell in cells], "".join(lines)
        above.append(line)
        if len(above) > _MOST_SETTINGS:
            break
    raise LogError(
        f"{name} contains settings but no table that begins with {_FIRST}",
        needed="a CSV as blackbox_decode or the Blackbox Explorer writes it",
        remedy="export the log again, or give the .BBL",
    )


def _settings(lines: Iterable[str]) -> dict[str, str]:
    """Name and value of each line; lists with or without brackets."""
    rows = (row for row in csv.reader(lines, skipinitialspace=True) if len(row) > 1)
    return {row[0].strip(): ",".join(cell.strip() for cell in row[1:]).strip("[]") for row in rows}


def _table(body: str, places: Sequence[int], width: int, name: str) -> FloatArray:
    """Columns as numbers, shape ``(columns, rows)``; a last line that was cut is left out."""
    rows = body.splitlines()
    if rows and rows[-1].count(",") < width - 1:
        rows.pop()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # an empty table is refused below
            found = np.loadtxt(io.StringIO("\n".join(rows)), delimiter=",", usecols=places, comments=None, ndmin=2)
    except ValueError as error:
        raise LogError(
            f"{name} contains a row that is not numeric: {error}",
            needed="a CSV as blackbox_decode writes it",
            remedy="decode the log again, or give the .BBL",
        ) from error
    if not found.size:
        raise LogError(f"{name} contains no flight: a header without rows", needed="samples", remedy="decode it again")
    return np.ascontiguousarray(found.T)
