"""``export.json``, schema ``rotorid.export/1``: what of a vehicle went to another tool, and what came back of it.

``rotorid.models/1`` is the vehicle itself for tools that read JSON: its numbers, and every model with its covariance.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from rotorid.documents.base import Document, FindingDocument
from rotorid.documents.result import MatricesDocument, matrices_document
from rotorid.results.summary import ParameterEstimate, PoleEstimate

if TYPE_CHECKING:
    from rotorid.flying.vehicle_from_results import JoinedVehicle
    from rotorid.flying.vehicle_numbers import VehicleNumber
    from rotorid.results.model import IdentifiedModel


class NumberDocument(Document):
    """A number of a vehicle, and where it comes from."""

    value: float
    unit: str
    source: Literal["identified", "given", "derived", "default"]
    std: float | None = None
    of: str = ""


class FileDocument(Document):
    """A file that was written."""

    name: str
    sha256: str


class ComparedDocument(Document):
    """A quantity as it was identified, with one standard deviation, and as the target's equations have it at hover."""

    name: str
    unit: str
    identified: float
    exported: float
    difference_percent: float | None
    held: Literal["exact", "approximated", "not"]
    identified_std: float | None = None


class KeptDelaysDocument(Document):
    """Delays of a model: the longest, how they are exported, and the phase error of their Padé approximations."""

    longest_s: float
    kept: Literal["states", "lag", "none"]
    pade_order: int | None = None
    phase_error_deg: float | None = None
    up_to_rad_s: float | None = None


class DrawsDocument(Document):
    """Vehicles drawn from the covariance, in ``draws``; ``redrawn`` draws were none.

    Each has a folder, or all are in one file, which the lines of ``start`` load.
    """

    count: int
    seed: int
    redrawn: int
    start: str = ""


class ExportDocument(Document):
    """``export.json``: target, files, the round trip, where every number comes from, and what was left out.

    ``pade_order`` is the highest of the models; ``delays`` has that of each.
    """

    schema_name: Annotated[Literal["rotorid.export/1"], Field(alias="schema")] = "rotorid.export/1"
    target: str
    name: str
    results: list[str]
    delay: Literal["states", "lag", "none"]
    pade_order: int | None = None
    delays: dict[str, KeptDelaysDocument] = Field(default_factory=dict)
    sample_rate_hz: float | None = None
    files: list[FileDocument]
    quantities: list[ComparedDocument]
    numbers: dict[str, NumberDocument]
    given: dict[str, NumberDocument]
    defaults: dict[str, NumberDocument]
    left_out: list[str]
    draws: DrawsDocument | None = None
    start: str
    findings: list[FindingDocument] = Field(default_factory=list)
    command: list[str] = Field(default_factory=list)


class CovarianceDocument(Document):
    """Covariance of the free parameters, in the order of the names and in their units."""

    names: list[str]
    matrix: list[list[float]]


class StateSpaceDocument(Document):
    """The model, delays as states by default: ``x' = A x + B u``, or the next sample, and ``y = C x + D u``."""

    sample_time_s: float | None = None
    states: list[str]
    A: list[list[float]]
    B: list[list[float]]
    C: list[list[float]]
    D: list[list[float]]


class ModelDocument(Document):
    """A model: parameters, covariance, matrices."""

    model: str
    logs: list[str]
    inputs: list[str]
    outputs: list[str]
    states: list[str]
    parameters: dict[str, ParameterEstimate]
    covariance: CovarianceDocument
    matrices: MatricesDocument
    state_space: StateSpaceDocument | None = None
    poles: list[PoleEstimate] = Field(default_factory=list)


class ModelsDocument(Document):
    """A vehicle: its numbers, its rotors, and the models that they come from."""

    schema_name: Annotated[Literal["rotorid.models/1"], Field(alias="schema")] = "rotorid.models/1"
    name: str
    numbers: dict[str, NumberDocument]
    rotors_m: list[list[float]] | None = None
    spins: list[float] | None = None
    models: list[ModelDocument]


def number_documents(numbers: Mapping[str, VehicleNumber]) -> dict[str, NumberDocument]:
    """Numbers of a vehicle as a document holds them."""
    return {name: NumberDocument.model_validate(number) for name, number in numbers.items()}


def file_documents(files: Mapping[str, str | bytes]) -> list[FileDocument]:
    """Names and hashes of files."""
    return [
        FileDocument(name=name, sha256=hashlib.sha256(text if isinstance(text, bytes) else text.encode()).hexdigest())
        for name, text in sorted(files.items())
    ]


def model_document(model: IdentifiedModel, state_space: StateSpaceDocument | None = None) -> ModelDocument:
    """A model with its covariance."""
    structure = model.structure
    return ModelDocument(
        model=structure.name,
        logs=list(model.provenance.inputs),
        inputs=list(structure.inputs),
        outputs=list(structure.outputs),
        states=list(structure.states),
        parameters=dict(model.parameters),
        covariance=CovarianceDocument(names=list(model.bounds.names), matrix=model.bounds.covariance.tolist()),
        matrices=matrices_document(model.system),
        state_space=state_space,
        poles=list(model.pole_estimates),
    )


def models_document(vehicle: JoinedVehicle, models: Sequence[ModelDocument]) -> ModelsDocument:
    """A vehicle and its models."""
    body = vehicle.multirotor
    layout = None if body is None else body.rotors.layout
    return ModelsDocument(
        name=vehicle.name,
        numbers=number_documents(vehicle.numbers),
        rotors_m=None if layout is None else layout.positions.tolist(),
        spins=None if layout is None else layout.spins.tolist(),
        models=list(models),
    )
