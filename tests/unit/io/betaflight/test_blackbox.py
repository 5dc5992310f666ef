"""The blackbox decoder: every encoding and predictor by hand, then whole flights that a small encoder writes."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from tests.unit.io.blackbox_log import END, header, inter, intra, only, record_of, signed, unsigned

from rotorid.errors import LogError
from rotorid.io.betaflight.blackbox import parse_header
from rotorid.io.betaflight.log import sniff


@pytest.mark.parametrize(
    ("encoding", "count", "body", "values"),
    [
        pytest.param(0, 1, signed(-300), [-300], id="signed"),
        pytest.param(1, 1, unsigned(70_000), [70_000], id="unsigned"),
        pytest.param(3, 1, unsigned(5), [-5], id="negated"),
        pytest.param(3, 1, unsigned((-5) & 0x3FFF), [5], id="negated 14 bits, below zero"),
        pytest.param(9, 1, b"", [0], id="null"),
        pytest.param(6, 3, b"\x05" + signed(7) + signed(-2), [7, 0, -2], id="eight tagged, three used"),
        pytest.param(6, 1, signed(9), [9], id="eight tagged, a lone one has no tag"),
        pytest.param(6, 9, b"\x80" + signed(3) + signed(4), [0] * 7 + [3, 4], id="eight tagged, nine fields"),
        pytest.param(7, 3, bytes([0b00_01_10_11]), [1, -2, -1], id="three of 2 bits"),
        pytest.param(7, 3, bytes([0b0100_0111, 0b1000_1111]), [7, -8, -1], id="three of 4 bits"),
        pytest.param(7, 3, bytes([0b10_100000, 31, 0b111111]), [-32, 31, -1], id="three of 6 bits"),
        pytest.param(
            7, 3, bytes([0b11_11_01_00, 0xFF, 0x00, 0x80, 1, 0, 0, 0x80]), [-1, -32768, 1 - 2**31], id="three of bytes"
        ),
        pytest.param(7, 3, bytes([0b11_00_00_10, 0, 0, 0x80, 5, 6]), [-(2**23), 5, 6], id="three, one of 24 bits"),
        pytest.param(10, 3, bytes([0b00_01_10_11]), [1, -2, -1], id="variable, 2 bits"),
        pytest.param(10, 3, bytes([0b01_01111_1, 0b0000_0111]), [15, -16, 7], id="variable, 5 5 4 bits"),
        pytest.param(10, 3, bytes([0b10_011111, 0b11_100000, 0b0_1111111]), [127, -64, -1], id="variable, 8 7 7 bits"),
        pytest.param(10, 3, bytes([0b11_00_00_00, 1, 2, 0xFD]), [1, 2, -3], id="variable, bytes"),
        pytest.param(8, 4, b"\x00", [0, 0, 0, 0], id="four, all zero"),
        pytest.param(8, 4, bytes([0b01_01_01_01, 0x7F, 0x81]), [7, -1, -8, 1], id="four of 4 bits"),
        pytest.param(8, 4, bytes([0b00_11_10_01, 0x58, 0x08, 0x00, 0x10]), [5, -128, -32767, 0], id="four, shifted"),
        pytest.param(8, 4, bytes([0b10_00_00_11, 0x12, 0x34, 0xFF]), [0x1234, 0, 0, -1], id="four, high byte first"),
    ],
)
def test_encodings(encoding: int, count: int, body: bytes, values: list[int]) -> None:
    names = [f"debug[{index}]" for index in range(count)]
    start = header(names, inter_encoding=[encoding] * count, inter_predictor=[0] * count)

    flight = only(start + intra(0, 5000, *[0] * count) + inter(body) + END)

    assert flight.frames.tolist() == [[0, 5000, *[0] * count], [2, 6000, *values]]
    assert flight.damage.skipped_bytes == 0


def test_four_numbers_of_the_first_data_version() -> None:
    names = [f"debug[{index}]" for index in range(4)]
    start = header(names, inter_encoding=[8] * 4, inter_predictor=[0] * 4).replace(b"version:2", b"version:1")
    body = bytes([0b11_10_01_01, 0x7F, 0x80, 0x34, 0x12])

    flight = only(start + intra(0, 5000, 0, 0, 0, 0) + inter(body) + END)

    assert flight.frames[1, 2:].tolist() == [-1, 7, -128, 0x1234]


@pytest.mark.parametrize(
    ("predictor", "expected"),
    [
        pytest.param(0, [1, 1], id="none"),
        pytest.param(1, [-4, -3], id="previous"),
        pytest.param(2, [-4, -2], id="straight line"),
        # (-5 - 5) / 2 + 1 = -4, then (-4 - 5) / 2 + 1 with division towards zero = -3
        pytest.param(3, [-4, -3], id="average"),
        pytest.param(4, [1071, 1071], id="minimum throttle"),
        pytest.param(8, [1501, 1501], id="center of the stick"),
        pytest.param(9, [76, 76], id="reference voltage"),
        pytest.param(10, [5001, 6001], id="time of the main frame"),
        pytest.param(11, [139, 139], id="idle of the motors"),
    ],
)
def test_predictors(predictor: int, expected: list[int]) -> None:
    lines = "H minthrottle:1070\nH vbatref:75\nH motorOutput:138,2047\n"
    start = header(["debug[0]"], inter_encoding=[0], inter_predictor=[predictor], lines=lines)

    flight = only(start + intra(0, 5000, -5) + 2 * inter(signed(1)) + END)

    assert flight.field("debug[0]").tolist() == [-5, *expected]


def test_motors_are_counted_from_the_first_motor() -> None:
    start = header(["motor[0]", "motor[1]"], inter_encoding=[0, 0], inter_predictor=[1, 5])

    flight = only(start + intra(0, 5000, 400, 500) + inter(signed(10) + signed(-20)) + END)

    assert flight.frames[1, 2:].tolist() == [410, 390]


def test_positions_are_counted_from_home() -> None:
    lines = (
        "H Field H name:GPS_home[0],GPS_home[1]\nH Field H signed:1,1\nH Field H predictor:0,0\n"
        "H Field H encoding:0,0\nH Field G name:time,GPS_coord[0],GPS_coord[1]\nH Field G signed:0,1,1\n"
        "H Field G predictor:10,7,7\nH Field G encoding:1,0,0\n"
        "H Field S name:flightModeFlags\nH Field S signed:0\nH Field S predictor:0\nH Field S encoding:1\n"
    )
    start = header(["debug[0]"], inter_encoding=[0], inter_predictor=[1], lines=lines)
    place = b"H" + signed(520_000_000) + signed(-130_000_000)
    fix = b"G" + unsigned(250) + signed(-7) + signed(9)

    flight = only(start + intra(0, 5000, 1) + b"S\x03" + place + fix + inter(signed(1)) + END)

    assert flight.fixes.tolist() == [[5250, 519_999_993, -129_999_991]]
    assert flight.fix_time_s.tolist() == pytest.approx([5.25e-3])
    assert len(flight.frames) == 2


@pytest.mark.parametrize("predictor", [1, 2, 3])
def test_slow_frames_hold_their_values_as_they_stand_whatever_they_are_counted_from(predictor: int) -> None:
    """INAV 7 to 9 announce the rate of the receiver as counted from the frame before, and write it whole."""
    lines = (
        "H Field S name:flightModeFlags,rxUpdateRate\nH Field S signed:0,0\n"
        f"H Field S predictor:0,{predictor}\nH Field S encoding:1,1\n"
    )
    start = header(["debug[0]"], inter_encoding=[0], inter_predictor=[1], lines=lines)
    slow = [b"S" + unsigned(1) + unsigned(rate) for rate in (150, 151, 90)]

    flight = only(start + intra(0, 5000, 1) + slow[0] + inter(signed(1)) + slow[1] + inter(signed(1)) + slow[2] + END)

    assert flight.slow_field("rxUpdateRate").tolist() == [150, 151, 90]
    assert flight.field("debug[0]").tolist() == [1, 2, 3]


@pytest.mark.parametrize(
    ("kind", "field"), [("predictor", "Field P predictor:6,1"), ("encoding", "Field P encoding:9,1")]
)
def test_a_definition_of_a_newer_firmware_is_unknown_not_damage(kind: str, field: str) -> None:
    start = header(["debug[0]"], inter_encoding=[0], inter_predictor=[0]).replace(
        f"{field},0".encode(), f"{field},23".encode()
    )

    with pytest.raises(LogError, match=rf"{kind} 23 of .*, which rotorid does not know.*newer than rotorid"):
        parse_header(start)


SLOW = (
    "H Field S name:flightModeFlags,failsafePhase\nH Field S signed:0,0\nH Field S predictor:0,0\n"
    "H Field S encoding:1,1\nH Firmware revision:Betaflight 4.3.1 (8d4f005) STM32F7X2\n"
)


def test_slow_frames_tell_arming_and_who_makes_the_set_points_of_rates(tmp_path: Path) -> None:
    start = header(["gyroADC[0]"], inter_encoding=[0], inter_predictor=[1], lines=SLOW)
    frames = [intra(0, 0, 1)] + [intra(8 * k, 8000 * k, 1) for k in range(1, 10)]
    # Armed in acro from 16 ms, angle mode from 40 ms, the failsafe from 56 ms in acro, disarmed from 64 ms.
    slow = {2: b"S\x01\x00", 5: b"S\x03\x00", 7: b"S\x01\x04", 8: b"S\x00\x04"}
    body = b"".join(frame + slow.get(number, b"") for number, frame in enumerate(frames))

    flight = only(start + body + END)
    status = record_of(start + body + END, tmp_path).status

    assert flight.slow.tolist() == [[1, 0], [3, 0], [1, 4], [0, 4]]
    assert flight.slow_time_s.tolist() == pytest.approx([0.016, 0.040, 0.056, 0.064])
    assert status.armed == ((pytest.approx(0.016), pytest.approx(0.064)),)
    assert status.direct_rates == ((pytest.approx(0.016), pytest.approx(0.040)),)
    assert status.in_air is None


@pytest.mark.parametrize(
    ("version", "flags", "mode"),
    [
        ("4.5.1", 1, "acro"),
        ("4.5.1", 1 | 1 << 7, "GPS rescue"),
        ("4.5.1", 1 | 1 << 4, "acro"),
        ("3.5.7", 1 | 1 << 7, "acro"),
        ("2025.12.1", 1 | 1 << 4, "altitude hold"),
        ("2025.12.1", 1 | 1 << 9, "position hold"),
        ("2025.12.1", 1 | 1 << 10 | 1 << 9 | 1 << 1, "GPS rescue"),
        ("2025.12.1", 1 | 1 << 7, "acro"),
    ],
)
def test_modes_that_level_by_themselves_are_no_acro(version: str, flags: int, mode: str, tmp_path: Path) -> None:
    lines = SLOW.replace("4.3.1", version)
    start = header(["gyroADC[0]"], inter_encoding=[0], inter_predictor=[1], lines=lines)
    frames = [intra(8 * k, 8000 * k, 1) for k in range(10)]
    slow = b"S" + unsigned(flags) + b"\x00"
    status = record_of(start + frames[0] + slow + b"".join(frames[1:]) + END, tmp_path).status

    assert [name for name, _, _ in status.modes] == [mode]
    assert bool(status.direct_rates) is (mode == "acro")


@pytest.mark.parametrize("turned", [False, True])
def test_the_yaw_controller_tells_which_way_the_motors_turn(tmp_path: Path, *, turned: bool) -> None:
    names = [*(f"motor[{k}]" for k in range(4)), "axisP[2]"]
    lines = "H motorOutput:0,1000\n"
    start = header(names, inter_encoding=[0] * 5, inter_predictor=[1] * 5, lines=lines)
    rng = np.random.default_rng(0)
    frames, wanted = [], rng.integers(-100, 100, 50)
    for number, term in enumerate(wanted):
        # Betaflight counts yaw to the left; usual motors 2 and 3 turn left, and speed up to turn the frame right.
        pattern = np.array([1, -1, -1, 1]) * (-1 if turned else 1)
        motors = (500 + pattern * term).tolist()
        frames.append(intra(8 * number, 8000 * number, *motors, int(term)))

    record = record_of(start + b"".join(frames) + END, tmp_path)

    np.testing.assert_allclose(record["yaw_command"].values, -wanted / 1000.0, atol=1e-12)


EVENTS = [
    b"E\x00" + unsigned(5000),
    b"E\x0d\x05" + signed(-3),
    b"E\x0d\x85\x00\x00\x80\x3f",
    b"E\x0f" + unsigned(2),
    b"E\x1e" + unsigned(300) + unsigned(1),
]


def small_flight(blocks: int = 3, offset: int = 0) -> list[bytes]:
    """Blocks of an I frame and three P frames, every second loop of 8."""
    body = b"".join(inter(signed(1)) for _ in range(3))
    return [intra(8 * block + offset, 5000 + 4000 * block, block) + body for block in range(blocks)]


START = header(["debug[0]"], inter_encoding=[0], inter_predictor=[1])


@pytest.mark.parametrize("event", EVENTS)
def test_events_stand_between_frames(event: bytes) -> None:
    flight = only(START + event.join([b"", *small_flight(), b""]) + END)

    assert len(flight.frames) == 12
    assert (flight.damage.skipped_bytes, flight.damage.lost_frames) == (0, 0)


def test_a_pause_of_the_logger_is_no_loss() -> None:
    resume = b"E\x0e" + unsigned(8000) + unsigned(4_005_000)
    late = intra(8000, 4_005_001, 5) + inter(signed(1))

    flight = only(START + b"".join(small_flight()) + resume + late + END)

    assert len(flight.frames) == 14
    assert (flight.damage.skipped_bytes, flight.damage.lost_frames) == (0, 0)


def test_a_damaged_frame_costs_the_rest_of_its_block() -> None:
    blocks = small_flight(6)
    blocks[2] = blocks[2][:-3] + b"\xaa\xaa\xaa"

    flight = only(START + b"".join(blocks) + END)

    iterations = flight.field("loopIteration").tolist()
    lost = sorted(set(range(0, 48, 2)) - set(iterations))
    assert lost
    assert set(lost) <= {16, 18, 20, 22}
    assert flight.damage.lost_frames == len(lost)
    assert flight.damage.skipped_bytes > 0
    assert np.all(np.diff(flight.time_s) > 0.0)


def test_time_goes_on_when_its_counter_wraps() -> None:
    near = 2**32 - 1500
    flight = only(START + intra(0, near, 1) + 3 * inter(signed(1)) + END)

    assert np.diff(flight.time_s).tolist() == pytest.approx([1e-3] * 3)


def test_erased_memory_behind_the_log_is_no_damage() -> None:
    flight = only(START + b"".join(small_flight()) + b"\xff" * 5000)

    assert len(flight.frames) == 12
    assert flight.damage.skipped_bytes == 0
    assert not flight.damage.ended


@pytest.mark.parametrize(
    ("written", "cadence"), [("1/4", (32, 1, 4)), ("2/3", (32, 2, 3)), ("4", (32, 1, 4)), ("0", (32, 1, 32))]
)
def test_cadence(written: str, cadence: tuple[int, int, int]) -> None:
    text = START.replace(b"I interval:8", b"I interval:32").replace(b"P interval:1/2", f"P interval:{written}".encode())
    assert parse_header(text).cadence == cadence


NAMES = (
    *(f"gyroADC[{i}]" for i in range(3)),
    *(f"accSmooth[{i}]" for i in range(3)),
    *(f"setpoint[{i}]" for i in range(4)),
    *(f"rcCommand[{i}]" for i in range(4)),
    *(f"debug[{i}]" for i in range(4)),
    *(f"motor[{i}]" for i in range(4)),
    "eRPM[0]",
    "vbatLatest",
)
LINES = (
    "H Firmware type:Cleanflight\nH Firmware revision:Betaflight 4.5.1 (77d01ba3b) STM32F7X2\nH gyro_scale:0x3f800000\n"
    "H acc_1G:2048\nH motorOutput:0,2000\nH motor_poles:14\nH rollPID:45,80,40\nH Craft name:fly\n"
    "H chirp_time_seconds:20\nH chirp_amplitude_roll:230\nH chirp_amplitude_pitch:200\nH yaw_motors_reversed:0\n"
)


def described(frames: int = 2000, *, chirp: bool = False, start_us: int = 0) -> bytes:
    """A flight of I and P frames of plain numbers; every value is logged anew."""
    start = header(NAMES, inter_encoding=[0] * len(NAMES), inter_predictor=[0] * len(NAMES), lines=LINES)
    parts = [start]
    for index in range(frames):
        phase = (0.01 * index) % (2.0 * math.pi)
        debug = [round(5000 * phase), 1, 25, round(1000 * math.cos(phase))] if chirp else [0, -1, 0, 0]
        values = [10, 20, 30, 205, 410, 2048, 1, 2, 3, 400, 50, 100, -250, 1500, *debug, 800, 900, 1000, 1100, 70, 1480]
        if index % 4:
            parts.append(inter(b"".join(map(signed, values))))
        else:
            parts.append(intra(2 * index, start_us + 5000 + 1000 * index, *values))
    return b"".join(parts) + END


def test_channels_have_their_signs_and_units(tmp_path: Path) -> None:
    record = record_of(described(), tmp_path)

    (topic,) = record.topics
    first = {channel.name: float(topic.values[row, 0]) for row, channel in enumerate(topic.channels)}
    degree, g = math.pi / 180.0, 9.80665
    assert first == pytest.approx(
        {
            "p": 10 * degree,
            "q": -20 * degree,
            "r": -30 * degree,
            "ax": 205 / 2048 * g,
            "ay": -410 / 2048 * g,
            "az": -g,
            "p_setpoint": degree,
            "q_setpoint": -2 * degree,
            "r_setpoint": -3 * degree,
            "roll_stick": 0.1,
            "pitch_stick": -0.2,
            "yaw_stick": 0.5,
            "thrust_stick": 0.5,
            "motor_1": 0.4,
            "motor_2": 0.45,
            "motor_3": 0.5,
            "motor_4": 0.55,
            "roll_command": 0.05,
            "pitch_command": 0.025,
            "yaw_command": 0.0,
            "thrust_command": 0.475,
            "motor_speed_1": 7000 * 2 / 14 * 2 * math.pi / 60,
            "battery_voltage": 14.8,
        },
        abs=1e-12,
    )
    assert record.parameters["rollPID_P"] == 45.0
    assert "Craft name" not in record.parameters
    assert record.instruments["roll"] == ("roll_stick",)
    assert record.declared == ()


def test_chirp_is_declared_and_is_the_instrument(tmp_path: Path) -> None:
    record = record_of(described(chirp=True), tmp_path)

    (sweep,) = record.declared
    assert (sweep.axis, sweep.kind, sweep.origin) == ("pitch", "sweep", "declared")
    assert (sweep.start_s, sweep.stop_s) == pytest.approx((0.005, 2.004))
    assert record.instruments["pitch"] == ("pitch_excitation", "pitch_stick")
    ((topic, row),) = record.holding("pitch_excitation")
    assert topic.values[row, 0] == pytest.approx(-200 * math.pi / 180.0)


def test_other_vehicles_use_the_sums_of_the_controllers(tmp_path: Path) -> None:
    names = ["gyroADC[0]", "axisP[1]", "axisI[1]", "motor[0]"]
    start = header(names, inter_encoding=[0] * 4, inter_predictor=[0] * 4)

    record = record_of(start + intra(0, 5000, 1, 30, 20, 1500) + END, tmp_path)

    ((topic, row),) = record.holding("pitch_command")
    assert topic.values[row].tolist() == pytest.approx([-0.05])
    assert topic.channels[row].source == "axisP[1] + axisI[1]"


def test_longest_flight_comes_first(tmp_path: Path) -> None:
    record = record_of(described(40) + described(80) + described(20), tmp_path)

    assert [topic.name for topic in record.topics] == ["flight 2", "flight 1", "flight 3"]
    several = [finding for finding in record.findings if finding.kind == "several_flights"]
    assert [finding.numbers["flights"] for finding in several] == [3.0]


def test_no_second_is_of_two_flights(tmp_path: Path) -> None:
    """Each battery starts the clock of the flight controller anew, and a flash keeps flights of many."""
    record = record_of(described(40) + described(80) + described(20), tmp_path)

    spans = sorted((float(topic.time_s[0]), float(topic.time_s[-1])) for topic in record.topics)
    assert all(before[1] < after[0] for before, after in pairwise(spans))
    lengths = {topic.name: float(np.ptp(topic.time_s)) for topic in record.topics}
    assert lengths == pytest.approx({"flight 1": 0.039, "flight 2": 0.079, "flight 3": 0.019})
    (several,) = [finding for finding in record.findings if finding.kind == "several_flights"]
    assert "those of flight 2 are 11 s later here than logged, those of flight 3 are 22 s later" in several.message


def test_flights_one_after_the_other_keep_their_stamps(tmp_path: Path) -> None:
    record = record_of(described(40) + described(80, start_us=1_000_000), tmp_path)

    assert sorted(float(topic.time_s[0]) for topic in record.topics) == pytest.approx([0.005, 1.005])
    (several,) = [finding for finding in record.findings if finding.kind == "several_flights"]
    assert "later" not in several.message


def test_flights_of_other_gains_are_told(tmp_path: Path) -> None:
    other = described(40).replace(b"H rollPID:45,80,40", b"H rollPID:50,80,40")
    record = record_of(other + described(80), tmp_path)

    (told,) = [finding for finding in record.findings if finding.kind == "parameters_changed"]
    assert "Flight 1 was flown with other settings than flight 2: rollPID_P 50 to 45." in told.message
    assert record.parameters["rollPID_P"] == 45.0
    same = record_of(described(40) + described(80), tmp_path)
    assert "parameters_changed" not in {finding.kind for finding in same.findings}


def adjusted(*events: tuple[int, int]) -> bytes:
    """A flight in which the pilot turned functions to values, after its second block."""
    told = b"".join(b"E\x0d" + bytes([function]) + signed(value) for function, value in events)
    flight = described(40).replace(b"H rollPID:45,80,40", b"H rollPID:45,80,40\nH pitchPID:47,84,46")
    first, *rest = flight.partition(b"I\x08")
    return first + told + b"".join(rest)


@pytest.mark.parametrize(
    ("events", "told"),
    [
        (((18, 48), (18, 52)), "rollPID_P 45 to 52."),
        (((15, 60), (19, 70)), "pitchPID_P 47 to 60, rollPID_I 80 to 70."),
        (((8, 33),), "pitchPID_D 46 to 33, rollPID_D 40 to 33."),
        (((18, 50), (18, 45)), ""),
        (((1, 120), (29, 3), (63, 9)), ""),
    ],
    ids=["the last value", "axes", "both axes", "turned back", "rates of the sticks"],
)
def test_gains_that_a_pilot_turns_in_flight_are_told(
    events: tuple[tuple[int, int], ...], told: str, tmp_path: Path
) -> None:
    record = record_of(adjusted(*events), tmp_path)

    found = [finding.message for finding in record.findings if finding.kind == "parameters_changed"]
    start = "The pilot adjusted gains in flight 1: "
    assert [message.partition(" The whole")[0] for message in found] == ([start + told] if told else [])
    assert all("no loop is computed" in one for one in found)
    assert not [finding for finding in record.findings if finding.kind == "corrupt_log"]


def test_sniffs_by_content() -> None:
    assert sniff(START)
    assert sniff(b"\xff\xff" + START)
    assert not sniff(b"ULog")


def test_a_log_without_frames_is_said_to_be_one(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="no frame"):
        record_of(START, tmp_path)
