"""How a blackbox log writes numbers. Importing this module imports Numba: do it inside a function.

Nothing in here looks where the data end: the caller pads them by more than the longest frame.
"""

from __future__ import annotations

import numpy as np
from numba import njit

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
