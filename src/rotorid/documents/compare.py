"""What ``compare.json`` holds, schema ``rotorid.compare/1``."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from rotorid.documents.base import Document
from rotorid.documents.result import (
    DelayDocument,
    FindingDocument,
    FrozenScoreDocument,
    PoleDocument,
    ProvenanceDocument,
    Status,
)
from rotorid.verification.fixed_parameters import Kind


class CrossValidatedDocument(Document):
    """Summary of the cross-validation of one result: mean of unseen scores, and their standard deviation."""

    kind: Kind
    mean_percent: float | None
    spread_percent: float | None
    best_percent: float | None = None
    horizon_s: float | None = None


class OnLogsDocument(Document):
    """Mean fit on the maneuvers that count, and its standard deviation over them; the same ones for all models.

    ``seen`` says whether any model was identified on one of them; then the comparison flatters that model.
    """

    mean_percent: float
    spread_percent: float | None
    maneuvers: int
    seen: bool


class ComparedModelDocument(Document):
    """One result as a row of the comparison."""

    label: str
    model: str
    method: str
    inputs: list[str]
    outputs: list[str]
    order: int
    free_parameters: int
    fit_percent: dict[str, float] | None = None
    cross_validation: CrossValidatedDocument | None = None
    on_logs: OnLogsDocument | None = None
    cost: float | None = None
    aic: float | None = None
    bic: float | None = None
    poles: list[PoleDocument] = Field(default_factory=list)
    delays: dict[str, DelayDocument] = Field(default_factory=dict)


class ComparedValueDocument(Document):
    """A parameter of one result.

    ``z`` is its difference from that of the first result that has it, over the standard deviation of a difference of
    independent estimates. Results that were fitted to a log in common are not independent: between them it is ``null``.
    """

    value: float
    std: float | None
    status: Status
    z: float | None = None


class ComparedParameterDocument(Document):
    """A parameter that results share by name and unit, by the label of the result."""

    unit: str
    values: dict[str, ComparedValueDocument]


class ComparedScoreDocument(Document):
    """One model on one maneuver; ``mean_percent`` is over the outputs that all models have in common."""

    seen: bool
    mean_percent: float | None
    scores: dict[str, FrozenScoreDocument]


class ComparedManeuverDocument(Document):
    """One maneuver of a log, on which every model was scored with frozen parameters, by the label of the result."""

    record: str
    axis: str
    kind: str
    start_s: float
    stop_s: float
    models: dict[str, ComparedScoreDocument]


class CompareDocument(Document):
    """``compare.json``: several models or methods side by side.

    ``common_outputs`` are those over which means on logs are taken. ``horizon_s`` is ``null`` where the maneuvers were
    simulated whole; with an unstable model among them, all were predicted so far ahead, from every sample.
    ``band_rad_s`` is what was looked at: that in which all models of frequency responses were fitted, ``null`` for all.
    With both, records passed a filter without phase before they were predicted, which shows a prediction a little of
    what comes: such scores compare models, and are higher than those of a prediction in flight.
    """

    schema_name: Annotated[Literal["rotorid.compare/1"], Field(alias="schema")] = "rotorid.compare/1"
    models: list[ComparedModelDocument]
    parameters: dict[str, ComparedParameterDocument] = Field(default_factory=dict)
    maneuvers: list[ComparedManeuverDocument] = Field(default_factory=list)
    common_outputs: list[str] = Field(default_factory=list)
    horizon_s: float | None = None
    band_rad_s: tuple[float, float] | None = None
    findings: list[FindingDocument] = Field(default_factory=list)
    provenance: ProvenanceDocument
