"""A model to be judged: structure, values, the fitted band, and where its outputs stood in the logs.

It comes from a fit that has just ended, from an identified model, or from the files of a result.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from rotorid.checking.flight import FlightPredictor, identified_flight, known_flight
from rotorid.checking.motors import MotorPredictor, identified_motors, known_motors
from rotorid.data.base import Immutable
from rotorid.errors import UsageError
from rotorid.flights.measure import Measured
from rotorid.flights.segments import source_of
from rotorid.io.documents import MOST_JSON_BYTES, DocumentError, parse_json, read_text
from rotorid.models.families import family_of
from rotorid.models.nonlinear import NonlinearStructure, linear_of
from rotorid.models.state_space import StateSpace
from rotorid.models.structure import LinearStructure
from rotorid.models.toml import structure_from_toml
from rotorid.results.model import IdentifiedModel
from rotorid.results.provenance import LoggedManeuver, Provenance
from rotorid.settings.given_controllers import GivenController
from rotorid.typing import Axis

RESULT, RESULTS, MODEL = "result.json", "results.json", "model.toml"

UNFILTERED = " without its known filters"
"""Suffix of the source of an output whose known filters were removed before the fit."""

_SAME_VALUE = 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidate(Immutable):
    """A model with all that judging it needs.

    Parameters
    ----------
    structure
        The model with its values.
    band_rad_s
        Where it was fitted, or ``None`` when that is not known.
    sources
        Output to where it stood in the logs that were fitted; empty when that is not known.
    controllers
        Controllers that a person gave, to fly the model in closed loop; they go before the gains in a log.
    provenance
        Which data it was fitted to, or ``None`` when that is not known.
    usual
        Motion of each output in the maneuvers that were fitted, see
        :func:`rotorid.checking.maneuvers.excited_outputs`; empty when that is not known.
    motors
        The vehicle, of a result of ``physical.motors``; the structure is then its motion around hover.
    flight
        The vehicle with its air, of a result of ``physical.flight``; the structure is then its motion around hover.
    nonlinear
        The equations with their values, of a nonlinear model; the structure is then its small motion about rest.
    """

    structure: LinearStructure
    band_rad_s: tuple[float, float] | None = None
    sources: Mapping[str, str] | None = None
    controllers: Mapping[Axis, GivenController] = field(default_factory=dict)
    provenance: Provenance | None = None
    usual: Mapping[str, float] = field(default_factory=dict)
    motors: MotorPredictor | None = None
    flight: FlightPredictor | None = None
    nonlinear: NonlinearStructure | None = None

    @property
    def system(self) -> StateSpace:
        """The model as numbers."""
        return self.structure.matrices(self.structure.parameters.values)

    def system_of(self, outputs: Sequence[str]) -> StateSpace:
        """The model as numbers, with some of its outputs."""
        rows = [self.structure.outputs.index(name) for name in outputs]
        whole = self.system
        return replace(whole, H0=whole.H0[rows], H1=whole.H1[rows], output_delays_s=whole.output_delays_s[rows])


def candidate_model(model: IdentifiedModel) -> Candidate:
    """An identified model, to be judged on further logs."""
    return Candidate(
        structure=model.structure,
        band_rad_s=model.band_rad_s,
        sources=model.provenance.sources or None,
        provenance=model.provenance,
        motors=identified_motors(model),
        flight=identified_flight(model),
        nonlinear=model.nonlinear,
    )


def output_sources(measured: Measured) -> dict[str, str]:
    """Source of each output in the first log that has it."""
    sources: dict[str, str] = {}
    for name in measured.response.outputs:
        segments = [segment for segment in measured.segments if name in segment.history.names]
        if segments:
            sources[name] = source_of(segments[0], name) + (UNFILTERED if name in measured.unfiltered else "")
    return sources


_RESULT_FILES = "a folder written by rotorid identify, its result.json or a model.toml"


def read_candidate(result: Path) -> Candidate:
    """The model behind a result folder, a ``result.json`` or a ``model.toml``.

    Parameters
    ----------
    result
        A folder that ``identify`` wrote, or one of the two files. Of a ``result.json``, whatever it is called, the
        ``model.toml`` next to it is read too, and has to hold its values.

    Raises
    ------
    UsageError
        There is no such model, or several, the result is none of ``identify``, or it is a ``model.toml`` of
        ``physical.motors`` alone, which does not say how its inputs are had from a log.
    ModelError
        The ``model.toml`` is wrong.
    """
    if not result.exists():
        raise UsageError(f"{result} does not exist", needed=_RESULT_FILES)
    folder = result if result.is_dir() else result.parent
    model = result if result.suffix == ".toml" else folder / MODEL
    if result.is_file() and result.suffix not in (".toml", ".json"):
        raise UsageError(
            f"{result.name} is not a result",
            needed=_RESULT_FILES,
            remedy="identify a model first, and give its folder before the logs",
        )
    if not model.exists() and (folder / RESULTS).exists():
        available = ", ".join(sorted(path.parent.name for path in folder.glob(f"*/{MODEL}")))
        raise UsageError(
            f"{result.name} contains several models",
            needed=f"one of its folders: {available}",
            remedy="name it after the folder",
        )
    read = structure_from_toml(read_text(model, needed=_RESULT_FILES), where=model.name)
    nonlinear = read if isinstance(read, NonlinearStructure) else None
    structure = linear_of(read) if isinstance(read, NonlinearStructure) else read
    document = result if result.suffix == ".json" else folder / RESULT
    if family_of(structure).needs_result and not document.exists():
        raise UsageError(
            f"{result} is only the {MODEL} of {structure.name}, without its motor settings",
            needed=f"its {RESULT} next to it",
            remedy="give the folder that identify wrote",
        )
    if result.suffix != ".toml" or document.exists():
        found = _with_result(structure, document, required=result.suffix != ".toml")
        return replace(found, nonlinear=nonlinear)
    return Candidate(structure=structure, nonlinear=nonlinear)


def _with_result(structure: LinearStructure, path: Path, *, required: bool) -> Candidate:
    wanted = "a result.json with the schema rotorid.result/1, written by identify"
    try:
        table = parse_json(read_text(path, needed=_RESULT_FILES, most_bytes=MOST_JSON_BYTES))
    except DocumentError as error:
        raise UsageError(f"{path} is not valid JSON: {error}", needed=wanted) from error
    known = isinstance(table, dict) and table.get("schema") == "rotorid.result/1"
    if not known or table.get("model") != structure.name:
        if not required:
            return Candidate(structure=structure)
        raise UsageError(f"{path} is not the result of the {MODEL} next to it", needed=wanted)
    try:
        return _of_table(structure, path, table, required=required)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise UsageError(f"{path} has parts of another kind than a result", needed=wanted) from error


def _of_table(structure: LinearStructure, path: Path, table: Mapping[str, Any], *, required: bool) -> Candidate:
    """The model with what its result says; an error of Python where a part is of another kind."""
    if required and not _holds_values(structure, table):
        raise UsageError(f"the {MODEL} next to {path} has other values", needed="both as written by identify")
    pairs = (table.get("cost") or {}).get("pairs") or {}
    bands = [(float(low), float(high)) for low, high in (pair["band_rad_s"] for pair in pairs.values())]
    sources = (table.get("provenance") or {}).get("sources") or None
    family = family_of(structure)
    needs = family.needs if family.needs_result else ""
    return Candidate(
        structure=structure,
        band_rad_s=(min(low for low, _ in bands), max(high for _, high in bands)) if bands else None,
        sources=sources,
        provenance=_provenance(table),
        motors=known_motors(table) if needs == "motors" else None,
        flight=known_flight(table) if needs == "flight" else None,
    )


def _holds_values(structure: LinearStructure, table: Mapping[str, Any]) -> bool:
    """Whether the values of a model are those of a result, where the result has them."""
    numbers = {
        name: entry["value"]
        for name, entry in (table.get("parameters") or {}).items()
        if isinstance(entry, Mapping) and isinstance(entry.get("value"), int | float)
    }
    values = structure.parameters.values
    return all(math.isclose(values[name], numbers[name], rel_tol=_SAME_VALUE) for name in numbers if name in values)


def _provenance(table: Mapping[str, Any]) -> Provenance | None:
    """Provenance of a result; empty for one shortened by hand."""
    try:
        provenance = dict(table["provenance"])
        maneuvers = tuple(
            LoggedManeuver(**{**maneuver, "band_rad_s": maneuver["band_rad_s"] and tuple(maneuver["band_rad_s"])})
            for maneuver in provenance.pop("maneuvers")
        )
        return Provenance(**provenance, maneuvers=maneuvers)
    except (KeyError, TypeError, ValueError):
        return None
