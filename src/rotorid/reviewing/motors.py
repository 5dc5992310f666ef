r"""Motors of a flight: at their limits, their balance in steady flight, falling out of step, with how much left.

Steady flight is every second in which the vehicle hardly turns (rates below 0.25 rad/s rms, without vibration), stays
near level and near its usual thrust. There the mean outputs :math:`m_i` of the motors differ by what trims the vehicle:

.. math:: m_i - \bar m = a\,y_i + b\,x_i + c\,s_i

with the positions :math:`x, y` and the directions of rotation :math:`s` of the rotors. A center of gravity off the
middle asks for :math:`a` and :math:`b`, an arm or motor mount that is twisted for :math:`c`, a weak motor or a damaged
propeller for more output of that motor alone. Of a quadrotor the three together explain everything, so that the
pattern with the fewest parts is given, where it leaves less than a tenth of the squares.

One flight shows a pattern and no cause: healthy vehicles differ as much. Of ten public ones, from 30 g to 2 kg, the
largest difference from the mean is 3, 4, 5, 6, 6, 7, 11, 11, 12 and 36 %; by a lognormal spread 95 % of healthy
vehicles lie below 30 %, the limit of the card. A cause takes earlier flights of the same vehicle
(:mod:`rotorid.reviewing.baseline`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from types import MappingProxyType

import numpy as np

from rotorid.autopilots.advice import absence, logging_advice, motor_advice, speed_advice
from rotorid.data.display import counted, listed
from rotorid.data.findings import Finding, warn
from rotorid.data.quantities import COMPARE, QUANTITIES
from rotorid.data.quantity import TWO_SIDED_95, Quantity
from rotorid.data.record import LOWEST_RATE_HZ, FlightRecord, Intervals
from rotorid.data.response import FrequencyResponse
from rotorid.errors import InsufficientDataError
from rotorid.flights.hover import FEWEST_SECONDS, WINDOW_S, steady_windows, thrust_curve
from rotorid.flights.motor_balance import amplitudes, patterns_or_pairs, rotor_geometry
from rotorid.flights.motor_stamps import stamp_findings
from rotorid.flights.rotor_order import order_of_log
from rotorid.flights.weight_balance import weight_balance
from rotorid.flights.whole_flights import FlightData, flown, loop_response
from rotorid.reviewing.missing import Unavailable, section
from rotorid.reviewing.values import MotorReview
from rotorid.signal.airborne import within
from rotorid.signal.clock import even_step_s
from rotorid.signal.limits import MotorLimits
from rotorid.signal.motors import (
    MotorHistory,
    logged_outputs,
    logged_speeds,
    motor_limits,
    or_none,
)
from rotorid.typing import BoolArray, FloatArray

EXPLAINED = 0.9
"""Part of the squares that a named pattern must explain."""

EVEN = 0.08
"""Imbalance up to which motors are called balanced; beyond it, its pattern is given."""

_BIAS = 0.003
"""What outputs of one motor differ by from flight to flight, as a part of the range."""

_STEP, _WITHIN_S = 0.2, 0.05
"""A motor whose output rises by this share of its range while its speed falls by as much within this time lost step."""

_DELAY_BAND_RAD_S = (10.0, 80.0)
"""Where lag and delay from output to gyro are fitted."""

_LONGEST_LAG_S = 0.12
"""Lags of motors that are tried."""

_LAG_BIAS = 0.05
"""Damping of the rate looks like less delay; flights with a known answer differ by so much."""


def motors(record: FlightRecord, *, mass_kg: float | None = None) -> tuple[MotorReview, tuple[Unavailable, ...]]:
    """Limits, balance, headroom, loss of step, thrust coefficient, and the delay from output to gyro.

    Parameters
    ----------
    record
        The log.
    mass_kg
        Mass in flight; without it thrust coefficients are per kilogram.

    Raises
    ------
    InsufficientDataError
        The vehicle never flew, or the log does not show whether it did.
    """
    flight = flown(record)
    unavailable: list[Unavailable] = []
    none: dict[str, Quantity] = {}
    times: tuple[float, ...] = ()
    nothing: tuple[dict[str, Quantity], dict[str, Quantity], str, FloatArray | None] = (none, none, "", None)
    (numbers, means, pattern, patterns), missing = section("motors", partial(_outputs, record, flight), nothing)
    unavailable += missing
    events, unchecked = section("motors.events", partial(_events, record, flight.flights), times)
    unavailable += unchecked
    thrust, missing = section("motors.thrust_coefficient", partial(_thrust, record, flight.flights, mass_kg), none)
    numbers = {**numbers, **thrust}
    unavailable += missing
    delay, missing = section("motors.output_delay_s", partial(_delay, flight), none)
    numbers = {**numbers, **delay}
    unavailable += missing
    found = MotorReview(
        means=means,
        numbers=numbers,
        pattern=pattern,
        events=events,
        steps_checked=not unchecked,
        patterns=patterns,
    )
    order, missing = section("motors.rotor_order", partial(_rotor_order, record), _NO_FINDINGS)
    unavailable += missing
    stamps, missing = section("motors.stamps", lambda: (stamp_findings(record), ()), _NO_FINDINGS)
    unavailable += missing
    return replace(found, findings=(*_findings(found), *order, *stamps)), tuple(unavailable)


_NO_FINDINGS: tuple[Finding, ...] = ()


def _rotor_order(record: FlightRecord) -> tuple[tuple[Finding, ...], list[Unavailable]]:
    """What the order of the motors shows, where it was asked of this log."""
    order = order_of_log(record)
    if order is None:
        return (), []
    if order.verdict == "not enough data":
        return (), [Unavailable(what="motors.rotor_order", why=order.why, remedy=order.remedy)]
    return tuple(order.findings("motors")), []


def _outputs(
    record: FlightRecord, flight: FlightData
) -> tuple[tuple[dict[str, Quantity], dict[str, Quantity], str, FloatArray | None], list[Unavailable]]:
    """Limits, balance and headroom, the mean outputs in steady flight, their pattern, and all patterns over the rotors.

    The last is ``None`` where the rotors are not known.
    """
    unavailable: list[Unavailable] = []
    numbers: dict[str, Quantity] = {}
    means: dict[str, Quantity] = {}
    pattern, patterns = "", None
    limits = motor_limits(record)
    if not limits.counted.any():
        how = absence(record, "motor_1")
        why = f"Motor outputs are {how}{' in the air' * (how == 'not logged')}."
        unavailable.append(Unavailable(what="motors", why=why, remedy=motor_advice(record)))
    else:
        numbers |= _limits(record, limits)
        if limits.unknown:
            why = f"The log {limits.unknown}."
            unavailable += [Unavailable(what=f"motors.saturated_{end}_share", why=why) for end in ("high", "low")]
        time_s, outputs = limits.time_s[limits.counted], limits.outputs[:, limits.counted]
        steady = steady_windows(record, flight.flights, time_s, outputs, limits.limited[limits.counted])
        why, remedy = _not_compared(outputs), motor_advice(record)
        if not why and len(steady) < FEWEST_SECONDS:
            why = f"The log contains {len(steady) * WINDOW_S:.0f} s of quiet hover; {FEWEST_SECONDS} s are needed."
            remedy = "hover for 20 s without touching the sticks"
        if why:
            unavailable += [
                Unavailable(what=f"motors.{name}", why=why, remedy=remedy) for name in ("imbalance", "headroom")
            ]
        else:
            means, balance, pattern = _balance(record, outputs, steady)
            patterns, even = _amplitudes(record, outputs, steady)
            numbers |= balance | even
    return (numbers, means, pattern, patterns), unavailable


def _not_compared(outputs: FloatArray) -> str:
    """Why outputs in the air, shape ``(motors, n)``, say nothing of the balance; empty where they do."""
    if len(outputs) < 2:
        return "The output of only one motor is logged."
    still = [str(number) for number, row in enumerate(outputs, start=1) if np.ptp(row) == 0.0]
    if not still:
        return ""
    if len(still) == 1:
        return f"The output of motor {still[0]} never moves in flight."
    return f"The outputs of motors {listed(still)} never move in flight."


def _limits(record: FlightRecord, limits: MotorLimits) -> dict[str, Quantity]:
    """Share of the flight in which a motor is at a limit, of each motor and by the axis that asks for most."""
    if limits.unknown:
        return {}
    numbers = {
        "saturated_high_share": _share(limits, np.asarray(limits.upper.any(axis=0))),
        "saturated_low_share": _share(limits, np.asarray(limits.lower.any(axis=0))),
    }
    for motor, (above, below) in enumerate(zip(limits.upper, limits.lower, strict=True), start=1):
        numbers[f"motor_{motor}_high_share"] = _share(limits, above)
        numbers[f"motor_{motor}_low_share"] = _share(limits, below)
    commands = []
    for axis in ("roll", "pitch", "yaw", "thrust"):
        if f"{axis}_command" not in record:
            return numbers
        track = record[f"{axis}_command"]
        kept = np.isfinite(track.values)
        if not kept.any():
            return numbers
        values = np.interp(limits.time_s, track.time_s[kept], track.values[kept])
        commands.append(np.abs(values - (np.median(values) if axis == "thrust" else 0.0)))
    asking = np.argmax(np.stack(commands), axis=0)
    for place, axis in enumerate(("roll", "pitch", "yaw", "thrust")):
        numbers[f"saturated_by_{axis}_share"] = _share(limits, limits.limited & (asking == place))
    return numbers


def _share(limits: MotorLimits, samples: BoolArray) -> Quantity:
    """Share of the flight with the spread of its mean between tenths of it."""
    value, on = limits.of(samples), samples[limits.counted]
    parts = [float(np.mean(part)) for part in np.array_split(on, 10) if part.size]
    std = float(np.std(parts, ddof=1)) / math.sqrt(len(parts)) if len(parts) > 1 else 0.0
    # None in n samples still allows three in n, or three times as many as the detection of a limit needs.
    half = max(TWO_SIDED_95 * std, 3.0 * limits.fewest / on.size)
    return Quantity(value=value, std=std, lower=max(value - half, 0.0), upper=min(value + half, 1.0), unit="1")


def _balance(
    record: FlightRecord, outputs: FloatArray, steady: list[slice]
) -> tuple[dict[str, Quantity], dict[str, Quantity], str]:
    """Mean outputs in steady flight, the largest difference from their mean, headroom, and the pattern."""
    each = np.stack([outputs[:, window].mean(axis=1) for window in steady])
    usual = each.mean(axis=0)
    # Seconds that follow each other are alike: means over up to ten parts give the error of the mean.
    parts = np.stack([part.mean(axis=0) for part in np.array_split(each, min(10, max(len(steady) // 2, 2)))])
    std = np.hypot(parts.std(axis=0, ddof=1) / math.sqrt(len(parts)), _BIAS)
    means = {
        f"motor_{number}": Quantity.normal(float(value), float(error), "1")
        for number, (value, error) in enumerate(zip(usual, std, strict=True), start=1)
    }
    average = float(usual.mean())
    imbalance = (usual - average) / average
    worst = int(np.argmax(np.abs(imbalance)))
    error = float(std[worst]) / average
    numbers = {
        "imbalance": Quantity(
            value=float(abs(imbalance[worst])),
            std=error,
            lower=max(float(abs(imbalance[worst])) - TWO_SIDED_95 * error, 0.0),
            upper=float(abs(imbalance[worst])) + TWO_SIDED_95 * error,
            unit="1",
        ),
        "headroom": Quantity.normal(1.0 - float(usual.max()), float(std[int(np.argmax(usual))]), "1"),
    }
    positions, spins = rotor_geometry(record, usual.size)
    if positions is None or spins is None:
        return means, numbers, ""
    expo, least, most = thrust_curve(record)
    share = _thrust_share(usual, expo)
    # How strongly the thrust of a motor follows its output, there.
    slope = usual * ((1.0 - expo) + 2.0 * expo * usual) / np.maximum((1.0 - expo) * usual + expo * usual**2, 1e-6)
    noise = slope * std / average * share
    for name, arm in zip(("forward", "right"), positions.T, strict=True):
        # The center of gravity lies where the thrusts balance, in parts of the arm.
        offset = float(share @ arm)
        ends = [float(_thrust_share(usual, end) @ arm) for end in (least, most)]
        spread = math.hypot(float(np.sqrt(np.sum((noise * arm) ** 2))), float(np.ptp(ends)) / (2.0 * TWO_SIDED_95))
        numbers[f"center_of_gravity_{name}"] = Quantity.normal(offset, spread, "1")
    pattern = ""
    if float(abs(imbalance[worst])) > EVEN and numbers["imbalance"].lower > 0.5 * EVEN:
        pattern = imbalance_pattern(imbalance, positions, spins)
    if pattern == "one motor":
        # What one weak motor asks for would look like a center of gravity off the middle.
        numbers = {name: value for name, value in numbers.items() if not name.startswith("center_of_gravity")}
    return means, numbers, pattern


def _amplitudes(
    record: FlightRecord, outputs: FloatArray, steady: list[slice]
) -> tuple[FloatArray | None, dict[str, Quantity]]:
    """Patterns over the rotors, and the amplitude of each in steady flight with its random error."""
    patterns, names = patterns_or_pairs(record, outputs.shape[0])
    if patterns is None:
        return None, {}
    each = amplitudes(np.stack([outputs[:, window].mean(axis=1) for window in steady]), patterns)
    parts = np.stack([part.mean(axis=0) for part in np.array_split(each, min(10, max(len(steady) // 2, 2)))])
    stds = parts.std(axis=0, ddof=1) / math.sqrt(len(parts))
    found = zip(names, each.mean(axis=0), stds, strict=True)
    return patterns, {
        name: Quantity.normal(float(value), float(std), "1") for name, value, std in found if math.isfinite(value)
    }


def _thrust_share(outputs: FloatArray, expo: float) -> FloatArray:
    """Part of each motor in the thrust."""
    thrust = np.maximum((1.0 - expo) * outputs + expo * outputs**2, 1e-6)
    return np.asarray(thrust / thrust.sum())


def imbalance_pattern(imbalance: FloatArray, positions: FloatArray, spins: FloatArray) -> str:
    """Where the motors are that differ from the mean: ``one side``, ``diagonal``, ``one motor``, or none of these.

    Parameters
    ----------
    imbalance
        Differences from the mean, over the mean, shape ``(motors,)``.
    positions
        Forward and right, shape ``(motors, 2)``.
    spins
        +1 and -1, shape ``(motors,)``.

    Examples
    --------
    >>> x = np.array([[1.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0]])
    >>> s = np.array([1.0, 1.0, -1.0, -1.0])
    >>> imbalance_pattern(np.array([0.1, -0.1, 0.1, -0.1]), x, s), imbalance_pattern(0.1 * s, x, s)
    ('one side', 'diagonal')
    >>> imbalance_pattern(np.array([0.3, -0.1, -0.1, -0.1]), x, s)
    'one motor'
    """
    total = float(imbalance @ imbalance)
    if total <= 0.0:
        return ""
    centering = np.eye(imbalance.size) - 1.0 / imbalance.size
    explained = {
        "diagonal": _explained(imbalance, spins[:, None] - spins.mean()),
        "one motor": max(_explained(imbalance, centering[:, [motor]]) for motor in range(imbalance.size)),
        "one side": _explained(imbalance, positions - positions.mean(axis=0)),
    }
    # A side has two parts and explains more by chance; it comes last, and must explain alone what it does.
    named = max(explained, key=lambda name: explained[name] - (0.02 if name == "one side" else 0.0))
    return named if explained[named] > EXPLAINED * total else ""


def _explained(imbalance: FloatArray, columns: FloatArray) -> float:
    fitted = columns @ np.linalg.lstsq(columns, imbalance, rcond=None)[0]
    return float(fitted @ fitted)


def _events(record: FlightRecord, flights: Intervals) -> tuple[tuple[float, ...], list[Unavailable]]:
    what = "motors.events"
    remedy = speed_advice(record)
    outputs = or_none(logged_outputs, record)
    try:
        speeds = logged_speeds(record)
    except InsufficientDataError as error:
        return (), [Unavailable(what=what, why=error.reason, remedy=remedy)]
    if outputs is None:
        return (), [Unavailable(what=what, why="Motor outputs are not logged.", remedy=motor_advice(record))]
    if min(speeds.sample_rate_hz, outputs.sample_rate_hz) < LOWEST_RATE_HZ:
        why = (
            f"Motor speeds are logged at {speeds.sample_rate_hz:.0f} Hz and outputs at {outputs.sample_rate_hz:.0f} "
            f"Hz, too slow for a desync of less than 0.1 s."
        )
        return (), [Unavailable(what=what, why=why, remedy=remedy)]
    return _lost_step(speeds, outputs, flights), []


def _lost_step(speeds: MotorHistory, outputs: MotorHistory, flights: Intervals) -> tuple[float, ...]:
    """When an output rises by a fifth of its range while the speed falls by a fifth, within 50 ms.

    A motor with lag still slows down after its output fell, when that rises again already: that is no loss of step. So
    the output must not have been higher just before.
    """
    time_s = speeds.time_s[within(speeds.time_s, flights)]
    if time_s.size < 10 or time_s[-1] <= time_s[0]:
        return ()
    lag = max(round(_WITHIN_S / even_step_s(time_s)), 1)
    from scipy.ndimage import maximum_filter1d

    span = max(round(_LONGEST_LAG_S * 2.0 * lag / _WITHIN_S), 1)
    found: list[float] = []
    for speed, output in zip(speeds.values, outputs.values, strict=False):
        turns = np.interp(time_s, speeds.time_s, speed)
        asked = np.interp(time_s, outputs.time_s, output)
        falls = (turns[lag:] < (1.0 - _STEP) * turns[:-lag]) & (turns[:-lag] > 0.3 * float(np.median(turns)))
        size = max(float(np.percentile(asked, 99)), 0.2)
        rises = asked[lag:] - asked[:-lag] > _STEP * size
        before = maximum_filter1d(asked, span, origin=(span - 1) // 2, mode="nearest")
        reason = before[:-lag] > asked[:-lag] + 0.25 * _STEP * size
        # What went before the first samples is not known.
        reason[:span] = True
        found += time_s[:-lag][falls & rises & ~reason].tolist()
    times = np.sort(np.array(found))
    separate = np.concatenate([[True], np.diff(times) > 5.0 * _WITHIN_S]) if times.size else np.zeros(0, dtype=np.bool_)
    return tuple(times[separate].tolist())


def _thrust(
    record: FlightRecord, flights: Intervals, mass_kg: float | None
) -> tuple[dict[str, Quantity], list[Unavailable]]:
    """The thrust coefficient of a rotor, from the weight that it carries in steady flight."""
    balance = weight_balance(record, flights, mass_kg=mass_kg)
    name = "thrust_coefficient" if balance.kind == "speed" else "thrust_by_output"
    return {name if mass_kg is not None else f"{name}_per_mass": balance.coefficient}, []


def _delay(flight: FlightData) -> tuple[dict[str, Quantity], list[Unavailable]]:
    """From output to gyro: lag of the motors and all delays together, by the phase of command to rate."""
    what = "motors.output_delay_s"
    reasons = []
    for axis, rate in (("roll", "p"), ("pitch", "q")):
        how, instrument = flight.instrument(axis)  # type: ignore[arg-type]
        try:
            if not instrument:
                raise InsufficientDataError("The sticks did not move, so command and feedback cannot be separated")
            response = loop_response(
                flight,
                reference=f"{axis}_command",
                answer=rate,
                instrument=instrument,
                intervals=flight.during(how),
            )
        except InsufficientDataError as error:
            reasons.append(
                str(error.findings[0].message) if error.findings else str(error).partition(";")[0].rstrip(".") + "."
            )
            continue
        fitted = _lag_and_delay(response)
        if fitted is not None:
            return {"output_delay_s": Quantity.normal(*fitted, "s")}, []
        reasons.append("Command and rate are not coherent enough between 10 and 80 rad/s.")
    remedy = "move the roll stick quickly left and right for 30 s, and log commands and rates at 100 Hz or more"
    if missing := tuple(name for name in ("roll_command", "p") if name not in flight.record):
        remedy = logging_advice(flight.record, 0.0, missing)
    return {}, [Unavailable(what=what, why=reasons[0], remedy=remedy)]


def _lag_and_delay(response: FrequencyResponse) -> tuple[float, float] | None:
    r"""Sum of lag and delay with its standard deviation, from :math:`H = K e^{-s \tau} / ((s + d)(T s + 1))`.

    In :math:`\ln H` the gain, the damping (:math:`\ln(s + d) \approx \ln s + d/s`) and the delay are linear, so that
    they are solved for each lag of a grid. Lag and delay trade against each other; their sum does so much less.
    """
    omega, values = np.asarray(response.omega_rad_s), np.asarray(response.values).reshape(-1)
    error = np.asarray(response.random_error).reshape(-1)
    low, high = _DELAY_BAND_RAD_S
    kept = (omega >= low) & (omega <= high) & (error < 0.2) & (error > 0.0) & np.isfinite(np.abs(values))
    if np.count_nonzero(kept) < 6 or omega[kept].max() < 2.0 * omega[kept].min():
        return None
    omega, error = omega[kept], np.tile(error[kept], 2)
    phase = np.unwrap(np.angle(values[kept])) + 0.5 * np.pi
    # A command whose sign is turned around moves the phase by half a turn.
    phase = phase - np.pi * np.round(phase[0] / np.pi)
    size = np.log(np.abs(values[kept]) * omega)
    none, one = np.zeros(omega.size), np.ones(omega.size)
    columns = np.stack([np.r_[one, none], np.r_[none, 1.0 / omega], np.r_[none, -omega]], axis=1) / error[:, None]
    lags = np.linspace(0.0, _LONGEST_LAG_S, 121)
    targets = np.concatenate(
        [
            size[:, None] + 0.5 * np.log1p(np.square(np.outer(omega, lags))),
            phase[:, None] + np.arctan(np.outer(omega, lags)),
        ]
    )
    targets = targets / error[:, None]
    solved = np.linalg.lstsq(columns, targets, rcond=None)[0]
    misfit = np.sum(np.square(targets - columns @ solved), axis=0)
    misfit[solved[2] < 0.0] = np.inf
    best = int(np.argmin(misfit))
    if not np.isfinite(misfit[best]):
        return None
    inflation = max(1.0, float(misfit[best]) / max(2 * omega.size - 4, 1))
    likely = misfit <= misfit[best] + inflation
    total = lags + solved[2]
    variance = float(np.linalg.inv(columns.T @ columns)[2, 2]) * inflation
    std = math.hypot(math.sqrt(variance), 0.5 * float(np.ptp(total[likely])), _LAG_BIAS * float(total[best]))
    return (float(total[best]), std) if std < 0.5 * total[best] else None


POSSIBLE_CAUSES: Mapping[str, str] = MappingProxyType(
    {
        "one side": "the center of gravity or weak rotors on that side",
        "diagonal": "a twisted arm, unlike propellers or yaw trim",
        "one motor": "its propeller, its motor or several causes together",
        "": "the center of gravity, propellers, arms or trim",
    }
)
"""What a pattern of the mean outputs may come from, for a sentence."""


def possible_causes(pattern: str) -> str:
    """What a pattern may come from, and how to find out, as a sentence."""
    return f"Could be {POSSIBLE_CAUSES[pattern]}; {COMPARE}."


def _findings(review: MotorReview) -> Iterator[Finding]:
    numbers = review.numbers
    high = numbers.get("saturated_high_share")
    if high is not None and high.value > QUANTITIES["saturated_high_share"].limit:
        message = f"A motor was at its upper limit for {100.0 * high.value:.1f} % of the flight."
        yield warn("saturation", "motors", message, saturated_share=high.value)
    imbalance = numbers.get("imbalance")
    row = QUANTITIES["imbalance"]
    if imbalance is not None and row.judged(imbalance) == "look":
        message = f"One motor's hover output differs by {row.shown(imbalance)} from the mean; {row.scale('good')}. "
        message += possible_causes(review.pattern)
        yield warn("motor_imbalance", "motors", message, imbalance=imbalance.value)
    if review.events:
        message = (
            f"A motor slowed down while its output rose, {counted(len(review.events), 'time')}, first at "
            f"{review.events[0]:.2f} s: probably a desync. Check the timing and the wiring of its ESC."
        )
        yield warn("motor_out_of_step", "motors", message, events=len(review.events), first_s=review.events[0])
