"""A verdict on gains, as ``tune.json`` and ``review.json`` have it."""

from __future__ import annotations

from typing import Any, Literal

from rotorid.documents.base import Document
from rotorid.results.summary import finite
from rotorid.tuning.judging import LoopVerdict, Verdict


class BreakingDocument(Document):
    """The likely plant that decides a verdict: where its sensitivity peaks, and its response over the likeliest there.

    ``sensitivity_peak`` is absent where its loop is unstable; ``situation`` names an end of the throttle or of D.
    """

    loop: Literal["rate", "whole"]
    situation: str = ""
    omega_rad_s: float
    sensitivity_peak: float | None = None
    gain: float
    phase_deg: float


class VerdictDocument(Document):
    """A verdict on gains, by the larger sensitivity peak of both loops over the likely plants.

    ``usual_peak``, ``peak_90`` and ``peak_95`` are its median and quantiles, absent where a loop is unstable there;
    ``unstable`` is the share of plants with an unstable loop. ``known_to_rad_s`` is the end of the band to measure,
    where the data do not suffice.
    """

    verdict: Verdict
    usual_peak: float | None = None
    peak_90: float | None = None
    peak_95: float | None = None
    unstable: float | None = None
    noisy: bool = False
    breaking: BreakingDocument | None = None
    known_to_rad_s: float | None = None


def verdict_fields(found: LoopVerdict) -> dict[str, Any]:
    """A verdict as :class:`VerdictDocument` has it."""
    return {
        "verdict": found.verdict,
        "usual_peak": finite(found.usual_peak),
        "peak_90": finite(found.refused_peak),
        "peak_95": finite(found.safe_peak),
        "unstable": found.unstable,
        "noisy": found.noisy,
        "known_to_rad_s": found.known_to_rad_s or None,
        "breaking": BreakingDocument(
            loop=found.breaking.loop,
            situation=found.breaking.situation,
            omega_rad_s=found.breaking.omega_rad_s,
            sensitivity_peak=finite(found.breaking.sensitivity_peak),
            gain=found.breaking.gain,
            phase_deg=found.breaking.phase_deg,
        ),
    }


def verdict_document(found: LoopVerdict | None) -> VerdictDocument:
    """A verdict as JSON; not enough data where there is none."""
    return VerdictDocument(verdict="not_enough_data") if found is None else VerdictDocument(**verdict_fields(found))
