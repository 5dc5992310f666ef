"""The whole way: logs in, a model with bounds, verified, out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from rotorid.data.findings import Finding
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.models.description import to_toml
from rotorid.models.structure import LinearStructure
from rotorid.pipeline.assemble import (
    combination_documents,
    cost_document,
    finding_documents,
    matrices_document,
    parameter_documents,
    pole_documents,
    provenance_document,
    standard_deviations,
    verification_document,
)
from rotorid.pipeline.document import ProvenanceDocument, ResultDocument
from rotorid.pipeline.fitting import Fitted, fit_with_bounds
from rotorid.pipeline.identification import Identification
from rotorid.pipeline.instruments import axis_of
from rotorid.pipeline.inverse import pose_screened
from rotorid.pipeline.measure import measure
from rotorid.pipeline.resolve import resolve_model
from rotorid.pipeline.selection import select_maneuvers
from rotorid.pipeline.settings import IdentifySettings
from rotorid.pipeline.verification import Checked, check
from rotorid.uncertainty.identifiability import unseen_combinations


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
    show, bound the parameters, and predict maneuvers that were not fitted.

    Parameters
    ----------
    records
        Logs as :func:`rotorid.read` gives them.
    model
        ``rate.roll``, ``rate.pitch``, ``rate.yaw``, ``rate.vertical``, a TOML file, or a structure.
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
    structure = resolve_model(model)
    inputs, outputs = structure.inputs, structure.outputs
    selection = select_maneuvers(records, [axis_of(name) for name in inputs], settings)
    measured = measure(selection.fitted, inputs=inputs, outputs=outputs, settings=settings, progress=progress)
    progress(f"fitting {structure.name}")
    screened = pose_screened(structure, measured, settings, selection.fitted)
    fitted = fit_with_bounds(screened.problem, measured)
    checked = check(fitted, measured, selection, verify, settings, progress)
    findings = [f for record in (*records, *verify) for f in record.findings]
    findings += [*measured.findings, *screened.findings, *fitted.findings, *checked.findings]
    provenance = provenance_document(
        (*records, *verify), settings, command=command, flown=selection.fitted, response=measured.response
    )
    return Identification(
        document=_document(fitted, checked, findings, provenance),
        model_toml=to_toml(structure, fitted.parameters, standard_deviations(fitted.bounds)),
        response=measured.response,
        beside=measured.beside,
        model_response=structure.response(fitted.parameters.values, measured.response.omega_rad_s),
        fitted=np.asarray(fitted.problem.used),
        least_coherence=settings.least_coherence(joint=measured.response.estimate == "joint"),
        segments=measured.segments,
        verifications=checked.verifications,
    )


def _document(
    fitted: Fitted, checked: Checked, findings: Sequence[Finding], provenance: ProvenanceDocument
) -> ResultDocument:
    structure = fitted.structure
    return ResultDocument(
        model=structure.name,
        inputs=list(structure.inputs),
        outputs=list(structure.outputs),
        states=list(structure.states),
        parameters=parameter_documents(fitted.parameters, fitted.bounds),
        cost=cost_document(fitted.problem, fitted.problem.costs(fitted.solution.theta)),
        matrices=matrices_document(fitted.system),
        poles=pole_documents(fitted.system),
        verification=verification_document(checked),
        identifiability=combination_documents(unseen_combinations(fitted.parameters, fitted.bounds)),
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
    structure = resolve_model(model)
    findings = [*(f for record in records for f in record.findings), *error.findings]
    if not error.findings:
        findings.append(Finding(kind="not_identifiable", severity="error", where=structure.name, message=str(error)))
    return ResultDocument(
        model=structure.name,
        inputs=list(structure.inputs),
        outputs=list(structure.outputs),
        states=list(structure.states),
        findings=finding_documents(findings),
        provenance=provenance_document(records, settings, command=command),
    )
