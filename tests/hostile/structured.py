"""Hostile logs with a sound structure: every format with stamps, values, counts and names that no vehicle writes.

A file is built by the rules of its format from stamps and values that are hostile, or it is a sound file of which
numbers, lengths and counts are replaced by the extremes of their types, and parts are cut, repeated and put elsewhere.
One seed, one file.
"""

from __future__ import annotations

import bz2
import gzip
import io
import json
import lzma
import random
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import Any

import numpy as np
from tests.hostile.damage import Sample
from tests.hostile.samples import MAPPING, SAMPLES

from rotorid.typing import FloatArray

EXTREMES = (0.0, -0.0, 1.0, -1.0, 1e308, -1e308, 1e-320, 1e30, 2.0**63, -(2.0**63), np.nan, np.inf, -np.inf, 1e9, 0.1)
NAMES = (
    *(
        "p",
        "q",
        "r",
        "phi",
        "roll_command",
        "pitch_command",
        "motor_1",
        "motor_2",
        "az",
        "q_setpoint",
        "battery_voltage",
    ),
    *("theta_setpoint", "roll_excitation", "pitch_stick", "motor_16", "motor_speed_1"),
)
UNITS: Mapping[str, str] = MappingProxyType(
    {"p": "rad/s", "q": "rad/s", "r": "rad/s", "phi": "rad", "az": "m/s^2", "q_setpoint": "rad/s"}
    | {"battery_voltage": "V", "theta_setpoint": "rad", "motor_speed_1": "rad/s"}
)
ODD = (
    "",
    " ",
    "=1+1",
    "@x",
    "\x1b[31mred",
    "\x9b2J",
    "\u202eevil",
    "a" * 5000,
    "../../x",
    "time",
    "p",
    "\0",
    "ä",
    "%s",
    "nan",
    "\u0663.\u0664",
    "\u2460",
    "1\u00b2",
)
HEADER_NUMBERS = (
    *("0", "-1", "1", "1/0", "0/1", "2147483648", "18446744073709551616", "9" * 400, "1e308", "5e-324", "nan", "0x10"),
    *("\u0663\u0664", "\u2460", "", ",", "0,0,0", "255,255,255,255,255", "1" * 5000),
)
"""What may stand in a header in the place of a number, a rate or a list of them."""
ODD_UNITS = (
    "",
    "furlong",
    "1/s",
    "rad/s^9",
    "rad/s" * 900,
    "deg\u00b2",
    "\u0663",
    "%s",
    "[",
    "m/(",
    "1e308 m",
    "ms",
    "us",
)
"""What may stand in the place of a unit."""


def stamps(chance: random.Random) -> FloatArray:
    """Stamps of every kind, in seconds."""
    count = chance.choice([0, 1, 2, 11, 40, 64, 100, 300, 300])
    step = chance.choice([0.0, 1e-9, 1e-6, 0.0025, 0.004, 0.02, 0.5, 3.0, 1e5])
    time_s = step * np.arange(count, dtype=float)
    for _ in range(chance.randint(0, 2)):
        place = chance.randrange(count + 1)
        kind = chance.randrange(11)
        if kind == 0:
            time_s[place:] += chance.choice([0.2, 30.0, 2e5, 1.7e9, 1e13, -1.0, -1e3])
        elif kind == 1:
            time_s = np.repeat(time_s[::2], 2)
        elif kind == 2:
            time_s[:1] = 0.0
            time_s[1:] += 1.7e9
        elif kind == 3:
            time_s = time_s[::-1].copy()
        elif kind == 4:
            time_s[place : place + 1] = chance.choice(EXTREMES)
        elif kind == 5:
            np.random.default_rng(chance.randrange(99)).shuffle(time_s)
        elif kind == 6:
            time_s[1::2] += 1e6
        elif kind == 7:
            time_s = np.floor(time_s / 0.016) * 0.016
        elif kind == 8:
            time_s = time_s + chance.choice([1e12, 2.0**33, -5.0, 1e15])
        elif kind == 9:
            time_s = np.arange(time_s.size) // 10 * 0.1 + np.arange(time_s.size) % 10 * 1e-7
        else:
            time_s[place:] = time_s[place - 1] if count else 0.0
    return time_s


def values(chance: random.Random, time_s: FloatArray) -> FloatArray:
    """A row of samples of every kind."""
    count = time_s.size
    kind = chance.randrange(9)
    index = np.arange(count)
    row = np.sin(0.3 * index)
    if kind == 0:
        return np.full(count, chance.choice(EXTREMES))
    if kind == 1:
        return chance.choice([1e308, 1e200, 3.0]) * np.where(index % 2, 1.0, -1.0)
    if kind == 2:
        row[:: chance.choice([2, 3, 7])] = chance.choice(EXTREMES)
    if kind == 3:
        return np.array([chance.choice(EXTREMES) for _ in range(count)])
    if kind == 4:
        return np.sign(row)
    if kind == 5:
        return np.sin(0.002 * index**2)
    if kind == 6:
        row[count // 2 :] = row[count // 2 - 1] if count else 0.0
    return row


def rows(chance: random.Random) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Stamps, and one to five channels on them."""
    time_s = stamps(chance)
    names = chance.sample(NAMES, chance.randint(1, 5))
    return time_s, {name: values(chance, time_s) for name in names}


def spoiled(chance: random.Random, content: bytes, tokens: Sequence[bytes] = ()) -> bytes:
    """A sound file with up to six of its parts replaced: extremes of all types of numbers, cuts, splices, flips."""
    data = bytearray(content)
    for _ in range(chance.randint(1, 6)):
        if not data:
            break
        # The beginning of most formats holds what all else depends on.
        place = chance.randrange(min(len(data), 200)) if chance.random() < 0.4 else chance.randrange(len(data))
        kind = chance.randrange(7)
        if kind < 3:
            form = chance.choice(["<H", "<I", "<Q", ">H", ">I", ">Q", "<d", "<f", "B"])
            if form[-1] in "df":
                piece = struct.pack(
                    form, _single(chance.choice(EXTREMES)) if form[-1] == "f" else chance.choice(EXTREMES)
                )
            else:
                most = 2 ** (8 * struct.calcsize(form)) - 1
                piece = struct.pack(form, chance.choice([0, 1, 2, most, most // 2, most // 2 + 1, most - 1]))
            data[place : place + len(piece)] = piece
        elif kind == 3:
            del data[place : place + chance.choice([1, 7, 100, 10_000])]
        elif kind == 4:
            part = data[place : place + chance.choice([1, 16, 200])]
            at = chance.randrange(len(data) + 1)
            data[at:at] = part * chance.choice([1, 3, 50])
        elif kind == 5:
            data[place] ^= 1 << chance.randrange(8)
        else:
            piece = chance.choice([*tokens, bytes(16), b"\xff" * 32, chance.randbytes(16)])
            data[place : place + chance.choice([0, len(piece)])] = piece
    return bytes(data)


def _single(value: float) -> float:
    return value if not np.isfinite(value) or abs(value) < 3e38 else np.copysign(3.4e38, value)


def _us(time_s: FloatArray) -> list[int]:
    """Stamps as 64 bits of microseconds, wrapped as a counter does it."""
    return [int(1e6 * stamp) % 2**64 if abs(stamp) < 1e300 else 2**64 - 1 for stamp in time_s.tolist()]


_ULOG_DEFINITIONS = (
    ("F", b"vehicle_torque_setpoint:uint64_t timestamp;float[99999999] xyz;"),
    ("F", b"vehicle_torque_setpoint:uint64_t timestamp;vehicle_torque_setpoint xyz;"),
    ("F", b"vehicle_torque_setpoint:uint64_t timestamp;float[\xd9\xa3] xyz;"),
    ("F", b"vehicle_angular_velocity:float[3] xyz;"),
    ("F", b"vehicle_angular_velocity:uint64_t timestamp;double[3] xyz;char[1000] xyz;"),
    ("F", b"a:b x;"),
    ("F", b"b:a x;a y;"),
    ("A", b"\0\0\0vehicle_angular_velocity"),
    ("A", b"\xff\xff\xffvehicle_torque_setpoint"),
    ("P", b"\x16float IMU_GYRO_RATEMAX" + struct.pack("<f", 1e30)),
    ("P", b"\x16int32_t IMU_GYRO_RATEMAX" + struct.pack("<i", -1)),
    ("Q", b"\1\x0ffloat MC_YAW_P" + struct.pack("<f", 2.8)),
    ("M", b"\0\x10char[9999999] x" + b"A"),
    ("I", b"\x19uint64_t time_ref_utc" + b"\xff" * 8),
    ("Z", bytes(40)),
    ("R", b"\0"),
)
"""Records among the definitions that contradict others, count too much, or are of no known type."""


def ulog(chance: random.Random) -> bytes:
    def message(letter: str, payload: bytes) -> bytes:
        return struct.pack("<HB", min(len(payload), 65535), ord(letter)) + payload[:65535]

    torque = b"vehicle_torque_setpoint:uint64_t timestamp;uint64_t timestamp_sample;float[3] xyz;uint8_t[4] _padding0;"
    rates = b"vehicle_angular_velocity:uint64_t timestamp;uint64_t timestamp_sample;float[3] xyz;"
    odd = chance.choice(ODD).encode()
    parts = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", chance.choice([0, 1000, 2**64 - 1])), message("B", bytes(40))]
    parts += [message("P", b"\x0ffloat MC_YAW_P" + struct.pack("<f", _single(chance.choice(EXTREMES))))]
    parts += [message("I", bytes([min(len(odd) + 9, 255)]) + b"char[3] x" + odd + b"PX4")]
    parts += [message("F", torque), message("F", rates), message("F", odd + b":" + odd + b" x;")]
    parts += [message("A", b"\0\0\0vehicle_torque_setpoint"), message("A", b"\0\1\0vehicle_angular_velocity")]
    for _ in range(chance.choice([0, 0, 1, 2])):
        parts.insert(chance.randrange(1, len(parts) + 1), message(*chance.choice(_ULOG_DEFINITIONS)))
    for number in (0, 1):
        time_s = stamps(chance)
        samples = [values(chance, time_s) for _ in range(3)]
        for stamp, row in zip(_us(time_s), zip(*(one.tolist() for one in samples), strict=True), strict=True):
            data = struct.pack("<HQQ", number, stamp, chance.choice([stamp, 0, 2**64 - 1]))
            parts.append(message("D", data + struct.pack("<3f", *map(_single, row)) + bytes(4 * (1 - number))))
    parts.append(message("L", b"6" + struct.pack("<Q", 300_000) + odd))
    return b"".join(parts)


_DATAFLASH_DEFINITIONS = (
    (b"RATE", b"Q" * 16, b"TimeUS," * 9),
    (b"RATE", b"Qff", b"TimeUS,R"),
    (b"RATE", b"Qf\xd9\xa3f", b"TimeUS,RDes,R,ROut"),
    (b"RATE", b"ffffffff", b"R,R,R,R,R,R,R,R"),
    (b"\xff\xff\xff\xff", b"a" * 16, b"," * 64),
    (b"", b"", b""),
    (b"FMTU", b"QBNN", b"TimeUS,FmtType,UnitIds,MultIds"),
    (b"MULT", b"Qbd", b"TimeUS,Id,Mult"),
    (b"UNIT", b"QbZ", b"TimeUS,Id,Label"),
)


def dataflash(chance: random.Random) -> bytes:
    def definition(number: int, length: int, name: bytes, letters: bytes, columns: bytes) -> bytes:
        return b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", number, length, name, letters, columns)

    odd = chance.choice(ODD).encode()
    parts = [
        definition(128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns"),
        definition(1, 43, b"RATE", b"Qffffffff", b"TimeUS,RDes,R,ROut,PDes,P,POut,YDes,Y"),
        definition(2, 36, b"IMU", b"QBffffff", b"TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
        definition(3, 31, b"PARM", b"QNf", b"TimeUS,Name,Value"),
        definition(4, 76, b"MSG", b"QZ", b"TimeUS,Message"),
        b"\xa3\x95\x03"
        + struct.pack(
            "<Q16sf",
            0,
            chance.choice([b"LOG_BITMASK", b"FRAME_CLASS", b"SCHED_LOOP_RATE", odd[:16]]),
            _single(chance.choice(EXTREMES)),
        ),
        b"\xa3\x95\x04" + struct.pack("<Q64s", 0, b"ArduCopter V" + odd[:40]),
    ]
    if chance.random() < 0.3:
        name, letters, columns = chance.choice(_DATAFLASH_DEFINITIONS)
        length = chance.choice([0, 3, 43, 255])
        parts.insert(
            chance.randrange(len(parts) + 1), definition(chance.choice([1, 2, 9]), length, name, letters, columns)
        )
    time_s = stamps(chance)
    samples = [values(chance, time_s) for _ in range(8)]
    for stamp, row in zip(_us(time_s), zip(*(one.tolist() for one in samples), strict=True), strict=True):
        parts.append(b"\xa3\x95\x01" + struct.pack("<Q8f", stamp, *map(_single, row)))
        parts.append(
            b"\xa3\x95\x02" + struct.pack("<QB6f", stamp, chance.choice([0, 0, 1, 255]), *map(_single, row[:6]))
        )
    return b"".join(parts)


def text_log(chance: random.Random) -> bytes:
    time_s = stamps(chance)
    lines = [
        "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns",
        "FMT, 1, 43, RATE, Qffffffff, TimeUS,RDes,R,ROut,PDes,P,POut,YDes,Y",
        "FMT, 3, 31, PARM, QNf, TimeUS,Name,Value",
        f"PARM, 0, LOG_BITMASK, {chance.choice(EXTREMES)}",
    ]
    row = values(chance, time_s).tolist()
    for stamp, value in zip(_us(time_s), row, strict=True):
        cell = chance.choice([f"{value}", f"{value}", f"{value}", chance.choice(ODD), "9" * 5000, "1e999"])
        lines.append(f"RATE, {stamp}, 0, {cell}, 0.1, 0, {value}, 0, 0, 0")
    return "\n".join(lines).encode("utf-8", "surrogateescape") + b"\n"


def table(chance: random.Random) -> bytes:
    time_s, columns = rows(chance)
    header = ["time [s]", *(f"{name} [{UNITS.get(name, '1')}]" for name in columns)]
    if chance.random() < 0.06:
        header[chance.randrange(len(header))] = chance.choice(ODD)
    if chance.random() < 0.1:
        place = chance.randrange(len(header))
        header[place] = f"{header[place].partition(' ')[0]} [{chance.choice(ODD_UNITS)}]"
    lines = [",".join(header)]
    table_rows = zip(time_s.tolist(), *(row.tolist() for row in columns.values()), strict=True)
    lines += [",".join(repr(cell) for cell in cells) for cells in table_rows]
    if len(lines) > 2 and chance.random() < 0.06:
        lines[chance.randrange(1, len(lines))] = chance.choice([*ODD, "9" * 5000, ",,,", '"', "1e999,1", "0x1,2"])
    return "\n".join(lines).encode() + chance.choice([b"", b"\n", b"\r\n", b"\n\n"])


def _without_what_csv_refuses(chance: random.Random) -> bytes:
    """Tables whose numbers are all finite, which go on to everything behind the reader."""
    content = table(chance)
    return content.replace(b"nan", b"0").replace(b"-inf", b"-1e308").replace(b"inf", b"1e308")


def topics(chance: random.Random) -> dict[str, bytes]:
    found = {}
    for topic in ("vehicle_torque_setpoint", "vehicle_angular_velocity"):
        time_s = stamps(chance)
        samples = [values(chance, time_s) for _ in range(3)]
        lines = ["timestamp,xyz[0],xyz[1],xyz[2]"]
        lines += [
            ",".join([str(stamp), *map(repr, row)])
            for stamp, row in zip(_us(time_s), zip(*(one.tolist() for one in samples), strict=True), strict=True)
        ]
        found[f"flight/log_{topic}_0.csv"] = "\n".join(lines).encode() + b"\n"
    return found


def decoded(chance: random.Random) -> bytes:
    time_s = stamps(chance)
    samples = [values(chance, time_s) for _ in range(3)]
    lines = ["loopIteration, time (us), gyroADC[0] (deg/s), motor[0], rcCommand[0]"]
    for number, (stamp, row) in enumerate(
        zip(_us(time_s), zip(*(s.tolist() for s in samples), strict=True), strict=True)
    ):
        lines.append(f"{number}, {stamp}, {row[0]!r}, {row[1]!r}, {row[2]!r}")
    return "\n".join(lines).encode() + b"\n"


def npz(chance: random.Random) -> bytes:
    time_s, columns = rows(chance)
    buffer = io.BytesIO()
    kind = chance.choice(["<f8", "<f4", ">f8", "<i8", "<u2"])
    with np.errstate(all="ignore"):
        arrays = {name: row.astype(kind) if chance.random() < 0.2 else row for name, row in columns.items()}
    np.savez(buffer, time=chance.choice([*[time_s] * 8, time_s[None], time_s[:, None]]), **arrays)
    return buffer.getvalue()


def mat(chance: random.Random) -> bytes:
    from scipy.io import savemat

    time_s, columns = rows(chance)
    buffer = io.BytesIO()
    savemat(buffer, {"time": time_s, **columns}, do_compression=chance.random() < 0.3)
    return buffer.getvalue()


def hdf5(chance: random.Random) -> bytes:
    import h5py

    time_s, columns = rows(chance)
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        for name, row in {"time": time_s, **columns}.items():
            file[name] = row
    return buffer.getvalue()


def parquet(chance: random.Random) -> bytes:
    import pyarrow
    from pyarrow.parquet import write_table

    time_s, columns = rows(chance)
    named = {f"{name} [{UNITS.get(name, '1')}]": row for name, row in columns.items()}
    buffer = io.BytesIO()
    write_table(pyarrow.table({"time [s]": time_s, **named}), buffer)
    return buffer.getvalue()


def archive(chance: random.Random) -> bytes:
    content = _without_what_csv_refuses(chance)
    kind = chance.randrange(4)
    if kind < 3:
        return (gzip.compress, bz2.compress, lzma.compress)[kind](content)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as packed:
        packed.writestr(chance.choice(["flight.csv", "../flight.csv", "/etc/x", "\x1b[31m.csv"]), content)
    return buffer.getvalue()


def mapping_text(chance: random.Random) -> bytes:
    text = MAPPING.decode()
    for _ in range(chance.randint(1, 3)):
        old = chance.choice(
            ['"t"', '"ms"', '"gyro"', "-1.0", "0.01", "0.05", "3", "9", '"deg/s"', '"sweep"', '"pitch"', "q"]
        )
        new = chance.choice(
            [
                *(repr(number) for number in EXTREMES),
                '""',
                "[]",
                "{}",
                "9" * 400,
                "[" * 100,
                '"\\u001b[31m"',
                "true",
                "1e999",
            ]
        )
        text = text.replace(old, new, chance.choice([1, -1]))
    return text.encode()


def blackbox(chance: random.Random) -> bytes:
    """A flight of which lines of the header are others, twice there, or gone."""
    log = sound("blackbox").content
    body = log.rindex(b"\nH ") + 1
    body = log.index(b"\n", body) + 1
    lines = log[:body].splitlines()
    lines += [
        b"H looptime:500",
        b"H gyro_sync_denom:1",
        b"H rateprof_rates:70,70,70",
        b"H vbatref:420",
        b"H motor_poles:14",
    ]
    for _ in range(chance.randint(1, 4)):
        place = chance.randrange(1, len(lines))
        name, _, value = lines[place].partition(b":")
        kind = chance.randrange(6)
        if kind < 3:
            cells = value.split(b",")
            cells[chance.randrange(len(cells))] = chance.choice(HEADER_NUMBERS).encode()
            lines[place] = name + b":" + b",".join(cells)
        elif kind == 3:
            del lines[place]
        elif kind == 4:
            lines.insert(place, name + b":" + chance.choice([*HEADER_NUMBERS, *ODD]).encode())
        else:
            lines[place] = chance.choice([b"H I interval:", b"H P interval:", b"H looptime:", name + b":"])
            lines[place] += chance.choice(HEADER_NUMBERS).encode()
    return b"\n".join(lines) + b"\n" + log[body:]


def crazyflie(chance: random.Random) -> bytes:
    """Events that are defined by other types, names and numbers, with a checksum that holds."""
    letters = [chance.choice("fdBbHhIiQq?\u0663") for _ in range(2)]
    names = [chance.choice(["gyro.x", "acc.z", "gyro.x", *ODD[:13]]) for _ in range(2)]
    variables = b"".join(f"{name}({letter})".encode() + b"\0" for name, letter in zip(names, letters, strict=True))
    count, known = chance.choice([1, 1, 1, 0, 2, 65535]), chance.choice([2, 2, 2, 0, 1, 65535])
    header = b"\xbc" + struct.pack("<HH", chance.choice([2, 2, 2, 1, 65535]), count)
    header += (
        b"\xff\xff"
        + chance.choice(["fixedFrequency", *ODD[:4]]).encode()
        + b"\0"
        + struct.pack("<H", known)
        + variables
    )
    time_s, parts = stamps(chance), []
    for number, stamp in enumerate(_us(time_s)):
        parts.append(struct.pack("<HQ", 0xFFFF, stamp))
        for letter in letters:
            form = "<" + (letter if letter in "fdBbHhIiQq?" else "f")
            value = chance.choice(EXTREMES)
            parts.append(struct.pack(form, _single(value)) if letter in "fd\u0663" else struct.pack(form, number % 100))
    body = header + b"".join(parts)
    return body + struct.pack("<I", zlib.crc32(body))


def telemetry(chance: random.Random) -> bytes:
    """Messages with right checksums, whose numbers and stamps are of every kind."""
    from tests.hostile.test_tlog_damage import frame

    from rotorid.io.mavlink.messages import LAYOUTS

    parts, time_s = [], stamps(chance)
    numbers = chance.sample(sorted(LAYOUTS), min(3, len(LAYOUTS)))
    for k, stamp in enumerate(_us(time_s)[:120]):
        number = chance.choice([30, *numbers])
        own_ms = struct.pack("<I", chance.choice([20 * k, stamp % 2**32, 2**32 - 1]))
        values = b"".join(
            struct.pack("<f", _single(chance.choice(EXTREMES))) for _ in range(chance.choice([6, 6, 6, 0, 30]))
        )
        whole = frame(k, number=number, payload=(own_ms + values)[:255])
        parts.append(struct.pack(">Q", stamp) + whole[8:] if chance.random() < 0.5 else whole)
    return b"".join(parts)


def paparazzi(chance: random.Random) -> bytes:
    """Lines of messages, whose numbers, names and stamps are of every kind."""
    lines = []
    for k, stamp in enumerate(stamps(chance).tolist()):
        cell = chance.choice([str(k), "4096", *map(repr, EXTREMES), "9" * 400, *ODD[:9]])
        lines.append(f"{stamp:.6f} 42 IMU_GYRO_SCALED {k} {cell} 0")
        lines.append(f"{stamp!r} {chance.choice(['42', '42', '43', '9' * 30])} ATTITUDE 0.1 {cell} -0.2")
        lines.append(f"{stamp:.3f} 42 ACTUATORS 1000,{cell},1500,2000")
        if chance.random() < 0.02:
            lines.append(chance.choice([*ODD, "1 42 IMU_GYRO_SCALED", "nan 42 RPM 1,2,3,4", "1 42 ENERGY nan -1 2"]))
    return "\n".join(lines).encode("utf-8", "surrogateescape") + b"\n"


def dialect(chance: random.Random) -> bytes:
    """Tables as spreadsheets and other programs write them: separators, decimal commas, units below, long, sparse."""
    time_s, columns = rows(chance)
    names = list(columns)
    cells = [[repr(value) for value in row.tolist()] for row in (time_s, *columns.values())]
    if chance.random() < 0.2:
        name = chance.choice(["name", "topic", "signal"])
        lines = [f"time,{name},value"]
        for row in zip(*cells, strict=True):
            lines += [
                f"{row[0]},{chance.choice([key, *ODD[:6]]) if chance.random() < 0.02 else key},{value}"
                for key, value in zip(names, row[1:], strict=True)
            ]
        return "\n".join(lines).encode("utf-8", "surrogateescape")
    separator = chance.choice([";", "\t", " ", "  ", "|", ","])
    comma = separator == ";" and chance.random() < 0.5
    if chance.random() < 0.2:
        clock = chance.choice(
            ["12:00:{:06.3f}", "2026-01-01T23:59:{:06.3f}Z", "{}:00:00", "00:00:{}", "2026-13-45 99:99:99"]
        )
        cells[0] = [clock.format(abs(stamp)) for stamp in time_s.tolist()]
    if chance.random() < 0.2:
        step = chance.choice([2, 3])
        cells[1:] = [["" if k % step else cell for k, cell in enumerate(column)] for column in cells[1:]]
    lines = [separator.join(["time", *names])]
    if chance.random() < 0.3:
        lines.append(separator.join(["s", *(chance.choice([UNITS.get(name, "1"), *ODD_UNITS]) for name in names)]))
    lines += [separator.join(row) for row in zip(*cells, strict=True)]
    text = "\n".join([*chance.choice([[], [], ["# a remark"], ["sep=" + separator], ["// x"] * 50]), *lines, ""])
    text = text.replace(".", ",") if comma else text
    return text.encode(chance.choice(["utf-8", "utf-8", "utf-8-sig", "utf-16"]), "replace")


def bag(chance: random.Random) -> bytes:
    """A ROS 2 bag of one topic with hostile stamps and values."""
    from tests.hostile.test_rosbag_damage import bag_of

    time_s = stamps(chance)
    data = values(chance, time_s).tolist()
    nanoseconds = [
        max(min(int(1e9 * stamp), 2**63 - 1), -(2**63)) if abs(stamp) < 1e300 else 2**63 - 1
        for stamp in time_s.tolist()
    ]
    container = chance.choice(["ros1", "sqlite", "mcap"])
    # What a container cannot write wraps, as its counter does.
    most = {"ros1": 2**32 * 10**9, "sqlite": 2**63, "mcap": 2**64}[container]
    nanoseconds = [stamp % most for stamp in nanoseconds]
    with TemporaryDirectory() as folder:
        return bag_of(Path(folder), container, zip(nanoseconds, data, strict=True))


def clock(chance: random.Random) -> FloatArray:
    """Stamps that are no clock or hardly one: steps of any size, neighbors of a double, bursts, joins of these."""
    parts = []
    at = chance.choice([0.0, 0.0, 1.0, 1e-300, 1e-9, 86_400.0, 1.7e9, 2.0**52, 1e15, -1e9, 1e300])
    for _ in range(chance.randint(1, 3)):
        count = chance.choice([2, 3, 8, 50, 200])
        kind = chance.randrange(6)
        if kind == 0:
            part = at + np.arange(count) * 10.0 ** chance.uniform(-324, 12)
        elif kind == 1:
            part = at + np.arange(count) * np.spacing(at) * chance.choice([0, 1, 2, 100, 255, 256, 257, 10_000])
        elif kind == 2:
            part = np.arange(count) * 5e-324 * chance.choice([1, 3, 2**40])
        elif kind == 3:
            part = (
                at
                + np.float64(np.float32(1e5))
                + np.cumsum(np.full(count, 10.0 ** chance.uniform(-9, 0))).astype(np.float32)
            )
        elif kind == 4:
            part = at + np.cumsum(10.0 ** np.random.default_rng(count).uniform(-20.0, 2.0, count))
        else:
            part = at + 0.004 * np.arange(count)
        parts.append(part)
        at = float(part[-1]) + chance.choice([0.0, 5e-324, 1e-12, 0.004, 1e3, 1e9])
    return np.concatenate(parts)


def rate(chance: random.Random) -> bytes:
    """A table of all that commands ask for on such a clock, as text, NumPy archive or MATLAB file."""
    from scipy.io import savemat

    time_s = clock(chance)
    k = np.arange(time_s.size)
    columns = {
        "p [rad/s]": np.sin(0.3 * k),
        "phi [rad]": 0.1 * np.sin(0.03 * k),
        "p_setpoint [rad/s]": np.sin(0.3 * k - 0.2),
        "roll_stick [1]": 0.2 * np.sin(0.3 * k),
        "roll_command [1]": 0.1 * np.sign(np.sin(0.01 * k**1.3)),
        "thrust_command [1]": 0.4 + 0.05 * np.sin(0.02 * k),
        "az [m/s^2]": -9.8 + np.cos(0.5 * k),
        "battery_voltage [V]": 16.0 - 0.1 * np.sin(0.2 * k),
    }
    kind = chance.randrange(4)
    if kind < 2:
        table_rows = zip(time_s.tolist(), *(row.tolist() for row in columns.values()), strict=True)
        lines = [",".join(["time [s]", *columns]), *(",".join(map(repr, row)) for row in table_rows), ""]
        return "\n".join(lines).encode()
    arrays = {"time": time_s, **{name.partition(" ")[0]: row for name, row in columns.items()}}
    buffer = io.BytesIO()
    if kind == 2:
        np.savez(buffer, **arrays)
    else:
        savemat(buffer, arrays)
    return buffer.getvalue()


_NUMPY_TOKENS = (b"'<f9'", b"(9,)", b"(" + b"1" * 60 + b"x", b"'|O'", b"\x93NUMPY\x01\0")
BUILDERS: Mapping[str, tuple[Callable[[random.Random], bytes] | None, tuple[str, ...], tuple[bytes, ...]]] = (
    MappingProxyType(
        {
            "ULog": (ulog, ("ULog",), (b"D", b"\x15\0F", b"\x05\0A\0\0\0", b"float[99999] y;")),
            "DataFlash": (dataflash, ("DataFlash",), (b"\xa3\x95\x80", b"\xa3\x95\x01", b"FMT\0", b"QBIfanNZ")),
            "DataFlash text": (text_log, ("DataFlash text",), (b"FMT, ", b",", b'{"meta": {"type":', b"\n")),
            "blackbox": (blackbox, ("blackbox",), (b"H Product:Blackbox", b"H P interval:", b"I", b"P", b"E\xff")),
            "blackbox CSV": (decoded, ("blackbox CSV",), (b",", b"\n", b"nan")),
            "Crazyflie": (crazyflie, ("Crazyflie",), (b"\xbc\x02\0", b"gyro.x(f)\0", b"(d)\0")),
            "tlog": (telemetry, ("tlog",), (b"\xfd\x1c\0\0", b"\xfe\x1c", b"\x1e\0\0")),
            "ROS": (bag, ("ROS 1", "ROS 2 sqlite", "MCAP"), ()),
            "MAT": (mat, ("MAT v5",), ()),
            "HDF5": (hdf5, ("HDF5",), ()),
            "NPZ": (npz, ("NPZ", "NPZ compressed"), _NUMPY_TOKENS),
            "Parquet": (parquet, ("Parquet",), ()),
            "CSV": (
                _without_what_csv_refuses,
                ("CSV",),
                (b",", b'"', b"\r", b"1e999", b"[deg/s]", b"\xff", b"\xef\xbb\xbf"),
            ),
            "tables of others": (
                dialect,
                ("CSV",),
                (b";", b"\t", b"sep=", b"12:00:00", b"\xff\xfe", b"name", b"value"),
            ),
            "Paparazzi": (paparazzi, ("Paparazzi",), (b" 42 ", b"IMU_GYRO_SCALED", b"nan", b"\n")),
            "clocks": (rate, ("CSV",), ()),
            "ulog2csv": (None, ("ulog2csv",), (b",", b"\n", b"nan", b"1e19", b"timestamp")),
            "archive": (archive, ("gzip", "xz", "bzip2", "zip"), ()),
            "mapping": (mapping_text, ("mapping",), (b"[[", b'"""', b"inf", b"1979-05-27", b"\\u0000")),
        }
    )
)
"""Format to what builds hostile files of it, the sound files that are spoiled, and what means something in it."""

_TEXT = "\n".join(
    [
        "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns",
        "FMT, 1, 43, RATE, Qffffffff, TimeUS,RDes,R,ROut,PDes,P,POut,YDes,Y",
        *(f"RATE, {4000 * k}, 0, {np.sin(0.3 * k)}, 0.1, 0, 0, 0, 0, 0" for k in range(60)),
    ]
)


_OTHERS = (
    "ULog",
    "DataFlash",
    "DataFlash text",
    "blackbox",
    "Crazyflie",
    "tlog",
    "NPZ",
    "CSV",
    "gzip",
    "zip",
    "mapping",
)
"""Formats that stand in the place of another one, or behind its beginning."""


@cache
def sound(name: str) -> Sample:
    """A sound file; of formats that the samples of the other tests have not, one of its own."""
    if name == "DataFlash text":
        return Sample(name="flight.log", content=_TEXT.encode())
    if name == "blackbox CSV":
        return Sample(name="flight.csv", content=decoded(random.Random(0)))
    if name == "Paparazzi":
        from tests.unit.io.test_paparazzi import DEFINITIONS, lines

        return Sample(name="flight.data", content=lines(60).encode(), beside={"flight.log": DEFINITIONS.encode()})
    return SAMPLES[name]()


def variants(format_name: str, count: int, seed: int = 0) -> Iterator[Sample]:
    """So many hostile inputs of a format; one seed, one list."""
    for number in range(count):
        chance = random.Random(f"{format_name} {seed} {number}")
        with np.errstate(all="ignore"):
            sample = _variant(format_name, number, chance)
        yield sample


def _variant(format_name: str, number: int, chance: random.Random) -> Sample:
    build, names, tokens = BUILDERS[format_name]
    sample = sound(names[number % len(names)])
    content, beside = sample.content, sample.beside
    if format_name == "ulog2csv" and chance.random() < 0.5:
        found = topics(chance)
        content, beside = found.pop(sample.name), found
    elif build is not None and chance.random() < 0.7:
        content = build(chance)
    if chance.random() < 0.02:
        content = chance.choice([b"", content[: chance.choice([8, 64, 600])]]) + sound(chance.choice(_OTHERS)).content
    if content == sample.content or chance.random() < 0.15:
        content = spoiled(chance, content, tokens)
    return Sample(name=sample.name, content=content, beside=beside, read=sample.read, mapping=sample.mapping)


def twisted(chance: random.Random, document: Any) -> Any:
    """A document of JSON with one to four of its parts replaced by something of another kind or size."""
    document = json.loads(json.dumps(document))
    for _ in range(chance.randint(1, 4)):
        place = document
        while True:
            keys = list(place) if isinstance(place, dict) else range(len(place))
            if not keys:
                break
            key = chance.choice(keys)
            if isinstance(place[key], dict | list) and place[key] and chance.random() < 0.8:
                place = place[key]
                continue
            kind = chance.randrange(4)
            if kind == 0:
                del place[key]
            elif kind == 1 and isinstance(place, dict):
                place[chance.choice(ODD)] = place[key]
            else:
                place[key] = chance.choice(
                    [None, True, 0, -1, 1e308, -1e308, 2**62, "", "nan", [], {}, [[]], [1e308] * 3, *ODD[:6]]
                )
            break
    return document
