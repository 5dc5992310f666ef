"""The page of ``fleet``: what changed, what is normal, the history of each vehicle, and a table that sorts and filters.

The numbers stand in the page column by column; the page's script draws what is looked at and no more, so that ten
thousand logs stay smooth.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rotorid.data.display import counted, visible
from rotorid.data.quantity import MISSING, Quantity, minus, significant, unit, with_error, with_interval
from rotorid.documents.fleet import FleetDocument, PopulationDocument, VehicleVerdictDocument
from rotorid.fleets.analysis import FleetAnalysis, History, quantity_of
from rotorid.report.frame import render

_DIGITS = 7
_MOST_FAILED = 200
_MOST_UNCHANGED, _MOST_NUMBERS = 50, 6


@dataclass(frozen=True, kw_only=True, slots=True)
class PopulationRow:
    """One parameter over the fleet; numbers are text, the 95 % interval of a spread below it."""

    model: str
    parameter: str
    unit: str
    mean: str
    shared: str
    between: tuple[str, str]
    within: tuple[str, str]
    normal: str
    vehicles: int
    flights: int


def render_fleet(analysis: FleetAnalysis, document: FleetDocument) -> str:
    """The page of a fleet as one HTML file.

    Parameters
    ----------
    analysis
        What its table says.
    document
        The same as it is written, with what failed.
    """
    unchanged = [verdict for verdict in document.verdicts if verdict.verdict != "changed"]
    return render(
        "fleet.html",
        pictures=(),
        further_script="fleet.js",
        further=_for_script(analysis),
        title=f"{counted(document.vehicles, 'vehicle')} in {counted(document.logs, 'log')}",
        sentences=document.sentences,
        unchanged=unchanged[:_MOST_UNCHANGED],
        more_unchanged=max(len(unchanged) - _MOST_UNCHANGED, 0),
        document=document,
        populations=[
            _row(model, name, population)
            for model, many in document.population.items()
            for name, population in many.items()
        ],
        failed=document.failed[:_MOST_FAILED],
        more_failed=max(len(document.failed) - _MOST_FAILED, 0),
        significant=significant,
        with_error=with_error,
        with_interval=with_interval,
        percent=_percent,
        checked=_checked,
    )


def _checked(verdict: VehicleVerdictDocument) -> str:
    """Numbers of a vehicle that could be checked, with the change that each would have shown."""
    found = [
        f"{quantity_of(number.parameter)} ({100.0 * number.detectable_share:.0f} %)"
        for number in verdict.numbers
        if number.verdict == "unchanged" and number.detectable_share is not None
    ]
    more = ", …" if len(found) > _MOST_NUMBERS else ""
    quantities = {(number.model, quantity_of(number.parameter)) for number in verdict.numbers}
    return f"{len(found)} of {len(quantities)}" + (f": {', '.join(found[:_MOST_NUMBERS])}{more}" if found else "")


def _percent(value: float | None) -> str:
    return MISSING if value is None else minus(f"{100.0 * value:+.1f} %")


def _row(model: str, name: str, population: PopulationDocument) -> PopulationRow:
    return PopulationRow(
        model=model,
        parameter=name,
        unit=unit(population.unit),
        mean=with_error(population.mean.value, population.mean.std),
        shared=significant(population.model_std, digits=2),
        between=_deviation(population.between_std),
        within=_deviation(population.within_std),
        normal=MISSING if population.normal is None else " to ".join(significant(end) for end in population.normal),
        vehicles=population.vehicles,
        flights=population.flights,
    )


def _deviation(one: Any) -> tuple[str, str]:
    if one is None:
        return MISSING, ""
    return with_interval(one.value, one.lower, math.inf if one.upper is None else one.upper)


def _for_script(analysis: FleetAnalysis) -> dict[str, Any]:
    """Every history by columns; texts that repeat are numbers of a list."""
    logs: dict[str, int] = {}
    findings: dict[str, int] = {}
    vehicles: dict[str, int] = {}

    def number(known: dict[str, int], text: str) -> int:
        return known.setdefault(visible(text), len(known))

    series = [
        {
            "vehicle": number(vehicles, history.vehicle),
            "model": history.model,
            "parameter": history.parameter,
            "unit": unit(history.unit),
            "log": [number(logs, row.log) for row in history.rows],
            "time": [row.time_utc for row in history.rows] if any(row.time_utc for row in history.rows) else [],
            "value": [_short(row.value) for row in history.rows],
            "std": [_short(row.std) for row in history.rows],
            "ends": [[_short(row.lower), _short(row.upper)] for row in history.rows],
            "findings": [number(findings, row.findings) for row in history.rows],
            "level": None if history.level is None else [_short(end) for end in _ends(history.level)],
            "verdict": history.verdict,
            "changes": [_change(history, k) for k in range(len(history.changes))],
            "drift": None if history.drift is None else _short(history.drift.slope.value),
            "odd": [odd.flight for odd in history.odd],
            "odd_vehicle": history.odd_vehicle is not None,
        }
        for history in analysis.histories
    ]
    return {
        "vehicles": list(vehicles),
        "logs": list(logs),
        "findings": list(findings),
        "series": series,
        "populations": [
            {
                "model": model,
                "parameter": name,
                "unit": unit(population.mean.unit),
                "mean": _short(population.mean.value),
                "low": None if population.low is None else _short(population.low),
                "high": None if population.high is None else _short(population.high),
            }
            for (model, name), population in analysis.populations.items()
        ],
    }


def _ends(level: Quantity) -> tuple[float, float, float]:
    return level.value, level.lower, level.upper


def _change(history: History, number: int) -> Mapping[str, float]:
    change = history.changes[number]
    stop = history.changes[number + 1].at_flight if number + 1 < len(history.changes) else len(history.rows) + 1
    start = history.changes[number - 1].at_flight if number else 1
    return {
        "at": change.at_flight,
        "from": start,
        "to": stop - 1,
        "before": _short(change.before.value) or 0.0,
        "after": _short(change.after.value) or 0.0,
    }


def _short(value: float) -> float | None:
    return float(f"{value:.{_DIGITS}g}") if math.isfinite(value) else None
