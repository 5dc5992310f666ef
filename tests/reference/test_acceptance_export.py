"""Vehicles of PX4's and ArduPilot's simulators, identified from their logs, come back as the defaults that flew."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rotorid.exports import Exported, ExportSettings, export, export_draws
from rotorid.flying.vehicle_from_results import joined_vehicle
from rotorid.identifying.identification import identify, identify_motors
from rotorid.io.registry import read
from rotorid.results.model import IdentifiedModel
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.motors import MotorSettings

pytestmark = pytest.mark.slow

Unpacked = Callable[[str], Path]


@pytest.fixture(scope="module")
def px4(unpacked: Unpacked) -> IdentifiedModel:
    logs = [unpacked(f"px4_sitl/{name}") for name in ("roll.ulg", "pitch.ulg.xz", "yaw.ulg.xz", "thrust.ulg.xz")]
    choices = MotorSettings(known={"m": 1.0, "I_zz": 0.03}, arm_m=0.2828)
    return identify_motors([read(log) for log in logs], choices)


@pytest.fixture(scope="module")
def ardupilot(unpacked: Unpacked) -> IdentifiedModel:
    names = ("x_calm_roll.BIN", "x_calm_thrust.BIN.xz", "x_wind_rollpitch.BIN.xz", "x_wind_yawthrust.BIN.xz")
    choices = MotorSettings(known={"m": 3.0, "I_zz": 0.04594}, arm_m=0.35)
    return identify_motors([read(unpacked(f"ardupilot_sitl/{name}")) for name in names], choices)


@pytest.fixture(scope="module")
def drag(unpacked: Unpacked) -> IdentifiedModel:
    """Calm air: momentum drag is all the drag near hover."""
    record = read(unpacked("ardupilot_sitl/x_calm_roll.BIN"))
    return identify([record], "hover.lateral", settings=IdentifySettings(reduce=True))


def parameters(exported: Exported) -> dict[str, float]:
    text = exported.files["vehicle_set.sh"]
    assert isinstance(text, str)
    lines = [line.split() for line in text.splitlines() if line.startswith("param set ")]
    return {name: float(value) for _, _, name, value in lines}


def table(exported: Exported) -> dict[str, Any]:
    return dict(json.loads(exported.files["vehicle.json"]))


def test_the_defaults_of_sih_come_back(px4: IdentifiedModel) -> None:
    found = parameters(export(px4, "px4-sih"))
    assert found["SIH_T_MAX"] == pytest.approx(5.0, rel=0.03)
    assert found["SIH_T_TAU"] == pytest.approx(0.05, rel=0.05)
    assert found["SIH_IXX"] == pytest.approx(0.025, rel=0.03)
    assert found["SIH_IYY"] == pytest.approx(0.025, rel=0.03)
    assert found["SIH_Q_MAX"] == pytest.approx(0.1, rel=0.05)
    # One damping for three axes: the mean of roll and pitch.
    assert found["SIH_KDW"] == pytest.approx(0.025, rel=0.1)


def test_what_was_given_of_sih_is_said_to_be_given(px4: IdentifiedModel) -> None:
    numbers = joined_vehicle([px4]).numbers
    given = {name for name, one in numbers.items() if one.source == "given"}
    assert {"m", "I_zz", "arm"} <= given
    assert not {"I_xx", "I_yy", "c_1", "T_motor", "kappa"} & given


def test_draws_of_sih_spread_as_the_result_does(px4: IdentifiedModel) -> None:
    made, _ = export_draws([px4], "px4-sih", ExportSettings(), 40, seed=1)
    inertia = [parameters(one)["SIH_IXX"] for one in made]
    std = px4.parameters["I_xx"].std
    assert std is not None
    spread = (sum((one - px4.parameters["I_xx"].value) ** 2 for one in inertia) / len(inertia)) ** 0.5
    # Of 40 draws a standard deviation is known to 11 %.
    assert spread == pytest.approx(std, rel=0.35)


def test_the_default_frame_of_ardupilot_comes_back(ardupilot: IdentifiedModel) -> None:
    found = table(export(ardupilot, "ardupilot", given={"disc_area": 0.385}))
    assert found["hoverThrOut"] == pytest.approx(0.39, rel=0.03)
    assert found["propExpo"] == pytest.approx(0.65, rel=0.03)
    assert found["moment_inertia"][:2] == pytest.approx([0.02297, 0.02297], rel=0.03)
    # SITL's torque has a factor of one, which the export knows by kappa alone.
    assert [found[f"motor{number}_yaw"] for number in range(1, 5)] == pytest.approx([1, 1, -1, -1], rel=0.05)


def test_the_momentum_drag_of_ardupilot_lies_in_its_interval(ardupilot: IdentifiedModel, drag: IdentifiedModel) -> None:
    found = table(export([ardupilot, drag], "ardupilot", given={"disc_area": 0.385}))["mdrag_coef"]
    known = drag.parameters["Y_v"]
    assert known.std is not None
    reach = 1.96 * known.std / abs(known.value) * found
    assert abs(found - 0.2) <= reach
    # The interval says something: zero is not in it.
    assert reach < found
