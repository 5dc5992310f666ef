"""A fit in the time domain: from records to a model with bounds.

:func:`fit_in_time` begins at the frequency-domain fit of the same data where there is one, else at the start values of
the structure, and ends with output error, prediction error or equation error. Bounds come from what is left of the
outputs, or of the equations of motion, corrected for its color.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.findings import Finding
from rotorid.errors import RotoridError, UsageError
from rotorid.fits.bootstrapping import Bootstrap
from rotorid.fits.frequency.fit import FrequencyFit
from rotorid.fits.scatter import LogEstimate, disagreements, with_scatter
from rotorid.fits.searching import Searched, refuse_search, searched
from rotorid.fits.time.records_alone import (
    bounds_in_time,
    errors_of_channels,
    estimate_of,
    fit_each_record,
    not_repeated,
    nothing_alone,
    parts_at,
    repeated,
)
from rotorid.fitting.equations.equation_error import EquationErrorFit, EquationScore, fit_equation_error
from rotorid.fitting.equations.regression import InBand, InTime
from rotorid.fitting.equations.rows import EquationDomain
from rotorid.fitting.least_squares import Solution
from rotorid.fitting.problem import Part
from rotorid.fitting.time.output_error import (
    Fitted,
    InitialCondition,
    OutputErrorFit,
    RecordsProblem,
    TimeData,
    TimeProblem,
    fit_output_error,
    log_likelihood,
    own_starts,
)
from rotorid.flights.instruments import is_command
from rotorid.flights.segments import TimeRecords
from rotorid.models.families import black_box_order, family_of
from rotorid.models.nonlinear import NonlinearStructure
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.results.model import SimulatedRecord
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.resolve import chosen_parameters
from rotorid.typing import FloatArray
from rotorid.uncertainty.cramer_rao import Bounds
from rotorid.uncertainty.sandwich import by_lines
from rotorid.uncertainty.time_error import by_records, grown, with_time_error
from rotorid.verification.driven import driven

_PROGRESS = logging.getLogger("rotorid.progress")


def equation_bounds(
    fit: EquationErrorFit,
    domain: EquationDomain,
    *,
    sample_rate_hz: float = 1.0,
    alone: Sequence[LogEstimate] = (),
    added: Sequence[Mapping[str, float]] = (),
) -> Bounds:
    r"""Bounds of an equation-error fit, from :math:`F = J^T J` of its weighted equations.

    Percents are formed as by :func:`rotorid.uncertainty.cramer_rao.bounds_of_parts`. The random covariance is that of
    the fit, for residuals of any color, and ``colored`` compares it with white ones; the model error is that of all
    fits in time. None of them knows the bias by noise in measured states.

    Parameters
    ----------
    domain
        Of the equations.
    alone, added
        See :func:`rotorid.uncertainty.time_error.with_time_error`.
    """
    fisher = fit.solution.jacobian.T @ fit.solution.jacobian
    length = np.sqrt(fisher.diagonal())
    white = np.sqrt(np.linalg.inv(fisher / np.outer(length, length)).diagonal()) / length
    ratio = np.log(fit.covariance.diagonal() / white**2)
    random = Bounds(
        names=fit.names,
        cramer_rao=2.0 * white,
        insensitivity=1.0 / length,
        covariance=fit.covariance,
        random=fit.covariance,
        colored=math.exp(0.5 * float(np.mean(ratio))),
    )
    random = with_scatter(random, disagreements(alone))
    parts = fit.parts(sample_rate_hz)
    if not isinstance(domain, InBand):
        return with_time_error(random, parts, alone=alone, added=added)
    lines = [np.linspace(*domain.band_rad_s, len(part.residual) // 2) for part in parts]
    return grown(random, [by_records(random, alone), by_lines(parts, lines).diagonal()], added)


TimeMethod: TypeAlias = Literal["output_error", "prediction_error", "equation_error"]

_GROWTHS = 2.0
"""How many times a mode may grow e-fold within a piece: with more, its start decides all that follows."""

_LEAST_PIECE = 20
"""Samples of a piece at least."""

_LEAST_NOISE = 1e-10
"""Of the errors that outputs are given, so that their covariance is regular."""

_ALIKE = 1.5
"""Factor within which two lengths of pieces count as the same."""

_ROUNDS = 3
"""Fits at most, each in pieces as short as the modes of the one before need."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TimeFit(Immutable):
    """A model that was fitted in the time domain, with what is known about it.

    Parameters
    ----------
    problem
        Its simulation over the records, or over pieces of them; at the covariance of the output errors.
    solution
        How the solver ended.
    parameters
        The identified values.
    listed
        The same with those that were dropped before.
    bounds
        Their uncertainty: random errors by the color of the residuals, model error and clocks.
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
    alone
        Each record fitted alone, where there are several that move every input.
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
    alone: tuple[LogEstimate, ...] = ()
    equations: tuple[EquationScore, ...] = ()
    search: Searched | None = None
    bootstrap: Bootstrap | None = None
    simulated: tuple[SimulatedRecord, ...] = ()

    @property
    def structure(self) -> LinearStructure:
        """Structure of the values, without states that a dropped lag has left without dynamics."""
        return self.problem.structure.condensed(self.parameters)

    @property
    def fit_percent(self) -> dict[str, float]:
        """Output to the share of its motion about the mean of each record that the model explains, all together."""
        return explained_percents(self.structure, self.simulated)


def explained_percents(
    structure: LinearStructure | NonlinearStructure, simulated: Sequence[SimulatedRecord]
) -> dict[str, float]:
    """Output to the share of its motion about the mean of each record that a simulation explains, all together.

    Records count in which an input moves the output, and an output without such a record has no share.
    """
    moved = [driven(structure, record.inputs) for record in simulated]
    percents = {}
    for row, name in enumerate(structure.outputs):
        shown = [(record, one) for record, one in zip(simulated, moved, strict=True) if name in one.outputs]
        missed = sum(float(np.sum((record.measured[row] - record.simulated[row]) ** 2)) for record, _ in shown)
        motion = sum(float(np.sum((record.measured[row] - record.measured[row].mean()) ** 2)) for record, _ in shown)
        if motion > 0.0:
            percent = 100.0 * (1.0 - math.sqrt(missed / motion))
            if any(math.isfinite(one.judged(name, percent)) for _, one in shown):
                percents[name] = percent
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
    posed: RecordsProblem | None = None
    bounds: Bounds | None = None
    alone: tuple[LogEstimate, ...] = ()


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
        structure, parameters = _from_frequency_fit(structure, parameters, frequency)
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
    return _bounded(ended._replace(search=ended.search or search), whole, method, records)


def _from_frequency_fit(
    structure: LinearStructure, parameters: ParameterSet, frequency: FrequencyFit
) -> tuple[LinearStructure, ParameterSet]:
    """A structure at the values of the frequency domain.

    Of a vehicle it stays without what was dropped there. A response in time shows delays that one of few samples for
    each period does not.
    """
    if all(is_command(name) for name in structure.inputs):
        return frequency.structure, frequency.structure.parameters
    known = {
        parameter.name: parameter.value
        for parameter in frequency.parameters
        if parameter.status == "free" and parameter.name in parameters.free
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
        starts += [basin.theta for basin in search.minima] if search else []
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
    data = records.data if length_s is None else tuple(p for record in records.data for p in record.pieces(length_s))
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
        start = _simulating(structure, parameters, records, settings, seeded=False)
        structure, parameters, search = start.problem.structure, start.problem.parameters, start.search
    problem = InnovationsProblem(
        structure=structure,
        parameters=parameters,
        records=records.data,
        hold=records.hold,
        unknowns=unknowns_of(structure),
    )
    fit = fit_prediction_error(problem)
    parts = parts_at(fit.problem, fit.solution)
    length_s = settings.pieces_s or piece_s(structure, fit.parameters, records.data)
    shown = posed_in_pieces(structure, fit.parameters, records, length_s).with_noise(fit.noise_covariance)
    return _Ended(
        shown,
        fit.solution,
        parts,
        fit.log_likelihood,
        length_s,
        noise_numbers=parts[0].slopes.shape[2] - len(parameters.free),
        search=search,
        posed=fit.problem,
    )


def _by_equations(
    structure: LinearStructure,
    parameters: ParameterSet,
    records: TimeRecords,
    settings: IdentifySettings,
    frequency: FrequencyFit | None,
) -> _Ended:
    """Equation error, over the band of the responses where there are any; the records are simulated to show it."""
    if family_of(structure).opaque:
        raise UsageError(
            f"equation_error does not work with {structure.name}, a black box whose states are not measured",
            remedy="use --method output_error or prediction_error",
        )
    band_rad_s = settings.band_rad_s or (frequency.band_rad_s if frequency is not None else None)
    domain = InTime() if band_rad_s is None else InBand(band_rad_s=band_rad_s)
    fit = fit_equation_error(structure, parameters, records.data, domain=domain, hold=records.hold)
    found = _without(fit.parameters, fit.left)
    length_s = settings.pieces_s or piece_s(structure, found, records.data)
    problem = posed_in_pieces(structure, found, records, length_s)
    errors = np.hstack([fitted.record.outputs - fitted.predicted for fitted in problem.predicted(found.pack())])
    noise = errors @ errors.T / errors.shape[1] + _LEAST_NOISE * problem.noise
    problem = problem.with_noise(noise)
    rate_hz = min(record.sample_rate_hz for record in records.data)
    added = errors_of_channels(problem, found.pack(), records.clocks)
    alone = _equations_of_each(structure, found, records, domain)
    bounds = equation_bounds(fit, domain, sample_rate_hz=rate_hz, alone=alone, added=added)
    return _Ended(
        problem,
        fit.solution,
        problem.parts(found.pack()),
        log_likelihood(problem),
        length_s,
        fit.findings,
        fit,
        bounds=bounds,
        alone=alone,
    )


def _equations_of_each(
    structure: LinearStructure, parameters: ParameterSet, records: TimeRecords, domain: EquationDomain
) -> tuple[LogEstimate, ...]:
    """The equations of each record alone, where there are several that move every input, or why not."""
    if not repeated(records):
        return not_repeated(structure.inputs, records, parameters.free)
    found = []
    for segment, data in zip(records.segments, records.data, strict=True):
        try:
            fit = fit_equation_error(structure, parameters, [data], domain=domain, hold=records.hold)
            own = equation_bounds(fit, domain, sample_rate_hz=data.sample_rate_hz)
        except RotoridError as error:  # a record may be too short for what all show together
            found.append(nothing_alone(segment, parameters.free, error.came))
        else:
            found.append(estimate_of(segment, fit.parameters, own))
    return tuple(found)


def _without(parameters: ParameterSet, left: Sequence[str]) -> ParameterSet:
    """A set in which what was not estimated is no longer free."""
    for name in set(left) & set(parameters.free):
        parameters = parameters.fix(name, parameters[name].value)
    return parameters


def _ended(fit: OutputErrorFit, length_s: float | None = None, findings: tuple[Finding, ...] = ()) -> _Ended:
    parts = fit.problem.parts(fit.solution.theta)
    problem = fit.problem.with_parameters(fit.parameters)
    return _Ended(problem, fit.solution, parts, fit.log_likelihood, length_s, findings, posed=fit.problem)


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
            f"--fix, --tie and --free do not work with {structure.name}, which has no values yet",
            remedy="give a black box with values, such as a model.toml",
        )
    refuse_search(settings, structure.name, "a black box starts from subspace identification; leave it out")
    if settings.pieces_s is not None:
        raise UsageError(
            f"--pieces does not work with {structure.name}",
            remedy="a black box is fitted to whole records; leave it out",
        )
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
    """Unknowns estimated with the parameters: for commands also their trim, which a vehicle integrates."""
    if all(is_command(name) for name in structure.inputs) and not family_of(structure).opaque:
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


def _bounded(ended: _Ended, whole: ParameterSet, method: TimeMethod, records: TimeRecords) -> TimeFit:
    parameters, posed = ended.problem.parameters, ended.posed
    by = ended.by_equations
    alone = ended.alone
    if by is not None:
        assert ended.bounds is not None
        bounds, whole = ended.bounds, _without(whole, by.left)
    else:
        assert posed is not None
        # Single numbers of a black box mean nothing, and neither does their scatter.
        alone = () if family_of(posed.structure).opaque else fit_each_record(posed, ended.solution, records)
        bounds = bounds_in_time(posed, ended.solution, alone=alone, clocks=records.clocks)
    scattered = disagreements(alone)
    units = {parameter.name: parameter.unit for parameter in parameters}
    disagreeing = tuple(disagreement.finding(units[disagreement.parameter]) for disagreement in scattered)
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
        findings=(*ended.findings, *disagreeing),
        alone=alone,
        equations=() if by is None else by.equations,
        search=ended.search,
    )


def simulated_records(predicted: Sequence[Fitted], records: TimeRecords) -> tuple[SimulatedRecord, ...]:
    """Every record as it was measured and as the model has it; pieces are joined again."""
    pieces = iter(predicted)
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
