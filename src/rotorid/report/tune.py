"""The page of ``tune``: gains as flown and as proposed, margins with their intervals, and what the vehicle will do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.documents.review import QuantityDocument
from rotorid.documents.tune import AxisTuneDocument, TuneDocument, tune_document
from rotorid.pipeline.tuning import AxisTuning, TuningProposal
from rotorid.plot.tuning import sensitivities, steps
from rotorid.report.frame import MISSING, Picture, render, significant
from rotorid.report.parts import finding_rows

_WORDS: Mapping[str, tuple[str, str]] = {
    "crossover_rad_s": ("Crossover", "rad/s"),
    "phase_margin_deg": ("Phase margin", "°"),
    "gain_margin_db": ("Gain margin", "dB"),
    "delay_margin_s": ("Delay margin", "s"),
    "sensitivity_peak": ("Sensitivity peak M_s", ""),
    "rejection_bandwidth_rad_s": ("Disturbance rejection bandwidth", "rad/s"),
}


@dataclass(frozen=True, kw_only=True, slots=True)
class MarginRow:
    """A margin of the rate loop and of the whole one, flown and proposed, with intervals."""

    name: str
    flown: str
    proposed: str
    flown_whole: str
    proposed_whole: str


@dataclass(frozen=True, kw_only=True, slots=True)
class GainRow:
    """A parameter of the firmware."""

    name: str
    flown: str
    proposed: str
    changed: bool


@dataclass(frozen=True, kw_only=True, slots=True)
class TunedAxis:
    """An axis on the page."""

    name: str
    changed: bool
    summary: str
    gains: tuple[GainRow, ...]
    margins: tuple[MarginRow, ...]
    pictures: tuple[Picture, ...]


def render_tune(proposal: TuningProposal, *, title: str) -> str:
    """The report as one HTML document, which holds everything it shows and asks the network for nothing.

    Parameters
    ----------
    proposal
        What ``tune`` found.
    title
        Heading of the page.
    """
    document = tune_document(proposal)
    axes = [_axis(axis, document.axes[axis], one) for axis, one in proposal.axes.items()]
    return render(
        "tune.html",
        title=title,
        document=document,
        sentences=tune_sentences(document),
        axes=axes,
        files=list(proposal.files.items()),
        rollback=list(proposal.rollback_files.items()),
        remarks=finding_rows(document.findings),
        pictures=[picture for one in axes for picture in one.pictures],
    )


def pictures_of(proposal: TuningProposal) -> list[Picture]:
    """All pictures of the page."""
    return [picture for axis, one in proposal.axes.items() for picture in _pictures(axis, one)]


def tune_sentences(document: TuneDocument) -> tuple[str, ...]:
    """What is proposed, in sentences."""
    sentences = []
    for axis, one in document.axes.items():
        if not one.changed:
            why = f": {one.reasons[0]}" if one.reasons else ""
            sentences.append(f"The gains of {axis} stay as they were flown{why}.")
            continue
        ratio, peak = one.attitude_ratio, one.proposed_whole.get("sensitivity_peak")
        held = f" The sensitivity peak will be {_told(peak)}." if peak is not None else ""
        sentences.append(
            f"With the proposed gains {axis} gives way to a moment by {significant(100.0 * ratio.value, digits=2)} % "
            f"({significant(100.0 * (ratio.lower or 0.0), digits=2)} to "
            f"{significant(100.0 * (ratio.upper or 0.0), digits=2)} %) of what it did.{held}"
        )
    return tuple(sentences)


def _axis(axis: str, document: AxisTuneDocument, one: AxisTuning) -> TunedAxis:
    stays = document.reasons[0] if document.reasons else ""
    return TunedAxis(
        name=axis,
        changed=document.changed,
        summary="; ".join(document.reasons) if document.changed else stays,
        gains=tuple(
            GainRow(
                name=name,
                flown=f"{gain.flown:.4g}",
                proposed=f"{gain.proposed:.4g}",
                changed=gain.flown != gain.proposed,
            )
            for name, gain in document.gains.items()
        ),
        margins=tuple(
            MarginRow(
                name=f"{words} [{unit}]" if unit else words,
                flown=_told(document.flown.get(name)),
                proposed=_told(document.proposed.get(name)),
                flown_whole=_told(document.flown_whole.get(name)),
                proposed_whole=_told(document.proposed_whole.get(name)),
            )
            for name, (words, unit) in _WORDS.items()
        ),
        pictures=tuple(_pictures(axis, one)),
    )


def _told(quantity: QuantityDocument | None) -> str:
    if quantity is None or quantity.lower is None or quantity.upper is None:
        return MISSING
    low, high = (significant(edge) for edge in (quantity.lower, quantity.upper))
    return f"{significant(quantity.value)} ({low} to {high})"


def _pictures(axis: str, one: AxisTuning) -> Sequence[Picture]:
    both = ("flown", "proposed") if one.proposal.changed else ("flown",)
    return [
        Picture(
            key=f"{axis}-step",
            description=f"Answer of {axis} to a step of its set-point, flown and proposed gains, with bands of 95 %",
            figure=steps(one.step_s, {name: _band(one.steps[name]) for name in both}, axis=axis),
        ),
        Picture(
            key=f"{axis}-sensitivity",
            description=f"Sensitivity of {axis} to disturbances over frequency, flown and proposed gains, with bands",
            figure=sensitivities(
                one.omega_rad_s,
                {name: _band(np.abs(1.0 / (1.0 + one.loops[f"{name}_whole"]))) for name in both},
                seen_rad_s=one.plant.band_rad_s,
            ),
        ),
    ]


def _band(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lower edge, median and upper edge over draws."""
    low, middle, high = np.quantile(rows, (0.025, 0.5, 0.975), axis=0)
    return low, middle, high
