r"""Whether a mapping agrees with the numbers of its file, asked before anything is computed from them.

A unit that is wrong by a factor shows in the size of the numbers, or against another channel:

- Stamps must rise, by steps that a flight controller makes: 1 Hz to 10 kHz.
- A channel must be possible (:mod:`rotorid.data.ranges`), rates and tilt also within what vehicles do.
- Specific force is gravity in the mean of any flight, and on the ground: its median is :math:`g`, unless the vehicle
  falls.
- Angles are the integral of rates: where tilt is small, :math:`\dot\phi = p` and :math:`\dot\theta = q`, so the
  regression of one on the other has the slope one, and :math:`180/\pi` or its inverse where one is in degrees.

The first contradiction is refused, with the table of the mapping and with what fits. What cannot be decided passes:
later checks of sensors against each other look closer.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from rotorid.data.ranges import range_of
from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Topic, units_of
from rotorid.errors import UsageError
from rotorid.io.tables.mapping import ChannelMapping, MappedChannel, Series
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2, UNITS, factor_to, parse_unit

_SLOWEST_S, _FASTEST_S = 1.5, 1e-4
"""Steps of a clock between which a mapping is not doubted: GPS at 1 Hz to a gyro at 10 kHz."""
_SLOW_S, _LONGEST_S = 0.2, 4.0 * 3600.0
"""So slow, and longer than any flight, the stamps are milliseconds of a fast logger."""
_FEWEST_STEPS = 50
_MOST_FALLING = 0.1
_TIME_UNITS = ("s", "ms", "us", "ns")

_MOSTLY = 99.0
"""Percentile of the size of a channel that must be possible: single spikes are damage of the log."""
_FASTEST_RAD_S = 75.0
"""No gyro of a flight controller measures more; a flip at 2000 deg/s is 35."""
_MOST_TILT_RAD = {"phi": 2.2 * math.pi, "theta": 1.1 * math.pi}
_LIMITS: Mapping[str, float] = {
    **dict.fromkeys(("p", "q", "r", "p_setpoint", "q_setpoint", "r_setpoint"), _FASTEST_RAD_S),
    **_MOST_TILT_RAD,
    **{f"{name}_setpoint": bound for name, bound in _MOST_TILT_RAD.items()},
    **dict.fromkeys(("roll_command", "pitch_command", "yaw_command", "thrust_command"), 20.0),
}
"""Largest size of channels, in SI, where it is narrower than what screening leaves out."""

_DRIVES: Mapping[str, float] = {"V": 75.0, "us": 3000.0}
"""Volts and pulses that drive a motor: batteries of 18 cells, and the longest pulses of a servo."""

_SHARES = {0.01: 'unit = "%"', 1.0 / 65535.0: "scale = 1.52590218966964e-05", 1e-3: "scale = 0.001"}
_PULSE_RANGE = (850.0, 2200.0)

_GRAVITY_TOLERANCE = 0.15
_OF_GRAVITY = ("g", "m/s^2", "mg", "cm/s^2")
_CALM = 0.35
"""Spread of the specific force against its median from which it says nothing about gravity."""

_LEAST_CORRELATION = 0.8
_DEGREES = 180.0 / math.pi
_SAME = 0.25
_FEWEST_SAMPLES = 200
_PAIRS = (("phi", "p"), ("theta", "q"))


def require_agreement(record: FlightRecord, mapping: ChannelMapping) -> None:
    """Refuse a mapping that the numbers contradict.

    Parameters
    ----------
    record
        As the mapping made it, in SI, before impossible values are left out.
    mapping
        Its channels know which table of the file they come from.

    Raises
    ------
    UsageError
        A contradiction; the message names the table of the mapping, and the remedy what fits.
    """
    tables = {channel.name: channel for channel in mapping.channels}
    for came, needed, remedy in _contradictions(record, mapping, tables):
        raise UsageError(came, needed=needed, remedy=remedy)


Contradiction = tuple[str, str, str]


def _contradictions(
    record: FlightRecord, mapping: ChannelMapping, tables: Mapping[str, MappedChannel]
) -> Iterator[Contradiction]:
    if any(topic.time_s.size > _FEWEST_STEPS for topic in record.topics):
        yield from _twins(mapping)
    for topic in record.topics:
        yield from _clock(topic, mapping, tables)
    values = {channel.name: topic.values[row] for topic in record.topics for row, channel in enumerate(topic.channels)}
    for name, samples in values.items():
        if name in tables and samples.size:
            yield from _size(tables[name], samples)
    yield from _gravity(values, tables)
    for topic in record.topics:
        yield from _angles(topic, tables)


def _twins(mapping: ChannelMapping) -> Iterator[Contradiction]:
    """Two channels of the same quantity out of the same numbers."""
    known: dict[tuple[object, ...], MappedChannel] = {}
    for channel in mapping.channels:
        samples = channel.samples
        if channel.name not in STANDARD_UNITS or samples.derivative:
            continue
        place = (samples.source, samples.row, samples.column, samples.file, STANDARD_UNITS[channel.name])
        if (twin := known.setdefault(place, channel)) is not channel:
            yield (
                f"{channel.where} has `source` = {_quoted(samples)}, as {twin.where or twin.name} has",
                f"each column for one channel: {twin.name} and {channel.name} differ",
                f"correct the source of {channel.name} or of {twin.name}",
            )


def _clock(topic: Topic, mapping: ChannelMapping, tables: Mapping[str, MappedChannel]) -> Iterator[Contradiction]:
    """Stamps that do not rise, or rise by steps that no logger makes."""
    steps = np.diff(topic.time_s)
    series, where = _clock_of(topic, mapping, tables)
    if steps.size < _FEWEST_STEPS or series is None:
        return
    falling = int(np.count_nonzero(steps < 0.0))
    if falling > _MOST_FALLING * steps.size:
        yield (
            f"{where}: {falling} of {steps.size} steps of {_quoted(series)} fall",
            "stamps that rise",
            "name the column of the stamps as `time`",
        )
    mean_s = float(np.median(np.abs(steps[steps != 0.0]))) if np.any(steps) else 0.0
    endless = mean_s > _SLOW_S and mean_s * steps.size > _LONGEST_S
    if mean_s == 0.0 or (_FASTEST_S <= mean_s <= _SLOWEST_S and not endless):
        return
    unit = series.unit or "s"
    fitting = _fitting_clock(mean_s / parse_unit(unit).factor)
    if fitting and fitting != unit:
        yield (
            f"{where}: {_quoted(series)} in {unit} is a step of {mean_s:.4g} s between samples",
            f"steps of {_FASTEST_S:g} to {_SLOWEST_S:g} s, and a flight of hours at most",
            f'write unit = "{fitting}" for the stamps: {1.0 / _step_s(mean_s, unit, fitting):.4g} Hz',
        )


def _step_s(mean_s: float, unit: str, fitting: str) -> float:
    return mean_s / parse_unit(unit).factor * parse_unit(fitting).factor


def _fitting_clock(step: float) -> str:
    """The unit in which a step of the numbers is one of 5 Hz to 10 kHz; empty for none, the coarsest of several."""
    for unit in _TIME_UNITS:
        if 1e-4 <= step * parse_unit(unit).factor <= 0.2:
            return unit
    return ""


def _clock_of(topic: Topic, mapping: ChannelMapping, tables: Mapping[str, MappedChannel]) -> tuple[Series | None, str]:
    channel = next((tables[item.name] for item in topic.channels if item.name in tables), None)
    if channel is not None and channel.time is not None:
        return channel.time, channel.where or channel.name
    clock = mapping.clock
    return ((clock.time or clock.steps) if clock else None), f"{_file(channel)}[clock]"


def _file(channel: MappedChannel | None) -> str:
    file, colon, _ = channel.where.partition(": ") if channel is not None else ("", "", "")
    return file + colon


def _size(channel: MappedChannel, samples: FloatArray) -> Iterator[Contradiction]:
    """A channel whose size no vehicle has, where another unit makes it possible."""
    si = channel.si
    known = range_of(Channel(name=channel.name, unit=si)) or (math.inf,)
    bound = (
        _LIMITS.get(channel.name)
        or _DRIVES.get(si if channel.name.startswith("motor_") else "")
        or max(map(abs, known))
    )
    peak = float(np.percentile(np.abs(samples), _MOSTLY))
    if not bound < peak < math.inf:
        return
    written = channel.samples.unit or si
    fitting = _fitting_unit(peak / abs(_factor(channel.samples, si)), bound, written, channel, samples)
    yield (
        f"{channel.where} has `unit` = {written!r}, which makes {_quoted(channel.samples)} a peak of {peak:.4g} "
        f"{'' if si == '1' else si}".rstrip(),
        f"at most {bound:.4g}" + ("" if si == "1" else f" {si}"),
        f"write {fitting}" if fitting else "correct `source`, `unit` or `scale`",
    )


def _factor(samples: Series, si: str) -> float:
    return samples.scale * factor_to(si, samples.unit)


def _fitting_unit(number: float, bound: float, written: str, channel: MappedChannel, samples: FloatArray) -> str:
    """What to write so that numbers of such a size are possible; empty where nothing known does it."""
    si = channel.si
    bench = len(units_of(channel.name)) > 1
    if si == "1" or bench:
        raw = samples / _factor(channel.samples, si)
        low, high = (float(np.percentile(raw, share)) for share in (1.0, _MOSTLY))
        if _PULSE_RANGE[0] <= low < high <= _PULSE_RANGE[1]:
            share = "offset = -1000.0 and scale = 0.001"
            return f'unit = "us", or {share} for a share of 1000 to 2000 µs' if bench else share
        if bench and si != "1":
            return ""
        if bench and 1.0 < number <= _DRIVES["V"]:
            return 'unit = "V" for volts, or unit = "%" for percent'
        for factor, words in sorted(_SHARES.items(), reverse=True):
            if 0.05 < number * factor <= 1.2:
                return words
        return ""
    for unit in ("deg", "deg/s", "rpm", "mV", "cm", "mm", "cm/s", "mm/s", "g", *UNITS):
        known = UNITS[unit]
        if known.si == si and unit != written and number * known.factor <= bound and known.factor < 1.0:
            return f'unit = "{unit}"'
    return ""


def _gravity(values: Mapping[str, FloatArray], tables: Mapping[str, MappedChannel]) -> Iterator[Contradiction]:
    """Specific force whose median is gravity in another unit."""
    down = values.get("az")
    if down is None or "az" not in tables or down.size < _FEWEST_SAMPLES:
        return
    parts = [values[name] for name in ("ax", "ay", "az") if name in values and values[name].size == down.size]
    size = np.sqrt(np.sum(np.square(parts), axis=0))
    median = float(np.median(size))
    spread = float(np.subtract(*np.percentile(size, [75.0, 25.0])))
    if not 0.0 < median < math.inf or spread > _CALM * median:
        return
    channel = tables["az"]
    written = channel.samples.unit or "m/s^2"
    # A share of vehicles falls or rests upside down; only the factor between two units is a contradiction.
    if abs(abs(float(np.median(down))) / median - 1.0) >= _GRAVITY_TOLERANCE:
        return
    raw = median / parse_unit(written).factor
    off = {unit: abs(raw * parse_unit(unit).factor / STANDARD_GRAVITY_M_S2 - 1.0) for unit in (written, *_OF_GRAVITY)}
    # Thousandths of g and cm/s^2 differ by 2 %, so that the numbers of one fit the other as well.
    closest = min(_OF_GRAVITY, key=off.__getitem__)
    if off[written] >= _GRAVITY_TOLERANCE and off[closest] < _GRAVITY_TOLERANCE:
        yield (
            f"{channel.where} has `unit` = {written!r}, which makes {_quoted(channel.samples)} a specific force "
            f"of {median:.3g} m/s^2 at rest and in the mean of a flight",
            f"gravity, {STANDARD_GRAVITY_M_S2:.2f} m/s^2",
            f'write unit = "{closest}"',
        )


def _angles(topic: Topic, tables: Mapping[str, MappedChannel]) -> Iterator[Contradiction]:
    """Tilt that changes some 57 times as fast, or as slowly, as the rates say."""
    rows = {channel.name: row for row, channel in enumerate(topic.channels)}
    for angle, rate in _PAIRS:
        if angle not in rows or rate not in rows or rate not in tables:
            continue
        slope = _slope(topic.time_s, topic.values[rows[angle]], topic.values[rows[rate]])
        for factor, faster in ((_DEGREES, True), (1.0 / _DEGREES, False)):
            if slope is not None and abs(abs(slope) / factor - 1.0) < _SAME:
                yield from _one_in_degrees(angle, rate, tables, too_fast=faster)


def _slope(time_s: FloatArray, angle: FloatArray, rate: FloatArray) -> float | None:
    """Change of the angle for each unit of the integral of the rate; ``None`` where they do not go together."""
    steps = np.diff(time_s)
    if steps.size < _FEWEST_SAMPLES or not np.all(steps > 0.0):
        return None
    # Sums over many steps, so that noise and a coarse angle matter less: about a tenth of a second each.
    stride = max(1, round(0.1 / float(np.median(steps))))
    turned = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * steps)])
    change, expected = (values[stride:] - values[:-stride] for values in (angle, turned))
    # Half a turn in such a time is a wrap, not a motion.
    kept = np.abs(change) < (math.pi if float(np.percentile(np.abs(angle), _MOSTLY)) < 2.0 * math.pi else 180.0)
    change, expected = change[kept], expected[kept]
    power = float(change @ change) * float(expected @ expected)
    if not 0.0 < power < math.inf:
        return None
    together = float(change @ expected)
    return together / float(expected @ expected) if abs(together) > _LEAST_CORRELATION * math.sqrt(power) else None


def _one_in_degrees(
    angle: str, rate: str, tables: Mapping[str, MappedChannel], *, too_fast: bool
) -> Iterator[Contradiction]:
    """What to say of an angle and a rate of which one has the wrong unit."""
    held, moved = tables.get(angle), tables[rate]
    angle_unit = (held.samples.unit if held else "") or "rad"
    rate_unit = moved.samples.unit or "rad/s"
    if too_fast:
        # Either the angle is in degrees and called radians, or the rate in radians and called degrees.
        fits = [(held, "deg")] if angle_unit == "rad" else []
        fits += [(moved, "rad/s")] if rate_unit == "deg/s" else []
    else:
        fits = [(moved, "deg/s")] if rate_unit == "rad/s" else []
        fits += [(held, "rad")] if angle_unit == "deg" else []
    choices = [f'unit = "{unit}" in [{_table(channel)}]' for channel, unit in fits if channel is not None]
    yield (
        f"{moved.where}: {angle} changes {'57 times as fast as' if too_fast else '1/57 as fast as'} {rate} says",
        f"{rate} as the rate of {angle}: one of {rate_unit} and {angle_unit} is wrong",
        f"write {' or '.join(choices)}" if choices else "correct `unit` or `scale` of one of the two",
    )


def _table(channel: MappedChannel) -> str:
    return channel.where.partition("[")[2].removesuffix("]") or channel.name


def _quoted(series: Series) -> str:
    place = series.row if series.row is not None else series.column
    return repr(series.source) + ("" if place is None else f"[{place}]")
