r"""The flight as a whole: what flew, when, on which battery, in which modes; and how it was logged.

Internal resistance comes from volts against amperes: with slow discharge taken out by a running mean over 20 s,

.. math:: \Delta V = -R \, \Delta I

Thrust over weight follows from the throttle of hover where the autopilot knows the motors' curve (ArduPilot's ``ThO``
is linear in thrust, so that the ratio is its inverse) or where the usual curve is known (PX4). Elsewhere it is the
largest specific force at full throttle, if the vehicle made less at lower throttle: thrust of a rotor falls as it
climbs, so that full throttle in a steady climb makes one weight and shows no ratio. Thrust grows with the throttle at
least in proportion, hence the most thrust is at least :math:`f/u` of the specific force f at throttle u. Drag is
that of :mod:`rotorid.flights.tilt_drag`, and so is the wind where drag is found.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from rotorid.autopilots.advice import (
    absence,
    channel_advice,
    gap_advice,
    logging_advice,
    motor_advice,
    raw_gyro_advice,
    speed_advice,
    wind_advice,
)
from rotorid.autopilots.px4.versions import firmware_shown, topic_of
from rotorid.autopilots.registry import autopilot_of, writer_of
from rotorid.data.display import capital, listed
from rotorid.data.quantity import TWO_SIDED_95, Quantity
from rotorid.data.record import FlightRecord, Intervals
from rotorid.errors import InsufficientDataError, ModelError
from rotorid.flights.hover import FEWEST_SECONDS, hover_of, thrust_curve
from rotorid.flights.same_vehicle import frame_of
from rotorid.flights.tilt_drag import TiltDrag, tilt_drag
from rotorid.models.autopilots.layouts import layout_of
from rotorid.reviewing.missing import Unavailable, section
from rotorid.reviewing.values import FlightSummary, LoggingReview, VehicleReview
from rotorid.reviewing.yaw_drift import yaw_drift
from rotorid.signal.airborne import airborne, in_air
from rotorid.signal.battery import battery_voltages
from rotorid.signal.clock import even_step_s
from rotorid.signal.dead_sensors import CHECK_SENSORS, dead_accelerometer
from rotorid.signal.motors import linearization_of, logged_outputs, or_none
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

GOOD_RATE_HZ = 250.0
"""Rate from which rates and commands show the loops of small multirotors; those of large ones need less."""

LONG_GAP = 3.0
"""Steps of a topic from which a pause is a gap."""

_TREND_S = 20.0
"""Changes that are slower do not enter the resistance of the battery."""

_BLOCK_S = 10.0
"""Gaps of the battery that are longer are not interpolated."""

_LEAST_CURRENT_A = 0.5
"""A current that seldom exceeds this counts as not logged."""

_LEAST_CORRELATION = 0.3
"""Least correlation of voltage and current for a resistance."""

_PUNCH_S = 0.1
"""Length over which the specific force at full throttle is averaged."""

_FULL = 0.9
"""Throttle that counts as full."""

_LOW, _NEAR_WEIGHT = 0.15, 0.15
"""Throttle from which specific force is compared with that at full throttle, where it is within this of the weight."""

_WIDEST_TURN_DEG = 90.0
"""Standard deviation of the direction of a wind from which it is not known."""

_COMPARED_S = 2.0
"""Flight at lower throttle that a comparison needs."""


def vehicle(record: FlightRecord) -> tuple[VehicleReview, tuple[Unavailable, ...]]:
    """The vehicle of a log, and what the log does not say of it."""
    history = or_none(logged_outputs, record)
    frame, source = frame_of(record)
    count = history.motors if history is not None else None
    if count is None:
        try:
            count = int(layout_of(record).positions.shape[0])
        except (InsufficientDataError, ModelError):
            count = None
    unavailable = []
    if not record.status.vehicle:
        why = "The log does not name the kind of vehicle. A multirotor is assumed."
        unavailable.append(Unavailable(what="vehicle.kind", why=why))
    if not frame:
        unavailable.append(Unavailable(what="vehicle.frame", why=f"The log does not name the frame{source}."))
    found = VehicleReview(
        autopilot=writer_of(record).name or record.source.format,
        firmware=record.source.firmware,
        kind=record.status.vehicle,
        frame=frame,
        motors=count,
    )
    return found, tuple(unavailable)


def flight(record: FlightRecord) -> tuple[FlightSummary, tuple[Unavailable, ...]]:
    """Flights, battery, throttle of hover, thrust over weight, drag, wind, yaw drift and modes.

    Raises
    ------
    InsufficientDataError
        The vehicle never flew, or the log does not show whether it did.
    """
    found = airborne(record)
    flights = found.intervals
    unavailable: list[Unavailable] = []
    none: dict[str, Quantity] = {}
    neither: tuple[Quantity | None, Quantity | None] = (None, None)
    battery, missing = section("flight.battery", partial(_battery, record, flights), none)
    unavailable += missing
    (hover, ratio), missing = section("flight.thrust_to_weight", partial(_thrust, record, flights), neither)
    unavailable += missing
    found_drag: TiltDrag | None = None
    found_drag, missing = section("flight.drag", lambda: (tilt_drag(record, flights), ()), found_drag)
    unavailable += missing
    wind, missing = section("flight.wind", partial(_wind, record, flights, found_drag), none)
    unavailable += missing
    yaw, missing = section("flight.yaw", partial(yaw_drift, record, flights), none)
    unavailable += missing
    modes = _modes(record, flights)
    if not modes:
        unavailable.append(Unavailable(what="flight.modes", why="Flight modes are not logged."))
    if hover is not None and (volts := _mean_voltage(record, flights)):
        # Without compensation, thrust follows output times voltage.
        battery["hover_output_v"] = Quantity.normal(volts * hover.value, volts * hover.std, "V")
    summary = FlightSummary(
        flights=flights,
        seen_in=found.seen_in,
        battery=battery,
        hover_throttle=hover,
        thrust_to_weight=ratio,
        wind=wind,
        drag={} if found_drag is None else _drag_numbers(found_drag),
        yaw=yaw,
        modes=modes,
        findings=() if found_drag is None else found_drag.findings(),
    )
    return summary, tuple(unavailable)


def _mean_voltage(record: FlightRecord, flights: Intervals) -> float:
    """In the air; zero where it is not logged, or where the autopilot takes it out of its outputs."""
    known = linearization_of(record)
    if known is not None and known.compensates_voltage:
        return 0.0
    time_s, volts = in_air(record, "battery_voltage", flights)
    return float(np.mean(volts)) if time_s.size > 10 else 0.0


def _battery(record: FlightRecord, flights: Intervals) -> tuple[dict[str, Quantity], list[Unavailable]]:
    numbers = dict(battery_voltages(record, flights))
    if not numbers:
        how = absence(record, "battery_voltage")
        why = f"Battery voltage is {how}{' in the air' if how == 'not logged' else ''}."
        remedy = channel_advice(record, "battery_voltage", "turn on the battery monitor")
        return {}, [Unavailable(what="flight.battery", why=why, remedy=remedy)]
    time_s, volts = in_air(record, "battery_voltage", flights)
    stamps, amperes = in_air(record, "battery_current", flights)
    if stamps.size < 20 or float(np.percentile(amperes, 90)) < _LEAST_CURRENT_A:
        why = "Battery current is not logged."
        remedy = channel_advice(record, "battery_current", "turn on the current sensor")
        return numbers, [Unavailable(what="flight.battery.resistance_ohm", why=why, remedy=remedy)]
    found = _resistance(time_s, volts, stamps, amperes)
    if found is None:
        why = "Current and voltage did not change together."
        return numbers, [
            Unavailable(what="flight.battery.resistance_ohm", why=why, remedy="raise the throttle a few times")
        ]
    numbers["resistance_ohm"] = found
    mean = float(np.mean(amperes))
    numbers["sag_v"] = Quantity(
        value=found.value * mean, std=found.std * mean, lower=found.lower * mean, upper=found.upper * mean, unit="V"
    )
    return numbers, []


def _resistance(time_s: FloatArray, volts: FloatArray, stamps: FloatArray, amperes: FloatArray) -> Quantity | None:
    """Volts per ampere of the fast changes, on ten samples a second, with the spread between parts of the flight."""
    first_s, last_s = max(time_s[0], stamps[0]), min(time_s[-1], stamps[-1])
    # In blocks that have samples: between flights a log may be silent for years.
    blocks = np.unique(np.floor((stamps[stamps >= first_s] - first_s) / _BLOCK_S))
    clock = first_s + np.add.outer(_BLOCK_S * blocks, np.arange(0.0, _BLOCK_S, 0.1)).ravel()
    clock = clock[clock < last_s]
    if clock.size < 100:
        return None
    pair: FloatArray = np.stack([_averaged(clock, time_s, volts), _averaged(clock, stamps, amperes)])
    size = round(_TREND_S / 0.1)
    from scipy.ndimage import uniform_filter1d

    moves = np.asarray(pair - uniform_filter1d(pair, min(size, clock.size // 2), axis=1, mode="nearest"))
    spread = [float(row.std()) for row in moves]
    if spread[1] < 0.02 * max(float(np.mean(pair[1])), _LEAST_CURRENT_A) or spread[0] == 0.0:
        return None
    if float(np.mean(moves[0] * moves[1])) > -_LEAST_CORRELATION * spread[0] * spread[1]:
        return None
    # Noise of the current makes the slope too flat, noise of the voltage the inverse one too steep: the resistance
    # lies between them, and their distance is no random error.
    flat = -float(moves[0] @ moves[1]) / float(moves[1] @ moves[1])
    steep = -float(moves[0] @ moves[0]) / float(moves[0] @ moves[1])
    value = flat
    parts = [
        -float(v @ i) / float(i @ i)
        for v, i in zip(*(np.array_split(row, 8) for row in moves), strict=True)
        if float(i @ i) > 0.05 * float(moves[1] @ moves[1])
    ]
    std = float(np.std(parts, ddof=1)) / math.sqrt(len(parts)) if len(parts) > 2 else 0.3 * value
    std = math.hypot(std, 0.03 * value)
    upper = max(value + TWO_SIDED_95 * std, min(steep, 1.5 * value))
    return Quantity(value=value, std=std, lower=max(value - TWO_SIDED_95 * std, 0.0), upper=upper, unit="Ω")


def _averaged(clock: FloatArray, time_s: FloatArray, values: FloatArray) -> FloatArray:
    """Means over a tenth of a second where the log is faster, straight lines where it is slower."""
    if time_s.size < 15 * clock.size / 10:
        return np.interp(clock, time_s, values)
    total: FloatArray = np.concatenate([[0.0], np.cumsum(values)])
    first, last = np.searchsorted(time_s, clock - 0.05), np.searchsorted(time_s, clock + 0.05)
    count = last - first
    means = (total[last] - total[first]) / np.maximum(count, 1)
    return np.asarray(np.where(count > 0, means, np.interp(clock, time_s, values)))


_HOVER = "hover for 20 s without touching the sticks"
_NO_HOVER = "The log contains no acceleration, and too little quiet hover for its thrust curve."
_NO_CURVE = "The log contains neither the thrust curve nor the acceleration."


def _thrust(
    record: FlightRecord, flights: Intervals
) -> tuple[tuple[Quantity | None, Quantity | None], list[Unavailable]]:
    """Throttle of hover in steady seconds, and thrust over weight."""
    found = hover_of(record, flights)
    if found is None:
        why = "Neither thrust nor motors are logged."
        remedy, parts = motor_advice(record), ("hover_throttle", "thrust_to_weight")
        return (None, None), [Unavailable(what=f"flight.{part}", why=why, remedy=remedy) for part in parts]
    unavailable: list[Unavailable] = []
    if found.hovering is None:
        why = f"The log contains {found.steady_s} s of quiet hover; {FEWEST_SECONDS} s are needed."
        unavailable.append(Unavailable(what="flight.hover_throttle", why=why, remedy=_HOVER))
    ratio, why = _thrust_to_weight(record, flights, found.hovering, found.time_s, found.throttle)
    if ratio is None:
        dead = dead_accelerometer(record)
        remedy = "raise the throttle to full for half a second in a safe climb"
        remedy = CHECK_SENSORS if dead and why.startswith(dead) else remedy
        remedy = {_NO_HOVER: _HOVER, _NO_CURVE: "log the accelerometer"}.get(why, remedy)
        unavailable.append(Unavailable(what="flight.thrust_to_weight", why=why, remedy=remedy))
    return (found.hovering, ratio), unavailable


def _thrust_to_weight(
    record: FlightRecord, flights: Intervals, hover: Quantity | None, time_s: FloatArray, throttle: FloatArray
) -> tuple[Quantity | None, str]:
    curved = linearization_of(record) is not None and "thrust_command" in record
    if curved and hover is not None and hover.value > 0.02:
        return _by_hover(record, hover), ""
    if weightless := dead_accelerometer(record):
        return None, f"{weightless}."
    stamps, az = in_air(record, "az", flights)
    if stamps.size < 50 or time_s.size < 20:
        return None, _NO_HOVER if curved and hover is None else _NO_CURVE
    # Of stamps in bursts most steps are far shorter than the samples are apart.
    step_s = even_step_s(stamps)
    size = min(max(round(_PUNCH_S / step_s), 1), stamps.size)
    force = np.convolve(-az / STANDARD_GRAVITY_M_S2, np.full(size, 1.0 / size), mode="same")
    asked = np.interp(stamps, time_s, np.convolve(throttle, np.full(3, 1.0 / 3.0), mode="same"))
    full = force[asked >= _FULL]
    if full.size < size:
        most, long_s = float(np.max(asked)), full.size * step_s
        demand_words = (
            f"was above {100.0 * _FULL:.0f} % for only {long_s:.2g} s"
            if full.size
            else f"never exceeded {100.0 * most:.0f} %"
        )
        return None, f"Throttle {demand_words}."
    value = float(np.percentile(full, 90))
    lower = (asked > _LOW) & (asked < _FULL) & (np.abs(force - 1.0) < _NEAR_WEIGHT)
    if np.count_nonzero(lower) * step_s >= _COMPARED_S:
        least = float(np.median(force[lower] / asked[lower]))
        if least > value:
            return None, (
                f"Full throttle was flown in a climb, which takes thrust: {value:.1f} times the weight. "
                f"{100.0 * float(np.median(asked[lower])):.0f} % throttle carries the weight too, so full thrust is "
                f"more than {least:.1f} times the weight."
            )
    # Airspeed reduces thrust: a hovering vehicle has more.
    return Quantity(value=value, std=0.1 * value, lower=0.9 * value, upper=1.5 * value, unit="1"), ""


def _by_hover(record: FlightRecord, hover: Quantity) -> Quantity:
    """The most thrust over that of hover, by the curve of the motors."""
    expo, least, most = (0.0, 0.0, 0.0)
    if autopilot_of(record).log.thrust_demand:
        expo, least, most = thrust_curve(record)

    def ratio(throttle: float, curve: float) -> float:
        return 1.0 / ((1.0 - curve) * throttle + curve * throttle**2)

    value = ratio(hover.value, expo)
    # The thrust curve of an autopilot's settings is uncertain by about a tenth.
    std = math.hypot(ratio(hover.value, most) - ratio(hover.value, least), 0.4 * value) / (2.0 * TWO_SIDED_95)
    std = math.hypot(std, value * hover.std / hover.value)
    lower, upper = value - TWO_SIDED_95 * std, value + TWO_SIDED_95 * std
    return Quantity(value=value, std=std, lower=min(max(lower, 1.0), value), upper=upper, unit="1")


def _drag_numbers(found: TiltDrag) -> dict[str, Quantity]:
    """Figures of ``drag``; those of the square only where it is there for sure."""
    numbers = {"drag_1_s": found.drag}
    if found.at_rest is not None and found.quadratic is not None and found.quadratic.lower > 0.0:
        numbers |= {"drag_at_rest_1_s": found.at_rest, "quadratic_drag_1_m": found.quadratic}
    return {**numbers, "top_speed_m_s": found.top_speed()}


def _wind(
    record: FlightRecord, flights: Intervals, drag: TiltDrag | None
) -> tuple[dict[str, Quantity], list[Unavailable]]:
    """Wind by drag and tilt, else as the autopilot estimates it."""
    if drag is not None and drag.wind_north is not None and drag.wind_east is not None:
        north, east = drag.wind_north, drag.wind_east
        return _wind_numbers(north.value, east.value, math.hypot(north.std, east.std) / math.sqrt(2.0)), []
    _, northward = in_air(record, "wind_north", flights)
    _, eastward = in_air(record, "wind_east", flights)
    if northward.size < 5 or northward.size != eastward.size or not (np.any(northward) or np.any(eastward)):
        why = "The log contains no wind estimate."
        return {}, [Unavailable(what="flight.wind", why=why, remedy=wind_advice(record))]
    # An estimator's own error is about this large; the spread of its estimate contains gusts.
    std = math.hypot(0.5, float(np.hypot(np.std(northward), np.std(eastward))) / math.sqrt(10.0))
    return _wind_numbers(float(np.mean(northward)), float(np.mean(eastward)), std), []


def _wind_numbers(north_m_s: float, east_m_s: float, std: float) -> dict[str, Quantity]:
    """Speed, and the direction that the wind comes from, of a wind with one error along and across."""
    speed = math.hypot(north_m_s, east_m_s)
    direction = math.degrees(math.atan2(-east_m_s, -north_m_s)) % 360.0
    found = Quantity.normal(speed, std, "m/s")
    numbers = {"speed_m_s": replace(found, lower=max(found.lower, 0.0))}
    # A wind that may come from anywhere has no direction.
    if speed > 0.0 and (turn := math.degrees(std / speed)) < _WIDEST_TURN_DEG:
        numbers["direction_deg"] = Quantity.normal(direction, turn, "deg")
    return numbers


def _modes(record: FlightRecord, flights: Intervals) -> dict[str, float]:
    total = sum(stop - start for start, stop in flights)
    shares: dict[str, float] = {}
    for name, start_s, stop_s in record.status.modes:
        inside = sum(max(0.0, min(stop, stop_s) - max(start, start_s)) for start, stop in flights)
        if inside > 0.0 and total > 0.0:
            shares[name] = shares.get(name, 0.0) + inside / total
    return dict(sorted(shares.items(), key=lambda item: -item[1]))


_NEEDED: Mapping[str, float] = {
    "p": GOOD_RATE_HZ,
    "p_setpoint": GOOD_RATE_HZ,
    "roll_command": GOOD_RATE_HZ,
    "motor_1": 50.0,
    "roll_stick": 25.0,
    "phi": 50.0,
    "ax": GOOD_RATE_HZ,
    "battery_voltage": 1.0,
}

_PX4_TOPICS: Mapping[str, tuple[str, float]] = {
    "p": ("vehicle_angular_velocity", 1000.0),
    "p_setpoint": ("vehicle_rates_setpoint", 1000.0),
    "roll_command": ("vehicle_torque_setpoint", 1000.0),
    "thrust_command": ("vehicle_thrust_setpoint", 1000.0),
    "motor_1": ("actuator_motors", 1000.0),
    "roll_stick": ("manual_control_setpoint", 100.0),
    "phi": ("vehicle_attitude", 200.0),
    "phi_setpoint": ("vehicle_attitude_setpoint", 200.0),
    "ax": ("vehicle_acceleration", 1000.0),
    "u": ("vehicle_local_position", 100.0),
    "battery_voltage": ("battery_status", 10.0),
    "motor_speed_1": ("esc_status", 100.0),
    "p_raw": ("sensor_gyro_fifo", 8000.0),
}
"""Channel to PX4's topic and the highest rate at which it is published."""

_PX4_FIXED: Mapping[str, int] = {
    **dict.fromkeys(("vehicle_status", "vehicle_land_detected", "actuator_armed", "parameter_update"), 0),
    "vehicle_imu_status": 1000,
    "hover_thrust_estimate": 100,
}
"""Topics that are always logged, and their interval in milliseconds."""

_PX4_WANTED: Mapping[str, float] = {**_NEEDED, "thrust_command": GOOD_RATE_HZ, "phi_setpoint": 50.0}


def logging(record: FlightRecord) -> tuple[LoggingReview, tuple[Unavailable, ...]]:
    """Rates of all channels, the longest gap in flight, and what to change before the next one."""
    rates = {name: record[name].sample_rate_hz for name in record.channel_names}
    try:
        flights: Intervals = airborne(record).intervals
    except InsufficientDataError:
        flights = ((record.start_s, record.stop_s),)
    gap_s = 0.0
    for name in ("p", "roll_command", "p_setpoint", "ax"):
        for start_s, stop_s in flights if name in record else ():
            stamps, _ = in_air(record, name, ((start_s, stop_s),))
            steps = np.diff(stamps)
            longest = float(steps.max()) if steps.size else 0.0
            if steps.size and longest > LONG_GAP * float(np.median(steps)):
                gap_s = max(gap_s, longest)
    slow = {name: rates.get(name, 0.0) for name, needed in _NEEDED.items() if rates.get(name, 0.0) < 0.9 * needed}
    change = tuple(_changes(record, slow, gap_s))
    topics = logger_topics(record) if autopilot_of(record).log.topics_listed else ""
    unavailable = []
    loops = [name for name in ("p", "p_setpoint", "roll_command") if not rates.get(name, 0.0)]
    if loops:
        why = f"{listed(loops)} {'is' if len(loops) == 1 else 'are'} not logged."
        remedy = logging_advice(record, rates.get("p", 0.0), tuple(loops))
        unavailable.append(Unavailable(what="logging.rates", why=why, remedy=remedy))
    return LoggingReview(rates_hz=rates, longest_gap_s=gap_s, change=change, topics=topics), tuple(unavailable)


def _changes(record: FlightRecord, slow: Mapping[str, float], gap_s: float) -> Iterator[str]:
    """Sentences with the settings to change, the most important first."""
    loop = [name for name in ("p", "p_setpoint", "roll_command", "ax") if name in slow]
    if loop:
        rate_hz = min(slow[name] for name in loop)
        if autopilot_of(record).log.fields_chosen:
            missing = tuple(name for name in loop if name not in record.channel_names)
            reason = f"{', '.join(missing)} not logged" if missing else f"Rates are logged at {rate_hz:.0f} Hz"
            advice = logging_advice(record, rate_hz, missing)
            yield f"{reason}: {advice}." if advice else f"{reason}."
        else:
            advice = logging_advice(record, rate_hz)
            if autopilot_of(record).log.topics_listed:
                rates = ", ".join(f"{name} {slow[name]:.0f} Hz" for name in loop)
                yield f"{rates}: {advice}; or put logger_topics.txt into etc/logging of the SD card."
            else:
                yield f"{advice[0].upper()}{advice[1:]}."
    if gap_s > 0.0:
        yield f"The longest gap in flight is {1e3 * gap_s:.0f} ms: {gap_advice(record)}."
    if "p_raw" not in record and (advice := raw_gyro_advice(record)).startswith("set "):
        yield f"{advice[0].upper()}{advice[1:]}, to log the gyro before its filters too."
    if not any(name.startswith("motor_speed_") for name in record.channel_names):
        yield f"{capital(speed_advice(record))}; they show which vibration the rotors cause."


def logger_topics(record: FlightRecord, *, wanted: Sequence[str] = ()) -> str:
    """Text of a ``logger_topics.txt`` that makes PX4 log what is missing or too slow, empty where nothing is.

    Each line is a topic and the interval in milliseconds, as PX4's logger reads them from ``etc/logging`` on the SD
    card. The file replaces the topics of ``SDLOG_PROFILE``, so it repeats those that the log already has.

    Parameters
    ----------
    record
        A PX4 log.
    wanted
        Channels to log as fast as they are published, in addition to the usual ones.

    Examples
    --------
    >>> from rotorid.data.record import Channel, Source, Topic
    >>> rates = Topic(name="vehicle_angular_velocity", time_s=np.arange(9) / 50.0, values=np.zeros((1, 9)),
    ...               channels=(Channel(name="p", unit="rad/s"),))
    >>> record = FlightRecord(source=Source(name="a.ulg", format="PX4 ULog", sha256=""), topics=(rates,))
    >>> logger_topics(record).splitlines()[:3]
    ['vehicle_angular_velocity 4', 'vehicle_rates_setpoint 4', 'vehicle_torque_setpoint 4']
    """
    rates = {name: record[name].sample_rate_hz for name in record.channel_names}
    needed = {**_PX4_WANTED, **{name: _PX4_TOPICS[name][1] for name in wanted if name in _PX4_TOPICS}}
    if all(rates.get(name, 0.0) >= 0.9 * rate for name, rate in needed.items()):
        return ""
    sources = (channel.source.partition("[")[0] for topic in record.topics for channel in topic.channels)
    firmware = firmware_shown(record.source.firmware, (*sources, *record.parameters))
    intervals_ms: dict[str, int] = {}
    for channel, (topic, fastest_hz) in _PX4_TOPICS.items():
        if channel not in needed and channel not in rates:
            continue
        rate_hz = min(max(needed.get(channel, 0.0), min(rates.get(channel, 0.0), fastest_hz)), fastest_hz)
        # An interval of zero is every message; whole milliseconds below half a step lose samples.
        interval_ms = 0 if rate_hz >= 1000.0 else math.floor(1000.0 / rate_hz)
        # Two topics of today may have been one of an older firmware, which then is logged as fast as the faster one.
        name = topic_of(topic, firmware)
        intervals_ms[name] = min(interval_ms, intervals_ms.get(name, interval_ms))
    intervals_ms |= {topic_of(topic, firmware): interval_ms for topic, interval_ms in _PX4_FIXED.items()}
    return "".join(f"{topic} {interval_ms}\n" for topic, interval_ms in intervals_ms.items() if topic)
