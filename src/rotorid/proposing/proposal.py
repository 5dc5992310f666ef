"""From an identified plant to gains: the loops as flown, a proposal that is safe for every likely plant, its effect.

Rate models of roll, pitch and yaw are given as results of ``identify``, in models of hover too, or identified from the
logs. The controller is
that of the log, with its exact filters and steps. Checks come first: this controller made the logged commands, the
motors had room, and the plant is known where the gains act. Where a check fails, the flown gains stay, with the reason
and the flight that would help. Nothing is sent to a vehicle.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from rotorid.autopilots.registry import writer_of
from rotorid.data.base import Immutable
from rotorid.data.display import capital, html_table, lines_of
from rotorid.data.findings import Finding, Findings, refusal, remark, warn, worst_first
from rotorid.data.quantity import Quantity
from rotorid.data.record import FlightRecord
from rotorid.data.trust import ROBUSTNESS
from rotorid.errors import InsufficientDataError, UsageError, reason_of
from rotorid.flights.controller_check import controller_findings
from rotorid.flights.same_vehicle import require_one_autopilot
from rotorid.flying.next_steps import sweep_for_tune
from rotorid.io.records import as_records
from rotorid.models.autopilots.settings import AxisController
from rotorid.proposing.axis import KnownAxis, differing_gains, known_axis, needed_rad_s
from rotorid.proposing.axis_gains import (
    AxisError,
    AxisGains,
    agreed_gains,
    axis_gains,
    scores_of,
    shares_angle,
    wishes_of,
)
from rotorid.proposing.filter_curve import FilterCurve, filter_curve, with_point
from rotorid.proposing.filters import FilterPrice, changed_filters, prices
from rotorid.proposing.flown_gains import FlownLoop, at_ends, flown_controllers, settings_records
from rotorid.proposing.judging import JudgedGains, judge_gains, load_gains, require_same_autopilot
from rotorid.proposing.outer import InnerLoop, OuterMaterial, known_outer, with_values
from rotorid.proposing.outer_flown import checked_by_flight
from rotorid.proposing.plants import flight_by_stick
from rotorid.proposing.settings import TUNED_AXES, TuneSettings
from rotorid.proposing.shared_filters import require_filters_hold
from rotorid.proposing.steps import attitude_steps, step_times_s
from rotorid.proposing.thrust import ThrustLinearization, linearization
from rotorid.results.model import IdentifiedModel, Records, Refused
from rotorid.results.provenance import Provenance, provenance
from rotorid.settings.option import as_settings
from rotorid.signal.excitations import rich_excitations
from rotorid.tuning.bands import BAND_OVER_CROSSOVER
from rotorid.tuning.files import parameter_files
from rotorid.tuning.firmware import rounded, scaled, written
from rotorid.tuning.gain_files import GainFile
from rotorid.tuning.kinds import KINDS
from rotorid.tuning.loops import ControllerParts, Gains, loop_figures, over_draws
from rotorid.tuning.plant import UncertainPlant
from rotorid.tuning.proposal import AxisProposal, Judged, Wishes, flights_between, steps_beyond
from rotorid.typing import Axis, ComplexArray, FloatArray, LoopName

_PROGRESS = logging.getLogger("rotorid.progress")

FULL_SCALE_M = 16.4
"""Rotor diameter of the helicopter for which the guidelines were made."""

_NEARLY = 1.15
_SAME_GAIN = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class PathStep(Immutable):
    """Gains of one of several flights.

    Parameters
    ----------
    flight
        Which one: the proposed gains are those of the first.
    goal
        Whether no further step follows.
    judged
        The gains, and their effect on every draw of today's plant.
    parameters
        The same, by the firmware's names.
    """

    flight: int
    goal: bool
    judged: Judged
    parameters: Mapping[str, float]

    def __post_init__(self) -> None:
        self._set(parameters=self.parameters)


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisTuning(Immutable):
    """An axis: its controller, its plant, flown and proposed gains, and their effect.

    Parameters
    ----------
    controller
        As the log has it.
    plant
        With draws of its uncertainty.
    omega_rad_s
        Frequencies of the responses below.
    proposal
        Flown and proposed gains, judged on all draws.
    parameters
        Firmware's name of each gain to its flown and proposed value, which are equal where it does not change.
    loops
        ``flown``, ``proposed``, ``flown_whole``, ``proposed_whole``: broken loops over the draws, ``(draws, f)``.
    responses
        ``attitude`` over its set-point and ``disturbance``, the attitude over a moment in commands, each followed by
        ``_flown`` or ``_proposed``, over the draws, ``(draws, f)``.
    step_s, steps
        Seconds, and the step response of the attitude with both gains, ``(draws, n)`` each.
    parts
        Transfer functions of each gain, with the filters of the proposal.
    path
        The flights to the best gains within the limits, the proposed gains first and the goal last; empty where one
        flight reaches them.
    prices
        Phase lag and noise of every filter of the proposed loop.
    ends
        Effect of the proposed gains at each end of a D that changes in flight.
    noise_seen
        Whether the log shows the noise of the rate, so that noise is in units of the command and not only a ratio.
    without_derivative
        Phase margin in degrees that the rate loop would have without D, for ``flown`` and ``proposed`` gains: what D
        is worth beside this P. ``None`` where a likely loop is unstable without it; absent where D is zero.
    """

    controller: AxisController
    plant: UncertainPlant
    omega_rad_s: FloatArray
    proposal: AxisProposal
    parameters: Mapping[str, tuple[float, float]]
    loops: Mapping[str, ComplexArray]
    responses: Mapping[str, ComplexArray]
    step_s: FloatArray
    steps: Mapping[str, FloatArray]
    parts: ControllerParts
    wishes: Wishes = field(default_factory=Wishes)
    path: tuple[PathStep, ...] = ()
    prices: tuple[FilterPrice, ...] = ()
    ends: Mapping[str, Judged] = field(default_factory=dict)
    noise_seen: bool = False
    without_derivative: Mapping[str, Quantity | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._set(
            without_derivative=self.without_derivative,
            parameters=self.parameters,
            loops=self.loops,
            responses=self.responses,
            steps=self.steps,
            path=tuple(self.path),
            prices=tuple(self.prices),
            ends=self.ends,
        )

    @cached_property
    def needed_rad_s(self) -> float:
        """Upper end of the sweep that the best gains need."""
        return needed_rad_s(self.proposal.axis, self.plant, self.controller, self.parts, self.wishes)

    @property
    def changed(self) -> bool:
        """Whether a gain or a filter of the axis is to change."""
        return any(after != before for before, after in self.parameters.values())


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
    **options: Any,
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
    logs = as_records(records)
    given = (models,) if isinstance(models, IdentifiedModel) else tuple(models)
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
    findings += [*thrust.findings, *_thrust_remarks(thrust)] if thrust is not None else []
    known: dict[Axis, KnownAxis] = {}
    refused: dict[Axis, InsufficientDataError] = {}
    look = {"draws": chosen.draws, "seed": chosen.seed}
    for axis in chosen.inner:
        _PROGRESS.info(f"tuning {axis}")
        try:
            known[axis] = known_axis(axis, given, logs, filters=chosen.filters, findings=findings, **look)
        except UsageError:
            # A model or an option that was given for this axis is wrong: the user decides.
            raise
        except Exception as failure:
            # What fails on one axis ends no other.
            refused[axis], remarks = _refused(axis, failure)
            findings += [finding for finding in remarks if finding not in findings]
    curve = None
    if chosen.filter_choice != "keep" and known:
        curve, known, chosen = _with_curve(known, chosen, thrust, findings)
    cascade = _Cascade(given, logs, chosen, dict(known))
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
    axes: dict[LoopName, AxisTuning] = {}
    shared: list[Finding] = []
    while known:
        try:
            inner, shared = _inner_axes(known, chosen, thrust)
            axes = {**axes, **dict(inner.items())}
            break
        except AxisError as failed:
            # What another axis was tuned to, or shares with it, is found anew without it.
            del known[failed.axis]
            refused[failed.axis], remarks = _refused(failed.axis, failed.cause)
            findings += [finding for finding in remarks if finding not in findings]
    every: dict[LoopName, KnownAxis] = dict(known.items())
    for loop in chosen.outer:
        _PROGRESS.info(f"tuning {loop}")
        try:
            every[loop], remarks = cascade.outer(loop, axes)
            remarks = checked_by_flight(every[loop], remarks) if loop == "velocity" else remarks
            gains = axis_gains(loop, every[loop], wishes_of(every[loop].controller, chosen))
            axes[loop] = axis_tuning(loop, every[loop], gains, chosen.filters)
        except UsageError:
            raise
        except Exception as failure:
            remarks = _refused(loop, failure)[1]
        findings += [finding for finding in remarks if finding not in findings]
    findings += [finding for finding in cascade.findings if finding not in findings]
    if not axes:
        raise InsufficientDataError(
            "no axis can be tuned from this data",
            remedy="see below what each axis needs",
            findings=worst_first(findings)
            or [refusal("not_tuned", "all axes", "No axis can be tuned from this data.")],
        )
    for loop, tuning in axes.items():
        try:
            path = _path(loop, every[loop], tuning)
        except Exception as failure:
            # The gains stand without their flights.
            error = reason_of(failure, f"flights to the goal of {loop}")
            findings.append(warn("internal_error", loop, f"{capital(str(error)).rstrip('.')}."))
        else:
            axes[loop] = replace(tuning, path=path)
    findings += shared
    findings += _remarks(axes, settings_from)
    if chosen.filters:
        findings += require_filters_hold(
            {axis: one for axis, one in known.items() if not axes[axis].proposal.changed},
            {axis: refused.get(axis) for axis in TUNED_AXES if axis not in axes},
            given,
            logs,
            filters=chosen.filters,
            wishes=Wishes(sensitivity_peak=chosen.robustness),
            **look,
        )
    return replace(_together(axes, findings, logs, given, chosen, thrust), judged=verdict, curve=curve)


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


class _Cascade:
    """Outer loops around the inner ones, as flown and as they will fly."""

    def __init__(
        self,
        given: Sequence[IdentifiedModel],
        logs: Sequence[FlightRecord],
        settings: TuneSettings,
        known: Mapping[Axis, KnownAxis],
    ) -> None:
        self.findings: list[Finding] = []
        # Why an axis that was asked for is not known is said of it already.
        self._lacking = ""
        self._asked, self._given, self._logs, self._settings = known, tuple(given), tuple(logs), settings

    @cached_property
    def known(self) -> dict[Axis, KnownAxis]:
        """Inner loops: those that are tuned, and roll and pitch where they are known."""
        found, own = dict(self._asked), self._settings
        for axis in TUNED_AXES[:2]:
            if axis not in found and axis not in own.inner:
                try:
                    found[axis] = known_axis(
                        axis,
                        self._given,
                        self._logs,
                        filters=own.filters,
                        draws=own.draws,
                        seed=own.seed,
                        findings=self.findings,
                    )
                except InsufficientDataError as error:
                    self._lacking = self._lacking or error.came
        return found

    def outer(self, loop: LoopName, tuned: Mapping[LoopName, AxisTuning]) -> tuple[KnownAxis, list[Finding]]:
        """An outer loop around loops with their proposed gains."""
        new = {
            axis: InnerLoop(one, tuned[axis].proposal.proposed.gains if axis in tuned else one.gains, one.then)
            for axis, one in self.known.items()
        }
        return known_outer(loop, self._material(self._flown), self._material(new))

    def with_parameters(self, loop: LoopName, values: Mapping[str, float]) -> KnownAxis:
        """An outer loop around loops with the parameters of a file."""
        then = {axis: with_values(one.flown.record, values) for axis, one in self.known.items()}
        new = {
            axis: InnerLoop(one, Gains.of(one.flown.with_parameters(then[axis]).controller), then[axis])
            for axis, one in self.known.items()
        }
        return known_outer(loop, self._material(self._flown), self._material(new, values))[0]

    @property
    def _flown(self) -> dict[Axis, InnerLoop]:
        return {axis: InnerLoop(one, one.gains) for axis, one in self.known.items()}

    def _material(self, inner: Mapping[Axis, InnerLoop], values: Mapping[str, float] | None = None) -> OuterMaterial:
        return OuterMaterial(
            given=self._given,
            logs=self._logs,
            inner=inner,
            draws=self._settings.draws,
            seed=self._settings.seed,
            values=values or {},
            lacking=self._lacking,
        )


def _refused(axis: LoopName, failure: Exception) -> tuple[InsufficientDataError, list[Finding]]:
    """Why an axis has no gains, and what to say of it."""
    error = reason_of(failure, f"gains of {axis}")
    lack = error if isinstance(error, InsufficientDataError) else None
    # tune does not have the options of identify.
    todo = error.expectation if "--" in error.remedy or not error.remedy else error.remedy
    why = "; ".join(part.rstrip(".") for part in (error.came, todo) if part)
    head = "Not enough data to tune" if error.needed else "No new gains for"
    _PROGRESS.info(f"{axis}: {error}")
    refused = lack or InsufficientDataError(error.came, needed=error.needed, remedy=error.remedy)
    return refused, [*(lack.findings if lack else ()), warn("not_tuned", axis, f"{head} {axis}: {why}.")]


def _inner_axes(
    known: Mapping[Axis, KnownAxis], settings: TuneSettings, thrust: ThrustLinearization | None
) -> tuple[dict[Axis, AxisTuning], list[Finding]]:
    """All axes with their gains, and a note on an angle gain that two of them share."""
    agreed, remarks = agreed_gains(known, lambda one: wishes_of(one.controller, settings, thrust))
    axes = {}
    for axis, one in known.items():
        try:
            axes[axis] = axis_tuning(axis, one, agreed[axis], settings.filters)
        except UsageError:
            raise
        except Exception as failure:
            raise AxisError(axis, failure) from failure
    return axes, remarks


def axis_tuning(axis: LoopName, known: KnownAxis, found: AxisGains, filters: Mapping[str, float]) -> AxisTuning:
    """An axis with its gains and their effect.

    Parameters
    ----------
    axis, known
        With the filters to fly.
    found
        Its gains.
    filters
        Those among the parameters that the user asked for.
    """
    flown, plant, then, controller, parts = known.flown, known.plant, known.then, known.controller, known.parts
    omega, drawn, proposal = known.omega_rad_s, known.drawn(), found.proposal
    before = known.flown_plant or plant
    sets = {
        "flown": (before.drawn(omega), known.flown_parts, proposal.flown.gains),
        "proposed": (drawn, parts, proposal.proposed.gains),
    }
    return AxisTuning(
        controller=flown.controller,
        plant=plant,
        omega_rad_s=omega,
        proposal=proposal,
        parameters=_parameters(known, filters, proposal),
        loops=_loops(sets),
        responses=_responses(omega, sets),
        parts=parts,
        wishes=found.wishes,
        prices=prices(
            None if KINDS[axis].outer else then or flown.record,
            controller,
            parts,
            plant.response(omega),
            proposal.proposed.gains,
        ),
        ends={
            name: scores_of(known, end, _with_end(proposal.proposed.gains, end))
            for name, end in at_ends(controller, parts).items()
        },
        noise_seen=parts.shows_noise,
        without_derivative=_without_derivative(omega, sets, plant.known_from_rad_s),
        **_steps(flown, then, (before, plant), proposal),
    )


def _path(axis: LoopName, known: KnownAxis, tuning: AxisTuning) -> tuple[PathStep, ...]:
    """The flights to the goal, gains as the firmware will hold them; an angle gain of two axes stays as proposed."""
    found, wishes = tuning.proposal, tuning.wishes
    if shares_angle(known):
        wishes = replace(wishes, angle_1_s=found.proposed.gains.A)
    beyond = steps_beyond(
        axis,
        known.plant,
        found,
        parts=known.parts,
        flown_parts=None if known.then is None else known.flown_parts,
        ends=tuple(at_ends(known.controller, known.parts).values()),
        wishes=wishes,
    )
    if not beyond:
        return ()
    steps = [found.proposed]
    steps += [scores_of(known, known.parts, rounded(known.controller, scores.gains)) for scores in beyond]
    flights = [1, *range(2, len(beyond) + 1)]
    flights.append(flights[-1] + max(1, flights_between(steps[-2].gains, steps[-1].gains, wishes)))
    return tuple(
        PathStep(
            flight=flight, goal=scores is steps[-1], judged=scores, parameters=written(known.controller, scores.gains)
        )
        for flight, scores in zip(flights, steps, strict=True)
    )


def _thrust_remarks(thrust: ThrustLinearization) -> list[Finding]:
    """How the thrust curve changes the gains."""
    low, high = thrust.flown_range
    if high - low <= _SAME_GAIN:
        return []
    message = (
        f"Over the flown throttle, the loop gain is {low:.2f} to {high:.2f} times that in hover, by the identified "
        "thrust curve. The new gains keep their limits over this whole range."
    )
    return [remark("thrust_range", thrust.parameter, message, lowest=low, highest=high)]


def _with_end(gains: Gains, end: ControllerParts) -> Gains:
    return replace(gains, D=end.controller.derivative_s2)


def _remarks(axes: Mapping[LoopName, AxisTuning], settings_from: Sequence[FlightRecord]) -> Iterator[Finding]:
    """Why gains do not change, what limits them, and which sweep would measure more."""
    short = [axis for axis in TUNED_AXES if axis in axes and _ends_early(axes[axis])]
    command = sweep_for_tune(settings_from[0], short) if short and settings_from else ""
    for axis, tuned in axes.items():
        if tuned.proposal.reasons:
            words = "; ".join(tuned.proposal.reasons)
            what = "are limited" if tuned.proposal.changed else "do not change"
            yield remark("tuning_bound", axis, f"The gains of {axis} {what}: {words}.")
        if axis in short:
            crossover, top = tuned.proposal.proposed.rate.usual_crossover_rad_s, tuned.plant.band_rad_s[1]
            loop = "new loop" if tuned.proposal.changed else "loop"
            message = (
                f"{capital(axis)} was measured up to {_hz(top)}, close to the crossover of the {loop} "
                f"({_hz(crossover)}), so the margins rely on the model. "
                f"{_next_flight(axis, settings_from, tuned.needed_rad_s, command)}"
            )
            numbers = {"crossover_rad_s": crossover, "needed_rad_s": tuned.needed_rad_s}
            yield warn("band_below_crossover", axis, message, **numbers)


def _next_flight(axis: Axis, logs: Sequence[FlightRecord], needed_rad_s: float, command: str) -> str:
    """The flight that shows an axis up to a frequency, as a sentence: a sweep, or 30 s in acro after one by stick."""
    sweep = f"fly a sweep up to {_hz(needed_rad_s)}{f', planned by: {command}' if command else ''}"
    flown = [record for record in logs if record.topics]
    if not flown or any(rich_excitations(record, axis) for record in flown):
        return capital(sweep if command else f"{sweep}.")
    stick = capital(flight_by_stick(axis))
    return f"{stick}; or {sweep}" if command else f"{stick}."


def _hz(omega_rad_s: float) -> str:
    """A frequency as pilots set it."""
    return f"{omega_rad_s / (2.0 * np.pi):.1f} Hz"


def _ends_early(tuned: AxisTuning) -> bool:
    """Whether the measured band ends below what the proposed gains need."""
    top = tuned.plant.band_rad_s[1]
    crosses = tuned.proposal.proposed.rate.usual_crossover_rad_s
    # A measured band ends a little below the end of its sweep.
    return crosses * BAND_OVER_CROSSOVER > top and tuned.needed_rad_s > _NEARLY * top


def _parameters(known: KnownAxis, filters: Mapping[str, float], found: AxisProposal) -> dict[str, tuple[float, float]]:
    """Every gain and filter of the loop by the firmware's name, flown and proposed."""
    flown, then = known.flown.controller, known.controller
    new = {**then.filters, **(written(then, found.proposed.gains) if found.changed else {})}
    before = {**flown.gains, **flown.filters}
    if KINDS[known.flown.axis].outer:
        return {name: (value, new.get(name, value)) for name, value in before.items()}
    gyro = changed_filters(known.flown.record, filters, gyro=True)
    return {name: (value, new.get(name, value)) for name, value in before.items()} | gyro


_Sets = Mapping[str, tuple[ComplexArray, ControllerParts, Gains]]


def _loops(sets: _Sets) -> dict[str, ComplexArray]:
    rate = {name: drawn * parts.rate(gains) for name, (drawn, parts, gains) in sets.items()}
    return rate | {f"{name}_whole": drawn * parts.whole(gains) for name, (drawn, parts, gains) in sets.items()}


def _without_derivative(omega: FloatArray, sets: _Sets, from_rad_s: float) -> dict[str, Quantity | None]:
    """Phase margins of the rate loops with the same gains but D, on all plants."""
    found: dict[str, Quantity | None] = {}
    for name, (drawn, parts, gains) in sets.items():
        if gains.D > 0.0:
            loops = loop_figures(omega, drawn * parts.rate(replace(gains, D=0.0)), from_rad_s=from_rad_s)
            margins = np.degrees(loops.phase_margin_rad)
            shown = bool((loops.stable > 0.0).all()) and bool(np.isfinite(margins).all())
            found[name] = over_draws(margins, "deg") if shown else None
    return found


def _responses(omega: FloatArray, sets: _Sets) -> dict[str, ComplexArray]:
    """The attitude over its set-point, and over a moment given as a command."""
    found = {}
    for name, (drawn, parts, gains) in sets.items():
        closed = 1.0 / (1.0 + drawn * parts.whole(gains))
        found[f"attitude_{name}"] = drawn * parts.angle(gains) * closed
        found[f"disturbance_{name}"] = drawn / (1j * omega) * closed
    return found


def _steps(
    flown: FlownLoop, then: FlightRecord | None, plants: tuple[UncertainPlant, UncertainPlant], found: AxisProposal
) -> dict[str, Any]:
    """Step response of the attitude with both gains, on all plants, as flown and as they will be."""
    sets = {"flown": (plants[0], None, found.flown.gains), "proposed": (plants[1], then, found.proposed.gains)}
    steps = {name: attitude_steps(flown, plant, gains, then=record) for name, (plant, record, gains) in sets.items()}
    return {"step_s": step_times_s(flown.axis), "steps": steps}


def _together(
    axes: Mapping[LoopName, AxisTuning],
    findings: Sequence[Finding],
    logs: Sequence[FlightRecord],
    given: Sequence[IdentifiedModel],
    settings: TuneSettings,
    thrust: ThrustLinearization | None,
) -> TuningProposal:
    """All axes, with their files."""
    first = next(iter(axes.values())).controller
    changes = {name: pair for tuning in axes.values() for name, pair in tuning.parameters.items() if pair[0] != pair[1]}
    for record in settings_records(given, logs)[:1]:
        changes |= changed_filters(record, settings.filters)
    every: dict[str, float] = {}
    for tuning in axes.values():
        every |= written(tuning.controller, tuning.proposal.flown.gains)
    make = partial(parameter_files, first.autopilot, firmware=first.firmware)
    files = make({name: after for name, (_, after) in changes.items()}, role="proposed") if changes else {}
    old = {name: before for name, (before, _) in changes.items()} or every
    findings = list(findings)
    if thrust is not None and thrust.changed:
        try:
            straightened = _straightened(axes, thrust, given, logs)
        except UsageError as error:
            thrust = thrust.kept(error.came)
            findings += thrust.findings
        else:
            files |= make({name: after for name, (_, after) in straightened.items()}, role="thrust")
            old |= {**every, **{name: before for name, (before, _) in straightened.items()}}
    return TuningProposal(
        autopilot=first.autopilot,
        firmware=first.firmware,
        axes=axes,
        thrust=thrust,
        scale=settings.scale or _scale(given),
        robustness=settings.robustness,
        files=files,
        rollback_files=make(old, role="rollback"),
        findings=worst_first(findings),
        provenance=provenance(logs, settings) if logs or not given else replace(given[0].provenance),
    )


def _scale(models: Sequence[IdentifiedModel]) -> float | None:
    """Full scale over the distance between opposite rotors."""
    arms = [model.motors.arm_m for model in models if model.motors is not None and model.motors.arm_m]
    return FULL_SCALE_M / (2.0 * arms[0]) if arms else None


def _straightened(
    axes: Mapping[LoopName, AxisTuning],
    thrust: ThrustLinearization,
    given: Sequence[IdentifiedModel],
    logs: Sequence[FlightRecord],
) -> dict[str, tuple[float, float]]:
    """The parameter that linearizes thrust, with gains that keep the loops in hover: flown and new.

    Thrust acts on every axis, so the gains of axes that are not tuned change too.

    Raises
    ------
    UsageError
        A gain leaves its range, or is not known.
    """
    controllers = {axis: axes[axis].controller for axis in TUNED_AXES if axis in axes}
    controllers |= flown_controllers((axis for axis in TUNED_AXES if axis not in axes), given, logs)
    if unknown := [axis for axis in TUNED_AXES if axis not in controllers]:
        named = " and ".join(unknown)
        raise UsageError(f"the gains of {named} would have to change too and are not known", needed="a log with them")
    values = {thrust.parameter: (thrust.flown, thrust.proposed)}
    for controller in controllers.values():
        try:
            new = scaled(controller, 1.0 / thrust.hover_gain)
        except UsageError as error:
            why = f"with {thrust.proposed:g}, {error.came}"
            raise UsageError(why, needed=error.needed) from error
        values |= {name: (controller.gains[name], value) for name, value in new.items()}
    return values


def refused_tuning(error: InsufficientDataError, records: Sequence[FlightRecord], settings: TuneSettings) -> Refused:
    """The refusal where no axis can be tuned."""
    return Refused(
        name="tune",
        structure=None,
        findings=worst_first(error.findings or [refusal("not_tuned", "all axes", str(error))]),
        provenance=provenance(records, settings),
    )
