"""What an identification would remark on a flight, before it is flown.

Too little usable data, parameters that the flight will not show or not separate, values that the estimate will miss by
more than chance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rotorid.data.findings import Finding, refusal, remark, warn
from rotorid.data.quantity import with_error
from rotorid.data.response import FrequencyResponse
from rotorid.data.trust import (
    CERTAIN_SIGN,
    CRAMER_RAO_GUIDELINE_PERCENT,
    FITTED_SHARE,
    INSENSITIVITY_GUIDELINE_PERCENT,
    LEAST_WIDTH,
    SMALL_ERROR,
)
from rotorid.errors import InsufficientDataError
from rotorid.fitting.frequency.problem import FrequencyProblem, pair_names
from rotorid.fitting.least_squares import Solution
from rotorid.models.parameter import ParameterSet
from rotorid.typing import BoolArray
from rotorid.uncertainty.cramer_rao import Bounds
from rotorid.uncertainty.identifiability import unseen_combinations

_BY_CHANCE = 2.0
"""Standard deviations within which an estimate misses a value by chance."""


def require_octave(response: FrequencyResponse, used: BoolArray, least_coherence: float) -> None:
    """Refuse a flight that leaves less than an octave to fit.

    Raises
    ------
    InsufficientDataError
        With the finding ``low_coherence``.
    """
    omega = response.omega_rad_s[used.any(axis=(0, 1))]
    if omega.size and omega[-1] >= LEAST_WIDTH * omega[0]:
        return
    names, best = ", ".join(pair_names(response)), float(response.coherence.max())
    low, high = (float(omega[0]), float(omega[-1])) if omega.size else (0.0, 0.0)
    message = f"Less than an octave of {names} will be usable; the coherence reaches at most {best:.2f}."
    raise InsufficientDataError(
        f"only {low:.3g} to {high:.3g} rad/s of the flight will be usable",
        needed=f"at least an octave with a coherence of {least_coherence:g} and {SMALL_ERROR}",
        remedy="fly a larger, longer or wider test input, or fly in calmer air",
        findings=[
            refusal(
                "low_coherence",
                names,
                message,
                best_coherence=best,
                limit=least_coherence,
                low_rad_s=low,
                high_rad_s=high,
            )
        ],
    )


def require_inside(parameters: ParameterSet, solution: Solution) -> None:
    """Refuse a forecast that ends on a bound, where a value is only a limit and has no standard deviation.

    Raises
    ------
    InsufficientDataError
        With the finding ``not_identifiable`` for each such parameter.
    """
    ended = [name for name, at_bound in zip(parameters.free, solution.at_bound, strict=False) if at_bound]
    if not ended:
        return
    values = parameters.unpack(solution.theta[: len(parameters.free)]).values
    names = ", ".join(f"{name} = {values[name]:.3g}" for name in ended)
    raise InsufficientDataError(
        f"the fit to the expected response ends at a bound: {names}",
        needed="a flight that determines all parameters",
        remedy="plan for a smaller model, or excite a wider band",
        findings=[
            refusal(
                "not_identifiable",
                name,
                f"{name} will end at the bound {values[name]:.3g} of its range, so its error is unknown.",
                value=float(values[name]),
            )
            for name in ended
        ],
    )


def remarks(
    problem: FrequencyProblem,
    solution: Solution,
    limits: Bounds,
    values: Mapping[str, float],
    band_rad_s: tuple[float, float],
    dropped: Sequence[str],
) -> tuple[Finding, ...]:
    """Remarks on coherence and parameters of a flight that is not flown yet.

    Parameters
    ----------
    problem, solution, limits
        The expected fit and its bounds.
    values
        Parameters as they were given.
    dropped
        Parameters that the fit would drop.
    """
    return (
        *_on_bands(problem, band_rad_s),
        *(_on_dropped(name) for name in dropped),
        *_on_parameters(solution, limits),
        *_on_gain(problem, solution, limits),
        *_on_biases(problem, solution, limits, values),
        *_on_combinations(problem, solution, limits),
    )


def _on_bands(problem: FrequencyProblem, band_rad_s: tuple[float, float]) -> tuple[Finding, ...]:
    data, (low, high) = problem.data, band_rad_s
    findings = []
    for y, u in np.ndindex(problem.used.shape[:2]):
        omega = data.omega_rad_s[problem.used[y, u]]
        if omega.size and np.log(omega[-1] / omega[0]) < FITTED_SHARE * np.log(high / low):
            findings.append(
                warn(
                    "low_coherence",
                    f"{data.outputs[y]}/{data.inputs[u]}",
                    f"Only {omega[0]:.2g} to {omega[-1]:.3g} rad/s of {data.outputs[y]}/{data.inputs[u]} will be "
                    "usable, "
                    f"of the planned {low:.2g} to {high:.3g} rad/s: outside, coherence is too low or windows are too "
                    "short.",
                    low_rad_s=float(omega[0]),
                    high_rad_s=float(omega[-1]),
                )
            )
    return tuple(findings)


def _on_dropped(name: str) -> Finding:
    return remark(
        "dropped_parameter",
        name,
        f"The flight cannot separate {name} from the other parameters; identify will drop it.",
    )


def _on_parameters(solution: Solution, limits: Bounds) -> tuple[Finding, ...]:
    """Parameters above CIFER's guidelines."""
    findings = []
    columns = (limits.names, solution.theta, limits.cramer_rao, limits.insensitivity)
    for name, value, cramer_rao, insensitivity in zip(*columns, strict=True):
        if value == 0.0:
            continue
        insensitivity_percent, known = 100.0 * insensitivity / abs(value), 100.0 * cramer_rao / abs(value)
        kind, percent, limit = "", 0.0, 0.0
        if insensitivity_percent > INSENSITIVITY_GUIDELINE_PERCENT:
            kind, percent, limit = "insensitive_parameter", insensitivity_percent, INSENSITIVITY_GUIDELINE_PERCENT
        elif known > CRAMER_RAO_GUIDELINE_PERCENT:
            kind, percent, limit = "uncertain_parameter", known, CRAMER_RAO_GUIDELINE_PERCENT
        if kind:
            what = "insensitivity" if kind == "insensitive_parameter" else "Cramér–Rao bound"
            findings.append(
                warn(
                    kind,
                    name,
                    f"{name} has little effect on this flight: {what} {percent:.0f} % (usual up to {limit:g} %). A "
                    "small error of the model can move it further than its expected error.",
                    **{f"{'insensitivity' if what == 'insensitivity' else 'cramer_rao'}_percent": percent},
                )
            )
    return tuple(findings)


def _on_gain(problem: FrequencyProblem, solution: Solution, limits: Bounds) -> tuple[Finding, ...]:
    """A gain whose sign stays uncertain."""
    gain = problem.structure.gain
    if gain not in limits.names:
        return ()
    row = limits.names.index(gain)
    value, std = float(solution.theta[row]), float(limits.std[row])
    if abs(value) >= CERTAIN_SIGN * std:
        return ()
    return (
        refusal(
            "not_identifiable",
            gain,
            f"{gain} will be too uncertain, even its sign: {with_error(value, std)}.",
            value=value,
            std=std,
        ),
    )


def _on_biases(
    problem: FrequencyProblem, solution: Solution, limits: Bounds, values: Mapping[str, float]
) -> tuple[Finding, ...]:
    """Parameters whose estimates will be biased."""
    findings = []
    for name, found, std in zip(limits.names, solution.theta, limits.std, strict=True):
        missed = float(found - values[name])
        if abs(missed) > _BY_CHANCE * std:
            cause = (
                "feedback biases a direct estimate"
                if problem.data.estimate == "direct"
                else "the model lacks a part of the loop, or windows are too short"
            )
            findings.append(
                warn(
                    "biased_parameter",
                    name,
                    f"{name} will be biased: about {found:.3g} instead of {values[name]:.3g} "
                    f"({abs(missed) / std:.1f} standard deviations), because {cause}.",
                    expected=float(found),
                    value=float(values[name]),
                    std=float(std),
                )
            )
    return tuple(findings)


def _on_combinations(problem: FrequencyProblem, solution: Solution, limits: Bounds) -> tuple[Finding, ...]:
    """Groups of parameters that the flight cannot separate."""
    return tuple(
        warn("not_identifiable", ", ".join(item.names or item.vector), item.words())
        for item in unseen_combinations(problem.parameters.unpack(solution.theta), limits)
        if item.flat
    )
