"""Vehicles that fly fast in air that their rotors feel, and what is true of them in the names of the flight's physics.

Four vehicles of the library take the thrust of hover from their own numbers, and from here what nobody has published of
them: inflow, rotor drag, flapping, the place of the accelerometer, and on request what the ladder holds beyond. They
fly figures of eight, steps of speed and climbs from 0 to 12 m/s in wind, led by their own autopilots.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from rotorid.data.flight_plan import FlightPlan, PlannedInput, SimulatedFlight
from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, MotorRecord, Source, Status, Topic
from rotorid.excitation.sticks import everyday_stick
from rotorid.models.flight import Airframe
from rotorid.models.rotors import RotorLayout
from rotorid.simulation.flight_physics import flight_values, with_flight
from rotorid.simulation.multirotor_flight import Aircraft, fly_multirotor
from rotorid.simulation.wind import Wind
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2
from rotorid.vehicles.catalog import aircraft

Motors = Literal["outputs", "speeds"]
Terms = Literal["basic", "full"]

RATE_HZ = 250.0
MISSIONS = ("eights", "steps", "climbs", "slow")
FULL_RAD_S = {"x500": 950.0, "iris": 1000.0, "hummingbird": 720.6, "forward_quad": 1200.0}
DISC_M2 = {"x500": 0.0507, "iris": 0.0507, "hummingbird": 0.0324, "forward_quad": 0.0324}
"""Of propellers of ten and eight inches."""


class Air(NamedTuple):
    """What is set by hand for a vehicle.

    Parameters
    ----------
    lost
        Share of the thrust in hover that inflow takes of the static thrust.
    drag_1_s
        Of all rotors in hover, over the mass.
    pitching_1_m_s
        Pitch acceleration by airspeed in hover that flapping makes.
    imu_m
        Place of the accelerometer.
    rotor_kg_m2
        Inertia of a rotor.
    lag_s
        Of the motors.
    """

    lost: float
    drag_1_s: float
    pitching_1_m_s: float
    imu_m: tuple[float, float, float]
    rotor_kg_m2: float
    lag_s: float


AIR: Mapping[str, Air] = {
    "x500": Air(0.26, 0.30, 1.2, (0.02, -0.008, -0.015), 4e-5, 0.030),
    "iris": Air(0.22, 0.36, 1.0, (-0.015, 0.01, 0.02), 3e-5, 0.035),
    "hummingbird": Air(0.28, 0.25, 1.5, (0.005, 0.008, -0.03), 2.2e-5, 0.024),
    "forward_quad": Air(0.24, 0.28, 1.1, (0.012, 0.0, 0.01), 2e-5, 0.045),
}


class Case(NamedTuple):
    """What flies where.

    Parameters
    ----------
    mission
        One of :data:`MISSIONS`; ``slow`` stays below 2 m/s.
    motors
        What is logged of them.
    wind
        To north and east, and gusts, m/s.
    terms
        ``full`` for more than drag, inflow and flapping.
    """

    vehicle: str
    mission: str = "eights"
    motors: Motors = "speeds"
    wind: tuple[float, float, float] = (0.0, 0.0, 0.2)
    terms: Terms = "basic"
    seed: int = 0
    duration_s: float = 60.0


class FlightTwin(NamedTuple):
    """A flight and what is true of it.

    Parameters
    ----------
    record
        As a log has it.
    motors
        The same as arrays; velocity and attitude are there, and may be taken out.
    frame, layout
        What its owner knows: mass, disc, places of the rotors about the center of gravity.
    truth
        By the names of :data:`rotorid.models.flight.FLIGHT_PARAMETERS`, in its units for what is logged of the motors.
    wind
        To north and east, m/s, the mean of what blew, gusts included.
    flight
        Everything, the true motion too.
    """

    record: FlightRecord
    motors: MotorRecord
    frame: Airframe
    layout: RotorLayout
    truth: Mapping[str, float]
    wind: tuple[float, float]
    flight: SimulatedFlight


@lru_cache
def craft_of(vehicle: str, motors: Motors, terms: Terms = "basic") -> tuple[Aircraft, Mapping[str, float]]:
    """A vehicle in moving air, and its numbers in units of what is logged of the motors."""
    stock, air, full = aircraft(vehicle), AIR[vehicle], FULL_RAD_S[vehicle] if motors == "speeds" else 1.0
    body, rotors = stock.vehicle, stock.vehicle.rotors
    weight_n = body.mass_kg * STANDARD_GRAVITY_M_S2 / rotors.layout.rotors
    # Thrust of the speed is a square; of the output it is the curve of the vehicle.
    curve = (0.0, 0.0, sum(rotors.thrust)) if motors == "speeds" else rotors.thrust
    # Of the full speed, whose square thrust is.
    share = float(np.sqrt(weight_n / sum(curve)))
    hover_m_s = float(np.sqrt(weight_n / (2.0 * 1.225 * DISC_M2[vehicle])))
    inflow = air.lost / (1.0 - air.lost) * sum(curve) * share / hover_m_s
    kappa = sum(rotors.torque_curve) / sum(rotors.thrust)
    values = {
        "m": body.mass_kg,
        **{f"c_{power}": curve[power] / (1.0 - air.lost) / full**power for power in range(3)},
        "c_lambda": inflow / full,
        "k_d": air.drag_1_s * body.mass_kg / (rotors.layout.rotors * share) / full,
        "T_motor": air.lag_s,
        "I_xx": float(body.inertia_kg_m2[0, 0]),
        "I_yy": float(body.inertia_kg_m2[1, 1]),
        "I_zz": float(body.inertia_kg_m2[2, 2]),
        "kappa": kappa * (1.0 - air.lost),
        "J_r": air.rotor_kg_m2 * FULL_RAD_S[vehicle] / full,
        "m_f": 2.0 * air.pitching_1_m_s * float(body.inertia_kg_m2[1, 1]) / (rotors.layout.rotors * share * full),
    }
    if terms == "full":
        values |= {
            "k_w": 0.15 * values["k_d"] * share * full / 10.0,
            "c_h": 0.3 * values["k_d"],
            "d_z": 0.004 * body.mass_kg,
            "kappa_lambda": 0.05 * kappa * weight_n / hover_m_s**2,
        }
    flying = with_flight(body, values, disc_m2=DISC_M2[vehicle], full=full)
    autopilot = stock.autopilot
    if vehicle == "forward_quad":
        autopilot = replace(autopilot, guidance=replace(aircraft("x500").autopilot.guidance, climb_p=0.1, climb_i=0.05))
    if autopilot.rate_hz != RATE_HZ:
        autopilot = replace(autopilot, rate_hz=RATE_HZ)
    guidance = replace(autopilot.guidance, tilt_limit_rad=0.8, stick_climb_m_s=3.0, stick_yaw_rate_rad_s=1.0)
    sensors = replace(
        stock.sensors,
        gyro_noise_rad_s=0.005,
        accelerometer_noise_m_s2=0.1,
        accelerometer_place_m=air.imu_m,
        velocity_noise_m_s=0.05,
        attitude_noise_rad=0.003,
    )
    truth = {**flight_values(flying, full=full), **values}
    truth |= dict(zip(("x_imu", "y_imu", "z_imu"), air.imu_m, strict=True))
    return Aircraft(vehicle=flying, autopilot=replace(autopilot, guidance=guidance), sensors=sensors), truth


def twin(case: Case) -> FlightTwin:
    """A flight."""
    craft, truth = craft_of(case.vehicle, case.motors, case.terms)
    speeds, plan = mission(case)
    north, east, gusts = case.wind
    wind = Wind(north_m_s=north, east_m_s=east, turbulence_m_s=gusts)
    flight = fly_multirotor(craft, plan, duration_s=case.duration_s, wind=wind, seed=case.seed, speed_m_s=speeds)
    vehicle = craft.vehicle
    layout = replace(vehicle.rotors.layout, name=vehicle.name, positions=vehicle.hubs_m)
    frame = Airframe(
        positions=vehicle.hubs_m, spins=layout.spins, mass_kg=vehicle.mass_kg, disc_m2=DISC_M2[case.vehicle]
    )
    columns = _logged(case, flight, np.random.default_rng([case.seed, 1]))
    blew = tuple(float(flight.truth[name].mean()) for name in ("wind_north", "wind_east"))
    return FlightTwin(
        record=_record(case, columns),
        motors=_motors(case, columns),
        frame=frame,
        layout=layout,
        truth=truth,
        wind=(blew[0], blew[1]),
        flight=flight,
    )


def mission(case: Case) -> tuple[tuple[float, ...], FlightPlan]:
    """Speeds over ground along the heading, and what a pilot does: turns, climbs, and leans for a moment."""
    rng = np.random.default_rng([case.seed, *case.mission.encode()])
    count = round(case.duration_s / 6.0)
    time_s = np.arange(round(case.duration_s * RATE_HZ)) / RATE_HZ
    swing = np.sin(2.0 * np.pi * time_s / 12.0)
    if case.mission == "eights":
        speeds = np.interp(np.arange(count + 1), [0, count / 2, count], [3.0, 12.0, 5.0])
        # A turn takes speed times yaw rate of lean.
        turning = 4.5 / np.maximum(np.interp(time_s, 6.0 * np.arange(count + 1), speeds), 4.5) * swing
        climbing = 0.3 * np.sin(2.0 * np.pi * time_s / 8.5)
    elif case.mission == "steps":
        speeds = np.repeat(rng.permutation(np.linspace(0.0, 12.0, count // 2 + 1)), 2)[: count + 1]
        turning, climbing = 0.3 * swing, 0.2 * np.sin(2.0 * np.pi * time_s / 7.0)
    elif case.mission == "climbs":
        speeds = np.interp(np.arange(count + 1), [0, count / 2, count], [0.0, 8.0, 2.0])
        turning, climbing = 0.3 * swing, np.clip(2.0 * np.sin(2.0 * np.pi * time_s / 9.0), -0.8, 0.8)
    else:
        speeds = np.interp(np.arange(count + 1), [0, count / 2, count], [0.0, 1.5, 0.5])
        turning, climbing = 0.2 * swing, 0.1 * swing
    leans = {
        axis: 0.12 * everyday_stick(level=1.0, duration_s=case.duration_s, sample_rate_hz=RATE_HZ, rng=rng)
        for axis in ("roll", "pitch")
    }
    twist = 0.4 * everyday_stick(level=1.0, duration_s=case.duration_s, sample_rate_hz=RATE_HZ, rng=rng)
    inputs = [_input(axis, values, "attitude_setpoint") for axis, values in leans.items()]
    inputs += [_input("yaw", twist, "rate_setpoint")]
    inputs += [_input("yaw", turning, "stick"), _input("thrust", climbing, "stick")]
    return tuple(float(speed) for speed in speeds), FlightPlan(name=case.mission, inputs=tuple(inputs), trim_s=0.0)


def _input(axis: str, values: FloatArray, entry: str) -> PlannedInput:
    return PlannedInput(
        axis=axis,  # type: ignore[arg-type]
        shape="sticks",
        start_s=0.0,
        values=values,
        sample_rate_hz=RATE_HZ,
        amplitude=float(np.abs(values).max()),
        entry=entry,  # type: ignore[arg-type]
    )


_MOTION = ("p", "q", "r", "phi", "theta", "psi", "velocity_north", "velocity_east", "velocity_down", "ax", "ay", "az")


def _logged(case: Case, flight: SimulatedFlight, rng: np.random.Generator) -> dict[str, FloatArray]:
    """What the log holds: sensors before their filters, and outputs or speeds of the motors."""
    columns = {name: np.asarray(flight.raw.get(name, flight.columns.get(name))) for name in _MOTION}
    rotors = sum(name.startswith("motor_") and "excitation" not in name for name in flight.columns)
    for number in range(1, rotors + 1):
        if case.motors == "outputs":
            columns[f"motor_{number}"] = np.asarray(flight.columns[f"motor_{number}"])
        else:
            speed = FULL_RAD_S[case.vehicle] * flight.truth[f"motor_speed_{number}"]
            columns[f"motor_speed_{number}"] = speed + 2.0 * rng.standard_normal(speed.size)
    return columns


def _record(case: Case, columns: Mapping[str, FloatArray]) -> FlightRecord:
    name = "-".join(str(part) for part in (case.vehicle, case.mission, case.motors, case.seed))
    whole = ((0.0, next(iter(columns.values())).size / RATE_HZ),)
    topic = Topic(
        name="flight",
        time_s=np.arange(next(iter(columns.values())).size) / RATE_HZ,
        channels=tuple(Channel(name=name, unit=STANDARD_UNITS[name]) for name in columns),
        values=np.stack(list(columns.values())),
    )
    return FlightRecord(
        source=Source(name=name, format="twin", sha256=name),
        topics=(topic,),
        status=Status(vehicle="multirotor", armed=whole, in_air=whole, flagged_in="twin"),
    )


def _motors(case: Case, columns: Mapping[str, FloatArray]) -> MotorRecord:
    """The log as arrays, velocity turned into body axes by the logged attitude."""
    prefix = "motor_speed_" if case.motors == "speeds" else "motor_"
    outputs = np.stack([values for name, values in columns.items() if name.startswith(prefix)])
    rows = np.stack([columns[name] for name in _MOTION])
    rates, attitude, over_ground, force = rows[:3], rows[3:6], rows[6:9], rows[9:]
    velocity = Rotation.from_euler("ZYX", attitude[::-1].T).inv().apply(over_ground.T).T
    return MotorRecord(
        name=case.mission,
        sample_rate_hz=RATE_HZ,
        outputs=outputs,
        rates=rates,
        az=force[2],
        w=velocity[2],
        force=force,
        velocity=velocity,
        attitude=attitude,
        between="lines" if case.motors == "speeds" else "held",
    )
