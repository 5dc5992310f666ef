"""What the page says about one identification."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rotorid.pipeline.document import ResultDocument
from rotorid.pipeline.identification import Identification
from rotorid.report.bootstrap_section import BootstrapShown, bootstrap_shown
from rotorid.report.checks import Check, check_section
from rotorid.report.delays import DelayRow, delay_rows, delay_sentence
from rotorid.report.fit_words import fit_sentences, sparkline
from rotorid.report.matrix_tables import MatrixTable, matrix_tables
from rotorid.report.model_pictures import model_pictures
from rotorid.report.modes import PoleRow, pole_rows, poles_picture, poles_sentence
from rotorid.report.motor_section import MotorsShown, motors_shown
from rotorid.report.numbers import significant
from rotorid.report.parameter_table import (
    Dropped,
    ParameterGroup,
    dropped_parameters,
    parameter_groups,
    truth_of_dropped,
)
from rotorid.report.picture import Picture
from rotorid.report.reduction_rows import StepRow, reduction_sentence, step_rows, told_by_steps
from rotorid.report.scope_rows import RangeRow, constants_sentence, range_rows
from rotorid.report.search_section import SearchShown, search_shown
from rotorid.report.tables import CostRow, FindingRow, ManeuverRow, cost_rows, finding_rows, maneuver_row
from rotorid.report.time_crossed import Crossed, crossed
from rotorid.report.time_fits import TimeFits, time_fits
from rotorid.report.time_words import time_sentences
from rotorid.report.timelines import timelines
from rotorid.report.told_apart import correlation_picture, correlation_sentence
from rotorid.report.unseen_pictures import UnseenSweeps, unseen_sweeps
from rotorid.report.wording import (
    LEVELS,
    Verdict,
    cost_verdict,
    fit_verdict,
    held_out,
    summary,
    worst_maneuver,
    worst_record,
)


@dataclass(frozen=True, kw_only=True)
class Fit:
    """How the fit went."""

    sentences: tuple[str, ...]
    curve: str


@dataclass(frozen=True, kw_only=True)
class Section:
    """One identification on the page."""

    anchor: str
    title: str
    document: ResultDocument
    records: tuple[str, ...]
    sentences: tuple[str, ...]
    cost: Verdict | None
    unseen: Verdict | None
    parameters: tuple[ParameterGroup, ...]
    dropped: tuple[Dropped, ...]
    truth_of_dropped: str
    fit: Fit | None
    costs: tuple[CostRow, ...]
    unseen_words: str
    responses: tuple[Picture, ...]
    folded_responses: tuple[Picture, ...]
    joint: bool
    least_coherence: float
    checks: tuple[Check, ...]
    sweeps: tuple[UnseenSweeps, ...]
    poles: tuple[PoleRow, ...]
    poles_words: str
    poles_picture: Picture | None
    matrices: tuple[MatrixTable, ...]
    delays: tuple[DelayRow, ...]
    delay_words: str
    covered: tuple[RangeRow, ...]
    constants: str
    steps: tuple[StepRow, ...]
    steps_words: str
    correlation: Picture | None
    correlation_words: str
    findings: tuple[FindingRow, ...]
    findings_in_steps: int
    maneuvers: tuple[ManeuverRow, ...]
    timelines: tuple[Picture, ...]
    time: TimeFits | None = None
    crossed: Crossed | None = None
    search: SearchShown | None = None
    bootstrap: BootstrapShown | None = None
    motors: MotorsShown | None = None

    @property
    def far_from_truth(self) -> bool:
        """Whether a known truth lies beyond what random errors explain."""
        return any(row.off.marked for group in self.parameters for row in group.rows)

    @property
    def pictures(self) -> tuple[Picture, ...]:
        """All figures of the section."""
        single = (self.search.picture if self.search else None, self.poles_picture, self.correlation)
        return (
            *(self.motors.pictures if self.motors else ()),
            *(self.time.all_pictures if self.time else ()),
            *self.responses,
            *self.folded_responses,
            *(picture for check in self.checks for picture in check.pictures),
            *(picture for one in self.sweeps for picture in one.pictures),
            *(picture for picture in single if picture is not None),
            *self.timelines,
        )


def section(identified: Identification, *, anchor: str, truth: Mapping[str, float]) -> Section:
    """Everything that the page says about one identification.

    Parameters
    ----------
    identified
        What ``identify`` found.
    anchor
        Prefix of the identifiers on the page, unique among its sections.
    truth
        True parameter values where they are known, as ``model.name`` or ``name``.
    """
    document = identified.document
    responses = model_pictures(identified, anchor=anchor)
    findings = [finding for finding in document.findings if not told_by_steps(finding, document)]
    return Section(
        anchor=anchor,
        title=_title(document),
        document=document,
        records=tuple(dict.fromkeys(segment.record for segment in identified.segments)),
        sentences=summary(document),
        cost=_explained(document),
        unseen=_unseen(document),
        parameters=parameter_groups(document, truth),
        dropped=dropped_parameters(document, anchor=anchor),
        truth_of_dropped=truth_of_dropped(document, truth),
        fit=_fit(document),
        costs=cost_rows(document),
        unseen_words="Held-out maneuver" if held_out(document) else "Unseen sweeps",
        responses=responses.leading,
        folded_responses=responses.folded,
        joint=identified.response.estimate == "joint",
        least_coherence=identified.least_coherence,
        checks=tuple(
            check_section(check, key=f"{anchor}-check-{number}")
            for number, check in enumerate(() if document.motors else identified.verifications)
        ),
        sweeps=tuple(
            unseen_sweeps(one, key=f"{anchor}-sweeps-{number}", least_coherence=identified.least_coherence)
            for number, one in enumerate(identified.judged)
        ),
        poles=pole_rows(document.poles),
        poles_words=poles_sentence(document.poles),
        poles_picture=poles_picture(document.poles, key=f"{anchor}-poles"),
        matrices=matrix_tables(document),
        delays=delay_rows(document),
        delay_words=delay_sentence(document),
        covered=range_rows(document.covered),
        constants=constants_sentence(document.constants),
        steps=step_rows(document.reduction, anchor=anchor),
        steps_words=reduction_sentence(document.reduction),
        correlation=correlation_picture(document.correlation, key=f"{anchor}-correlation"),
        correlation_words=correlation_sentence(document.correlation),
        findings=finding_rows(findings),
        findings_in_steps=len(document.findings) - len(findings),
        maneuvers=tuple(maneuver_row(flown.record, flown) for flown in document.provenance.maneuvers),
        time=None if document.motors else time_fits(identified, key=f"{anchor}-time"),
        motors=motors_shown(identified, key=f"{anchor}-motors"),
        crossed=crossed(document.cross_validation),
        search=search_shown(document.search, key=f"{anchor}-search-cost"),
        bootstrap=bootstrap_shown(document),
        timelines=timelines(
            () if identified.simulated else identified.segments,
            document.provenance.maneuvers,
            inputs=document.inputs,
            outputs=document.outputs,
            key=f"{anchor}-timeline",
        ),
    )


def _title(document: ResultDocument) -> str:
    # "Roll" for a single command, the model's name for anything richer.
    if len(document.inputs) == 1 and document.inputs[0].endswith("_command"):
        return document.inputs[0].removesuffix("_command").capitalize()
    return document.model


def _cost(cost: float) -> Verdict:
    return Verdict(cost_verdict(cost).level, f"cost {significant(cost)}")


def _explained(document: ResultDocument) -> Verdict | None:
    """Verdict on the fit: that of the worst output for a fit in time, of the cost in the frequency domain."""
    if document.method != "frequency" and document.fit_percent:
        return fit_verdict(min(document.fit_percent.values()))
    return _cost(document.cost.average) if document.cost else None


def _unseen(document: ResultDocument) -> Verdict | None:
    """The worse of what unseen maneuvers and unseen sweeps say."""
    costs = document.verification.frequency.values()
    found = document.verification
    flown = worst_maneuver(found.maneuvers) if found.maneuvers else worst_record(found.records)
    verdicts = [*([flown] if flown else []), *([_cost(max(costs))] if costs else [])]
    return max(verdicts, key=lambda verdict: LEVELS.index(verdict.level), default=None)


def _fit(document: ResultDocument) -> Fit | None:
    if document.fit is None:
        return None
    in_time = document.method != "frequency"
    sentences = time_sentences(document, document.fit) if in_time else fit_sentences(document.fit)
    return Fit(sentences=sentences, curve=sparkline(document.fit.trace))
