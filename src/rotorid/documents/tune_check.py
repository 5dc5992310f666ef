"""``check.json``, schema ``rotorid.tune_check/1``: a flight with new gains compared with its prediction."""

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
from rotorid.typing import AnyArray, LoopName

CHECK = "check.json"
_WANTED = f"a {TUNE} that rotorid tune wrote, or its folder"


class ComparedFigureDocument(Document):
    """A figure of a loop, ``rate`` or ``whole``, predicted and measured, and whether they agree (``inside``).

    ``method`` is how it was measured; a figure that is not ``decided`` is too uncertain for a verdict.
    """

    loop: Literal["rate", "whole"]
    name: str
    foretold: QuantityDocument
    measured: QuantityDocument
    inside: bool
    method: Literal["model", "injection", "setpoints"] = "model"
    decided: bool = True


METHODS = {"model": "plant and gains", "injection": "test signal", "setpoints": "set-points"}
"""How a figure was measured, for people."""


def compared_words(row: ComparedFigureDocument) -> str:
    """Whether a figure is as predicted, in a few words."""
    return ("as predicted" if row.inside else "outside") if row.decided else "not enough data"


class CheckedAxisDocument(Document):
    """An axis: which gains its log has, figures predicted and measured, the verdict, and what to do next.

    ``contradicted`` is true where what was measured without a model disagrees with the identified plant.
    """

    gains: Literal["proposed", "flown", "other"]
    verdict: Literal["as_foretold", "inside_limits", "worse", "cannot_tell", "other_gains"]
    contradicted: bool = False
    figures: list[ComparedFigureDocument]
    sentence: str
    advice: str


class TuneCheckDocument(Document):
    """``check.json``: how a flight compares with its prediction."""

    schema_name: Annotated[Literal["rotorid.tune_check/1"], Field(alias="schema")] = "rotorid.tune_check/1"
    as_foretold: bool = False
    axes: dict[LoopName, CheckedAxisDocument] = Field(default_factory=dict)
    findings: list[FindingDocument] = Field(default_factory=list)
    provenance: ProvenanceDocument


def tune_check_document(found: CheckedTuning) -> TuneCheckDocument:
    """The comparison as written to ``check.json``."""
    return TuneCheckDocument(
        as_foretold=found.as_foretold,
        axes={axis: _axis(checked) for axis, checked in found.axes.items()},
        findings=[FindingDocument.model_validate(finding) for finding in found.findings],
        provenance=ProvenanceDocument.model_validate(found.provenance),
    )


def refused_check_document(refused: Refused) -> TuneCheckDocument:
    """The document of flights that cannot be compared; its findings give the reasons."""
    return TuneCheckDocument(
        findings=[FindingDocument.model_validate(finding) for finding in refused.findings],
        provenance=ProvenanceDocument.model_validate(refused.provenance),
    )


def _axis(checked: CheckedAxis) -> CheckedAxisDocument:
    return CheckedAxisDocument.model_validate(
        {
            "gains": checked.gains,
            "verdict": checked.verdict,
            "contradicted": checked.contradicted,
            "figures": [ComparedFigureDocument.model_validate(figure) for figure in checked.figures],
            "sentence": checked.sentence,
            "advice": checked.advice,
        }
    )


def load_foretold(path: str | Path) -> dict[LoopName, Foretold]:
    """The prediction of a proposal, by axis and outer loop.

    Parameters
    ----------
    path
        The folder that ``rotorid tune`` wrote, or its ``tune.json``.

    Raises
    ------
    UsageError
        The path contains no proposal.
    """
    file = Path(path) / TUNE if Path(path).is_dir() else Path(path)
    text = documents.read_text(file, needed=_WANTED, most_bytes=documents.MOST_JSON_BYTES)
    try:
        table = documents.parse_json(text)
        schema = table.get("schema") if isinstance(table, dict) else None
        if schema != "rotorid.tune/1":
            came = f"has the schema {schema}" if isinstance(schema, str) else "has no schema"
            raise UsageError(f"{file} {came}", needed=_WANTED)
        document = checked(TuneDocument, table)
    except documents.DocumentError as error:
        raise UsageError(f"{file} is not a proposal: {error}", needed=_WANTED) from error
    signals_file = file.parent / SIGNALS
    arrays = read_arrays(signals_file) if signals_file.is_file() else {}
    expected = {axis: _foretold(axis, tuning, arrays) for axis, tuning in document.axes.items()}
    asked = document.provenance.settings.get("robustness")
    if isinstance(asked, (int, float)):
        expected = {axis: replace(foretold, robustness=float(asked)) for axis, foretold in expected.items()}
    return expected


def _foretold(axis: LoopName, tuning: AxisTuneDocument, arrays: Mapping[str, AnyArray]) -> Foretold:
    return Foretold(
        flown={name: gain.flown for name, gain in tuning.gains.items()},
        proposed={name: gain.proposed for name, gain in tuning.gains.items()},
        rate=_quantities(tuning.proposed),
        whole=_quantities(tuning.proposed_whole),
        omega_rad_s=arrays.get(f"{axis}/omega_rad_s"),
        loops=arrays.get(f"{axis}/loops/proposed_whole"),
    )


def _quantities(quantities: dict[str, QuantityDocument]) -> dict[str, Quantity]:
    return {
        name: Quantity(
            value=quantity.value, std=quantity.std, lower=quantity.lower, upper=quantity.upper, unit=quantity.unit
        )
        for name, quantity in quantities.items()
        if quantity.std is not None and quantity.lower is not None and quantity.upper is not None
    }
