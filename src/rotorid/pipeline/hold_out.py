"""Where all that was flown was fitted: fit again without one maneuver, and judge that model on it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from rotorid.data.findings import Finding
from rotorid.errors import InsufficientDataError
from rotorid.models.structure import LinearStructure
from rotorid.pipeline.fitting import fitted_band
from rotorid.pipeline.instruments import Flown
from rotorid.pipeline.inverse import pose_screened
from rotorid.pipeline.judged import Judged
from rotorid.pipeline.measure import measure
from rotorid.pipeline.settings import IdentifySettings
from rotorid.pipeline.unseen_sweeps import judge_sweeps
from rotorid.reduce.elimination import fit_and_drop

_ADVICE = "Fly doublets, or give another log with --verify."


def hold_out(
    structure: LinearStructure, flown: Sequence[Flown], settings: IdentifySettings, progress: Callable[[str], None]
) -> Judged:
    """Fit a structure to all maneuvers but one, and judge that second model on that one.

    Held out is the last maneuver of an axis that was flown more than once: without the only sweep of an axis its
    parameters would be those of noise. The second fit begins from nothing: its band, its start values and what it drops
    come from the maneuvers that are left. It is another model than the one of the result, which has seen all of them.

    Parameters
    ----------
    structure
        What to fit.
    flown
        All maneuvers that the model of the result was fitted to.
    settings
        Choices of the run.
    progress
        Told what is being done.
    """
    axes = [maneuver.axis for _, maneuver in flown]
    again = [index for index, axis in enumerate(axes) if axes.count(axis) > 1]
    if not again:
        return Judged(findings=(nothing_left(),))
    rest, held = [*flown[: again[-1]], *flown[again[-1] + 1 :]], flown[again[-1]]
    name = f"{held[0].source.name} at {held[1].start_s:.1f} s"
    progress(f"holding out {name}")
    try:
        measured = measure(rest, inputs=structure.inputs, outputs=structure.outputs, settings=settings)
        reduced = fit_and_drop(pose_screened(structure, measured, settings, rest).problem)
        parameters = reduced.problem.parameters.unpack(reduced.solution.theta)
        band = fitted_band(reduced.problem)
        judged = judge_sweeps(structure, parameters, [held], band_rad_s=band, settings=settings)
    except InsufficientDataError as error:
        return Judged(findings=(_not_held_out(name, error),))
    # What was said of the data when all of it was fitted need not be said of its parts again.
    poor = (finding for finding in judged.findings if finding.kind == "poor_verification")
    findings = (*poor, _held_out(name, max(judged.costs.values()), band))
    return replace(judged, findings=findings)


def nothing_left() -> Finding:
    """What to say where a model was judged on nothing that it had not seen, and nothing can be held out."""
    return Finding(
        kind="not_verified",
        severity="warning",
        where="verification",
        message=(
            "Everything that was flown was fitted, and no axis twice, so nothing is left to judge the model on. "
            f"{_ADVICE}"
        ),
    )


def _not_held_out(name: str, error: InsufficientDataError) -> Finding:
    return Finding(
        kind="not_verified",
        severity="warning",
        where=name,
        message=(
            f"No maneuver is left unseen, and that of {name} could not be held out of a second fit: "
            f"{error.came.rstrip('.')}. {_ADVICE}"
        ),
    )


def _held_out(name: str, worst: float, band_rad_s: tuple[float, float]) -> Finding:
    # Fewer maneuvers may carry a narrower band, in which a model of the wrong form passes: so the band is said.
    return Finding(
        kind="held_out",
        severity="info",
        where=name,
        message=(
            f"No maneuver is left unseen. A second model, fitted from {band_rad_s[0]:.2g} to {band_rad_s[1]:.3g} rad/s "
            f"without that of {name}, predicts its response with a cost of {worst:.1f}; the model of this result was "
            "fitted to all maneuvers."
        ),
        numbers={"cost": worst, "low_rad_s": band_rad_s[0], "high_rad_s": band_rad_s[1]},
    )
