"""Fits in time that do not hold: what does not describe its records, or has a value that nothing bounds, is refused."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence

import numpy as np

from rotorid.data.findings import Finding, refusal
from rotorid.data.quantity import with_error
from rotorid.data.trust import ACCEPTABLE_COST
from rotorid.errors import InsufficientDataError
from rotorid.fits.frequency.fit import FrequencyFit, unbounded_parameters
from rotorid.fits.frequency.refusals import faster_than_sampled
from rotorid.fits.time.fit import TimeFit
from rotorid.fits.time.frequency_check import responses_without_hold
from rotorid.fitting.frequency.problem import pair_names
from rotorid.fitting.least_squares import Outcome, Solution
from rotorid.flights.instruments import is_command
from rotorid.flights.segments import TimeRecords
from rotorid.models.families import family_of
from rotorid.models.parameter import ParameterSet
from rotorid.uncertainty.cramer_rao import Bounds

LEAST_EXPLAINED_PERCENT = 100.0 * (1.0 - math.sqrt(0.5))
"""Below it a simulation leaves more of the variance of an output than it explains."""

_SIGNIFICANT = 3.0
"""Largest errors, in units of those of the responses (rms), at which a high cost does not count."""


def require_time_fit_explains(fitted: TimeFit, frequency: FrequencyFit | None, records: TimeRecords) -> None:
    """Refuse a model that does not describe the records it was fitted to.

    A simulation that leaves more of every output than it explains; a search that came to no rest, or poles that no
    sample shows, but for black boxes, whose single numbers mean nothing; derivatives of a vehicle that miss the
    responses of the same flights by what no fit of responses may, and by many times what these responses state. A fit
    in time has its least errors where noise is least and none of its own for what the structure lacks: nothing else
    would show.

    Parameters
    ----------
    fitted, records
        The fit, with its simulations, and what it was fitted to.
    frequency
        The fit of responses of the same flights, where there is one.

    Raises
    ------
    InsufficientDataError
        One of these.
    """
    name, reasons = fitted.problem.structure.name, []
    opaque = family_of(fitted.problem.structure).opaque
    if fitted.method == "output_error":
        reasons += unexplained(fitted.fit_percent)
    if not opaque:
        reasons += out_of_iterations(name, fitted.solution)
        system = fitted.structure.matrices(fitted.parameters.values)
        rate_hz = min(record.sample_rate_hz for record in records.data)
        reasons += faster_than_sampled(name, system, rate_hz, fitted.structure.outputs)
    of_vehicles = all(is_command(name) for name in fitted.problem.structure.inputs)
    if frequency is not None and not opaque and of_vehicles:
        reasons += _missed_responses(fitted, frequency, records)
    if reasons:
        too_large = all(reason.kind == "impossible_physics" for reason in reasons)
        # Of several outputs, one may be of lower order than the others.
        part = next((reason.where.removeprefix(f"{name}: ") for reason in reasons if reason.where != name), "")
        rest = f" for {part}, and this one without it (--inputs, --outputs)" if part else ""
        remedy = (
            f"use a model of one order less{rest}"
            if too_large
            else "use a model with the missing dynamics, or segments in which the inputs move the vehicle"
        )
        raise does_not_describe(name, reasons, remedy)


def unexplained(fit_percent: Mapping[str, float]) -> list[Finding]:
    """Refusals of a simulation that leaves more of every output than it explains, or of which none was moved."""
    if not fit_percent:
        message = "No input moved an output clearly, and the model explains none of them."
        return [refusal("no_excitation", "outputs", message)]
    if max(fit_percent.values()) >= LEAST_EXPLAINED_PERCENT:
        return []
    return [
        refusal(
            "poor_fit",
            output,
            f"In simulation the model misses more of {output} than it explains: its fit is {percent:.0f} %.",
            fit_percent=percent,
        )
        for output, percent in fit_percent.items()
    ]


def out_of_iterations(name: str, solution: Solution) -> list[Finding]:
    """The refusal of a search that did not converge."""
    if solution.outcome is not Outcome.OUT_OF_ITERATIONS:
        return []
    return [refusal("not_converged", name, f"The fit did not converge: {solution.outcome.value}")]


def does_not_describe(name: str, reasons: Sequence[Finding], remedy: str) -> InsufficientDataError:
    """The error of a model that does not hold, with its reasons."""
    return InsufficientDataError(
        f"{name} does not describe these flights: " + " ".join(reason.message for reason in reasons),
        remedy=remedy,
        findings=reasons,
    )


def _missed_responses(fitted: TimeFit, frequency: FrequencyFit, records: TimeRecords) -> Iterator[Finding]:
    problem, theta = responses_without_hold(fitted, frequency, records)
    costs = problem.costs(theta)
    used = problem.used.any(axis=-1)
    average = float(np.mean(costs[used]))
    if average <= ACCEPTABLE_COST:
        return
    model = problem.structure.response(problem.parameters.unpack(theta).values, problem.data.omega_rad_s)
    off = np.abs(model[problem.used] / problem.data.values[problem.used] - 1.0)
    stated = math.sqrt(2.0) * problem.data.random_error[problem.used]
    if float(np.sqrt(np.mean((off / stated) ** 2))) <= _SIGNIFICANT:
        return
    worst = np.unravel_index(np.argmax(np.where(used, costs, -np.inf)), costs.shape)
    pair = np.array(pair_names(problem.data)).reshape(costs.shape)[worst]
    message = (
        f"In the frequency domain the average cost of these values is {average:.0f}, above the acceptable "
        f"{ACCEPTABLE_COST:g}; {pair} is worst with {costs[worst]:.0f}."
    )
    yield refusal("poor_fit", fitted.problem.structure.name, message, average_cost=average)


def require_bounds(parameters: ParameterSet, bounds: Bounds, couplings: Collection[str] = ()) -> None:
    """Refuse values that nothing bounds, for others take over whatever they do.

    Parameters
    ----------
    parameters, bounds
        What a fit found, and how certain it is.
    couplings
        Those that are zero unless known better.

    Raises
    ------
    InsufficientDataError
        A parameter, no coupling, is ten times less certain than it is large.
    """
    loose = [name for name in unbounded_parameters(parameters, bounds) if name not in couplings]
    if not loose:
        return
    stds = bounds.stds
    found = ", ".join(
        f"{name} is {with_error(parameters[name].value, stds[name])} {parameters[name].unit}" for name in loose
    )
    raise InsufficientDataError(
        f"not enough data for {', '.join(loose)}: {found}",
        needed="records that separate them from the other parameters",
        remedy="use a smaller model, such as one order less, or fix one of them with --fix NAME=VALUE",
        findings=[
            refusal("not_identifiable", ", ".join(loose), f"{found}: other parameters compensate for any change.")
        ],
    )
