"""Parts that several pages share: rows of tables, the table of parameters, and pictures of responses and flights.

Rows are text with marks for the cells that deserve attention. Parameters are grouped by force and moment, the dropped
ones in a sentence. Responses on the axis of their input come first. What the data covered says where a model holds.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from rotorid.data.quantity import MISSING, percent, significant, unit, with_error
from rotorid.data.record import Maneuver
from rotorid.data.trust import CRAMER_RAO_GUIDELINE_PERCENT, INSENSITIVITY_GUIDELINE_PERCENT
from rotorid.documents.base import ManeuverDocument
from rotorid.documents.result import ResultDocument, result_document
from rotorid.plot.figure import quantity
from rotorid.plot.frequency import bode
from rotorid.plot.time import timeline
from rotorid.report.frame import Picture, drawn, in_all_units
from rotorid.report.words import parameter_group, parameter_words, status_word
from rotorid.results.model import FittedData, IdentifiedModel, Verifications
from rotorid.results.provenance import LoggedManeuver
from rotorid.results.segment import Segment
from rotorid.results.summary import PairCost, ParameterEstimate, Range
from rotorid.results.verdicts import NOT_IDENTIFIED, Verdict, cost_verdict, error_of, response_verdict

_ON_AXIS = {
    "roll_command": ("p", "phi", "v", "ay", "p_dot", "v_dot"),
    "pitch_command": ("q", "theta", "u", "ax", "q_dot", "u_dot"),
    "yaw_command": ("r", "psi", "r_dot"),
    "thrust_command": ("w", "az", "w_dot"),
}
_MOST_UNFOLDED = 4

_MOST_NUMBERS, _LEAST_POINTS = 60_000, 400
"""Numbers in the pictures of all flights of a page, and points of a trace however many traces there are."""


@dataclass(frozen=True, eq=False)
class Shown:
    """An identified model as the page takes it: its document, and the data behind the pictures."""

    document: ResultDocument
    data: FittedData
    verifications: Verifications

    @classmethod
    def of(cls, model: IdentifiedModel) -> Shown:
        """A model with its document."""
        return cls(result_document(model), model.data, model.verifications)


@dataclass(frozen=True, kw_only=True, slots=True)
class ModelPictures:
    """Pictures in sight, and those that fold away: what one axis does to another."""

    leading: tuple[Picture, ...]
    folded: tuple[Picture, ...]


def on_axis(output: str, input: str) -> bool:
    """Whether an output belongs to the axis of an input; every output does where the input has no axis.

    Examples
    --------
    >>> on_axis("q", "pitch_command"), on_axis("az", "pitch_command"), on_axis("az", "motor_3")
    (True, False, True)
    """
    return input not in _ON_AXIS or output in _ON_AXIS[input]


def by_axis(pairs: list[tuple[str, str]]) -> list[tuple[str, str]]:
    """Pairs ``(output, input)`` with those on axis first, and of these by input, else in their order."""
    inputs = list(dict.fromkeys(input for _, input in pairs))
    return sorted(pairs, key=lambda pair: (not on_axis(*pair), inputs.index(pair[1])))


def leading_pairs(pairs: list[tuple[str, str]]) -> int:
    """How many of the pairs, on axis first, are in sight; a few are all.

    Examples
    --------
    >>> leading_pairs([("p", "roll_command"), ("r", "roll_command")])
    2
    """
    main = sum(on_axis(*pair) for pair in pairs)
    return main if main and len(pairs) > _MOST_UNFOLDED else len(pairs)


def model_pictures(shown: Shown, *, anchor: str) -> ModelPictures:
    """A picture of each fitted response; a few are all in sight.

    Parameters
    ----------
    anchor
        Prefix of the identifiers on the page.
    """
    response = shown.data.response
    pairs = by_axis(
        [
            (output, input)
            for u, input in enumerate(response.inputs)
            for y, output in enumerate(response.outputs)
            if shown.data.used[y, u].any()
        ]
    )
    pictures = tuple(
        _picture(shown, f"{anchor}-response-{number}", output, input) for number, (output, input) in enumerate(pairs)
    )
    leading = leading_pairs(pairs)
    return ModelPictures(leading=pictures[:leading], folded=pictures[leading:])


def _picture(shown: Shown, key: str, output: str, input: str) -> Picture:
    draw = partial(
        bode,
        shown.data.response,
        output=output,
        input=input,
        model=shown.data.model_response,
        beside=shown.data.direct,
        fitted=shown.data.used,
        least_coherence=shown.data.least_coherence,
    )
    description = f"Bode plot of {quantity(output).words} over {quantity(input).words}, measured and model"
    return in_all_units(draw, key=key, description=description, converted=True)


@dataclass(frozen=True, kw_only=True, slots=True)
class CostRow:
    """The cost of one response, where it was fitted and on sweeps that were not."""

    pair: str
    value: str
    verdict: Verdict | None
    band: str
    points: str
    unseen: Verdict | None


def cost_rows(document: ResultDocument) -> tuple[CostRow, ...]:
    """Cost of each response on the axis of its input, then of the others; each with that on unseen sweeps."""
    fitted = document.cost.pairs if document.cost else {}
    unseen = document.verification.frequency
    names = [*fitted, *(pair for pair in unseen if pair not in fitted)]
    split = [(pair.partition("/")[0], pair.partition("/")[2]) for pair in names]
    ordered = ["/".join(part for part in pair if part) for pair in by_axis(split)]
    return tuple(_cost_row(document, pair, fitted.get(pair), unseen.get(pair)) for pair in ordered)


def _cost_row(document: ResultDocument, pair: str, cost: PairCost | None, unseen: float | None) -> CostRow:
    return CostRow(
        pair=pair,
        value=significant(cost.value if cost else None),
        verdict=response_verdict(pair, cost.value, document.findings) if cost else None,
        band=_interval(cost.band_rad_s, "rad/s") if cost else MISSING,
        points=str(cost.points) if cost else MISSING,
        unseen=None if unseen is None else Verdict(cost_verdict(unseen).level, significant(unseen)),
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class ManeuverRow:
    """An excitation on the log's own clock."""

    record: str
    kind: str
    interval: str
    duration: str
    band: str
    origin: str


def maneuver_row(record: str, maneuver: Maneuver | ManeuverDocument) -> ManeuverRow:
    """One maneuver in words."""
    return ManeuverRow(
        record=record,
        kind=f"{maneuver.axis} {maneuver.kind.replace('_', ' ')}",
        interval=f"{maneuver.start_s:.2f} to {maneuver.stop_s:.2f} s",
        duration=f"{maneuver.stop_s - maneuver.start_s:.1f} s",
        band=_interval(maneuver.band_rad_s, "rad/s") if maneuver.band_rad_s else MISSING,
        origin=f"{maneuver.origin} in {maneuver.signal}" if maneuver.signal else maneuver.origin,
    )


def _interval(band: tuple[float, float], of: str) -> str:
    return f"{significant(band[0])} to {significant(band[1])} {of}"


_PERCENT = 100.0
_CONSTANTS = {
    "g": ("m/s²", 1.0),
    **dict.fromkeys(("U0", "V0", "W0"), ("m/s", 1.0)),
    **dict.fromkeys(("theta0", "phi0"), ("°", 180.0 / math.pi)),
    **dict.fromkeys(("D_x", "D_y"), ("m/s²", 1.0)),
    "z_imu": ("m", 1.0),
}
"""Unit of paper of the constants of the library, and its factor; others are shown unchanged."""


@dataclass(frozen=True, kw_only=True, slots=True)
class RangeRow:
    """What the data covered of a quantity, in the unit of paper."""

    words: str
    lowest: str
    highest: str
    rms: str
    unit: str


def range_rows(covered: Mapping[str, Range]) -> tuple[RangeRow, ...]:
    """Angles in degrees, commands in percent, the rest in SI units."""
    rows = []
    for name, spread in covered.items():
        words, shown, factor = _paper(name, spread.unit)
        lowest, highest, rms = (
            significant(factor * value, digits=3) for value in (spread.lowest, spread.highest, spread.rms)
        )
        rows.append(RangeRow(words=words, lowest=lowest, highest=highest, rms=rms, unit=shown))
    return tuple(rows)


def constants_sentence(constants: Mapping[str, float]) -> str:
    """Constants that are not zero, in the units of paper; empty where there are none.

    Examples
    --------
    >>> constants_sentence({"g": 9.80665, "U0": 2.1, "theta0": 0.0})
    'Constants of the model: g = 9.807 m/s², U0 = 2.1 m/s.'
    """
    sentences = []
    for name, value in constants.items():
        if value != 0.0:
            shown, factor = _CONSTANTS.get(name, ("", 1.0))
            sentences.append(f"{name} = {significant(factor * value, digits=4)} {shown}".rstrip())
    return f"Constants of the model: {', '.join(sentences)}." if sentences else ""


def _paper(name: str, si: str) -> tuple[str, str, float]:
    paper = quantity(name)
    if name.endswith("_command"):
        return ("throttle (thrust command)" if name == "thrust_command" else paper.words), "%", _PERCENT
    return paper.words, paper.unit or unit(si), paper.factor


def points_of(traces: int) -> int:
    """How many points each of so many traces may have, so that a page with all of them stays small.

    Examples
    --------
    >>> points_of(4), points_of(1000)
    (15000, 400)
    """
    return max(_LEAST_POINTS, _MOST_NUMBERS // max(traces, 1))


def timelines(
    segments: Sequence[Segment],
    maneuvers: Sequence[LoggedManeuver | ManeuverDocument],
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    key: str,
) -> tuple[Picture, ...]:
    """One picture for each record, since each has its own clock.

    Parameters
    ----------
    segments
        The data, which may reach into the quiet time around their maneuvers, or over several of them.
    maneuvers
        What to shade.
    inputs, outputs
        Channels to draw.
    key
        Identifiers of the pictures are this and a number.
    """
    by_record: dict[str, list[Segment]] = {}
    for segment in segments:
        by_record.setdefault(segment.record, []).append(segment)
    return tuple(
        Picture(
            key=f"{key}-{number}",
            description=f"Inputs and outputs over time in {record}, maneuvers shaded",
            figure=drawn(
                timeline,
                within,
                inputs=inputs,
                outputs=outputs,
                shaded=[(maneuver.start_s, maneuver.stop_s) for maneuver in maneuvers if maneuver.record == record],
            ),
        )
        for number, (record, within) in enumerate(by_record.items())
    )


FAR_SIGMAS = 3.0
"""A distance from the truth that random errors alone hardly explain."""

_MOST_UNGROUPED = 6


@dataclass(frozen=True, slots=True)
class Cell:
    """A number of a table, marked when it is beyond its guideline."""

    text: str
    marked: bool = False


@dataclass(frozen=True, kw_only=True, slots=True)
class ParameterRow:
    """A parameter with everything that is known about it."""

    name: str
    words: str
    value: str
    unit: str
    cramer_rao: Cell
    insensitivity: Cell
    status: str
    truth: str
    off: Cell


@dataclass(frozen=True, kw_only=True, slots=True)
class ParameterGroup:
    """Parameters of one force or moment; a short table is one group without a title."""

    title: str
    rows: tuple[ParameterRow, ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class Dropped:
    """A dropped parameter, and the identifier of where the page says why."""

    name: str
    target: str


def parameter_rows(document: ResultDocument, truth: Mapping[str, float]) -> tuple[ParameterRow, ...]:
    """One row for each parameter that was not dropped; truth is looked up as ``model.name`` first, then as ``name``."""
    return tuple(
        ParameterRow(
            name=name,
            words=parameter_words(name),
            value=MISSING
            if status == NOT_IDENTIFIED
            else with_error(parameter.value, error_of(name, parameter, document.findings)),
            unit=unit(parameter.unit),
            cramer_rao=_percent(parameter.cramer_rao_percent, CRAMER_RAO_GUIDELINE_PERCENT),
            insensitivity=_percent(parameter.insensitivity_percent, INSENSITIVITY_GUIDELINE_PERCENT),
            status=status,
            truth=significant(known := truth.get(f"{document.model}.{name}", truth.get(name)), digits=4),
            off=_off(parameter, known),
        )
        for name, parameter in document.parameters.items()
        if (status := status_word(document, name)) != "dropped"
    )


def parameter_groups(document: ResultDocument, truth: Mapping[str, float]) -> tuple[ParameterGroup, ...]:
    """The rows by force and moment in the order in which these come up, delays and lags behind them, others last."""
    rows = parameter_rows(document, truth)
    groups: dict[str, list[ParameterRow]] = {}
    for row in rows:
        groups.setdefault(parameter_group(row.name, document.parameters[row.name].unit), []).append(row)
    if len(rows) <= _MOST_UNGROUPED or len(groups) < 2:
        return (ParameterGroup(title="", rows=rows),)
    others = groups.pop("", [])
    ordered = [ParameterGroup(title=title, rows=tuple(members)) for title, members in groups.items()]
    return (*ordered, ParameterGroup(title="Others", rows=tuple(others))) if others else tuple(ordered)


def dropped_parameters(document: ResultDocument, *, anchor: str) -> tuple[Dropped, ...]:
    """The dropped ones, in the order of the model.

    Parameters
    ----------
    anchor
        Prefix of the identifiers of the section: a step of the reduction is ``ANCHOR-step-N``, the findings are
        ``ANCHOR-findings``.
    """
    steps = {step.parameter: number for number, step in enumerate(document.reduction) if step.action == "dropped"}
    return tuple(
        Dropped(name=name, target=f"{anchor}-step-{steps[name]}" if name in steps else f"{anchor}-findings")
        for name, parameter in document.parameters.items()
        if parameter.status == "dropped"
    )


def truth_of_dropped(document: ResultDocument, truth: Mapping[str, float]) -> str:
    """Known true values of what was dropped, as words; empty where none is known."""
    known = {
        name: value
        for name, parameter in document.parameters.items()
        if parameter.status == "dropped"
        and (value := truth.get(f"{document.model}.{name}", truth.get(name))) is not None
    }
    return ", ".join(f"{name} {significant(value)}" for name, value in known.items())


def _percent(value: float | None, guideline: float) -> Cell:
    return Cell(percent(value), value is not None and value > guideline)


def _off(parameter: ParameterEstimate, truth: float | None) -> Cell:
    if truth is None or not parameter.std:
        return Cell("")
    sigmas = abs(parameter.value - truth) / parameter.std
    return Cell(f"{sigmas:.1f} σ", sigmas > FAR_SIGMAS)
