"""The page of ``fleet``: which vehicles to look at and why, what is normal, each vehicle's history, all numbers.

The numbers are embedded column by column. The page's script draws only what is looked at, so that ten thousand logs
stay smooth.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rotorid.data.display import capital, counted
from rotorid.data.quantities import QUANTITIES
from rotorid.data.quantity import MISSING, TWO_SIDED_95, minus, significant, with_error, with_interval, with_unit
from rotorid.documents.fleet import (
    DifferenceDocument,
    FailedLogDocument,
    FleetDocument,
    OddFlightDocument,
    OutOfBalanceDocument,
    PopulationDocument,
    VehicleVerdictDocument,
    YawOverVoltageDocument,
)
from rotorid.documents.review import QuantityDocument
from rotorid.fleets.analysis import FleetAnalysis, History, quantity_of
from rotorid.fleets.names import Shown, shown, words_of
from rotorid.fleets.populations import Population
from rotorid.fleets.table import REVIEW
from rotorid.fleets.yaw_drift import SLOPES
from rotorid.letters import visible
from rotorid.plot.fleet import over_voltage
from rotorid.report.frame import Picture, drawn, frequency_of, render

_DIGITS = 7
_MOST_FAILED = 200
_MOST_UNCHANGED, _MOST_NUMBERS = 50, 6


@dataclass(frozen=True, kw_only=True, slots=True)
class Notable:
    """A vehicle to look at: what was found, since which flight and log, and the usual cause."""

    vehicle: str
    what: str
    flight: int | None = None
    log: str = ""
    usual: str = ""

    @property
    def line(self) -> str:
        """All of it in one line."""
        where = f", flight {self.flight} ({self.log})" if self.flight else ""
        return f"{self.vehicle}{where}: {self.what}" + (f"; usual cause: {self.usual}" if self.usual else "")


def notable(document: FleetDocument) -> tuple[Notable, ...]:
    """What to look at: changes first, then odd flights, odd vehicles, slow changes, other gains and imbalance."""
    return (
        *(
            Notable(
                vehicle=cause.vehicle,
                what=f"changed: {cause.words}",
                flight=cause.at_flight,
                log=cause.log,
                usual=cause.usual,
            )
            for cause in document.causes
        ),
        *_joined(
            Notable(vehicle=odd.vehicle, what=f"odd flight: {_odd(odd)}", flight=odd.flight, log=odd.log)
            for odd in document.outliers.flights
        ),
        *_joined(
            Notable(vehicle=odd.vehicle, what=f"unlike the other vehicles: {words_of(odd.model, odd.parameter)}")
            for odd in document.outliers.vehicles
        ),
        *_joined(
            Notable(vehicle=drift.vehicle, what=f"slow change: {_slope(drift.model, drift.parameter, drift.slope)}")
            for drift in document.drifts
        ),
        *(
            Notable(
                vehicle=gains.vehicle,
                what="other gains: "
                + ", ".join(
                    f"{name} {significant(before)} to {significant(after)}"
                    for name, (before, after) in gains.gains.items()
                ),
                flight=gains.at_flight,
                log=gains.log,
            )
            for gains in document.other_gains
        ),
        *(
            Notable(
                vehicle=one.vehicle,
                what=f"motors out of balance: {_imbalance(one)}",
            )
            for one in document.out_of_balance
        ),
    )


def _imbalance(one: OutOfBalanceDocument) -> str:
    row = QUANTITIES["imbalance"]
    size = with_unit(significant(100.0 * one.imbalance.value), "%")
    return f"{size} in {one.flights} of {counted(one.of_flights, 'flight')}, {row.scale('good')}"


def _joined(found: Iterable[Notable]) -> Iterable[Notable]:
    """One line for all quantities of a vehicle and flight."""
    several: dict[tuple[str, int | None], Notable] = {}
    for one in found:
        key = (one.vehicle, one.flight)
        if key in several:
            one = replace(one, what=f"{several[key].what}, {one.what.partition(': ')[2]}")
        several[key] = one
    return several.values()


def _odd(odd: OddFlightDocument) -> str:
    quantity = quantity_of_paper(odd.model, odd.parameter, odd.value.unit)
    value, expected = quantity.factor * odd.value.value, quantity.factor * odd.expected
    number = with_error(value, None if odd.value.std is None else quantity.factor * odd.value.std)
    return f"{words_of(odd.model, odd.parameter)} {with_unit(number, quantity.unit)}, usually {significant(expected)}"


def _slope(model: str, parameter: str, slope: QuantityDocument) -> str:
    quantity = quantity_of_paper(model, parameter, slope.unit)
    number = with_error(quantity.factor * slope.value, None if slope.std is None else quantity.factor * slope.std)
    return f"{words_of(model, parameter)} by {with_unit(number, quantity.unit)} per flight"


def quantity_of_paper(model: str, parameter: str, unit: str) -> Shown:
    """How a quantity is written, figures of a review in Hz unless the reader prefers rad/s."""
    found = shown(model, parameter, unit)
    if model == REVIEW and found.unit == "rad/s" and frequency_of(["flight.ulg"]) == "Hz":
        return replace(found, unit="Hz", factor=found.factor / (2.0 * math.pi))
    return found


@dataclass(frozen=True, kw_only=True, slots=True)
class Refusal:
    """Models of a log that have no answer for one reason."""

    log: str
    models: str
    flights: int
    reason: str

    @property
    def line(self) -> str:
        """All of it in one line."""
        models = f" ({self.models})" if self.models else ""
        return f"{self.log}{models}: {self.reason}" + (f" ({self.flights} flights)" if self.flights > 1 else "")


def refusals(failed: Sequence[FailedLogDocument]) -> list[Refusal]:
    """What has no answer: each reason of a log once, with its models and number of flights."""
    found: dict[tuple[str, str], list[FailedLogDocument]] = {}
    for failure in failed:
        # A reason often begins with the name of its log.
        reason = failure.reason.removeprefix(failure.log).lstrip(": ")
        found.setdefault((failure.log, reason), []).append(failure)
    return [
        Refusal(
            log=log,
            models=", ".join(dict.fromkeys(failure.model for failure in many if failure.model)),
            flights=len({failure.flight for failure in many}),
            reason=reason,
        )
        for (log, reason), many in found.items()
    ]


@dataclass(frozen=True, kw_only=True, slots=True)
class PopulationRow:
    """One quantity over the fleet; numbers are text, the 95 % interval of a spread below it."""

    quantity: Shown
    mean: str
    shared: str
    between: tuple[str, str]
    within: tuple[str, str]
    normal: str
    vehicles: int
    flights: int


@dataclass(frozen=True, kw_only=True, slots=True)
class GroupRow:
    """The difference of one quantity between two groups of flights."""

    quantity: Shown
    group: str
    against: str
    difference: tuple[str, str]
    share: str
    found: bool


@dataclass(frozen=True, kw_only=True, slots=True)
class YawRow:
    """Yaw drift or trim over battery voltage: slopes with intervals, or what was missing, and the flights as points."""

    quantity: Shown
    within: tuple[str, str]
    between: tuple[str, str]
    flights: int
    picture: Picture


def render_fleet(analysis: FleetAnalysis, document: FleetDocument) -> str:
    """The page of a fleet as one HTML file.

    Parameters
    ----------
    analysis
        The analysis of its table.
    document
        The same as it is written, with what failed.
    """
    unchanged = [verdict for verdict in document.verdicts if verdict.verdict != "changed"]
    yaw = [_over_voltage(found) for found in document.yaw_over_voltage if found.flights]
    refused = refusals(document.failed)
    return render(
        "fleet.html",
        pictures=[row.picture for row in yaw],
        further_script="fleet.js",
        further=_for_script(analysis),
        title=f"{counted(document.vehicles, 'vehicle')} in {counted(document.logs, 'log')}",
        sentences=document.sentences,
        notable=notable(document),
        unchanged=unchanged[:_MOST_UNCHANGED],
        more_unchanged=max(len(unchanged) - _MOST_UNCHANGED, 0),
        document=document,
        populations=[
            _row(model, name, population)
            for model, many in document.population.items()
            for name, population in many.items()
        ],
        yaw=yaw,
        groups=[_group(difference) for difference in document.groups],
        refused=refused[:_MOST_FAILED],
        more_refused=max(len(refused) - _MOST_FAILED, 0),
        checked=_checked,
        capital=capital,
    )


def _checked(verdict: VehicleVerdictDocument) -> str:
    """Quantities of a vehicle that could be checked, with the change that each would have shown."""
    found = [
        f"{words_of(number.model, quantity_of(number.parameter))} ({100.0 * number.detectable_share:.0f} %)"
        for number in verdict.numbers
        if number.verdict == "unchanged" and number.detectable_share is not None
    ]
    more = ", …" if len(found) > _MOST_NUMBERS else ""
    quantities = {(number.model, quantity_of(number.parameter)) for number in verdict.numbers}
    return f"{len(found)} of {len(quantities)}" + (f": {', '.join(found[:_MOST_NUMBERS])}{more}" if found else "")


def _group(difference: DifferenceDocument) -> GroupRow:
    found = difference.difference
    quantity = quantity_of_paper(difference.model, difference.parameter, found.unit)
    ends = (None if end is None else quantity.factor * end for end in (found.value, found.lower, found.upper))
    return GroupRow(
        quantity=quantity,
        group=difference.group,
        against=difference.against,
        difference=with_interval(*ends),
        share=MISSING if difference.relative is None else minus(f"{100.0 * difference.relative:+.1f} %"),
        found=difference.found,
    )


def _row(model: str, name: str, population: PopulationDocument) -> PopulationRow:
    quantity = quantity_of_paper(model, name, population.unit)
    normal = population.normal
    return PopulationRow(
        quantity=quantity,
        mean=with_error(*_times(quantity.factor, population.mean.value, population.mean.std)),
        shared=significant(quantity.factor * population.model_std, digits=2),
        between=_deviation(population.between_std, quantity.factor),
        within=_deviation(population.within_std, quantity.factor),
        normal=MISSING if normal is None else " to ".join(significant(quantity.factor * end) for end in normal),
        vehicles=population.vehicles,
        flights=population.flights,
    )


def _over_voltage(found: YawOverVoltageDocument) -> YawRow:
    level = quantity_of_paper(REVIEW, found.parameter, found.flights[0].value.unit)
    quantity = quantity_of_paper(REVIEW, SLOPES[found.parameter], "")
    slopes = {"slope within flights": found.within, "slope between flights": found.between}
    picture = Picture(
        key=f"fleet-{found.parameter}",
        description=f"{capital(level.words)} of each flight over its battery voltage, with errors and slopes",
        figure=drawn(
            over_voltage,
            np.array([flight.voltage_v for flight in found.flights]),
            level.factor * np.array([flight.value.value for flight in found.flights]),
            level.factor * TWO_SIDED_95 * np.array([flight.value.std or 0.0 for flight in found.flights]),
            label=f"{capital(level.words)} [{level.unit}]",
            names=[f"{flight.vehicle}, {flight.log}" for flight in found.flights],
            slopes={name: quantity.factor * slope.value for name, slope in slopes.items() if slope is not None},
        ),
    )
    return YawRow(
        quantity=quantity,
        within=_slope_cells(found.within, found.why_within, quantity.factor),
        between=_slope_cells(found.between, found.why_between, quantity.factor),
        flights=len(found.flights),
        picture=picture,
    )


def _slope_cells(slope: QuantityDocument | None, why: str, factor: float) -> tuple[str, str]:
    if slope is None:
        return "not enough data", why
    return with_interval(*_times(factor, slope.value, slope.lower, slope.upper))


def _times(factor: float, *values: float | None) -> Iterator[float | None]:
    return (None if value is None else factor * value for value in values)


def _deviation(deviation: QuantityDocument | None, factor: float) -> tuple[str, str]:
    if deviation is None:
        return MISSING, ""
    upper = math.inf if deviation.upper is None else deviation.upper
    return with_interval(*_times(factor, deviation.value, deviation.lower, upper))


def _for_script(analysis: FleetAnalysis) -> dict[str, Any]:
    """Every history by columns, in units of paper; texts that repeat are numbers of a list."""
    logs: dict[str, int] = {}
    findings: dict[str, int] = {}
    vehicles: dict[str, int] = {}

    def number(known: dict[str, int], text: str) -> int:
        return known.setdefault(visible(text), len(known))

    def described(history: History) -> dict[str, Any]:
        quantity = quantity_of_paper(history.model, history.parameter, history.unit)

        def short(value: float) -> float | None:
            return float(f"{quantity.factor * value:.{_DIGITS}g}") if math.isfinite(value) else None

        level = history.level
        return {
            "vehicle": number(vehicles, history.vehicle),
            "model": history.model,
            "parameter": quantity.label,
            "unit": quantity.unit,
            "log": [number(logs, row.log) for row in history.rows],
            "time": [row.time_utc for row in history.rows] if any(row.time_utc for row in history.rows) else [],
            "value": [short(row.value) for row in history.rows],
            "text": [with_error(*_times(quantity.factor, row.value, row.std)) for row in history.rows],
            "ends": [[short(row.lower), short(row.upper)] for row in history.rows],
            "findings": [number(findings, row.findings.replace("_", " ")) for row in history.rows],
            "level": None if level is None else [short(end) for end in (level.value, level.lower, level.upper)],
            "level_text": "" if level is None else with_error(*_times(quantity.factor, level.value, level.std)),
            "verdict": history.verdict,
            "changes": [_change(history, k, quantity.factor) for k in range(len(history.changes))],
            "odd": [odd.flight for odd in history.odd],
            "odd_vehicle": history.odd_vehicle is not None,
        }

    def of_population(model: str, name: str, population: Population) -> dict[str, Any]:
        quantity = quantity_of_paper(model, name, population.mean.unit)
        low, high = _times(quantity.factor, population.low, population.high)
        return {"model": model, "parameter": quantity.label, "unit": quantity.unit, "low": low, "high": high}

    series = [described(history) for history in analysis.histories]
    return {
        "vehicles": list(vehicles),
        "logs": list(logs),
        "findings": list(findings),
        "series": series,
        "populations": [of_population(*key, population) for key, population in analysis.populations.items()],
    }


def _change(history: History, number: int, factor: float) -> Mapping[str, float]:
    change = history.changes[number]
    stop = history.changes[number + 1].at_flight if number + 1 < len(history.changes) else len(history.rows) + 1
    start = history.changes[number - 1].at_flight if number else 1
    return {
        "at": change.at_flight,
        "from": start,
        "to": stop - 1,
        "before": factor * change.before.value,
        "after": factor * change.after.value,
    }
