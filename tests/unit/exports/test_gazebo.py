"""Gazebo's model: strict XML whose links and plugins, read back, are the vehicle and fly as rotorid's equations do."""

from __future__ import annotations

import re
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np
import pytest
from tests.unit.exports.flown import flown
from tests.unit.exports.motion import STEP_S, doublet, inequality, own
from tests.unit.exports.vehicles import SECOND, asymmetric, second, sih

from rotorid.errors import ModelError
from rotorid.exports import Exported, ExportSettings
from rotorid.exports.gazebo import export
from rotorid.flying.vehicle_from_results import JoinedVehicle, joined_vehicle
from rotorid.models.rotors import library_layout
from rotorid.typing import FloatArray

FLU = np.diag([1.0, -1.0, -1.0])


def test_lags_up_and_down_are_those_of_the_motors() -> None:
    vehicle = second(T_motor=0.03, T_motor_up=0.02, T_motor_down=0.04)
    for path, lag_s in (("timeConstantUp", 0.02), ("timeConstantDown", 0.04)):
        found = re.findall(rf"<{path}>(.*?)</{path}>", text_of(export(vehicle, ExportSettings()), "model.sdf"))
        assert {float(text) for text in found} == {lag_s}


def text_of(exported: Exported, ending: str) -> str:
    (name,) = (name for name in exported.files if name.endswith(ending))
    text = exported.files[name]
    assert isinstance(text, str)
    return text


def number(element: ElementTree.Element, path: str) -> float:
    found = element.findtext(path)
    assert found is not None, path
    return float(found)


def place(text: str | None) -> FloatArray:
    assert text is not None
    values = np.array([float(one) for one in text.split()])
    assert values.size == 6
    assert not values[3:].any()
    return values[:3]


@dataclass
class Model:
    """What the XML says: all links as one body about the origin, and the rotors."""

    mass: float
    center: FloatArray
    inertia: FloatArray
    hubs: FloatArray
    signs: FloatArray
    plugins: list[ElementTree.Element]
    slowest: float
    fastest: float

    def accelerations(self, x: FloatArray, velocity: FloatArray, rates: FloatArray) -> FloatArray:
        """Forces of the plugin's words on the links together, forward, right, down."""
        v, w = FLU @ velocity, FLU @ rates
        force, moment = np.zeros(3), -np.cross(w, self.inertia @ w)
        for plugin, share, hub, sign in zip(self.plugins, x, self.hubs, self.signs, strict=True):
            omega = self.slowest + share * (self.fastest - self.slowest)
            thrust = number(plugin, "motorConstant") * omega**2
            air = v + np.cross(w, hub)
            push = np.array([0, 0, thrust]) - omega * number(plugin, "rotorDragCoefficient") * air * [1, 1, 0]
            force += push
            # The reaction of a rotor that turns counterclockwise turns the body clockwise, seen from above.
            moment += np.cross(hub, push)
            moment[2] -= sign * number(plugin, "momentConstant") * thrust
        return np.concatenate([FLU @ force / self.mass, FLU @ np.linalg.solve(self.inertia, moment)])


def model_of(exported: Exported) -> Model:
    root = ElementTree.fromstring(text_of(exported, "model.sdf"))
    (model,) = root.findall("model")
    mass, moment, inertia, hubs = 0.0, np.zeros(3), np.zeros((3, 3)), {}
    for link in model.findall("link"):
        at = place(link.findtext("pose")) if link.find("pose") is not None else np.zeros(3)
        hubs[link.get("name")] = at
        own_place = link.findtext("inertial/pose")
        center = at + (place(own_place) if own_place else 0.0)
        kilograms = number(link, "inertial/mass")
        i = {key: number(link, f"inertial/inertia/{key}") for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")}
        tensor = np.array(
            [[i["ixx"], i["ixy"], i["ixz"]], [i["ixy"], i["iyy"], i["iyz"]], [i["ixz"], i["iyz"], i["izz"]]]
        )
        assert np.linalg.eigvalsh(tensor).min() > 0.0
        mass += kilograms
        moment = moment + kilograms * center
        inertia = inertia + tensor + kilograms * (center @ center * np.eye(3) - np.outer(center, center))
    plugins = sorted(model.findall("plugin"), key=lambda one: number(one, "actuator_number"))
    airframe = next(str(text) for name, text in exported.files.items() if "_gz_" in name)
    ends = [re.search(rf"SIM_GZ_EC_{end}1 (\d+)\n", airframe) for end in ("MIN", "MAX")]
    assert all(ends)
    joints = {joint.get("name"): joint for joint in model.findall("joint")}
    assert all(joints[one.findtext("jointName")].findtext("child") == one.findtext("linkName") for one in plugins)
    return Model(
        mass=mass,
        center=moment / mass,
        inertia=inertia,
        hubs=np.array([hubs[one.findtext("linkName")] for one in plugins]),
        signs=np.array([1.0 if one.findtext("turningDirection") == "ccw" else -1.0 for one in plugins]),
        plugins=plugins,
        slowest=float(ends[0][1]) if ends[0] else 0.0,
        fastest=float(ends[1][1]) if ends[1] else 0.0,
    )


@pytest.mark.parametrize("vehicle", [sih(), second(T_motor=0.03), asymmetric()], ids=["sih", "second", "odd"])
def test_the_links_together_are_the_vehicle(vehicle: JoinedVehicle) -> None:
    model, body = model_of(export(vehicle, ExportSettings())), vehicle.multirotor
    assert body is not None
    assert model.mass == pytest.approx(body.mass_kg)
    assert model.center == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    assert FLU @ model.inertia @ FLU == pytest.approx(body.inertia_kg_m2, rel=1e-6, abs=1e-9)
    assert model.hubs == pytest.approx(body.rotors.layout.positions @ FLU)
    assert model.signs.tolist() == body.rotors.layout.spins.tolist()


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize(
    "vehicle", [sih(), second(T_motor=0.03, X_u=-0.2), asymmetric(X_u=0.0, Y_v=0.0)], ids=["sih", "second", "odd"]
)
def test_gazebo_answers_a_doublet_as_the_vehicle_does(vehicle: JoinedVehicle, axis: int) -> None:
    # What the plugin has of air: drag across, equal along x and y, at the rotors.
    exported = export(vehicle, ExportSettings())
    rows = {one.name: one.exported for one in exported.compared}
    known = {name: one.value for name, one in vehicle.numbers.items()}
    model = model_of(exported)
    drag = sum(number(one, "rotorDragCoefficient") for one in model.plugins)
    omega = np.sqrt(vehicle.hover_force_n / number(model.plugins[0], "motorConstant"))
    # Drag acts at the rotors: it damps rotation, and tilts a vehicle whose rotors are above its center.
    height, newtons = float(model.hubs[:, 2].mean()), drag * omega
    lever = float((model.hubs[:, :2] ** 2).sum(axis=1).mean())
    air = dict.fromkeys(("X_u", "Y_v"), -newtons / known["m"]) | {"Z_w": 0.0}
    air |= {"M_u": height * newtons / known["I_yy"], "L_v": -height * newtons / known["I_xx"]}
    air |= {"L_p": -(height**2) * newtons / known["I_xx"], "M_q": -(height**2) * newtons / known["I_yy"]}
    air |= {"N_r": -lever * newtons / known["I_zz"]}
    assert vehicle.multirotor is not None
    layout = vehicle.multirotor.rotors.layout
    same = joined_vehicle([], given=known | air, layout=layout).multirotor
    assert same is not None
    outputs = doublet(same, axis)
    # PX4 rounds its range to whole speeds: the same motion begins at the output where the model hovers.
    shift = rows["hover output"] - vehicle.hover_output
    decay = np.exp(-STEP_S / number(model.plugins[0], "timeConstantUp"))
    theirs = flown(model.accelerations, outputs + shift, lambda x, u: u + decay * (x - u), STEP_S)
    found = inequality(own(same, outputs), theirs)
    assert "pqr"[axis] in found
    assert max(found.values()) < 0.02, found


def test_the_second_vehicle_has_its_numbers() -> None:
    model = model_of(export(second(), ExportSettings()))
    # 144.28 before PX4 rounds it to a whole number; the constant moves with it.
    assert (model.slowest, model.fastest) == (144.0, 1000.0)
    assert number(model.plugins[0], "motorConstant") == pytest.approx(
        1.52750e-5 * ((1000 - 144.28) / 856.0) ** 2, rel=2e-5
    )


def test_a_steep_curve_begins_at_zero_and_says_so() -> None:
    steep = joined_vehicle([], given=SECOND | {"c_0": -4.0, "c_1": 6.0, "c_2": 14.0}, layout=library_layout("quad.x"))
    exported = export(steep, ExportSettings())
    assert model_of(exported).slowest == 0.0
    held = {one.name: one for one in exported.compared}
    assert held["hover output"].held == "approximated"
    assert held["vertical acceleration per output"].difference_percent == pytest.approx(0.0, abs=1e-6)
    assert exported.findings[0].kind == "export_compromise"


def test_all_files_are_what_they_say() -> None:
    exported = export(asymmetric(), ExportSettings(names="bird"))
    assert sorted(exported.files) == ["22002_gz_bird", "bird.world.sdf", "bird/model.config", "bird/model.sdf"]
    config = ElementTree.fromstring(text_of(exported, "model.config"))
    assert (config.tag, config.findtext("sdf")) == ("model", "model.sdf")
    world = ElementTree.fromstring(text_of(exported, "world.sdf"))
    assert world.findtext("world/include/uri") == "model://bird"
    sdf = text_of(exported, "model.sdf")
    assert "motor lag" in sdf
    lines = [line for line in str(exported.files["22002_gz_bird"]).splitlines() if line.startswith("param")]
    assert all(re.fullmatch(r"param set-default [A-Z0-9_]{1,16} -?[\d.e+-]+", line) for line in lines)
    # Forward and right: the first rotor stands at the rear right, and turns clockwise.
    assert "param set-default CA_ROTOR0_PX -0.2" in lines
    assert "param set-default CA_ROTOR0_PY 0.15" in lines
    assert "param set-default CA_ROTOR0_KM -0.018" in lines


def test_a_vehicle_of_grams_has_rotors_lighter_than_itself() -> None:
    tiny = SECOND | {"m": 0.03, "I_xx": 1.4e-5, "I_yy": 1.5e-5, "I_zz": 2.9e-5, "c_0": 0.0, "c_1": 0.0, "c_2": 0.15}
    model = model_of(
        export(joined_vehicle([], given=tiny | {"arm": 0.046}, layout=library_layout("quad.x")), ExportSettings())
    )
    assert model.mass == pytest.approx(0.03)


def test_whole_speeds_of_a_slow_rotor_move_the_hover_and_are_said() -> None:
    exported = export(second(speed_max=40.0), ExportSettings())
    (hover,) = (one for one in exported.compared if one.name == "hover output")
    assert hover.held == "approximated"
    with pytest.raises(ModelError, match="from 0 to 1 rad/s; expected at least 10 rad/s between them"):
        export(second(speed_max=0.6), ExportSettings())
