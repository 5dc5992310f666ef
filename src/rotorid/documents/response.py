"""The document that ``rotorid response`` writes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar, cast

from pydantic import Field

from rotorid.documents.base import Document, FindingDocument, Flags, ManeuverDocument, Numbers, ProvenanceDocument
from rotorid.results.summary import RemovedFilters

if TYPE_CHECKING:
    from rotorid.loops.rate_loops import AxisLoop
    from rotorid.loops.responses import Responses
    from rotorid.results.provenance import Refused


class EstimatedDocument(Document):
    """A number, one standard deviation of it and its 95 % interval, in the unit that its name says."""

    value: float
    std: float
    lower: float | None = None
    upper: float | None = None


class PairDocument(Document):
    """One response: its usable part, and its values on the grid of the document.

    ``band_rad_s`` is the usable band, ``null`` where there is none; the means are over it.
    ``direct_difference_db`` is the rms difference of the direct from the joint estimate there, ``leakage_percent`` the
    rms error that the windows would have caused, ``largest_input_noise_db`` the largest bias of a direct estimate by
    noise at a measured input.
    """

    unit: str
    band_rad_s: tuple[float, float] | None = None
    points: int = 0
    mean_coherence: float | None = None
    mean_random_error: float | None = None
    direct_difference_db: float | None = None
    leakage_percent: float | None = None
    largest_input_noise_db: float | None = None
    magnitude: Numbers
    phase_rad: Numbers
    coherence: Numbers
    random_error: Numbers
    used: Flags


class RecordDocument(ManeuverDocument):
    """A maneuver with its own mean coherence by pair, and whether the estimate uses it."""

    coherence: dict[str, float] = Field(default_factory=dict)
    used: bool = True


class BoundDocument(EstimatedDocument):
    """A bound by the end of the band, ``omega_rad_s``, on a number beyond it: ``at_least`` this, or at most."""

    at_least: bool
    omega_rad_s: float


class BeyondDocument(Document):
    """Numbers beyond the band, by a model of the vehicle times the controller in the log: none was measured."""

    method: str
    up_to_rad_s: float
    numbers: dict[str, EstimatedDocument] = Field(default_factory=dict)


class LoopDocument(Document):
    """Margins of the loop of one axis: numbers with their uncertainty, or in ``not_seen`` why there is none.

    ``scope`` names the loop: ``rate`` is the rate loop alone, ``whole`` the loop with all outer loops closed around it.
    ``bounds`` has bounds on numbers beyond the band, and ``beyond`` their values by a model. ``whole`` is the whole
    loop, where a test signal at the mixer shows it in addition to the rate loop.
    """

    method: str
    scope: Literal["rate", "whole"] = "rate"
    band_rad_s: tuple[float, float] | None = None
    numbers: dict[str, EstimatedDocument] = Field(default_factory=dict)
    not_seen: dict[str, str] = Field(default_factory=dict)
    bounds: dict[str, BoundDocument] = Field(default_factory=dict)
    beyond: BeyondDocument | None = None
    whole: LoopDocument | None = None


class ResponseDocument(Document):
    """``response.json``: frequency responses with their errors and usable bands."""

    schema_name: Annotated[Literal["rotorid.response/1"], Field(alias="schema")] = "rotorid.response/1"
    inputs: list[str]
    outputs: list[str]
    estimate: Literal["direct", "joint"] | None = None
    instruments: list[str] = Field(default_factory=list)
    windows_s: list[float] = Field(default_factory=list)
    omega_rad_s: Numbers = Field(default_factory=list)
    pairs: dict[str, PairDocument] = Field(default_factory=dict)
    input_coherence: dict[str, float] = Field(default_factory=dict)
    largest_condition: float | None = None
    records: list[RecordDocument] = Field(default_factory=list)
    loops: dict[str, LoopDocument] = Field(default_factory=dict)
    processing: list[str] = Field(default_factory=list)
    filters_removed: dict[str, RemovedFilters] = Field(default_factory=dict)
    findings: list[FindingDocument] = Field(default_factory=list)
    provenance: ProvenanceDocument


def response_document(result: Responses | Refused) -> ResponseDocument:
    """The document of ``rotorid response``; of a refusal with findings alone."""
    return ResponseDocument.model_validate(result)


LoopT = TypeVar("LoopT", bound="AxisLoop | LoopDocument")


def loops_of(loops: Mapping[Any, LoopT]) -> list[tuple[str, str, LoopT]]:
    """Every loop with its axis and a key of its own: that of the rate, then the whole one where both were measured.

    Parameters
    ----------
    loops
        By axis.
    """
    found = []
    for axis, loop in loops.items():
        found.append((str(axis), str(axis), loop))
        if loop.whole is not None:
            found.append((str(axis), f"{axis}_whole", cast("LoopT", loop.whole)))
    return found
