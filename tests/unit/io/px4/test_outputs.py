"""Motors from the outputs of PX4's drivers: which they are, in which units, and what is said where that is unknown."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from tests.unit.io.px4.test_log import message, read, spread, stamps, ulog

from rotorid.autopilots.advice import motor_advice, unread_words
from rotorid.autopilots.thrust import expo_share
from rotorid.data.record import FlightRecord, Source
from rotorid.io.px4 import log as px4
from rotorid.io.registry import read as read_log

QUAD = {"SYS_AUTOSTART": 4001.0}
PULSES = {**QUAD, "PWM_MIN": 1100.0, "PWM_MAX": 1900.0}
DEMANDS = np.array([[0.0, 0.25, 0.5, 0.75], [0.1, 0.3, 0.6, 0.9], [0.2, 0.2, 0.4, 1.0]])
"""Of four motors in three samples."""


def outputs_of(values: np.ndarray, used: int = 4) -> dict[str, list[float]]:
    """The topic as its driver logs it: motors first, the rest of sixteen outputs at zero."""
    fields = {f"output[{index}]": list(values[:, index]) for index in range(values.shape[1])}
    rest = {f"output[{index}]": [0.0] * len(values) for index in range(values.shape[1], 16)}
    return {"timestamp": stamps(len(values), 50_000), "noutputs": [float(used)] * len(values), **fields, **rest}


def motors_of(record: FlightRecord) -> np.ndarray:
    (topic,) = (topic for topic in record.topics if topic.row("motor_1") is not None)
    names = [channel.name for channel in topic.channels]
    assert names == [f"motor_{number}" for number in range(1, len(names) + 1)]
    return topic.values.T


def pulses(low: float = 1100.0, high: float = 1900.0) -> np.ndarray:
    return low + (high - low) * DEMANDS


@pytest.mark.parametrize(
    ("parameters", "values"),
    [
        pytest.param(PULSES, pulses(), id="pulses of all outputs"),
        pytest.param({**QUAD, "PWM_MAIN_MIN": 1100.0, "PWM_MAIN_MAX": 1900.0}, pulses(), id="pulses of the bank"),
        pytest.param(
            {**PULSES, "PWM_MIN": 1000.0, **{f"PWM_MAIN_MIN{n}": 1100.0 for n in range(1, 5)}, "PWM_MAIN_MAX2": -1.0},
            pulses(),
            id="pulses of each output; -1 is the limit of all",
        ),
        pytest.param(QUAD, DEMANDS, id="shares"),
        pytest.param({"MAV_TYPE": 2.0}, 2.0 * DEMANDS - 1.0, id="shares of both signs"),
        pytest.param({**QUAD, "DSHOT_CONFIG": 600.0, "DSHOT_MIN": 0.1}, 199.9 + (1999.0 - 199.9) * DEMANDS, id="DShot"),
        pytest.param(QUAD, 8191.0 * DEMANDS, id="CAN"),
        pytest.param(
            {**PULSES, "THR_MDL_FAC": 0.4},
            1100.0 + 800.0 * expo_share(DEMANDS, 0.4),
            id="the curve of the motors is undone again",
        ),
    ],
)
def test_motors_are_demands_from_0_to_1(tmp_path: Path, parameters: dict[str, float], values: np.ndarray) -> None:
    record = read(tmp_path, {"actuator_outputs": outputs_of(values)}, parameters)

    np.testing.assert_allclose(motors_of(record), DEMANDS, atol=2e-6)
    assert not [finding for finding in record.findings if finding.where == "actuator_outputs"]
    assert record.unread == ()


def test_a_motor_that_is_held_still_has_no_output(tmp_path: Path) -> None:
    record = read(tmp_path, {"actuator_outputs": outputs_of(np.full((3, 4), 900.0))}, PULSES)

    assert np.all(motors_of(record) == 0.0)


def test_pulses_without_limits_are_read_with_a_remark(tmp_path: Path) -> None:
    record = read(tmp_path, {"actuator_outputs": outputs_of(pulses(1000.0, 2000.0))}, QUAD)

    np.testing.assert_allclose(motors_of(record), DEMANDS, atol=2e-6)
    (finding,) = (finding for finding in record.findings if finding.where == "actuator_outputs")
    assert "1000 to 2000 µs were assumed" in finding.message


def test_demands_of_newer_firmware_come_first(tmp_path: Path) -> None:
    demands = {f"control[{index}]": list(DEMANDS[:, index]) for index in range(4)}
    topics: dict[str, Mapping[str, list[float]]] = {
        "actuator_outputs": outputs_of(pulses()),
        "actuator_motors": {"timestamp": stamps(3, 10_000), **demands},
    }
    record = read(tmp_path, topics, PULSES)

    assert [topic.name for topic, _ in record.holding("motor_1")] == ["actuator_motors"]


def test_outputs_come_before_controls_which_are_no_motors(tmp_path: Path) -> None:
    controls = spread("control[0] control[1] control[2] control[3]", timestamp=stamps())
    record = read(tmp_path, {"actuator_controls_0": controls, "actuator_outputs": outputs_of(pulses())}, PULSES)

    assert record["motor_1"].topic == "actuator_outputs"
    assert record["roll_command"].topic == "actuator_controls_0"


def test_functions_of_outputs_say_which_motor_they_are(tmp_path: Path) -> None:
    """As of 1.13: motors 1 to 4 on outputs 5, 6, 2, 1 of the second bank."""
    places = (4, 5, 1, 0)
    values = np.zeros((3, 6))
    values[:, places] = pulses()
    functions = {f"PWM_AUX_FUNC{place + 1}": 101.0 + motor for motor, place in enumerate(places)}
    limits = {
        f"PWM_AUX_{end}{place + 1}": value for place in places for end, value in (("MIN", 1100.0), ("MAX", 1900.0))
    }
    record = read(tmp_path, {"actuator_outputs": outputs_of(values)}, {**functions, **limits})

    np.testing.assert_allclose(motors_of(record), DEMANDS, atol=2e-6)


def test_the_second_driver_is_read_where_the_first_moves_no_motor(tmp_path: Path) -> None:
    first, second = outputs_of(np.zeros((3, 4))), outputs_of(pulses())
    names = "".join(f";float {name}" for name in second if name != "timestamp")
    packer = struct.Struct("<HQ" + "f" * (len(second) - 1))
    extra = message("A", struct.pack("<BH", 1, 7) + b"actuator_outputs")
    extra += b"".join(message("D", packer.pack(7, *row)) for row in zip(*second.values(), strict=True))
    assert f"uint64_t timestamp{names}".encode() in ulog({"actuator_outputs": first})

    (tmp_path / "flight.ulg").write_bytes(ulog({"actuator_outputs": first}, PULSES, extra))
    record = px4.read(tmp_path / "flight.ulg", Source(name="flight.ulg", format=px4.FORMAT, sha256=""))

    np.testing.assert_allclose(motors_of(record), DEMANDS, atol=2e-6)
    assert record.unread == ()


def test_outputs_that_are_not_understood_are_not_called_missing(tmp_path: Path) -> None:
    topics = {
        "actuator_outputs": outputs_of(pulses()),
        "vehicle_attitude": spread("q[0] q[1] q[2] q[3]", timestamp=stamps()),
    }
    record = read(tmp_path, topics, {"SYS_AUTOSTART": 13014.0})

    assert "motor_1" not in record
    (unread,) = record.unread
    assert (unread.name, unread.rate_hz) == ("actuator_outputs", pytest.approx(20.0))
    advice = motor_advice(record)
    assert advice.startswith(
        "actuator_outputs is in the log (20 Hz), but rotorid does not read it: which of its outputs"
    )


def test_a_topic_near_to_missing_channels_is_named(tmp_path: Path) -> None:
    topics = {
        "vehicle_imu": spread("delta_angle[0]", timestamp=stamps()),
        "vehicle_attitude": spread("q[0] q[1] q[2] q[3]", timestamp=stamps()),
    }
    record = read(tmp_path, topics)

    assert "are sums over an interval" in unread_words(record.unread, ("q",))
    (finding,) = (finding for finding in record.findings if finding.where == "p")
    assert "vehicle_imu is in the log (250 Hz), but rotorid does not read it" in finding.message


def test_real_outputs_follow_the_controls(unpacked: Callable[[str], Path]) -> None:
    """An X quad of 2016 in its simulator: the mix of its outputs is what the mixer received."""
    record = read_log(unpacked("px4/sample_old_1MB.ulg"))
    topic, _ = next(record.holding("motor_1"))
    motors = topic.values
    mixed = {
        "roll_command": motors.T @ np.array([-1.0, 1.0, 1.0, -1.0]) / 4.0,
        "pitch_command": motors.T @ np.array([1.0, -1.0, 1.0, -1.0]) / 4.0,
        "thrust_command": motors.mean(axis=0),
    }
    for name, mix in mixed.items():
        command = np.interp(topic.time_s, record[name].time_s, record[name].values)
        assert np.corrcoef(command, mix)[0, 1] > 0.8, name
