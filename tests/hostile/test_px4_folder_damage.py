"""Damaged folders of CSV files: one sentence that names file and line, or a record that says what was cut."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rotorid.data.record import FlightRecord, Source
from rotorid.errors import LogError
from rotorid.io.px4 import folder as px4_folder

SOURCE = Source(name="flight", format=px4_folder.FORMAT, sha256="")
FILE = "log_vehicle_torque_setpoint_0.csv"
HEADER = "timestamp,xyz[0],xyz[1],xyz[2]\n"
LINES = [f"{1000000 + 4000 * n},{n},2.25,-0.5\n" for n in range(40)]
TEXT = HEADER + "".join(LINES)


def outcome(folder: Path, content: bytes) -> FlightRecord | str:
    (folder / FILE).write_bytes(content)
    try:
        return px4_folder.read_folder(folder, SOURCE)
    except LogError as error:
        return str(error)


@pytest.mark.parametrize("cut", range(1, len(TEXT), 4))
def test_a_cut_file_keeps_its_whole_lines(tmp_path: Path, cut: int) -> None:
    found = outcome(tmp_path, TEXT[:cut].encode())
    whole = TEXT[:cut].count("\n") - 1
    if whole < 1:
        assert isinstance(found, str)
        return
    assert isinstance(found, FlightRecord)
    assert found.topics[0].time_s.size == whole
    said = [finding.where for finding in found.findings if finding.kind == "corrupt_log"]
    assert said == ([] if TEXT[:cut].endswith("\n") else [FILE])


def test_flipped_bits_are_a_record_or_one_sentence(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for place in rng.integers(len(TEXT), size=500).tolist():
        content = bytearray(TEXT.encode())
        content[place] ^= 1 << int(rng.integers(8))
        found = outcome(tmp_path, bytes(content))
        assert isinstance(found, FlightRecord) or FILE in found or "contains no topic" in found


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"", "line 1 is no header"),
        (b"\xff\xfe\0\0\n", "line 1 is not UTF-8 text"),
        (b"time,xyz[0]\n1,2\n", "line 1 is no header"),
        (b"timestamp,xyz[0],xyz[0]\n1,2,3\n", "names each column once"),
        (HEADER.encode() + b"1,2,3,4\n1,2\n", "line 3 has not the 4 cells"),
        (HEADER.encode() + b"1,2,3,4\n2,2,x,4\n", "line 3 contains a cell that is no number"),
        (HEADER.encode() + b"-1,2,3,4\n", "line 2 has a time stamp"),
        (HEADER.encode() + b"nan,2,3,4\n", "line 2 has a time stamp"),
        (HEADER.encode() + b"1e300,2,3,4\n", "line 2 has a time stamp"),
    ],
)
def test_nonsense_is_one_sentence(tmp_path: Path, content: bytes, sentence: str) -> None:
    found = outcome(tmp_path, content)
    assert isinstance(found, str)
    assert sentence in found


def test_a_parameter_file_cannot_make_anything_run(tmp_path: Path) -> None:
    (tmp_path / "parameters.octave").write_bytes(
        b"# name A\nsystem('true')\nB = 1+1\n\xff\xfe\nC = 1e999\n" + b"D " * 99
    )
    found = outcome(tmp_path, TEXT.encode())
    assert isinstance(found, FlightRecord)
    assert found.parameters == {}


def test_folders_that_are_called_like_files_are_passed_over(tmp_path: Path) -> None:
    (tmp_path / "log_battery_status_0.csv").mkdir()
    assert isinstance(outcome(tmp_path, TEXT.encode()), FlightRecord)
