"""What one run of ``identify`` hands on: the document, and the arrays that the pictures need."""

from __future__ import annotations

from dataclasses import dataclass

from rotorid.data.history import TimeHistory
from rotorid.data.maneuver import Maneuver
from rotorid.data.response import FrequencyResponse
from rotorid.pipeline.document import ResultDocument
from rotorid.pipeline.judged import Judged
from rotorid.typing import BoolArray, ComplexArray
from rotorid.verify.verification import Verification


@dataclass(frozen=True, kw_only=True, eq=False)
class Segment:
    """A maneuver with the data around it, on one clock."""

    record: str
    maneuver: Maneuver
    history: TimeHistory


@dataclass(frozen=True, kw_only=True, eq=False)
class Identification:
    """A finished identification.

    Parameters
    ----------
    document
        What ``result.json`` holds.
    model_toml
        The structure with the identified values, as text.
    response
        The measured response that was fitted.
    beside
        The direct estimate, when ``response`` is a joint one.
    model_response
        The model on the same grid, shape ``(y, u, f)``; the exact response, delays included.
    fitted
        Points that entered the fit, shape ``(y, u, f)``.
    segments
        The maneuvers that were used, with their data.
    verifications
        Unseen maneuvers, measured and predicted.
    judged
        Responses of unseen sweeps, measured and of the model.
    least_coherence
        Coherence below which points were left out.
    """

    document: ResultDocument
    model_toml: str
    response: FrequencyResponse
    beside: FrequencyResponse | None
    model_response: ComplexArray
    fitted: BoolArray
    segments: tuple[Segment, ...]
    verifications: tuple[Verification, ...]
    judged: tuple[Judged, ...] = ()
    least_coherence: float = 0.6
