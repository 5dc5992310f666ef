"""The document that ``rotorid design`` writes."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from rotorid.data.flight_plan import Entry, Shape
from rotorid.pipeline.document import FindingDocument, ProvenanceDocument
from rotorid.pipeline.document_base import Document
from rotorid.pipeline.simulation_document import ReachedDocument, VehicleDocument


class TestInputDocument(Document):
    """A test input: how large it is, and the limit that a larger one would pass (empty where none was looked for)."""

    axis: str
    shape: Shape
    entry: Entry
    start_s: float
    stop_s: float
    amplitude: float
    unit: str
    band_rad_s: tuple[float, float] | None = None
    limited_by: str = ""


class PredictedParameterDocument(Document):
    """What a flight will tell about a parameter.

    ``expected`` is where the fit will end but for chance, ``std`` one standard deviation as an identification will
    state it, ``percent`` the same of ``value``, ``lowest_std`` what no estimate from the same test inputs falls below.
    """

    value: float
    unit: str
    expected: float
    std: float
    percent: float | None
    lowest_std: float
    cramer_rao_percent: float | None
    insensitivity_percent: float | None


class PredictedResponseDocument(Document):
    """Where a response will be usable, and how good it will be there: medians over its usable points."""

    band_rad_s: tuple[float, float] | None
    points: int
    coherence: float | None
    random_error: float | None


class PredictionDocument(Document):
    """What a plan will tell for a model; ``refused`` says why it could not support it.

    ``inflation`` is the factor on standard deviations that stands for a structure which does not fit what will fly.
    """

    model: str
    parameters: dict[str, PredictedParameterDocument] = Field(default_factory=dict)
    responses: dict[str, PredictedResponseDocument] = Field(default_factory=dict)
    inflation: float | None = None
    refused: str = ""
    findings: list[FindingDocument] = Field(default_factory=list)


class ShortestDocument(Document):
    """The least duration of each test input that reaches the accuracy asked for; ``null`` where none does."""

    model: str
    wanted_percent: dict[str, float]
    duration_s: float | None
    limiting: str
    words: str


class PlanSummaryDocument(Document):
    """A plan, what it reaches in the simulator, what it will tell, and the folder of its files."""

    kind: Shape
    folder: str
    duration_s: float
    inputs: list[TestInputDocument]
    reached: ReachedDocument
    predictions: list[PredictionDocument]
    shortest: list[ShortestDocument] = Field(default_factory=list)
    files: list[str] = Field(default_factory=list)


class DesignDocument(Document):
    """``design.json``: plans, what they will tell, and which of them tells most about each parameter (``best``)."""

    schema_name: Annotated[Literal["rotorid.design/1"], Field(alias="schema")] = "rotorid.design/1"
    vehicle: VehicleDocument
    limits: dict[str, float]
    plans: list[PlanSummaryDocument]
    best: dict[str, str] = Field(default_factory=dict)
    findings: list[FindingDocument] = Field(default_factory=list)
    provenance: ProvenanceDocument
