"""Paparazzi logs: fields by the definitions of the flight, exact fractions, and what is missing without them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rotorid.data.record import FlightRecord
from rotorid.errors import LogError
from rotorid.io.paparazzi import definitions_of
from rotorid.io.registry import read

DEFINITIONS = """<?xml version="1.0"?>
<configuration time_of_day="1600000000"><telemetry><message name="IMU_GYRO_SCALED" period=".01"/></telemetry>
<protocol><msg_class name="telemetry" id="1">
<message name="ATTITUDE" id="6">
  <field name="phi" type="float" unit="rad" alt_unit="deg"/>
  <field name="psi" type="float" unit="rad" alt_unit="deg"/>
  <field name="theta" type="float" unit="rad" alt_unit="deg"/>
</message>
<message name="IMU_GYRO_SCALED" id="131">
  <field name="gp" type="int32" alt_unit="deg/s" alt_unit_coef="0.0139882"/>
  <field name="gq" type="int32" alt_unit="deg/s" alt_unit_coef="0.0139882"/>
  <field name="gr" type="int32" alt_unit="deg/s" alt_unit_coef="0.0139882"/>
</message>
<message name="IMU_ACCEL_SCALED" id="132">
  <field name="ax" type="int32" alt_unit="m/s2" alt_unit_coef="0.0009766"/>
  <field name="ay" type="int32" alt_unit="m/s2" alt_unit_coef="0.0009766"/>
  <field name="az" type="int32" alt_unit="m/s2" alt_unit_coef="0.0009766"/>
</message>
<message name="ROTORCRAFT_FP" id="147">
  <field name="east" type="int32" alt_unit="m" alt_unit_coef="0.0039063"/>
  <field name="north" type="int32" alt_unit="m" alt_unit_coef="0.0039063"/>
  <field name="up" type="int32" alt_unit="m" alt_unit_coef="0.0039063"/>
  <field name="veast" type="int32" alt_unit="m/s" alt_unit_coef="0.0000019"/>
</message>
<message name="ROTORCRAFT_CMD" id="237">
  <field name="cmd_roll" type="int32"/><field name="cmd_pitch" type="int32"/>
  <field name="cmd_yaw" type="int32"/><field name="cmd_thrust" type="int32"/>
</message>
<message name="ACTUATORS" id="105"><field name="values" type="uint16[]"/></message>
</msg_class>
<msg_class name="datalink" id="2"><message name="ATTITUDE"><field name="x" type="uint8"/></message></msg_class>
</protocol></configuration>"""


def lines(count: int = 100) -> str:
    return "".join(
        f"{0.01 * k:.3f} 42 IMU_GYRO_SCALED {k} {-4096} 0\n"
        f"{0.01 * k:.3f} 42 IMU_ACCEL_SCALED 0 0 -10046\n"
        f"{0.01 * k + 0.002:.3f} 42 ATTITUDE 0.1 1.5 -0.2\n"
        f"{0.01 * k + 0.003:.3f} 42 ROTORCRAFT_FP 256 512 768 524288\n"
        f"{0.01 * k + 0.003:.3f} 42 ROTORCRAFT_CMD 960 -960 0 4800\n"
        f"{0.01 * k + 0.004:.3f} 42 ACTUATORS 1000,1250,1500,2000\n"
        for k in range(count)
    )


def written(folder: Path, text: str, definitions: str = DEFINITIONS) -> Path:
    (folder / "20_12_08.data").write_text(text)
    if definitions:
        (folder / "20_12_08.log").write_text(definitions)
    return folder / "20_12_08.data"


def first(record: FlightRecord, *names: str) -> list[float]:
    return [float(record[name].values[-1]) for name in names]


def test_fields_become_channels(tmp_path: Path) -> None:
    record = read(written(tmp_path, lines()))
    assert first(record, "p", "q", "r") == pytest.approx([99 / 4096, -1.0, 0.0])
    assert first(record, "az") == pytest.approx([-10046 / 1024])
    assert first(record, "phi", "psi", "theta") == [0.1, 1.5, -0.2]
    assert first(record, "east", "north", "down", "velocity_east") == pytest.approx([1.0, 2.0, -3.0, 1.0])
    assert first(record, "roll_command", "pitch_command", "thrust_command") == pytest.approx([0.1, -0.1, 0.5])
    assert first(record, "motor_1", "motor_2", "motor_4") == pytest.approx([0.0, 0.25, 1.0])
    np.testing.assert_allclose(record["p"].time_s, 0.01 * np.arange(100))
    assert [finding.kind for finding in record.findings] == ["assumed_geometry"]


def test_without_definitions_the_file_that_is_missing_is_named(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"without the definitions of its messages; expected 20_12_08\.log"):
        read(written(tmp_path, lines(), ""))


def test_what_cannot_be_read_is_said(tmp_path: Path) -> None:
    text = lines() + "1.0 7 ATTITUDE 0 0 0\n1.01 42 ATT\n1.02 x\n"
    record = read(written(tmp_path, text))
    assert {"several_vehicles", "corrupt_log"} <= {finding.kind for finding in record.findings}
    with pytest.raises(LogError, match="contains only ALIVE; expected messages such as IMU_GYRO"):
        read(written(tmp_path, "0.1 42 ALIVE 1,2,3\n"))


def test_definitions_are_those_of_the_vehicle() -> None:
    found = definitions_of(DEFINITIONS)
    assert [field.name for field in found["ATTITUDE"]] == ["phi", "psi", "theta"]
    assert definitions_of("<message name=") == {}
    assert definitions_of('<<<message  <field name=<message name="A"') == {}
