"""What a careful engineer would remark on a fit."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rotorid.data.channel import AXES
from rotorid.data.findings import Finding
from rotorid.fit.frequency_cost import ACCEPTABLE_COST, EXCELLENT_COST
from rotorid.fit.problem import FrequencyProblem
from rotorid.fit.solution import Outcome, Solution
from rotorid.models.parameter import ParameterSet
from rotorid.models.rate import MOTOR_LAG
from rotorid.pipeline.measure import Measured
from rotorid.typing import BoolArray
from rotorid.uncertainty.bounds import CRAMER_RAO_GUIDELINE_PERCENT, INSENSITIVITY_GUIDELINE_PERCENT, Bounds
from rotorid.uncertainty.identifiability import Combination

_EXCITED_SHARE = 0.7

_INPUT_DELAYS = tuple(f"tau_{axis}" for axis in AXES)
_KNOWN = 0.25
"""Lag and delay count as told apart when each is known to a quarter of itself."""

_LARGEST_CORRELATION = 0.95
_NOTHING = 1e9


def judge_parameters(parameters: ParameterSet, bounds: Bounds) -> tuple[Finding, ...]:
    """Parameters above CIFER's guidelines, and lag and delay that the data hardly tell apart."""
    findings = []
    for name, cramer_rao, insensitivity in zip(bounds.names, bounds.cramer_rao, bounds.insensitivity, strict=True):
        value = abs(parameters[name].value)
        if value == 0.0:
            continue
        percents = (100.0 * cramer_rao / value, 100.0 * insensitivity / value)
        if percents[1] > INSENSITIVITY_GUIDELINE_PERCENT:
            findings.append(
                Finding(
                    kind="insensitive_parameter",
                    severity="warning",
                    where=name,
                    message=(
                        f"The response hardly depends on {name}: its insensitivity is {percents[1]:.0f} % "
                        f"(guideline {INSENSITIVITY_GUIDELINE_PERCENT:g} %)."
                    ),
                    numbers={"insensitivity_percent": percents[1]},
                )
            )
        elif percents[0] > CRAMER_RAO_GUIDELINE_PERCENT:
            findings.append(
                Finding(
                    kind="uncertain_parameter",
                    severity="warning",
                    where=name,
                    message=(
                        f"{name} trades against other parameters: its Cramér–Rao bound is {percents[0]:.0f} % "
                        f"(guideline {CRAMER_RAO_GUIDELINE_PERCENT:g} %)."
                    ),
                    numbers={"cramer_rao_percent": percents[0]},
                )
            )
    return (*findings, *_lag_and_delay(parameters, bounds))


def _lag_and_delay(parameters: ParameterSet, bounds: Bounds) -> tuple[Finding, ...]:
    """Whether the data tell motor lag and delay apart, and their sum, which they know better than either."""
    delays = [name for name in bounds.names if name in _INPUT_DELAYS]
    if MOTOR_LAG not in bounds.names or not delays:
        return ()
    return tuple(_one_lag_and_delay(parameters, bounds, name) for name in delays)


def _one_lag_and_delay(parameters: ParameterSet, bounds: Bounds, delay: str) -> Finding:
    rows = [bounds.names.index(name) for name in (MOTOR_LAG, delay)]
    values = [parameters[name].value for name in (MOTOR_LAG, delay)]
    block = bounds.covariance[np.ix_(rows, rows)]
    lag_std, delay_std = (math.sqrt(block[row, row]) for row in range(2))
    together, std = sum(values), math.sqrt(max(float(block.sum()), 0.0))
    correlation = float(bounds.correlation[rows[0], rows[1]])
    known = lag_std <= _KNOWN * abs(values[0]) and delay_std <= _KNOWN * abs(values[1])
    apart = known and abs(correlation) <= _LARGEST_CORRELATION
    each = f"{1e3 * values[0]:.1f} ± {1e3 * lag_std:.1f} ms and {1e3 * values[1]:.1f} ± {1e3 * delay_std:.1f} ms"
    total = f"{1e3 * together:.1f} ± {1e3 * std:.1f} ms"
    message = (
        f"Motor lag and delay are told apart, as {each} with a correlation of {correlation:.2f}; together they are "
        f"{total}, which is known better than either."
        if apart
        else f"Motor lag and delay are hardly told apart: {each} with a correlation of {correlation:.2f}. Trust their "
        f"sum of {total}. A wider band would separate them, or the lag from a bench or from measured motor speeds "
        f"(--fix {MOTOR_LAG}=VALUE)."
    )
    return Finding(
        kind="lag_plus_delay" if apart else "not_identifiable",
        severity="info" if apart else "warning",
        where=f"{MOTOR_LAG}, {delay}",
        message=message,
        numbers={"sum_s": together, "std_s": std, "correlation": correlation},
    )


def judge_combinations(combinations: Sequence[Combination]) -> tuple[Finding, ...]:
    """A warning for each group of parameters that the data do not tell apart at all."""
    return tuple(
        Finding(
            kind="not_identifiable",
            severity="warning",
            where=", ".join(item.names or item.vector),
            message=item.words(),
            numbers={"relative_std": min(item.relative_std, _NOTHING)},
        )
        for item in combinations
        if item.flat
    )


def judge_fit(problem: FrequencyProblem, solution: Solution, mean_cost: float) -> tuple[Finding, ...]:
    """How well the structure follows the data, and how the solver ended."""
    findings = []
    if mean_cost > EXCELLENT_COST:
        acceptable = mean_cost <= ACCEPTABLE_COST
        findings.append(
            Finding(
                kind="poor_fit",
                severity="info" if acceptable else "warning",
                where=problem.structure.name,
                message=(
                    f"The average cost is {mean_cost:.0f}: "
                    + (
                        f"acceptable, but above the {EXCELLENT_COST:g} of a model hardly to be told from the flight."
                        if acceptable
                        else f"above the {ACCEPTABLE_COST:g} of an acceptable model. Narrow the band, or take a "
                        "structure with the missing dynamics."
                    )
                ),
                numbers={"average_cost": mean_cost},
            )
        )
    for name, at_bound in zip(problem.parameters.free, solution.at_bound, strict=True):
        if at_bound:
            findings.append(
                Finding(
                    kind="parameter_at_bound",
                    severity="warning",
                    where=name,
                    message=f"{name} ended on a bound of the search; its value says no more than that.",
                )
            )
    if solution.outcome is not Outcome.CONVERGED:
        findings.append(
            Finding(
                kind="not_converged", severity="warning", where=problem.structure.name, message=solution.outcome.value
            )
        )
    return tuple(findings)


def _what_ends(measured: Measured, top: float) -> str:
    """Why the fitted band ends where it does."""
    if measured.excited_to_rad_s < measured.asked_rad_s[1] and top > 0.9 * measured.trusted_rad_s[1]:
        return f"the sweeps end at {measured.excited_to_rad_s:.3g} rad/s"
    return "the rest is not coherent enough, or its error is above 30 %"


def judge_band(measured: Measured, used: BoolArray) -> tuple[Finding, ...]:
    """How much of the band that was asked for could be used."""
    data = measured.response
    findings = []
    for y, u in np.ndindex(used.shape[:2]):
        omega = data.omega_rad_s[used[y, u]]
        if not omega.size:
            continue
        share = np.log(omega[-1] / omega[0]) / np.log(measured.asked_rad_s[1] / measured.asked_rad_s[0])
        if share < _EXCITED_SHARE:
            low, high = measured.asked_rad_s
            findings.append(
                Finding(
                    kind="low_coherence",
                    severity="warning",
                    where=f"{data.outputs[y]}/{data.inputs[u]}",
                    message=(
                        f"Of the band {low:.2g} to {high:.3g} rad/s only {omega[0]:.2g} to {omega[-1]:.3g} rad/s could "
                        f"be fitted; {_what_ends(measured, float(omega[-1]))}."
                    ),
                    numbers={"low_rad_s": float(omega[0]), "high_rad_s": float(omega[-1])},
                )
            )
    return tuple(findings)
