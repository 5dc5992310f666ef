r"""gym-pybullet-drones: a URDF whose places its reader counts, with the numbers of its rotors as properties.

Its physics in PyBullet, in axes forward, left, up, by the speeds of the rotors in turns a minute:

.. math::

    F_i = k_f N_i^2, \qquad M_z = k_m (-N_0^2 + N_1^2 - N_2^2 + N_3^2), \qquad
    D = -\mathrm{diag}(k_{xy}, k_{xy}, k_z) \Big( \sum_i \tfrac{2\pi}{60} N_i \Big) V

with the rotors front right, rear right, rear left and front left, in this order. A speed is had at once, there is no
lag. The drag is along axes of the world, which is that of the body near level flight. Outputs become speeds as for
RotorPy (:mod:`rotorid.exports.rotorpy`), so that force and slope of a rotor at hover are held.

References
----------
gym-pybullet-drones, ``gym_pybullet_drones/envs/BaseAviary.py``, ``assets/cf2x.urdf``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from rotorid.data.findings import Finding
from rotorid.exports.arrangement import Arranged, require_four_upright, require_x
from rotorid.exports.mujoco import FLU, own_slopes, require_rigid
from rotorid.exports.rotorpy import SpeedVehicle, rotor_radius, speed_vehicle
from rotorid.exports.round_trip import (
    DELAY,
    HOVER,
    PITCH,
    ROLL,
    VERTICAL,
    YAW,
    compared,
    identified_motion,
    in_flight,
    linearized,
    lost_air,
)
from rotorid.exports.settings import ExportSettings
from rotorid.exports.target import URDF_INERTIA, Compared, Exported, Fidelity, table_lines, vector_text, xml_comment
from rotorid.exports.thrust import full_thrust_words
from rotorid.typing import FloatArray

if TYPE_CHECKING:
    from rotorid.flying.vehicle_from_results import JoinedVehicle
    from rotorid.flying.vehicle_numbers import VehicleNumber
    from rotorid.simulation.multirotor import Multirotor

NAME = "urdf"

_BEARINGS_DEG = (45.0, 135.0, -135.0, -45.0)
_SPINS = (1.0, -1.0, 1.0, -1.0)

_GRAVITY_M_S2 = 9.8
"""gym-pybullet-drones' own."""

_ROUNDING = 1e-9
_RPM = 60.0 / math.tau
_USUAL = {"max_speed_kmh": (30.0, "km/h"), "gnd_eff_coeff": (11.36859, "1")}
_DOWNWASH = {"dw_coeff_1": 2267.18, "dw_coeff_2": 0.16, "dw_coeff_3": -0.11}
_USUAL_RADIUS_M = 0.0231348
"""Of the Crazyflie that comes with it."""


def export(vehicle: JoinedVehicle, choices: ExportSettings) -> Exported:
    """A URDF with properties.

    Parameters
    ----------
    vehicle
        With four upright rotors in an X.
    choices
        The name; there is no lag and no delay.

    Raises
    ------
    UsageError
        Mass, inertia or another number is not known.
    ModelError
        The rotors are not four in an X that turn against their neighbors.
    """
    from rotorid.flying.vehicle_from_results import require
    from rotorid.flying.vehicle_numbers import VehicleNumber

    body = require(vehicle, "m", "I_xx", "I_yy", "I_zz", "kappa", "arm", target=NAME)
    require_four_upright(body.rotors.layout, "gym-pybullet-drones")
    require_rigid(body)
    rotors = require_x(body.rotors.layout, _BEARINGS_DEG, _SPINS, "gym-pybullet-drones")
    defaults: dict[str, VehicleNumber] = {}
    findings: list[Finding] = []
    model = speed_vehicle(vehicle, body, 0.0, defaults, findings)
    radius_m = rotor_radius(vehicle, body, "prop_radius", _USUAL_RADIUS_M, defaults)
    for name, (value, unit) in _USUAL.items():
        defaults[name] = VehicleNumber(value=value, unit=unit, source="default", of="cf2x.urdf")
    rows = _compared(vehicle, body, model, rotors)
    name = choices.names
    head = [
        f"{name}: an identified multirotor for gym-pybullet-drones, by rotorid",
        "",
        *table_lines(rows),
        "",
        f"Turns a minute for an output x from 0 to 1: {_slope(model):.9g} * max(x + {model.shift:.9g}, 0)",
        "Rotors of the vehicle, from 1, as links prop0 to prop3: " + ", ".join(str(i + 1) for i in rotors.order),
    ]
    return Exported(
        target=NAME,
        files={f"{name}.urdf": _urdf(name, body, model, rotors, radius_m, head)},
        compared=rows,
        defaults=defaults,
        left_out=tuple(_left_out(vehicle, body, model, rotors)),
        start=(
            f"Copy {name}.urdf to gym_pybullet_drones/assets, add {name.upper()} = {name!r} to DroneModel in\n"
            "utils/enums.py, and use drone_model=DroneModel."
            f"{name.upper()} with physics=Physics.PYB_DRAG; Physics.DYN has other\n"
            "levers than the file."
        ),
        findings=tuple(findings),
    )


def _slope(model: SpeedVehicle) -> float:
    """Turns a minute by output."""
    return model.fastest_rad_s * _RPM / (1.0 + model.shift)


def _properties(body: Multirotor, model: SpeedVehicle, radius_m: float) -> dict[str, float]:
    full_n = len(model.hubs_m) * model.thrust * model.fastest_rad_s**2
    return {
        "arm": body.rotors.layout.arm,
        "kf": model.thrust / _RPM**2,
        "km": model.torque / _RPM**2,
        "thrust2weight": full_n / (model.mass_kg * _GRAVITY_M_S2),
        "max_speed_kmh": _USUAL["max_speed_kmh"][0],
        "gnd_eff_coeff": _USUAL["gnd_eff_coeff"][0],
        "prop_radius": radius_m,
        "drag_coeff_xy": model.drag,
        "drag_coeff_z": model.climb_drag,
        **_DOWNWASH,
    }


# The file: its reader takes the first child for properties and the second for the body, and counts within that.


def _urdf(
    name: str, body: Multirotor, model: SpeedVehicle, rotors: Arranged, radius_m: float, head: Sequence[str]
) -> str:
    values = " ".join(f'{key}="{value:.9g}"' for key, value in _properties(body, model, radius_m).items())
    arm = body.rotors.layout.arm
    shape = f'<geometry><cylinder radius="{arm:.4g}" length="{0.3 * arm:.4g}"/></geometry>'
    origin = '<origin rpy="0 0 0" xyz="0 0 0"/>'
    lines = ['<?xml version="1.0" ?>', *xml_comment(head), f'<robot name="{name}">', f"  <properties {values}/>"]
    lines += ['  <link name="base_link">', *inertial_lines(model.mass_kg, model.inertia_kg_m2, np.zeros(3))]
    grey = '<material name="grey"><color rgba=".5 .5 .5 1"/></material>'
    lines += [f"    <visual>{origin}{shape}{grey}</visual>", f"    <collision>{origin}{shape}</collision>", "  </link>"]
    lines += massless_links(model.hubs_m[list(rotors.order)], "center_of_mass")
    return "\n".join([*lines, "</robot>"]) + "\n"


def massless_links(hubs_m: FloatArray, center: str) -> list[str]:
    """Links of the rotors, and one at the center of gravity, by whose order their readers know them."""
    lines: list[str] = []
    # The height of upright rotors without drag has no effect; in PyBullet it would damp, by poses a step apart.
    flat = hubs_m * [1.0, 1.0, 0.0]
    for link, place in [*((f"prop{i}", hub) for i, hub in enumerate(flat)), (center, np.zeros(3))]:
        lines += [f'  <link name="{link}_link">', *inertial_lines(0.0, np.zeros((3, 3)), place), "  </link>"]
        lines += [f'  <joint name="{link}_joint" type="fixed">', '    <parent link="base_link"/>']
        lines += [f'    <child link="{link}_link"/>', "  </joint>"]
    return lines


def inertial_lines(mass: float, inertia: FloatArray, place: FloatArray) -> list[str]:
    """Mass, inertia and place of a link."""
    # With products PyBullet turns the axes of the body to the principal ones, by which its readers fly then.
    tensor = " ".join(f'{name}="{inertia[i, j] if i == j else 0.0:.9g}"' for name, (i, j) in URDF_INERTIA.items())
    return [
        "    <inertial>",
        f'      <origin rpy="0 0 0" xyz="{vector_text(place)}"/>',
        f'      <mass value="{mass:.9g}"/>',
        f"      <inertia {tensor}/>",
        "    </inertial>",
    ]


# The equations


def pybullet_accelerations(
    model: SpeedVehicle, rotors: Arranged, rpm: FloatArray, velocity_m_s: FloatArray, rates_rad_s: FloatArray
) -> FloatArray:
    """Its equations with ``Physics.PYB_DRAG``: accelerations without gravity, FRD, in level flight.

    Parameters
    ----------
    model, rotors
        The numbers of the file, and its order of rotors.
    rpm
        Of the rotors in that order, shape ``(4,)``.
    velocity_m_s, rates_rad_s
        Of the body, FRD.
    """
    speed, turn = FLU @ velocity_m_s, FLU @ rates_rad_s
    thrust = model.thrust / _RPM**2 * rpm**2
    inertia = np.diag(np.diag(model.inertia_kg_m2))
    drag = np.array([model.drag, model.drag, model.climb_drag]) * float(rpm.sum()) / _RPM
    force = np.array([0.0, 0.0, thrust.sum()]) - drag * speed
    push = np.stack([0.0 * thrust, 0.0 * thrust, thrust], axis=1)
    moment = np.cross(model.hubs_m[list(rotors.order)], push).sum(axis=0)
    moment[2] += model.torque / model.thrust * float(thrust @ [-1.0, 1.0, -1.0, 1.0])
    moment = moment - np.cross(turn, inertia @ turn)
    return np.concatenate([FLU @ force / model.mass_kg, FLU @ np.linalg.solve(inertia, moment)])


def _compared(vehicle: JoinedVehicle, body: Multirotor, model: SpeedVehicle, rotors: Arranged) -> tuple[Compared, ...]:
    lag = vehicle.numbers.get("T_motor")
    lag_s = None if lag is None else lag.value
    identified = own_slopes(vehicle, body, identified_motion(vehicle, body, lag_s=lag_s))
    shares = body.hover_shares[list(rotors.order)]
    own = linearized(
        lambda x, v, w: pybullet_accelerations(model, rotors, model.speed(x) * _RPM, v, w),
        shares,
        lag_s=None,
        output=float(model.output(math.sqrt(model.mass_kg * _GRAVITY_M_S2 / (4.0 * model.thrust)))),
    )
    fidelities = bullet_fidelities(body)
    across = {vehicle.numbers[name].value for name in ("X_u", "Y_v") if name in vehicle.numbers}
    if len(across) > 1 or not model.drag:
        fidelities |= dict.fromkeys(("X_u", "Y_v"), "approximated")
    if not model.climb_drag:
        fidelities["Z_w"] = "approximated"
    rows = compared(vehicle, identified, own.replaced(rotors.restored(own.by_output)), fidelities)
    return rows + in_flight(
        vehicle,
        body,
        lambda x, v, w: pybullet_accelerations(model, rotors, model.speed(x) * _RPM, v, w),
        shares,
    )


def bullet_fidelities(body: Multirotor) -> dict[str, Fidelity]:
    """How PyBullet holds a vehicle: without moments by motion, on a diagonal inertia, with one hover of all rotors."""
    fidelities: dict[str, Fidelity] = dict.fromkeys(("L_p", "M_q", "N_r", "M_u", "L_v"), "not")
    if np.any(body.inertia_kg_m2[np.triu_indices(3, 1)]):
        fidelities |= dict.fromkeys((ROLL, PITCH, YAW, "X_u", "Y_v"), "approximated")
    if np.ptp(body.hover_shares) > _ROUNDING:
        fidelities |= dict.fromkeys((VERTICAL, ROLL, PITCH, YAW, HOVER), "approximated")
    return fidelities


def _left_out(vehicle: JoinedVehicle, body: Multirotor, model: SpeedVehicle, rotors: Arranged) -> list[str]:
    remarks = []
    if rotors.mirrored:
        remarks.append("All rotors turn the other way there, so yaw from rotor speeds has the opposite sign.")
    if (lag := vehicle.numbers.get("T_motor")) is not None:
        remarks.append(f"Rotors turn at once: the lag of the motors, {1e3 * lag.value:.3g} ms, is lost.")
    if (late := vehicle.numbers.get(DELAY)) is not None and late.value > 0.0:
        remarks.append(f"There is no delay: {1e3 * late.value:.2g} ms are lost.")
    remarks.append("There is no damping of rates and no moment by velocity; drag needs Physics.PYB_DRAG.")
    remarks += lost_air(vehicle)
    if np.any(body.inertia_kg_m2[np.triu_indices(3, 1)]):
        remarks.append("Products of inertia are left out: PyBullet would turn the axes of the body.")
    full = model.thrust * model.fastest_rad_s**2
    remarks += full_thrust_words("a square of the speed", full, body.rotors.thrust_at(1.0))
    return remarks
