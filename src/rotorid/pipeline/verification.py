"""Verification on maneuvers that the fit has not seen."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from rotorid.data.findings import Finding
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.fit.frequency_cost import ACCEPTABLE_COST, pair_costs, point_weights
from rotorid.fit.problem import usable_points
from rotorid.models.parameter import ParameterSet
from rotorid.pipeline.fitting import Fitted
from rotorid.pipeline.measure import Measured, measure
from rotorid.pipeline.selection import RICH_KINDS, Flown, Selection, axis_of, cut, other_sources
from rotorid.pipeline.settings import IdentifySettings
from rotorid.reduce.elimination import fit_and_drop
from rotorid.signal.segment import find_excitations
from rotorid.typing import BoolArray
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
    frequency: Mapping[str, float] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()


def check(
    fitted: Fitted,
    measured: Measured,
    selection: Selection,
    verify: Sequence[FlightRecord],
    settings: IdentifySettings,
    progress: Callable[[str], None],
) -> Checked:
    """Judge a fitted model on whatever it has not seen.

    Short maneuvers of the same logs and of further ones are predicted in the time domain, sweeps of further ones in
    the frequency domain. Where nothing is left over, the last fitted maneuver is held out of a second fit.
    """
    axes = [axis_of(name) for name in fitted.structure.inputs]
    flown = [(record, m) for record in verify for axis in axes for m in find_excitations(record, axis)]
    others = [(record, m) for record, m in flown if not selection.fits(record, m)]
    short = [*selection.unseen, *((record, m) for record, m in others if m.kind not in RICH_KINDS)]
    sweeps = [(record, m) for record, m in others if m.kind in RICH_KINDS]
    if not short and not sweeps:
        return (
            Checked(findings=(_nothing_to_verify(verify, axes),))
            if verify
            else _hold_out(fitted, selection.fitted, settings, progress)
        )
    predicted = _predict(fitted, measured, short, progress) if short else Checked()
    costs = _cost_on(fitted, fitted.parameters, sweeps, settings) if sweeps else {}
    return replace(predicted, frequency=costs)


def _predict(fitted: Fitted, measured: Measured, short: Sequence[Flown], progress: Callable[[str], None]) -> Checked:
    inputs, outputs = fitted.structure.inputs, fitted.structure.outputs
    segments, findings = cut(short, channels=(*inputs, *outputs), rest_s=_REST_S, progress=progress)
    checks = tuple(
        verify_in_time(
            fitted.system,
            segment.history,
            inputs=inputs,
            outputs=outputs,
            band_rad_s=fitted.band_rad_s,
            record=segment.record,
            maneuver=segment.maneuver,
        )
        for segment in segments
        if segment.history.duration_s >= _SHORTEST_S
    )
    remarks = (*findings, *other_sources(measured.segments, segments, outputs), *(f for c in checks for f in _poor(c)))
    return Checked(verifications=checks, findings=remarks)


def _hold_out(
    fitted: Fitted, flown: Sequence[Flown], settings: IdentifySettings, progress: Callable[[str], None]
) -> Checked:
    """Where all that was flown was fitted: fit again without the last maneuver, and judge that model on it."""
    if len(flown) < 2:
        return Checked(findings=(_not_verified(),))
    progress("holding out the last maneuver")
    rest, last = flown[:-1], flown[-1:]
    structure = fitted.structure
    try:
        measured = measure(rest, inputs=structure.inputs, outputs=structure.outputs, settings=settings)
        used = _usable(measured, settings, fitted.band_rad_s)
        smaller = replace(fitted.problem, data=measured.response, used=used)
        reduced = fit_and_drop(smaller)
        parameters = reduced.problem.parameters.unpack(reduced.solution.theta)
        costs = _cost_on(fitted, parameters, last, settings)
    except InsufficientDataError:
        # One maneuver alone may be too short for the band of all together; then nothing was left unseen.
        return Checked(findings=(_not_verified(),))
    name = f"{last[0][0].source.name} at {last[0][1].start_s:.1f} s"
    return Checked(frequency=costs, findings=(_held_out(name, costs),))


def _cost_on(
    fitted: Fitted, parameters: ParameterSet, sweeps: Sequence[Flown], settings: IdentifySettings
) -> dict[str, float]:
    """Cost of a frozen model against the responses of sweeps that were not fitted, in the fitted band."""
    structure = fitted.structure
    measured = measure(sweeps, inputs=structure.inputs, outputs=structure.outputs, settings=settings)
    data, used = measured.response, _usable(measured, settings, fitted.band_rad_s)
    model = structure.response(parameters.values, data.omega_rad_s)
    costs = pair_costs(model, data.values, point_weights(data, used))
    return {
        f"{output}/{input}": float(costs[y, u])
        for y, output in enumerate(data.outputs)
        for u, input in enumerate(data.inputs)
        if used[y, u].any()
    }


def _usable(measured: Measured, settings: IdentifySettings, band_rad_s: tuple[float, float]) -> BoolArray:
    limit = settings.least_coherence(joint=measured.response.estimate == "joint")
    return usable_points(measured.response, coherence=limit, band_rad_s=band_rad_s)


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
    poor = worst > ACCEPTABLE_COST
    return Finding(
        kind="poor_verification" if poor else "held_out",
        severity="warning" if poor else "info",
        where=name,
        message=(
            f"No doublets are in the log. A model fitted without the maneuver of {name} predicts its response with a "
            f"cost of {worst:.1f}"
            + (f", above the {ACCEPTABLE_COST:g} of an acceptable model" if poor else "")
            + "; the model of this result was then fitted to all maneuvers."
        ),
        numbers={"cost": worst},
    )


def _nothing_to_verify(verify: Sequence[FlightRecord], axes: Sequence[str]) -> Finding:
    names = ", ".join(record.source.name for record in verify)
    return Finding(
        kind="not_verified",
        severity="warning",
        where=names,
        message=(
            f"{names} holds no excitation of {' or '.join(axes)} beyond what was fitted, so the model was not verified "
            "on it."
        ),
    )
