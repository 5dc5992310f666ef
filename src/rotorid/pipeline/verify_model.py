"""A model that is to be judged: its structure, its values, and where it holds."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from rotorid.data.immutable import Immutable
from rotorid.errors import UsageError
from rotorid.models.description import from_toml
from rotorid.models.parameter import ParameterSet
from rotorid.models.state_space import StateSpace
from rotorid.models.structure import LinearStructure
from rotorid.pipeline.cutting import source_of
from rotorid.pipeline.document import ProvenanceDocument
from rotorid.pipeline.fitting import Fitted
from rotorid.pipeline.measure import Measured
from rotorid.pipeline.motor_choices import MODEL as MOTORS
from rotorid.pipeline.verify_controller import GivenController
from rotorid.typing import Axis

RESULT, MODEL = "result.json", "model.toml"


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidate(Immutable):
    """A model with all that judging it needs.

    Parameters
    ----------
    structure, parameters
        The model.
    band_rad_s
        Where it was fitted, or ``None`` when that is not known.
    sources
        Output to where it stood in the logs that were fitted; empty when that is not known.
    controllers
        Controllers that a person gave, to fly the model in closed loop; they go before the gains in a log.
    provenance
        Which data it was fitted to, or ``None`` when that is not known.
    """

    structure: LinearStructure
    parameters: ParameterSet
    band_rad_s: tuple[float, float] | None = None
    sources: Mapping[str, str] | None = None
    controllers: Mapping[Axis, GivenController] = field(default_factory=dict)
    provenance: ProvenanceDocument | None = None

    @property
    def system(self) -> StateSpace:
        """The model as numbers."""
        return self.structure.matrices(self.parameters.values)

    def system_of(self, outputs: Sequence[str]) -> StateSpace:
        """The model as numbers, with some of its outputs."""
        rows = [self.structure.outputs.index(name) for name in outputs]
        whole = self.system
        return replace(whole, H0=whole.H0[rows], H1=whole.H1[rows], output_delays_s=whole.output_delays_s[rows])


def candidate_of(fitted: Fitted, measured: Measured) -> Candidate:
    """A model that has just been fitted."""
    return Candidate(
        structure=fitted.structure,
        parameters=fitted.structure.parameters,
        band_rad_s=fitted.band_rad_s,
        sources=output_sources(measured),
    )


def output_sources(measured: Measured) -> dict[str, str]:
    """Output to where it stood in the first log."""
    return {name: source_of(measured.segments[0], name) for name in measured.response.outputs}


def read_candidate(result: Path) -> Candidate:
    """The model behind a result folder, a ``result.json`` or a ``model.toml``.

    Parameters
    ----------
    result
        A folder that ``identify`` wrote, or one of the two files. Of a ``result.json`` the ``model.toml`` next to it
        is read too.

    Raises
    ------
    UsageError
        There is no such model, the result is none of ``identify``, or it is one of ``physical.motors``, whose model
        does not say how its inputs are had from a log.
    ModelError
        The ``model.toml`` is wrong.
    """
    folder = result if result.is_dir() else result.parent
    model = result if result.suffix == ".toml" else folder / MODEL
    structure = from_toml(_text(model), where=model.name)
    if structure.name == MOTORS:
        raise motors_refused(str(result))
    document = folder / RESULT
    if result.suffix != ".toml" or document.exists():
        return _with_result(structure, document, required=result.suffix != ".toml")
    return Candidate(structure=structure, parameters=structure.parameters)


def motors_refused(which: str) -> UsageError:
    """Why a result of ``physical.motors`` is not scored on logs as other models are.

    Parameters
    ----------
    which
        The result.
    """
    return UsageError(
        f"{which} is a result of {MOTORS}, whose inputs are motors that identify makes ready from each log by itself",
        needed="a result of another model to score on a log",
        remedy=f"rotorid identify LOGS --model {MOTORS} --verify LOG judges it on unseen flights",
    )


def _with_result(structure: LinearStructure, path: Path, *, required: bool) -> Candidate:
    wanted = "a result.json with the schema rotorid.result/1, as identify writes it"
    try:
        table = json.loads(_text(path))
    except ValueError as error:
        raise UsageError(f"{path} is no JSON: {error}", needed=wanted) from error
    known = isinstance(table, dict) and table.get("schema") == "rotorid.result/1"
    if not known or table.get("model") != structure.name:
        if not required:
            return Candidate(structure=structure, parameters=structure.parameters)
        raise UsageError(f"{path} is not the result of the {MODEL} next to it", needed=wanted)
    pairs = (table.get("cost") or {}).get("pairs") or {}
    bands = [pair["band_rad_s"] for pair in pairs.values()]
    sources = (table.get("provenance") or {}).get("sources") or None
    return Candidate(
        structure=structure,
        parameters=structure.parameters,
        band_rad_s=(min(low for low, _ in bands), max(high for _, high in bands)) if bands else None,
        sources=sources,
        provenance=_provenance(table),
    )


def _provenance(table: Mapping[str, Any]) -> ProvenanceDocument | None:
    """Where a result came from; of one that was shortened by hand nothing is known."""
    from pydantic import ValidationError

    try:
        return ProvenanceDocument.model_validate(table.get("provenance"))
    except ValidationError:
        return None


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is no UTF-8 text"
        raise UsageError(
            f"{path} cannot be read: {reason}",
            needed="a folder that rotorid identify wrote, its result.json or a model.toml",
        ) from error
