"""Files with which ArduPilot's Copter flies a plan: parameters of its SYSTEMID mode, and scripts for its Lua.

SYSTEMID mode (25) flies one waveform, a logarithmic chirp, on one axis at a time; :class:`SystemId` holds its settings
and the waveform that they make. Everything else needs a script; what scripts can reach is the attitude set-point, in
GUIDED mode. Nothing but the firmware can add to the mixer's input or to a rate set-point in another form than that
chirp.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from types import MappingProxyType

import numpy as np

from rotorid.autopilots.ardupilot.firmware import named
from rotorid.autopilots.ardupilot.system_id import (
    CHECKED,
    LOITER,
    SID_AXIS,
    SYSTEM_ID_MODE,
    entry_reason,
    start_mode,
    throttle_of,
)
from rotorid.data.flight_plan import FlightPlan, PlannedInput
from rotorid.errors import UsageError
from rotorid.plans.csv import file_stem, filled, number, number_above, one_line, table
from rotorid.plans.facts import HOLD, FlightFacts, excited_s, flown_by_hand, how_to_stop
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

SYSTEM_ID_DELAY_S = 1.0
"""Time in the mode before its waveform begins, fixed in the firmware."""

CONSTANT_CYCLES = 2.0
"""Periods at the lowest frequency before the chirp begins, fixed in the firmware."""

_AGREEMENT = 0.01
"""Share of the amplitude by which the waveform of the firmware may differ from the planned samples."""

_RANGES: Mapping[str, tuple[float, float]] = MappingProxyType(
    {
        "SID_F_START_HZ": (0.01, 100.0),
        "SID_F_STOP_HZ": (0.01, 100.0),
        "SID_T_FADE_IN": (0.0, 20.0),
        "SID_T_REC": (0.0, 255.0),
        "SID_T_FADE_OUT": (0.0, 5.0),
    }
)


@dataclass(frozen=True, kw_only=True, slots=True)
class SystemId:
    """Settings of SYSTEMID mode for one run.

    Parameters
    ----------
    axis
        ``SID_AXIS``.
    magnitude
        ``SID_MAGNITUDE``: degrees for angles (1 to 6), degrees per second for rates (7 to 9), a fraction for the mixer
        (10 to 13).
    start_hz, stop_hz, fade_in_s, record_s, fade_out_s
        ``SID_F_START_HZ``, ``SID_F_STOP_HZ``, ``SID_T_FADE_IN``, ``SID_T_REC``, ``SID_T_FADE_OUT``. The record holds
        the part of constant frequency and the fades.
    """

    axis: int
    magnitude: float
    start_hz: float
    stop_hz: float
    fade_in_s: float
    record_s: float
    fade_out_s: float

    @property
    def parameters(self) -> dict[str, float]:
        """The autopilot's names and values, in the order of its documentation."""
        return {
            "SID_AXIS": self.axis,
            "SID_MAGNITUDE": self.magnitude,
            "SID_F_START_HZ": self.start_hz,
            "SID_F_STOP_HZ": self.stop_hz,
            "SID_T_FADE_IN": self.fade_in_s,
            "SID_T_REC": self.record_s,
            "SID_T_FADE_OUT": self.fade_out_s,
        }

    @property
    def constant_s(self) -> float:
        """Time at the lowest frequency before the chirp, two periods."""
        return CONSTANT_CYCLES / self.start_hz

    def waveform(self, time_s: FloatArray) -> FloatArray:
        r"""What the mode adds, in the unit of the magnitude.

        .. math:: m \, w(t) \sin\left[ \frac{\omega_{min} (T - T_c)}{B} \left(e^{B (t - T_c) / (T - T_c)} - 1\right)
            \right], \quad \omega_{min} (t - T_c) \text{ as phase until } T_c, \quad B = \ln(\omega_{max}/\omega_{min})

        Parameters
        ----------
        time_s
            From the begin of the waveform, one second after the mode was entered, any shape.

        References
        ----------
        ArduPilot, ``libraries/AP_Math/chirp.cpp`` and ``ArduCopter/mode_systemid.cpp``.
        """
        low, rise = 2.0 * math.pi * self.start_hz, math.log(self.stop_hz / self.start_hz)
        swept, length = time_s - self.constant_s, self.record_s - self.constant_s
        phase = np.where(
            swept < 0.0, low * swept, low * length / rise * np.expm1(rise * np.maximum(swept, 0.0) / length)
        )
        into = np.clip(time_s / self.fade_in_s, 0.0, 1.0) if self.fade_in_s else np.where(time_s > 0.0, 1.0, 0.0)
        left = self.record_s - time_s
        out = np.clip(left / self.fade_out_s, 0.0, 1.0) if self.fade_out_s else np.where(left >= 0.0, 1.0, 0.0)
        # The firmware has one window, which forgets the fade-in where the fades overlap; ranges keep them apart.
        window = 0.25 * (1.0 - np.cos(math.pi * into)) * (1.0 - np.cos(math.pi * out))
        flown: FloatArray = self.magnitude * window * np.sin(phase)
        return flown


def system_id(planned: PlannedInput) -> SystemId:
    """Settings with which SYSTEMID mode flies a planned chirp.

    Parameters
    ----------
    planned
        A logarithmic sweep whose part of constant frequency lasts two periods of its lowest frequency, as the firmware
        has it. ``fade_in_s``, ``fade_out_s`` and ``trim_s`` are taken from its settings; without a ``trim_s`` the zeros
        at its ends are counted.

    Raises
    ------
    UsageError
        The mode cannot fly this: another form, no such place to enter, a value out of its range, or samples that are
        not those of the firmware's chirp.

    Examples
    --------
    >>> from rotorid.excitation import logarithmic_sweep
    >>> band = (2.0 * math.pi * 0.2, 2.0 * math.pi * 20.0)
    >>> values = logarithmic_sweep(amplitude=0.1, band_rad_s=band, duration_s=60.0, sample_rate_hz=100.0,
    ...                            constant_s=10.0, fade_in_s=5.0, fade_out_s=2.0)
    >>> chirp = PlannedInput(axis="roll", shape="logarithmic_sweep", start_s=0.0, values=values, sample_rate_hz=100.0,
    ...                      amplitude=0.1, band_rad_s=band, settings={"fade_in_s": 5.0, "fade_out_s": 2.0})
    >>> {name: round(value, 6) for name, value in system_id(chirp).parameters.items()}
    {'SID_AXIS': 10, 'SID_MAGNITUDE': 0.1, 'SID_F_START_HZ': 0.2, 'SID_F_STOP_HZ': 20.0, 'SID_T_FADE_IN': 5.0,
    'SID_T_REC': 60.0, 'SID_T_FADE_OUT': 2.0}
    """
    axis = _axis_number(planned)
    if planned.shape != "logarithmic_sweep" or planned.band_rad_s is None:
        raise UsageError(
            f"ArduPilot's SYSTEMID mode cannot fly a {in_words(planned.shape)} on {planned.axis}",
            needed="a logarithmic sweep with its band",
            remedy="plan a logarithmic sweep, or an attitude set-point, which a script can fly",
        )
    if not planned.amplitude > 0.0:
        raise UsageError(
            f"the sweep on {planned.axis} has the amplitude {planned.amplitude:g}", needed="an amplitude above zero"
        )
    low, high = planned.band_rad_s
    begin_s, end_s = excited_s(planned)
    settings = SystemId(
        axis=axis,
        magnitude=planned.amplitude if axis >= 10 else math.degrees(planned.amplitude),
        start_hz=low / (2.0 * math.pi),
        stop_hz=high / (2.0 * math.pi),
        fade_in_s=planned.settings.get("fade_in_s", 1.0),
        record_s=end_s - begin_s,
        fade_out_s=planned.settings.get("fade_out_s", 1.0),
    )
    _require_ranges(settings)
    _require_agreement(settings, planned, begin_s - planned.start_s)
    return settings


def _axis_number(planned: PlannedInput) -> int:
    number_of = SID_AXIS.get((planned.entry, planned.axis))
    if number_of is None:
        places = ", ".join(f"{in_words(entry)} of {axis}" for entry, axis in SID_AXIS)
        raise UsageError(
            f"ArduPilot's SYSTEMID mode has no entry {in_words(planned.entry)} of {planned.axis}",
            needed=f"one of {places}",
            remedy="plan another entry",
        )
    return number_of


def _require_ranges(settings: SystemId) -> None:
    for name, (least, most) in _RANGES.items():
        value = settings.parameters[name]
        if not least <= value <= most:
            raise UsageError(f"{name} would be {value:g}", needed=f"{least:g} to {most:g}", remedy="change the plan")
    if (
        settings.record_s <= settings.constant_s + settings.fade_out_s
        or settings.fade_in_s >= settings.record_s - settings.fade_out_s
    ):
        raise UsageError(
            f"a chirp of {settings.record_s:g} s from {settings.start_hz:g} Hz is too short for its first two cycles "
            f"({settings.constant_s:g} s) and fades of {settings.fade_in_s:g} s and {settings.fade_out_s:g} s",
            remedy="make it longer or raise its lowest frequency",
        )


def _require_agreement(settings: SystemId, planned: PlannedInput, trim_s: float) -> None:
    """Refuse settings from which the firmware flies other samples than those of the plan."""
    time_s = np.arange(planned.values.size) / planned.sample_rate_hz - trim_s
    flown = settings.waveform(time_s) * (planned.amplitude / settings.magnitude)
    deviation = float(np.abs(flown - planned.values).max()) / planned.amplitude
    if deviation > _AGREEMENT:
        raise UsageError(
            (
                f"the samples of the sweep on {planned.axis} differ from "
                f"ArduPilot's chirp by {100.0 * deviation:.0f} % of the amplitude"
            ),
            needed=f"two cycles at constant frequency ({settings.constant_s:g} s), and fades in the settings",
            remedy=f"plan it with constant_s={settings.constant_s:g}, fade_in_s and fade_out_s",
        )


def in_words(name: str) -> str:
    """A name of the library in a sentence.

    Examples
    --------
    >>> in_words("rate_setpoint")
    'rate setpoint'
    """
    return name.replace("_", " ")


DEFAULT_LOG_BITMASK = 176126
"""Copter's own default."""
LOG_BITS = (0, 1)
"""Fast and medium attitude: together they make SYSTEMID mode log every loop."""
FAST_IMU_BIT = 18
"""IMU at the rate of the loop, for maneuvers outside of SYSTEMID mode, where ``SIDD`` is not written."""

AFTER, LOG = "ardupilot-after.param", "ardupilot-log.param"
"""Parameters to load after the flight, and logging parameters for a flight by script."""

ATTITUDE_RATE_HZ = 50.0
"""Rate at which the script sends attitudes."""


def ardupilot_files(plan: FlightPlan, facts: FlightFacts) -> dict[str, str]:
    """Files for ArduPilot: parameters for each run, parameters for afterwards, and a script where one helps.

    - A plan of logarithmic sweeps gives one ``.param`` file for each, to be flown one by one, and a Lua script that
      flies them all in one flight after each other, while a switch of the pilot is on. Both are entered from Stabilize,
      the only hovering mode from which every version enters these axes, and the pilot works the throttle.
    - A plan of other forms that enter as attitude set-points of roll, pitch and yaw gives logging parameters, a Lua
      script for GUIDED mode and its table of attitudes. The script holds the place as slowly as
      :func:`rotorid.simulation.multirotor_flight.piloted` does; the autopilot holds the height.
    - Inputs at the sticks, and doublets or multisteps beside sweeps, are left to the pilot's hand and the flight card.

    The files are for Copter 4.5 to 4.7; :func:`rotorid.autopilots.ardupilot.system_id.firmware_findings` compares the
    version of a log with them.

    Neither ever overrides the pilot's sticks, arms or disarms: a change of the flight mode or of the switch ends the
    run.

    Parameters
    ----------
    facts
        Its limits.

    Returns
    -------
    dict[str, str]
        File name to text. Parameters as ``NAME,VALUE``, which Mission Planner and MAVProxy load.

    Raises
    ------
    UsageError
        ArduPilot cannot fly one of the inputs.
    """
    by_hand = flown_by_hand(plan, "ArduPilot")
    sweeps = [planned for planned in plan.inputs if planned not in by_hand]
    if not sweeps:
        raise UsageError(
            "ArduPilot has no files for test inputs at the sticks",
            needed="command, rate or attitude inputs",
            remedy="fly them by hand with the flight card, or plan another entry",
        )
    if all(planned.shape == "logarithmic_sweep" for planned in sweeps):
        return _chirp_files(plan, sweeps, facts)
    return _attitude_files(plan, facts)


def log_bitmask(*, fast_imu: bool) -> int:
    """``LOG_BITMASK`` of a test flight: the default, fast attitude, and the IMU at the rate of the loop.

    Examples
    --------
    >>> log_bitmask(fast_imu=False), log_bitmask(fast_imu=True)
    (176127, 438271)
    """
    bits = (*LOG_BITS, FAST_IMU_BIT) if fast_imu else LOG_BITS
    mask = DEFAULT_LOG_BITMASK
    for bit in bits:
        mask |= 1 << bit
    return mask


def plan_log_bitmask(plan: FlightPlan) -> int:
    """``LOG_BITMASK`` for a plan: with the fast IMU where something is flown outside of SYSTEMID mode."""
    return log_bitmask(fast_imu=any(planned.shape != "logarithmic_sweep" for planned in plan.inputs))


def versions_words() -> str:
    """The versions of Copter that the files are for.

    Examples
    --------
    >>> versions_words()
    '4.5 to 4.7'
    """
    oldest, newest = CHECKED[0], CHECKED[-1]
    return f"{oldest[0]}.{oldest[1]} to {newest[0]}.{newest[1]}"


def _tilt_limit_parameter(firmware: str) -> str:
    """The parameter of the largest lean, which 4.7 renamed."""
    version = named(firmware).copter
    if version is None:
        return "ANGLE_MAX (from 4.7 on ATC_ANGLE_MAX)"
    return "ANGLE_MAX" if version < (4, 7) else "ATC_ANGLE_MAX"


def _chirp_files(plan: FlightPlan, sweeps: Sequence[PlannedInput], facts: FlightFacts) -> dict[str, str]:
    runs = [(planned, system_id(planned)) for planned in sweeps]
    _require_one_by_one(sweeps)
    shared = {"LOG_BITMASK": plan_log_bitmask(plan)}
    # One script hovers in one mode: all axes of a plan are of the attitude, rates or the mixer.
    (start,) = {start_mode(settings.axis) for _, settings in runs}
    words = {
        "plan": one_line(plan.name),
        "vehicle": one_line(facts.vehicle),
        "facts": facts,
        "versions": versions_words(),
        "start": start,
        "stop": how_to_stop(plan, "ArduPilot"),
        "throttle": throttle_of(runs[0][1].axis),
        "reason": entry_reason(runs[0][1].axis, facts.firmware),
    }
    files = {}
    for index, (planned, settings) in enumerate(runs, start=1):
        files[f"ardupilot-{index}-{planned.axis}.param"] = filled(
            "ardupilot_run.param",
            **words,
            index=index,
            of=len(runs),
            planned=planned,
            settings=settings,
            fast_imu=bool(shared["LOG_BITMASK"] >> FAST_IMU_BIT & 1),
            lean_limit=_tilt_limit_parameter(facts.firmware),
            lines=_lines(settings.parameters | shared),
        )
    files[AFTER] = filled("ardupilot_after.param", **words, default=DEFAULT_LOG_BITMASK)
    files[f"{file_stem(plan.name)}-chirps.lua"] = filled(
        "ardupilot_chirps.lua",
        **words,
        mode=SYSTEM_ID_MODE,
        loiter=LOITER,
        runs=[(planned.axis, SYSTEM_ID_DELAY_S + settings.record_s, _settings(settings)) for planned, settings in runs],
        rests=_rests_s(sweeps, plan.trim_s),
        number=number,
    )
    return files


def _attitude_files(plan: FlightPlan, facts: FlightFacts) -> dict[str, str]:
    for planned in plan.inputs:
        if planned.entry != "attitude_setpoint" or planned.axis == "thrust":
            raise UsageError(
                f"ArduPilot cannot fly a {in_words(planned.shape)} on {planned.axis} as {in_words(planned.entry)}",
                needed="logarithmic sweeps, or attitude set-points of roll, pitch and yaw",
                remedy="plan logarithmic sweeps for SYSTEMID mode, or attitude set-points for GUIDED mode",
            )
    time_s, columns = table(plan, sample_rate_hz=ATTITUDE_RATE_HZ)
    zero = np.zeros(time_s.size)
    angles = np.degrees([columns.get(f"{axis}_attitude_setpoint", zero) for axis in ("roll", "pitch", "yaw")])
    stem = file_stem(plan.name)
    words = {
        "plan": one_line(plan.name),
        "vehicle": one_line(facts.vehicle),
        "facts": facts,
        "stop": how_to_stop(plan, "ArduPilot"),
        "versions": versions_words(),
    }
    rows = [f"{roll:.3f},{pitch:.3f},{yaw:.3f}" for roll, pitch, yaw in angles.T.tolist()]
    return {
        LOG: filled(
            "ardupilot_log.param", **words, lines=_lines({"LOG_BITMASK": plan_log_bitmask(plan), "SCR_ENABLE": 1})
        ),
        AFTER: filled("ardupilot_after.param", **words, default=DEFAULT_LOG_BITMASK),
        f"{stem}-attitude.csv": "\n".join([*rows, ""]),
        f"{stem}-attitude.lua": filled(
            "ardupilot_attitude.lua",
            **words,
            table=f"{stem}-attitude.csv",
            rows=len(rows),
            rate_hz=ATTITUDE_RATE_HZ,
            largest_deg=[number_above(float(np.abs(angle).max())) for angle in angles],
            hold=HOLD,
            gravity=STANDARD_GRAVITY_M_S2,
            number=number,
        ),
    }


def _require_one_by_one(inputs: Sequence[PlannedInput]) -> None:
    for before, after in pairwise(inputs):
        if excited_s(after)[0] < excited_s(before)[1]:
            raise UsageError(
                f"ArduPilot's SYSTEMID mode cannot fly sweeps on {before.axis} and {after.axis} at the same time",
                needed="one sweep after the other",
                remedy="start the second one after the first",
            )


def _rests_s(sweeps: Sequence[PlannedInput], last_s: float) -> list[float]:
    """Pause after each run as planned, without the second that the mode waits itself."""
    edges = [excited_s(planned) for planned in sweeps]
    gaps = [after[0] - before[1] for before, after in pairwise(edges)]
    return [max(gap - SYSTEM_ID_DELAY_S, 1.0) for gap in gaps] + [last_s]


def _settings(settings: SystemId) -> list[tuple[str, str]]:
    return [(name, number(value)) for name, value in settings.parameters.items()]


def _lines(parameters: Mapping[str, float]) -> list[str]:
    return [f"{name},{number(value)}" for name, value in parameters.items()]
