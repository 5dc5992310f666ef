r"""From records in time to a fitted model with bounds.

Where a time-domain fit begins: the frequency-domain fit of the same data, and the start values of the structure.

Bounds of parameters that were fitted in time: by what is left of outputs, or of equations of motion.

What a careful engineer would remark on a time-domain fit.

Whether inputs follow the errors of the outputs: then a controller was at work, and output error is biased.

.. math:: r_k = \frac{1}{N \sigma_e \sigma_u} \sum_t e_t u_{t+k}, \qquad Q = N \sum_{k=1}^{K} r_k^2 \sim \chi^2_K

for residuals and inputs that are both whitened by an autoregression of their own: without feedback no input knows
what the model could not explain before it. After Haugh, *Checking the Independence of Two Covariance-Stationary Time
Series*, 1976.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, refusal, remark, warn
from rotorid.data.trust import CERTAIN_SIGN
from rotorid.errors import InsufficientDataError, ModelError, UsageError
from rotorid.fitting.equations.equation_error import EquationErrorFit, EquationScore, fit_equation_error
from rotorid.fitting.equations.regression import InBand, InTime
from rotorid.fitting.frequency.problem import ACCEPTABLE_COST, FrequencyProblem, pair_names
from rotorid.fitting.frequency.screening import is_coupling
from rotorid.fitting.least_squares import Outcome, Solution
from rotorid.fitting.problem import Part
from rotorid.fitting.time.output_error import (
    InitialCondition,
    OutputErrorFit,
    TimeData,
    TimeProblem,
    fit_output_error,
    log_likelihood,
    own_starts,
)
from rotorid.models.expression import Expression
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.pipeline.fits.bootstrapping import Bootstrap
from rotorid.pipeline.fits.frequency import (
    FrequencyFit,
    faster_than_sampled,
    fit_with_bounds,
    grown,
    judge_parameters,
    require_known_gain,
)
from rotorid.pipeline.fits.searching import Searched, refuse_search, searched
from rotorid.pipeline.preparation.flights import Flight
from rotorid.pipeline.preparation.instruments import is_command
from rotorid.pipeline.preparation.inverse import pose_screened, require_vehicle
from rotorid.pipeline.preparation.measure import Measured, measure
from rotorid.pipeline.preparation.resolve import black_box_order, chosen_parameters
from rotorid.pipeline.preparation.segments import TimeRecords
from rotorid.pipeline.results import SimulatedRecord
from rotorid.pipeline.settings import IdentifySettings
from rotorid.pipeline.summary import Compared, EquationFit, Information, RecordFit, Residuals
from rotorid.typing import ComplexArray, FloatArray
from rotorid.uncertainty.colored import autoregression
from rotorid.uncertainty.cramer_rao import Bounds, bounds, bounds_of_parts
from rotorid.verification.scores import GOOD_FIT_PERCENT, nrmse_fit_percent

_PROGRESS = logging.getLogger("rotorid.progress")


def equation_bounds(fit: EquationErrorFit) -> Bounds:
    r"""Bounds of an equation-error fit, from :math:`F = J^T J` of its weighted equations.

    Percents are formed as by :func:`rotorid.uncertainty.cramer_rao.bounds_of_parts`. The covariance is that of the fit,
    for residuals of any color, and ``inflation`` compares it with white ones. None of them knows the bias by noise in
    measured states.
    """
    fisher = fit.solution.jacobian.T @ fit.solution.jacobian
    length = np.sqrt(fisher.diagonal())
    white = np.sqrt(np.linalg.inv(fisher / np.outer(length, length)).diagonal()) / length
    ratio = np.log(fit.covariance.diagonal() / white**2)
    return Bounds(
        names=fit.names,
        cramer_rao=2.0 * white,
        insensitivity=1.0 / length,
        covariance=fit.covariance,
        random=fit.covariance,
        inflation=math.exp(0.5 * float(np.mean(ratio))),
    )


TimeMethod: TypeAlias = Literal["output_error", "prediction_error", "equation_error"]

_GROWTHS = 2.0
"""How many times a mode may grow e-fold within a piece: with more, its start decides all that follows."""

_LEAST_PIECE = 20
_LEAST_NOISE = 1e-10
_ALIKE = 1.5
_ROUNDS = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class TimeFit(Immutable):
    """A model that was fitted in the time domain, with what is known about it.

    Parameters
    ----------
    method
        How.
    problem
        Its simulation over the records, or over pieces of them; at the covariance of the output errors.
    solution
        How the solver ended.
    parameters
        The identified values.
    listed
        The same with those that were dropped before.
    bounds
        Their uncertainty, corrected for the color of the residuals.
    memory
        Order of the autoregression that describes that color; zero where none does.
    log_likelihood
        Of the residuals, were they white and Gaussian.
    unknowns
        How many numbers were estimated beside the parameters.
    noise_numbers
        How many more a noise model has than the covariance of the errors.
    pieces_s
        Length of the pieces, ``None`` for whole records.
    findings
        Remarks of the fit itself.
    equations
        How well each equation of motion holds, where those were fitted.
    search
        The search that the fit began at, if any; also in the frequency domain.
    bootstrap
        Refits to noise drawn anew, where they were asked for.
    simulated
        Every record as it was measured and as the model has it.
    """

    method: TimeMethod
    problem: TimeProblem
    solution: Solution
    parameters: ParameterSet
    listed: ParameterSet
    bounds: Bounds
    memory: int
    log_likelihood: float
    unknowns: int
    noise_numbers: int
    pieces_s: float | None
    findings: tuple[Finding, ...] = ()
    equations: tuple[EquationScore, ...] = ()
    search: Searched | None = None
    bootstrap: Bootstrap | None = None
    simulated: tuple[SimulatedRecord, ...] = ()

    @property
    def structure(self) -> LinearStructure:
        """What the values belong to, without states that a dropped lag has left without dynamics."""
        return self.problem.structure.condensed(self.parameters)

    @property
    def fit_percent(self) -> dict[str, float]:
        """Output to the share of its motion about the mean of each record that the model explains, all together."""
        return explained_percents(self.structure.outputs, self.simulated)


def explained_percents(outputs: Sequence[str], simulated: Sequence[SimulatedRecord]) -> dict[str, float]:
    """Output to the share of its motion about the mean of each record that a simulation explains, all together."""
    percents = {}
    for row, name in enumerate(outputs):
        pairs = [(record.measured[row], record.simulated[row]) for record in simulated]
        missed = sum(float(np.sum((measured - simulated) ** 2)) for measured, simulated in pairs)
        moved = sum(float(np.sum((measured - measured.mean()) ** 2)) for measured, _ in pairs)
        percents[name] = 100.0 * (1.0 - math.sqrt(missed / moved)) if moved > 0.0 else 0.0
    return percents


class _Ended(NamedTuple):
    """End of the search of one method; the problem simulates with the values that were found."""

    problem: TimeProblem
    solution: Solution
    parts: list[Part]
    log_likelihood: float
    pieces_s: float | None = None
    findings: tuple[Finding, ...] = ()
    by_equations: EquationErrorFit | None = None
    noise_numbers: int = 0
    search: Searched | None = None


def fit_in_time(
    structure: LinearStructure,
    records: TimeRecords,
    settings: IdentifySettings,
    *,
    method: TimeMethod,
    frequency: FrequencyFit | None = None,
) -> TimeFit:
    """Fit a structure to records in time and bound its parameters.

    The search begins at the fit in the frequency domain, where there is one, and at the start values of the structure.
    Where a mode grows, records are cut into pieces in which it grows twice e-fold at most, each with an initial state
    of its own (multiple shooting).

    Parameters
    ----------
    structure
        What to fit; of a vehicle's, what the frequency domain has dropped stays dropped.
    records
        What to fit it to.
    settings
        Choices of the run.
    method
        How.
    frequency
        The fit of the same data in the frequency domain.

    Raises
    ------
    InsufficientDataError
        The records do not determine the parameters.
    UsageError
        The method is not one for this structure.
    """
    parameters = chosen_parameters(structure, settings)
    if frequency is not None:
        structure, parameters = _begun(structure, parameters, frequency)
    whole = frequency.parameters if frequency is not None else chosen_parameters(structure, settings)
    _PROGRESS.info(f"fitting {structure.name} by {method.replace('_', ' ')}")
    seeded = frequency is not None
    if method == "prediction_error":
        ended = _predicting(structure, parameters, records, settings, seeded=seeded)
    elif method == "output_error":
        ended = _simulating(structure, parameters, records, settings, seeded=seeded)
    else:
        ended = _by_equations(structure, parameters, records, settings, frequency)
    search = frequency.search if frequency is not None else None
    return _bounded(ended._replace(search=ended.search or search), whole, method)


def _begun(
    structure: LinearStructure, parameters: ParameterSet, frequency: FrequencyFit
) -> tuple[LinearStructure, ParameterSet]:
    """A structure at the values of the frequency domain.

    Of a vehicle it stays without what was dropped there. A response in time shows delays that one of few samples for
    each period does not.
    """
    if all(is_command(name) for name in structure.inputs):
        return frequency.structure, frequency.structure.parameters
    known = {
        one.name: one.value for one in frequency.parameters if one.status == "free" and one.name in parameters.free
    }
    return structure, parameters.with_values(known)


def _simulating(
    structure: LinearStructure,
    parameters: ParameterSet,
    records: TimeRecords,
    settings: IdentifySettings,
    *,
    seeded: bool,
) -> _Ended:
    """Output error from all minima of a search, in pieces as short as the modes need that it finds."""
    order = black_box_order(structure)
    if order is not None and not any(parameters.values.values()):
        return _black_box(structure, order, records, settings, unknowns_of(structure))
    length_s = settings.pieces_s
    if length_s is None:
        length_s = piece_s(structure, parameters, records.data)
    search = None
    for _ in range(_ROUNDS):
        fitted_s = length_s
        problem = posed_in_pieces(structure, parameters, records, fitted_s)
        search = search or searched(problem, settings)
        starts = [parameters.pack()] if seeded else []
        # The own starts of a large model lead nowhere that its responses have not shown.
        if not seeded or any(parameters[name].starts for name in parameters.free):
            starts += own_starts(problem)
        starts += [one.theta for one in search.minima] if search else []
        fit = fit_output_error(problem, starts=starts)
        parameters, seeded = fit.parameters, True
        needed = piece_s(structure, parameters, records.data)
        if settings.pieces_s is not None or _about_as_long(fitted_s, needed):
            break
        length_s = needed
    return _ended(fit, fitted_s)._replace(search=search)


def _about_as_long(length_s: float | None, needed_s: float | None) -> bool:
    if length_s is None or needed_s is None:
        return length_s is needed_s
    return needed_s / _ALIKE < length_s < _ALIKE * needed_s


def posed_in_pieces(
    structure: LinearStructure, parameters: ParameterSet, records: TimeRecords, length_s: float | None
) -> TimeProblem:
    """Records, or pieces of about one length of them, simulated by a structure."""
    data = records.data if length_s is None else tuple(p for one in records.data for p in one.pieces(length_s))
    return TimeProblem(
        structure=structure, parameters=parameters, records=data, hold=records.hold, unknowns=unknowns_of(structure)
    )


def _predicting(
    structure: LinearStructure,
    parameters: ParameterSet,
    records: TimeRecords,
    settings: IdentifySettings,
    *,
    seeded: bool,
) -> _Ended:
    """Prediction error, from the values of the frequency domain or of an output-error fit."""
    from rotorid.fitting.time.prediction_error import InnovationsProblem, fit_prediction_error

    search = None
    if not seeded:
        begun = _simulating(structure, parameters, records, settings, seeded=False)
        structure, parameters, search = begun.problem.structure, begun.problem.parameters, begun.search
    problem = InnovationsProblem(
        structure=structure,
        parameters=parameters,
        records=records.data,
        hold=records.hold,
        unknowns=unknowns_of(structure),
    )
    fit = fit_prediction_error(problem)
    low, high = problem.box
    theta = fit.solution.theta
    # A noise on its bound has no effect any more, and none on what is known of the model.
    kept = ((theta > low) & (theta < high)) | (np.arange(theta.size) < len(parameters.free))
    parts = [part._replace(slopes=part.slopes[:, :, kept]) for part in problem.parts(theta)]
    length_s = settings.pieces_s or piece_s(structure, fit.parameters, records.data)
    shown = posed_in_pieces(structure, fit.parameters, records, length_s).with_noise(fit.noise_covariance)
    noise_numbers = int(kept.sum()) - len(parameters.free)
    return _Ended(shown, fit.solution, parts, fit.log_likelihood, length_s, noise_numbers=noise_numbers, search=search)


def _by_equations(
    structure: LinearStructure,
    parameters: ParameterSet,
    records: TimeRecords,
    settings: IdentifySettings,
    frequency: FrequencyFit | None,
) -> _Ended:
    """Equation error, over the band of the responses where there are any; the records are simulated to show it."""
    if black_box_order(structure) is not None:
        raise UsageError(
            f"the method equation_error came with {structure.name}",
            needed="output_error or prediction_error for a black box, whose states nothing measures",
        )
    band_rad_s = settings.band_rad_s or (frequency.band_rad_s if frequency is not None else None)
    domain = InTime() if band_rad_s is None else InBand(band_rad_s=band_rad_s)
    fit = fit_equation_error(structure, parameters, records.data, domain=domain, hold=records.hold)
    found = _without(fit.parameters, fit.left)
    length_s = settings.pieces_s or piece_s(structure, found, records.data)
    problem = posed_in_pieces(structure, found, records, length_s)
    errors = np.hstack([one.record.outputs - one.predicted for one in problem.predicted(found.pack())])
    noise = errors @ errors.T / errors.shape[1] + _LEAST_NOISE * problem.noise
    problem = problem.with_noise(noise)
    parts = problem.parts(found.pack())
    return _Ended(problem, fit.solution, parts, log_likelihood(problem), length_s, fit.findings, fit)


def _without(parameters: ParameterSet, left: Sequence[str]) -> ParameterSet:
    """A set in which what was not estimated is no longer free."""
    for name in set(left) & set(parameters.free):
        parameters = parameters.fix(name, parameters[name].value)
    return parameters


def _ended(fit: OutputErrorFit, length_s: float | None = None, findings: tuple[Finding, ...] = ()) -> _Ended:
    parts = fit.problem.parts(fit.solution.theta)
    problem = fit.problem.with_parameters(fit.parameters)
    return _Ended(problem, fit.solution, parts, fit.log_likelihood, length_s, findings)


def _black_box(
    structure: LinearStructure,
    order: int,
    records: TimeRecords,
    settings: IdentifySettings,
    unknowns: tuple[InitialCondition, ...],
) -> _Ended:
    """A black box without values: its starts come from subspaces."""
    from rotorid.fitting.black_box.fit import StartPlan, fit_black_box, fit_black_box_pairs

    if settings.fix or settings.ties or settings.free:
        raise UsageError(
            f"--fix, --tie or --free came with {structure.name}",
            needed="a black box with values, as a model.toml holds one",
        )
    refuse_search(settings, structure.name, "none: a black box begins at subspaces")
    if settings.pieces_s is not None:
        raise UsageError(f"--pieces came with {structure.name}", needed="none: a black box is fitted to whole records")
    plan = StartPlan(seed=settings.seed)
    delays = any(name.startswith("tau") for name in structure.parameters.names)
    if len(structure.states) > order:
        pairs = tuple(zip(structure.inputs, structure.outputs, strict=True))
        found = fit_black_box_pairs(
            records.data, order, pairs=pairs, delays=delays, hold=records.hold, unknowns=unknowns, plan=plan
        )
    else:
        found = fit_black_box(
            records.data,
            order,
            inputs=structure.inputs,
            outputs=structure.outputs,
            delays=delays,
            hold=records.hold,
            unknowns=unknowns,
            plan=plan,
        )
    return _ended(found.fit, findings=found.findings)


def unknowns_of(structure: LinearStructure) -> tuple[InitialCondition, ...]:
    """What is estimated beside the parameters: for commands also their trim, which a vehicle integrates."""
    if all(is_command(name) for name in structure.inputs) and black_box_order(structure) is None:
        return ("initial_state", "output_shift", "state_bias")
    return ("initial_state", "output_shift")


def piece_s(structure: LinearStructure, parameters: ParameterSet, data: Sequence[TimeData]) -> float | None:
    """Length of pieces in which the fastest growing mode stays small; ``None`` where whole records do."""
    growth_1_s = growth(structure, parameters)
    longest_s = max(record.duration_s for record in data)
    if growth_1_s * longest_s <= _GROWTHS:
        return None
    return max(_GROWTHS / growth_1_s, _LEAST_PIECE / min(record.sample_rate_hz for record in data))


def growth(structure: LinearStructure, parameters: ParameterSet) -> float:
    """Largest real part of a pole, at least zero."""
    poles = structure.matrices(parameters.values).poles()
    return max(0.0, float(poles.real.max(initial=0.0)))


def _bounded(ended: _Ended, whole: ParameterSet, method: TimeMethod) -> TimeFit:
    parameters = ended.problem.parameters
    by = ended.by_equations
    bounds = bounds_of_parts(ended.parts, parameters.free) if by is None else equation_bounds(by)
    whole = whole if by is None else _without(whole, by.left)
    same = whole.free == parameters.free
    return TimeFit(
        method=method,
        problem=ended.problem,
        solution=ended.solution,
        parameters=parameters,
        listed=whole.unpack(parameters.pack()) if same else parameters,
        bounds=bounds,
        memory=bounds.ar_order,
        log_likelihood=ended.log_likelihood,
        unknowns=sum(part.unknown.shape[2] for part in ended.parts),
        noise_numbers=ended.noise_numbers,
        pieces_s=ended.pieces_s,
        findings=ended.findings,
        equations=() if by is None else by.equations,
        search=ended.search,
    )


def simulated_records(fitted: TimeFit, records: TimeRecords) -> tuple[SimulatedRecord, ...]:
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


def record_fits(
    simulated: Sequence[SimulatedRecord], records: TimeRecords, outputs: Sequence[str]
) -> tuple[RecordFit, ...]:
    """Fit of every record on its own."""
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
                for row, name in enumerate(outputs)
                if math.isfinite(percent := nrmse_fit_percent(record.measured[row], record.simulated[row]))
            },
        )
        for record, data in zip(simulated, records.data, strict=True)
    )


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
            name: _autocorrelation([one.measured[row] - one.simulated[row] for one in simulated], lags)
            for row, name in enumerate(outputs)
        },
    )


def _autocorrelation(errors: Sequence[FloatArray], lags: int) -> tuple[float, ...]:
    centered = [error - error.mean() for error in errors]
    products = [sum(float(e[lag:] @ e[: e.size - lag]) for e in centered) for lag in range(lags + 1)]
    return tuple(product / products[0] if products[0] > 0.0 else 0.0 for product in products)


def equation_fits(fitted: TimeFit) -> tuple[EquationFit, ...]:
    """How well each equation of motion holds, where those were fitted."""
    return tuple(
        EquationFit(name=score.name, r_squared=score.r_squared, press=score.press, misfit=score.misfit)
        for score in fitted.equations
    )


class FrequencySide(NamedTuple):
    """What the frequency domain says about the same data.

    Parameters
    ----------
    measured
        Responses, or ``None`` where they could not be estimated.
    fitted
        The fit in the frequency domain, or ``None`` where there is none.
    why_not
        Why there is no fit, in words; empty where there is one.
    """

    measured: Measured | None = None
    fitted: FrequencyFit | None = None
    why_not: str = ""


def frequency_side(
    structure: LinearStructure,
    flights: Sequence[Flight],
    settings: IdentifySettings,
    *,
    fits: bool = True,
    searches: bool = False,
) -> FrequencySide:
    """Measure responses and fit them, as far as the data support that.

    Parameters
    ----------
    structure, flights, settings
        As for :func:`rotorid.pipeline.identification.identify`.
    fits
        Whether to fit the structure; one without start values of its own cannot be.
    searches
        Whether the search that the settings ask for belongs here, and not to the fit in time.

    Raises
    ------
    InsufficientDataError
        All that a response shows is the inverse of the controller.
    """
    try:
        measured = measure(flights, inputs=structure.inputs, outputs=structure.outputs, settings=settings)
    except (InsufficientDataError, ModelError) as error:
        return FrequencySide(None, None, error.came.rstrip("."))
    require_vehicle(measured, settings, flights)
    if not fits:
        return FrequencySide(measured)
    try:
        _PROGRESS.info(f"fitting {structure.name} in the frequency domain")
        problem = pose_screened(structure, measured, settings, flights).problem
        own = settings if searches else replace(settings, search=None, evaluations=None, starts="default")
        return FrequencySide(measured, fit_with_bounds(problem, measured, own))
    except (InsufficientDataError, ModelError) as error:
        return FrequencySide(measured, None, error.came.rstrip("."))


def held_response(omega_rad_s: FloatArray, records: TimeRecords) -> ComplexArray:
    r"""Response of the hold of the inputs, :math:`(1 - e^{-j \omega T}) / (j \omega T)`, shape ``(f,)``.

    It is one for inputs that were joined by lines. Responses between samples contain it. A simulation with held inputs
    has it apart from the model.
    """
    if records.hold == "first":
        return np.ones(omega_rad_s.size, dtype=np.complex128)
    half = 0.5 * omega_rad_s / records.data[0].sample_rate_hz
    return np.asarray(np.sinc(half / np.pi) * np.exp(-1j * half), dtype=np.complex128)


_APART = 3.0
"""Combined standard deviations beyond which two methods disagree."""

_COLORED = 1.2
_SETTLED = 1e-6


LEAST_EXPLAINED_PERCENT = 100.0 * (1.0 - math.sqrt(0.5))
"""Below it a simulation leaves more of the variance of an output than it explains."""


_SIGNIFICANT = 3.0
"""Errors that responses state, as root mean square, within which their cost says nothing."""


def require_sound_in_time(fitted: TimeFit, frequency: FrequencyFit | None, records: TimeRecords) -> None:
    """Refuse a model that does not describe the records it was fitted to.

    A simulation that leaves more of every output than it explains; a search that came to no rest, or poles that no
    sample shows, but for black boxes, whose single numbers mean nothing; derivatives of a vehicle that miss the
    responses of the same flights by what no fit of responses may, and by many times what these responses state. A fit
    in time has its least errors where noise is least and none of its own for what the structure lacks: nothing else
    would tell.

    Parameters
    ----------
    fitted, records
        The fit, with its simulations, and what it was fitted to.
    frequency
        The fit of responses of the same flights, where there is one.

    Raises
    ------
    InsufficientDataError
        One of these.
    """
    name, reasons = fitted.problem.structure.name, []
    fit_percent = fitted.fit_percent
    if fitted.method == "output_error" and fit_percent and max(fit_percent.values()) < LEAST_EXPLAINED_PERCENT:
        for output, percent in fit_percent.items():
            message = f"Simulated, the model leaves more of {output} than it explains: its fit is {percent:.0f} %."
            reasons.append(refusal("poor_fit", output, message, fit_percent=percent))
    black_box = black_box_order(fitted.problem.structure) is not None
    if fitted.solution.outcome is Outcome.OUT_OF_ITERATIONS and not black_box:
        message = f"The fit did not converge: {fitted.solution.outcome.value}"
        reasons.append(refusal("not_converged", name, message))
    if not black_box:
        system = fitted.structure.matrices(fitted.parameters.values)
        reasons += faster_than_sampled(name, system, min(one.sample_rate_hz for one in records.data))
    of_vehicles = all(is_command(name) for name in fitted.problem.structure.inputs)
    if frequency is not None and not black_box and of_vehicles:
        reasons += _missed_responses(fitted, frequency, records)
    if reasons:
        too_large = all(reason.kind == "impossible_physics" for reason in reasons)
        raise InsufficientDataError(
            f"{name} does not describe these flights: " + " ".join(reason.message for reason in reasons),
            needed="a model that follows the records it is fitted to",
            remedy="take a model of an order less, whose lags all show"
            if too_large
            else "take a structure with the missing dynamics, or segments in which the inputs move the vehicle",
            findings=reasons,
        )


def _missed_responses(fitted: TimeFit, frequency: FrequencyFit, records: TimeRecords) -> Iterator[Finding]:
    problem, theta = beside_responses(fitted, frequency, records)
    costs = problem.costs(theta)
    used = problem.used.any(axis=-1)
    average = float(np.mean(costs[used]))
    if average <= ACCEPTABLE_COST:
        return
    model = problem.structure.response(problem.parameters.unpack(theta).values, problem.data.omega_rad_s)
    off = np.abs(model[problem.used] / problem.data.values[problem.used] - 1.0)
    stated = math.sqrt(2.0) * problem.data.random_error[problem.used]
    if float(np.sqrt(np.mean((off / stated) ** 2))) <= _SIGNIFICANT:
        return
    worst = np.unravel_index(np.argmax(np.where(used, costs, -np.inf)), costs.shape)
    pair = np.array(pair_names(problem.data)).reshape(costs.shape)[worst]
    message = (
        f"Beside the responses of the same flights the average cost of these values is {average:.0f}, above the "
        f"{ACCEPTABLE_COST:g} of an acceptable model; {pair} costs most, {costs[worst]:.0f}."
    )
    yield refusal("poor_fit", fitted.problem.structure.name, message, average_cost=average)


def beside_responses(
    fitted: TimeFit, frequency: FrequencyFit, records: TimeRecords
) -> tuple[FrequencyProblem, FloatArray]:
    """Responses as a fit in time sees them, without the hold of the inputs, and the values that it found."""
    problem = frequency.problem
    values = {name: fitted.parameters[name].value for name in problem.parameters.free}
    measured = problem.data
    apart = replace(measured, values=measured.values / held_response(measured.omega_rad_s, records))
    return replace(problem, data=apart), problem.parameters.with_values(values).pack()


def judge_time_fit(fitted: TimeFit, records: TimeRecords, fit_percent: Mapping[str, float]) -> tuple[Finding, ...]:
    """Remarks on the fit, its residuals and its parameters; those of a black box mean nothing one by one."""
    black_box = black_box_order(fitted.problem.structure) is not None
    return (
        *fitted.findings,
        *_pieces(fitted),
        *judge_explained(fit_percent, simulated=fitted.method == "output_error"),
        *judge_colors(fitted.problem.structure.name, fitted.bounds, 1.0 / records.data[0].sample_rate_hz),
        *judge_solver(
            fitted.problem.structure.name, fitted.solution, fitted.parameters, fitted.problem.structure.input_delays
        ),
        *(() if black_box else judge_parameters(fitted.parameters, fitted.bounds)),
    )


def _pieces(fitted: TimeFit) -> list[Finding]:
    if fitted.pieces_s is None:
        return []
    rate = growth(fitted.problem.structure, fitted.parameters)
    why = (
        f"The fastest mode grows e-fold in {1.0 / rate:.2g} s, and over a whole record any error would explode."
        if rate > 0.0
        else "Pieces were asked for."
    )
    count = len(fitted.problem.records)
    cut = f"in {count} pieces of about {fitted.pieces_s:.2g} s, each with an initial state of its own"
    return [
        remark(
            "fitted_in_pieces",
            fitted.problem.structure.name,
            f"{why} The records were fitted {cut}; fits in percent are those of the pieces."
            if fitted.method == "output_error"
            else f"{why} The fit takes the records whole; to show it they were simulated {cut}.",
            pieces=float(count),
            length_s=fitted.pieces_s,
            growth_1_s=rate,
        )
    ]


def judge_explained(fit_percent: Mapping[str, float], *, simulated: bool = True) -> list[Finding]:
    """A remark on each output that a simulation explains badly; a warning where the simulation was what was fitted."""
    why = (
        "Dynamics are missing, or other things than the inputs move it."
        if simulated
        else "The fit looks at each sample by itself; in a simulation gusts add up, and so does what is missing."
    )
    return [
        (warn if simulated else remark)(
            "poor_fit",
            name,
            f"Simulated, the model explains {percent:.0f} % of {name} in the records it was fitted to (good: "
            f"{GOOD_FIT_PERCENT:g} % and more). {why}",
            fit_percent=percent,
        )
        for name, percent in fit_percent.items()
        if percent < GOOD_FIT_PERCENT
    ]


def judge_colors(name: str, bounds: Bounds, step_s: float) -> list[Finding]:
    """A remark on residuals that are not white."""
    factor, memory = bounds.inflation, bounds.ar_order
    if factor < _COLORED:
        return []
    color = (
        f"Residuals remember their past over some {memory} samples ({memory * step_s:.2g} s), as in every real flight."
        if memory
        else "Errors of the equations are not white, as in every real flight."
    )
    return [
        remark(
            "colored_residuals",
            name,
            f"{color} Standard deviations count that: they are {factor:.2g} times as large as for white residuals.",
            factor=factor,
            memory=float(memory),
        )
    ]


def judge_solver(
    name: str, solution: Solution, parameters: ParameterSet, input_delays: Sequence[Expression]
) -> list[Finding]:
    """Parameters that ended on a bound, and a search that did not come to rest."""
    delays = {str(entry) for entry in input_delays}
    findings = [
        _at_bound(one, late=one in delays and parameters[one].value == 0.0)
        for one, at_bound in zip(parameters.free, solution.at_bound, strict=False)
        if at_bound
    ]
    if solution.outcome is not Outcome.CONVERGED and left_to_gain(solution) > _SETTLED:
        findings.append(warn("not_converged", name, solution.outcome.value))
    return findings


def _at_bound(name: str, *, late: bool) -> Finding:
    why = (
        " The outputs answer no later than they are asked, or earlier: so do outputs that passed a zero-phase filter "
        "which the inputs did not, or commands that were stamped late."
        if late
        else ""
    )
    return warn(
        "parameter_at_bound", name, f"{name} ended on a bound of the search; its value says no more than that.{why}"
    )


def left_to_gain(solution: Solution) -> float:
    """Share of the sum of squares that one more step promises; bounds are respected."""
    inner = ~np.array(solution.at_bound, dtype=np.bool_)
    if not inner.any() or solution.cost <= 0.0:
        return 0.0
    J = solution.jacobian[:, inner]
    step = np.linalg.lstsq(J, solution.residual, rcond=None)[0]
    return float(np.sum((J @ step) ** 2)) / solution.cost


def compare_with(
    frequency: FrequencyFit, structure: LinearStructure, fitted: TimeFit, records: TimeRecords
) -> dict[str, Compared]:
    """Parameters of the frequency-domain fit that the time-domain fit has too.

    A response between samples contains the hold of the inputs, half a step of delay, which a simulation with held
    inputs has apart. That much of a delay is no disagreement.
    """
    half_s = 0.5 / records.data[0].sample_rate_hz if records.hold == "zero" else 0.0
    delays = {str(entry) for entry in structure.input_delays}
    std = dict(zip(frequency.bounds.names, map(float, frequency.bounds.std), strict=True))
    return {
        parameter.name: Compared(
            value=parameter.value, std=std.get(parameter.name), hold_s=half_s * (parameter.name in delays)
        )
        for parameter in frequency.parameters
        if parameter.name in fitted.parameters.names and parameter.status != "dropped"
    }


def with_model_error(
    fitted: TimeFit, frequency: FrequencyFit, structure: LinearStructure, records: TimeRecords
) -> TimeFit:
    r"""The fit with what the structure leaves out beside its random errors, as the frequency domain shows it.

    .. math:: C = C_{random} + C_{model, f} + d d^T

    Records in time do not tell model error from noise. What the residuals of responses show of it, see
    :mod:`rotorid.uncertainty.model_error`, bends a fit of the same data in time as well, though not alike: with the
    distance :math:`d` between both where it exceeds what they state, hold of the inputs apart. Nothing tells which of
    the two is right. Where responses leave a
    parameter without a bound they have run away with it: then their errors are taken at the values of the fit in time.

    Parameters
    ----------
    fitted, records
        The fit in time, and what it was fitted to.
    frequency, structure
        The fit of responses of the same data. Parameters that only one of the two has keep their random errors.
    """
    bounds, names = fitted.bounds, list(fitted.bounds.names)
    shared = [name for name in frequency.bounds.names if name in names]
    if not shared:
        return fitted
    by_responses = frequency.bounds
    if grown(frequency.parameters, by_responses):
        by_responses = _bounds_beside(fitted, frequency, records)
    here = [names.index(name) for name in shared]
    there = [by_responses.names.index(name) for name in shared]
    added = np.zeros(bounds.covariance.shape)
    added[np.ix_(here, here)] = (by_responses.covariance - by_responses.random)[np.ix_(there, there)]
    std = np.sqrt(np.diag(bounds.covariance + added))
    distance = np.zeros(len(names))
    for name, other in compare_with(frequency, structure, fitted, records).items():
        if name in shared and other.std is not None:
            place = names.index(name)
            off = fitted.parameters[name].value + other.hold_s - other.value
            distance[place] = off if abs(off) > math.hypot(std[place], other.std) else 0.0
    return replace(fitted, bounds=replace(bounds, covariance=bounds.covariance + added + np.outer(distance, distance)))


def _bounds_beside(fitted: TimeFit, frequency: FrequencyFit, records: TimeRecords) -> Bounds:
    """What the responses of the same flights know of parameters at the values of a fit in time."""
    problem, theta = beside_responses(fitted, frequency, records)
    residual, jacobian = problem.residuals(theta)
    there = replace(frequency.final, theta=theta, residual=residual, jacobian=jacobian)
    return bounds(problem, there, weights=frequency.weights)


def require_bounds(fitted: TimeFit) -> None:
    """Refuse a model with a parameter that nothing bounds, for others take over whatever it does.

    Raises
    ------
    InsufficientDataError
        A parameter, no coupling, is ten times less certain than it is large.
    """
    structure = fitted.problem.structure
    if black_box_order(structure) is not None:
        return
    couplings = [one.name for one in structure.parameters if is_coupling(one)]
    loose = [name for name in grown(fitted.parameters, fitted.bounds) if name not in couplings]
    if not loose:
        return
    found = ", ".join(
        f"{name} is {fitted.parameters[name].value:.2g} ± {std:.1g} {fitted.parameters[name].unit}"
        for name, std in zip(fitted.bounds.names, map(float, fitted.bounds.std), strict=True)
        if name in loose
    )
    raise InsufficientDataError(
        f"nothing bounds {', '.join(loose)}: {found}",
        needed="records that tell them apart from the other parameters",
        remedy="take a smaller model, such as one of an order less, or hold one of them with --fix NAME=VALUE",
        findings=[refusal("not_identifiable", ", ".join(loose), f"{found}: other parameters take over what they do.")],
    )


def require_one_gain(fitted: TimeFit, frequency: FrequencyFit | None) -> None:
    """Refuse a model whose gain could as well have the other sign, its distance to that of the responses counted.

    Raises
    ------
    InsufficientDataError
        The gain lies within two standard deviations of zero.
    """
    gain = fitted.problem.structure.gain
    if gain is None or gain not in fitted.bounds.names:
        return
    if frequency is None or gain not in frequency.bounds.names:
        require_known_gain(gain, fitted.parameters, fitted.bounds)
        return
    here, there = fitted.parameters[gain], frequency.parameters[gain]
    std = float(fitted.bounds.std[fitted.bounds.names.index(gain)])
    if abs(here.value) >= CERTAIN_SIGN * std:
        return
    said = f"{gain} is {here.value:.4g} {here.unit} in time and {there.value:.4g} {here.unit} by the responses"
    raise InsufficientDataError(
        f"{said} of the same flights",
        needed="methods that agree on it, within a half of its size at least",
        remedy="take --method frequency or output_error, or hold what trades against it with --fix NAME=VALUE",
        findings=[refusal("not_identifiable", gain, f"{said}.", value=here.value, std=std, by_responses=there.value)],
    )


def judge_agreement(fitted: TimeFit, others: Mapping[str, Compared]) -> tuple[Finding, ...]:
    """A warning for each parameter that time and frequency domain know, and know differently."""
    # Their distance is part of what is stated: without it, what each knows of itself.
    std = dict(zip(fitted.bounds.names, map(float, fitted.bounds.random_std), strict=True))
    findings = []
    for name, other in others.items():
        if name not in std or other.std is None:
            continue
        value, combined = fitted.parameters[name].value, math.hypot(std[name], other.std)
        distance = abs(value + other.hold_s - other.value) / combined if combined > 0.0 else 0.0
        if distance > _APART:
            unit = fitted.parameters[name].unit
            held = (
                f" Of that, {1e3 * other.hold_s:.3g} ms are the hold of the input, which the response contains."
                if other.hold_s
                else ""
            )
            findings.append(
                warn(
                    "methods_disagree",
                    name,
                    f"{name} is {value:.4g} ± {std[name]:.2g} {unit} in the time domain and {other.value:.4g} ± "
                    f"{other.std:.2g} {unit} in the frequency domain, {distance:.1f} standard deviations apart."
                    f"{held} They weigh what the structure leaves out differently, or feedback biases one of them.",
                    time=value,
                    frequency=other.value,
                    distance_std=distance,
                    hold_s=other.hold_s,
                )
            )
    return tuple(findings)


def nothing_unseen(names: Sequence[str]) -> Finding:
    """What to say where a model was judged on nothing that it had not seen."""
    return warn(
        "not_verified",
        ", ".join(names),
        "Everything that was flown was fitted, so nothing is left to judge the model on. Give another log with "
        "--verify.",
    )


_REACH_S = 0.5
_MOST_LAGS = 40
_LEAST_LAGS = 5
_CHANCE = 1e-4
_MOST_LEVELS = 8
_SHARE, _SHARE_OF_SETPOINTS = 0.01, 0.05
"""Least share that counts. Resampled set-points are smeared over the samples around them by some percent."""


class Following(NamedTuple):
    """How an input follows an output's errors: share of its motion, and the chance of that without feedback."""

    output: str
    input: str
    share: float
    chance: float


def following(
    errors: Sequence[FloatArray],
    inputs: Sequence[FloatArray],
    *,
    input_names: Sequence[str],
    output_names: Sequence[str],
    sample_rate_hz: float,
) -> tuple[Following, ...]:
    """Every input against the past errors of every output; one of a few levels is a test signal, which follows nothing.

    A zero-phase filter on the outputs makes errors that know the inputs to come, which looks the same.

    Parameters
    ----------
    errors
        Output errors of each record, shape ``(y, n)``.
    inputs
        Inputs of the same records, shape ``(u, n)``.
    input_names, output_names
        Names of the rows.
    sample_rate_hz
        Of all records.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> error = rng.standard_normal(3000)
    >>> command = rng.standard_normal(3000)
    >>> command[2:] -= 0.5 * error[:-2]
    >>> found = following(
    ...     [error[None]], [command[None]], input_names=["roll_command"], output_names=["p"], sample_rate_hz=50.0
    ... )
    >>> round(found[0].share, 1), found[0].chance < 1e-6
    (0.2, True)
    """
    lags = int(np.clip(round(_REACH_S * sample_rate_hz), _LEAST_LAGS, _MOST_LAGS))
    found = []
    for y, output in enumerate(output_names):
        e = _whitened([one[y] for one in errors])
        for u, name in enumerate(input_names):
            if all(np.unique(one[u]).size <= _MOST_LEVELS for one in inputs):
                continue
            share, chance = _test(e, _whitened([one[u] for one in inputs]), lags)
            found.append(Following(output, name, share, chance))
    return tuple(found)


def _test(errors: Sequence[FloatArray], inputs: Sequence[FloatArray], lags: int) -> tuple[float, float]:
    from scipy.stats import chi2

    count = sum(one.size for one in errors)
    power = sum(float(one @ one) for one in errors) * sum(float(one @ one) for one in inputs)
    if power == 0.0:
        return 0.0, 1.0
    products = [
        sum(float(e[: e.size - lag] @ u[lag:]) for e, u in zip(errors, inputs, strict=True))
        for lag in range(1, lags + 1)
    ]
    share = float(np.sum(np.square(products))) / power
    # By chance alone every lag takes one part in N.
    return max(share - lags / count, 0.0), float(chi2.sf(count * share, lags))


def _whitened(parts: Sequence[FloatArray]) -> list[FloatArray]:
    """Records without what their own past explains."""
    centered = [part - part.mean() for part in parts]
    coefficients = autoregression([part[:, None] for part in centered]).coefficients[:, 0, 0]
    filtered = (np.convolve(part, np.concatenate([[1.0], -coefficients])) for part in centered)
    return [np.asarray(one[: part.size]) for one, part in zip(filtered, centered, strict=True)]


def judge_following(found: Sequence[Following]) -> tuple[Finding, ...]:
    """A warning for each input that follows the errors of an output: that of the output it follows most."""
    findings = []
    for name in dict.fromkeys(one.input for one in found):
        worst = max((one for one in found if one.input == name), key=lambda one: one.share)
        least = _SHARE if is_command(name) else _SHARE_OF_SETPOINTS
        if worst.chance < _CHANCE and worst.share > least:
            findings.append(_biased(worst))
    return tuple(findings)


def _biased(one: Following) -> Finding:
    return warn(
        "closed_loop_bias",
        f"{one.output}/{one.input}",
        f"{one.input} follows what the model could not explain in {one.output} ({100.0 * one.share:.0f} % of what "
        "its own past leaves), so a controller moved it. Plain output error is biased by that; --method "
        "prediction_error models the noise and is not.",
        share=one.share,
        chance=one.chance,
    )
