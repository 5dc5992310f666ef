"""Contents of the document of a fit in time: fits of records, information, residuals and equations."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rotorid.fits.scatter import LogEstimate, name_of_stretch
from rotorid.fits.time.fit import TimeFit
from rotorid.flights.segments import TimeRecords
from rotorid.models.nonlinear import NonlinearStructure
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.results.model import SimulatedRecord
from rotorid.results.summary import Derived, EquationFit, Information, RecordFit, Residuals
from rotorid.typing import FloatArray
from rotorid.uncertainty.cramer_rao import Bounds
from rotorid.verification.driven import driven
from rotorid.verification.scores import nrmse_fit_percent


def record_fits(
    simulated: Sequence[SimulatedRecord],
    records: TimeRecords,
    structure: LinearStructure | NonlinearStructure,
    *,
    parameters: ParameterSet,
    alone: Sequence[LogEstimate] = (),
) -> tuple[RecordFit, ...]:
    """Fit of every record on its own, with its own estimates where it was fitted alone too."""
    estimates = {estimate.record: _estimates(estimate, parameters) for estimate in alone}
    missing = {estimate.record: dict(estimate.missing) for estimate in alone}
    return tuple(
        RecordFit(
            record=record.record,
            start_s=float(record.time_s[0]),
            stop_s=float(record.time_s[-1]),
            samples=record.time_s.size,
            sample_rate_hz=data.sample_rate_hz,
            pieces=len(record.starts),
            fit_percent={
                name: percent
                for row, name in enumerate(structure.outputs)
                if math.isfinite(
                    percent := moved.judged(name, nrmse_fit_percent(record.measured[row], record.simulated[row]))
                )
            },
            parameters=estimates.get(name_of_stretch(record.record, float(record.time_s[0])), {}),
            missing=missing.get(name_of_stretch(record.record, float(record.time_s[0])), {}),
        )
        for record, data in zip(simulated, records.data, strict=True)
        for moved in [driven(structure, record.inputs)]
    )


def _estimates(estimate: LogEstimate, parameters: ParameterSet) -> dict[str, Derived]:
    return {
        name: Derived(value=estimate.values[name], std=std, unit=parameters[name].unit)
        for name, std in estimate.stds.items()
    }


def information(fitted: TimeFit) -> Information:
    """Criteria of Akaike and Schwarz of a fit in time, see :func:`information_of`."""
    outputs = len(fitted.problem.structure.outputs)
    numbers = len(fitted.parameters.free) + fitted.unknowns + fitted.noise_numbers + outputs * (outputs + 1) // 2
    return information_of(fitted.log_likelihood, numbers, fitted.problem.samples * outputs)


def information_of(log_likelihood: float, numbers: int, count: int) -> Information:
    r"""Criteria of Akaike and Schwarz, :math:`2 k - 2 \ln L` and :math:`k \ln N - 2 \ln L`, for white residuals."""
    twice = -2.0 * log_likelihood
    return Information(aic=2.0 * numbers + twice, bic=numbers * math.log(count) + twice, numbers=numbers)


_LAGS = 60


def residuals(fitted: TimeFit, records: TimeRecords) -> Residuals:
    """Color of the residuals."""
    return residual_colors(fitted.simulated, fitted.structure.outputs, fitted.bounds, records.data[0].sample_rate_hz)


def residual_colors(
    simulated: Sequence[SimulatedRecord], outputs: Sequence[str], bounds: Bounds, sample_rate_hz: float
) -> Residuals:
    """Color of what a simulation has left of its outputs."""
    sizes = [record.time_s.size for record in simulated]
    lags = min(_LAGS, min(sizes) - 1)
    return Residuals(
        memory=bounds.ar_order,
        inflation=bounds.inflation,
        step_s=1.0 / sample_rate_hz,
        chance=2.0 / math.sqrt(sum(sizes)),
        autocorrelation={
            name: _autocorrelation([item.measured[row] - item.simulated[row] for item in simulated], lags)
            for row, name in enumerate(outputs)
        },
    )


def _autocorrelation(errors: Sequence[FloatArray], lags: int) -> tuple[float, ...]:
    centered = [error - error.mean() for error in errors]
    products = [sum(float(e[lag:] @ e[: e.size - lag]) for e in centered) for lag in range(lags + 1)]
    return tuple(product / products[0] if products[0] > 0.0 else 0.0 for product in products)


def equation_fits(fitted: TimeFit) -> tuple[EquationFit, ...]:
    """Fit of each equation of motion, if equations were fitted."""
    return tuple(
        EquationFit(name=score.name, r_squared=score.r_squared, press=score.press, misfit=score.misfit)
        for score in fitted.equations
    )
