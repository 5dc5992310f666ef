"""Leave out what the data do not show: a parameter that the cost does not miss, or one driven to zero by its bound."""

from __future__ import annotations

from dataclasses import dataclass

from rotorid.data.findings import Finding
from rotorid.fit.identify import fit
from rotorid.fit.problem import FrequencyProblem
from rotorid.fit.solution import Solution
from rotorid.models.parameter import Parameter

LARGEST_RISE = 2.0
"""A parameter is kept when leaving it out raises the mean cost by more than this (paper practice with CIFER)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Reduced:
    """A fit after what was not seen has been dropped.

    Parameters
    ----------
    problem, solution
        The reduced problem and its solution.
    findings
        Why each parameter was dropped.
    """

    problem: FrequencyProblem
    solution: Solution
    findings: tuple[Finding, ...]


def fit_and_drop(problem: FrequencyProblem) -> Reduced:
    """Fit, then drop optional parameters that the data do not show.

    An optional parameter goes when the mean cost without it rises by no more than 2; one that several inputs share is
    judged by all their responses together. Any parameter whose bound of zero holds it goes too: it would have crossed
    into values that the vehicle cannot have.

    Parameters
    ----------
    problem
        With all parameters free that the user left free.
    """
    best, solution = problem, fit(problem)
    findings: list[Finding] = []
    for name in problem.structure.optional:
        if name not in best.parameters.free or not _may_be_zero(best.parameters[name]):
            continue
        smaller = best.with_parameters(best.parameters.drop(name))
        trial = fit(smaller)
        rise = mean_cost(smaller, trial) - mean_cost(best, solution)
        if rise <= LARGEST_RISE:
            findings.append(_not_missed(best.parameters[name], rise, inputs=len(problem.structure.inputs)))
            best, solution = smaller, trial
    for name in best.parameters.free:
        value = dict(zip(best.parameters.free, solution.theta, strict=True)).get(name)
        bounds = (best.parameters[name].lower, best.parameters[name].upper)
        if value == 0.0 and value in bounds:
            best = best.with_parameters(best.parameters.drop(name))
            solution = fit(best)
            findings.append(_at_zero(name))
    return Reduced(problem=best, solution=solution, findings=tuple(findings))


def mean_cost(problem: FrequencyProblem, solution: Solution) -> float:
    """Cost of a solution per response that is used."""
    return solution.cost / max(int(problem.used.any(axis=-1).sum()), 1)


def _may_be_zero(parameter: Parameter) -> bool:
    return parameter.lower <= 0.0 <= parameter.upper


def _not_missed(parameter: Parameter, rise: float, *, inputs: int) -> Finding:
    # A lag that is not seen still delays; nothing else can take its place.
    absorbed = f" and its effect is part of the {'delay' if inputs == 1 else 'delays'}" if parameter.unit == "s" else ""
    return Finding(
        kind="dropped_parameter",
        severity="info",
        where=parameter.name,
        message=(
            f"The data do not show {parameter.name} beside the other parameters: leaving it out raises the cost by "
            f"only {max(rise, 0.0):.2f} (limit {LARGEST_RISE:g}), so it is set to zero{absorbed}."
        ),
        numbers={"cost_rise": rise, "limit": LARGEST_RISE},
    )


def _at_zero(name: str) -> Finding:
    return Finding(
        kind="dropped_parameter",
        severity="warning",
        where=name,
        message=(
            f"{name} was driven to its bound of zero and left out: the data would have it on the other side. "
            + (
                "A delay below zero means clocks that disagree, a filtered input, or a wrong channel."
                if name.startswith("tau_")
                else "The band reaches into speed modes or coupling that this structure leaves out, or is too narrow."
            )
        ),
    )
