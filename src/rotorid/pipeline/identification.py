"""The whole way: logs in, a model with bounds, verified, out.

Identify in the time domain: logs in, a model with bounds, compared with the frequency domain, verified, out.
"""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rotorid.data.findings import Finding, refusal, remark
from rotorid.data.record import FlightRecord
from rotorid.data.response import FrequencyResponse
from rotorid.documents.result import CostDocument, ProvenanceDocument, ResultDocument
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.models.structure import LinearStructure
from rotorid.models.toml import to_toml
from rotorid.pipeline.assemble import (
    bootstrap_document,
    combination_documents,
    compared_documents,
    correlation_document,
    cost_document,
    equation_documents,
    finding_documents,
    fit_document,
    fit_percents,
    information_document,
    matrices_document,
    minima_documents,
    noise_document,
    parameter_documents,
    pole_documents,
    provenance_document,
    range_documents,
    record_documents,
    residuals_document,
    search_document,
    searched_minima,
    simulated_records,
    standard_deviations,
    step_documents,
    time_fit_document,
    verification_document,
)
from rotorid.pipeline.bootstrapping import Bootstrapped, bootstrap, require_bootstrap
from rotorid.pipeline.candidate import output_sources
from rotorid.pipeline.consistency import data_quality
from rotorid.pipeline.coverage import covered_by
from rotorid.pipeline.frequency_fit import Fitted, delay_budget, first_step, fit_with_bounds, judge_combinations
from rotorid.pipeline.instruments import Flown, axes_of, is_command
from rotorid.pipeline.inverse import pose_screened
from rotorid.pipeline.measure import Measured, filter_delays, measure
from rotorid.pipeline.resolve import answers_setpoints, black_box_order, resolve_model
from rotorid.pipeline.results import Identification, SimulatedRecord
from rotorid.pipeline.scope import scoped, trimmed
from rotorid.pipeline.searching import judge_minima, refuse_search
from rotorid.pipeline.segments import TimeRecords, source_of, time_records
from rotorid.pipeline.selection import select_maneuvers, select_records
from rotorid.pipeline.settings import MODEL, IdentifySettings
from rotorid.pipeline.time_fit import (
    Compared,
    FrequencySide,
    TimeFitted,
    TimeMethod,
    compare_with,
    fit_in_time,
    following,
    frequency_side,
    held_response,
    judge_agreement,
    judge_following,
    judge_time_fit,
)
from rotorid.pipeline.unseen import Verifications, check, check_in_time
from rotorid.uncertainty.identifiability import Combination, unseen_combinations
from rotorid.uncertainty.propagation import pole_confidence

_PROGRESS = logging.getLogger("rotorid.progress")


@dataclass(frozen=True, kw_only=True, eq=False)
class _Made:
    """Everything that a run has made, for its document."""

    fitted: TimeFitted
    refitted: Bootstrapped | None
    records: TimeRecords
    side: FrequencySide
    compared: dict[str, Compared]
    simulated: tuple[SimulatedRecord, ...]
    percents: dict[str, float]
    flown: Sequence[Flown]
    checked: Verifications
    combinations: Sequence[Combination]
    findings: Sequence[Finding]
    provenance: ProvenanceDocument


def chosen_method(structure: LinearStructure, settings: IdentifySettings) -> TimeMethod | None:
    """How a model is fitted in time; ``None`` for a fit in the frequency domain."""
    if settings.method == "auto":
        return "output_error" if answers_setpoints(structure) else None
    return None if settings.method == "frequency" else settings.method


def identify_in_time(
    records: Sequence[FlightRecord],
    whole: LinearStructure,
    *,
    method: TimeMethod,
    settings: IdentifySettings,
    verify: Sequence[FlightRecord] = (),
    command: Sequence[str] = (),
) -> Identification:
    """Identify a model from flight records in the time domain.

    The steps: find what was flown, take it out of the logs as it was sampled, fit responses in the frequency domain
    for a start and a comparison, fit the simulation, bound the parameters with the color of the residuals, test
    whether a controller moved the inputs, and simulate what was not fitted.

    Parameters
    ----------
    records, settings, verify, command
        As for :func:`rotorid.pipeline.identification.identify`.
    whole
        The model.
    method
        How to fit it.

    Raises
    ------
    InsufficientDataError
        The data cannot support the model; its findings say why.
    UsageError, ModelError
        An option or a model is wrong.
    """
    _refuse_what_there_is_not(method, settings)
    own = replace(settings, outputs=whole.outputs) if answers_setpoints(whole) and not settings.outputs else settings
    selection, remarks = select_records(whole, records, settings)
    flown = selection.fitted
    scope = scoped(whole, selection, records, own)
    at_trim = trimmed(scope.structure, flown, settings)
    structure = at_trim.structure
    black_box = black_box_order(structure) is not None
    valued = not black_box or any(structure.parameters.values.values())
    side = frequency_side(structure, flown, own, fits=valued, searches=method == "prediction_error")
    data = time_records(structure, flown, own)
    fitted = fit_in_time(structure, data, own, method=method, frequency=side.fitted)
    refitted = bootstrap(fitted, own)
    simulated = simulated_records(fitted, data)
    combinations = () if black_box else unseen_combinations(fitted.parameters, fitted.bounds)
    percents = fit_percents(simulated, fitted.structure.outputs)
    compared = compare_with(side.fitted, structure, fitted, data) if side.fitted else {}
    band = side.fitted.band_rad_s if side.fitted else None
    checked = check_in_time(fitted, data, selection, verify, own, band_rad_s=band)
    findings = [
        *(finding for record in (*records, *verify) for finding in record.findings),
        *(*remarks, *scope.findings, *at_trim.findings, *_of_vehicles(data.findings, structure)),
        *data_quality(flown, data.segments, structure.inputs),
        *judge_time_fit(fitted, data, percents),
        *judge_minima(fitted.search, fitted.parameters, fitted.bounds),
        *(refitted.findings if refitted else ()),
        *(_feedback(simulated, fitted, data) if method == "output_error" else ()),
        *judge_agreement(fitted, compared),
        *_not_compared(side, structure, fits=valued),
        *judge_combinations(combinations),
        *checked.findings,
    ]
    made = _Made(
        fitted=fitted,
        refitted=refitted,
        records=data,
        side=side,
        compared=compared,
        simulated=simulated,
        percents=percents,
        flown=flown,
        checked=checked,
        combinations=combinations,
        findings=findings,
        provenance=provenance_document(
            (*records, *verify),
            settings,
            command=command,
            flown=flown,
            response=side.measured.response if side.measured else None,
            sources={name: source_of(data.segments[0], name) for name in structure.outputs},
        ),
    )
    return _identification(made, own)


def _refuse_what_there_is_not(method: TimeMethod, settings: IdentifySettings) -> None:
    require_bootstrap(settings, method)
    if method == "equation_error":
        refuse_search(settings, "equation error", "another method: regression has one minimum and needs no search")


def _identification(made: _Made, settings: IdentifySettings) -> Identification:
    fitted, side = made.fitted, made.side
    structure = fitted.structure
    response = side.measured.response if side.measured else no_response(structure)
    used = side.fitted.problem.used if side.fitted else np.zeros(response.values.shape, dtype=np.bool_)
    if side.measured and not side.fitted:
        limit = settings.least_coherence(joint=response.estimate == "joint")
        used = side.measured.trusted_points(response, limit)
    return Identification(
        document=_time_document(made),
        model_toml=to_toml(structure, structure.parameters, standard_deviations(fitted.bounds)),
        response=response,
        beside=side.measured.beside if side.measured else None,
        model_response=structure.response(fitted.parameters.values, response.omega_rad_s)
        * held_response(response.omega_rad_s, made.records),
        fitted=np.asarray(used),
        least_coherence=settings.least_coherence(joint=response.estimate == "joint"),
        segments=made.records.segments,
        verifications=made.checked.verifications,
        judged=made.checked.judged,
        simulated=made.simulated,
    )


def no_response(structure: LinearStructure) -> FrequencyResponse:
    """A response that could be measured at no frequency."""
    shape = (len(structure.outputs), len(structure.inputs), 0)
    return FrequencyResponse(
        omega_rad_s=np.zeros(0),
        values=np.zeros(shape, dtype=np.complex128),
        coherence=np.zeros(shape),
        random_error=np.zeros(shape),
        covariance=np.zeros((*shape, 0), dtype=np.complex128),
        inputs=structure.inputs,
        outputs=structure.outputs,
        estimate="direct",
    )


def _time_document(made: _Made) -> ResultDocument:
    fitted, side = made.fitted, made.side
    structure = fitted.structure
    parameters, bounds = structure.parameters, fitted.bounds
    outputs = structure.outputs
    seen = np.ones((len(outputs), len(structure.inputs)), dtype=np.bool_)
    filters = filter_delays(side.measured, made.flown) if side.measured else {}
    return ResultDocument(
        model=structure.name,
        inputs=list(structure.inputs),
        outputs=list(outputs),
        states=list(structure.states),
        parameters=parameter_documents(fitted.listed, bounds),
        cost=_cost(made),
        fit_percent=made.percents,
        fit=time_fit_document(fitted),
        method=fitted.method,
        hold=made.records.hold,
        pieces_s=fitted.pieces_s,
        records=record_documents(made.simulated, made.records, outputs),
        noise=noise_document(fitted, outputs),
        log_likelihood=fitted.log_likelihood,
        information=information_document(fitted),
        residuals=residuals_document(fitted, made.simulated, made.records),
        minima=minima_documents(fitted),
        search=search_document(fitted.search),
        bootstrap=bootstrap_document(made.refitted),
        equations=equation_documents(fitted),
        frequency_fit=compared_documents(made.compared) if side.fitted else None,
        reduction=step_documents(side.fitted.steps if side.fitted else ()),
        correlation=correlation_document(bounds),
        constants=dict(structure.constants),
        matrices=matrices_document(structure.matrices(parameters.values)),
        poles=pole_documents(pole_confidence(structure, parameters, bounds)),
        delays=delay_budget(structure, parameters, bounds, seen, filters),
        covered=range_documents(covered_by(made.flown)),
        verification=verification_document(made.checked, structure.states),
        identifiability=combination_documents(made.combinations),
        findings=finding_documents(made.findings),
        provenance=made.provenance,
    )


def _cost(made: _Made) -> CostDocument | None:
    """CIFER's cost of the values that the time domain gives, where responses were fitted too."""
    if made.side.fitted is None:
        return None
    problem = made.side.fitted.problem
    theta = problem.parameters.with_values(
        {name: made.fitted.parameters[name].value for name in problem.parameters.free}
    ).pack()
    data = problem.data
    apart = replace(data, values=data.values / held_response(data.omega_rad_s, made.records))
    return cost_document(problem, replace(problem, data=apart).costs(theta))


def _feedback(simulated: Sequence[SimulatedRecord], fitted: TimeFitted, records: TimeRecords) -> tuple[Finding, ...]:
    return judge_following(
        following(
            [one.measured - one.simulated for one in simulated],
            [one.inputs for one in simulated],
            input_names=fitted.structure.inputs,
            output_names=fitted.structure.outputs,
            sample_rate_hz=records.data[0].sample_rate_hz,
        )
    )


def _of_vehicles(findings: Sequence[Finding], structure: LinearStructure) -> Iterator[Finding]:
    """Remarks without those on motor lags, which no response to a set-point is about."""
    motors = all(is_command(name) for name in structure.inputs)
    return (finding for finding in findings if motors or "needed_hz" not in finding.numbers)


def _not_compared(side: FrequencySide, structure: LinearStructure, *, fits: bool) -> tuple[Finding, ...]:
    if side.fitted is not None or not fits:
        return ()
    return (
        remark(
            "not_compared", structure.name, f"There is no fit in the frequency domain to compare with: {side.why_not}."
        ),
    )


def identify(
    records: Sequence[FlightRecord],
    model: str | Path | LinearStructure,
    *,
    settings: IdentifySettings | None = None,
    verify: Sequence[FlightRecord] = (),
    command: Sequence[str] = (),
) -> Identification:
    """Identify a model from flight records.

    The steps: find the excitations, bring the channels onto one clock, estimate composite-window frequency responses
    (joint input–output where an instrument is logged), fit the structure in CIFER's cost, drop what the data do not
    show, bound the parameters, and predict maneuvers that were not fitted. Responses to set-points, black boxes and
    whatever ``settings.method`` says are fitted in time, see :func:`rotorid.pipeline.identification.identify_in_time`.

    Parameters
    ----------
    records
        Logs as :func:`rotorid.read` gives them.
    model
        A name of the library such as ``hover.longitudinal`` or ``rate.roll``, a response model such as
        ``response.second_order``, which finds its channels in the logs, a TOML file, or a structure.
    settings
        Choices; everything has a default.
    verify
        Further records, kept unseen, to judge the model on.
    command
        For the provenance of the result.

    Returns
    -------
    Identification
        The document of ``result.json`` and the arrays behind it.

    Raises
    ------
    InsufficientDataError
        The data cannot support the model; its findings say why.
    UsageError, ModelError
        An option or a model is wrong.

    Examples
    --------
    >>> from rotorid.io.registry import read
    >>> result = identify([read("flight.BIN")], "rate.roll")  # doctest: +SKIP
    >>> result.document.parameters["L_roll"].value  # doctest: +SKIP
    439.3
    """
    settings = settings or IdentifySettings()
    whole = resolve_model(model, outputs=settings.outputs, logged=logged_by_all(records))
    if method := chosen_method(whole, settings):
        return identify_in_time(records, whole, method=method, settings=settings, verify=verify, command=command)
    _refuse_choices_of_time(settings)
    axes, commands = axes_of(whole.inputs, whole.outputs), all(is_command(name) for name in whole.inputs)
    selection = select_maneuvers(records, axes, settings, whole=not commands)
    flown = selection.fitted
    scope = scoped(whole, selection, records, settings)
    at_trim = trimmed(scope.structure, flown, settings)
    structure, asked = at_trim.structure, settings
    findings = [f for record in (*records, *verify) for f in record.findings]
    findings += [*scope.findings, *at_trim.findings]
    if settings.speed_damping == "two_step":
        first = first_step(structure, flown, settings)
        settings = replace(settings, fix={**first.fix, **settings.fix})
        findings += first.findings
    measured = measure(flown, inputs=structure.inputs, outputs=structure.outputs, settings=settings)
    _PROGRESS.info(f"fitting {structure.name}")
    screened = pose_screened(structure, measured, settings, flown)
    fitted = fit_with_bounds(screened.problem, measured, settings)
    refitted = bootstrap(fitted, settings)
    checked = check(fitted, measured, selection, verify, settings)
    unseen = unseen_combinations(fitted.parameters, fitted.bounds)
    findings += [*measured.findings, *screened.findings, *fitted.findings, *judge_combinations(unseen)]
    findings += [*(refitted.findings if refitted else ()), *checked.findings]
    provenance = provenance_document(
        (*records, *verify),
        asked,
        command=command,
        flown=flown,
        response=measured.response,
        sources=output_sources(measured),
    )
    return Identification(
        document=_document(fitted, refitted, checked, findings, provenance, measured, flown, unseen),
        model_toml=to_toml(fitted.structure, fitted.structure.parameters, standard_deviations(fitted.bounds)),
        response=measured.response,
        beside=measured.beside,
        model_response=fitted.structure.response(fitted.parameters.values, measured.response.omega_rad_s),
        fitted=np.asarray(fitted.problem.used),
        least_coherence=settings.least_coherence(joint=measured.response.estimate == "joint"),
        segments=measured.segments,
        verifications=checked.verifications,
        judged=checked.judged,
    )


def logged_by_all(records: Sequence[FlightRecord]) -> tuple[str, ...]:
    """Channels that every record holds."""
    names = [record.channel_names for record in records]
    return tuple(name for name in (names[0] if names else ()) if all(name in others for others in names))


def _refuse_choices_of_time(settings: IdentifySettings) -> None:
    """Refuse options that a fit of responses does not have."""
    asked = {"--hold": settings.hold != "auto", "--starts": settings.starts != "default"}
    asked["--pieces"] = settings.pieces_s is not None
    if given := [name for name, chosen in asked.items() if chosen]:
        raise UsageError(
            f"{' and '.join(given)} came for a fit in the frequency domain",
            needed="a method that simulates, such as --method output_error",
            remedy="responses are searched with --search" if settings.starts != "default" else "",
        )


def _document(
    fitted: Fitted,
    refitted: Bootstrapped | None,
    checked: Verifications,
    findings: Sequence[Finding],
    provenance: ProvenanceDocument,
    measured: Measured,
    flown: Sequence[Flown],
    unseen: Sequence[Combination],
) -> ResultDocument:
    structure = fitted.structure
    seen = np.asarray(fitted.problem.used.any(axis=-1))
    return ResultDocument(
        model=structure.name,
        inputs=list(structure.inputs),
        outputs=list(structure.outputs),
        states=list(structure.states),
        parameters=parameter_documents(fitted.parameters, fitted.bounds),
        cost=cost_document(fitted.problem, fitted.costs),
        fit=fit_document(fitted.solution, fitted.weights, fitted.bounds.inflation),
        minima=searched_minima(fitted.search),
        search=search_document(fitted.search),
        bootstrap=bootstrap_document(refitted),
        reduction=step_documents(fitted.steps),
        correlation=correlation_document(fitted.bounds),
        constants=dict(structure.constants),
        matrices=matrices_document(fitted.system),
        poles=pole_documents(pole_confidence(structure, structure.parameters, fitted.bounds)),
        delays=delay_budget(structure, structure.parameters, fitted.bounds, seen, filter_delays(measured, flown)),
        covered=range_documents(covered_by(flown)),
        verification=verification_document(checked, structure.states),
        identifiability=combination_documents(unseen),
        findings=finding_documents(findings),
        provenance=provenance,
    )


def refused(
    error: InsufficientDataError,
    records: Sequence[FlightRecord],
    model: str | Path | LinearStructure,
    *,
    settings: IdentifySettings,
    command: Sequence[str] = (),
) -> ResultDocument:
    """The document for data that cannot support a model: its findings say why, and no number is given."""
    findings = [*(f for record in records for f in record.findings), *error.findings]
    structure = None
    # Motors are no linear structure, and their channels stand in the log.
    if model != MODEL:
        with contextlib.suppress(InsufficientDataError):
            structure = resolve_model(model, outputs=settings.outputs, logged=logged_by_all(records))
    name = structure.name if structure else str(model)
    if not error.findings:
        findings.append(refusal("not_identifiable", name, str(error)))
    return ResultDocument(
        model=name,
        inputs=list(structure.inputs if structure else ()),
        outputs=list(structure.outputs if structure else ()),
        states=list(structure.states if structure else ()),
        findings=finding_documents(findings),
        provenance=provenance_document(records, settings, command=command),
    )
