"""Array types used in every signature."""

from __future__ import annotations

from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
ComplexArray: TypeAlias = NDArray[np.complex128]
BoolArray: TypeAlias = NDArray[np.bool_]
IntArray: TypeAlias = NDArray[np.int64]
AnyArray: TypeAlias = NDArray[Any]

Axis: TypeAlias = Literal["roll", "pitch", "yaw", "thrust"]
"""An input axis of a multirotor, as the mixer sees it."""

LoopName: TypeAlias = Literal["roll", "pitch", "yaw", "thrust", "velocity", "climb"]
"""A loop of a cascade: of an axis, or an outer one, of the horizontal velocity or of the climb, with its position."""
