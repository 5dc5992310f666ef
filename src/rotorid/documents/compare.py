"""What ``compare.json`` holds, schema ``rotorid.compare/1``, and the results that it compares."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from rotorid.data.display import counted
from rotorid.data.quantity import MISSING, with_error
from rotorid.documents.base import Document, FindingDocument, ProvenanceDocument, Shown, ShownDocument, finding_lines
from rotorid.documents.result import MODEL, model_of, read_result, read_text
from rotorid.documents.results import result_files
from rotorid.documents.review import QuantityDocument
from rotorid.errors import UsageError
from rotorid.flying.step_responses import StepPair, compared_steps
from rotorid.identifying.comparison import ComparedManeuver, Comparison, Entry, OnLogsSummary, basis_of, scored_outputs
from rotorid.identifying.cross_validation import signal_scores
from rotorid.models.parameter import Status
from rotorid.models.toml import structure_from_toml
from rotorid.results.summary import DelayBudget, FitVerdict, ParameterEstimate, PoleEstimate, SignalScore, finite
from rotorid.results.verdicts import has_value, verdict
from rotorid.reviewing.measured_steps import with_measured
from rotorid.uncertainty.differences import Difference, Verdict, differences
from rotorid.verification.verification import Kind


class CrossValidatedDocument(Document):
    """Summary of the cross-validation of one result: mean of unseen scores, and their standard deviation."""

    kind: Kind
    mean_percent: float | None
    spread_percent: float | None
    best_percent: float | None = None
    horizon_s: float | None = None


class ComparedModelDocument(Document):
    """One result as a row of the comparison."""

    label: str
    model: str
    method: str
    inputs: list[str]
    outputs: list[str]
    order: int
    free_parameters: int
    verdict: FitVerdict | None = None
    fit_percent: dict[str, float] | None = None
    cross_validation: CrossValidatedDocument | None = None
    on_logs: OnLogsSummary | None = None
    cost: float | None = None
    aic: float | None = None
    bic: float | None = None
    poles: list[PoleEstimate] = Field(default_factory=list)
    delays: dict[str, DelayBudget] = Field(default_factory=dict)


class ComparedValueDocument(Document):
    """A parameter of one result.

    ``z`` is its difference from that of the first result that has it, over the standard deviation of a difference of
    independent estimates; of a number that cannot change sign, of their logarithms. Results that were fitted to a log
    in common are not independent, and a delay beside a lag is another number than one alone: there it is ``null``.
    ``verdict`` says whether it changed, by the rule of ``fleet``. ``identified`` is false where others compensate for
    any change of the parameter: the value is where the search began.
    """

    value: float
    std: float | None
    status: Status
    identified: bool = True
    z: float | None = None
    verdict: Verdict | None = None


class ComparedParameterDocument(Document):
    """A parameter that results share by name and unit, by the label of the result."""

    unit: str
    values: dict[str, ComparedValueDocument]


class ComparedScoreDocument(Document):
    """One model on one maneuver; ``mean_percent`` is over the outputs that all models have in common."""

    seen: bool
    mean_percent: float | None
    scores: dict[str, SignalScore]


class ComparedManeuverDocument(Document):
    """One maneuver of a log, on which every model was scored with frozen parameters, by the label of the result."""

    record: str
    axis: str
    kind: str
    start_s: float
    stop_s: float
    models: dict[str, ComparedScoreDocument]


class ComparedStepDocument(Document):
    """The answer of one model to a unit step: final value, time to 10 % and rise time from 10 to 90 % of it.

    Times are ``null`` where the response does not settle.
    """

    final: float
    start_s: float | None
    rise_s: float | None
    rise_std_s: float | None


class MeasuredStepDocument(Document):
    """Rise time of a step response as a log shows it; ``why`` is the reason where the log does not."""

    log: str
    rise_time_s: QuantityDocument | None
    why: str = ""


class ComparedStepsDocument(Document):
    """Step responses of one pair under several models, by the label of the result, and in the logs."""

    input: str
    output: str
    models: dict[str, ComparedStepDocument]
    measured: list[MeasuredStepDocument] = Field(default_factory=list)


class CompareDocument(ShownDocument):
    """``compare.json``: several models or methods side by side.

    ``common_outputs`` are those over which means on logs are taken. ``horizon_s`` is ``null`` where the maneuvers were
    simulated whole; with an unstable model among them, all were predicted so far ahead, from every sample.
    ``band_rad_s`` is what was looked at: that in which all models of frequency responses were fitted, ``null`` for all.
    With both, records passed a filter without phase before they were predicted, which shows a prediction a little of
    what comes: such scores compare models, and are higher than those of a prediction in flight.
    """

    schema_name: Annotated[Literal["rotorid.compare/1"], Field(alias="schema")] = "rotorid.compare/1"
    models: list[ComparedModelDocument]
    parameters: dict[str, ComparedParameterDocument] = Field(default_factory=dict)
    maneuvers: list[ComparedManeuverDocument] = Field(default_factory=list)
    steps: list[ComparedStepsDocument] = Field(default_factory=list)
    common_outputs: list[str] = Field(default_factory=list)
    horizon_s: float | None = None
    band_rad_s: tuple[float, float] | None = None
    findings: list[FindingDocument] = Field(default_factory=list)
    provenance: ProvenanceDocument

    def shown(self) -> Shown:
        """Each model with the verdict on its fit and its mean on the logs, then the parameters that they share."""
        rows = [
            (row.label, row.model, row.verdict.word if row.verdict else MISSING, _mean_words(row.on_logs))
            for row in self.models
        ]
        rows += [
            (name, shared.unit, label, f"{with_error(value.value, value.std)} {value.verdict or ''}".rstrip())
            for name, shared in self.parameters.items()
            for label, value in shared.values.items()
            if value.identified and value.status != "dropped"
        ]
        return Shown(
            f"{counted(len(self.models), 'model')} compared on {counted(len(self.maneuvers), 'maneuver')}",
            ("which", "model or unit", "verdict or model", "mean on logs, or value"),
            [*rows, *finding_lines(self.findings, 4)],
        )


def _mean_words(found: OnLogsSummary | None) -> str:
    """The mean fit of a model on the logs; flights that it was fitted to flatter it."""
    if found is None:
        return ""
    seen = ", some fitted" if found.seen else ""
    return f"{with_error(found.mean_percent, found.spread_percent)} % on {counted(found.maneuvers, 'maneuver')}{seen}"


def shown_comparison(found: Comparison) -> CompareDocument:
    """A comparison without step responses, which take a while, to be shown."""
    return compare_document(found, steps=())


def compare_document(found: Comparison, steps: Sequence[StepPair] | None = None) -> CompareDocument:
    """A comparison as ``compare.json`` holds it.

    Parameters
    ----------
    steps
        Step responses of its models, where :func:`steps_of` has made them already.
    """
    return CompareDocument(
        models=[_model(entry, found.on_logs.get(entry.label)) for entry in found.entries],
        parameters=_parameters(found.entries),
        maneuvers=[_maneuver(each, found.common_outputs) for each in found.maneuvers],
        steps=[_steps(pair) for pair in (steps_of(found) if steps is None else steps)],
        common_outputs=list(found.common_outputs),
        horizon_s=finite(found.horizon_s),
        band_rad_s=found.band_rad_s,
        findings=[FindingDocument.model_validate(finding) for finding in found.findings],
        provenance=ProvenanceDocument.model_validate(found.provenance),
    )


@lru_cache(maxsize=1)
def steps_of(found: Comparison) -> tuple[StepPair, ...]:
    """Step responses of the models of a comparison whose equations are known, with those that its logs show."""
    # A page, its figures and its document ask one after the other.
    return with_measured(
        compared_steps({entry.label: entry.model for entry in found.entries if entry.scored}), found.records
    )


def _steps(pair: StepPair) -> ComparedStepsDocument:
    return ComparedStepsDocument(
        input=pair.input,
        output=pair.output,
        models={
            label: ComparedStepDocument(
                final=float(step.response[-1]), start_s=step.start_s, rise_s=step.rise_s, rise_std_s=step.rise_std_s
            )
            for label, step in pair.models.items()
        },
        measured=[
            MeasuredStepDocument(
                log=step.log,
                rise_time_s=None if step.rise is None else QuantityDocument.model_validate(step.rise),
                why=step.why,
            )
            for step in pair.measured
        ],
    )


def _model(entry: Entry, summary: OnLogsSummary | None) -> ComparedModelDocument:
    model = entry.model
    fit, validated = model.fit, model.cross_validation
    return ComparedModelDocument(
        label=entry.label,
        model=model.name,
        method=fit.method,
        inputs=list(model.structure.inputs),
        outputs=list(fit.outputs),
        order=len(model.structure.states),
        free_parameters=sum(parameter.status == "free" for parameter in model.parameters.values()),
        verdict=verdict(model),
        fit_percent=None if fit.fit_percent is None else dict(fit.fit_percent),
        cross_validation=None
        if validated is None
        else CrossValidatedDocument(
            kind=validated.kind,
            mean_percent=validated.mean_percent,
            spread_percent=validated.spread_percent,
            best_percent=validated.best.mean_percent if validated.best else None,
            horizon_s=validated.horizon_s,
        ),
        on_logs=summary,
        cost=fit.cost.average if fit.cost else None,
        aic=fit.information.aic if fit.information else None,
        bic=fit.information.bic if fit.information else None,
        poles=list(model.pole_estimates),
        delays=dict(model.delays),
    )


def _parameters(entries: Sequence[Entry]) -> dict[str, ComparedParameterDocument]:
    """Every parameter by its name; where units differ it is another one, and is called so."""
    found: dict[str, tuple[str, dict[str, ParameterEstimate]]] = {}
    for entry in entries:
        for name, parameter in entry.model.parameters.items():
            unit, _ = found.setdefault(name, (parameter.unit, {}))
            own = name if unit == parameter.unit else f"{name} [{parameter.unit}]"
            found.setdefault(own, (parameter.unit, {}))[1][entry.label] = parameter
    known = {entry.label: entry for entry in entries}
    pairs = [(name, *labels) for name, (_, values) in found.items() for labels in _independent(name, values, known)]
    compared = differences(
        [
            (name.partition(" ")[0], _estimate(found[name][1][before]), _estimate(found[name][1][after]))
            for name, before, after in pairs
        ]
    )
    answers = {(name, label): difference for (name, _, label), difference in zip(pairs, compared, strict=True)}
    return {
        name: ComparedParameterDocument(
            unit=unit,
            values={
                label: _value(
                    estimate, answers.get((name, label)), identified=_identified(name, estimate, known[label])
                )
                for label, estimate in values.items()
            },
        )
        for name, (unit, values) in found.items()
    }


def _independent(
    name: str, values: Mapping[str, ParameterEstimate], entries: Mapping[str, Entry]
) -> Iterator[tuple[str, str]]:
    """The first result that has an error, with each that measured the same number on other logs."""
    values = {label: estimate for label, estimate in values.items() if _identified(name, estimate, entries[label])}
    first = next((label for label, estimate in values.items() if estimate.std), None)
    if first is None:
        return
    here = entries[first]
    parameter = name.partition(" ")[0]
    for label, estimate in values.items():
        there = entries[label]
        alike = basis_of(there.model, parameter) == basis_of(here.model, parameter)
        if label != first and estimate.std and alike and not here.fitted_logs & there.fitted_logs:
            yield first, label


def _identified(name: str, estimate: ParameterEstimate, entry: Entry) -> bool:
    return has_value(name.partition(" ")[0], estimate, entry.model.findings)


def _estimate(estimate: ParameterEstimate) -> tuple[float, float]:
    return estimate.value, estimate.std or 0.0


def _value(estimate: ParameterEstimate, difference: Difference | None, *, identified: bool) -> ComparedValueDocument:
    return ComparedValueDocument(
        value=estimate.value,
        std=estimate.std,
        status=estimate.status,
        identified=identified,
        z=None if difference is None else finite(difference.distance),
        verdict=None if difference is None else difference.verdict,
    )


def _maneuver(each: ComparedManeuver, shared: Sequence[str]) -> ComparedManeuverDocument:
    return ComparedManeuverDocument(
        record=each.record,
        axis=each.maneuver.axis,
        kind=each.maneuver.kind,
        start_s=each.maneuver.start_s,
        stop_s=each.maneuver.stop_s,
        models={
            label: ComparedScoreDocument(
                seen=label in each.seen,
                mean_percent=finite(each.mean_percent(label, shared or scored_outputs(group))),
                scores=signal_scores(group),
            )
            for label, group in each.scores.items()
        },
    )


def read_results(paths: Sequence[Path]) -> tuple[Entry, ...]:
    """Read what ``identify`` wrote.

    Parameters
    ----------
    paths
        Folders, of one model or of several, or ``result.json`` files; at least two different models. The ``model.toml``
        in the same folder gives the model.

    Raises
    ------
    UsageError
        A path contains no result, one is given twice, or fewer than two are given.
    ModelError
        A ``model.toml`` is wrong.
    """
    files = [file for path in paths for file in result_files(path)]
    if len(files) < 2:
        for file in files:
            read_result(file, read_text(file))
        came = "only one result was given" if files else "no result was given"
        raise UsageError(came, needed="at least two", remedy="add another")
    for number, file in enumerate(files):
        if file.resolve() in [other.resolve() for other in files[:number]]:
            raise UsageError(f"{file} was given twice", remedy="give each result once")
    return tuple(_read(file, label) for file, label in zip(files, _labels(files), strict=True))


def _labels(files: Sequence[Path]) -> list[str]:
    """Names of the folders, with as many parents as they need to differ."""
    folders = [file.resolve().parent.parts for file in files]
    count = 1
    while len({parts[-count:] for parts in folders}) < len(folders) and count < max(map(len, folders)):
        count += 1
    labels = ["/".join(parts[-count:]) for parts in folders]
    # Two results in one folder differ by the names of their files.
    return [
        f"{label}/{file.name}" if labels.count(label) > 1 else label for label, file in zip(labels, files, strict=True)
    ]


def _read(file: Path, label: str) -> Entry:
    text = read_text(file)
    document = read_result(file, text)
    model = file.parent / MODEL
    structure = structure_from_toml(read_text(model), where=str(model)) if model.exists() else None
    if structure is not None and structure.name != document.model:
        raise UsageError(
            f"{model} is of {structure.name}, but {file} of {document.model}", needed="files of one result"
        )
    return Entry(
        label=label,
        model=model_of(file, document, structure),
        sha256=hashlib.sha256(text.encode()).hexdigest(),
        scored=structure is not None,
    )
