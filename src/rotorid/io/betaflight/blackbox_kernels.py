"""The walk through the frames of a blackbox log, number by number.

Importing this module imports Numba: do it inside a function.

Nothing in here looks where the data end: the caller pads them by more than the longest frame, so that no read can leave
the array. A frame that ends in the padding is one that the log cuts off.
"""

from __future__ import annotations

import numpy as np

from rotorid.compiling import njit
from rotorid.typing import AnyArray, IntArray

MASK = 0xFFFFFFFF
THREES = np.array(
    [
        [20, 2, 18, 2, 16, 2, 1],
        [16, 4, 12, 4, 8, 4, 2],
        [16, 6, 8, 6, 0, 6, 3],
        [20, 2, 18, 2, 16, 2, 1],
        [17, 5, 12, 5, 8, 4, 2],
        [14, 8, 7, 7, 0, 7, 3],
    ],
    dtype=np.int64,
)
"""Lowest bit in the three leading bytes and width of each number, and bytes used; by tag, then the variable kind."""


@njit(cache=True)
def unsigned(data: AnyArray, at: int) -> tuple[int, int]:
    """A number of seven bits per byte, lowest first, and the place after it."""
    value = 0
    for shift in range(0, 35, 7):
        byte = int(data[at])
        at += 1
        value |= (byte & 127) << shift
        if byte < 128:
            break
    return value & MASK, at


@njit(cache=True)
def signed(data: AnyArray, at: int) -> tuple[int, int]:
    """The same with the sign in the lowest bit."""
    value, at = unsigned(data, at)
    return (value >> 1) ^ -(value & 1), at


# One signature, or every constant width would be compiled anew.
@njit("int64(int64, int64)", cache=True)
def extended(value: int, bits: int) -> int:
    """The lowest ``bits`` of a number as a two's complement."""
    half = 1 << (bits - 1)
    return ((value & (2 * half - 1)) ^ half) - half


@njit(cache=True)
def tagged_eight(data: AnyArray, at: int, out: IntArray, first: int, count: int) -> int:
    """TAG8_8SVB: one byte says which of up to eight numbers are not zero; a lone one needs no such byte."""
    tag = 1
    if count > 1:
        tag = int(data[at])
        at += 1
    for index in range(count):
        out[first + index] = 0
        if tag >> index & 1:
            out[first + index], at = signed(data, at)
    return at


@njit(cache=True)
def tagged_three(data: AnyArray, at: int, out: IntArray, first: int, encoding: int) -> int:
    """TAG2_3S32 and TAG2_3SVARIABLE: two bits say how wide the three numbers are."""
    lead = int(data[at])
    if lead < 192:
        word = lead << 16 | int(data[at + 1]) << 8 | int(data[at + 2])
        case = (lead >> 6) + 3 * (encoding == 10)
        for index in range(3):
            out[first + index] = extended(word >> THREES[case, 2 * index], THREES[case, 2 * index + 1])
        return at + int(THREES[case, 6])
    at += 1
    for index in range(3):
        width = (lead >> 2 * index & 3) + 1
        value = 0
        for byte in range(width):
            value |= int(data[at + byte]) << 8 * byte
        out[first + index] = extended(value, 8 * width)
        at += width
    return at


@njit(cache=True)
def tagged_four(data: AnyArray, at: int, out: IntArray, first: int) -> int:
    """TAG8_4S16 since data version 2: widths of 0, 4, 8 or 16 bits, packed by half bytes, highest first."""
    tag = int(data[at])
    nibble = 2 * (at + 1)
    for index in range(4):
        code = tag >> 2 * index & 3
        width = 1 << code - 1 if code else 0
        value = 0
        for _ in range(width):
            byte = int(data[nibble >> 1])
            value = value << 4 | (byte & 15 if nibble & 1 else byte >> 4)
            nibble += 1
        out[first + index] = extended(value, 4 * width) if width else 0
    return nibble + 1 >> 1


@njit(cache=True)
def tagged_four_first(data: AnyArray, at: int, out: IntArray, first: int) -> int:
    """TAG8_4S16 of data version 1: whole bytes, lowest first; two numbers of four bits share one."""
    tag = int(data[at])
    at += 1
    index = 0
    while index < 4:
        code = tag >> 2 * index & 3
        out[first + index] = 0
        if code == 1:
            out[first + index] = extended(int(data[at]), 4)
            index += 1
            if index < 4:
                out[first + index] = extended(int(data[at]) >> 4, 4)
            at += 1
        elif code == 2:
            out[first + index] = extended(int(data[at]), 8)
            at += 1
        elif code == 3:
            out[first + index] = extended(int(data[at]) | int(data[at + 1]) << 8, 16)
            at += 2
        index += 1
    return at


@njit(cache=True)
def read_fields(data: AnyArray, at: int, groups: IntArray, row: IntArray) -> int:
    """Numbers of a frame as they were encoded, into ``row``; gives the place after them."""
    for group in range(groups.shape[0]):
        encoding, first, count = groups[group, 0], groups[group, 1], groups[group, 2]
        if encoding == 0:
            row[first], at = signed(data, at)
        elif encoding == 1:
            row[first], at = unsigned(data, at)
        elif encoding == 3:
            value, at = unsigned(data, at)
            row[first] = -extended(value, 14)
        elif encoding == 6:
            at = tagged_eight(data, at, row, first, count)
        elif encoding == 7 or encoding == 10:
            at = tagged_three(data, at, row, first, encoding)
        elif encoding == 8:
            at = tagged_four(data, at, row, first)
        elif encoding == -8:
            at = tagged_four_first(data, at, row, first)
        else:
            row[first] = 0
    return at


HALF = 1 << 31
MARKERS = np.full(256, -1, dtype=np.int64)
INTRA, INTER, SLOW, GPS, HOME, EVENT = range(6)


for _kind, _letter in enumerate(b"IPSGHE"):
    MARKERS[_letter] = _kind


# What the walk knows and counts.
ROWS, FIXES, SEARCHING, ANCHORED, ITERATION, TIME, PERIOD_NS, INTRA_ITERATION, INTRA_TIME = range(9)
SEEN_ITERATION, SEEN_TIME, SEEN, RESUMED, ENDED, SKIPPED, PLACES, FIRST_BYTE, LAST_BYTE, CUT = range(9, 19)
SLOWS = 19
ADJUSTED, FUNCTIONS = 20, 64
"""From here on two numbers for each function that a pilot can adjust in flight: whether, and its last value."""
SLOTS = ADJUSTED + 2 * FUNCTIONS

FAREWELL = np.frombuffer(b"End of log", dtype=np.uint8)

LONGEST_BLIND_US = 10_000_000
"""Longest gap between frames that is believed while the duration of a loop is not known."""
PAUSE_US = 10_000
"""How far two stamps may be apart more than their loops explain."""


@njit(cache=True)
def predict(fields: IntArray, row: IntArray, past: IntArray, home: IntArray, following: int, main_time: int) -> None:
    """Add to each number of ``row`` what the logger had taken from it; ``past`` holds two frames, last first."""
    for index in range(fields.shape[0]):
        predictor, constant = fields[index, 0], fields[index, 1]
        value = row[index] + constant
        if predictor == 1:
            value = row[index] + past[0, index]
        elif predictor == 2:
            value = row[index] + 2 * past[0, index] - past[1, index]
        elif predictor == 3:
            # The logger divides as C does: towards zero.
            total = past[0, index] + past[1, index]
            value = row[index] + (total + (total < 0) >> 1)
        elif predictor == 5:
            value = row[index] + row[constant]
        elif predictor == 6:
            value = row[index] + following
        elif predictor == 7:
            value = row[index] + home[constant]
        elif predictor == 10:
            value = row[index] + main_time
        value &= MASK
        row[index] = extended(value, 32) if fields[index, 2] else value


@njit(cache=True)
def next_iteration(iteration: int, cadence: IntArray) -> int:
    """The next loop that is logged: ``cadence`` is the I interval, and P of every Q loops."""
    interval, some, of = cadence[0], cadence[1], cadence[2]
    place = iteration % interval
    phase = (place + some) % of
    step = 1 if phase < some else 1 + of - phase
    return int(iteration - place + min(place + step, interval))


@njit(cache=True)
def consistent(steps: int, elapsed: int, period_ns: int) -> bool:
    """Whether a number of loops can have taken this time, in µs."""
    if not (0 < steps < HALF and 0 < elapsed < HALF):
        return False
    if period_ns == 0:
        return elapsed <= LONGEST_BLIND_US
    expected = steps * period_ns / 1000.0
    return bool(abs(elapsed - expected) <= 0.25 * expected + PAUSE_US)


@njit(cache=True)
def plausible(iteration: int, time: int, interval: int, state: IntArray) -> bool:
    """Whether a frame can follow what is known.

    While the place of the frames is not known, two frames that agree with each other outvote the past.
    """
    if state[ROWS] == 0:
        return True
    steps, elapsed = (iteration - state[ITERATION]) & MASK, (time - state[TIME]) & MASK
    if state[SEARCHING] == 0:
        return consistent(steps, elapsed, state[PERIOD_NS])
    if iteration % interval:
        return False
    if consistent(steps, elapsed, state[PERIOD_NS]):
        return True
    steps, elapsed = (iteration - state[SEEN_ITERATION]) & MASK, (time - state[SEEN_TIME]) & MASK
    started = state[SEEN] == 1 and consistent(steps, elapsed, state[PERIOD_NS])
    state[SEEN_ITERATION], state[SEEN_TIME], state[SEEN] = iteration, time, 1
    return started


@njit(cache=True)
def event_stop(data: AnyArray, at: int, state: IntArray) -> int:
    """The place after an event, or -1 when it is none; notes the end of the log and pauses of it."""
    code = int(data[at + 1])
    place = at + 2
    if code == 255:
        for letter in FAREWELL:
            if data[place] != letter:
                return -1
            place += 1
        state[ENDED] = 1
        return place
    if code in (0, 15, 40):
        return unsigned(data, place)[1]
    if code == 30:
        return unsigned(data, unsigned(data, place)[1])[1]
    if code == 14:
        iteration, place = unsigned(data, place)
        time, place = unsigned(data, place)
        if state[SEARCHING] == 0:
            # One loop earlier, since the frame that follows has the same number.
            state[ITERATION], state[TIME], state[RESUMED] = (iteration - 1) & MASK, (time - 1) & MASK, 1
        return place
    if code == 13:
        return place + 5 if data[place] >= 128 else signed(data, place + 1)[1]
    if code == 20:
        return signed(data, place + 1)[1] + 2
    if 10 <= code <= 12:
        return place + (5, 4, 8)[code - 10]
    return -1


@njit(cache=True)
def note_adjustment(data: AnyArray, at: int, state: IntArray) -> None:
    """Remember what was adjusted in flight, if this event says so in whole numbers, as it does for gains."""
    function = int(data[at + 2])
    if data[at + 1] == 13 and function < FUNCTIONS:
        state[ADJUSTED + 2 * function], state[ADJUSTED + 2 * function + 1] = 1, signed(data, at + 3)[0]


@njit(cache=True)
def keep(kind: int, current: IntArray, past: IntArray, main: IntArray, breaks: AnyArray, state: IntArray) -> None:
    """Make a frame part of the flight, and the base of the next."""
    iteration, time, row = current[0], current[1], state[ROWS]
    if kind == INTRA:
        steps, elapsed = (iteration - state[INTRA_ITERATION]) & MASK, (time - state[INTRA_TIME]) & MASK
        if row and state[ANCHORED] and 0 < steps < HALF and state[RESUMED] == 0:
            state[PERIOD_NS] = 1000 * elapsed // steps
        state[INTRA_ITERATION], state[INTRA_TIME], state[ANCHORED] = iteration, time, 1
    for index in range(main.shape[1]):
        # Both frames before the one after an I frame are that I frame.
        past[1, index] = current[index] if kind == INTRA else past[0, index]
        past[0, index] = main[row, index] = current[index]
    breaks[row] = state[RESUMED]
    state[ITERATION], state[TIME], state[ROWS] = iteration, time, row + 1
    state[RESUMED], state[SEARCHING], state[SEEN] = 0, 0, 0


@njit(cache=True)
def followed(data: AnyArray, stop: int, size: int, state: IntArray) -> bool:
    """Whether a frame that ends here ends at the next one, or at the end of the log."""
    return stop == size or state[ENDED] == 1 or (stop < size and MARKERS[data[stop]] >= 0)


@njit(cache=True)
def skip(at: int, state: IntArray) -> None:
    """Count a byte that belongs to nothing."""
    if state[SKIPPED] == 0:
        state[FIRST_BYTE] = at
    if state[SKIPPED] == 0 or at != state[LAST_BYTE] + 1:
        state[PLACES] += 1
    state[LAST_BYTE] = at
    state[SKIPPED] += 1
    state[SEARCHING], state[ANCHORED] = 1, 0


@njit(cache=True)
def accept(
    kind: int,
    rows: IntArray,
    past: IntArray,
    cadence: IntArray,
    main: IntArray,
    breaks: AnyArray,
    fixes: IntArray,
    slows: IntArray,
    state: IntArray,
) -> bool:
    """Take in a frame that is whole; no, when it cannot follow those before it."""
    if kind == INTRA or (kind == INTER and state[ANCHORED] == 1):
        if not plausible(rows[kind, 0], rows[kind, 1], cadence[0], state):
            return False
        keep(kind, rows[kind], past, main, breaks, state)
    elif kind == GPS:
        fix, last = state[FIXES], fixes.shape[1] - 1
        for index in range(last):
            fixes[fix, index] = rows[GPS, index]
        fixes[fix, last] = state[TIME]
        state[FIXES] = fix + 1
    elif kind == SLOW and state[SLOWS] < slows.shape[0]:
        slow, last = state[SLOWS], slows.shape[1] - 1
        for index in range(last):
            slows[slow, index] = rows[SLOW, index]
        slows[slow, last] = state[ROWS]
        state[SLOWS] = slow + 1
    return True


@njit(cache=True)
def walk(
    data: AnyArray,
    size: int,
    groups: tuple[IntArray, ...],
    fields: tuple[IntArray, ...],
    cadence: IntArray,
    rows: IntArray,
    past: IntArray,
    main: IntArray,
    breaks: AnyArray,
    fixes: IntArray,
    slows: IntArray,
    state: IntArray,
) -> None:
    """Follow the frames of a flight from its first byte to its last.

    ``main`` receives the I and P frames, ``breaks`` where the logger had paused, ``fixes`` the G frames with the time
    of the main frame before them, ``slows`` the S frames with how many main frames stand before them; ``rows``,
    ``past`` and ``state`` are zeros to work on. Loop number and time are the first two fields of a main frame. The data
    are wider than a byte, since Numba shifts bytes without a sign.
    """
    at = 0
    while at < size and state[ENDED] == 0:
        kind, searching = MARKERS[data[at]], state[SEARCHING] == 1
        stop = -1
        # Where frames begin is not known while searching: only an I frame, or the end in so many words, says so.
        if kind == EVENT and (not searching or data[at + 1] == 255):
            stop = event_stop(data, at, state)
        elif kind == INTRA or (kind >= 0 and kind != EVENT and not searching):
            stop = read_fields(data, at + 1, groups[kind], rows[kind])
            following = next_iteration(state[ITERATION], cadence)
            predict(fields[kind], rows[kind], past, rows[HOME], following, state[TIME])
        if stop > size and not searching:
            state[CUT] = size - at
            return
        whole = stop >= 0 and followed(data, stop, size, state)
        if not whole or not accept(kind, rows, past, cadence, main, breaks, fixes, slows, state):
            skip(at, state)
            at += 1
            continue
        if kind == EVENT:
            note_adjustment(data, at, state)
        at = stop
