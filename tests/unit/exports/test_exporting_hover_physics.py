"""Exports of ``physical.hover`` alone: the numbers of the vehicle that flew, nothing given and no default for them."""

from __future__ import annotations

import pytest
from tests.unit.flying.vehicle_twins import hover_physics, own_torque, twin_of

from rotorid.exports.exporting import export
from rotorid.flying.vehicle_from_results import joined_vehicle
from rotorid.simulation.linearization import hover_derivatives_of, hover_slopes

SIMULATORS = (
    *("px4-sih", "ardupilot", "gazebo", "mujoco", "rotorpy", "urdf", "fmu"),
    *("rl-tools", "crazyflow", "pyflyt", "aerial-gym", "flightmare"),
)
ROUNDED = 5e-4


@pytest.mark.parametrize(
    ("target", "name"),
    [*((target, "px4_quad") for target in SIMULATORS), ("gazebo", "hummingbird"), ("mujoco", "hummingbird")],
)
def test_a_simulator_has_the_vehicle_of_the_result(target: str, name: str) -> None:
    craft = twin_of(name)
    body = craft.vehicle
    exported = export(joined_vehicle([hover_physics(craft)]), target)
    found = {row.name: row for row in exported.compared}
    count, hover = body.rotors.layout.rotors, float(body.hover_shares.mean())
    slope_n = body.rotors.thrust[1] + 2.0 * hover * body.rotors.thrust[2]
    yaw = count * slope_n * own_torque(craft)[0] / float(body.inertia_kg_m2[2, 2])
    wanted = {
        "vertical acceleration per output": count * slope_n / body.mass_kg,
        "yaw acceleration per output": yaw,
        "hover output": hover,
        "motor lag": body.rotors.mean_lag_s,
        "X_u": float(hover_slopes(body)[0, 0]),
    }
    for row, value in wanted.items():
        assert found[row].identified == pytest.approx(value, rel=1e-6), row
        if found[row].held == "exact":
            assert found[row].exported == pytest.approx(value, rel=10.0 * ROUNDED if row == "hover output" else ROUNDED)
    roll, pitch = (found[f"{axis} acceleration per output"].identified for axis in ("roll", "pitch"))
    derivatives = hover_derivatives_of(body, craft.autopilot)
    assert roll / pitch == pytest.approx(derivatives["L_roll"] / derivatives["M_pitch"], rel=1e-6)
