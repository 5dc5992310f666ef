"""Tables as other programs write them are read as what they say, and messages name the line of the file itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rotorid.data.record import FlightRecord
from rotorid.errors import LogError, UsageError
from rotorid.io.registry import read
from rotorid.io.tables.mapping import parse_mapping

TIME = 0.01 * np.arange(40)
RATE_DEG = 10.0 * np.sin(7.0 * TIME)


def rows(separator: str = ",", form: str = "{:.2f}{}{:.4f}", end: str = "\n", tail: str = "") -> str:
    return "".join(form.format(t, separator, q) + tail + end for t, q in zip(TIME, RATE_DEG, strict=True))


def comma(text: str) -> str:
    return text.replace(".", ",")


def written(folder: Path, content: str | bytes, encoding: str = "utf-8", name: str = "flight.csv") -> Path:
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode(encoding))
    return path


HEADER = "time [s],q [deg/s]\n"
DIALECTS = {
    "byte order mark": "\ufeff" + HEADER + rows(),
    "semicolon and decimal comma": "time [s];q [deg/s]\n" + comma(rows(";")),
    "tab and decimal comma": "time [s]\tq [deg/s]\n" + comma(rows("\t")),
    "quoted decimal comma": HEADER
    + "".join(f'"{comma(f"{t:.2f}")}","{comma(f"{q:.4f}")}"\n' for t, q in zip(TIME, RATE_DEG, strict=True)),
    "units in parentheses": "Time (s),q (deg/s)\n" + rows(),
    "a line of units": "time,q\ns,deg/s\n" + rows(),
    "remarks": "# of the 3rd of May\n# windy\n\n" + HEADER + "# begins\n" + rows() + "# ends\n",
    "a header in a remark": "# flight 3\n# time [s],q [deg/s]\n" + rows(),
    "the separator in the first line": "sep=;\ntime [s];q [deg/s]\n" + comma(rows(";")),
    "ends of lines of Windows": (HEADER + rows()).replace("\n", "\r\n"),
    "a separator behind each row": HEADER + rows(tail=","),
    "spaces": "time_s q [deg/s]\n".replace("q [deg/s]", "q(deg/s)") + rows("   "),
    "an empty column": "time [s],,q [deg/s]\n" + rows(",,"),
    "stamps behind": "q [deg/s],time_ms\n"
    + "".join(f"{q:.4f},{1e3 * t:.0f}\n" for t, q in zip(TIME, RATE_DEG, strict=True)),
}


def check(record: FlightRecord) -> None:
    topic, row = record.topics[0], record.channel_names.index("q")
    np.testing.assert_allclose(topic.time_s, TIME, atol=1e-9)
    np.testing.assert_allclose(topic.values[row], np.radians(RATE_DEG), atol=1e-6)


@pytest.mark.parametrize("name", DIALECTS)
def test_tables_of_other_programs(name: str, tmp_path: Path) -> None:
    check(read(written(tmp_path, DIALECTS[name])))


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le"])
def test_unicode_of_windows(encoding: str, tmp_path: Path) -> None:
    check(read(written(tmp_path, (HEADER + rows()).replace("\n", "\r\n"), encoding)))


@pytest.mark.parametrize("date", ["2026-05-03T23:59:59.{:03d}Z", "2026/05/03 23:59:59.{:03d}", "23:59:59.{:03d}"])
def test_dates_are_seconds_of_the_day(date: str, tmp_path: Path) -> None:
    lines = [f"{date.format(int(1e3 * t))},{q:.4f}" for t, q in zip(TIME, RATE_DEG, strict=True)]
    record = read(written(tmp_path, "timestamp,q [deg/s]\n" + "\n".join(lines)))
    np.testing.assert_allclose(record.topics[0].time_s, 86399.0 + TIME, atol=1e-6)
    over = ["2026-05-03 23:59:59.5,1", "2026-05-04 00:00:00.5,2"]
    record = read(written(tmp_path, "timestamp,q [deg/s]\n" + "\n".join(over)))
    assert record.topics[0].time_s.tolist() == [86399.5, 86400.5]


def test_a_message_names_the_line_of_the_file_itself(tmp_path: Path) -> None:
    text = "# windy\n" + HEADER + rows()
    lines = text.splitlines()
    lines[9] = "0.07,oops"
    with pytest.raises(LogError, match=r"flight.csv, line 10, column 'q \[deg/s\]' is 'oops'"):
        read(written(tmp_path, "\n".join(lines)))


def test_a_long_table_is_read_by_itself(tmp_path: Path) -> None:
    text = "time [s],name,value\n" + "".join(
        f"{t:.2f},q,{np.radians(q):.6f}\n{t:.2f},mode,AUTO\n" + (f"{t + 0.003:.3f},phi,0.1\n" if k % 2 else "")
        for k, (t, q) in enumerate(zip(TIME, RATE_DEG, strict=True))
    )
    record = read(written(tmp_path, text))
    check(record)
    assert record["phi"].time_s.size == 20
    assert {topic.name for topic in record.topics} == {"clock", "clock 2"}


def test_a_long_table_is_read_by_a_mapping(tmp_path: Path) -> None:
    text = "_time;_field;_value\n" + "".join(
        f"{int(1e3 * t)};imu.gy;{q:.4f}\n{int(1e3 * t)};imu.gz;{-q:.4f}\n" for t, q in zip(TIME, RATE_DEG, strict=True)
    )
    document = {
        "clock": {"time": {"source": "_time", "unit": "ms"}},
        "channels": {
            "q": {"source": "imu.gy", "unit": "deg/s"},
            "r": {"source": "imu.gz", "unit": "deg/s", "scale": -1.0},
        },
    }
    record = read(written(tmp_path, text), mapping=parse_mapping(document))
    check(record)
    assert len(record.topics) == 1
    document["channels"] = {"q": {"source": "imu.gyy", "unit": "deg/s"}}
    with pytest.raises(UsageError, match=r"no column 'imu\.gyy'.* did you mean imu\.gy"):
        read(tmp_path / "flight.csv", mapping=parse_mapping(document))


def test_a_long_table_may_have_topics_fields_and_units(tmp_path: Path) -> None:
    text = "t,topic,field,value,unit\n" + "".join(
        f"{t:.2f},imu,q,{q:.4f},deg/s\n{t:.2f},baro,q,{q:.4f},\n" for t, q in zip(TIME, RATE_DEG, strict=True)
    )
    path = written(tmp_path, text)
    check(
        read(path, mapping=parse_mapping({"clock": {"time": {"source": "t"}}, "channels": {"q": {"source": "imu.q"}}}))
    )
    short = text.replace("t,topic,field", "t,tag,name").replace(",imu,q", ",,q").replace(",baro,q", ",,height")
    with pytest.raises(LogError, match=r"first column is 'timestamp'.*write the unit behind the stamps"):
        read(written(tmp_path, short.replace("t,tag", "timestamp,tag")))


def test_a_long_table_with_other_names_lists_them(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="has the columns time, gyro_y, gyro_z"):
        read(written(tmp_path, "time,name,value\n0,gyro_y,1\n0,gyro_z,1\n"))
    with pytest.raises(LogError, match="no row has a number"):
        read(written(tmp_path, "time,name,value\n0,mode,AUTO\n"))


def test_a_column_that_is_empty_in_many_rows_has_stamps_of_its_own(tmp_path: Path) -> None:
    text = "time [s],q [deg/s],phi [deg]\n" + "".join(
        f"{t:.2f},{q:.4f},{'5' if k % 4 == 0 else ('' if k % 2 else 'nan')}\n"
        for k, (t, q) in enumerate(zip(TIME, RATE_DEG, strict=True))
    )
    record = read(written(tmp_path, text))
    check(record)
    np.testing.assert_allclose(record["phi"].time_s, TIME[::4])


def test_a_mapping_may_leave_out_the_unit_that_a_column_carries(tmp_path: Path) -> None:
    path = written(tmp_path, "t [ms],gyro_y [deg/s]\n" + "".join(f"{10 * k},{q:.4f}\n" for k, q in enumerate(RATE_DEG)))
    document = {"clock": {"time": {"source": "t"}}, "channels": {"q": {"source": "gyro_y"}}}
    check(read(path, mapping=parse_mapping(document)))
    document["channels"]["q"]["unit"] = "rad/s"
    with pytest.raises(UsageError, match=r"gives gyro_y the unit 'rad/s', and its column is 'gyro_y \[deg/s\]'"):
        read(path, mapping=parse_mapping(document))


def test_the_mappings_of_known_programs_fit_their_tables(tmp_path: Path) -> None:
    mappings = Path(__file__).resolve().parents[4] / "docs" / "mappings"
    ros = "%time,field.header.seq,field.angular_velocity.x,field.angular_velocity.y,field.angular_velocity.z,"
    ros += "field.linear_acceleration.x,field.linear_acceleration.y,field.linear_acceleration.z\n"
    ros += "".join(f"{1714000000000000000 + 10**7 * k},{k},0.1,0.2,0.3,0,0,9.81\n" for k in range(40))
    record = read(written(tmp_path, ros), mapping=mappings / "rostopic_imu.toml")
    assert [record[name].values[0] for name in ("p", "q", "r", "az")] == [0.1, -0.2, -0.3, -9.81]
    qgc = "Timestamp,roll,pitch,heading,rollRate,pitchRate,yawRate,groundSpeed\n"
    qgc += "".join(f"2026-05-03 10:00:0{k}.000,1,2,180,0,90,0,3\n" for k in range(9))
    record = read(written(tmp_path, qgc), mapping=mappings / "qgroundcontrol.toml")
    assert record["q"].values[0] == pytest.approx(np.pi / 2)
    assert record["q"].time_s.tolist() == [36000.0 + k for k in range(9)]
    client = "Timestamp,gyro.x,gyro.y,gyro.z,acc.x,acc.y,acc.z,motor.m1,motor.m2,motor.m3,motor.m4\n"
    client += "".join(f"{1000 + 10 * k},0,90,0,0,0,1,32768,32768,32768,32768\n" for k in range(40))
    record = read(written(tmp_path, client), mapping=mappings / "crazyflie_client.toml")
    assert record["q"].values[0] == pytest.approx(-np.pi / 2)
    assert record["az"].values[0] == pytest.approx(-9.80665)
    assert record["motor_4"].values[0] == pytest.approx(0.5, abs=1e-4)


@pytest.mark.parametrize(
    ("header", "words"),
    [
        ("__time,/imu/angular_velocity/x", "PlotJuggler"),
        ("%time,field.header.seq,field.angular_velocity.x", "rostopic"),
        ("Timestamp,roll,pitch,rollRate,groundSpeed", "QGroundControl"),
        ("Timestamp,gyro.x,motor.m1", "Crazyflie client"),
        ("t,px,py,pz,qx,imu_gyro_x,motor_motor_m1,motor_motor_m2", "nanobench.toml"),
        ("t,x,y,z,qx,m1_thrust,m1_erpm,ax,ay,az", "idsia_nanodrone.toml"),
        ("Frame,Sub Frame,TX,TY", "Vicon"),
        ("12,FE,1c,1,1,mavlink_attitude_t,time_boot_ms,123,roll,0.1", "tlog"),
        ("CUSTOM.date [local],OSD.pitch", "DJI"),
        ("Objects\n100\nFrame,Sub Frame,TX", "Vicon"),
        ("Format Version,1.23,Take Name,a", "OptiTrack"),
        ("0.1,0.1,3", "has no header: its first line is 0.1, 0.1, 3"),
    ],
)
def test_tables_of_known_programs_are_named(header: str, words: str, tmp_path: Path) -> None:
    numbers = ",".join("1" for _ in header.split(","))
    with pytest.raises(LogError, match=words):
        read(written(tmp_path, f"{header}\n{numbers}\n{numbers}\n"))
