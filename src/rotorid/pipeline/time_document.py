"""From a fit in time to the parts of its document."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from rotorid.pipeline.document import (
    ComparedDocument,
    EquationDocument,
    FitDocument,
    InformationDocument,
    MinimumDocument,
    RecordFitDocument,
    ResidualsDocument,
)
from rotorid.pipeline.identification import SimulatedRecord
from rotorid.pipeline.time_fit import TimeFitted
from rotorid.pipeline.time_judge import Compared
from rotorid.pipeline.time_records import TimeRecords
from rotorid.typing import FloatArray
from rotorid.verify.scores import nrmse_fit_percent

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
