"""A stretch of a log on one clock: motors as they were told, motion as it was measured, filters as they are known."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rotorid.data.findings import Finding
from rotorid.data.history import TimeHistory
from rotorid.data.maneuver import Maneuver
from rotorid.data.motor_record import MotorRecord
from rotorid.data.record import FlightRecord
from rotorid.fit.motor_fit import LEAST_SAMPLES
from rotorid.pipeline.building import built
from rotorid.signal.autopilot_filters import filter_findings, known_filters
from rotorid.signal.battery import voltage_factor
from rotorid.signal.clock import one_clock
from rotorid.signal.interpolated import interpolated
from rotorid.signal.known_filter import combined_response
from rotorid.signal.motor_outputs import Kind, MotorHistory, with_motors
from rotorid.signal.reconstruct import ingredients
from rotorid.typing import FloatArray

_MEASURED = ("p", "q", "r", "az")
_COPIES = 3
_RINGING_S = 0.1


class MotorFlight(NamedTuple):
    """A stretch of a log.

    Parameters
    ----------
    record
        On one clock.
    maneuver
        Where in the log.
    kind
        What the outputs are.
    """

    record: MotorRecord
    maneuver: Maneuver
    kind: Kind


class Motors(NamedTuple):
    """Motors, and whether they are samples of something smooth that somebody had joined by straight lines."""

    history: MotorHistory
    smooth: bool


def true_motors(history: MotorHistory) -> Motors:
    """Motors without the straight lines that somebody drew between slower samples."""
    joined = interpolated(history.time_s, history.values)
    if joined is None:
        return Motors(_without_copies(history), False)
    findings = (*history.findings, joined.finding(history.source))
    return Motors(replace(history, time_s=joined.time_s, values=joined.values, findings=findings), True)


def _without_copies(history: MotorHistory) -> MotorHistory:
    """Motors without samples that only repeat the one before, where that is the rule: a table of a faster clock."""
    changed = np.flatnonzero(np.r_[True, np.any(np.diff(history.values, axis=1) != 0.0, axis=0)])
    if changed.size < LEAST_SAMPLES or np.median(np.diff(changed)) < _COPIES:
        return history
    kept = replace(history, time_s=history.time_s[changed], values=history.values[:, changed])
    message = (
        f"{history.source} comes at {history.sample_rate_hz:.0f} Hz and repeats every value of the motors until the "
        f"next one, at {kept.sample_rate_hz:.1f} Hz."
    )
    numbers = {"rate_hz": kept.sample_rate_hz, "logged_rate_hz": history.sample_rate_hz}
    remark = Finding(
        kind="interpolated_channel", severity="warning", where=history.source, message=message, numbers=numbers
    )
    return replace(kept, findings=(*history.findings, remark))


def on_one_clock(
    record: FlightRecord, motors: Motors, stretch: Maneuver, reference_v: float | None
) -> tuple[list[MotorFlight], list[Finding]]:
    """A stretch on the clock of its rates, in pieces where the log has gaps; pieces of a moment are left out.

    Parameters
    ----------
    record, motors, stretch
        What was flown, and where in it.
    reference_v
        Voltage at which thrust is told; ``None`` where it does not matter.
    """
    history = motors.history
    start_s = max(stretch.start_s, float(history.time_s[0]), record.start_s)
    stop_s = min(stretch.stop_s, float(history.time_s[-1]), record.stop_s)
    followers = ingredients("w", record.channel_names)
    moving = "w" in record.channel_names or set(followers) <= set(record.channel_names)
    wanted = ("w",) if "w" in record.channel_names else followers
    found = one_clock(
        with_motors(record, history),
        channels=_MEASURED,
        followers=wanted if moving else (),
        start_s=start_s,
        stop_s=stop_s,
    )
    findings = [*found.findings]
    flights = []
    for part in found.histories:
        if part.time_s.size < LEAST_SAMPLES:
            continue
        one = built(part, (*_MEASURED, "w")) if moving else part
        strength = np.ones(one.time_s.size)
        if reference_v is not None:
            strength = voltage_factor(record, one.time_s, reference_v=reference_v).values
        findings += _filtered(record, one)
        flights.append(MotorFlight(_record(record, motors, one, strength), stretch, history.kind))
    return flights, findings


def _record(record: FlightRecord, motors: Motors, part: TimeHistory, strength: FloatArray) -> MotorRecord:
    return MotorRecord(
        name=record.source.name,
        sample_rate_hz=part.sample_rate_hz,
        outputs=_outputs(record, motors, part),
        rates=np.stack([part[name] for name in ("p", "q", "r")]),
        az=part["az"],
        w=part["w"] if "w" in part.names else np.zeros(0),
        strength=strength,
        gyro_taps=_taps(record, part, "p"),
        accel_taps=_taps(record, part, "az"),
        start_s=part.start_s,
    )


def _outputs(record: FlightRecord, motors: Motors, part: TimeHistory) -> FloatArray:
    """Mean output over each sample: held until the next stamp, or on the way to it where the loop was faster."""
    from scipy.interpolate import CubicSpline

    history, time_s = motors.history, part.time_s
    if motors.smooth:
        return np.asarray(CubicSpline(history.time_s, history.values, axis=1)(time_s), dtype=np.float64)
    if history.kind == "speed":
        return np.stack([np.interp(time_s, history.time_s, row) for row in history.values])
    late = np.searchsorted(history.time_s, time_s + 1e-9, side="right") - 1
    held = history.values[:, np.clip(late, 0, history.time_s.size - 1)]
    loops = round(record.parameters.get("SCHED_LOOP_RATE", 0.0) / history.sample_rate_hz)
    if loops < 2 or history.kind != "thrust_demand":
        return held
    # A loop that many times faster went on to the next logged demand by steps that nobody logged.
    share = (loops - 1) / (2.0 * loops)
    following = np.concatenate([held[:, 1:], held[:, -1:]], axis=1)
    return np.asarray((1.0 - share) * held + share * following)


def _taps(record: FlightRecord, part: TimeHistory, name: str) -> FloatArray:
    """Impulse response of the known filters in front of a channel, at the rate of the record."""
    filters = known_filters(record, part.channels[part.names.index(name)].source)
    if not filters:
        return np.ones(1)
    count = 2 * max(16, round(_RINGING_S * part.sample_rate_hz))
    omega = np.asarray(2.0 * np.pi * np.fft.rfftfreq(count, 1.0 / part.sample_rate_hz), dtype=np.float64)
    taps = np.fft.irfft(combined_response(filters, omega), count)[: count // 2]
    # What rings on is little, and rest must stay rest.
    return np.asarray(taps / taps.sum(), dtype=np.float64)


def _filtered(record: FlightRecord, part: TimeHistory) -> Iterator[Finding]:
    # A log without the parameters of an autopilot says nothing of filters, and need not say so.
    if not record.parameters:
        return
    for name in ("p", "az"):
        source = part.channels[part.names.index(name)].source
        for finding in filter_findings(record, source):
            if finding.kind == "known_filter":
                message = f"{finding.message} The model passes it too."
                yield replace(finding, message=message)
            else:
                yield finding
