"""The page about mappings and the mappings beside it say what the code does."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from rotorid.errors import LogError, UsageError
from rotorid.io.registry import read
from rotorid.io.tables.mapping import ANGLES, BODY_VECTORS, EARTH_VECTORS, QUATERNION, parse_mapping, read_mapping
from rotorid.models.rotors import layout_from_toml

DOCS = Path(__file__).resolve().parents[4] / "docs"
PAGE = (DOCS / "mapping.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"```toml\n(.*?)```", PAGE, flags=re.DOTALL)


@pytest.mark.parametrize("number", range(len(EXAMPLES)))
def test_every_example_is_understood(number: int) -> None:
    document = tomllib.loads(EXAMPLES[number])
    if number == 0:
        # The first one shows channels alone, before the page comes to the clock.
        assert all("time" in table for table in document["channels"].values())
    assert parse_mapping(document, f"example {number}").files == (
        ("", "output.csv") if "output.csv" in EXAMPLES[number] else ("",)
    )


@pytest.mark.parametrize("path", sorted((DOCS / "mappings").glob("*.toml")), ids=lambda path: path.name)
def test_every_mapping_is_understood(path: Path) -> None:
    assert read_mapping(path).files[0] == ""


def test_every_vector_stands_on_the_page() -> None:
    listed = dict(re.findall(r"^\| `(\w+)` \| `([a-z_ ]+)` \| (?:`frame`|`world`|both)", PAGE, flags=re.MULTILINE))
    known = {**BODY_VECTORS, **EARTH_VECTORS, **ANGLES, QUATERNION: ANGLES["attitude"]}
    assert {name: tuple(channels.split()) for name, channels in listed.items()} == known


@pytest.mark.parametrize("path", sorted((DOCS / "layouts").glob("*.toml")), ids=lambda path: path.name)
def test_every_layout_is_understood(path: Path) -> None:
    assert not layout_from_toml(path.read_text(encoding="utf-8"), where=path.name).uncontrollable


def test_a_matrix_of_neurobem_is_turned_whatever_its_name(tmp_path: Path) -> None:
    table = np.tile(np.arange(41.0), (300, 1))
    table[:, 0] = np.arange(300) / 400.0
    table[:, 7:11] = [0.0, 0.0, np.sin(0.5), np.cos(0.5)]
    table[:, 28] = 162.0
    savemat(tmp_path / "flight.mat", {"bemnn_of_this_flight": table})
    record = read(tmp_path / "flight.mat", mapping=DOCS / "mappings" / "neurobem.toml", sandbox=False)
    first = {name: float(record[name].values[0]) for name in record.channel_names}
    assert [first[name] for name in ("p", "q", "r", "u", "v", "w")] == [4.0, -5.0, -6.0, 14.0, -15.0, -16.0]
    assert [first[f"motor_speed_{motor}"] for motor in range(1, 5)] == [20.0, 21.0, 22.0, 23.0]
    assert first["psi"] == pytest.approx(-1.0)
    assert first["battery_voltage"] == pytest.approx(16.2)
    with pytest.raises(LogError, match=r"neurobem\.toml"):
        read(tmp_path / "flight.mat", sandbox=False)


def test_motion_capture_is_turned(tmp_path: Path) -> None:
    header = "t,gyro_x,gyro_y,gyro_z,acc_x,acc_y,acc_z,x,y,z,roll,pitch,yaw,u_pitch,baro"
    # Level, 2 m east, 3 m north, 5 m up, nose to the north-east, turning left at 90 deg/s, pushed nose down.
    (tmp_path / "flight.csv").write_text(f"{header}\n1500,0,0,90,0,0,1,2,3,5,0,10,45,0.2,512\n")
    record = read(tmp_path / "flight.csv", mapping=DOCS / "mappings" / "motion_capture_enu.toml")
    (topic,) = record.topics
    found = {channel.name: float(topic.values[row, 0]) for row, channel in enumerate(topic.channels)}
    assert topic.time_s.tolist() == [1.5]
    assert found == pytest.approx(
        {
            "p": 0.0,
            "q": 0.0,
            "r": -np.pi / 2,
            "ax": 0.0,
            "ay": 0.0,
            "az": -9.80665,
            "north": 3.0,
            "east": 2.0,
            "down": -5.0,
            "phi": 0.0,
            "theta": -np.deg2rad(10.0),
            "psi": np.pi / 4,
            "pitch_command": -0.2,
            "pressure_altitude": 5.12,
        },
        abs=1e-12,
    )


def test_a_specific_force_along_the_axes_of_the_earth_is_turned_into_the_body(tmp_path: Path) -> None:
    """A hover that leans 0.3 rad to the right and heads north-west: forward, left, up over a world with z up."""
    roll, yaw = 0.3, np.pi / 4
    quaternion = [
        np.cos(yaw / 2) * np.cos(roll / 2),
        np.cos(yaw / 2) * np.sin(roll / 2),
        np.sin(yaw / 2) * np.sin(roll / 2),
        np.sin(yaw / 2) * np.cos(roll / 2),
    ]
    # Thrust of 11 m/s^2 along the body's up axis, seen from the earth: it pulls to the right of the heading.
    up = 11.0 * np.array([np.sin(yaw) * np.sin(roll), -np.cos(yaw) * np.sin(roll), np.cos(roll)])
    numbers = ",".join(repr(float(number)) for number in (*quaternion, *up))
    table = "t,qw,qx,qy,qz,fx,fy,fz\n" + "".join(f"{0.01 * row!r},{numbers}\n" for row in range(60))
    (tmp_path / "flight.csv").write_text(table)
    force = {"sources": ["fx", "fy", "fz"], "along": "world"}
    document = {
        "frame": "FLU",
        "world": "NWU",
        "clock": {"time": {"source": "t"}},
        "vectors": {"specific_force": force, "quaternion": {"sources": ["qw", "qx", "qy", "qz"]}},
    }
    record = read(tmp_path / "flight.csv", mapping=parse_mapping(document))
    found = [float(record[name].values[5]) for name in ("phi", "ax", "ay", "az")]
    assert found == pytest.approx([roll, 0.0, 0.0, -11.0], abs=1e-9)
    with pytest.raises(UsageError, match=r"\[vectors.quaternion\]"):
        parse_mapping({**document, "vectors": {"specific_force": force}})
    with pytest.raises(UsageError, match="has `along`"):
        parse_mapping({**document, "vectors": {"position": force}})
