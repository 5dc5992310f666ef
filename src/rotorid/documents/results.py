"""``results.json``, schema ``rotorid.results/1``: several models of the same logs."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer

from rotorid.documents.base import Document, FindingDocument, ProvenanceDocument
from rotorid.documents.result import ResultDocument, refused_document, result_document
from rotorid.pipeline.results import IdentifiedModel
from rotorid.pipeline.several import SeveralModels

RESULTS = "results.json"


class ResultsDocument(Document):
    """A result for each model that was asked for; one that was refused has its findings and no ``parameters``."""

    schema_name: Annotated[Literal["rotorid.results/1"], Field(alias="schema")] = "rotorid.results/1"
    results: list[ResultDocument]
    findings: list[FindingDocument] = Field(default_factory=list)
    provenance: ProvenanceDocument

    @model_serializer(mode="wrap")
    def _without_empty(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        written: dict[str, Any] = serialize(self)
        for result in written["results"]:
            if not result["parameters"]:
                del result["parameters"]
        return written


def results_document(models: SeveralModels) -> ResultsDocument:
    """Several models as ``results.json`` holds them, in the order in which they were asked for."""
    refusals = [one for answer in models.refused.values() for one in answer.findings if one.severity == "error"]
    return ResultsDocument(
        results=[
            result_document(answer) if isinstance(answer, IdentifiedModel) else refused_document(answer)
            for answer in models.values()
        ],
        findings=[FindingDocument.model_validate(finding) for finding in refusals],
        provenance=ProvenanceDocument.model_validate(models.provenance),
    )
