"""What a careful engineer would remark on a fit."""

from __future__ import annotations

import numpy as np

from rotorid.data.findings import Finding
from rotorid.fit.frequency_cost import ACCEPTABLE_COST, EXCELLENT_COST
from rotorid.fit.problem import FrequencyProblem
from rotorid.fit.solution import Outcome, Solution
from rotorid.models.parameter import ParameterSet
from rotorid.models.rate import MOTOR_LAG
from rotorid.pipeline.measure import Measured
from rotorid.typing import BoolArray
from rotorid.uncertainty.bounds import CRAMER_RAO_GUIDELINE_PERCENT, INSENSITIVITY_GUIDELINE_PERCENT, Bounds

_EXCITED_SHARE = 0.7


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
    """The sum of motor lag and delay, which the data know better than either."""
    delays = [name for name in bounds.names if name.startswith("tau_")]
    if MOTOR_LAG not in bounds.names or len(delays) != 1:
        return ()
    pick = np.array([name in (MOTOR_LAG, delays[0]) for name in bounds.names], dtype=np.float64)
    total = parameters[MOTOR_LAG].value + parameters[delays[0]].value
    std = float(np.sqrt(pick @ bounds.covariance @ pick))
    return (
        Finding(
            kind="lag_plus_delay",
            severity="info",
            where=f"{MOTOR_LAG}, {delays[0]}",
            message=(
                f"Motor lag and delay together are {1e3 * total:.1f} ± {1e3 * std:.1f} ms; that sum is known better "
                "than its two parts."
            ),
            numbers={"sum_s": total, "std_s": std},
        ),
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
