"""What one run of ``identify`` hands on: the document, and the arrays that the pictures need."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.data.record import Maneuver, TimeHistory
from rotorid.data.response import FrequencyResponse
from rotorid.documents.result import ResultDocument
from rotorid.pipeline.frequency_check import FrequencyCheck
from rotorid.typing import BoolArray, ComplexArray, FloatArray
from rotorid.verification.verification import Verification


@dataclass(frozen=True, kw_only=True, eq=False)
class Segment:
    """A maneuver with the data around it, on one clock."""

    record: str
    maneuver: Maneuver
    history: TimeHistory


@dataclass(frozen=True, kw_only=True, eq=False)
class SimulatedRecord(Immutable):
    """A fitted stretch of a record with what the model makes of its inputs, for time-domain fits.

    Parameters
    ----------
    record
        Name of the file.
    maneuver
        What was flown.
    time_s
        Stamps on the log's own clock, shape ``(samples,)``.
    inputs
        Shape ``(u, samples)``, as differences from their mean.
    measured, simulated
        Outputs, shape ``(y, samples)``; initial state and trim of the simulation were estimated.
    starts
        Samples at which the simulation began anew, the first included.
    """

    record: str
    maneuver: Maneuver
    time_s: FloatArray
    inputs: FloatArray
    measured: FloatArray
    simulated: FloatArray
    starts: tuple[int, ...] = (0,)

    def __post_init__(self) -> None:
        self._set(
            time_s=read_only(self.time_s, np.float64, ndim=1),
            inputs=read_only(self.inputs, np.float64, ndim=2),
            measured=read_only(self.measured, np.float64, ndim=2),
            simulated=read_only(self.simulated, np.float64, ndim=2),
            starts=tuple(self.starts),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Identification:
    """A finished identification.

    Parameters
    ----------
    document
        What ``result.json`` holds.
    model_toml
        The structure with the identified values, as text.
    response
        The measured response that was fitted; beside a time-domain fit that of the same data, without any frequency
        where it could not be measured.
    beside
        The direct estimate, when ``response`` is a joint one.
    model_response
        The model on the same grid, shape ``(y, u, f)``; the exact response, delays included.
    fitted
        Points that entered the fit, shape ``(y, u, f)``.
    segments
        The maneuvers that were used, with their data.
    verifications
        Unseen maneuvers, measured and predicted.
    judged
        Responses of unseen sweeps, measured and of the model.
    least_coherence
        Coherence below which points were left out.
    simulated
        What a time-domain fit was made to: every record, measured and simulated.
    """

    document: ResultDocument
    model_toml: str
    response: FrequencyResponse
    beside: FrequencyResponse | None
    model_response: ComplexArray
    fitted: BoolArray
    segments: tuple[Segment, ...]
    verifications: tuple[Verification, ...]
    judged: tuple[FrequencyCheck, ...] = ()
    least_coherence: float = 0.6
    simulated: tuple[SimulatedRecord, ...] = ()
