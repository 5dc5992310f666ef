"""Writer of ArduPilot logs: a simulated flight as the DataFlash log that Copter would have left of it."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np

from rotorid.data.channel import MOTORS
from rotorid.data.simulated_flight import SimulatedFlight
from rotorid.errors import UsageError
from rotorid.io.ardupilot_actuators import MOTOR_FUNCTIONS, motor_channels
from rotorid.io.ardupilot_injections import Injection, injections
from rotorid.io.ardupilot_layouts import LAYOUTS
from rotorid.io.ardupilot_signals import DEGREES, SIGNALS, Logged
from rotorid.io.dataflash_write import Messages, write_dataflash
from rotorid.typing import AnyArray, IntArray

FIRMWARE = "ArduCopter V4.5.7 (rotorid)"
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


def write_ardupilot(
    path: Path, flown: SimulatedFlight, *, rates_hz: Mapping[str, float] | None = None, start_s: float = 60.0
) -> None:
    """Write a flight as an ArduPilot log: definitions, parameters, then what the autopilot knew.

    ``RATE`` and ``IMU`` hold the filtered rates and accelerations of ``flown.columns``, ``SIDD`` the unfiltered ones of
    ``flown.raw`` (or the filtered ones, when the flight has no others), and only while a sweep was injected. Samples
    are picked, not averaged, as the logger does. A message is left out when the flight lacks what it is for; a field
    that a flight cannot know (set-points that it did not have, temperatures, currents) is zero. Of test inputs, the log
    declares sweeps alone, see :mod:`rotorid.io.ardupilot_injections`.

    A real SYSTEMID mode waits a second before the waveform begins; here the run begins with the maneuver, so that the
    times of the log are those of the plan. The mode logs rates and accelerations that are means over one turn of the
    loop, and a reader who knows that takes half a turn off the delay: ``flown.raw`` must hold such means, or delays
    seem shorter by that half.

    Parameters
    ----------
    path
        File to write or replace, whole or not at all.
    flown
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
    ...     [topic.values.round(1).tolist() for topic in read(Path(folder, "still.bin")).topics]
    [[[12.6, 12.5]]]
    """
    if not flown.samples:
        raise UsageError("a flight without samples came", needed="at least one")
    _check_finite(flown)
    rates = _checked_rates(rates_hz or {}, flown.sample_rate_hz)
    runs = injections(flown)
    parameters = logged_parameters(flown, runs)
    stamps_us = np.rint((start_s + flown.time_s) * 1e6).astype(np.int64)
    tables = (
        *_events(flown, runs, parameters, stamps_us),
        *_system_id(flown, runs, stamps_us, _picked(flown, rates["SIDD"])),
        *_signals(flown, parameters, stamps_us, rates),
    )
    order = list(LAYOUTS)
    write_dataflash(path, sorted(tables, key=lambda table: order.index(table.layout.name)))


def logged_parameters(flown: SimulatedFlight, runs: tuple[Injection, ...]) -> Mapping[str, float]:
    """Parameters of the log: those of the flight, and those without which a log does not explain itself.

    Added where the flight does not give them: rate of the loop, ``LOG_BITMASK``, pulse widths and channels of the
    motors, and the settings of the last run of SYSTEMID mode.
    """
    motors = sum(f"motor_{number}" in flown.columns for number in range(1, MOTORS + 1))
    functions = {motor: function for function, motor in MOTOR_FUNCTIONS.items()}
    if motors > len(functions):
        raise UsageError(f"{motors} motors came", needed=f"at most {len(functions)}, which ArduPilot can number")
    added = {
        "SCHED_LOOP_RATE": flown.sample_rate_hz,
        "LOG_BITMASK": float(LOG_BITMASK),
        "MOT_PWM_MIN": 1000.0,
        "MOT_PWM_MAX": 2000.0,
    }
    if not motor_channels({}, flown.parameters):
        added |= {f"SERVO{motor}_FUNCTION": float(functions[motor]) for motor in range(1, motors + 1)}
    if runs:
        added["SID_AXIS"] = float(runs[-1].entry)
        added |= {name: runs[-1].settings[column] for column, name in _SETTINGS.items()}
    return MappingProxyType(added | dict(flown.parameters))


def _check_finite(flown: SimulatedFlight) -> None:
    for where, signals in (("columns", flown.columns), ("raw", flown.raw)):
        for name, values in signals.items():
            finite = np.isfinite(values)
            if not finite.all():
                raise UsageError(
                    f"{name} of the flight's {where} is not finite in {np.count_nonzero(~finite)} samples, the first "
                    f"at {flown.time_s[np.argmin(finite)]:g} s",
                    needed="finite samples",
                    remedy="find out why the simulation diverged, or end the flight before it does",
                )


def _checked_rates(asked_hz: Mapping[str, float], loop_hz: float) -> Mapping[str, float]:
    """Rate of every message: as asked, or as usual, and never more than the loop's."""
    usual = {"SIDD": loop_hz} | {name: min(signal.rate_hz, loop_hz) for name, signal in SIGNALS.items()}
    for name, rate_hz in asked_hz.items():
        if name not in usual:
            close = difflib.get_close_matches(name, usual, n=1)
            raise UsageError(
                f"a rate for the message {name!r} came",
                needed=f"one of {', '.join(usual)}",
                remedy=f"did you mean {close[0]}?" if close else "",
            )
        if not 0.0 < rate_hz <= loop_hz:
            raise UsageError(
                f"a rate of {rate_hz:g} Hz for {name} came",
                needed=f"more than zero and at most the loop's {loop_hz:g} Hz",
            )
    return {**usual, **asked_hz}


def _picked(flown: SimulatedFlight, rate_hz: float) -> IntArray:
    """Samples that a logger of this rate picks: the first at or after each of its instants."""
    stride = flown.sample_rate_hz / rate_hz
    # A hair less, so that whole numbers do not depend on their rounding.
    instants = np.arange(math.ceil(flown.samples / stride)) * stride
    picked: IntArray = np.ceil(instants - 1e-9).astype(np.int64)
    return picked[picked < flown.samples]


def _table(name: str, stamps_us: IntArray, values: Mapping[str, AnyArray | list[str] | float]) -> Messages:
    """Messages of which only some columns are known; the others are zero."""
    zeros = dict.fromkeys(LAYOUTS[name].format.columns, 0.0)
    return Messages(layout=LAYOUTS[name], values={**zeros, "TimeUS": stamps_us, **values})


def _events(
    flown: SimulatedFlight, runs: tuple[Injection, ...], parameters: Mapping[str, float], stamps_us: IntArray
) -> Iterator[Messages]:
    begin = stamps_us[:1]
    values = np.array(list(parameters.values()))
    yield _table(
        "PARM", begin.repeat(len(parameters)), {"Name": list(parameters), "Value": values, "Default": math.nan}
    )
    entered = np.array([stamps_us[run.samples[0]] for run in runs], dtype=np.int64)
    texts = [FIRMWARE, _cut(f"Simulated flight of {flown.vehicle}")]
    texts += [f"SystemID Starting: axis={run.entry}" for run in runs]
    yield _table("MSG", np.append(begin.repeat(2), entered), {"Message": texts})
    yield _table("ARM", begin, {"ArmState": 1.0, "ArmChecks": parameters.get("ARMING_CHECK", 1.0)})
    yield _table("EV", begin.repeat(2), {"Id": np.array([_ARMED, _NOT_LANDED])})
    yield _modes(flown, runs, stamps_us)


def _cut(text: str) -> str:
    """As much of a text as a message holds."""
    return text.encode("utf-8")[:_TEXT_BYTES].decode("utf-8", errors="ignore")


def _modes(flown: SimulatedFlight, runs: tuple[Injection, ...], stamps_us: IntArray) -> Messages:
    """The pilot's mode, SYSTEMID from the first to the last sample of each run, and the pilot's mode again."""
    usual = STABILIZE if "thrust_stick" in flown.columns else ALT_HOLD
    changes = [(0, usual, _BY_COMMAND)]
    for run in runs:
        changes.append((int(run.samples[0]), SYSTEM_ID, _BY_SWITCH))
        changes.append((int(run.samples[-1]) + 1, usual, _BY_SWITCH))
    last = {at: (mode, reason) for at, mode, reason in changes if at < flown.samples}
    modes = np.array([mode for mode, _ in last.values()])
    reasons = np.array([reason for _, reason in last.values()])
    return _table("MODE", stamps_us[list(last)], {"Mode": modes, "ModeNum": modes, "Rsn": reasons})


def _system_id(
    flown: SimulatedFlight, runs: tuple[Injection, ...], stamps_us: IntArray, picked: IntArray
) -> Iterator[Messages]:
    """Settings and samples of all runs, the samples at the stamps of ``RATE``."""
    if not runs:
        return
    settings = {name: np.array([run.settings[name] for run in runs]) for name in runs[0].settings}
    entered = np.array([stamps_us[run.samples[0]] for run in runs])
    yield _table("SIDS", entered, {"Ax": np.array([run.entry for run in runs]), **settings})
    samples = np.concatenate([run.samples for run in runs])
    kept = np.isin(samples, picked)
    measured = {**flown.columns, **flown.raw}
    values: dict[str, AnyArray] = {
        "Time": np.concatenate([run.elapsed_s for run in runs])[kept],
        "Targ": np.concatenate([run.target for run in runs])[kept],
        "F": np.concatenate([run.frequency_hz for run in runs])[kept],
    }
    for names, factor in ((_GYRO, DEGREES), (_ACCELEROMETER, 1.0)):
        values |= {column: measured[name][samples[kept]] * factor for column, name in names.items() if name in measured}
    yield _table("SIDD", stamps_us[samples[kept]], values)


def _signals(
    flown: SimulatedFlight, parameters: Mapping[str, float], stamps_us: IntArray, rates: Mapping[str, float]
) -> Iterator[Messages]:
    """Messages at fixed rates, those for which the flight has columns."""
    for name, signal in SIGNALS.items():
        if set(signal.needed) <= flown.columns.keys():
            samples = _picked(flown, rates[name])
            yield _table(
                name, stamps_us[samples], signal.values(Logged(flown=flown, samples=samples, parameters=parameters))
            )
