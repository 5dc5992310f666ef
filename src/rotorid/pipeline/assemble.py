"""From numbers to the document that ``result.json`` holds."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from rotorid import __version__
from rotorid.data.findings import Finding
from rotorid.data.maneuver import Maneuver
from rotorid.data.record import FlightRecord
from rotorid.data.response import FrequencyResponse
from rotorid.fit.problem import FrequencyProblem
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.models.state_space import StateSpace
from rotorid.pipeline.document import (
    CombinationDocument,
    CostDocument,
    DelaysDocument,
    FindingDocument,
    ManeuverDocument,
    MatricesDocument,
    PairCost,
    ParameterDocument,
    PoleDocument,
    ProvenanceDocument,
    ScoreDocument,
    VerificationDocument,
)
from rotorid.pipeline.instruments import Flown
from rotorid.pipeline.settings import MeasureSettings
from rotorid.pipeline.verification import Checked
from rotorid.uncertainty.bounds import Bounds
from rotorid.uncertainty.identifiability import Combination

_NEAR_ZERO = 1e-12
_ORDER = {"error": 0, "warning": 1, "info": 2}


def finding_documents(findings: Sequence[Finding]) -> list[FindingDocument]:
    """Findings by severity, each once."""
    unique = list(dict.fromkeys((f.kind, f.severity, f.where, f.message, tuple(f.numbers.items())) for f in findings))
    ordered = sorted(unique, key=lambda item: _ORDER[item[1]])
    return [
        FindingDocument(kind=kind, severity=severity, where=where, message=message, numbers=dict(numbers))
        for kind, severity, where, message, numbers in ordered
    ]


def parameter_documents(parameters: ParameterSet, bounds: Bounds) -> dict[str, ParameterDocument]:
    """Every parameter with its uncertainty."""
    rows = {name: index for index, name in enumerate(bounds.names)}
    return {parameter.name: _parameter(parameter, bounds, rows.get(parameter.name)) for parameter in parameters}


def _parameter(parameter: Parameter, bounds: Bounds, row: int | None) -> ParameterDocument:
    if row is None:
        return ParameterDocument(value=parameter.value, unit=parameter.unit, status=parameter.status)
    size = abs(parameter.value)
    return ParameterDocument(
        value=parameter.value,
        unit=parameter.unit,
        std=float(bounds.std[row]),
        cramer_rao_percent=100.0 * float(bounds.cramer_rao[row]) / size if size > _NEAR_ZERO else None,
        insensitivity_percent=100.0 * float(bounds.insensitivity[row]) / size if size > _NEAR_ZERO else None,
        status=parameter.status,
    )


def cost_document(problem: FrequencyProblem, costs: np.ndarray) -> CostDocument:
    """The cost of each response and their mean."""
    pairs = {}
    for y, u in np.ndindex(problem.used.shape[:2]):
        omega = problem.data.omega_rad_s[problem.used[y, u]]
        if omega.size:
            name = f"{problem.data.outputs[y]}/{problem.data.inputs[u]}"
            band = (float(omega[0]), float(omega[-1]))
            pairs[name] = PairCost(value=float(costs[y, u]), band_rad_s=band, points=omega.size)
    return CostDocument(average=float(np.mean([pair.value for pair in pairs.values()])), pairs=pairs)


def matrices_document(system: StateSpace) -> MatricesDocument:
    """The matrices as lists."""
    return MatricesDocument(
        M=system.M.tolist(),
        F=system.F.tolist(),
        G=system.G.tolist(),
        H0=system.H0.tolist(),
        H1=system.H1.tolist(),
        delays_s=DelaysDocument(inputs=system.input_delays_s.tolist(), outputs=system.output_delays_s.tolist()),
    )


def pole_documents(system: StateSpace) -> list[PoleDocument]:
    """Eigenvalues, slowest first."""
    return [
        PoleDocument(
            real=float(pole.real),
            imag=float(pole.imag),
            damping=float(-pole.real / abs(pole)) if abs(pole) > 0.0 else 0.0,
            frequency_rad_s=float(abs(pole)),
        )
        for pole in system.poles()
    ]


def verification_document(checked: Checked) -> VerificationDocument:
    """Scores by record and maneuver, and costs on unseen sweeps."""
    records = {}
    for item in checked.verifications:
        name = f"{item.record}: {item.maneuver.axis} {item.maneuver.kind} at {item.maneuver.start_s:.1f} s"
        records[name] = {
            output: ScoreDocument(
                nrmse_fit_percent=scores.nrmse_fit_percent,
                tic=scores.tic,
                rms=scores.rms,
                bias=scores.bias,
                reference_shift=scores.reference_shift,
            )
            for output, scores in item.scores.items()
            if math.isfinite(scores.nrmse_fit_percent)
        }
    return VerificationDocument(records=records, frequency=dict(checked.frequency))


def combination_documents(combinations: Sequence[Combination]) -> list[CombinationDocument]:
    """Unseen combinations in words and as vectors."""
    return [CombinationDocument(words=item.words(), vector=dict(item.vector)) for item in combinations]


def provenance_document(
    records: Sequence[FlightRecord],
    settings: MeasureSettings,
    *,
    command: Sequence[str],
    flown: Sequence[Flown] = (),
    response: FrequencyResponse | None = None,
) -> ProvenanceDocument:
    """Where the result came from."""
    return ProvenanceDocument(
        version=__version__,
        command=list(command),
        inputs=_hashes(records),
        settings=settings.as_json(),
        seed=settings.seed,
        estimate=response.estimate if response else None,
        instruments=list(response.instruments) if response else [],
        maneuvers=[maneuver_document(record, maneuver) for record, maneuver in flown],
    )


def _hashes(records: Sequence[FlightRecord]) -> dict[str, str]:
    """Hash of each log by its name; logs of one name are told apart by a number."""
    hashes: dict[str, str] = {}
    for record in records:
        name, sha256 = record.source.name, record.source.sha256
        count = 1
        while hashes.setdefault(name, sha256) != sha256:
            count += 1
            name = f"{record.source.name} ({count})"
    return hashes


def maneuver_document(record: FlightRecord, maneuver: Maneuver) -> ManeuverDocument:
    """One maneuver."""
    return ManeuverDocument(
        record=record.source.name,
        axis=maneuver.axis,
        kind=maneuver.kind,
        start_s=maneuver.start_s,
        stop_s=maneuver.stop_s,
        band_rad_s=maneuver.band_rad_s,
        origin=maneuver.origin,
        signal=maneuver.signal,
    )


def standard_deviations(bounds: Bounds) -> Mapping[str, float]:
    """Name to standard deviation."""
    return dict(zip(bounds.names, map(float, bounds.std), strict=True))
