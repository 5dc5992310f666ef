"""The report on measured frequency responses: loops, responses, their usable bands, and the data."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType
from typing import TypeAlias

import numpy as np

from rotorid.data.display import capital
from rotorid.data.quantities import QUANTITIES, Judgment
from rotorid.data.quantity import MISSING, Quantity, significant, unit, with_unit
from rotorid.documents.response import BoundDocument, EstimatedDocument, LoopDocument, loops_of
from rotorid.loops.rate_loops import AxisLoop
from rotorid.loops.responses import Pair, Responses
from rotorid.plot.curves import Frequency, runs
from rotorid.plot.figure import quantity
from rotorid.plot.frequency import bode, coherence_map, window_contributions
from rotorid.plot.loops import MINUS_3_DB, Crossing, broken_loop, disturbance_rejection
from rotorid.report.findings import finding_rows
from rotorid.report.frame import Picture, in_all_units, over_frequency, render
from rotorid.report.parts import ManeuverRow, by_axis, leading_pairs, maneuver_row, timelines
from rotorid.report.response_words import response_summary
from rotorid.results.verdicts import Verdict
from rotorid.spectral.derived import Estimated, read_points
from rotorid.spectral.loops import sensitivity
from rotorid.spectral.margins import Bound
from rotorid.typing import FloatArray

_LOOP_NUMBERS = (
    "crossover_rad_s",
    "phase_margin_rad",
    "delay_margin_s",
    "gain_margin_up",
    "gain_margin_down",
    "modulus_margin",
    "modulus_omega_rad_s",
    "disturbance_rejection_bandwidth_rad_s",
    "disturbance_rejection_peak",
    "disturbance_rejection_peak_omega_rad_s",
    "attitude_bandwidth_rad_s",
    "attitude_phase_bandwidth_rad_s",
    "attitude_gain_bandwidth_rad_s",
    "attitude_omega_180_rad_s",
    "attitude_phase_delay_s",
    "attitude_fitted_phase_delay_s",
)
"""Numbers of a loop, in the order of the table."""

_LARGEST = {
    "modulus_omega_rad_s": "modulus_margin",
    "disturbance_rejection_peak_omega_rad_s": "disturbance_rejection_peak",
}
"""A place to the number that belongs to it."""


_Number: TypeAlias = Estimated | EstimatedDocument | Bound | BoundDocument


@dataclass(frozen=True, kw_only=True, slots=True)
class PairRow:
    """The usable part of one response."""

    name: str
    words: str
    band: str
    hertz: str
    points: str
    coherence: str
    error: str
    difference: str
    leakage: str
    noise: str
    unit: str

    @property
    def usable(self) -> bool:
        """Whether any point can be used."""
        return self.points != "0"


def pair_rows(result: Responses) -> tuple[PairRow, ...]:
    """One row for each response ``output/input``."""
    return tuple(_pair_row(name, pair) for name, pair in result.pairs.items())


def _pair_row(name: str, pair: Pair) -> PairRow:
    output, _, input = name.partition("/")
    low, high = pair.band_rad_s or (math.nan, math.nan)
    error = None if pair.mean_random_error is None else 100.0 * pair.mean_random_error
    turn = 2.0 * math.pi
    return PairRow(
        name=name,
        words=f"{quantity(output).words} over {quantity(input).words}",
        band=f"{significant(low)} to {significant(high)}" if pair.band_rad_s else "nothing",
        hertz=f"{significant(low / turn)} to {significant(high / turn)} Hz" if pair.band_rad_s else "",
        points=str(pair.points),
        coherence=_coherence(pair.mean_coherence),
        error=significant(error, digits=2),
        difference=significant(pair.direct_difference_db, digits=2),
        leakage=significant(pair.leakage_percent, digits=2),
        noise=significant(pair.largest_input_noise_db, digits=2),
        unit=unit(pair.unit) or "1",
    )


def _coherence(value: float | None) -> str:
    return MISSING if value is None else f"{value:.2f}"


@dataclass(frozen=True, kw_only=True, slots=True)
class LoopRow:
    """A number of a loop, with what to know of it."""

    words: str
    value: str
    unit: str
    scale: str = ""

    @property
    def shown(self) -> str:
        """The number with its unit and scale."""
        return f"{with_unit(self.value, self.unit)}{f' ({self.scale})' if self.scale else ''}"


@dataclass(frozen=True, kw_only=True, slots=True)
class LoopAnswer:
    """What a loop is like: a headline, and its main numbers with a scale where they have one."""

    axis: str
    verdict: Verdict
    headline: str
    rows: tuple[LoopRow, ...]

    @property
    def sentence(self) -> str:
        """The main numbers in one line."""
        parts = [f"{row.words[:1].lower()}{row.words[1:]} {row.shown}" for row in self.rows]
        return f"{capital(', '.join(parts))}." if parts else ""


_MAIN = (
    "crossover_rad_s",
    "phase_margin_rad",
    "gain_margin_up",
    "modulus_margin",
    "disturbance_rejection_bandwidth_rad_s",
    "attitude_bandwidth_rad_s",
)
"""Numbers of the answer."""

_ANSWERED: Mapping[Judgment, Verdict] = MappingProxyType(
    {
        "good": Verdict("good", "good"),
        "look": Verdict("fair", "look here"),
        "cannot": Verdict("", "not enough data"),
    }
)


def loop_answer(axis: str, loop: AxisLoop | LoopDocument, *, frequency: Frequency = "rad/s") -> LoopAnswer:
    """The answer on one loop: whether its phase margin is safe, and its main numbers.

    Parameters
    ----------
    axis
        ``roll``, ``pitch`` or ``yaw``.
    frequency
        Unit of frequencies.
    """
    named, limit = f"{axis} {LOOP_SCOPES[loop.scope]}", QUANTITIES["phase_margin_deg"]
    margin, model = _margin(loop), False
    if margin is None and loop.beyond and (known := loop.beyond.numbers.get("phase_margin_rad")):
        margin, model = _in_degrees(known), True
    judgment = "cannot" if margin is None else limit.judged(margin)
    rows = [row for name in _MAIN if (row := _main_row(name, loop, judgment, frequency)) is not None]
    if margin is None:
        headline = f"The phase margin of the {named} was not measured."
    elif judgment == "cannot":
        headline = f"Unclear whether the {named} is far from oscillation."
    else:
        headline = f"The {named} is {'far from' if judgment == 'good' else 'close to'} oscillation."
    source = " This is by model, beyond the measured band." if model else ""
    return LoopAnswer(axis=named, verdict=_ANSWERED[judgment], headline=f"{headline}{source}", rows=tuple(rows))


def _in_degrees(margin: _Number) -> Quantity:
    return Quantity.normal(math.degrees(margin.value), math.degrees(margin.std), "deg")


def _margin(loop: AxisLoop | LoopDocument) -> Quantity | None:
    """The phase margin, or a bound that is on the bad side of the limit: what is beyond is no better."""
    if (known := loop.numbers.get("phase_margin_rad")) is not None:
        return _in_degrees(known)
    bound = loop.bounds.get("phase_margin_rad")
    if bound is None or bound.at_least:
        return None
    most = _in_degrees(bound)
    return most if QUANTITIES["phase_margin_deg"].judged(most) == "look" else None


def _main_row(name: str, loop: AxisLoop | LoopDocument, judgment: Judgment, frequency: Frequency) -> LoopRow | None:
    further = loop.beyond.numbers if loop.beyond else {}
    if name in loop.numbers:
        row = _row(name, loop.numbers[name], frequency=frequency)
    elif name in further:
        row = replace(_row(name, further[name], frequency=frequency), scale="by model")
    elif name in loop.bounds:
        row = _row(name, loop.bounds[name], frequency=frequency)
        row = replace(row, value=f"{'≥' if loop.bounds[name].at_least else '≤'} {row.value}")
    else:
        return None
    scale = row.scale
    if name == "phase_margin_rad":
        scale = "; ".join(part for part in (QUANTITIES["phase_margin_deg"].scale(judgment), row.scale) if part)
    elif name == "modulus_margin" and name in loop.numbers:
        # The peak of the sensitivity is one over the distance from −1.
        peak = QUANTITIES["sensitivity_peak"]
        inverse = 1.0 / loop.numbers[name].value
        scale = f"M_s {significant(inverse)}; {peak.scale('good' if inverse <= peak.limit else 'look')}"
    return replace(row, scale=scale)


@dataclass(frozen=True, kw_only=True, slots=True)
class Unseen:
    """Numbers of a loop that were not measured, all for one reason."""

    words: str
    reason: str


def loop_rows(loop: AxisLoop | LoopDocument, *, frequency: Frequency = "rad/s") -> tuple[LoopRow, ...]:
    """Numbers of a loop with standard deviations: measured, bounded by the end of the band, and by a model beyond it.

    Parameters
    ----------
    frequency
        Unit of frequencies.
    """
    further = loop.beyond.numbers if loop.beyond else {}
    return (
        *(_row(name, loop.numbers[name], frequency=frequency) for name in _LOOP_NUMBERS if name in loop.numbers),
        *(_bound_row(name, loop.bounds[name], frequency) for name in _LOOP_NUMBERS if name in loop.bounds),
        *(
            _row(name, further[name], ", by model", "(not measured: model times controller)", frequency)
            for name in _LOOP_NUMBERS
            if name in further
        ),
    )


def _row(
    name: str,
    number: _Number,
    source: str = "",
    note: str = "",
    frequency: Frequency = "rad/s",
) -> LoopRow:
    row = QUANTITIES[name]
    hertz = row.unit == "rad/s" and frequency == "Hz"
    factor = _PER_TURN if hertz else 1.0
    shown = row.with_error(factor * number.value, factor * number.std)
    return LoopRow(
        words=f"{capital(row.words)}{source}", value=shown, unit=f"{'Hz' if hertz else row.unit} {note}".strip()
    )


_PER_TURN = 0.5 / math.pi


def _bound_row(name: str, bound: Bound | BoundDocument, frequency: Frequency) -> LoopRow:
    row = _row(name, bound, frequency=frequency)
    at = f"{significant(bound.omega_rad_s * (_PER_TURN if frequency == 'Hz' else 1.0))} {frequency}"
    where = f"(at {at}, the end of the band; {_going(bound)})"
    value = f"{'≥' if bound.at_least else '≤'} {row.value}"
    return LoopRow(words=row.words, value=value, unit=f"{row.unit} {where}".lstrip())


def _going(bound: Bound | BoundDocument) -> str:
    return "still rising" if bound.at_least else "still falling"


def unseen(loop: AxisLoop | LoopDocument) -> tuple[Unseen, ...]:
    """What was not measured of a loop: one entry for each reason."""
    reasons: dict[str, list[str]] = {}
    for name in _LOOP_NUMBERS:
        if name in loop.not_seen and not {name, _LARGEST.get(name)} & set(loop.bounds):
            # A peak and its place are missing together, or bounded together.
            words = QUANTITIES[name].words.removesuffix(" at")
            reasons.setdefault(loop.not_seen[name], []).append(words)
    return tuple(
        Unseen(words=", ".join(dict.fromkeys(words)).capitalize(), reason=reason.removeprefix("not seen: "))
        for reason, words in reasons.items()
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class SplitRow:
    """How two inputs moved together."""

    inputs: str
    coherence: str


def split_rows(result: Responses) -> tuple[SplitRow, ...]:
    """One row for every two inputs."""
    return tuple(
        SplitRow(inputs=name.replace(",", ", "), coherence=_coherence(mean))
        for name, mean in result.input_coherence.items()
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class RecordRow:
    """A maneuver, its coherence when taken alone, and whether it entered the estimate."""

    maneuver: ManeuverRow
    coherence: str
    verdict: Verdict


def record_rows(result: Responses) -> tuple[RecordRow, ...]:
    """One row for each maneuver that was looked at."""
    return tuple(
        RecordRow(
            maneuver=maneuver_row(record.record, record),
            coherence=", ".join(f"{name} {_coherence(mean)}" for name, mean in record.coherence.items()),
            verdict=Verdict("good", "used") if record.used else Verdict("fair", "left out"),
        )
        for record in result.records
    )


def bands_picture(result: Responses) -> Picture:
    """Unbroken usable bands of all responses; where points are missing between two, the bar breaks."""
    response = result.response
    usable = {
        (output, input): [_span(response.omega_rad_s, run) for run in runs(result.used[y, u])]
        for y, output in enumerate(response.outputs)
        for u, input in enumerate(response.inputs)
    }
    return over_frequency(
        partial(coherence_map, usable, asked=result.measured.asked_rad_s),
        key="bands",
        description="Usable bands of all responses over frequency",
    )


def _span(omega_rad_s: FloatArray, run: slice) -> tuple[float, float]:
    inside = omega_rad_s[run]
    if inside.size > 1:
        return float(inside[0]), float(inside[-1])
    # A single point extends half a step to each side: a bar needs a width.
    below, above = omega_rad_s[max(run.start - 1, 0)], omega_rad_s[min(run.stop, omega_rad_s.size - 1)]
    return float(np.sqrt(below * inside[0])), float(np.sqrt(inside[0] * above))


def response_pictures(result: Responses) -> tuple[Picture, ...]:
    """A Bode picture of each response of which something can be used, over the direct estimate, on axis first."""
    return tuple(
        in_all_units(
            partial(
                bode,
                result.response,
                output=output,
                input=input,
                beside=result.measured.direct,
                fitted=result.used,
                least_coherence=result.least_coherence,
            ),
            key=f"response-{number}",
            description=f"Bode plot of {quantity(output).words} over {quantity(input).words}",
            converted=True,
        )
        for number, (output, input) in enumerate(_usable(result))
    )


def window_pictures(result: Responses) -> tuple[Picture, ...]:
    """Which window carries which frequency of each response of which something can be used."""
    response, diagnostics = result.response, result.measured.diagnostics
    pictures = []
    for number, (output, input) in enumerate(_usable(result)):
        row = response.pair(output, input)
        draw = partial(
            window_contributions,
            response.omega_rad_s,
            diagnostics.windows_s,
            diagnostics.share[row],
            diagnostics.window_error[row],
            composite_error=response.random_error[row],
        )
        words = f"Windows behind {quantity(output).words} over {quantity(input).words}"
        pictures.append(over_frequency(draw, key=f"windows-{number}", description=words, converted=True))
    return tuple(pictures)


def _usable(result: Responses) -> list[tuple[str, str]]:
    """Outputs and inputs of the responses of which something can be used, on axis first."""
    response = result.response
    return by_axis([(response.outputs[y], response.inputs[u]) for y, u in np.argwhere(result.used.any(axis=-1))])


LOOP_SCOPES = {"rate": "rate loop", "whole": "whole loop"}
"""Which loop around an axis, in words."""


def loop_pictures(axis: str, loop: AxisLoop) -> tuple[Picture, ...]:
    """The broken loop with its margins and the sensitivity with its bandwidth; none where it was not measured."""
    # Without a number there is no picture: the axis was not excited.
    if loop.loop is None or not (used := read_points(loop.loop)).any():
        return ()
    margins, rejection = loop.margins, loop.rejection
    broken = partial(
        broken_loop,
        loop.loop.omega_rad_s,
        loop.loop.values[0, 0],
        random_error=loop.loop.random_error[0, 0],
        used=used,
        gain_crossovers=[_crossing(c.omega_rad_s, c.phase_margin_rad) for c in margins.gain_crossovers]
        if margins
        else (),
        phase_crossovers=[_crossing(c.omega_rad_s, c.gain_margin) for c in margins.phase_crossovers] if margins else (),
    )
    response = sensitivity(loop.loop)
    at = Estimated(value=10.0 ** (MINUS_3_DB / 20.0), std=0.0)
    rejected = partial(
        disturbance_rejection,
        response.omega_rad_s,
        response.values[0, 0],
        random_error=response.random_error[0, 0],
        used=read_points(response),
        bandwidth=_crossing(rejection.bandwidth_rad_s, at) if rejection and rejection.bandwidth_rad_s else None,
        peak=_crossing(rejection.peak_omega_rad_s, rejection.peak)
        if rejection and rejection.peak_omega_rad_s and rejection.peak
        else None,
    )
    return (
        in_all_units(broken, key=f"loop-{axis}", description=f"Broken {axis} loop with its margins"),
        in_all_units(rejected, key=f"rejection-{axis}", description=f"Sensitivity of the {axis} loop"),
    )


def _crossing(where: Estimated, what: Estimated) -> Crossing:
    return Crossing(omega_rad_s=where.value, omega_std_rad_s=where.std, value=what.value, value_std=what.std)


def timeline_pictures(result: Responses) -> tuple[Picture, ...]:
    """The flights, with the maneuvers shaded that entered the estimate."""
    return timelines(
        result.segments,
        [record for record in result.records if record.used],
        inputs=result.inputs,
        outputs=result.outputs,
        key="timeline",
    )


@dataclass(frozen=True, kw_only=True)
class Loop:
    """The loop of one axis on the page."""

    axis: str
    method: str
    rows: tuple[LoopRow, ...]
    unseen: tuple[Unseen, ...]
    pictures: tuple[Picture, ...]


def render_responses(result: Responses, *, title: str) -> str:
    """The report as one HTML document, which needs no other file and in which no text of a log can act.

    Parameters
    ----------
    result
        What ``response`` found.
    """
    drawn = _drawn(result)
    return render(
        "response.html",
        logs=result.provenance.inputs,
        title=title,
        document=result,
        sentences=response_summary(result),
        least_coherence=result.least_coherence,
        pairs=pair_rows(result),
        bands=drawn.bands,
        responses=drawn.responses,
        leading=leading_pairs(_usable(result)),
        loops=drawn.loops,
        answers=[loop_answer(axis, loop) for axis, _, loop in loops_of(result.loops)],
        splits=split_rows(result),
        condition=significant(result.largest_condition),
        windows=drawn.windows,
        records=record_rows(result),
        timelines=drawn.timelines,
        remarks=finding_rows(result.findings),
        pictures=drawn.pictures,
    )


def pictures_of(result: Responses) -> Sequence[Picture]:
    """All pictures of the page."""
    return _drawn(result).pictures


@dataclass(frozen=True, kw_only=True)
class _Drawn:
    """What the page shows, drawn."""

    bands: Picture
    responses: Sequence[Picture]
    loops: Sequence[Loop]
    windows: Sequence[Picture]
    timelines: Sequence[Picture]

    @property
    def pictures(self) -> Sequence[Picture]:
        of_loops = (picture for loop in self.loops for picture in loop.pictures)
        return [self.bands, *self.responses, *of_loops, *self.windows, *self.timelines]


def _drawn(result: Responses) -> _Drawn:
    return _Drawn(
        bands=bands_picture(result),
        responses=response_pictures(result),
        loops=_loops(result),
        windows=window_pictures(result),
        timelines=timeline_pictures(result),
    )


def _loops(result: Responses) -> tuple[Loop, ...]:
    return tuple(
        Loop(
            axis=f"{axis} {LOOP_SCOPES[loop.scope]}",
            method=loop.method,
            rows=loop_rows(loop),
            unseen=unseen(loop),
            pictures=loop_pictures(key, loop),
        )
        for axis, key, loop in loops_of(result.loops)
    )
