"""ROS bags of three kinds: axes, stamps, types, set-points, mappings, and what is said when nothing fits."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rotorid.autopilots.advice import motor_advice
from rotorid.data.record import FlightRecord, Source
from rotorid.errors import LogError, UsageError
from rotorid.io.ros import bag as rosbag
from rotorid.io.ros import containers as bag_extract
from rotorid.io.ros.bag import RULES
from rotorid.io.tables.mapping import parse_mapping

pytest.importorskip("rosbags", reason="the extra [ros] is not installed")

from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

SOURCE = Source(name="flight.bag", format=rosbag.FORMAT, sha256="")
START_NS = 1_790_000_000 * 10**9
STEP_NS = 5_000_000
DELAY_NS = 2_000_000
CONTAINERS = ("ros1", "sqlite", "mcap")

PX4 = {
    "px4_msgs/msg/VehicleTorqueSetpoint": "uint64 timestamp\nuint64 timestamp_sample\nfloat32[3] xyz\n",
    "px4_msgs/msg/VehicleAttitude": "uint64 timestamp\nuint64 timestamp_sample\nfloat32[4] q\n",
    "px4_msgs/msg/ActuatorMotors": "uint64 timestamp\nfloat32[12] control\n",
}
MAVROS = {
    "mavros_msgs/msg/ActuatorControl": "std_msgs/Header header\nuint8 group_mix\nfloat32[8] controls\n",
    "mavros_msgs/msg/AttitudeTarget": "std_msgs/Header header\nuint8 type_mask\ngeometry_msgs/Quaternion orientation\n"
    "geometry_msgs/Vector3 body_rate\nfloat32 thrust\n",
    "mavros_msgs/msg/ESCTelemetryItem": "std_msgs/Header header\nint32 rpm\n",
    "mavros_msgs/msg/ESCTelemetry": "std_msgs/Header header\nmavros_msgs/ESCTelemetryItem[] esc_telemetry\n",
    "mavros_msgs/msg/RCOut": "std_msgs/Header header\nuint16[] channels\n",
    "mav_msgs/msg/Actuators": "std_msgs/Header header\nfloat64[] angular_velocities\nfloat64[] normalized\n",
}

Make = Callable[[Any, int], Any]
"""A message out of the types of a store and the number of the sample."""


def types_of(container: str) -> Any:
    store = get_typestore(Stores.ROS1_NOETIC if container == "ros1" else Stores.ROS2_HUMBLE)
    for kind, text in (PX4 | MAVROS).items():
        store.register(get_types_from_msg(text, kind))
    return store


def write_bag(folder: Path, container: str, topics: Mapping[str, tuple[str, Make]], count: int = 40) -> Path:
    store, one = types_of(container), container == "ros1"
    if one:
        path = folder / "flight.bag"
        writer: Any = rosbag1.Writer(path)
    else:
        plugin = rosbag2.StoragePlugin.MCAP if container == "mcap" else rosbag2.StoragePlugin.SQLITE3
        path = folder / "flight" / ("flight.mcap" if container == "mcap" else "flight.db3")
        writer = rosbag2.Writer(folder / "flight", version=9, storage_plugin=plugin)
    with writer:
        links = {topic: writer.add_connection(topic, kind, typestore=store) for topic, (kind, _) in topics.items()}
        for k in range(count):
            for topic, (kind, make) in topics.items():
                message = make(store, k)
                data = store.serialize_ros1(message, kind) if one else store.serialize_cdr(message, kind)
                writer.write(links[topic], START_NS + k * STEP_NS + DELAY_NS, bytes(data))
    return path


def header(store: Any, k: int, frame: str = "", *, stamped: bool = True) -> Any:
    stamp_ns = (START_NS + k * STEP_NS) * stamped
    time = store.types["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    kind = store.types["std_msgs/msg/Header"]
    old = {"seq": k} if "seq" in kind.__dataclass_fields__ else {}
    return kind(stamp=time, frame_id=frame, **old)


def vector(store: Any, values: Sequence[float], kind: str = "Vector3") -> Any:
    return store.types[f"geometry_msgs/msg/{kind}"](**dict(zip("xyz", values, strict=True)))


def quaternion(store: Any, phi: float, theta: float, psi: float) -> Any:
    """Yaw, pitch, roll about the axes z, y, x of whatever frames."""
    (cr, cp, cy), (sr, sp, sy) = np.cos([phi / 2, theta / 2, psi / 2]), np.sin([phi / 2, theta / 2, psi / 2])
    return store.types["geometry_msgs/msg/Quaternion"](
        w=cr * cp * cy + sr * sp * sy,
        x=sr * cp * cy - cr * sp * sy,
        y=cr * sp * cy + sr * cp * sy,
        z=cr * cp * sy - sr * sp * cy,
    )


def imu(store: Any, k: int, *, frame: str = "base_link", stamped: bool = True, absent: float = 0.0) -> Any:
    none = np.zeros(9)
    none[0] = absent
    return store.types["sensor_msgs/msg/Imu"](
        header=header(store, k, frame, stamped=stamped),
        orientation=quaternion(store, 0.1, 0.2, 0.3),
        orientation_covariance=none,
        angular_velocity=vector(store, (0.1 * k, 0.2, 0.3)),
        angular_velocity_covariance=np.zeros(9),
        linear_acceleration=vector(store, (0.4, 0.5, 9.81)),
        linear_acceleration_covariance=np.zeros(9),
    )


def pose(store: Any) -> Any:
    return store.types["geometry_msgs/msg/Pose"](
        position=vector(store, (1.0, 2.0, 3.0), "Point"), orientation=quaternion(store, 0.0, 0.2, 0.3)
    )


def twist(store: Any, _: int = 0) -> Any:
    return store.types["geometry_msgs/msg/Twist"](
        linear=vector(store, (1.0, 2.0, 3.0)), angular=vector(store, (0.1, 0.2, 0.3))
    )


def odometry(store: Any, k: int, frame: str = "odom", child: str = "base_link") -> Any:
    kind = store.types
    return kind["nav_msgs/msg/Odometry"](
        header=header(store, k, frame),
        child_frame_id=child,
        pose=kind["geometry_msgs/msg/PoseWithCovariance"](pose=pose(store), covariance=np.zeros(36)),
        twist=kind["geometry_msgs/msg/TwistWithCovariance"](twist=twist(store), covariance=np.zeros(36)),
    )


def number(store: Any, k: int) -> Any:
    return store.types["std_msgs/msg/Float64"](data=float(k))


def read_bag(path: Path, mapping: dict[str, Any] | None = None) -> FlightRecord:
    return rosbag.read(path, SOURCE, None if mapping is None else parse_mapping(mapping), sandbox=False)


def first_values(record: FlightRecord, names: str) -> list[float]:
    found = [next(record.holding(name)) for name in names.split()]
    return [float(topic.values[row, 0]) for topic, row in found]


@pytest.mark.parametrize("container", CONTAINERS)
def test_an_imu_is_turned_and_stands_at_its_own_stamps(tmp_path: Path, container: str) -> None:
    path = write_bag(tmp_path, container, {"/imu/data": ("sensor_msgs/msg/Imu", imu)})
    assert rosbag.sniff(path.read_bytes()[:4096])
    record = read_bag(path)
    topic, row = next(record.holding("p"))
    # Seconds since 1970 in double precision are good to 2⁻²² s.
    np.testing.assert_allclose(topic.time_s, (START_NS + np.arange(40) * STEP_NS) * 1e-9, rtol=0, atol=2.0**-21)
    np.testing.assert_allclose(topic.values[row], 0.1 * np.arange(40), rtol=1e-15)
    np.testing.assert_allclose(first_values(record, "q r ax ay az"), [-0.2, -0.3, 0.4, -0.5, -9.81], rtol=1e-15)
    np.testing.assert_allclose(first_values(record, "phi theta psi"), [0.1, -0.2, np.pi / 2 - 0.3], rtol=1e-12)
    assert record.findings == ()


def test_frames_that_are_down_already_are_left_as_they_are(tmp_path: Path) -> None:
    path = write_bag(tmp_path, "mcap", {"/imu": ("sensor_msgs/msg/Imu", lambda s, k: imu(s, k, frame="base_link_frd"))})
    record = read_bag(path)
    np.testing.assert_allclose(first_values(record, "q az theta psi"), [0.2, 9.81, 0.2, 0.3], rtol=1e-12)


def test_an_orientation_that_the_sensor_does_not_have_is_left_out(tmp_path: Path) -> None:
    path = write_bag(tmp_path, "mcap", {"/imu": ("sensor_msgs/msg/Imu", lambda s, k: imu(s, k, absent=-1.0))})
    assert set(read_bag(path).channel_names) == {"p", "q", "r", "ax", "ay", "az"}


@pytest.mark.parametrize("container", CONTAINERS)
def test_odometry_gives_position_speed_and_attitude(tmp_path: Path, container: str) -> None:
    record = read_bag(write_bag(tmp_path, container, {"/odom": ("nav_msgs/msg/Odometry", odometry)}))
    assert first_values(record, "north east down u v w") == [2.0, 1.0, -3.0, 1.0, -2.0, -3.0]
    np.testing.assert_allclose(first_values(record, "phi theta psi"), [0.0, -0.2, np.pi / 2 - 0.3], atol=1e-12)


def test_an_attitude_between_two_worlds_is_left_out(tmp_path: Path) -> None:
    make = lambda store, k: odometry(store, k, "odom", "base_link_frd")  # noqa: E731
    record = read_bag(write_bag(tmp_path, "mcap", {"/odom": ("nav_msgs/msg/Odometry", make)}))
    assert "phi" not in record.channel_names
    assert first_values(record, "north v") == [2.0, 2.0]


def test_the_name_of_a_topic_tells_a_set_point_from_a_measurement(tmp_path: Path) -> None:
    def stamped(store: Any, k: int) -> Any:
        return store.types["geometry_msgs/msg/TwistStamped"](header=header(store, k), twist=twist(store))

    def posed(store: Any, k: int) -> Any:
        return store.types["geometry_msgs/msg/PoseStamped"](header=header(store, k), pose=pose(store))

    topics = {
        "/cmd_vel": ("geometry_msgs/msg/Twist", twist),
        "/mavros/local_position/velocity_body": ("geometry_msgs/msg/TwistStamped", stamped),
        "/mavros/local_position/velocity_local": ("geometry_msgs/msg/TwistStamped", stamped),
        "/mavros/local_position/pose": ("geometry_msgs/msg/PoseStamped", posed),
        "/mavros/setpoint_position/local": ("geometry_msgs/msg/PoseStamped", posed),
        "/wind": ("geometry_msgs/msg/TwistStamped", stamped),
    }
    record = read_bag(write_bag(tmp_path, "sqlite", topics))
    assert first_values(record, "u v w r u_setpoint r_setpoint") == [1.0, -2.0, -3.0, -0.3, 1.0, -0.3]
    assert first_values(record, "velocity_north velocity_east velocity_down") == [2.0, 1.0, -3.0]
    assert first_values(record, "north north_setpoint") == [2.0, 2.0]
    kinds = {finding.kind: finding for finding in record.findings}
    assert kinds["receive_time"].where == "/cmd_vel"
    assert "/wind (geometry_msgs/msg/TwistStamped)" in kinds["unknown_topic"].message


def test_mavros_commands_and_targets(tmp_path: Path) -> None:
    def controls(store: Any, k: int) -> Any:
        values = np.array([0.25, -0.5, 0.125, 0.75, 0, 0, 0, 0], dtype=np.float32)
        return store.types["mavros_msgs/msg/ActuatorControl"](
            header=header(store, k), group_mix=k % 2, controls=values * (1 - k % 2)
        )

    def target(store: Any, k: int) -> Any:
        return store.types["mavros_msgs/msg/AttitudeTarget"](
            header=header(store, k),
            type_mask=128,
            orientation=quaternion(store, 0.1, 0.2, 0.3),
            body_rate=vector(store, (0.1, 0.2, 0.3)),
            thrust=0.5,
        )

    topics = {
        "/mavros/target_actuator_control": ("mavros_msgs/msg/ActuatorControl", controls),
        "/mavros/setpoint_raw/target_attitude": ("mavros_msgs/msg/AttitudeTarget", target),
    }
    record = read_bag(write_bag(tmp_path, "ros1", topics))
    assert first_values(record, "roll_command pitch_command yaw_command") == [0.25, -0.5, 0.125]
    commands, row = next(record.holding("thrust_command"))
    assert commands.values[row].tolist() == [0.75] * 20
    np.testing.assert_allclose(first_values(record, "p_setpoint q_setpoint r_setpoint"), [0.1, -0.2, -0.3])
    assert "phi_setpoint" not in record.channel_names


def test_px4_topics_keep_their_axes_and_their_own_clock(tmp_path: Path) -> None:
    def torque(store: Any, k: int) -> Any:
        stamp = (START_NS + k * STEP_NS) // 1000
        xyz = np.array([0.25, -0.5, 0.125], dtype=np.float32)
        return store.types["px4_msgs/msg/VehicleTorqueSetpoint"](timestamp=stamp, timestamp_sample=stamp - 9, xyz=xyz)

    def attitude(store: Any, k: int) -> Any:
        stamp = (START_NS + k * STEP_NS) // 1000
        half = np.float32(np.sqrt(0.5))
        q = np.array([half, half, 0.0, 0.0], dtype=np.float32)
        return store.types["px4_msgs/msg/VehicleAttitude"](timestamp=stamp, timestamp_sample=stamp - 1000, q=q)

    def motors(store: Any, k: int) -> Any:
        control = np.full(12, np.nan, dtype=np.float32)
        control[:4] = 0.5
        return store.types["px4_msgs/msg/ActuatorMotors"](timestamp=(START_NS + k * STEP_NS) // 1000, control=control)

    topics = {
        "/fmu/out/vehicle_torque_setpoint": ("px4_msgs/msg/VehicleTorqueSetpoint", torque),
        "/fmu/out/vehicle_attitude": ("px4_msgs/msg/VehicleAttitude", attitude),
        "/fmu/out/actuator_motors": ("px4_msgs/msg/ActuatorMotors", motors),
    }
    record = read_bag(write_bag(tmp_path, "mcap", topics))
    assert first_values(record, "roll_command pitch_command yaw_command") == [0.25, -0.5, 0.125]
    assert first_values(record, "phi theta psi") == pytest.approx([np.pi / 2, 0.0, 0.0], abs=1e-6)
    assert [name for name in record.channel_names if name.startswith("motor_")] == [f"motor_{n}" for n in range(1, 5)]
    command, _ = next(record.holding("roll_command"))
    measured, _ = next(record.holding("phi"))
    # A command is stamped when it is published, a measurement when it was sampled.
    np.testing.assert_allclose(command.time_s - measured.time_s, 1e-3, atol=2.0**-20)


def actuators(speeds: Sequence[float], outputs: Sequence[float]) -> Make:
    return lambda store, k: store.types["mav_msgs/msg/Actuators"](
        header=header(store, k), angular_velocities=np.array(speeds), normalized=np.array(outputs)
    )


def test_speeds_and_outputs_of_motors(tmp_path: Path) -> None:
    def telemetry(store: Any, k: int) -> Any:
        item = store.types["mavros_msgs/msg/ESCTelemetryItem"]
        items = [item(header=header(store, k), rpm=rpm) for rpm in (3000, 6000)]
        return store.types["mavros_msgs/msg/ESCTelemetry"](header=header(store, k), esc_telemetry=items)

    made = {
        "/mavros/esc_telemetry": ("mavros_msgs/msg/ESCTelemetry", telemetry),
        "/uav/command/motors": ("mav_msgs/msg/Actuators", actuators((500.0, 600.0), (0.25, 0.75))),
    }
    record = read_bag(write_bag(tmp_path, "mcap", made))
    assert first_values(record, "motor_1 motor_2") == [0.25, 0.75]
    assert first_values(record, "motor_speed_1 motor_speed_2") == pytest.approx([100 * np.pi, 200 * np.pi])


def test_speeds_that_were_measured_and_those_that_were_asked_for(tmp_path: Path) -> None:
    made = {
        "/uav/motor_speed": ("mav_msgs/msg/Actuators", actuators((500.0, 600.0), ())),
        "/uav/command/motor_speed": ("mav_msgs/msg/Actuators", actuators((1.0, 2.0), ())),
    }
    record = read_bag(write_bag(tmp_path, "ros1", made))
    assert first_values(record, "motor_speed_1 motor_speed_2") == [500.0, 600.0]
    assert "no share of full output" in motor_advice(record)


def test_pulses_without_limits_are_not_called_missing(tmp_path: Path) -> None:
    def pulses(store: Any, k: int) -> Any:
        return store.types["mavros_msgs/msg/RCOut"](header=header(store, k), channels=np.array([1500] * 4, np.uint16))

    made = {"/mavros/rc/out": ("mavros_msgs/msg/RCOut", pulses), "/imu": ("sensor_msgs/msg/Imu", imu)}
    record = read_bag(write_bag(tmp_path, "mcap", made))
    assert motor_advice(record).startswith("/mavros/rc/out is in the log, but rotorid does not read it: bags contain")


def test_a_transform_is_an_attitude_and_a_position(tmp_path: Path) -> None:
    def transform(store: Any, k: int) -> Any:
        kind = store.types
        rotation = quaternion(store, 0.1, 0.2, 0.3)
        inner = kind["geometry_msgs/msg/Transform"](translation=vector(store, (1.0, 2.0, 3.0)), rotation=rotation)
        return kind["geometry_msgs/msg/TransformStamped"](
            header=header(store, k, "world"), child_frame_id="base_link", transform=inner
        )

    record = read_bag(write_bag(tmp_path, "mcap", {"/vicon": ("geometry_msgs/msg/TransformStamped", transform)}))
    assert first_values(record, "north east down") == [2.0, 1.0, -3.0]
    assert first_values(record, "phi theta psi") == pytest.approx([0.1, -0.2, np.pi / 2 - 0.3], abs=1e-9)


def test_a_header_that_nobody_filled_in_is_not_believed(tmp_path: Path) -> None:
    make = lambda store, k: imu(store, k, stamped=False)  # noqa: E731
    record = read_bag(write_bag(tmp_path, "ros1", {"/imu": ("sensor_msgs/msg/Imu", make)}))
    assert [finding.kind for finding in record.findings] == ["receive_time"]
    assert record.start_s == pytest.approx((START_NS + DELAY_NS) * 1e-9, abs=1e-6)


def test_two_clocks_in_one_bag_are_said(tmp_path: Path) -> None:
    def torque(store: Any, k: int) -> Any:
        xyz = np.zeros(3, dtype=np.float32)
        return store.types["px4_msgs/msg/VehicleTorqueSetpoint"](
            timestamp=10**6 + 5000 * k, timestamp_sample=10**6, xyz=xyz
        )

    topics = {
        "/imu": ("sensor_msgs/msg/Imu", imu),
        "/fmu/out/vehicle_torque_setpoint": ("px4_msgs/msg/VehicleTorqueSetpoint", torque),
    }
    record = read_bag(write_bag(tmp_path, "mcap", topics))
    (finding,) = (finding for finding in record.findings if finding.kind == "clock_skew")
    assert finding.numbers["skew_s"] == pytest.approx(START_NS * 1e-9 - 1.0, abs=0.01)


def test_a_plain_number_counts_by_the_name_of_its_topic(tmp_path: Path) -> None:
    topics = {"/rig/pitch_command": ("std_msgs/msg/Float64", number), "/rig/noise": ("std_msgs/msg/Float64", number)}
    record = read_bag(write_bag(tmp_path, "sqlite", topics))
    assert record.channel_names == ("pitch_command",)
    assert record.topics[0].values[0].tolist() == list(range(40))
    with pytest.raises(LogError, match=r"contains /rig/noise \(std_msgs/msg/Float64\).*--map"):
        read_bag(write_bag(tmp_path / "..", "ros1", {"/rig/noise": ("std_msgs/msg/Float64", number)}))


def arrays(store: Any, k: int) -> Any:
    layout = store.types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    return store.types["std_msgs/msg/Float64MultiArray"](layout=layout, data=np.array([1.0, 2.0, float(k)]))


@pytest.mark.parametrize("container", CONTAINERS)
def test_a_mapping_reaches_fields_elements_and_stamps(tmp_path: Path, container: str) -> None:
    topics = {
        "/imu": ("sensor_msgs/msg/Imu", imu),
        "/cmd": ("std_msgs/msg/Float64MultiArray", arrays),
    }
    channels = {
        "p": {"source": "/imu.angular_velocity.x", "time": "/imu.header.stamp"},
        "roll_command": {"source": "/cmd.data", "column": 2, "time": "/cmd.@received", "scale": -1.0},
        "yaw_command": {"source": "/cmd.data[1]", "time": "/cmd.@received"},
    }
    record = read_bag(write_bag(tmp_path, container, topics), {"channels": channels})
    gyro, command = record.topics
    np.testing.assert_allclose(gyro.values[0], 0.1 * np.arange(40), rtol=1e-15)
    np.testing.assert_array_equal(command.values, [-np.arange(40.0), np.full(40, 2.0)])
    np.testing.assert_allclose(command.time_s - gyro.time_s, DELAY_NS * 1e-9, atol=2.0**-20)


@pytest.mark.parametrize(
    ("source", "sentence"),
    [
        ("/imv.angular_velocity.x", "no topic '/imv'.*did you mean /imu"),
        ("/imu.angular_velocity", "no number at 'angular_velocity'.*header, orientation"),
        ("/imu.angular_velocity.q", "no number at 'angular_velocity.q'"),
        ("/imu.header.frame_id", "no number at 'header.frame_id'"),
        ("/imu.__class__.__mro__", "no number at '__class__.__mro__'"),
    ],
)
def test_a_mapping_that_does_not_fit_is_told_so(tmp_path: Path, source: str, sentence: str) -> None:
    path = write_bag(tmp_path, "mcap", {"/imu": ("sensor_msgs/msg/Imu", imu)}, count=3)
    with pytest.raises(UsageError, match=sentence):
        read_bag(path, {"channels": {"p": {"source": source, "time": "/imu.header.stamp"}}})


def test_a_database_without_definitions_falls_back_to_the_standard_ones(tmp_path: Path) -> None:
    import sqlite3

    def torque(store: Any, k: int) -> Any:
        xyz = np.zeros(3, dtype=np.float32)
        return store.types["px4_msgs/msg/VehicleTorqueSetpoint"](timestamp=k, timestamp_sample=k, xyz=xyz)

    topics = {
        "/imu": ("sensor_msgs/msg/Imu", imu),
        "/fmu/out/vehicle_torque_setpoint": ("px4_msgs/msg/VehicleTorqueSetpoint", torque),
    }
    path = write_bag(tmp_path, "sqlite", topics)
    base = sqlite3.connect(path)
    base.execute("DROP TABLE message_definitions")
    base.commit()
    base.close()
    record = read_bag(path)
    assert next(record.holding("p"))[0].time_s.size == 40
    (finding,) = record.findings
    assert (finding.kind, finding.where) == ("missing_channel", "/fmu/out/vehicle_torque_setpoint")


def test_every_rule_names_channels_of_the_vocabulary() -> None:
    from rotorid.data.record import STANDARD_UNITS

    for rule in RULES:
        assert set(rule.channels) <= set(STANDARD_UNITS)
        assert len(rule.fields) == len(rule.channels) or rule.axes in {"attitude", "px4_attitude"}


def test_a_missing_package_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    path = write_bag(tmp_path, "mcap", {"/imu": ("sensor_msgs/msg/Imu", imu)}, count=2)
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    monkeypatch.setitem(sys.modules, "rosbags.serde", None)
    with pytest.raises(LogError, match=r'pip install "rotorid\[ros\]"'):
        bag_extract.extract(path, {"by_kind": {"sensor_msgs/msg/Imu": ["angular_velocity.x"]}, "by_topic": {}})


def test_a_bag_is_read_through_the_sandbox(tmp_path: Path) -> None:
    path = write_bag(tmp_path, "mcap", {"/imu": ("sensor_msgs/msg/Imu", imu)})
    inside, outside = rosbag.read(path, SOURCE), read_bag(path)
    for one, other in zip(inside.topics, outside.topics, strict=True):
        np.testing.assert_array_equal(one.values, other.values)
        np.testing.assert_array_equal(one.time_s, other.time_s)
