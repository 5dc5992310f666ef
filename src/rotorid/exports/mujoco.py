r"""MuJoCo: a free body with a thruster for each rotor as MJCF, and a loop in Python for what MJCF has no place for.

An actuator follows its control :math:`u` with the lag of the motors and pushes on the site of its rotor,

.. math:: T \dot a = u - a, \qquad F_i = c_{1,i} \, a + c_{0,i}, \qquad Q_i = -s_i \kappa F_i

along and about the axis of the rotor; axes are forward, left, up. MuJoCo has no gain that grows with the control, so
that the two coefficients are the tangent of the thrust of each rotor at its own hover. Force and torque stay within
those of no and full output.

Drag, damping and the delay are no part of MJCF: the one damping of a free joint is the same for all six motions, and
fluid forces come from the shape of the inertia. The loop applies :math:`D (V, \omega)` in body axes as an outer force
before each step, with what the rotors do in moving air where that is known, and hands outputs on late by whole steps.

References
----------
MuJoCo's XML reference, ``general``, ``inertial``, ``option``, ``keyframe``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from rotorid.errors import ModelError
from rotorid.exports.px4_sih import delay_steps, lag_of
from rotorid.exports.rotor_air import air_numbers, rotor_air, source
from rotorid.exports.round_trip import DELAY, HoverMotion, compared, identified_motion, in_flight, linearized
from rotorid.exports.settings import ExportSettings
from rotorid.exports.target import Compared, Exported, number_text, table_lines, vector_of, vector_text, xml_comment
from rotorid.exports.thrust import delay_words, full_thrust_words, lag_words
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

if TYPE_CHECKING:
    from rotorid.flying.vehicle_from_results import JoinedVehicle
    from rotorid.simulation.multirotor import Multirotor

NAME = "mujoco"

STEP_S = 0.001

FLU = np.diag([1.0, -1.0, -1.0])
"""Forward, right, down to forward, left, up."""

_BOTH = np.diag([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])
_MOTION = ("X_u", "Y_v", "Z_w", "L_p", "M_q", "N_r")
_TRIANGLE_ROUNDING = 1e-9
_HEIGHT_M = 1.0


def export(vehicle: JoinedVehicle, choices: ExportSettings) -> Exported:
    """A model with a keyframe in hover, and a loop that flies it.

    Parameters
    ----------
    vehicle
        With any number of rotors, tilted ones too.
    choices
        ``delay="lag"`` adds the delay to the lag; otherwise the loop holds it.

    Raises
    ------
    UsageError
        Mass, inertia or another number is not known.
    ModelError
        The inertia is that of no rigid body, which MuJoCo refuses, or the rotors do not carry the vehicle.
    """
    from rotorid.flying.vehicle_from_results import require

    body = require(vehicle, "m", "I_xx", "I_yy", "I_zz", "kappa", "arm", target=NAME)
    require_rigid(body)
    lag_s, steps = lag_of(vehicle, choices), delay_steps(vehicle, choices, step_s=STEP_S)
    name = choices.names
    rows = _compared(vehicle, body, mjcf(name, body, lag_s=lag_s), choices)
    title = f"{name}: an identified multirotor for MuJoCo, by rotorid"
    head = [title, "", *table_lines(rows), "", f"{name}_fly.py applies drag, damping and delay."]
    return Exported(
        target=NAME,
        files={
            f"{name}.xml": mjcf(name, body, lag_s=lag_s, head=head),
            f"{name}_fly.py": _loop(name, body, steps, [title, "", *table_lines(rows)]),
        },
        compared=rows,
        left_out=tuple(_left_out(vehicle, body, choices)),
        start=(
            f"python {name}_fly.py    hovers, rolls and comes back; its load() and step() are for loops of your own\n"
            f"python -m mujoco.viewer --mjcf={name}.xml    without drag, damping and delay"
        ),
    )


def require_rigid(body: Multirotor) -> None:
    """Refuse an inertia that no rigid body has.

    Raises
    ------
    ModelError
        One principal moment is more than the other two together.
    """
    low, middle, high = np.linalg.eigvalsh(body.inertia_kg_m2)
    if low + middle < high * (1.0 - _TRIANGLE_ROUNDING):
        raise ModelError(
            f"the principal moments of inertia are {low:.4g}, {middle:.4g} and {high:.4g} kg m^2",
            needed=f"none above the sum of the other two, {low + middle:.4g}: no rigid body has such",
            remedy=f"--set I_zz=… of at most {low + middle:.4g}",
        )


def tangents(body: Multirotor) -> FloatArray:
    """Thrust of each rotor about its own hover: constant and slope, shape ``(rotors, 2)``."""
    _, c_1, c_2 = body.rotors.thrust
    shares = body.hover_shares
    slopes = c_1 + 2.0 * c_2 * shares
    forces = np.array([body.rotors.thrust_at(float(share)) for share in shares])
    return np.stack([forces - slopes * shares, slopes], axis=1)


def own_slopes(vehicle: JoinedVehicle, body: Multirotor, motion: HoverMotion) -> HoverMotion:
    """Motion about hover with the slope of each rotor at its own hover: they carry unlike shares off the center."""
    return motion.replaced(motion.by_output * tangents(body)[:, 1] / vehicle.hover_slope_n)


# The files


def mjcf(name: str, body: Multirotor, *, lag_s: float | None, head: Sequence[str] = ()) -> str:
    """The model.

    Parameters
    ----------
    name
        Of the model and of its body.
    body
        The vehicle, FRD.
    lag_s
        Of the motors; none where it is not known.
    head
        Lines of a comment.
    """
    inertia = FLU @ body.inertia_kg_m2 @ FLU
    entries = [inertia[at] for at in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    arm = body.rotors.layout.arm
    gravity = f"0 0 {-STANDARD_GRAVITY_M_S2:.9g}"
    lines = [
        *xml_comment(head),
        f'<mujoco model="{name}">',
        '  <compiler angle="radian" autolimits="true"/>',
        f'  <option timestep="{STEP_S:g}" integrator="RK4" density="0" viscosity="0" gravity="{gravity}"/>',
        "  <worldbody>",
        '    <light pos="0 0 5" dir="0 0 -1" directional="true"/>',
        '    <geom name="floor" type="plane" size="50 50 0.1" rgba="0.8 0.85 0.8 1"/>',
        f'    <body name="{name}" pos="0 0 {_HEIGHT_M:g}">',
        f'      <freejoint name="{name}"/>',
        f'      <inertial pos="0 0 0" mass="{number_text(body.mass_kg)}" fullinertia="{vector_text(entries)}"/>',
        f'      <geom name="frame" type="box" size="{0.6 * arm:.4g} {0.6 * arm:.4g} {0.15 * arm:.4g}" mass="0" '
        'rgba="0.2 0.2 0.25 1"/>',
        '      <site name="imu" pos="0 0 0" size="0.005"/>',
        *_rotor_sites(body, arm),
        "    </body>",
        "  </worldbody>",
        "  <actuator>",
        *_actuators(body, lag_s),
        "  </actuator>",
        "  <sensor>",
        '    <gyro name="rates" site="imu"/>',
        '    <accelerometer name="specific_force" site="imu"/>',
        '    <velocimeter name="velocity" site="imu"/>',
        f'    <framequat name="attitude" objtype="body" objname="{name}"/>',
        "  </sensor>",
        "  <keyframe>",
        _hovering(body, lagged=bool(lag_s)),
        "  </keyframe>",
        "</mujoco>",
    ]
    return "\n".join(lines) + "\n"


def _rotor_sites(body: Multirotor, arm: float) -> list[str]:
    lines = []
    for index, (hub, spin) in enumerate(zip(body.hubs_m @ FLU, body.rotors.layout.spins, strict=True), start=1):
        color = "0.1 0.4 0.8 0.5" if spin > 0.0 else "0.8 0.3 0.1 0.5"
        lines += [
            f'      <site name="rotor_{index}" pos="{vector_text(hub)}" size="0.005"/>',
            f'      <geom type="cylinder" pos="{vector_text(hub)}" size="{0.45 * arm:.4g} {0.01 * arm:.4g}" mass="0" '
            f'contype="0" conaffinity="0" rgba="{color}"/>',
        ]
    return lines


def _actuators(body: Multirotor, lag_s: float | None) -> list[str]:
    layout, kappa = body.rotors.layout, body.rotors.torque_per_thrust_m
    axes, full = layout.thrust_axes.T @ FLU, max(body.rotors.thrust_at(1.0), 0.0)
    lag = 'dyntype="none"' if not lag_s else f'dyntype="filterexact" dynprm="{number_text(lag_s)}"'
    lines = []
    for index, (axis, spin, (zero, slope)) in enumerate(zip(axes, layout.spins, tangents(body), strict=True), start=1):
        gear = np.concatenate([axis, -spin * kappa * axis])
        lines.append(
            f'    <general name="motor_{index}" site="rotor_{index}" gear="{vector_text(gear)}" {lag} gaintype="fixed" '
            f'gainprm="{number_text(slope)}" biastype="affine" biasprm="{number_text(zero)} 0 0" ctrlrange="0 1" '
            f'forcerange="0 {number_text(full)}"/>'
        )
    return lines


def _hovering(body: Multirotor, *, lagged: bool) -> str:
    outputs = vector_text(body.hover_shares)
    # Without its activation a motor would start from zero.
    activation = f' act="{outputs}"' if lagged else ""
    return f'    <key name="hover" qpos="0 0 {_HEIGHT_M:g} 1 0 0 0" ctrl="{outputs}"{activation}/>'


def _loop(name: str, body: Multirotor, steps: int, head: Sequence[str]) -> str:
    air = body.aerodynamics
    assert air is not None
    rows = ",\n".join(f"        [{', '.join(f'{value + 0.0:.9g}' for value in row)}]" for row in _BOTH @ air @ _BOTH)
    table = "\n".join(line.rstrip() for line in head)
    moving, wrench = "", "AERODYNAMICS @ motion"
    if body.body().has_air:
        moving = f"\n# Rotors in moving air.\n{source(body)}\n"
        lagged = "data.act if model.na else np.asarray(outputs)"
        wrench += f" + rotor_air(ROTOR_AIR, {lagged}, motion[:3], motion[3:])"
    return _LOOP.format(name=name, table=table, rows=rows, steps=steps, air=moving, wrench=wrench)


_LOOP = '''"""{table}

Axes are forward, left, up. load() gives the vehicle in hover, step() moves it on under outputs of its motors, 0 to 1.
It needs mujoco and numpy.
"""

from collections import deque
from pathlib import Path

import mujoco
import numpy as np

MODEL = Path(__file__).with_name("{name}.xml")

# Force (N) and moment (N m) by velocity (m/s) and rate (rad/s).
AERODYNAMICS = np.array(
    [
{rows},
    ]
)

# Steps from an output to the motor.
DELAY_STEPS = {steps}
{air}

def load():
    """The model and its data in hover."""
    model = mujoco.MjModel.from_xml_path(str(MODEL))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("hover").id)
    mujoco.mj_forward(model, data)
    return model, data


def late(model):
    """Outputs on their way to the motors, at first those of hover."""
    return deque([model.key("hover").ctrl.copy()] * DELAY_STEPS)


def step(model, data, outputs, on_the_way=None, wind=(0.0, 0.0, 0.0)):
    """One step; on_the_way is what late() gave, without it there is no delay. Wind is in axes of the world, m/s."""
    if on_the_way is not None:
        on_the_way.append(np.array(outputs, dtype=float))
        outputs = on_the_way.popleft()
    axes = np.empty(9)
    mujoco.mju_quat2Mat(axes, data.qpos[3:7])
    axes = axes.reshape(3, 3)
    motion = np.concatenate([axes.T @ (data.qvel[:3] - np.asarray(wind)), data.qvel[3:6]])
    force, moment = np.split({wrench}, 2)
    data.ctrl[:] = outputs
    data.xfrc_applied[model.body("{name}").id] = np.concatenate([axes @ force, axes @ moment])
    mujoco.mj_step(model, data)


if __name__ == "__main__":
    model, data = load()
    hover, on_the_way = data.ctrl.copy(), late(model)
    for _ in range(1000):
        step(model, data, hover, on_the_way)
    print(f"after a second of hover: height {{data.qpos[2]:.4f}} m, rates {{data.qvel[3:6].round(6)}} rad/s")
    left = np.array([np.sign(model.site(f"rotor_{{i + 1}}").pos[1]) for i in range(model.nu)])
    for k in range(400):
        step(model, data, hover + 0.02 * left * (1.0 if k < 200 else -1.0), on_the_way)
    print(f"after a doublet to the right: {{data.qpos[:3].round(3)}} m, rates {{data.qvel[3:6].round(3)}} rad/s")
'''


# The equations


def mujoco_accelerations(
    text: str,
    aerodynamics: FloatArray,
    x: FloatArray,
    velocity_m_s: FloatArray,
    rates_rad_s: FloatArray,
    air: dict[str, FloatArray] | None = None,
) -> FloatArray:
    """What a model and its loop do, by the equations at the head: accelerations without gravity, FRD.

    Parameters
    ----------
    text
        The model as it is written.
    aerodynamics
        What the loop applies, forward, left, up, shape ``(6, 6)``.
    x
        Activations, shape ``(rotors,)``.
    velocity_m_s, rates_rad_s
        Through the air and of the body, FRD.
    air
        Of :func:`rotorid.exports.rotor_air.air_numbers`, where the loop applies it.
    """
    from xml.etree import ElementTree

    root = ElementTree.fromstring(text)
    inertial, sites = root.find(".//inertial"), {site.get("name"): site for site in root.iter("site")}
    assert inertial is not None
    xx, yy, zz, xy, xz, yz = vector_of(inertial.get("fullinertia"))
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    motion = np.concatenate([FLU @ velocity_m_s, FLU @ rates_rad_s])
    wrench = aerodynamics @ motion
    if air is not None:
        wrench = wrench + rotor_air(air, x, motion[:3], motion[3:])
    for share, motor in zip(x, root.iter("general"), strict=True):
        low, high = vector_of(motor.get("forcerange"))
        bias, gain = vector_of(motor.get("biasprm"))[0], vector_of(motor.get("gainprm"))[0]
        gear = float(np.clip(gain * share + bias, low, high)) * vector_of(motor.get("gear"))
        hub = vector_of(sites[motor.get("site")].get("pos"))
        wrench = wrench + np.concatenate([gear[:3], np.cross(hub, gear[:3]) + gear[3:]])
    turn = motion[3:]
    moment = wrench[3:] - np.cross(turn, inertia @ turn)
    mass = float(inertial.get("mass", "nan"))
    return np.concatenate([FLU @ wrench[:3] / mass, FLU @ np.linalg.solve(inertia, moment)])


def _compared(vehicle: JoinedVehicle, body: Multirotor, text: str, choices: ExportSettings) -> tuple[Compared, ...]:
    air = body.aerodynamics
    assert air is not None
    lag_s = lag_of(vehicle, choices)
    identified = own_slopes(vehicle, body, identified_motion(vehicle, body, lag_s=lag_s))
    moving = air_numbers(body) if body.body().has_air else None

    def accelerations(x: FloatArray, v: FloatArray, w: FloatArray) -> FloatArray:
        return mujoco_accelerations(text, _BOTH @ air @ _BOTH, x, v, w, moving)

    exported = linearized(accelerations, body.hover_shares, lag_s=lag_s)
    rows = compared(vehicle, identified, exported, {}, delay=choices.delay == "lag")
    rows += in_flight(vehicle, body, accelerations, body.hover_shares, drag="exact", lift="exact")
    late_s = delay_steps(vehicle, choices, step_s=STEP_S) * STEP_S
    if choices.delay == "none":
        return rows
    return tuple(replace(row, exported=late_s, held="approximated") if row.name == DELAY else row for row in rows)


def _left_out(vehicle: JoinedVehicle, body: Multirotor, choices: ExportSettings) -> list[str]:
    full = body.rotors.thrust_at(1.0)
    line = min(float(tangents(body).sum(axis=1).mean()), full)
    remarks = full_thrust_words("the tangent at hover, within that of no and of full output", line, full)
    steps = f"{delay_steps(vehicle, choices, step_s=STEP_S)} steps of {1e3 * STEP_S:g} ms"
    words = f"The delay of {{}} is in the loop as {steps}, and not in the model."
    if choices.delay == "none":
        words = "The delay of {} is left out (--no-delay)."
    remarks += delay_words(vehicle, words, as_lag=choices.delay == "lag")
    if np.any(body.aerodynamics) or body.body().has_air:
        remarks.append("Drag and damping are in the loop and not in the model.")
    unknown = [name for name in _MOTION if name not in vehicle.numbers]
    if unknown:
        remarks.append(f"{', '.join(unknown)} {'is' if len(unknown) == 1 else 'are'} not identified: there is none.")
    return remarks + lag_words(vehicle)
