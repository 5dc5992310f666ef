"""Rotors in moving air for simulators that are loops in Python: the equations of a vehicle, copied into their files.

:func:`rotor_air` is written into the file of a target as it stands here, so that what the round trip judges is what
flies there. Axes are forward, left, up.
"""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING

import numpy as np

from rotorid.typing import FloatArray

if TYPE_CHECKING:
    from rotorid.simulation.multirotor import Multirotor

_FLU = np.diag([1.0, -1.0, -1.0])


def rotor_air(air: dict[str, np.ndarray], x: np.ndarray, velocity: np.ndarray, rates: np.ndarray) -> np.ndarray:
    """Force (N) and moment (N m) that motion through the air adds to rotors at the lagged outputs x."""
    c_0, c_1, c_2 = air["curve"]
    share = np.sqrt(np.maximum(c_0 + x * (c_1 + x * c_2), 0.0) / (c_0 + c_1 + c_2))
    hubs, hover = air["hubs"], air["induced"] * share
    local = velocity + np.cross(rates, hubs)
    across, climb, edge = local[:, :2], local[:, 2], np.hypot(local[:, 0], local[:, 1])
    # The induced velocity of momentum theory, from that of hover by Newton's method.
    induced = hover
    for _ in range(12):
        through = induced + climb
        length = np.sqrt(edge**2 + through**2) + 1e-9
        slope = np.maximum(1.0 + hover**2 * through / length**3, 0.3)
        induced = np.clip(induced - (induced - hover**2 / length) / slope, 0.0, 3.0 * hover + 1.0)
    inflow = climb + induced
    lift = -air["c_lambda"] * share * (inflow - hover)
    lift = lift + edge * (air["c_h"] * share + air["c_hw"] * climb + air["c_ha"] * np.abs(climb))
    lift = lift + air["c_wake"] * (hubs[:, :2] * across).sum(axis=1) * climb
    push = np.column_stack([-(air["k_d"] * share + air["k_w"] * climb)[:, None] * across, lift])
    moment = np.cross(hubs, push).sum(axis=0)
    tilting = share * induced / (np.abs(inflow) + np.hypot(edge, inflow) + 1e-6)
    rolling = air["m_s"] * air["spins"] * share
    moment[0] += (air["m_f"] * tilting * local[:, 1] + rolling * local[:, 0]).sum()
    moment[1] += (-(air["m_f"] + air["m_fx"]) * tilting * local[:, 0] + rolling * local[:, 1]).sum()
    moment[2] -= (air["kappa_lambda"] * air["spins"] * (inflow**2 - hover**2)).sum()
    moment[2] -= (air["k_r"] * share).sum() * rates[2]
    force = push.sum(axis=0)
    force[2] -= air["d_z"] * velocity[2] * np.sqrt((velocity**2).sum())
    return np.concatenate([force, moment])


def air_numbers(body: Multirotor) -> dict[str, FloatArray]:
    """What :func:`rotor_air` takes of a vehicle, by outputs."""
    plain = body.body()
    numbers = {
        "induced": plain.induced_per_share,
        "c_lambda": plain.inflow,
        "c_h": plain.edge_lift,
        "c_hw": plain.edge_climb_lift,
        "c_ha": plain.edge_speed_lift,
        "c_wake": plain.wake,
        "k_d": plain.induced_drag,
        "k_w": plain.climb_drag,
        "m_f": plain.flapping,
        "m_fx": plain.forward_flapping,
        "m_s": body.rotors.flow.side_flapping_n_s if body.rotors.flow is not None else 0.0,
        "kappa_lambda": plain.inflow_torque,
        "k_r": plain.yaw_damping,
        "d_z": plain.vertical_drag,
    }
    return {
        # Of rotors whose drag goes by the output itself, that is the speed.
        "curve": np.array(body.rotors.thrust if plain.has_flow else (0.0, 0.0, 1.0)),
        "hubs": body.hubs_m @ _FLU,
        "spins": np.array(body.rotors.layout.spins),
        **{name: np.array(value) for name, value in numbers.items()},
    }


def source(body: Multirotor) -> str:
    """The numbers and the function as lines of a file, which imports numpy as ``np``."""
    rows = []
    for name, value in air_numbers(body).items():
        text = np.array2string(value, separator=", ", formatter={"float_kind": lambda number: f"{number + 0.0:.9g}"})
        rows.append(f'    "{name}": np.array({" ".join(text.split())}),')
    return "\n".join(["ROTOR_AIR = {", *rows, "}", "", "", inspect.getsource(rotor_air).rstrip()])
