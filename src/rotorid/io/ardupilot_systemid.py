"""Runs of ArduPilot's SYSTEMID mode: what was injected where, and the interval of each chirp."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from types import MappingProxyType

import numpy as np

from rotorid.data.findings import Finding
from rotorid.data.maneuver import Maneuver
from rotorid.data.record import Topic
from rotorid.io.ardupilot_channels import SYSTEM_ID, Row, topic_of
from rotorid.io.dataflash_formats import Table
from rotorid.typing import Axis

ENTRIES: Mapping[int, tuple[Axis, str]] = MappingProxyType(
    {
        1: ("roll", "deg"),
        2: ("pitch", "deg"),
        3: ("yaw", "deg/s"),
        4: ("roll", "deg"),
        5: ("pitch", "deg"),
        6: ("yaw", "deg/s"),
        7: ("roll", "deg/s"),
        8: ("pitch", "deg/s"),
        9: ("yaw", "deg/s"),
        10: ("roll", "1"),
        11: ("pitch", "1"),
        12: ("yaw", "1"),
        13: ("thrust", "1"),
    }
)
"""``SID_AXIS`` to the excited axis and the unit of the injected signal.

1–3 enter as pilot input and 4–6 the same without feedforward (in yaw both are a rate), 7–9 the rate controller's
target, 10–13 the mixer.
"""


_ENDED_EARLY = 0.9
_LOOP_BY_LOOP = 0.75
"""Below this part of the loop's rate at most every second sample was logged."""

_EVERY_LOOP_BITS = 0b11
"""Bits of ``LOG_BITMASK``, fast and medium attitude, with which SYSTEMID mode logs every loop."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Run:
    """One stay in SYSTEMID mode.

    Parameters
    ----------
    messages
        Its ``SIDD`` messages.
    start_s, stop_s
        Their first and last stamp.
    entry
        ``SID_AXIS`` of the run, zero when the log does not say.
    planned_rad_s
        Band that was set, when the log says.
    band_rad_s
        Band that was flown: the run may have been left early.
    """

    messages: slice
    start_s: float
    stop_s: float
    entry: int
    planned_rad_s: tuple[float, float] | None
    band_rad_s: tuple[float, float] | None

    @property
    def axis(self) -> Axis | None:
        return ENTRIES[self.entry][0] if self.entry in ENTRIES else None


def system_id_runs(tables: Mapping[str, Table], parameters: Mapping[str, float]) -> tuple[Run, ...]:
    """Runs in the order flown: a new one begins where the time of the waveform starts again.

    ``SIDS``, written when the mode is entered, says axis and band. A log that lost it is read with ``SID_AXIS``, which
    holds for the end of the flight.
    """
    data = tables.get("SIDD")
    if data is None or (time_s := data.time_s) is None or not data.holds_numbers("Time"):
        return ()
    waveform_s = data.column("Time")
    begins = np.flatnonzero(waveform_s[1:] < waveform_s[:-1]) + 1
    edges = [0, *begins.tolist(), len(data)]
    runs = []
    for begin, end in pairwise(edges):
        start_s, stop_s = float(time_s[begin]), float(time_s[end - 1])
        entry, planned = _settings(tables.get("SIDS"), start_s) or (int(parameters.get("SID_AXIS", 0.0)), None)
        messages = slice(begin, end)
        runs.append(
            Run(
                messages=messages,
                start_s=start_s,
                stop_s=stop_s,
                entry=entry,
                planned_rad_s=planned,
                band_rad_s=_flown(data, messages, planned),
            )
        )
    return tuple(runs)


def _flown(data: Table, messages: slice, planned: tuple[float, float] | None) -> tuple[float, float] | None:
    """The band that was really flown: a pilot may leave the mode early, and a log may be cut."""
    if not data.holds_numbers("F"):
        return planned
    frequency = 2.0 * math.pi * data.chosen(messages).numbers("F")[0]
    frequency = frequency[np.isfinite(frequency) & (frequency > 0.0)]
    if frequency.size == 0 or not frequency.min() < frequency.max():
        return planned
    return float(frequency.min()), float(frequency.max())


def _settings(setup: Table | None, start_s: float) -> tuple[int, tuple[float, float] | None] | None:
    """Axis and band of the last ``SIDS`` before a run."""
    if setup is None or (time_s := setup.time_s) is None or not setup.holds_numbers("Ax"):
        return None
    last = int(np.searchsorted(time_s, start_s, side="right")) - 1
    if last < 0:
        return None
    entry = int(setup.column("Ax")[last])
    if not setup.holds_numbers("FSt", "FSp"):
        return entry, None
    low, high = sorted(2.0 * math.pi * float(setup.column(name)[last]) for name in ("FSt", "FSp"))
    return entry, (low, high) if 0.0 < low < high < math.inf else None


def system_id_topics(tables: Mapping[str, Table], runs: tuple[Run, ...]) -> Iterator[Topic]:
    """One topic for each run, so that an excitation channel holds the runs of its axis alone."""
    for number, run in enumerate(runs, start=1):
        rows: tuple[Row, ...] = SYSTEM_ID
        if run.axis is not None:
            rows = (*rows, Row("Targ", f"{run.axis}_excitation", ENTRIES[run.entry][1]))
        topic = topic_of(tables["SIDD"], rows, name=f"SIDD run {number}", chosen=run.messages)
        if topic is not None:
            yield topic


def declared_maneuvers(runs: tuple[Run, ...]) -> tuple[Maneuver, ...]:
    """The sweeps that the log announces."""
    return tuple(
        Maneuver(
            axis=run.axis,
            kind="sweep",
            start_s=run.start_s,
            stop_s=run.stop_s,
            band_rad_s=run.band_rad_s,
            origin="declared",
            signal=f"{run.axis}_excitation",
        )
        for run in runs
        if run.axis is not None and run.start_s < run.stop_s
    )


def system_id_findings(runs: tuple[Run, ...]) -> Iterator[Finding]:
    """Runs whose injected signal has no name here."""
    for number, run in enumerate(runs, start=1):
        if run.planned_rad_s and run.band_rad_s and run.band_rad_s[1] < _ENDED_EARLY * run.planned_rad_s[1]:
            yield Finding(
                kind="sweep_ended_early",
                severity="warning",
                where=f"SIDD run {number}",
                message=f"the sweep of {run.start_s:.2f} s to {run.stop_s:.2f} s reached {run.band_rad_s[1]:.3g} of "
                f"the planned {run.planned_rad_s[1]:.3g} rad/s",
                numbers={"reached_rad_s": run.band_rad_s[1], "planned_rad_s": run.planned_rad_s[1]},
            )
        if run.axis is None:
            yield Finding(
                kind="no_excitation",
                severity="warning",
                where=f"SIDD run {number}",
                message=f"the SYSTEMID run of {run.start_s:.2f} s to {run.stop_s:.2f} s was injected at SID_AXIS "
                f"{run.entry}, which is none of 1 to 13; its signal is not used",
                numbers={"sid_axis": run.entry, "start_s": run.start_s, "stop_s": run.stop_s},
            )


def decimation_findings(
    topics: tuple[Topic, ...], runs: tuple[Run, ...], parameters: Mapping[str, float]
) -> Iterator[Finding]:
    """Rates of a SYSTEMID log that hold every n-th sample of the loop, without a filter in front.

    Vibration above half the rate of the log then appears as slower motion, in the band of the response or outside. The
    remark is a warning where the sweeps themselves come within a factor of two of that limit: there the response's own
    content is folded.
    """
    loop_hz = parameters.get("SCHED_LOOP_RATE", 0.0)
    tops = [run.band_rad_s[1] for run in runs if run.band_rad_s]
    reached_hz = max(tops, default=0.0) / (2.0 * math.pi)
    mask = int(parameters.get("LOG_BITMASK", 0.0))
    if not runs:
        return
    for topic in topics:
        rate_hz = topic.sample_rate_hz
        named = topic.name == "RATE" or topic.name.startswith("SIDD")
        if not named or not 0.0 < rate_hz < _LOOP_BY_LOOP * loop_hz:
            continue
        bits = mask | _EVERY_LOOP_BITS
        remedy = "" if bits == mask else f"; set bits 0 and 1 of LOG_BITMASK to log every loop: {mask} becomes {bits}"
        yield Finding(
            kind="decimated",
            severity="warning" if 2.0 * reached_hz > 0.5 * rate_hz else "info",
            where=topic.name,
            message=f"{topic.name} was logged at {rate_hz:.0f} Hz out of a loop of {loop_hz:.0f} Hz, one sample in "
            f"{loop_hz / rate_hz:.0f} without a filter in front: what the vehicle does above "
            f"{0.5 * rate_hz:.0f} Hz, vibration above all, folds into the response{remedy}",
            numbers={"rate_hz": rate_hz, "loop_hz": loop_hz, "nyquist_hz": 0.5 * rate_hz, "sweep_top_hz": reached_hz},
        )
