"""The document that ``rotorid response`` writes, and how numbers become it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from rotorid.data.record import STANDARD_UNITS
from rotorid.data.response import FrequencyResponse
from rotorid.documents.base import Document
from rotorid.documents.result import FindingDocument, ManeuverDocument, ProvenanceDocument
from rotorid.spectral.estimate import Diagnostics
from rotorid.typing import BoolArray, FloatArray


class EstimatedDocument(Document):
    """A number and one standard deviation of it, in the unit that its name says."""

    value: float
    std: float


class PairDocument(Document):
    """One response: what of it can be used, and its values on the grid of the document.

    ``band_rad_s`` is the usable band, ``null`` where there is none; the means are taken inside of it.
    ``direct_difference_db`` is the rms difference of the direct from the joint estimate there, ``leakage_percent`` the
    rms of what the windows would have added, ``largest_input_noise_db`` how much too low noise at a measured input can
    have made a direct estimate at most.
    """

    unit: str
    band_rad_s: tuple[float, float] | None = None
    points: int = 0
    mean_coherence: float | None = None
    mean_random_error: float | None = None
    direct_difference_db: float | None = None
    leakage_percent: float | None = None
    largest_input_noise_db: float | None = None
    magnitude: list[float]
    phase_rad: list[float]
    coherence: list[float]
    random_error: list[float]
    used: list[bool]


class RecordDocument(ManeuverDocument):
    """A maneuver with its own mean coherence by pair, and whether it entered the estimate."""

    coherence: dict[str, float] = Field(default_factory=dict)
    used: bool = True


class LoopDocument(Document):
    """Margins of the loop of one axis: numbers with their uncertainty, or in ``not_seen`` why there is none."""

    method: str
    band_rad_s: tuple[float, float] | None = None
    numbers: dict[str, EstimatedDocument] = Field(default_factory=dict)
    not_seen: dict[str, str] = Field(default_factory=dict)


class ResponseDocument(Document):
    """``response.json``: frequency responses with their errors and what can be used of them."""

    schema_name: Annotated[Literal["rotorid.response/1"], Field(alias="schema")] = "rotorid.response/1"
    inputs: list[str]
    outputs: list[str]
    estimate: Literal["direct", "joint"] | None = None
    instruments: list[str] = Field(default_factory=list)
    windows_s: list[float] = Field(default_factory=list)
    omega_rad_s: list[float] = Field(default_factory=list)
    pairs: dict[str, PairDocument] = Field(default_factory=dict)
    input_coherence: dict[str, float] = Field(default_factory=dict)
    largest_condition: float | None = None
    records: list[RecordDocument] = Field(default_factory=list)
    loops: dict[str, LoopDocument] = Field(default_factory=dict)
    processing: list[str] = Field(default_factory=list)
    findings: list[FindingDocument] = Field(default_factory=list)
    provenance: ProvenanceDocument


def pair_documents(
    response: FrequencyResponse,
    used: BoolArray,
    *,
    beside: FrequencyResponse | None,
    diagnostics: Diagnostics,
    measured_inputs: Sequence[str],
) -> dict[str, PairDocument]:
    """Every pair ``output/input`` of a response.

    Parameters
    ----------
    response
        The responses.
    used
        Points that can be used, shape ``(y, u, f)``.
    beside
        The direct estimate next to a joint one.
    diagnostics
        What stands behind the response.
    measured_inputs
        Inputs that a sensor measured; noise in them biases a direct estimate.
    """
    return {
        f"{output}/{input}": _pair(
            response,
            used,
            (y, u),
            beside,
            diagnostics,
            noisy=input in measured_inputs and response.estimate == "direct",
        )
        for y, output in enumerate(response.outputs)
        for u, input in enumerate(response.inputs)
    }


def _pair(
    response: FrequencyResponse,
    used: BoolArray,
    row: tuple[int, int],
    beside: FrequencyResponse | None,
    diagnostics: Diagnostics,
    *,
    noisy: bool,
) -> PairDocument:
    chosen, values = used[row], response.values[row]
    document = PairDocument(
        unit=unit_of_ratio(response.outputs[row[0]], response.inputs[row[1]]),
        magnitude=np.abs(values).tolist(),
        phase_rad=_unwrapped(values, chosen).tolist(),
        coherence=response.coherence[row].tolist(),
        random_error=response.random_error[row].tolist(),
        used=chosen.tolist(),
    )
    if not chosen.any():
        return document
    omega, coherence = response.omega_rad_s[chosen], response.coherence[row][chosen]
    difference = None if beside is None else _rms_db(beside.values[row][chosen] / values[chosen])
    return document.model_copy(
        update={
            "band_rad_s": (float(omega[0]), float(omega[-1])),
            "points": int(chosen.sum()),
            "mean_coherence": float(coherence.mean()),
            "mean_random_error": float(response.random_error[row][chosen].mean()),
            "direct_difference_db": difference,
            "leakage_percent": 100.0 * float(np.sqrt(np.mean(np.abs(diagnostics.leakage[row][chosen]) ** 2))),
            # With noise on both sides the truth lies between S_uy/S_uu and S_yy/S_yu, which is that over the coherence.
            "largest_input_noise_db": float(-20.0 * np.log10(coherence.min())) if noisy else None,
        }
    )


def unit_of_ratio(output: str, input: str) -> str:
    """Unit of a response.

    Examples
    --------
    >>> unit_of_ratio("p", "roll_command"), unit_of_ratio("u", "theta"), unit_of_ratio("p", "p_setpoint")
    ('rad/s', 'm/s/rad', '1')
    """
    above, below = (STANDARD_UNITS.get(name, "1") for name in (output, input))
    if above == below:
        return "1"
    if below == "1":
        return above
    return f"{above}/({below})" if "/" in below else f"{above}/{below}"


def input_coherences(inputs: Sequence[str], coherence: FloatArray, trusted: BoolArray) -> Mapping[str, float]:
    """Mean coherence of every two inputs over the trusted frequencies, by ``first,second``."""
    pairs = [(i, j) for i in range(len(inputs)) for j in range(i + 1, len(inputs))]
    where = trusted if trusted.any() else np.ones_like(trusted)
    return {f"{inputs[i]},{inputs[j]}": float(coherence[i, j, where].mean()) for i, j in pairs}


def _unwrapped(values: np.ndarray, chosen: BoolArray) -> FloatArray:
    """Phases that run on through the usable points, which begin within half a turn below zero and above −360°."""
    phase = np.angle(values)
    index = np.flatnonzero(chosen) if chosen.any() else np.arange(phase.size)
    spine = np.unwrap(phase[index])
    spine -= 2.0 * np.pi * np.ceil((spine[0] - 0.25 * np.pi) / (2.0 * np.pi))
    near = np.interp(np.arange(phase.size), index, spine)
    return np.asarray(phase + 2.0 * np.pi * np.round((near - phase) / (2.0 * np.pi)))


def _rms_db(ratio: np.ndarray) -> float:
    return float(np.sqrt(np.mean((20.0 * np.log10(np.abs(ratio))) ** 2)))
