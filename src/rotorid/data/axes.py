"""Axes of a vehicle, and the channels that show how it turns about them."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from rotorid.typing import Axis

RATES = ("p", "q", "r")
"""Body rates."""

ATTITUDE = ("phi", "theta", "psi")
"""Angles of roll, pitch and yaw."""

RATE_OF: Mapping[Axis, str] = MappingProxyType({"roll": "p", "pitch": "q", "yaw": "r"})
"""The body rate about each axis."""

ANGLE_OF: Mapping[Axis, str] = MappingProxyType({"roll": "phi", "pitch": "theta", "yaw": "psi"})
"""The angle about each axis."""

AXIS_WORDS: Mapping[str, Axis] = MappingProxyType({"az": "thrust", "p": "roll", "q": "pitch", "r": "yaw"})
"""The axis whose motion a channel of accelerations or rates shows first."""
