"""Every model of the flights whose simulators are known: 95 % intervals that hold, of each simulator."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import pytest
from tests.reference.simulators import ARDUPILOT_DAMPING_1_S, ARDUPILOT_DELAY_S, PX4, PX4_DELAYS_S

import rotorid
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError

PROMISED = 0.93
TWO_SIDED = 1.96
HOVER = ("hover.longitudinal", "hover.lateral", "hover.full")
DELAYS = ("tau_roll", "tau_pitch", "tau_yaw", "tau_thrust")
ARDUPILOT = {"L_roll": 437.2, "M_pitch": 437.2, "N_yaw": 14.18, "Z_thrust": -27.05} | dict.fromkeys(
    DELAYS, ARDUPILOT_DELAY_S
)
ARDUPILOT_CALM = ARDUPILOT | {"Z_thrust": -27.33, "L_p": ARDUPILOT_DAMPING_1_S, "M_q": ARDUPILOT_DAMPING_1_S}
"""Drag of the ArduPilot simulator grows with the square of the speed: it has no slope at rest, and none is judged."""

UNCOUPLED = dict.fromkeys(("X_w", "Z_q", "L_p", "N_v", "Y_r", "L_yaw", "Y_yaw", "X_thrust", "M_thrust", "N_spin"), 0.0)
PX4_TRUTH = {**UNCOUPLED, **PX4, **PX4_DELAYS_S, "X_u": -1.0, "Y_v": -1.0} | dict.fromkeys(
    ("M_u", "L_v", "X_q", "Y_p", "M_w", "Z_u", "L_r", "N_p", "N_roll"), 0.0
)

REFUSED = {"s500 axis.roll", "s500 axis.pitch", "s500 axis.vertical"}
"""What turns and lifts the S500 beside one axis alone is of the size of the axis itself; hover models hold it."""


class Flight(NamedTuple):
    """What is identified of which logs, and what is true of them."""

    folder: str
    logs: Sequence[str]
    models: Sequence[str]
    truth: Mapping[str, float]


FLIGHTS = (
    Flight("px4_sitl", ["roll.ulg"], ("rate.roll", "axis.roll"), PX4_TRUTH),
    Flight("px4_sitl", ["pitch.ulg.xz"], ("rate.pitch", "axis.pitch"), PX4_TRUTH),
    Flight("px4_sitl", ["yaw.ulg.xz"], ("rate.yaw", "axis.yaw"), PX4_TRUTH),
    Flight("px4_sitl", ["thrust.ulg.xz"], ("rate.vertical", "axis.vertical"), PX4_TRUTH),
    Flight("px4_sitl", ["pitch.ulg.xz", "thrust.ulg.xz"], HOVER[:1], PX4_TRUTH),
    Flight("px4_sitl", ["roll.ulg", "yaw.ulg.xz"], HOVER[1:2], PX4_TRUTH),
    Flight("px4_sitl", ["roll.ulg", "pitch.ulg.xz", "yaw.ulg.xz", "thrust.ulg.xz"], HOVER[2:], PX4_TRUTH),
    Flight("ardupilot_sitl", ["x_calm_roll.BIN"], ("rate.roll", "axis.roll"), ARDUPILOT_CALM),
    Flight("ardupilot_sitl", ["x_calm_thrust.BIN.xz"], ("rate.vertical", "axis.vertical"), ARDUPILOT_CALM),
    Flight(
        "ardupilot_sitl",
        ["x_wind_rollpitch.BIN.xz"],
        ("rate.roll", "rate.pitch", "axis.roll", "axis.pitch"),
        ARDUPILOT,
    ),
    Flight(
        "ardupilot_sitl",
        ["x_wind_yawthrust.BIN.xz"],
        ("rate.yaw", "rate.vertical", "axis.yaw", "axis.vertical"),
        ARDUPILOT,
    ),
    Flight("ardupilot_sitl", ["x_wind_rollpitch.BIN.xz", "x_wind_yawthrust.BIN.xz"], HOVER, ARDUPILOT),
    Flight("s500", ["pitch_sweeps.csv", "thrust_sweeps.csv"], ("axis.pitch", "axis.vertical", HOVER[0]), {}),
    Flight("s500", ["roll_sweeps.csv", "yaw_sweeps.csv"], ("axis.roll", "axis.yaw", HOVER[1]), {}),
)


class Judged(NamedTuple):
    """A parameter of one identification, and how many stated deviations it lies from what is true."""

    folder: str
    model: str
    name: str
    ratio: float


def judged(
    flight: Flight, model: str, *, reduce: bool, truth: Mapping[str, float], records: list[FlightRecord]
) -> list[Judged]:
    found = rotorid.identify(records, model, reduce=reduce)
    return [
        Judged(flight.folder, model, name, (one.value - truth[name]) / one.std)
        for name, one in found.parameters.items()
        if one.status == "free" and one.std and name in truth
    ]


@pytest.mark.slow
def test_intervals_hold(unpacked: Callable[[str], Path], shared_data: Path) -> None:
    simulated = json.loads((shared_data / "s500" / "truth.json").read_text())
    s500 = UNCOUPLED | simulated["longitudinal"] | simulated["lateral"]
    rows: list[Judged] = []
    refused: list[str] = []
    records: dict[str, FlightRecord] = {}
    for flight in FLIGHTS:
        paths = [f"{flight.folder}/{log}" for log in flight.logs]
        records |= {path: rotorid.read(unpacked(path)) for path in paths if path not in records}
        for model in flight.models:
            for reduce in (False, True) if model in HOVER else (False,):
                truth = s500 if flight.folder == "s500" else flight.truth
                try:
                    rows += judged(flight, model, reduce=reduce, truth=truth, records=[records[path] for path in paths])
                except InsufficientDataError as error:
                    refused.append(f"{flight.folder} {model}{' reduced' if reduce else ''}: {error}")
    print(*refused, sep="\n")
    held = {}
    for folder in ("px4_sitl", "ardupilot_sitl", "s500"):
        own = [row for row in rows if row.folder == folder]
        print(
            folder, len(own), *(f"{row.model} {row.name} {row.ratio:+.1f}" for row in own if abs(row.ratio) > TWO_SIDED)
        )
        held[folder] = sum(abs(row.ratio) <= TWO_SIDED for row in own) / len(own)
    print(held)
    assert min(held.values()) >= PROMISED
    assert {line.partition(":")[0] for line in refused} == REFUSED
