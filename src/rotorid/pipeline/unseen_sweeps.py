"""Judge a frozen model on sweeps that it has not seen, in the frequency domain."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from rotorid.data.findings import Finding
from rotorid.errors import InsufficientDataError
from rotorid.fit.frequency_cost import ACCEPTABLE_COST, pair_costs, point_weights
from rotorid.fit.problem import usable_points
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.pipeline.instruments import Flown
from rotorid.pipeline.judged import Judged, JudgedPair
from rotorid.pipeline.measure import Measured, measure
from rotorid.pipeline.settings import MeasureSettings
from rotorid.typing import BoolArray


def judge_sweeps(
    structure: LinearStructure,
    parameters: ParameterSet,
    sweeps: Sequence[Flown],
    *,
    band_rad_s: tuple[float, float],
    settings: MeasureSettings,
    progress: Callable[[str], None] = lambda _: None,
) -> Judged:
    """Cost of a frozen model against the responses of sweeps that were not fitted.

    Judged where the model was fitted and where the sweeps of each input excite: above their end there is coherence
    too, of noise that the controller fed back. A response without usable points, such as that of an input that was not
    swept or of an output that does not follow it, is left out and not judged.

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
    measured = measure(sweeps, inputs=structure.inputs, outputs=structure.outputs, settings=settings, progress=progress)
    data = measured.response
    limit = settings.least_coherence(joint=data.estimate == "joint")
    used = _used(measured, band_rad_s, limit)
    if not used.any():
        raise _nothing_usable(band_rad_s, measured.trusted_rad_s, limit)
    model = structure.response(parameters.values, data.omega_rad_s)
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


def _used(measured: Measured, fitted_rad_s: tuple[float, float], limit: float) -> BoolArray:
    """Points in the fitted band, each input as far as its own sweeps went, shape ``(y, u, f)``."""
    data, trusted = measured.response, measured.trusted_rad_s
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
