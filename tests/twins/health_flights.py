"""Flights of simulated vehicles whose rotors are known: five healthy ones, then one with a rotor that lost thrust.

Vehicles differ as built: each rotor by 2 % of thrust, the center of gravity by 1 % of the arm. Flights of one vehicle
differ by what is put on and what blows: mass 2 %, battery 5 % of voltage (thrust by its square), the place of the
battery (center of gravity by 0.4 % of the arm forward, 0.2 % to the side: half a millimeter of a quarter of the mass of
a nano quadrotor), the trim of yaw (torque of two rotors by 0.8 %), steady wind up to some 2 m/s of any direction and
gusts. The balance then scatters by 0.2 to 0.4 % of the outputs, as the steadiest axis of a real nano quadrotor does.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rotorid.data.flight_plan import SimulatedFlight
from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Status, Topic
from rotorid.flying.simulation import everyday_plan
from rotorid.simulation.multirotor_flight import Aircraft, fly_multirotor, piloted
from rotorid.simulation.wind import Wind
from rotorid.vehicles.catalog import aircraft

RATES_HZ = {"px4_quad": (50.0, 10.0), "crazyflie": (100.0, 100.0)}
"""Of gyro and motor outputs as they are logged: PX4's default, and a Crazyflie's radio."""

WRITTEN = {"px4_quad": ("PX4 ULog", "PX4 v1.14.0"), "crazyflie": ("Crazyflie uSD", "Crazyflie")}
CELLS = {"px4_quad": 14.8, "crazyflie": 3.7}
GYRO, MOTORS = ("p", "q", "r", "phi", "theta", "ax", "ay", "az"), tuple(f"motor_{n}" for n in range(1, 5))
COMMANDS = ("roll_command", "pitch_command", "yaw_command", "thrust_command")
LOOPS = ("p_setpoint", "q_setpoint", "r_setpoint", "roll_stick", "pitch_stick", "yaw_stick")
DURATION_S = 40.0


@dataclass(frozen=True, kw_only=True)
class Loss:
    """Thrust that a rotor lost, as a share."""

    rotor: int
    share: float


def as_flown(name: str, vehicle: int, rng: np.random.Generator, loss: Loss | None, voltage: float) -> Aircraft:
    """A vehicle as it was built, with the load and the battery of a flight, and a rotor that lost thrust."""
    craft, bench = aircraft(name), np.random.default_rng([5, vehicle])
    body = craft.vehicle
    arm = float(np.abs(body.rotors.layout.positions[0, 0]))
    thrust = (1.0 + 0.02 * bench.standard_normal(4)) * voltage**2
    if loss is not None:
        thrust[loss.rotor - 1] *= 1.0 - loss.share
    place = 0.01 * arm * bench.standard_normal(2) + np.array([0.004, 0.002]) * arm * rng.standard_normal(2)
    mass = body.mass_kg * (1.0 + 0.02 * rng.standard_normal())
    body = replace(body, center_of_gravity_m=(*place.tolist(), 0.0), mass_kg=mass)
    wrench = body.wrench * thrust
    # Of rotors that turn one way, so that the trim of yaw moves.
    wrench[5, wrench[5] > 0.0] *= 1.0 + 0.008 * rng.standard_normal()
    return piloted(replace(craft, vehicle=replace(body, effectiveness=wrench)))


def flight_of(name: str, vehicle: int, flight: int, loss: Loss | None = None, *, loops: bool = False) -> FlightRecord:
    """The log of a flight, with set-points and sticks where loops are wanted, which take most of a review.

    The same number with another loss has the same air, load and pilot.
    """
    flown, voltage = fly(name, vehicle, flight, loss)
    return logged(name, flown, f"flight-{flight:02d}", voltage, further=LOOPS if loops else ())


def fly(name: str, vehicle: int, flight: int, loss: Loss | None = None) -> tuple[SimulatedFlight, float]:
    """A flight, and the voltage of its battery over the usual one."""
    rng = np.random.default_rng([6, vehicle, flight])
    voltage = 1.0 + 0.05 * (rng.random() - 0.5)
    craft = as_flown(name, vehicle, rng, loss, voltage)
    north, east = rng.normal(0.0, 1.0, 2).tolist()
    wind = Wind(north_m_s=north, east_m_s=east, turbulence_m_s=float(rng.uniform(0.0, 0.5)))
    seed = 1000 * vehicle + flight
    plan = everyday_plan(craft, duration_s=DURATION_S, level=0.1, seed=seed)
    return fly_multirotor(craft, plan, wind=wind, seed=seed), voltage


def logged(name: str, flown: SimulatedFlight, log: str, voltage: float, *, further: Sequence[str] = ()) -> FlightRecord:
    """A flight at the rates at which the autopilot logs, with the mean voltage of its battery."""
    gyro_hz, motor_hz = RATES_HZ[name]
    topics = [
        _topic(flown, "gyro", [one for one in (*GYRO, *COMMANDS, *further) if one in flown.columns], gyro_hz),
        _topic(flown, "motors", MOTORS, motor_hz),
    ]
    time_s = np.arange(0.0, DURATION_S, 0.5)
    volts = CELLS[name] * voltage * (1.0 + 0.01 * np.cos(math.pi * time_s / DURATION_S))
    channel = Channel(name="battery_voltage", unit="V", source="battery.voltage")
    topics.append(Topic(name="battery", time_s=time_s, channels=(channel,), values=volts[None]))
    written, firmware = WRITTEN[name]
    return FlightRecord(
        source=Source(name=log, format=written, sha256=f"{name}-{log}", firmware=firmware),
        topics=tuple(topics),
        parameters=dict(flown.parameters),
        status=Status(in_air=((0.0, DURATION_S),), flagged_in="twin", vehicle="multirotor"),
    )


def _topic(flown: SimulatedFlight, name: str, channels: Sequence[str], rate_hz: float) -> Topic:
    step = max(round(flown.sample_rate_hz / rate_hz), 1)
    return Topic(
        name=name,
        time_s=np.asarray(flown.time_s[::step]),
        channels=tuple(Channel(name=one, unit=STANDARD_UNITS[one], source=f"{name}.{one}") for one in channels),
        values=np.stack([flown.columns[one][::step] for one in channels]),
    )
