"""Reads files of gains back, as a vehicle does."""

from __future__ import annotations

_TYPES = ("6", "9")
"""Of a whole and of a real number, as QGroundControl has them."""


def parsed(text: str) -> dict[str, float]:
    """Parameters of a file of any autopilot, by name."""
    found = {}
    for line in text.splitlines():
        if line.startswith("#") or not line.strip():
            continue
        parts = line.replace(",", " ").replace("=", " ").split()
        if (len(parts) == 5 and parts[4] in _TYPES) or (parts[0] == "param" and len(parts) == 4):
            found[parts[2]] = float(parts[3])
        elif parts[0] == "set" and len(parts) == 3 and parts[2].lstrip("-").isdigit():
            found[parts[1]] = float(parts[2])
        elif len(parts) == 2 and parts[0].isupper():
            found[parts[0]] = float(parts[1])
    return found
