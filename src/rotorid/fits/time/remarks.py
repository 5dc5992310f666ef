"""Findings on a fit in time: its pieces, fits, residuals and solver."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rotorid.data.findings import Finding, remark, warn
from rotorid.fits.remarks import judge_parameters
from rotorid.fits.time.fit import TimeFit, growth
from rotorid.fitting.least_squares import Outcome, Solution
from rotorid.flights.segments import TimeRecords
from rotorid.models.expression import Expression
from rotorid.models.families import family_of
from rotorid.models.nonlinear import NonlinearStructure
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.results.model import SimulatedRecord
from rotorid.uncertainty.cramer_rao import Bounds
from rotorid.verification.driven import driven, undriven_words
from rotorid.verification.scores import GOOD_FIT_PERCENT

_COLORED = 1.2
"""Inflation of standard deviations from which the color of residuals is remarked on."""

_SETTLED = 1e-6
"""Share of the cost that one more step may promise at the end."""


def judge_time_fit(fitted: TimeFit, records: TimeRecords, fit_percent: Mapping[str, float]) -> tuple[Finding, ...]:
    """Remarks on the fit, its residuals and its parameters; those of a black box mean nothing one by one."""
    opaque = family_of(fitted.problem.structure).opaque
    return (
        *fitted.findings,
        *_pieces(fitted),
        *judge_explained(fit_percent, simulated=fitted.method == "output_error"),
        *undriven_outputs(fitted.structure, fitted.simulated, fit_percent),
        *judge_colors(fitted.problem.structure.name, fitted.bounds, 1.0 / records.data[0].sample_rate_hz),
        *judge_solver(
            fitted.problem.structure.name, fitted.solution, fitted.parameters, fitted.problem.structure.input_delays
        ),
        *(() if opaque else judge_parameters(fitted.parameters, fitted.bounds)),
    )


def _pieces(fitted: TimeFit) -> list[Finding]:
    if fitted.pieces_s is None:
        return []
    rate = growth(fitted.problem.structure, fitted.parameters)
    why = (
        f"The fastest mode grows by a factor of e in {1.0 / rate:.2g} s, so over a whole record any error would "
        "explode."
        if rate > 0.0
        else "Pieces were requested."
    )
    count = len(fitted.problem.records)
    cut = f"in {count} pieces of about {fitted.pieces_s:.2g} s, each with its own initial state"
    return [
        remark(
            "fitted_in_pieces",
            fitted.problem.structure.name,
            f"{why} The records were fitted {cut}; fits in percent are for the pieces."
            if fitted.method == "output_error"
            else f"{why} Whole records were fitted; to show the fit they were simulated {cut}.",
            pieces=float(count),
            length_s=fitted.pieces_s,
            growth_1_s=rate,
        )
    ]


def judge_explained(fit_percent: Mapping[str, float], *, simulated: bool = True) -> list[Finding]:
    """A remark on each output that a simulation explains badly; a warning where the simulation was what was fitted."""
    why = (
        "The model lacks dynamics, or something other than its inputs moves the vehicle."
        if simulated
        else "The fit looks at each sample separately; in a simulation gusts and missing dynamics add up."
    )
    return [
        (warn if simulated else remark)(
            "poor_fit",
            name,
            f"In simulation the model explains {percent:.0f} % of {name} in the fitted records (good: "
            f"{GOOD_FIT_PERCENT:g} % and more). {why}",
            fit_percent=percent,
        )
        for name, percent in fit_percent.items()
        if percent < GOOD_FIT_PERCENT
    ]


def undriven_outputs(
    structure: LinearStructure | NonlinearStructure,
    simulated: Sequence[SimulatedRecord],
    fit_percent: Mapping[str, float],
) -> list[Finding]:
    """A note on each output that no input moved, or hardly: the records do not show how well it is explained."""
    moved = [driven(structure, record.inputs) for record in simulated]
    return [
        remark(
            "no_excitation",
            name,
            f"{undriven_words(structure, name, moved)}, so the records do not show how well {name} is explained.",
        )
        for name in structure.outputs
        if name not in fit_percent and simulated
    ]


def judge_colors(name: str, bounds: Bounds, step_s: float) -> list[Finding]:
    """A remark on residuals that are not white."""
    factor, memory = bounds.inflation, bounds.ar_order
    if factor < _COLORED:
        return []
    color = (
        f"Residuals are correlated over about {memory} samples ({memory * step_s:.2g} s), as in every real flight."
        if memory
        else "Residuals of the equations are correlated, as in every real flight."
    )
    return [
        remark(
            "colored_residuals",
            name,
            f"{color} Standard deviations include this: they are {factor:.2g} times as large as for white residuals.",
            factor=factor,
            memory=float(memory),
        )
    ]


def judge_solver(
    name: str, solution: Solution, parameters: ParameterSet, input_delays: Sequence[Expression]
) -> list[Finding]:
    """Findings on parameters at a bound, and on a search that did not converge."""
    delays = {str(entry) for entry in input_delays}
    findings = [
        _at_bound(parameter, late=parameter in delays and parameters[parameter].value == 0.0)
        for parameter, at_bound in zip(parameters.free, solution.at_bound, strict=False)
        if at_bound
    ]
    if solution.outcome is not Outcome.CONVERGED and left_to_gain(solution) > _SETTLED:
        findings.append(warn("not_converged", name, solution.outcome.value))
    return findings


def _at_bound(name: str, *, late: bool) -> Finding:
    why = (
        " The outputs respond no later than the command, or earlier. A zero-phase filter on the outputs alone or "
        "late time stamps of the commands cause this."
        if late
        else ""
    )
    return warn(
        "parameter_at_bound", name, f"{name} ended at a bound of the search, so its value is only a limit.{why}"
    )


def left_to_gain(solution: Solution) -> float:
    """Share of the sum of squares that one more step promises; bounds are respected."""
    inner = ~np.array(solution.at_bound, dtype=np.bool_)
    if not inner.any() or solution.cost <= 0.0:
        return 0.0
    J = solution.jacobian[:, inner]
    step = np.linalg.lstsq(J, solution.residual, rcond=None)[0]
    return float(np.sum((J @ step) ** 2)) / solution.cost


def nothing_unseen(names: Sequence[str]) -> Finding:
    """The warning that no maneuver is left to validate the model."""
    return warn(
        "not_verified",
        ", ".join(dict.fromkeys(names)),
        "All maneuvers were used for the fit; none is left to validate the model. Give another log with --verify.",
    )
