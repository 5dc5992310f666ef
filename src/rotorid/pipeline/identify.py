"""The whole way: logs in, a model with bounds, verified, out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from rotorid.data.findings import Finding
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError, ModelError, UsageError
from rotorid.fit.problem import FrequencyProblem, usable_points
from rotorid.models.description import from_toml, to_toml
from rotorid.models.parameter import ParameterSet
from rotorid.models.rate import RATE_AXES, rate_model
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
from rotorid.pipeline.document import ResultDocument
from rotorid.pipeline.identification import Identification
from rotorid.pipeline.judge import judge_band, judge_fit, judge_parameters, require_usable
from rotorid.pipeline.measure import Measured, correlated_inputs, feedback_bias, measure
from rotorid.pipeline.selection import RICH_KINDS, Flown, Selection, axis_of, select_maneuvers
from rotorid.pipeline.settings import IdentifySettings
from rotorid.pipeline.verification import Checked, cost_on_sweeps, hold_out, verify_unseen
from rotorid.reduce.elimination import Reduced, fit_and_drop
from rotorid.signal.segment import find_excitations
from rotorid.uncertainty.bounds import Bounds, bounds
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
    >>> from rotorid.vehicles.demo import demo_record  # doctest: +SKIP
    >>> result = identify([demo_record(seed=0)], "rate.roll")  # doctest: +SKIP
    """
    settings = settings or IdentifySettings()
    structure = resolve_model(model)
    parameters = _with_fixed(structure.parameters, settings)
    axes = [axis_of(name) for name in structure.inputs]
    selection = select_maneuvers(records, axes, settings)
    measured = measure(
        selection.fitted, inputs=structure.inputs, outputs=structure.outputs, settings=settings, progress=progress
    )
    joint = measured.response.estimate == "joint"
    used = usable_points(
        measured.response, coherence=settings.least_coherence(joint=joint), band_rad_s=measured.trusted_rad_s
    )
    require_usable(measured, used, rate_model=structure.name in RATE_AXES)
    progress(f"fitting {structure.name}")
    problem = FrequencyProblem(structure=structure, parameters=parameters, data=measured.response, used=used)
    reduced = fit_and_drop(problem)
    found = reduced.problem.parameters.unpack(reduced.solution.theta)
    limits = bounds(reduced.problem, reduced.solution)
    checked = _verify(problem, found, selection, verify, settings, progress)
    findings = [f for record in records for f in record.findings]
    findings += [*measured.findings, *judge_band(measured, used), *feedback_bias(measured, used)]
    findings += [*correlated_inputs(measured, used), *reduced.findings]
    findings += [f for part in checked for f in part.findings]
    return _finished(
        reduced,
        found,
        limits,
        measured,
        selection,
        checked,
        findings,
        records=(*records, *verify),
        settings=settings,
        command=command,
    )


def resolve_model(model: str | Path | LinearStructure) -> LinearStructure:
    """The structure behind a name, a TOML file or a structure.

    Raises
    ------
    ModelError
        There is no such model, or the file is wrong.
    """
    if isinstance(model, LinearStructure):
        return model
    if isinstance(model, str) and model in RATE_AXES:
        return rate_model(model)
    path = Path(model)
    if path.suffix != ".toml":
        raise ModelError(
            f"there is no model {str(model)!r}",
            needed=f"one of {', '.join(RATE_AXES)}, or a .toml file with a structure",
        )
    if not path.is_file():
        raise UsageError(f"there is no file {path}", needed="a model in TOML, such as a model.toml of a result")
    return from_toml(path.read_text(encoding="utf-8"), where=path.name)


def _with_fixed(parameters: ParameterSet, settings: IdentifySettings) -> ParameterSet:
    for name, value in settings.fix.items():
        parameters = parameters.fix(name, value)
    if not parameters.free:
        raise UsageError("every parameter is fixed", needed="at least one that is free")
    return parameters


def _verify(
    problem: FrequencyProblem,
    found: ParameterSet,
    selection: Selection,
    verify: Sequence[FlightRecord],
    settings: IdentifySettings,
    progress: Callable[[str], None],
) -> list[Checked]:
    structure = problem.structure
    names = {"inputs": structure.inputs, "outputs": structure.outputs}
    system = structure.matrices(found.values)
    omega = problem.data.omega_rad_s[problem.used.any(axis=(0, 1))]
    band = (float(omega[0]), float(omega[-1]))
    axes = [axis_of(name) for name in structure.inputs]
    other = [(record, m) for record in verify for axis in axes for m in find_excitations(record, axis)]
    short: list[Flown] = [*selection.unseen, *((r, m) for r, m in other if m.kind not in RICH_KINDS)]
    sweeps = [(record, m) for record, m in other if m.kind in RICH_KINDS]
    checked = []
    if short:
        checked.append(verify_unseen(system, short, **names, band_rad_s=band, progress=progress))
    if sweeps:
        checked.append(Checked(frequency=cost_on_sweeps(problem, found, sweeps, settings, band)))
    if not checked and verify:
        checked.append(Checked(findings=(_nothing_to_verify(verify, axes),)))
    if not short and not sweeps and not verify:
        checked.append(hold_out(problem, selection.fitted, settings, band, progress))
    return checked


def _nothing_to_verify(verify: Sequence[FlightRecord], axes: Sequence[str]) -> Finding:
    names = ", ".join(record.source.name for record in verify)
    return Finding(
        kind="not_verified",
        severity="warning",
        where=names,
        message=f"{names} holds no excitation of {' or '.join(axes)}, so the model was not verified on it.",
    )


def _finished(
    reduced: Reduced,
    found: ParameterSet,
    limits: Bounds,
    measured: Measured,
    selection: Selection,
    checked: Sequence[Checked],
    findings: Sequence[Finding],
    *,
    records: Sequence[FlightRecord],
    settings: IdentifySettings,
    command: Sequence[str],
) -> Identification:
    problem, structure = reduced.problem, reduced.problem.structure
    system = structure.matrices(found.values)
    cost = cost_document(problem, problem.costs(reduced.solution.theta))
    combinations = unseen_combinations(found, limits)
    remarks = (*findings, *judge_parameters(found, limits), *judge_fit(problem, reduced.solution, cost.average))
    document = ResultDocument(
        model=structure.name,
        inputs=list(structure.inputs),
        outputs=list(structure.outputs),
        states=list(structure.states),
        parameters=parameter_documents(found, limits),
        cost=cost,
        matrices=matrices_document(system),
        poles=pole_documents(system),
        verification=verification_document(checked),
        identifiability=combination_documents(combinations),
        findings=finding_documents(remarks),
        provenance=provenance_document(
            records, settings, command=command, flown=selection.fitted, response=measured.response
        ),
    )
    return Identification(
        document=document,
        model_toml=to_toml(structure, found, standard_deviations(limits)),
        response=measured.response,
        beside=measured.beside,
        model_response=structure.response(found.values, measured.response.omega_rad_s),
        fitted=np.asarray(problem.used),
        segments=measured.segments,
        verifications=tuple(check for part in checked for check in part.verifications),
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
