"""Consistency of the flights of a frequency fit: each part is fitted alone and compared."""

from __future__ import annotations

import contextlib
import logging
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from rotorid.data.trust import ACCEPTABLE_COST, RICH_KINDS
from rotorid.errors import RotoridError
from rotorid.fits.frequency.fit import FrequencyFit
from rotorid.fits.frequency.inverse import pose_screened
from rotorid.fits.frequency.windows import measured_with_model
from rotorid.fits.scatter import LogEstimate, amplitude_dependences, disagreements, widened
from rotorid.fitting.frequency.fit import fit_frequency, refine
from rotorid.fitting.least_squares import Outcome
from rotorid.flights.flights import Flight
from rotorid.flights.instruments import axes_of
from rotorid.flights.measure import Measured, measure
from rotorid.settings.identifying import IdentifySettings
from rotorid.typing import Axis
from rotorid.uncertainty.cramer_rao import bounds

_PROGRESS = logging.getLogger("rotorid.progress")


def with_scatter(fitted: FrequencyFit, flights: Sequence[Flight], settings: IdentifySettings) -> FrequencyFit:
    """The fit with intervals that cover the scatter between flights, each of which shows every input.

    Parts are logs, or the repetitions of its maneuvers where one log holds all. Each is measured alone and fitted at
    the structure that all together ended with; one that cannot be is not compared. Repetitions with different swings
    show besides what depends on amplitude.
    """
    estimates: list[LogEstimate] = []
    parts = _flights_by_part(flights, axes_of(fitted.problem.data.inputs, fitted.problem.data.outputs))
    for place, (name, part) in enumerate(parts.items()):
        _PROGRESS.info(f"fitting {name} alone", extra={"done": place, "total": len(parts)})
        with contextlib.suppress(RotoridError):  # a part may be too short for what all show together
            estimates += _separate_estimates(fitted, name, part, settings)
    bent = amplitude_dependences(estimates) if len({id(flight.record) for flight in flights}) == 1 else ()
    dependent = {dependence.parameter for dependence in bent}
    disagreeing = [disagreement for disagreement in disagreements(estimates) if disagreement.parameter not in dependent]
    added = {disagreement.parameter: disagreement.scatter for disagreement in disagreeing}
    added |= {
        dependence.parameter: abs(fitted.parameters[dependence.parameter].value - dependence.at_rest)
        for dependence in bent
    }
    units = {parameter.name: parameter.unit for parameter in fitted.parameters}
    findings = [dependence.finding(units[dependence.parameter]) for dependence in bent] + [
        disagreement.finding(units[disagreement.parameter]) for disagreement in disagreeing
    ]
    return replace(fitted, bounds=widened(fitted.bounds, added), findings=(*fitted.findings, *findings))


def _flights_by_part(flights: Sequence[Flight], axes: Sequence[Axis]) -> dict[str, list[Flight]]:
    """Parts of flights that each show every axis, by their names; none where there is only one."""
    logs: dict[int, list[Flight]] = {}
    for flight in flights:
        logs.setdefault(id(flight.record), []).append(flight)
    if len(logs) > 1:
        whole = [part for part in logs.values() if {*axes} <= {flight.axis for flight in part}]
        names = [part[0].record.source.name for part in whole]
        parts = {
            name if names.count(name) == 1 else f"{name} ({place})": part
            for place, (name, part) in enumerate(zip(names, whole, strict=True), 1)
        }
    else:
        rich = [flight for flight in flights if flight.maneuver.kind in RICH_KINDS]
        turns = [[flight for flight in rich if flight.axis == axis] for axis in axes]
        together = zip(*turns, strict=False)
        parts = {f"{part[0].record.source.name} at {part[0].maneuver.start_s:.1f} s": [*part] for part in together}
    return parts if len(parts) > 1 else {}


def _separate_estimates(
    fitted: FrequencyFit, name: str, flights: Sequence[Flight], settings: IdentifySettings
) -> Iterator[LogEstimate]:
    """Parameters of a fit estimated from some of the flights, if its structure describes them."""
    whole = fitted.problem
    measured = measure(flights, inputs=whole.data.inputs, outputs=whole.data.outputs, settings=settings)
    posed = pose_screened(whole.structure, measured, settings, flights).problem
    kept = whole.used.any(axis=-1, keepdims=True) & (posed.data.omega_rad_s >= fitted.band_rad_s[0])
    problem = replace(posed, parameters=whole.parameters.with_values(fitted.parameters.values), used=posed.used & kept)
    problem = measured_with_model(problem, fitted.parameters, fitted.bounds, measured, settings) or problem
    solution = fit_frequency(problem)
    final = refine(problem, solution) if fitted.weights == "covariance" else solution
    costs = problem.costs(final.theta)[problem.used.any(axis=-1)]
    converged = {solution.outcome, final.outcome} == {Outcome.CONVERGED}
    if converged and float(np.mean(costs)) <= ACCEPTABLE_COST:
        limits = bounds(problem, final, weights=fitted.weights)
        values = problem.parameters.unpack(final.theta).values
        yield LogEstimate(
            record=name,
            values={name: values[name] for name in limits.names},
            stds=limits.stds,
            random={
                parameter: std
                for parameter, std in limits.random_stds.items()
                if whole.parameters[parameter].unit != "s"
            },
            asked=_swing(measured, measured.response.inputs),
            moved=_swing(measured, measured.response.outputs),
        )


def _swing(measured: Measured, names: Sequence[str]) -> float:
    """Root mean square of channels about their means; of several, their geometric mean."""
    histories = [segment.history for segment in measured.segments]
    sizes = []
    for name in names:
        moved = np.concatenate([history[name] - history[name].mean() for history in histories])
        sizes.append(float(np.sqrt(np.mean(moved**2))))
    return math.prod(sizes) ** (1.0 / len(sizes))
