r"""Aerial Gym: the configuration of a robot as a Python class, with its URDF.

Its equations, in axes forward, left, up, by the thrust :math:`F_i` of a rotor that its controller commands:

.. math::

    T \frac{d}{dt} \sqrt{F_i} = \sqrt{F_{c,i}} - \sqrt{F_i}, \qquad
    m \dot v = m g + R \left( \textstyle\sum_i F_i \, e_z - D_l V - D_q |V| V \right), \qquad
    J \dot\omega = \textstyle\sum_i F_i (r_i \times e_z - \kappa s_i e_z) - D_\omega \omega - \omega \times J \omega

with one lag for thrusts that rise and one for those that fall, of thrust itself where that is nearer to the identified
curve at hover than its root. Thrusts are commanded, so that the curve by outputs is that of the identified rotors, in
front of the simulator. A rotor pushes on a link of its own: a thousandth of the mass is there, since a link without
mass has no motion, and the inertia of the whole is the identified one.

References
----------
aerial_gym_simulator, ``aerial_gym/config/robot_config/base_quad_config.py``, ``control/control_allocation.py``,
``control/motor_model.py``, ``robots/base_multirotor.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np

from rotorid.data.base import Immutable
from rotorid.exports.arrangement import refuse_tilted
from rotorid.exports.learners import DrawnFiles, forward_left_up, lags_of, numbered, plain
from rotorid.exports.mujoco import FLU, own_slopes, require_rigid
from rotorid.exports.px4_sih import lag_of
from rotorid.exports.round_trip import compared, hover_air, identified_motion, in_flight, linearized, lost_air
from rotorid.exports.settings import ExportSettings
from rotorid.exports.target import (
    URDF_INERTIA,
    Compared,
    Exported,
    Fidelity,
    number_text,
    table_lines,
    vector_of,
    vector_text,
    xml_comment,
)
from rotorid.exports.thrust import delay_words
from rotorid.typing import FloatArray

if TYPE_CHECKING:
    from rotorid.flying.vehicle_from_results import JoinedVehicle
    from rotorid.simulation.multirotor import Multirotor

NAME = "aerial-gym"

_MASS_OF_LINK, _RADIUS_OF_LINK_M = 1e-3, 0.01
"""Share of the mass on the link of a rotor, and the radius of the ball that it is."""

_BETWEEN = 1.5
"""Power of the output that thrust is at hover, from which its root is what lags."""


def export(vehicle: JoinedVehicle, choices: ExportSettings) -> Exported:
    """A Python file with the configuration, and a URDF.

    Parameters
    ----------
    vehicle
        With any number of upright rotors.
    choices
        ``delay="lag"`` adds the delay to the lag.

    Raises
    ------
    UsageError
        Mass, inertia, the lag of the motors or another number is not known.
    ModelError
        The rotors are tilted, the inertia is that of no rigid body, or the lag is zero.
    """
    from rotorid.flying.vehicle_from_results import require

    body = require(vehicle, "m", "I_xx", "I_yy", "I_zz", "kappa", "arm", "T_motor", target=NAME)
    refuse_tilted(body.rotors.layout, "Aerial Gym")
    require_rigid(body)
    values, name = _values(vehicle, body, lags_of(vehicle, choices, NAME)), choices.names
    rows = _compared(vehicle, body, values, _urdf(name, body), choices)
    title = f"{name}: an identified multirotor for Aerial Gym, by rotorid"
    head = [title, "", *table_lines(rows)]
    return Exported(
        target=NAME,
        files={
            f"{name}.urdf": _urdf(name, body, head),
            f"{name}_aerial_gym.py": _module([_class(name, values)], [name], head),
        },
        compared=rows,
        left_out=tuple(_left_out(vehicle, values, choices)),
        start=_START.format(place="", name=name, choose="VEHICLES[0]"),
    )


def together(drawn: Sequence[Exported], name: str) -> DrawnFiles:
    """One Python file with a configuration for each drawn vehicle, and their URDFs."""
    files: dict[str, str | bytes] = {}
    classes, names = [], numbered(name, len(drawn))
    for own, vehicle in zip(names, drawn, strict=True):
        module, urdf = vehicle.files[f"{name}_aerial_gym.py"], vehicle.files[f"{name}.urdf"]
        assert isinstance(module, str)
        assert isinstance(urdf, str)
        files[f"draws/{own}.urdf"] = urdf.replace(f'<robot name="{name}">', f'<robot name="{own}">')
        found = module[module.index("class ") : module.index("\n\n\nVEHICLES")]
        found = found.replace(f"class {name}(", f"class {own}(", 1)
        classes.append(found.replace(f'"{name}.urdf"', f'"{own}.urdf"').replace(f'name = "{name}"', f'name = "{own}"'))
    title = f"{name}: multirotors for Aerial Gym, drawn from the covariance of what was identified, by rotorid"
    files[f"draws/{name}_aerial_gym.py"] = _module(classes, names, [title])
    start = _START.format(place='sys.path.insert(0, "draws")\n', name=name, choose="random.choice(VEHICLES)")
    return DrawnFiles(files=files, start="import random, sys\n" + start)


_START = """\
import isaacgym
from aerial_gym.registry.robot_registry import robot_registry
from aerial_gym.robots.base_multirotor import BaseMultirotor
{place}from {name}_aerial_gym import VEHICLES
robot_registry.register("{name}", BaseMultirotor, {choose})
# then SimBuilder().build_sim(..., robot_name="{name}", controller_name="no_control"): actions are thrusts, N"""


@dataclass(frozen=True, kw_only=True, eq=False)
class GymValues(Immutable):
    """What the configuration holds beside the URDF, forward, left, up.

    Parameters
    ----------
    allocation
        Force and moment by thrust, shape ``(6, rotors)``.
    directions
        Of the rotors, +1 counterclockwise, shape ``(rotors,)``.
    torque_per_thrust_m
        Of every rotor.
    linear, turning
        Force (N s/m) and moment (N m s) that brake, by velocity and rate, shape ``(3,)``.
    square
        The same by the square of velocity, N s²/m².
    rising_s, falling_s
        Lags.
    roots
        Whether the root of thrust lags, and not thrust.
    curve
        Thrust by output, from the constant to the square.
    """

    allocation: FloatArray
    directions: FloatArray
    torque_per_thrust_m: float
    linear: FloatArray
    turning: FloatArray
    square: FloatArray
    rising_s: float
    falling_s: float
    roots: bool
    curve: tuple[float, float, float]

    @property
    def least_n(self) -> float:
        """Thrust without output."""
        return max(self.curve[0], 0.0)

    def thrust(self, outputs: FloatArray) -> FloatArray:
        """Commands of outputs, newtons."""
        c_0, c_1, c_2 = self.curve
        return np.maximum(c_0 + outputs * (c_1 + outputs * c_2), self.least_n)


def _values(vehicle: JoinedVehicle, body: Multirotor, lags_s: tuple[float, float]) -> GymValues:
    layout, hubs = body.rotors.layout, body.hubs_m @ FLU
    kappa, air = body.rotors.torque_per_thrust_m, hover_air(body)
    nothing = np.zeros(layout.rotors)
    allocation = np.stack([nothing, nothing, nothing + 1.0, hubs[:, 1], -hubs[:, 0], -kappa * layout.spins])
    bend = vehicle.hover_slope_n * vehicle.hover_output / vehicle.hover_force_n
    return GymValues(
        allocation=allocation,
        directions=layout.spins,
        torque_per_thrust_m=kappa,
        linear=-np.diag(air)[:3],
        turning=-np.diag(air)[3:],
        square=np.array([0.0, 0.0, body.vertical_drag_n_s2_m2]),
        rising_s=lags_s[0],
        falling_s=lags_s[1],
        roots=bend > _BETWEEN,
        curve=body.rotors.thrust,
    )


# The files


def _urdf(name: str, body: Multirotor, head: Sequence[str] = ()) -> str:
    arm, hubs = body.rotors.layout.arm, body.hubs_m @ FLU
    mass, small = body.mass_kg, _MASS_OF_LINK * body.mass_kg
    ball = 0.4 * small * _RADIUS_OF_LINK_M**2 * np.eye(3)
    base = mass - small * len(hubs)
    center = -small * hubs.sum(axis=0) / base
    inertia = forward_left_up(body.inertia_kg_m2) - _about(base, center)
    for hub in hubs:
        inertia = inertia - ball - _about(small, hub)
    shape = f'<geometry><cylinder radius="{arm:.4g}" length="{0.3 * arm:.4g}"/></geometry>'
    lines = ['<?xml version="1.0" ?>', *xml_comment(head), f'<robot name="{name}">', '  <link name="base_link">']
    lines += [*_inertial(base, inertia, center), f"    <visual>{shape}</visual>", f"    <collision>{shape}</collision>"]
    lines += ["  </link>"]
    # Isaac Gym orders the links of one parent by their names.
    for link, hub in zip(numbered("motor", len(hubs)), hubs, strict=True):
        lines += [f'  <link name="{link}">', *_inertial(small, ball, np.zeros(3)), "  </link>"]
        lines += [f'  <joint name="base_link_to_{link}" type="fixed">', '    <parent link="base_link"/>']
        lines += [f'    <child link="{link}"/>', f'    <origin xyz="{vector_text(hub)}" rpy="0 0 0"/>', "  </joint>"]
    return "\n".join([*lines, "</robot>"]) + "\n"


def _about(mass: float, place: FloatArray) -> FloatArray:
    """Inertia of a point about the center of gravity."""
    return np.asarray(mass * (place @ place * np.eye(3) - np.outer(place, place)))


def _inertial(mass: float, inertia: FloatArray, place: FloatArray) -> list[str]:
    tensor = " ".join(f'{entry}="{number_text(float(inertia[at]) + 0.0)}"' for entry, at in URDF_INERTIA.items())
    where = f'<origin xyz="{vector_text(place)}" rpy="0 0 0"/>'
    return [f'    <inertial>{where}<mass value="{number_text(mass)}"/><inertia {tensor}/></inertial>']


def _module(classes: Sequence[str], names: Sequence[str], head: Sequence[str]) -> str:
    table = "\n".join(line.rstrip() for line in head)
    return _MODULE.format(table=table, classes="\n\n\n".join(classes), names=", ".join(names))


_MODULE = '''"""{table}

Actions without a controller are thrusts (N) of the rotors, those of outputs x from 0 to 1 by thrust_by_output:
c_0 + c_1 x + c_2 x^2.
"""

from pathlib import Path

from aerial_gym.config.robot_config.base_quad_config import BaseQuadCfg

{classes}


VEHICLES = [{names}]
'''


def _class(name: str, values: GymValues) -> str:
    matrix = "\n".join(f"            {plain(row)}," for row in values.allocation)
    numbers: Mapping[str, object] = {
        "rotors": len(values.directions),
        "linear": plain(values.linear),
        "square": plain(values.square),
        "turning": plain(values.turning),
        "links": list(range(1, len(values.directions) + 1)),
        "directions": [int(spin) for spin in values.directions],
        "rising": plain(values.rising_s),
        "falling": plain(values.falling_s),
        "roots": values.roots,
        "most": plain(sum(values.curve)),
        "least": plain(values.least_n),
        "kappa": plain(values.torque_per_thrust_m),
        "curve": plain(np.array(values.curve)),
    }
    return _CLASS.format(name=name, matrix=matrix, **numbers)


_CLASS = """\
class {name}(BaseQuadCfg):
    thrust_by_output = {curve}

    class damping:
        linvel_linear_damping_coefficient = {linear}
        linvel_quadratic_damping_coefficient = {square}
        angular_linear_damping_coefficient = {turning}
        angular_quadratic_damping_coefficient = [0.0, 0.0, 0.0]

    class robot_asset(BaseQuadCfg.robot_asset):
        asset_folder = str(Path(__file__).resolve().parent)
        file = "{name}.urdf"
        name = "{name}"
        base_link_name = "base_link"
        collapse_fixed_joints = False
        # Damping of its own would be added.
        linear_damping = 0.0
        angular_damping = 0.0

    class control_allocator_config:
        num_motors = {rotors}
        force_application_level = "motor_link"
        application_mask = {links}
        motor_directions = {directions}
        allocation_matrix = [
{matrix}
        ]

        class motor_model_config:
            use_rps = {roots}
            # Cancels; alike from least to most, as the rest, so that nothing is randomized here.
            motor_thrust_constant_min = motor_thrust_constant_max = 1.0e-5
            motor_time_constant_increasing_min = motor_time_constant_increasing_max = {rising}
            motor_time_constant_decreasing_min = motor_time_constant_decreasing_max = {falling}
            max_thrust = {most}
            min_thrust = {least}
            max_thrust_rate = 1.0e6
            thrust_to_torque_ratio = {kappa}
            # With its integration the lag would be longer by a step.
            use_discrete_approximation = False"""


# The equations


def aerial_gym_accelerations(
    urdf: str, values: GymValues, thrust_n: FloatArray, velocity_m_s: FloatArray, rates_rad_s: FloatArray
) -> FloatArray:
    """Its equations: accelerations without gravity, FRD.

    Parameters
    ----------
    urdf
        As it is written.
    values
        Of the configuration.
    thrust_n
        Lagged ones of the rotors, shape ``(rotors,)``.
    velocity_m_s, rates_rad_s
        Over ground and of the body, FRD.
    """
    mass, inertia, hubs = _whole(urdf)
    speed, turn = FLU @ velocity_m_s, FLU @ rates_rad_s
    push = thrust_n[:, None] * np.array([0.0, 0.0, 1.0])
    force = push.sum(axis=0) - values.linear * speed - values.square * np.linalg.norm(speed) * speed
    moment = np.cross(hubs, push).sum(axis=0) - values.turning * turn - np.cross(turn, inertia @ turn)
    moment[2] -= values.torque_per_thrust_m * float(values.directions @ thrust_n)
    return np.concatenate([FLU @ force / mass, FLU @ np.linalg.solve(inertia, moment)])


def _whole(urdf: str) -> tuple[float, FloatArray, FloatArray]:
    """Mass, inertia about the center of gravity, and places of the rotors from there, of all links together."""
    robot = ElementTree.fromstring(urdf)
    origins = {
        _of(joint, "child").get("link"): vector_of(_of(joint, "origin").get("xyz")) for joint in robot.iter("joint")
    }
    masses, places, inertias, hubs = [], [], [], []
    for link in robot.iter("link"):
        inertial, origin = _of(link, "inertial"), origins.get(link.get("name"), np.zeros(3))
        masses.append(float(_of(inertial, "mass").get("value", "nan")))
        places.append(origin + vector_of(_of(inertial, "origin").get("xyz")))
        entries = _of(inertial, "inertia")
        matrix = np.zeros((3, 3))
        for entry, (i, j) in URDF_INERTIA.items():
            matrix[i, j] = matrix[j, i] = float(entries.get(entry, "nan"))
        inertias.append(matrix)
        if link.get("name") in origins:
            hubs.append(origin)
    center = np.average(places, axis=0, weights=masses)
    inertia = sum(
        (own + _about(mass, place - center) for own, mass, place in zip(inertias, masses, places, strict=True)),
        np.zeros((3, 3)),
    )
    return sum(masses), inertia, np.array(hubs) - center


def _of(element: ElementTree.Element, tag: str) -> ElementTree.Element:
    found = element.find(tag)
    assert found is not None
    return found


def _compared(
    vehicle: JoinedVehicle, body: Multirotor, values: GymValues, urdf: str, choices: ExportSettings
) -> tuple[Compared, ...]:
    def accelerations(x: FloatArray, v: FloatArray, w: FloatArray) -> FloatArray:
        return aerial_gym_accelerations(urdf, values, values.thrust(x), v, w)

    identified = own_slopes(vehicle, body, identified_motion(vehicle, body, lag_s=lag_of(vehicle, choices)))
    exported = linearized(accelerations, body.hover_shares, lag_s=0.5 * (values.rising_s + values.falling_s))
    fidelities: dict[str, Fidelity] = dict.fromkeys(("M_u", "L_v"), "not")
    if np.any(body.inertia_kg_m2[np.triu_indices(3, 1)]):
        # Its damping is a number for each axis of the body, and the rates are those of coupled axes.
        fidelities |= dict.fromkeys(("L_p", "M_q", "N_r"), "approximated")
    rows = compared(vehicle, identified, exported, fidelities, delay=choices.delay == "lag")
    return rows + in_flight(vehicle, body, accelerations, body.hover_shares)


def _left_out(vehicle: JoinedVehicle, values: GymValues, choices: ExportSettings) -> list[str]:
    remarks = ["Aerial Gym commands thrusts: thrust_by_output makes them of outputs, by the identified curve."]
    what = "the root of thrust" if values.roots else "thrust"
    if values.curve[0] or values.curve[1 if values.roots else 2]:
        remarks.append(f"The lag is that of {what}, which is the lag of outputs at hover.")
    if any(name in vehicle.numbers for name in ("M_u", "L_v")):
        remarks.append("There is no moment by velocity.")
    unknown = [name for name in ("X_u", "Y_v", "Z_w", "L_p", "M_q", "N_r") if name not in vehicle.numbers]
    if unknown:
        remarks.append(f"{', '.join(unknown)} {'is' if len(unknown) == 1 else 'are'} not identified: there is none.")
    remarks.append("Gains of its controllers are its own: none was identified.")
    words = "Aerial Gym has no delay: {} are lost; --delay-as-lag adds them to the lag."
    return [*remarks, *delay_words(vehicle, words, as_lag=choices.delay == "lag"), *lost_air(vehicle, "d_z")]
