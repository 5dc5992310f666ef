"""What a careful engineer would remark on a fit."""

from __future__ import annotations

import numpy as np

from rotorid.data.findings import Finding
from rotorid.errors import InsufficientDataError
from rotorid.fit.frequency_cost import ACCEPTABLE_COST, EXCELLENT_COST
from rotorid.fit.problem import FrequencyProblem
from rotorid.fit.solution import Outcome, Solution
from rotorid.models.parameter import ParameterSet
from rotorid.models.rate import MOTOR_LAG
from rotorid.pipeline.measure import Measured
from rotorid.typing import BoolArray
from rotorid.uncertainty.bounds import CRAMER_RAO_GUIDELINE_PERCENT, INSENSITIVITY_GUIDELINE_PERCENT, Bounds

LOWEST_TOP_RAD_S = 8.0
"""A rate model is not identified from data that end below: there the speed modes of the airframe rule."""

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


def require_known_gain(gain: str | None, parameters: ParameterSet, bounds: Bounds) -> None:
    """Refuse a model whose gain could as well have the other sign.

    Raises
    ------
    InsufficientDataError
        The gain lies within two standard deviations of zero.
    """
    if gain not in bounds.names:
        return
    value, std = parameters[gain].value, float(bounds.std[bounds.names.index(gain)])
    if abs(value) >= 2.0 * std:
        return
    found = f"{value:.2g} ± {std:.1g} {parameters[gain].unit}"
    raise InsufficientDataError(
        f"the data do not show {gain}: {found}",
        needed="a gain that differs from zero by two standard deviations",
        remedy="give longer segments or a wider band, or excite the axis harder",
        findings=[
            Finding(
                kind="not_identifiable",
                severity="error",
                where=gain,
                message=f"Not even the sign of {gain} is certain: the fit gives {found}.",
                numbers={"value": value, "std": std},
            )
        ],
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
    if solution.outcome is not Outcome.CONVERGED:
        findings.append(
            Finding(
                kind="not_converged", severity="warning", where=problem.structure.name, message=solution.outcome.value
            )
        )
    return tuple(findings)


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
                        f"Of the band {low:.2g} to {high:.3g} rad/s only {omega[0]:.2g} to {omega[-1]:.3g} rad/s is "
                        "coherent enough to be fitted."
                    ),
                    numbers={"low_rad_s": float(omega[0]), "high_rad_s": float(omega[-1])},
                )
            )
    return tuple(findings)


def require_usable(measured: Measured, used: BoolArray, *, rate_model: bool) -> None:
    """Refuse a fit where the data end below what the model needs.

    Raises
    ------
    InsufficientDataError
        No point is usable, or a rate model would be fitted to speed modes alone.
    """
    data = measured.response
    name = f"{data.outputs[0]}/{data.inputs[0]}"
    top = min(measured.excited_to_rad_s, float(data.omega_rad_s[-1]))
    usable_top = float(data.omega_rad_s[used.any(axis=(0, 1))][-1]) if used.any() else 0.0
    if used.any() and not (rate_model and usable_top < LOWEST_TOP_RAD_S):
        return
    low, high = measured.asked_rad_s
    if top < max(low, LOWEST_TOP_RAD_S):
        message = (
            f"There is no excitation above {top:.2g} rad/s in {name}; what is coherent above is feedback and noise."
        )
        raise InsufficientDataError(
            f"no excitation above {top:.2g} rad/s came for {name}",
            needed=f"excitation that goes on to {max(low, LOWEST_TOP_RAD_S if rate_model else 0.0):.3g} rad/s and more",
            remedy="fly a sweep that goes faster",
            findings=[
                Finding(
                    kind="no_excitation",
                    severity="error",
                    where=name,
                    message=message,
                    numbers={"highest_rad_s": top, "low_rad_s": low, "high_rad_s": high},
                )
            ],
        )
    best = float(data.coherence.max())
    raise InsufficientDataError(
        f"the coherence of {name} reaches {best:.4g} at most inside {low:.3g} to {high:.3g} rad/s",
        needed="points above the limit of coherence with an error below 30 %",
        remedy="excite the axis harder or longer, or fly in calmer air",
        findings=[
            Finding(
                kind="low_coherence",
                severity="error",
                where=name,
                message=f"No usable stretch of {name}: the coherence reaches {best:.4g} at most.",
                numbers={"best_coherence": best},
            )
        ],
    )
