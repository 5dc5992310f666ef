"""Blackbox logs: bytes to the flights that stand in them, field by field."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice, pairwise

import numpy as np

from rotorid.errors import LogError
from rotorid.io.blackbox_header import FRAMES, MAGIC, Header, Layout, parse_header
from rotorid.typing import AnyArray, FloatArray, IntArray

PADDING = 4096
"""More than the longest frame: 128 fields of five bytes, and their tags."""
ERASED = re.compile(rb"\xff{16,}\Z")
"""Flash memory that was never written."""
WRAP = 1 << 32
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
    """

    number: int
    header: Header
    time_s: FloatArray
    frames: IntArray
    fix_time_s: FloatArray
    fixes: IntArray
    damage: Damage

    @property
    def duration_s(self) -> float:
        return float(self.time_s[-1] - self.time_s[0]) if self.time_s.size else 0.0

    @property
    def fields(self) -> tuple[str, ...]:
        return self.header.layouts["I"].names

    def field(self, name: str) -> IntArray:
        """Samples of a field of the main frames, shape ``(frames,)``."""
        column: IntArray = self.frames[:, self.fields.index(name)]
        return column


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
            f"a blackbox log of {len(data)} bytes came that starts more than {MOST_FLIGHTS} flights",
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
    from rotorid.io import blackbox_kernels as kernels

    header = parse_header(section)
    erased = ERASED.search(section)
    body = section[header.size : erased.start() if erased else len(section)]
    data = np.frombuffer(body + bytes(PADDING), dtype=np.uint8).astype(np.int16)
    layouts = [header.layouts[letter] for letter in FRAMES]
    intra, inter, _, gps, _ = layouts
    width = max(len(layout.names) for layout in layouts)
    rows = len(body) // min(intra.least_bytes, inter.least_bytes) + 1
    main = np.empty((rows, len(intra.names)), dtype=np.int64)
    breaks = np.zeros(rows, dtype=np.bool_)
    fixes = np.empty((len(body) // gps.least_bytes + 1 if gps.names else 1, len(gps.names) + 1), dtype=np.int64)
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
        state,
    )
    # Copies, so that the generous allocation goes.
    main, fixes = main[: state[kernels.ROWS]].copy(), fixes[: state[kernels.FIXES]].copy()
    return Flight(
        number=number,
        header=header,
        time_s=_seconds(main[:, 1]),
        frames=main,
        fix_time_s=_fix_times(fixes, gps),
        fixes=fixes[:, :-1],
        damage=Damage(
            skipped_bytes=int(state[kernels.SKIPPED]),
            places=int(state[kernels.PLACES]),
            first_byte=header.size + int(state[kernels.FIRST_BYTE]),
            lost_frames=lost_frames(main[:, 0], breaks[: len(main)], header.cadence),
            cut_bytes=int(state[kernels.CUT]),
            ended=bool(state[kernels.ENDED]),
        ),
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
