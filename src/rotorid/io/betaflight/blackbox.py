"""The blackbox container of Betaflight, Cleanflight and INAV: from the bytes of a log to its flights, frame by frame.

A log is a row of flights. Each begins with a header in plain text, its settings and how its frames are encoded, and
goes on with frames that hold differences to predictions. There is no checksum; the frames are walked in
:mod:`rotorid.io.betaflight.blackbox_kernels`.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice, pairwise
from types import MappingProxyType

import numpy as np

from rotorid.errors import LogError
from rotorid.typing import AnyArray, FloatArray, IntArray

MAGIC = b"H Product:Blackbox"

_PADDING = 4096
"""More than the longest frame: 128 fields of five bytes, and their tags."""
_LEAST_ERASED = 16
"""So many bytes of ones at the end are flash memory that was never written."""
WRAP = 1 << 32
_REVISION = re.compile(r"(Betaflight|INAV)\D{0,40}(\d{1,4})\.(\d{1,4})")

MOST_FLIGHTS = 10_000
"""More than a memory holds; each takes room, even one of which there is nothing but the first words."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Damage:
    """What of a flight could not be read.

    Parameters
    ----------
    skipped_bytes, places, first_byte
        Bytes that belong to no frame, in how many places, and the first of them, counted from the flight's header.
    lost_frames
        Frames that the logger must have written between those that were read, by their loop numbers.
    cut_bytes
        Bytes of a last frame that is not complete.
    ended
        Whether the logger closed the flight.
    """

    skipped_bytes: int
    places: int
    first_byte: int
    lost_frames: int
    cut_bytes: int
    ended: bool


@dataclass(frozen=True, kw_only=True, eq=False, slots=True)
class Flight:
    """One flight of a log.

    Parameters
    ----------
    number
        Place in the file, from 1.
    header
        Its settings.
    time_s
        Stamps of the main frames, shape ``(frames,)``, on the flight controller's clock.
    frames
        Main frames as logged, shape ``(frames, fields)``; the columns are those of the I layout.
    fix_time_s, fixes
        The same for the GPS; the columns are those of the G layout.
    damage
        What was lost.
    slow_time_s, slow
        The same for what is logged when it changes, such as flight modes; the columns are those of the S layout.
    adjusted
        Gains that the pilot turned in flight, by the names of :func:`parameters_of`, with their last values.
    """

    number: int
    header: Header
    time_s: FloatArray
    frames: AnyArray
    fix_time_s: FloatArray
    fixes: IntArray
    damage: Damage
    slow_time_s: FloatArray = field(default_factory=lambda: np.zeros(0))
    slow: IntArray = field(default_factory=lambda: np.zeros((0, 0), dtype=np.int64))
    adjusted: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))

    @property
    def duration_s(self) -> float:
        return float(self.time_s[-1] - self.time_s[0]) if self.time_s.size else 0.0

    @property
    def fields(self) -> tuple[str, ...]:
        return self.header.layouts["I"].names

    @property
    def slow_fields(self) -> tuple[str, ...]:
        return self.header.layouts["S"].names

    def slow_field(self, name: str) -> IntArray:
        """Samples of a field of the slow frames, shape ``(slow frames,)``."""
        column: IntArray = self.slow[:, self.slow_fields.index(name)]
        return column

    def field(self, name: str) -> IntArray:
        """Samples of a field of the main frames, shape ``(frames,)``."""
        column: IntArray = self.frames[:, self.fields.index(name)]
        return column


_LONGEST_LINE = 4096
_MOST_FIELDS = 128
_MOST_LINES = 20_000
_LONGEST_QUOTE = 200
LARGEST_CADENCE = 65_535
_MOST_PREDICTED = 8
"""Fields of a frame that take no byte at all. Loggers know one, the loop number; many would inflate a small file."""

FRAMES = "IPSGH"
GROUPED: Mapping[int, int] = MappingProxyType({6: 8, 7: 3, 8: 4, 10: 3})
"""Encodings that write several fields at once, and how many. 6 also takes fewer."""
SINGLE = frozenset({0, 1, 3, 9})
CONSTANTS: Mapping[int, str] = MappingProxyType({4: "minthrottle", 8: "", 9: "vbatref", 11: "motorOutput"})
_OF_FRAMES_BEFORE = frozenset({1, 2, 3})
_RELATIVE = frozenset({0, *_OF_FRAMES_BEFORE, 5, 6, 7, 10})

_INTEGER = re.compile(r"-?\d{1,10}")
_PARTS = MappingProxyType({"PID": ("P", "I", "D")})


@dataclass(frozen=True, kw_only=True, slots=True)
class Layout:
    """How a kind of frame is encoded.

    Parameters
    ----------
    names
        Fields in the order of the frame.
    groups
        Rows of encoding, first field, number of fields: what is read from the bytes at once.
    predictors
        Rows of predictor, constant, and whether the field has a sign. The constant is added to a field that is
        predicted by a setting (predictor 0), and the field to look at for predictors 5 and 7.
    """

    names: tuple[str, ...] = ()
    groups: tuple[tuple[int, int, int], ...] = ()
    predictors: tuple[tuple[int, int, int], ...] = ()

    @property
    def least_bytes(self) -> int:
        """Length of the shortest possible frame, with its letter."""
        return 1 + sum(encoding != 9 for encoding, _, _ in self.groups)


@dataclass(frozen=True, kw_only=True, slots=True)
class Header:
    """Settings of a flight and layouts of its frames.

    Parameters
    ----------
    values
        The lines of the header as they stand there.
    layouts
        Letter of a kind of frame to its layout; empty for kinds that the flight does not log.
    cadence
        Every how many loops an I frame comes, and that P of every Q loops are logged.
    size
        Bytes of the header.
    """

    values: Mapping[str, str]
    layouts: Mapping[str, Layout]
    cadence: tuple[int, int, int]
    size: int

    def number(self, name: str, default: float = 0.0) -> float:
        """First number of a setting, decimal or hexadecimal."""
        text = self.values.get(name, "").split(",")[0]
        value = _number(text)
        return default if value is None else value

    @property
    def firmware(self) -> tuple[str, tuple[int, int]]:
        """Name and version, such as ``("Betaflight", (4, 5))``; empty and zero where the header says neither."""
        found = _REVISION.search(self.values.get("Firmware revision", ""))
        return (found[1], (int(found[2]), int(found[3]))) if found else ("", (0, 0))


def flights(data: bytes) -> Iterator[tuple[int, Flight | LogError]]:
    """The flights of a log in their order, or why one of them cannot be read.

    A log holds no checksum: what is noticed is a frame that does not end where the next one begins, or whose loop
    number and time cannot follow those before it. Then the decoder goes on at the next I frame that can, and counts
    what lies between.

    Parameters
    ----------
    data
        The whole file.

    Raises
    ------
    LogError
        The file holds more flights than any memory.
    """
    starts = [match.start() for match in islice(re.finditer(re.escape(MAGIC), data), MOST_FLIGHTS + 1)]
    if len(starts) > MOST_FLIGHTS:
        raise LogError(
            f"this blackbox log of {len(data)} bytes starts more than {MOST_FLIGHTS} flights",
            needed="a log as the flight controller wrote it",
            remedy="download the log from the flight controller again",
        )
    for number, (start, stop) in enumerate(pairwise((*starts, len(data))), start=1):
        section = data[start:stop]
        try:
            yield number, decode(section, number)
        except LogError as error:
            yield number, error


def decode(section: bytes, number: int = 1) -> Flight:
    """Decode one flight, from its header to the next.

    Raises
    ------
    LogError
        The header is damaged.
    """
    from rotorid.io.betaflight import blackbox_kernels as kernels

    header = parse_header(section)
    written = len(section.rstrip(b"\xff"))
    body = section[header.size : written if written <= len(section) - _LEAST_ERASED else len(section)]
    data = np.frombuffer(body + bytes(_PADDING), dtype=np.uint8).astype(np.int16)
    layouts = [header.layouts[letter] for letter in FRAMES]
    intra, inter, slow, gps, _ = layouts
    width = max(len(layout.names) for layout in layouts)
    rows = len(body) // min(intra.least_bytes, inter.least_bytes) + 1
    main = np.empty((rows, len(intra.names)), dtype=np.int64)
    breaks = np.zeros(rows, dtype=np.bool_)
    fixes = np.empty((len(body) // gps.least_bytes + 1 if gps.names else 1, len(gps.names) + 1), dtype=np.int64)
    slows = np.empty((len(body) // slow.least_bytes + 1 if slow.names else 0, len(slow.names) + 1), dtype=np.int64)
    state = np.zeros(kernels.SLOTS, dtype=np.int64)
    kernels.walk(
        data,
        len(body),
        tuple(_table(layout.groups) for layout in layouts),
        tuple(_table(layout.predictors) for layout in layouts),
        np.array(header.cadence, dtype=np.int64),
        np.zeros((len(FRAMES), width), dtype=np.int64),
        np.zeros((2, width), dtype=np.int64),
        main,
        breaks,
        fixes,
        slows,
        state,
    )
    # Copies, so that the generous allocation goes.
    main, fixes = main[: state[kernels.ROWS]].copy(), fixes[: state[kernels.FIXES]].copy()
    time_s, slows = _seconds(main[:, 1]), slows[: state[kernels.SLOWS]].copy()
    return Flight(
        number=number,
        header=header,
        time_s=time_s,
        frames=main,
        fix_time_s=_fix_times(fixes, gps),
        fixes=fixes[:, :-1],
        slow_time_s=time_s[np.maximum(slows[:, -1] - 1, 0)] if time_s.size else np.zeros(len(slows)),
        slow=slows[:, :-1],
        adjusted=_adjusted(state[kernels.ADJUSTED :].reshape(-1, 2)),
        damage=Damage(
            skipped_bytes=int(state[kernels.SKIPPED]),
            places=int(state[kernels.PLACES]),
            first_byte=header.size + int(state[kernels.FIRST_BYTE]),
            lost_frames=lost_frames(main[:, 0], breaks[: len(main)], header.cadence),
            cut_bytes=int(state[kernels.CUT]),
            ended=bool(state[kernels.ENDED]),
        ),
    )


_ADJUSTABLE = MappingProxyType(
    {
        **{6 + part: ("pitchPID", "rollPID") for part in range(3)},
        **{9 + part: ("yawPID",) for part in range(3)},
        **{15 + part: ("pitchPID",) for part in range(3)},
        **{18 + part: ("rollPID",) for part in range(3)},
    }
)
"""Gains among what firmwares of this family let a pilot adjust, by its number: P, I and D of each follow each other."""


def _adjusted(functions: IntArray) -> Mapping[str, float]:
    """Last values of the gains among adjusted functions ``(functions, 2)``: whether, and its value."""
    return MappingProxyType(
        {
            f"{owner}_{'PID'[function % 3]}": float(functions[function, 1])
            for function, owners in _ADJUSTABLE.items()
            if functions[function, 0]
            for owner in owners
        }
    )


def lost_frames(iterations: IntArray, breaks: AnyArray, cadence: tuple[int, int, int]) -> int:
    """Frames that are missing between those at hand; a pause of the logger is no loss.

    Parameters
    ----------
    iterations
        Loop numbers of the frames, shape ``(frames,)``.
    breaks
        Whether the logger had paused before a frame, shape ``(frames,)``.
    cadence
        Loops from one I frame to the next, and P of every Q loops.

    Examples
    --------
    Every other of eight loops is logged; that with number 4 is missing:

    >>> import numpy as np
    >>> lost_frames(np.array([0, 2, 6, 8]), np.zeros(4, dtype=bool), (8, 1, 2))
    1
    """
    interval, some, of = cadence
    place = np.arange(interval)
    logged = ((place + some - 1) % of < some) | (place == 0)
    before = np.cumsum(logged) - 1
    index = iterations // interval * int(logged.sum()) + before[iterations % interval]
    steps = np.diff(index)[~breaks[1:]]
    return int((steps[steps > 1] - 1).sum())


def _table(rows: tuple[tuple[int, int, int], ...]) -> IntArray:
    return np.array(rows, dtype=np.int64).reshape(-1, 3)


def _seconds(stamps: IntArray) -> FloatArray:
    """Stamps in µs of 32 bits, which wrap every 71 minutes, as seconds that do not."""
    wraps = np.cumsum(np.diff(stamps, prepend=stamps[:1]) < -(WRAP // 2))
    seconds: FloatArray = (stamps + wraps * WRAP) * 1e-6
    return seconds


def _fix_times(fixes: IntArray, layout: Layout) -> FloatArray:
    """When a position was logged; old loggers do not say, and the main frame before it has to."""
    column = layout.names.index("time") if "time" in layout.names else -1
    return _seconds(fixes[:, column])


def parse_header(data: bytes) -> Header:
    """Read the lines ``H name:value`` at the beginning of a flight.

    Raises
    ------
    LogError
        The header does not say how to read the frames, or contradicts itself.
    """
    values: dict[str, str] = {}
    at = lines = 0
    while data.startswith(b"H ", at):
        end = data.find(b"\n", at, at + _LONGEST_LINE)
        if end < 0:
            break
        if (lines := lines + 1) > _MOST_LINES:
            raise _contradiction(f"it has more than {_MOST_LINES} lines")
        name, colon, value = data[at + 2 : end].decode("latin-1").rstrip("\r").partition(":")
        if colon:
            values.setdefault(name.strip(), value.strip())
        at = end + 1
    layouts = {letter: _layout(letter, values) for letter in FRAMES}
    if layouts["I"].names[:2] != ("loopIteration", "time"):
        raise _contradiction(f"the main frames begin with {', '.join(layouts['I'].names[:2]) or 'no field'}")
    return Header(values=MappingProxyType(values), layouts=layouts, cadence=_cadence(values), size=at)


def parameters_of(header: Header) -> Mapping[str, float]:
    """The numbers among the settings; of lists one name each, ``rollPID_P`` or ``motorOutput_1``.

    Examples
    --------
    >>> values = {"rollPID": "14,10,18", "minthrottle": "1070", "Craft name": "CS110"}
    >>> dict(parameters_of(Header(values=values, layouts={}, cadence=(32, 1, 4), size=0)))
    {'rollPID_P': 14.0, 'rollPID_I': 10.0, 'rollPID_D': 18.0, 'minthrottle': 1070.0}
    """
    numbers: dict[str, float] = {}
    for name, text in header.values.items():
        values = [_number(part) for part in text.split(",")]
        if name.startswith("Field ") or None in values:
            continue
        known = _PARTS.get(name[-3:], ()) if len(values) == 3 else ()
        parts = known or tuple(str(index) for index in range(len(values)))
        names = [name] if len(values) == 1 else [f"{name}_{part}" for part in parts]
        numbers |= {key: value for key, value in zip(names, values, strict=True) if value is not None}
    return numbers


def _number(text: str) -> float | None:
    """A setting as a number; hexadecimal ones are the bits of a float."""
    if re.fullmatch(r"0x[0-9a-fA-F]{8}", text):
        value = struct.unpack("<f", struct.pack("<I", int(text, 16)))[0]
    elif re.fullmatch(r"-?\d{1,15}(\.\d{1,15})?", text):
        value = float(text)
    else:
        return None
    return float(value) if math.isfinite(value) else None


def _layout(letter: str, values: Mapping[str, str]) -> Layout:
    # P frames hold the fields of I frames, and only their encoding differs.
    owner = "I" if letter == "P" else letter
    listed = values.get(f"Field {owner} name", "")
    if not listed:
        return Layout()
    names = tuple(listed.split(","))
    if len(names) > _MOST_FIELDS:
        raise _contradiction(f"{len(names)} fields of {letter} frames were announced")
    encodings = _integers(f"Field {letter} encoding", values, len(names))
    predictors = _integers(f"Field {letter} predictor", values, len(names))
    signs = _integers(f"Field {owner} signed", values, len(names))
    if encodings.count(9) > _MOST_PREDICTED:
        raise _contradiction(f"{encodings.count(9)} fields of {letter} frames take no bytes")
    if letter == "I" and not _OF_FRAMES_BEFORE.isdisjoint(predictors):
        raise _contradiction("I frames are counted from the frames before them")
    # Firmware writes the values of rare frames as they stand, whatever their header says of the frames before: INAV 7
    # to 9 announce some fields of slow frames as counted from the last one.
    codes = predictors if letter in "IP" else [0 if code in _OF_FRAMES_BEFORE else code for code in predictors]
    constants = [_prediction(names, index, code, values) for index, code in enumerate(codes)]
    return Layout(
        names=names,
        groups=_groups(letter, encodings, first_version=values.get("Data version") == "1"),
        predictors=tuple((*constant, sign) for constant, sign in zip(constants, signs, strict=True)),
    )


def _groups(letter: str, encodings: Sequence[int], *, first_version: bool) -> tuple[tuple[int, int, int], ...]:
    groups: list[tuple[int, int, int]] = []
    at = 0
    while at < len(encodings):
        code = encodings[at]
        if code not in SINGLE and code not in GROUPED:
            raise _unknown(f"encoding {code} of {letter} frames")
        count = 1
        while count < GROUPED.get(code, 1) and at + count < len(encodings) and encodings[at + count] == code:
            count += 1
        if code not in (6, *SINGLE) and count < GROUPED[code]:
            raise _contradiction(f"encoding {code} of {letter} frames needs {GROUPED[code]} fields and has {count}")
        groups.append((-8 if code == 8 and first_version else code, at, count))
        at += count
    return tuple(groups)


def _prediction(names: Sequence[str], index: int, code: int, values: Mapping[str, str]) -> tuple[int, int]:
    """Predictor and constant of a field; settings become the constant of predictor 0, which predicts nothing else."""
    if code == 8:
        return 0, 1500
    if code in CONSTANTS:
        text = values.get(CONSTANTS[code], "").split(",")[0]
        if not _INTEGER.fullmatch(text):
            raise _contradiction(f"{names[index]} is counted from {CONSTANTS[code]}, which is {text or 'not given'}")
        return 0, int(text)
    if code == 5:
        if "motor[0]" not in names[:index]:
            raise _contradiction(f"{names[index]} is counted from motor[0], which is not before it")
        return code, names.index("motor[0]")
    if code == 7:
        coordinate = "GPS_home[1]" if names[index].endswith("[1]") else "GPS_home[0]"
        home = values.get("Field H name", "").split(",")
        if coordinate not in home:
            raise _contradiction(f"{names[index]} is counted from {coordinate}, which is not logged")
        return code, home.index(coordinate)
    if code not in _RELATIVE:
        raise _unknown(f"predictor {code} of {names[index]}")
    return code, 0


def _integers(name: str, values: Mapping[str, str], count: int) -> list[int]:
    parts = values.get(name, "").split(",")
    if len(parts) != count or not all(_INTEGER.fullmatch(part) for part in parts):
        raise _contradiction(f"`{name}` should list {count} whole numbers")
    return [int(part) for part in parts]


def _cadence(values: Mapping[str, str]) -> tuple[int, int, int]:
    """Loops between I frames, and P of every Q loops: logged as ``P/Q``, as ``Q`` alone, or 0 for no P frames."""
    interval = values.get("I interval", "32")
    some, slash, of = values.get("P interval", "1/1").partition("/")
    if not slash:
        some, of = "1", some
    if not all(_INTEGER.fullmatch(text) for text in (interval, some, of)):
        raise _contradiction("the intervals of the frames are not whole numbers")
    every = int(interval)
    part, whole = (1, every) if int(of) == 0 else (int(some), int(of))
    if not (1 <= every <= LARGEST_CADENCE and 1 <= part <= whole <= LARGEST_CADENCE):
        raise _contradiction(f"I frames every {every} loops and {part} of {whole} loops logged cannot be")
    return every, part, whole


def _unknown(what: str) -> LogError:
    """A definition that no published firmware of this family writes: of a newer one, or damaged."""
    return LogError(
        f"this blackbox log has {_shown(what)}, which rotorid does not know",
        needed="predictors 0 to 11 and encodings 0, 1, 3 and 6 to 10, as Betaflight and INAV write them",
        remedy="download the log again; if its firmware is newer than rotorid, report it",
    )


def _shown(text: str) -> str:
    # What is quoted may be anything, frames among it, and a sentence is one line without control characters.
    return "".join(sign if sign.isprintable() else "\N{REPLACEMENT CHARACTER}" for sign in text[:_LONGEST_QUOTE])


def _contradiction(came: str) -> LogError:
    return LogError(
        f"the header of this blackbox log is damaged: {_shown(came)}",
        needed="the definitions of the fields, complete",
        remedy="download the log from the flight controller again",
    )
