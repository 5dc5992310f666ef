"""PX4's SIH: its own vehicle comes back, files follow their grammar, and its equations fly as rotorid's do."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from tests.unit.exports.flown import flown
from tests.unit.exports.motion import doublet, inequality, own
from tests.unit.exports.vehicles import SIH, asymmetric, second, sih

from rotorid.errors import ModelError, UsageError
from rotorid.exports import Exported, ExportSettings
from rotorid.exports.px4_sih import export, sih_accelerations
from rotorid.flying.vehicle_from_results import JoinedVehicle, joined_vehicle
from rotorid.models.rotors import RotorLayout, library_layout
from rotorid.typing import FloatArray

STEPS_PER_SIH_STEP = 4


def parameters(exported: Exported) -> dict[str, float]:
    """The list of QGroundControl, read by its grammar."""
    (name,) = (name for name in exported.files if name.endswith(".params"))
    text = exported.files[name]
    assert isinstance(text, str)
    found = {}
    for line in text.splitlines():
        if line and not line.startswith("#"):
            vehicle, component, parameter, value, kind = line.split("\t")
            assert (vehicle, component, kind in ("6", "9")) == ("1", "1", True)
            assert re.fullmatch(r"[A-Z][A-Z0-9_]{0,15}", parameter)
            assert kind == "9" or re.fullmatch(r"-?\d+", value)
            found[parameter] = float(value)
    return found


def row(exported: Exported, name: str) -> float:
    return next(one.difference_percent for one in exported.compared if one.name == name)


def sih_flown(exported: Exported, outputs: FloatArray) -> dict[str, FloatArray]:
    """SIH by its equations in steps of 4 ms, of outputs for rotors in SIH's order."""
    own_parameters = parameters(exported)
    share = 0.004 / own_parameters["SIH_T_TAU"]
    return flown(
        lambda x, v, w: sih_accelerations(own_parameters, x, v, w), outputs, lambda x, u: x + share * (u - x), 0.004
    )


def test_the_own_vehicle_of_sih_comes_back() -> None:
    found = parameters(export(sih(), ExportSettings()))
    assert found["SIH_T_MAX"] == pytest.approx(5.0)
    assert found["SIH_Q_MAX"] == pytest.approx(0.1)
    assert found["SIH_T_TAU"] == pytest.approx(0.05003, abs=5e-6)
    assert [found[f"SIH_L_{axis}"] for axis in ("ROLL", "PITCH")] == pytest.approx([0.2, 0.2])
    assert [found[f"SIH_I{axis}"] for axis in ("XX", "YY", "ZZ", "XY", "XZ", "YZ")] == [0.025, 0.025, 0.03, 0, 0, 0]
    assert (found["SIH_KDV"], found["SIH_KDW"]) == pytest.approx((1.0, 0.025))


@pytest.mark.parametrize("vehicle", [sih(), second(T_motor=0.03), asymmetric()], ids=["sih", "second", "odd"])
def test_gains_and_lag_are_exact_where_the_form_has_them(vehicle: JoinedVehicle) -> None:
    exported = export(vehicle, ExportSettings())
    assert row(exported, "vertical acceleration per output") == pytest.approx(0.0, abs=1e-4)
    assert row(exported, "motor lag") == pytest.approx(0.0, abs=1e-4)
    held = {one.name: one.held for one in exported.compared}
    if vehicle.name == "vehicle" and "M_u" in vehicle.numbers:
        assert (held["roll acceleration per output"], held["M_u"]) == ("approximated", "not")


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_sih_answers_a_doublet_as_the_vehicle_does(axis: int) -> None:
    vehicle = sih()
    body = vehicle.multirotor
    assert body is not None
    outputs = doublet(body, axis)
    mine = {name: values[3::STEPS_PER_SIH_STEP] for name, values in own(body, outputs).items()}
    # Held for a step of SIH, as its controller holds them.
    theirs = sih_flown(export(vehicle, ExportSettings()), outputs[::STEPS_PER_SIH_STEP])
    found = inequality(mine, theirs)
    assert "pqr"[axis] in found
    assert max(found.values()) < 0.02, found


def test_signs_of_an_asymmetric_vehicle_in_another_order() -> None:
    vehicle = asymmetric()
    exported = export(vehicle, ExportSettings())
    found = parameters(exported)
    # Levers are the means of both sides, products of inertia entries of the matrix.
    assert (found["SIH_L_ROLL"], found["SIH_L_PITCH"]) == pytest.approx((0.155, 0.21))
    assert [found[f"SIH_I{axis}"] for axis in ("XY", "XZ", "YZ")] == [0.0012, -0.0017, 0.0009]
    x = np.full(4, found["MPC_THR_HOVER"])
    still = sih_accelerations(found, x, np.zeros(3), np.zeros(3))
    assert still[:3] == pytest.approx([0.0, 0.0, -9.80665], abs=1e-5)
    # Front left and rear left, SIH's third and second, roll to the right.
    right = sih_accelerations(found, x + np.array([0.0, 0.01, 0.01, 0.0]), np.zeros(3), np.zeros(3)) - still
    inertia = vehicle.multirotor.inertia_kg_m2 if vehicle.multirotor is not None else np.eye(3)
    assert inertia @ right[3:] == pytest.approx([0.01 * 2 * 0.155 * found["SIH_T_MAX"], 0.0, 0.0], abs=1e-7)


def test_rotors_that_turn_the_other_way_fly_the_same() -> None:
    layout = replace(library_layout("quad.x"), spins=-library_layout("quad.x").spins)
    exported = export(joined_vehicle([], given=SIH, layout=layout), ExportSettings())
    assert row(exported, "yaw acceleration per output") == pytest.approx(0.0, abs=1e-4)


def test_a_hexacopter_has_its_type_and_its_levers() -> None:
    exported = export(joined_vehicle([], given=SIH, layout=library_layout("hexa.x")), ExportSettings(names="six"))
    found = parameters(exported)
    assert (found["SIH_VEHICLE_TYPE"], found["SIH_L_ROLL"]) == (4.0, pytest.approx(SIH["arm"]))
    text = exported.files["22001_sihsim_six"]
    assert isinstance(text, str)
    assert "make px4_sitl sihsim_hex" in exported.start


def test_the_airframe_is_shell_with_parameters_and_the_round_trip() -> None:
    exported = export(sih(), ExportSettings(names="bird"))
    text = exported.files["22001_sihsim_bird"]
    assert isinstance(text, str)
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    assert lines[:3] == [
        ". ${R}etc/init.d/rc.mc_defaults",
        "PX4_SIMULATOR=${PX4_SIMULATOR:=sihsim}",
        "PX4_SIM_MODEL=${PX4_SIM_MODEL:=bird}",
    ]
    own_lines = [re.fullmatch(r"param set(-default)? ([A-Z0-9_]{1,16}) (-?[\d.e+-]+)", line) for line in lines[3:]]
    assert all(own_lines)
    assert "# motor lag" in text
    listed = {line[2]: float(line[3]) for line in own_lines if line}
    assert [listed[f"CA_ROTOR{index}_KM"] for index in range(4)] == pytest.approx([0.02, 0.02, -0.02, -0.02])


def test_the_delay_goes_to_the_lag_or_is_left_out() -> None:
    vehicle = asymmetric(delay=0.006)
    without, lagged = (export(vehicle, ExportSettings(delay=one)) for one in ("none", "lag"))  # type: ignore[arg-type]
    assert any("6 ms are lost" in sentence for sentence in without.left_out)
    assert any("part of the lag" in sentence for sentence in lagged.left_out)
    assert parameters(lagged)["SIH_T_TAU"] == pytest.approx(parameters(without)["SIH_T_TAU"] + 0.006, abs=2e-5)
    assert next(one for one in lagged.compared if one.name == "motor lag and delay").identified == pytest.approx(0.036)


def test_what_is_not_identified_is_sihs_and_said() -> None:
    exported = export(second(), ExportSettings())
    assert set(exported.defaults) == {"SIH_T_TAU", "SIH_KDW"}
    assert exported.defaults["SIH_T_TAU"].source == "default"
    assert exported.findings[0].kind == "export_compromise"


@pytest.mark.parametrize("name", ["quad.plus", "octo.x", "y6", "hexa.plus"])
def test_rotors_that_sih_does_not_fly_are_refused(name: str) -> None:
    with pytest.raises(ModelError, match="quad X or a hexa X, which SIH flies"):
        export(joined_vehicle([], given=SIH, layout=library_layout(name)), ExportSettings())


def test_a_quad_whose_spins_do_not_pair_is_refused() -> None:
    positions = library_layout("quad.x").positions
    layout = RotorLayout(name="odd", positions=positions, spins=[1, -1, 1, -1])
    with pytest.raises(ModelError, match="stand or turn otherwise"):
        export(joined_vehicle([], given=SIH, layout=layout), ExportSettings())


def test_without_a_mass_it_asks_for_one() -> None:
    known = {name: value for name, value in SIH.items() if name != "m"}
    with pytest.raises(UsageError, match="--set m="):
        export(joined_vehicle([], given=known, layout=library_layout("quad.x")), ExportSettings())


@pytest.mark.parametrize("lag_s", [0.0, 0.0002])
def test_a_lag_shorter_than_a_step_is_that_of_one_step(lag_s: float) -> None:
    vehicle = joined_vehicle([], given=SIH | {"T_motor": lag_s}, layout=library_layout("quad.x"))
    exported = export(vehicle, ExportSettings())
    assert parameters(exported)["SIH_T_TAU"] == 0.004
    (lag,) = (one for one in exported.compared if one.name == "motor lag")
    assert (lag.identified, lag.exported, lag.held) == (lag_s, 0.0, "approximated")
