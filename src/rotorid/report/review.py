"""The page of a review: a first screen for a pilot, and under it everything for an engineer."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from rotorid.data.display import capital, counted
from rotorid.data.quantities import QUANTITIES, FigureOfMerit, Part, figure, figures_of, words_of_path
from rotorid.data.quantity import MISSING, Quantity, significant, unit, with_error, with_interval
from rotorid.data.trust import trusted
from rotorid.errors import UsageError
from rotorid.flights.motor_balance import BalanceChange
from rotorid.plot import miniatures
from rotorid.plot.curves import Frequency, Magnitude
from rotorid.plot.figure import Figure
from rotorid.plot.frequency import bode
from rotorid.plot.loops import Crossing, broken_loop
from rotorid.plot.review import motor_bars, noise_maps, setpoint_traces, spectra, step_answers
from rotorid.report.findings import FindingRow, finding_rows
from rotorid.report.frame import Picture, in_all_units, render, with_files
from rotorid.results.model import IdentifiedModel, Refused
from rotorid.results.summary import ParameterEstimate
from rotorid.results.verdicts import LEVEL_OF, Verdict, badge
from rotorid.results.verdicts import verdict as fit_verdict_of
from rotorid.reviewing.baseline import left_out_words
from rotorid.reviewing.card import Card
from rotorid.reviewing.cards import cards, interval_words, no_flight, of_bench, without_sweep
from rotorid.reviewing.filters import filter_files
from rotorid.reviewing.loops import LOOPS
from rotorid.reviewing.missing import Unavailable, section
from rotorid.reviewing.missing_words import gathered
from rotorid.reviewing.motors import possible_causes
from rotorid.reviewing.values import BaselineReview, LoopReview, MarginReview, NoiseMap, Review, StepCurve
from rotorid.spectral.derived import read_points
from rotorid.tuning.judging import VERDICT_NAMES
from rotorid.typing import BoolArray
from rotorid.uncertainty.differences import Verdict as ChangeVerdict

if TYPE_CHECKING:
    from markupsafe import Markup

LOOP_WORDS: Mapping[str, str] = {loop.name: loop.words for loop in LOOPS}
CHANGE_WORDS: Mapping[ChangeVerdict, str] = {
    "changed": "changed",
    "unchanged": "no change",
    "undecided": "not enough data",
}
PLACES = {
    "one side": "Motors on one side work harder.",
    "diagonal": "Motors on one diagonal work harder.",
    "one motor": "One motor differs from the others.",
}
_STAGES = {"before": "before the filters", "after": "after the filters"}
_FAST, _SLOW = ("p", "q", "r"), ("phi", "theta", "psi", "u", "v", "w")
_MOST_PEAKS = 6


@dataclass(frozen=True, kw_only=True, slots=True)
class NumberRow:
    """A quantity in words and one cell for each column: its value, and below it its 95 % interval and a remark."""

    words: str
    cells: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class ModelRow:
    """A model: the verdict of its fit with the reason, and its parameters where there are any."""

    name: str
    verdict: Verdict
    parameters: tuple[tuple[str, str, str], ...]
    words: str


@dataclass(frozen=True, kw_only=True, slots=True)
class CardRow:
    """A card with its badge and its small picture, which is empty where there is nothing to draw."""

    card: Card
    verdict: Verdict
    picture: Markup


@dataclass(frozen=True, kw_only=True, slots=True)
class ComparedRow:
    """A figure of this flight, what earlier flights let expect, and whether it changed."""

    words: str
    now: tuple[str, str]
    expected: str
    verdict: str


@dataclass(frozen=True, kw_only=True, slots=True)
class BaselineRows:
    """What the page shows of earlier flights."""

    sentences: tuple[str, ...]
    left_out: tuple[str, ...]
    flights: tuple[str, ...]
    rows: tuple[ComparedRow, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Section:
    """What the page shows of one log."""

    anchor: str
    review: Review
    cards: tuple[CardRow, ...]
    headline: str
    steps: tuple[Picture, ...]
    loops: tuple[NumberRow, ...]
    loop_names: tuple[str, ...]
    tracking: tuple[NumberRow, ...]
    tracking_names: tuple[str, ...]
    traces: tuple[Picture, ...]
    bodes: tuple[Picture, ...]
    margins: tuple[NumberRow, ...]
    margin_names: tuple[str, ...]
    broken: tuple[Picture, ...]
    noise: tuple[Picture, ...]
    noise_numbers: tuple[NumberRow, ...]
    motors: tuple[Picture, ...]
    motor_numbers: tuple[NumberRow, ...]
    power: tuple[NumberRow, ...]
    models: tuple[ModelRow, ...]
    unavailable: tuple[Unavailable, ...]
    baseline: BaselineRows | None = None

    @property
    def sweepless(self) -> bool:
        """Whether its models were identified without any maneuver that was made for it."""
        return without_sweep(self.review)

    @property
    def intervals(self) -> str:
        """What the ± of its cards says."""
        return interval_words([row.card for row in self.cards])

    @property
    def pattern(self) -> str:
        """Where the motors are that differ, and what that may come from."""
        pattern = self.review.motors.pattern
        return f"{capital(PLACES[pattern])} {possible_causes(pattern)}" if pattern else ""

    @property
    def pictures(self) -> tuple[Picture, ...]:
        """All that the page has to draw."""
        return (*self.steps, *self.traces, *self.bodes, *self.broken, *self.noise, *self.motors)


def render_reviews(reviews: Sequence[Review]) -> str:
    """One page about one log, or about several side by side.

    Parameters
    ----------
    reviews
        At least one.

    Raises
    ------
    UsageError
        There is nothing to show.
    """
    if not reviews:
        raise UsageError("a page about no review was asked for", needed="at least one review")
    sections = [_section(review, f"l{number}") for number, review in enumerate(reviews, start=1)]
    compared = _compared(reviews) if len(reviews) > 1 else ()
    overlaid = _overlaid(reviews) if len(reviews) > 1 else ()
    title = reviews[0].name if len(reviews) == 1 else f"{len(reviews)} flights side by side"
    page = render(
        "review.html",
        logs=[review.vehicle.autopilot for review in reviews],
        title=title,
        sections=sections,
        compared=compared,
        names=[review.name for review in reviews],
        overlaid=overlaid,
        quantities=QUANTITIES,
        remarks={section.anchor: _remarks(section.review) for section in sections},
        pictures=[*overlaid, *(picture for section in sections for picture in section.pictures)],
    )
    numbers = range(1, len(reviews) + 1)
    arrays = ["review.npz"] if len(reviews) == 1 else [f"review-{number}.npz" for number in numbers]
    topics = ["logger_topics.txt"] if any(review.logging.topics for review in reviews) else []
    filters = [
        name if len(reviews) == 1 else f"{number}-{name}"
        for number, review in zip(numbers, reviews, strict=True)
        for name in filter_files(review)
    ]
    return with_files(page, ["review.json", *arrays, *topics, *filters])


def _remarks(review: Review) -> tuple[FindingRow, ...]:
    """Findings without their numbers, which are in their sentences; a loss of control heads the page instead."""
    others = (finding for finding in review.findings if finding.kind != "control_lost")
    return finding_rows([replace(finding, numbers={}) for finding in others])


def pictures_of(reviews: Sequence[Review]) -> dict[str, Figure]:
    """All pictures of the page by names that serve for files."""
    named = {}
    for number, review in enumerate(reviews, start=1):
        prefix = "" if len(reviews) == 1 else f"{number}-"
        for picture in _section(review, "").pictures:
            named[f"{prefix}{picture.key.removeprefix('-')}"] = picture.figure
    return named


def _section(review: Review, anchor: str) -> Section:
    names = tuple(LOOP_WORDS[name] for name in review.loops)
    missing: list[Unavailable] = []

    def drawn(what: str, make: Callable[[], Iterable[Picture]]) -> tuple[Picture, ...]:
        """Pictures, or none: one that cannot be drawn leaves its reason in the list of what is missing."""
        none: tuple[Picture, ...] = ()
        pictures, gaps = section(f"page.{what}", lambda: (tuple(make()), ()), none)
        missing.extend(gaps)
        return pictures

    return Section(
        anchor=anchor,
        review=review,
        cards=tuple(_card(card, review) for card in cards(review)),
        headline=headline(review),
        steps=drawn("steps", lambda: _steps(review, anchor)),
        loops=_rows("loops", [loop.numbers for loop in review.loops.values()]),
        loop_names=names,
        tracking=_rows("tracking", [found.numbers for found in review.tracking.values()]),
        tracking_names=tuple(LOOP_WORDS[name] for name in review.tracking),
        traces=drawn("traces", lambda: _traces(review, anchor)),
        bodes=drawn("loops", lambda: (_bode(loop, f"{anchor}-bode-{name}") for name, loop in review.loops.items())),
        margins=_margin_rows(list(review.margins.values())),
        margin_names=tuple(review.margins),
        broken=drawn(
            "margins",
            lambda: (
                _broken(margin, f"{anchor}-broken-{axis}")
                for axis, margin in review.margins.items()
                if not margin.stick_idle and read_points(margin.loop).any()
            ),
        ),
        noise=drawn("noise", lambda: _noise(review, anchor)),
        noise_numbers=_single(review.noise.numbers),
        motors=drawn("motors", lambda: _motors(review, anchor)),
        motor_numbers=_single(review.motors.numbers),
        power=_power(review),
        models=tuple(_model(name, model) for name, model in review.models.items()),
        unavailable=gathered((*review.cannot_tell, *missing)),
        baseline=None if review.baseline is None else _baseline(review.baseline),
    )


def _baseline(baseline: BaselineReview) -> BaselineRows:
    order: tuple[ChangeVerdict, ...] = ("changed", "unchanged", "undecided")
    figures = sorted(baseline.figures.items(), key=lambda entry: order.index(entry[1].verdict))
    rows = [
        ComparedRow(
            words=f"{capital(words_of_path(path))}{f' [{row.unit}]' * bool(row.unit)}",
            now=row.cells(one.now),
            expected=MISSING if one.expected is None else _ends(row, one.expected),
            verdict=CHANGE_WORDS[one.verdict],
        )
        for path, one in figures
        if (row := figure(path.rpartition(".")[2])) is not None
    ]
    outputs = {} if baseline.balance is None else baseline.balance.outputs
    motors = [
        ComparedRow(
            words=f"Output of motor {number} against the others [%]",
            now=with_interval(100.0 * change.value, 100.0 * change.lower, 100.0 * change.upper),
            expected="0",
            verdict=_motor_verdict(baseline.balance, number),
        )
        for number, change in outputs.items()
    ]
    return BaselineRows(
        sentences=baseline.sentences,
        left_out=tuple(left_out_words(baseline)),
        flights=baseline.flights,
        rows=(*motors, *rows),
    )


def _motor_verdict(balance: BalanceChange | None, number: int) -> str:
    """The answer about one motor: where one is named, the others follow from it."""
    if balance is None or balance.motor in (None, number):
        return "" if balance is None else CHANGE_WORDS[balance.verdict]
    return f"follows from motor {balance.motor}"


def _ends(row: FigureOfMerit, expected: Quantity) -> str:
    factor = row.factor or 1.0
    return " to ".join(significant(factor * end) for end in (expected.lower, expected.upper))


def _card(card: Card, review: Review) -> CardRow:
    from markupsafe import Markup

    # A small picture repeats what its card says, and is left out where it cannot be drawn.
    small, _ = section("page.cards", lambda: (_SMALL[card.key](review, card) if review.flight.flights else "", ()), "")
    # Names of a log are escaped where the picture is made.
    picture = Markup(small)
    return CardRow(card=card, verdict=Verdict(LEVEL_OF[card.color], card.word), picture=picture)


def _small_steps(review: Review, _: Card) -> str:
    known = {name: review.loops[name].step for name in ("p", "q") if name in review.loops}
    steps = {name: step for name, step in known.items() if step is not None}
    if not steps:
        return ""
    end = _interesting_s(review, tuple(steps))
    drawn = {}
    for name, step in steps.items():
        shown = step.time_s <= end
        drawn[LOOP_WORDS[name]] = (step.time_s[shown], step.value[shown])
    return miniatures.curves(drawn, level=1.0, description=f"Response to a step over {end:.2g} s")


def _small_margins(review: Review, card: Card) -> str:
    row = QUANTITIES[card.quantity or "phase_margin_deg"]
    # Gusts show numbers of an axis whose stick is idle, and are no test of its loop.
    moved = {axis: margin for axis, margin in review.margins.items() if not margin.stick_idle}
    known = {axis: margin.numbers.get(card.quantity or "phase_margin_deg") for axis, margin in moved.items()}
    rows = {str(axis): (found.value, found.lower, found.upper) for axis, found in known.items() if found is not None}
    return miniatures.intervals(rows, limit=row.limit, good=row.good_side, description=_row_words(row))


def _row_words(row: FigureOfMerit) -> str:
    return f"{capital(row.words)}; {row.scale('good')}"


def _small_noise(review: Review, _: Card) -> str:
    maps = review.noise.maps
    channel = next((found.channel for found in maps if found.channel == "p"), maps[0].channel if maps else "")
    drawn = {
        _STAGES[found.stage]: (found.frequency_hz, 10.0 * np.log10(np.maximum(found.average, 1e-300)))
        for found in maps
        if found.channel == channel
    }
    end = max((float(frequency_hz[-1]) for frequency_hz, _ in drawn.values()), default=0.0)
    return miniatures.curves(drawn, description=f"Noise of the {_channel_words(channel)} from 0 to {end:.0f} Hz")


def _small_motors(review: Review, _: Card) -> str:
    means = [quantity.value for quantity in review.motors.means.values()]
    return miniatures.bars(means, description="Mean output of each motor in steady flight")


def _small_power(review: Review, _: Card) -> str:
    row, found = QUANTITIES["thrust_to_weight"], review.flight.thrust_to_weight
    rows = {} if found is None else {"thrust": (found.value, found.lower, found.upper)}
    return miniatures.intervals(rows, limit=row.limit, good=row.good_side, description=_row_words(row))


def _small_models(review: Review, _: Card) -> str:
    levels = {name: LEVEL_OF[fit_verdict_of(model).color] for name, model in review.models.items()}
    refused = [name for name, model in review.models.items() if isinstance(model, Refused)]
    return miniatures.marks({**levels, **dict.fromkeys(refused, "unknown")}, description="Verdict on each model")


_SMALL: Mapping[str, Callable[[Review, Card], str]] = {
    "tracking": _small_steps,
    "margins": _small_margins,
    "noise": _small_noise,
    "filters": lambda _review, _card: "",
    "motors": _small_motors,
    "power": _small_power,
    "models": _small_models,
}
"""What draws the small picture of a card."""


def headline(review: Review) -> str:
    """What flew, and when, in one line."""
    craft, air = review.vehicle, review.flight
    what = ", ".join(part for part in (craft.kind, craft.frame, craft.firmware or craft.autopilot) if part)
    if not air.flights:
        return f"{what or 'Unknown vehicle'}: {(of_bench(review) or no_flight(review)).replace('This', 'this', 1)}"
    spans = ", ".join(f"{start_s:.1f} to {stop_s:.1f} s" for start_s, stop_s in air.flights)
    total_s = sum(stop_s - start_s for start_s, stop_s in air.flights)
    count = counted(len(air.flights), "flight")
    return f"{what or 'Unknown vehicle'} · {count}, {total_s:.0f} s in the air ({spans})"


def _rows(part: Part, columns: Sequence[Mapping[str, Quantity]]) -> tuple[NumberRow, ...]:
    """A row for each figure of a part that any column has."""
    return tuple(
        NumberRow(words=row.label, cells=tuple(_cells(row, column.get(name)) for column in columns))
        for name, row in figures_of(part).items()
        if any(name in column for column in columns)
    )


def _margin_rows(margins: Sequence[MarginReview | None]) -> tuple[NumberRow, ...]:
    """Margins of axes or flights; what lies beyond the band of an axis is marked as a model's."""
    rows = []
    columns = [{} if margin is None else margin.numbers for margin in margins]
    names = [name for name in figures_of("margins") if any(name in column for column in columns)]
    for name, row in zip(names, _rows("margins", columns), strict=True):
        cells = tuple(
            (*cell, "by model") if margin is not None and name in margin.by_model else cell
            for margin, cell in zip(margins, row.cells, strict=True)
        )
        rows.append(NumberRow(words=row.words, cells=cells))
    if any(margin is not None and margin.verdict is not None for margin in margins):
        rows.append(NumberRow(words="Verdict on these gains", cells=tuple(_verdict_cell(margin) for margin in margins)))
    return tuple(rows)


def _verdict_cell(margin: MarginReview | None) -> tuple[str, str]:
    """The verdict on flown gains; the peak of both loops that 90 % of the likely vehicles stay below."""
    if margin is None:
        return (MISSING, "")
    if margin.verdict is None:
        return (VERDICT_NAMES["not_enough_data"], "")
    peak = margin.verdict.refused_peak
    return (VERDICT_NAMES[margin.verdict.verdict], f"M_s up to {peak:.1f}" if np.isfinite(peak) else "may be unstable")


def _cells(row: FigureOfMerit, quantity: Quantity | None) -> tuple[str, str]:
    return (MISSING, "") if quantity is None else row.cells(quantity)


def _single(numbers: Mapping[str, Quantity]) -> tuple[NumberRow, ...]:
    """Numbers one below the other; those of each motor are in the files."""
    rows = ((QUANTITIES[name], quantity) for name, quantity in numbers.items() if name in QUANTITIES)
    return tuple(NumberRow(words=row.label, cells=(row.cells(quantity),)) for row, quantity in rows)


def _steps(review: Review, anchor: str) -> list[Picture]:
    pictures = []
    for names, words, key in ((_FAST, "body rates", "rates"), (_SLOW, "angles and speeds", "angles")):
        curves = {LOOP_WORDS[name]: review.loops[name].step for name in names if name in review.loops}
        shown: dict[str, StepCurve] = {name: curve for name, curve in curves.items() if curve is not None}
        if shown:
            pictures.append(
                Picture(
                    key=f"{anchor}-step-{key}",
                    description=f"Answers of {words} to a step of their set-points, with 95 % bands",
                    figure=step_answers(shown, until_s=_interesting_s(review, names)),
                )
            )
    return pictures


def _traces(review: Review, anchor: str) -> Iterable[Picture]:
    """Set-point and answer as logged, where no step response says more."""
    for name, found in review.tracking.items():
        loop = review.loops.get(name)
        if loop is not None and loop.step is not None:
            continue
        angle = name not in _FAST
        words, degrees = LOOP_WORDS[name], 180.0 / np.pi
        trace = found.trace
        yield Picture(
            key=f"{anchor}-trace-{name}",
            description=f"The {words} and its set-point over {trace.time_s[-1] - trace.time_s[0]:.0f} s of the flight",
            figure=setpoint_traces(
                trace.time_s,
                degrees * trace.reference,
                degrees * trace.answer,
                label=f"{capital(words)} [{'°' if angle else '°/s'}]",
            ),
        )


def _interesting_s(review: Review, names: Sequence[str]) -> float:
    """Long enough for the slowest rise four times over."""
    rises = [
        review.loops[name].numbers["rise_time_s"].value
        for name in names
        if name in review.loops and "rise_time_s" in review.loops[name].numbers
    ]
    ends = [float(loop.step.time_s[-1]) for name, loop in review.loops.items() if name in names and loop.step]
    return min(max(ends), max(0.25, 6.0 * max(rises))) if rises else min(max(ends), 1.0)


def _bode(loop: LoopReview, key: str) -> Picture:
    draw = partial(
        bode, loop.response, output=loop.answer, input=loop.reference, fitted=_usable(loop), least_coherence=0.0
    )
    description = f"Bode plot of {LOOP_WORDS[loop.name]} over its set-point with 95 % band"
    return in_all_units(draw, key=key, description=description, converted=True)


def _usable(loop: LoopReview) -> BoolArray:
    """Points of a loop that its numbers are made of: those that are known to 30 %, within its band."""
    low, high = loop.band_rad_s
    omega = loop.response.omega_rad_s
    known = trusted(loop.response.random_error, np.ones(loop.response.values.shape), 0.0)
    return np.asarray(known & (omega >= low * (1.0 - 1e-9)) & (omega <= high * (1.0 + 1e-9)))


def _broken(margin: MarginReview, key: str) -> Picture:
    numbers = margin.numbers
    marked: list[Crossing] = []
    if "crossover_rad_s" in numbers and "phase_margin_deg" in numbers:
        at, value = numbers["crossover_rad_s"], numbers["phase_margin_deg"]
        marked.append(
            Crossing(
                omega_rad_s=at.value,
                value=float(np.deg2rad(value.value)),
                omega_std_rad_s=at.std,
                value_std=float(np.deg2rad(value.std)),
            )
        )
    draw = partial(_broken_loop, margin, marked)
    return in_all_units(draw, key=key, description=f"Broken {margin.axis} rate loop with its phase margin")


def _broken_loop(
    margin: MarginReview, marked: Sequence[Crossing], *, frequency: Frequency = "rad/s", magnitude: Magnitude = "dB"
) -> Figure:
    """The picture of a broken loop with the name of its axis, and 95 % intervals in its legend as all over the page."""
    # Beyond what the numbers are read from, feedback and noise would look like a loop at −1.
    points = read_points(margin.loop)
    figure = broken_loop(
        margin.loop.omega_rad_s[points],
        margin.loop.values[0, 0, points],
        random_error=margin.loop.random_error[0, 0, points],
        gain_crossovers=marked,
        frequency=frequency,
        magnitude=magnitude,
    )
    for label in figure["layout"]["annotations"]:
        label["text"] = f"{margin.axis.capitalize()}: {label['text'][:1].lower()}{label['text'][1:]}"
    if marked:
        factor = 1.0 if frequency == "rad/s" else 0.5 / np.pi
        crossover = margin.numbers["crossover_rad_s"]
        (degrees, reach), (at, along) = (
            QUANTITIES["phase_margin_deg"].cells(margin.numbers["phase_margin_deg"]),
            with_interval(*(factor * end for end in (crossover.value, crossover.lower, crossover.upper))),
        )
        words = f"phase margin {degrees}°{f' ({reach})' if reach else ''} at {at} {frequency}"
        words += f" ({along})" if along else ""
        figure["data"][-1].update(name=words, legendgroup=words, hovertemplate=f"{words}<extra></extra>")
    return figure


def _noise(review: Review, anchor: str) -> list[Picture]:
    pictures = []
    for channel in dict.fromkeys(noise_map.channel for noise_map in review.noise.maps):
        maps = [noise_map for noise_map in review.noise.maps if noise_map.channel == channel]
        words = _channel_words(channel)
        peaks = sorted(
            (peak for peak in review.noise.peaks if peak.channel == channel), key=lambda peak: -peak.height_db
        )[:_MOST_PEAKS]
        pictures.append(
            Picture(
                key=f"{anchor}-spectrum-{channel}",
                description=f"Mean noise spectrum of the {words} with its strongest lines",
                figure=spectra(
                    {_STAGES[noise_map.stage]: (noise_map.frequency_hz, noise_map.average) for noise_map in maps},
                    peaks=[(peak.frequency_hz.value, _peak_words(peak.source, peak.harmonic)) for peak in peaks],
                    unit=unit(maps[0].unit),
                ),
            )
        )
        drawn: dict[str, NoiseMap] = {
            f"{words.capitalize()} {_STAGES[noise_map.stage]}": noise_map
            for noise_map in maps
            if np.isfinite(noise_map.density).any()
        }
        if drawn:
            pictures.append(
                Picture(
                    key=f"{anchor}-map-{channel}",
                    description=f"Noise of the {words} over frequency against {maps[0].against.replace('_', ' ')}",
                    figure=noise_maps(drawn, against=maps[0].against.replace("_", " "), unit=unit(maps[0].unit)),
                )
            )
    return pictures


def _peak_words(source: str, harmonic: int | None) -> str:
    if source == "rotor":
        return f"rotor ×{harmonic}" if harmonic else "rotor"
    return "frame" if source == "frame" else "?"


def _channel_words(channel: str) -> str:
    words = {"p": "roll gyro", "q": "pitch gyro", "r": "yaw gyro", "ax": "forward", "ay": "sideward", "az": "vertical"}
    base = channel.removesuffix("_raw")
    return words.get(base, channel) + (" accelerometer" if base in ("ax", "ay", "az") else "")


def _motors(review: Review, anchor: str) -> tuple[Picture, ...]:
    means = {name.replace("_", " "): (quantity.value, quantity.std) for name, quantity in review.motors.means.items()}
    if not means:
        return ()
    description = "Mean output of each motor in steady flight"
    return (Picture(key=f"{anchor}-motors", description=description, figure=motor_bars(means)),)


def _power(review: Review) -> tuple[NumberRow, ...]:
    flight = review.flight
    of_flight = {"hover_throttle": flight.hover_throttle, "thrust_to_weight": flight.thrust_to_weight}
    known = {name: quantity for name, quantity in of_flight.items() if quantity is not None}
    groups = (flight.battery, known, flight.drag, flight.wind, flight.yaw)
    return tuple(row for group in groups for row in _single(group))


def _model(name: str, model: IdentifiedModel | Refused) -> ModelRow:
    found = fit_verdict_of(model)
    if isinstance(model, IdentifiedModel):
        shown = tuple(
            (which, _value(parameter), unit(parameter.unit))
            for which, parameter in model.parameters.items()
            if parameter.status != "dropped"
        )
        return ModelRow(name=name, verdict=badge(found), parameters=shown, words=found.reason)
    return ModelRow(name=name, verdict=badge(found), parameters=(), words=found.reason)


def _value(parameter: ParameterEstimate) -> str:
    return with_error(parameter.value, parameter.std) if parameter.std else significant(parameter.value, digits=4)


def _compared(reviews: Sequence[Review]) -> tuple[NumberRow, ...]:
    """A row for each card, and for each number of the loops and margins that any of the flights shows."""
    by_log = [cards(review) for review in reviews]
    rows = [
        NumberRow(words=same[0].title, cells=tuple((card.number or MISSING, card.word) for card in same))
        for same in zip(*by_log, strict=True)
    ]
    for name, words in LOOP_WORDS.items():
        columns = [review.loops[name].numbers if name in review.loops else {} for review in reviews]
        rows += [NumberRow(words=f"{words}: {row.words}", cells=row.cells) for row in _rows("loops", columns)]
    for axis in ("roll", "pitch", "yaw"):
        same = _margin_rows([review.margins.get(axis) for review in reviews])
        rows += [NumberRow(words=f"{axis} loop: {row.words}", cells=row.cells) for row in same]
    return tuple(rows)


def _overlaid(reviews: Sequence[Review]) -> tuple[Picture, ...]:
    """Step responses of the same loop in several flights."""
    pictures = []
    for name in _FAST:
        curves: dict[str, StepCurve] = {}
        for review in reviews:
            step = review.loops[name].step if name in review.loops else None
            if step is not None:
                curves[review.name] = step
        if len(curves) > 1:
            pictures.append(
                Picture(
                    key=f"overlaid-{name}",
                    description=f"Answers of the {LOOP_WORDS[name]} to a step in {len(curves)} flights",
                    figure=step_answers(
                        curves,
                        until_s=max(
                            _interesting_s(review, (name,))
                            for review in reviews
                            if name in review.loops and review.loops[name].step
                        ),
                    ),
                )
            )
    return tuple(pictures)
