"""The flight card: one page for the pilot, for use outdoors. What to fly, how long, when to stop.

Its words depend on the autopilot; its drawings of test inputs are SVG inside the page.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from rotorid import __version__
from rotorid.autopilots.autopilot import Card
from rotorid.autopilots.px4.advice import log_profile
from rotorid.autopilots.registry import named
from rotorid.data.display import listed
from rotorid.data.flight_plan import FlightPlan, PlannedInput, Shape
from rotorid.data.quantity import MISSING, percent, significant, unit, with_error
from rotorid.data.trust import DIRECT_COHERENCE
from rotorid.errors import UsageError
from rotorid.flying.settings import UNITS_OF_STEPS
from rotorid.plans.ardupilot import plan_log_bitmask
from rotorid.plans.facts import (
    FlightFacts,
    PredictedBound,
    all_by_hand,
    excited_s,
    flown_by_hand,
    how_to_stop,
    throttle_by_hand,
)
from rotorid.report.frame import CARD_POLICY, asset
from rotorid.report.parts import FAR_SIGMAS
from rotorid.typing import FloatArray

if TYPE_CHECKING:
    from markupsafe import Markup

    from rotorid.documents.design import TestInputDocument

WHOLE_ERROR = "random and model error, as identify will state them"
"""What a predicted error leaves out."""

LEAST_BATTERY_PERCENT = 30
LEAST_CELL_V = 3.5

_SAMPLES_PER_PERIOD = 10.0
"""Samples of the log in a period of the highest frequency that a plan needs."""

_SHAPES: Mapping[Shape, str] = MappingProxyType(
    {
        "pilot_sweep": "sweep, slow to fast",
        "logarithmic_sweep": "sweep",
        "multisine": "multisine",
        "random_binary": "random steps",
        "doublet": "doublet",
        "two_one_one": "2-1-1",
        "three_two_one_one": "3-2-1-1",
    }
)


def shape_words(planned: PlannedInput) -> str:
    """The form of a test input."""
    return _SHAPES[planned.shape]


def amplitude_words(planned: PlannedInput | TestInputDocument) -> str:
    """Its size in the pilot's units.

    Examples
    --------
    >>> step = PlannedInput(axis="roll", shape="doublet", start_s=0.0, values=[0.1, -0.1], sample_rate_hz=2.0,
    ...                     amplitude=0.15)
    >>> amplitude_words(step)
    '± 15 % of full control'
    """
    size = abs(planned.amplitude)
    percent, degrees = _short(100.0 * size), _short(math.degrees(size))
    if planned.entry == "stick":
        return f"± {percent} % of the stick"
    if planned.axis == "thrust":
        return f"± {percent} % of full thrust"
    if planned.entry == "command":
        return f"± {percent} % of full control"
    return f"± {degrees}{'°/s' if planned.entry == 'rate_setpoint' else '°'}"


def band_words(planned: PlannedInput) -> str:
    """Its frequencies in hertz, or the length of its steps.

    Examples
    --------
    >>> step = PlannedInput(axis="roll", shape="doublet", start_s=0.0, values=[0.1, -0.1], sample_rate_hz=2.0,
    ...                     amplitude=0.15)
    >>> band_words(step)
    'steps of 0.5 s'
    """
    if planned.band_rad_s is not None:
        low, high = (_short(edge / (2.0 * math.pi)) for edge in planned.band_rad_s)
        return f"{low} to {high} Hz"
    begin_s, end_s = excited_s(planned)
    return f"steps of {_short((end_s - begin_s) / UNITS_OF_STEPS.get(planned.shape, 1))} s"


def how_to_fly(plan: FlightPlan, facts: FlightFacts) -> str:
    """What the pilot does during every run, and who controls the throttle."""
    autopilot = facts.autopilot
    by_hand = flown_by_hand(plan, autopilot)
    if all_by_hand(plan, autopilot):
        return (
            f"Each run: start and end in trimmed hover{named(autopilot).card.hand_mode}. Follow the picture with the "
            f"stick of that axis{_hand_words(plan.inputs)}. Other sticks: small, slow corrections only."
        )
    card = named(autopilot).card
    words = card.how(plan, [planned for planned in plan.inputs if planned not in by_hand], facts.firmware)
    return f"{words} {_check_words(plan, card)}" if by_hand else words


def _check_words(plan: FlightPlan, card: Card) -> str:
    """What the runs by hand are for: they check the model."""
    still = f" for {plan.trim_s:.0f} s" if plan.trim_s >= 1.0 else ""
    return (
        f"Fly the runs by hand last{card.hand_mode}: they only check the model. Keep the sticks still"
        f"{still} before and after each, then land."
    )


def before(plan: FlightPlan, facts: FlightFacts) -> list[str]:
    """What to check before the flight."""
    card = named(facts.autopilot).card
    loaded = (Card() if all_by_hand(plan, facts.autopilot) else card).loaded.format(
        mask=plan_log_bitmask(plan), profile=log_profile(facts.firmware), rate_hz=least_rate_hz(plan)
    )
    stop = how_to_stop(plan, facts.autopilot)
    way = f"Way to stop tested in hover: {stop}"
    if card.way_tried and throttle_by_hand(plan, facts.autopilot):
        way = f"Tested in hover: {card.way_tried}; way to stop: {stop}"
    return [
        "Propellers undamaged, tight, right way round; battery full and strapped; nothing loose",
        loaded,
        way,
        card.ready,
        f"Nobody within {_clear_m(facts):.0f} m of the start; as little wind as possible",
        "Note take-off mass, battery and wind",
    ]


def stops(facts: FlightFacts) -> list[tuple[str, str]]:
    """Limits at which to stop, with their names."""
    return [
        ("tilt", f"{math.degrees(facts.stop_tilt_rad):.0f}°"),
        ("rate", f"{math.degrees(facts.stop_rate_rad_s):.0f}°/s"),
        ("from start", f"{facts.stop_room_m:.0f} m"),
        ("height change", f"{length_words(facts.stop_climb_m)} m"),
        ("battery", f"{LEAST_BATTERY_PERCENT} %"),
    ]


def stop_sentence(plan: FlightPlan, facts: FlightFacts) -> str:
    """How to stop, and reasons to stop without a number."""
    return (
        f"To stop: {how_to_stop(plan, facts.autopilot)}. Also stop if an oscillation grows, you hear a new sound, the "
        f"link is poor, you are not sure, or any cell is below {LEAST_CELL_V:g}\u00a0V under load."
    )


def after(plan: FlightPlan, facts: FlightFacts) -> list[str]:
    """What to check after the flight."""
    by_hand = flown_by_hand(plan, facts.autopilot)
    made = len(plan.inputs) - len(by_hand) or len(plan.inputs)
    count = f"{made} {'maneuver' if made == 1 else 'maneuvers'}"
    extra = f"; {len(by_hand)} more by hand" if 0 < len(by_hand) < len(plan.inputs) else ""
    low, high = (100.0 * edge for edge in facts.motors)
    return [
        f"{count} found on {listed(plan.axes)}, without gaps{extra}",
        f"Commands and rates logged at {least_rate_hz(plan):.0f} Hz or more",
        f"Coherence at least {DIRECT_COHERENCE:g} over the band",
        f"As predicted: tilt up to {math.degrees(facts.tilt_rad):.0f}°, rates up to "
        f"{math.degrees(facts.rate_rad_s):.0f}°/s, motors {low:.0f} to {high:.0f}\u00a0%",
        "If not, fly again: larger if coherence is low, smaller if motors reach their limits",
    ]


def least_rate_hz(plan: FlightPlan) -> float:
    """Least log rate of the plan: ten samples per period of its highest frequency, and 50 Hz."""
    highest = max((planned.band_rad_s[1] for planned in plan.inputs if planned.band_rad_s), default=0.0)
    wanted = _SAMPLES_PER_PERIOD * highest / (2.0 * math.pi)
    return max(10.0 * math.ceil(wanted / 10.0 - 1e-9), 50.0)


def clock_words(seconds: float) -> str:
    """Minutes and seconds.

    Examples
    --------
    >>> clock_words(65.4), clock_words(9.0)
    ('1:05', '0:09')
    """
    whole = round(seconds)
    return f"{whole // 60}:{whole % 60:02d}"


def length_words(meters: float) -> str:
    """A length without its unit: whole meters from ten up, below in decimeters.

    Examples
    --------
    >>> length_words(145.07), length_words(2.64), length_words(4.0), length_words(0.0)
    ('145', '2.6', '4', '0')
    """
    return f"{meters:.0f}" if meters >= 9.95 else f"{meters:.1f}".removesuffix(".0")


def _hand_words(inputs: Sequence[PlannedInput]) -> str:
    """How the hand moves in sweeps and steps."""
    kinds = {planned.maneuver.kind for planned in inputs}
    if kinds == {"sweep"}:
        return ", from slow to fast, never faster than you can move it smoothly"
    if kinds <= {"doublet", "multistep"}:
        return ": move quickly to each level, keep it there as long as in the picture, then release"
    return ": sweeps from slow to fast, steps quickly from level to level" if "sweep" in kinds else ""


def _short(value: float) -> str:
    return f"{value:.0f}" if value >= 10.0 else significant(value, digits=2)


def _clear_m(facts: FlightFacts) -> float:
    """Radius to keep clear: the room, plus the height or 10 m."""
    return facts.stop_room_m + max(facts.height_m, 10.0)


_WIDTH, _HEIGHT = 300.0, 54.0
_COLUMNS = 300
_SAMPLES = 32
"""Columns of the drawing, and samples in each: an oscillation faster than a column is drawn as the area it fills."""

# Attributes and not classes: what makes PDF of the page applies its style sheet to HTML only.
_INPUT = 'fill="#000" stroke="#000" stroke-width="1.3" stroke-linejoin="round"'
_ZERO = 'fill="none" stroke="#999" stroke-width="0.8"'


def input_picture(
    strips: Sequence[Sequence[PlannedInput]], edges_s: tuple[float, float], *, description: str
) -> Markup:
    """Test inputs over time, in strips with the same time, each with its own height.

    Parameters
    ----------
    strips
        The inputs of each strip, at least one.
    edges_s
        Time at the left and the right edge, on the clock of the plan.
    description
        What it shows, for those who cannot see it.
    """
    from markupsafe import Markup, escape

    strip = _HEIGHT / len(strips)
    lines = [
        _path(planned, edges_s, center=(index + 0.5) * strip, reach=0.44 * strip)
        for index, planned in enumerate(strips)
    ]
    return Markup(
        f'<svg viewBox="0 0 {_WIDTH:g} {_HEIGHT:g}" preserveAspectRatio="none" role="img" '
        f'aria-label="{escape(description)}">{"".join(lines)}</svg>'
    )


def _path(inputs: Sequence[PlannedInput], edges_s: tuple[float, float], *, center: float, reach: float) -> str:
    time_s = np.linspace(*edges_s, _COLUMNS * _SAMPLES + 1)
    values = np.sum([planned.at(time_s) for planned in inputs], axis=0)
    values /= max(float(np.abs(planned.values).max()) for planned in inputs)
    points = [f"{x:.1f},{center - reach * y:.2f}" for x, y in _outline(values).tolist()]
    zero = f'<path d="M0,{center:g} H{_WIDTH:g}" {_ZERO}/>'
    return f'{zero}<path d="M{" L".join(points)} Z" {_INPUT}/>'


def _outline(values: FloatArray) -> FloatArray:
    """The highest values of the columns from left to right, then the lowest back again, shape ``(points, 2)``.

    Columns share their borders, so that a slow curve closes to a line.
    """
    borders = values[::_SAMPLES]
    columns = values[:-1].reshape(_COLUMNS, _SAMPLES)
    highest = np.maximum(columns.max(axis=1), borders[1:])
    lowest = np.minimum(columns.min(axis=1), borders[1:])
    across = (np.arange(_COLUMNS) + 0.5) * (_WIDTH / _COLUMNS)
    outline: FloatArray = np.column_stack(
        [np.concatenate([across, across[::-1]]), np.concatenate([highest, lowest[::-1]])]
    )
    return outline


FILE = "flight-card.html"
MOST_RUNS = 8
"""More runs than these do not fit on a page that can be read outdoors."""
MOST_BOUNDS = 12

_ROOMY, _DENSE = 4, 6
"""Up to so many runs the pictures are large, and from so many on the rows are narrow."""
_LONG_NAME = 34
_LONG_S = 10.0
_NOT_KNOWN = "too uncertain"


@dataclass(frozen=True, kw_only=True)
class Run:
    """Inputs that are flown without a pause: one, or several at the same time."""

    number: int
    axes: str
    words: str
    details: tuple[str, ...]
    begin: str
    length: str
    each: bool
    picture: Markup


@dataclass(frozen=True, kw_only=True)
class BoundRow:
    """Predicted accuracy of one parameter."""

    name: str
    model: str
    value: str
    unit: str
    percent: str
    off: str


def flight_card(plan: FlightPlan, facts: FlightFacts) -> dict[str, str]:
    """The card as one self-contained HTML file that prints on one A4 page.

    Parameters
    ----------
    plan
        The plan to fly. Inputs that overlap are one run.
    facts
        Its vehicle, predictions and limits.

    Returns
    -------
    dict[str, str]
        File name to text.

    Raises
    ------
    UsageError
        There are more runs than fit on the page.
    """
    return {FILE: flight_card_html(plan, facts)}


def flight_card_html(plan: FlightPlan, facts: FlightFacts) -> str:
    """Text of the card; see :func:`flight_card`."""
    import jinja2
    from markupsafe import Markup

    runs = _runs(plan, facts)
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    first_s, last_s = _edges_s(plan.inputs)
    return environment.from_string(asset("templates/flight_card.html")).render(
        policy=CARD_POLICY,
        style=Markup(asset("flight_card.css")),
        version=__version__,
        plan=plan,
        facts=facts,
        height=length_words(facts.height_m),
        climb=length_words(facts.climb_m),
        runs=runs,
        density="roomy" if len(runs) <= _ROOMY else "dense" if len(runs) >= _DENSE else "",
        long_name=len(plan.name) > _LONG_NAME,
        total=clock_words(last_s - first_s),
        how=how_to_fly(plan, facts),
        before=before(plan, facts),
        stops=stops(facts),
        whole_error=WHOLE_ERROR,
        stop_sentence=stop_sentence(plan, facts),
        after=after(plan, facts),
        bounds=_bound_rows(facts.bounds),
        more=max(len(facts.bounds) - MOST_BOUNDS, 0),
    )


def _runs(plan: FlightPlan, facts: FlightFacts) -> tuple[Run, ...]:
    groups: list[list[PlannedInput]] = []
    for planned in sorted(plan.inputs, key=lambda planned: excited_s(planned)[0]):
        if groups and excited_s(planned)[0] < _edges_s(groups[-1])[1]:
            groups[-1].append(planned)
        else:
            groups.append([planned])
    repeated = [list(same) for _, same in groupby(groups, key=_likeness)]
    if len(repeated) > MOST_RUNS:
        raise UsageError(
            f"{len(repeated)} runs do not fit on a flight card",
            needed=f"at most {MOST_RUNS} runs",
            remedy="split the plan into several flights",
        )
    zero_s = _edges_s(plan.inputs)[0]
    by_hand = flown_by_hand(plan, facts.autopilot)
    return tuple(_run(number, same, zero_s, by_hand) for number, same in enumerate(repeated, start=1))


def _likeness(group: Sequence[PlannedInput]) -> tuple[object, ...]:
    """Equal for runs that look the same to a pilot, whatever their sign or noise."""
    return tuple(
        (planned.axis, planned.shape, planned.entry, amplitude_words(planned), band_words(planned)) for planned in group
    )


def _run(number: int, repeats: Sequence[Sequence[PlannedInput]], zero_s: float, by_hand: Sequence[PlannedInput]) -> Run:
    first, times = repeats[0], len(repeats)
    begin_s, end_s = _edges_s([planned for group in repeats for planned in group])
    each_s = _edges_s(first)[1] - begin_s
    axes = ", ".join(dict.fromkeys(planned.axis for planned in first))
    words = ", ".join(dict.fromkeys(shape_words(planned) for planned in first))
    words = f"{times} × {words}" if times > 1 else words
    hand = first[0] in by_hand and first[0].entry != "stick"
    pad_s = 0.02 * (end_s - begin_s)
    edges_s = (max(begin_s - pad_s, 0.0), end_s + pad_s)
    length = f"{each_s:.0f}" if each_s >= _LONG_S else f"{each_s:.1f}"
    return Run(
        number=number,
        axes=axes.capitalize(),
        words=words,
        details=("by hand", *_details(first)[1:]) if hand else _details(first),
        begin=clock_words(begin_s - zero_s),
        length=length,
        each=times > 1,
        picture=input_picture(_strips(repeats), edges_s, description=f"{words} on {axes}, of {length} s"),
    )


def _strips(repeats: Sequence[Sequence[PlannedInput]]) -> list[list[PlannedInput]]:
    """The inputs of each strip of a drawing, repeats one after the other."""
    return [list(strip) for strip in zip(*repeats, strict=True)]


def _details(group: Sequence[PlannedInput]) -> tuple[str, ...]:
    """Amplitude and band; axes are named where they differ."""
    amplitudes = [amplitude_words(planned) for planned in group]
    if len(set(amplitudes)) == 1:
        sizes = amplitudes[0]
    else:
        sizes = ", ".join(f"{planned.axis} {words}" for planned, words in zip(group, amplitudes, strict=True))
    return (sizes, *dict.fromkeys(band_words(planned) for planned in group))


def _edges_s(inputs: Sequence[PlannedInput]) -> tuple[float, float]:
    edges = [excited_s(planned) for planned in inputs]
    return min(begin for begin, _ in edges), max(end for _, end in edges)


def _bound_rows(bounds: Sequence[PredictedBound]) -> tuple[BoundRow, ...]:
    """The first bounds; models are named where there are several, uncertain parameters are marked."""
    several = len({bound.model for bound in bounds}) > 1
    return tuple(
        BoundRow(
            name=bound.name,
            model=bound.model if several else "",
            value=with_error(bound.value, bound.std) if bound.known else _NOT_KNOWN,
            unit=unit(bound.unit) if bound.known else "",
            percent=percent(bound.percent) if bound.known else MISSING,
            off=f"{bound.off_sigmas:.0f} σ off {significant(bound.given, digits=3)}"
            if bound.given is not None and bound.off_sigmas > FAR_SIGMAS
            else "",
        )
        for bound in bounds[:MOST_BOUNDS]
    )
