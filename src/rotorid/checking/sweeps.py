"""Unseen sweeps compared in the frequency domain, and one left out of a second fit.

What was fitted flatters a model. Where all that was flown was fitted, a second model is fitted without one maneuver and
compared with it.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rotorid.data.findings import Finding, remark, warn
from rotorid.data.record import Maneuver
from rotorid.data.response import FrequencyResponse
from rotorid.data.trust import ACCEPTABLE_COST
from rotorid.errors import InsufficientDataError
from rotorid.fits.frequency.fit import fitted_band
from rotorid.fits.frequency.inverse import pose_screened
from rotorid.fitting.frequency.problem import pair_costs, point_weights, usable_points
from rotorid.flights.flights import Flight
from rotorid.flights.instruments import axis_of, is_command
from rotorid.flights.measure import Measured, measure
from rotorid.flights.segments import holds
from rotorid.models.families import family_of
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.reduction.guided import fit_and_drop
from rotorid.results.model import FrequencyCheck
from rotorid.results.summary import PairCost
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.measuring import MeasureSettings
from rotorid.spectral.derived import selected
from rotorid.typing import BoolArray, ComplexArray

_PROGRESS = logging.getLogger("rotorid.progress")


def check_sweeps(
    structure: LinearStructure,
    parameters: ParameterSet,
    sweeps: Sequence[Flight],
    *,
    band_rad_s: tuple[float, float],
    settings: MeasureSettings,
) -> FrequencyCheck:
    r"""Cost of a frozen model against the responses of sweeps that were not fitted.

    Judged are the responses to inputs that were swept, where the model was fitted and where the sweeps of each input
    excite: above their end there is coherence too, of noise that the controller fed back. What the controller does
    meanwhile with the other inputs :math:`v` was measured too, and the model is given it,

    .. math:: H_{yu} + H_{yv} \, (v/u)

    A response without usable points, such as that of an output that does not follow, is left out and not judged.

    Parameters
    ----------
    sweeps
        What it has not seen.
    band_rad_s
        The fitted band.

    Raises
    ------
    InsufficientDataError
        A channel is missing, the sweeps are too short, or no point of them is usable in the fitted band.
    """
    swept = _swept(structure.inputs, sweeps)
    others = tuple(name for name in structure.inputs if name not in swept and _moves(name, sweeps))
    measured = measure(
        sweeps,
        inputs=swept,
        outputs=(*structure.outputs, *others),
        settings=_of_inputs(settings, structure.inputs, swept),
    )
    data = _of_outputs(measured.response, len(structure.outputs))
    limit = settings.least_coherence(joint=data.estimate == "joint")
    model = _model(structure, parameters, measured.response)
    # The decibels of a response that the model does not have, such as one whose parameters were dropped, judge nothing.
    used = _used(measured, data, band_rad_s, limit) & np.any(model != 0.0, axis=-1, keepdims=True)
    if not used.any():
        raise _nothing_usable(band_rad_s, measured.trusted_rad_s, limit)
    costs = pair_costs(model, data.values, point_weights(data, used))
    pairs = {}
    for y, u in np.ndindex(used.shape[:2]):
        omega = data.omega_rad_s[used[y, u]]
        if omega.size:
            band = (float(omega[0]), float(omega[-1]))
            pairs[f"{data.outputs[y]}/{data.inputs[u]}"] = PairCost(
                value=float(costs[y, u]), band_rad_s=band, points=omega.size
            )
    records = tuple(dict.fromkeys(sweep.record.source.name for sweep in sweeps))
    return FrequencyCheck(
        pairs=pairs,
        findings=(*measured.findings, *_poor(records, pairs)),
        records=records,
        response=data,
        model_response=model,
        used=used,
    )


def _swept(inputs: Sequence[str], sweeps: Sequence[Flight]) -> tuple[str, ...]:
    """Inputs of a model that sweeps excite; one that is no command may be moved by any."""
    axes = {sweep.axis for sweep in sweeps}
    return tuple(name for name in inputs if not is_command(name) or axis_of(name) in axes)


def _moves(name: str, sweeps: Sequence[Flight]) -> bool:
    """Whether a channel is anything but constant in the logs of some sweeps."""
    return any(np.ptp(topic.values[row]) > 0.0 for sweep in sweeps for topic, row in sweep.record.holding(name))


def _of_inputs(settings: MeasureSettings, inputs: Sequence[str], swept: Sequence[str]) -> MeasureSettings:
    """The choices of a run for some of its inputs: of instruments that were given, theirs."""
    if len(settings.instruments) != len(inputs):
        return settings
    given = dict(zip(inputs, settings.instruments, strict=True))
    return replace(settings, instruments=tuple(given[name] for name in swept))


def _of_outputs(data: FrequencyResponse, count: int) -> FrequencyResponse:
    """The responses of the first outputs only."""
    return data if len(data.outputs) == count else selected(data, outputs=data.outputs[:count])


def _model(structure: LinearStructure, parameters: ParameterSet, data: FrequencyResponse) -> ComplexArray:
    """The model with the other inputs, whose responses follow those of its outputs in ``data``."""
    whole = structure.response(parameters.values, data.omega_rad_s)
    count = len(structure.outputs)
    swept = [structure.inputs.index(name) for name in data.inputs]
    others = [structure.inputs.index(name) for name in data.outputs[count:]]
    # Records that lack an input show nothing of it.
    moved = np.nan_to_num(data.values[count:])
    return np.asarray(whole[:, swept] + np.einsum("yvf,vuf->yuf", whole[:, others], moved))


def _used(measured: Measured, data: FrequencyResponse, fitted_rad_s: tuple[float, float], limit: float) -> BoolArray:
    """Points in the fitted band, each input within the band of its own sweeps, shape ``(y, u, f)``."""
    trusted = measured.trusted_rad_s
    used = np.zeros(data.values.shape, dtype=np.bool_)
    reached = np.asarray(measured.trusted_points(data, limit).any(axis=0))
    for u in range(len(data.inputs)):
        tops = data.omega_rad_s[reached[u]]
        if tops.size:
            band = max(fitted_rad_s[0], trusted[0]), min(fitted_rad_s[1], float(tops[-1]))
            used[:, u] = usable_points(data, coherence=limit, band_rad_s=band)[:, u]
    return used


def _nothing_usable(
    fitted_rad_s: tuple[float, float], trusted_rad_s: tuple[float, float], least_coherence: float
) -> InsufficientDataError:
    band = f"the fitted band of {fitted_rad_s[0]:.3g} to {fitted_rad_s[1]:.3g} rad/s"
    disjoint = trusted_rad_s[1] <= fitted_rad_s[0] or trusted_rad_s[0] >= fitted_rad_s[1]
    return InsufficientDataError(
        f"its sweeps, usable from {trusted_rad_s[0]:.3g} to {trusted_rad_s[1]:.3g} rad/s, do not reach {band}"
        if disjoint
        else f"no point of its sweeps in {band} reaches a coherence of {least_coherence:g}",
        needed="usable points in the fitted band",
        remedy="fly a sweep over the fitted band",
    )


def _poor(records: Sequence[str], pairs: Mapping[str, PairCost]) -> list[Finding]:
    where = ", ".join(records)
    return [
        warn(
            "poor_verification",
            f"{where}: {name}",
            f"The model misses the response {name} of unseen sweeps: cost {pair.value:.0f}, acceptable up to "
            f"{ACCEPTABLE_COST:g}.",
            cost=pair.value,
        )
        for name, pair in pairs.items()
        if not pair.value <= ACCEPTABLE_COST
    ]


def _advice(structure: LinearStructure) -> str:
    """What would judge a model: a bench flies nothing."""
    if family_of(structure).needs == "single motors":
        return "Sweep again, and give that log with --verify."
    return "Fly doublets, or give another log with --verify."


def hold_out(structure: LinearStructure, flights: Sequence[Flight], settings: IdentifySettings) -> FrequencyCheck:
    """Fit a structure to all maneuvers but one, and judge that second model on that one.

    Held out is the last maneuver of an axis that was flown more than once: without the only sweep of an axis, or of
    a motor that turns it on a pivot, its parameters would be those of noise. The second fit begins from nothing: its
    band, its start values and what it drops come from the maneuvers that are left. It is another model than the one of
    the result, which has seen all of them.

    Parameters
    ----------
    flights
        All maneuvers that the model of the result was fitted to.
    """
    single = all(name.startswith("motor_") for name in structure.inputs)
    shown = [_shown_by(flight.maneuver, single=single) for flight in flights]
    again = [index for index, one in enumerate(shown) if shown.count(one) > 1]
    if not again:
        return FrequencyCheck(findings=(nothing_left(structure),))
    rest, held_out = [*flights[: again[-1]], *flights[again[-1] + 1 :]], flights[again[-1]]
    name = f"{held_out.record.source.name} at {held_out.maneuver.start_s:.1f} s"
    _PROGRESS.info(f"holding out {name}")
    try:
        measured = measure(rest, inputs=structure.inputs, outputs=structure.outputs, settings=settings)
        reduced = fit_and_drop(pose_screened(structure, measured, settings, rest).problem)
        parameters = reduced.problem.parameters.unpack(reduced.solution.theta)
        band = fitted_band(reduced.problem)
        there = tuple(name for name in structure.outputs if holds(held_out.record, name))
        selected = structure if there == structure.outputs else structure.select(outputs=there)
        judged = check_sweeps(selected, parameters, [held_out], band_rad_s=band, settings=settings)
    except InsufficientDataError as error:
        return FrequencyCheck(findings=(_not_held_out(structure, name, error),))
    # Findings on the data of the first fit need no repetition for its parts.
    poor = (finding for finding in judged.findings if finding.kind == "poor_verification")
    findings = (*poor, _held_out(name, max(judged.costs.values()), band))
    return replace(judged, findings=findings)


def _shown_by(maneuver: Maneuver, *, single: bool) -> str:
    """What a maneuver excites: its axis or, on a bench, the one motor whose test input was logged.

    Without a test input, feedback moves all motors at once: nothing shows which of them was swept, nor whether twice.
    """
    if maneuver.signal.startswith("motor_") and maneuver.signal.endswith("_excitation"):
        return maneuver.signal
    return f"{maneuver.axis} at {maneuver.start_s:g} s" if single else maneuver.axis


def nothing_left(structure: LinearStructure) -> Finding:
    """The finding on a model that has no unseen data and no maneuver to leave out."""
    return warn(
        "not_verified",
        "verification",
        f"All maneuvers were used for the fit, each on its own axis; none is left to validate the model. "
        f"{_advice(structure)}",
    )


def _not_held_out(structure: LinearStructure, name: str, error: InsufficientDataError) -> Finding:
    return warn(
        "not_verified",
        name,
        f"No maneuver is left to validate the model, and a second fit without that of {name} failed: "
        f"{error.came.rstrip('.')}. {_advice(structure)}",
    )


def _held_out(name: str, worst: float, band_rad_s: tuple[float, float]) -> Finding:
    # Fewer maneuvers may carry a narrower band, in which a wrong model passes, so the finding names the band.
    return remark(
        "held_out",
        name,
        f"All maneuvers were used for the fit. A second model, fitted from {band_rad_s[0]:.2g} to "
        f"{band_rad_s[1]:.3g} rad/s without that of {name}, predicts its response with a cost of {worst:.1f}.",
        cost=worst,
        low_rad_s=band_rad_s[0],
        high_rad_s=band_rad_s[1],
    )
