"""A gigabyte of flight, a simulator's log repeated with its stamps moved on: time and memory stay in bounds."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rotorid.io.ardupilot.dataflash import decode
from rotorid.io.tables.csv import write_csv
from rotorid.typing import AnyArray, IntArray

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="memory is counted in other units elsewhere"),
]

# Runs a command, and says its processor time and its most memory.
CHILD = """
import resource, subprocess, sys
code = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL).returncode
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(code, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024.0**2)
"""


def ran(*words: str | Path) -> tuple[int, float, float]:
    """Exit code, seconds of processor time, GiB of memory of ``rotorid WORDS``."""
    command = [sys.executable, "-c", CHILD, sys.executable, "-m", "rotorid", *words]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    code, seconds, memory = said.split()
    return int(code), float(seconds), float(memory)


def repeated(raw: AnyArray, stamps_at: IntArray, first: int, times: int, to: Path) -> None:
    """A log, and its bytes from ``first`` on again and again, each time later."""
    around = stamps_at[:, np.newaxis] + np.arange(8)
    stamps = raw[around].copy().view("<u8")[:, 0]
    span_us = int(stamps.max() - stamps[stamps > 0].min()) + 5000
    with to.open("wb") as out:
        out.write(raw.tobytes())
        for again in range(1, times):
            copy = raw.copy()
            copy[around] = (stamps + np.uint64(again * span_us))[:, np.newaxis].view(np.uint8).reshape(-1, 8)
            out.write(copy[first:].tobytes())


def dataflash_stamps(raw: AnyArray) -> IntArray:
    tables = [table for table in decode(raw).tables.values() if "TimeUS" in table]
    return np.concatenate([table.positions.astype(np.int64) + table.format.fields["TimeUS"][0] for table in tables])


def ulog_stamps(raw: AnyArray) -> tuple[IntArray, int]:
    """Where the stamps stand, and the first message that holds data."""
    content, at, found = raw.tobytes(), 16, []
    while at + 3 <= len(content):
        if content[at + 2] == ord("D"):
            found.append(at + 5)
        at += 3 + int.from_bytes(content[at : at + 2], "little")
    return np.array(found), found[0] - 5


@pytest.fixture
def room(tmp_path: Path) -> Path:
    space = os.statvfs(tmp_path)
    if space.f_bavail * space.f_frsize < 4 << 30:
        pytest.skip("a gigabyte of flight needs 4 GiB on the disk")
    return tmp_path


@pytest.mark.parametrize(
    ("name", "most_gib"),
    [
        ("ardupilot_sitl/x_calm_roll.BIN", 1.0),
        ("px4_sitl/roll.ulg", 1.0),
    ],
)
def test_a_gigabyte_is_inspected_in_half_a_minute_and_a_gibibyte(
    shared_data: Path, room: Path, name: str, most_gib: float
) -> None:
    raw = np.fromfile(shared_data / name, dtype=np.uint8)
    log = room / Path(name).name
    stamps, first = ulog_stamps(raw) if name.endswith("ulg") else (dataflash_stamps(raw), 0)
    repeated(raw, stamps, first, 10**9 // (raw.size - first) + 1, log)
    code, seconds, memory_gib = ran("inspect", log, "--json")
    log.unlink()
    assert code == 0
    assert seconds < 30.0
    assert memory_gib < most_gib


def test_a_table_of_600_megabytes(room: Path) -> None:
    time_s = np.arange(4_000_000) / 250.0
    names = ("p", "q", "r", "phi", "theta", "psi", "roll_command", "pitch_command", "yaw_command", "ax", "ay", "az")
    rng = np.random.default_rng(0)
    log, part = room / "flight.csv", 400_000
    write_csv(log, time_s[:part], {name: rng.normal(size=part) for name in names})
    header, _, rows = log.read_text().partition("\n")
    tails = [row.partition(",")[2] for row in rows.splitlines()]
    with log.open("w") as out:
        out.write(f"{header}\n")
        for begin in range(0, time_s.size, part):
            clock = time_s[begin : begin + part].tolist()
            out.write("".join(f"{stamp:.10g},{tail}\n" for stamp, tail in zip(clock, tails, strict=True)))
    assert log.stat().st_size > 450e6
    code, seconds, memory_gib = ran("inspect", log, "--json")
    assert (code, seconds < 60.0, memory_gib < 1.5) == (0, True, True)
    # Noise holds no model; what counts is that the stretch is looked at as soon as the table is read.
    _, seconds, memory_gib = ran(
        "identify", log, "--model", "rate.roll", "--segment", "roll:10:70", "--out", room / "o"
    )
    log.unlink()
    assert (seconds < 20.0, memory_gib < 1.5) == (True, True)


def test_a_log_of_200_megabytes_is_reviewed_in_a_gibibyte(shared_data: Path, room: Path) -> None:
    raw = np.fromfile(shared_data / "ardupilot_sitl/x_calm_roll.BIN", dtype=np.uint8)
    log = room / "long.BIN"
    repeated(raw, dataflash_stamps(raw), 0, 9, log)
    assert log.stat().st_size > 195e6
    code, seconds, memory_gib = ran("review", log, "--out", room / "review", "--quiet")
    page = room / "review" / "review.html"
    print(f"{seconds:.0f} s, {memory_gib:.2f} GiB, page of {page.stat().st_size / 1e6:.1f} MB")
    assert code == 0
    assert memory_gib < 1.0
    assert page.stat().st_size < 6e6
