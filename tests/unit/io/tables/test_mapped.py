"""What a mapping can draw on: other axes, whole vectors, quaternions, several experiments, several files."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

from rotorid.data.record import FlightRecord, places
from rotorid.errors import LogError, UsageError
from rotorid.io.registry import read
from rotorid.io.tables.mapping import parse_mapping
from rotorid.typing import FloatArray

RNG = np.random.default_rng(4)
CLOCK = "[clock]\nsample_rate_hz = 10.0\n"


def through(folder: Path, text: str, sandbox: bool = False, **arrays: FloatArray) -> FlightRecord:
    """A NumPy archive with these arrays, read through a mapping."""
    np.savez(folder / "log.npz", **arrays)
    return read(folder / "log.npz", mapping=parse_mapping(tomllib.loads(text), "map.toml"), sandbox=sandbox)


def rows(record: FlightRecord) -> dict[str, FloatArray]:
    return {channel.name: topic.values[row] for topic in record.topics for row, channel in enumerate(topic.channels)}


VECTORS = {
    "rates": "p q r",
    "body_velocity": "u v w",
    "specific_force": "ax ay az",
    "angular_acceleration": "p_dot q_dot r_dot",
    "body_acceleration": "u_dot v_dot w_dot",
    "rates_setpoint": "p_setpoint q_setpoint r_setpoint",
    "body_velocity_setpoint": "u_setpoint v_setpoint w_setpoint",
    "position": "north east down",
    "velocity": "velocity_north velocity_east velocity_down",
    "position_setpoint": "north_setpoint east_setpoint down_setpoint",
    "velocity_setpoint": "velocity_north_setpoint velocity_east_setpoint velocity_down_setpoint",
}
EARTH = ("position", "velocity", "position_setpoint", "velocity_setpoint")


@pytest.mark.parametrize("by", ["row", "column"])
@pytest.mark.parametrize("name", VECTORS)
def test_vectors_are_turned(tmp_path: Path, name: str, by: str) -> None:
    x, y, z = data = RNG.normal(size=(3, 5))
    text = f'frame = "FLU"\nworld = "ENU"\n{CLOCK}[vectors.{name}]\nsource = "m"\nby = "{by}"\n'
    found = rows(through(tmp_path, text, m=data if by == "row" else data.T))
    expected = (y, x, -z) if name in EARTH else (x, -y, -z)
    assert list(found) == VECTORS[name].split()
    for values, truth in zip(found.values(), expected, strict=True):
        np.testing.assert_array_equal(values, truth)


def test_a_vector_of_variables_keeps_its_unit_scale_and_clock(tmp_path: Path) -> None:
    text = '[vectors.rates]\nsources = ["a", "b", "c"]\nunit = "deg/s"\nscale = 0.5\ntime = "t"\ntime_unit = "ms"\n'
    record = through(tmp_path, text, a=np.array([360.0]), b=np.array([2.0]), c=np.array([4.0]), t=np.array([1500.0]))
    assert record.topics[0].time_s.tolist() == [1.5]
    np.testing.assert_allclose(record.topics[0].values[:, 0], np.deg2rad([180.0, 1.0, 2.0]), rtol=1e-15)


def test_a_channel_is_its_own_component_and_a_command_is_no_vector(tmp_path: Path) -> None:
    names = ("pitch_command", "p", "q", "az", "velocity_east", "down", "w_setpoint")
    text = f'frame = "FLU"\nworld = "ENU"\n{CLOCK}' + "".join(f'[channels.{n}]\nsource = "{n}"\n' for n in names)
    found = rows(through(tmp_path, text, **{name: np.array([2.0]) for name in names}))
    signs = {name: float(values[0]) / 2.0 for name, values in found.items()}
    assert signs == {
        "pitch_command": 1.0,
        "p": 1.0,
        "q": -1.0,
        "az": -1.0,
        "velocity_east": 1.0,
        "down": -1.0,
        "w_setpoint": -1.0,
    }


@pytest.mark.parametrize("world", ["ENU", "NWU"])
def test_west_is_not_east(tmp_path: Path, world: str) -> None:
    text = f'world = "{world}"\n{CLOCK}[channels.velocity_east]\nsource = "v"\n'
    sign = {"ENU": 1.0, "NWU": -1.0}[world]
    assert rows(through(tmp_path, text, v=np.array([3.0])))["velocity_east"].tolist() == [3.0 * sign]


def test_a_table_may_have_other_axes_than_the_file(tmp_path: Path) -> None:
    text = f'frame = "FLU"\n{CLOCK}[channels.q]\nsource = "v"\n[channels.r]\nsource = "v"\nframe = "FRD"\n'
    found = rows(through(tmp_path, text, v=np.array([3.0])))
    assert (found["q"].tolist(), found["r"].tolist()) == ([-3.0], [3.0])


def test_angles_are_turned_in_their_own_unit(tmp_path: Path) -> None:
    text = (
        f'frame = "FLU"\nworld = "ENU"\n{CLOCK}[vectors.attitude]\nsources = ["a", "b", "c"]\nunit = "deg"\n'
        '[channels.psi_setpoint]\nsource = "d"\nunit = "deg"\nscale = -1.0\noffset = 5.0\n'
    )
    values = {"a": np.array([10.0]), "b": np.array([20.0]), "c": np.array([30.0]), "d": np.array([-35.0])}
    found = {name: np.rad2deg(row[0]) for name, row in rows(through(tmp_path, text, **values)).items()}
    # The set-point: -(−35° + 5°) = 30° from east to the left is 60° from north to the right.
    assert found == pytest.approx({"phi": 10.0, "theta": -20.0, "psi": 60.0, "psi_setpoint": 60.0}, abs=1e-12)


@pytest.mark.parametrize(("frame", "world", "yaw"), [("FRD", "NED", 0.7), ("FLU", "ENU", np.pi / 2 - 0.7 - 3.0)])
def test_a_quaternion_becomes_angles(tmp_path: Path, frame: str, world: str, yaw: float) -> None:
    # About the third axis by 0.7 rad, and by 3.7 rad in the other frame, where the answer must stay within half a turn.
    turn = 0.7 if frame == "FRD" else 3.7
    half = np.full(4, 0.5 * turn)
    zero = np.zeros(4)
    text = f'frame = "{frame}"\nworld = "{world}"\n{CLOCK}[vectors.quaternion]\nsources = ["w", "x", "y", "z"]\n'
    found = rows(through(tmp_path, text, w=np.cos(half), x=zero, y=zero, z=np.sin(half)))
    assert list(found) == ["phi", "theta", "psi"]
    np.testing.assert_allclose(found["psi"], yaw, atol=1e-15)
    np.testing.assert_allclose([found["phi"], found["theta"]], 0.0, atol=1e-15)


def test_a_quaternion_may_have_a_clock_of_its_own(tmp_path: Path) -> None:
    text = f'{CLOCK}[channels.q]\nsource = "g"\n[vectors.quaternion]\nsource = "m"\nby = "column"\ntime = "t"\n'
    still = np.tile([1.0, 0.0, 0.0, 0.0], (2, 1))
    record = through(tmp_path, text, g=np.zeros(7), m=still, t=np.array([3.0, 4.0]))
    assert [(topic.name, topic.values.shape) for topic in record.topics] == [("clock", (1, 7)), ("t", (3, 2))]


def test_people_know_a_table_by_its_columns(tmp_path: Path) -> None:
    motors = "".join(f'[channels.motor_{n}]\nsource = "m{n}"\n' for n in range(1, 5))
    text = f'{CLOCK}[channels.u]\nsource = "vx"\n[channels.v]\nsource = "vy"\n{motors}'
    record = through(tmp_path, text, **{name: np.zeros(7) for name in ("vx", "vy", "m1", "m2", "m3", "m4")})
    assert places(next(record.holding(f"motor_{n}")) for n in range(1, 5)) == "m1 to m4"
    assert places(next(record.holding(name)) for name in ("u", "v")) == "vx, vy"


def test_a_quaternion_that_is_none_is_refused(tmp_path: Path) -> None:
    text = f'{CLOCK}[vectors.quaternion]\nsources = ["w", "x", "y", "z"]\n'
    parts = {name: np.array([1.0, 0.0]) for name in "wxyz"}
    with pytest.raises(LogError, match="sample 2 of the quaternion is zero"):
        through(tmp_path, text, **parts)
    with pytest.raises(LogError, match="have 2, 2, 2, 3 samples"):
        through(tmp_path, text, **(parts | {"z": np.ones(3)}))


def test_pulses_become_parts_of_their_range(tmp_path: Path) -> None:
    text = f'{CLOCK}[channels.motor_1]\nsource = "us"\noffset = -1000.0\nscale = 0.1\nunit = "%"\n'
    assert rows(through(tmp_path, text, us=np.array([1000.0, 1500.0])))["motor_1"].tolist() == [0.0, 0.5]


def test_a_name_of_ones_own_is_brought_to_si(tmp_path: Path) -> None:
    text = f'{CLOCK}[channels.baro]\nsource = "b"\nunit = "cm"\n'
    record = through(tmp_path, text, b=np.array([250.0]))
    (channel,) = record.topics[0].channels
    assert (channel.name, channel.unit, record.topics[0].values.tolist()) == ("baro", "m", [[2.5]])


EXPERIMENTS = '[experiments]\nnames = ["a", "b"]\nspacing_s = 60.0\n[channels.q]\nsource = "{experiment}_gyro"\n'


def test_experiments_follow_each_other(tmp_path: Path) -> None:
    text = CLOCK + EXPERIMENTS + '[segments]\nuse = [{axis = "pitch", kind = "random_binary"}]'
    record = through(tmp_path, text, a_gyro=np.array([1.0, 2.0, 3.0]), b_gyro=np.array([4.0, 5.0]))
    (topic,) = record.topics
    np.testing.assert_allclose(topic.time_s, [0.0, 0.1, 0.2, 60.0, 60.1], rtol=1e-15)
    assert topic.values.tolist() == [[1.0, 2.0, 3.0, 4.0, 5.0]]
    # A segment without an interval is each whole experiment.
    assert [(m.kind, m.start_s, m.stop_s) for m in record.declared] == [
        ("random_binary", 0.0, 0.2),
        ("random_binary", 60.0, 60.1),
    ]


def test_a_segment_with_a_kind_is_declared_and_a_bare_one_given(tmp_path: Path) -> None:
    items = '{kind = "sweep", stop_s = 0.2, start_s = 0, band_rad_s = [1, 20]}, {start_sample = 1, stop_sample = 4}'
    text = f'{CLOCK}[channels.roll_command]\nsource = "a"\n[segments]\nuse = [{items}]'
    sweep, bare = through(tmp_path, text, a=np.zeros(5)).declared
    assert (sweep.origin, sweep.kind, sweep.band_rad_s, sweep.signal) == (
        "declared",
        "sweep",
        (1.0, 20.0),
        "roll_command",
    )
    assert (bare.origin, bare.kind, bare.start_s, bare.stop_s) == ("given", "other", 0.1, 0.4)


def test_experiments_with_stamps_that_go_on_keep_them(tmp_path: Path) -> None:
    text = (
        '[clock]\ntime = { source = "{experiment}_t" }\n'
        + EXPERIMENTS.replace("spacing_s = 60.0\n", "")
        + '[vectors.quaternion]\nsource = "{experiment}_att"\ntime = "{experiment}_ta"\n'
    )
    one = np.array([[1.0], [0.0], [0.0], [0.0]])
    arrays = {f"{name}_{kind}": np.array([place]) for place, name in ((5.0, "a"), (9.0, "b")) for kind in ("t", "ta")}
    arrays |= {f"{name}_gyro": np.array([1.0]) for name in "ab"} | {f"{name}_att": one for name in "ab"}
    record = through(tmp_path, text, **arrays)
    assert [topic.time_s.tolist() for topic in record.topics] == [[5.0, 9.0], [5.0, 9.0]]


def test_experiments_must_not_overlap(tmp_path: Path) -> None:
    text = CLOCK + EXPERIMENTS.replace("60.0", "0.1")
    with pytest.raises(UsageError, match=r"experiment 2 begins at 0.1 s.*ends at 0.2 s.*spacing_s = 11 or more"):
        through(tmp_path, text, a_gyro=np.zeros(3), b_gyro=np.zeros(3))


def test_a_whole_record_of_one_sample_is_no_segment(tmp_path: Path) -> None:
    text = CLOCK + '[channels.pitch_command]\nsource = "a"\n[segments]\nuse = [{}]'
    with pytest.raises(LogError, match="a segment goes from 0 s to 0 s"):
        through(tmp_path, text, a=np.zeros(1))


TWO = CLOCK + '[channels.pitch_command]\nsource = "u"\n[channels.q]\nsource = "y"\nfile = "{}"\n'


def test_channels_may_stand_in_another_file_of_another_format(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "y.csv").write_text("x,y\n0,5\n0,6\n")
    record = through(tmp_path, TWO.format("out/y.csv"), u=np.array([1.0, 2.0]))
    (topic,) = record.topics
    assert topic.values.tolist() == [[1.0, 2.0], [5.0, 6.0]]
    assert [channel.source for channel in topic.channels] == ["u", "out/y.csv:y"]
    assert (record.source.name, record.source.format) == ("log.npz", "NumPy archive")
    (tmp_path / "out" / "y.csv").write_text("x,y\n0,5\n0,7\n")
    changed = through(tmp_path, TWO.format("out/y.csv"), u=np.array([1.0, 2.0]))
    assert changed.source.sha256 != record.source.sha256


def test_another_file_may_have_another_length_and_clock(tmp_path: Path) -> None:
    (tmp_path / "y.csv").write_text("t,y\n7,5\n8,6\n9,7\n")
    text = TWO.format("y.csv") + 'time = "t"\n'
    record = through(tmp_path, text, u=np.array([1.0, 2.0]))
    assert [(topic.name, topic.time_s.tolist()) for topic in record.topics] == [
        ("clock", [0.0, 0.1]),
        ("t", [7.0, 8.0, 9.0]),
    ]


def test_a_file_with_stamps_of_its_own_needs_no_common_clock(tmp_path: Path) -> None:
    """Motion capture next to an IMU: each file calls its stamps by a name of its own."""
    (tmp_path / "capture.csv").write_text("time,x,y,z,w,i,j,k\n7,1,2,3,1,0,0,0\n8,1,2,3,1,0,0,0\n")
    text = """world = "ENU"
        frame = "FLU"
        clock = "t [ms]"
        channels.ax = "a [mg]"
        vectors.position = { sources = ["x", "y", "z"], file = "capture.csv", time = "time" }
        vectors.quaternion = { sources = ["w", "i", "j", "k"], file = "capture.csv", time = "time" }
    """
    record = through(tmp_path, text, t=np.array([0.0, 5.0, 10.0]), a=np.array([0.0, 1000.0, 0.0]))
    imu, capture = record.topics
    assert (imu.time_s.tolist(), imu.values.tolist()) == ([0.0, 0.005, 0.01], [[0.0, 9.80665, 0.0]])
    assert capture.time_s.tolist() == [7.0, 8.0]
    assert capture.values[:3, 0].tolist() == [2.0, 1.0, -3.0]


def test_a_channel_may_be_a_weighted_sum(tmp_path: Path) -> None:
    """Axis commands of motor commands, eq. 6 of the Hummingbird's paper, in shares of 200 counts."""
    text = CLOCK + "[channels]\npitch_command = { sum = { n1 = 0.5, n3 = -0.5 }, scale = 0.005 }\n"
    record = through(tmp_path, text, n1=np.array([110.0, 90.0]), n3=np.array([90.0, 100.0]))
    (topic,) = record.topics
    assert topic.values.tolist() == [[0.05, -0.025]]
    assert topic.channels[0].source == "0.5 n1 - 0.5 n3"


def test_a_sum_of_columns_takes_their_unit(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("t,n1 [%],n3 [%],n4\n0,60,40,1\n1,70,40,1\n")
    (tmp_path / "map.toml").write_text('clock = "t"\nchannels.pitch_command.sum = { n1 = 0.5, n3 = -0.5 }\n')
    record = read(tmp_path / "log.csv", mapping=tmp_path / "map.toml")
    assert record.topics[0].values.tolist() == [[0.1, 0.15]]
    (tmp_path / "map.toml").write_text('clock = "t"\nchannels.pitch_command.sum = { n1 = 0.5, n4 = -0.5 }\n')
    with pytest.raises(UsageError, match=r"adds up 0.5 n1 - 0.5 n4, in %, no unit; expected one unit"):
        read(tmp_path / "log.csv", mapping=tmp_path / "map.toml")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("sum = { a = 1.0, c = 1.0 }", "no 'c'"),
        ("sum = { a = 1.0, b = 1.0 }", "the parts of 1 a [+] 1 b have 2, 3 samples"),
        ('sum = { a = 1.0 }, source = "a"', "`source` and `sum`; expected one of them"),
        ("sum = {}", "an empty `sum`"),
        ('sum = { a = "x" }', "`sum` has `a` = 'x'; expected a finite number"),
    ],
)
def test_a_sum_that_is_none_is_refused(tmp_path: Path, words: str, message: str) -> None:
    with pytest.raises((UsageError, LogError), match=message):
        through(tmp_path, CLOCK + f"[channels]\nq = {{ {words} }}\n", a=np.zeros(2), b=np.zeros(3))


def test_a_link_cannot_lead_out_of_the_folder(tmp_path: Path) -> None:
    (tmp_path / "secret.csv").write_text("y,z\n1,2\n")
    folder = tmp_path / "logs"
    folder.mkdir()
    try:
        (folder / "y.csv").symlink_to(tmp_path / "secret.csv")
    except OSError:
        pytest.skip("links cannot be made here")
    with pytest.raises(UsageError, match="is outside the folder"):
        through(folder, TWO.format("y.csv"), u=np.zeros(1))


def test_a_missing_other_file_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"y\.csv cannot be opened"):
        through(tmp_path, TWO.format("y.csv"), u=np.zeros(1))


@pytest.mark.parametrize("suffix", ["csv", "npz", "parquet"])
def test_every_format_is_turned(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"log.{suffix}"
    if suffix == "csv":
        path.write_text("a,b\n2,3\n")
    elif suffix == "npz":
        np.savez(path, a=np.array([2.0]), b=np.array([3.0]))
    else:
        pyarrow = pytest.importorskip("pyarrow")
        from pyarrow import parquet

        parquet.write_table(pyarrow.table({"a": [2.0], "b": [3.0]}), path)
    text = f'frame = "FLU"\n{CLOCK}[channels.p]\nsource = "a"\n[channels.q]\nsource = "b"\n'
    record = read(path, mapping=parse_mapping(tomllib.loads(text)), sandbox=False)
    assert record.topics[0].values.tolist() == [[2.0], [-3.0]]
