"""Which stretches of which logs a frequency response is made from."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rotorid.data.channel import AXES
from rotorid.data.findings import Finding
from rotorid.data.maneuver import Maneuver
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.pipeline.instruments import Flown, axes_of
from rotorid.pipeline.measure import measure
from rotorid.pipeline.selection import RICH_KINDS, described, each_once, inside, of_axes, whole_flights
from rotorid.pipeline.settings import ResponseSettings
from rotorid.signal.segment import find_excitations
from rotorid.typing import Axis

_FAR_LESS = 0.5
"""A maneuver with less than this share of the coherence of the best one on its axis is left out."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidate:
    """A maneuver, its own mean coherence by pair ``output/input``, and whether it is used."""

    record: FlightRecord
    maneuver: Maneuver
    coherence: Mapping[str, float]
    used: bool = True


@dataclass(frozen=True, kw_only=True, eq=False)
class Chosen:
    """Maneuvers of a response, those left out among the candidates."""

    candidates: tuple[Candidate, ...]
    findings: tuple[Finding, ...]

    @property
    def flown(self) -> tuple[Flown, ...]:
        """Records and maneuvers that are used."""
        return tuple((item.record, item.maneuver) for item in self.candidates if item.used)


def choose(
    records: Sequence[FlightRecord],
    inputs: Sequence[str],
    outputs: tuple[str, ...],
    settings: ResponseSettings,
    progress: Callable[[str], None],
) -> Chosen:
    """The rich excitations of the inputs' axes, without those that are far less coherent than the best of their axis.

    Inputs that are no commands of an axis take the excitations of the outputs' axes. Without any excitation a flight is
    read whole.

    Raises
    ------
    InsufficientDataError
        A given segment lies outside of every record, or no record has a flight.
    """
    each_once(records)
    axes = axes_of(inputs, outputs)
    flown = _given(records, axes, settings) or _found(records, axes)
    if not flown:
        return _whole_flights(records, axes)
    if len(flown) < 2:
        return Chosen(candidates=tuple(_plain(item) for item in flown), findings=())
    progress("coherence of each maneuver")
    return _by_coherence([_candidate(item, inputs, outputs, settings) for item in flown])


def _given(records: Sequence[FlightRecord], axes: Sequence[Axis], settings: ResponseSettings) -> list[Flown]:
    if not settings.segments:
        return []
    segments = of_axes(settings.segments, axes)
    flown = [(record, described(record, m)) for record in records for m in segments if inside(record, m)]
    if not flown:
        spans = ", ".join(f"{r.start_s:.1f} to {r.stop_s:.1f} s of {r.source.name}" for r in records)
        message = f"No given segment lies inside {spans}."
        raise InsufficientDataError(
            "no given segment lies inside the records",
            needed=f"a segment of {' or '.join(axes)} within {spans}",
            remedy="see the excitations that rotorid inspect finds",
            findings=[Finding(kind="no_excitation", severity="error", where=", ".join(axes), message=message)],
        )
    return flown


def _found(records: Sequence[FlightRecord], axes: Sequence[Axis]) -> list[Flown]:
    found = [(record, m) for record in records for axis in axes for m in find_excitations(record, axis)]
    return [(record, m) for record, m in found if m.kind in RICH_KINDS or m.origin == "given"]


def _whole_flights(records: Sequence[FlightRecord], axes: Sequence[Axis]) -> Chosen:
    candidates, findings = [], []
    for record, maneuver in whole_flights(records, axes):
        start_s, stop_s = maneuver.start_s, maneuver.stop_s
        candidates.append(Candidate(record=record, maneuver=maneuver, coherence={}))
        findings.append(
            Finding(
                kind="no_excitation",
                severity="warning",
                where=record.source.name,
                message=(
                    f"No sweep, multisine or random binary signal of {' or '.join(axes)} was found in "
                    f"{record.source.name}, so the whole flight from {start_s:.1f} to {stop_s:.1f} s was used. "
                    "Where gusts and not the pilot move the vehicle, such a response shows the controller."
                ),
                numbers={"start_s": start_s, "stop_s": stop_s},
            )
        )
    return Chosen(candidates=tuple(candidates), findings=tuple(findings))


def _plain(flown: Flown) -> Candidate:
    record, maneuver = flown
    return Candidate(record=record, maneuver=maneuver, coherence={})


def _candidate(flown: Flown, inputs: Sequence[str], outputs: tuple[str, ...], settings: ResponseSettings) -> Candidate:
    """A maneuver with the coherence that it has alone, to the input of its own axis."""
    record, maneuver = flown
    own = tuple(name for name in inputs if name == f"{maneuver.axis}_command") or tuple(inputs)
    alone = (
        replace(settings, instruments=(), windows_s=()) if len(own) < len(inputs) else replace(settings, windows_s=())
    )
    try:
        measured = measure([flown], inputs=own, outputs=outputs, settings=alone)
    except InsufficientDataError:
        # Too short or too still to be judged alone: it may still add to the others.
        return _plain(flown)
    # That of input and output, with an instrument or without, so that maneuvers can be compared.
    response = measured.beside or measured.response
    coherence = {
        f"{output}/{name}": float(np.mean(response.coherence[y, u]))
        for y, output in enumerate(response.outputs)
        for u, name in enumerate(response.inputs)
    }
    return Candidate(record=record, maneuver=maneuver, coherence=coherence)


def _by_coherence(candidates: Sequence[Candidate]) -> Chosen:
    best = {axis: max((_peak(item) for item in candidates if item.maneuver.axis == axis), default=0.0) for axis in AXES}
    kept, findings = [], []
    for item in candidates:
        top = best[item.maneuver.axis]
        used = not item.coherence or item.maneuver.origin == "given" or _peak(item) >= _FAR_LESS * top
        kept.append(replace(item, used=used))
        if not used:
            where = f"{item.record.source.name}: {item.maneuver.axis} at {item.maneuver.start_s:.1f} s"
            findings.append(
                Finding(
                    kind="low_coherence",
                    severity="warning",
                    where=where,
                    message=(
                        f"This maneuver has a mean coherence of {_peak(item):.2f} and the best of its axis {top:.2f}; "
                        "it was left out. Name it with --segment to use it."
                    ),
                    numbers={"mean_coherence": _peak(item), "best": top},
                )
            )
    return Chosen(candidates=tuple(kept), findings=tuple(findings))


def _peak(item: Candidate) -> float:
    """The coherence of the pair that shows the maneuver best."""
    return max(item.coherence.values(), default=0.0)
