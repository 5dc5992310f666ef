"""The documents that commands write: typed, so that their JSON schemas come from the code."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

Status = Literal["free", "fixed", "tied", "dropped"]


class Document(BaseModel):
    """Base of all documents: immutable, no unknown fields, numbers finite or ``null``."""

    model_config = ConfigDict(frozen=True, extra="forbid", ser_json_inf_nan="null", populate_by_name=True)


class FindingDocument(Document):
    """An engineer's remark."""

    kind: str
    severity: Literal["info", "warning", "error"]
    where: str
    message: str
    numbers: dict[str, float] = Field(default_factory=dict)


class ParameterDocument(Document):
    """One parameter with its uncertainty; percents are CIFER's, ``std`` covers random errors, not a wrong structure."""

    value: float
    unit: str
    std: float | None = None
    cramer_rao_percent: float | None = None
    insensitivity_percent: float | None = None
    status: Status


class PairCost(Document):
    """Cost of one response."""

    value: float
    band_rad_s: tuple[float, float]
    points: int


class CostDocument(Document):
    """Frequency-domain cost: the average, and each response on its own."""

    average: float
    pairs: dict[str, PairCost]


class DelaysDocument(Document):
    """Delays of inputs and outputs in seconds, in the order of the names."""

    inputs: list[float]
    outputs: list[float]


class MatricesDocument(Document):
    """Matrices of ``M x' = F x + G u(t - tau)``, ``y = H0 x + H1 x'`` at the identified values."""

    M: list[list[float]]
    F: list[list[float]]
    G: list[list[float]]
    H0: list[list[float]]
    H1: list[list[float]]
    delays_s: DelaysDocument


class PoleDocument(Document):
    """An eigenvalue of the model."""

    real: float
    imag: float
    damping: float
    frequency_rad_s: float


class ScoreDocument(Document):
    """How one output of the model predicts one unseen record."""

    nrmse_fit_percent: float
    tic: float
    rms: float
    bias: float
    reference_shift: float


class VerificationDocument(Document):
    """Scores per unseen record and output, and costs of responses on unseen sweeps."""

    records: dict[str, dict[str, ScoreDocument]] = Field(default_factory=dict)
    frequency: dict[str, float] = Field(default_factory=dict)


class CombinationDocument(Document):
    """Parameters that the data cannot tell apart, in words and as a vector over parameter names."""

    words: str
    vector: dict[str, float]


class ManeuverDocument(Document):
    """An excited interval on the log's own clock."""

    record: str
    axis: str
    kind: str
    start_s: float
    stop_s: float
    band_rad_s: tuple[float, float] | None = None
    origin: str
    signal: str


class ProvenanceDocument(Document):
    """Where the result came from: enough to make it again."""

    version: str
    command: list[str]
    inputs: dict[str, str]
    settings: dict[str, str | int | float | bool | list[str] | list[float] | None]
    seed: int
    estimate: Literal["direct", "joint"] | None = None
    instruments: list[str] = Field(default_factory=list)
    maneuvers: list[ManeuverDocument] = Field(default_factory=list)


class ResultDocument(Document):
    """``result.json``: everything that an identification answers."""

    schema_name: Annotated[Literal["rotorid.result/1"], Field(alias="schema")] = "rotorid.result/1"
    model: str
    inputs: list[str]
    outputs: list[str]
    states: list[str]
    parameters: dict[str, ParameterDocument] = Field(default_factory=dict)
    cost: CostDocument | None = None
    fit_percent: dict[str, float] | None = None
    matrices: MatricesDocument | None = None
    poles: list[PoleDocument] = Field(default_factory=list)
    verification: VerificationDocument = Field(default_factory=VerificationDocument)
    identifiability: list[CombinationDocument] = Field(default_factory=list)
    findings: list[FindingDocument] = Field(default_factory=list)
    provenance: ProvenanceDocument
