"""RotorPy's dictionary: its equations answer as the vehicle does, in RotorPy itself where that is installed.

RotorPy brings a package under the GPL and belongs to no group of this project but ``rotorpy``; without it the same
equations are integrated here.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.unit.exports.motion import STEP_S, doublet, imported, inequality, named, own
from tests.unit.exports.vehicles import SIH, asymmetric, second, sih

from rotorid.errors import ModelError
from rotorid.exports import ExportSettings
from rotorid.exports.mujoco import FLU
from rotorid.exports.rotorpy import export
from rotorid.flying.vehicle_from_results import JoinedVehicle, joined_vehicle
from rotorid.models.rotors import library_layout
from rotorid.typing import FloatArray


def held() -> JoinedVehicle:
    """A vehicle whose damping is that which RotorPy's drag makes, so that all of it is held."""
    rows = {row.name: row for row in export(sih(), ExportSettings()).compared}
    damping = {name: rows[name].exported for name in ("L_p", "M_q", "N_r")}
    return joined_vehicle([], given=SIH | damping, layout=library_layout("quad.x"))


def flown(module: Any, outputs: FloatArray) -> dict[str, FloatArray]:
    """What RotorPy makes of outputs."""
    Multirotor = pytest.importorskip("rotorpy.vehicles.multirotor", reason="RotorPy is not installed").Multirotor
    vehicle = Multirotor(module.quad_params, initial_state=module.hovering())
    return _advanced(vehicle.initial_state, lambda state, row: vehicle.step(state, row, STEP_S), module, outputs)


def _advanced(
    state: dict[str, Any], step: Callable[[Any, Any], dict[str, Any]], module: Any, outputs: FloatArray
) -> dict[str, FloatArray]:
    rates, velocity = np.empty((len(outputs), 3)), np.empty((len(outputs), 3))
    for k, row in enumerate(outputs):
        state = step(state, {"cmd_motor_speeds": module.speeds(row)})
        rates[k], velocity[k] = state["w"], state["v"]
    return named(rates @ FLU, velocity @ FLU)


def test_rotorpy_hovers_and_answers_a_doublet_as_rotorid_does(tmp_path: Path) -> None:
    vehicle = held()
    module: Any = imported(export(vehicle, ExportSettings()), tmp_path, "vehicle_rotorpy.py")
    body = vehicle.multirotor
    assert body is not None
    # Its gravity is 0.03 % more: hover is at the speeds of its file.
    still = flown(module, np.tile((module.HOVER_SPEEDS / 1000.0) * (1 + module.SHIFT) - module.SHIFT, (200, 1)))
    assert max(np.abs(values).max() for values in still.values()) < 1e-6
    for axis in range(3):
        outputs = doublet(body, axis)
        shift = module.HOVER_SPEEDS / 1000.0 * (1 + module.SHIFT) - module.SHIFT - body.hover_shares
        found = inequality(own(body, outputs), flown(module, outputs + shift), curved=True)
        assert "pqr"[axis] in found
        assert max(found.values()) < 0.02, found


def test_a_square_of_a_shifted_output_is_held_at_every_output(tmp_path: Path) -> None:
    vehicle = asymmetric()
    module: Any = imported(export(vehicle, ExportSettings()), tmp_path, "vehicle_rotorpy.py")
    outputs = np.array([0.0, 0.3, 0.6, 1.0])
    # 0.1 + 2 x + 10 x^2 is a square.
    thrust = module.quad_params["k_eta"] * module.speeds(outputs) ** 2
    np.testing.assert_allclose(thrust, 0.1 + 2.0 * outputs + 10.0 * outputs**2, rtol=1e-6)
    assert module.quad_params["rotor_speed_min"] == pytest.approx(float(module.speeds(0.0)))


def test_a_curve_steeper_than_a_square_keeps_force_and_slope_at_hover(tmp_path: Path) -> None:
    vehicle = second()
    module: Any = imported(export(vehicle, ExportSettings()), tmp_path, "vehicle_rotorpy.py")

    def thrust(x: float) -> float:
        return float(module.quad_params["k_eta"] * module.speeds(x) ** 2)

    output = vehicle.hover_output
    assert thrust(output) == pytest.approx(vehicle.hover_force_n, rel=1e-6)
    assert (thrust(output + 1e-4) - thrust(output - 1e-4)) / 2e-4 == pytest.approx(vehicle.hover_slope_n, rel=1e-5)


def test_signs_go_from_right_and_down_to_left_and_up(tmp_path: Path) -> None:
    module: Any = imported(export(asymmetric(), ExportSettings()), tmp_path, "vehicle_rotorpy.py")
    found = module.quad_params
    assert [found[name] for name in ("Ixy", "Ixz", "Iyz")] == [-0.0012, 0.0017, 0.0009]
    np.testing.assert_allclose(found["rotor_pos"]["r1"], [-0.2, -0.15, 0.03])
    # The first turns clockwise: its torque is counterclockwise, about up.
    assert found["rotor_directions"].tolist() == [1, -1, -1, 1]
    assert found["k_m"] / found["k_eta"] == pytest.approx(0.018)


def test_rows_that_rotorpy_has_one_number_for_are_approximated() -> None:
    rows = {row.name: row for row in export(asymmetric(M_u=0.7, L_v=-0.7 * 24 / 18), ExportSettings()).compared}
    assert {name for name, row in rows.items() if row.held == "exact"} == {
        "vertical acceleration per output",
        "roll acceleration per output",
        "pitch acceleration per output",
        "yaw acceleration per output",
        "hover output",
        "motor lag",
        "Z_w",
    }
    # Both moments by velocity are of one size, as flapping of round discs makes them.
    assert rows["M_u"].exported == pytest.approx(rows["M_u"].identified, rel=0.02)
    assert rows["L_v"].exported == pytest.approx(rows["L_v"].identified, rel=0.02)
    assert rows["delay"].held == "not"


def test_what_was_not_identified_is_listed() -> None:
    exported = export(second(), ExportSettings())
    assert set(exported.defaults) == {"tau_m", "rotor_speed_max"}
    measured = export(second(speed_max=850.0, T_motor=0.02), ExportSettings())
    assert not measured.defaults


def test_six_rotors_are_refused() -> None:
    vehicle = joined_vehicle([], given=SIH, layout=library_layout("hexa.x"))
    with pytest.raises(ModelError, match="has 6 rotors; expected four rotors"):
        export(vehicle, ExportSettings())
