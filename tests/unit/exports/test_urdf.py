"""The URDF of gym-pybullet-drones: its reader counts children, and PyBullet's equations answer as the vehicle does."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from tests.unit.exports.motion import STEP_S, doublet, inequality, named, own
from tests.unit.exports.vehicles import SIH, asymmetric, second

from rotorid.errors import ModelError
from rotorid.exports import Exported, ExportSettings
from rotorid.exports.mujoco import FLU
from rotorid.exports.urdf import export
from rotorid.flying.vehicle_from_results import JoinedVehicle, joined_vehicle
from rotorid.models.rotors import library_layout
from rotorid.typing import FloatArray


class Reader:
    """What gym-pybullet-drones takes from its places in a file."""

    def __init__(self, exported: Exported) -> None:
        text = exported.files["vehicle.urdf"]
        assert isinstance(text, str)
        root = ElementTree.fromstring(text)
        self.properties = {name: float(value) for name, value in root[0].attrib.items()}
        inertial = root[1][0]
        self.mass = float(inertial[1].attrib["value"])
        self.inertia = np.array([float(inertial[2].attrib[f"i{axis}{axis}"]) for axis in "xyz"])
        shape = root[1][2][1][0]
        self.radius, self.length = float(shape.attrib["radius"]), float(shape.attrib["length"])
        places = {link.attrib["name"]: link[0][0].attrib["xyz"] for link in root.iter("link")}
        self.links = list(places)
        self.hubs = np.array([np.fromstring(places[f"prop{i}_link"], sep=" ") for i in range(4)])
        found = re.search(r"to 1: (\S+) \* max\(x \+ (\S+), 0\)", text)
        assert found is not None
        self.slope, self.shift = float(found[1]), float(found[2])
        order = re.search(r"prop0 to prop3: ([\d, ]+)", text)
        assert order is not None
        self.order = [int(number) - 1 for number in order[1].split(",")]

    def rpm(self, outputs: FloatArray) -> FloatArray:
        return np.asarray(self.slope * np.maximum(outputs[self.order] + self.shift, 0.0))


def flown(reader: Reader, outputs: FloatArray, *, gravity: float) -> dict[str, FloatArray]:
    """Its equations in small steps, without drag."""
    p = reader.properties
    rates, velocity, turn = np.zeros(3), np.zeros(3), np.eye(3)
    kept = np.empty((len(outputs), 6))
    for k, row in enumerate(outputs):
        square = reader.rpm(row) ** 2
        force = p["kf"] * square
        drag = -np.array([p["drag_coeff_xy"]] * 2 + [p["drag_coeff_z"]]) * reader.rpm(row).sum() * 2.0 * np.pi / 60.0
        moment = np.array([reader.hubs[:, 1] @ force, -reader.hubs[:, 0] @ force, p["km"] * square @ [-1, 1, -1, 1]])
        moment = moment - np.cross(rates, reader.inertia * rates)
        push = turn @ (np.array([0.0, 0.0, force.sum()]) + drag * (turn.T @ velocity))
        rates = rates + STEP_S * moment / reader.inertia
        velocity = velocity + STEP_S * (push / reader.mass - np.array([0.0, 0.0, gravity]))
        x, y, z = STEP_S * rates
        turn = turn @ (np.eye(3) + np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]))
        kept[k] = *rates, *velocity
    return named(kept[:, :3] @ FLU, kept[:, 3:] @ FLU)


def test_the_reader_finds_everything_in_its_place() -> None:
    vehicle = asymmetric()
    reader = Reader(export(vehicle, ExportSettings()))
    assert reader.links == ["base_link", "prop0_link", "prop1_link", "prop2_link", "prop3_link", "center_of_mass_link"]
    # Rotors above the center would be damped by PyBullet, and their height has no effect.
    assert vehicle.multirotor is not None
    assert np.any(vehicle.multirotor.hubs_m[:, 2])
    np.testing.assert_array_equal(reader.hubs[:, 2], 0.0)
    assert reader.mass == 1.7
    np.testing.assert_allclose(reader.inertia, [0.018, 0.024, 0.035])
    assert reader.radius > reader.length > 0.0
    # Front right, rear right, rear left, front left.
    np.testing.assert_array_equal(np.sign(reader.hubs[:, :2]), [[1, -1], [-1, -1], [-1, 1], [1, 1]])
    assert reader.order == [1, 0, 2, 3]
    assert reader.properties["km"] / reader.properties["kf"] == pytest.approx(0.018)
    assert list(reader.properties) == [
        *("arm", "kf", "km", "thrust2weight", "max_speed_kmh", "gnd_eff_coeff", "prop_radius"),
        *("drag_coeff_xy", "drag_coeff_z", "dw_coeff_1", "dw_coeff_2", "dw_coeff_3"),
    ]


def straight() -> JoinedVehicle:
    """A vehicle of which all is held but the damping, which it has not."""
    known = {name: SIH[name] for name in ("m", "I_xx", "I_yy", "I_zz", "kappa", "arm", "X_u", "Y_v", "Z_w")}
    return joined_vehicle([], given=known | {"c_0": 0.1, "c_1": 2.0, "c_2": 10.0}, layout=library_layout("quad.x"))


def test_it_hovers_and_answers_a_doublet_as_rotorid_does() -> None:
    vehicle = straight()
    reader, body = Reader(export(vehicle, ExportSettings())), vehicle.multirotor
    assert body is not None
    still = flown(reader, np.tile(body.hover_shares, (200, 1)), gravity=9.80665)
    assert max(np.abs(values).max() for values in still.values()) < 1e-6
    for axis in range(3):
        outputs = doublet(body, axis)
        found = inequality(own(body, outputs), flown(reader, outputs, gravity=9.80665))
        assert "pqr"[axis] in found
        assert max(found.values()) < 0.02, found


def test_full_speed_is_full_output() -> None:
    vehicle = straight()
    reader = Reader(export(vehicle, ExportSettings()))
    full = 4.0 * reader.properties["kf"] * reader.rpm(np.ones(4))[0] ** 2
    assert full == pytest.approx(4.0 * 12.1, rel=1e-6)
    assert reader.properties["thrust2weight"] == pytest.approx(full / (reader.mass * 9.8), rel=1e-6)


def test_lag_and_damping_are_left_out_and_said() -> None:
    exported = export(asymmetric(), ExportSettings())
    rows = {row.name: row for row in exported.compared}
    assert {rows[name].held for name in ("motor lag", "delay", "L_p", "M_q", "N_r", "M_u", "L_v")} == {"not"}
    said = " ".join(exported.left_out)
    assert "30 ms" in said
    assert "6 ms" in said
    assert "Products of inertia" in said


def test_it_is_written_under_its_name(tmp_path: Path) -> None:
    exported = export(second(), ExportSettings(names="tuned"))
    exported.write(tmp_path)
    assert ElementTree.parse(tmp_path / "tuned.urdf").getroot().attrib["name"] == "tuned"
    assert "DroneModel.TUNED" in exported.start


@pytest.mark.parametrize("layout", ["quad.plus", "hexa.x"])
def test_another_layout_is_refused(layout: str) -> None:
    vehicle = joined_vehicle([], given=SIH, layout=library_layout(layout))
    with pytest.raises(ModelError, match="which gym-pybullet-drones flies"):
        export(vehicle, ExportSettings())
