r"""What ``physical.flight`` knows of the air, as numbers of a vehicle: drag and inflow of its rotors in outputs.

A result of it has thrust without inflow, in the unit of its motors. Everybody else reads thrust and torque as rotors
make them in hover, by outputs from zero to one:

.. math::

    \bar c_i = c_i \left(1 - \frac{c_\lambda}{C} \frac{v_h}{\Omega_h}\right), \qquad
    \bar\kappa = \frac{\kappa \, C \, \Omega_h^2 + \kappa_\lambda v_h^2}{T(\Omega_h)}

with the thrust C without inflow at a speed of one.

What the rotors do to a vehicle that moves follows about hover as derivatives, X_u to N_r.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING

from rotorid.models.flight import CURVE_TERMS, full_thrust, hover_thrust
from rotorid.results.summary import airframe_of
from rotorid.simulation.multirotor import RotorFlow

if TYPE_CHECKING:
    from rotorid.results.model import IdentifiedModel
    from rotorid.results.summary import ParameterEstimate

AIR_UNITS: Mapping[str, str] = MappingProxyType(
    {
        "c_lambda": "N s/m",
        "k_d": "N s/m",
        "k_w": "N s^2/m^2",
        "c_h": "N s/m",
        "c_hw": "N s^2/m^2",
        "c_ha": "N s^2/m^2",
        "c_wake": "N s^2/m^3",
        "d_z": "N s^2/m^2",
        "m_f": "N s",
        "m_fx": "N s",
        "m_s": "N s",
        "kappa_lambda": "N s^2/m",
        "k_r": "N m s",
    }
)
"""Names of :data:`rotorid.models.flight.FLIGHT_PARAMETERS`, by outputs in place of speeds."""

PLACE = ("x_imu", "y_imu", "z_imu")
"""Where the accelerometer is, from the center of gravity, in meters."""

_PER_SPEED = ("c_lambda", "k_d", "c_h", "m_f", "m_fx", "m_s", "k_r", "J_r")
"""What is by the speed of a rotor."""

_FLOW: Mapping[str, str] = MappingProxyType(
    {
        "edge_lift_n_s_m": "c_h",
        "edge_climb_lift_n_s2_m2": "c_hw",
        "edge_speed_lift_n_s2_m2": "c_ha",
        "wake_n_s2_m3": "c_wake",
        "climb_drag_n_s2_m2": "k_w",
        "flapping_n_s": "m_f",
        "forward_flapping_n_s": "m_fx",
        "side_flapping_n_s": "m_s",
        "inflow_torque_n_s2_m": "kappa_lambda",
        "yaw_damping_n_m_s": "k_r",
    }
)


def hover_parameters(model: IdentifiedModel) -> Mapping[str, ParameterEstimate]:
    """Parameters of a result of motors, with thrust and torque as they are in hover.

    Raises
    ------
    ModelError
        The rotors of the result do not carry its weight.
    """
    flight, motors, own = model.flight, model.motors, model.parameters
    if flight is None or motors is None:
        return own
    values = {name: estimate.value for name, estimate in own.items() if estimate.status != "dropped"}
    hover = hover_thrust(values, airframe_of(motors, flight, values["m"]))
    found = dict(own)
    left = hover.coefficient / full_thrust(values)
    stated = flight.hover.get("thrust_coefficient")
    for name in CURVE_TERMS:
        if name in values:
            std = own[name].std
            alone = len(set(CURVE_TERMS) & set(values)) == 1 and stated is not None
            # What inflow and static thrust trade cancels in hover.
            std = stated.std if alone and stated is not None else None if std is None else left * std
            found[name] = replace(own[name], value=left * own[name].value, std=std)
    if "kappa" in values:
        static = full_thrust(values) * hover.speed**2
        thrust = hover.coefficient * hover.speed**2
        torque = values["kappa"] * static + values.get("kappa_lambda", 0.0) * hover.induced_m_s**2
        share = torque / thrust / values["kappa"]
        kappa = own["kappa"]
        std = None if kappa.std is None else share * kappa.std
        found["kappa"] = replace(kappa, value=share * kappa.value, std=std)
        if "I_zz" in values:
            found["kappa_per_I_zz"] = _ratio(found["kappa"], own["I_zz"])
    return found


def _ratio(kappa: ParameterEstimate, inertia: ParameterEstimate) -> ParameterEstimate:
    value = kappa.value / inertia.value
    shares = [estimate.std / abs(estimate.value) for estimate in (kappa, inertia) if estimate.std and estimate.value]
    std = abs(value) * math.hypot(*shares) if shares else None
    return replace(kappa, value=value, std=std, unit="1/(kg m)", status="tied")


def air_factors(model: IdentifiedModel, *, full: float | None, scale: float | None, length: float) -> dict[str, float]:
    """What brings the numbers of the air, and ``J_r``, to outputs, kilograms and meters; what stays unknown is absent.

    Parameters
    ----------
    full
        Speed at full output in the unit of the motors; ``None`` where nobody knows.
    scale
        Factor of mass, thrust and inertia; ``None`` where they are known by the kilogram only.
    length
        Factor of the arm.
    """
    if scale is None or model.flight is None:
        return {}
    factors = {name: scale for name in AIR_UNITS if name not in _PER_SPEED}
    factors["c_wake"] /= length
    if full is not None:
        factors |= dict.fromkeys(_PER_SPEED, scale * full)
    return factors


def rotor_flow(values: Mapping[str, float], *, rotors: int, density_kg_m3: float) -> RotorFlow | None:
    """What rotors do in moving air beyond drag and inflow that are linear; ``None`` where nothing of it is known.

    Parameters
    ----------
    values
        Numbers of a vehicle, ``disc_area`` being that of all rotors.
    """
    known = {key: values[name] for key, name in _FLOW.items() if values.get(name, 0.0) != 0.0}
    # Without inflow the induced velocity does nothing.
    disc_m2 = values.get("disc_area", 0.0) / rotors
    breathing = disc_m2 > 0.0 and any(values.get(name, 0.0) != 0.0 for name in ("c_lambda", "m_f", "kappa_lambda"))
    if not known and not breathing:
        return None
    return RotorFlow(disc_m2=disc_m2 if breathing else 0.0, air_density_kg_m3=density_kg_m3, **known)
