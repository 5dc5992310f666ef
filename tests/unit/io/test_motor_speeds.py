"""Motor speeds that no rotor turned: what disagrees with its output is left out and named, and nothing else is."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter
from tests.unit.identifying.motor_logs import ARM_M, THRUST_BY_SPEED, with_speeds

from rotorid import FlightRecord, read
from rotorid.data.record import Channel, Source, Topic
from rotorid.identifying.identification import identify_motors
from rotorid.io.motor_speeds import checked_speeds
from rotorid.io.records import as_records
from rotorid.reviewing.inspection import inspect
from rotorid.settings.motors import MotorSettings
from rotorid.typing import FloatArray
from rotorid.vehicles.motor_flight import TRUTH

RATE_HZ, LAG_S, USUAL = 100.0, 0.05, 800.0
Change = Callable[[FloatArray, FloatArray], None]
"""Of speeds and outputs, shapes ``(4, samples)``, in place."""


def flight(change: Change = lambda speeds, outputs: None, *, outputs_logged: bool = True) -> FlightRecord:
    """Sixty seconds of four motors that follow their outputs with a lag, and a gyro that hardly moves."""
    rng = np.random.default_rng(4)
    samples = round(60.0 * RATE_HZ)
    keep = np.exp(-1.0 / (0.3 * RATE_HZ))
    outputs = 0.5 + 0.06 * lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], rng.normal(size=(4, samples)), axis=1)
    slow = np.exp(-1.0 / (LAG_S * RATE_HZ))
    speeds = lfilter([1.0 - slow], [1.0, -slow], outputs - 0.5, axis=1) * USUAL * 1.4 + USUAL
    speeds = speeds + rng.normal(size=speeds.shape)
    change(speeds, outputs)
    time_s = np.arange(samples) / RATE_HZ
    rows = {f"motor_speed_{place + 1}": ("rad/s", row) for place, row in enumerate(speeds)}
    if outputs_logged:
        rows |= {f"motor_{place + 1}": ("1", row) for place, row in enumerate(outputs)}
    rows |= {name: ("rad/s", 0.05 * rng.normal(size=samples)) for name in ("p", "q")}
    topic = Topic(
        name="log",
        time_s=time_s,
        channels=tuple(Channel(name=name, unit=unit) for name, (unit, _) in rows.items()),
        values=np.stack([row for _, row in rows.values()]),
    )
    return FlightRecord(source=Source(name="a.csv", format="CSV", sha256=""), topics=(topic,))


def messages(record: FlightRecord) -> list[str]:
    return [finding.message for finding in record.findings if finding.kind == "channels_disagree"]


@pytest.mark.parametrize("outputs_logged", [True, False])
def test_sound_speeds_pass_unchanged(outputs_logged: bool) -> None:
    record = flight(outputs_logged=outputs_logged)
    assert checked_speeds(record) is record


def drops(speeds: FloatArray, _: FloatArray) -> None:
    speeds[1, np.random.default_rng(1).choice(np.arange(10, 5990), 180, replace=False)] = 0.0


def negative(speeds: FloatArray, _: FloatArray) -> None:
    speeds[2, 1000:1004] *= -1.0


def stuck(speeds: FloatArray, _: FloatArray) -> None:
    speeds[0, 2000:2300] = speeds[0, 2000]


def doubled(speeds: FloatArray, _: FloatArray) -> None:
    speeds[3, 3000:3003] *= 2.0
    speeds[3, 4000:4002] *= 0.5


@pytest.mark.parametrize(
    ("change", "name", "words", "samples"),
    [
        (drops, "motor_speed_2", "no more than a tenth", 180),
        (negative, "motor_speed_3", "no more than a tenth", 4),
        (stuck, "motor_speed_1", "stands still", 299),
        (doubled, "motor_speed_4", "twice or half", 5),
    ],
)
def test_samples_that_no_rotor_turned_are_left_out_and_named(
    change: Change, name: str, words: str, samples: int
) -> None:
    checked = checked_speeds(flight(change))
    (message,) = messages(checked)
    assert message.startswith(f"{name} ")
    assert words in message
    assert " s; they were left out" in message
    assert 6000 - checked[name].values.size == samples
    others = {f"motor_speed_{number}" for number in range(1, 5)} - {name}
    assert all(checked[other].values.size == 6000 for other in others)
    assert checked["p"].values.size == 6000


def failed_motor(speeds: FloatArray, outputs: FloatArray) -> None:
    speeds[0, 3000:3100] = 0.0
    outputs[0, 3000:3100] = 1.0


def slow_desync(speeds: FloatArray, _: FloatArray) -> None:
    speeds[0, 3000:3020] *= 0.4


@pytest.mark.parametrize("change", [failed_motor, slow_desync])
def test_a_motor_that_really_fails_stays_in_the_record(change: Change) -> None:
    record = flight(change)
    assert checked_speeds(record) is record


def test_speeds_that_are_negative_throughout_lose_their_sign_alone() -> None:
    def backward(speeds: FloatArray, _: FloatArray) -> None:
        speeds[0] *= -1.0

    checked = checked_speeds(flight(backward))
    assert checked["motor_speed_1"].values.min() > 0.0
    assert [finding.severity for finding in checked.findings] == ["info"]


@pytest.mark.parametrize("factor", [2.0, 0.5])
def test_a_channel_with_another_number_of_poles_is_left_out(factor: float) -> None:
    def scaled(speeds: FloatArray, _: FloatArray) -> None:
        speeds[2] *= factor

    checked = checked_speeds(flight(scaled))
    assert "motor_speed_3" not in checked
    (finding,) = [finding for finding in checked.findings if "number of poles" in finding.message]
    assert finding.numbers["ratio"] == pytest.approx(factor, rel=0.02)


@pytest.mark.parametrize("noise", [0.0, 5.0])
def test_a_sensor_that_never_sees_its_motor_turn_is_left_out(noise: float) -> None:
    def dead(speeds: FloatArray, _: FloatArray) -> None:
        speeds[1] = noise * np.abs(np.sin(np.arange(speeds.shape[1])))

    checked = checked_speeds(flight(dead))
    assert "motor_speed_2" not in checked
    (message,) = messages(checked)
    assert "while its motor runs" in message


def test_speeds_of_zero_throughout_are_left_out_where_outputs_show_that_motors_run() -> None:
    def silent(speeds: FloatArray, _: FloatArray) -> None:
        speeds[:] = 0.0

    def at_rest(speeds: FloatArray, outputs: FloatArray) -> None:
        speeds[:], outputs[:] = 0.0, 0.05

    checked = checked_speeds(flight(silent))
    assert not any(name.startswith("motor_speed") for name in checked.channel_names)
    for record in (flight(at_rest), flight(silent, outputs_logged=False)):
        assert checked_speeds(record) is record


def test_holes_in_a_channel_hide_nothing() -> None:
    def holes(speeds: FloatArray, _: FloatArray) -> None:
        speeds[1, 100:200] = np.nan
        speeds[1, 300:302] = 0.0

    checked = checked_speeds(flight(holes))
    assert checked["motor_speed_2"].values.size == 6000 - 100 - 2
    assert len(messages(checked)) == 1


def test_speeds_in_another_order_are_left_out() -> None:
    def swapped(speeds: FloatArray, _: FloatArray) -> None:
        speeds[[0, 1]] = speeds[[1, 0]]

    checked = checked_speeds(flight(swapped))
    assert [name for name in checked.channel_names if name.startswith("motor_speed")] == [
        "motor_speed_3",
        "motor_speed_4",
    ]
    assert len(messages(checked)) == 2


@pytest.mark.parametrize("burst", [1, 4])
def test_a_thrust_coefficient_does_not_suffer_from_lost_speeds(burst: int, tmp_path: Path) -> None:
    """One motor reads zero in 3 % of the samples: c_2 stays within 1 %; bursts explained no axis before."""
    path = with_speeds(tmp_path / "speeds.csv")
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    head = path.read_text(encoding="utf-8").partition("\n")[0]
    starts = np.random.default_rng(2).choice(len(table) // burst - 2, round(0.03 * len(table) / burst), replace=False)
    for start in 1 + starts:
        table[burst * start : burst * (start + 1), 2] = 0.0
    np.savetxt(path, table, delimiter=",", header=head, comments="", fmt="%.9g")
    record = read(path)
    known = {"m": TRUTH["m"], "kappa": 0.02}
    found = identify_motors([record], MotorSettings(known=known, layout="quad.x", arm_m=ARM_M))
    assert found.parameters["c_2"].value == pytest.approx(THRUST_BY_SPEED, rel=0.01)
    (message,) = messages(record)
    assert message.startswith("motor_speed_2 ")


def test_a_record_made_by_hand_is_checked_once() -> None:
    (checked,) = as_records(flight(drops))
    assert len(messages(checked)) == 1
    (again,) = as_records(checked)
    assert again is checked
    assert "channels_disagree" in {finding.kind for finding in inspect(flight(drops)).findings}
