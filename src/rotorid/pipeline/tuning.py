"""From an identified plant to gains: the loops as flown, a proposal that holds for every likely plant, what it will do.

Rate models of roll, pitch and yaw come as results of ``identify`` or are identified from the logs. The controller is
that of the log, with its exact filters and steps. Before anything is proposed it is checked that this controller made
the logged commands, that the motors had room, and that the plant is known where the gains act. Where one of these fails
the flown gains stay, and the reason and the flight that would help are said. Nothing is sent to a vehicle.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, refusal, remark, warn, worst_first
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.models.autopilots.reading import axis_controller
from rotorid.models.autopilots.settings import AxisController
from rotorid.pipeline.checking.candidate import RATES, Controllers
from rotorid.pipeline.identification import identify
from rotorid.pipeline.preparation.controllers import acting_on, logged_axis
from rotorid.pipeline.preparation.flights import Flight
from rotorid.pipeline.preparation.segments import cut
from rotorid.pipeline.provenance import Provenance, provenance
from rotorid.pipeline.results import IdentifiedModel, Records, Refused
from rotorid.pipeline.settings import Setting, as_records, require_seed
from rotorid.signal.filters import combined_response
from rotorid.tuning.files import parameter_files
from rotorid.tuning.firmware import parameters_of, ranges_of, rounded, written
from rotorid.tuning.loops import ControllerParts, frequency_grid
from rotorid.tuning.plant import MeasuredRatio, UncertainPlant, uncertain_plant
from rotorid.tuning.proposal import AxisProposal, Wishes, judged, propose
from rotorid.typing import Axis, ComplexArray, FloatArray
from rotorid.verification.time_domain import matched

_PROGRESS = logging.getLogger("rotorid.progress")

TUNED_AXES: tuple[Axis, ...] = ("roll", "pitch", "yaw")
_MOST_SATURATED = 0.02
_AT_LIMIT = (0.02, 0.98)
_WIDEST_GAIN = 0.15
_BAND_OVER_CROSSOVER = 1.5
_WITHOUT_SPEED_RAD_S = (3.0, 300.0)
_STEP_S = 0.01
_BEHIND_FILTERS = ("vehicle_angular_velocity", "RATE", "PIDR", "PIDP", "PIDY", "gyroADC")
"""Where logs have the rate as the controller takes it, so that no filter of the gyro has to be known."""


@dataclass(frozen=True, kw_only=True)
class TuneSettings(Immutable):
    """Choices of one run of ``tune``.

    Parameters
    ----------
    axes
        Those to look at; all by default.
    robustness
        Largest sensitivity peak M_s of the rate loop and of the whole one, on 95 of 100 likely plants.
    noise
        Noise of the command at most, as a factor on that of the flown gains.
    keep
        Gains that stay, of P, I, D and A.
    draws, seed
        How many likely plants, and the seed of the draws.

    Raises
    ------
    UsageError
        A number is out of range, or a gain is unknown.
    """

    axes: tuple[Axis, ...] = TUNED_AXES
    robustness: float = 1.7
    noise: float = 2.0
    keep: tuple[str, ...] = ()
    draws: int = 50
    seed: int = 0

    def __post_init__(self) -> None:
        require_seed(self.seed)
        if not 1.2 <= self.robustness <= 2.5:
            raise UsageError(f"a robustness of {self.robustness:g} came", needed="a largest M_s from 1.2 to 2.5")
        if not 0.1 <= self.noise <= 10.0:
            raise UsageError(f"a noise of {self.noise:g} came", needed="a factor from 0.1 to 10")
        if wrong := [name for name in self.keep if name not in "PIDA" or len(name) != 1]:
            raise UsageError(f"the gain {wrong[0]} came", needed="of P, I, D and A")
        if len(set(self.keep)) == 4:
            raise UsageError("all gains stay", needed="at least one that may change")
        if wrong_axes := [axis for axis in self.axes if axis not in TUNED_AXES]:
            raise UsageError(f"the axis {wrong_axes[0]} came", needed="roll, pitch, yaw")
        if not 10 <= self.draws <= 1000:
            raise UsageError(f"{self.draws} draws came", needed="10 to 1000")
        self._set(axes=tuple(self.axes), keep=tuple(self.keep))

    def as_json(self) -> dict[str, Setting]:
        """The choices for the provenance of a result."""
        return {
            "axes": [str(axis) for axis in self.axes],
            "robustness": self.robustness,
            "noise": self.noise,
            "keep": list(self.keep),
            "draws": self.draws,
            "seed": self.seed,
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisTuning(Immutable):
    """An axis: its controller, its plant, the flown gains and the proposed ones, and what both do.

    Parameters
    ----------
    controller
        As the log tells it.
    plant
        With draws of what is not known.
    omega_rad_s
        Frequencies of the responses below.
    proposal
        Flown and proposed gains, judged on all draws.
    parameters
        Firmware's name of each gain to its flown and its proposed value; kept ones are alike.
    loops
        ``flown``, ``proposed``, ``flown_whole``, ``proposed_whole``: broken loops over the draws, ``(draws, f)``.
    step_s, steps
        Seconds, and the attitude's answer to a step of its set-point under both gains, ``(draws, n)`` each.
    """

    controller: AxisController
    plant: UncertainPlant
    omega_rad_s: FloatArray
    proposal: AxisProposal
    parameters: Mapping[str, tuple[float, float]]
    loops: Mapping[str, ComplexArray]
    step_s: FloatArray
    steps: Mapping[str, FloatArray]

    def __post_init__(self) -> None:
        self._set(parameters=self.parameters, loops=self.loops, steps=self.steps)


@dataclass(frozen=True, kw_only=True, eq=False)
class TuningProposal(Immutable):
    """What to change of the gains of a vehicle, and what that will do.

    Parameters
    ----------
    autopilot, firmware
        As the log names them.
    axes
        Those that were looked at and have a model and a controller.
    files, rollback_files
        Name of each file to its text: proposed gains, and the flown ones.
    findings
        Why axes or gains stay as they are, the worst first.
    provenance
        Where the models came from.
    """

    autopilot: str
    firmware: str
    axes: Mapping[Axis, AxisTuning]
    files: Mapping[str, str]
    rollback_files: Mapping[str, str]
    findings: tuple[Finding, ...]
    provenance: Provenance

    def __post_init__(self) -> None:
        self._set(axes=self.axes, files=self.files, rollback_files=self.rollback_files)

    @property
    def changed(self) -> bool:
        """Whether any gain is to change."""
        return any(one.proposal.changed for one in self.axes.values())


def tune(
    models: IdentifiedModel | Sequence[IdentifiedModel] = (),
    records: Records = (),
    *,
    settings: TuneSettings | None = None,
    **options: Any,
) -> TuningProposal:
    """Propose gains of roll, pitch and yaw.

    Parameters
    ----------
    models
        Rate models of the axes, as ``identify`` answers them; those that are missing are identified from the logs.
    records
        Logs, whose parameters say which controller flew.
    settings
        Choices; everything has a default.
    **options
        Fields of :class:`TuneSettings`, which go before ``settings``.

    Raises
    ------
    InsufficientDataError
        No axis has a model and a controller; findings say why.
    UsageError
        An option is wrong, or nothing came.

    Examples
    --------
    >>> import rotorid
    >>> proposal = rotorid.tune(records="flight.ulg")  # doctest: +SKIP
    >>> proposal.axes["roll"].parameters["MC_ROLLRATE_P"]  # doctest: +SKIP
    (0.15, 0.21)
    """
    chosen = replace(settings or TuneSettings(), **options)
    logs = as_records(records)
    given = (models,) if isinstance(models, IdentifiedModel) else tuple(models)
    if not given and not logs:
        raise UsageError("nothing came to tune", needed="results of identify, logs, or both")
    findings: list[Finding] = [finding for record in logs for finding in record.findings]
    axes: dict[Axis, AxisTuning] = {}
    for axis in chosen.axes:
        try:
            axes[axis] = _axis(axis, given, logs, chosen, findings)
        except InsufficientDataError as error:
            message = f"{axis}: {error}"
            findings += [one for one in error.findings if one not in findings]
            findings.append(warn("not_tuned", axis, f"The gains of {axis} stay: {str(error).rstrip('.')}."))
            _PROGRESS.info(message)
    if not axes:
        raise InsufficientDataError(
            "no axis can be tuned",
            needed="a rate model of an axis, the gains that flew, and motors with room to both sides",
            remedy="the findings say what each axis lacks",
            findings=worst_first(findings) or [refusal("not_tuned", "all axes", "No axis can be tuned.")],
        )
    return _together(axes, findings, logs, given, chosen)


def _axis(
    axis: Axis,
    given: Sequence[IdentifiedModel],
    logs: Sequence[FlightRecord],
    settings: TuneSettings,
    findings: list[Finding],
) -> AxisTuning:
    """One axis, from its model to what the proposed gains will do."""
    _PROGRESS.info(f"tuning {axis}")
    model = _model(axis, given, logs)
    command, rate = f"{axis}_command", RATES[axis][0]
    source = model.provenance.sources.get(rate, "")
    record = next((one for one in logs if command in one.channel_names), logs[0] if logs else None)
    controller = _controller(axis, command, source, model, record)
    if record is not None:
        _require_room(record)
        findings += _explained(axis, record, model, controller, source)
    omega = frequency_grid(controller.controller)
    seen, logged = _filters(record, controller, source, omega)
    plant = _plant(model, command, rate, settings)
    known = parameters_of(controller)
    # What the firmware has no parameter for, or one whose meaning is not sure, stays.
    stay = tuple(name for name in "PIDA" if name in settings.keep or name not in known)
    wishes = Wishes(sensitivity_peak=settings.robustness, noise=settings.noise, keep=stay, ranges=ranges_of(controller))
    found = propose(axis, plant, controller.controller, seen=seen, logged=logged, omega_rad_s=omega, wishes=wishes)
    parts = ControllerParts(controller=controller.controller, omega_rad_s=omega, seen=seen, logged=logged)
    drawn = plant.drawn(omega)
    if found.changed:
        held = rounded(controller, found.proposed.gains)
        found = replace(found, proposed=judged(parts, drawn, held))
    findings += _said(axis, found, plant)
    return AxisTuning(
        controller=controller,
        plant=plant,
        omega_rad_s=omega,
        proposal=found,
        parameters=_parameters(controller, found),
        loops=_loops(parts, drawn, found),
        **_steps(controller, plant, found, seen_by=(record, source)),
    )


def _model(axis: Axis, given: Sequence[IdentifiedModel], logs: Sequence[FlightRecord]) -> IdentifiedModel:
    """The rate model of an axis: one that came, else one of the logs."""
    name = f"rate.{axis}"
    own = next((one for one in given if one.name == name), None)
    if own is not None:
        return own
    if not logs:
        raise InsufficientDataError(f"no result of {name} came", needed=f"one of rotorid identify --model {name}")
    held = [one for one in logs if {f"{axis}_command", RATES[axis][0]} <= set(one.channel_names)]
    if not held:
        raise InsufficientDataError(f"no log holds {axis}_command and {RATES[axis][0]}", needed="both of them")
    try:
        return identify(held, name)
    except InsufficientDataError as error:
        # Below some rad/s the speed of the vehicle acts, which a rate model lacks; no margin lies there.
        if not any(finding.kind == "poor_fit" for finding in error.findings):
            raise
        return identify(held, name, band_rad_s=_WITHOUT_SPEED_RAD_S)


def _controller(
    axis: Axis, command: str, source: str, model: IdentifiedModel, record: FlightRecord | None
) -> AxisController:
    """The controller that flew, by the parameters of the log or by what the result says of them."""
    found = None
    if record is not None:
        found = logged_axis(record, command, source=source)
    elif (known := model.controller) is not None:
        found = axis_controller(
            {**known.gains, **known.filters}, axis, firmware=known.firmware, loop_rate_hz=known.loop_rate_hz
        )
    if found is None:
        raise InsufficientDataError(
            f"the gains of {axis} are not known",
            needed="a log with the parameters of its autopilot",
            remedy="give the log beside the result",
            findings=[refusal("no_controller", axis, f"No gains of the {axis} controller are known.")],
        )
    if record is None and not source.startswith(_BEHIND_FILTERS):
        raise InsufficientDataError(
            f"the filter of the gyro of {axis} is not known: its rate stands in {source or 'an unknown place'}",
            needed="the log, whose parameters tell it",
            remedy="give the log beside the result",
        )
    return found


def _require_room(record: FlightRecord) -> None:
    """Refuse a flight whose motors stood at their limits: its plant is that of a limit cycle."""
    names = [name for name in record.channel_names if name.startswith("motor_") and name[6:].isdigit()]
    limited = count = 0
    for topic in record.topics:
        rows = [row for name in names if (row := topic.row(name)) is not None]
        if rows:
            values = topic.values[rows]
            flying = np.nanmean(values, axis=0) > 0.1
            stopped = (values <= _AT_LIMIT[0]) | (values >= _AT_LIMIT[1])
            limited += int(np.count_nonzero(stopped[:, flying].any(axis=0)))
            count += int(np.count_nonzero(flying))
    share = limited / count if count else 0.0
    if share > _MOST_SATURATED:
        message = f"A motor stood at a limit for {100.0 * share:.0f} % of the flight: lower the gains first."
        raise InsufficientDataError(
            f"a motor stood at a limit for {100.0 * share:.0f} % of the flight",
            needed=f"at most {100.0 * _MOST_SATURATED:.0f} %, or the plant is that of a limit cycle",
            remedy="lower the gains first",
            findings=[refusal("saturation", record.source.name, message, share=share)],
        )


def _explained(
    axis: Axis, record: FlightRecord, model: IdentifiedModel, controller: AxisController, source: str
) -> list[Finding]:
    """Refuse a controller that did not make the logged command; a remark where that cannot be seen.

    The command is made again, sample by sample, of the rate in the log, which has to be the one that the controller
    took: not one in front of the filters of the gyro.
    """
    acting = acting_on(record, controller.controller, source=source)
    if acting.seen or acting.logged:
        message = (
            f"The rate of {axis} stands in {source}, in front of filters of the gyro: whether these gains made the "
            "commands was not checked."
        )
        return [remark("controller_unchecked", axis, message)]
    controllers = Controllers(record=record, given={})
    command, rate = f"{axis}_command", RATES[axis][0]
    own = [one for one in model.data.segments if one.record == record.source.name]
    band = model.band_rad_s
    if not own or band is None:
        return []
    try:
        segments, _ = cut(
            [Flight(record, one.maneuver) for one in own[:1]],
            channels=(command, rate),
            followers=controllers.channels((axis,)),
        )
        history = segments[0].history
        found = controllers.loop(axis, history, matched(band, None, history))
    except (InsufficientDataError, UsageError):
        found = None
    if found is None:
        message = f"The log holds no set-point of {axis}: whether these gains made the commands was not checked."
        return [remark("controller_unchecked", axis, message)]
    _, setpoint, scores = found
    if not scores.alike:
        message = (
            f"With its gains the {axis} controller does not make the logged command of {setpoint} and the rate: TIC "
            f"{scores.tic:.2f}."
        )
        raise InsufficientDataError(
            f"the gains in the log did not make the logged {command} (TIC {scores.tic:.2f})",
            needed="a flight whose controller is the one in its parameters",
            remedy="the gains changed in flight, or a part of the controller is not modeled",
            findings=[refusal("other_controller", axis, message, tic=scores.tic)],
        )
    return []


def _filters(
    record: FlightRecord | None, controller: AxisController, source: str, omega: FloatArray
) -> tuple[ComplexArray, ComplexArray]:
    """Filters in front of the rate that the controller takes, and in front of the one in the log."""
    if record is None:
        ones = np.ones(omega.size, dtype=np.complex128)
        return ones, ones
    acting = acting_on(record, controller.controller, source=source)
    return combined_response(acting.seen, omega), combined_response(acting.logged, omega)


def _plant(model: IdentifiedModel, command: str, rate: str, settings: TuneSettings) -> UncertainPlant:
    """The plant with draws, from the model and what was measured beside it."""
    structure = model.structure
    row, column = structure.outputs.index(rate), structure.inputs.index(command)
    values, gain = structure.parameters.values, structure.gain
    if gain is not None and (std := model.parameters[gain].std) is not None:
        share = std / abs(model.parameters[gain].value)
        if share > _WIDEST_GAIN:
            raise InsufficientDataError(
                f"{gain} is known to {100.0 * share:.0f} % only",
                needed=f"{100.0 * _WIDEST_GAIN:.0f} %",
                remedy=f"fly a longer sweep of {command.removesuffix('_command')}",
            )

    def response(omega_rad_s: FloatArray) -> ComplexArray:
        return np.asarray(structure.response(values, np.atleast_1d(omega_rad_s))[row, column])

    band = model.band_rad_s
    if band is None:
        raise InsufficientDataError(f"{model.name} was not fitted to responses", needed="--method frequency")
    measured = model.data.response
    ratio = None
    if measured.omega_rad_s.size and rate in measured.outputs and command in measured.inputs:
        y, u = measured.outputs.index(rate), measured.inputs.index(command)
        used = np.asarray(model.data.used[y, u], dtype=bool)
        if used.sum() >= 3:
            omega, seen = measured.omega_rad_s[used], measured.values[y, u, used]
            relative = measured.covariance[y, u][np.ix_(used, used)] / np.outer(seen, seen.conj())
            ratio = MeasuredRatio(omega_rad_s=omega, ratio=seen / response(omega), covariance=relative)
    return uncertain_plant(response, ratio, band_rad_s=band, draws=settings.draws, seed=settings.seed)


def _said(axis: Axis, found: AxisProposal, plant: UncertainPlant) -> list[Finding]:
    """Why the gains stay, what binds, and what a better flight would tell."""
    said = []
    if found.reasons:
        words = "; ".join(found.reasons)
        verb = "are bound" if found.changed else "stay"
        said.append(remark("tuning_bound", axis, f"The gains of {axis} {verb}: {words}."))
    crossover = float(np.nanmedian(found.proposed.rate.crossover_rad_s))
    if crossover * _BAND_OVER_CROSSOVER > plant.band_rad_s[1]:
        message = (
            f"The plant of {axis} was seen up to {plant.band_rad_s[1]:.0f} rad/s, and its loop crosses over at "
            f"{crossover:.0f}: what is foretold beyond is the model's. Fly a sweep up to {3.0 * crossover:.0f} rad/s."
        )
        said.append(warn("band_below_crossover", axis, message, crossover_rad_s=crossover))
    return said


def _parameters(controller: AxisController, found: AxisProposal) -> dict[str, tuple[float, float]]:
    """Every gain and filter of the loop by the firmware's name, flown and proposed."""
    new = written(controller, found.proposed.gains) if found.changed else {}
    flown = {**controller.gains, **controller.filters}
    return {name: (value, new.get(name, value)) for name, value in flown.items()}


def _loops(parts: ControllerParts, drawn: ComplexArray, found: AxisProposal) -> dict[str, ComplexArray]:
    both = {"flown": found.flown.gains, "proposed": found.proposed.gains}
    rate = {name: drawn * parts.rate(gains) for name, gains in both.items()}
    return rate | {f"{name}_whole": drawn * parts.whole(gains) for name, gains in both.items()}


_STEP_RATE_HZ, _STEP_SAMPLES, _STEP_SHOWN_S = 250.0, 4096, 2.0


def _steps(
    controller: AxisController,
    plant: UncertainPlant,
    found: AxisProposal,
    *,
    seen_by: tuple[FlightRecord | None, str],
) -> dict[str, Any]:
    """Answer of the attitude to a step of its set-point, by both gains, on all plants."""
    omega = np.asarray(2.0 * np.pi * np.fft.rfftfreq(_STEP_SAMPLES, 1.0 / _STEP_RATE_HZ), dtype=np.float64)
    omega[0] = omega[1] * 1e-3
    record, source = seen_by
    seen, logged = _filters(record, controller, source, omega)
    parts = ControllerParts(controller=controller.controller, omega_rad_s=omega, seen=seen, logged=logged)
    drawn = plant.drawn(omega)
    count = round(_STEP_SHOWN_S * _STEP_RATE_HZ)
    steps = {}
    for name, gains in (("flown", found.flown.gains), ("proposed", found.proposed.gains)):
        answer = drawn * parts.angle(gains) / (1.0 + drawn * parts.whole(gains)) if gains.A > 0.0 else None
        if answer is None:
            answer = drawn * parts.rate(gains) / (1.0 + drawn * parts.rate(gains))
        impulse = np.fft.irfft(answer, n=_STEP_SAMPLES, axis=1)
        steps[name] = np.cumsum(impulse, axis=1)[:, :count]
    return {"step_s": np.arange(count) / _STEP_RATE_HZ, "steps": steps}


def _together(
    axes: Mapping[Axis, AxisTuning],
    findings: Sequence[Finding],
    logs: Sequence[FlightRecord],
    given: Sequence[IdentifiedModel],
    settings: TuneSettings,
) -> TuningProposal:
    """All axes, with their files."""
    first = next(iter(axes.values())).controller
    changed = [one for one in axes.values() if one.proposal.changed]
    new = {name: after for one in changed for name, (before, after) in one.parameters.items() if after != before}
    old = {name: one.parameters[name][0] for one in changed for name in one.parameters if name in new}
    every: dict[str, float] = {}
    for one in axes.values():
        every |= written(one.controller, one.proposal.flown.gains)
    version = first.firmware
    return TuningProposal(
        autopilot=first.autopilot,
        firmware=first.firmware,
        axes=axes,
        files=parameter_files(first.autopilot, new, role="proposed", firmware=version) if new else {},
        rollback_files=parameter_files(first.autopilot, old or every, role="rollback", firmware=version),
        findings=worst_first(findings),
        provenance=provenance(logs, settings) if logs or not given else replace(given[0].provenance),
    )


def refused_tuning(error: InsufficientDataError, records: Sequence[FlightRecord], settings: TuneSettings) -> Refused:
    """What to say where no axis can be tuned."""
    return Refused(
        name="tune",
        structure=None,
        findings=worst_first(error.findings or [refusal("not_tuned", "all axes", str(error))]),
        provenance=provenance(records, settings),
    )
