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
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from rotorid.models.flight import CURVE_TERMS, full_thrust, hover_thrust
from rotorid.models.flight_derivatives import FlightDerivatives, flight_derivatives
from rotorid.results.model import bounds_of
from rotorid.results.summary import airframe_of
from rotorid.simulation.multirotor import RotorFlow
from rotorid.typing import FloatArray
from rotorid.uncertainty.propagation import covariance_of

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

PLACE: tuple[str, ...] = ("x_imu", "y_imu", "z_imu")
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
    if model.flight is None:
        return model.parameters
    numbers = {name: estimate.value for name, estimate in model.parameters.items() if estimate.status != "dropped"}
    hovering, found = _in_hover(model, numbers), dict(model.parameters)
    spread = _hover_covariance(model, numbers).diagonal().tolist()
    for (name, value), variance in zip(hovering.items(), spread, strict=True):
        std = math.sqrt(variance) if variance > 0.0 else None
        if name in found:
            # What was held stays given, though inflow moves it.
            found[name] = replace(found[name], value=value, std=None if found[name].status == "fixed" else std)
        else:
            found[name] = replace(found["kappa"], value=value, std=std, unit="1/(kg m)", status="tied")
    return found


def _in_hover(model: IdentifiedModel, values: Mapping[str, float]) -> dict[str, float]:
    """Thrust and torque as rotors make them in hover, by the names of the coefficients; see the head."""
    assert model.motors is not None
    assert model.flight is not None
    hover = hover_thrust(values, airframe_of(model.motors, model.flight, values["m"]))
    static = full_thrust(values)
    found = {name: hover.coefficient / static * values[name] for name in CURVE_TERMS if name in values}
    if "kappa" in values:
        torque = values["kappa"] * static * hover.speed**2 + values.get("kappa_lambda", 0.0) * hover.induced_m_s**2
        found["kappa"] = torque / (hover.coefficient * hover.speed**2)
        if "I_zz" in values:
            found["kappa_per_I_zz"] = found["kappa"] / values["I_zz"]
    return found


def _hover_covariance(model: IdentifiedModel, values: Mapping[str, float]) -> FloatArray:
    """Covariance of :func:`_in_hover`: what inflow and thrust without it trade cancels there."""
    return covariance_of(lambda of: list(_in_hover(model, of).values()), values, model.bounds)


def curve_correlation(model: IdentifiedModel, terms: Sequence[str]) -> FloatArray:
    """Correlation of coefficients of the thrust curve in hover, shape ``(terms, terms)``."""
    if model.flight is None:
        return bounds_of(model.bounds, terms).correlation
    numbers = {name: estimate.value for name, estimate in model.parameters.items() if estimate.status != "dropped"}
    rows = [list(_in_hover(model, numbers)).index(name) for name in terms]
    covariance = _hover_covariance(model, numbers)[np.ix_(rows, rows)]
    std = np.sqrt(np.maximum(covariance.diagonal(), 1e-300))
    return np.asarray(covariance / np.outer(std, std))


_STILL = frozenset({"T_motor", "J_r", *PLACE})
"""Numbers of a flight that no derivative of motion depends on."""


def implied_derivatives(
    model: IdentifiedModel, speeds_m_s: Sequence[float], *, exact: Iterable[str] = ()
) -> FlightDerivatives:
    """Stability derivatives that a result of ``physical.flight`` implies, as its numbers err together.

    Parameters
    ----------
    speeds_m_s
        Of level flight in still air.
    exact
        Numbers that do not err, because somebody gave them.
    """
    assert model.motors is not None
    assert model.flight is not None
    values = {name: estimate.value for name, estimate in model.parameters.items() if estimate.status != "dropped"}
    without = _STILL.union(exact)
    known = [name for name in model.bounds.names if name in values and name not in without]
    return flight_derivatives(
        values,
        airframe_of(model.motors, model.flight, values["m"]),
        speeds_m_s,
        free=known,
        covariance=bounds_of(model.bounds, known).covariance,
    )


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
