"""From numbers to the document that ``result.json`` holds.

From a fit in time to the parts of its document.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from rotorid.data.findings import Finding, worst_first
from rotorid.data.record import FlightRecord, Maneuver
from rotorid.data.response import FrequencyResponse
from rotorid.documents.base import FindingDocument, ManeuverDocument, ProvenanceDocument
from rotorid.documents.result import (
    BasinDocument,
    BootstrapDocument,
    CombinationDocument,
    ComparedDocument,
    CorrelationDocument,
    CostDocument,
    DelaysDocument,
    EquationDocument,
    FitDocument,
    InformationDocument,
    MatricesDocument,
    MinimumDocument,
    PairCost,
    ParameterDocument,
    PoleDocument,
    RangeDocument,
    RecordFitDocument,
    ResidualsDocument,
    ScoreDocument,
    SearchDocument,
    SpreadDocument,
    StepDocument,
    VerificationDocument,
)
from rotorid.fitting.frequency.problem import FrequencyProblem
from rotorid.fitting.least_squares import Solution
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.models.state_space import StateSpace
from rotorid.pipeline.bootstrapping import Bootstrapped
from rotorid.pipeline.coverage import Range
from rotorid.pipeline.instruments import Flown
from rotorid.pipeline.provenance import hashes as hashes
from rotorid.pipeline.provenance import logged, provenance
from rotorid.pipeline.results import SimulatedRecord
from rotorid.pipeline.searching import Searched
from rotorid.pipeline.segments import TimeRecords
from rotorid.pipeline.settings import MeasureSettings
from rotorid.pipeline.time_fit import Compared, TimeFitted
from rotorid.pipeline.unseen import Verifications
from rotorid.pipeline.verify_document import maneuver_verification, sweep_verification
from rotorid.reduction.guided import Step
from rotorid.typing import FloatArray
from rotorid.uncertainty.cramer_rao import Bounds, Weights
from rotorid.uncertainty.identifiability import Combination
from rotorid.uncertainty.propagation import Pole, covariance_of_all
from rotorid.uncertainty.resampling import SpreadRow, SpreadTable
from rotorid.verification.scores import nrmse_fit_percent

_NEAR_ZERO = 1e-12


def finding_documents(findings: Sequence[Finding]) -> list[FindingDocument]:
    """Findings by severity, each once."""
    return [FindingDocument.model_validate(finding) for finding in worst_first(findings)]


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


def verification_document(checked: Verifications, states: Sequence[str]) -> VerificationDocument:
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
    return ProvenanceDocument.model_validate(
        provenance(records, settings, command=command, flights=flown, response=response, sources=sources)
    )


def maneuver_document(record: FlightRecord, maneuver: Maneuver) -> ManeuverDocument:
    """One maneuver."""
    return ManeuverDocument.model_validate(logged(record, maneuver))


def standard_deviations(bounds: Bounds) -> Mapping[str, float]:
    """Name to standard deviation."""
    return dict(zip(bounds.names, map(float, bounds.std), strict=True))


_LAGS = 60


def simulated_records(fitted: TimeFitted, records: TimeRecords) -> tuple[SimulatedRecord, ...]:
    """Every record as it was measured and as the model has it; pieces are joined again."""
    pieces = iter(fitted.problem.predicted(fitted.problem.parameters.with_values(fitted.parameters.values).pack()))
    found = []
    for segment, data in zip(records.segments, records.data, strict=True):
        parts: list[FloatArray] = []
        starts: list[int] = []
        while (reached := sum(part.shape[1] for part in parts)) < data.samples:
            starts.append(reached)
            parts.append(next(pieces).predicted)
        found.append(
            SimulatedRecord(
                record=segment.record,
                maneuver=segment.maneuver,
                time_s=segment.history.time_s,
                inputs=data.inputs,
                measured=data.outputs,
                simulated=np.hstack(parts),
                starts=tuple(starts),
            )
        )
    return tuple(found)


def fit_percents(simulated: Sequence[SimulatedRecord], outputs: Sequence[str]) -> dict[str, float]:
    """Output to the share of its motion about the mean of each record that the model explains, all together."""
    percents = {}
    for row, name in enumerate(outputs):
        missed = sum(float(np.sum((one.measured[row] - one.simulated[row]) ** 2)) for one in simulated)
        moved = sum(float(np.sum((one.measured[row] - one.measured[row].mean()) ** 2)) for one in simulated)
        percents[name] = 100.0 * (1.0 - math.sqrt(missed / moved)) if moved > 0.0 else 0.0
    return percents


def record_documents(
    simulated: Sequence[SimulatedRecord], records: TimeRecords, outputs: Sequence[str]
) -> list[RecordFitDocument]:
    """Fit of every record on its own."""
    return [
        RecordFitDocument(
            record=one.record,
            start_s=float(one.time_s[0]),
            stop_s=float(one.time_s[-1]),
            samples=one.time_s.size,
            sample_rate_hz=data.sample_rate_hz,
            pieces=len(one.starts),
            fit_percent={
                name: percent
                for row, name in enumerate(outputs)
                if math.isfinite(percent := nrmse_fit_percent(one.measured[row], one.simulated[row]))
            },
        )
        for one, data in zip(simulated, records.data, strict=True)
    ]


def noise_document(fitted: TimeFitted, outputs: Sequence[str]) -> dict[str, float]:
    """Output to the standard deviation of its errors, in its unit."""
    return dict(zip(outputs, map(float, np.sqrt(fitted.problem.noise.diagonal())), strict=True))


def information_document(fitted: TimeFitted) -> InformationDocument:
    r"""Criteria of Akaike and Schwarz, :math:`2 k - 2 \ln L` and :math:`k \ln N - 2 \ln L`, for white residuals."""
    outputs = len(fitted.problem.structure.outputs)
    numbers = len(fitted.parameters.free) + fitted.unknowns + fitted.noise_numbers + outputs * (outputs + 1) // 2
    count = fitted.problem.samples * outputs
    twice = -2.0 * fitted.log_likelihood
    return InformationDocument(aic=2.0 * numbers + twice, bic=numbers * math.log(count) + twice, numbers=numbers)


def residuals_document(
    fitted: TimeFitted, simulated: Sequence[SimulatedRecord], records: TimeRecords
) -> ResidualsDocument:
    """Color of the residuals."""
    shortest, samples = min(one.time_s.size for one in simulated), sum(one.time_s.size for one in simulated)
    lags = min(_LAGS, shortest - 1)
    return ResidualsDocument(
        memory=fitted.memory,
        inflation=fitted.bounds.inflation,
        step_s=1.0 / records.data[0].sample_rate_hz,
        chance=2.0 / math.sqrt(samples),
        autocorrelation={
            name: _autocorrelation([one.measured[row] - one.simulated[row] for one in simulated], lags)
            for row, name in enumerate(fitted.structure.outputs)
        },
    )


def _autocorrelation(errors: Sequence[FloatArray], lags: int) -> list[float]:
    centered = [error - error.mean() for error in errors]
    products = [sum(float(e[lag:] @ e[: e.size - lag]) for e in centered) for lag in range(lags + 1)]
    return [product / products[0] if products[0] > 0.0 else 0.0 for product in products]


def minima_documents(fitted: TimeFitted) -> list[MinimumDocument]:
    """Other minima than the one that counts, best first."""
    return [
        MinimumDocument(
            cost=minimum.cost,
            parameters=dict(zip(fitted.parameters.free, map(float, minimum.theta), strict=True)),
        )
        for minimum in fitted.solution.others
        if len(minimum.theta) == len(fitted.parameters.free)
    ]


def equation_documents(fitted: TimeFitted) -> list[EquationDocument]:
    """How well each equation of motion holds, where those were fitted."""
    return [EquationDocument.model_validate(one._asdict()) for one in fitted.equations]


def time_fit_document(fitted: TimeFitted) -> FitDocument:
    """How the solver ended."""
    return FitDocument(
        weights="likelihood",
        outcome=fitted.solution.outcome.value,
        evaluations=fitted.solution.evaluations,
        trace=list(fitted.solution.trace),
        inflation=fitted.bounds.inflation,
    )


def compared_documents(others: Mapping[str, Compared]) -> dict[str, ComparedDocument]:
    """The frequency-domain fit beside."""
    return {name: ComparedDocument(value=one.value, std=one.std, hold_s=one.hold_s) for name, one in others.items()}
