"""Matrix entries: a number, or a signed and scaled sum of parameters, written as one would on paper."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from rotorid.errors import ModelError
from rotorid.typing import FloatArray

_NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
# A star must stand between a number and a name: "2*" and "2*-x" are slips of the pen, not sums.
_TERM = re.compile(rf"\s*([+-]?)\s*(?:({_NUMBER})\s*(?:\*\s*(?=[A-Za-z_]))?)?([A-Za-z_]\w*)?\s*")


@dataclass(frozen=True, slots=True)
class Entry:
    """An affine function of parameters: ``constant + sum(factor * parameter)``."""

    constant: float = 0.0
    terms: tuple[tuple[str, float], ...] = ()

    @classmethod
    def parse(cls, text: str | float) -> Entry:
        """Read ``0``, ``-9.81``, ``L_p``, ``-M_q`` or ``2.5*L_p - 1``.

        Raises
        ------
        ModelError
            The text is not such a sum, or a number in it is not finite.

        Examples
        --------
        >>> Entry.parse("2*L_p - 1")
        Entry(constant=-1.0, terms=(('L_p', 2.0),))
        """
        if isinstance(text, (int, float)):
            if isinstance(text, bool) or not abs(text) <= sys.float_info.max:
                raise _not_affine(str(text))
            return cls(constant=float(text))
        constant, terms, position = 0.0, [], 0
        while position < len(text):
            match = _TERM.match(text, position)
            if match is None or match.end() == position or not (match[2] or match[3]):
                raise _not_affine(text)
            if position and not match[1]:
                raise _not_affine(text)
            factor = float(match[2] or 1.0) * (-1.0 if match[1] == "-" else 1.0)
            if not math.isfinite(factor):
                raise _not_affine(text)
            if match[3]:
                terms.append((match[3], factor))
            else:
                constant += factor
            position = match.end()
        if not text.strip():
            raise _not_affine(text)
        return cls(constant=constant, terms=tuple(terms))

    def __str__(self) -> str:
        parts = [f"{'-' if factor < 0 else '+'} {_scaled(name, abs(factor))}" for name, factor in self.terms]
        if self.constant or not parts:
            parts.append(f"{'-' if self.constant < 0 else '+'} {abs(self.constant):.17g}")
        text = " ".join(parts)
        return text[2:] if text.startswith("+") else "-" + text[2:]


def _scaled(name: str, factor: float) -> str:
    return name if factor == 1.0 else f"{factor:.17g}*{name}"


def _not_affine(text: str) -> ModelError:
    return ModelError(f"the matrix entry {text!r} cannot be read", needed="a number or a sum such as '2.5*L_p - 1'")


def affine_tensor(rows: Iterable[Iterable[Entry]], names: tuple[str, ...], shape: tuple[int, int]) -> FloatArray:
    """Entries as one array, shape ``(1 + parameters, rows, columns)``: the constants, then each parameter's factor."""
    tensor = np.zeros((1 + len(names), *shape))
    for i, row in enumerate(rows):
        for j, entry in enumerate(row):
            tensor[0, i, j] = entry.constant
            for name, factor in entry.terms:
                if name not in names:
                    raise ModelError(f"a matrix names {name!r}", needed=f"one of {', '.join(names)}")
                tensor[1 + names.index(name), i, j] += factor
    return tensor
