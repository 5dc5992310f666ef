"""The document of ``rotorid inspect``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from rotorid.documents.base import Document, FindingDocument, ManeuverDocument

if TYPE_CHECKING:
    from rotorid.reviewing.inspection import Inspection


class NeedDocument(Document):
    """One thing that a model needs, and whether the log has it."""

    need: str
    there: bool
    found: str


class SupportDocument(Document):
    """Whether a model can be identified from this log, and what to change if not."""

    possible: bool
    because: str
    remedy: str = ""
    instrument: str | None = None
    needs: list[NeedDocument] = Field(default_factory=list)
    by: Literal["", "excitation", "ordinary flight", "motors", "flight", "motor speeds"] = ""


class ChannelDocument(Document):
    """A channel in one topic: the same channel may be in several."""

    name: str
    unit: str
    source: str
    topic: str
    rate_hz: float
    samples: int
    start_s: float | None
    stop_s: float | None
    gaps: int
    longest_gap_s: float


class CandidateDocument(ManeuverDocument):
    """A stretch of strong motion of an axis, and the value of ``--segment`` that selects it."""

    segment: str


class BatteryDocument(Document):
    """Voltage of the battery at the start and end of the flights (of the log where it never flew), and the lowest."""

    start_v: float
    stop_v: float
    lowest_v: float


class FlightDocument(Document):
    """An interval in the air, and the channels that show it."""

    start_s: float
    stop_s: float
    seen_in: str


class KinematicsDocument(Document):
    """A sensor compared with attitude or velocities: scale, bias and lag with standard deviations."""

    channel: str
    against: str
    start_s: float
    stop_s: float
    scale: float
    scale_std: float
    bias: float
    bias_std: float
    lag_s: float
    lag_std_s: float
    cancellation: float
    verdict: Literal["consistent", "inconsistent", "uncertain"]


class SkewDocument(Document):
    """The lag of one signal behind another, the part that filters explain, and the ``--shift`` for the rest."""

    channel: str
    reference: str
    delayed: str
    nature: Literal["same_channel", "vehicle"]
    start_s: float
    stop_s: float
    seconds: float
    std_s: float
    sample_s: float
    coherence: float
    known_s: tuple[float, float]
    remedy: str = ""


class InspectDocument(Document):
    """Answer of ``inspect``."""

    schema_name: Annotated[Literal["rotorid.inspect/1"], Field(alias="schema")] = "rotorid.inspect/1"
    name: str
    format: str
    firmware: str
    sha256: str
    start_s: float
    stop_s: float
    parameters: int
    channels: list[ChannelDocument]
    excitations: list[ManeuverDocument]
    supports: dict[str, SupportDocument]
    findings: list[FindingDocument]
    candidates: list[CandidateDocument] = Field(default_factory=list)
    flights: list[FlightDocument] = Field(default_factory=list)
    kinematics: list[KinematicsDocument] = Field(default_factory=list)
    skews: list[SkewDocument] = Field(default_factory=list)
    battery: BatteryDocument | None = None
    settings: dict[str, float] = Field(default_factory=dict)
    vehicle: str = ""
    next_commands: list[str] = Field(default_factory=list)


class InspectionsDocument(Document):
    """Several logs, in the order in which they were given."""

    schema_name: Annotated[Literal["rotorid.inspections/1"], Field(alias="schema")] = "rotorid.inspections/1"
    inspections: list[InspectDocument]


def inspect_document(inspection: Inspection) -> InspectDocument:
    """What ``rotorid inspect --json`` prints."""
    return InspectDocument.model_validate(inspection)
