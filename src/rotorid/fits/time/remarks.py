"""What a careful engineer would remark on a fit in time: on its pieces, its fits, its residuals and its solver."""

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
from rotorid.models.parameter import ParameterSet
from rotorid.uncertainty.cramer_rao import Bounds
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
        f"The fastest mode grows e-fold in {1.0 / rate:.2g} s, and over a whole record any error would explode."
        if rate > 0.0
        else "Pieces were asked for."
    )
    count = len(fitted.problem.records)
    cut = f"in {count} pieces of about {fitted.pieces_s:.2g} s, each with an initial state of its own"
    return [
        remark(
            "fitted_in_pieces",
            fitted.problem.structure.name,
            f"{why} The records were fitted {cut}; fits in percent are those of the pieces."
            if fitted.method == "output_error"
            else f"{why} The fit takes the records whole; to show it they were simulated {cut}.",
            pieces=float(count),
            length_s=fitted.pieces_s,
            growth_1_s=rate,
        )
    ]


def judge_explained(fit_percent: Mapping[str, float], *, simulated: bool = True) -> list[Finding]:
    """A remark on each output that a simulation explains badly; a warning where the simulation was what was fitted."""
    why = (
        "Dynamics are missing, or other things than the inputs move it."
        if simulated
        else "The fit looks at each sample by itself; in a simulation gusts add up, and so does what is missing."
    )
    return [
        (warn if simulated else remark)(
            "poor_fit",
            name,
            f"Simulated, the model explains {percent:.0f} % of {name} in the records it was fitted to (good: "
            f"{GOOD_FIT_PERCENT:g} % and more). {why}",
            fit_percent=percent,
        )
        for name, percent in fit_percent.items()
        if percent < GOOD_FIT_PERCENT
    ]


def judge_colors(name: str, bounds: Bounds, step_s: float) -> list[Finding]:
    """A remark on residuals that are not white."""
    factor, memory = bounds.inflation, bounds.ar_order
    if factor < _COLORED:
        return []
    color = (
        f"Residuals remember their past over some {memory} samples ({memory * step_s:.2g} s), as in every real flight."
        if memory
        else "Errors of the equations are not white, as in every real flight."
    )
    return [
        remark(
            "colored_residuals",
            name,
            f"{color} Standard deviations count that: they are {factor:.2g} times as large as for white residuals.",
            factor=factor,
            memory=float(memory),
        )
    ]


def judge_solver(
    name: str, solution: Solution, parameters: ParameterSet, input_delays: Sequence[Expression]
) -> list[Finding]:
    """Parameters that ended on a bound, and a search that did not come to rest."""
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
        " The outputs answer no later than they are asked, or earlier: so do outputs that passed a zero-phase filter "
        "which the inputs did not, or commands that were stamped late."
        if late
        else ""
    )
    return warn(
        "parameter_at_bound", name, f"{name} ended on a bound of the search; its value says no more than that.{why}"
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
    """What to say where a model was judged on nothing that it had not seen."""
    return warn(
        "not_verified",
        ", ".join(names),
        "Everything that was flown was fitted, so nothing is left to judge the model on. Give another log with "
        "--verify.",
    )
