"""Judge a frozen model on sweeps that it has not seen, in the frequency domain."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from rotorid.data.findings import Finding
from rotorid.data.response import FrequencyResponse
from rotorid.errors import InsufficientDataError
from rotorid.fit.frequency_cost import ACCEPTABLE_COST, pair_costs, point_weights
from rotorid.fit.problem import usable_points
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.pipeline.instruments import Flown, axis_of, is_command
from rotorid.pipeline.judged import Judged, JudgedPair
from rotorid.pipeline.measure import Measured, measure
from rotorid.pipeline.settings import MeasureSettings
from rotorid.typing import BoolArray, ComplexArray


def judge_sweeps(
    structure: LinearStructure,
    parameters: ParameterSet,
    sweeps: Sequence[Flown],
    *,
    band_rad_s: tuple[float, float],
    settings: MeasureSettings,
    progress: Callable[[str], None] = lambda _: None,
) -> Judged:
    r"""Cost of a frozen model against the responses of sweeps that were not fitted.

    Judged are the responses to inputs that were swept, where the model was fitted and where the sweeps of each input
    excite: above their end there is coherence too, of noise that the controller fed back. What the controller does
    meanwhile with the other inputs :math:`v` was measured too, and the model is given it,

    .. math:: H_{yu} + H_{yv} \, (v/u)

    A response without usable points, such as that of an output that does not follow, is left out and not judged.

    Parameters
    ----------
    structure, parameters
        The model.
    sweeps
        What it has not seen.
    band_rad_s
        The fitted band.
    settings
        Choices of the run.
    progress
        Told what is being done.

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
        progress=progress,
    )
    data = _of_outputs(measured.response, len(structure.outputs))
    limit = settings.least_coherence(joint=data.estimate == "joint")
    used = _used(measured, data, band_rad_s, limit)
    if not used.any():
        raise _nothing_usable(band_rad_s, measured.trusted_rad_s, limit)
    model = _model(structure, parameters, measured.response)
    costs = pair_costs(model, data.values, point_weights(data, used))
    pairs = {}
    for y, u in np.ndindex(used.shape[:2]):
        omega = data.omega_rad_s[used[y, u]]
        if omega.size:
            band = (float(omega[0]), float(omega[-1]))
            pairs[f"{data.outputs[y]}/{data.inputs[u]}"] = JudgedPair(
                cost=float(costs[y, u]), band_rad_s=band, points=omega.size
            )
    records = tuple(dict.fromkeys(record.source.name for record, _ in sweeps))
    return Judged(
        pairs=pairs,
        findings=(*measured.findings, *_poor(records, pairs)),
        records=records,
        response=data,
        model_response=model,
        used=used,
    )


def _swept(inputs: Sequence[str], sweeps: Sequence[Flown]) -> tuple[str, ...]:
    """Inputs of a model that sweeps excite; one that is no command may be moved by any."""
    axes = {maneuver.axis for _, maneuver in sweeps}
    return tuple(name for name in inputs if not is_command(name) or axis_of(name) in axes)


def _moves(name: str, sweeps: Sequence[Flown]) -> bool:
    """Whether a channel is anything but constant in the logs of some sweeps."""
    return any(np.ptp(topic.values[row]) > 0.0 for record, _ in sweeps for topic, row in record.holding(name))


def _of_inputs(settings: MeasureSettings, inputs: Sequence[str], swept: Sequence[str]) -> MeasureSettings:
    """The choices of a run for some of its inputs: of instruments that were given, theirs."""
    if len(settings.instruments) != len(inputs):
        return settings
    given = dict(zip(inputs, settings.instruments, strict=True))
    return replace(settings, instruments=tuple(given[name] for name in swept))


def _of_outputs(data: FrequencyResponse, count: int) -> FrequencyResponse:
    """The responses of the first outputs only."""
    if len(data.outputs) == count:
        return data
    between = data.output_correlation
    return replace(
        data,
        outputs=data.outputs[:count],
        values=data.values[:count],
        coherence=data.coherence[:count],
        random_error=data.random_error[:count],
        covariance=data.covariance[:count],
        output_correlation=None if between is None else between[:, :count, :count],
        disturbance=None,
    )


def _model(structure: LinearStructure, parameters: ParameterSet, data: FrequencyResponse) -> ComplexArray:
    """The model with what the other inputs did, of which ``data`` holds the responses after those of its outputs."""
    whole = structure.response(parameters.values, data.omega_rad_s)
    count = len(structure.outputs)
    swept = [structure.inputs.index(name) for name in data.inputs]
    others = [structure.inputs.index(name) for name in data.outputs[count:]]
    return np.asarray(whole[:, swept] + np.einsum("yvf,vuf->yuf", whole[:, others], data.values[count:]))


def _used(measured: Measured, data: FrequencyResponse, fitted_rad_s: tuple[float, float], limit: float) -> BoolArray:
    """Points in the fitted band, each input as far as its own sweeps went, shape ``(y, u, f)``."""
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
    apart = trusted_rad_s[1] <= fitted_rad_s[0] or trusted_rad_s[0] >= fitted_rad_s[1]
    return InsufficientDataError(
        f"its sweeps, trusted from {trusted_rad_s[0]:.3g} to {trusted_rad_s[1]:.3g} rad/s, do not reach {band}"
        if apart
        else f"no point of its sweeps in {band} reaches the coherence of {least_coherence:g}",
        needed="usable points in the fitted band",
        remedy="fly a sweep over the fitted band",
    )


def _poor(records: Sequence[str], pairs: Mapping[str, JudgedPair]) -> list[Finding]:
    where = ", ".join(records)
    return [
        Finding(
            kind="poor_verification",
            severity="warning",
            where=f"{where}: {name}",
            message=(
                f"The model misses the response {name} of unseen sweeps with a cost of {pair.cost:.0f}, above the "
                f"{ACCEPTABLE_COST:g} of an acceptable model."
            ),
            numbers={"cost": pair.cost},
        )
        for name, pair in pairs.items()
        if not pair.cost <= ACCEPTABLE_COST
    ]
