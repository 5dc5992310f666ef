"""A mapping that the numbers contradict is refused with the table and with what fits; one that fits never is."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rotorid.errors import UsageError
from rotorid.io.registry import read
from rotorid.io.tables.mapping import parse_mapping

RATE_HZ = 250.0
TIME = np.arange(5000) / RATE_HZ
PHI = 0.4 * np.sin(2.0 * TIME) + 0.1 * np.sin(9.0 * TIME)
P = np.gradient(PHI, TIME)
NOISE = np.random.default_rng(1).normal(size=(8, TIME.size))

COLUMNS = {
    "t": TIME,
    "phi": PHI,
    "p": P + 0.05 * NOISE[0],
    "q": 0.3 * np.cos(TIME) + 0.05 * NOISE[1],
    "ax": 0.3 * NOISE[2],
    "ay": 0.3 * NOISE[3],
    "az": -9.81 + 0.8 * NOISE[4],
    "m1": 0.5 + 0.1 * NOISE[5],
    "volt": 15.0 - 0.05 * TIME,
}
TRUE: dict[str, Any] = {
    "clock": {"time": {"source": "t"}},
    "channels": {
        **{name: {"source": name} for name in ("phi", "p", "q", "ax", "ay", "az")},
        "motor_1": {"source": "m1"},
        "battery_voltage": {"source": "volt", "unit": "V"},
    },
}


def attempt(folder: Path, changed: dict[str, Any], **units: Any) -> None:
    """Read the flight with some columns changed; ``units`` are keys of channels, and of the clock."""
    columns = {**COLUMNS, **changed}
    np.savez(folder / "log.npz", **columns)
    document = copy.deepcopy(TRUE)
    for name, keys in units.items():
        table = document["clock"]["time"] if name == "clock" else document["channels"][name]
        table |= keys
    read(folder / "log.npz", mapping=parse_mapping(document, "map.toml"))


DEGREES = 180.0 / np.pi

WRONG = {
    "rates in deg/s named rad/s, fast": ({"q": 4000.0 * COLUMNS["q"]}, {}, "[channels.q]", 'write unit = "deg/s"'),
    "rates in deg/s named rad/s, against phi": (
        {"p": DEGREES * COLUMNS["p"] / 10.0, "phi": PHI / 10.0},
        {},
        "phi changes 1/57 as fast as p says",
        'write unit = "deg/s" in [channels.p]',
    ),
    "rates in rad/s named deg/s": (
        {},
        {"p": {"unit": "deg/s"}},
        "phi changes 57 times as fast",
        'unit = "rad/s" in [channels.p]',
    ),
    "tilt in degrees named rad": ({"phi": DEGREES * PHI}, {}, "[channels.phi]", 'write unit = "deg"'),
    "small tilt in degrees named rad": (
        {"phi": DEGREES * PHI / 10.0, "p": COLUMNS["p"] / 10.0},
        {},
        "57 times",
        'unit = "deg" in [channels.phi]',
    ),
    "gravity 1 named m/s^2": (
        {name: COLUMNS[name] / 9.81 for name in ("ax", "ay", "az")},
        {},
        "[channels.az]",
        'write unit = "g"',
    ),
    "gravity 9.81 named g": (
        {},
        {name: {"unit": "g"} for name in ("ax", "ay", "az")},
        "[channels.az]",
        'write unit = "m/s^2"',
    ),
    "pulses without an offset": (
        {"m1": 1000.0 + 1000.0 * COLUMNS["m1"]},
        {},
        "[channels.motor_1]",
        "offset = -1000.0 and scale = 0.001",
    ),
    "percent": ({"m1": 100.0 * COLUMNS["m1"]}, {}, "[channels.motor_1]", 'unit = "%"'),
    "65535": ({"m1": 65535.0 * COLUMNS["m1"]}, {}, "[channels.motor_1]", "scale = 1.5259"),
    "millivolts": ({"volt": 1e3 * COLUMNS["volt"]}, {}, "[channels.battery_voltage]", 'unit = "mV"'),
    "milliseconds named s": ({"t": 1e3 * TIME}, {}, "[clock]", 'unit = "ms" for the stamps: 250 Hz'),
    "microseconds named s": ({"t": 1e6 * TIME}, {}, "[clock]", 'unit = "us" for the stamps: 250 Hz'),
    "microseconds named ms": ({"t": 1e6 * TIME}, {"clock": {"unit": "ms"}}, "[clock]", 'unit = "us"'),
    "seconds named ms": ({}, {"clock": {"unit": "ms"}}, "[clock]", 'unit = "s"'),
    "stamps that are no stamps": ({"t": COLUMNS["q"]}, {}, "[clock]", "name the column of the stamps"),
    "one column for two channels": ({}, {"q": {"source": "p"}}, "[channels.q]", "correct the source of q or of p"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_the_numbers_contradict_is_refused(name: str, tmp_path: Path) -> None:
    changed, units, where, remedy = WRONG[name]
    with pytest.raises(UsageError) as error:
        attempt(tmp_path, changed, **units)
    assert where in error.value.came
    assert remedy in error.value.remedy
    assert error.value.came.startswith("map.toml: [")


RIGHT: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "as it is": ({}, {}),
    "deg/s and deg": (
        {"p": DEGREES * COLUMNS["p"], "phi": DEGREES * PHI},
        {"p": {"unit": "deg/s"}, "phi": {"unit": "deg"}},
    ),
    "noise for rates": ({"p": 0.3 * NOISE[6]}, {}),
    "a vehicle at rest": ({name: 0.01 * COLUMNS[name] for name in ("p", "q", "phi")}, {}),
    "gravity removed": ({"ax": NOISE[2], "ay": NOISE[3], "az": NOISE[4]}, {}),
    "a dead accelerometer": (dict.fromkeys(("ax", "ay", "az"), 0.0 * TIME), {}),
    "axes up": ({"az": -COLUMNS["az"]}, {}),
    "flips": ({"p": 20.0 * np.sign(np.sin(TIME)), "phi": np.angle(np.exp(20j * np.abs(np.arcsin(np.sin(TIME)))))}, {}),
    "1 Hz of GPS": ({"t": np.arange(TIME.size) * 1.0}, {}),
    "a spike of damage": ({"q": np.where(np.arange(TIME.size) == 77, 1e9, COLUMNS["q"])}, {}),
    "a few stamps that fall": ({"t": np.where(np.arange(TIME.size) % 500 == 77, 0.0, TIME)}, {}),
    "an axis turned around": ({"p": -COLUMNS["p"]}, {}),
}


@pytest.mark.parametrize("name", RIGHT)
def test_what_fits_or_cannot_be_decided_passes(name: str, tmp_path: Path) -> None:
    changed, units = RIGHT[name]
    attempt(tmp_path, changed, **units)


def test_vectors_are_named_by_their_table(tmp_path: Path) -> None:
    np.savez(tmp_path / "log.npz", t=TIME, gyro=5000.0 * np.stack([P, P, P]))
    document = {
        "clock": {"time": {"source": "t"}},
        "vectors": {"rates": {"source": "gyro", "unit": "rad/s"}},
    }
    with pytest.raises(UsageError, match=r"map.toml: \[vectors.rates\] has `unit` = 'rad/s', which makes 'gyro'\[0\]"):
        read(tmp_path / "log.npz", mapping=parse_mapping(document, "map.toml"))
