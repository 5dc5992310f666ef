"""``flown.json``, schema ``rotorid.flown/1``: an identified model flown through logs or a plan, as a document."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from rotorid.documents.base import Document, FindingDocument, ProvenanceDocument
from rotorid.flying.flown_models import FlownModel
from rotorid.results.model import Refused
from rotorid.results.summary import ParameterEstimate
from rotorid.verification.verification import Scores

FLOWN, SIGNALS = "flown.json", "flown.npz"


class FlownFlightDocument(Document):
    """One flight: its place in the log, the number of restarts of the simulation, and scores of each output.

    ``signals`` is the prefix of its arrays in ``flown.npz``: ``time_s``, ``inputs``, ``measured``, ``simulated``,
    ``lower`` and ``upper``, with rows in the order of ``inputs`` and ``outputs``.
    """

    record: str
    start_s: float
    stop_s: float
    samples: int
    sample_rate_hz: float
    pieces: int
    inputs: list[str]
    outputs: list[str]
    scores: dict[str, Scores] = Field(default_factory=dict)
    signals: str


class FlownLogDocument(Document):
    """A log that was written: seed and number of its noise, and its deviation by output, ``assumed`` or known."""

    file: str
    seed: int
    run: int
    noise: dict[str, float]
    assumed: list[str] = Field(default_factory=list)


class FlownDocument(Document):
    """``flown.json``: a model simulated with the inputs of logs, with the measurement, or with those of a plan."""

    schema_name: Annotated[Literal["rotorid.flown/1"], Field(alias="schema")] = "rotorid.flown/1"
    model: str
    parameters: dict[str, ParameterEstimate] = Field(default_factory=dict)
    flights: list[FlownFlightDocument] = Field(default_factory=list)
    logs: list[FlownLogDocument] = Field(default_factory=list)
    findings: list[FindingDocument] = Field(default_factory=list)
    provenance: ProvenanceDocument


def flown_document(flown: FlownModel) -> FlownDocument:
    """The document of a flown model."""
    return FlownDocument(
        model=flown.model.name,
        parameters=dict(flown.model.parameters),
        flights=[
            FlownFlightDocument(
                record=stretch.record,
                start_s=stretch.maneuver.start_s,
                stop_s=stretch.maneuver.stop_s,
                samples=stretch.time_s.size,
                sample_rate_hz=stretch.sample_rate_hz,
                pieces=len(stretch.starts),
                inputs=list(stretch.input_names),
                outputs=list(stretch.output_names),
                scores=dict(stretch.scores),
                signals=f"flight_{number + 1}",
            )
            for number, stretch in enumerate(flown.stretches)
        ],
        logs=[
            FlownLogDocument(
                file=log.file, seed=log.seed, run=log.run, noise=dict(log.noise), assumed=list(log.assumed)
            )
            for log in flown.logs
        ],
        findings=[FindingDocument.model_validate(finding) for finding in flown.findings],
        provenance=ProvenanceDocument.model_validate(flown.provenance),
    )


def refused_flown_document(refused: Refused) -> FlownDocument:
    """The document of logs that a model cannot be simulated with: its findings give the reason."""
    return FlownDocument(
        model=refused.name,
        findings=[FindingDocument.model_validate(finding) for finding in refused.findings],
        provenance=ProvenanceDocument.model_validate(refused.provenance),
    )


def flown_arrays(flown: FlownModel) -> Mapping[str, np.ndarray]:
    """All signals, for ``flown.npz``."""
    kinds = ("time_s", "inputs", "measured", "simulated", "lower", "upper")
    return {
        f"flight_{number + 1}/{kind}": np.asarray(getattr(stretch, kind))
        for number, stretch in enumerate(flown.stretches)
        for kind in kinds
    }
