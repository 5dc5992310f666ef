"""Large motion: the method that fits a nonlinear structure to whole flights, such as drag or flight from commands.

Output error, as for responses to set-points: the model is simulated over each record from a start of its own, and what
it misses counts as noise at the outputs, whose covariance is estimated with the parameters. Signals are taken as they
stand in the log, since a model of large motion counts from no trim. Three rules choose what is fitted where nobody
said it: the outputs that the logs hold, without those that only integrate another one (a position beside its
velocity: its errors add up, and say nothing new); parameters that act only on what no moving input reaches are held;
and of several records each is fitted alone too, so that their scatter is seen and enters the intervals. Where wind
moves the vehicle, records are fitted in pieces with constants of their own (:mod:`rotorid.fitting.time.disturbed`).
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from rotorid.checking.checks import checks_of
from rotorid.checking.nonlinear import NonlinearPredictor, flown_records, logged_outputs
from rotorid.checking.predictions import whole_flights
from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, refusal, remark, warn
from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, TimeHistory
from rotorid.data.response import FrequencyResponse
from rotorid.errors import InsufficientDataError, RotoridError
from rotorid.fits.remarks import judge_combinations, judge_parameters
from rotorid.fits.scatter import Disagreement, LogEstimate, disagreements, name_of_stretch, with_scatter
from rotorid.fits.searching import Searched, judge_minima, search_summary, searched, searched_minima
from rotorid.fits.time.fit import explained_percents, simulated_records
from rotorid.fits.time.records_alone import nothing_alone
from rotorid.fits.time.refusals import does_not_describe, out_of_iterations, require_bounds, unexplained
from rotorid.fits.time.remarks import judge_colors, judge_explained, judge_solver, nothing_unseen, undriven_outputs
from rotorid.fits.time.summary import information_of, record_fits, residual_colors
from rotorid.fitting.least_squares import LevenbergMarquardt
from rotorid.fitting.time.disturbed import DISTURBED, PIECES_S, falls, left_over, pushed
from rotorid.fitting.time.nonlinear import NonlinearFit, NonlinearProblem, fit_nonlinear
from rotorid.fitting.time.output_error import TimeData, log_likelihood, moving
from rotorid.flights.coverage import covered_by
from rotorid.flights.flights import Flight
from rotorid.flights.segments import TimeRecords, source_of
from rotorid.flights.selection import Selection
from rotorid.identifying.methods import FitReport
from rotorid.models.library import THRUST_LIMIT
from rotorid.models.nonlinear import NonlinearStructure, linear_of
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.results.model import FittedData, SimulatedRecord, Verifications, bounds_of, no_response
from rotorid.results.summary import Checks, Fit, FitEnd
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.resolve import chosen_parameters
from rotorid.settings.verifying import VerifySettings
from rotorid.signal.step_response import CHANNELS as THRUST_CHANNELS
from rotorid.signal.step_response import thrust_over_weight
from rotorid.simulation.nonlinear import Scheme
from rotorid.uncertainty.clocks import channel_errors
from rotorid.uncertainty.cramer_rao import Bounds, bounds_of_parts
from rotorid.uncertainty.identifiability import unseen_combinations
from rotorid.uncertainty.propagation import pole_confidence
from rotorid.uncertainty.time_error import with_time_error

_PROGRESS = logging.getLogger("rotorid.progress")

_ABOUT_AS_MUCH = 3.0
"""Largest ratio of the sensitivities of a parameter between the best record and one compared with it."""


def asked_parameters(structure: NonlinearStructure, settings: IdentifySettings) -> ParameterSet:
    """The parameters of a structure as the user wants them.

    Raises
    ------
    UsageError
        Nothing is left free.
    ModelError
        A parameter, a constant or an output is unknown.
    """
    if settings.outputs:
        structure.select(settings.outputs)
    return chosen_parameters(structure.with_constants(settings.constants), settings)


class NonlinearData(NamedTuple):
    """Flights, and what of a nonlinear structure is fitted to them.

    Parameters
    ----------
    whole
        The model with all outputs that need no further parameters, such as positions beside velocities.
    structure
        Of the outputs that are fitted.
    parameters
        Of both, as the user wants them; those that nothing moves are held.
    records
        The same as inputs and outputs.
    """

    whole: NonlinearStructure
    structure: NonlinearStructure
    parameters: ParameterSet
    flights: tuple[Flight, ...]
    records: TimeRecords
    findings: tuple[Finding, ...]

    @property
    def response(self) -> FrequencyResponse | None:
        """None was measured."""
        return None

    @property
    def sources(self) -> Mapping[str, str]:
        """Source of each output in the first log."""
        return {name: source_of(self.records.segments[0], name) for name in self.structure.outputs}


@dataclass(frozen=True, kw_only=True, eq=False)
class FittedNonlinear(Immutable):
    """A fitted nonlinear structure.

    Parameters
    ----------
    model
        The whole structure, with its identified values.
    fit
        End of the search; of several pieces where they were asked for.
    bounds
        Of the free parameters, for residuals of any color, with the scatter of records.
    simulated
        Every record as measured and as the model has it.
    alone
        What each record says by itself, where there are several.
    scattered
        Parameters of which records say different things.
    search
        The search that the fit began at, if any.
    pieces_s
        Length of the pieces that records were cut into, if they were.
    disturbance
        What else moved the vehicle, if anything did.
    """

    model: NonlinearStructure
    outputs: tuple[str, ...]
    fit: NonlinearFit
    bounds: Bounds
    simulated: tuple[SimulatedRecord, ...]
    alone: tuple[LogEstimate, ...] = ()
    scattered: tuple[Disagreement, ...] = ()
    search: Searched | None = None
    pieces_s: float | None = None
    disturbance: Finding | None = None

    @cached_property
    def structure(self) -> LinearStructure:
        """Linearization for small motion about hover, if there is one."""
        return linear_of(self.model)

    @property
    def listed(self) -> ParameterSet:
        """All parameters."""
        return self.model.parameters

    @cached_property
    def fit_percent(self) -> dict[str, float]:
        """Output to the share of its motion that the model explains, over all records."""
        return explained_percents(self.fitted, self.simulated)

    @property
    def fitted(self) -> NonlinearStructure:
        """Structure of the outputs that were fitted."""
        return self.model.select(self.outputs)


class Posing(NamedTuple):
    """How records are posed: the structure that simulates them, and the length of their pieces."""

    structure: NonlinearStructure
    pieces_s: float | None
    disturbance: Finding | None = None


@dataclass(frozen=True, kw_only=True)
class Nonlinear:
    """Fit a nonlinear structure to whole flights.

    Parameters
    ----------
    flies
        Whether the model is one of motion through the air, which wind may move, and whose channels have clocks of their
        own. Other methods state the model error of theirs.
    """

    model: NonlinearStructure
    settings: IdentifySettings
    flies: bool = True
    problem: type[NonlinearProblem] = NonlinearProblem
    solver: LevenbergMarquardt = field(default_factory=LevenbergMarquardt)

    def prepare(self, records: Sequence[FlightRecord]) -> NonlinearData:
        """Prepare the flights as logged, and fix parameters that nothing in them moves."""
        parameters = asked_parameters(self.model, self.settings)
        model = self.model.with_constants(self.settings.constants)
        flights = whole_flights(records, self.settings.segments)
        outputs, left = _outputs(model, records, self.settings.outputs)
        structure = model.select(outputs)
        flown = flown_records(structure, flights, self.settings)
        parameters = parameters.only(structure.parameters.names)
        parameters, remarks = _fixed_at_rest(structure, parameters, flown.data)
        if not parameters.free:
            raise InsufficientDataError(
                f"no input of {structure.name} moves",
                needed=f"a flight in which {' or '.join(structure.inputs)} moves",
                findings=[refusal("no_excitation", structure.name, "No input of the model moves.")],
            )
        # Neither motor lag nor delay of a small multirotor is asked of drag and flight.
        findings = [finding for finding in flown.findings if "needed_hz" not in finding.numbers]
        known = set(structure.parameters.names)
        more = [name for name in model.outputs if set(model.select([name]).parameters.names) <= known]
        whole = model.select([name for name in model.outputs if name in more or name in outputs])
        return NonlinearData(whole, structure, parameters, flights, flown, (*findings, *left, *remarks))

    def fit(self, data: NonlinearData) -> FittedNonlinear:
        """Fit all records together, bound the parameters, and fit each record alone."""
        data = self._with_thrust_limit(data)
        structure, records = data.structure, data.records
        _PROGRESS.info(f"fitting {structure.name} by output error")
        posing = Posing(structure, self.settings.pieces_s)
        problem = self._posed(posing, data.parameters, records, records.data)
        search = searched(problem, self.settings)
        starts = [problem.start, *(basin.theta for basin in (search.minima if search else ()))]
        fits = [fit_nonlinear(problem, solver=self.solver, start=start) for start in starts]
        fit = min(fits, key=_likelihood)
        if not np.isfinite(fit.solution.cost):
            raise InsufficientDataError(
                f"{structure.name} has no finite simulation of these flights",
                needed="start values with which the model can be simulated",
                remedy="shorten the records with --pieces SECONDS, or give values with --fix NAME=VALUE",
                findings=[refusal("not_converged", structure.name, "The simulation diverges at the start values.")],
            )
        if self.flies:
            fit, posing = self._beside_wind(data, fit, posing)
        estimates = self._fit_each_record(data, fit, posing)
        scattered = disagreements(estimates)
        fitted = FittedNonlinear(
            model=replace(data.whole, parameters=fit.estimate.parameters),
            outputs=structure.outputs,
            fit=fit,
            bounds=self._bounds(data, fit, estimates, scattered),
            simulated=simulated_records(fit.problem.predicted(fit.solution.theta), records),
            alone=estimates,
            scattered=scattered,
            search=search,
            pieces_s=posing.pieces_s,
            disturbance=posing.disturbance,
        )
        _require_explained(fitted)
        return fitted

    def _with_thrust_limit(self, data: NonlinearData) -> NonlinearData:
        """With the limit of thrust near its value, or without one where the flight shows none.

        The search comes from below: a limit above all thrust that is asked for moves nothing.
        """
        structure, parameters = data.structure, data.parameters
        if THRUST_LIMIT not in parameters.free:
            return data
        unlimited = parameters.fix(THRUST_LIMIT, parameters[THRUST_LIMIT].upper)
        if not set(THRUST_CHANNELS) <= set(structure.outputs):
            return data._replace(parameters=unlimited)
        highest = max(_highest_thrust(structure, data.records.data), 1.0)
        low = parameters.with_values({THRUST_LIMIT: 0.5 * (1.0 + highest)})
        posing, records = Posing(structure, self.settings.pieces_s), data.records
        ended, free = (
            fit_nonlinear(self._posed(posing, chosen, records, records.data), solver=self.solver)
            for chosen in (low, unlimited)
        )
        if _likelihood(free) - _likelihood(ended) < _SHOWS_A_LIMIT:
            return data._replace(parameters=unlimited)
        near = ended.estimate.parameters[THRUST_LIMIT].value
        return data._replace(parameters=low.with_values({THRUST_LIMIT: near}))

    def _thrust_unlimited(self, data: NonlinearData, fitted: FittedNonlinear) -> Sequence[Finding]:
        """Up to where no limit of thrust shows, where one was looked for."""
        parameters = fitted.model.parameters
        if THRUST_LIMIT not in data.parameters.free or THRUST_LIMIT in parameters.free:
            return ()
        if not set(THRUST_CHANNELS) <= set(data.structure.outputs):
            needed = ", ".join(THRUST_CHANNELS)
            return (remark("thrust_limit", THRUST_LIMIT, f"A limit of thrust is not seen without {needed}."),)
        highest = _highest_thrust(data.structure, data.records.data)
        message = f"Thrust reached {highest:.2f} times the weight, and no limit shows up to there."
        return (remark("thrust_limit", THRUST_LIMIT, message, highest=highest),)

    def first_fit(self, data: NonlinearData) -> ParameterSet:
        """The parameters that fit all records best, without their bounds."""
        posing = Posing(data.structure, self.settings.pieces_s)
        problem = self._posed(posing, data.parameters, data.records, data.records.data)
        return fit_nonlinear(problem, solver=self.solver).estimate.parameters

    def _bounds(
        self,
        data: NonlinearData,
        fit: NonlinearFit,
        alone: Sequence[LogEstimate],
        scattered: Sequence[Disagreement],
    ) -> Bounds:
        """Random errors by the color of the residuals; what equations leave out, records that differ, and channels."""
        theta, names = fit.solution.theta, fit.problem.parameters.free
        parts = fit.problem.parts(theta)
        bounds = with_scatter(bounds_of_parts(parts, names), scattered)
        if not self.flies:
            return bounds
        return with_time_error(
            bounds, parts, alone=alone, added=channel_errors(fit.problem, theta, data.records.clocks)
        )

    def _beside_wind(self, data: NonlinearData, fit: NonlinearFit, posing: Posing) -> tuple[NonlinearFit, Posing]:
        """The fit in pieces with constants in the equations, where that explains what inputs do not.

        Records of one piece do not separate a constant from drag, and are left as they are.
        """
        longest_s = max(record.duration_s for record in data.records.data)
        theta, free = fit.solution.theta, fit.problem.parameters.free
        if longest_s < 2.0 * PIECES_S[-1] or bounds_of_parts(fit.problem.parts(theta), free).inflation ** 2 < DISTURBED:
            return fit, posing
        structure = pushed(posing.structure, free)
        lengths_s = [posing.pieces_s] if posing.pieces_s is not None else [*PIECES_S, None]
        _PROGRESS.info(f"fitting {posing.structure.name} in wind")
        found: list[tuple[NonlinearFit, Posing]] = []
        for length_s in lengths_s:
            other = Posing(structure, length_s)
            problem = self._posed(other, fit.estimate.parameters, data.records, data.records.data)
            try:
                one = fit_nonlinear(problem, solver=self.solver)
                bounds_of_parts(one.problem.parts(one.solution.theta), free)
            except RotoridError:  # constants take what a parameter does
                continue
            if np.isfinite(one.solution.cost):
                found.append((one, other))
        if not found:
            return fit, posing
        least = left_over(found[0][0])
        ratio = falls(left_over(fit), least)
        if not ratio.max() >= DISTURBED:
            return fit, posing
        chosen, other = next(pair for pair in reversed(found) if (falls(left_over(pair[0]), least) < DISTURBED).all())
        row = int(np.argmax(ratio))
        whole, piece = np.sqrt(left_over(fit)[row]), np.sqrt(left_over(chosen)[row])
        return chosen, other._replace(disturbance=_disturbance(posing.structure, row, whole, piece, other.pieces_s))

    def _posed(
        self, posing: Posing, parameters: ParameterSet, records: TimeRecords, data: Sequence[TimeData]
    ) -> NonlinearProblem:
        length_s = posing.pieces_s
        parts = data if length_s is None else [piece for record in data for piece in record.pieces(length_s)]
        scheme = Scheme(hold=records.hold)
        return self.problem(structure=posing.structure, parameters=parameters, records=tuple(parts), scheme=scheme)

    def _fit_each_record(self, data: NonlinearData, fit: NonlinearFit, posing: Posing) -> tuple[LogEstimate, ...]:
        """The fit of each record alone, started from that of all, with the reason where there is not enough data."""
        if len(data.records.data) < 2:
            return ()
        free = fit.estimate.parameters.free
        found, shown = [], _shown(fit, data.records)
        for place, (segment, record) in enumerate(zip(data.records.segments, data.records.data, strict=True)):
            _PROGRESS.info(f"fitting {record.name} alone", extra={"done": place, "total": len(data.records.data)})
            parameters, at_rest = _fixed_at_rest(data.structure, fit.estimate.parameters, [record])
            missing = {finding.where: finding.message.partition(", so ")[0] for finding in at_rest}
            if not moving(record.inputs).any():
                found.append(nothing_alone(segment, free, "no input of the model moved"))
                continue
            if not parameters.free:
                found.append(replace(nothing_alone(segment, (), ""), missing=missing))
                continue
            try:
                item = fit_nonlinear(self._posed(posing, parameters, data.records, [record]), solver=self.solver)
                bounds = bounds_of_parts(item.problem.parts(item.solution.theta), parameters.free)
            except RotoridError as error:  # a record may be too short for what all show together
                short = nothing_alone(segment, parameters.free, error.came)
                found.append(replace(short, missing={**short.missing, **missing}))
                continue
            little = f"another record moves what it acts on more than {_ABOUT_AS_MUCH:g} times as much"
            missing |= {name: little for name in bounds.names if not shown[place][name]}
            found.append(
                LogEstimate(
                    record=name_of_stretch(segment.record, segment.history.start_s),
                    values=item.estimate.parameters.values,
                    stds={n: std for n, std in zip(bounds.names, bounds.std.tolist(), strict=True) if shown[place][n]},
                    missing=missing,
                )
            )
        return tuple(found)

    def verify(self, data: NonlinearData, fitted: FittedNonlinear, records: Sequence[FlightRecord]) -> Verifications:
        """Simulate further logs from their start on."""
        if not records:
            names = list(dict.fromkeys(segment.record for segment in data.records.segments))
            return Verifications(findings=(nothing_unseen(names),))
        selection = Selection(fitted=data.flights, unseen=())
        return NonlinearPredictor(fitted.model).predict(records, VerifySettings(), selection).found

    def checks(self, fitted: FittedNonlinear, found: Verifications) -> Checks:  # noqa: ARG002 - as all methods
        """Scores of the flights."""
        return checks_of(found, ())

    def describe(self, data: NonlinearData, fitted: FittedNonlinear) -> FitReport:
        """Fits of the records and their residuals."""
        structure, solution = fitted.structure, fitted.fit.solution
        response, problem = no_response(structure), fitted.fit.problem
        noise = np.sqrt(problem.noise.diagonal())
        outputs = len(fitted.outputs)
        numbers = len(fitted.bounds.names) + problem.most_unknowns + outputs * (outputs + 1) // 2
        likelihood = log_likelihood(problem)
        fits = record_fits(
            fitted.simulated, data.records, fitted.fitted, parameters=fitted.model.parameters, alone=fitted.alone
        )
        linear = fitted.structure.parameters
        return FitReport(
            fit=Fit(
                method="output_error",
                outputs=fitted.outputs,
                end=FitEnd(
                    weights="likelihood",
                    outcome=solution.outcome.value,
                    evaluations=solution.evaluations,
                    trace=tuple(solution.trace),
                    inflation=fitted.bounds.inflation,
                ),
                fit_percent=fitted.fit_percent,
                hold=data.records.hold,
                pieces_s=fitted.pieces_s,
                records=fits,
                noise=dict(zip(fitted.outputs, map(float, noise), strict=True)),
                log_likelihood=likelihood,
                information=information_of(likelihood, numbers, problem.samples * outputs),
                residuals=residual_colors(
                    fitted.simulated, fitted.outputs, fitted.bounds, data.records.data[0].sample_rate_hz
                ),
                minima=searched_minima(fitted.search),
                search=search_summary(fitted.search),
            ),
            data=FittedData(
                response=response,
                direct=None,
                model_response=response.values,
                used=np.zeros(response.values.shape, dtype=np.bool_),
                segments=data.records.segments,
                simulated=fitted.simulated,
            ),
            combinations=unseen_combinations(fitted.model.parameters, fitted.bounds),
            # A model that does not rest at zero has no small motion about it, and no poles.
            poles=pole_confidence(structure, linear, bounds_of(fitted.bounds, linear.free)) if linear.free else (),
            covered=covered_by(data.flights),
            nonlinear=fitted.model,
        )

    def remarks(self, data: NonlinearData, fitted: FittedNonlinear, report: FitReport) -> Sequence[Finding]:
        """On the fit, its residuals and parameters, and on records that disagree."""
        units = {parameter.name: parameter.unit for parameter in fitted.model.parameters}
        step_s = 1.0 / data.records.data[0].sample_rate_hz
        return (
            *((fitted.disturbance,) if fitted.disturbance is not None else ()),
            *self._thrust_unlimited(data, fitted),
            *judge_explained(fitted.fit_percent),
            *undriven_outputs(fitted.fitted, fitted.simulated, fitted.fit_percent),
            *judge_colors(fitted.model.name, fitted.bounds, step_s),
            *judge_solver(fitted.model.name, fitted.fit.solution, fitted.model.parameters, fitted.model.input_delays),
            *judge_parameters(fitted.model.parameters, fitted.bounds),
            *judge_minima(fitted.search, fitted.model.parameters, fitted.bounds),
            *judge_combinations(report.combinations),
            *(disagreement.finding(units[disagreement.parameter]) for disagreement in fitted.scattered),
        )


def _outputs(
    model: NonlinearStructure, records: Sequence[FlightRecord], asked: Sequence[str]
) -> tuple[tuple[str, ...], tuple[Finding, ...]]:
    """Outputs to fit, and a remark on those that are left out.

    Raises
    ------
    InsufficientDataError
        The logs hold none.
    """
    if asked:
        return tuple(asked), ()
    logged = logged_outputs(model, records)
    rates = dict(zip(model.states, model.equations, strict=True))
    own = {
        name for name, expression in zip(model.outputs, model.output_equations, strict=True) if str(expression) == name
    }
    integrals = [name for name in logged if name in own and str(rates[name]) in logged and str(rates[name]) in own]
    chosen = tuple(name for name in logged if name not in integrals)
    if not chosen:
        names = ", ".join(record.source.name for record in records)
        raise InsufficientDataError(
            f"{names} contains none of {', '.join(model.outputs)}",
            needed="an output of the model",
            remedy="name its source with --map",
            findings=[refusal("missing_channel", name, f"{name} is in no log.") for name in model.outputs],
        )
    remarks = [
        remark(
            "outputs_left_out",
            name,
            f"{name} is the integral of {rates[name]}, which is fitted, so it was left out; choose others with "
            "--outputs.",
        )
        for name in integrals
    ]
    missing = [name for name in model.outputs if name not in logged]
    remarks += [
        remark("missing_channel", name, f"{name} is not in every log, so it was not fitted.") for name in missing
    ]
    return chosen, tuple(remarks)


def _shown(fit: NonlinearFit, records: TimeRecords) -> list[dict[str, bool]]:
    """For each record, whether it moves what a parameter acts on about as much as the record does that moves it most.

    One that hardly does so turns a small error of a sensor into a large one of the parameter, which says nothing of the
    other records.
    """
    names = fit.estimate.parameters.free
    parts = iter(fit.problem.parts(fit.solution.theta))
    sizes = []
    for data in records.data:
        total, samples = np.zeros(len(names)), 0
        while samples < data.samples:
            slopes = next(parts).slopes[:, :, : len(names)]
            total, samples = total + np.sum(slopes**2, axis=(0, 1)), samples + slopes.shape[0]
        sizes.append(np.sqrt(total))
    most = np.max(sizes, axis=0)
    return [dict(zip(names, (size * _ABOUT_AS_MUCH >= most).tolist(), strict=True)) for size in sizes]


def _fixed_at_rest(
    structure: NonlinearStructure, parameters: ParameterSet, data: Sequence[TimeData]
) -> tuple[ParameterSet, tuple[Finding, ...]]:
    """Parameters with those fixed that act only on states moved by inputs that do not move."""
    moving = {
        name for row, name in enumerate(structure.inputs) if any(np.ptp(record.inputs[row]) > 0.0 for record in data)
    }
    still = [name for name in structure.inputs if name not in moving]
    if not still or not moving:
        return parameters, ()
    asleep = structure.reached(still) - structure.reached(moving)
    rows = dict(zip(structure.states, structure.equations, strict=True))
    delays = dict(zip(structure.inputs, structure.input_delays, strict=True))
    awake = [
        *(expression for state, expression in rows.items() if state not in asleep),
        *(delays[name] for name in moving),
    ]
    awake += [
        expression
        for expression in structure.output_equations
        if not (expression.names & set(structure.states)) <= asleep
    ]
    used = frozenset().union(*(expression.names for expression in awake)) if awake else frozenset()
    fixed = [name for name in parameters.free if name not in parameters.only(used & set(parameters.names)).names]
    for name in fixed:
        parameters = parameters.fix(name, parameters[name].value)
    words = f"{' and '.join(still)} did not move"
    return parameters, tuple(
        remark("no_excitation", name, f"{words}, so {name} was fixed at {parameters[name].value:g}.") for name in fixed
    )


def _disturbance(
    structure: NonlinearStructure, row: int, whole: float, piece: float, pieces_s: float | None
) -> Finding:
    """A warning about what moved the vehicle besides its inputs."""
    name = structure.outputs[row]
    where = f"in pieces of {pieces_s:g} s with constants" if pieces_s is not None else "with constants"
    return warn(
        "disturbed_flight",
        name,
        f"The inputs do not explain the whole motion: the simulation misses {name} by {whole:.2g}, or by {piece:.2g} "
        f"{where} in the equations, which were therefore fitted too. Causes are wind, a trim, or another law of drag. "
        "Fly in still air for smaller errors.",
        whole=whole,
        piece=piece,
    )


def _likelihood(fit: NonlinearFit) -> float:
    """Cost of a fit for comparison with others of the same records; less is better."""
    return -log_likelihood(fit.problem) if np.isfinite(fit.solution.cost) else math.inf


_SHOWS_A_LIMIT = 10.0
"""Gain of the log-likelihood from which a limit of thrust is more than the highest peak of a record with its noise."""

_SMOOTH_RAD_S = 12.0
"""Thrust is asked of motion up to here; noise of the velocity above is larger than thrust."""


def _highest_thrust(structure: NonlinearStructure, records: Sequence[TimeData]) -> float:
    """Highest thrust over weight of all records."""
    channels = tuple(Channel(name=name, unit=STANDARD_UNITS[name]) for name in structure.outputs)
    flown = [
        TimeHistory(values=record.outputs, sample_rate_hz=record.sample_rate_hz, start_s=0.0, channels=channels)
        for record in records
    ]
    return float(max(thrust_over_weight(one, cutoff_rad_s=_SMOOTH_RAD_S).max() for one in flown))


def _require_explained(fitted: FittedNonlinear) -> None:
    """Refuse a search without an end, a simulation that leaves more than it explains, and values without bounds."""
    reasons = [*unexplained(fitted.fit_percent), *out_of_iterations(fitted.model.name, fitted.fit.solution)]
    if reasons:
        remedy = "use other outputs, a model with the missing dynamics, or segments in which the inputs move it"
        raise does_not_describe(fitted.model.name, reasons, remedy)
    require_bounds(fitted.model.parameters, fitted.bounds)
