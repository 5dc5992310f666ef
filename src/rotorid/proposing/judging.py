"""Foreign gains around an identified plant: read, checked against the vehicle that flew, and judged.

The parameters of the file take the place of those that flew, filters included, and the controller is read again, so
that what is judged is what the firmware would make of them. What a file leaves out stays as flown, if loading the file
would leave it so. Gains of another firmware, vehicle or version, out of range or incomplete, are refused by name:
nothing is judged by guess, and nothing is sent to a vehicle.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TypeAlias

from rotorid.autopilots.firmware import Version, version_of, versions_of
from rotorid.data.base import Immutable
from rotorid.data.display import listed
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError, UsageError, nearest_name
from rotorid.io.documents import read_bytes
from rotorid.models.autopilots import betaflight
from rotorid.models.autopilots.betaflight import as_in_header
from rotorid.models.autopilots.betaflight_settings import MOVING_GYRO
from rotorid.models.autopilots.betaflight_sliders import D_IS_BASE_SINCE
from rotorid.models.autopilots.gains import ahead_of, letter_of, parameters_of
from rotorid.models.autopilots.outer import (
    OUTER_LOOPS,
    as_logged,
    generation_of,
    outer_letter,
    outer_names,
    outer_settings,
)
from rotorid.models.autopilots.settings import AxisController, Parameter, loop_settings
from rotorid.proposing.axis import KnownAxis
from rotorid.proposing.flown_gains import FlownLoop, at_ends
from rotorid.proposing.outer import with_values
from rotorid.proposing.steps import attitude_steps
from rotorid.signal.autopilot_filters import filter_findings
from rotorid.tuning.gain_files import LARGEST_BYTES, GainFile, read_gains
from rotorid.tuning.judging import CommandNoise, Figures, LoopVerdict, Verdict, loop_verdict, situations_of, worst
from rotorid.tuning.kinds import KINDS
from rotorid.tuning.loops import ControllerParts, Gains, frequency_grid
from rotorid.tuning.plant import UncertainPlant
from rotorid.tuning.proposal import Judged, judged
from rotorid.typing import Axis, FloatArray, LoopName

_WHOLE_FILE = 40
"""Parameters from which a file counts as all of a vehicle's: then none of its gains may be missing."""

_OF_VEHICLE = ("SYS_AUTOSTART", "CA_AIRFRAME", "CA_ROTOR_COUNT", "FRAME_CLASS", "FRAME_TYPE", "MAV_TYPE")

_OF_PLANT = (
    *("THR_MDL_FAC", "MC_BAT_SCALE_EN", "MOT_THST_EXPO", "MOT_SPIN_MIN", "MOT_SPIN_MAX", "MOT_BAT_VOLT_MAX"),
    *("MOT_BAT_VOLT_MIN", "thrust_linear", "SCHED_LOOP_RATE", "INS_GYRO_RATE", "IMU_GYRO_RATEMAX", "IMU_INTEG_RATE"),
    *("looptime", "pid_process_denom"),
)
"""What changes the plant itself: it was measured with the flown values."""

_SAME = 1e-6
_FAR_OUTSIDE = 4.0
"""Times the end of a range from which a gain is taken for one in other units."""

_HIDDEN = ("INS_HNTCH_", "INS_HNTC2_", "INS_NOTCH_", "FILT")
"""Filters that ArduPilot does not log while they are off."""

_GAIN_STEMS = ("MC_ROLL", "MC_PITCH", "MC_YAW", "MC_DTERM_CUTOFF", "ATC_RAT_", "ATC_ANG_")

_RENAMED = {
    "MC_DTERM_CUTOFF": "IMU_DGYRO_CUTOFF",
    "IMU_GYRO_NF_FREQ": "IMU_GYRO_NF0_FRQ",
    "IMU_GYRO_NF_BW": "IMU_GYRO_NF0_BW",
    **{f"MPC_{axis}_VEL_{letter}": f"MPC_{axis}_VEL_{letter}_ACC" for axis in ("XY", "Z") for letter in "PID"},
    **{f"ATC_RAT_{axis}_FILT": f"ATC_RAT_{axis}_FLT{of}" for axis, of in (("RLL", "D"), ("PIT", "D"), ("YAW", "E"))},
    **{f"{of}_lowpass{n}_hz": f"{of}_lpf{n or 1}_static_hz" for of in ("dterm", "gyro") for n in ("", 2)},
    **{f"{of}_lowpass_dyn_hz_{end}": f"{of}_lpf1_dyn_hz_{end}" for of in ("dterm", "gyro") for end in range(2)},
    **{f"d_min_{axis}": f"d_max_{axis}" for axis in range(3)},
}
"""Names of older firmware, to those that took their place, some of them in other units or with another meaning."""

_OTHER_NAMES = {**_RENAMED, **{new: old for old, new in _RENAMED.items()}}

_LESS = (0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2)
_KNOBS: tuple[tuple[str, ...], ...] = (
    *(("A",), ("I",), ("D",)),
    *(("P", "D"), ("I", "A"), ("P", "I", "D"), ("P", "I", "D", "A")),
)
_TRIED_DRAWS = 10


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisJudgment(Immutable):
    """Foreign gains on one axis.

    Parameters
    ----------
    axis
        ``roll``, ``pitch`` or ``yaw``, or an outer loop.
    found
        The verdict, with the plant that decides it.
    verdict
        That of the axis: not enough data where the file changes what was not measured.
    judged, flown
        Figures of the foreign and of the flown gains over the draws, in hover.
    parameters
        Each gain and filter by the firmware's name, flown and foreign.
    noise
        Of the command.
    lower
        Parameters, with values, that would make the gains fly gently or better; empty where none of the tried would.
    reasons
        What keeps the gains from a better verdict, beside their loops, as sentences.
    parts
        Transfer functions of the foreign gains.
    plant
        With its draws.
    steps
        Step responses of the attitude with the flown and with the foreign gains, ``flown`` and ``judged``, over the
        draws; only of loops that are stable on all of them.
    """

    axis: LoopName
    found: LoopVerdict
    verdict: Verdict
    judged: Judged
    flown: Judged
    parameters: Mapping[str, tuple[float, float]]
    noise: CommandNoise
    lower: Mapping[str, float]
    reasons: tuple[str, ...]
    parts: ControllerParts
    plant: UncertainPlant
    steps: Mapping[str, FloatArray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._set(parameters=self.parameters, lower=self.lower, reasons=tuple(self.reasons), steps=self.steps)


@dataclass(frozen=True, kw_only=True, eq=False)
class JudgedGains(Immutable):
    """Foreign gains of a vehicle.

    Parameters
    ----------
    source
        Name of the file.
    axes
        Those that could be judged.
    unknown
        Axis to the reason why it could not.
    findings
        Parameters that were left out.
    """

    source: str
    axes: Mapping[LoopName, AxisJudgment]
    unknown: Mapping[LoopName, str] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()

    def __post_init__(self) -> None:
        self._set(axes=self.axes, unknown=self.unknown, findings=tuple(self.findings))

    @property
    def verdict(self) -> Verdict:
        """The worst of all axes."""
        unknown: dict[str, Verdict] = dict.fromkeys(self.unknown, "not_enough_data")
        return worst({**unknown, **{axis: found.verdict for axis, found in self.axes.items()}})


def load_gains(path: Path | str) -> GainFile:
    """Gains of a file on disk.

    Parameters
    ----------
    path
        A parameter file, or the text of ``diff all``.

    Raises
    ------
    UsageError
        There is no such file, it is too large, or it contains no gains.
    """
    place = Path(path)
    if "=" in place.name and not place.exists():
        raise UsageError(
            f"{place.name!r} is no file",
            needed="a file of gains",
            remedy="write lines such as roll: P=0.1 D=0.002 into it",
        )
    data = read_bytes(place, needed="a file of gains", most_bytes=LARGEST_BYTES)
    return read_gains(
        data.decode("utf-8", errors="replace"), name=place.name, include=partial(_included_preset, place.resolve())
    )


_PRESET_FILE = re.compile(r"presets/[^\\:]{1,200}\.txt")


def _included_preset(place: Path, named: str) -> str:
    """The content of a preset by its path in the collection that the including preset is part of."""
    for folder in place.parents if _PRESET_FILE.fullmatch(named) else ():
        file = (folder / named).resolve()
        if file.is_relative_to(folder) and file.is_file():
            content = read_bytes(file, needed="a preset", most_bytes=LARGEST_BYTES)
            return content.decode("utf-8", errors="replace")
    raise UsageError(
        f"{place.name} includes {named}, which is not there",
        needed="all lines of the preset",
        remedy="keep the preset in its folder of firmware-presets, or paste the lines that it includes",
    )


OuterOf: TypeAlias = Callable[[LoopName, Mapping[str, float]], KnownAxis]
"""An outer loop with its plant, around inner loops with the parameters of a file."""


def _changes_outer(loop: LoopName, values: Mapping[str, float], logged: Mapping[str, float]) -> bool:
    """Whether a file changes a gain or a filter of an outer loop, or consists of little else."""
    named = [name for name in outer_names(loop) if name in values]
    few = len(values) <= _WHOLE_FILE
    return any(few or not _is_same(values[name], logged.get(name, math.nan)) for name in named)


def judge_gains(
    gains: GainFile,
    known: Mapping[Axis, KnownAxis],
    refused: Mapping[Axis, InsufficientDataError],
    *,
    gain_range: tuple[float, float] = (1.0, 1.0),
    outer: OuterOf | None = None,
    asked: Sequence[LoopName] = (),
    logged: Mapping[str, float] | None = None,
) -> JudgedGains:
    """The verdict on the gains of a file.

    Parameters
    ----------
    gains
        See :func:`load_gains`.
    known
        Axes whose plant and flown controller are known.
    refused
        Other axes, with the reason.
    gain_range
        Least and largest gain of the loops over the flown throttle, relative to hover.
    outer
        What gives an outer loop around the loops with the gains of the file; without it none is judged.
    asked
        Outer loops that are judged although the file leaves their gains as they flew.
    logged
        Parameters of the log, where no axis is known that has them.

    Raises
    ------
    UsageError
        The gains are not for this vehicle, out of range, or incomplete.
    """
    findings: list[Finding] = []
    axes: dict[LoopName, AxisJudgment] = {}
    flown = {axis: one.flown for axis, one in known.items()}
    if first := next(iter(flown.values()), None):
        _require_same_firmware(gains, first)
        gains, how = gains.on(first.record.parameters, version_of(first.controller.firmware))
        findings += [remark("gains_read", gains.name, how)] if how else []
    logged = next((one.record.parameters for one in flown.values()), logged or {})
    values = as_logged(_values(gains, (*known, *refused), flown, logged), logged)
    wanted = _axes_of(gains, values)
    whole = not gains.preset and (gains.defaults_first or len(gains.values) > _WHOLE_FILE)
    if whole:
        _require_whole(gains, values, flown)
    for axis, one in known.items():
        left_out = _require_same_vehicle(gains, values, one.flown)
        left_out += _ahead_of_loops(gains, values, one.flown.record)
        findings += [finding for finding in left_out if finding not in findings]
        if axis in wanted:
            then = one.flown.with_parameters(with_values(one.flown.record, values))
            findings += _require_ranges(one.flown.controller, then)
            axes[axis] = judge_axis(axis, one, values, gain_range=gain_range)
    unknown: dict[LoopName, str] = {axis: str(why) for axis, why in refused.items() if axis in wanted}
    around = [loop for loop in OUTER_LOOPS if loop in asked or _changes_outer(loop, values, logged)]
    for loop in around:
        if outer is None:
            break
        try:
            one = outer(loop, values)
        except InsufficientDataError as error:
            unknown[loop] = str(error)
        else:
            left_out = _require_same_vehicle(gains, values, one.flown)
            findings += [finding for finding in left_out if finding not in findings]
            if whole:
                _require_whole(gains, values, {loop: one.flown})
            findings += _require_ranges(one.flown.controller, _merged(one.flown.record, values, one.flown))
            axes[loop] = judge_axis(loop, one, values)
    if not axes and not unknown:
        judgeable = [*known, *refused, *asked]
        raise UsageError(
            f"{gains.name} contains no gains of {' or '.join(judgeable) or 'an axis that was measured'}",
            needed=f"gains of an axis to judge; these are of {listed([*wanted, *around]) or 'no loop'}",
        )
    return JudgedGains(source=gains.name, axes=axes, unknown=unknown, findings=tuple(findings))


_OF_ROLL = re.compile(r"MC_ROLL\w+|ATC_(?:RAT|ANG)_RLL_\w+|rollPID_\w|(?:d_m..|ff_weight)_0")
_OF_PITCH = re.compile(r"MC_PITCH\w+|ATC_(?:RAT|ANG)_PIT_\w+|pitchPID_\w|(?:d_m..|ff_weight)_1")
_OF_YAW = re.compile(r"MC_YAW\w+|ATC_(?:RAT|ANG)_YAW_\w+|yawPID_\w|(?:d_m..|ff_weight)_2")
_NAMES_OF: Mapping[Axis, re.Pattern[str]] = MappingProxyType({"roll": _OF_ROLL, "pitch": _OF_PITCH, "yaw": _OF_YAW})
"""What firmware calls the gains of an axis."""


_STICK_AHEAD = "ff_weight"
"""Feed-forward of Betaflight, of the stick alone; that of PX4 and ArduPilot is inside the angle loop, and judged."""


def _ahead_of_loops(gains: GainFile, values: Mapping[str, float], record: FlightRecord) -> list[Finding]:
    """A remark on feed-forward of the stick that changes: no margin depends on it."""
    changed = [
        gains.written.get(name, name)
        for name, value in values.items()
        if name.startswith(_STICK_AHEAD) and not _is_same(value, record.parameters.get(name, value))
    ]
    if not changed:
        return []
    names = ", ".join(changed)
    message = f"{names}: feed-forward changes how the vehicle follows the stick, but no margin."
    return [remark("feedforward_changes", gains.name, message)]


def _axes_of(gains: GainFile, values: Mapping[str, float]) -> tuple[Axis, ...]:
    """Axes whose loops a file may change: those that it names, and all by a filter or a gain that they share."""
    if gains.by_hand:
        return tuple(axis for axis in _NAMES_OF if {axis, ""} & gains.by_hand.keys())
    named_by = {name: [axis for axis, names in _NAMES_OF.items() if names.fullmatch(name)] for name in values}
    if any(loop_settings({name: 0.0}) and not axes for name, axes in named_by.items()):
        return tuple(_NAMES_OF)
    return tuple(axis for axis in _NAMES_OF if any(axis in axes for axes in named_by.values()))


def _values(
    gains: GainFile, axes: Sequence[Axis], flown: Mapping[Axis, FlownLoop], logged: Mapping[str, float]
) -> dict[str, float]:
    """Parameters of a file by the names of the log, gains by hand among them."""
    values = dict(gains.values)
    for name, by_letter in gains.by_hand.items():
        if not name and len(axes) > 1:
            raise UsageError(
                f"{gains.name} names no axis",
                needed="such as roll: P=0.1 D=0.002",
                remedy="or give --axes with one axis",
            )
        loops: dict[LoopName, Mapping[str, Parameter]] = {
            axis: parameters_of(one.controller) for axis, one in flown.items() if name in ("", axis)
        }
        for loop in (loop for loop in OUTER_LOOPS if loop == name):
            if (known := generation_of(logged, loop)) is None:
                raise UsageError(f"the log contains no gains of {loop}", needed=f"such as {outer_names(loop)[0]}")
            loops[loop] = known.gains
        for loop, parameters in loops.items():
            for letter, value in by_letter.items():
                if letter not in parameters:
                    raise UsageError(
                        f"{letter} of {loop} cannot be set by hand", needed=f"one of {', '.join(parameters)} of {loop}"
                    )
                own = parameters[letter].name
                values[next(iter(as_in_header({own: value})), own)] = value
    return values


def _require_same_vehicle(gains: GainFile, values: Mapping[str, float], flown: FlownLoop) -> list[Finding]:
    """Refuse parameters that are not this vehicle's; remarks on those that no loop depends on."""
    record = flown.record
    autopilot = flown.controller.autopilot
    where = record.source.name
    _require_not_negative(gains, record, values)
    for name in _OF_VEHICLE:
        if name in values and not _is_same(record.parameters.get(name, values[name]), values[name]):
            raise UsageError(
                f"{gains.name} is for another vehicle: {name} is {values[name]:g}, and {record.parameters[name]:g} in "
                f"{where}",
                needed="gains of this vehicle",
                remedy="put only gains and filters into the file to judge them on this vehicle",
            )
    left_out, unlogged = [], []
    few = len(values) <= _WHOLE_FILE
    then = _merged(record, values, flown)
    understood = {*record.parameters, *then.gains, *as_in_header(dict.fromkeys(flown.controller.gains, 0.0))}
    for name in values:
        if name in understood or name.startswith(_HIDDEN):
            continue
        written = gains.written.get(name, name)
        if name in _OF_PLANT:
            unlogged.append(written)
            continue
        other = _OTHER_NAMES.get(name, "")
        near = nearest_name(written, [*flown.controller.gains, *flown.controller.filters]) if few else ""
        # Firmware that has no such parameter ignores it, or means something else by it.
        if other in record.parameters or near or name.startswith(_GAIN_STEMS) or (few and loop_settings({name: 0.0})):
            remedy = "export the gains from this version of the firmware"
            if other in record.parameters:
                remedy = f"{remedy}, which has {other} instead, maybe in other units"
            elif near:
                remedy = f"did you mean {near}?"
            raise UsageError(
                f"{where} has no parameter {written}, which {gains.name} contains",
                needed="names of the firmware that flew",
                remedy=remedy,
            )
        left_out.append(written)
    if not loop_settings(values) and not outer_settings(values):
        raise UsageError(f"{gains.name} contains no gain and no filter of {autopilot}", needed="gains or filters")
    found = []
    if unlogged:
        message = f"The log does not contain {', '.join(unlogged)}; judged as if the file does not change them."
        found.append(warn("gains_left_out", gains.name, message))
    if left_out and few:
        names = ", ".join(sorted(left_out)[:6])
        message = f"No rate or angle loop depends on {names}; these were not judged."
        found.append(remark("gains_left_out", gains.name, message))
    return found


def require_same_autopilot(gains: GainFile, record: FlightRecord, autopilot: str) -> None:
    """Refuse gains of another autopilot than that of a log.

    Raises
    ------
    UsageError
        They are of another one.
    """
    if gains.autopilot and autopilot and gains.autopilot != autopilot:
        raise UsageError(
            f"{gains.name} contains gains of {gains.autopilot}, but {record.source.name} is from {autopilot}",
            needed=f"gains of {autopilot}",
        )


def _require_same_firmware(gains: GainFile, flown: FlownLoop) -> None:
    """Refuse gains of another autopilot, or of a version that computes another controller from them."""
    require_same_autopilot(gains, flown.record, flown.controller.autopilot)
    theirs, ours = versions_of(gains.firmware), version_of(flown.controller.firmware)
    if gains.autopilot != betaflight.NAME or not theirs or ours is None:
        return

    def generation(version: Version) -> int:
        return sum(version >= change for change in (*betaflight.CHANGES, D_IS_BASE_SINCE))

    if generation(ours) not in {generation(version) for version in theirs}:
        raise UsageError(
            f"{gains.name} is from {gains.firmware}, but {flown.record.source.name} from Betaflight {ours[0]}.{ours[1]}"
            ", which computes the controller in another way from these settings",
            needed="settings of the version that flew",
        )


def _require_whole(
    gains: GainFile, values: Mapping[str, float], flown: Mapping[Axis, FlownLoop] | Mapping[LoopName, FlownLoop]
) -> None:
    """Refuse a file of all parameters in which a gain is missing, and a ``diff`` that leaves it at a default."""
    missing = []
    for one in flown.values():
        names = [name for name in one.controller.gains if letter_of(name)]
        missing += [name for name in names if next(iter(as_in_header({name: 0.0})), name) not in values]
    if missing:
        why = "a diff leaves defaults out" if gains.defaults_first else "the file may be cut off"
        raise UsageError(
            f"{gains.name} does not contain {', '.join(dict.fromkeys(missing))}",
            needed=f"all gains of {listed([*flown])}",
            remedy=f"{why}: give a {'dump' if gains.defaults_first else 'complete file'}",
        )


def _merged(record: FlightRecord, values: Mapping[str, float], flown: FlownLoop) -> AxisController:
    return flown.with_parameters(with_values(record, values))


def judge_axis(
    axis: LoopName,
    known: KnownAxis,
    values: Mapping[str, float],
    *,
    gain_range: tuple[float, float] = (1.0, 1.0),
    advise: bool = True,
) -> AxisJudgment:
    """The verdict on foreign parameters of one axis, which are taken as they are.

    Parameters
    ----------
    axis, known
        Its plant and its flown controller.
    values
        Parameters by the names of the log; those that are not there stay as flown.
    gain_range
        As for :func:`judge_gains`.
    advise
        Whether to look for what to lower and to compute steps, which takes longest.
    """
    record = known.flown.record
    then = with_values(record, values)
    controller = known.flown.with_parameters(then)
    grids = [frequency_grid(one.controller, axis) for one in (known.flown.controller, controller)]
    omega = min(grids, key=lambda grid: float(grid[-1]))
    noise = known.flown.rate_noise(omega, known.plant.band_rad_s)
    flown_parts = known.flown.parts(omega, noise=noise)
    parts = known.flown.parts(omega, then=then, noise=noise)
    own = Gains.of(controller.controller)
    scores = _scores(known.plant, parts, own)
    before = _scores(known.flown_plant or known.plant, flown_parts, known.gains)
    of_command = CommandNoise(
        rms=scores.noise if parts.shows_noise else None, ratio=scores.noise / max(before.noise, 1e-300)
    )
    found = loop_verdict(known.plant, _situations(known.plant, controller, parts, own, gain_range), noise=of_command)
    doubts = tuple(_doubts(known.flown, record, then, values))
    verdict: Verdict = "not_enough_data" if doubts and found.flies else found.verdict
    before_names = {**known.flown.controller.gains, **known.flown.controller.filters}
    after_names = {**controller.gains, **controller.filters}
    return AxisJudgment(
        axis=axis,
        found=found,
        verdict=verdict,
        judged=scores,
        flown=before,
        parameters={
            name: (before, before if _is_same(before, after) else after)
            for name, after in after_names.items()
            for before in (before_names.get(name, after),)
        },
        noise=of_command,
        lower=_lower(known.plant, controller, parts, own, gain_range) if advise and verdict == "do_not_fly" else {},
        reasons=doubts,
        parts=parts,
        plant=known.plant,
        steps={
            name: attitude_steps(known.flown, known.plant, gains_then, then=place)
            for name, one, gains_then, place in (("flown", before, known.gains, None), ("judged", scores, own, then))
            if advise and (one.rate.stable * one.whole.stable).all()
        },
    )


def _scores(plant: UncertainPlant, parts: ControllerParts, gains: Gains) -> Judged:
    return judged(parts, plant.drawn(parts.omega_rad_s), gains, from_rad_s=plant.known_from_rad_s)


def _situations(
    plant: UncertainPlant,
    controller: AxisController,
    parts: ControllerParts,
    gains: Gains,
    gain_range: tuple[float, float],
) -> dict[str, Figures]:
    """Figures at both ends of a D that moves, and of the flown throttle."""
    ends = {name: replace(gains, D=end.controller.derivative_s2) for name, end in at_ends(controller, parts).items()}
    made = {name: (parts.rate(one), parts.whole(one)) for name, one in (ends or {"": gains}).items()}
    return situations_of(plant, parts.omega_rad_s, made, gain_range=gain_range)


def _lower(
    plant: UncertainPlant,
    controller: AxisController,
    parts: ControllerParts,
    gains: Gains,
    gain_range: tuple[float, float],
) -> dict[str, float]:
    """The mildest change of one gain, or of P, I and D together, with which the loops may fly; empty where none may."""
    few = replace(plant, misfits=plant.misfits[:_TRIED_DRAWS])
    named = parameters_of(controller)

    def flies(on: UncertainPlant, less: Gains) -> bool:
        return loop_verdict(on, _situations(on, controller, parts, less, gain_range)).flies

    for factor in _LESS:
        for knob in _KNOBS:
            letters = [letter for letter in knob if getattr(gains, letter) > 0.0]
            if not letters or not all(letter in named for letter in letters):
                continue
            changed = {letter: _lowered(named[letter], factor * getattr(gains, letter)) for letter in letters}
            less = replace(gains, **changed)
            if flies(few, less) and flies(plant, less):
                return {named[letter].name: value / named[letter].per_si for letter, value in changed.items()}
    return {}


def _lowered(parameter: Parameter, gain: float) -> float:
    """A gain that its parameter can have, not above the given one."""
    return math.floor(gain / parameter.per_si) * parameter.per_si if parameter.integer else gain


def _require_not_negative(gains: GainFile, record: FlightRecord, values: Mapping[str, float]) -> None:
    gains_of_loops = {**loop_settings(values), **{name: values[name] for name in values if outer_letter(name)}}
    for name, value in gains_of_loops.items():
        if value < 0.0 and value != record.parameters.get(name):
            raise UsageError(f"{gains.written.get(name, name)} = {value:g} is out of range", needed="0 or more")


def _require_ranges(flown: AxisController, controller: AxisController) -> list[Finding]:
    """Refuse gains that the firmware would not take, or that are far beyond its range; a remark on others outside it.

    Ranges of PX4 and ArduPilot are advice: their own autotunes leave them.
    """
    outside = []
    parameters: list[Parameter] = [*parameters_of(controller).values(), *ahead_of(controller)]
    for parameter in parameters:
        value = controller.gains.get(parameter.name)
        if value is None or _is_same(value, flown.gains.get(parameter.name, math.nan)):
            continue
        if parameter.low * (1.0 - _SAME) <= value <= parameter.high * (1.0 + _SAME):
            continue
        if parameter.integer or value > _FAR_OUTSIDE * parameter.high:
            raise UsageError(
                f"{parameter.name} = {value:g} is out of range",
                needed=f"a value from {parameter.low:g} to {parameter.high:g}",
            )
        outside.append(f"{parameter.name} = {value:g} (usually {parameter.low:g} to {parameter.high:g})")
    if not outside:
        return []
    message = f"Outside the firmware's usual range, and judged as it stands: {', '.join(outside)}."
    return [warn("gains_out_of_range", controller.axis, message)]


def _is_same(value: float, other: float) -> bool:
    """Whether two values of a parameter differ by their digits only: a log has 32 bits of it."""
    return math.isclose(value, other, rel_tol=_SAME, abs_tol=_SAME)


def _doubts(flown: FlownLoop, record: FlightRecord, then: FlightRecord, values: Mapping[str, float]) -> Iterator[str]:
    """What the file changes and no flight shows, as sentences."""
    for name in _OF_PLANT:
        if name in values and not _is_same(values[name], record.parameters.get(name, values[name])):
            yield (
                f"{name} changes from {record.parameters[name]:g} to {values[name]:g}, which changes the vehicle "
                "itself: fly with it, then judge the gains."
            )
    for name in MOVING_GYRO:
        if values.get(name, 0.0) > 0.0 and not _is_same(values[name], record.parameters.get(name, 0.0)):
            yield f"{name} follows the throttle, which is not modeled."
    source = flown.source
    if KINDS[flown.axis].outer:
        return
    before = _unknown_filters(record, source)
    yield from (message for message in _unknown_filters(then, source) if message not in before)


def _unknown_filters(record: FlightRecord, source: str) -> list[str]:
    return [one.message for one in filter_findings(record, source) if one.kind == "unknown_filter"]
