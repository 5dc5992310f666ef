"""What a fit of flight says of hover: thrust, slope, speed and drag with their errors, and the motion about it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rotorid.fitting.flight.fit import FlightFit
from rotorid.models.flight import (
    FLIGHT_PARAMETERS,
    Airframe,
    HoverThrust,
    full_thrust,
    hover_thrust,
)
from rotorid.models.parameter import ParameterSet
from rotorid.models.rotors import RotorLayout
from rotorid.models.structure import LinearStructure
from rotorid.models.toml import from_toml
from rotorid.results.summary import Derived
from rotorid.uncertainty.cramer_rao import Bounds
from rotorid.uncertainty.propagation import covariance_of

_BY_OUTPUT: Mapping[str, str] = {
    "N s/rad": "N",
    "N s^2/rad^2": "N",
    "N s^2/(m rad)": "N s/m",
    "N s^2/rad": "N s",
    "N m s^2/rad^2": "N m s/rad",
}
"""Units by outputs, a share of the full speed, in place of rad/s."""

_PER_MASS: Mapping[str, str] = {
    "kg": "1",
    "N": "m/s^2",
    "N s": "m/s",
    "N s/m": "1/s",
    "N s/rad": "m/(s rad)",
    "N s^2/m": "1",
    "N s^2/m^2": "1/m",
    "N s^2/m^3": "1/m^2",
    "N s^2/rad": "m/rad",
    "N s^2/rad^2": "m/rad^2",
    "N s^2/(m rad)": "1/rad",
    "N m s": "m^2/s",
    "N m s/rad": "m^2/(s rad)",
    "N m s^2/rad^2": "m^2/rad^2",
    "kg m^2": "m^2",
}
"""Units of a vehicle of which only what it does per kilogram is known."""


def flight_units(*, scaled: bool, speeds: bool) -> dict[str, str]:
    """Unit of each parameter.

    Parameters
    ----------
    scaled
        Whether the mass is known; otherwise all numbers are per kilogram.
    speeds
        Whether the motors are known by measured speeds, and not by outputs.

    Examples
    --------
    >>> flight_units(scaled=True, speeds=True)["k_d"], flight_units(scaled=False, speeds=False)["k_d"]
    ('N s^2/(m rad)', '1/s')
    """
    units = {name: parameter.unit for name, parameter in FLIGHT_PARAMETERS.items()}
    if not speeds:
        units = {name: _BY_OUTPUT.get(unit, unit) for name, unit in units.items()} | {"J_r": "N m s"}
    return units if scaled else {name: _PER_MASS.get(unit, unit) for name, unit in units.items()}


def hover_numbers(fit: FlightFit, bounds: Bounds, *, scaled: bool, speeds: bool) -> dict[str, Derived]:
    r"""Numbers of hover in still air, whose errors follow from the covariance by their slopes.

    ``thrust_coefficient`` is thrust of a rotor over its speed squared, ``thrust_slope`` its change with that speed,
    ``speed`` and ``induced_velocity`` those that carry the weight, and ``drag`` that of all rotors over mass,

    .. math:: D = n k_d \Omega / m

    ``thrust_hover`` is thrust at the speed that was found. Of motors that are known by outputs, ``output`` is the one
    of hover, ``output_slope`` the change of thrust with it, ``thrust_full`` thrust at full output and
    ``thrust_to_weight`` that over the share of the weight.

    Parameters
    ----------
    scaled
        Whether the mass is known; otherwise numbers are per kilogram.
    speeds
        Whether motors are known by measured speeds.
    """
    units = flight_units(scaled=scaled, speeds=speeds)
    force = units["c_0"]
    of = {
        "thrust_coefficient": units["c_2"],
        "thrust_slope": units["c_1"],
        "speed": "rad/s" if speeds else "1",
        "induced_velocity": "m/s",
        "drag": "1/s",
        "thrust_hover": force,
        "output": "1",
        "output_slope": force,
        "thrust_full": force,
        "thrust_to_weight": "1",
    }
    at_speed = fit.hover.speed
    values = _numbers(fit.values, fit.airframe, at_speed, speeds=speeds)
    spread = covariance_of(
        lambda of: list(_numbers(of, fit.airframe, at_speed, speeds=speeds).values()), fit.values, bounds
    )
    return {
        name: Derived(value=value, std=float(np.sqrt(max(variance, 0.0))), unit=of[name])
        for (name, value), variance in zip(values.items(), spread.diagonal().tolist(), strict=True)
    }


def _numbers(values: Mapping[str, float], airframe: Airframe, at_speed: float, *, speeds: bool) -> dict[str, float]:
    hover = hover_thrust(values, airframe)
    found = {
        "thrust_coefficient": hover.coefficient,
        "thrust_slope": hover.slope_n,
        "speed": hover.speed,
        "induced_velocity": hover.induced_m_s,
        # Induced velocity grows with the speed, so that inflow takes the same share of thrust at any.
        "thrust_hover": hover.coefficient * at_speed**2,
    }
    if "k_d" in values:
        found["drag"] = airframe.rotors * values["k_d"] * hover.speed / airframe.mass_kg
    if speeds:
        return found
    output, per_output = _output_of(values, hover.speed)
    return found | {
        "output": output,
        "output_slope": hover.slope_n * per_output,
        "thrust_full": hover.coefficient,
        "thrust_to_weight": 1.0 / hover.speed**2,
    }


def _output_of(values: Mapping[str, float], speed: float) -> tuple[float, float]:
    """The output that gives a speed, as a share of the full one, and the change of the speed with the output."""
    constant, linear, square = (values.get(name, 0.0) for name in ("c_0", "c_1", "c_2"))
    thrust = full_thrust(values) * speed**2
    if square == 0.0:
        output = (thrust - constant) / linear
    else:
        output = (-linear + np.sqrt(max(linear**2 + 4.0 * square * (thrust - constant), 0.0))) / (2.0 * square)
    return float(output), float((linear + 2.0 * square * output) / (2.0 * speed * full_thrust(values)))


_MOMENTS = {"p": "1/I_xx", "q": "1/I_yy", "r": "kappa/I_zz"}


def hover_structure(
    parameters: ParameterSet, layout: RotorLayout, hover: HoverThrust, *, output: float, axes: Sequence[str]
) -> LinearStructure:
    r"""Small motions about hover in still air, with the identified values.

    .. math::

        \delta F_i = (2 c_2 \Omega_h - c_\lambda v_h) \frac{d\Omega}{du} \, \delta u_i, \qquad
        \dot w = Z_w w - \tfrac{1}{m} \sum \delta F_i, \qquad Z_w = -\tfrac{n}{2 m} c_\lambda \Omega_h

    with the speed and induced velocity of hover; climb takes half of its speed from the induced velocity.

    Parameters
    ----------
    parameters
        Identified values.
    hover
        Of these values.
    output
        Of the motors in hover; their speed where that was measured.
    axes
        Rates whose inertia is known.
    """
    names, motors = parameters.names, range(1, layout.rotors + 1)
    lag = "T_motor" in names
    speeds = [f"x_{i}" if lag else f"motor_{i}" for i in motors]
    equations = [f"T_motor*x_{i}' = -x_{i} + motor_{i}" for i in motors] if lag else []
    arms, torque = layout.moment_arms, layout.torque_axes
    levers = {"p": arms[0], "q": arms[1], "r": torque[2]}
    for axis in axes:
        terms = " + ".join(
            f"({lever!r})*{speed}" for lever, speed in zip(levers[axis].tolist(), speeds, strict=True) if lever
        )
        spin_up = "".join(
            f" - ({lever!r})*spin_up*{speed}'"
            for lever, speed in zip(levers[axis].tolist(), speeds, strict=True)
            if axis == "r" and lag and "J_r" in names
        )
        equations.append(f"{axis}'{spin_up} = {axis}_thrust*({terms})")
    total = " + ".join(speeds)
    inflow = "c_lambda" in names
    equations.append(f"w' = {'Z_w*w ' if inflow else ''}- az_thrust*({total})")
    states = [*(speeds if lag else []), *axes, "w"]
    lines = [
        'schema = "rotorid.model/1"',
        'name = "physical.flight"',
        'source = "motors to rates and specific force, linear about hover in still air"',
        f"inputs = [{', '.join(_quoted(f'motor_{i}') for i in motors)}]",
        f"states = [{', '.join(map(_quoted, states))}]",
        "equations = [",
        *(f"    {_quoted(equation)}," for equation in equations),
        "]",
        f"outputs = [{', '.join(map(_quoted, (*axes, 'az = w' + chr(39))))}]",
        "[constants]",
        f"x_0 = {output!r}",
        f"Omega_0 = {hover.speed!r}",
        f"v_0 = {hover.induced_m_s!r}",
        *_tables(parameters, axes, layout.rotors),
    ]
    return from_toml("\n".join(lines), where="the hover model")


def _tables(parameters: ParameterSet, axes: Sequence[str], rotors: int) -> list[str]:
    names = parameters.names
    used = {"m", "c_0", "c_1", "c_2", "c_lambda", "T_motor"}
    used |= {name for axis in axes for name in _MOMENTS[axis].removeprefix("1/").split("/")}
    used |= {"J_r"} if "r" in axes and "T_motor" in names else set()
    lines: list[str] = []
    for parameter in parameters:
        if parameter.name in used:
            lines += [
                f"[parameters.{parameter.name}]",
                f"value = {parameter.value!r}",
                f'unit = "{parameter.unit}"',
                *(['status = "fixed"'] if parameter.status != "free" else []),
            ]
    full = " + ".join(name for name in ("c_0", "c_1", "c_2") if name in names)
    slope = f"2*({full})*Omega_0{' - c_lambda*v_0' if 'c_lambda' in names else ''}"
    # What the speed, as a share of the full one, gains by the output.
    curve = " + ".join(term for name, term in (("c_1", "c_1"), ("c_2", "2*c_2*x_0")) if name in names)
    gained = f"({curve})/(2*Omega_0*({full}))" if {"c_0", "c_1"} & set(names) else ""
    slope = f"({slope})*{gained}" if gained else f"({slope})"
    tied = {f"{axis}_thrust": f"{slope}*{_MOMENTS[axis]}".replace("*1/", "/") for axis in axes}
    tied["az_thrust"] = f"{slope}/m"
    if "c_lambda" in names:
        tied["Z_w"] = f"(-{0.5 * rotors!r})*c_lambda*Omega_0/m"
    if "r" in axes and "J_r" in names and "T_motor" in names:
        tied["spin_up"] = f"J_r*{gained}/I_zz" if gained else "J_r/I_zz"
    units = {"p_thrust": "rad/(m s^2)", "q_thrust": "rad/(m s^2)", "r_thrust": "rad/s^2", "az_thrust": "m/s^2"}
    units["spin_up"] = "1"
    for name, expression in tied.items():
        lines += [f"[parameters.{name}]", f'tied = "{expression}"', f'unit = "{units.get(name, "1/s")}"']
    return lines


def _quoted(text: str) -> str:
    return f'"{text}"'
