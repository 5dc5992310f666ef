"""What spoils a fit of flight physics, and what to do about it: one message and one remedy for each.

The motors are numbered in another order (:mod:`rotorid.flights.rotor_order` says which), out of step with the gyro, too
slowly logged or still; wind and accelerometer bias cannot be separated; the velocity comes late. The first four leave
no answer, so that they are errors; the others leave one with a warning.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from rotorid.autopilots.advice import logging_advice, motor_advice, slow_motor_advice
from rotorid.data.findings import Finding, refusal, warn
from rotorid.data.quantity import Quantity, milliseconds
from rotorid.data.record import LOWEST_RATE_HZ, FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.models.flight import QUARTER_TURN_RAD

LATE_S = 0.05
"""Delay of the velocity that costs 2 % of drag."""

_SURE = 3.0


def motors_out_of_step(
    record: FlightRecord, correlation: Mapping[str, float], far_s: float | None
) -> InsufficientDataError:
    """The error of motors that have no relation to the motion.

    Parameters
    ----------
    correlation
        Axis to the largest correlation of the torque of the motors with the angular acceleration.
    far_s
        Skew at which they do have one; ``None`` where none does.
    """
    values = " and ".join(f"{value:.2f} in {axis}" for axis, value in correlation.items())
    came = f"the motors of {record.source.name} do not explain its motion (correlation {values})"
    numbers = {f"correlation_{axis}": value for axis, value in correlation.items()}
    if far_s is None:
        remedy = "check how the two were joined, or fly quicker roll and pitch movements"
    else:
        order = "after" if far_s > 0.0 else "before"
        came = f"{came}, but they do {abs(far_s):.2f} s {order}"
        remedy = f"delay the stamps of the motors by {far_s:.2f} s"
        numbers["late_s"] = far_s
    return _refused("motor_stamps", "motors", came, "motors and gyro on one clock", remedy, numbers)


def logged_too_slowly(record: FlightRecord, what: str, rate_hz: float) -> InsufficientDataError:
    """The error of motors or rates that were logged more slowly than they act.

    Parameters
    ----------
    what
        Channel, or ``motors``.
    rate_hz
        Its rate; zero where it is not logged.
    """
    missing = (what,) if rate_hz <= 0.0 and what != "motors" else ()
    came = f"{record.source.name} has no {what}" if missing else f"{what} are logged at {rate_hz:.0f} Hz"
    kind = "missing_channel" if missing else "rate_too_low"
    if what != "motors":
        remedy = logging_advice(record, rate_hz, missing)
    else:
        remedy = slow_motor_advice(record, rate_hz) if rate_hz > 0.0 else motor_advice(record)
    needed = f"motors and rates at {LOWEST_RATE_HZ:.0f} Hz or more"
    return _refused(kind, what, came, needed, remedy, {"rate_hz": rate_hz})


def motors_still(record: FlightRecord, band_hz: tuple[float, float]) -> InsufficientDataError:
    """The error of motors that do not move in a band."""
    came = f"the motors of {record.source.name} do not move between {band_hz[0]:g} and {band_hz[1]:g} Hz"
    remedy = "move the roll and pitch sticks quickly"
    return _refused("no_excitation", "motors", came, "motors that turn the vehicle", remedy, {})


def motors_explain_too_little(
    record: FlightRecord, correlation: Mapping[str, float], needed: float
) -> InsufficientDataError:
    """The error of motors that act on the motion, but less than gusts and noise do."""
    values = " and ".join(f"{value:.2f} in {axis}" for axis, value in correlation.items())
    came = f"the motors of {record.source.name} explain too little of its motion (correlation {values})"
    numbers = {f"correlation_{axis}": value for axis, value in correlation.items()}
    remedy = "fly quicker roll and pitch movements"
    return _refused("no_excitation", "motors", came, f"a correlation of {needed:g} in one axis", remedy, numbers)


def wind_or_bias(turned_rad: float, where: str) -> tuple[Finding, ...]:
    """A warning where the heading turned too little to separate wind from a bias of the accelerometer.

    Parameters
    ----------
    turned_rad
        Range of the heading in flight.
    """
    if turned_rad >= QUARTER_TURN_RAD:
        return ()
    message = (
        f"The heading turned by {math.degrees(turned_rad):.0f}°; {math.degrees(QUARTER_TURN_RAD):.0f}° are needed to "
        "separate wind from accelerometer bias, which counts as zero. Fly both ways, or turn once while hovering."
    )
    return (warn("wind_or_bias", where, message, turned_rad=turned_rad),)


def velocity_late(delay_s: Quantity, where: str) -> tuple[Finding, ...]:
    """A warning where the velocity surely comes later than the motion, and by enough to change drag.

    Parameters
    ----------
    delay_s
        Of the velocity after acceleration and attitude.
    """
    if abs(delay_s.value) < max(LATE_S, _SURE * delay_s.std):
        return ()
    order = "after" if delay_s.value > 0.0 else "before"
    message = (
        f"The velocity comes {milliseconds(abs(delay_s.value), delay_s.std)} ms {order} the motion. The fit moves it "
        "by so much; log the velocity of the estimator, or of motion capture, with its own stamps."
    )
    return (warn("velocity_late", where, message, delay_s=delay_s.value, std_s=delay_s.std),)


def _refused(
    kind: str, where: str, came: str, needed: str, remedy: str, numbers: Mapping[str, float]
) -> InsufficientDataError:
    message = f"{came[0].upper()}{came[1:]}. {remedy[0].upper()}{remedy[1:]}." if remedy else f"{came}."
    return InsufficientDataError(
        came, needed=needed, remedy=remedy, findings=[refusal(kind, where, message, **numbers)]
    )
