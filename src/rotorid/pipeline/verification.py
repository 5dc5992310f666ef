"""Verification on maneuvers that the fit has not seen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.data.findings import Finding
from rotorid.errors import InsufficientDataError
from rotorid.fit.frequency_cost import pair_costs, point_weights
from rotorid.fit.problem import FrequencyProblem, usable_points
from rotorid.models.parameter import ParameterSet
from rotorid.models.state_space import StateSpace
from rotorid.pipeline.measure import Measured, measure
from rotorid.pipeline.selection import Flown, cut
from rotorid.pipeline.settings import IdentifySettings
from rotorid.reduce.elimination import fit_and_drop
from rotorid.verify.scores import GOOD_TIC
from rotorid.verify.time_domain import verify_in_time
from rotorid.verify.verification import Verification

_REST_S = 0.5
_SHORTEST_S = 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Checked:
    """What verification found.

    Parameters
    ----------
    verifications
        Unseen maneuvers in the time domain.
    frequency
        Cost of the model against responses of unseen sweeps, by record and response.
    findings
        Remarks.
    """

    verifications: tuple[Verification, ...] = ()
    frequency: dict[str, float] | None = None
    findings: tuple[Finding, ...] = ()


def verify_unseen(
    system: StateSpace,
    short: Sequence[Flown],
    *,
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    band_rad_s: tuple[float, float],
    progress: Callable[[str], None],
) -> Checked:
    """Predict doublets and other short maneuvers with a frozen model."""
    segments, findings = cut(short, channels=(*inputs, *outputs), rest_s=_REST_S, progress=progress)
    checks = tuple(
        verify_in_time(
            system,
            segment.history,
            inputs=inputs,
            outputs=outputs,
            band_rad_s=band_rad_s,
            record=segment.record,
            maneuver=segment.maneuver,
        )
        for segment in segments
        if segment.history.duration_s >= _SHORTEST_S
    )
    return Checked(verifications=checks, findings=(*findings, *(f for check in checks for f in _poor(check))))


def cost_on_sweeps(
    problem: FrequencyProblem,
    parameters: ParameterSet,
    sweeps: Sequence[Flown],
    settings: IdentifySettings,
    band_rad_s: tuple[float, float],
) -> dict[str, float]:
    """Cost of a frozen model against the responses of sweeps that were not fitted, in the fitted band."""
    structure = problem.structure
    measured = measure(sweeps, inputs=structure.inputs, outputs=structure.outputs, settings=settings)
    return _costs(structure.response(parameters.values, measured.response.omega_rad_s), measured, settings, band_rad_s)


def hold_out(
    problem: FrequencyProblem,
    flown: Sequence[Flown],
    settings: IdentifySettings,
    band_rad_s: tuple[float, float],
    progress: Callable[[str], None],
) -> Checked:
    """Where all that was flown was fitted: fit again without the last maneuver, and judge that model on it."""
    if len(flown) < 2:
        return Checked(findings=(_not_verified(),))
    progress("holding out the last maneuver")
    structure = problem.structure
    inputs, outputs = structure.inputs, structure.outputs
    rest, last = flown[:-1], flown[-1:]
    try:
        measured = measure(rest, inputs=inputs, outputs=outputs, settings=settings)
        used = usable_points(measured.response, coherence=_limit(measured, settings), band_rad_s=band_rad_s)
        if not used.any():
            return Checked(findings=(_not_verified(),))
        smaller = FrequencyProblem(
            structure=structure, parameters=problem.parameters, data=measured.response, used=used
        )
        reduced = fit_and_drop(smaller)
        parameters = reduced.problem.parameters.unpack(reduced.solution.theta)
        costs = cost_on_sweeps(problem, parameters, last, settings, band_rad_s)
    except InsufficientDataError:
        # One maneuver alone may be too short for the band of all together; then nothing was left unseen.
        return Checked(findings=(_not_verified(),))
    name = f"{last[0][0].source.name} at {last[0][1].start_s:.1f} s"
    return Checked(
        frequency={f"{name}: {pair}": cost for pair, cost in costs.items()},
        findings=(_held_out(name, costs),),
    )


def _costs(
    model: np.ndarray, measured: Measured, settings: IdentifySettings, band_rad_s: tuple[float, float]
) -> dict[str, float]:
    data = measured.response
    used = usable_points(data, coherence=_limit(measured, settings), band_rad_s=band_rad_s)
    costs = pair_costs(model, data.values, point_weights(data, used))
    return {
        f"{output}/{input}": float(costs[y, u])
        for y, output in enumerate(data.outputs)
        for u, input in enumerate(data.inputs)
        if used[y, u].any()
    }


def _limit(measured: Measured, settings: IdentifySettings) -> float:
    return settings.least_coherence(joint=measured.response.estimate == "joint")


def _poor(check: Verification) -> list[Finding]:
    where = f"{check.record} at {check.maneuver.start_s:.1f} s"
    return [
        Finding(
            kind="poor_verification",
            severity="warning",
            where=where,
            message=(
                f"{name} of the {check.maneuver.kind} at {check.maneuver.start_s:.1f} s is predicted with a Theil "
                f"coefficient of {scores.tic:.2f} (good: up to {GOOD_TIC:g})."
            ),
            numbers={"tic": scores.tic, "nrmse_fit_percent": scores.nrmse_fit_percent},
        )
        for name, scores in check.scores.items()
        if scores.tic > GOOD_TIC
    ]


def _not_verified() -> Finding:
    return Finding(
        kind="not_verified",
        severity="warning",
        where="verification",
        message=(
            "Everything that was flown was fitted, so nothing is left to judge the model on. Fly doublets, or give "
            "another log with --verify."
        ),
    )


def _held_out(name: str, costs: dict[str, float]) -> Finding:
    worst = max(costs.values(), default=float("nan"))
    return Finding(
        kind="held_out",
        severity="info",
        where=name,
        message=(
            f"No doublets are in the log. A model fitted without the maneuver of {name} predicts its response with a "
            f"cost of {worst:.1f}; the model of this result was then fitted to all maneuvers."
        ),
        numbers={"cost": worst},
    )
