"""The document of a plan for a rig: ``design.json`` of ``rotorid design sweep --vehicle rig``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import Field

from rotorid.documents.base import Document, FindingDocument, ProvenanceDocument
from rotorid.flying.bench_designs import BenchDesign
from rotorid.results.provenance import Provenance
from rotorid.typing import Axis


class MotorSweepDocument(Document):
    """A sweep of a single motor."""

    axis: Axis
    motor: str
    amplitude: float
    unit: str
    start_s: float
    stop_s: float
    band_rad_s: tuple[float, float] | None


class ExpectedParameterDocument(Document):
    """A parameter of the rig, with the standard deviation that a log of the plan gives."""

    value: float
    std: float
    unit: str
    percent: float | None


class BenchDesignDocument(Document):
    """``design.json`` of a rig: sweeps of motors, the angle that they reach, and what they measure."""

    schema_name: Annotated[Literal["rotorid.design-bench/1"], Field(alias="schema")] = "rotorid.design-bench/1"
    vehicle: str
    limit_rad: float
    reached_rad: float
    duration_s: float
    sweeps: list[MotorSweepDocument]
    model: str
    expected: dict[str, ExpectedParameterDocument]
    files: list[str]
    findings: list[FindingDocument] = Field(default_factory=list)
    provenance: ProvenanceDocument


def bench_design_document(
    design: BenchDesign, *, files: Sequence[str], command: Sequence[str] = ()
) -> BenchDesignDocument:
    """What ``rotorid design`` writes for a rig.

    Parameters
    ----------
    design
        The plan, and what it reaches.
    files
        Names of the files in the same folder.
    """
    settings = design.settings
    provenance = Provenance(
        command=tuple(command),
        settings={"prior": settings.prior.source if settings.prior is not None else None},
        seed=settings.seed,
    )
    return BenchDesignDocument(
        vehicle=settings.source,
        limit_rad=settings.limit_rad,
        reached_rad=design.reached_rad,
        duration_s=design.plan.duration_s,
        sweeps=[
            MotorSweepDocument(
                axis=part.axis,
                motor=part.motor,
                amplitude=part.amplitude,
                unit=part.unit,
                start_s=part.start_s,
                stop_s=part.stop_s,
                band_rad_s=part.band_rad_s,
            )
            for part in design.plan.inputs
        ],
        model=design.model,
        expected={
            name: ExpectedParameterDocument(
                value=one.value,
                std=one.std,
                unit=one.unit,
                percent=100.0 * one.std / abs(one.value) if one.value else None,
            )
            for name, one in design.expected.items()
        },
        files=list(files),
        findings=[FindingDocument.model_validate(finding) for finding in design.findings],
        provenance=ProvenanceDocument.model_validate(provenance),
    )
