"""Clocks that are none: steps of 2e-17 s, neighboring doubles, denormals, years between two samples.

Whoever divides by a step gets a rate, and whoever multiplies a duration by a rate gets the length of a grid: two stamps
2e-17 s apart, 53 bytes of a file, once took 6.7 GB. What is no clock does not pass the readers.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest

from rotorid.data.record import Channel, FlightRecord, Source, Topic
from rotorid.io import read
from rotorid.signal.clock import resample
from rotorid.typing import FloatArray

MOST_KB = 200_000
NUMBERS = np.arange(400.0)

CLOCKS: Mapping[str, FloatArray] = MappingProxyType(
    {
        "two stamps 2e-17 s apart": np.array([0.0, 2e-17]),
        "three near the least double": np.array([0.0, 1e-302, 2e-302]),
        "denormals": NUMBERS * 5e-324,
        "denormals, then a clock": np.concatenate([NUMBERS[:100] * 5e-324, 0.02 + 0.004 * NUMBERS[:300]]),
        "neighboring doubles": 1.0 + NUMBERS * 2.0**-52,
        "neighboring doubles since 1970": 1.7e9 + NUMBERS * 2.0**-22,
        "a hundred units in the last place since 1970": 1.7e9 + NUMBERS * 100.0 * 2.0**-22,
        "nanoseconds": NUMBERS * 1e-9,
    }
)
"""No clock, or hardly one."""

SPREAD: Mapping[str, FloatArray] = MappingProxyType(
    {
        "three samples in a year": np.array([0.0, 1.0, 2.0]) * 1.5e7,
        "a jump of thirty years": NUMBERS * 0.004 + 1e9 * (NUMBERS >= 200),
        "two flights thirty years apart": NUMBERS * 0.1 + 1e9 * (NUMBERS >= 200),
        "slower and slower": 1e9 * (NUMBERS / 400.0) ** 3,
        "microseconds in clusters": np.repeat(NUMBERS[:40] * 0.05, 10) + np.tile(NUMBERS[:10] * 2e-6, 40),
    }
)
"""Clocks over which no grid may be laid: from end to end, or with their shortest step."""


def table(stamps: FloatArray) -> str:
    k = np.arange(stamps.size)
    columns = {
        "p [rad/s]": np.sin(0.3 * k),
        "phi [rad]": 0.1 * np.sin(0.03 * k),
        "p_setpoint [rad/s]": np.sin(0.3 * k - 0.2),
        "roll_stick [1]": 0.2 * np.sin(0.3 * k),
        "roll_command [1]": 0.1 * np.sign(np.sin(0.01 * k**1.3)),
        "thrust_command [1]": 0.4 + 0.05 * np.sin(0.02 * k),
        "az [m/s^2]": -9.8 + np.cos(0.5 * k),
        "battery_voltage [V]": 16.0 - 0.1 * np.sin(0.2 * k),
        "battery_current [A]": 10.0 + 2.0 * np.sin(0.2 * k),
    }
    rows = [",".join(repr(float(cell)) for cell in row) for row in zip(stamps, *columns.values(), strict=True)]
    return "\n".join([f"time [s],{','.join(columns)}", *rows, ""])


def written(clocks: Mapping[str, FloatArray], folder: Path) -> Path:
    folder.mkdir()
    for name, stamps in clocks.items():
        (folder / f"{name}.csv".replace(" ", "_")).write_text(table(stamps))
    return folder


@pytest.mark.skipif(sys.platform != "linux", reason="limits of memory and their measurement are those of Linux")
@pytest.mark.parametrize("clocks", [CLOCKS, SPREAD], ids=["too fast", "too long"])
def test_no_clock_takes_more_memory_than_the_libraries_do(clocks: Mapping[str, FloatArray], tmp_path: Path) -> None:
    folder = written(clocks, tmp_path / "logs")
    commands = [
        "inspect --json",
        "review",
        "identify --model rate.roll --json",
        "delay",
        "response --inputs roll_command --outputs p",
    ]
    command = [sys.executable, "-m", "tests.hostile.clock_child", str(folder), *commands]
    ran = subprocess.run(command, capture_output=True, text=True, check=False)
    lines = ran.stdout.splitlines()
    assert len(lines) == len(clocks) * len(commands), ran.stderr[-2000:]
    assert not [line for line in lines if ": shown, " not in line]
    peak_kb = max(int(line.split()[-2]) for line in lines)
    assert peak_kb < MOST_KB, lines


@pytest.mark.parametrize("name", CLOCKS)
def test_what_is_no_clock_is_a_finding_and_never_a_rate(name: str, tmp_path: Path) -> None:
    path = tmp_path / "flight.csv"
    path.write_text(table(CLOCKS[name]))
    record = read(path)
    (disorder,) = [finding for finding in record.findings if finding.kind == "clock_disorder"]
    assert disorder.severity == "warning"
    assert all(topic.sample_rate_hz <= 1e6 for topic in record.topics)
    kept = max(topic.time_s.size for topic in record.topics)
    assert kept == (301 if "then a clock" in name else 1)


@pytest.mark.parametrize("start_s", [0.0, 60.0, 86_400.0, 1.7e9])
@pytest.mark.parametrize("step_us", [1, 2, 125, 1000, 20_000])
def test_whole_microseconds_are_a_clock(start_s: float, step_us: int, tmp_path: Path) -> None:
    """Except where a double since 1970 keeps less than 256 units in the last place of a step."""
    stamps = (start_s * 1e6 + step_us * np.arange(300)) / 1e6
    (tmp_path / "flight.csv").write_text(table(stamps))
    record = read(tmp_path / "flight.csv")
    expected = 300 if start_s < 1e9 or step_us >= 125 else 1
    assert max(topic.time_s.size for topic in record.topics) == expected


@pytest.mark.parametrize("stamps", [(0.0, 2e-17), (0.0, 1e-12, 2e-12), (0.0, 1e-6, 2e-6)])
def test_no_uniform_clock_is_longer_than_the_stamps_allow(stamps: Sequence[float]) -> None:
    """Also for a record that somebody made by hand, which no reader has looked at."""
    rate = Channel(name="p", unit="rad/s")
    topic = Topic(name="IMU", time_s=stamps, channels=(rate,), values=np.ones((1, len(stamps))))
    record = FlightRecord(source=Source(name="made", format="", sha256=""), topics=(topic,))
    histories = resample(record, channels=["p"], start_s=stamps[0], stop_s=stamps[-1]).histories
    assert sum(history.values.shape[1] for history in histories) <= 4 * len(stamps)
