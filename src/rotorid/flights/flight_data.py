"""From logs to records of whole flights: motors, all axes of the sensors, velocity and attitude on one clock.

Motors, rotors, filters and battery are read as for ``physical.motors`` (:mod:`rotorid.flights.motor_data`). What is
added: the stretches are those in the air, whatever was flown in them, because air shows in fast flight and not in
excitations; and velocity over ground and attitude where the log has them. A velocity that never changes comes from an
estimator without aid, and counts as not logged.

Stamps are compared once more: measured speeds against the gyro (:mod:`rotorid.flights.motor_stamps`), of which the skew
goes into the fit. Of outputs, the skew contains the lag of the motors, so that only differences between logs are one.
A log whose motors have no relation to its motion is refused. A velocity that is surely late is moved ahead
(:mod:`rotorid.flights.velocity_stamps`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rotorid.autopilots.advice import logging_advice
from rotorid.data.axes import ATTITUDE, RATES
from rotorid.data.findings import Finding, refusal
from rotorid.data.quantity import Quantity
from rotorid.data.record import LOWEST_RATE_HZ, FlightRecord, Intervals, Maneuver, MotorRecord, places
from rotorid.errors import InsufficientDataError, ModelError, nearest_name
from rotorid.fitting.flight.motion import VelocityClass, velocity_class
from rotorid.flights.flights import Flight, longest_flight, never_flew
from rotorid.flights.motor_data import Channels, MotorData, Reading, Stretches, given_stretches, motor_data
from rotorid.flights.motor_stamps import motor_skew
from rotorid.flights.segments import is_logged
from rotorid.flights.supports import SHORTEST_FLIGHT_S
from rotorid.flights.velocity_stamps import prompt_velocity
from rotorid.models.flight import AIR_DENSITY_KG_M3, FLIGHT_PARAMETERS, Airframe
from rotorid.models.rotors import RotorLayout
from rotorid.settings.motors import MotorSettings
from rotorid.signal.airborne import airborne
from rotorid.signal.clock import missing_channel
from rotorid.signal.kinematics import ACCELERATIONS, EARTH_VELOCITIES, VELOCITIES
from rotorid.signal.motors import Kind
from rotorid.units import STANDARD_GRAVITY_M_S2

_MARGIN_S = 1.0
_AT_ONCE_S, _RESTING_M_S, _LIFT_OFF_M_S = 0.1, 0.1, 0.5
"""A log begins with lift-off where it begins this soon, so slow, and climbs so fast within the margin."""
"""Left out after take-off and before landing, where the ground carries a part of the weight."""

USUAL_DISC_SHARE = 0.8
"""Diameter of a rotor over the distance to its nearest neighbor: .7 to .85 on vehicles of 30 g to 2 kg."""

USUAL_DISC_LOADING_N_M2 = 75.0
"""Weight over the area of the discs, where the mass is not known: 40 to 145 on vehicles of 30 g to 2 kg."""

_STILL_M_S = 1e-6


class GivenAirframe(NamedTuple):
    """An airframe before a fit, and what of it is an assumption.

    Parameters
    ----------
    airframe
        With 1 kg where the mass is not known; its discs are then as large as a kilogram usually needs, because only
        thrust over disc counts.
    scaled
        Whether the mass is known.
    disc_assumed
        Whether nobody gave the diameter of the rotors.
    """

    airframe: Airframe
    scaled: bool
    disc_assumed: bool

    @property
    def diameter_m(self) -> float:
        """Of a rotor."""
        return 2.0 * math.sqrt(self.airframe.disc_m2 / math.pi)


class FlightMotion(NamedTuple):
    """Data for a fit of the physics of flight.

    Parameters
    ----------
    motors
        Stretches of all logs, whose records have specific force along all axes, and velocity and attitude where they
        were logged.
    given
        The airframe before the fit.
    skews_s
        For each stretch by how much the stamps of the motors are earlier than those of the gyro.
    """

    motors: MotorData
    given: GivenAirframe
    skews_s: tuple[float, ...]

    @property
    def records(self) -> tuple[MotorRecord, ...]:
        """Motors, rates, specific force, velocity and attitude of the stretches."""
        return self.motors.records

    @property
    def layout(self) -> RotorLayout:
        """The rotors."""
        return self.motors.layout

    @property
    def kind(self) -> Kind:
        """What the motors are known by."""
        return self.motors.kind

    @property
    def flights(self) -> tuple[Flight, ...]:
        """Logs and what of them was used."""
        return self.motors.flights

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Remarks on the way from the logs."""
        return self.motors.findings

    @property
    def response(self) -> None:
        """None was measured."""

    @property
    def velocity(self) -> VelocityClass:
        """How the velocity over ground can be had in all stretches."""
        return velocity_class(self.records)

    @property
    def sources(self) -> Mapping[str, str]:
        """Where motors and velocity come from."""
        found = dict(self.motors.sources)
        if self.velocity == "measured":
            flight = self.flights[0]
            names = velocity_channels(flight.record, flight.maneuver)
            found["velocity"] = places(next(flight.record.holding(name)) for name in names if name not in ATTITUDE)
        return found


def flight_data(
    records: Sequence[FlightRecord],
    choices: MotorSettings,
    *,
    reference_v: float | None = None,
    layout: RotorLayout | None = None,
) -> FlightMotion:
    """Every flight of every log on one clock.

    Parameters
    ----------
    records, choices, reference_v, layout
        As for :func:`rotorid.flights.motor_data.motor_data`; ``choices.known`` may hold the mass.

    Raises
    ------
    InsufficientDataError
        A log lacks motors, rotors, gyros or accelerometer, or has them too slowly, no flight lasts 10 s, or nobody
        knows the size of the vehicle.
    UsageError
        Logs are of different vehicles, or of motors of different kind, or no given segment lies inside one.
    """
    prompt = [prompt_velocity(record) for record in records]
    motors = motor_data(
        [record for record, _ in prompt],
        choices,
        reference_v=reference_v,
        layout=layout,
        reading=Reading(flown_stretches, _channels),
    )
    _require_rates(motors)
    skews_s, unknown = _skews(motors)
    late = [finding for _, findings in prompt for finding in findings]
    motors = motors._replace(findings=(*motors.findings, *late, *unknown))
    return FlightMotion(motors, given_airframe(motors.layout, choices), skews_s)


def _require_rates(motors: MotorData) -> None:
    """Refuse motors, gyros and accelerometers that are slower than motors act."""
    records = {id(flight.record): flight.record for flight in motors.flights}.values()
    for record, history in zip(records, motors.histories, strict=True):
        sensors_hz = min(record.rate_hz(name) for name in (*RATES, *ACCELERATIONS))
        for what, rate_hz, names in (
            ("motors", history.sample_rate_hz, ("motor_1",)),
            ("gyros or accelerometers", sensors_hz, ACCELERATIONS),
        ):
            if rate_hz < LOWEST_RATE_HZ:
                came = f"the {what} of {record.source.name} are logged at {rate_hz:.0f} Hz"
                raise InsufficientDataError(
                    came,
                    needed=f"{LOWEST_RATE_HZ:.0f} Hz or more, to see how they move the vehicle",
                    remedy=logging_advice(record, rate_hz, names),
                    findings=[refusal("rate_too_low", what, f"{came[:1].upper()}{came[1:]}."), *motors.findings],
                )


_OF_MOTORS_S = 0.003
"""Difference of skews between logs from which stamps differ, and not the lag of the motors."""

_SURE = 3.0


def _skews(motors: MotorData) -> tuple[tuple[float, ...], tuple[Finding, ...]]:
    """For each stretch the skew of its log, and warnings on logs whose motors move too little to show one.

    Raises
    ------
    InsufficientDataError
        The motors of a log have no relation to its motion.
    """
    late: dict[int, Quantity] = {}
    unknown: list[Finding] = []
    for record, spans in given_spans(motors.flights):
        try:
            late[id(record)] = motor_skew(record, motors.layout, intervals=spans).late_s
        except InsufficientDataError as error:
            if any(finding.kind == "motor_stamps" for finding in error.findings):
                raise
            # Motors that were logged slowly have a warning of their own.
            unknown += [replace(found, severity="warning") for found in error.findings if found.kind == "no_excitation"]
    skews_s = {key: each.value for key, each in late.items()}
    if motors.kind != "speed":
        usual_s = float(np.median(list(skews_s.values()))) if skews_s else 0.0
        skews_s = {
            key: each.value - usual_s
            for key, each in late.items()
            if abs(each.value - usual_s) > max(_OF_MOTORS_S, _SURE * each.std)
        }
    logs = {(flight.record.source.name, flight.maneuver.start_s): id(flight.record) for flight in motors.flights}
    keys = (logs.get((stretch.record.name, stretch.maneuver.start_s)) for stretch in motors.stretches)
    return tuple(skews_s.get(key, 0.0) if key is not None else 0.0 for key in keys), tuple(unknown)


def given_spans(flights: Sequence[Flight]) -> list[tuple[FlightRecord, Intervals]]:
    """Each log once with the segments that were given for it; without any, as whole flights count for every command."""
    logs = {id(flight.record): flight.record for flight in flights}.values()
    return [
        (
            log,
            tuple(
                (flight.maneuver.start_s, flight.maneuver.stop_s)
                for flight in flights
                if flight.record is log and flight.maneuver.origin == "given"
            ),
        )
        for log in logs
    ]


def given_airframe(layout: RotorLayout, choices: MotorSettings) -> GivenAirframe:
    """The airframe that layout and choices describe.

    Raises
    ------
    InsufficientDataError
        The size of the vehicle is not known.
    ModelError
        A known value is not one of this model, or is impossible.

    Examples
    --------
    >>> from rotorid.models.rotors import library_layout
    >>> given = given_airframe(library_layout("quad.x").scaled(0.25), MotorSettings(known={"m": 1.5}))
    >>> round(given.diameter_m, 3), given.disc_assumed
    (0.283, True)
    """
    known = choices.known
    for name, value in known.items():
        if name not in FLIGHT_PARAMETERS:
            near = nearest_name(name, FLIGHT_PARAMETERS)
            raise ModelError(
                f"there is no parameter {name}",
                needed=f"one of {', '.join(FLIGHT_PARAMETERS)}",
                remedy=f"did you mean {near}?" if near else "",
            )
        if name in ("m", "I_xx", "I_yy", "I_zz", "kappa", "T_motor") and not value > 0.0:
            raise ModelError(f"the known {name} = {value:g} is not possible", needed="a positive number")
    if {"kappa", "I_zz"} <= set(known):
        raise ModelError("both kappa and I_zz are given as known", needed="one of them, which gives the other")
    if not layout.arm_known:
        message = f"The log does not show the size of {layout.name}, on which the air at each rotor depends."
        raise InsufficientDataError(
            f"the size of {layout.name} is not known",
            needed="the distance from the center of gravity to the farthest rotor",
            remedy="measure it and give --arm METERS",
            findings=[refusal("not_identifiable", "arm", message)],
        )
    mass = known.get("m")
    if mass is None:
        disc_m2 = STANDARD_GRAVITY_M_S2 / (layout.rotors * USUAL_DISC_LOADING_N_M2)
    else:
        diameter_m = choices.rotor_diameter_m or USUAL_DISC_SHARE * neighbor_distance(layout)
        disc_m2 = 0.25 * math.pi * diameter_m**2
    airframe = Airframe(
        positions=layout.positions,
        spins=layout.spins,
        mass_kg=1.0 if mass is None else mass,
        disc_m2=disc_m2,
        density_kg_m3=AIR_DENSITY_KG_M3,
    )
    return GivenAirframe(airframe, mass is not None, mass is None or choices.rotor_diameter_m is None)


def neighbor_distance(layout: RotorLayout) -> float:
    """Distance of the two closest rotors that do not share an axis, in the unit of the positions.

    Examples
    --------
    >>> from rotorid.models.rotors import library_layout
    >>> round(neighbor_distance(library_layout("quad.x").scaled(0.25)), 3)
    0.354
    """
    flat = layout.positions[:, :2]
    distances = np.hypot(*(flat[:, None, :] - flat[None, :, :]).transpose(2, 0, 1))
    apart = distances[distances > 1e-3 * layout.arm]
    return float(apart.min()) if apart.size else 2.0 * layout.arm


def flown_stretches(record: FlightRecord, choices: MotorSettings) -> Stretches:
    """The given segments; else the flights of 10 s and more, without take-off and landing.

    Raises
    ------
    InsufficientDataError
        No flight lasts so long.
    """
    if choices.segments:
        return given_stretches(record, choices), []
    flights = [(start_s, stop_s) for start_s, stop_s in _in_air(record) if stop_s - start_s >= SHORTEST_FLIGHT_S]
    if not flights:
        name = record.source.name
        message = f"No flight of {name} lasts {SHORTEST_FLIGHT_S:.0f} s."
        raise InsufficientDataError(
            message.rstrip("."),
            needed=f"{SHORTEST_FLIGHT_S:.0f} s in the air",
            remedy="fly longer, or name a stretch with --segment",
            findings=[refusal("record_too_short", name, message)],
        )
    return [
        Maneuver(axis="thrust", kind="other", start_s=start_s, stop_s=stop_s, origin="found")
        for start_s, stop_s in flights
    ], []


def _in_air(record: FlightRecord) -> Sequence[tuple[float, float]]:
    """Flights without their ends; the whole record where nothing shows take-off or landing."""
    try:
        found = airborne(record, margin_s=_MARGIN_S)
    except InsufficientDataError as error:
        if never_flew(error):
            raise
        return (longest_flight(record),)
    flights = found.intervals if found.by_thrust else ((record.start_s, record.stop_s),)
    return tuple((_off_the_ground(record, start_s), stop_s) for start_s, stop_s in flights)


def _off_the_ground(record: FlightRecord, start_s: float) -> float:
    """The start of a flight, later by the margin where the log begins with lift-off: at rest, and climbing at once.

    The ground turns the vehicle as no motor does.
    """
    if start_s - record.start_s > _AT_ONCE_S or any(name not in record.channel_names for name in EARTH_VELOCITIES):
        return start_s
    tracks = [record[name] for name in EARTH_VELOCITIES]
    moving = [track.values[np.abs(track.time_s - start_s) <= _MARGIN_S] for track in tracks]
    if any(values.size == 0 for values in moving):
        return start_s
    resting = float(np.linalg.norm([values[0] for values in moving])) < _RESTING_M_S
    return start_s + _MARGIN_S if resting and -float(moving[2].min()) > _LIFT_OFF_M_S else start_s


def velocity_channels(record: FlightRecord, stretch: Maneuver) -> tuple[str, ...]:
    """Channels that give the velocity in body axes, with the attitude where it is needed; empty where none does."""
    for names in (VELOCITIES, (*EARTH_VELOCITIES, *ATTITUDE)):
        if all(is_logged(record, name, stretch.start_s, stretch.stop_s) for name in names) and _moves(
            Flight(record, stretch), names
        ):
            return names
    return ()


def _moves(flight: Flight, names: Sequence[str]) -> bool:
    """Whether a velocity takes more than one value."""
    of_speed = [name for name in names if name not in ATTITUDE]
    spans = (np.ptp(samples.values) for name in of_speed for samples in flight.samples(name) if samples.values.size)
    return any(span > _STILL_M_S for span in spans)


def _channels(record: FlightRecord, stretch: Maneuver) -> Channels:
    measured = (*RATES, *ACCELERATIONS)
    for name in measured:
        if name not in record.channel_names:
            raise missing_channel(record, name, logging_advice(record, 0.0, (name,)))
    of_velocity = velocity_channels(record, stretch)
    attitude = all(is_logged(record, name, stretch.start_s, stretch.stop_s) for name in ATTITUDE)
    turned = ATTITUDE if attitude else ()
    wanted = (*measured, *(VELOCITIES if of_velocity else ()), *turned)
    return Channels(measured, tuple(dict.fromkeys((*of_velocity, *turned))), wanted)
