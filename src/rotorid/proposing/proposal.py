"""From an identified plant to gains: the loops as flown, a proposal that is safe for every likely plant, its effect.

Rate models of roll, pitch and yaw are given as results of ``identify``, in models of hover too, or identified from the
logs. The controller is
that of the log, with its exact filters and steps. Checks come first: this controller made the logged commands, the
motors had room, and the plant is known where the gains act. Where a check fails, the flown gains stay, with the reason
and the flight that would help. Nothing is sent to a vehicle.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

from rotorid.autopilots.registry import writer_of
from rotorid.data.base import Immutable
from rotorid.data.display import capital, html_table, lines_of
from rotorid.data.findings import Finding, Findings, refusal, warn, worst_first
from rotorid.data.record import FlightRecord
from rotorid.data.trust import ROBUSTNESS
from rotorid.errors import InsufficientDataError, UsageError, reason_of
from rotorid.flights.controller_check import controller_findings
from rotorid.flights.same_vehicle import require_one_autopilot
from rotorid.io.records import as_records
from rotorid.proposing.axis import KnownAxis, differing_gains, known_axis
from rotorid.proposing.axis_tuning import AxisTuning, axis_tuning, flights_to_goal
from rotorid.proposing.cascade import Cascade
from rotorid.proposing.filter_curve import FilterCurve, filter_curve, with_point
from rotorid.proposing.flown_gains import settings_records
from rotorid.proposing.judging import JudgedGains, judge_gains, load_gains, require_same_autopilot
from rotorid.proposing.new_gains import AxisError, AxisGains, agreed_gains, axis_gains, wishes_of
from rotorid.proposing.outer_flown import checked_by_flight
from rotorid.proposing.proposal_files import proposal_files
from rotorid.proposing.remarks import reason_without_gains, remarks_of, thrust_remarks
from rotorid.proposing.settings import TUNED_AXES, TuneSettings
from rotorid.proposing.shared_filters import require_filters_hold
from rotorid.proposing.thrust import ThrustLinearization, linearization
from rotorid.results.model import IdentifiedModel, Records, Refused, as_models
from rotorid.results.provenance import Provenance, provenance
from rotorid.settings.option import as_settings
from rotorid.tuning.gain_files import GainFile
from rotorid.tuning.proposal import Wishes
from rotorid.typing import Axis, LoopName

if TYPE_CHECKING:
    from rotorid.settings.option_types import TuneOptions

_PROGRESS = logging.getLogger("rotorid.progress")

FULL_SCALE_M = 16.4
"""Rotor diameter of the helicopter for which the guidelines were made."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TuningProposal(Immutable):
    """New gains of a vehicle, and their effect.

    Parameters
    ----------
    autopilot, firmware
        As the log names them.
    axes
        Those with a model and a controller.
    thrust
        What linearizes thrust, with a fit of ``physical.motors`` or ``physical.flight``.
    scale
        Scale factor to a full-size helicopter, where it is known.
    robustness
        Requested largest sensitivity peak.
    judged
        The verdict on foreign gains, where some were given.
    curve
        Filters that could fly with the gains, where they were looked for.
    files, rollback_files
        Name of each file to its text: proposed gains, and the flown ones.
    findings
        Why axes or gains do not change, the worst first.
    provenance
        Source of the models.
    """

    autopilot: str
    firmware: str
    axes: Mapping[LoopName, AxisTuning]
    thrust: ThrustLinearization | None
    scale: float | None
    files: Mapping[str, str]
    rollback_files: Mapping[str, str]
    findings: tuple[Finding, ...]
    provenance: Provenance
    robustness: float = ROBUSTNESS
    judged: JudgedGains | None = None
    curve: FilterCurve | None = None

    def __post_init__(self) -> None:
        self._set(axes=self.axes, files=self.files, rollback_files=self.rollback_files)

    def __repr__(self) -> str:
        return lines_of(self._head, self._rows)

    def _repr_html_(self) -> str:
        findings_html = Findings(self.findings)._repr_html_() if self.findings else ""
        return html_table(self._head, ["axis", "parameter", "flown", "proposed"], self._rows) + findings_html

    @property
    def _head(self) -> str:
        return f"{'new' if self.changed else 'no new'} gains for {self.autopilot}"

    @property
    def _rows(self) -> list[tuple[str, str, str, str]]:
        return [
            (axis, name, f"{before:.4g}", f"{after:.4g}")
            for axis, tuning in self.axes.items()
            for name, (before, after) in tuning.parameters.items()
            if after != before
        ]

    @property
    def changed(self) -> bool:
        """Whether any gain or filter is to change."""
        return any(name.startswith("proposed") for name in self.files)


def tune(
    models: IdentifiedModel | Sequence[IdentifiedModel] = (),
    records: Records = (),
    *,
    settings: TuneSettings | None = None,
    judge: GainFile | Path | str | None = None,
    **options: Unpack[TuneOptions],
) -> TuningProposal:
    """Propose gains of roll, pitch and yaw, and of the outer loops around them.

    Parameters
    ----------
    models
        Results of ``identify`` with the rates of the axes: ``rate.*``, ``axis.*`` or ``hover.*``; missing ones are
        identified from the logs. A model
        ``physical.motors`` or ``physical.flight`` adds the thrust curve.
    records
        Logs, whose parameters give the flown controller.
    settings
        Choices; everything has a default.
    judge
        File with foreign gains, on which a verdict is wanted.
    **options
        Fields of :class:`TuneSettings`, which go before ``settings``.

    Raises
    ------
    InsufficientDataError
        No axis has a model and a controller; findings give the reasons.
    UsageError
        An option is wrong, or nothing was given.

    Examples
    --------
    >>> import rotorid
    >>> proposal = rotorid.tune(records="flight.ulg")  # doctest: +SKIP
    >>> proposal.axes["roll"].parameters["MC_ROLLRATE_P"]  # doctest: +SKIP
    (0.15, 0.21)
    """
    chosen = as_settings(TuneSettings, settings, options)
    logs = as_records(records, optional=True)
    given = as_models(models, remedy="read a result with rotorid.load, and give logs as records=")
    foreign = judge if judge is None or isinstance(judge, GainFile) else load_gains(judge)
    if foreign is not None and len(chosen.axes) == len(chosen.outer) == 1:
        foreign = foreign.of(chosen.outer[0])
    if not given and not logs:
        raise UsageError("nothing to tune", remedy="give logs, results of identify, or both")
    findings = [finding for record in logs for finding in (*record.findings, *controller_findings(record))]
    findings += [*require_one_autopilot(given, logs), *differing_gains(chosen.inner, logs)]
    settings_from = settings_records(given, logs)
    autopilot = next((name for record in settings_from if (name := writer_of(record).name)), "")
    if foreign is not None and settings_from:
        # Before the long work.
        require_same_autopilot(foreign, next(iter(settings_from)), autopilot)
    thrust = linearization(given, next(iter(settings_from), None), autopilot=autopilot, seed=chosen.seed)
    findings += [*thrust.findings, *thrust_remarks(thrust)] if thrust is not None else []
    known, refused = _known_axes(given, logs, chosen, findings)
    curve = None
    if chosen.filter_choice != "keep" and known:
        curve, known, chosen = _with_curve(known, chosen, thrust, findings)
    cascade = Cascade(given, logs, chosen, known)
    verdict = None
    if foreign is not None and (known or chosen.outer):
        verdict = judge_gains(
            foreign,
            known or cascade.known,
            refused,
            gain_range=thrust.flown_range if thrust is not None else (1.0, 1.0),
            outer=cascade.with_parameters,
            asked=chosen.outer,
            logged=settings_from[0].parameters if settings_from else {},
        )
        findings += verdict.findings
    inner, shared = _inner_axes(known, refused, chosen, thrust, findings)
    tuned = inner | _outer_loops(cascade, inner, chosen, findings)
    if not tuned:
        raise InsufficientDataError(
            "no axis can be tuned from this data",
            remedy="see below what each axis needs",
            findings=worst_first(findings)
            or [refusal("not_tuned", "all axes", "No axis can be tuned from this data.")],
        )
    axes = _with_paths(tuned, findings)
    findings += [*shared, *remarks_of(axes, settings_from)]
    if chosen.filters:
        findings += require_filters_hold(
            {axis: known[axis] for axis in chosen.inner if axis in axes and not axes[axis].proposal.changed},
            {axis: refused.get(axis) for axis in TUNED_AXES if axis not in axes},
            given,
            logs,
            filters=chosen.filters,
            wishes=Wishes(sensitivity_peak=chosen.robustness),
            draws=chosen.draws,
            seed=chosen.seed,
        )
    files = proposal_files(axes, thrust, given, logs, chosen.filters)
    first = next(iter(axes.values())).controller
    return TuningProposal(
        autopilot=first.autopilot,
        firmware=first.firmware,
        axes=axes,
        thrust=files.thrust,
        scale=chosen.scale or _scale(given),
        robustness=chosen.robustness,
        files=files.proposed,
        rollback_files=files.rollback,
        findings=worst_first([*findings, *files.findings]),
        provenance=_provenance(logs, given, chosen),
        judged=verdict,
        curve=curve,
    )


_Tuned = dict[LoopName, tuple[KnownAxis, AxisTuning]]


def _known_axes(
    given: Sequence[IdentifiedModel], logs: Sequence[FlightRecord], chosen: TuneSettings, findings: list[Finding]
) -> tuple[dict[Axis, KnownAxis], dict[Axis, InsufficientDataError]]:
    """The axes whose loops are known, and why the others are not; findings are added."""
    known: dict[Axis, KnownAxis] = {}
    refused: dict[Axis, InsufficientDataError] = {}
    for axis in chosen.inner:
        _PROGRESS.info(f"tuning {axis}")
        try:
            known[axis] = known_axis(
                axis,
                given,
                logs,
                filters=chosen.filters,
                draws=chosen.draws,
                seed=chosen.seed,
                findings=findings,
            )
        except UsageError:
            # A model or an option that was given for this axis is wrong: the user decides.
            raise
        except Exception as failure:
            # What fails on one axis ends no other.
            refused[axis], remarks = reason_without_gains(axis, failure)
            findings += [finding for finding in remarks if finding not in findings]
    return known, refused


def _with_curve(
    known: dict[Axis, KnownAxis],
    chosen: TuneSettings,
    thrust: ThrustLinearization | None,
    findings: list[Finding],
) -> tuple[FilterCurve | None, dict[Axis, KnownAxis], TuneSettings]:
    """Filters with gains, and the axes and settings with those that were picked; as they were where none is known."""
    _PROGRESS.info("looking for filters")
    try:
        curve = filter_curve(known, lambda one: wishes_of(one.controller, chosen, thrust), chosen.filters)
    except InsufficientDataError as error:
        why = f"Not enough data for other filters: {error.came}; {error.remedy or error.expectation}."
        findings.append(warn("filter_not_judged", "filters", why))
        return None, known, chosen
    except AxisError as failed:
        # The axis is named, with the reason, where its gains are searched.
        why = f"Other filters were not looked for, because the gains of {failed.axis} could not be searched."
        findings.append(warn("filter_not_judged", "filters", why))
        return None, known, chosen
    number = curve.recommended if chosen.filter_choice == "propose" else chosen.filter_choice
    if number == "curve":
        return curve, known, chosen
    point = curve.point(int(number))
    picked = replace(chosen, filters={**chosen.filters, **point.values}, noise=point.noise_limit)
    changed = with_point(known, point, chosen.filters) if point.filters else known
    return replace(curve, picked=point.number), changed, picked


def _inner_axes(
    known: Mapping[Axis, KnownAxis],
    refused: dict[Axis, InsufficientDataError],
    chosen: TuneSettings,
    thrust: ThrustLinearization | None,
    findings: list[Finding],
) -> tuple[_Tuned, list[Finding]]:
    """All axes with their gains, and a note on a shared angle gain; what fails is added to refusals and findings."""
    left = dict(known)
    while left:
        try:
            agreed, remarks = agreed_gains(left, lambda one: wishes_of(one.controller, chosen, thrust))
            return {axis: (one, _tuning_of(axis, one, agreed[axis], chosen)) for axis, one in left.items()}, remarks
        except AxisError as failed:
            # What another axis was tuned to, or shares with it, is found anew without it.
            del left[failed.axis]
            refused[failed.axis], why = reason_without_gains(failed.axis, failed.cause)
            findings += [finding for finding in why if finding not in findings]
    return {}, []


def _tuning_of(axis: Axis, known: KnownAxis, found: AxisGains, chosen: TuneSettings) -> AxisTuning:
    try:
        return axis_tuning(axis, known, found, chosen.filters)
    except UsageError:
        raise
    except Exception as failure:
        raise AxisError(axis, failure) from failure


def _outer_loops(cascade: Cascade, inner: _Tuned, chosen: TuneSettings, findings: list[Finding]) -> _Tuned:
    """The outer loops around axes with their new gains; findings are added."""
    gains = {axis: tuning.proposal.proposed.gains for axis, (_, tuning) in inner.items()}
    tuned: _Tuned = {}
    for loop in chosen.outer:
        _PROGRESS.info(f"tuning {loop}")
        try:
            known, remarks = cascade.outer(loop, gains)
            remarks = checked_by_flight(known, remarks) if loop == "velocity" else remarks
            found = axis_gains(loop, known, wishes_of(known.controller, chosen))
            tuned[loop] = known, axis_tuning(loop, known, found, chosen.filters)
        except UsageError:
            raise
        except Exception as failure:
            remarks = reason_without_gains(loop, failure)[1]
        findings += [finding for finding in remarks if finding not in findings]
    findings += [finding for finding in cascade.findings if finding not in findings]
    return tuned


def _with_paths(tuned: _Tuned, findings: list[Finding]) -> dict[LoopName, AxisTuning]:
    """Axes with the flights to their goals; findings are added."""
    axes = {}
    for loop, (known, tuning) in tuned.items():
        axes[loop] = tuning
        try:
            axes[loop] = replace(tuning, path=flights_to_goal(loop, known, tuning))
        except Exception as failure:
            # The gains stand without their flights.
            error = reason_of(failure, f"flights to the goal of {loop}")
            findings.append(warn("internal_error", loop, f"{capital(str(error)).rstrip('.')}."))
    return axes


def _provenance(logs: Sequence[FlightRecord], given: Sequence[IdentifiedModel], chosen: TuneSettings) -> Provenance:
    """The logs of a proposal, or those of its first result where there are no others, with the choices of ``tune``."""
    own = provenance(logs, chosen)
    return own if logs else replace(given[0].provenance, settings=own.settings, seed=own.seed)


def _scale(models: Sequence[IdentifiedModel]) -> float | None:
    """Full scale over the distance between opposite rotors."""
    arms = [model.motors.arm_m for model in models if model.motors is not None and model.motors.arm_m]
    return FULL_SCALE_M / (2.0 * arms[0]) if arms else None


def refused_tuning(error: InsufficientDataError, records: Sequence[FlightRecord], settings: TuneSettings) -> Refused:
    """The refusal where no axis can be tuned."""
    return Refused(
        name="tune",
        structure=None,
        findings=worst_first(error.findings or [refusal("not_tuned", "all axes", str(error))]),
        provenance=provenance(records, settings),
    )
