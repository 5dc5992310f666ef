"""Judge a frozen model on sweeps that it has not seen, in the frequency domain."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from rotorid.data.findings import Finding
from rotorid.errors import InsufficientDataError
from rotorid.fit.frequency_cost import ACCEPTABLE_COST, pair_costs, point_weights
from rotorid.fit.problem import usable_points
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.pipeline.instruments import Flown
from rotorid.pipeline.measure import measure
from rotorid.pipeline.settings import IdentifySettings


@dataclass(frozen=True, kw_only=True, eq=False)
class Judged:
    """What unseen sweeps say about a model.

    Parameters
    ----------
    costs
        Cost of each response that has usable points, by ``output/input``.
    findings
        Remarks on the sweeps and on the costs.
    """

    costs: Mapping[str, float] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()


def judge_sweeps(
    structure: LinearStructure,
    parameters: ParameterSet,
    sweeps: Sequence[Flown],
    *,
    band_rad_s: tuple[float, float],
    settings: IdentifySettings,
    progress: Callable[[str], None] = lambda _: None,
) -> Judged:
    """Cost of a frozen model against the responses of sweeps that were not fitted.

    Judged where the model was fitted and these sweeps excite: above their end there is coherence too, of noise that
    the controller fed back.

    Parameters
    ----------
    structure, parameters
        The model.
    sweeps
        What it has not seen.
    band_rad_s
        The fitted band.
    settings
        Choices of the run that fitted it.
    progress
        Told what is being done.

    Raises
    ------
    InsufficientDataError
        A channel is missing, the sweeps are too short, or no point of them is usable in the fitted band.
    """
    measured = measure(sweeps, inputs=structure.inputs, outputs=structure.outputs, settings=settings, progress=progress)
    data, trusted = measured.response, measured.trusted_rad_s
    band = max(band_rad_s[0], trusted[0]), min(band_rad_s[1], trusted[1])
    limit = settings.least_coherence(joint=data.estimate == "joint")
    used = usable_points(data, coherence=limit, band_rad_s=band)
    if not used.any():
        raise _nothing_usable(band_rad_s, trusted, limit)
    costs = pair_costs(structure.response(parameters.values, data.omega_rad_s), data.values, point_weights(data, used))
    named = {
        f"{output}/{input}": float(costs[y, u])
        for y, output in enumerate(data.outputs)
        for u, input in enumerate(data.inputs)
        if used[y, u].any()
    }
    return Judged(costs=named, findings=(*measured.findings, *_poor(sweeps, named)))


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


def _poor(sweeps: Sequence[Flown], costs: Mapping[str, float]) -> list[Finding]:
    where = ", ".join(dict.fromkeys(record.source.name for record, _ in sweeps))
    return [
        Finding(
            kind="poor_verification",
            severity="warning",
            where=f"{where}: {pair}",
            message=(
                f"The model misses the response {pair} of unseen sweeps with a cost of {cost:.0f}, above the "
                f"{ACCEPTABLE_COST:g} of an acceptable model."
            ),
            numbers={"cost": cost},
        )
        for pair, cost in costs.items()
        if not cost <= ACCEPTABLE_COST
    ]
