"""Runs of ArduPilot's SYSTEMID mode: when, on which axis, and in which band.

A run is a declared maneuver. ``SIDS`` says axis and band when the mode is entered, ``SIDD`` what was flown.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from types import MappingProxyType

import numpy as np

from rotorid.data.findings import Finding, warn
from rotorid.data.record import Maneuver
from rotorid.io.ardupilot.dataflash import Table
from rotorid.io.screening import without_isolated
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


def runs_of(tables: Mapping[str, Table], parameters: Mapping[str, float]) -> tuple[Run, ...]:
    """Runs in the order flown: a new one begins where the time of the waveform starts again.

    ``SIDS``, written when the mode is entered, says axis and band. A log that lost it is read with ``SID_AXIS``, which
    holds for the end of the flight.
    """
    data = tables.get("SIDD")
    if data is None or (time_s := data.time_s) is None or not data.holds_numbers("Time"):
        return ()
    waveform_s = without_isolated(data.column("Time"))
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
                band_rad_s=_swept_band(data, messages, planned),
            )
        )
    return tuple(runs)


def _swept_band(data: Table, messages: slice, planned: tuple[float, float] | None) -> tuple[float, float] | None:
    """The band that was really flown: a pilot may leave the mode early, and a log may be cut."""
    if not data.holds_numbers("F"):
        return planned
    frequency = 2.0 * math.pi * without_isolated(data.chosen(messages).numbers("F")[0])
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


def run_findings(runs: tuple[Run, ...]) -> Iterator[Finding]:
    """Runs whose injected signal has no name here."""
    for number, run in enumerate(runs, start=1):
        if run.planned_rad_s and run.band_rad_s and run.band_rad_s[1] < _ENDED_EARLY * run.planned_rad_s[1]:
            yield warn(
                "sweep_ended_early",
                f"SIDD run {number}",
                f"the sweep of {run.start_s:.2f} s to {run.stop_s:.2f} s reached {run.band_rad_s[1]:.3g} of "
                f"the planned {run.planned_rad_s[1]:.3g} rad/s",
                reached_rad_s=run.band_rad_s[1],
                planned_rad_s=run.planned_rad_s[1],
            )
        if run.axis is None:
            yield warn(
                "no_excitation",
                f"SIDD run {number}",
                f"the SYSTEMID run of {run.start_s:.2f} s to {run.stop_s:.2f} s was injected at SID_AXIS "
                f"{run.entry}, which is not 1 to 13; its signal is not used",
                sid_axis=run.entry,
                start_s=run.start_s,
                stop_s=run.stop_s,
            )
