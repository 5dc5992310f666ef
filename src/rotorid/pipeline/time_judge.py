"""What a careful engineer would remark on a time-domain fit."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from rotorid.data.findings import Finding
from rotorid.fit.solution import Outcome, Solution
from rotorid.models.structure import LinearStructure
from rotorid.pipeline.fitting import Fitted
from rotorid.pipeline.judge import judge_parameters
from rotorid.pipeline.resolve import black_box_order
from rotorid.pipeline.time_fit import TimeFitted, growth
from rotorid.pipeline.time_records import TimeRecords
from rotorid.verify.scores import GOOD_FIT_PERCENT

_APART = 3.0
"""Combined standard deviations beyond which two methods disagree."""

_COLORED = 1.2
_SETTLED = 1e-6


class Compared(NamedTuple):
    """One parameter in the frequency domain, and what of the difference the hold of the inputs explains."""

    value: float
    std: float | None
    hold_s: float = 0.0


def judge_time_fit(fitted: TimeFitted, records: TimeRecords, fit_percent: Mapping[str, float]) -> tuple[Finding, ...]:
    """Remarks on the fit, its residuals and its parameters; those of a black box mean nothing one by one."""
    black_box = black_box_order(fitted.problem.structure) is not None
    return (
        *fitted.findings,
        *_pieces(fitted),
        *_poor(fit_percent, fitted),
        *_colored(fitted, records),
        *_solver(fitted),
        *(() if black_box else judge_parameters(fitted.parameters, fitted.bounds)),
    )


def _pieces(fitted: TimeFitted) -> list[Finding]:
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
        Finding(
            kind="fitted_in_pieces",
            severity="info",
            where=fitted.problem.structure.name,
            message=(
                f"{why} The records were fitted {cut}; fits in percent are those of the pieces."
                if fitted.method == "output_error"
                else f"{why} The fit takes the records whole; to show it they were simulated {cut}."
            ),
            numbers={
                "pieces": float(count),
                "length_s": fitted.pieces_s,
                "growth_1_s": rate,
            },
        )
    ]


def _poor(fit_percent: Mapping[str, float], fitted: TimeFitted) -> list[Finding]:
    simulated = fitted.method == "output_error"
    why = (
        "Dynamics are missing, or other things than the inputs move it."
        if simulated
        else "The fit looks at each sample by itself; in a simulation gusts add up, and so does what is missing."
    )
    return [
        Finding(
            kind="poor_fit",
            severity="warning" if simulated else "info",
            where=name,
            message=(
                f"Simulated, the model explains {percent:.0f} % of {name} in the records it was fitted to (good: "
                f"{GOOD_FIT_PERCENT:g} % and more). {why}"
            ),
            numbers={"fit_percent": percent},
        )
        for name, percent in fit_percent.items()
        if percent < GOOD_FIT_PERCENT
    ]


def _colored(fitted: TimeFitted, records: TimeRecords) -> list[Finding]:
    factor = fitted.bounds.inflation
    if factor < _COLORED:
        return []
    memory_s = fitted.memory / records.data[0].sample_rate_hz
    color = (
        f"Residuals remember their past over some {fitted.memory} samples ({memory_s:.2g} s), as in every real flight."
        if fitted.memory
        else "Errors of the equations are not white, as in every real flight."
    )
    return [
        Finding(
            kind="colored_residuals",
            severity="info",
            where=fitted.problem.structure.name,
            message=(
                f"{color} Standard deviations count that: they are {factor:.2g} times as large as for white residuals."
            ),
            numbers={"factor": factor, "memory": float(fitted.memory)},
        )
    ]


def _solver(fitted: TimeFitted) -> list[Finding]:
    solution, structure = fitted.solution, fitted.problem.structure
    delays = {str(entry) for entry in structure.input_delays}
    findings = [
        _at_bound(name, late=name in delays and fitted.parameters[name].value == 0.0)
        for name, at_bound in zip(fitted.parameters.free, solution.at_bound, strict=False)
        if at_bound
    ]
    if solution.outcome is not Outcome.CONVERGED and left_to_gain(solution) > _SETTLED:
        findings.append(
            Finding(kind="not_converged", severity="warning", where=structure.name, message=solution.outcome.value)
        )
    return findings


def _at_bound(name: str, *, late: bool) -> Finding:
    why = (
        " The outputs answer no later than they are asked, or earlier: so do outputs that passed a zero-phase filter "
        "which the inputs did not, or commands that were stamped late."
        if late
        else ""
    )
    return Finding(
        kind="parameter_at_bound",
        severity="warning",
        where=name,
        message=f"{name} ended on a bound of the search; its value says no more than that.{why}",
    )


def left_to_gain(solution: Solution) -> float:
    """Share of the sum of squares that one more step promises; bounds are respected."""
    inner = ~np.array(solution.at_bound, dtype=np.bool_)
    if not inner.any() or solution.cost <= 0.0:
        return 0.0
    J = solution.jacobian[:, inner]
    step = np.linalg.lstsq(J, solution.residual, rcond=None)[0]
    return float(np.sum((J @ step) ** 2)) / solution.cost


def compare_with(
    frequency: Fitted, structure: LinearStructure, fitted: TimeFitted, records: TimeRecords
) -> dict[str, Compared]:
    """Parameters of the frequency-domain fit that the time-domain fit has too.

    A response between samples contains the hold of the inputs, half a step of delay, which a simulation with held
    inputs has apart. That much of a delay is no disagreement.
    """
    half_s = 0.5 / records.data[0].sample_rate_hz if records.hold == "zero" else 0.0
    delays = {str(entry) for entry in structure.input_delays}
    std = dict(zip(frequency.bounds.names, map(float, frequency.bounds.std), strict=True))
    return {
        parameter.name: Compared(parameter.value, std.get(parameter.name), half_s * (parameter.name in delays))
        for parameter in frequency.parameters
        if parameter.name in fitted.parameters.names and parameter.status != "dropped"
    }


def judge_agreement(fitted: TimeFitted, others: Mapping[str, Compared]) -> tuple[Finding, ...]:
    """A warning for each parameter that time and frequency domain know, and know differently."""
    std = dict(zip(fitted.bounds.names, map(float, fitted.bounds.std), strict=True))
    findings = []
    for name, other in others.items():
        if name not in std or other.std is None:
            continue
        value, combined = fitted.parameters[name].value, math.hypot(std[name], other.std)
        distance = abs(value + other.hold_s - other.value) / combined if combined > 0.0 else 0.0
        if distance > _APART:
            unit = fitted.parameters[name].unit
            held = (
                f" Of that, {1e3 * other.hold_s:.3g} ms are the hold of the input, which the response contains."
                if other.hold_s
                else ""
            )
            findings.append(
                Finding(
                    kind="methods_disagree",
                    severity="warning",
                    where=name,
                    message=(
                        f"{name} is {value:.4g} ± {std[name]:.2g} {unit} in the time domain and {other.value:.4g} ± "
                        f"{other.std:.2g} {unit} in the frequency domain, {distance:.1f} standard deviations apart."
                        f"{held} They weigh what the structure leaves out differently, or feedback biases one of them."
                    ),
                    numbers={
                        "time": value,
                        "frequency": other.value,
                        "distance_std": distance,
                        "hold_s": other.hold_s,
                    },
                )
            )
    return tuple(findings)


def nothing_unseen(names: Sequence[str]) -> Finding:
    """What to say where a model was judged on nothing that it had not seen."""
    return Finding(
        kind="not_verified",
        severity="warning",
        where=", ".join(names),
        message=(
            "Everything that was flown was fitted, so nothing is left to judge the model on. Give another log with "
            "--verify."
        ),
    )
