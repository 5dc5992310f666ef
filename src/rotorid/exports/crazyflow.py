r"""crazyflow and drone-models: a section of TOML with the keywords of their ``first_principles`` model.

Its equations, in axes forward, left, up, by the speed :math:`n_i` of a rotor in turns a minute:

.. math::

    \dot n_i = (n_{c,i} - n_i)/T, \qquad F_i = a_0 + a_1 n_i + a_2 n_i^2, \qquad
    m \dot v = m g + R \left( \textstyle\sum_i F_i \, e_z + D R^T v \right), \qquad
    J \dot\omega = \mathrm{diag}(L, L, 0) M F + \mathrm{diag}(0, 0, 1) M Q - \omega \times J \omega

with the torques :math:`Q_i = \kappa F_i`. Vehicles of theirs are square: the first two rows of the mixing matrix
:math:`M` are signs. Its equations take any number, so that a rectangle is :math:`y_i/L` and :math:`-x_i/L`.

Speeds here are outputs in other units, :math:`n_i = n_1 x_i`, by which thrust has the identified coefficients.

References
----------
drone-models 0.1.0, ``drone_models/first_principles/model.py``; crazyflow,
``crazyflow/dynamics/first_principles/dynamics.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rotorid.exports.arrangement import ROTORS, require_four_upright
from rotorid.exports.learners import AIR_OF_ROTATION, DrawnFiles, forward_left_up, lags_of, numbered, plain
from rotorid.exports.mujoco import FLU, own_slopes
from rotorid.exports.px4_sih import lag_of
from rotorid.exports.rotorpy import FASTEST_RAD_S
from rotorid.exports.round_trip import compared, hover_air, identified_motion, in_flight, linearized, lost_air
from rotorid.exports.settings import ExportSettings
from rotorid.exports.target import Compared, Exported, Fidelity, table_lines
from rotorid.exports.thrust import delay_words
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

if TYPE_CHECKING:
    from rotorid.flying.vehicle_from_results import JoinedVehicle
    from rotorid.simulation.multirotor import Multirotor

NAME = "crazyflow"

_RPM = 60.0 / (2.0 * math.pi)
_SQUARE = 0.005
"""Share by which levers may differ from one length, and still be of a square."""


def export(vehicle: JoinedVehicle, choices: ExportSettings) -> Exported:
    """One TOML file with a section of the vehicle's name.

    Parameters
    ----------
    vehicle
        With four upright rotors.
    choices
        ``delay="lag"`` adds the delay to the lag.

    Raises
    ------
    UsageError
        Mass, inertia, the lag of the motors or another number is not known.
    ModelError
        There are not four rotors, they are tilted, or the lag is zero.
    """
    from rotorid.flying.vehicle_from_results import require

    body = require(vehicle, "m", "I_xx", "I_yy", "I_zz", "kappa", "arm", "T_motor", target=NAME)
    require_four_upright(body.rotors.layout, NAME)
    section = _section(vehicle, body, lags_of(vehicle, choices, NAME))
    rows = _compared(vehicle, body, section, choices)
    name = choices.names
    head = [f"{name}: an identified multirotor for crazyflow and drone-models, by rotorid", "", *table_lines(rows)]
    file = f"{name}_crazyflow.toml"
    return Exported(
        target=NAME,
        files={file: "\n".join([*(f"# {line}".rstrip() for line in head), "", _toml(name, section)])},
        compared=rows,
        left_out=tuple(_left_out(vehicle, body, choices)),
        start=_START.format(read=f'tomllib.loads(Path("{file}").read_text())["{name}"]'),
    )


def together(drawn: Sequence[Exported], name: str) -> DrawnFiles:
    """One TOML file with a section for each drawn vehicle."""
    import tomllib

    # Single vehicles all have the same name: only a number makes sections of one file.
    sections = [
        tomllib.loads(text)[name] for vehicle in drawn for text in vehicle.files.values() if isinstance(text, str)
    ]
    texts = [_toml(own, section) for own, section in zip(numbered(name, len(drawn)), sections, strict=True)]
    file = f"draws/{name}_crazyflow.toml"
    read = f'random.choice(list(tomllib.loads(Path("{file}").read_text()).values()))'
    return DrawnFiles(files={file: "\n".join(texts)}, start="import random\n" + _START.format(read=read))


_START = """\
import inspect, tomllib
from functools import partial
from pathlib import Path
import numpy as np
from drone_models.first_principles import dynamics  # or crazyflow.dynamics.first_principles
drone = {read}
drone["J_inv"] = np.linalg.inv(drone["J"])
names = set(inspect.signature(dynamics).parameters) & set(drone)
fly = partial(dynamics, **{{name: np.asarray(drone[name]) for name in names}})  # commands: rpm_max * outputs"""


def _toml(name: str, section: Mapping[str, object]) -> str:
    return "\n".join([f"[{name}]", *(f"{key} = {value}" for key, value in section.items())]) + "\n"


def _section(vehicle: JoinedVehicle, body: Multirotor, lags_s: tuple[float, float]) -> dict[str, Any]:
    """The section by its keys."""
    known = vehicle.numbers.get("speed_max")
    fastest = (FASTEST_RAD_S if known is None else known.value) * _RPM
    thrust = np.array(body.rotors.thrust) / fastest ** np.arange(3)
    hubs = body.hubs_m @ FLU
    length = float(np.abs(hubs[:, :2]).mean())
    levers = np.stack([hubs[:, 1], -hubs[:, 0]]) / length
    if _square(body):
        levers = np.sign(levers)
    up, down = lags_s
    values: dict[str, FloatArray | float] = {
        "mass": body.mass_kg,
        "gravity_vec": np.array([0.0, 0.0, -STANDARD_GRAVITY_M_S2]),
        "J": forward_left_up(body.inertia_kg_m2),
        "L": length,
        "prop_inertia": 0.0,
        "rpm2thrust": thrust,
        "rpm2torque": body.rotors.torque_per_thrust_m * thrust,
        "rotor_dyn_coef": np.array([1.0 / up, 0.0, 1.0 / down, 0.0]),
        "mixing_matrix": np.vstack([levers, -body.rotors.layout.spins]),
        "drag_matrix": forward_left_up(hover_air(body)[:3, :3]),
        "thrust_min": max(body.rotors.thrust_at(0.0), 0.0),
        "thrust_max": body.rotors.thrust_at(1.0),
        "rpm_max": fastest,
    }
    return {key: plain(value) for key, value in values.items()}


def _square(body: Multirotor) -> bool:
    levers = np.abs(body.hubs_m[:, :2])
    return bool(np.abs(levers / levers.mean() - 1.0).max() <= _SQUARE)


# The equations


def crazyflow_accelerations(
    section: Mapping[str, Any], rpm: FloatArray, velocity_m_s: FloatArray, rates_rad_s: FloatArray
) -> FloatArray:
    """Its equations: accelerations without gravity, FRD.

    Parameters
    ----------
    section
        Of the file.
    rpm
        Lagged speeds of the rotors, shape ``(4,)``.
    velocity_m_s, rates_rad_s
        Over ground and of the body, FRD.
    """
    speed, turn, inertia = FLU @ velocity_m_s, FLU @ rates_rad_s, np.asarray(section["J"])
    powers = np.stack([np.ones(ROTORS), rpm, rpm**2])
    thrust, torque = (np.asarray(section[key]) @ powers for key in ("rpm2thrust", "rpm2torque"))
    mixing = np.asarray(section["mixing_matrix"])
    moment = np.append(section["L"] * (mixing[:2] @ thrust), mixing[2] @ torque) - np.cross(turn, inertia @ turn)
    force = np.array([0.0, 0.0, thrust.sum()]) + np.asarray(section["drag_matrix"]) @ speed
    return np.concatenate([FLU @ force / section["mass"], FLU @ np.linalg.solve(inertia, moment)])


def _compared(
    vehicle: JoinedVehicle, body: Multirotor, section: Mapping[str, Any], choices: ExportSettings
) -> tuple[Compared, ...]:
    def accelerations(x: FloatArray, v: FloatArray, w: FloatArray) -> FloatArray:
        return crazyflow_accelerations(section, section["rpm_max"] * x, v, w)

    identified = own_slopes(vehicle, body, identified_motion(vehicle, body, lag_s=lag_of(vehicle, choices)))
    up, _, down, _ = section["rotor_dyn_coef"]
    exported = linearized(accelerations, body.hover_shares, lag_s=0.5 * (1.0 / up + 1.0 / down))
    fidelities: dict[str, Fidelity] = dict.fromkeys(AIR_OF_ROTATION, "not")
    rows = compared(vehicle, identified, exported, fidelities, delay=choices.delay == "lag")
    return rows + in_flight(vehicle, body, accelerations, body.hover_shares)


def _left_out(vehicle: JoinedVehicle, body: Multirotor, choices: ExportSettings) -> list[str]:
    remarks = ["crazyflow has drag alone: moments by rates and by velocity are lost, and drag is that of hover."]
    if not {"X_u", "Y_v", "Z_w"} & set(vehicle.numbers):
        remarks = ["Drag is not identified: the vehicle has none. crazyflow has no moments by rates and velocity."]
    if "h" in vehicle.numbers:
        remarks.append("prop_inertia is 0: drone-models 0.1.0 has the gyroscopic moment with a wrong sign.")
    if not _square(body):
        remarks.append("The rotors are no square: mixing_matrix has levers over L, where crazyflow's own has signs.")
    words = "crazyflow has no delay: {} are lost; --delay-as-lag adds them to the lag."
    return [*remarks, *delay_words(vehicle, words, as_lag=choices.delay == "lag"), *lost_air(vehicle)]
