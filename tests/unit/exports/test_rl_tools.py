"""rl-tools' block of dynamics: each field, its equations in flight, and l2f itself where that is installed."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from tests.unit.exports.flown import flown
from tests.unit.exports.motion import STEP_S, doublet, inequality, named, own
from tests.unit.exports.vehicles import SIH, asymmetric, second, sih

from rotorid.errors import ModelError, UsageError
from rotorid.exports import Exported, ExportSettings, draw_files
from rotorid.exports.rl_tools import export
from rotorid.flying.vehicle_from_results import JoinedVehicle, joined_vehicle
from rotorid.models.rotors import library_layout
from rotorid.typing import FloatArray

AIRLESS = dict.fromkeys(("X_u", "Y_v", "Z_w", "M_u", "L_v", "L_p", "M_q", "N_r"), 0.0)

VEHICLES = [asymmetric(**AIRLESS, delay=0.0), second(**AIRLESS, T_motor=0.04)]


def dynamics_of(exported: Exported) -> dict[str, Any]:
    (text,) = exported.files.values()
    block: dict[str, Any] = json.loads(text)["dynamics"]
    return block


def l2f_accelerations(block: dict[str, Any], u: FloatArray, w: FloatArray) -> FloatArray:
    """``60_dynamics.h`` loop by loop, in its own axes: accelerations without gravity."""
    thrust, torque = np.zeros(3), np.zeros(3)
    for i in range(4):
        c = block["rotor_thrust_coefficients"][i]
        magnitude = c[0] + c[1] * u[i] + c[2] * u[i] * u[i]
        push = np.array(block["rotor_thrust_directions"][i]) * magnitude
        thrust += push
        torque += np.array(block["rotor_torque_directions"][i]) * (magnitude * block["rotor_torque_constants"][i])
        torque += np.cross(block["rotor_positions"][i], push)
    turning = torque - np.cross(w, np.array(block["J"]) @ w)
    return np.concatenate([thrust / block["mass"], np.array(block["J_inv"]) @ turning])


def simulated(block: dict[str, Any], outputs: FloatArray) -> dict[str, FloatArray]:
    flip = np.array([1.0, -1.0, -1.0])
    rising, falling = (np.array(block[f"rotor_time_constants_{word}"]) for word in ("rising", "falling"))

    def lag(x: FloatArray, wanted: FloatArray) -> FloatArray:
        tau = np.where(wanted >= x, rising, falling)
        return wanted + (x - wanted) * np.exp(-STEP_S / tau)

    def accelerations(x: FloatArray, _v: FloatArray, w: FloatArray) -> FloatArray:
        return l2f_accelerations(block, x, flip * w) * np.tile(flip, 2)

    return flown(accelerations, outputs, lag, STEP_S)


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_its_equations_fly_as_ours_do(vehicle: JoinedVehicle) -> None:
    body = vehicle.multirotor
    assert body is not None
    block = dynamics_of(export(vehicle, ExportSettings()))
    for axis in range(3):
        outputs = doublet(body, axis)
        found = inequality(own(body, outputs), simulated(block, outputs))
        assert "pqr"[axis] in found
        assert max(found.values()) < 0.02, found


def test_each_field_is_the_number_of_the_vehicle() -> None:
    vehicle = asymmetric(T_motor_up=0.02, T_motor_down=0.04)
    block = dynamics_of(export(vehicle, ExportSettings()))
    assert block["mass"] == 1.7
    assert block["gravity"] == [0.0, 0.0, -9.80665]
    assert block["rotor_positions"][0] == [-0.2, -0.15, 0.03]
    assert block["rotor_thrust_directions"] == [[0.0, 0.0, 1.0]] * 4
    # The first turns clockwise, so that it turns the body the other way: about up.
    assert [row[2] for row in block["rotor_torque_directions"]] == [1.0, -1.0, -1.0, 1.0]
    assert block["rotor_thrust_coefficients"] == [[0.1, 2.0, 10.0]] * 4
    assert block["rotor_torque_constants"] == [0.018] * 4
    assert block["rotor_time_constants_rising"] == [0.02] * 4
    assert block["rotor_time_constants_falling"] == [0.04] * 4
    assert block["J"] == [[0.018, -0.0012, 0.0017], [-0.0012, 0.024, 0.0009], [0.0017, 0.0009, 0.035]]
    np.testing.assert_allclose(np.array(block["J"]) @ block["J_inv"], np.eye(3), atol=1e-8)
    assert block["action_limit"] == {"min": 0.0, "max": 1.0}
    assert vehicle.multirotor is not None
    assert block["hovering_throttle_relative"] == pytest.approx(vehicle.multirotor.hover_shares.mean())


def test_a_delay_is_lost_or_part_of_both_lags() -> None:
    late = export(asymmetric(), ExportSettings())
    assert any("6 ms are lost" in sentence for sentence in late.left_out)
    block = dynamics_of(export(asymmetric(), ExportSettings(delay="lag")))
    assert block["rotor_time_constants_rising"] == pytest.approx([0.036] * 4)


def test_air_is_lost_and_said_so() -> None:
    exported = export(sih(), ExportSettings())
    rows = {row.name: row for row in exported.compared}
    assert {rows[name].held for name in ("X_u", "Z_w", "L_p", "N_r")} == {"not"}
    assert all(row.held == "exact" for name, row in rows.items() if name not in AIRLESS)
    assert any("has no air: drag, damping and inflow are lost" in sentence for sentence in exported.left_out)


def test_what_is_missing_is_asked_for() -> None:
    known = {name: value for name, value in SIH.items() if name != "T_motor"}
    with pytest.raises(UsageError, match="--set T_motor="):
        export(joined_vehicle([], given=known, layout=library_layout("quad.x")), ExportSettings())
    with pytest.raises(ModelError, match="lag of vehicle is 0 s"):
        export(joined_vehicle([], given=SIH | {"T_motor": 0.0}, layout=library_layout("quad.x")), ExportSettings())
    with pytest.raises(ModelError, match="has 6 rotors; expected four rotors"):
        export(joined_vehicle([], given=SIH, layout=library_layout("hexa.x")), ExportSettings())


def test_drawn_vehicles_are_one_file() -> None:
    vehicles = [export(second(T_motor=0.04, m=mass), ExportSettings()) for mass in (2.0, 2.1, 2.2)]
    made = draw_files(vehicles, "rl-tools", ExportSettings())
    (text,) = made.files.values()
    found = json.loads(text)
    assert [found[f"vehicle_{number}"]["mass"] for number in (1, 2, 3)] == [2.0, 2.1, 2.2]
    assert "draws/vehicle_rl_tools.json" in made.start


def test_l2f_loads_the_block(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("l2f", reason="l2f is not installed")
    exported = export(asymmetric(), ExportSettings())
    exported.write(tmp_path)
    monkeypatch.chdir(tmp_path)
    scope: dict[str, Any] = {}
    exec(exported.start + "\nread = json.loads(l2f.parameters_to_json(device, environment, parameters))", scope)
    # Its own writer has six decimals.
    block = dynamics_of(exported)
    for key, value in block.items():
        if key != "action_limit":
            np.testing.assert_allclose(scope["read"]["dynamics"][key], value, rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_l2f_flies_as_ours_does(vehicle: JoinedVehicle, tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("l2f", reason="l2f is not installed")
    body = vehicle.multirotor
    assert body is not None
    exported = export(vehicle, ExportSettings())
    exported.write(tmp_path)
    monkeypatch.chdir(tmp_path)
    for axis in range(3):
        outputs = doublet(body, axis)
        found = inequality(own(body, outputs), flown_in_l2f(exported.start, outputs))
        assert max(found.values()) < 0.02, found


def flown_in_l2f(start: str, outputs: FloatArray) -> dict[str, FloatArray]:
    """By the lines that start it, in our steps; its actions are from -1 to 1."""
    scope: dict[str, Any] = {}
    exec(
        start.replace("l2f.parameters_from_json", f'values["integration"]["dt"] = {STEP_S}\nl2f.parameters_from_json'),
        scope,
    )
    l2f, flip = scope["l2f"], np.array([1.0, -1.0, -1.0])
    place = [scope[name] for name in ("device", "environment", "parameters")]
    state, following, rng = l2f.State(), l2f.State(), l2f.Rng()
    l2f.initialize_rng(place[0], rng, 0)
    l2f.initial_state(*place, state)
    state.rpm = outputs[0]
    kept = np.empty((len(outputs), 6))
    for k, row in enumerate(outputs):
        l2f.step(*place, state, 2.0 * row - 1.0, following, rng)
        state.assign(following)
        kept[k] = [*(flip * state.angular_velocity), *(flip * state.linear_velocity)]
    return named(kept[:, :3], kept[:, 3:])
