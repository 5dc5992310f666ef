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
from rotorid.fit.solution import Solution
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.models.state_space import StateSpace
from rotorid.pipeline.bootstrapping import Bootstrapped
from rotorid.pipeline.coverage import Range
from rotorid.pipeline.document import (
    BasinDocument,
    BootstrapDocument,
    CombinationDocument,
    CorrelationDocument,
    CostDocument,
    DelaysDocument,
    FindingDocument,
    FitDocument,
    ManeuverDocument,
    MatricesDocument,
    MinimumDocument,
    ParameterDocument,
    PoleDocument,
    ProvenanceDocument,
    SearchDocument,
    SpreadDocument,
    StepDocument,
    VerificationDocument,
)
from rotorid.pipeline.instruments import Flown
from rotorid.pipeline.score_document import PairCost, RangeDocument, ScoreDocument
from rotorid.pipeline.searching import Searched
from rotorid.pipeline.settings import MeasureSettings
from rotorid.pipeline.verification import Checked
from rotorid.pipeline.verify_document import maneuver_verification, sweep_verification
from rotorid.reduce.step import Step
from rotorid.uncertainty.bounds import Bounds, Weights
from rotorid.uncertainty.identifiability import Combination
from rotorid.uncertainty.propagation import Pole, covariance_of_all
from rotorid.uncertainty.spread_table import SpreadRow, SpreadTable

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
    spread = np.sqrt(np.diag(covariance_of_all(parameters, bounds)))
    values = parameters.values
    return {
        parameter.name: _parameter(parameter, values[parameter.name], float(std), bounds, rows.get(parameter.name))
        for parameter, std in zip(parameters, spread, strict=True)
    }


def _parameter(parameter: Parameter, value: float, std: float, bounds: Bounds, row: int | None) -> ParameterDocument:
    if row is None:
        known = std if parameter.status == "tied" and std > 0.0 else None
        return ParameterDocument(value=value, unit=parameter.unit, status=parameter.status, std=known)
    size = abs(value)
    return ParameterDocument(
        value=value,
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


def pole_documents(poles: Sequence[Pole]) -> list[PoleDocument]:
    """Eigenvalues with their uncertainty, slowest first."""
    return [
        PoleDocument(
            real=float(pole.value.real),
            imag=float(pole.value.imag),
            damping=pole.damping or 0.0,
            frequency_rad_s=pole.frequency_rad_s,
            real_std=_root(pole.covariance, 0),
            imag_std=_root(pole.covariance, 1),
            damping_std=pole.damping_std,
            frequency_std_rad_s=pole.frequency_std_rad_s,
        )
        for pole in poles
    ]


def _root(covariance: np.ndarray | None, index: int) -> float | None:
    return None if covariance is None else float(np.sqrt(covariance[index, index]))


def fit_document(solution: Solution, weights: Weights, inflation: float) -> FitDocument:
    """How the solver ended."""
    return FitDocument(
        weights=weights,
        outcome=solution.outcome.value,
        evaluations=solution.evaluations,
        trace=list(solution.trace),
        inflation=inflation,
    )


def step_documents(steps: Sequence[Step]) -> list[StepDocument]:
    """Steps of a reduction, in order."""
    return [
        StepDocument(
            parameter=step.parameter,
            action=step.action,
            reason=step.reason,
            value_before=step.value_before,
            insensitivity_percent=_finite(step.insensitivity_percent),
            cramer_rao_percent=_finite(step.cramer_rao_percent),
            mean_cost_before=step.mean_cost_before,
            mean_cost_after=None if step.mean_cost_after is None else _finite(step.mean_cost_after),
        )
        for step in steps
    ]


def _finite(number: float) -> float | None:
    return number if math.isfinite(number) else None


def correlation_document(bounds: Bounds) -> CorrelationDocument:
    """Correlation of the free parameters."""
    return CorrelationDocument(names=list(bounds.names), matrix=bounds.correlation.tolist())


def range_documents(ranges: Mapping[str, Range]) -> dict[str, RangeDocument]:
    """What the data covered."""
    return {
        name: RangeDocument(unit=item.unit, lowest=item.low, highest=item.high, rms=item.rms)
        for name, item in ranges.items()
    }


def verification_document(checked: Checked, states: Sequence[str]) -> VerificationDocument:
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
    return VerificationDocument(
        records=records,
        frequency=dict(checked.frequency),
        maneuvers=[maneuver_verification(check, states, None) for check in checked.verifications],
        sweeps=[sweep_verification(judged) for judged in checked.judged],
    )


def search_document(found: Searched | None) -> SearchDocument | None:
    """A search with all of its minima."""
    if found is None:
        return None
    result = found.result
    return SearchDocument(
        name=found.name,
        objective=found.cost,
        evaluations=result.evaluations,
        polishing=result.polishing,
        local_searches=result.local_searches,
        minima=[BasinDocument(cost=b.cost, share=b.share, parameters=found.values(b)) for b in found.minima],
        trace=[(at.evaluations, at.best) for at in result.trace if math.isfinite(at.best)],
    )


def searched_minima(found: Searched | None) -> list[MinimumDocument]:
    """Other minima than the one that the fit went on from."""
    if found is None:
        return []
    return [MinimumDocument(cost=one.cost, parameters=found.values(one)) for one in found.minima[1:]]


def bootstrap_document(found: Bootstrapped | None) -> BootstrapDocument | None:
    """A bootstrap as its table and the correlation of its runs."""
    if found is None:
        return None
    table = found.table
    return BootstrapDocument(
        source=found.source,
        runs=table.runs,
        seed=table.seed,
        left_out=dict(table.left_out),
        parameters={row.name: _spread(row) for row in table.rows()},
        correlation=CorrelationDocument(names=list(table.names), matrix=_correlation(table)),
    )


def _spread(row: SpreadRow) -> SpreadDocument:
    return SpreadDocument(
        mean=row.mean,
        std=row.std,
        relative_percent=_finite(row.relative_percent),
        low=row.low,
        median=row.median,
        high=row.high,
    )


def _correlation(table: SpreadTable) -> list[list[float]]:
    """Correlation of the runs; zero beside what did not scatter."""
    scale = np.where(table.std > 0.0, table.std, np.inf)
    matrix = table.covariance / np.outer(scale, scale)
    np.fill_diagonal(matrix, 1.0)
    return [[float(value) for value in row] for row in matrix]


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
    sources: Mapping[str, str] | None = None,
) -> ProvenanceDocument:
    """Where the result came from."""
    return ProvenanceDocument(
        version=__version__,
        command=list(command),
        inputs=hashes(records),
        settings=settings.as_json(),
        seed=settings.seed,
        estimate=response.estimate if response else None,
        instruments=list(response.instruments) if response else [],
        sources=dict(sources or {}),
        maneuvers=[maneuver_document(record, maneuver) for record, maneuver in flown],
    )


def hashes(records: Sequence[FlightRecord]) -> dict[str, str]:
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
