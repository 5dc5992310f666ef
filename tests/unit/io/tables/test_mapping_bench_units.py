"""Motors of a bench in volts, pulses, percent and speeds: as they come, and refused where a unit contradicts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rotorid.errors import InsufficientDataError, UsageError
from rotorid.io.registry import read
from rotorid.io.tables.csv import write_csv
from rotorid.signal.airborne import airborne

TIME_S = np.arange(0.0, 20.0, 0.01)
SINE = np.sin(2.0 * TIME_S)


def table(path: Path, unit: str, middle: float, size: float, *, mapped: str | None = None) -> Path:
    """A log of one motor and an angle; without a unit in its header where a mapping has it."""
    header = f"time [s],{'u' if mapped else f'motor_3 [{unit}]'},{'angle' if mapped else 'phi [deg]'}"
    rows = np.column_stack([TIME_S, middle + size * SINE, 5.0 * SINE])
    np.savetxt(path / "rig.csv", rows, delimiter=",", header=header, comments="", fmt="%.8g")
    if mapped:
        (path / "rig.toml").write_text(mapped, encoding="utf-8")
    return path / "rig.csv"


def mapping(unit: str) -> str:
    return f"""
[clock]
time = {{ source = "time [s]" }}
[channels.motor_3]
source = "u"
unit = "{unit}"
[channels.phi]
source = "angle"
unit = "deg"
"""


@pytest.mark.parametrize(
    ("unit", "middle", "size", "held", "factor"),
    [
        ("V", 6.0, 1.3, "V", 1.0),
        ("mV", 6000.0, 1300.0, "V", 1e-3),
        ("%", 50.0, 20.0, "1", 0.01),
        ("us", 1500.0, 90.0, "us", 1.0),
        ("ms", 1.5, 0.09, "us", 1e3),
        ("rpm", 5000.0, 700.0, "rad/s", np.pi / 30.0),
    ],
)
@pytest.mark.parametrize("by_map", [False, True])
def test_a_motor_keeps_its_unit(
    tmp_path: Path, unit: str, middle: float, size: float, held: str, factor: float, *, by_map: bool
) -> None:
    file = table(tmp_path, unit, middle, size, mapped=mapping(unit) if by_map else None)
    record = read(file, mapping=tmp_path / "rig.toml" if by_map else None)
    motor = record["motor_3"]
    assert motor.unit == held
    np.testing.assert_allclose(motor.values, factor * (middle + size * SINE), rtol=1e-6)
    assert not record.findings


@pytest.mark.parametrize(
    ("unit", "middle", "size", "remedy"),
    [
        ("1", 6.0, 1.3, 'unit = "V" for volts'),
        ("1", 1500.0, 90.0, 'unit = "us"'),
        ("V", 1500.0, 90.0, 'unit = "us"'),
        ("us", 5000.0, 700.0, "correct `source`, `unit` or `scale`"),
    ],
)
def test_a_unit_that_numbers_contradict_is_refused(
    tmp_path: Path, unit: str, middle: float, size: float, remedy: str
) -> None:
    file = table(tmp_path, unit, middle, size, mapped=mapping(unit))
    with pytest.raises(UsageError) as caught:
        read(file, mapping=tmp_path / "rig.toml")
    assert remedy in str(caught.value)


@pytest.mark.parametrize("unit", ["deg", "m/s", "kg"])
def test_a_unit_that_drives_no_motor_is_refused(tmp_path: Path, unit: str) -> None:
    with pytest.raises(UsageError, match="a unit of 1 or V or us or rad/s"):
        read(table(tmp_path, unit, 1.0, 0.1))
    with pytest.raises(UsageError, match="a unit of 1 or V or us or rad/s"):
        read(table(tmp_path, "V", 1.0, 0.1, mapped=mapping(unit)), mapping=tmp_path / "rig.toml")


def test_what_was_written_in_volts_reads_back(tmp_path: Path) -> None:
    write_csv(tmp_path / "a.csv", TIME_S, {"motor_1": 6.0 + SINE, "phi": 0.1 * SINE}, {"motor_1": "V"})
    record = read(tmp_path / "a.csv")
    assert (record["motor_1"].unit, record["phi"].unit) == ("V", "rad")
    np.testing.assert_allclose(record["motor_1"].values, 6.0 + SINE, rtol=1e-6)


def test_a_line_of_a_mapping_is_a_source_with_its_unit(tmp_path: Path) -> None:
    rows = np.column_stack([1e3 * TIME_S, 6.0 + SINE, 5.0 * SINE])
    np.savetxt(tmp_path / "a.csv", rows, delimiter=",", header="t,U 3,angle", comments="", fmt="%.8g")
    short = 'clock = "t [ms]"\nchannels.motor_3 = "U 3 [V]"\nchannels.phi = "angle [deg]"\n'
    (tmp_path / "a.toml").write_text(short, encoding="utf-8")
    record = read(tmp_path / "a.csv", mapping=tmp_path / "a.toml")
    np.testing.assert_allclose(record["motor_3"].values, 6.0 + SINE, rtol=1e-6)
    np.testing.assert_allclose(record["phi"].values, np.radians(5.0 * SINE), atol=1e-6)
    np.testing.assert_allclose(record["phi"].time_s, TIME_S, atol=1e-6)


def test_a_motor_without_a_unit_asks_for_it(tmp_path: Path) -> None:
    file = table(tmp_path, "1", 6.0, 1.3)
    found = read(file)
    assert [finding.kind for finding in found.findings] == ["impossible_value"]
    assert "Write its unit, such as motor_3 [V]" in found.findings[0].message
    with pytest.raises(
        InsufficientDataError, match=r"motor_3 of rig\.csv is no share of full output; this needs its unit"
    ):
        airborne(found)


@pytest.mark.parametrize(("limits", "low", "high"), [("[1100, 1900]", 1100.0, 1900.0), ('"logged"', 1410.0, 1590.0)])
def test_an_output_is_its_share_between_the_smallest_and_the_largest(
    tmp_path: Path, limits: str, low: float, high: float
) -> None:
    mapped = f'clock = "time [s]"\nchannels.motor_3 = {{ source = "u", range = {limits} }}\n'
    record = read(table(tmp_path, "us", 1500.0, 90.0, mapped=mapped), mapping=tmp_path / "rig.toml")
    assert record.unit_of("motor_3") == "1"
    np.testing.assert_allclose(record["motor_3"].values, (1500.0 + 90.0 * SINE - low) / (high - low), atol=1e-5)


@pytest.mark.parametrize(
    ("words", "came"),
    [
        ("range = [1900, 1100]", "two rising numbers"),
        ('range = "all"', "two rising numbers"),
        ('range = "logged", unit = "us"', "remove `unit`"),
    ],
)
def test_a_range_that_is_none_is_refused(tmp_path: Path, words: str, came: str) -> None:
    mapped = f'clock = "time [s]"\nchannels.motor_3 = {{ source = "u", {words} }}\n'
    file = table(tmp_path, "us", 1500.0, 90.0, mapped=mapped)
    with pytest.raises(UsageError, match=came):
        read(file, mapping=tmp_path / "rig.toml")
