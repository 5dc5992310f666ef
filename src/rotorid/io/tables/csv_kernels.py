"""Text to numbers as it passes by: cells of a table in CSV, with the bits that Python's own conversion gives.

A number of at most 19 digits is a whole number times a power of ten. Where the whole number is below 2⁵³ and the power
within 10^±22, both are exact in double precision, and one product or quotient is rounded once (W. D. Clinger, "How to
Read Floating Point Numbers Accurately", PLDI 1990, section 4). All other cells are left to who called: their places are
noted down.
"""

from __future__ import annotations

import numpy as np

from rotorid.compiling import njit
from rotorid.typing import AnyArray, BoolArray, FloatArray, IntArray

_POWERS = 10.0 ** np.arange(23)
_EXACT = 1 << 53


@njit(cache=True)
def parse(
    text: AnyArray, separator: int, wanted: BoolArray, table: FloatArray, first_row: int, slow: IntArray
) -> tuple[bool, int, int]:
    """Fill a table with the wanted cells of whole lines.

    Parameters
    ----------
    text
        Whole lines, ``uint8``; each ends with a line feed.
    separator
        The byte between cells.
    wanted
        Of every column of the file, whether it is, shape ``(cells,)``.
    table
        Shape ``(wanted cells, rows)``, with room for all lines behind ``first_row``.
    first_row
        Where the first of the lines goes.
    slow
        Room for all wanted cells of the text, shape ``(n, 4)``, of which those that are left to the caller are filled
        in: column, row, first byte, byte behind.

    Returns
    -------
    whole
        Whether every line had as many cells as there are columns; it ends at the first that has not.
    rows, waiting
        Number of rows, and of the cells that are left to the caller.
    """
    cells = wanted.size
    at = row = waiting = 0
    while at < text.size:
        # A line of blanks alone is none.
        first = at
        while text[first] == 32 or text[first] == 13 or (text[first] == 9 and separator != 9):
            first += 1
        if text[first] == 10:
            at = first + 1
            continue
        column = 0
        for cell in range(cells):
            begin = at
            while text[at] != separator and text[at] != 10:
                at += 1
            if wanted[cell]:
                value, known = _number(text, begin, at)
                table[column, first_row + row] = value
                if not known:
                    slow[waiting, 0], slow[waiting, 1] = column, first_row + row
                    slow[waiting, 2], slow[waiting, 3] = begin, at
                    waiting += 1
                column += 1
            if (text[at] == 10) != (cell == cells - 1):
                return False, row, waiting
            at += 1
        row += 1
    return True, row, waiting


@njit(cache=True)
def _number(text: AnyArray, begin: int, end: int) -> tuple[float, bool]:
    """The number between two bytes, and whether it can be read here."""
    while begin < end and (text[begin] == 32 or text[begin] == 9):
        begin += 1
    while end > begin and (text[end - 1] == 32 or text[end - 1] == 9 or text[end - 1] == 13):
        end -= 1
    negative = begin < end and text[begin] == 45
    if negative or (begin < end and text[begin] == 43):
        begin += 1
    whole = 0
    digits = power = 0
    point = False
    at = begin
    while at < end:
        sign = text[at]
        if 48 <= sign <= 57:
            whole = whole * 10 + (sign - 48)
            digits += 1
            if whole >= _EXACT:
                return 0.0, False
            power -= point
        elif sign == 46 and not point:
            point = True
        else:
            break
        at += 1
    if digits == 0:
        return 0.0, False
    if at < end:
        if (text[at] != 101 and text[at] != 69) or end - at > 5:
            return 0.0, False
        at += 1
        down = at < end and text[at] == 45
        if down or (at < end and text[at] == 43):
            at += 1
        if at == end:
            return 0.0, False
        exponent = 0
        while at < end:
            if not 48 <= text[at] <= 57:
                return 0.0, False
            exponent = exponent * 10 + (text[at] - 48)
            at += 1
        power += -exponent if down else exponent
    if not -22 <= power <= 22:
        return 0.0, False
    value = whole * _POWERS[power] if power >= 0 else whole / _POWERS[-power]
    return (-value if negative else value), True
