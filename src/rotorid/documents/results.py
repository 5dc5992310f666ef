"""``results.json``, schema ``rotorid.results/1``: several models of the same logs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer

from rotorid.documents.base import Document, FindingDocument, ProvenanceDocument
from rotorid.documents.result import (
    RESULT,
    ResultDocument,
    load,
    read_result,
    read_text,
    refused_document,
    result_document,
)
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.identifying.identify_many import SeveralModels
from rotorid.results.model import IdentifiedModel

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
    refusals = [
        finding for answer in models.refused.values() for finding in answer.findings if finding.severity == "error"
    ]
    return ResultsDocument(
        results=[
            result_document(answer) if isinstance(answer, IdentifiedModel) else refused_document(answer)
            for answer in models.values()
        ],
        findings=[FindingDocument.model_validate(finding) for finding in refusals],
        provenance=ProvenanceDocument.model_validate(models.provenance),
    )


def refused_results(models: SeveralModels, error: InsufficientDataError) -> ResultsDocument:
    """Several models of which none could be identified, with what each lacks; unsupported models are no results."""
    findings = [FindingDocument.model_validate(finding) for finding in error.findings]
    return results_document(models).model_copy(update={"findings": findings})


def is_result(path: Path) -> bool:
    """Whether a path is that of a result of ``identify``, or of several, and not of a log."""
    return any((path / name).is_file() for name in ("result.json", "results.json")) or path.suffix == ".json"


def load_results(paths: Sequence[str | Path]) -> list[IdentifiedModel]:
    """Read the models of several results, in their order.

    Parameters
    ----------
    paths
        Folders that ``identify`` wrote, of one model or of several, or the ``result.json`` or ``results.json`` in them.
        Of several models the identified ones are read.

    Raises
    ------
    UsageError
        A path leads to no result, or to none with a model.
    """
    return [load(file) for path in paths for file in result_files(Path(path))]


def result_files(path: Path) -> list[Path]:
    """The ``result.json`` of each model behind a path: of several models the identified ones, in their order.

    Parameters
    ----------
    path
        As in :func:`load_results`.

    Raises
    ------
    UsageError
        Of several models none is identified, or the folder of one is missing.
    """
    folder = path if path.is_dir() else path.parent
    several = path.name == RESULTS if path.is_file() else (folder / RESULTS).is_file()
    if not several:
        return [path / RESULT if path.is_dir() else path]
    table = _table(folder / RESULTS)
    standing = [str(row.get("model")) for row in table if isinstance(row, dict) and row.get("parameters")]
    if not standing:
        raise UsageError(f"{path} has no model: not enough data", needed="results with parameters")
    files = {read_result(file, read_text(file)).model: file for file in sorted(folder.glob(f"*/{RESULT}"))}
    missing = [name for name in standing if name not in files]
    if missing:
        raise UsageError(f"the folder of {missing[0]} is not in {path}", needed="all folders that identify wrote")
    return [files[name] for name in standing]


def _table(file: Path) -> list[Any]:
    from rotorid.io import documents

    needed = f"a {RESULTS} that rotorid identify wrote"
    try:
        read = documents.parse_json(documents.read_text(file, needed=needed, most_bytes=documents.MOST_JSON_BYTES))
    except documents.DocumentError as error:
        raise UsageError(f"{file} is no JSON: {error}", needed=needed) from error
    results = read.get("results") if isinstance(read, dict) else None
    if not isinstance(results, list) or read.get("schema") != "rotorid.results/1":
        raise UsageError(f"{file} is no {RESULTS}", needed=needed)
    return results
