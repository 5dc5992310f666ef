"""``track.json``, schema ``rotorid.track/1``: the gain of a model through a flight."""

from __future__ import annotations

import math
from itertools import groupby
from typing import Annotated, Literal

from pydantic import Field

from rotorid.data.quantity import with_error
from rotorid.documents.base import Document, FindingDocument, ProvenanceDocument, Shown, ShownDocument, finding_lines
from rotorid.documents.review import QuantityDocument
from rotorid.identifying.tracking import FlightTracking
from rotorid.results.provenance import Refused
from rotorid.results.summary import finite
from rotorid.typing import AnyArray
from rotorid.uncertainty.differences import FALSE_SHARE, Verdict, chance, detectable, verdict
from rotorid.verification.tracking import BLOCK_S, Why


class GainStepDocument(Document):
    """A step of the gain: when it was found, when it began, gain after it over that of the reference."""

    at_s: float
    since_s: float
    ratio: float
    std: float


class TrimStepDocument(Document):
    """A lasting change of a mean command."""

    channel: str
    at_s: float
    before: float
    after: float
    std: float


class CannotTellDocument(Document):
    """A time without a verdict: too little movement of the ``stick``, or rougher ``air`` than in the reference."""

    start_s: float
    stop_s: float
    why: Literal["stick", "air"]


class TrackDocument(ShownDocument):
    """``track.json``: a model followed through a flight.

    ``gain`` is that of the end of the flight over that of the reference. ``told_s`` are the seconds with a verdict. The
    ``verdict`` is ``changed`` where there are steps, or where the gain at the end differs by more than its error and
    the step looked for. ``thrust_exponent`` is ``null`` where it is unknown, so that other throttles count less.
    """

    schema_name: Annotated[Literal["rotorid.track/1"], Field(alias="schema")] = "rotorid.track/1"
    log: str = ""
    model: str = ""
    axis: str = ""
    parameters: dict[str, float] = Field(default_factory=dict)
    parameter_stds: dict[str, float | None] = Field(default_factory=dict)
    parameter_units: dict[str, str] = Field(default_factory=dict)
    given: bool = False
    instrument: str = ""
    reference_s: tuple[float, float] | None = None
    told_s: float = 0.0
    gain: QuantityDocument | None = None
    verdict: Verdict = "undecided"
    detectable_share: float | None = None
    thrust_exponent: float | None = None
    steps: list[GainStepDocument] = Field(default_factory=list)
    trims: list[TrimStepDocument] = Field(default_factory=list)
    cannot_tell: list[CannotTellDocument] = Field(default_factory=list)
    findings: list[FindingDocument] = Field(default_factory=list)
    provenance: ProvenanceDocument

    def shown(self) -> Shown:
        """The verdict, the gain at the end, what changed when, and when there is no verdict."""
        rows: list[tuple[str, ...]] = [("verdict", self.verdict, f"{self.told_s:.0f} s could be judged")]
        if self.gain is not None:
            rows.append(("gain at the end", with_error(self.gain.value, self.gain.std), "of that of the reference"))
        rows += [("step", with_error(step.ratio, step.std), f"from {step.since_s:.1f} s") for step in self.steps]
        rows += [
            (f"mean {trim.channel}", f"{trim.before:.3g} to {trim.after:.3g}", f"{trim.at_s:.1f} s")
            for trim in self.trims
        ]
        rows += [
            ("not enough data", f"{gap.start_s:.1f} to {gap.stop_s:.1f} s", _WHY[gap.why]) for gap in self.cannot_tell
        ]
        return Shown(
            f"{self.log}: gain of {self.model} in flight",
            ("what", "value", "note"),
            [*rows, *finding_lines(self.findings, 3)],
        )


_WHY = {"stick": "the stick moved too little", "air": "rougher air than in the reference"}


def track_document(found: FlightTracking | Refused) -> TrackDocument:
    """The document of a tracked flight; for a refusal only its findings."""
    common = {
        "findings": [FindingDocument.model_validate(finding) for finding in found.findings],
        "provenance": ProvenanceDocument.model_validate(found.provenance),
    }
    if isinstance(found, Refused):
        return TrackDocument.model_validate(common)
    tracking = found.tracking
    ratio, std = float(tracking.ratio[-1]), float(tracking.std[-1])
    share = detectable(std, tests=1) if tracking.told_s > 0.0 else math.inf
    moved = (
        abs(ratio - 1.0) > float(str(found.provenance.settings["step_share"]))
        and chance((ratio - 1.0) / std) < FALSE_SHARE
    )
    return TrackDocument.model_validate(
        {
            **common,
            "log": found.log,
            "model": found.model,
            "axis": found.axis,
            "parameters": dict(found.parameters),
            "parameter_stds": dict(found.parameter_stds),
            "parameter_units": dict(found.parameter_units),
            "given": found.given,
            "instrument": found.instrument,
            "reference_s": found.reference_s,
            "told_s": tracking.told_s,
            "gain": {"value": ratio, "std": std, "lower": ratio - 2 * std, "upper": ratio + 2 * std, "unit": "1"},
            "verdict": verdict(found=bool(tracking.steps) or moved, detectable_share=share),
            "detectable_share": finite(share),
            "thrust_exponent": tracking.thrust_exponent,
            "steps": [GainStepDocument.model_validate(step) for step in tracking.steps],
            "trims": [TrimStepDocument.model_validate(trim_step) for trim_step in found.trims],
            "cannot_tell": [
                CannotTellDocument(start_s=start_s, stop_s=stop_s, why=why)
                for start_s, stop_s, why in silent(found)
                if why in ("stick", "air")
            ],
        }
    )


def silent(found: FlightTracking) -> list[tuple[float, float, Why]]:
    """Times without a verdict, each with its reason."""
    tracking, parts = found.tracking, []
    blocks = zip(tracking.time_s, tracking.cannot_tell, strict=True)
    for why, group in groupby(blocks, key=lambda item: item[1]):
        if why:
            times = [float(time_s) for time_s, _ in group]
            parts.append((times[0] - BLOCK_S, times[-1], why))
    return parts


def track_arrays(found: FlightTracking) -> dict[str, AnyArray]:
    """Arrays of ``track.npz``."""
    tracking = found.tracking
    return {
        "time_s": tracking.time_s,
        "ratio": tracking.ratio,
        "std": tracking.std,
        "level": tracking.level,
        "rougher": tracking.rougher,
    }
