"""Results of ``identify`` that are to be compared: their documents, and their models with values."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from rotorid.data.immutable import Immutable
from rotorid.data.maneuver import Maneuver
from rotorid.data.record import FlightRecord
from rotorid.errors import UsageError
from rotorid.models.description import from_toml
from rotorid.models.structure import LinearStructure
from rotorid.pipeline.document import ResultDocument
from rotorid.pipeline.seen_data import fitted_logs, has_seen

RESULT, MODEL, SCHEMA = "result.json", "model.toml", "rotorid.result/1"

_WANTED = f"a folder that rotorid identify wrote, or its {RESULT}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Entry(Immutable):
    """One result.

    Parameters
    ----------
    label
        What it is called in the comparison.
    document
        What its ``result.json`` holds.
    structure
        The model with its values, ``None`` where no ``model.toml`` stands beside.
    sha256
        Hash of the ``result.json``.
    """

    label: str
    document: ResultDocument
    structure: LinearStructure | None
    sha256: str

    def has_seen(self, record: FlightRecord, maneuver: Maneuver) -> bool:
        """Whether any part of a maneuver was fitted, see :func:`rotorid.pipeline.seen_data.has_seen`."""
        return has_seen(self.document.provenance, record, maneuver)

    @cached_property
    def fitted_logs(self) -> frozenset[str]:
        """Hashes of the logs that it was fitted to."""
        return fitted_logs(self.document.provenance)


def read_results(paths: Sequence[Path]) -> tuple[Entry, ...]:
    """Read what ``identify`` wrote.

    Parameters
    ----------
    paths
        Folders, or ``result.json`` files; at least two different ones. The ``model.toml`` beside gives the model.

    Raises
    ------
    UsageError
        A path leads to no result, one came twice, or fewer than two came.
    ModelError
        A ``model.toml`` is wrong.
    """
    files = [path / RESULT if path.is_dir() else path for path in paths]
    if len(files) < 2:
        raise UsageError(f"{len(files)} result came to compare", needed="at least two", remedy="give another folder")
    for number, file in enumerate(files):
        if file.resolve() in [other.resolve() for other in files[:number]]:
            raise UsageError(f"{file} came twice", needed="each result once")
    return tuple(_read(file, label) for file, label in zip(files, _labels(files), strict=True))


def _labels(files: Sequence[Path]) -> list[str]:
    """Names of the folders, with as many of those above as it takes to tell them apart."""
    folders = [file.resolve().parent.parts for file in files]
    count = 1
    while len({parts[-count:] for parts in folders}) < len(folders) and count < max(map(len, folders)):
        count += 1
    labels = ["/".join(parts[-count:]) for parts in folders]
    # Two results in one folder differ by the names of their files.
    return [
        f"{label}/{file.name}" if labels.count(label) > 1 else label for label, file in zip(labels, files, strict=True)
    ]


def _read(file: Path, label: str) -> Entry:
    text = _text(file)
    document = _document(file, text)
    model = file.parent / MODEL
    structure = from_toml(_text(model), where=str(model)) if model.exists() else None
    if structure is not None and structure.name != document.model:
        raise UsageError(f"{model} holds {structure.name} and {file} {document.model}", needed="files of one result")
    return Entry(label=label, document=document, structure=structure, sha256=hashlib.sha256(text.encode()).hexdigest())


def _document(file: Path, text: str) -> ResultDocument:
    from pydantic import ValidationError

    try:
        table = json.loads(text)
    except ValueError as error:
        raise UsageError(f"{file} is no JSON: {error}", needed=_WANTED) from error
    schema = table.get("schema") if isinstance(table, dict) else None
    if schema != SCHEMA:
        came = f"has the schema {schema}" if isinstance(schema, str) else "names no schema"
        raise UsageError(f"{file} {came}", needed=f"a {RESULT} with the schema {SCHEMA}")
    try:
        document = ResultDocument.model_validate(table)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise UsageError(
            f"{file} does not fit its schema at {where}: {first['msg']}",
            needed=f"a {RESULT} of this version",
            remedy="identify anew",
        ) from error
    if not document.parameters:
        raise UsageError(f"{file} holds no model: its data did not support one", needed="results with parameters")
    return document


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is no UTF-8 text"
        raise UsageError(f"{path} cannot be read: {reason}", needed=_WANTED) from error
