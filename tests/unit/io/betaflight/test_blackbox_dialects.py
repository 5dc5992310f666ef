"""Blackbox logs as the firmwares write them: predicted I frames, cadences, all events, eRPM, CHIRP, INAV, options."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from tests.unit.io.blackbox_log import END, header, inter, intra, only, record_of, signed, unsigned

from rotorid.autopilots.advice import channel_advice, speed_advice
from rotorid.data.record import FlightRecord
from rotorid.typing import FloatArray

DEGREE = math.pi / 180.0
BETAFLIGHT = "H Firmware type:Cleanflight\nH Firmware revision:Betaflight 4.5.1 (77d01ba3b) STM32F7X2\n"


def named(record: FlightRecord) -> dict[str, FloatArray]:
    return {channel.name: topic.values[row] for topic in record.topics for row, channel in enumerate(topic.channels)}


def one_frame(folder: Path, lines: str, **fields: int) -> dict[str, float]:
    """First samples of a flight with one I frame of plain numbers; ``motor__0`` stands for ``motor[0]``."""
    names = [f"{name.replace('__', '[')}]" if "__" in name else name for name in fields]
    start = header(names, inter_encoding=[0] * len(names), inter_predictor=[0] * len(names), lines=lines)
    record = record_of(start + intra(0, 5000, *fields.values()) + END, folder)
    return {name: float(values[0]) for name, values in named(record).items()}


@pytest.mark.parametrize(
    ("predictor", "encoded", "expected"),
    [
        pytest.param(0, -7, -7, id="none"),
        pytest.param(4, 30, 1100, id="minimum throttle"),
        pytest.param(8, -20, 1480, id="center of the stick"),
        pytest.param(9, -3, 72, id="reference voltage"),
        pytest.param(11, 12, 150, id="idle of the motors"),
    ],
)
def test_predictors_of_whole_frames(predictor: int, encoded: int, expected: int) -> None:
    lines = "H minthrottle:1070\nH vbatref:75\nH motorOutput:138,2047\n"
    start = header(["debug[0]"], inter_encoding=[0], inter_predictor=[1], lines=lines)
    start = start.replace(b"I predictor:0,0,0", f"I predictor:0,0,{predictor}".encode())

    flight = only(start + intra(0, 5000, encoded) + inter(signed(-2)) + END)

    # The P frame counts from the number, not from what was encoded.
    assert flight.field("debug[0]").tolist() == [expected, expected - 2]


def test_motors_of_a_whole_frame_are_counted_from_the_first_one() -> None:
    start = header(
        ["motor[0]", "motor[1]"], inter_encoding=[0, 0], inter_predictor=[3, 3], lines="H motorOutput:48,2047\n"
    )
    start = start.replace(b"I predictor:0,0,0,0", b"I predictor:0,0,11,5")

    flight = only(start + intra(0, 5000, 400, -30) + inter(signed(10) + signed(-10)) + END)

    assert flight.frames[:, 2:].tolist() == [[448, 418], [458, 408]]


def test_unsigned_fields_wrap_and_signed_ones_do_not() -> None:
    start = header(["a", "b"], inter_encoding=[0, 0], inter_predictor=[1, 1], signs=[0, 1])

    flight = only(start + intra(0, 5000, 1, 1) + inter(signed(-2) + signed(-2)) + END)

    assert flight.frames[1, 2:].tolist() == [2**32 - 1, -1]


@pytest.mark.parametrize(
    ("interval", "ratio", "logged"),
    [
        (8, "1/1", [0, 1, 2, 3, 4, 5, 6, 7, 8, 9]),
        (8, "1/4", [0, 4, 8, 12, 16]),
        # Two loops of three.
        (6, "2/3", [0, 2, 3, 5, 6, 8, 9, 11, 12]),
        (4, "0", [0, 4, 8, 12]),
    ],
)
def test_loop_numbers_follow_the_cadence(interval: int, ratio: str, logged: list[int]) -> None:
    start = header(["debug[0]"], inter_encoding=[0], inter_predictor=[1])
    start = start.replace(b"I interval:8", f"I interval:{interval}".encode())
    start = start.replace(b"P interval:1/2", f"P interval:{ratio}".encode())
    parts, last = [start], 0
    for loop in logged:
        parts.append(
            intra(loop, 5000 + 500 * loop, 1) if loop % interval == 0 else inter(signed(0), 500 * (loop - last))
        )
        last = loop

    flight = only(b"".join(parts) + END)

    assert flight.field("loopIteration").tolist() == logged
    assert (flight.damage.lost_frames, flight.damage.skipped_bytes) == (0, 0)
    np.testing.assert_allclose(flight.time_s, [0.005 + 0.0005 * loop for loop in logged], rtol=1e-12)


@pytest.mark.parametrize(
    "event",
    [
        pytest.param(b"E\x0a" + bytes(5), id="start of an automatic tune"),
        pytest.param(b"E\x0b" + bytes(4), id="result of it"),
        pytest.param(b"E\x0c" + bytes(8), id="its targets"),
        pytest.param(b"E\x14\x01" + signed(-500) + b"\x10\x00", id="tune by the gyro"),
        pytest.param(b"E\x28" + unsigned(70_000), id="change of the flight mode of INAV"),
    ],
)
def test_old_events_are_stepped_over(event: bytes) -> None:
    start = header(["debug[0]"], inter_encoding=[0], inter_predictor=[1])
    body = intra(0, 5000, 1) + event + inter(signed(1)) + event + inter(signed(1))

    flight = only(start + body + END)

    assert flight.field("debug[0]").tolist() == [1, 2, 3]
    assert (flight.damage.lost_frames, flight.damage.skipped_bytes) == (0, 0)


@pytest.mark.parametrize("poles", [12, 14])
def test_motor_speeds_have_the_poles_of_the_motors(tmp_path: Path, poles: int) -> None:
    names = [f"eRPM[{index}]" for index in range(4)]
    lines = BETAFLIGHT + f"H motor_poles:{poles}\n"
    start = header(names, inter_encoding=[0] * 4, inter_predictor=[1] * 4, lines=lines)
    body = intra(0, 5000, 70, 140, 210, 280) + inter(b"".join(map(signed, (14, 0, -14, 7))))

    found = named(record_of(start + body + END, tmp_path))

    electrical_rpm = 100.0 * np.array([[70, 84], [140, 140], [210, 196], [280, 287]])
    truth = electrical_rpm / (poles / 2) * 2.0 * math.pi / 60.0
    for index in range(4):
        np.testing.assert_allclose(found[f"motor_speed_{index + 1}"], truth[index], rtol=1e-14)


def test_motor_speeds_without_poles_are_left_out(tmp_path: Path) -> None:
    assert set(one_frame(tmp_path, BETAFLIGHT, gyroADC__0=1, eRPM__0=70)) == {"p"}


CHIRP = BETAFLIGHT + (
    "H gyro_scale:0x3f800000\nH chirp_time_seconds:4\nH chirp_amplitude_roll:230\nH chirp_amplitude_pitch:200\n"
    "H chirp_amplitude_yaw:180\n"
)
RATE_HZ = 250.0


def chirped(sweeps: list[tuple[int, float, float, float]], cosine_of: float = 1000.0) -> bytes:
    """Sweeps of (axis, seconds, first Hz, last Hz) with a second of rest around each; times rise by 4 ms."""
    debug: list[tuple[int, int, int, int]] = []
    rest = int(RATE_HZ) * [(0, -1, 0, 0)]
    for axis, seconds, first_hz, last_hz in sweeps:
        time_s = np.arange(int(seconds * RATE_HZ)) / RATE_HZ
        frequency = first_hz * (last_hz / first_hz) ** (time_s / seconds)
        phase = np.mod(2.0 * math.pi * np.cumsum(frequency) / RATE_HZ, 2.0 * math.pi)
        debug += rest
        debug += [
            (round(5000.0 * p), axis, round(10.0 * f), round(cosine_of * math.cos(p)))
            for p, f in zip(phase.tolist(), frequency.tolist(), strict=True)
        ]
    names = ["gyroADC[0]", *(f"debug[{index}]" for index in range(4))]
    parts = [header(names, inter_encoding=[0] * 5, inter_predictor=[0] * 5, lines=CHIRP)]
    for index, values in enumerate([*debug, *rest]):
        if index % 4:
            parts.append(inter(b"".join(map(signed, (1, *values))), 4000))
        else:
            parts.append(intra(2 * index, 4000 * index, 1, *values))
    return b"".join(parts) + END


def test_chirps_of_every_axis_have_their_times_bands_and_signs(tmp_path: Path) -> None:
    record = record_of(chirped([(0, 4.0, 2.0, 20.0), (2, 3.0, 5.0, 12.0), (1, 0.5, 5.0, 9.0)]), tmp_path)

    assert [(sweep.axis, sweep.kind, sweep.signal) for sweep in record.declared] == [
        ("roll", "sweep", "roll_excitation"),
        ("yaw", "sweep", "yaw_excitation"),
    ]
    roll, yaw = record.declared
    # Sample by sample; the third run is shorter than a second and is none.
    assert (roll.start_s, roll.stop_s) == pytest.approx((1.0, 5.0 - 1.0 / RATE_HZ))
    assert (yaw.start_s, yaw.stop_s) == pytest.approx((6.0, 9.0 - 1.0 / RATE_HZ))
    # Frequencies are logged in tenths of a hertz.
    assert roll.band_rad_s == pytest.approx((4.0 * math.pi, 40.0 * math.pi), abs=0.1 * math.pi)
    assert yaw.band_rad_s == pytest.approx((10.0 * math.pi, 24.0 * math.pi), abs=0.1 * math.pi)

    found = named(record)
    time_s = record.topics[0].time_s
    resting = (time_s < 0.999) | (time_s > 5.0)
    assert np.all(found["roll_excitation"][resting] == 0.0)
    first = int(np.searchsorted(time_s, 0.9999))
    # The cosine begins near one; the yaw axis of the firmware points up.
    assert found["roll_excitation"][first] == pytest.approx(230.0 * DEGREE, rel=2e-3)
    first = int(np.searchsorted(time_s, 5.9999))
    assert found["yaw_excitation"][first] == pytest.approx(-180.0 * DEGREE, rel=1e-2)


def test_other_debug_fields_are_no_chirp(tmp_path: Path) -> None:
    """The same fields with another amplitude of the cosine: some other debug mode."""
    record = record_of(chirped([(0, 4.0, 2.0, 20.0)], cosine_of=700.0), tmp_path)

    assert record.declared == ()
    assert "roll_excitation" not in record.channel_names


def test_inav_counts_in_centimeters_and_upward(tmp_path: Path) -> None:
    lines = "H Firmware type:Cleanflight\nH Firmware revision:INAV 7.1.0 (abc) MATEKF405\nH gyro_scale:0x3f800000\n"
    fields = {"axisRate__0": 10, "axisRate__1": 20, "axisRate__2": 30, "gyroADC__1": 4}
    position = {f"navPos__{index}": value for index, value in enumerate((150, -250, 1200))}
    velocity = {f"navVel__{index}": value for index, value in enumerate((100, 200, 300))}

    found = one_frame(tmp_path, lines, **fields, **position, **velocity, vbat=1650)

    assert found == pytest.approx(
        {
            "p_setpoint": 10 * DEGREE,
            "q_setpoint": -20 * DEGREE,
            "r_setpoint": -30 * DEGREE,
            "q": -4 * DEGREE,
            "north": 1.5,
            "east": -2.5,
            "down": -12.0,
            "velocity_north": 1.0,
            "velocity_east": 2.0,
            "velocity_down": -3.0,
            "battery_voltage": 16.5,
        },
        abs=1e-12,
    )


def test_fields_without_their_settings_are_not_called_missing(tmp_path: Path) -> None:
    names = ["gyroADC[0]", "accSmooth[0]", "accSmooth[2]", "eRPM[0]"]
    start = header(names, inter_encoding=[0] * 4, inter_predictor=[0] * 4)
    record = record_of(start + intra(0, 5000, 1, 2, 3, 4) + END, tmp_path)

    assert speed_advice(record).startswith("eRPM[0] is in the log, but rotorid does not read it: the header does not")
    (finding,) = (finding for finding in record.findings if finding.message.startswith("accSmooth[0] is in the log"))
    assert "acc_1G" in finding.message


def test_inav_logs_angles_in_tenths_of_a_degree_and_the_pitch_nose_down(tmp_path: Path) -> None:
    lines = "H Firmware type:Cleanflight\nH Firmware revision:INAV 9.0.0 (abc) JHEMCUF435\nH gyro_scale:0x3f800000\n"
    angles = {f"attitude__{index}": value for index, value in enumerate((100, -200, 3000))}

    found = one_frame(tmp_path, lines, **angles, gyroRaw__0=7, amperage=1250)

    assert found == pytest.approx(
        {
            "phi": 10 * DEGREE,
            "theta": 20 * DEGREE,
            "psi": 300 * DEGREE,
            "p_raw": 7 * DEGREE,
            "battery_current": 12.5,
        }
    )


@pytest.mark.parametrize(
    ("flags", "mode", "direct"),
    [
        (1, "acro", True),
        (1 | 2, "angle", False),
        (1 | 1 << 3, "acro", True),
        (1 | 2 | 1 << 9, "position hold", False),
        (1 | 1 << 8, "return", False),
        (1 | 1 << 10, "acro", True),
    ],
)
def test_inav_says_when_it_was_armed_and_who_made_the_set_points(
    tmp_path: Path, flags: int, mode: str, direct: bool
) -> None:
    slow = (
        "H Field S name:flightModeFlags,activeFlightModeFlags\nH Field S signed:0,0\nH Field S predictor:0,0\n"
        "H Field S encoding:1,1\nH Firmware revision:INAV 9.0.0 (abc) JHEMCUF435\n"
    )
    start = header(["gyroADC[0]"], inter_encoding=[0], inter_predictor=[1], lines=slow)
    frames = [intra(8 * k, 8000 * k, 1) for k in range(5)]
    frames[1] += b"S" + unsigned(flags) + unsigned(0)
    status = record_of(start + b"".join(frames) + END, tmp_path).status

    assert status.armed == ((pytest.approx(0.008), pytest.approx(0.032)),)
    assert [name for name, _, _ in status.modes] == [mode]
    assert bool(status.direct_rates) == direct


def test_angles_of_betaflight_come_from_the_vector_of_a_quaternion(tmp_path: Path) -> None:
    """A quarter turn to the right, in axes forward, left, up: about −z."""
    yawed = {f"imuQuaternion__{index}": value for index, value in enumerate((0, 0, round(-math.sqrt(0.5) * 32767)))}
    pitched = {f"imuQuaternion__{index}": value for index, value in enumerate((0, round(-0.5 * 32767), 0))}
    assert one_frame(tmp_path, BETAFLIGHT, **yawed) == pytest.approx(
        {"phi": 0.0, "theta": 0.0, "psi": math.pi / 2}, abs=1e-4
    )
    assert one_frame(tmp_path, BETAFLIGHT, **pitched) == pytest.approx(
        {"phi": 0.0, "theta": 60 * DEGREE, "psi": 0.0}, abs=1e-4
    )


def test_high_resolution_counts_tenths(tmp_path: Path) -> None:
    lines = BETAFLIGHT + "H gyro_scale:0x3f800000\nH blackbox_high_resolution:1\n"

    found = one_frame(tmp_path, lines, gyroADC__0=100, setpoint__0=200, rcCommand__0=2500, rcCommand__3=15_000)

    assert found == pytest.approx(
        {"p": 10 * DEGREE, "p_setpoint": 20 * DEGREE, "roll_stick": 0.5, "thrust_stick": 0.5}, abs=1e-12
    )


def test_motors_that_turn_the_other_way_yaw_the_other_way(tmp_path: Path) -> None:
    motors = {"motor__0": 1500, "motor__1": 1300, "motor__2": 1300, "motor__3": 1500}
    limits = "H minthrottle:1000\nH maxthrottle:2000\n"
    usual, turned = (
        one_frame(tmp_path, BETAFLIGHT + limits + f"H yaw_motors_reversed:{flag}\n", **motors) for flag in (0, 1)
    )
    assert usual["yaw_command"] == pytest.approx(-0.1)
    assert turned["yaw_command"] == pytest.approx(0.1)
    assert (usual["thrust_command"], usual["motor_2"]) == pytest.approx((0.4, 0.3))


def test_first_loggers_give_the_gyro_in_radians_per_microsecond(tmp_path: Path) -> None:
    # 0x2f8ee4a0 is 2.6e-10 as a float: the hexadecimal digits are its bits.
    scale = float(np.array([0x2F8EE4A0], dtype=np.uint32).view(np.float32)[0])
    found = one_frame(tmp_path, "H gyro_scale:0x2f8ee4a0\n", gyroADC__0=1000)
    assert found["p"] == pytest.approx(scale * 1e6 * 1000, rel=1e-12)


@pytest.mark.parametrize(
    ("revision", "field", "volts"),
    [
        ("Betaflight 3.5.7 (a)", "vbatLatest", 16.2),
        ("Betaflight 4.3.0 (a)", "vbatLatest", 1.62),
        ("EmuFlight 0.4", "", 0),
    ],
)
def test_battery_voltage_depends_on_the_firmware(tmp_path: Path, revision: str, field: str, volts: float) -> None:
    found = one_frame(tmp_path, f"H Firmware revision:{revision}\n", gyroADC__0=1, vbatLatest=162)
    assert found.get("battery_voltage", 0) == pytest.approx(volts)


def test_a_voltage_of_unknown_unit_is_named_with_the_firmware_that_has_one(tmp_path: Path) -> None:
    revision = "H Firmware revision:Betaflight 3.0.1 (a)\n"
    start = header(["gyroADC[0]", "vbatLatest"], inter_encoding=[0, 0], inter_predictor=[0, 0], lines=revision)
    old = record_of(start + intra(0, 5000, 1, 162) + END, tmp_path)
    assert channel_advice(old, "battery_voltage").endswith("its unit is known only for Betaflight 3.1 and newer")


def test_a_flight_with_a_broken_header_costs_only_itself(tmp_path: Path) -> None:
    start = header(["gyroADC[0]"], inter_encoding=[0], inter_predictor=[1])
    whole = start + intra(0, 5000, 1) + 3 * inter(signed(1)) + END
    broken = start.replace(b"Field P encoding:9,1,0", b"Field P encoding:9,1,77") + intra(0, 5000, 1) + END

    record = record_of(whole + broken + whole, tmp_path)

    assert sorted(topic.name for topic in record.topics) == ["flight 1", "flight 3"]
    assert [finding.severity for finding in record.findings if "77" in finding.message] == ["warning"]
