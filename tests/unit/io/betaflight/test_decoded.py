"""A decoded blackbox log holds what the log holds, as far as its settings came with it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rotorid
from rotorid.data import FlightRecord
from rotorid.errors import LogError
from rotorid.io.betaflight.blackbox import Flight, flights

N = 3000


@pytest.fixture(scope="module")
def log(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first seconds of a real log."""
    path = tmp_path_factory.mktemp("blackbox") / "LOG.BBL"
    path.write_bytes((shared_data / "betaflight" / "smooth_tune.BBL").read_bytes()[:200_000])
    return path


@pytest.fixture(scope="module")
def flight(log: Path) -> Flight:
    _, found = next(flights(log.read_bytes()))
    assert isinstance(found, Flight)
    return replace(found, time_s=found.time_s[:N], frames=found.frames[:N])


@pytest.fixture(scope="module")
def sound(log: Path) -> FlightRecord:
    return rotorid.read(log)


def rows(flight: Flight, *, gyro_unit: str = "") -> list[str]:
    """Lines as blackbox_decode writes them; a column of words stands among the numbers."""
    shown = {"time": "time (us)", "vbatLatest": "vbatLatest (V)"}
    scales = {"vbatLatest": 0.1}
    if gyro_unit:
        shown |= {f"gyroADC[{axis}]": f"gyroADC[{axis}] ({gyro_unit})" for axis in range(3)}
        scales |= {f"gyroADC[{axis}]": np.pi / 180.0 for axis in range(3)}
    header = ", ".join([*(shown.get(name, name) for name in flight.fields), "flightModeFlags (flags)"])
    values = flight.frames * np.array([scales.get(name, 1.0) for name in flight.fields])
    return [header, *(", ".join([*(f"{value:.12g}" for value in row), "ANGLE_MODE|ARM"]) for row in values.tolist())]


def settings(flight: Flight) -> list[str]:
    return [f'{name}, "{value}"' for name, value in flight.header.values.items() if not name.startswith("Field")]


def compare(record: FlightRecord, sound: FlightRecord, names: list[str]) -> None:
    for name in names:
        np.testing.assert_allclose(record[name].values, sound[name].values[:N], rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(record[name].time_s, sound[name].time_s[:N], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("unit", ["", "rad/s"])
def test_with_its_settings_beside_it_the_csv_is_the_log(
    tmp_path: Path, flight: Flight, sound: FlightRecord, unit: str
) -> None:
    (tmp_path / "LOG.01.csv").write_text("\n".join(rows(flight, gyro_unit=unit)))
    (tmp_path / "LOG.01.headers.csv").write_text("\n".join(["fieldname, fieldvalue", *settings(flight)]))
    record = rotorid.read(tmp_path / "LOG.01.csv")
    assert record.source.format == "Betaflight blackbox as CSV"
    assert record.source.firmware == sound.source.firmware
    assert record.channel_names == sound.channel_names
    compare(record, sound, list(sound.channel_names))
    assert [finding.kind for finding in record.findings] == ["assumed_geometry"]


def test_settings_on_top_of_the_table_are_as_good(tmp_path: Path, flight: Flight, sound: FlightRecord) -> None:
    top = [f'"{name}","{value}"' for name, value in flight.header.values.items() if not name.startswith("Field")]
    header, *body = rows(flight)
    quoted = ",".join(f'"{cell.strip()}"' for cell in header.split(","))
    (tmp_path / "export.csv").write_text("\n".join([*top, quoted, *body]))
    compare(rotorid.read(tmp_path / "export.csv"), sound, list(sound.channel_names))


def test_without_settings_rates_and_sticks_are_read_and_the_rest_is_named(
    tmp_path: Path, flight: Flight, sound: FlightRecord
) -> None:
    (tmp_path / "LOG.01.csv").write_text("\n".join(rows(flight)))
    record = rotorid.read(tmp_path / "LOG.01.csv")
    compare(record, sound, ["p", "q", "r", "roll_stick", "thrust_stick"])
    assert not {"motor_1", "az", "battery_voltage"} & set(record.channel_names)
    told = next(finding for finding in record.findings if finding.where == "settings")
    assert "--save-headers" in told.message


def test_a_last_line_that_was_cut_is_left_out(tmp_path: Path, flight: Flight) -> None:
    lines = rows(flight)
    (tmp_path / "LOG.01.csv").write_text("\n".join([*lines[:100], lines[100][:40]]))
    assert rotorid.read(tmp_path / "LOG.01.csv")["p"].values.size == 99


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("loopIteration, time (us), gyroADC[0]\n", "contains no flight"),
        ("loopIteration, time (us), rssi\n1, 2, 3\n", "no column of time, gyro or motors"),
        ("loopIteration, time (us), motor[0], motor[1]\n0, 0, 200, 300\n", "have no unit without the settings"),
        ("loopIteration, time (us), gyroADC[0]\n1, 2, three\n1, 2, 3\n", "not numeric"),
        ('"Product","Blackbox flight data recorder by Nicholas Sherlock"\n"a","b"\n', "settings but no table"),
    ],
)
def test_a_table_that_cannot_be_read_is_one_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    (tmp_path / "LOG.01.csv").write_text(text)
    with pytest.raises(LogError, match=sentence) as error:
        rotorid.read(tmp_path / "LOG.01.csv")
    assert error.value.exit_code == 2
    assert error.value.remedy


def test_a_log_of_high_resolution_without_settings_is_known_by_its_throttle(
    tmp_path: Path, flight: Flight, sound: FlightRecord
) -> None:
    tenths = [10.0 if name.startswith(("rcCommand", "gyroADC")) else 1.0 for name in flight.fields]
    fine = replace(flight, frames=flight.frames * np.array(tenths))
    (tmp_path / "LOG.01.csv").write_text("\n".join(rows(fine)))
    record = rotorid.read(tmp_path / "LOG.01.csv")
    compare(record, sound, ["p", "q", "r", "roll_stick", "thrust_stick"])


def test_without_settings_and_throttle_the_scale_of_rates_is_said_to_be_unknown(tmp_path: Path) -> None:
    (tmp_path / "LOG.01.csv").write_text("loopIteration, time (us), gyroADC[0]\n0, 0, 100\n1, 500, 100\n")
    record = rotorid.read(tmp_path / "LOG.01.csv")
    (told,) = [finding for finding in record.findings if finding.where == "settings"]
    assert "the scale of rates and set-points is unknown" in told.message


@pytest.mark.parametrize(("unit", "value"), [("A", 12.5), ("mA", 12500.0)])
def test_current_is_in_the_unit_of_its_column(unit: str, value: float, tmp_path: Path, flight: Flight) -> None:
    header, *body = rows(flight)
    (tmp_path / "LOG.01.headers.csv").write_text("\n".join(["fieldname, fieldvalue", *settings(flight)]))
    table = [f"{header}, amperageLatest ({unit})", *(f"{line}, {value}" for line in body[:50])]
    (tmp_path / "LOG.01.csv").write_text("\n".join(table))
    np.testing.assert_allclose(rotorid.read(tmp_path / "LOG.01.csv")["battery_current"].values, 12.5)
