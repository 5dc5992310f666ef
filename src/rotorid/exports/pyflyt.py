r"""PyFlyt: a folder with the URDF of a vehicle and the YAML of its rotors, drag and controllers, for ``QuadX``.

Its equations, in axes forward, left, up, by the throttle :math:`y_i` of a rotor, in steps of 1/240 s by Euler's rule:

.. math::

    \tau \dot y_i = u_i - y_i, \qquad F_i = \tfrac{1}{4} F_{all} \, y_i^2, \qquad Q_i = F_i \, c_Q / c_T, \qquad
    D_j = -\tfrac{1}{2} \rho C A \, |V_j| V_j

with the rotors front right, rear left, front left and rear right, of which the first two turn counterclockwise. Outputs
become throttles :math:`u = (x + b)/(1 + b)` as they become speeds for RotorPy (:mod:`rotorid.exports.rotorpy`), so that
force and slope of a rotor at hover are held. One number of drag meets the identified deceleration at one speed.

References
----------
PyFlyt 0.29.0, ``PyFlyt/core/drones/quadx.py``, ``core/abstractions/motors.py``, ``boring_bodies.py``,
``models/vehicles/cf2x``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.findings import Finding
from rotorid.exports.arrangement import Arranged, require_four_upright, require_x
from rotorid.exports.learners import DrawnFiles, lags_of, numbered, yaml_number
from rotorid.exports.mujoco import FLU, own_slopes, require_rigid
from rotorid.exports.px4_sih import lag_of
from rotorid.exports.rotorpy import SpeedVehicle, speed_vehicle
from rotorid.exports.round_trip import (
    accelerations_of,
    compared,
    fastest_m_s,
    identified_motion,
    in_flight,
    linearized,
    lost_air,
)
from rotorid.exports.settings import ExportSettings
from rotorid.exports.target import Compared, Exported, table_lines, xml_comment
from rotorid.exports.thrust import delay_words, full_thrust_words, sih_lag
from rotorid.exports.urdf import bullet_fidelities, inertial_lines, massless_links
from rotorid.typing import FloatArray

if TYPE_CHECKING:
    from rotorid.flying.vehicle_from_results import JoinedVehicle
    from rotorid.flying.vehicle_numbers import VehicleNumber
    from rotorid.simulation.multirotor import Multirotor

NAME = "pyflyt"

STEP_S = 1.0 / 240.0
"""Of its physics."""

_BEARINGS_DEG = (45.0, -135.0, -45.0, 135.0)
_SPINS = (1.0, 1.0, -1.0, -1.0)

_GRAVITY_M_S2, _DENSITY_KG_M3 = 9.81, 1.225
"""PyFlyt's own."""

_DRAG_AT_M_S = 5.0
"""Speed at which drag is met where no flight shows the fastest."""

_RPM = 60.0 / math.tau


@dataclass(frozen=True, kw_only=True, eq=False)
class ThrottleVehicle(Immutable):
    """A vehicle of PyFlyt.

    Parameters
    ----------
    speeds
        The same by the speeds of its rotors.
    rotors
        Its order of rotors.
    tau_s
        Of the steps of the throttle.
    drag_area_m2
        With a drag coefficient of one.
    """

    speeds: SpeedVehicle
    rotors: Arranged
    tau_s: float
    drag_area_m2: float

    @property
    def full_n(self) -> float:
        """Thrust of one rotor at full throttle."""
        return self.speeds.thrust * self.speeds.fastest_rad_s**2

    def throttle(self, output: FloatArray) -> FloatArray:
        """Throttles of outputs."""
        return self.speeds.speed(output) / self.speeds.fastest_rad_s


def export(vehicle: JoinedVehicle, choices: ExportSettings) -> Exported:
    """A folder with a URDF and a YAML.

    Parameters
    ----------
    vehicle
        With four upright rotors in an X.
    choices
        ``delay="lag"`` adds the delay to the lag.

    Raises
    ------
    UsageError
        Mass, inertia, the lag of the motors or another number is not known.
    ModelError
        The rotors are not four in an X that turn against their neighbors, or the lag is zero.
    """
    from rotorid.flying.vehicle_from_results import require

    body = require(vehicle, "m", "I_xx", "I_yy", "I_zz", "kappa", "arm", "T_motor", target=NAME)
    require_four_upright(body.rotors.layout, "PyFlyt")
    require_rigid(body)
    defaults: dict[str, VehicleNumber] = {}
    findings: list[Finding] = []
    lag_s = float(np.mean(lags_of(vehicle, choices, NAME)))
    model = ThrottleVehicle(
        speeds=speed_vehicle(vehicle, body, lag_s, defaults, findings),
        rotors=require_x(body.rotors.layout, _BEARINGS_DEG, _SPINS, "PyFlyt"),
        tau_s=sih_lag(lag_s, step_s=STEP_S),
        drag_area_m2=_drag_area(vehicle, body),
    )
    rows = _compared(vehicle, body, model, choices)
    name = choices.names
    head = [f"{name}: an identified multirotor for PyFlyt, by rotorid", "", *table_lines(rows)]
    return Exported(
        target=NAME,
        files={f"{name}/{name}.urdf": _urdf(name, body, model, head), f"{name}/{name}.yaml": _yaml(model, head)},
        compared=rows,
        defaults=defaults,
        left_out=tuple(_left_out(vehicle, body, model, choices)),
        start=_START.format(choose=f'name, place = "{name}", "."'),
        findings=tuple(findings),
    )


def together(drawn: Sequence[Exported], name: str) -> DrawnFiles:
    """A folder for each drawn vehicle, all in one, of which PyFlyt takes any by its name."""
    files: dict[str, str | bytes] = {}
    for own, vehicle in zip(numbered(name, len(drawn)), drawn, strict=True):
        for path, text in vehicle.files.items():
            assert isinstance(text, str)
            renamed = text.replace(f'<robot name="{name}">', f'<robot name="{own}">')
            files[f"draws/{own}/{own}.{path.rpartition('.')[2]}"] = renamed
    start = "import os, random\n" + _START.format(choose='name, place = random.choice(os.listdir("draws")), "draws"')
    return DrawnFiles(files=files, start=start)


_START = """\
import numpy as np, yaml
from pathlib import Path
from PyFlyt.core import Aviary
{choose}
options = dict(drone_model=name, model_dir=str(Path(place).resolve()))
world = Aviary(np.array([[0.0, 0.0, 10.0]]), np.zeros((1, 3)), drone_type="quadx", drone_options=options)
world.set_mode(-1)  # throttles of the rotors
rotors = yaml.safe_load(Path(place, name, name + ".yaml").read_text())["outputs"]
throttles = lambda x: (np.asarray(x)[rotors["order"]] + rotors["shift"]) / (1.0 + rotors["shift"])
world.set_setpoint(0, throttles([0.5] * 4))
world.step()"""


def _drag_speed(vehicle: JoinedVehicle) -> float:
    return fastest_m_s(vehicle) or _DRAG_AT_M_S


def _drags(vehicle: JoinedVehicle, body: Multirotor) -> dict[str, float]:
    """Deceleration along each known axis at the speed at which drag is met, m/s²."""
    speed, still = _drag_speed(vehicle), accelerations_of(body, body.hover_shares, np.zeros(3))
    return {
        name: float(still[axis] - accelerations_of(body, body.hover_shares, speed * np.eye(3)[axis])[axis])
        for axis, name in enumerate(("X_u", "Y_v"))
        if name in vehicle.numbers
    }


def _drag_area(vehicle: JoinedVehicle, body: Multirotor) -> float:
    """Area by which the mean of both axes is met; zero where nothing is known or motion would be driven."""
    known = list(_drags(vehicle, body).values())
    mean = body.mass_kg * float(np.mean(known)) if known else 0.0
    return max(mean, 0.0) / (0.5 * _DENSITY_KG_M3 * _drag_speed(vehicle) ** 2)


# The files


def _urdf(name: str, body: Multirotor, model: ThrottleVehicle, head: Sequence[str]) -> str:
    arm, speeds = body.rotors.layout.arm, model.speeds
    shape = f'<geometry><cylinder radius="{arm:.4g}" length="{0.3 * arm:.4g}"/></geometry>'
    origin = '<origin rpy="0 0 0" xyz="0 0 0"/>'
    lines = ['<?xml version="1.0" ?>', *xml_comment(head), f'<robot name="{name}">', '  <link name="base_link">']
    lines += inertial_lines(speeds.mass_kg, speeds.inertia_kg_m2, np.zeros(3))
    lines += [f"    <visual>{origin}{shape}</visual>", f"    <collision>{origin}{shape}</collision>", "  </link>"]
    lines += massless_links(speeds.hubs_m[list(model.rotors.order)], "body")
    return "\n".join([*lines, "</robot>"]) + "\n"


def _yaml(model: ThrottleVehicle, head: Sequence[str]) -> str:
    speeds = model.speeds
    blocks: Mapping[str, Mapping[str, float]] = {
        "motor_params": {
            "total_thrust": len(speeds.hubs_m) * model.full_n,
            "thrust_coef": speeds.thrust / _RPM**2,
            "torque_coef": speeds.torque / _RPM**2,
            # Noise of any other ratio has a mean in PyFlyt.
            "noise_ratio": 0.0,
            "tau": model.tau_s,
        },
        "drag_params": {"drag_coef_xyz": 1.0, "drag_area_xyz": model.drag_area_m2, "drag_coef_pqr": 0.0},
    }
    lines = [f"# {line}".rstrip() for line in head]
    for block, values in blocks.items():
        lines += ["", f"{block}:", *(f"  {key}: {yaml_number(value)}" for key, value in values.items())]
    lines += ["", "# Throttles are (output + shift) / (1 + shift), of the vehicle's rotors in this order, from 0."]
    lines += ["outputs:", f"  shift: {yaml_number(speeds.shift)}", f"  order: {list(model.rotors.order)}"]
    return "\n".join([*lines, "", _CONTROLLERS])


_CONTROLLERS = """\
# Gains of PyFlyt's own cf2x: nothing was identified of them.
control_params:
  ang_vel: {kp: [0.04, 0.04, 0.08], ki: [5.0e-7, 5.0e-7, 2.7e-4], kd: [1.0e-4, 1.0e-4, 0.0], lim: [1.0, 1.0, 1.0]}
  ang_pos: {kp: [2.0, 2.0, 2.0], ki: [0.0, 0.0, 0.0], kd: [0.0, 0.0, 0.0], lim: [3.0, 3.0, 3.0]}
  lin_vel: {kp: [0.8, 0.8], ki: [0.3, 0.3], kd: [0.5, 0.5], lim: [0.4, 0.4]}
  lin_pos: {kp: [1.0, 1.0], ki: [0.0, 0.0], kd: [0.0, 0.0], lim: [2.0, 2.0]}
  z_pos: {kp: 1.0, ki: 0.0, kd: 0.0, lim: 1.0}
  z_vel: {kp: 2.0, ki: 0.5, kd: 0.05, lim: 1.0}
"""


# The equations


def pyflyt_accelerations(
    model: ThrottleVehicle, throttles: FloatArray, velocity_m_s: FloatArray, rates_rad_s: FloatArray
) -> FloatArray:
    """Its equations: accelerations without gravity, FRD.

    Parameters
    ----------
    model
        The numbers of the files.
    throttles
        Lagged ones of its rotors, shape ``(4,)``.
    velocity_m_s, rates_rad_s
        Through the air and of the body, FRD.
    """
    speeds, speed, turn = model.speeds, FLU @ velocity_m_s, FLU @ rates_rad_s
    thrust = model.full_n * throttles**2
    inertia = np.diag(np.diag(speeds.inertia_kg_m2))
    push = thrust[:, None] * np.array([0.0, 0.0, 1.0])
    moment = np.cross(speeds.hubs_m[list(model.rotors.order)], push).sum(axis=0)
    moment[2] -= speeds.torque / speeds.thrust * float(thrust @ _SPINS)
    force = push.sum(axis=0) - 0.5 * _DENSITY_KG_M3 * model.drag_area_m2 * np.abs(speed) * speed
    moment = moment - np.cross(turn, inertia @ turn)
    return np.concatenate([FLU @ force / speeds.mass_kg, FLU @ np.linalg.solve(inertia, moment)])


def _compared(
    vehicle: JoinedVehicle, body: Multirotor, model: ThrottleVehicle, choices: ExportSettings
) -> tuple[Compared, ...]:
    def accelerations(x: FloatArray, v: FloatArray, w: FloatArray) -> FloatArray:
        return pyflyt_accelerations(model, model.throttle(x), v, w)

    identified = own_slopes(vehicle, body, identified_motion(vehicle, body, lag_s=lag_of(vehicle, choices)))
    speeds, shares = model.speeds, body.hover_shares[list(model.rotors.order)]
    own = linearized(
        accelerations,
        shares,
        lag_s=-STEP_S / math.log1p(-STEP_S / model.tau_s),
        output=float(speeds.output(math.sqrt(speeds.mass_kg * _GRAVITY_M_S2 / (len(shares) * speeds.thrust)))),
    )
    fidelities = bullet_fidelities(body) | dict.fromkeys(("X_u", "Y_v", "Z_w"), "not")
    exported = own.replaced(model.rotors.restored(own.by_output))
    rows = compared(vehicle, identified, exported, fidelities, delay=choices.delay == "lag")
    if fastest_m_s(vehicle) is not None:
        return rows + in_flight(vehicle, body, accelerations, shares)
    return rows + _drag_rows(vehicle, body, model)


def _drag_rows(vehicle: JoinedVehicle, body: Multirotor, model: ThrottleVehicle) -> tuple[Compared, ...]:
    """Drag at the speed at which it is met, of each known axis."""
    speed = _drag_speed(vehicle)
    exported = 0.5 * _DENSITY_KG_M3 * model.drag_area_m2 * speed**2 / body.mass_kg
    return tuple(
        Compared(
            name=f"drag at {speed:g} m/s ({name})",
            unit="m/s^2",
            identified=identified,
            exported=exported,
            held="approximated",
        )
        for name, identified in _drags(vehicle, body).items()
    )


def _left_out(vehicle: JoinedVehicle, body: Multirotor, model: ThrottleVehicle, choices: ExportSettings) -> list[str]:
    remarks = [
        f"PyFlyt's drag grows with the square of speed, alike on all axes: it is right at {_drag_speed(vehicle):g} m/s "
        "along the discs."
    ]
    if not {"X_u", "Y_v"} & set(vehicle.numbers):
        remarks = ["Drag is not identified: the vehicle has none."]
    remarks.append("There is no damping of rates and no moment by velocity.")
    remarks.append("control_params are those of PyFlyt's cf2x: tune them, or command throttles (mode -1).")
    if model.rotors.mirrored:
        remarks.append("All rotors turn the other way there, so yaw from throttles has the opposite sign.")
    up, down = lags_of(vehicle, choices, NAME)
    if not math.isclose(up, down):
        remarks.append(f"PyFlyt has one lag: the mean of {up:.3g} s for rising and {down:.3g} s for falling outputs.")
    if np.any(body.inertia_kg_m2[np.triu_indices(3, 1)]):
        remarks.append("Products of inertia are left out: PyBullet would turn the axes of the body.")
    remarks += full_thrust_words("a square of the throttle", model.full_n, body.rotors.thrust_at(1.0))
    words = "PyFlyt has no delay: {} are lost; --delay-as-lag adds them to the lag."
    return [*remarks, *delay_words(vehicle, words, as_lag=choices.delay == "lag"), *lost_air(vehicle)]
