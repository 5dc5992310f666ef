"""A simulated flight as the DataFlash log that ArduPilot Copter would have written of it.

The inverse of :mod:`rotorid.io.ardupilot.log`: layouts of messages as firmware 4.5 defines them in its own logs, and
for each message the columns of the vocabulary in the log's units and directions. ``RATE.ADes`` and ``RATE.A`` are
centimeters per second squared, upward; angles of heading run from 0 to 360 degrees.

Sweeps are logged as runs of SYSTEMID mode (``SIDS``) with their samples (``SIDD``), whose ``Targ`` reaches the mixer
one loop after its stamp. That mode injects one logarithmic chirp on one axis at a time, and its messages have no word
for a doublet, a multisine or a random signal: of those a log shows what arrived at the mixer (``RATE``), and no more.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise, zip_longest
from pathlib import Path
from types import MappingProxyType
from typing import TypeAlias

import numpy as np

from rotorid.data.flight_plan import SimulatedFlight
from rotorid.data.record import MOTORS, Maneuver
from rotorid.errors import UsageError, nearest_name
from rotorid.io.ardupilot.dataflash_writer import Layout, Messages, write_dataflash
from rotorid.io.ardupilot.log import DSHOT_TYPES, MOTOR_FUNCTIONS, STICKS, motor_channels
from rotorid.io.ardupilot.system_id import ENTRIES
from rotorid.typing import AnyArray, FloatArray, IntArray
from rotorid.units import STANDARD_GRAVITY_M_S2, parse_unit

_FIRMWARE = "ArduCopter V4.5.7 (rotorid)"
LOG_BITMASK = 176126 | 1 << 0 | 1 << 18
"""ArduPilot's own choice of messages, with fast attitude and fast IMU."""

STABILIZE, ALT_HOLD, SYSTEM_ID = 0, 2, 25
"""Numbers of modes."""

_ARMED, _NOT_LANDED = 10, 28
_BY_SWITCH, _BY_COMMAND = 1, 2
_TEXT_BYTES = 64
_GYRO = {"Gx": "p", "Gy": "q", "Gz": "r"}
_ACCELEROMETER = {"Ax": "ax", "Ay": "ay", "Az": "az"}
_SETTINGS = {
    "Mag": "SID_MAGNITUDE",
    "FSt": "SID_F_START_HZ",
    "FSp": "SID_F_STOP_HZ",
    "TFin": "SID_T_FADE_IN",
    "TR": "SID_T_REC",
    "TFout": "SID_T_FADE_OUT",
}
"""Column of ``SIDS`` to the parameter that sets it; the time of constant frequency has none."""

_CHANNELS = "TimeUS," + ",".join(f"C{number}" for number in range(1, 15))
_ANGLES = "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw"

_TABLE = (
    Layout(number=32, name="PARM", letters="QNff", columns="TimeUS,Name,Value,Default", units="s---",
           multipliers="F---", absent=frozenset({"Default"})),
    Layout(number=59, name="MSG", letters="QZ", columns="TimeUS,Message", units="s-", multipliers="F-"),
    Layout(number=186, name="ARM", letters="QBIBB", columns="TimeUS,ArmState,ArmChecks,Forced,Method", units="s----",
           multipliers="F----"),
    Layout(number=181, name="EV", letters="QB", columns="TimeUS,Id", units="s-", multipliers="F-"),
    Layout(number=10, name="SIDS", letters="QBfffffff", columns="TimeUS,Ax,Mag,FSt,FSp,TFin,TC,TR,TFout",
           units="s--ssssss", multipliers="F--------"),
    Layout(number=120, name="MODE", letters="QMBB", columns="TimeUS,Mode,ModeNum,Rsn", units="s---",
           multipliers="F---"),
    Layout(number=195, name="ANG", letters="Qfffffff", columns=f"{_ANGLES},Dt", units="sddddhhs",
           multipliers="F0000000"),
    Layout(number=75, name="RATE", letters="Qfffffffffffff",
           columns="TimeUS,RDes,R,ROut,PDes,P,POut,YDes,Y,YOut,ADes,A,AOut,AOutSlew", units="skk-kk-kk-oo--",
           multipliers="F?????????BB--"),
    Layout(number=9, name="SIDD", letters="Qfffffffff", columns="TimeUS,Time,Targ,F,Gx,Gy,Gz,Ax,Ay,Az",
           units="ss-zkkkooo", multipliers="F---------"),
    Layout(number=163, name="IMU", letters="QBffffffIIfBBHH",
           columns="TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz", units="s#EEEooo--O--zz",
           multipliers="F-000000-----00"),
    Layout(number=44, name="XKF1", letters="QBccCfffffffccce",
           columns="TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,dPD,PN,PE,PD,GX,GY,GZ,OH", units="s#ddhnnnnmmmkkkm",
           multipliers="F-BBB0000000BBBB"),
    Layout(number=88, name="BAT", letters="QBfffffcfBBB",
           columns="TimeUS,Inst,Volt,VoltR,Curr,CurrTot,EnrgTot,Temp,Res,RemPct,H,SH", units="s#vvAaXOw%-%",
           multipliers="F-000C0?0000"),
    Layout(number=0, name="CTUN", letters="Qffffffefffhh",
           columns="TimeUS,ThI,ABst,ThO,ThH,DAlt,Alt,BAlt,DSAlt,SAlt,TAlt,DCRt,CRt", units="s----mmmmmmnn",
           multipliers="F----00B000BB", absent=frozenset({"DSAlt"})),
    Layout(number=72, name="ATT", letters="QffffffB", columns=f"{_ANGLES},AEKF", units="sddddhh-",
           multipliers="F000000-"),
    Layout(number=205, name="MOTB", letters="QfffffB",
           columns="TimeUS,LiftMax,BatVolt,ThLimit,ThrAvMx,ThrOut,FailFlags", units="s------",
           multipliers="F------"),
    Layout(number=60, name="RCIN", letters="QHHHHHHHHHHHHHH", columns=_CHANNELS, units="sYYYYYYYYYYYYYY",
           multipliers="F--------------"),
    Layout(number=62, name="RCOU", letters="QHHHHHHHHHHHHHH", columns=_CHANNELS, units="sYYYYYYYYYYYYYY",
           multipliers="F--------------"),
)  # fmt: skip

LAYOUTS: Mapping[str, Layout] = MappingProxyType({layout.name: layout for layout in _TABLE})
"""Name to layout, in the order in which ArduPilot writes messages of one instant."""


def write_ardupilot(
    path: Path, flight: SimulatedFlight, *, rates_hz: Mapping[str, float] | None = None, start_s: float = 60.0
) -> None:
    """Write a flight as an ArduPilot log: definitions, parameters, then what the autopilot knew.

    ``RATE`` and ``IMU`` hold the filtered rates and accelerations of ``flight.columns``, ``SIDD`` the unfiltered ones
    of ``flight.raw`` (or the filtered ones, when the flight has no others), and only while a sweep was injected.
    Samples are picked, not averaged, as the logger does. A message is left out when the flight lacks what it is for; a
    field that a flight cannot know (set-points that it did not have, temperatures, currents) is zero. Of test inputs,
    the log declares sweeps alone, see the module.

    A real SYSTEMID mode waits a second before the waveform begins; here the run begins with the maneuver, so that the
    times of the log are those of the plan. The mode logs rates and accelerations that are means over one turn of the
    loop, and a reader who knows that takes half a turn off the delay: ``flight.raw`` must hold such means, or delays
    seem shorter by that half.

    Parameters
    ----------
    path
        File to write or replace, whole or not at all.
    flight
        The flight; its mixer commands include what was injected, as ArduPilot's do.
    rates_hz
        Message to its rate, where it is not the usual one: ``{"RATE": 200.0}``.
    start_s
        Stamp of the flight's zero, on the clock of the log.

    Raises
    ------
    UsageError
        A column holds NaN or infinity, or more than its field can hold; an unknown message or an impossible rate is
        named; sweeps overlap; the flight is empty; the place cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> from rotorid.io.registry import read
    >>> still = SimulatedFlight(vehicle="demo", autopilot="ardupilot", sample_rate_hz=2.0, time_s=[0.0, 0.5],
    ...               columns={"battery_voltage": [12.6, 12.5]})
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_ardupilot(Path(folder, "still.bin"), still, rates_hz={"BAT": 2.0})
    ...     np.asarray(read(Path(folder, "still.bin"))["battery_voltage"]).round(1).tolist()
    [12.6, 12.5]
    """
    if not flight.samples:
        raise UsageError("the flight has no samples", needed="at least one")
    _check_finite(flight)
    rates = _checked_rates(rates_hz or {}, flight.sample_rate_hz)
    runs = injections(flight)
    parameters = _logged_parameters(flight, runs)
    stamps_us = np.rint((start_s + flight.time_s) * 1e6).astype(np.int64)
    tables = (
        *_events(flight, runs, parameters, stamps_us),
        *_system_id(flight, runs, stamps_us, _picked(flight, rates["SIDD"])),
        *_signal_messages(flight, parameters, stamps_us, rates),
    )
    order = list(LAYOUTS)
    write_dataflash(path, sorted(tables, key=lambda table: order.index(table.layout.name)))


def _logged_parameters(flight: SimulatedFlight, runs: tuple[Injection, ...]) -> Mapping[str, float]:
    """Parameters of the log: those of the flight, and those without which a log does not explain itself.

    Added where the flight does not give them: rate of the loop, ``LOG_BITMASK``, pulse widths and channels of the
    motors, and the settings of the last run of SYSTEMID mode.
    """
    motors = sum(f"motor_{number}" in flight.columns for number in range(1, MOTORS + 1))
    functions = {motor: function for function, motor in MOTOR_FUNCTIONS.items()}
    if motors > len(functions):
        raise UsageError(
            f"the flight has {motors} motors", needed=f"at most {len(functions)}, which ArduPilot can number"
        )
    added = {
        "SCHED_LOOP_RATE": flight.sample_rate_hz,
        "LOG_BITMASK": float(LOG_BITMASK),
        "MOT_PWM_MIN": 1000.0,
        "MOT_PWM_MAX": 2000.0,
    }
    if not motor_channels({}, flight.parameters):
        added |= {f"SERVO{motor}_FUNCTION": float(functions[motor]) for motor in range(1, motors + 1)}
    if runs:
        added["SID_AXIS"] = float(runs[-1].entry)
        added |= {name: runs[-1].settings[column] for column, name in _SETTINGS.items()}
    return MappingProxyType(added | dict(flight.parameters))


def _check_finite(flight: SimulatedFlight) -> None:
    for where, signals in (("columns", flight.columns), ("raw", flight.raw)):
        for name, values in signals.items():
            finite = np.isfinite(values)
            if not finite.all():
                raise UsageError(
                    f"{name} of the flight's {where} is not finite in {np.count_nonzero(~finite)} samples, the first "
                    f"at {flight.time_s[np.argmin(finite)]:g} s",
                    needed="finite samples",
                    remedy="find out why the simulation diverged, or end the flight before it does",
                )


def _checked_rates(asked_hz: Mapping[str, float], loop_hz: float) -> Mapping[str, float]:
    """Rate of every message: as asked, or as usual, and never more than the loop's."""
    usual = {"SIDD": loop_hz} | {name: min(signal.rate_hz, loop_hz) for name, signal in SIGNALS.items()}
    for name, rate_hz in asked_hz.items():
        if name not in usual:
            near = nearest_name(name, usual)
            raise UsageError(
                f"unknown message {name!r}",
                needed=f"one of {', '.join(usual)}",
                remedy=f"did you mean {near}?" if near else "",
            )
        if not 0.0 < rate_hz <= loop_hz:
            raise UsageError(
                f"the rate {rate_hz:g} Hz of {name} is out of range",
                needed=f"more than zero and at most the loop's {loop_hz:g} Hz",
            )
    return {**usual, **asked_hz}


def _events(
    flight: SimulatedFlight, runs: tuple[Injection, ...], parameters: Mapping[str, float], stamps_us: IntArray
) -> Iterator[Messages]:
    begin = stamps_us[:1]
    values = np.array(list(parameters.values()))
    yield _table(
        "PARM", begin.repeat(len(parameters)), {"Name": list(parameters), "Value": values, "Default": math.nan}
    )
    entered = np.array([stamps_us[run.samples[0]] for run in runs], dtype=np.int64)
    texts = [_FIRMWARE, _cut(f"Simulated flight of {flight.vehicle}")]
    texts += [f"SystemID Starting: axis={run.entry}" for run in runs]
    yield _table("MSG", np.append(begin.repeat(2), entered), {"Message": texts})
    yield _table("ARM", begin, {"ArmState": 1.0, "ArmChecks": parameters.get("ARMING_CHECK", 1.0)})
    yield _table("EV", begin.repeat(2), {"Id": np.array([_ARMED, _NOT_LANDED])})
    yield _modes(flight, runs, stamps_us)


def _cut(text: str) -> str:
    """As much of a text as a message holds."""
    return text.encode("utf-8")[:_TEXT_BYTES].decode("utf-8", errors="ignore")


def _modes(flight: SimulatedFlight, runs: tuple[Injection, ...], stamps_us: IntArray) -> Messages:
    """The pilot's mode, SYSTEMID from the first to the last sample of each run, and the pilot's mode again."""
    usual = STABILIZE if "thrust_stick" in flight.columns else ALT_HOLD
    changes = [(0, usual, _BY_COMMAND)]
    for run in runs:
        changes.append((int(run.samples[0]), SYSTEM_ID, _BY_SWITCH))
        changes.append((int(run.samples[-1]) + 1, usual, _BY_SWITCH))
    last = {at: (mode, reason) for at, mode, reason in changes if at < flight.samples}
    modes = np.array([mode for mode, _ in last.values()])
    reasons = np.array([reason for _, reason in last.values()])
    return _table("MODE", stamps_us[list(last)], {"Mode": modes, "ModeNum": modes, "Rsn": reasons})


def _system_id(
    flight: SimulatedFlight, runs: tuple[Injection, ...], stamps_us: IntArray, picked: IntArray
) -> Iterator[Messages]:
    """Settings and samples of all runs, the samples at the stamps of ``RATE``."""
    if not runs:
        return
    settings = {name: np.array([run.settings[name] for run in runs]) for name in runs[0].settings}
    entered = np.array([stamps_us[run.samples[0]] for run in runs])
    yield _table("SIDS", entered, {"Ax": np.array([run.entry for run in runs]), **settings})
    samples = np.concatenate([run.samples for run in runs])
    kept = np.isin(samples, picked)
    measured = {**flight.columns, **flight.raw}
    values: dict[str, AnyArray] = {
        "Time": np.concatenate([run.elapsed_s for run in runs])[kept],
        # The firmware logs its test signal one loop before the mixer receives it.
        "Targ": np.concatenate([np.append(run.target[1:], 0.0) for run in runs])[kept],
        "F": np.concatenate([run.frequency_hz for run in runs])[kept],
    }
    for names, factor in ((_GYRO, DEGREES), (_ACCELEROMETER, 1.0)):
        values |= {column: measured[name][samples[kept]] * factor for column, name in names.items() if name in measured}
    yield _table("SIDD", stamps_us[samples[kept]], values)


def _signal_messages(
    flight: SimulatedFlight, parameters: Mapping[str, float], stamps_us: IntArray, rates: Mapping[str, float]
) -> Iterator[Messages]:
    """Messages at fixed rates, those for which the flight has columns."""
    for name, signal in SIGNALS.items():
        if set(signal.needed) <= flight.columns.keys():
            samples = _picked(flight, rates[name])
            yield _table(
                name, stamps_us[samples], signal.values(Logged(flight=flight, samples=samples, parameters=parameters))
            )


def _picked(flight: SimulatedFlight, rate_hz: float) -> IntArray:
    """Samples that a logger of this rate picks: the first at or after each of its instants."""
    stride = flight.sample_rate_hz / rate_hz
    # A hair less, so that whole numbers do not depend on their rounding.
    instants = np.arange(math.ceil(flight.samples / stride)) * stride
    picked: IntArray = np.ceil(instants - 1e-9).astype(np.int64)
    return picked[picked < flight.samples]


def _table(name: str, stamps_us: IntArray, values: Mapping[str, AnyArray | list[str] | float]) -> Messages:
    """Messages of which only some columns are known; the others are zero."""
    zeros = dict.fromkeys(LAYOUTS[name].format.columns, 0.0)
    return Messages(layout=LAYOUTS[name], values={**zeros, "TimeUS": stamps_us, **values})


Values: TypeAlias = Mapping[str, AnyArray | float]
"""Column to its values, one for every message or one for all of them."""

CHANNELS = 14
"""Channels of ``RCIN`` and ``RCOU``."""

DEGREES = 180.0 / math.pi
_THRUST_EXPO = 0.65
"""ArduPilot's ``MOT_THST_EXPO`` where nothing is set."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Logged:
    """The samples of a flight that become messages of one kind.

    Parameters
    ----------
    samples
        Their indices.
    parameters
        Parameters of the log.
    """

    flight: SimulatedFlight
    samples: IntArray
    parameters: Mapping[str, float]

    def __getitem__(self, name: str) -> FloatArray:
        """A column at those samples; zeros when the flight does not know it."""
        column = self.flight.columns.get(name)
        return np.zeros(self.samples.size) if column is None else column[self.samples]

    def degrees(self, **columns: str) -> dict[str, FloatArray]:
        """Columns in degrees, or degrees per second: ``R="p"``."""
        return {column: self[name] * DEGREES for column, name in columns.items()}

    def parameter(self, name: str, usual: float = 0.0) -> float:
        return self.parameters.get(name, usual)


def rate_values(logged: Logged) -> Values:
    """``RATE``: rates and their set-points, the mixer's inputs, and the vertical acceleration, upward."""
    return {
        **logged.degrees(R="p", P="q", Y="r", RDes="p_setpoint", PDes="q_setpoint", YDes="r_setpoint"),
        "ROut": logged["roll_command"],
        "POut": logged["pitch_command"],
        "YOut": logged["yaw_command"],
        "AOut": logged["thrust_command"],
        "A": _climbing_acceleration_cm_s2(logged),
    }


def _climbing_acceleration_cm_s2(logged: Logged) -> FloatArray:
    if "az" not in logged.flight.columns:
        return np.zeros(logged.samples.size)
    phi, theta = logged["phi"], logged["theta"]
    # Third row of the rotation from body to earth.
    down = -np.sin(theta) * logged["ax"] + np.cos(theta) * (np.sin(phi) * logged["ay"] + np.cos(phi) * logged["az"])
    climbing: FloatArray = -100.0 * (down + STANDARD_GRAVITY_M_S2)
    return climbing


def attitude_values(logged: Logged) -> Values:
    """``ATT``: roll and pitch as they are, yaw from 0 to 360 degrees."""
    level = logged.degrees(Roll="phi", DesRoll="phi_setpoint", Pitch="theta", DesPitch="theta_setpoint")
    return {**level, "Yaw": _heading(logged["psi"]), "DesYaw": _heading(logged["psi_setpoint"])}


def _heading(angle: FloatArray) -> FloatArray:
    return np.mod(angle * DEGREES, 360.0)


def _angle_values(logged: Logged) -> Values:
    """``ANG``: the attitude of every turn of the loop."""
    return {**attitude_values(logged), "Dt": 1.0 / logged.flight.sample_rate_hz}


def _imu_values(logged: Logged) -> Values:
    """``IMU``: rates and accelerations after the autopilot's filters."""
    gyro = {"GyrX": logged["p"], "GyrY": logged["q"], "GyrZ": logged["r"]}
    accelerometer = {"AccX": logged["ax"], "AccY": logged["ay"], "AccZ": logged["az"]}
    rate_hz = logged.flight.sample_rate_hz
    return {**gyro, **accelerometer, "GH": 1.0, "AH": 1.0, "GHz": rate_hz, "AHz": rate_hz}


def _estimate_values(logged: Logged) -> Values:
    """``XKF1``: velocity, position and attitude of the estimator."""
    return {
        **logged.degrees(Roll="phi", Pitch="theta"),
        # Rounded to hundredths as the log holds it, 360 degrees are none.
        "Yaw": np.mod(np.round(_heading(logged["psi"]), 2), 360.0),
        "VN": logged["velocity_north"],
        "VE": logged["velocity_east"],
        "VD": logged["velocity_down"],
        "dPD": logged["velocity_down"],
        "PN": logged["north"],
        "PE": logged["east"],
        "PD": logged["down"],
    }


def _battery_values(logged: Logged) -> Values:
    """``BAT``: the voltage, which also stands for the one at rest."""
    volts = logged["battery_voltage"]
    return {"Volt": volts, "VoltR": volts, "H": 1.0}


def _throttle_values(logged: Logged) -> Values:
    """``CTUN``: throttle, altitude and climb."""
    pilot = "thrust_stick" if "thrust_stick" in logged.flight.columns else "thrust_command"
    height = -logged["down"]
    return {
        "ThI": logged[pilot],
        "ThO": logged["thrust_command"],
        "ThH": logged.parameter("MOT_THST_HOVER"),
        "Alt": height,
        "BAlt": height,
        "DSAlt": math.nan,
        "CRt": -100.0 * logged["velocity_down"],
    }


def lift_values(logged: Logged) -> Values:
    """``MOTB``: what the voltage leaves of the lift, as ArduPilot's compensation of the battery reckons it."""
    full, empty = logged.parameter("MOT_BAT_VOLT_MAX"), logged.parameter("MOT_BAT_VOLT_MIN")
    expo = logged.parameter("MOT_THST_EXPO", _THRUST_EXPO)
    known = "battery_voltage" in logged.flight.columns and 0.0 < empty < full
    part = np.clip(logged["battery_voltage"], empty, full) / full if known else np.ones(logged.samples.size)
    throttle = logged["thrust_command"]
    return {
        "LiftMax": (1.0 - expo) * part + expo * part**2,
        "BatVolt": part,
        "ThLimit": 1.0,
        "ThrAvMx": throttle,
        "ThrOut": throttle,
    }


def _output_values(logged: Logged) -> Values:
    """``RCOU``: pulse widths of the motors on their channels, microseconds.

    Raises
    ------
    UsageError
        A motor stands on a channel that the message does not have, or on none.
    """
    low, high = logged.parameter("MOT_PWM_MIN"), logged.parameter("MOT_PWM_MAX")
    if int(logged.parameter("MOT_PWM_TYPE")) in DSHOT_TYPES:
        low, high = 1000.0, 2000.0
    channels = {motor: channel for channel, motor in motor_channels({}, logged.parameters).items()}
    values = {}
    for number in range(1, MOTORS + 1):
        if f"motor_{number}" in logged.flight.columns:
            if channels.get(number, CHANNELS + 1) > CHANNELS:
                raise UsageError(
                    f"motor {number} has no channel in RCOU",
                    needed=f"a parameter SERVOn_FUNCTION for it, n from 1 to {CHANNELS}",
                )
            values[f"C{channels[number]}"] = low + (high - low) * logged[f"motor_{number}"]
    return values


def _stick_values(logged: Logged) -> Values:
    """``RCIN``: pulse widths of the sticks, with the calibration and direction of the parameters; others centered."""
    values: dict[str, AnyArray | float] = {f"C{channel}": 1500.0 for channel in range(1, CHANNELS + 1)}
    for axis, (name, usual) in STICKS.items():
        if f"{axis}_stick" in logged.flight.columns:
            channel = int(logged.parameter(name, usual))
            values[f"C{channel}"] = _pulse_widths(logged, axis, f"RC{channel}")
    return values


def _pulse_widths(logged: Logged, axis: str, prefix: str) -> FloatArray:
    low, high = logged.parameter(f"{prefix}_MIN", 1000.0), logged.parameter(f"{prefix}_MAX", 2000.0)
    span = high - low if high > low else 1000.0
    if axis == "thrust":
        return low + span * logged["thrust_stick"]
    reversed_ = logged.parameter(f"{prefix}_REVERSED") == 1.0 or logged.parameter(f"{prefix}_REV", 1.0) == -1.0
    slope = -0.5 * span if reversed_ else 0.5 * span
    return logged.parameter(f"{prefix}_TRIM", 1500.0) + slope * logged[f"{axis}_stick"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Signal:
    """A message at a fixed rate.

    Parameters
    ----------
    needed
        Columns without which it is not written.
    values
        What it says.
    rate_hz
        Its rate, whatever ``LOG_BITMASK`` says; without one every turn of the loop is logged.
    """

    needed: tuple[str, ...]
    values: Callable[[Logged], Values]
    rate_hz: float = math.inf


def _signal_rows() -> Iterator[tuple[str, str, Callable[[Logged], Values], float]]:
    yield "ANG", "phi theta psi", _angle_values, math.inf
    yield "RATE", "p q r roll_command pitch_command yaw_command thrust_command", rate_values, math.inf
    yield "IMU", "p q r ax ay az", _imu_values, math.inf
    yield "XKF1", "velocity_north velocity_east velocity_down north east down", _estimate_values, 25.0
    yield "BAT", "battery_voltage", _battery_values, 10.0
    yield "CTUN", "thrust_command", _throttle_values, 10.0
    yield "ATT", "phi theta psi", attitude_values, 10.0
    yield "MOTB", "battery_voltage thrust_command", lift_values, 10.0
    yield "RCIN", "roll_stick pitch_stick yaw_stick thrust_stick", _stick_values, 10.0
    yield "RCOU", "motor_1", _output_values, 10.0


SIGNALS: Mapping[str, Signal] = MappingProxyType(
    {
        name: Signal(needed=tuple(needed.split()), values=values, rate_hz=rate_hz)
        for name, needed, values, rate_hz in _signal_rows()
    }
)
"""Message to what it says, with the rates of a vehicle that logs fast attitude and fast IMU."""

MIXER = 10
"""Entry (``SID_AXIS``) of an injection into the mixer's roll input; pitch, yaw and thrust follow."""

_STEADY = 0.01
"""A half wave within this part of the longest one's length, and one sample, has the lowest frequency."""

_FULL = 0.95
"""Half waves of this part of the magnitude are past the fade; those of what remains of one are too small to show."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Injection:
    """One run of SYSTEMID mode.

    Parameters
    ----------
    samples
        Its samples in the flight, rising.
    entry
        ``SID_AXIS``.
    target
        The injected signal at them, in the unit of the entry.
    elapsed_s
        Time of the waveform at them; the mode counts from its first turn of the loop.
    frequency_hz
        Frequency of the waveform at them; zero when the band is not known.
    settings
        Columns of ``SIDS`` beside stamp and axis.
    """

    samples: IntArray
    entry: int
    target: FloatArray
    elapsed_s: FloatArray
    frequency_hz: FloatArray
    settings: Mapping[str, float]


def injections(flight: SimulatedFlight) -> tuple[Injection, ...]:
    """Runs in the order of their beginnings: the sweeps whose signal is an excitation that the flight holds.

    The axis of a run is the mixer's, unless ``SID_AXIS`` among the parameters of the flight names another entry of the
    same axis.

    Raises
    ------
    UsageError
        Two sweeps overlap.
    """
    swept = sorted(
        (sweep for sweep in flight.maneuvers if _is_injected(sweep, flight)), key=lambda sweep: sweep.start_s
    )
    for sweep, other in pairwise(swept):
        if other.start_s < sweep.stop_s:
            raise UsageError(
                f"the sweeps of {sweep.axis} until {sweep.stop_s:g} s and of {other.axis} from {other.start_s:g} s on "
                "overlap",
                needed="one sweep at a time, which is what ArduPilot's SYSTEMID mode can inject",
                remedy="fly them one after the other, or write another format",
            )
    return tuple(_injections(flight, swept))


def _is_injected(maneuver: Maneuver, flight: SimulatedFlight) -> bool:
    return maneuver.kind == "sweep" and maneuver.signal.endswith("_excitation") and maneuver.signal in flight.columns


def _injections(flight: SimulatedFlight, swept: list[Maneuver]) -> Iterator[Injection]:
    slack = 0.5 / flight.sample_rate_hz
    for sweep, following in zip_longest(swept, swept[1:]):
        # The last sample is the one at which the sweep is over, unless the next one begins there.
        last_s = sweep.stop_s + slack if following is None else min(sweep.stop_s + slack, following.start_s - slack)
        samples = np.flatnonzero((flight.time_s > sweep.start_s - slack) & (flight.time_s < last_s))
        if samples.size:
            yield _injection(flight, sweep, samples)


def _injection(flight: SimulatedFlight, maneuver: Maneuver, samples: IntArray) -> Injection:
    entry = _entry(maneuver, flight.parameters)
    period_s = 1.0 / flight.sample_rate_hz
    target = flight.columns[maneuver.signal][samples] / parse_unit(ENTRIES[entry][1]).factor
    elapsed_s = flight.time_s[samples] - flight.time_s[samples[0]]
    low, high = (value / (2.0 * math.pi) for value in maneuver.band_rad_s or (0.0, 0.0))
    magnitude, fade_in_s, constant_s, fade_out_s = waveform_settings(target, elapsed_s, low)
    settings = {
        "Mag": magnitude,
        "FSt": low,
        "FSp": high,
        "TFin": fade_in_s,
        "TC": constant_s,
        "TR": maneuver.duration_s,
        "TFout": fade_out_s,
    }
    return Injection(
        samples=samples,
        entry=entry,
        target=target,
        elapsed_s=elapsed_s + period_s,
        frequency_hz=_frequency(elapsed_s, low, high, constant_s),
        settings=settings,
    )


def _entry(maneuver: Maneuver, parameters: Mapping[str, float]) -> int:
    named = int(parameters.get("SID_AXIS", 0.0))
    if named in ENTRIES and ENTRIES[named][0] == maneuver.axis:
        return named
    return next(entry for entry in range(MIXER, MIXER + 4) if ENTRIES[entry][0] == maneuver.axis)


def _frequency(elapsed_s: FloatArray, low: float, high: float, constant_s: float) -> FloatArray:
    """Frequency of a logarithmic chirp that stays at its lowest one for a while, Hz."""
    swept_s = np.maximum(elapsed_s - constant_s, 0.0)
    if not 0.0 < low < high or swept_s[-1] <= 0.0:
        return np.full(elapsed_s.size, low)
    frequency: FloatArray = low * np.exp(math.log(high / low) * swept_s / swept_s[-1])
    return frequency


def waveform_settings(target: FloatArray, elapsed_s: FloatArray, low_hz: float) -> tuple[float, float, float, float]:
    r"""Magnitude, fade in, time of constant frequency and fade out of a chirp, read off its half waves.

    In the middle of a half wave, at time t inside a raised-cosine fade of length T, the signal is
    :math:`A \sin^2(\tfrac{\pi}{2} t / T)`, which gives T for every half wave; the median is taken. The frequency is
    constant for as long as the half waves are as long as one of the lowest frequency, within one percent. A waveform
    that is no chirp, or that has noise on it, has a true magnitude and meaningless times.

    Parameters
    ----------
    target, elapsed_s
        The injected signal and the time since it began, shape ``(samples,)``.
    low_hz
        Its lowest frequency; zero when not known.

    Examples
    --------
    >>> time_s = np.arange(4000) / 400.0
    >>> fade = np.sin(0.5 * np.pi * np.clip(time_s / 2.0, 0.0, 1.0)) ** 2
    >>> [round(value, 1) for value in waveform_settings(0.2 * fade * np.sin(30.0 * time_s), time_s, 0.0)]
    [0.2, 2.0, 0.0, 0.0]
    """
    size = np.abs(target)
    magnitude = float(size.max())
    moving = np.flatnonzero(size)
    crossings = moving[1:][np.diff(np.signbit(target[moving]))]
    begins = np.append(0, crossings)
    centers = (begins + np.append(crossings, target.size)) // 2
    heights = size[centers] / (magnitude or 1.0)
    fade_in_s = _fade(elapsed_s[centers], heights)
    fade_out_s = _fade((elapsed_s[-1] - elapsed_s[centers])[::-1], heights[::-1])
    half_s = 0.5 / low_hz if low_hz else math.inf
    steady = np.abs(np.diff(elapsed_s[begins]) - half_s) < _STEADY * half_s + elapsed_s[1] - elapsed_s[0]
    constant_s = float(elapsed_s[begins[np.argmin(steady)]]) if steady.any() and not steady.all() else 0.0
    return magnitude, fade_in_s, constant_s, fade_out_s


def _fade(distances_s: FloatArray, heights: FloatArray) -> float:
    """Length of a raised-cosine fade, from half waves at their distances from its beginning; zero without one."""
    faded = int(np.argmax(heights > _FULL))
    inside = (heights[:faded] > 1.0 - _FULL) & (distances_s[:faded] > 0.0)
    if not inside.any():
        return 0.0
    rise = np.arcsin(np.sqrt(heights[:faded][inside])) / (0.5 * math.pi)
    return float(np.median(distances_s[:faded][inside] / rise))
