"""Flags and kinds of vehicles: what was not logged yet is unknown, and what a log names is no multirotor."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

import rotorid
from rotorid.data.record import Status
from rotorid.io.ardupilot.dataflash_writer import Messages, write_dataflash
from rotorid.io.ardupilot.status import status_of as ardupilot_status
from rotorid.io.ardupilot.writer import LAYOUTS
from rotorid.io.betaflight.status import status_of as betaflight_status
from rotorid.io.px4.status import status_of as px4_status
from rotorid.typing import AnyArray

SPAN_S = (10.0, 60.0)


@pytest.mark.parametrize(
    ("firmware", "parameters", "vehicle"),
    [
        ("ArduCopter V3.2.1 (0c3f43b2)", {}, "multirotor"),
        ("APM:Copter V3.4-rc2", {}, "multirotor"),
        ("ArduRover v2.45", {}, "rover"),
        ("APM:Rover V2.50 (abcdef)", {}, "rover"),
        ("ArduRover V4.2.0", {"FRAME_CLASS": 2.0}, "boat"),
        ("ArduPlane V3.8.2", {}, "plane"),
        ("ArduPlane V4.3.0", {"Q_ENABLE": 1.0}, "VTOL"),
        ("ArduSub V4.1.0", {}, "submarine"),
        ("", {"GROUND_STEER_ALT": 0.0}, "plane"),
        ("", {"CRUISE_THROTTLE": 50.0}, "rover"),
        ("", {"JS_GAIN_DEFAULT": 0.5}, "submarine"),
        ("", {"H_RSC_MODE": 1.0}, "helicopter"),
        ("", {"BATT_CAPACITY": 3300.0}, ""),
        ("", {}, ""),
    ],
)
def test_ardupilot_names_its_vehicle(firmware: str, parameters: Mapping[str, float], vehicle: str) -> None:
    assert ardupilot_status({}, parameters, firmware, SPAN_S).vehicle == vehicle


TEXT = """\
{banner}
 Free RAM: 1990
FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns
FMT, 130, 31, IMU, Iffffff, TimeMS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ
{rows}
"""


@pytest.mark.parametrize(("banner", "vehicle"), [("ArduRover V2.50", "rover"), ("ArduPlane v3.0", "plane"), ("", "")])
def test_the_text_of_an_old_log_names_its_vehicle(tmp_path: Path, banner: str, vehicle: str) -> None:
    rows = "\n".join(f"IMU, {n * 20}, 0.0{n % 7}, 0.01, 0.0, 0.1, 0.0, -9.{n % 9}" for n in range(200))
    log = tmp_path / "7.log"
    log.write_text(TEXT.format(banner=banner, rows=rows), encoding="utf-8")
    record = rotorid.read(log)
    assert record.status.vehicle == vehicle
    assert ("other_vehicle" in {finding.kind for finding in record.findings}) == bool(vehicle)


@pytest.mark.parametrize(
    ("number", "vehicle"),
    [
        (4001, "multirotor"),
        (2100, "plane"),
        (13000, "VTOL"),
        (50000, "rover"),
        (60000, "submarine"),
        (1001, ""),
        (0, ""),
    ],
)
def test_px4_names_its_vehicle_by_its_airframe(number: int, vehicle: str) -> None:
    assert px4_status({}, {"SYS_AUTOSTART": number}, SPAN_S).vehicle == vehicle


def _topic(name: str, field: str, time_s: list[float], values: list[int]) -> dict[str, AnyArray]:
    return {f"{name}/timestamp": np.array(time_s) * 1e6, f"{name}/{field}": np.array(values)}


def test_flags_of_px4_that_were_logged_late_are_unknown_before() -> None:
    armed = _topic("vehicle_status", "arming_state", [30.0, 50.0], [2, 1])
    landed = _topic("vehicle_land_detected", "landed", [28.0, 49.0], [0, 1])
    late = px4_status({**armed, **landed}, {}, SPAN_S)
    assert late.unlogged == ((10.0, 30.0),)
    assert late.in_air == ((30.0, 49.0),)
    # What was said within two seconds, was so when the record began.
    armed = _topic("vehicle_status", "arming_state", [11.0, 50.0], [2, 1])
    landed = _topic("vehicle_land_detected", "landed", [11.5, 49.0], [0, 1])
    soon = px4_status({**armed, **landed}, {}, SPAN_S)
    assert (soon.unlogged, soon.in_air, soon.armed) == ((), ((10.0, 49.0),), ((10.0, 50.0),))
    alone = px4_status(landed, {}, SPAN_S)
    assert (alone.armed, alone.in_air) == (None, ((10.0, 49.0),))


def _logged(path: Path, *events: tuple[float, int]) -> Status:
    """A log of 50 s with some events, read."""
    stamps = np.arange(10.0, 60.0, 0.1)
    imu = dict.fromkeys(LAYOUTS["IMU"].format.columns, 0.0) | {"TimeUS": stamps * 1e6, "GyrX": np.sin(stamps)}
    values = {"TimeUS": np.array([at for at, _ in events]) * 1e6, "Id": np.array([number for _, number in events])}
    tables = [Messages(layout=LAYOUTS["EV"], values=values)] if events else []
    write_dataflash(path, [Messages(layout=LAYOUTS["IMU"], values=imu), *tables])
    return rotorid.read(path).status


ARMED, DISARMED, LANDED, NOT_LANDED = 10, 11, 18, 28


def test_what_lost_events_leave_is_unknown(tmp_path: Path) -> None:
    whole = _logged(tmp_path / "a.bin", (12.0, ARMED), (15.0, NOT_LANDED), (40.0, LANDED), (41.0, DISARMED))
    assert (np.ravel(whole.in_air), whole.unlogged) == (pytest.approx([15.0, 40.0]), ())
    lost = _logged(tmp_path / "b.bin", (12.0, ARMED), (40.0, LANDED), (41.0, DISARMED))
    assert np.ravel(lost.unlogged) == pytest.approx([12.0, 40.0])
    # Only the landing is there: it flew from before the log, and what is known of arming is nothing.
    landing = _logged(tmp_path / "c.bin", (40.0, LANDED))
    assert landing.armed is None
    assert np.ravel(landing.in_air) == pytest.approx([10.0, 40.0])
    bench = _logged(tmp_path / "d.bin", (12.0, ARMED), (41.0, DISARMED))
    assert bench.in_air == ()
    silent = _logged(tmp_path / "e.bin")
    assert (silent.armed, silent.in_air) == (None, None)


def test_flags_of_betaflight_that_were_logged_late_are_unknown_before() -> None:
    """The slow frames of a log that began in flight come after its first samples."""
    header = SimpleNamespace(values={"Firmware revision": "Betaflight 4.5.0"}, firmware=("Betaflight", (4, 5)))
    flight = SimpleNamespace(
        header=header,
        slow_fields=("flightModeFlags",),
        fields=("motor[2]",),
        slow_field=lambda _: np.array([1, 0]),
        slow_time_s=np.array([14.0, 50.0]),
        time_s=np.array([10.0, 60.0]),
    )
    status = betaflight_status([cast("Any", flight)])
    assert (status.unlogged, status.armed) == (((10.0, 14.0),), ((14.0, 50.0),))
