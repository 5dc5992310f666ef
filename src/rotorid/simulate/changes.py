"""A vehicle with other numbers: what `--set` and `--vary` change, by the names that an identification uses."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from rotorid.data.channel import AXES
from rotorid.models.ties import no_such
from rotorid.simulate.multirotor import Multirotor
from rotorid.simulate.multirotor_flight import Aircraft
from rotorid.units import STANDARD_GRAVITY_M_S2

HOLD_1_S, HOLD_1_S2, HOLD_PLACE_1_S = 1.0, 0.2, 0.3
"""Acceleration for a drift, for its integral, and speed asked for by a distance: what :func:`piloted` adds. The scripts
that fly a plan hold with the same numbers, so that a flight may be what its prediction was."""


def changed(aircraft: Aircraft, values: Mapping[str, float]) -> Aircraft:
    """The same aircraft with other numbers.

    The autopilot stays as it is but for the thrust command at which it hovers: what changes is the vehicle that it
    meets.

    Parameters
    ----------
    aircraft
        What to change.
    values
        ``m`` (kg), ``I_xx I_yy I_zz`` (kg m²), ``T_motor`` (both lags of the rotors, s), ``T_motor_up T_motor_down``,
        ``thrust`` (factor on the thrust curve), ``kappa`` (torque over thrust, m), ``drag`` (factor on everything that
        the air does), ``tau`` (delay of all commands, s).

    Raises
    ------
    ModelError
        There is no such number, or the vehicle cannot be.

    Examples
    --------
    >>> from rotorid.models.rotor_layout_library import library_layout
    >>> from rotorid.simulate.autopilot import Autopilot, RateLoop
    >>> from rotorid.simulate.multirotor import Rotors
    >>> rotors = Rotors(layout=library_layout("quad.x").scaled(0.25), thrust=(0, 0, 9.0), torque_per_thrust_m=0.02)
    >>> vehicle = Multirotor(name="demo", mass_kg=1.2, inertia_kg_m2=(0.012, 0.012, 0.02), rotors=rotors)
    >>> gains = RateLoop(proportional=(0.1, 0.1, 0.2))
    >>> autopilot = Autopilot(kind="simple", rate_hz=250.0, rates=gains, angle_1_s=(4.0, 4.0, 2.0))
    >>> changed(Aircraft(vehicle=vehicle, autopilot=autopilot), {"m": 1.5}).vehicle.mass_kg
    1.5
    """
    for name, value in values.items():
        if name == "tau":
            aircraft = replace(aircraft, autopilot=replace(aircraft.autopilot, delay_s=(value,) * 4))
        elif name in _CHANGES:
            aircraft = replace(aircraft, vehicle=_CHANGES[name](aircraft.vehicle, value))
        else:
            raise no_such("number of a vehicle", name, (*_CHANGES, "tau"))
    return aircraft


def piloted(aircraft: Aircraft) -> Aircraft:
    """The same aircraft with slow loops that hold its place and height, where its autopilot has none.

    They stand for a pilot who brings it back: 1 m/s² of acceleration for each m/s of drift, 0.3 m/s for each meter, and
    the same in height. What the sticks ask for comes on top.

    Parameters
    ----------
    aircraft
        What flies.
    """
    guidance, vehicle = aircraft.autopilot.guidance, aircraft.vehicle
    if not guidance.hold_velocity:
        guidance = replace(
            guidance,
            hold_velocity=True,
            velocity_p_1_s=HOLD_1_S,
            velocity_i_1_s2=HOLD_1_S2,
            position_p_1_s=HOLD_PLACE_1_S,
        )
    if not guidance.hold_height:
        hover = float(aircraft.autopilot.hover_commands(vehicle)[AXES.index("thrust")])
        climb = HOLD_1_S * hover / STANDARD_GRAVITY_M_S2
        guidance = replace(
            guidance, hold_height=True, climb_p=climb, climb_i=HOLD_PLACE_1_S * climb, height_p_1_s=HOLD_PLACE_1_S
        )
    return replace(aircraft, autopilot=replace(aircraft.autopilot, guidance=guidance))


def number_of(aircraft: Aircraft, name: str) -> float:
    """What :func:`changed` would change; one for a factor."""
    vehicle, rotors = aircraft.vehicle, aircraft.vehicle.rotors
    diagonal = np.diag(vehicle.inertia_kg_m2)
    numbers = {
        "m": vehicle.mass_kg,
        "I_xx": float(diagonal[0]),
        "I_yy": float(diagonal[1]),
        "I_zz": float(diagonal[2]),
        "T_motor": rotors.lag_up_s,
        "T_motor_up": rotors.lag_up_s,
        "T_motor_down": rotors.lag_down_s or 0.0,
        "thrust": 1.0,
        "kappa": rotors.torque_per_thrust_m,
        "drag": 1.0,
        "tau": float(np.mean(aircraft.autopilot.delay_s)),
    }
    if name not in numbers:
        raise no_such("number of a vehicle", name, tuple(numbers))
    return numbers[name]


def _inertia(axis: int) -> Callable[[Multirotor, float], Multirotor]:
    def change(vehicle: Multirotor, value: float) -> Multirotor:
        inertia = np.array(vehicle.inertia_kg_m2)
        inertia[axis, axis] = value
        return replace(vehicle, inertia_kg_m2=inertia)

    return change


def _lags(vehicle: Multirotor, up_s: float, down_s: float) -> Multirotor:
    return replace(vehicle, rotors=replace(vehicle.rotors, lag_up_s=up_s, lag_down_s=down_s))


def _thrust(vehicle: Multirotor, factor: float) -> Multirotor:
    rotors = vehicle.rotors
    c_0, c_1, c_2 = (factor * one for one in rotors.thrust)
    # A torque curve of its own goes along, so that torque over thrust stays.
    q_0, q_1, q_2 = (factor * one for one in rotors.torque_curve)
    torque = None if rotors.torque is None else (q_0, q_1, q_2)
    return replace(vehicle, rotors=replace(rotors, thrust=(c_0, c_1, c_2), torque=torque))


def _drag(vehicle: Multirotor, factor: float) -> Multirotor:
    rotors = vehicle.rotors
    assert vehicle.aerodynamics is not None
    x, y, z = (factor * one for one in vehicle.quadratic_drag_n_s2_m2)
    return replace(
        vehicle,
        aerodynamics=factor * vehicle.aerodynamics,
        quadratic_drag_n_s2_m2=(x, y, z),
        rotors=replace(
            rotors,
            induced_drag_n_s_m=factor * rotors.induced_drag_n_s_m,
            inflow_n_s_m=factor * rotors.inflow_n_s_m,
        ),
    )


_CHANGES: Mapping[str, Callable[[Multirotor, float], Multirotor]] = MappingProxyType(
    {
        "m": lambda vehicle, value: replace(vehicle, mass_kg=value),
        "I_xx": _inertia(0),
        "I_yy": _inertia(1),
        "I_zz": _inertia(2),
        "T_motor": lambda vehicle, value: _lags(vehicle, value, value),
        "T_motor_up": lambda vehicle, value: _lags(vehicle, value, vehicle.rotors.lag_down_s or value),
        "T_motor_down": lambda vehicle, value: _lags(vehicle, vehicle.rotors.lag_up_s, value),
        "thrust": _thrust,
        "kappa": lambda vehicle, value: replace(vehicle, rotors=replace(vehicle.rotors, torque_per_thrust_m=value)),
        "drag": _drag,
    }
)
