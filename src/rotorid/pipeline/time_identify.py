"""Identify in the time domain: logs in, a model with bounds, compared with the frequency domain, verified, out."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rotorid.data.findings import Finding
from rotorid.data.record import FlightRecord
from rotorid.data.response import FrequencyResponse
from rotorid.models.description import to_toml
from rotorid.models.structure import LinearStructure
from rotorid.pipeline.assemble import (
    bootstrap_document,
    combination_documents,
    correlation_document,
    cost_document,
    finding_documents,
    matrices_document,
    parameter_documents,
    pole_documents,
    provenance_document,
    range_documents,
    search_document,
    standard_deviations,
    step_documents,
    verification_document,
)
from rotorid.pipeline.bootstrapping import Bootstrapped, bootstrap, require_bootstrap
from rotorid.pipeline.coverage import covered_by
from rotorid.pipeline.cutting import source_of
from rotorid.pipeline.delay_budget import delay_budget
from rotorid.pipeline.document import CostDocument, ProvenanceDocument, ResultDocument
from rotorid.pipeline.filters import filter_delays
from rotorid.pipeline.identification import Identification, SimulatedRecord
from rotorid.pipeline.instruments import Flown, is_command
from rotorid.pipeline.judge import judge_combinations
from rotorid.pipeline.quality import data_quality
from rotorid.pipeline.resolve import answers_setpoints, black_box_order
from rotorid.pipeline.scope import scoped
from rotorid.pipeline.searching import judge_minima, refuse_search
from rotorid.pipeline.settings import IdentifySettings
from rotorid.pipeline.time_document import (
    compared_documents,
    equation_documents,
    fit_percents,
    information_document,
    minima_documents,
    noise_document,
    record_documents,
    residuals_document,
    simulated_records,
    time_fit_document,
)
from rotorid.pipeline.time_feedback import following, judge_following
from rotorid.pipeline.time_fit import TimeFitted, TimeMethod, fit_in_time
from rotorid.pipeline.time_judge import Compared, compare_with, judge_agreement, judge_time_fit
from rotorid.pipeline.time_records import TimeRecords, time_records
from rotorid.pipeline.time_selection import select_records
from rotorid.pipeline.time_start import FrequencySide, frequency_side, held_response
from rotorid.pipeline.time_verify import check_in_time
from rotorid.pipeline.trim import trimmed
from rotorid.pipeline.verification import Checked
from rotorid.uncertainty.identifiability import Combination, unseen_combinations
from rotorid.uncertainty.propagation import pole_confidence


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
    checked: Checked
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
    progress: Callable[[str], None] = lambda _: None,
) -> Identification:
    """Identify a model from flight records in the time domain.

    The steps: find what was flown, take it out of the logs as it was sampled, fit responses in the frequency domain
    for a start and a comparison, fit the simulation, bound the parameters with the color of the residuals, test
    whether a controller moved the inputs, and simulate what was not fitted.

    Parameters
    ----------
    records, settings, verify, command, progress
        As for :func:`rotorid.pipeline.identify.identify`.
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
    side = frequency_side(structure, flown, own, progress, fits=valued, searches=method == "prediction_error")
    data = time_records(structure, flown, own, progress)
    fitted = fit_in_time(structure, data, own, method=method, frequency=side.fitted, progress=progress)
    refitted = bootstrap(fitted, own, progress)
    simulated = simulated_records(fitted, data)
    combinations = () if black_box else unseen_combinations(fitted.parameters, fitted.bounds)
    percents = fit_percents(simulated, fitted.structure.outputs)
    compared = compare_with(side.fitted, structure, fitted, data) if side.fitted else {}
    band = side.fitted.band_rad_s if side.fitted else None
    checked = check_in_time(fitted, data, selection, verify, own, progress, band_rad_s=band)
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
        document=_document(made),
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


def _document(made: _Made) -> ResultDocument:
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
        Finding(
            kind="not_compared",
            severity="info",
            where=structure.name,
            message=f"There is no fit in the frequency domain to compare with: {side.why_not}.",
        ),
    )
