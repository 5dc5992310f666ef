"""ArduPilot logs as flight records: on logs written here, and on the flights with known answers."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rotorid.autopilots.advice import motor_advice, speed_advice
from rotorid.autopilots.ardupilot.filters import passage
from rotorid.data.record import STANDARD_UNITS, FlightRecord, Source, Topic
from rotorid.errors import LogError
from rotorid.io.ardupilot.log import FORMAT, read

PACKING = dict.fromkeys("QBHIf") | {"N": "16s", "Z": "64s", "e": "i"}
DEGREE = math.pi / 180.0
STAMP_S = 0.01
"""The manifest gives times to a hundredth of a second."""


class Log:
    """A DataFlash log under construction; each message is defined when it first appears."""

    def __init__(self) -> None:
        self.data = b""
        self.numbers: dict[str, int] = {"FMT": 128}
        self.define("FMT", "BBnNZ", "Type,Length,Name,Format,Columns", 89)

    def define(self, name: str, letters: str, columns: str, length: int) -> None:
        texts = (name.encode(), letters.encode(), columns.encode())
        self.data += b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", self.numbers[name], length, *texts)

    def add(self, name: str, letters: str, **columns: float | str) -> None:
        packing = "<" + "".join(PACKING[letter] or letter for letter in letters)
        if name not in self.numbers:
            self.numbers[name] = len(self.numbers)
            self.define(name, letters, ",".join(columns), 3 + struct.calcsize(packing))
        values = [value.encode() if isinstance(value, str) else value for value in columns.values()]
        self.data += b"\xa3\x95" + bytes([self.numbers[name]]) + struct.pack(packing, *values)

    def parameter(self, name: str, value: float) -> None:
        self.add("PARM", "QNf", TimeUS=0, Name=name, Value=value)

    def run(self, start_us: int, entry: int, low_hz: float, high_hz: float) -> None:
        """One SYSTEMID run of five samples, a hundredth of a second apart; the signal is the number of the entry."""
        self.add("SIDS", "QBff", TimeUS=start_us - 100, Ax=entry, FSt=low_hz, FSp=high_hz)
        for index in range(5):
            values = dict.fromkeys(("Gx", "Gy", "Gz", "Ax", "Ay"), 0.0) | {"Az": -9.75, "Gx": 180.0}
            stamp = start_us + 10_000 * index
            self.add("SIDD", "Q" + "f" * 8, TimeUS=stamp, Time=0.01 * index, Targ=entry, **values)

    def read(self, folder: Path) -> FlightRecord:
        path = folder / "log.bin"
        path.write_bytes(self.data)
        return read_log(path)


def read_log(path: Path) -> FlightRecord:
    return read(path, Source(name=path.name, format=FORMAT, sha256=""))


def topic(record: FlightRecord, name: str) -> Topic:
    return next(topic for topic in record.topics if topic.name == name)


def values(record: FlightRecord, channel: str) -> list[float]:
    """Samples of a channel in its preferred topic."""
    held, row = next(record.holding(channel))
    samples: list[float] = held.values[row].tolist()
    return samples


def test_each_run_is_a_topic_that_excites_its_own_axis(tmp_path: Path) -> None:
    log = Log()
    log.run(1_000_000, 10, 0.1, 20.0)
    log.run(3_000_000, 8, 0.5, 10.0)
    log.run(5_000_000, 2, 0.2, 5.0)

    record = log.read(tmp_path)

    excited = [[c.name for c in topic.channels if c.name.endswith("_excitation")] for topic in record.topics]
    assert excited == [["roll_excitation"], ["pitch_excitation"], ["pitch_excitation"]]
    units = [topic.channels[-1].unit for topic in record.topics]
    assert units == ["1", "rad/s", "rad"]
    signals = [topic.values[-1, 0] for topic in record.topics]
    assert signals == pytest.approx([10.0, 8.0 * DEGREE, 2.0 * DEGREE], rel=1e-15)
    assert [(m.axis, m.start_s, m.stop_s) for m in record.declared] == [
        ("roll", 1.0, 1.04),
        ("pitch", 3.0, 3.04),
        ("pitch", 5.0, 5.04),
    ]
    assert record.declared[1].band_rad_s == pytest.approx((math.pi, 20.0 * math.pi), rel=1e-15)
    assert {m.kind for m in record.declared} == {"sweep"}
    assert {m.origin for m in record.declared} == {"declared"}
    assert record.instruments == {"roll": ("roll_excitation",), "pitch": ("pitch_excitation",)}
    assert values(record, "p") == pytest.approx([math.pi] * 5, rel=1e-15)
    assert values(record, "az") == [-9.75] * 5


def test_run_at_an_unknown_place_is_reported(tmp_path: Path) -> None:
    log = Log()
    log.run(1_000_000, 18, 0.1, 2.0)

    record = log.read(tmp_path)

    assert record.declared == ()
    assert record.instruments == {}
    assert [(finding.kind, finding.numbers["sid_axis"]) for finding in record.findings if finding.numbers] == [
        ("no_excitation", 18.0)
    ]


def test_preference_is_system_id_then_rate_then_imu(tmp_path: Path) -> None:
    log = Log()
    for instance, rate in ((0, 0.25), (1, 0.5)):
        log.add("IMU", "QBf", TimeUS=1, I=instance, GyrX=rate)
    log.add("RATE", "Qff", TimeUS=1, R=90.0, ROut=0.5)
    log.run(1_000_000, 10, 0.1, 20.0)

    record = log.read(tmp_path)

    assert [held.name for held, _ in record.holding("p")] == ["SIDD run 1", "RATE", "IMU"]
    assert topic(record, "IMU").values.tolist() == [[0.25]]
    assert values(record, "roll_command") == [0.5]


def test_position_control_says_what_was_asked_for_before_and_behind_its_velocity_loop(tmp_path: Path) -> None:
    """Desired velocity is that of stick or path; the target adds what the position loop corrects."""
    log = Log()
    for letter, sign in (("N", 1.0), ("E", -1.0), ("D", 2.0)):
        columns = {
            f"{name}{letter}": sign * value for name, value in (("DV", 1.5), ("TV", 9.0), ("DA", 8.0), ("TA", 2.5))
        }
        log.add(f"PSC{letter}", "Qffff", TimeUS=1, **columns)

    record = log.read(tmp_path)

    assert values(record, "velocity_north_feedforward") == [1.5]
    assert values(record, "velocity_east_feedforward") == [-1.5]
    assert values(record, "acceleration_down_setpoint") == [5.0]


def test_old_rate_messages_are_read_in_their_own_units(tmp_path: Path) -> None:
    log = Log()
    columns = {"RllDes": 0.0, "Rll": 9000.0, "RllOut": -2250.0, "AccOut": 250.0}
    log.add("RATE", "Iffff", TimeMS=1500, **columns)

    record = log.read(tmp_path)

    assert values(record, "p") == pytest.approx([math.pi / 2.0], rel=1e-15)
    assert values(record, "roll_command") == [-0.5]
    assert values(record, "thrust_command") == [0.25]
    assert topic(record, "RATE").time_s.tolist() == [1.5]
    assert "legacy_units" in [finding.kind for finding in record.findings]


def test_motors_follow_the_servo_functions(tmp_path: Path) -> None:
    log = Log()
    for name, value in {"SERVO1_FUNCTION": 34, "SERVO2_FUNCTION": 0, "SERVO3_FUNCTION": 33}.items():
        log.parameter(name, value)
    log.parameter("MOT_PWM_MIN", 1100)
    log.parameter("MOT_PWM_MAX", 1900)
    log.add("RCOU", "QHHH", TimeUS=1, C1=1500, C2=1234, C3=1300)
    log.add("ESC", "QBf", TimeUS=1, Instance=2, RPM=6000.0)

    record = log.read(tmp_path)

    assert [c.name for c in topic(record, "RCOU").channels] == ["motor_1", "motor_2"]
    assert values(record, "motor_1") == pytest.approx([0.25], rel=1e-12)
    assert values(record, "motor_2") == pytest.approx([0.5], rel=1e-12)
    assert values(record, "motor_speed_1") == pytest.approx([200.0 * math.pi], rel=1e-12)


def test_old_logs_name_their_frame_in_a_text(tmp_path: Path) -> None:
    log = Log()
    log.add("MSG", "QZ", TimeUS=0, Message="APM:Copter V3.4.4 (65ffe9d7)")
    log.add("MSG", "QZ", TimeUS=0, Message="Frame: TRI")
    log.parameter("RC3_MIN", 1100)
    log.parameter("RC3_MAX", 1900)
    log.add("RCOU", "QHHHH", TimeUS=1, C1=1100, C2=1500, C3=1900, C4=1700)

    record = log.read(tmp_path)

    assert record.source.firmware == "APM:Copter V3.4.4 (65ffe9d7)"
    assert topic(record, "RCOU").values[:, 0] == pytest.approx([0.0, 0.5, 1.0], abs=1e-12)


def test_sticks_follow_calibration_and_direction(tmp_path: Path) -> None:
    log = Log()
    for name, value in {"RCMAP_ROLL": 2, "RCMAP_PITCH": 1, "RC1_REVERSED": 1, "RC2_MIN": 1100, "RC2_MAX": 1900}.items():
        log.parameter(name, value)
    log.add("RCIN", "QHHHH", TimeUS=1, C1=2000, C2=1700, C3=1250, C4=1500)

    record = log.read(tmp_path)

    sticks = {name: values(record, f"{name}_stick")[0] for name in ("roll", "pitch", "yaw", "thrust")}
    assert sticks == pytest.approx({"roll": 0.5, "pitch": -1.0, "yaw": 0.0, "thrust": 0.25}, abs=1e-12)
    assert record.instruments["roll"] == ("roll_stick",)


def test_parameters_are_the_last_ones_and_say_nothing_of_the_place(tmp_path: Path) -> None:
    log = Log()
    for name, value in (("SIH_MASS", 1.0), ("SIH_MASS", 2.0), ("SIM_OPOS_LAT", -35.0), ("AHRS_ORIG_LON", 149.0)):
        log.parameter(name, value)
    log.run(1_000_000, 10, 1.0, 10.0)

    record = log.read(tmp_path)

    assert dict(record.parameters) == {"SIH_MASS": 2.0}


@pytest.mark.parametrize(
    ("loop_hz", "high_hz", "severity"),
    [(100.0, 20.0, None), (200.0, 20.0, "info"), (400.0, 20.0, "info"), (200.0, 30.0, "warning"), (None, 20.0, None)],
)
def test_every_nth_sample_of_the_loop_is_remarked_on(
    tmp_path: Path, loop_hz: float | None, high_hz: float, severity: str | None
) -> None:
    """The run has 100 Hz, so that 50 Hz is the limit and a sweep beyond 25 Hz comes near to it."""
    log = Log()
    log.parameter("LOG_BITMASK", 0b1101)
    if loop_hz is not None:
        log.parameter("SCHED_LOOP_RATE", loop_hz)
    log.run(1_000_000, 10, 1.0, high_hz)
    found = [finding for finding in log.read(tmp_path).findings if finding.kind == "decimated"]
    assert [finding.severity for finding in found] == ([] if severity is None else [severity])
    for finding in found:
        assert finding.where == "SIDD run 1"
        assert finding.numbers["nyquist_hz"] == pytest.approx(50.0)
        assert finding.numbers["loop_hz"] == loop_hz
        assert f"one sample in {loop_hz / 100.0:.0f} " in finding.message
        assert "LOG_BITMASK = 262159" in finding.message


def test_missing_rate_names_the_bit_to_set(tmp_path: Path) -> None:
    log = Log()
    log.add("IMU", "Qf", TimeUS=1, GyrX=0.0)

    (finding,) = log.read(tmp_path).findings

    assert (finding.kind, finding.where) == ("missing_channel", "RATE")
    assert "LOG_BITMASK" in finding.message


def test_missing_file_is_an_error_of_the_user(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"gone\.bin cannot be read"):
        read_log(tmp_path / "gone.bin")


@pytest.mark.parametrize(
    ("name", "runs"),
    [
        ("x_calm_roll.BIN", [("roll", 94.85, 186.33, 0.1, 20.0), ("roll", 203.40, 264.90, 0.2, 15.0)]),
        ("x_wind_rollpitch.BIN.xz", [("roll", 94.80, 176.29, 0.1, 20.0), ("pitch", 194.40, 275.89, 0.1, 20.0)]),
    ],
)
def test_declared_sweeps_are_those_that_were_flown(
    name: str, runs: list[tuple[str, float, float, float, float]], unpacked: Callable[[str], Path]
) -> None:
    record = read_log(unpacked(f"ardupilot_sitl/{name}"))

    assert [maneuver.axis for maneuver in record.declared] == [run[0] for run in runs]
    for maneuver, (axis, start_s, stop_s, low_hz, high_hz) in zip(record.declared, runs, strict=True):
        assert maneuver.start_s == pytest.approx(start_s, abs=STAMP_S)
        assert maneuver.stop_s == pytest.approx(stop_s, abs=STAMP_S)
        # The log holds the band in single precision.
        assert maneuver.band_rad_s == pytest.approx((2 * math.pi * low_hz, 2 * math.pi * high_hz), rel=1e-7)
        assert record.instruments[axis][0] == f"{axis}_excitation"
    excited = [topic for topic in record.topics for channel in topic.channels if channel.name == "roll_excitation"]
    assert len(excited) == sum(run[0] == "roll" for run in runs)


def test_simulated_flight_has_the_channels_and_signs_of_the_vocabulary(shared_data: Path) -> None:
    record = read_log(shared_data / "ardupilot_sitl" / "x_calm_roll.BIN")

    for held in record.topics:
        for channel in held.channels:
            assert STANDARD_UNITS[channel.name] == channel.unit
    rate, run = topic(record, "RATE"), topic(record, "SIDD run 1")
    together = (rate.time_s >= run.time_s[0]) & (rate.time_s <= run.time_s[-1])
    assert np.array_equal(rate.time_s[together], run.time_s)
    # In still air a positive roll command accelerates to the right: command and roll acceleration agree in sign.
    command = rate.values[rate.row("roll_command") or 0, together]
    acceleration = np.gradient(run.values[run.row("p") or 0], run.time_s)
    assert np.corrcoef(command, acceleration)[0, 1] > 0.9
    hover = np.median(values(record, "az"))
    assert -10.0 < hover < -9.6
    assert 0.3 < np.median(values(record, "thrust_command")) < 0.42
    assert 0.5 < np.median(values(record, "motor_1")) < 0.65
    assert record.source.firmware.startswith("ArduCopter V4.7")


@pytest.mark.parametrize("name", ["erle_brain3.BIN", "beast_0036.BIN"])
def test_slow_logs_are_called_slow_and_told_what_to_change(name: str, shared_data: Path) -> None:
    record = read_log(shared_data / "ardupilot" / name)

    slow = {finding.where: finding for finding in record.findings if finding.kind == "rate_too_low"}
    assert set(slow) == {"RATE", "IMU", "RCOU"}
    assert all("LOG_BITMASK" in finding.message for finding in slow.values())
    assert all(finding.numbers["rate_hz"] < 30.0 for finding in slow.values())
    assert {channel.name for channel in topic(record, "RCOU").channels} == {f"motor_{n}" for n in range(1, 5)}
    assert {"roll_command", "p", "az", "phi", "velocity_north", "battery_voltage"} <= set(record.channel_names)


def flown(*events: tuple[int, int], armed: tuple[tuple[int, int], ...]) -> Log:
    """Ten seconds of motion, with events and states of arming at whole seconds."""
    log = Log()
    log.add("MSG", "QZ", TimeUS=0, Message="ArduCopter V4.6.2 (1ebd4d99)")
    for stamp in range(0, 10_000_001, 100_000):
        log.add("IMU", "Qffffff", TimeUS=stamp, **dict.fromkeys(("GyrX", "GyrY", "GyrZ", "AccX", "AccY", "AccZ"), 0.1))
    for second, state in armed:
        log.add("ARM", "QBI", TimeUS=1_000_000 * second, ArmState=state, ArmChecks=0)
    for second, event in events:
        log.add("EV", "QB", TimeUS=1_000_000 * second, Id=event)
    return log


@pytest.mark.parametrize(("left_s", "expected"), [(9.0, ((3.0, 6.0),)), (5.0, ((3.0, 5.0),))])
def test_a_plan_of_attitudes_lasts_from_message_to_message_in_guided_mode(
    left_s: float, expected: tuple[tuple[float, float], ...], tmp_path: Path
) -> None:
    log = flown(armed=((1, 1),))
    log.add("MODE", "QBBB", TimeUS=2_000_000, Mode=4, ModeNum=4, Rsn=1)
    log.add("MODE", "QBBB", TimeUS=int(1e6 * left_s), Mode=5, ModeNum=5, Rsn=1)
    for second, text in (
        (1, "rotorid: plan of 48 s loaded"),
        (3, "rotorid: plan begins"),
        (6, "rotorid: plan complete"),
    ):
        log.add("MSG", "QZ", TimeUS=1_000_000 * second, Message=text)
    assert log.read(tmp_path).status.planned == expected


@pytest.mark.parametrize(
    ("events", "armed", "expected"),
    [
        ((), ((2, 1), (7, 0)), ((2.0, 7.0),)),
        ((), ((7, 0),), ((0.0, 7.0),)),
        ((), ((2, 1),), ((2.0, 10.0),)),
        (((3, 28), (6, 18)), ((2, 1), (7, 0)), ((2.0, 7.0),)),
        (((1, 10), (8, 11)), ((2, 1), (7, 0)), ((1.0, 8.0),)),
    ],
)
def test_arming_is_told_by_its_message_where_events_do_not(
    events: tuple[tuple[int, int], ...],
    armed: tuple[tuple[int, int], ...],
    expected: tuple[tuple[float, float], ...],
    tmp_path: Path,
) -> None:
    status = flown(*events, armed=armed).read(tmp_path).status
    assert status.armed == expected
    assert status.flagged_in == ("EV" if events else "ARM")


@pytest.mark.parametrize(
    ("events", "armed", "in_air"),
    [
        # GPS and fences alone: the log may begin and end in the air.
        (((3, 25), (6, 62)), None, None),
        # Armed and never taken off.
        (((3, 10), (6, 11)), ((3.0, 6.0),), ()),
        (((3, 28), (6, 18)), ((3.0, 10.0),), ((3.0, 6.0),)),
    ],
)
def test_events_that_tell_neither_arming_nor_landing_do_not_say_that_it_never_flew(
    events: tuple[tuple[int, int], ...],
    armed: tuple[tuple[float, float], ...] | None,
    in_air: tuple[tuple[float, float], ...] | None,
    tmp_path: Path,
) -> None:
    status = flown(*events, armed=()).read(tmp_path).status
    assert (status.armed, status.in_air) == (armed, in_air)


def test_pulses_with_ranges_of_their_own_are_shares_of_them(tmp_path: Path) -> None:
    log = Log()
    for name, value in {"SERVO1_FUNCTION": 33, "SERVO2_FUNCTION": 34, "MOT_PWM_TYPE": 8}.items():
        log.parameter(name, value)
    for name, value in {"MOT_PWM_MIN": 1000, "MOT_PWM_MAX": 2000, "SERVO2_MIN": 1100, "SERVO2_MAX": 1900}.items():
        log.parameter(name, value)
    log.add("RCOU", "QHH", TimeUS=1, C1=1100, C2=1100)
    record = log.read(tmp_path)
    assert values(record, "motor_1") == pytest.approx([0.1])
    assert values(record, "motor_2") == pytest.approx([0.0])


def test_gains_that_change_after_arming_are_told_and_what_is_set_before_is_not(tmp_path: Path) -> None:
    log = flown(armed=((2, 1), (7, 0)))
    for second, value in ((0, 0.1), (1, 0.12), (5, 0.15)):
        stated = {"ATC_RAT_RLL_P": value, "MOT_THST_HOVER": value, "ATC_RAT_PIT_P": min(value, 0.12)}
        for name, number in stated.items():
            log.add("PARM", "QNf", TimeUS=1_000_000 * second, Name=name, Value=number)
    record = log.read(tmp_path)
    (told,) = [finding for finding in record.findings if finding.kind == "parameters_changed"]
    assert told.severity == "warning"
    assert "ATC_RAT_RLL_P 0.12 to 0.15." in told.message
    assert "PIT" not in told.message
    assert "HOVER" not in told.message
    assert record.parameters["ATC_RAT_RLL_P"] == pytest.approx(0.15)


QUAD = {f"SERVO{channel}_FUNCTION": 33.0 + motor for motor, channel in enumerate((2, 3, 1, 4))}
"""Motors 1 to 4 on outputs 2, 3, 1 and 4."""


def with_speeds(instances: dict[int, float], functions: dict[str, float]) -> Log:
    log = Log()
    for name, value in functions.items():
        log.parameter(name, value)
    for sample in range(3):
        for instance, rpm in instances.items():
            log.add("ESC", "QBf", TimeUS=1_000_000 + 10_000 * sample + instance, Instance=instance, RPM=rpm)
    return log


def speeds_of(record: FlightRecord) -> dict[str, float]:
    names = [name for name in record.channel_names if name.startswith("motor_speed_")]
    return {name: round(values(record, name)[0] * 30.0 / math.pi) for name in names}


def test_the_speeds_of_some_motors_are_those_of_their_outputs(tmp_path: Path) -> None:
    record = with_speeds({0: 4000.0, 2: 5000.0}, QUAD).read(tmp_path)
    assert speeds_of(record) == {"motor_speed_3": 4000, "motor_speed_2": 5000}
    assert record.unread == ()


def test_speeds_that_are_numbered_among_themselves_follow_the_outputs(tmp_path: Path) -> None:
    """Controllers on a bus count from 0, though the motors are outputs 9 to 12."""
    functions = {f"SERVO{channel}_FUNCTION": 33.0 + motor for motor, channel in enumerate((11, 12, 9, 10))}
    record = with_speeds({number: 1000.0 * (number + 1) for number in range(4)}, functions).read(tmp_path)
    assert speeds_of(record) == {
        "motor_speed_3": 1000,
        "motor_speed_4": 2000,
        "motor_speed_1": 3000,
        "motor_speed_2": 4000,
    }


def test_speeds_of_no_motor_are_not_called_missing(tmp_path: Path) -> None:
    log = with_speeds({12: 4000.0}, QUAD)
    log.add("ATT", "Qf", TimeUS=1_000_000, Roll=0.0)
    record = log.read(tmp_path)
    assert speeds_of(record) == {}
    assert speed_advice(record).startswith("ESC is in the log (100 Hz), but rotorid does not read it: none of its")


def test_outputs_without_a_frame_are_not_called_missing(tmp_path: Path) -> None:
    log = Log()
    for sample in range(3):
        log.add("RCOU", "QHHHH", TimeUS=1_000_000 + 100_000 * sample, C1=1500, C2=1500, C3=1500, C4=1500)
    log.add("ATT", "Qf", TimeUS=1_000_000, Roll=0.0)
    record = log.read(tmp_path)
    assert motor_advice(record).startswith("RCOU is in the log (10 Hz), but rotorid does not read it: neither SERVOn")


@pytest.mark.parametrize(
    ("name", "columns", "expected"),
    [
        ("FTN", {"NDn": 2, "NF1": 80.0, "NF2": 90.0, "NF3": 0.0}, {1: 80.0, 2: 90.0}),
        ("FTN", {"NDn": 1, "DnF1": 70.0}, {1: 70.0}),
        ("FTNS", {"NF": 85.0}, {1: 85.0}),
        ("FCN", {"NF": 1, "CF1": 81.0, "CF2": 0.0, "HF1": 162.0}, {1: 81.0}),
        ("FCN", {"NF": 1, "CF1": 81.0, "CF2": math.nan}, {1: 81.0}),
        ("FCNS", {"CF": 82.0, "HF": 164.0}, {1: 82.0}),
        ("FTN1", {"PkAvg": 99.0, "DnF": 83.0}, {1: 83.0}),
    ],
)
def test_centers_of_notches(tmp_path: Path, name: str, columns: dict[str, float], expected: dict[int, float]) -> None:
    log = Log()
    for sample in range(3):
        log.add(name, "Q" + "f" * len(columns), TimeUS=1_000_000 + 10_000 * sample, **columns)
    record = log.read(tmp_path)
    found = {channel: values(record, channel)[0] / (2.0 * math.pi) for channel in record.channel_names}
    assert found == pytest.approx({f"notch_frequency_{number}": hertz for number, hertz in expected.items()})


def test_a_notch_that_moves_is_named_with_where_it_was(tmp_path: Path) -> None:
    log = Log()
    settings = {"ENABLE": 1, "MODE": 3, "REF": 1, "FREQ": 60, "BW": 30, "ATT": 40, "HMNCS": 1}
    for setting, value in {"INS_GYRO_FILTER": 40.0, **{f"INS_HNTCH_{k}": v for k, v in settings.items()}}.items():
        log.parameter(setting, float(value))
    for sample in range(101):
        log.add("FTN", "QBBf", TimeUS=1_000_000 + 10_000 * sample, I=0, NDn=1, NF1=80.0 + 0.2 * sample)
        log.add("FTN", "QBBf", TimeUS=1_000_001 + 10_000 * sample, I=1, NDn=1, NF1=500.0)
    doubts = passage(log.read(tmp_path), "RATE.R", None).doubts
    assert len(doubts) == 1
    assert doubts[0].endswith("; it was between 80 and 100 Hz for 95 % of the log")


def test_angles_come_from_a_quaternion_where_no_others_are_logged(tmp_path: Path) -> None:
    half = math.pi / 8.0
    log = Log()
    for sample in range(3):
        stamp = 1_000_000 + 10_000 * sample
        log.add("XKQ", "QBffff", TimeUS=stamp, C=0, Q1=math.cos(half), Q2=0.0, Q3=math.sin(half), Q4=0.0)
        log.add("XKQ", "QBffff", TimeUS=stamp, C=1, Q1=1.0, Q2=0.0, Q3=0.0, Q4=0.0)
    assert values(log.read(tmp_path), "theta") == pytest.approx([math.pi / 4.0] * 3)
    log.add("ATT", "Qfff", TimeUS=1_000_000, Roll=0.0, Pitch=10.0, Yaw=0.0)
    assert values(log.read(tmp_path), "theta") == pytest.approx([math.radians(10.0)])
