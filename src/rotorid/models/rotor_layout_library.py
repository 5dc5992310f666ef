"""The library of rotor layouts by name, and layouts that a user describes."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files
from types import MappingProxyType
from typing import Any

import numpy as np

from rotorid.errors import ModelError
from rotorid.models.rotor_layout import UP, RotorLayout
from rotorid.models.ties import no_such
from rotorid.typing import FloatArray

SPINS: Mapping[str, float] = MappingProxyType({"ccw": 1.0, "cw": -1.0})
"""Sense of rotation seen from above to the sign of the yaw moment on the vehicle."""

_NEEDED = (
    'tables [[rotor]], each with position_m = [forward, right, down] and spin = "ccw" or "cw" seen from above, '
    "in the order of the motors; axis = [x, y, z] for a tilted rotor"
)


@cache
def _library() -> Mapping[str, Mapping[str, Any]]:
    text = files("rotorid.models").joinpath("rotor_layouts.toml").read_text(encoding="utf-8")
    return MappingProxyType(tomllib.loads(text))


def layout_names() -> tuple[str, ...]:
    """Names of the layouts in the library, sorted.

    Examples
    --------
    >>> [name for name in layout_names() if name.startswith("quad.x")]
    ['quad.x', 'quad.x.betaflight', 'quad.x.betaflight.reversed', 'quad.x.clockwise', 'quad.x.crazyflie', 'quad.x.dji']
    """
    return tuple(sorted(_library()))


def library_layout(name: str) -> RotorLayout:
    """A layout of the library, in units of the arm.

    The order of the motors is that of ArduPilot and PX4 unless the name says otherwise. Real frames are often longer
    than wide; the library knows the pattern and not the ratio.

    Parameters
    ----------
    name
        One of :func:`layout_names`.

    Raises
    ------
    ModelError
        There is no such layout.

    Examples
    --------
    >>> layout = library_layout("quad.plus")
    >>> layout.positions.round(12).tolist()[0], layout.spins.tolist()
    ([0.0, 1.0, 0.0], [1.0, 1.0, -1.0, -1.0])
    """
    if name not in _library():
        raise no_such("rotor layout", name, layout_names())
    entry = _library()[name]
    if "angles_deg" in entry:
        angles = np.radians(entry["angles_deg"])
        flat = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    else:
        flat = np.array(entry["positions"], dtype=np.float64)
        flat /= np.hypot(flat[:, 0], flat[:, 1]).max()
    return RotorLayout(
        name=name,
        positions=np.column_stack([flat, np.zeros(len(flat))]),
        spins=np.array([SPINS[spin] for spin in entry["spin"].split()]),
        yaw_weights=None if "yaw" not in entry else np.array(entry["yaw"]),
        source="the library",
    )


def named_by(key: str, value: Any) -> str | None:
    """The layout whose ``ardupilot`` or ``px4`` list holds ``value``, or ``None``."""
    return next((name for name, entry in _library().items() if value in entry.get(key, ())), None)


def layout_from_toml(text: str, *, where: str) -> RotorLayout:
    """A layout from a description: one table ``[[rotor]]`` for each motor, in the order of the log's motors.

    Parameters
    ----------
    text
        The description. ``name`` is optional.
    where
        What the messages call it.

    Raises
    ------
    ModelError
        It is no TOML, or a rotor lacks what it needs.

    Examples
    --------
    >>> text = '''
    ... [[rotor]]
    ... position_m = [0.1, 0.12, 0.0]
    ... spin = "ccw"
    ... [[rotor]]
    ... position_m = [-0.1, -0.12, 0.0]
    ... spin = "cw"
    ... axis = [0.0, 0.1, -1.0]
    ... '''
    >>> layout = layout_from_toml(text, where="frame.toml")
    >>> layout.arm_known, round(layout.arm, 4)
    (True, 0.1562)
    """
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ModelError(f"{where} is no TOML: {error}", needed=_NEEDED) from error
    unknown = sorted(set(table) - {"name", "rotor"})
    rotors = table.get("rotor")
    if unknown or not isinstance(rotors, list) or not all(isinstance(rotor, dict) for rotor in rotors) or not rotors:
        held = ", ".join(unknown) or "no tables [[rotor]]"
        raise ModelError(f"{where} holds {held}", needed=_NEEDED)
    rows = [_rotor(rotor, f"{where}, rotor {number}") for number, rotor in enumerate(rotors, start=1)]
    return RotorLayout(
        name=str(table.get("name", where)),
        positions=np.array([position for position, _, _ in rows]),
        spins=np.array([spin for _, spin, _ in rows]),
        axes=np.array([axis for _, _, axis in rows]),
        arm_known=True,
        source=where,
    )


def _rotor(rotor: Mapping[str, Any], where: str) -> tuple[FloatArray, float, FloatArray]:
    unknown = sorted(set(rotor) - {"position_m", "spin", "axis"})
    if unknown:
        raise ModelError(f"{where} holds {', '.join(unknown)}", needed=_NEEDED)
    if not isinstance(rotor.get("spin"), str) or rotor["spin"] not in SPINS:
        raise ModelError(f"{where} has the spin {rotor.get('spin')!r}", needed='"ccw" or "cw", seen from above')
    return (
        _vector(rotor.get("position_m"), f"{where}, position_m"),
        SPINS[rotor["spin"]],
        _vector(rotor.get("axis", UP), f"{where}, axis"),
    )


def _vector(value: Any, where: str) -> FloatArray:
    numbers = value if isinstance(value, Sequence) and not isinstance(value, str) else ()
    if len(numbers) != 3 or not all(isinstance(one, int | float) and not isinstance(one, bool) for one in numbers):
        raise ModelError(f"{where} is {value!r}", needed="three numbers: forward, right, down")
    return np.array(numbers, dtype=np.float64)
