"""The document that ``rotorid simulate`` writes."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from rotorid.pipeline.document import FindingDocument, ManeuverDocument, ProvenanceDocument
from rotorid.pipeline.document_base import Document


class TruthDocument(Document):
    """A number of the vehicle that flew, by the name that an identification would give it."""

    value: float
    unit: str


class ReachedDocument(Document):
    """Extremes of a flight: true motion, outputs to the motors, share of the time with motors at a limit."""

    tilt_rad: float
    rate_rad_s: float
    position_m: float
    height_m: float
    motor_low: float
    motor_high: float
    saturated: float


class SimulatedLogDocument(Document):
    """A log that was written: its seed, the numbers drawn for it (``changed``), and what the flight reached."""

    file: str
    format: str
    sha256: str
    seed: int
    duration_s: float
    changed: dict[str, float] = Field(default_factory=dict)
    reached: ReachedDocument | None = None


class VehicleDocument(Document):
    """What flew. ``changed`` holds what the user set otherwise than the source has it."""

    name: str
    description: str
    source: str
    autopilot: str
    control_rate_hz: float | None = None
    changed: dict[str, float] = Field(default_factory=dict)


class SimulationDocument(Document):
    """``simulation.json``: what flew, what was true, and the logs.

    ``truth`` holds the derivatives of the exact linear model about hover, in still air. ``maneuvers`` are on the clock
    of the logs.
    """

    schema_name: Annotated[Literal["rotorid.simulation/1"], Field(alias="schema")] = "rotorid.simulation/1"
    vehicle: VehicleDocument
    logs: list[SimulatedLogDocument]
    maneuvers: list[ManeuverDocument] = Field(default_factory=list)
    truth: dict[str, TruthDocument]
    findings: list[FindingDocument] = Field(default_factory=list)
    provenance: ProvenanceDocument
