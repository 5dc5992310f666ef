"""The whole way: logs in, a model with bounds, verified, out."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from rotorid.data.findings import Finding
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.models.description import to_toml
from rotorid.models.structure import LinearStructure
from rotorid.pipeline.assemble import (
    bootstrap_document,
    combination_documents,
    correlation_document,
    cost_document,
    finding_documents,
    fit_document,
    matrices_document,
    parameter_documents,
    pole_documents,
    provenance_document,
    range_documents,
    search_document,
    searched_minima,
    standard_deviations,
    step_documents,
    verification_document,
)
from rotorid.pipeline.bootstrapping import Bootstrapped, bootstrap
from rotorid.pipeline.coverage import covered_by
from rotorid.pipeline.delay_budget import delay_budget
from rotorid.pipeline.document import ProvenanceDocument, ResultDocument
from rotorid.pipeline.filters import filter_delays
from rotorid.pipeline.fitting import Fitted, fit_with_bounds
from rotorid.pipeline.identification import Identification
from rotorid.pipeline.instruments import Flown, axes_of, is_command
from rotorid.pipeline.inverse import pose_screened
from rotorid.pipeline.judge import judge_combinations
from rotorid.pipeline.measure import Measured, measure
from rotorid.pipeline.motor_choices import MODEL
from rotorid.pipeline.resolve import resolve_model
from rotorid.pipeline.scope import scoped
from rotorid.pipeline.selection import select_maneuvers
from rotorid.pipeline.settings import IdentifySettings
from rotorid.pipeline.speed_damping import first_step
from rotorid.pipeline.time_identify import chosen_method, identify_in_time
from rotorid.pipeline.trim import trimmed
from rotorid.pipeline.verification import Checked, check
from rotorid.pipeline.verify_model import output_sources
from rotorid.uncertainty.identifiability import Combination, unseen_combinations
from rotorid.uncertainty.propagation import pole_confidence


def _silent(_: str) -> None:
    """Say nothing."""


def identify(
    records: Sequence[FlightRecord],
    model: str | Path | LinearStructure,
    *,
    settings: IdentifySettings | None = None,
    verify: Sequence[FlightRecord] = (),
    command: Sequence[str] = (),
    progress: Callable[[str], None] = _silent,
) -> Identification:
    """Identify a model from flight records.

    The steps: find the excitations, bring the channels onto one clock, estimate composite-window frequency responses
    (joint input–output where an instrument is logged), fit the structure in CIFER's cost, drop what the data do not
    show, bound the parameters, and predict maneuvers that were not fitted. Responses to set-points, black boxes and
    whatever ``settings.method`` says are fitted in time, see :func:`rotorid.pipeline.time_identify.identify_in_time`.

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
    progress
        Told what is being done.

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
        return identify_in_time(
            records, whole, method=method, settings=settings, verify=verify, command=command, progress=progress
        )
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
        first = first_step(structure, flown, settings, progress)
        settings = replace(settings, fix={**first.fix, **settings.fix})
        findings += first.findings
    measured = measure(flown, inputs=structure.inputs, outputs=structure.outputs, settings=settings, progress=progress)
    progress(f"fitting {structure.name}")
    screened = pose_screened(structure, measured, settings, flown)
    fitted = fit_with_bounds(screened.problem, measured, settings, progress)
    refitted = bootstrap(fitted, settings, progress)
    checked = check(fitted, measured, selection, verify, settings, progress)
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
    checked: Checked,
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
        findings.append(Finding(kind="not_identifiable", severity="error", where=name, message=str(error)))
    return ResultDocument(
        model=name,
        inputs=list(structure.inputs if structure else ()),
        outputs=list(structure.outputs if structure else ()),
        states=list(structure.states if structure else ()),
        findings=finding_documents(findings),
        provenance=provenance_document(records, settings, command=command),
    )
