"""The flight card: one page for the pilot, to be read outdoors. What to fly, how long, when to stop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING

from rotorid import __version__
from rotorid.data.flight_plan import FlightPlan, PlannedInput
from rotorid.errors import UsageError
from rotorid.report.flight_facts import FlightFacts, PredictedBound, excited_s, flown_by_hand
from rotorid.report.flight_picture import input_picture
from rotorid.report.flight_words import (
    after,
    amplitude_words,
    band_words,
    before,
    clock_words,
    how_to_fly,
    length_words,
    shape_words,
    stop_sentence,
    stops,
)
from rotorid.report.frame import asset
from rotorid.report.numbers import MISSING, percent, unit, with_error

if TYPE_CHECKING:
    from markupsafe import Markup

FILE = "flight-card.html"
MOST_RUNS = 8
"""More runs than these do not fit on a page that can be read outdoors."""
MOST_BOUNDS = 12

_ROOMY, _DENSE = 4, 6
"""Up to so many runs the pictures are large, and from so many on the rows are narrow."""
_LONG_NAME = 34
_LONG_S = 10.0
_NOT_KNOWN = "not known"
_POLICY = "default-src 'none'; style-src 'unsafe-inline'"


@dataclass(frozen=True, kw_only=True)
class Run:
    """What is flown without a rest in between: one input, or several at the same time."""

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
    """What the flight will tell about one parameter."""

    name: str
    model: str
    value: str
    unit: str
    percent: str


def flight_card(plan: FlightPlan, facts: FlightFacts) -> dict[str, str]:
    """The card as an HTML file that holds everything it shows, asks the network for nothing, and prints on one A4 page.

    Parameters
    ----------
    plan
        What is to be flown. Inputs that overlap are one run.
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
        policy=_POLICY,
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
        how=how_to_fly(plan, facts.autopilot),
        before=before(plan, facts),
        stops=stops(facts),
        stop_sentence=stop_sentence(facts),
        after=after(plan, facts),
        bounds=_bound_rows(facts.bounds),
        more=max(len(facts.bounds) - MOST_BOUNDS, 0),
    )


def flight_card_pdf(html: str) -> bytes:
    """The card as PDF.

    Parameters
    ----------
    html
        From :func:`flight_card_html`.

    Raises
    ------
    UsageError
        The library that makes PDF is not installed.
    """
    try:
        from weasyprint import HTML
    except (ImportError, OSError) as error:
        # It is an OSError when the library is there and Pango, which it draws with, is not.
        raise UsageError(
            "a flight card as PDF needs weasyprint, which cannot be loaded",
            needed="the extra pdf",
            remedy="pip install 'rotorid[pdf]', or print the HTML card from a browser",
        ) from error
    written: bytes = HTML(string=html, url_fetcher=_refuse).write_pdf()
    return written


def _refuse(url: str) -> dict[str, object]:
    """The card holds everything it shows: nothing is ever fetched, whatever a name in it says."""
    raise ValueError(f"the card asks for {url}")


def _runs(plan: FlightPlan, facts: FlightFacts) -> tuple[Run, ...]:
    groups: list[list[PlannedInput]] = []
    for planned in sorted(plan.inputs, key=lambda one: excited_s(one)[0]):
        if groups and excited_s(planned)[0] < _edges_s(groups[-1])[1]:
            groups[-1].append(planned)
        else:
            groups.append([planned])
    repeated = [list(same) for _, same in groupby(groups, key=_likeness)]
    if len(repeated) > MOST_RUNS:
        raise UsageError(
            f"a flight card for {len(repeated)} runs",
            needed=f"at most {MOST_RUNS}, so that the page can be read outdoors",
            remedy="split the plan into several flights",
        )
    zero_s = _edges_s(plan.inputs)[0]
    by_hand = flown_by_hand(plan, facts.autopilot)
    return tuple(_run(number, same, zero_s, by_hand) for number, same in enumerate(repeated, start=1))


def _likeness(group: Sequence[PlannedInput]) -> tuple[object, ...]:
    """Equal for runs that a pilot takes for the same, whatever their sign or their noise."""
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
    """The inputs of each strip of a drawing: repeats stand behind each other."""
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
    """The first bounds; models are named where there are several, what the data do not tell is called so."""
    several = len({bound.model for bound in bounds}) > 1
    return tuple(
        BoundRow(
            name=bound.name,
            model=bound.model if several else "",
            value=with_error(bound.value, bound.std) if bound.known else _NOT_KNOWN,
            unit=unit(bound.unit) if bound.known else "",
            percent=percent(bound.percent) if bound.known else MISSING,
        )
        for bound in bounds[:MOST_BOUNDS]
    )
