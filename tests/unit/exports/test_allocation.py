"""Motor factors of a vehicle: those of the autopilots' own tables on their frames, and axes apart on any other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.exports.vehicles import sih
from tests.unit.flying.test_vehicle_from_results import motors

from rotorid.errors import ModelError, UsageError
from rotorid.exports import ExportSettings, export
from rotorid.exports.allocation import (
    effectiveness,
    factors_of,
    lua_factors,
    lua_script,
    mmix_factors,
    mmix_lines,
    motor_test_order,
)
from rotorid.flying.vehicle_from_results import joined_vehicle
from rotorid.models.rotors import RotorLayout, ardupilot_mixer, layout_names, library_layout

QUADX = """
mmix 0 1.000000 -1.000000 1.000000 -1.000000
mmix 1 1.000000 -1.000000 -1.000000 1.000000
mmix 2 1.000000 1.000000 1.000000 1.000000
mmix 3 1.000000 1.000000 -1.000000 -1.000000
"""
"""Betaflight's own table: rear right, front right, rear left, front left."""

UNEVEN = RotorLayout(
    name="uneven",
    positions=np.array([[0.10, 0.15, -0.02], [-0.22, -0.12, -0.02], [0.10, -0.15, -0.02], [-0.22, 0.12, -0.02]]),
    spins=np.array([1.0, 1.0, -1.0, -1.0]),
    arm_known=True,
)
"""The center of gravity is far ahead of the middle, as with a camera."""


def test_quad_x_has_the_signs_of_ardupilot() -> None:
    """Front right, rear left, front left, rear right: sines and cosines of their bearings, made one at the most."""
    assert factors_of(library_layout("quad.x"))[:, :3].round(9).tolist() == [
        [-1.0, 1.0, 1.0],
        [1.0, -1.0, 1.0],
        [1.0, 1.0, -1.0],
        [-1.0, -1.0, -1.0],
    ]


def test_quad_plus_has_the_script_of_ardupilot() -> None:
    """Its example of a scripting matrix for a plus, with the same numbers of the motor test."""
    layout = library_layout("quad.plus")
    text = lua_script(factors_of(layout), motor_test_order(layout), "plus")
    rows = [line[len("MotorsMatrix:add_motor_raw(") : -1] for line in text.splitlines() if "add_motor_raw" in line]
    assert [[float(value) for value in row.split(",")] for row in rows] == [
        [0, -1, 0, 1, 2],
        [1, 1, 0, 1, 4],
        [2, 0, 1, -1, 1],
        [3, 0, -1, -1, 3],
    ]
    assert "set_throttle_factor" not in text
    assert "assert(MotorsMatrix:init(4)" in text


def test_quad_x_of_betaflight_has_its_table() -> None:
    lines = mmix_lines(factors_of(library_layout("quad.x.betaflight"))).splitlines()
    assert [line for line in lines if line.startswith("mmix") and "reset" not in line] == QUADX.split("\n")[1:-1]


def test_even_frames_are_mixed_as_ardupilot_does() -> None:
    """Frames whose rotors are all alike; in the others, the own table gives rotors more than they need, or couples."""
    for name in layout_names():
        layout = library_layout(name)
        if layout.uncontrollable or not name.startswith(("quad.x", "quad.plus", "quad.h", "hexa.x", "hexa.plus")):
            continue
        own = replace(layout, yaw_weights=layout.spins)
        np.testing.assert_allclose(factors_of(layout)[:, :3], 2.0 * ardupilot_mixer(own)[:, :3], atol=1e-9)


def test_an_uneven_frame_has_its_axes_apart() -> None:
    """By each of the three files as it is read back, where a standard table pitches with every change of thrust."""
    acts = effectiveness(UNEVEN, 0.017)
    standard = acts @ ardupilot_mixer(UNEVEN)
    assert abs(standard[1, 3]) > 0.2 * abs(standard[1, 1])
    factors = factors_of(UNEVEN, 0.017)
    for read in (
        lua_factors(lua_script(factors, motor_test_order(UNEVEN), "uneven")),
        mmix_factors(mmix_lines(factors)),
    ):
        response = acts @ read
        np.testing.assert_allclose(response - np.diag(np.diag(response)), 0.0, atol=1e-6)
        assert np.all(np.diag(response) > 0.0)


def test_the_export_says_what_the_standard_frame_would_do() -> None:
    uneven = export([], "allocation", ExportSettings(names="bird"), layout=UNEVEN)
    (coupled,) = [finding for finding in uneven.findings if finding.where == "standard frame"]
    assert coupled.severity == "warning"
    assert coupled.numbers["coupling_percent"] > 20.0
    assert {row.difference_percent for row in uneven.compared if "coupling" in row.name} == {0.0}
    assert "set_throttle_factor(1" in str(uneven.files["bird_motors.lua"])
    even = export(sih(), "allocation")
    assert [finding.severity for finding in even.findings if finding.where == "standard frame"] == ["info"]
    assert max(abs(row.difference_percent) for row in even.compared) < 1e-3


def test_parameters_of_px4_are_the_geometry() -> None:
    text = str(export(sih(), "allocation").files["vehicle_px4_set.sh"])
    values = dict(line.split()[2:] for line in text.splitlines() if line.startswith("param set"))
    assert values["CA_ROTOR_COUNT"] == "4"
    assert [float(values[f"CA_ROTOR0_P{axis}"]) for axis in "XYZ"] == pytest.approx([0.2, 0.2, 0.0])
    assert [float(values[f"CA_ROTOR{index}_KM"]) for index in range(4)] == pytest.approx([0.02, 0.02, -0.02, -0.02])


def test_neither_mass_nor_size_is_needed() -> None:
    """A result that knows ratios alone; what nobody measured is listed."""
    exported = export(motors(scale=None), "allocation")
    assert "vehicle_betaflight.txt" in exported.files
    assert set(exported.defaults) <= {"arm", "kappa"}
    bare = export([], "allocation", layout=library_layout("hexa.x"))
    assert set(bare.defaults) == {"arm", "kappa"}


def test_without_rotors_they_are_asked_for() -> None:
    with pytest.raises(UsageError, match=r"positions of the rotors.*--layout"):
        export(joined_vehicle([], given={"m": 1.0}), "allocation")


def test_tilted_rotors_need_the_torque_and_lose_side_forces() -> None:
    axes = np.array([[0.0, 0.15, -1.0], [0.0, -0.15, -1.0], [0.0, -0.15, -1.0], [0.0, 0.15, -1.0]])
    tilted = replace(library_layout("quad.x").scaled(0.25), axes=axes)
    with pytest.raises(UsageError, match=r"kappa \(m\).*tilted.*--set kappa=M"):
        export([], "allocation", layout=tilted)
    exported = export([], "allocation", given={"kappa": 0.02}, layout=tilted)
    assert any("side forces" in sentence for sentence in exported.left_out)
    assert "CA_ROTOR0_AY" in str(exported.files["vehicle_px4.params"])


def test_rotors_that_cannot_fly_are_refused() -> None:
    same = replace(library_layout("quad.plus"), spins=np.ones(4), yaw_weights=None)
    with pytest.raises(ModelError, match=r"cannot make .*yaw.* without the other axes"):
        factors_of(same)
    row = RotorLayout(
        name="row", positions=[[0.1, 0, 0], [0.2, 0, 0], [-0.1, 0, 0], [-0.2, 0, 0]], spins=[1, -1, 1, -1]
    )
    with pytest.raises(ModelError, match=r"cannot make roll"):
        factors_of(row)
    outside = replace(UNEVEN, positions=UNEVEN.positions + np.array([0.3, 0.0, 0.0]))
    with pytest.raises(ModelError, match=r"motor 1 of uneven would have to push down in hover|motor \d"):
        factors_of(outside)


def test_betaflight_mixes_eight_motors() -> None:
    angles = np.radians(np.arange(10) * 36.0)
    positions = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(10)])
    exported = export([], "allocation", layout=RotorLayout(name="deca", positions=positions, spins=[1.0, -1.0] * 5))
    assert "vehicle_betaflight.txt" not in exported.files
    assert any("mmix" in sentence for sentence in exported.left_out)
