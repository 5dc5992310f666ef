"""How a linear model is fitted: what data it needs, its fit with bounds, and what is remarked on it.

Each method has the same few verbs, so that :func:`rotorid.identify` is one way for all of them. Responses are fitted in
the frequency domain; output error, prediction error and equation error fit the records themselves, and compare with
the frequency domain where that can answer too. Physics of motors is in :mod:`rotorid.identifying.motors`.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from rotorid.checking.candidate import Candidate, output_sources
from rotorid.checking.checks import checks_of
from rotorid.checking.linear import LinearPredictor, candidate_of
from rotorid.checking.responses import FittedResponses
from rotorid.checking.sweeps import hold_out
from rotorid.data.findings import Finding, remark
from rotorid.data.record import FlightRecord
from rotorid.data.response import FrequencyResponse
from rotorid.errors import UsageError
from rotorid.fits.bootstrapping import bootstrap, require_bootstrap
from rotorid.fits.data_requirements import require_known_gain
from rotorid.fits.frequency.fit import FrequencyFit, cost_of
from rotorid.fits.frequency.inverse import Screened, pose_screened
from rotorid.fits.frequency.refusals import fit_or_refuse
from rotorid.fits.frequency.scatter_between_flights import with_scatter
from rotorid.fits.frequency.speed_damping import first_step, without_first
from rotorid.fits.frequency.trim_choice import best_trim
from rotorid.fits.remarks import judge_assumed, judge_combinations
from rotorid.fits.searching import judge_minima, refuse_search, search_summary, searched_minima
from rotorid.fits.time.feedback import following, judge_following
from rotorid.fits.time.fit import TimeFit, TimeMethod, fit_in_time, simulated_records
from rotorid.fits.time.frequency_check import (
    FrequencySide,
    compare_with,
    frequency_side,
    hold_response,
    require_one_gain,
    responses_without_hold,
    with_distance,
)
from rotorid.fits.time.refusals import require_bounds, require_time_fit_explains
from rotorid.fits.time.remarks import judge_time_fit, nothing_unseen
from rotorid.fits.time.summary import equation_fits, information, record_fits, residuals
from rotorid.fitting.frequency.screening import is_coupling
from rotorid.fitting.least_squares import Solution
from rotorid.flights.consistency import data_quality, sensor_agreement, sensor_errors
from rotorid.flights.coverage import covered_by
from rotorid.flights.flights import Flight
from rotorid.flights.instruments import is_command
from rotorid.flights.measure import Measured, filter_delays, given_filters_kept, measure
from rotorid.flights.segments import TimeRecords, source_of, time_records
from rotorid.flights.selection import Selection, select_records
from rotorid.flights.sensors import corrected_record, sensor_correction, with_sensor_errors
from rotorid.flights.supports import supporting_logs
from rotorid.flights.unchecked import equal_delays, with_equal_delays
from rotorid.identifying.delay_budget import delay_budget
from rotorid.identifying.scope import (
    require_common_axes,
    scoped,
    trimmed,
    trimmed_in_wind,
    with_channels_of,
    with_spread,
)
from rotorid.models.families import family_of, is_rate_model, order_is_open
from rotorid.models.input_units import absent_motors
from rotorid.models.nonlinear import NonlinearStructure
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.reduction.guided import Step
from rotorid.results.model import FittedData, Verifications, no_response
from rotorid.results.summary import (
    Checks,
    Cost,
    DelayBudget,
    Fit,
    FitEnd,
    FitWeights,
    FlightPhysics,
    Minimum,
    MotorPhysics,
    OrderChoice,
    Range,
    ReductionStep,
    finite,
)
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.measuring import MeasureSettings
from rotorid.settings.option import Settings
from rotorid.settings.verifying import VerifySettings
from rotorid.signal.sensor_correction import SensorCorrection
from rotorid.uncertainty.cramer_rao import Bounds
from rotorid.uncertainty.identifiability import Combination, unseen_combinations
from rotorid.uncertainty.propagation import Pole, pole_confidence

_SWEPT_TO_RAD_S = 10.0
"""By most excitations whose band nothing says."""

_PROGRESS = logging.getLogger("rotorid.progress")


class Prepared(Protocol):
    """Data of a fit: what was flown, on one clock."""

    @property
    def flights(self) -> Sequence[Flight]:
        """Records and maneuvers that are fitted."""
        ...

    @property
    def findings(self) -> Sequence[Finding]:
        """Remarks on the way from the logs."""
        ...

    @property
    def response(self) -> FrequencyResponse | None:
        """The measured response, where there is one."""
        ...

    @property
    def sources(self) -> Mapping[str, str]:
        """Source of each channel in the logs."""
        ...


class Fitted(Protocol):
    """End of a fit: values and bounds."""

    @property
    def structure(self) -> LinearStructure:
        """The model with its identified values."""
        ...

    @property
    def listed(self) -> ParameterSet:
        """All parameters with their values, dropped ones included."""
        ...

    @property
    def bounds(self) -> Bounds:
        """Of the free ones."""
        ...


class FitReport(NamedTuple):
    """Report of a finished fit.

    Parameters
    ----------
    fit
        How it went.
    data
        What it was made to.
    combinations
        Parameters that the data cannot separate.
    poles
        With their uncertainty.
    delays, covered, motors, flight, nonlinear
        As in :class:`rotorid.results.model.IdentifiedModel`.
    """

    fit: Fit
    data: FittedData
    combinations: Sequence[Combination] = ()
    poles: Sequence[Pole] = ()
    delays: Mapping[str, DelayBudget] = {}
    covered: Mapping[str, Range] = {}
    motors: MotorPhysics | None = None
    flight: FlightPhysics | None = None
    nonlinear: NonlinearStructure | None = None


DataT = TypeVar("DataT", bound=Prepared)
FittedT = TypeVar("FittedT", bound=Fitted)


class Method(Protocol[DataT, FittedT]):
    """A way to fit a model to flights."""

    @property
    def settings(self) -> Settings:
        """Choices of the run."""
        ...

    def prepare(self, records: Sequence[FlightRecord]) -> DataT:
        """Find what was flown, cut it out of the logs, and bring it on one clock."""
        ...

    def fit(self, data: DataT) -> FittedT:
        """Values of the parameters, and their bounds."""
        ...

    def verify(self, data: DataT, fitted: FittedT, records: Sequence[FlightRecord]) -> Verifications:
        """Predictions of unfitted flights: of the same logs, and of further ones."""
        ...

    def checks(self, fitted: FittedT, found: Verifications) -> Checks:
        """The same in numbers."""
        ...

    def describe(self, data: DataT, fitted: FittedT) -> FitReport:
        """Report of the fit."""
        ...

    def remarks(self, data: DataT, fitted: FittedT, report: FitReport) -> Sequence[Finding]:
        """Findings on the fit."""
        ...


@dataclass(frozen=True, kw_only=True)
class _Linear(Generic[DataT]):
    """A linear model and how to fit it.

    Parameters
    ----------
    model
        The whole model.
    """

    model: LinearStructure
    settings: IdentifySettings

    def checks(self, fitted: Fitted, found: Verifications) -> Checks:
        """Scores of maneuvers, and costs on sweeps."""
        return checks_of(found, fitted.structure.states)


class StructureAndLogs(NamedTuple):
    """Structure and data of a fit."""

    structure: LinearStructure
    selection: Selection
    findings: tuple[Finding, ...]


def choose(
    model: LinearStructure,
    records: Sequence[FlightRecord],
    settings: IdentifySettings,
    *,
    in_time: bool,
    outputs: tuple[str, ...] = (),
) -> StructureAndLogs:
    """The maneuvers to fit, and the model cut to what they can show, at their trim.

    Parameters
    ----------
    model, records, settings
        As for :func:`rotorid.identify`.
    in_time
        Whether any motion of an input shows a response to set-points, as it does in time.
    outputs
        Those to fit where the settings name none.

    Raises
    ------
    InsufficientDataError
        Nothing was flown that shows the model.
    UsageError, ModelError
        A choice is wrong.
    """
    ruled_out: tuple[Finding, ...] = ()
    if is_rate_model(model) and not settings.segments:
        records, ruled_out = supporting_logs(records, model.name)
    records, left = with_channels_of(model, records, joined=not in_time)
    require_common_axes(model, records)
    selection, remarks = select_records(model, records, settings, in_time=in_time)
    own = settings if settings.outputs or not outputs else replace(settings, outputs=outputs)
    scope = scoped(model, selection, records, own, joined=not in_time)
    leaning = (with_spread(scope.structure, selection.fitted, settings), selection.fitted, settings)
    at_trim = best_trim([trimmed(*leaning), *trimmed_in_wind(*leaning)], settings)
    return StructureAndLogs(
        at_trim.structure,
        replace(selection, fitted=at_trim.flights),
        (*ruled_out, *left, *remarks, *scope.findings, *at_trim.findings),
    )


class ResponseData(NamedTuple):
    """Measured responses, and the problem of fitting a structure to them.

    Parameters
    ----------
    measured, screened
        The responses, and what can be fitted of them.
    settings
        Choices of the run, with what a first step held.
    sensors
        Errors of sensors that were taken out.
    """

    selection: Selection
    measured: Measured
    screened: Screened
    settings: IdentifySettings
    findings: tuple[Finding, ...]
    sensors: SensorCorrection | None = None

    @property
    def flights(self) -> tuple[Flight, ...]:
        """Records and maneuvers that are fitted."""
        return self.selection.fitted

    @property
    def response(self) -> FrequencyResponse:
        """The estimate that is fitted."""
        return self.measured.response

    @property
    def sources(self) -> Mapping[str, str]:
        """Source of each output in the first log."""
        return output_sources(self.measured)


class Frequency(_Linear[ResponseData]):
    """Fit measured frequency responses in CIFER's cost, joint input–output where an instrument is logged."""

    def prepare(self, records: Sequence[FlightRecord]) -> ResponseData:
        """Measure the responses and leave out what shows the controller instead of the vehicle."""
        settings = self.settings
        if settings.filters:
            # Who gives a filter wants the model without it.
            settings = replace(settings, correct_filters=True)
        _refuse_choices_of_time(settings)
        sensors = None
        if settings.correct_sensors:
            flown = choose(self.model, records, settings, in_time=False).selection.fitted
            sensors = sensor_correction(flown)
            records = [corrected_record(record, sensors.correction) for record in records]
        structure, selection, findings = choose(self.model, records, settings, in_time=False)
        flights = selection.fitted
        if settings.speed_damping != "joint":
            first = first_step(structure, flights, settings)
            own = without_first(settings.pairs)
            settings = replace(settings, fix={**first.fix, **settings.fix}, pairs=own)
            findings += first.findings
        measured = measure(flights, inputs=structure.inputs, outputs=structure.outputs, settings=settings)
        if not settings.correct_filters:
            findings += given_filters_kept(flights, measured.segments, structure.outputs)
        if absent := absent_motors(structure):
            response, alike = with_equal_delays(measured.response, absent, top_rad_s=measured.trusted_rad_s[1])
            measured = replace(measured, response=response)
            findings += (alike,)
        if sensors is not None:
            response = with_sensor_errors(measured.response, sensors.correction, flights, settings)
            measured = replace(measured, response=response)
            findings += sensors.findings
        _PROGRESS.info(f"fitting {structure.name}")
        screened = pose_screened(structure, measured, settings, flights)
        return ResponseData(
            selection,
            measured,
            screened,
            settings,
            (*findings, *measured.findings, *screened.findings),
            sensors.correction if sensors else None,
        )

    def fit(self, data: ResponseData) -> FrequencyFit:
        """Fit, drop parameters that the data do not show, bound the others; bootstrap if requested."""
        fitted = fit_or_refuse(data.screened.problem, data.measured, data.settings)
        again = bootstrap(fitted.problem, fitted.final, fitted.bounds, data.settings, weights=fitted.weights)
        scattered = with_scatter(fitted, data.flights, data.settings)
        # Logs of two vehicles may leave not even a sign, although each is certain by itself.
        require_known_gain(scattered.problem.structure.gain, scattered.parameters, scattered.bounds, scattered.findings)
        return replace(scattered, bootstrap=again)

    def verify(self, data: ResponseData, fitted: FrequencyFit, records: Sequence[FlightRecord]) -> Verifications:
        """Predict unseen maneuvers; where there are none, hold one out of a second fit."""
        if data.sensors is not None:
            records = [corrected_record(record, data.sensors) for record in records]
        predictor = LinearPredictor(candidate_of(fitted, data.measured))
        found = predictor.predict(records, judging(data.settings), data.selection).found
        if found.maneuvers or found.sweeps or records:
            return found
        held_out = hold_out(fitted.problem.structure, data.flights, data.settings)
        sweeps = (held_out,) if held_out.response is not None else ()
        return Verifications(frequency=held_out.costs, findings=(*held_out.findings, *found.findings), sweeps=sweeps)

    def describe(self, data: ResponseData, fitted: FrequencyFit) -> FitReport:
        """Costs, responses and delays."""
        structure, problem, measured = fitted.structure, fitted.problem, data.measured
        own, response = structure.parameters, problem.data
        used = np.asarray(problem.used)
        filters = filter_delays(measured, data.flights)
        return FitReport(
            fit=Fit(
                method="frequency",
                outputs=structure.outputs,
                end=_end(fitted.solution, fitted.weights, fitted.bounds),
                cost=cost_of(problem, fitted.costs),
                minima=searched_minima(fitted.search),
                search=search_summary(fitted.search),
                bootstrap=fitted.bootstrap.summary if fitted.bootstrap else None,
                reduction=reduction_steps(fitted.steps),
            ),
            data=FittedData(
                response=response,
                direct=measured.direct,
                model_response=structure.response(fitted.parameters.values, response.omega_rad_s),
                used=used,
                least_coherence=data.settings.least_coherence(joint=response.estimate == "joint"),
                segments=measured.segments,
                filters_removed=measured.filters_removed,
            ),
            combinations=unseen_combinations(fitted.parameters, fitted.bounds),
            poles=pole_confidence(structure, own, fitted.bounds),
            delays=delay_budget(structure, own, fitted.bounds, np.asarray(used.any(axis=-1)), filters),
            covered=covered_by(data.flights),
        )

    def remarks(self, data: ResponseData, fitted: FrequencyFit, report: FitReport) -> Sequence[Finding]:
        """On data, fit and parameters."""
        again = fitted.bootstrap.findings if fitted.bootstrap else ()
        assumed = judge_assumed(fitted.problem.structure, data.settings.fix)
        return (*fitted.findings, *judge_combinations(report.combinations), *assumed, *again)


def judging(settings: IdentifySettings) -> VerifySettings:
    """Choices of a run for what it judges unseen flights by; intervals were given of the fitted logs."""
    shared = {field.name: getattr(settings, field.name) for field in fields(MeasureSettings)}
    return VerifySettings(**{**shared, "segments": ()})


def _refuse_choices_of_time(settings: IdentifySettings) -> None:
    """Refuse options that a fit of responses does not have."""
    asked = {"--hold": settings.hold != "auto", "--starts": settings.starts != "default"}
    asked["--pieces"] = settings.pieces_s is not None
    if given := [name for name, chosen in asked.items() if chosen]:
        raise UsageError(
            f"{' and '.join(given)} does not work in the frequency domain",
            remedy="choose a method that simulates, such as --method "
            "output_error{'; responses are searched with --search' if settings.starts != 'default' else ''}",
        )


class TimeDomainData(NamedTuple):
    """Records in time, and the frequency domain of the same maneuvers.

    Parameters
    ----------
    records
        Maneuvers as they were sampled.
    frequency
        Responses of the same maneuvers and their fit, as far as the data support that.
    orders
        How the order of a black box was chosen, where it was.
    """

    structure: LinearStructure
    selection: Selection
    records: TimeRecords
    frequency: FrequencySide
    settings: IdentifySettings
    findings: tuple[Finding, ...]
    orders: OrderChoice | None = None

    @property
    def flights(self) -> tuple[Flight, ...]:
        """Records and maneuvers that are fitted."""
        return self.selection.fitted

    @property
    def response(self) -> FrequencyResponse | None:
        """The measured response, where there is one."""
        return self.frequency.measured.response if self.frequency.measured else None

    @property
    def sources(self) -> Mapping[str, str]:
        """Source of each output in the first log."""
        return {name: source_of(self.records.segments[0], name) for name in self.structure.outputs}


@dataclass(frozen=True, kw_only=True)
class InTime(_Linear[TimeDomainData]):
    """Fit records in time: output error, prediction error or equation error.

    Parameters
    ----------
    kind
        Which of them.
    """

    kind: TimeMethod

    def prepare(self, records: Sequence[FlightRecord]) -> TimeDomainData:
        """Take the maneuvers out of the logs as they were sampled, and fit their responses for a start."""
        require_bootstrap(self.settings, self.kind)
        asked = self.settings.correct_filters, self.settings.correct_sensors, self.settings.filters
        for option, given in zip(("--correct-filters", "--correct-sensors", "--filter"), asked, strict=True):
            if given:
                raise UsageError(
                    f"{option} does not work in the time domain",
                    remedy="use --method frequency, which corrects responses",
                )
        if self.kind == "equation_error":
            needed = "use another method: regression has one minimum, so there is nothing to search"
            refuse_search(self.settings, "equation error", needed)
        model = self.model
        own = family_of(model).answers_setpoints and not self.settings.outputs
        settings = replace(self.settings, outputs=model.outputs) if own else self.settings
        structure, selection, findings = choose(
            model, records, self.settings, in_time=True, outputs=model.outputs if own else ()
        )
        side = frequency_side(
            structure,
            selection.fitted,
            settings,
            fits=_has_values(structure),
            searches=self.kind == "prediction_error",
        )
        data = time_records(structure, selection.fitted, settings)
        if absent := absent_motors(structure):
            tops = [flight.maneuver.band_rad_s[1] for flight in selection.fitted if flight.maneuver.band_rad_s]
            findings += (equal_delays(absent, max(tops, default=_SWEPT_TO_RAD_S), widened=False),)
        of_vehicles = all(is_command(name) for name in structure.inputs)
        # No response to a set-point is about the lag of motors.
        remarks = [finding for finding in data.findings if of_vehicles or "needed_hz" not in finding.numbers]
        remarks += given_filters_kept(selection.fitted, data.segments, structure.outputs)
        agreement = sensor_agreement(selection.fitted)
        # A fit in time states random errors alone: of a contradiction only the refusal counts here.
        sensor_errors(agreement, structure.outputs)
        quality = data_quality(selection.fitted, data.segments, structure.inputs, agreement)
        orders = None
        if order_is_open(structure.name):
            from rotorid.fits.time.orders import chosen_order

            structure, orders = chosen_order(structure, data, settings)
        return TimeDomainData(structure, selection, data, side, settings, (*findings, *remarks, *quality), orders)

    def fit(self, data: TimeDomainData) -> TimeFit:
        """Fit, bound with the color of the residuals, and simulate the records."""
        fitted = fit_in_time(
            data.structure, data.records, data.settings, method=self.kind, frequency=data.frequency.fitted
        )
        theta = fitted.problem.parameters.with_values(fitted.parameters.values).pack()
        fitted = replace(fitted, simulated=simulated_records(fitted.problem.predicted(theta), data.records))
        side = data.frequency.fitted
        require_time_fit_explains(fitted, side, data.records)
        if side:
            fitted = with_distance(fitted, compare_with(side, data.structure, fitted, data.records))
        require_one_gain(fitted, side)
        if not family_of(data.structure).opaque:
            couplings = [parameter.name for parameter in data.structure.parameters if is_coupling(parameter)]
            require_bounds(fitted.parameters, fitted.bounds, couplings)
        again = bootstrap(fitted.problem, fitted.solution, fitted.bounds, data.settings)
        return replace(fitted, bootstrap=again)

    def verify(self, data: TimeDomainData, fitted: TimeFit, records: Sequence[FlightRecord]) -> Verifications:
        """Predict unseen maneuvers as those of the frequency domain are, or simulate responses to set-points."""
        if not data.selection.unseen and not records:
            return Verifications(findings=(nothing_unseen([segment.record for segment in data.records.segments]),))
        structure = fitted.structure
        if not all(is_command(name) for name in structure.inputs):
            return FittedResponses(fitted, data.records, data.settings).predict(records, data.selection)
        candidate = Candidate(
            structure=structure,
            band_rad_s=data.frequency.fitted.band_rad_s if data.frequency.fitted else None,
            sources=data.sources,
        )
        return LinearPredictor(candidate).predict(records, judging(data.settings), data.selection).found

    def describe(self, data: TimeDomainData, fitted: TimeFit) -> FitReport:
        """Fits of the records, their residuals, and the frequency domain."""
        structure, side, records = fitted.structure, data.frequency, data.records
        others = compare_with(side.fitted, data.structure, fitted, records) if side.fitted else None
        noise = np.sqrt(fitted.problem.noise.diagonal())
        parameters, bounds = structure.parameters, fitted.bounds
        used = np.ones((len(structure.outputs), len(structure.inputs)), dtype=np.bool_)
        filters = filter_delays(side.measured, data.flights) if side.measured else {}
        return FitReport(
            fit=Fit(
                method=self.kind,
                outputs=structure.outputs,
                end=_end(fitted.solution, "likelihood", bounds),
                cost=self._cost(data, fitted),
                fit_percent=fitted.fit_percent,
                hold=records.hold,
                pieces_s=fitted.pieces_s,
                records=record_fits(fitted.simulated, records, structure, parameters=fitted.listed, alone=fitted.alone),
                noise=dict(zip(structure.outputs, map(float, noise), strict=True)),
                log_likelihood=fitted.log_likelihood,
                information=information(fitted),
                residuals=residuals(fitted, records),
                minima=_other_minima(fitted),
                search=search_summary(fitted.search),
                bootstrap=fitted.bootstrap.summary if fitted.bootstrap else None,
                equations=equation_fits(fitted),
                frequency_fit=others,
                reduction=reduction_steps(side.fitted.steps if side.fitted else ()),
                orders=data.orders,
            ),
            data=self._data(data, fitted),
            combinations=() if family_of(data.structure).opaque else unseen_combinations(fitted.parameters, bounds),
            poles=pole_confidence(structure, parameters, bounds),
            delays=delay_budget(structure, parameters, bounds, used, filters),
            covered=covered_by(data.flights),
        )

    def remarks(self, data: TimeDomainData, fitted: TimeFit, report: FitReport) -> Sequence[Finding]:
        """On fit, residuals and parameters, on feedback, and on the frequency domain."""
        return (
            *judge_time_fit(fitted, data.records, fitted.fit_percent),
            *judge_minima(fitted.search, fitted.parameters, fitted.bounds),
            *(fitted.bootstrap.findings if fitted.bootstrap else ()),
            *(_feedback(fitted, data.records) if self.kind == "output_error" else ()),
            *_not_compared(data),
            *judge_combinations(report.combinations),
            *judge_assumed(fitted.structure, data.settings.fix),
        )

    def _data(self, data: TimeDomainData, fitted: TimeFit) -> FittedData:
        structure, side = fitted.structure, data.frequency
        response = side.measured.response if side.measured else no_response(structure)
        limit = data.settings.least_coherence(joint=response.estimate == "joint")
        used = side.fitted.problem.used if side.fitted else np.zeros(response.values.shape, dtype=np.bool_)
        if side.measured and not side.fitted:
            used = side.measured.trusted_points(response, limit)
        exact = structure.response(fitted.parameters.values, response.omega_rad_s)
        return FittedData(
            response=response,
            direct=side.measured.direct if side.measured else None,
            model_response=exact * hold_response(response.omega_rad_s, data.records),
            used=np.asarray(used),
            least_coherence=limit,
            segments=data.records.segments,
            simulated=fitted.simulated,
        )

    def _cost(self, data: TimeDomainData, fitted: TimeFit) -> Cost | None:
        """CIFER's cost of the values that the time domain gives, where responses were fitted too."""
        if data.frequency.fitted is None:
            return None
        problem, theta = responses_without_hold(fitted, data.frequency.fitted, data.records)
        return cost_of(problem, problem.costs(theta))


def _has_values(structure: LinearStructure) -> bool:
    """Whether a structure has values to start from; a black box has none at first."""
    return not family_of(structure).opaque or any(structure.parameters.values.values())


def _feedback(fitted: TimeFit, records: TimeRecords) -> tuple[Finding, ...]:
    return judge_following(
        following(
            [record.measured - record.simulated for record in fitted.simulated],
            [record.inputs for record in fitted.simulated],
            input_names=fitted.structure.inputs,
            output_names=fitted.structure.outputs,
            sample_rate_hz=records.data[0].sample_rate_hz,
        )
    )


def _not_compared(data: TimeDomainData) -> tuple[Finding, ...]:
    if data.frequency.fitted is not None or not _has_values(data.structure):
        return ()
    message = f"There is no frequency-domain fit to compare with: {data.frequency.why_not}."
    return (remark("not_compared", data.structure.name, message),)


def _end(solution: Solution, weights: FitWeights, bounds: Bounds) -> FitEnd:
    return FitEnd(
        weights=weights,
        outcome=solution.outcome.value,
        evaluations=solution.evaluations,
        trace=tuple(solution.trace),
        inflation=bounds.inflation,
        model_error=dict(bounds.model_error.deviations) if bounds.model_error else {},
    )


def _other_minima(fitted: TimeFit) -> tuple[Minimum, ...]:
    """Other minima than the one that counts, best first."""
    free = fitted.parameters.free
    return tuple(
        Minimum(cost=minimum.cost, parameters=dict(zip(free, map(float, minimum.theta), strict=True)))
        for minimum in fitted.solution.others
        if len(minimum.theta) == len(free)
    )


def reduction_steps(steps: Sequence[Step]) -> tuple[ReductionStep, ...]:
    """Steps of a reduction, in order."""
    return tuple(
        ReductionStep(
            parameter=step.parameter,
            action=step.action,
            reason=step.reason,
            value_before=step.value_before,
            insensitivity_percent=finite(step.insensitivity_percent),
            cramer_rao_percent=finite(step.cramer_rao_percent),
            mean_cost_before=step.mean_cost_before,
            mean_cost_after=None if step.mean_cost_after is None else finite(step.mean_cost_after),
        )
        for step in steps
    )
