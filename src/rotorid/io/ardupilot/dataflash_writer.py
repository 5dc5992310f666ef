"""ArduPilot's DataFlash container, written: tables of messages to bytes, merged by their stamps.

A log holds its own definitions first (``FMT``), then the units and multipliers of their columns (``UNIT``, ``MULT``,
``FMTU``), then the messages one after another, as :mod:`rotorid.io.ardupilot.dataflash` reads them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

import numpy as np

from rotorid.data.base import Immutable
from rotorid.errors import UsageError
from rotorid.io.ardupilot.dataflash import FMT, HEADER_BYTES, LETTERS, MAGIC, Format
from rotorid.io.files import write_atomically
from rotorid.typing import AnyArray, IntArray

CLOCK = "TimeUS"
_LARGEST_MESSAGE_BYTES = 255
NAME_BYTES, COLUMNS_BYTES = 4, 64

UNITS: Mapping[str, str] = MappingProxyType(
    {
        "-": "",
        "?": "UNKNOWN",
        "A": "A",
        "a": "Ah",
        "d": "deg",
        "b": "B",
        "k": "deg/s",
        "E": "rad/s",
        "h": "degheading",
        "m": "m",
        "n": "m/s",
        "o": "m/s/s",
        "O": "degC",
        "%": "%",
        "s": "s",
        "q": "rpm",
        "r": "rad",
        "v": "V",
        "w": "Ohm",
        "X": "W.h",
        "Y": "us",
        "z": "Hz",
        "#": "instance",
    }
)
"""Letter of a unit to its label, as ArduPilot spells it."""

MULTIPLIERS: Mapping[str, float] = MappingProxyType(
    {
        "-": 0.0,
        "?": 1.0,
        "2": 1e2,
        "1": 1e1,
        "0": 1.0,
        "A": 1e-1,
        "B": 1e-2,
        "C": 1e-3,
        "D": 1e-4,
        "E": 1e-5,
        "F": 1e-6,
        "G": 1e-7,
        "I": 1e-9,
        "!": 3.6,
        "/": 3600.0,
    }
)
"""Letter of a multiplier to its factor."""


@dataclass(frozen=True, kw_only=True)
class Layout:
    """What one kind of message looks like.

    Parameters
    ----------
    number
        Third byte of every message of this kind, 0 to 255; 128 belongs to ``FMT``.
    name
        Up to four characters: ``RATE``.
    letters
        One letter per column, see :data:`rotorid.io.ardupilot.dataflash.LETTERS`.
    columns
        Their names, separated by commas.
    units, multipliers
        One letter per column, see :data:`UNITS` and :data:`MULTIPLIERS`; the values in the log times their multiplier
        are in the unit.
    absent
        Columns in which a NaN says that there is no value. In all others it is an error.

    Examples
    --------
    >>> mode = Layout(number=120, name="MODE", letters="QMBB", columns="TimeUS,Mode,ModeNum,Rsn", units="s---",
    ...               multipliers="F---")
    >>> mode.format.length, mode.format.columns[1]
    (14, 'Mode')
    """

    number: int
    name: str
    letters: str
    columns: str
    units: str
    multipliers: str
    absent: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        count = len(self.columns.split(","))
        wrong = (
            {len(self.letters), len(self.units), len(self.multipliers)} != {count}
            or not set(self.letters) <= LETTERS.keys() - {"a"}
            or not set(self.units) <= UNITS.keys()
            or not set(self.multipliers) <= MULTIPLIERS.keys()
            or not 0 < len(self.name) <= NAME_BYTES
            or len(self.columns) > COLUMNS_BYTES
            or not 0 <= self.number < 1 << 8
            or self.format.length > _LARGEST_MESSAGE_BYTES
        )
        if wrong:
            raise UsageError(
                f"the layout {self.name} of {self.letters!r} for {self.columns!r} is not possible",
                needed="a known letter, unit and multiplier for every column, a name of at most four characters, at "
                "most 64 characters of columns and 255 bytes of message",
            )

    @property
    def format(self) -> Format:
        """The definition, as the reader knows it."""
        return Format(
            number=self.number,
            length=HEADER_BYTES + sum(LETTERS[letter].dtype.itemsize for letter in self.letters),
            name=self.name,
            letters=self.letters,
            columns=tuple(self.columns.split(",")),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Messages(Immutable):
    """All messages of one kind.

    Parameters
    ----------
    layout
        What they look like.
    values
        Column to its values in the unit of the column times its multiplier, shape ``(messages,)``, texts for the text
        letters; a single value holds for all messages. ``TimeUS`` counts whole microseconds.
    """

    layout: Layout
    values: Mapping[str, AnyArray | Sequence[str] | float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._set(values=self.values)


def write_dataflash(path: Path, tables: Iterable[Messages]) -> None:
    """Write a log, whole or not at all; see :func:`encode`.

    Parameters
    ----------
    tables
        Kinds of messages.

    Raises
    ------
    UsageError
        A value does not fit into its column, or the place cannot be written.
    """
    write_atomically(path, encode(tables))


def encode(tables: Iterable[Messages]) -> bytes:
    """Bytes of a log.

    Messages stand in the order of their ``TimeUS``; those of the same microsecond in the order of ``tables``, so that
    what declares goes before what it declares. Equal tables give equal bytes.

    Parameters
    ----------
    tables
        Kinds of messages, each with a number, a name and a column ``TimeUS`` of its own.

    Raises
    ------
    UsageError
        A value is not finite, does not fit into its column, or a column is missing or of another length.

    Examples
    --------
    >>> from rotorid.io.ardupilot.dataflash import decode
    >>> event = Layout(number=181, name="EV", letters="QB", columns="TimeUS,Id", units="s-", multipliers="F-")
    >>> log = decode(encode([Messages(layout=event, values={"TimeUS": np.array([7, 9]), "Id": np.array([10, 28])})]))
    >>> log.tables["EV"].column("Id").tolist()
    [10, 28]
    """
    timed_tables = [table for table in tables if np.size(table.values.get(CLOCK, ()))]
    numbers = [
        FMT.number,
        *(layout.number for layout in (UNIT, MULT, FMTU, *(messages.layout for messages in timed_tables))),
    ]
    if not timed_tables or len(set(numbers)) < len(numbers):
        raise UsageError(
            f"got messages {', '.join(messages.layout.name for messages in timed_tables) or 'of no kind'}",
            needed="at least one kind with stamps TimeUS, each with a number of its own that is none of "
            f"{', '.join(map(str, numbers[:4]))}",
        )
    blocks = [packed(messages) for messages in timed_tables]
    stamps = [block[CLOCK].astype(np.int64) for block in blocks]
    head = b"".join(
        block.tobytes()
        for block in _described([messages.layout for messages in timed_tables], int(min(map(np.min, stamps))))
    )
    return head + _merged(blocks, stamps).tobytes()


def packed(table: Messages) -> AnyArray:
    """Messages as they stand in the log, shape ``(messages,)``, one structure of bytes for each."""
    form = table.layout.format
    missing = [name for name in form.columns if name not in table.values]
    if missing:
        raise UsageError(
            f"messages {form.name} have no {', '.join(missing)}", needed=f"values for {table.layout.columns}"
        )
    fields = [(name, LETTERS[letter].dtype) for name, letter in zip(form.columns, form.letters, strict=True)]
    rows = np.zeros(np.size(table.values[form.columns[0]]), dtype=[("head", "u1", HEADER_BYTES), *fields])
    rows["head"] = (*MAGIC, form.number)
    for name, letter in zip(form.columns, form.letters, strict=True):
        stored = _stored(table, name, letter)
        if stored.shape not in ((), rows.shape):
            raise UsageError(f"{form.name}.{name} has shape {stored.shape}", needed=f"shape {rows.shape}")
        rows[name] = stored
    return rows


def _stored(table: Messages, name: str, letter: str) -> AnyArray:
    """Values of a column as its letter stores them."""
    kind, where = LETTERS[letter], f"{table.layout.name}.{name}"
    given = np.asarray(table.values[name])
    if kind.dtype.kind == "S":
        return _texts(given, kind.dtype.itemsize, where)
    if kind.dtype.kind in "iu" and given.dtype.kind in "iu":
        scaled = given if kind.divisor == 1.0 else given * round(kind.divisor)
    else:
        numbers = given.astype(np.float64)
        allowed = np.isfinite(numbers) | (np.isnan(numbers) & (name in table.layout.absent and kind.dtype.kind == "f"))
        if not allowed.all():
            raise UsageError(
                f"{where} contains {np.count_nonzero(~allowed)} values that are not finite, the first at message "
                f"{int(np.argmin(allowed))}",
                needed="finite numbers",
                remedy="write the part of the flight in which they are",
            )
        scaled = numbers if kind.dtype.kind == "f" else np.rint(numbers * kind.divisor)
    lowest, highest = _limits(kind.dtype)
    if np.any((scaled < lowest) | (scaled > highest)):
        raise UsageError(
            f"{where} reaches from {given.min():g} to {given.max():g}",
            needed=f"{lowest / kind.divisor:g} to {highest / kind.divisor:g}, which its letter {letter} can hold",
        )
    return scaled.astype(kind.dtype)


def _limits(dtype: np.dtype[np.generic]) -> tuple[float, float]:
    """Lowest and highest number of a type; whole numbers as such, since a float loses the last of 64 bits."""
    if dtype.kind == "f":
        single = np.finfo(dtype.name)
        return float(single.min), float(single.max)
    whole = np.iinfo(dtype.name)
    return whole.min, whole.max


def _texts(given: AnyArray, width: int, where: str) -> AnyArray:
    texts = [str(text).encode("utf-8") for text in given.ravel()]
    longest = max(texts, key=len, default=b"")
    if len(longest) > width:
        raise UsageError(
            f"{where} is to hold {longest.decode('utf-8')!r}", needed=f"at most {width} bytes", remedy="shorten it"
        )
    return np.array(texts, dtype=f"S{width}").reshape(given.shape)


def _merged(blocks: Sequence[AnyArray], stamps: Sequence[IntArray]) -> AnyArray:
    """Messages of all kinds one after another in the order of their stamps, ``uint8``."""
    lengths = np.repeat([block.itemsize for block in blocks], [block.size for block in blocks])
    order = np.argsort(np.concatenate(stamps), kind="stable")
    starts = np.empty(order.size, dtype=np.int64)
    starts[order] = np.cumsum(lengths[order]) - lengths[order]
    merged = np.empty(int(lengths.sum()), dtype=np.uint8)
    begin = 0
    for block in blocks:
        # Every place at which a message of this length could begin, as one item: what is written does not overlap.
        whole = np.dtype((np.void, block.itemsize))
        places = np.ndarray(merged.size - block.itemsize + 1, dtype=whole, buffer=merged, strides=(1,))
        places[starts[begin : begin + block.size]] = block.view(whole)
        begin += block.size
    return merged


def _described(layouts: Sequence[Layout], begin_us: int) -> list[AnyArray]:
    """Definitions of all messages, their units, and what the letters of the units mean."""
    described = (UNIT, MULT, FMTU, *layouts)
    formats = (FMT, *(layout.format for layout in described))
    return [
        packed(
            Messages(
                layout=_DEFINITION,
                values={
                    "Type": np.array([form.number for form in formats]),
                    "Length": np.array([form.length for form in formats]),
                    "Name": [form.name for form in formats],
                    "Format": [form.letters for form in formats],
                    "Columns": [",".join(form.columns) for form in formats],
                },
            )
        ),
        _lettered(UNIT, UNITS, begin_us),
        _lettered(MULT, MULTIPLIERS, begin_us),
        packed(
            Messages(
                layout=FMTU,
                values={
                    CLOCK: np.full(len(described), begin_us),
                    "FmtType": np.array([layout.number for layout in described]),
                    "UnitIds": [layout.units for layout in described],
                    "MultIds": [layout.multipliers for layout in described],
                },
            )
        ),
    ]


def _lettered(layout: Layout, meanings: Mapping[str, str] | Mapping[str, float], begin_us: int) -> AnyArray:
    values: list[str | float] = list(meanings.values())
    return packed(
        Messages(
            layout=layout,
            values={
                CLOCK: np.full(len(values), begin_us),
                "Id": np.array([ord(letter) for letter in meanings]),
                layout.format.columns[-1]: np.array(values),
            },
        )
    )


_DEFINITION = Layout(
    number=FMT.number,
    name=FMT.name,
    letters=FMT.letters,
    columns=",".join(FMT.columns),
    units="-b---",
    multipliers="-----",
)
UNIT = Layout(number=117, name="UNIT", letters="QbZ", columns="TimeUS,Id,Label", units="s--", multipliers="F--")
MULT = Layout(number=118, name="MULT", letters="Qbd", columns="TimeUS,Id,Mult", units="s--", multipliers="F--")
FMTU = Layout(
    number=116, name="FMTU", letters="QBNN", columns="TimeUS,FmtType,UnitIds,MultIds", units="s---", multipliers="F---"
)
