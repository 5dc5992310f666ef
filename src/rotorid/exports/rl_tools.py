r"""rl-tools: the ``dynamics`` of a vehicle as JSON, for its simulator l2f and for policies trained there as RAPTOR.

Its equations, in axes forward, left, up, with the lagged output :math:`u_i` of a rotor:

.. math::

    T \dot u_i = x_i - u_i, \qquad F_i = c_0 + c_1 u_i + c_2 u_i^2, \qquad
    m \dot v = m g + R \sum_i F_i \, a_i, \qquad
    J \dot\omega = \sum_i F_i \left( r_i \times a_i + \kappa \, b_i \right) - \omega \times J \omega

with one lag for outputs that rise and one for those that fall. These are the equations of the identified rotors, so
that no number is converted. Air is no part of them.

References
----------
rl-tools, ``include/rl_tools/rl/environments/l2f/operations_generic/60_dynamics.h``, ``operations_cpu.h``.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rotorid.exports.arrangement import ROTORS, require_four
from rotorid.exports.learners import (
    AIR_OF_ROTATION,
    DrawnFiles,
    forward_left_up,
    lags_of,
    numbered,
    plain,
)
from rotorid.exports.mujoco import FLU, own_slopes
from rotorid.exports.px4_sih import lag_of
from rotorid.exports.round_trip import compared, identified_motion, in_flight, linearized, lost_air
from rotorid.exports.settings import ExportSettings
from rotorid.exports.target import Compared, Exported, Fidelity
from rotorid.exports.thrust import delay_words
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

if TYPE_CHECKING:
    from rotorid.flying.vehicle_from_results import JoinedVehicle
    from rotorid.simulation.multirotor import Multirotor

NAME = "rl-tools"

_AIR = ("X_u", "Y_v", "Z_w", *AIR_OF_ROTATION)


def export(vehicle: JoinedVehicle, choices: ExportSettings) -> Exported:
    """One JSON file with the block ``dynamics``.

    Parameters
    ----------
    vehicle
        With four rotors, tilted ones too.
    choices
        ``delay="lag"`` adds the delay to the lag.

    Raises
    ------
    UsageError
        Mass, inertia, the lag of the motors or another number is not known.
    ModelError
        There are not four rotors, or the lag is zero.
    """
    from rotorid.flying.vehicle_from_results import require

    body = require(vehicle, "m", "I_xx", "I_yy", "I_zz", "kappa", "arm", "T_motor", target=NAME)
    require_four(body.rotors.layout, NAME)
    dynamics = _dynamics(body, lags_of(vehicle, choices, NAME))
    file = f"{choices.names}_rl_tools.json"
    return Exported(
        target=NAME,
        files={file: _text({"dynamics": dynamics})},
        compared=_compared(vehicle, body, dynamics, choices),
        left_out=tuple(_left_out(vehicle, choices)),
        start=_START.format(read=f'json.loads(Path("{file}").read_text())["dynamics"]'),
    )


def together(drawn: Sequence[Exported], name: str) -> DrawnFiles:
    """One JSON file with the ``dynamics`` of each drawn vehicle by its name."""
    blocks = [json.loads(text)["dynamics"] for vehicle in drawn for text in vehicle.files.values()]
    file = f"draws/{name}_rl_tools.json"
    read = f'random.choice(list(json.loads(Path("{file}").read_text()).values()))'
    start = "import random\n" + _START.format(read=read)
    return DrawnFiles(files={file: _text(dict(zip(numbered(name, len(blocks)), blocks, strict=True)))}, start=start)


_START = """\
import json, l2f
from pathlib import Path
device, environment, parameters = l2f.Device(), l2f.Environment(), l2f.Parameters()
l2f.initialize_environment(device, environment)
l2f.initial_parameters(device, environment, parameters)
values = json.loads(l2f.parameters_to_json(device, environment, parameters))
values["dynamics"] = {read}
l2f.parameters_from_json(device, environment, json.dumps(values), parameters)"""


def _text(block: Mapping[str, Any]) -> str:
    return json.dumps(block, indent=2, allow_nan=False) + "\n"


def _dynamics(body: Multirotor, lags_s: tuple[float, float]) -> dict[str, Any]:
    """The block by its keys."""
    layout, rotors = body.rotors.layout, body.rotors
    inertia = np.asarray(plain(forward_left_up(body.inertia_kg_m2)))
    up, down = lags_s
    values: dict[str, FloatArray | float] = {
        "rotor_positions": body.hubs_m @ FLU,
        "rotor_thrust_directions": layout.thrust_axes.T @ FLU,
        "rotor_torque_directions": layout.torque_axes.T @ FLU,
        "rotor_thrust_coefficients": np.tile(rotors.thrust, (ROTORS, 1)),
        "rotor_torque_constants": np.full(ROTORS, rotors.torque_per_thrust_m),
        "rotor_time_constants_rising": np.full(ROTORS, up),
        "rotor_time_constants_falling": np.full(ROTORS, down),
        "mass": body.mass_kg,
        "gravity": np.array([0.0, 0.0, -STANDARD_GRAVITY_M_S2]),
        "J": inertia,
        "J_inv": np.linalg.inv(inertia),
        "hovering_throttle_relative": float(body.hover_shares.mean()),
    }
    return {**{key: plain(value) for key, value in values.items()}, "action_limit": {"min": 0.0, "max": 1.0}}


# The equations


def rl_tools_accelerations(dynamics: Mapping[str, Any], outputs: FloatArray, rates_rad_s: FloatArray) -> FloatArray:
    """Its equations: accelerations without gravity, FRD.

    Parameters
    ----------
    dynamics
        The block of the file.
    outputs
        Lagged ones of the rotors, shape ``(4,)``.
    rates_rad_s
        Of the body, FRD.
    """
    turn, inertia = FLU @ rates_rad_s, np.asarray(dynamics["J"])
    powers = np.stack([np.ones(ROTORS), outputs, outputs**2], axis=1)
    thrust = (np.asarray(dynamics["rotor_thrust_coefficients"]) * powers).sum(axis=1)[:, None]
    push = np.asarray(dynamics["rotor_thrust_directions"]) * thrust
    torque = np.asarray(dynamics["rotor_torque_constants"])[:, None] * thrust * dynamics["rotor_torque_directions"]
    moment = (torque + np.cross(dynamics["rotor_positions"], push)).sum(axis=0) - np.cross(turn, inertia @ turn)
    return np.concatenate([FLU @ push.sum(axis=0) / dynamics["mass"], FLU @ np.asarray(dynamics["J_inv"]) @ moment])


def _compared(
    vehicle: JoinedVehicle, body: Multirotor, dynamics: Mapping[str, Any], choices: ExportSettings
) -> tuple[Compared, ...]:
    def accelerations(x: FloatArray, _v: FloatArray, w: FloatArray) -> FloatArray:
        return rl_tools_accelerations(dynamics, x, w)

    lag_s = lag_of(vehicle, choices)
    identified = own_slopes(vehicle, body, identified_motion(vehicle, body, lag_s=lag_s))
    keys = ("rotor_time_constants_rising", "rotor_time_constants_falling")
    exported = linearized(accelerations, body.hover_shares, lag_s=float(np.mean([dynamics[key][0] for key in keys])))
    fidelities: dict[str, Fidelity] = dict.fromkeys(_AIR, "not")
    rows = compared(vehicle, identified, exported, fidelities, delay=choices.delay == "lag")
    return rows + in_flight(vehicle, body, accelerations, body.hover_shares, drag="not")


def _left_out(vehicle: JoinedVehicle, choices: ExportSettings) -> list[str]:
    remarks = ["rl-tools has no air: drag, damping and inflow are lost, and no gyroscopic moment of rotors."]
    if not set(_AIR) & set(vehicle.numbers):
        remarks = ["rl-tools has no air, and none was identified."]
    words = "rl-tools has no delay: {} are lost; --delay-as-lag adds them to the lag."
    return [*remarks, *delay_words(vehicle, words, as_lag=choices.delay == "lag"), *lost_air(vehicle)]
