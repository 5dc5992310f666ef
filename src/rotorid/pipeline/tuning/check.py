"""After the flight with new gains: are the loops what was foretold, and what to do next.

The second flight is identified as the first was, and its flown loops are compared with those that were foretold. A
figure is inside where its value lies in the foretold interval, widened by what the second flight itself does not know.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, warn, worst_first
from rotorid.data.quantity import TWO_SIDED_95, Quantity
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.pipeline.provenance import Provenance
from rotorid.pipeline.results import IdentifiedModel, Records
from rotorid.pipeline.tuning.proposal import AxisTuning, TuneSettings, tune
from rotorid.tuning.loops import quantities
from rotorid.typing import Axis, ComplexArray, FloatArray

COMPARED = {
    "crossover_rad_s": "crossover",
    "phase_margin_deg": "phase margin",
    "sensitivity_peak": "sensitivity peak",
}
"""Figures that are foretold; a gain margin lies outside the band in half of the flights and is not."""

_LOOP = {"rate": "the rate loop", "whole": "the loop with the angle loop"}
_SAME = 1e-4


@dataclass(frozen=True, kw_only=True, eq=False)
class Foretold(Immutable):
    """What a proposal said of one axis.

    Parameters
    ----------
    flown, proposed
        Value of every parameter, by the firmware's name.
    rate, whole
        Figures of the rate loop alone and of the whole one with the proposed gains, by name.
    omega_rad_s, loops
        Frequencies, and the whole loop on all draws, ``(draws, f)``; ``None`` where a document alone is at hand.
    """

    flown: Mapping[str, float]
    proposed: Mapping[str, float]
    rate: Mapping[str, Quantity]
    whole: Mapping[str, Quantity]
    omega_rad_s: FloatArray | None = None
    loops: ComplexArray | None = None

    def __post_init__(self) -> None:
        self._set(flown=self.flown, proposed=self.proposed, rate=self.rate, whole=self.whole)


@dataclass(frozen=True, kw_only=True)
class ComparedFigure(Immutable):
    """One figure of a loop, foretold and measured.

    Parameters
    ----------
    loop
        ``rate`` or ``whole``.
    name
        Such as ``crossover_rad_s``.
    foretold, measured
        With their intervals.
    inside
        Whether the second flight is what was foretold.
    """

    loop: str
    name: str
    foretold: Quantity
    measured: Quantity
    inside: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class CheckedAxis(Immutable):
    """An axis after its flight with other gains.

    Parameters
    ----------
    gains
        Which gains are in the second log: ``proposed``, ``flown`` (those of the first) or ``other``.
    foretold
        What the proposal said.
    figures
        Foretold and measured.
    tuning
        The second flight, as ``tune`` sees it: its loops, and what it would change now.
    verdict
        ``as_foretold``, ``inside_limits``, ``worse`` or ``other_gains``.
    sentence, advice
        What came of it, and what to do next.
    """

    gains: str
    foretold: Foretold
    figures: tuple[ComparedFigure, ...]
    tuning: AxisTuning
    verdict: str
    sentence: str
    advice: str


@dataclass(frozen=True, kw_only=True, eq=False)
class CheckedTuning(Immutable):
    """What came of a proposal.

    Parameters
    ----------
    axes
        Those of the proposal that the second flight shows.
    findings
        The worst first.
    provenance
        Of the second flight.
    """

    axes: Mapping[Axis, CheckedAxis]
    findings: tuple[Finding, ...]
    provenance: Provenance

    def __post_init__(self) -> None:
        self._set(axes=self.axes, findings=tuple(self.findings))

    @property
    def as_foretold(self) -> bool:
        """Whether every axis flies as it was foretold."""
        return all(one.verdict == "as_foretold" for one in self.axes.values())


def check_tuning(
    foretold: Mapping[Axis, Foretold],
    records: Records,
    models: Sequence[IdentifiedModel] = (),
    *,
    settings: TuneSettings | None = None,
    **options: Any,
) -> CheckedTuning:
    """Whether the loops of a second flight are what was foretold.

    Parameters
    ----------
    foretold
        By axis, as ``tune.json`` holds it.
    records
        Logs of the second flight.
    models
        Rate models of it, where they are at hand.
    settings, **options
        As for :func:`rotorid.pipeline.tuning.proposal.tune`.

    Raises
    ------
    InsufficientDataError
        No axis of the proposal can be told from the second flight.
    UsageError
        The proposal holds no axis.
    """
    if not foretold:
        raise UsageError("a proposal without any axis came", needed="a tune.json in which gains were looked at")
    chosen = replace(settings or TuneSettings(), **options)
    chosen = replace(chosen, axes=tuple(axis for axis in chosen.axes if axis in foretold), filters={})
    found = tune(models, records, settings=chosen)
    axes = {axis: _checked(axis, foretold[axis], one, chosen) for axis, one in found.axes.items()}
    if not axes:
        raise InsufficientDataError("no axis of the proposal was flown", needed="a sweep of an axis of the proposal")
    said = [_finding(axis, one) for axis, one in axes.items()]
    return CheckedTuning(
        axes=axes,
        findings=worst_first([*(one for one in said if one is not None), *found.findings]),
        provenance=found.provenance,
    )


def _checked(axis: Axis, before: Foretold, now: AxisTuning, settings: TuneSettings) -> CheckedAxis:
    judged = now.proposal.flown
    figures = [
        ComparedFigure(
            loop=loop, name=name, foretold=told[name], measured=seen[name], inside=_inside(told[name], seen[name])
        )
        for loop, told, seen in (
            ("rate", before.rate, quantities(judged.rate)),
            ("whole", before.whole, quantities(judged.whole)),
        )
        for name in COMPARED
        if name in told and name in seen
    ]
    logged = {name: value for name, (value, _) in now.parameters.items()}
    gains = _which(before, logged)
    peak = max((one.measured.value for one in figures if one.name == "sensitivity_peak"), default=math.inf)
    missed = [one for one in figures if not one.inside]
    verdict = (
        "other_gains"
        if gains != "proposed"
        else "as_foretold"
        if figures and not missed
        else "worse"
        if peak > settings.robustness * 1.03
        else "inside_limits"
    )
    sentence, advice = _words(axis, verdict, gains, figures, now)
    return CheckedAxis(
        gains=gains,
        foretold=before,
        figures=tuple(figures),
        tuning=now,
        verdict=verdict,
        sentence=sentence,
        advice=advice,
    )


def _inside(foretold: Quantity, measured: Quantity) -> bool:
    slack = TWO_SIDED_95 * measured.std
    return foretold.lower - slack <= measured.value <= foretold.upper + slack


def _which(before: Foretold, logged: Mapping[str, float]) -> str:
    """Which gains a log has: a firmware keeps them as numbers of 32 bits."""

    def alike(told: Mapping[str, float]) -> bool:
        shared = [name for name in told if name in logged]
        return bool(shared) and all(
            math.isclose(told[name], logged[name], rel_tol=_SAME, abs_tol=1e-9) for name in shared
        )

    return "proposed" if alike(before.proposed) else "flown" if alike(before.flown) else "other"


def _words(axis: Axis, verdict: str, gains: str, figures: Sequence[ComparedFigure], now: AxisTuning) -> tuple[str, str]:
    """What came of it and what to do next, in sentences."""
    peak = next((one.measured.value for one in figures if (one.loop, one.name) == ("whole", "sensitivity_peak")), None)
    held = f" Its sensitivity peak is {peak:.2f}." if peak is not None else ""
    if verdict == "other_gains":
        old = gains == "flown"
        which = "the gains of the first flight" if old else "gains that are neither the proposed nor the old ones"
        todo = (
            "Load the proposed file, and fly again" if old else "Propose anew from this log, or load the proposed file"
        )
        return f"In this log {axis} flies {which}: nothing can be checked.{held}", f"{todo}."
    further = (
        " A further step is open: rotorid tune on this log proposes it." if now.changed else " Nothing more to gain."
    )
    if verdict == "as_foretold":
        return f"The loop of {axis} is what was foretold.{held}", f"Keep these gains.{further}"
    names = ", ".join(f"{COMPARED[one.name]} of {_LOOP[one.loop]}" for one in figures if not one.inside)
    if verdict == "worse":
        return (
            f"The loop of {axis} is not what was foretold ({names}), and less robust than it should be.{held}",
            "Go back to the old gains with the rollback file, and fly a longer sweep before the next proposal.",
        )
    return (
        f"The loop of {axis} is not what was foretold ({names}), and inside its limits.{held}",
        f"These gains can stay; the next proposal should be made from this log.{further}",
    )


def _finding(axis: Axis, one: CheckedAxis) -> Finding | None:
    if one.verdict == "as_foretold":
        return None
    kind = "other_gains" if one.verdict == "other_gains" else "not_as_foretold"
    return warn(kind, axis, f"{one.sentence} {one.advice}")
