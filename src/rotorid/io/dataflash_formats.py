"""What a DataFlash log says about its own messages: the letters of a format, and the columns that they make."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType

import numpy as np

from rotorid.errors import UsageError
from rotorid.io.gather import gather, gather_into
from rotorid.typing import AnyArray, BoolArray, FloatArray, IntArray

HEADER_BYTES = 3
INSTANCE_UNIT = "instance"
"""Unit label of the column that numbers identical sensors."""


@dataclass(frozen=True, slots=True)
class Letter:
    """How one letter of a format string is stored: the NumPy type, and by what the stored integer is divided."""

    dtype: np.dtype[np.generic]
    divisor: float = 1.0

    @property
    def stored(self) -> np.dtype[np.generic]:
        """Type of one item in the log: arrays and texts as they stand, without an end at the first zero."""
        plain = self.dtype.kind != "S" and not self.dtype.shape
        return self.dtype if plain else np.dtype((np.void, self.dtype.itemsize))


def _letter(dtype: str | tuple[str, int], divisor: float = 1.0) -> Letter:
    return Letter(np.dtype(dtype), divisor)


LETTERS: Mapping[str, Letter] = MappingProxyType(
    {
        "a": _letter(("<i2", 32)),
        "b": _letter("i1"),
        "B": _letter("u1"),
        "h": _letter("<i2"),
        "H": _letter("<u2"),
        "i": _letter("<i4"),
        "I": _letter("<u4"),
        "q": _letter("<i8"),
        "Q": _letter("<u8"),
        "g": _letter("<f2"),
        "f": _letter("<f4"),
        "d": _letter("<f8"),
        "n": _letter("S4"),
        "N": _letter("S16"),
        "Z": _letter("S64"),
        "c": _letter("<i2", 100.0),
        "C": _letter("<u2", 100.0),
        "e": _letter("<i4", 100.0),
        "E": _letter("<u4", 100.0),
        "L": _letter("<i4", 1e7),
        "M": _letter("u1"),
    }
)
"""Every letter that a format may hold. Dividing by a power of ten is exact to the last bit, multiplying is not."""


@dataclass(frozen=True, kw_only=True)
class Format:
    """One definition of a message, as its ``FMT`` message gives it.

    Parameters
    ----------
    number
        Third byte of every message of this kind.
    length
        Bytes of a message, its three header bytes included.
    name
        Up to four characters: ``RATE``.
    letters
        One letter per column, see ``LETTERS``.
    columns
        Names of the columns, in the order of the letters.
    """

    number: int
    length: int
    name: str
    letters: str
    columns: tuple[str, ...]

    @cached_property
    def decodable(self) -> bool:
        """Whether the letters are known and fill the declared length."""
        if any(letter not in LETTERS for letter in self.letters):
            return False
        return HEADER_BYTES + sum(LETTERS[letter].dtype.itemsize for letter in self.letters) == self.length

    @cached_property
    def fields(self) -> Mapping[str, tuple[int, str]]:
        """Column to its offset in the message and its letter; of two columns with one name the later one counts."""
        fields: dict[str, tuple[int, str]] = {}
        offset = HEADER_BYTES
        for name, letter in zip(self.columns, self.letters, strict=False):
            fields[name] = (offset, letter)
            offset += LETTERS[letter].dtype.itemsize
        return MappingProxyType(fields)


FMT = Format(
    number=128,
    length=89,
    name="FMT",
    letters="BBnNZ",
    columns=("Type", "Length", "Name", "Format", "Columns"),
)
"""The one definition that a log need not make: that of the definitions."""


def parse_format(message: bytes) -> Format | None:
    """Read one ``FMT`` message of 89 bytes, header included; ``None`` when it cannot be one.

    Examples
    --------
    >>> texts = b"RATE" + b"Qf".ljust(16, bytes(1)) + b"TimeUS,R".ljust(64, bytes(1))
    >>> parse_format(bytes([0xA3, 0x95, 128, 75, 15]) + texts).columns
    ('TimeUS', 'R')
    """
    number, length = message[3], message[4]
    name, letters, columns = (text_of(field) for field in (message[5:9], message[9:25], message[25:89]))
    if length < HEADER_BYTES or not name or not (name.isascii() and name.isprintable()):
        return None
    return Format(
        number=number,
        length=length,
        name=name,
        letters=letters,
        columns=tuple(columns.split(",")) if columns else (),
    )


def text_of(raw: bytes) -> str:
    """Text up to the first zero byte; UTF-8, or Latin-1 where the field is not UTF-8."""
    try:
        text = raw.decode("utf-8")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")
    return text.partition("\0")[0]


@dataclass(frozen=True, kw_only=True, eq=False)
class Table:
    """All messages of one kind: a row for each message, a column for each field, read when asked for.

    Parameters
    ----------
    format
        Definition of the messages.
    units
        Column to the label of its unit, such as ``deg/s``, for the columns to which the log gives one. It holds for
        the values that ``column`` returns.
    data
        The whole log, ``uint8``.
    positions
        First byte of each message, shape ``(messages,)``, rising.
    """

    format: Format
    units: Mapping[str, str]
    data: AnyArray
    positions: IntArray

    def __len__(self) -> int:
        return int(self.positions.size)

    def __contains__(self, column: str) -> bool:
        return column in self.format.fields

    @property
    def name(self) -> str:
        return self.format.name

    @property
    def columns(self) -> tuple[str, ...]:
        return tuple(self.format.fields)

    def holds_numbers(self, *columns: str) -> bool:
        """Whether all these columns exist and are plain numbers; a damaged definition may say otherwise."""
        return all(column in self and self.format.fields[column][1] not in "anNZ" for column in columns)

    def holds_text(self, *columns: str) -> bool:
        """Whether all these columns exist and are text."""
        return all(column in self and self.format.fields[column][1] in "nNZ" for column in columns)

    @property
    def instance_column(self) -> str | None:
        """Column that numbers identical sensors, when the log declares one."""
        return next((column for column, unit in self.units.items() if unit == INSTANCE_UNIT), None)

    def chosen(self, which: BoolArray | slice) -> Table:
        """The table of some of the messages: a mask of shape ``(messages,)``, or a slice."""
        return replace(self, positions=self.positions[which])

    def column(self, name: str) -> AnyArray:
        """Values of one column, see `read`."""
        return self.read(name)[name]

    def read(self, *names: str) -> dict[str, AnyArray]:
        """Values of some columns, or of all when none is named, each of shape ``(messages,)``.

        Integers and floats keep the width of the log; the scaled letters ``c C e E L`` become ``float64``; text becomes
        ``str``. Arrays (letter ``a``) have shape ``(messages, 32)``, and so has the raw content of a logged file
        (``FILE.Data``), which is no text: ``uint8``, shape ``(messages, 64)``.

        Raises
        ------
        UsageError
            There is no such column.
        """
        fields = self._fields(names or self.columns)
        places = [(offset, LETTERS[letter].stored) for offset, letter in fields.values()]
        stored = gather(self.data, self.positions, places)
        return {
            name: self._value(letter, values)
            for (name, (_, letter)), values in zip(fields.items(), stored, strict=True)
        }

    def numbers(self, *names: str) -> FloatArray:
        """Values of columns for which `holds_numbers` is true, shape ``(names, messages)``.

        Raises
        ------
        UsageError
            There is no such column.
        """
        fields = self._fields(names)
        values = np.empty((len(names), len(self)))
        kinds = {name: LETTERS[letter] for name, (_, letter) in fields.items()}
        # Widening a signaling NaN, which damage may produce, is no reason for a warning: it stays a NaN.
        with np.errstate(invalid="ignore"):
            places = [(fields[name][0], kinds[name].stored) for name in names]
            gather_into(list(values), self.data, self.positions, places)
        for row, name in zip(values, names, strict=True):
            if kinds[name].divisor != 1.0:
                row /= kinds[name].divisor
        return values

    def _fields(self, names: Iterable[str]) -> Mapping[str, tuple[int, str]]:
        unknown = next((name for name in names if name not in self.format.fields), None)
        if unknown is not None:
            raise UsageError(
                f"the message {self.name} has no column {unknown!r}",
                needed=f"one of {', '.join(self.columns)}",
                remedy="correct the name",
            )
        return {name: self.format.fields[name] for name in names}

    def _value(self, letter: str, stored: AnyArray) -> AnyArray:
        kind = LETTERS[letter]
        if kind.dtype.kind == "S":
            raw = stored.view(np.uint8).reshape(-1, kind.dtype.itemsize)
            return raw if self.name == "FILE" and letter == "Z" else _texts(raw)
        if kind.dtype.shape:
            return stored.view(kind.dtype.base).reshape(-1, *kind.dtype.shape)
        return stored if kind.divisor == 1.0 else np.true_divide(stored, kind.divisor, dtype=np.float64)

    @property
    def clock(self) -> tuple[str, float] | None:
        """Column with the stamps and its steps per second, or ``None`` when the messages carry none."""
        for name, per_second in (("TimeUS", 1e6), ("TimeMS", 1e3)):
            if name in self and self.format.fields[name][1] in "IQiq":
                return name, per_second
        return None

    @property
    def time_s(self) -> FloatArray | None:
        """Stamps in seconds on the log's own clock, or ``None`` when the messages carry none."""
        if self.clock is None:
            return None
        name, per_second = self.clock
        stamps: FloatArray = self.numbers(name)[0]
        stamps /= per_second
        return stamps


def _texts(raw: AnyArray) -> AnyArray:
    """Text of each row of bytes, shape ``(messages, width)`` to ``(messages,)``."""
    width = raw.shape[1]
    if raw.size and raw.max() > 0x7F:
        return np.array([text_of(row.tobytes()) for row in raw], dtype=f"<U{width}")
    before_zero = np.logical_and.accumulate(raw != 0, axis=1)
    ascii_bytes = np.where(before_zero, raw, 0).astype(np.uint8)
    # ASCII is the first page of Unicode: widening the bytes is the whole conversion.
    return ascii_bytes.astype("<u4").view(f"<U{width}")[:, 0]
