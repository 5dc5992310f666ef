"""The page of ``tune``: new gains, their margins with intervals, and the predicted flight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from rotorid.autopilots import named
from rotorid.data.display import capital
from rotorid.data.quantities import QUANTITIES
from rotorid.data.quantity import MISSING, Quantity
from rotorid.data.trust import SAFE_PEAK
from rotorid.documents.review import QuantityDocument
from rotorid.documents.tune import AxisTuneDocument, FilterPriceDocument, TuneDocument, tune_document
from rotorid.documents.tune_check import METHODS, compared_words, tune_check_document
from rotorid.loops.rate_loops import shown_quantities
from rotorid.models.autopilots.gains import parameters_of
from rotorid.models.controller import RateController
from rotorid.plot.tuning import by_hand, rejection, responses, steps
from rotorid.proposing.axis_tuning import AxisTuning
from rotorid.proposing.check import CheckedAxis, CheckedTuning
from rotorid.proposing.proposal import TuningProposal
from rotorid.proposing.steps import step_times_s
from rotorid.report.filters import choice_picture, choice_rows, choice_sentence
from rotorid.report.findings import finding_rows
from rotorid.report.frame import Picture, drawn, in_all_units, over_frequency, render
from rotorid.report.loop_words import answer_of, is_outer
from rotorid.report.tune_words import (
    PATH_MARGINS,
    balance_sentence,
    following,
    headline,
    is_checked,
    judged_sentences,
    limit_sentences,
    limiting,
    margin_lines,
    missed_sentences,
    moving_d_sentence,
    next_flight,
    not_tuned,
    path_sentence,
    step_name,
    stricter_sentence,
    tune_sentences,
    unread,
    verdict_sentence,
)
from rotorid.tuning.judging import VERDICT_NAMES, Verdict
from rotorid.tuning.kinds import loop_words
from rotorid.tuning.loops import quantities
from rotorid.tuning.noise import RateNoise
from rotorid.typing import ComplexArray, FloatArray, LoopName

_OF_LOOPS = (
    "crossover_rad_s",
    "phase_margin_deg",
    "gain_margin_db",
    "delay_margin_s",
    "sensitivity_peak",
    "rejection_bandwidth_rad_s",
    "rejection_peak_db",
)
_OF_ATTITUDE = ("attitude_bandwidth_rad_s", "phase_delay_s")
_NOTHING = (MISSING, "")
_SENSITIVITY = "Sensitivity to disturbances"
_DRAWS_ON_PAGE = 12
_DIGITS = 6
_NOISE_BANDS = 80
"""Most bands into which the spectrum of the gyro is summed for the page."""


@dataclass(frozen=True, kw_only=True, slots=True)
class MarginRow:
    """A margin of the rate loop and of the whole loop, each flown and proposed: values with their intervals."""

    name: str
    cells: tuple[tuple[str, str], ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class GainRow:
    """A parameter of the firmware."""

    name: str
    flown: str
    proposed: str
    changed: bool


@dataclass(frozen=True, kw_only=True, slots=True)
class Slider:
    """A gain to move by hand, in the firmware's numbers."""

    name: str
    label: str
    low: str
    high: str
    step: str
    value: str


@dataclass(frozen=True, kw_only=True, slots=True)
class PathRow:
    """A flight on the way to the goal: its gains, its predicted margins, and the attitude error."""

    name: str
    gains: tuple[str, ...]
    margins: tuple[tuple[str, str], ...]
    attitude: str


@dataclass(frozen=True, kw_only=True, slots=True)
class TunedAxis:
    """An axis, or an outer loop, on the page."""

    name: str
    loops: tuple[str, str]
    error: str
    changed: bool
    summary: str
    gains: tuple[GainRow, ...]
    margins: tuple[MarginRow, ...]
    path: tuple[PathRow, ...]
    path_gains: tuple[str, ...]
    path_sentence: str
    pictures: tuple[Picture, ...]
    filters: tuple[FilterPriceDocument, ...]
    notes: tuple[str, ...]
    sliders: tuple[Slider, ...]
    by_hand: Picture


@dataclass(frozen=True, kw_only=True, slots=True)
class JudgedCard:
    """Foreign gains of an axis on the page."""

    name: str
    loops: tuple[str, str]
    badge: str
    words: str
    sentence: str
    gains: tuple[GainRow, ...]
    margins: tuple[MarginRow, ...]
    pictures: tuple[Picture, ...]


_BADGES: Mapping[Verdict, str] = {
    "fly": "good",
    "gently": "warning",
    "do_not_fly": "poor",
    "not_enough_data": "warning",
}


def _judged_cards(document: TuneDocument, proposal: TuningProposal) -> tuple[JudgedCard, ...]:
    """One for every axis that foreign gains may change."""
    if document.judged is None or proposal.judged is None:
        return ()
    cards = []
    for axis, found in document.judged.axes.items():
        known = proposal.judged.axes.get(axis)
        attitude = () if is_outer(axis) else _OF_ATTITUDE
        steps_found = {} if known is None else {name: _band(rows) for name, rows in known.steps.items()}
        cards.append(
            JudgedCard(
                name=axis,
                loops=_loops_of(axis),
                badge=_BADGES[found.verdict],
                words=VERDICT_NAMES[found.verdict],
                sentence=verdict_sentence(axis, found),
                gains=tuple(
                    GainRow(
                        name=name,
                        flown=f"{gain.flown:.4g}",
                        proposed=f"{gain.proposed:.4g}",
                        changed=gain.flown != gain.proposed,
                    )
                    for name, gain in found.gains.items()
                    if gain.flown != gain.proposed
                ),
                margins=tuple(
                    MarginRow(name=_named(name), cells=tuple(_cell(name, loop.get(name)) for loop in loops))
                    for names, loops in ((_OF_LOOPS, (found.rate, found.whole)), (attitude, ({}, found.attitude)))
                    for name in names
                    if any(name in loop for loop in loops)
                ),
                pictures=(
                    Picture(
                        key=f"{axis}-judged-step",
                        description=f"Step response of {axis} with flown and judged gains, with 95 % bands",
                        figure=drawn(steps, step_times_s(axis), steps_found, axis=answer_of(axis, whole=True)),
                    ),
                )
                if "judged" in steps_found
                else (),
            )
        )
    return tuple(cards)


def render_tune(proposal: TuningProposal, *, title: str, check_folder: str = "") -> str:
    """The report as one self-contained HTML document.

    Parameters
    ----------
    proposal
        What ``tune`` found.
    check_folder
        The folder of the page as a user types it, where it is known.
    """
    document = tune_document(proposal)
    axes = [_axis(axis, document.axes[axis], tuning, proposal.scale) for axis, tuning in proposal.axes.items()]
    judged = _judged_cards(document, proposal)
    curve = [] if document.filter_curve is None else [choice_picture(document.filter_curve)]
    margins = margin_lines(document)
    return render(
        "tune.html",
        logs=[document.autopilot, *document.provenance.inputs],
        title=title,
        document=document,
        headline=headline(document),
        sentences=tune_sentences(document),
        judged=judged,
        judged_title=next(iter(judged_sentences(document)), ""),
        margins=margins,
        missed=missed_sentences(margins),
        next_flight=next_flight(document),
        is_checked=is_checked(document),
        following=following(document),
        loading=named(document.autopilot).loading,
        axes=axes,
        choices=choice_rows(document),
        choice_sentence="" if document.filter_curve is None else choice_sentence(document.filter_curve),
        curve=curve,
        files=list(proposal.files.items()),
        rollback=list(proposal.rollback_files.items()),
        thrust=_thrust(document),
        limits=limit_sentences(document) if document.axes else (),
        stricter=stricter_sentence(document),
        moving_d=moving_d_sentence(document),
        check_folder=check_folder,
        refused=bool(not_tuned(document)),
        unread=finding_rows(unread(document)),
        path_margins=[(capital(QUANTITIES[name].before), QUANTITIES[name].unit) for name in PATH_MARGINS],
        remarks=finding_rows(document.findings),
        pictures=[
            *curve,
            *(picture for card in judged for picture in card.pictures),
            *(picture for tuned in axes for picture in (*tuned.pictures, tuned.by_hand)),
        ],
        further_script="tune.js",
        further={axis: loops_for_page(tuning, limit=proposal.robustness) for axis, tuning in proposal.axes.items()},
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class ComparedRow:
    """A figure predicted and measured, how it was measured, and whether both agree."""

    name: str
    foretold: tuple[str, str]
    measured: tuple[str, str]
    method: str
    verdict: str


@dataclass(frozen=True, kw_only=True, slots=True)
class CheckedCard:
    """An axis after its flight."""

    name: str
    verdict: str
    sentence: str
    advice: str
    rows: tuple[ComparedRow, ...]
    pictures: tuple[Picture, ...]


_VERDICTS: Mapping[str, tuple[str, str]] = {
    "as_foretold": ("good", "as predicted"),
    "inside_limits": ("warning", "not as predicted, but within limits"),
    "worse": ("poor", "worse than predicted"),
    "cannot_tell": ("warning", "not enough data"),
    "other_gains": ("warning", "other gains were flown"),
}


def render_check(found: CheckedTuning, *, title: str) -> str:
    """The page of a flight with new gains: predicted and measured margins, and what to do next.

    Parameters
    ----------
    found
        What ``tune --check`` found.
    """
    document = tune_check_document(found)
    cards = [
        CheckedCard(
            name=axis,
            verdict=document.axes[axis].verdict,
            sentence=checked.sentence,
            advice=checked.advice,
            rows=tuple(
                ComparedRow(
                    name=f"{_named(row.name)}, {loop_words(axis)[row.loop]}",
                    foretold=_cell(row.name, row.foretold),
                    measured=_cell(row.name, row.measured),
                    method=METHODS[row.method],
                    verdict=compared_words(row),
                )
                for row in document.axes[axis].figures
            ),
            pictures=tuple(_check_pictures(axis, checked)),
        )
        for axis, checked in found.axes.items()
    ]
    return render(
        "tune_check.html",
        logs=document.provenance.inputs,
        title=title,
        document=document,
        cards=cards,
        verdicts=_VERDICTS,
        remarks=finding_rows(document.findings),
        pictures=[picture for card in cards for picture in card.pictures],
    )


def _named(name: str) -> str:
    return capital(QUANTITIES[name].label)


def _check_pictures(axis: str, checked: CheckedAxis) -> list[Picture]:
    """Predicted and measured sensitivity, where the proposal's own signals are available."""
    expected, now = checked.foretold, checked.tuning
    if expected.loops is None or expected.omega_rad_s is None:
        return []
    measured = _band(np.abs(1.0 / (1.0 + now.loops["flown_whole"])))
    at = np.log(expected.omega_rad_s)
    rows = [np.interp(at, np.log(now.omega_rad_s), edge) for edge in measured]
    both = {"predicted": _band(np.abs(1.0 / (1.0 + expected.loops))), "measured": (rows[0], rows[1], rows[2])}
    return [
        in_all_units(
            partial(responses, expected.omega_rad_s, both, label=_SENSITIVITY),
            key=f"{axis}-check",
            description=f"Sensitivity of {axis} to disturbances, predicted and measured, with 95 % bands",
            converted=True,
        )
    ]


def loops_for_page(tuning: AxisTuning, *, limit: float) -> dict[str, Any]:
    """An axis for the page's own script: plant, some draws, and what each gain does, by frequency.

    Parameters
    ----------
    limit
        Largest sensitivity peak that was asked for.
    """
    parts, omega = tuning.parts, tuning.omega_rad_s
    controller = parts.controller
    known = parameters_of(tuning.controller)
    draws = tuning.plant.drawn(omega)
    noise = np.ones(omega.size) if parts.rate_noise is None else parts.rate_noise
    first_order = controller.derivative_cutoff_hz
    return {
        "omega": _short(omega),
        "from_rad_s": tuning.plant.known_from_rad_s,
        "plant": _complex(tuning.plant.response(omega)),
        "draws": [_complex(row) for row in draws[:_DRAWS_ON_PAGE]],
        "rate": {name: _complex(row) for name, row in parts.by_rate.items()},
        "angle": {name: _complex(row) for name, row in parts.by_angle.items()},
        "noise": _short(noise / noise.max()),
        # Other filters make other noise of today's gains too, and the whole spectrum may be known.
        "noise_today": tuning.proposal.flown.noise / parts.noise(tuning.proposal.flown.gains),
        "noise_seen": tuning.noise_seen,
        "gyro": None if parts.gyro_noise is None else _gyro_noise(parts.gyro_noise, controller),
        "flown": tuning.proposal.flown.gains.as_dict(),
        "units": {name: {"name": known_axis.name, "per_si": known_axis.per_si} for name, known_axis in known.items()},
        "derivative_cutoff_hz": first_order,
        "derivative_step_s": controller.derivative_step_s or controller.step_s,
        # Some of the likely plants may exceed what was asked for; red is what is not fine in the table.
        "limit": max(1.03 * limit, SAFE_PEAK),
    }


def _gyro_noise(noise: RateNoise, controller: RateController) -> dict[str, list[float] | list[list[float]]]:
    """What each band of frequencies adds to the noise of the command, see :meth:`RateNoise.of_command`."""
    rows = noise.of_command(controller)
    heard = np.flatnonzero(noise.density)
    if not heard.size:
        heard = np.arange(noise.density.size)
    first, last = int(heard[0]), int(heard[-1])
    edges = np.unique(np.geomspace(first + 1, last + 2, _NOISE_BANDS).astype(np.int64) - 1)[:-1]
    of_p, of_both, of_d = (np.add.reduceat(row[: last + 1], edges) for row in rows)
    omega = np.add.reduceat(noise.omega_rad_s[: last + 1], edges) / np.diff([*edges, last + 1])
    return {"omega": _short(omega), "of_p": _short(of_p), "of_both": _complex(of_both), "of_d": _short(of_d)}


def _short(values: FloatArray) -> list[float]:
    return [float(f"{value:.{_DIGITS}g}") for value in values]


def _complex(row: ComplexArray) -> list[list[float]]:
    return [_short(row.real), _short(row.imag)]


def _sliders(tuning: AxisTuning) -> tuple[Slider, ...]:
    """A slider for each gain that the firmware has a parameter for, and one for a first-order low-pass of D."""
    found = []
    flown, proposed = tuning.proposal.flown.gains.as_dict(), tuning.proposal.proposed.gains.as_dict()
    for name, parameter in parameters_of(tuning.controller).items():
        values = [gains[name] / parameter.per_si for gains in (flown, proposed)]
        most = 2.5 * max(values)
        if most > 0.0:
            step = 1.0 if parameter.integer else float(f"{most / 400.0:.1g}")
            high = min(max(most, step), parameter.high)
            found.append(_slider(name, parameter.name, min(parameter.low, min(values)), high, step, values[1]))
    if cutoff := tuning.parts.controller.derivative_cutoff_hz:
        found.append(_slider("cutoff", "D low-pass [Hz]", 5.0, max(150.0, 2.0 * cutoff), 1.0, cutoff))
    return tuple(found)


def _slider(name: str, label: str, low: float, high: float, step: float, value: float) -> Slider:
    numbers = {"low": low, "high": high, "step": step, "value": value}
    return Slider(name=name, label=label, **{key: f"{number:.6g}" for key, number in numbers.items()})


def _thrust(document: TuneDocument) -> str:
    """What would linearize thrust, in a sentence; empty without a fit of the motors."""
    thrust = document.thrust
    if thrust is None:
        return ""
    before, after = (f"{low:.2f} to {high:.2f}" for low, high in (thrust.flown_range, thrust.proposed_range))
    now = f"Over the flown throttle, the loop gain is {before} times that in hover"
    if thrust.flown == thrust.proposed:
        return f"{now}, so {thrust.parameter} stays at {thrust.flown:g}."
    return (
        f"{now}. With {thrust.parameter} = {thrust.proposed:g} instead of {thrust.flown:g} it would be {after} times. "
        f"The file thrust sets this value and multiplies the flown gains by {1.0 / thrust.hover_gain:.3f}, so that the "
        f"vehicle hovers as before at a throttle of {thrust.hover_demand:.2f}. Fly it alone, then tune again."
    )


def _loops_of(axis: LoopName) -> tuple[str, str]:
    words = loop_words(axis)
    return capital(words["rate"]), capital(words["whole"])


def _axis(axis: LoopName, document: AxisTuneDocument, tuning: AxisTuning, scale: float | None) -> TunedAxis:
    loops = (document.flown, document.proposed, document.flown_whole, document.proposed_whole)
    whole = (document.flown_attitude, document.proposed_attitude)
    return TunedAxis(
        name=axis,
        loops=_loops_of(axis),
        error="Position error" if is_outer(axis) else "Attitude error",
        changed=document.changed,
        summary=limiting(document),
        gains=tuple(
            GainRow(
                name=name,
                flown=f"{gain.flown:.4g}",
                proposed=f"{gain.proposed:.4g}",
                changed=gain.flown != gain.proposed,
            )
            for name, gain in document.gains.items()
        ),
        margins=(
            *(
                MarginRow(name=_named(name), cells=tuple(_cell(name, loop.get(name)) for loop in loops))
                for name in _OF_LOOPS
            ),
            *(
                MarginRow(
                    name=_named(name), cells=(_NOTHING, _NOTHING, *(_cell(name, loop.get(name)) for loop in whole))
                )
                for name in _OF_ATTITUDE
                if not is_outer(axis)
            ),
        ),
        path=tuple(
            PathRow(
                name=step_name(step),
                gains=tuple(f"{value:.4g}" for value in step.gains.values()),
                margins=tuple(_cell(name, step.whole.get(name)) for name in PATH_MARGINS),
                attitude=f"{100.0 * step.attitude_ratio.value:.0f} %",
            )
            for step in document.path
        ),
        path_gains=tuple(document.path[0].gains) if document.path else (),
        path_sentence=path_sentence(document.path, axis) if document.path else "",
        pictures=tuple(_pictures(axis, tuning, scale)),
        filters=tuple(document.filters),
        notes=tuple(filter(None, (balance_sentence(axis, document), *document.notes))),
        # The page's own steps are those of an attitude.
        sliders=() if is_outer(axis) else _sliders(tuning),
        by_hand=Picture(
            key=f"{axis}-by-hand",
            description=f"Step response of {axis} with the gains of today and those chosen here",
            figure=drawn(by_hand, axis),
        ),
    )


def _cell(name: str, quantity: QuantityDocument | None) -> tuple[str, str]:
    """A figure and its interval in the unit of paper."""
    if quantity is None or quantity.lower is None or quantity.upper is None:
        return _NOTHING
    return QUANTITIES[name].cells(quantity)


def _pictures(axis: LoopName, tuning: AxisTuning, scale: float | None) -> Sequence[Picture]:
    both = ("flown", "proposed") if tuning.proposal.changed else ("flown",)
    bands = {
        kind: {name: _band(np.abs(tuning.responses[f"{kind}_{name}"])) for name in both}
        for kind in ("attitude", "disturbance")
    }
    quick = {
        "flown": shown_quantities(tuning.proposal.flown.whole, tuning.plant),
        "proposed": quantities(tuning.proposal.proposed.whole),
    }
    edges = {
        name: (_edges(found["rejection_bandwidth_rad_s"]), _edges(found["rejection_peak_db"]))
        for name, found in quick.items()
        if name in both and {"rejection_bandwidth_rad_s", "rejection_peak_db"} <= found.keys()
    }
    scale = None if is_outer(axis) else scale
    answer = answer_of(axis, whole=tuning.proposal.flown.gains.A > 0.0)
    moment = "force" if is_outer(axis) else "moment"
    guided = "" if scale is None else f", with the guideline for a helicopter {scale:.0f} times larger"
    sensitivities = {name: _band(np.abs(1.0 / (1.0 + tuning.loops[f"{name}_whole"]))) for name in both}
    spectrum = partial(responses, tuning.omega_rad_s, seen_rad_s=tuning.plant.band_rad_s)
    further = [
        in_all_units(
            partial(spectrum, bands["attitude"], label=f"{capital(answer)} over its set-point"),
            key=f"{axis}-attitude",
            description=f"Magnitude of {answer} over its set-point, flown and proposed gains",
            converted=True,
        ),
        in_all_units(
            partial(spectrum, bands["disturbance"], label=f"{capital(answer)} over {moment}"),
            key=f"{axis}-disturbance",
            description=f"Magnitude of {answer} under a disturbance {moment}, flown and proposed gains",
            converted=True,
        ),
    ]
    if tuning.proposal.flown.gains.A == 0.0:
        further = further[1:]
    if edges:
        further.append(
            over_frequency(
                partial(rejection, axis, edges, scale=scale),
                key=f"{axis}-rejection",
                description=f"Disturbance-rejection bandwidth and peak in {axis}{guided}",
            )
        )
    return [
        Picture(
            key=f"{axis}-step",
            description=f"Step response of {answer} with flown and proposed gains, with 95 % bands",
            figure=drawn(steps, tuning.step_s, {name: _band(tuning.steps[name]) for name in both}, axis=answer),
        ),
        in_all_units(
            partial(spectrum, sensitivities, label=_SENSITIVITY),
            key=f"{axis}-sensitivity",
            description=(
                f"Sensitivity of {axis} to disturbances over frequency, flown and proposed gains, with 95 % bands"
            ),
            converted=True,
        ),
        *further,
    ]


def _edges(quantity: Quantity) -> tuple[FloatArray, FloatArray, FloatArray]:
    return np.array(quantity.lower), np.array(quantity.value), np.array(quantity.upper)


def _band(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lower edge, median and upper edge over draws."""
    low, middle, high = np.quantile(rows, (0.025, 0.5, 0.975), axis=0)
    return low, middle, high
