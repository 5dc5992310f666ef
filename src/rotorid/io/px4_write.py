"""A simulated flight as the log that PX4 would have written of it.

What a topic holds stands in `rotorid.io.px4_topics`, the table that reads it too; how PX4 lays it out and how often it
logs it, in `rotorid.io.px4_layouts`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from rotorid.data.simulated_flight import SimulatedFlight
from rotorid.errors import UsageError
from rotorid.io.mapping_keys import nearest
from rotorid.io.px4_layouts import DEBUG_PROFILE, INTEGERS, LAYOUTS, PROFILE, Layout
from rotorid.io.px4_topics import ALL_RULES, Rule
from rotorid.io.ulog_write import LoggedTopic, message_dtype, write_ulog
from rotorid.typing import AnyArray, FloatArray, IntArray

_INFORMATION: Mapping[str, str | int] = {
    "sys_name": "PX4",
    "ver_hw": "ROTORID_SIM",
    # Major, minor and patch, then the kind of release: zero is one under development.
    "ver_sw_release": 1 << 24 | 17 << 16,
}
_THRUST = Rule(topic="", fields=("thrust_body[2]",), channels=("thrust_command",), sign=-1.0)
_MOTORS = 12
_LARGEST = float(np.finfo(np.float32).max)


def write_px4(
    path: Path, flown: SimulatedFlight, *, rates_hz: Mapping[str, float] | None = None, start_s: float = 30.0
) -> None:
    r"""Write a simulated flight as a ULog file, as PX4 with ``SDLOG_PROFILE = 57`` would have logged it.

    A topic is written when the flight has channels of it, one that holds an attitude when it has all three angles;
    components that the flight does not have are not numbers, as in PX4. Samples are picked, not averaged: message
    :math:`i` of a topic is the first turn of the control loop at or after :math:`i / r`, so that a rate :math:`r` that
    divides that of the loop gives even steps, and any other is kept on average. Stamps of sampling and of publication
    are the same. Test inputs, for which PX4 has no topic, are in ``debug_vect`` (roll, pitch, yaw) and
    ``debug_key_value`` (thrust) under the name `rotorid.io.px4_topics.EXCITATION`.

    What the flight does not have, the log does not invent: no flight mode, no landed flags, no position on Earth. It
    calls its hardware ``ROTORID_SIM``.

    Parameters
    ----------
    path
        File to write or replace.
    flown
        A flight of PX4's controller, or of a simple one.
    rates_hz
        Topic to messages in a second, for those that are to differ from `rotorid.io.px4_layouts.LAYOUTS`; above the
        rate of the loop every turn is logged.
    start_s
        Time since boot at the zero of the flight's own clock.

    Raises
    ------
    UsageError
        A value is not a number in single precision, the flight is one of ArduPilot or has more than twelve motors, a
        topic or a rate is unknown, a whole-numbered parameter is none, stamps fall below zero, nothing is there to be
        logged, or the place cannot be written. Nothing is written then.

    Examples
    --------
    >>> import tempfile
    >>> from rotorid.io.registry import read
    >>> flown = SimulatedFlight(vehicle="demo", autopilot="px4", sample_rate_hz=4.0, time_s=[0.0, 0.25],
    ...                         columns={"p": [0, 0.5]})
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_px4(Path(folder) / "flight.ulg", flown)
    ...     record = read(Path(folder) / "flight.ulg")
    >>> record.source.firmware, record.topics[0].name, record.topics[0].time_s.tolist()
    ('PX4 1.17.0 (development)', 'vehicle_angular_velocity', [30.0, 30.25])
    """
    if flown.autopilot == "ardupilot" or f"motor_{_MOTORS + 1}" in flown.columns:
        raise UsageError(
            f"a flight of {flown.vehicle} with {flown.autopilot} came, which PX4 cannot have logged",
            needed=f"PX4's controller or a simple one, and at most {_MOTORS} motors",
            remedy="write a DataFlash log or a CSV",
        )
    rates = _rates(rates_hz or {})
    stamps = _stamps(flown, start_s)
    topics = [topic for layout in LAYOUTS for topic in _logged(flown, layout, stamps, rates[layout.topic])]
    if not topics:
        raise UsageError(
            f"the flight of {flown.vehicle} holds no channel that PX4 logs",
            needed="commands, rates, attitude or position",
        )
    debug = any(topic.name.startswith("debug_") for topic in topics)
    parameters = {"SDLOG_PROFILE": float(PROFILE + DEBUG_PROFILE * debug), **flown.parameters}
    write_ulog(
        path,
        topics,
        parameters={name: _typed(name, value) for name, value in parameters.items()},
        information=_INFORMATION,
    )


def _rates(asked: Mapping[str, float]) -> dict[str, float | None]:
    rates = {layout.topic: layout.rate_hz for layout in LAYOUTS}
    for topic, rate_hz in asked.items():
        if topic not in rates:
            close = nearest(topic, rates)
            raise UsageError(
                f"the topic {topic} came, which is not written",
                needed=f"one of {', '.join(rates)}",
                remedy=f"did you mean {close}?" if close else "",
            )
        if not rate_hz > 0.0:
            raise UsageError(f"{rate_hz:g} Hz came for {topic}", needed="a positive rate")
        rates[topic] = rate_hz
    return rates


def _stamps(flown: SimulatedFlight, start_s: float) -> IntArray:
    """Microseconds since boot."""
    stamps = np.rint((flown.time_s + start_s) * 1e6)
    if not (stamps.size and np.isfinite(stamps).all() and stamps[0] >= 0.0 and np.all(np.diff(stamps) > 0.0)):
        raise UsageError(
            f"the flight of {flown.vehicle} has {flown.samples} stamps that cannot be those of a log",
            needed="finite ones from zero up, at least a microsecond apart",
            remedy="" if flown.samples else "simulate at least one turn of the control loop",
        )
    return stamps.astype(np.int64)


def _logged(flown: SimulatedFlight, layout: Layout, stamps: IntArray, rate_hz: float | None) -> Iterator[LoggedTopic]:
    """The topic, when the flight has channels of it."""
    held = flown.raw if layout.raw else flown.columns
    dtype = message_dtype(layout.fields)
    own = [rule for rule in ALL_RULES if rule.topic == layout.topic and _fits(rule, dtype)]
    rules = [rule for rule in own if _is_held(rule, held)]
    if not rules:
        return
    if rules[0].named:
        # A topic holds one message a turn: what is added behind the controllers goes first.
        rules = rules[:1]
    turns = _turns(flown, rate_hz)
    samples = _blank(layout, dtype, turns.size, 1e6 / flown.sample_rate_hz)
    for clock in {"timestamp", "timestamp_sample"} & set(dtype.names or ()):
        samples[clock] = stamps[turns]
    if rules[0].named:
        field, name = rules[0].named
        samples[field] = name.encode()
    for flag, channel in layout.flags.items():
        samples[flag] = channel in held
    for rule in (*rules, *([_THRUST] if _fits(_THRUST, dtype) else [])):
        for field, values in _values(rule, _picked(rule, held, turns, flown)):
            _column(samples, field)[:] = values
    yield LoggedTopic(name=layout.topic, layout=layout.fields, samples=samples)


def _fits(rule: Rule, dtype: np.dtype[np.void]) -> bool:
    return all(field.partition("[")[0] in (dtype.names or ()) for field in rule.fields)


def _is_held(rule: Rule, held: Mapping[str, FloatArray]) -> bool:
    present = [name in held for name in rule.channels]
    return all(present) if _is_attitude(rule) else any(present)


def _is_attitude(rule: Rule) -> bool:
    return len(rule.channels) < len(rule.fields)


def _turns(flown: SimulatedFlight, rate_hz: float | None) -> IntArray:
    """Turns of the control loop that are logged."""
    every = 1.0 if rate_hz is None else max(flown.sample_rate_hz / rate_hz, 1.0)
    # A step that is whole but for rounding must not be rounded up to the next turn.
    turns: IntArray = np.ceil(np.arange(int(flown.samples / every) + 1) * every - 1e-6).astype(np.int64)
    return turns[turns < flown.samples]


def _blank(layout: Layout, dtype: np.dtype[np.void], rows: int, period_us: float) -> AnyArray:
    """Rows without channels: floating-point numbers that are none, other zeros, and what is fixed."""
    row: AnyArray = np.zeros(1, dtype=dtype)
    for name in dtype.names or ():
        if dtype[name].base.kind == "f":
            row[name] = np.nan
        elif name.endswith("_integral_dt"):
            row[name] = round(period_us)
    for field, value in layout.fixed.items():
        _column(row, field)[:] = value
    return np.repeat(row, rows)


def _column(samples: AnyArray, field: str) -> AnyArray:
    """The part of the rows that a field such as ``xyz[2]`` is."""
    name, _, place = field.rstrip("]").partition("[")
    column: AnyArray = samples[name][:, int(place)] if place else samples[name]
    return column


def _picked(
    rule: Rule, held: Mapping[str, FloatArray], turns: IntArray, flown: SimulatedFlight
) -> dict[str, FloatArray]:
    """Channels of a rule that the flight has, at the turns that are logged; a number that is none is refused."""
    picked: dict[str, FloatArray] = {}
    for name in rule.channels:
        if name in held:
            wrong = np.flatnonzero(~(np.abs(held[name]) <= _LARGEST))
            if wrong.size:
                first = wrong[0]
                raise UsageError(
                    f"{name} of the flight of {flown.vehicle} is {held[name][first]:g} at {flown.time_s[first]:g} s",
                    needed="numbers that single precision can hold",
                    remedy="look at what diverged in the simulation",
                )
            picked[name] = held[name][turns]
    return picked


def _values(rule: Rule, picked: Mapping[str, FloatArray]) -> Iterator[tuple[str, FloatArray]]:
    """Fields of a rule and their values."""
    if _is_attitude(rule):
        yield from zip(rule.fields, _quaternion(*(picked[name] for name in rule.channels)), strict=True)
        return
    for field, name in zip(rule.fields, rule.channels, strict=True):
        if name in picked:
            yield field, picked[name] * rule.sign


def _quaternion(phi: FloatArray, theta: FloatArray, psi: FloatArray) -> FloatArray:
    """Body to earth, rows w, x, y, z, of yaw–pitch–roll angles: what `rotorid.frames.euler_from_quaternion` undoes."""
    (cr, sr), (cp, sp), (cy, sy) = ((np.cos(half), np.sin(half)) for half in (0.5 * phi, 0.5 * theta, 0.5 * psi))
    return np.stack(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ]
    )


def _typed(name: str, value: float) -> float | int:
    """A parameter in the type that PX4 has it in."""
    if not re.fullmatch(INTEGERS, name):
        return float(value)
    if not float(value).is_integer():
        raise UsageError(f"the parameter {name} = {value:g} came", needed="a whole number, which it is in PX4")
    return int(value)
