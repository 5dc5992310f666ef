"""Reader of ArduPilot logs: the tables of a DataFlash log as a flight record in the vocabulary of the package."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from rotorid.data.channel import AXES, LOWEST_RATE_HZ
from rotorid.data.findings import Finding, Severity
from rotorid.data.record import FlightRecord, Source, Topic
from rotorid.io.ardupilot_actuators import motor_topics, stick_topic
from rotorid.io.ardupilot_channels import MESSAGES, common_topics, is_legacy_rate
from rotorid.io.ardupilot_systemid import (
    Run,
    decimation_findings,
    declared_maneuvers,
    system_id_findings,
    system_id_runs,
    system_id_topics,
)
from rotorid.io.dataflash import decode, sniff
from rotorid.io.dataflash_formats import Table
from rotorid.io.gather import file_bytes
from rotorid.io.privacy import without_places

__all__ = ["FORMAT", "read", "sniff"]

FORMAT = "ArduPilot DataFlash"

FAST_BITS = (("RATE", 0, "fast attitude"), ("IMU", 18, "fast IMU"))
"""Message, and the bit of ``LOG_BITMASK`` that logs it in every loop."""

WANTED = frozenset({*MESSAGES, "SIDD", "SIDS", "PARM", "VER", "MSG", "RCOU", "RCIN", "ESC"}) | {
    f"ESC{number}" for number in range(1, 33)
}
"""Messages that are read at all."""


def read(path: Path, source: Source) -> FlightRecord:
    """Read a log.

    Rates and accelerations come from ``SIDD`` while SYSTEMID mode ran, else from ``RATE`` and ``IMU``; mixer inputs
    from ``RATE``. All stamps are those of the log. ``RATE`` and ``IMU`` have passed the gyro filter
    (``INS_GYRO_FILTER``), ``SIDD`` has not: a model fitted to the former carries the filter's delay. Positions are
    relative to the origin of the estimator; where on Earth that is does not enter the record. The file is mapped and
    only the messages behind the channels are collected, so that memory follows the record and not the log.

    Parameters
    ----------
    path
        The log, unpacked.
    source
        What is known of the file; the firmware is filled in.

    Raises
    ------
    LogError
        The file cannot be read or is no DataFlash log.
    """
    log = decode(file_bytes(path), WANTED)
    tables, parameters = log.tables, _parameters(log.tables)
    runs = system_id_runs(tables, parameters)
    sticks = stick_topic(tables, parameters)
    flown = (*system_id_topics(tables, runs), *common_topics(tables), *motor_topics(tables, parameters))
    topics = flown if sticks is None else (*flown, sticks)
    return FlightRecord(
        source=replace(source, firmware=_firmware(tables)),
        topics=topics,
        parameters=without_places(parameters),
        declared=declared_maneuvers(runs),
        instruments=_instruments(runs, sticks),
        findings=(
            *log.findings,
            *system_id_findings(runs),
            *decimation_findings(topics, runs, parameters),
            *_dialect(tables),
            *_slow(topics, parameters),
        ),
    )


def _parameters(tables: Mapping[str, Table]) -> Mapping[str, float]:
    """The autopilot's parameters; of one that changed in flight, the last value."""
    table = tables.get("PARM")
    if table is None or not (table.holds_text("Name") and table.holds_numbers("Value")):
        return {}
    return {
        str(name): float(value)
        for name, value in zip(table.column("Name"), table.column("Value"), strict=True)
        if np.isfinite(value)
    }


def _firmware(tables: Mapping[str, Table]) -> str:
    """``ArduCopter V4.5.7 (…)``, as the autopilot introduces itself."""
    for name, column in (("VER", "FWS"), ("MSG", "Message")):
        if name in tables and tables[name].holds_text(column):
            texts = tables[name].column(column).tolist()
            found = next((text for text in texts if re.search(r"\bV\d+\.\d+", text)), "")
            if found:
                return str(found)
    return ""


def _instruments(runs: tuple[Run, ...], sticks: Topic | None) -> Mapping[str, tuple[str, ...]]:
    """Signals without feedback: the injection where there was one, then the stick, which a pilot closes slowly."""
    excited = {run.axis for run in runs}
    held = () if sticks is None else tuple(channel.name for channel in sticks.channels)
    listed = {
        axis: (
            *([f"{axis}_excitation"] if axis in excited else []),
            *([f"{axis}_stick"] if f"{axis}_stick" in held else []),
        )
        for axis in AXES
    }
    return {axis: names for axis, names in listed.items() if names}


def _dialect(tables: Mapping[str, Table]) -> Iterator[Finding]:
    if "RATE" not in tables:
        yield Finding(
            kind="missing_channel",
            severity="warning",
            where="RATE",
            message="the log has no RATE messages, so that the mixer's inputs are not known; set bit 0 (fast attitude) "
            "of LOG_BITMASK",
        )
    elif is_legacy_rate(tables["RATE"]):
        yield Finding(
            kind="legacy_units",
            severity="info",
            where="RATE",
            message="RATE is in the units of firmware before 3.4: rates were read as centidegrees per second, roll, "
            "pitch and yaw outputs as parts of 4500, throttle as parts of 1000",
        )


def _slow(topics: tuple[Topic, ...], parameters: Mapping[str, float]) -> Iterator[Finding]:
    """Topics too slow for what they are needed for, with the parameter to change."""
    rates = {topic.name: topic.sample_rate_hz for topic in topics if topic.time_s.size > 1}
    mask = int(parameters.get("LOG_BITMASK", 0.0))
    for name, bit, meaning in FAST_BITS:
        if rates.get(name, LOWEST_RATE_HZ) < LOWEST_RATE_HZ:
            said = f"bit {bit} of LOG_BITMASK ({meaning})"
            if mask >> bit & 1:
                remedy = f"{said} is set already, so that the autopilot's loop or its storage is too slow"
            else:
                remedy = f"set {said}: {mask} becomes {mask | 1 << bit}"
            yield _too_slow(name, rates[name], "warning", remedy)
    if rates.get("RCOU", LOWEST_RATE_HZ) < LOWEST_RATE_HZ:
        usable = rates.get("RATE", 0.0) >= LOWEST_RATE_HZ
        remedy = "ArduPilot writes it ten times a second whatever LOG_BITMASK says: use the mixer's inputs in RATE"
        yield _too_slow("RCOU", rates["RCOU"], "info" if usable else "warning", remedy)


def _too_slow(name: str, rate_hz: float, severity: Severity, remedy: str) -> Finding:
    return Finding(
        kind="rate_too_low",
        severity=severity,
        where=name,
        message=f"{name} was logged at {rate_hz:.1f} Hz, too slow for motor-level work, which needs at least "
        f"{LOWEST_RATE_HZ:.0f} Hz; {remedy}",
        numbers={"rate_hz": rate_hz, "needed_hz": LOWEST_RATE_HZ},
    )
