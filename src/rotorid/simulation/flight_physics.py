r"""A simulated vehicle by the numbers of :data:`rotorid.models.flight.FLIGHT_PARAMETERS`, and those numbers of one.

Both hold the same equations with thrust written in two ways. A flight is fitted with the thrust that a rotor would make
without inflow; a simulated vehicle has the thrust of hover, and adds what motion changes. With the induced velocity of
hover :math:`v_h = \nu x`,

.. math::

    T_{hover} = (C - c_\lambda \nu) x^2, \qquad Q_{hover} = (\kappa C + \kappa_\lambda \nu^2) x^2

where x is the speed as the numbers have it, and C the thrust without inflow at a speed of one: ``c_2`` in rad/s, or the
sum of the curve's coefficients for motors known by their outputs u, where :math:`C x^2 = c_0 + c_1 u + c_2 u^2`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from rotorid.models.flight import Airframe, full_thrust, hover_thrust
from rotorid.models.rotors import RotorLayout
from rotorid.simulation.multirotor import Multirotor, RotorFlow, Rotors
from rotorid.units import STANDARD_GRAVITY_M_S2


def rotors_with(values: Mapping[str, float], airframe: Airframe, layout: RotorLayout, *, full: float = 1.0) -> Rotors:
    """Rotors that do what these numbers say, without lag where ``T_motor`` is absent.

    Parameters
    ----------
    values
        By the names of :data:`~rotorid.models.flight.FLIGHT_PARAMETERS`; what is absent is zero.
    airframe
        Mass, disc and density of the air.
    layout
        Of the rotors.
    full
        Speed of a rotor at full output in the unit of the numbers: rad/s, or one for outputs.

    Raises
    ------
    ModelError
        The rotors cannot carry the weight.

    Examples
    --------
    >>> from rotorid.models.rotors import library_layout
    >>> layout = library_layout("quad.x").scaled(0.25)
    >>> frame = Airframe(positions=layout.positions, spins=layout.spins, mass_kg=1.2, disc_m2=0.05)
    >>> rotors = rotors_with({"c_2": 12.0, "c_lambda": 0.5, "k_d": 0.1}, frame, layout)
    >>> rotors.induced_drag_n_s_m, [round(term, 3) for term in rotors.thrust]
    (0.1, [0.0, 0.0, 7.968])
    """
    get = {name: values.get(name, 0.0) for name in _NAMES}.__getitem__
    found = hover_thrust(values, airframe)
    per_speed = found.induced_m_s / found.speed
    inflow = full * get("c_lambda")
    static = full_thrust(values)
    left = 1.0 - get("c_lambda") * per_speed / static
    torque = (get("kappa") * static + get("kappa_lambda") * per_speed**2) / (static * left)
    lag_s = get("T_motor")
    return Rotors(
        layout=layout,
        thrust=(left * get("c_0"), left * full * get("c_1"), left * full**2 * get("c_2")),
        torque_per_thrust_m=torque,
        lag_up_s=lag_s,
        lag_down_s=lag_s,
        induced_drag_n_s_m=full * get("k_d"),
        inflow_n_s_m=inflow,
        inertia_kg_m2=get("J_r"),
        full_speed_rad_s=full,
        flow=RotorFlow(
            disc_m2=airframe.disc_m2,
            air_density_kg_m3=airframe.density_kg_m3,
            edge_lift_n_s_m=full * get("c_h"),
            edge_climb_lift_n_s2_m2=get("c_hw"),
            edge_speed_lift_n_s2_m2=get("c_ha"),
            wake_n_s2_m3=get("c_wake"),
            climb_drag_n_s2_m2=get("k_w"),
            flapping_n_s=full * get("m_f"),
            forward_flapping_n_s=full * get("m_fx"),
            side_flapping_n_s=full * get("m_s"),
            inflow_torque_n_s2_m=get("kappa_lambda"),
            yaw_damping_n_m_s=full * get("k_r"),
        ),
    )


_NAMES = (
    *("c_0", "c_1", "c_2", "c_lambda", "k_d", "k_w", "c_h", "c_hw", "c_ha", "c_wake"),
    *("T_motor", "kappa", "J_r", "m_f", "m_fx", "m_s", "kappa_lambda", "k_r"),
)


def with_flight(vehicle: Multirotor, values: Mapping[str, float], *, disc_m2: float, full: float = 1.0) -> Multirotor:
    """A vehicle that flies by these numbers; what they do not hold of body, layout and battery stays.

    Parameters
    ----------
    vehicle
        What it is otherwise. Drag and derivatives of its body go: the numbers stand for them.
    values, full
        See :func:`rotors_with`. ``m``, ``I_xx``, ``I_yy`` and ``I_zz`` replace those of the vehicle where present,
        ``x_cg``, ``y_cg`` and ``z_cg`` move its center of gravity.
    disc_m2
        That one rotor sweeps.

    Raises
    ------
    ModelError
        The rotors cannot carry the weight.
    """
    mass_kg = values.get("m", vehicle.mass_kg)
    layout = vehicle.rotors.layout
    inertia = np.array(vehicle.inertia_kg_m2)
    for place, name in enumerate(("I_xx", "I_yy", "I_zz")):
        inertia[place, place] = values.get(name, inertia[place, place])
    x, y, z = vehicle.center_of_gravity_m
    return replace(
        vehicle,
        mass_kg=mass_kg,
        inertia_kg_m2=inertia,
        rotors=rotors_with(values, _frame(vehicle, mass_kg, disc_m2), layout, full=full),
        aerodynamics=None,
        quadratic_drag_n_s2_m2=(0.0, 0.0, 0.0),
        vertical_drag_n_s2_m2=values.get("d_z", 0.0),
        center_of_gravity_m=(x + values.get("x_cg", 0.0), y + values.get("y_cg", 0.0), z + values.get("z_cg", 0.0)),
        effectiveness=None,
    )


def flight_values(vehicle: Multirotor, *, full: float = 1.0) -> dict[str, float]:
    """What :func:`with_flight` makes of a vehicle, back: its numbers about its own center of gravity.

    The torque constant is that of hover, whatever the shape of a torque curve.

    Parameters
    ----------
    vehicle
        A vehicle.
    full
        Speed of a rotor at full output in the unit that is wanted: rad/s, or one for outputs.

    Examples
    --------
    >>> from rotorid.vehicles.catalog import aircraft
    >>> found = flight_values(aircraft("x500").vehicle)
    >>> round(found["m"], 2), round(found["kappa"], 3)
    (2.0, 0.016)
    """
    rotors, flow = vehicle.rotors, vehicle.rotors.flow or RotorFlow()
    per_share = vehicle.induced_per_share_m_s
    share = rotors.share_of(vehicle.mass_kg * STANDARD_GRAVITY_M_S2 / rotors.layout.rotors)
    hovering = rotors.thrust_at(1.0)
    static = hovering + rotors.inflow_n_s_m * per_share
    c_0, c_1, c_2 = (static / hovering * coefficient for coefficient in rotors.thrust)
    torque = hovering * float(np.polynomial.polynomial.polyval(share, rotors.torque_curve)) / rotors.thrust_at(share)
    diagonal = vehicle.inertia_kg_m2.diagonal()
    return {
        "m": vehicle.mass_kg,
        "c_0": c_0,
        "c_1": c_1 / full,
        "c_2": c_2 / full**2,
        "c_lambda": rotors.inflow_n_s_m / full,
        "k_d": rotors.induced_drag_n_s_m / full,
        "k_w": flow.climb_drag_n_s2_m2,
        "c_h": flow.edge_lift_n_s_m / full,
        "c_hw": flow.edge_climb_lift_n_s2_m2,
        "c_ha": flow.edge_speed_lift_n_s2_m2,
        "d_z": vehicle.vertical_drag_n_s2_m2,
        "c_wake": flow.wake_n_s2_m3,
        "T_motor": rotors.mean_lag_s,
        "I_xx": float(diagonal[0]),
        "I_yy": float(diagonal[1]),
        "I_zz": float(diagonal[2]),
        "kappa": (torque - flow.inflow_torque_n_s2_m * per_share**2) / static,
        "J_r": rotors.inertia_kg_m2 * rotors.full_speed_rad_s / full,
        "m_f": flow.flapping_n_s / full,
        "m_fx": flow.forward_flapping_n_s / full,
        "m_s": flow.side_flapping_n_s / full,
        "kappa_lambda": flow.inflow_torque_n_s2_m,
        "k_r": flow.yaw_damping_n_m_s / full,
    }


def _frame(vehicle: Multirotor, mass_kg: float, disc_m2: float) -> Airframe:
    return Airframe(positions=vehicle.hubs_m, spins=vehicle.rotors.layout.spins, mass_kg=mass_kg, disc_m2=disc_m2)
