"""Results of ``physical.flight`` as they are saved, of a vehicle whose numbers are known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from tests.unit.flying.test_vehicle_from_results import result

from rotorid.models.flight import FLIGHT_PARAMETERS, Airframe, hover_thrust
from rotorid.models.rotors import RotorLayout, library_layout
from rotorid.results.model import IdentifiedModel
from rotorid.results.summary import Derived, FlightLimits, FlightPhysics, MotorPhysics
from rotorid.simulation.flight_physics import with_flight
from rotorid.simulation.multirotor import Multirotor, Rotors

FULL_RAD_S = 900.0
DISC_M2 = 0.05
ARM_M = 0.25
LIMITS = FlightLimits(edge_m_s=(0.0, 10.0), climb_m_s=(-3.0, 3.0), load=(0.7, 1.4), motors=(0.35, 0.85))

OF_OUTPUTS: Mapping[str, float] = {
    "m": 1.2,
    "c_2": 12.0,
    "c_lambda": 0.45,
    "k_d": 0.12,
    "T_motor": 0.04,
    "I_xx": 0.012,
    "I_yy": 0.013,
    "I_zz": 0.02,
    "kappa": 0.018,
    "J_r": 0.02,
    "m_f": 0.0005,
    "x_imu": 0.02,
    "y_imu": -0.01,
    "z_imu": 0.03,
}
PER_SPEED = {"c_1": 1, "c_2": 2, "c_lambda": 1, "k_d": 1, "c_h": 1, "J_r": 1, "m_f": 1, "m_fx": 1, "m_s": 1, "k_r": 1}
OF_SPEEDS = {name: value / FULL_RAD_S ** PER_SPEED.get(name, 0) for name, value in OF_OUTPUTS.items()}
BY_MASS = (
    *("m", "c_0", "c_1", "c_2", "c_lambda", "k_d", "k_w", "c_h", "d_z", "I_xx", "I_yy", "I_zz", "J_r", "m_f"),
    "kappa_lambda",
)


def layout() -> RotorLayout:
    """Rotors a little above the center of gravity."""
    flat = library_layout("quad.x").scaled(ARM_M)
    return replace(flat, positions=flat.positions + np.array([0.0, 0.0, -0.02]))


def vehicle(values: Mapping[str, float] = OF_OUTPUTS, *, full: float = 1.0) -> Multirotor:
    """The same as it flies."""
    rotors = Rotors(layout=layout(), thrust=(0.0, 0.0, 9.0))
    bare = Multirotor(name="true", mass_kg=values["m"], inertia_kg_m2=np.eye(3), rotors=rotors)
    return with_flight(bare, values, disc_m2=DISC_M2, full=full)


def flight(
    values: Mapping[str, float] = OF_OUTPUTS,
    *,
    outputs: str = "output",
    known: tuple[str, ...] = ("m", "I_zz"),
    disc_assumed: bool = False,
    log: str = "fast.ulg",
) -> IdentifiedModel:
    """A result; without ``m`` among what is known everything is per kilogram."""
    mass_kg, disc_m2 = values["m"], DISC_M2
    held = dict(values)
    if "m" not in known:
        held |= {name: values[name] / mass_kg for name in BY_MASS if name in values}
        disc_m2 /= mass_kg
    own = layout()
    frame = Airframe(positions=own.positions, spins=own.spins, mass_kg=held["m"], disc_m2=disc_m2)
    hover = hover_thrust(held, frame)
    motors = MotorPhysics(
        layout="quad.x",
        arm_m=own.arm,
        rotors=tuple(map(tuple, own.positions.tolist())),
        spins=tuple(own.spins.tolist()),
        outputs=outputs,
        source="outputs",
        outputs_rate_hz=250.0,
        curve="quadratic" if "c_1" not in values else "polynomial",
        hover_output=hover.speed,
        flown_outputs=LIMITS.motors,
        scale="m" if "m" in known else None,
        load_factor=1.0,
    )
    physics = FlightPhysics(
        velocity="measured",
        disc_m2=disc_m2,
        disc_assumed=disc_assumed,
        density_kg_m3=frame.density_kg_m3,
        logs=(),
        limits=LIMITS,
        hover={"thrust_coefficient": Derived(value=hover.coefficient, std=0.01 * hover.coefficient, unit="N")},
    )
    fixed = {name: held.pop(name) for name in dict.fromkeys((*known, "m")) if name in held}
    units = {name: parameter.unit for name, parameter in FLIGHT_PARAMETERS.items()}
    made = result("physical.flight", held, fixed=fixed, units=units, motors=motors, log=log)
    return replace(made, flight=physics)
