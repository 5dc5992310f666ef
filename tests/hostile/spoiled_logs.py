"""Bad values, stamps, flags and units in the bytes of good logs: what flipped bits and lost bytes leave in a file.

A fault changes one number where it stands: to two to nine times the largest of its channel, to what a flipped bit of
its exponent makes of it, to none, to zero; a stamp to one of another time; a flag or a byte of what declares units,
names and parameters to any other.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from rotorid.io.ardupilot.dataflash import LETTERS, decode
from rotorid.io.px4.writer import message_dtype
from rotorid.typing import AnyArray

RELEVANT = 0.6
"""Share of the faults in what a model of roll is made of; the others lie anywhere."""


@dataclass(frozen=True, kw_only=True)
class Column:
    """A field of all messages of one kind: where its values stand, and what they are."""

    name: str
    places: AnyArray
    dtype: np.dtype[np.generic]
    stamp: bool = False
    relevant: bool = False

    def values(self, content: bytes) -> AnyArray:
        size = self.dtype.itemsize
        whole = np.frombuffer(content, np.uint8)
        return whole[self.places[:, None] + np.arange(size)].copy().view(self.dtype)[:, 0]


Spoiler = Callable[[bytes, np.random.Generator], bytes]


def in_columns(columns: Sequence[Column], content: bytes, rng: np.random.Generator) -> bytes:
    """One fault in one value of one column."""
    relevant = [column for column in columns if column.relevant]
    chosen = relevant if relevant and rng.random() < RELEVANT else columns
    column = chosen[int(rng.integers(len(chosen)))]
    values = column.values(content)
    row = int(rng.integers(values.size))
    changed = bytearray(content)
    place = int(column.places[row])
    if column.dtype.kind == "f":
        written = struct.pack("<f" if column.dtype.itemsize == 4 else "<d", _wrong(values, row, rng))
    elif column.stamp:
        written = int(_late(int(values[row]), rng)).to_bytes(column.dtype.itemsize, "little")
    else:
        bits = int.from_bytes(changed[place : place + column.dtype.itemsize], "little")
        written = (bits ^ 1 << int(rng.integers(8 * column.dtype.itemsize))).to_bytes(column.dtype.itemsize, "little")
    changed[place : place + len(written)] = written
    return bytes(changed)


def _wrong(values: AnyArray, row: int, rng: np.random.Generator) -> float:
    finite = values[np.isfinite(values)]
    largest = float(np.abs(finite).max(initial=0.0))
    flipped = np.array(values[row : row + 1], dtype=np.float32).view(np.uint32) ^ np.uint32(
        1 << int(rng.integers(23, 31))
    )
    made = (
        float(rng.choice([-1.0, 1.0])) * float(rng.uniform(2.0, 9.0)) * largest,
        float(flipped.view(np.float32)[0]),
        *(float("nan"), 0.0, -float(values[row])),
    )
    return made[int(rng.choice(5, p=[0.5, 0.2, 0.1, 0.1, 0.1]))]


def _late(stamp_us: int, rng: np.random.Generator) -> int:
    moved = (0, stamp_us - 6_000_700, stamp_us + 1_000_000_000, stamp_us ^ 1 << int(rng.integers(32)), 2**63)
    return max(moved[int(rng.integers(5))], 0)


_BIN_RELEVANT = {"RATE": ("RDes", "R", "ROut", "TimeUS"), "SIDD": ("Targ", "Gx", "TimeUS")}
_BIN_FLAGS = {"EV": "Id", "ARM": "ArmState", "MODE": "ModeNum"}
_BIN_DECLARING = ("FMTU", "UNIT", "MULT", "MSG", "PARM", "SIDS")


def spoil_bin(content: bytes, rng: np.random.Generator) -> bytes:
    """A DataFlash log."""
    tables = decode(content).tables
    columns = []
    for name, table in tables.items():
        if name == "FMT":  # A column by another name is one that is missing.
            continue
        for field, (offset, letter) in table.format.fields.items():
            if not len(table) or letter not in LETTERS:
                continue
            dtype = LETTERS[letter].dtype
            relevant = field in _BIN_RELEVANT.get(name, ()) or _BIN_FLAGS.get(name) == field
            places = table.positions + offset
            if name in _BIN_DECLARING or dtype.shape or dtype.kind == "S":
                columns += [
                    Column(name=f"{name}.{field}", places=places + byte, dtype=np.dtype("u1"))
                    for byte in range(dtype.itemsize)
                ]
            else:
                columns.append(
                    Column(
                        name=f"{name}.{field}",
                        places=places,
                        dtype=dtype,
                        stamp=field == "TimeUS",
                        relevant=relevant,
                    )
                )
    return in_columns(columns, content, rng)


_ULG_RELEVANT = (
    *("vehicle_torque_setpoint.xyz", "vehicle_angular_velocity.xyz", "manual_control_setpoint.roll"),
    *("vehicle_land_detected.landed", "vehicle_status.arming_state", "vehicle_angular_velocity.timestamp_sample"),
    *("vehicle_torque_setpoint.timestamp_sample", "vehicle_torque_setpoint.timestamp"),
)


def spoil_ulg(content: bytes, rng: np.random.Generator) -> bytes:
    """A ULog."""
    return in_columns(list(_ulg_columns(content)), content, rng)


def _ulg_columns(content: bytes) -> Iterator[Column]:
    layouts: dict[str, np.dtype[np.void]] = {}
    names: dict[int, str] = {}
    found: dict[str, list[int]] = {}
    parameters = []
    place = 16
    while place + 3 <= len(content):
        size, kind = struct.unpack_from("<HB", content, place)
        body = place + 3
        if kind == ord("F"):
            name, _, layout = content[body : body + size].decode().partition(":")
            layouts[name] = message_dtype(layout)
        elif kind == ord("A"):
            (number,) = struct.unpack_from("<H", content, body + 1)
            names[number] = content[body + 3 : body + size].decode()
        elif kind == ord("D"):
            (number,) = struct.unpack_from("<H", content, body)
            found.setdefault(names[number], []).append(body + 2)
        elif kind == ord("P"):
            parameters.append(body + size - 4)
        place = body + size
    yield Column(name="parameters", places=np.array(parameters), dtype=np.dtype("<i4"))
    for name, positions in found.items():
        for field, (dtype, offset, *_) in (layouts[name].fields or {}).items():
            base = dtype.subdtype[0] if dtype.subdtype else dtype
            for item in range(dtype.itemsize // base.itemsize):
                yield Column(
                    name=f"{name}.{field}",
                    places=np.array(positions) + offset + item * base.itemsize,
                    dtype=base,
                    stamp=field.startswith("timestamp"),
                    relevant=f"{name}.{field}" in _ULG_RELEVANT and item == 0,
                )


def spoil_bbl(content: bytes, rng: np.random.Generator) -> bytes:
    """A blackbox log: numbers of any length stand where they stand, so that a bit of anything is flipped."""
    begin = content.rindex(b"\nH ") if rng.random() > 0.1 else 0
    place = int(rng.integers(begin, len(content)))
    changed = bytearray(content)
    changed[place] ^= 1 << int(rng.integers(8))
    return bytes(changed)


def spoil_csv(content: bytes, rng: np.random.Generator) -> bytes:
    """A table: a cell of a row is another number, or the letters of one are."""
    head, *lines = content.decode().splitlines()
    names = [cell.partition(" ")[0] for cell in head.split(",")]
    relevant = [column for column, name in enumerate(names) if name in ("time", "roll_command", "p", "roll_stick")]
    column = int(rng.choice(relevant)) if rng.random() < RELEVANT else int(rng.integers(len(names)))
    row = int(rng.integers(len(lines)))
    cells = lines[row].split(",")
    values = np.array([float(line.split(",")[column]) for line in lines])
    wrong = _wrong(values, row, rng)
    # A table is written by hand or by a converter, and what is no number is refused with its line.
    cells[column] = f"{wrong if np.isfinite(wrong) else 0.0:.9g}"
    lines[row] = ",".join(cells)
    return "\n".join([head, *lines, ""]).encode()


SPOILERS: Mapping[str, Spoiler] = MappingProxyType(
    {"BIN": spoil_bin, "ulg": spoil_ulg, "bbl": spoil_bbl, "csv": spoil_csv}
)
"""Ending of a log to what puts one fault into its bytes."""


def spoiled(ending: str, content: bytes, seed: int) -> bytes:
    """The log with one to five faults; one seed, one log."""
    rng = np.random.default_rng(seed)
    for _ in range(int(rng.integers(1, 6))):
        content = SPOILERS[ending](content, rng)
    return content
