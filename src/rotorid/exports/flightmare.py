r"""Flightmare: the block ``quadrotor_dynamics`` of its YAML.

Its equations, in axes forward, left, up, by the speed :math:`\Omega_i` of a rotor:

.. math::

    \tau \dot\Omega_i = \Omega_{c,i} - \Omega_i, \qquad F_i = c_2 \Omega_i^2 + c_1 \Omega_i + c_0, \qquad
    J = \tfrac{1}{12} m l^2 \, \mathrm{diag}(4.5, 4.5, 7), \qquad
    J \dot\omega = \tfrac{l}{\sqrt 2} M F + \kappa \, \sigma^T F \, e_z - \omega \times J \omega

with the rotors front left, front right, rear right and rear left, in a square. Inertia follows from mass and arm, so
that these are no numbers of the vehicle: :math:`l` is that whose accelerations about the level axes are the identified
ones (their geometric mean, where roll and pitch differ), and :math:`\kappa` that whose yaw is,

.. math::

    l = \frac{12}{4.5 \sqrt 2 \, m \sqrt{(y/I_{xx}) (x/I_{yy})}}, \qquad
    \kappa = \frac{7 m l^2}{12} \frac{\kappa_{id}}{I_{zz}}

Commands are thrusts, which it turns into speeds by the root of the square: a curve without one, as a line, becomes the
square with its force and slope at hover.

References
----------
flightmare, ``flightlib/src/dynamics/quadrotor_dynamics.cpp``, ``src/objects/quadrotor.cpp``,
``configs/quadrotor_env.yaml``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from rotorid.errors import ModelError
from rotorid.exports.arrangement import Arranged, require_four_upright, require_x
from rotorid.exports.learners import AIR_OF_ROTATION, DrawnFiles, lags_of, numbered, yaml_number
from rotorid.exports.mujoco import FLU, own_slopes
from rotorid.exports.px4_sih import lag_of
from rotorid.exports.rotorpy import FASTEST_RAD_S
from rotorid.exports.round_trip import PITCH, ROLL, compared, identified_motion, in_flight, linearized, lost_air
from rotorid.exports.settings import ExportSettings
from rotorid.exports.target import Compared, Exported, Fidelity, table_lines
from rotorid.exports.thrust import delay_words, full_thrust_words
from rotorid.exports.urdf import bullet_fidelities
from rotorid.typing import FloatArray

if TYPE_CHECKING:
    from rotorid.flying.vehicle_from_results import JoinedVehicle
    from rotorid.flying.vehicle_numbers import VehicleNumber
    from rotorid.simulation.multirotor import Multirotor

NAME = "flightmare"

_BEARINGS_DEG = (-45.0, 45.0, 135.0, -135.0)
_SPINS = (-1.0, 1.0, -1.0, 1.0)

_LEVEL, _UPRIGHT = 4.5 / 12.0, 7.0 / 12.0
"""Inertia over mass and square of the arm."""

_MOST_N = 2000.0**2 * 1.3298253500372892e-06 + 2000.0 * 0.0038360810526746033 - 1.7689986848125325
"""Thrust of a rotor beyond which it does not go, by the numbers that it was compiled with: the file changes nothing."""

_FASTEST_TURNS_RAD_S = 6.0
"""Limit of its rate commands, as in its own file."""

_BENT = 0.05
"""Least share of full thrust in the square term, for speeds to follow from thrust."""

_ALIKE = 0.001


def export(vehicle: JoinedVehicle, choices: ExportSettings) -> Exported:
    """A YAML file with the block of the vehicle.

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
        The rotors are not four in an X that turn against their neighbors, the lag is zero, or a rotor carries more in
        hover than Flightmare allows.
    """
    from rotorid.flying.vehicle_from_results import require

    body = require(vehicle, "m", "I_xx", "I_yy", "I_zz", "kappa", "arm", "T_motor", target=NAME)
    require_four_upright(body.rotors.layout, "Flightmare")
    rotors = require_x(body.rotors.layout, _BEARINGS_DEG, _SPINS, "Flightmare")
    if vehicle.hover_force_n >= _MOST_N:
        raise ModelError(
            f"each rotor of {vehicle.name} carries {vehicle.hover_force_n:.3g} N in hover",
            needed=f"less than {_MOST_N:.3g} N, to which Flightmare limits every rotor",
        )
    defaults: dict[str, VehicleNumber] = {}
    block = _block(vehicle, body, float(np.mean(lags_of(vehicle, choices, NAME))), defaults)
    rows = _compared(vehicle, body, block, rotors, choices)
    name = choices.names
    head = [
        f"{name}: an identified multirotor for Flightmare, by rotorid",
        "",
        *table_lines(rows),
        "",
        "arm_l and kappa give the identified accelerations with the inertia that Flightmare computes of them.",
        f"Commands are thrusts (N), for outputs x from 0 to 1: {_terms(_curve(vehicle, body))}",
        "Rotors of the vehicle, from 1, in Flightmare's order: " + ", ".join(str(i + 1) for i in rotors.order),
    ]
    file = f"{name}_flightmare.yaml"
    return Exported(
        target=NAME,
        files={file: "\n".join([*(f"# {line}".rstrip() for line in head), "", _text("quadrotor_dynamics", block)])},
        compared=rows,
        defaults=defaults,
        left_out=tuple(_left_out(vehicle, body, block, rotors, choices)),
        start=_START.format(read=f'yaml.safe_load(Path("{file}").read_text())["quadrotor_dynamics"]'),
    )


def together(drawn: Sequence[Exported], name: str) -> DrawnFiles:
    """One YAML file with the block of each drawn vehicle by its name."""
    texts = []
    for own, vehicle in zip(numbered(name, len(drawn)), drawn, strict=True):
        (text,) = vehicle.files.values()
        assert isinstance(text, str)
        texts.append(f"{own}:{text.rpartition('quadrotor_dynamics:')[2]}")
    file = f"draws/{name}_flightmare.yaml"
    read = f'random.choice(list(yaml.safe_load(Path("{file}").read_text()).values()))'
    return DrawnFiles(files={file: "\n".join(texts)}, start="import random\n" + _START.format(read=read))


_START = """\
import os, yaml
from pathlib import Path
place = Path(os.environ["FLIGHTMARE_PATH"], "flightlib/configs/quadrotor_env.yaml")  # read by each QuadrotorEnv
values = yaml.safe_load(place.read_text())
values["quadrotor_dynamics"] = {read}
place.write_text(yaml.safe_dump(values))"""


def _curve(vehicle: JoinedVehicle, body: Multirotor) -> FloatArray:
    """Thrust by output, from the constant to the square: the identified one, or the square that meets it at hover."""
    own = np.array(body.rotors.thrust)
    if own[2] >= _BENT * own.sum() and own[1] >= 0.0:
        return own
    force, slope = vehicle.hover_force_n, vehicle.hover_slope_n
    shift = 2.0 * force / slope - vehicle.hover_output
    return np.asarray(slope**2 / (4.0 * force) * np.array([shift**2, 2.0 * shift, 1.0]))


def _terms(curve: FloatArray) -> str:
    return f"{curve[0]:.9g} + x ({curve[1]:.9g} + {curve[2]:.9g} x)"


def _block(
    vehicle: JoinedVehicle, body: Multirotor, lag_s: float, defaults: dict[str, VehicleNumber]
) -> dict[str, float | list[float]]:
    """The block by its keys."""
    from rotorid.flying.vehicle_numbers import VehicleNumber

    known = vehicle.numbers.get("speed_max")
    fastest = FASTEST_RAD_S if known is None else known.value
    if known is None:
        unit = "the unit of speeds; --set speed_max=… gives the speed at full output"
        defaults["motor_omega_max"] = VehicleNumber(value=fastest, unit="rad/s", source="default", of=unit)
    turns = VehicleNumber(value=_FASTEST_TURNS_RAD_S, unit="rad/s", source="default", of="quadrotor_env.yaml")
    defaults["omega_max"] = turns
    turning = np.linalg.inv(body.inertia_kg_m2)
    along, across = np.abs(body.hubs_m[:, :2]).mean(axis=0)
    by_thrust = math.sqrt(across * turning[0, 0] * along * turning[1, 1])
    arm = math.sqrt(0.5) / (_LEVEL * body.mass_kg * by_thrust)
    curve = _curve(vehicle, body) / fastest ** np.arange(3)
    return {
        "mass": body.mass_kg,
        "arm_l": arm,
        "motor_omega_min": 0.0,
        "motor_omega_max": fastest,
        "motor_tau": lag_s,
        "thrust_map": [float(term) for term in curve[::-1]],
        "kappa": _UPRIGHT * body.mass_kg * arm**2 * body.rotors.torque_per_thrust_m * float(turning[2, 2]),
        "omega_max": [_FASTEST_TURNS_RAD_S] * 3,
    }


def _text(name: str, block: Mapping[str, float | list[float]]) -> str:
    lines = [f"{name}:"]
    for key, value in block.items():
        text = f"[{', '.join(map(yaml_number, value))}]" if isinstance(value, list) else yaml_number(value)
        lines.append(f"  {key}: {text}")
    return "\n".join(lines) + "\n"


# The equations


def flightmare_accelerations(
    block: Mapping[str, float | list[float]], speeds_rad_s: FloatArray, rates_rad_s: FloatArray
) -> FloatArray:
    """Its equations: accelerations without gravity, FRD.

    Parameters
    ----------
    block
        Of the file.
    speeds_rad_s
        Lagged ones of its rotors, shape ``(4,)``.
    rates_rad_s
        Of the body, FRD.
    """
    mass, arm, kappa = (float(np.asarray(block[key])) for key in ("mass", "arm_l", "kappa"))
    turn, inertia = FLU @ rates_rad_s, mass * arm**2 * np.array([_LEVEL, _LEVEL, _UPRIGHT])
    thrust = np.clip(np.polyval(np.asarray(block["thrust_map"]), speeds_rad_s), 0.0, _MOST_N)
    level = arm * math.sqrt(0.5) * (np.array([[1.0, -1.0, -1.0, 1.0], [-1.0, -1.0, 1.0, 1.0]]) @ thrust)
    moment = np.append(level, -kappa * (np.array(_SPINS) @ thrust)) - np.cross(turn, inertia * turn)
    return np.concatenate([[0.0, 0.0, -thrust.sum() / mass], FLU @ (moment / inertia)])


def _compared(
    vehicle: JoinedVehicle,
    body: Multirotor,
    block: Mapping[str, float | list[float]],
    rotors: Arranged,
    choices: ExportSettings,
) -> tuple[Compared, ...]:
    fastest = float(np.asarray(block["motor_omega_max"]))

    def accelerations(x: FloatArray, _v: FloatArray, w: FloatArray) -> FloatArray:
        return flightmare_accelerations(block, fastest * x, w)

    identified = own_slopes(vehicle, body, identified_motion(vehicle, body, lag_s=lag_of(vehicle, choices)))
    shares = body.hover_shares[list(rotors.order)]
    own = linearized(accelerations, shares, lag_s=float(np.asarray(block["motor_tau"])))
    exported = own.replaced(rotors.restored(own.by_output))
    fidelities: dict[str, Fidelity] = {**bullet_fidelities(body)}
    fidelities |= dict.fromkeys(("X_u", "Y_v", "Z_w", *AIR_OF_ROTATION), "not")
    if not _square(body):
        fidelities |= dict.fromkeys((ROLL, PITCH), "approximated")
    rows = compared(vehicle, identified, exported, fidelities, delay=choices.delay == "lag")
    return rows + in_flight(vehicle, body, accelerations, shares, drag="not")


def _square(body: Multirotor) -> bool:
    """Whether all rotors turn the vehicle alike about both level axes."""
    effects = np.abs(body.hubs_m[:, [1, 0]]) / np.diag(body.inertia_kg_m2)[:2]
    return bool(np.ptp(effects) <= _ALIKE * effects.mean())


def _left_out(
    vehicle: JoinedVehicle,
    body: Multirotor,
    block: Mapping[str, float | list[float]],
    rotors: Arranged,
    choices: ExportSettings,
) -> list[str]:
    arm, kappa = (float(np.asarray(block[key])) for key in ("arm_l", "kappa"))
    own, torque = body.rotors.layout.arm, body.rotors.torque_per_thrust_m
    remarks = [
        f"Inertia follows from mass and arm there: arm_l {arm:.3g} m (vehicle: {own:.3g} m) and kappa {kappa:.3g} m "
        f"(vehicle: {torque:.3g} m) give the identified accelerations.",
        "Flightmare has no air: drag, damping and inflow are lost.",
    ]
    if not _square(body):
        remarks.append("Roll and pitch answer alike in Flightmare: the file has their mean.")
    if rotors.mirrored:
        remarks.append("All rotors turn the other way there, so yaw from thrusts has the opposite sign.")
    up, down = lags_of(vehicle, choices, NAME)
    if not math.isclose(up, down):
        remarks.append(
            f"Flightmare has one lag: the mean of {up:.3g} s for rising and {down:.3g} s for falling outputs."
        )
    full = float(_curve(vehicle, body).sum())
    if full > _MOST_N:
        remarks.append(f"Flightmare limits a rotor to {_MOST_N:.3g} N, where this one makes {full:.3g} N.")
    remarks += full_thrust_words("a square of the output", full, body.rotors.thrust_at(1.0))
    words = "Flightmare has no delay: {} are lost; --delay-as-lag adds them to the lag."
    return [*remarks, *delay_words(vehicle, words, as_lag=choices.delay == "lag"), *lost_air(vehicle)]
