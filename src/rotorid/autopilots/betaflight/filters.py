"""Filters that Betaflight runs in front of the channels that its blackbox holds.

References
----------
Betaflight wiki, *Gyro & Dterm filtering*, *4.2 Tuning Notes* and *4.3 Tuning Notes*; ``common/filter.c``,
``sensors/gyro_init.c`` and, for the names in the header, ``blackbox/blackbox.c``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import partial
from typing import NamedTuple

from rotorid.autopilots.betaflight.notches import DYNAMIC_FEATURE
from rotorid.autopilots.filters import butterworth_low_pass, cascaded_low_pass, moving_average, notch
from rotorid.autopilots.numbers import Parameters, broken, whole
from rotorid.autopilots.passages import UNKNOWN, Passage, built, doubtful, joined, moving
from rotorid.data.record import FlightRecord

_SETTINGS = ("gyro_", "features", "dshot_bidir", "rpm_filter_", "pid_process_denom")
_GYRO = r"gyroADC\[\d\]"
_COMMANDS = r"motor mix|motor\[\d\]"
_VERSION = re.compile(r"Betaflight\D{0,40}(\d{1,4})\.(\d{1,4})")
_SPLIT = (4, 2)
"""From this version on the sensor is read at its own rate and filtered, but for low-pass 2, at that of the PID loop."""
_PT1, _BIQUAD = 0, 1
_CASCADES = {2: 2, 3: 3}
"""Type to order of the low-passes PT2 and PT3."""
_CASCADES_SINCE = (4, 3)
"""Before, these types meant other things."""
_LARGEST_DENOMINATOR = 255.0


class _LowPass(NamedTuple):
    """Names of the settings of a low-pass, newest first."""

    cutoff: tuple[str, ...]
    kind: tuple[str, ...]
    moving: tuple[str, ...]
    at_sensor_rate: bool


_LOW_PASSES = (
    _LowPass(
        ("gyro_lpf1_static_hz", "gyro_lowpass_hz"),
        ("gyro_lpf1_type", "gyro_lowpass_type", "gyro_soft_type"),
        ("gyro_lpf1_dyn_hz_0", "gyro_lowpass_dyn_hz_0"),
        at_sensor_rate=False,
    ),
    _LowPass(
        ("gyro_lpf2_static_hz", "gyro_lowpass2_hz"),
        ("gyro_lpf2_type", "gyro_lowpass2_type", "gyro_soft2_type"),
        (),
        at_sensor_rate=True,
    ),
)
_SPEED_NOTCHES = ("rpm_filter_harmonics", "gyro_rpm_notch_harmonics")


def passage(record: FlightRecord, source: str, sensor_rate_hz: float | None) -> Passage:
    """What a channel of a blackbox log has passed.

    Parameters
    ----------
    record
        With the settings of the header as its parameters.
    source
        Field of the log.
    sensor_rate_hz
        In place of the one that the header gives.
    """
    settings = record.parameters
    if re.fullmatch(_COMMANDS, source):
        curved = settings.get("thrust_linear", 0.0) > 0.0
        return doubtful("it contains a thrust curve (thrust_linear)") if curved else Passage()
    if not re.fullmatch(_GYRO, source):
        return doubtful(UNKNOWN)
    named = _VERSION.search(record.source.firmware)
    if named is None:
        return doubtful("the log names no version of Betaflight, without which its settings mean nothing")
    if not settings.get("looptime", 0.0) > 0.0:
        return doubtful("the log does not carry looptime, the period of the sensor")
    if damaged := broken(settings, *_SETTINGS):
        return doubtful(f"{', '.join(damaged)} in the log is no number")
    denominator = settings.get("pid_process_denom", 1.0)
    if not 1.0 <= denominator <= _LARGEST_DENOMINATOR:
        return doubtful(f"pid_process_denom = {denominator:g} cannot be")
    version = (int(named[1]), int(named[2]))
    sensor_hz = sensor_rate_hz or 1e6 / settings["looptime"]
    loop_hz = sensor_hz / denominator if version >= _SPLIT else sensor_hz
    return joined(
        (
            *(_low_pass(row, settings, version, sensor_hz if row.at_sensor_rate else loop_hz) for row in _LOW_PASSES),
            _decimation(settings, sensor_hz, loop_hz),
            *_notches(settings, loop_hz),
            *_moving_notches(settings),
        )
    )


def _low_pass(row: _LowPass, settings: Parameters, version: tuple[int, int], rate_hz: float) -> Passage:
    followed = _first(row.moving, settings)
    if followed is not None and settings[followed] > 0.0:
        return moving(followed, settings[followed])
    cutoff, kind = _first(row.cutoff, settings), _first(row.kind, settings)
    if cutoff is None:
        # Old firmware has no second low-pass; the first one was always there.
        return Passage() if row.at_sensor_rate else doubtful(f"the log does not carry {' or '.join(row.cutoff)}")
    # The firmware leaves out a low-pass beyond half of its rate.
    if not 0.0 < settings[cutoff] < 0.5 * rate_hz:
        return Passage()
    if kind is None:
        return doubtful(f"{cutoff} = {settings[cutoff]:g}, and the log does not carry {' or '.join(row.kind)}")
    code, setting_words = whole(settings, kind), f"{cutoff} = {settings[cutoff]:g}"
    if code == _BIQUAD:
        return built(setting_words, partial(butterworth_low_pass, settings[cutoff], rate_hz))
    if code == _PT1 or (code in _CASCADES and version >= _CASCADES_SINCE):
        return built(setting_words, partial(cascaded_low_pass, _CASCADES.get(code, 1), settings[cutoff], rate_hz))
    return doubtful(f"a low-pass of a kind that is not modeled is on ({kind} = {code})")


def _decimation(settings: Parameters, sensor_hz: float, loop_hz: float) -> Passage:
    """Where no second low-pass stands before it, the loop takes the mean of the samples since the last one."""
    cutoff = _first(_LOW_PASSES[1].cutoff, settings)
    if loop_hz == sensor_hz or (cutoff is not None and settings[cutoff] > 0.0):
        return Passage()
    return Passage(filters=(moving_average(1.0 / loop_hz, sensor_hz),))


def _notches(settings: Parameters, rate_hz: float) -> Iterator[Passage]:
    r"""Notches from center :math:`f_0` and lower cutoff :math:`f_1`: :math:`Q = f_0 f_1 / (f_0^2 - f_1^2)`."""
    for index in range(2):
        names = (f"gyro_notch_hz_{index}", f"gyro_notch_cutoff_{index}")
        if not all(settings.get(name, 0.0) > 0.0 for name in names):
            continue
        center_hz, cutoff_hz = (settings[name] for name in names)
        setting_words = " and ".join(f"{name} = {settings[name]:g}" for name in names)
        # Whole numbers of hertz: what is less is damage.
        if 1.0 <= cutoff_hz < center_hz < 0.5 * rate_hz:
            quality = center_hz * cutoff_hz / (center_hz**2 - cutoff_hz**2)
            yield built(setting_words, partial(notch, center_hz, quality, rate_hz))
        else:
            yield doubtful(f"{setting_words} make no notch at {rate_hz:g} Hz")


def _moving_notches(settings: Parameters) -> Iterator[Passage]:
    if whole(settings, "features") & DYNAMIC_FEATURE:
        yield moving("dynamic notch in features", settings["features"])
    # Without telemetry from the motors they have nothing to follow.
    if settings.get("dshot_bidir", 1.0) > 0.0:
        for name in _SPEED_NOTCHES:
            if settings.get(name, 0.0) > 0.0:
                yield moving(name, settings[name])


def _first(names: tuple[str, ...], settings: Parameters) -> str | None:
    return next((name for name in names if name in settings), None)
