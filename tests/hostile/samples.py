"""A small sound file of every format that is read, for the tests that damage them."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import struct
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType

import numpy as np
import pytest
from tests.hostile.damage import Sample

COUNT = 60
STEP_S = 0.004
RATE = np.sin(0.3 * np.arange(COUNT))


def ulog() -> Sample:
    """Torque set-points and rates as PX4 logs them, with parameters and a text message between them."""

    def message(letter: str, payload: bytes) -> bytes:
        return struct.pack("<HB", len(payload), ord(letter)) + payload

    torque = b"vehicle_torque_setpoint:uint64_t timestamp;uint64_t timestamp_sample;float[3] xyz;uint8_t[4] _padding0;"
    rates = b"vehicle_angular_velocity:uint64_t timestamp;uint64_t timestamp_sample;float[3] xyz;"
    parts = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1000), message("B", bytes(40))]
    parts += [message("I", b"\x0echar[3] sysnamPX4"), message("P", b"\x0ffloat MC_YAW_P" + struct.pack("<f", 2.8))]
    parts += [message("F", torque), message("F", rates)]
    parts += [message("A", b"\0\0\0vehicle_torque_setpoint"), message("A", b"\0\1\0vehicle_angular_velocity")]
    for k in range(COUNT):
        stamps = struct.pack("<QQ", 4000 * k + 10_000, 4000 * k + 9_000)
        parts.append(message("D", b"\0\0" + stamps + struct.pack("<3f", RATE[k], 0, 0) + bytes(4)))
        parts.append(message("D", b"\1\0" + stamps + struct.pack("<3f", 0, RATE[k], 0)))
    parts.append(message("L", b"6" + struct.pack("<Q", 300_000) + b"disarmed"))
    return Sample(name="flight.ulg", content=b"".join(parts))


def dataflash() -> Sample:
    """Rates, sensors and parameters as ArduPilot logs them."""

    def definition(number: int, length: int, name: bytes, letters: bytes, columns: bytes) -> bytes:
        return b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", number, length, name, letters, columns)

    parts = [
        definition(128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns"),
        definition(1, 43, b"RATE", b"Qffffffff", b"TimeUS,RDes,R,ROut,PDes,P,POut,YDes,Y"),
        definition(2, 36, b"IMU", b"QBffffff", b"TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
        definition(3, 31, b"PARM", b"QNf", b"TimeUS,Name,Value"),
        b"\xa3\x95\x03" + struct.pack("<Q16sf", 0, b"LOG_BITMASK", 176126.0),
    ]
    for k in range(COUNT):
        parts.append(b"\xa3\x95\x01" + struct.pack("<Q8f", 4000 * k, 0, RATE[k], 0.1, 0, 0, 0, 0, 0))
        parts.append(b"\xa3\x95\x02" + struct.pack("<QB6f", 4000 * k, 0, RATE[k], 0, 0, 0, 0, -9.81))
    return Sample(name="flight.bin", content=b"".join(parts))


def blackbox() -> Sample:
    """A flight of a Betaflight quadrotor, without a checksum, as the format has none."""
    from tests.hostile.test_blackbox_damage import LOG

    return Sample(name="flight.bbl", content=LOG)


def crazyflie() -> Sample:
    """A uSD log with its checksum."""
    from tests.hostile.test_crazyflie_damage import LOG

    return Sample(name="log00", content=LOG)


def tlog() -> Sample:
    """Telemetry of attitudes."""
    from tests.hostile.test_tlog_damage import INTACT

    return Sample(name="flight.tlog", content=INTACT)


def bag(container: str) -> Sample:
    """A ROS 1 bag, a ROS 2 database or an MCAP file with one topic."""
    pytest.importorskip("rosbags", reason="the extra [ros] is not installed")
    from tests.hostile.test_rosbag_damage import intact_bag

    with TemporaryDirectory() as folder:
        return Sample(name="flight.bag", content=intact_bag(Path(folder), container))


def mat() -> Sample:
    """A MATLAB file of version 5, compressed as MATLAB does it, with a struct."""
    from scipy.io import savemat

    buffer = io.BytesIO()
    content = {"time": STEP_S * np.arange(COUNT), "q": RATE, "s": {"a": 1.0, "b": "text", "c": [1.0, "two"]}}
    savemat(buffer, content, do_compression=False)
    return Sample(name="flight.mat", content=buffer.getvalue())


def hdf5() -> Sample:
    """An HDF5 file, as which MATLAB writes version 7.3."""
    h5py = pytest.importorskip("h5py", reason="the extra [hdf5] is not installed")
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        file["time"], file["q"] = STEP_S * np.arange(COUNT), RATE
        file.create_dataset("s/a", data=RATE, compression="gzip", fletcher32=True)
    return Sample(name="flight.mat", content=buffer.getvalue())


def npz(*, compressed: bool) -> Sample:
    """A NumPy archive; uncompressed, a flipped bit stands in a header or in a value."""
    buffer = io.BytesIO()
    save = np.savez_compressed if compressed else np.savez
    save(buffer, time=STEP_S * np.arange(COUNT), q=RATE)
    return Sample(name="flight.npz", content=buffer.getvalue())


def parquet() -> Sample:
    """A Parquet table with checksums of its pages."""
    arrow = pytest.importorskip("pyarrow", reason="the extra [parquet] is not installed")
    writer = pytest.importorskip("pyarrow.parquet", reason="the extra [parquet] is not installed")
    buffer = io.BytesIO()
    table = arrow.table({"time [s]": STEP_S * np.arange(COUNT), "q [rad/s]": RATE})
    writer.write_table(table, buffer, write_page_checksum=True)
    return Sample(name="flight.parquet", content=buffer.getvalue())


def csv() -> Sample:
    """A table in text."""
    rows = "".join(f"{STEP_S * k:.3f},{RATE[k]:.7g},{-RATE[k]:.7g}\n" for k in range(COUNT))
    return Sample(name="flight.csv", content=f"time [s],q [rad/s],pitch_command [1]\n{rows}".encode())


def folder() -> Sample:
    """A folder of ulog2csv files, of which one is damaged."""
    rows = "".join(f"{4000 * k + 10_000},{RATE[k]:.7g},0,0\n" for k in range(COUNT))
    text = f"timestamp,xyz[0],xyz[1],xyz[2]\n{rows}".encode()
    names = [f"flight/log_{topic}_0.csv" for topic in ("vehicle_torque_setpoint", "vehicle_angular_velocity")]
    return Sample(name=names[0], content=text, beside={names[1]: text}, read="flight")


def packed(pack: Callable[[bytes], bytes], suffix: str) -> Sample:
    """The table in text, compressed."""
    return Sample(name=f"flight.csv.{suffix}", content=pack(csv().content))


def zipped(content: bytes) -> bytes:
    """A zip archive of one file."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("flight.csv", content)
    return buffer.getvalue()


MAPPING = b"""# the rig of 2026
[clock]
time = { source = "t", unit = "ms" }
[channels.q]
source = "gyro"
unit = "deg/s"
scale = -1.0
[channels.pitch_command]
source = "u"
time = "t"
time_unit = "ms"
[segments]
use = [{ start_s = 0.01, stop_s = 0.05, axis = "pitch", kind = "sweep" }, { start_sample = 3, stop_sample = 9 }]
"""


def mapping() -> Sample:
    """A mapping, damaged, next to a sound table."""
    table = "t,gyro,u\n" + "".join(f"{4 * k},{RATE[k]:.7g},{k % 3}\n" for k in range(COUNT))
    return Sample(
        name="map.toml", content=MAPPING, beside={"foreign.csv": table.encode()}, read="foreign.csv", mapping="map.toml"
    )


SAMPLES: Mapping[str, Callable[[], Sample]] = MappingProxyType(
    {
        "ULog": ulog,
        "DataFlash": dataflash,
        "blackbox": blackbox,
        "Crazyflie": crazyflie,
        "tlog": tlog,
        "ROS 1": lambda: bag("ros1"),
        "ROS 2 sqlite": lambda: bag("sqlite"),
        "MCAP": lambda: bag("mcap"),
        "MAT v5": mat,
        "HDF5": hdf5,
        "NPZ": lambda: npz(compressed=False),
        "NPZ compressed": lambda: npz(compressed=True),
        "Parquet": parquet,
        "CSV": csv,
        "ulog2csv": folder,
        "gzip": lambda: packed(gzip.compress, "gz"),
        "xz": lambda: packed(lzma.compress, "xz"),
        "bzip2": lambda: packed(bz2.compress, "bz2"),
        "zip": lambda: packed(zipped, "zip"),
        "mapping": mapping,
    }
)
"""Every format, and the way to a sound file of it."""
