"""Units of the constants of motors, and the thrust that follows from them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rotorid.flights.motor_data import MotorData
from rotorid.models.motors import SPIN_UP
from rotorid.models.parameter import ParameterSet
from rotorid.results.summary import Derived
from rotorid.uncertainty.cramer_rao import Bounds
from rotorid.units import STANDARD_GRAVITY_M_S2

_BY_SPEED = {"c_1": "N s/rad", "c_2": "N s^2/rad^2", SPIN_UP: "1"}
_PER_MASS = {"kg": "1", "N": "m/s^2", "N s/rad": "m/(s rad)", "N s^2/rad^2": "m/rad^2"}


def units_of(parameters: ParameterSet, *, scaled: bool, arm_known: bool, speeds: bool) -> dict[str, str]:
    """Units of the identified values: without a mass all are per kilogram, without an arm inertia is per meter."""
    units = {parameter.name: parameter.unit for parameter in parameters}
    if speeds:
        # By the speed that was measured, and not by a share of full output.
        units |= {name: unit for name, unit in _BY_SPEED.items() if name in units}
    if not scaled:
        units = {name: _PER_MASS.get(unit, unit) for name, unit in units.items()}
    moment = {(True, True): "kg m^2", (True, False): "kg m", (False, True): "m^2", (False, False): "m"}
    units |= {name: moment[scaled, arm_known] for name in ("I_xx", "I_yy") if name in units}
    if not scaled:
        # Torque over thrust does not depend on the mass, and inertia of yaw does.
        of_yaw = {"kappa_per_I_zz": "1/m", "I_zz": "m^2", "I_zz/kappa": "m"}
        units |= {name: unit for name, unit in of_yaw.items() if name in units or "/" in name}
    return units


def derived_numbers(
    parameters: ParameterSet, bounds: Bounds, at_hover: Bounds, hover: float, data: MotorData, *, scaled: bool
) -> dict[str, Derived]:
    """Thrust at hover, its slope, and what the rotors give at full output."""

    def of_curve(terms: Mapping[str, float], unit: str, limits: Bounds = bounds) -> Derived:
        value = sum(parameters[name].value * factor for name, factor in terms.items() if name in parameters.names)
        return Derived(value=float(value), std=_std(limits, terms), unit=unit if scaled else _PER_MASS[unit])

    slope_unit = "N s/rad" if data.kind == "speed" else "N"
    found = {
        "thrust_hover": of_curve({"c_0": 1.0, "c_1": hover, "c_2": hover**2}, "N", at_hover),
        "thrust_slope": of_curve({"c_1": 1.0, "c_2": 2.0 * hover}, slope_unit),
    }
    if data.kind == "speed":
        return found
    found["thrust_full"] = of_curve({"c_0": 1.0, "c_1": 1.0, "c_2": 1.0}, "N")
    full, mass = found["thrust_full"].value, parameters["m"].value
    weight = mass * STANDARD_GRAVITY_M_S2 / data.layout.rotors
    gradient = {"c_0": 1.0 / weight, "c_1": 1.0 / weight, "c_2": 1.0 / weight, "m": -full / (weight * mass)}
    found["thrust_to_weight"] = Derived(value=full / weight, std=_std(bounds, gradient), unit="1")
    return found


def _std(bounds: Bounds, gradient: Mapping[str, float]) -> float:
    slopes = np.array([gradient.get(name, 0.0) for name in bounds.names])
    return float(np.sqrt(slopes @ bounds.covariance @ slopes))
