"""``check.json``, schema ``rotorid.tune_check/1``: a flight with proposed gains beside what was foretold of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from rotorid.data.quantity import Quantity
from rotorid.documents.base import Document, FindingDocument, ProvenanceDocument, checked
from rotorid.documents.review import QuantityDocument
from rotorid.documents.tune import SIGNALS, TUNE, AxisTuneDocument, TuneDocument
from rotorid.errors import UsageError
from rotorid.io import documents
from rotorid.io.tables.npz import read_arrays
from rotorid.proposing.check import CheckedAxis, CheckedTuning, Foretold
from rotorid.results.model import Refused
from rotorid.typing import AnyArray, Axis

CHECK = "check.json"
_WANTED = f"a {TUNE} that rotorid tune wrote, or its folder"


class ComparedFigureDocument(Document):
    """A figure of a loop, ``rate`` or ``whole``: foretold, measured, and whether the second is what the first said.

    ``method`` is how it was measured; a figure that is not ``decided`` is known too badly to say anything.
    """

    loop: Literal["rate", "whole"]
    name: str
    foretold: QuantityDocument
    measured: QuantityDocument
    inside: bool
    method: Literal["model", "injection"] = "model"
    decided: bool = True


METHODS = {"model": "plant and gains", "injection": "test signal"}
"""How a figure was measured, for people."""


def compared_words(row: ComparedFigureDocument) -> str:
    """Whether a figure is what was foretold, in a word or two."""
    return ("as foretold" if row.inside else "outside") if row.decided else "not enough data"


class CheckedAxisDocument(Document):
    """An axis: which gains its log has, figures foretold and measured, the verdict, and what to do next.

    ``contradicted`` where the test signal at the mixer shows another loop than the identified plant does.
    """

    gains: Literal["proposed", "flown", "other"]
    verdict: Literal["as_foretold", "inside_limits", "worse", "cannot_tell", "other_gains"]
    contradicted: bool = False
    figures: list[ComparedFigureDocument]
    sentence: str
    advice: str


class TuneCheckDocument(Document):
    """``check.json``: what came of a proposal."""

    schema_name: Annotated[Literal["rotorid.tune_check/1"], Field(alias="schema")] = "rotorid.tune_check/1"
    as_foretold: bool = False
    axes: dict[Axis, CheckedAxisDocument] = Field(default_factory=dict)
    findings: list[FindingDocument] = Field(default_factory=list)
    provenance: ProvenanceDocument


def tune_check_document(found: CheckedTuning) -> TuneCheckDocument:
    """What came of a proposal, as ``check.json`` holds it."""
    return TuneCheckDocument(
        as_foretold=found.as_foretold,
        axes={axis: _axis(one) for axis, one in found.axes.items()},
        findings=[FindingDocument.model_validate(finding) for finding in found.findings],
        provenance=ProvenanceDocument.model_validate(found.provenance),
    )


def refused_check_document(refused: Refused) -> TuneCheckDocument:
    """The document of flights that say nothing of the proposal: its findings say why."""
    return TuneCheckDocument(
        findings=[FindingDocument.model_validate(finding) for finding in refused.findings],
        provenance=ProvenanceDocument.model_validate(refused.provenance),
    )


def _axis(one: CheckedAxis) -> CheckedAxisDocument:
    return CheckedAxisDocument.model_validate(
        {
            "gains": one.gains,
            "verdict": one.verdict,
            "contradicted": one.contradicted,
            "figures": [ComparedFigureDocument.model_validate(figure) for figure in one.figures],
            "sentence": one.sentence,
            "advice": one.advice,
        }
    )


def load_foretold(path: str | Path) -> dict[Axis, Foretold]:
    """What a proposal said of every axis.

    Parameters
    ----------
    path
        The folder that ``rotorid tune`` wrote, or its ``tune.json``.

    Raises
    ------
    UsageError
        The path leads to no proposal.
    """
    file = Path(path) / TUNE if Path(path).is_dir() else Path(path)
    text = documents.read_text(file, needed=_WANTED, most_bytes=documents.MOST_JSON_BYTES)
    try:
        table = documents.parse_json(text)
        schema = table.get("schema") if isinstance(table, dict) else None
        if schema != "rotorid.tune/1":
            came = f"has the schema {schema}" if isinstance(schema, str) else "names no schema"
            raise UsageError(f"{file} {came}", needed=_WANTED)
        document = checked(TuneDocument, table)
    except documents.DocumentError as error:
        raise UsageError(f"{file} is no proposal: {error}", needed=_WANTED) from error
    beside = file.parent / SIGNALS
    arrays = read_arrays(beside) if beside.is_file() else {}
    told = {axis: _foretold(axis, one, arrays) for axis, one in document.axes.items()}
    asked = document.provenance.settings.get("robustness")
    if isinstance(asked, (int, float)):
        told = {axis: replace(one, robustness=float(asked)) for axis, one in told.items()}
    return told


def _foretold(axis: Axis, one: AxisTuneDocument, arrays: Mapping[str, AnyArray]) -> Foretold:
    return Foretold(
        flown={name: gain.flown for name, gain in one.gains.items()},
        proposed={name: gain.proposed for name, gain in one.gains.items()},
        rate=_quantities(one.proposed),
        whole=_quantities(one.proposed_whole),
        omega_rad_s=arrays.get(f"{axis}/omega_rad_s"),
        loops=arrays.get(f"{axis}/loops/proposed_whole"),
    )


def _quantities(told: dict[str, QuantityDocument]) -> dict[str, Quantity]:
    return {
        name: Quantity(value=one.value, std=one.std, lower=one.lower, upper=one.upper, unit=one.unit)
        for name, one in told.items()
        if one.std is not None and one.lower is not None and one.upper is not None
    }
