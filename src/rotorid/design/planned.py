"""A plan as its records will be cut: which maneuvers are fitted, how much quiet time goes with them, which windows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rotorid.data.channel import Channel
from rotorid.data.flight_plan import Entry, FlightPlan, PlannedInput
from rotorid.data.history import TimeHistory
from rotorid.data.immutable import Immutable
from rotorid.data.maneuver import Maneuver
from rotorid.design.seen import as_seen
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.spectral.windows import WindowPlan, given_windows, plan_windows
from rotorid.typing import Axis, FloatArray

_POINTS = 100
_HIGHEST_RAD_S = 100.0
_LONGEST_MARGIN_S = 20.0
_SHORT_KINDS = ("doublet", "multistep")
_ENDING_KINDS = ("sweep", "multisine")
"""Of which nothing lies above a highest frequency; what shows there is the flank of a window's spectral line."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Planned(Immutable):
    """Test inputs as they will stand in the records of a fit.

    Parameters
    ----------
    flight
        Test inputs of the whole flight, one channel for each axis.
    spans
        First sample of each record, and the one after its last.
    axes
        The axes of these channels, those of the inputs of the model first.
    entries
        Where the test inputs of each axis enter.
    fitted
        The test inputs that are fitted, as an identification sees them.
    """

    flight: TimeHistory
    spans: tuple[tuple[int, int], ...]
    axes: tuple[Axis, ...]
    entries: tuple[Entry, ...]
    fitted: tuple[Maneuver, ...]

    def records(self, flight: TimeHistory | None = None) -> tuple[TimeHistory, ...]:
        """The records that are cut out of the test inputs, or out of a history of the same flight."""
        whole = flight or self.flight
        return tuple(
            replace(whole, values=whole.values[:, first:last], start_s=whole.start_s + first / whole.sample_rate_hz)
            for first, last in self.spans
        )

    def windows(self, band_rad_s: tuple[float, float], lengths_s: Sequence[float] = ()) -> WindowPlan:
        """Windows for the band: those given, or by the rule that an identification follows."""
        lengths = np.sort([(last - first) / self.flight.sample_rate_hz for first, last in self.spans])[::-1]
        typical = float(lengths[np.searchsorted(np.cumsum(lengths), 0.5 * lengths.sum())])
        if lengths_s:
            return given_windows(lengths_s, typical)
        return plan_windows(typical, float(lengths.sum()), band_rad_s)

    @property
    def band_rad_s(self) -> tuple[float, float]:
        """The band to look at where none was asked for: that of the sweeps, or what the log carries."""
        nyquist_rad_s = np.pi * self.flight.sample_rate_hz
        carried = min(0.25 * nyquist_rad_s, _HIGHEST_RAD_S)
        bands = [one.band_rad_s for one in self.fitted if one.band_rad_s is not None]
        sweeps = all(one.kind == "sweep" and one.band_rad_s is not None for one in self.fitted)
        low = min((band[0] for band in bands), default=0.5)
        return low, min(max(band[1] for band in bands) if sweeps else carried, 0.8 * nyquist_rad_s)

    def excited_to_rad_s(self, axis: Axis) -> float:
        """How far up sweeps and multisines of an axis go; infinite where others leave that to the coherence."""
        own = [one for one in self.fitted if one.axis == axis]
        tops = [one.band_rad_s[1] for one in own if one.kind in _ENDING_KINDS and one.band_rad_s is not None]
        return max(tops) if tops and len(tops) == len(own) else np.inf


def grid_rad_s(band_rad_s: tuple[float, float], windows: WindowPlan) -> FloatArray:
    """Logarithmic grid over what the windows support of a band, shape ``(f,)``."""
    low, high = max(band_rad_s[0], windows.lowest_rad_s), band_rad_s[1]
    return np.geomspace(min(low, 0.9 * high), high, _POINTS)


def as_planned(
    plan: FlightPlan,
    axes: Sequence[Axis],
    sample_rate_hz: float,
    *,
    declared: Sequence[Entry] = ("command",),
    alone: bool = False,
) -> Planned:
    """Cut a plan as an identification of some axes will cut its log.

    Doublets and multisteps are kept for verification where anything longer is flown. Quiet time of up to 20 s and half
    of a maneuver goes with it, up to the next maneuver of another axis; what then touches becomes one record.

    Parameters
    ----------
    plan
        The flight.
    axes
        Of the inputs of the model.
    sample_rate_hz
        Rate of the log.
    declared
        Where test inputs enter that the log declares with their band; of others an identification finds what it can.
    alone
        Whether the log holds declared test inputs only while they are flown, so that no quiet time goes with them.

    Raises
    ------
    InsufficientDataError
        An axis is not excited.
    UsageError
        Test inputs of one axis enter at several places.
    """
    own = [one for one in plan.inputs if one.axis in axes]
    fitted = tuple(one for one in own if one.maneuver.kind not in _SHORT_KINDS) or tuple(own)
    if silent := [axis for axis in axes if axis not in {one.axis for one in fitted}]:
        raise InsufficientDataError(
            f"the plan {plan.name} without test inputs on {', '.join(silent)} came", needed="test inputs on every axis"
        )
    spans = _spans(plan, fitted, declared if alone else ())
    sources = (*axes, *(axis for axis in plan.axes if axis not in axes and _moves(plan, axis, spans)))
    flight = _flight(plan, sources, sample_rate_hz)
    return Planned(
        flight=flight,
        spans=tuple((round(start_s * sample_rate_hz), round(stop_s * sample_rate_hz)) for start_s, stop_s in spans),
        axes=sources,
        entries=tuple(_entry(plan, axis) for axis in sources),
        fitted=as_seen(fitted, flight, declared=declared),
    )


def _spans(plan: FlightPlan, fitted: Sequence[PlannedInput], alone: Sequence[Entry]) -> list[tuple[float, float]]:
    """Start and stop of each record; no quiet time goes with what enters at one of ``alone``."""
    widest_s = min(0.5 * max(one.maneuver.duration_s for one in fitted), _LONGEST_MARGIN_S)
    barriers = [one for one in plan.inputs if not any(_overlap(one, mine) for mine in fitted)]
    spans: list[tuple[float, float]] = []
    for one in sorted(fitted, key=lambda mine: mine.start_s):
        earliest = max([0.0, *(other.stop_s for other in barriers if other.stop_s <= one.start_s)])
        latest = min([plan.duration_s, *(other.start_s for other in barriers if other.start_s >= one.stop_s)])
        margin_s = 0.0 if one.entry in alone else widest_s
        start_s, stop_s = max(one.start_s - margin_s, earliest), min(one.stop_s + margin_s, latest)
        if spans and start_s < spans[-1][1]:
            start_s, stop_s = spans[-1][0], max(spans.pop()[1], stop_s)
        spans.append((start_s, stop_s))
    return spans


def _overlap(a: PlannedInput, b: PlannedInput) -> bool:
    return a.start_s < b.stop_s and b.start_s < a.stop_s


def _moves(plan: FlightPlan, axis: Axis, spans: Sequence[tuple[float, float]]) -> bool:
    own = [one for one in plan.inputs if one.axis == axis]
    return any(one.start_s < stop_s and start_s < one.stop_s for one in own for start_s, stop_s in spans)


def _entry(plan: FlightPlan, axis: Axis) -> Entry:
    entries = list(dict.fromkeys(one.entry for one in plan.inputs if one.axis == axis))
    if len(entries) > 1:
        raise UsageError(f"test inputs of {axis} at {' and '.join(entries)} came", needed="one place for each axis")
    return entries[0]


def _flight(plan: FlightPlan, axes: Sequence[Axis], sample_rate_hz: float) -> TimeHistory:
    time_s = np.arange(round(plan.duration_s * sample_rate_hz)) / sample_rate_hz
    rows = [
        sum((one.at(time_s) for one in plan.inputs if one.axis == axis), start=np.zeros_like(time_s)) for axis in axes
    ]
    return TimeHistory(
        values=np.stack(rows),
        channels=tuple(Channel(name=f"{axis}_excitation", unit="1") for axis in axes),
        sample_rate_hz=sample_rate_hz,
        start_s=0.0,
    )
