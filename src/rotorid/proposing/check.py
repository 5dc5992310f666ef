"""After the flight with new gains: are the loops as predicted, and what to do next.

The second flight is identified like the first, and its loops are compared with the prediction. A figure is inside where
its value lies in the predicted interval, widened by the uncertainty of the second flight.

An identified plant may be wrong in both flights in the same way, and then it agrees with itself. Where a test signal
was added at the mixer, the whole loop is measured with it, without any model, and that measurement counts; so does the
velocity loop where its set-points moved and are logged, with the logged gains. Two wide intervals always overlap, so an
uncertain figure decides nothing.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Unpack

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.display import capital
from rotorid.data.findings import Finding, warn, worst_first
from rotorid.data.quantities import QUANTITIES
from rotorid.data.quantity import TWO_SIDED_95, Quantity
from rotorid.data.record import FlightRecord
from rotorid.data.trust import ROBUSTNESS
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.io.records import as_records
from rotorid.loops.rate_loops import loop_by_injection, shown_quantities
from rotorid.models.autopilots.outer import OUTER_LOOPS
from rotorid.proposing.axis_tuning import AxisTuning
from rotorid.proposing.outer import flown_outer
from rotorid.proposing.outer_flown import LoopSeen, exclude_each_other, loop_by_setpoints
from rotorid.proposing.proposal import tune
from rotorid.proposing.settings import TUNED_AXES, TuneSettings
from rotorid.results.model import IdentifiedModel, Records
from rotorid.results.provenance import Provenance
from rotorid.settings.option import as_settings
from rotorid.tuning.bands import BAND_OVER_CROSSOVER
from rotorid.tuning.kinds import KINDS, LOOP_WORDS, loop_words
from rotorid.tuning.loops import Gains
from rotorid.typing import ComplexArray, FloatArray, LoopName

if TYPE_CHECKING:
    from rotorid.settings.option_types import TuneOptions

COMPARED = ("crossover_rad_s", "phase_margin_deg", "sensitivity_peak")
"""Figures that are compared; a gain margin lies outside the measured band in half of the flights and is not."""

WIDEST: Mapping[str, float] = {"crossover_rad_s": 0.1, "sensitivity_peak": 0.12}
"""Half the interval of a figure over its value, above which it decides nothing: a loop that is off by more flies
differently. Good flights give a crossover to 4 % and a peak to 3 %."""

WIDEST_PHASE_DEG = 6.0
"""The same for a phase margin; good flights give it to 2.5 degrees."""

_PEAK_SLACK = 1.03
"""Sensitivity peak relative to the requested limit, up to which a loop counts as robust."""

_SWEEPS: Mapping[LoopName, str] = {
    "velocity": "Fly a longer sweep of roll and pitch",
    "climb": "Fly a longer sweep of the thrust",
}
"""What shows the plant of an outer loop better, as the beginning of a sentence."""
_SAME = 5e-3
"""Relative difference up to which gains are the same: a ground station rounds them, and no figure would show it."""

_MODEL, _INJECTION, _SETPOINTS = "model", "injection", "setpoints"


@dataclass(frozen=True, kw_only=True, eq=False)
class Foretold(Immutable):
    """The prediction of a proposal for one axis.

    Parameters
    ----------
    flown, proposed
        Value of every parameter, by the firmware's name.
    rate, whole
        Figures of the rate loop alone and of the whole one with the proposed gains, by name.
    omega_rad_s, loops
        Frequencies, and the whole loop on all draws, ``(draws, f)``; ``None`` where a document alone is at hand.
    robustness
        Requested largest sensitivity peak.
    """

    flown: Mapping[str, float]
    proposed: Mapping[str, float]
    rate: Mapping[str, Quantity]
    whole: Mapping[str, Quantity]
    omega_rad_s: FloatArray | None = None
    loops: ComplexArray | None = None
    robustness: float = ROBUSTNESS

    def __post_init__(self) -> None:
        self._set(flown=self.flown, proposed=self.proposed, rate=self.rate, whole=self.whole)


@dataclass(frozen=True, kw_only=True)
class ComparedFigure(Immutable):
    """One figure of a loop, predicted and measured.

    Parameters
    ----------
    loop
        ``rate`` or ``whole``.
    name
        Such as ``crossover_rad_s``.
    foretold, measured
        With their intervals.
    inside
        Whether the second flight is as predicted, within both intervals.
    method
        ``injection``, measured with the test signal at the mixer, ``setpoints``, with those of the velocity, or
        ``model``: the identified plant times the gains.
    decided
        Whether it counts: it is outside, or both intervals are narrow enough to exclude another loop.
    """

    loop: str
    name: str
    foretold: Quantity
    measured: Quantity
    inside: bool
    method: str = _MODEL
    decided: bool = True


@dataclass(frozen=True, kw_only=True, eq=False)
class CheckedAxis(Immutable):
    """An axis after its flight with other gains.

    Parameters
    ----------
    gains
        Which gains are in the second log: ``proposed``, ``flown`` (those of the first) or ``other``.
    foretold
        The prediction.
    figures
        Predicted and measured.
    tuning
        The second flight, tuned: its loops, and what would change now.
    contradicted
        Whether what was measured shows another loop than the identified plant does.
    verdict
        ``as_foretold``, ``inside_limits``, ``worse``, ``cannot_tell`` or ``other_gains``.
    sentence, advice
        The result, and what to do next.
    """

    gains: str
    foretold: Foretold
    figures: tuple[ComparedFigure, ...]
    tuning: AxisTuning
    verdict: str
    sentence: str
    advice: str
    contradicted: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class CheckedTuning(Immutable):
    """A flight compared with a proposal.

    Parameters
    ----------
    axes
        Those of the proposal that the second flight shows.
    findings
        The worst first.
    provenance
        Of the second flight.
    unchecked
        Those with new gains that it does not show.
    """

    axes: Mapping[LoopName, CheckedAxis]
    findings: tuple[Finding, ...]
    provenance: Provenance
    unchecked: tuple[LoopName, ...] = ()

    def __post_init__(self) -> None:
        self._set(axes=self.axes, findings=tuple(self.findings))

    @property
    def as_foretold(self) -> bool:
        """Whether every axis with new gains flies as it was foretold."""
        return not self.unchecked and all(checked.verdict == "as_foretold" for checked in self.axes.values())


def check_tuning(
    foretold: Mapping[LoopName, Foretold],
    records: Records,
    models: Sequence[IdentifiedModel] = (),
    *,
    settings: TuneSettings | None = None,
    **options: Unpack[TuneOptions],
) -> CheckedTuning:
    """Whether the loops of a second flight are what was foretold.

    Parameters
    ----------
    foretold
        By axis and outer loop, as ``tune.json`` holds it.
    records
        Logs of the second flight.
    models
        Rate models of it, where they are at hand.
    settings, **options
        As for :func:`rotorid.proposing.proposal.tune`. Without axes all of the proposal are compared. The sensitivity
        peak that a proposal asked for goes before that of the settings.

    Raises
    ------
    InsufficientDataError
        The second flight supports no axis of the proposal.
    UsageError
        The proposal contains no axis.
    """
    if not foretold:
        raise UsageError("the proposal contains no axis", needed="a tune.json with gains of at least one axis")
    chosen = as_settings(TuneSettings, settings, options)
    asked = max(item.robustness for item in foretold.values())
    wanted = chosen.axes if chosen.axes != TUNED_AXES else (*TUNED_AXES, *OUTER_LOOPS)
    axes_compared = tuple(axis for axis in wanted if axis in foretold)
    chosen = replace(chosen, axes=axes_compared, filters={}, robustness=asked)
    found = tune(models, records, settings=chosen)
    logs = as_records(records)
    axes = {
        axis: _checked(axis, foretold[axis], found.axes[axis], _measured(axis, logs))
        for axis in axes_compared
        if axis in found.axes
    }
    if not axes:
        raise InsufficientDataError("no axis of the proposal was flown", needed="a sweep on roll, pitch or yaw")
    findings = [_finding(axis, checked) for axis, checked in axes.items()]
    return CheckedTuning(
        axes=axes,
        findings=worst_first([*(finding for finding in findings if finding is not None), *found.findings]),
        provenance=found.provenance,
        unchecked=tuple(
            axis for axis in axes_compared if axis not in axes and foretold[axis].flown != foretold[axis].proposed
        ),
    )


def _measured(axis: LoopName, logs: Sequence[FlightRecord]) -> dict[str, Quantity]:
    """Figures of the whole loop without the plant of a model, by name; empty where a flight does not show it.

    An axis is measured by injections at the mixer, the velocity by its set-points.
    """
    own = next((tuned for tuned in TUNED_AXES if tuned == axis), None)
    try:
        if axis == "velocity":
            outer = flown_outer(axis, logs)
            by_setpoints = loop_by_setpoints(outer, Gains.of(outer.controller.controller), logs)
            return {} if by_setpoints is None else by_setpoints.quantities
        found = None if own is None else loop_by_injection(own, logs)
    except (InsufficientDataError, UsageError):
        return {}
    if found is None or found.loop is None or found.margins is None or found.rejection is None:
        return {}
    return LoopSeen(found.margins, found.rejection, float(found.loop.omega_rad_s[-1])).quantities


def _checked(axis: LoopName, before: Foretold, now: AxisTuning, injected: Mapping[str, Quantity]) -> CheckedAxis:
    judged = now.proposal.flown
    rate, whole = (shown_quantities(loop, now.plant) for loop in (judged.rate, judged.whole))
    contradicted = any(
        exclude_each_other(whole[name], measured) for name, measured in injected.items() if name in whole
    )
    # A plant that the test signal confirms at the crossover may say what its peak is a little above its band.
    peak_measured = "crossover_rad_s" in injected or _band_reaches_peak(now)
    figures = [
        _compared(loop, name, predicted[name], measured[name], trusted=not contradicted, peak_measured=peak_measured)
        for loop, predicted, measured in (("rate", before.rate, rate), ("whole", before.whole, whole))
        for name in COMPARED
        if name in predicted and name in measured and not (loop == "whole" and name in injected)
    ]
    figures += [
        _compared("whole", name, before.whole[name], measured, method=_SETPOINTS if KINDS[axis].outer else _INJECTION)
        for name, measured in injected.items()
        if name in before.whole
    ]
    figures.sort(key=lambda figure: (list(LOOP_WORDS).index(figure.loop), COMPARED.index(figure.name)))
    logged = {name: value for name, (value, _) in now.parameters.items()}
    gains = _which(before, logged)
    unstable = not contradicted and not bool(np.median(judged.rate.stable * judged.whole.stable))
    verdict = _verdict(figures, before.robustness, unstable=unstable) if gains == "proposed" else "other_gains"
    sentence, advice = _words(axis, verdict, gains, figures, now, contradicted=contradicted)
    return CheckedAxis(
        gains=gains,
        foretold=before,
        figures=tuple(figures),
        tuning=now,
        verdict=verdict,
        sentence=sentence,
        advice=advice,
        contradicted=contradicted,
    )


def _compared(
    loop: str,
    name: str,
    foretold: Quantity,
    measured: Quantity,
    *,
    method: str = _MODEL,
    trusted: bool = True,
    peak_measured: bool = True,
) -> ComparedFigure:
    inside = _inside(foretold, measured)
    narrow = _narrow(name, foretold) and _narrow(name, measured) and (peak_measured or name != "sensitivity_peak")
    return ComparedFigure(
        loop=loop,
        name=name,
        foretold=foretold,
        measured=measured,
        inside=inside,
        method=method,
        decided=trusted and (narrow or not inside),
    )


def _narrow(name: str, quantity: Quantity) -> bool:
    half = 0.5 * (quantity.upper - quantity.lower)
    return half <= WIDEST_PHASE_DEG if name == "phase_margin_deg" else half <= WIDEST[name] * abs(quantity.value)


def _band_reaches_peak(now: AxisTuning) -> bool:
    return now.plant.band_rad_s[1] >= BAND_OVER_CROSSOVER * now.proposal.flown.rate.usual_crossover_rad_s


def _verdict(figures: Sequence[ComparedFigure], robustness: float, *, unstable: bool) -> str:
    """The verdict of all figures that count."""
    decided = [figure for figure in figures if figure.decided]
    missed = [figure for figure in decided if not figure.inside]
    peaks = [figure for figure in decided if figure.name == "sensitivity_peak"]
    limit = _PEAK_SLACK * robustness
    if unstable or (missed and any(figure.measured.value > limit for figure in peaks)):
        return "worse"
    # The whole loop is what flies: each of its figures has to be known.
    if missed:
        robust = any(figure.loop == "whole" and _narrow("sensitivity_peak", figure.measured) for figure in peaks)
        return "inside_limits" if robust else "cannot_tell"
    whole = {figure.name for figure in decided if figure.loop == "whole"}
    return "as_foretold" if whole == set(COMPARED) else "cannot_tell"


def _inside(foretold: Quantity, measured: Quantity) -> bool:
    slack = TWO_SIDED_95 * measured.std
    return foretold.lower - slack <= measured.value <= foretold.upper + slack


def _which(before: Foretold, logged: Mapping[str, float]) -> str:
    """Which gains a log has."""

    def alike(figures: Mapping[str, float]) -> bool:
        shared = [name for name in figures if name in logged]
        return bool(shared) and all(
            math.isclose(figures[name], logged[name], rel_tol=_SAME, abs_tol=1e-9) for name in shared
        )

    return "proposed" if alike(before.proposed) else "flown" if alike(before.flown) else "other"


def _words(
    axis: LoopName, verdict: str, gains: str, figures: Sequence[ComparedFigure], now: AxisTuning, *, contradicted: bool
) -> tuple[str, str]:
    """The result and what to do next, in sentences."""
    peak = next((figure for figure in figures if (figure.loop, figure.name) == ("whole", "sensitivity_peak")), None)
    peak_words = (
        f" Measured peak sensitivity M_s: {peak.measured.value:.2f}." if peak is not None and peak.decided else ""
    )
    other = (
        f" {_CONTRADICTS.get(axis, 'The test signal at the mixer contradicts')} the identified plant, which may be "
        "wrong in both flights."
        if contradicted
        else ""
    )
    sweep = _SWEEPS.get(axis) or f"Fly a sweep of {axis} up to {_hz(max(now.needed_rad_s, now.plant.band_rad_s[1]))}"
    if verdict == "other_gains":
        old = gains == "flown"
        which = "the old gains" if old else "neither the new nor the old gains"
        todo = "Load the new gains and fly again" if old else "Tune from this log, or load the new gains and fly again"
        return f"This log was flown with {which}, so nothing can be checked.{peak_words}", f"{todo}."
    seen = any(figure.method != _MODEL for figure in figures)
    computed = "" if seen else _COMPUTED.get(axis, "")
    names = _named(axis, [figure for figure in figures if figure.decided and not figure.inside])
    if verdict == "cannot_tell":
        missed = f" These differ from the prediction: {names}." if names else ""
        return (
            f"Not enough data: the {_undecided(figures)} is too uncertain.{missed}{other}",
            f"{sweep} and check again. Use these gains for it only if the vehicle flies calmly, else the rollback "
            "file.",
        )
    if verdict == "as_foretold":
        return (
            f"The loop is as predicted.{computed}{peak_words}{other}",
            f"Keep these gains. {_further(axis, sweep, now)}",
        )
    if verdict == "worse":
        why = f" ({names})" if names else ""
        return (
            f"The loop is less robust than predicted{why}.{peak_words}{other}",
            "Load the rollback file, and fly a longer sweep before you tune again.",
        )
    following = (
        f"{sweep} before you tune again."
        if contradicted
        else f"Use this log to tune again. {_further(axis, sweep, now)}"
    )
    return (
        f"The loop is robust, but not as predicted ({names}).{peak_words}{other}",
        f"These gains can stay. {following}",
    )


_CONTRADICTS: Mapping[LoopName, str] = {"velocity": "Velocity and its set-points contradict"}
"""What measured the loop of an axis without a model, as the beginning of a sentence."""

_COMPUTED: Mapping[LoopName, str] = {
    "velocity": " It was computed from the attitude loop of this flight, not measured.",
    "climb": " It was computed from the throttle response of this flight, not measured.",
}
"""Where the loop of a second flight comes from, if not from its own motion."""


def _named(axis: LoopName, figures: Sequence[ComparedFigure]) -> str:
    words = loop_words(axis)
    return ", ".join(f"{QUANTITIES[figure.name].words} ({words[figure.loop]})" for figure in figures)


def _undecided(figures: Sequence[ComparedFigure]) -> str:
    """Figures of the whole loop that are missing or too uncertain."""
    decided = {figure.name for figure in figures if figure.loop == "whole" and figure.decided}
    return " or the ".join(QUANTITIES[name].words for name in COMPARED if name not in decided)


def _hz(omega_rad_s: float) -> str:
    """A frequency as pilots set it."""
    return f"{omega_rad_s / (2.0 * math.pi):.0f} Hz"


def _further(axis: LoopName, sweep: str, now: AxisTuning) -> str:
    """What more can be gained."""
    if now.changed:
        return "To improve further, run rotorid tune on this log."
    if not _band_reaches_peak(now):
        end = _hz(now.plant.band_rad_s[1])
        return f"The flight was measured only up to {end}, too low for better gains. {sweep}."
    return f"No better gains for {axis} exist within the limits."


def _finding(axis: LoopName, checked: CheckedAxis) -> Finding | None:
    if checked.verdict == "as_foretold":
        return None
    kinds = {"other_gains": "other_gains", "cannot_tell": "check_undecided"}
    kind = kinds.get(checked.verdict, "not_as_foretold")
    return warn(kind, axis, f"{capital(axis)}: {checked.sentence} {checked.advice}")
