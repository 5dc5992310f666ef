"""Parameters of a log as numbers: one that is none is not known."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TypeAlias

Parameters: TypeAlias = Mapping[str, float]


def broken(parameters: Parameters, *beginnings: str) -> list[str]:
    """Parameters that damage has made infinite or no number, of those whose names begin like this.

    Examples
    --------
    >>> broken({"INS_GYRO_RATE": float("nan"), "INS_GYRO_FILTER": 20.0}, "INS_")
    ['INS_GYRO_RATE']
    """
    return [name for name, value in parameters.items() if name.startswith(beginnings) and not math.isfinite(value)]


def whole(parameters: Parameters, name: str, usual: int = 0) -> int:
    """A parameter that counts or names something, or is a mask of bits; the usual value where it is not known.

    Examples
    --------
    >>> whole({"LOG_BITMASK": 176126.0}, "LOG_BITMASK"), whole({"LOG_BITMASK": float("nan")}, "LOG_BITMASK", 5)
    (176126, 5)
    """
    value = parameters.get(name, math.nan)
    return int(value) if math.isfinite(value) else usual
