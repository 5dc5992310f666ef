"""``bench.json``, schema ``rotorid.bench/1``: errors of models on a public benchmark."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from rotorid.benchmarking.benchmark import Benchmarked
from rotorid.benchmarking.catalog import METRICS
from rotorid.documents.base import Document, FindingDocument, ProvenanceDocument
from rotorid.results.provenance import Refused
from rotorid.results.summary import finite
from rotorid.verification.multistep import QUANTITIES


class BenchRowDocument(Document):
    """One error of one model.

    ``source`` says where the number comes from: fitted here, naive, in the files, predictions of the user, or a paper
    with the flights that it used. ``std`` is one standard deviation between flights, ``null`` where it is not known.
    ``parameters`` are the free numbers of the model.
    """

    model: str
    source: str
    metric: str
    value: float | None
    std: float | None
    parameters: int | None


class StepsDocument(Document):
    """Mean errors of a model after each step: position as logged (m), velocity (m/s), attitude (rad), rates (rad/s)."""

    horizons_s: list[float]
    position: list[float | None]
    velocity: list[float | None]
    attitude: list[float | None]
    rates: list[float | None]


class BenchDocument(Document):
    """``bench.json``: models of rotorid, predictions of the user and published errors, one row an error.

    ``metrics`` gives the unit of each metric. ``steps`` holds the errors over 1 to 50 steps by model, where states are
    predicted. ``unfair`` says what makes rows less comparable than they look.
    """

    schema_name: Annotated[Literal["rotorid.bench/1"], Field(alias="schema")] = "rotorid.bench/1"
    benchmark: str = ""
    title: str = ""
    split: str = ""
    flights: list[str] = Field(default_factory=list)
    metrics: dict[str, str] = Field(default_factory=dict)
    rows: list[BenchRowDocument] = Field(default_factory=list)
    steps: dict[str, StepsDocument] = Field(default_factory=dict)
    unfair: list[str] = Field(default_factory=list)
    citation: str = ""
    license: str = ""
    address: str = ""
    findings: list[FindingDocument] = Field(default_factory=list)
    provenance: ProvenanceDocument


def bench_document(found: Benchmarked | Refused) -> BenchDocument:
    """The document of a benchmark; for a refusal only its findings."""
    common = {
        "findings": [FindingDocument.model_validate(finding) for finding in found.findings],
        "provenance": ProvenanceDocument.model_validate(found.provenance),
    }
    if isinstance(found, Refused):
        return BenchDocument.model_validate(common)
    benchmark = found.benchmark
    return BenchDocument.model_validate(
        {
            "benchmark": benchmark.name,
            "title": benchmark.title,
            "split": found.split,
            "flights": list(found.flights),
            "metrics": {metric.name: metric.unit for metric in METRICS[benchmark.kind]},
            "rows": [
                BenchRowDocument(
                    model=row.model,
                    source=row.source,
                    metric=row.metric,
                    value=finite(row.value),
                    std=None if row.std is None else finite(row.std),
                    parameters=row.parameters,
                )
                for row in found.rows
            ],
            "steps": {
                model: StepsDocument.model_validate(
                    {
                        "horizons_s": errors.horizons_s.tolist(),
                        **{name: [finite(value) for value in errors.model[name].tolist()] for name in QUANTITIES},
                    }
                )
                for model, errors in found.steps.items()
            },
            "unfair": list(benchmark.unfair),
            "citation": benchmark.citation,
            "license": benchmark.license,
            "address": benchmark.address,
            **common,
        }
    )
