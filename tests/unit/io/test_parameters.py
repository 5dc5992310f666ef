"""No record of any format says where on Earth the flight was, or which board flew."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import rotorid
from rotorid.io import read
from rotorid.io.ardupilot.dataflash import decode
from rotorid.io.parameters import kept_parameters
from rotorid.vehicles.px4 import PX4_PARAMETERS

NEAR_DEG = 0.05
"""Five kilometers: as a parameter or a sample that comes nearer to the place, a coordinate would count."""

PLACES = {
    "ardupilot_sitl/x_calm_roll.BIN": (-35.3632, 149.1652),
    "ardupilot/beast_0036.BIN": (38.8313, -6.9461),
    "px4_sitl/roll.ulg": (47.3977, 8.5457),
    "px4/sample_log_small.ulg": (63.4170, 10.4082),
    "px4/sample_logging_tagged_and_default_params.ulg": (47.3977, 8.5456),
    "px4/sample_old_1MB.ulg": (47.3977, 8.5456),
}
"""Logs of vehicles that knew where they were: latitude and longitude in degrees, from their own position messages."""

OTHERS = ("px4/sample.ulg", "ardupilot/erle_brain3.BIN", "betaflight/smooth_tune.BBL", "crazyflie/log10")


def coordinates(place: tuple[float, float]) -> list[tuple[float, float]]:
    """Both coordinates in degrees and in 1e-7 degrees, as logs hold them, each with what counts as near."""
    return [(angle * factor, NEAR_DEG * factor) for angle in place for factor in (1.0, 1e7)]


@pytest.mark.parametrize("name", PLACES)
def test_no_parameter_and_no_channel_is_a_coordinate_of_the_flight(name: str, shared_data: Path) -> None:
    record = read(shared_data / name)
    for where, near in coordinates(PLACES[name]):
        assert [key for key, value in record.parameters.items() if abs(value - where) < near] == []
    for topic in record.topics:
        for channel, values in zip(topic.channels, topic.values, strict=True):
            # A channel that stands at a coordinate throughout is one; motion may pass through any number.
            assert not any(np.median(np.abs(values - where)) < near for where, near in coordinates(PLACES[name])), (
                channel.name
            )


@pytest.mark.parametrize("name", [*PLACES, *OTHERS])
def test_positions_are_relative_and_no_name_is_that_of_a_place(name: str, shared_data: Path) -> None:
    record = read(shared_data / name)
    assert kept_parameters(record.parameters) == record.parameters
    for axis in ("north", "east", "down"):
        for topic, row in record.holding(axis):
            # Earth-fixed coordinates are thousands of kilometers; these flights stay within sight.
            assert np.abs(topic.values[row]).max() < 5000.0


def test_the_logs_did_hold_what_the_records_leave_out(shared_data: Path) -> None:
    table = decode((shared_data / "ardupilot_sitl/x_calm_roll.BIN").read_bytes()).tables["PARM"]
    logged = dict(zip(table.column("Name").tolist(), table.column("Value").tolist(), strict=True))
    assert logged["SIM_OPOS_LAT"] == pytest.approx(-35.3632, abs=NEAR_DEG)
    assert "SIM_OPOS_LAT" not in read(shared_data / "ardupilot_sitl/x_calm_roll.BIN").parameters


@pytest.mark.parametrize(
    "name",
    [
        "SIM_OPOS_ALT",
        "SIH_LOC_LAT0",
        "SIH_LOC_MU_X",
        "LPE_LON",
        "NAV_AH_LAT",
        "BCN_LATITUDE",
        "AHRS_ORIGIN_LON",
        "EKF2_MAG_DECL",
        "ATT_MAG_DECL",
        "COMPASS_DEC",
        "BRD_SERIAL_NUM",
        "COM_FLIGHT_UUID",
        "BRD_SERIAL_NUM2",
        "BAT1_SERIAL",
        "DID_UAS_ID",
        "WIFI_SSID1",
        "CAL_GYRO0_ID",
        "COMPASS_DEV_ID2",
        "INS_GYR2_ID",
        "INS_ACC_ID",
        "SENS_GPS0_ID",
        "EKF2_AGP0_ID",
        "SIM_MAG1_DEVID",
        "VTX_PILOT_ID",
        "MAV_SYS_ID",
        "SERIAL1_BAUD",
        "A_PARAMETER_OF_NEXT_YEAR",
    ],
)
def test_parameters_of_place_and_owner_are_left_out(name: str) -> None:
    assert kept_parameters({name: 1.0}) == {}


@pytest.mark.parametrize(
    "name",
    [
        *(
            "LOIT_SPEED",
            "ATC_RAT_RLL_P",
            "MOT_SPIN_MIN",
            "VT_B_DEC_FF",
            "EKF2_GPS_POS_X",
            "ACRO_THR_MID",
            "MC_AT_SYSID_AMP",
        ),
        *("CA_ROTOR3_KM", "FRAME_CLASS", "FRAME", "SERVO12_FUNCTION", "LOG_BITMASK", "SDLOG_PROFILE", "MC_ROLLRATE_K"),
        *("INS_HNTCH_FREQ", "INS_HNTC2_BW", "IMU_GYRO_NF0_FRQ", "THR_MDL_FAC", "SIH_T_TAU", "BAT1_V_CHARGED"),
        *("rollPID_P", "dyn_notch_count", "magPID", "motorOutput_1", "looptime", "P ratio"),
    ],
)
def test_parameters_that_only_sound_alike_stay(name: str) -> None:
    assert kept_parameters({name: 1.0}) == {name: 1.0}


def test_the_serial_number_of_the_board_does_not_leave_a_px4_log(shared_data: Path) -> None:
    path = shared_data / "px4/s250_2017.ulg"
    assert b"001d00313235510c32393433" in path.read_bytes()
    record = read(path)
    assert "001d0031" not in repr(record.source) + repr(record.findings)


def test_origin_and_home_messages_of_a_telemetry_log_are_not_read() -> None:
    from rotorid.io.mavlink.messages import LAYOUTS

    absolute = {"GLOBAL_POSITION_INT", "GPS_RAW_INT", "HOME_POSITION", "GPS_GLOBAL_ORIGIN", "AHRS2"}
    assert absolute.isdisjoint(layout.name for layout in LAYOUTS.values())


def test_a_px4_folder_of_csv_files_keeps_no_place(tmp_path: Path) -> None:
    (tmp_path / "log_battery_status_0.csv").write_text("timestamp,voltage_v\n1000,12.0\n2000,12.0\n")
    (tmp_path / "parameters.txt").write_text("SIH_LOC_LAT0 = 47.4\nMC_ROLL_P = 6.5\n")
    record = read(tmp_path)
    assert record.parameters == {"MC_ROLL_P": 6.5}


def test_every_parameter_that_the_package_names_is_kept() -> None:
    """What the sources ask of a record, by its literal name; new ones belong to the list."""
    shaped = re.compile(r"(?:parameters\.get\(|parameters\[)\"([A-Z][A-Z0-9]*(?:_[A-Z0-9]+)+)\"")
    asked = set(PX4_PARAMETERS)
    for room in ("models", "signal", "pipeline", "spectral", "io"):
        for file in (Path(rotorid.__file__).parent / room).rglob("*.py"):
            asked |= set(shaped.findall(file.read_text(encoding="utf-8")))
    assert len(asked) > 40
    assert asked - set(kept_parameters(dict.fromkeys(asked, 1.0))) == set()
