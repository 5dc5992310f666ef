"""Numbers of a vehicle: their names, units and signs, and where each comes from."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal, TypeAlias

from rotorid.data.base import Immutable
from rotorid.data.quantity import with_error
from rotorid.errors import UsageError
from rotorid.flying.vehicle_air import (
    AIR_UNITS,
    PLACE,
)
from rotorid.models.flight import CURVE_TERMS
from rotorid.models.parameter import no_such

if TYPE_CHECKING:
    pass

if TYPE_CHECKING:
    from rotorid.results.model import IdentifiedModel

Source: TypeAlias = Literal["identified", "given", "derived", "default"]

UNITS: Mapping[str, str] = MappingProxyType(
    {
        "m": "kg",
        "I_xx": "kg m^2",
        "I_yy": "kg m^2",
        "I_zz": "kg m^2",
        "I_xy": "kg m^2",
        "I_xz": "kg m^2",
        "I_yz": "kg m^2",
        "c_0": "N",
        "c_1": "N",
        "c_2": "N",
        "kappa": "m",
        "kappa_per_I_zz": "1/(kg m)",
        "h_per_I_zz": "rad/s",
        "h": "kg m^2/s",
        "T_motor": "s",
        "T_motor_up": "s",
        "T_motor_down": "s",
        "delay": "s",
        **dict.fromkeys(("delay_roll", "delay_pitch", "delay_yaw", "delay_thrust"), "s"),
        "X_u": "1/s",
        "Y_v": "1/s",
        "Z_w": "1/s",
        "M_u": "1/(m s)",
        "L_v": "1/(m s)",
        "L_p": "1/s",
        "M_q": "1/s",
        "N_r": "1/s",
        "arm": "m",
        "speed_max": "rad/s",
        "disc_area": "m^2",
        "spin_min": "1",
        "spin_max": "1",
        "reference_v": "V",
        **dict.fromkeys((*PLACE, "z_cg"), "m"),
        **AIR_UNITS,
    }
)
"""Numbers of a vehicle. ``I_xy I_xz I_yz`` are entries of the matrix of inertia, forward, right, down; thrust of one
rotor in hover is ``c_0 + c_1 x + c_2 x^2`` of the lagged output x from zero to one, and its angular momentum ``h x``;
what moving air adds are the terms of `rotorid.models.flight`."""

MOTION: Mapping[str, tuple[int, int]] = MappingProxyType(
    {
        "X_u": (0, 0),
        "Y_v": (1, 1),
        "Z_w": (2, 2),
        "M_u": (4, 0),
        "L_v": (3, 1),
        "L_p": (3, 3),
        "M_q": (4, 4),
        "N_r": (5, 5),
    }
)
"""Acceleration by motion: rows and columns of ``u v w p q r``."""

_POSITIVE = ("m", "I_xx", "I_yy", "I_zz", "kappa", "arm", "speed_max", "disc_area", "reference_v")

_FROM_ZERO = ("T_motor", "T_motor_up", "T_motor_down", "spin_min", "spin_max", "h", "h_per_I_zz")

INERTIA = ("I_xx", "I_yy", "I_zz")

PRODUCTS: Mapping[str, tuple[int, int]] = {"I_xy": (0, 1), "I_xz": (0, 2), "I_yz": (1, 2)}

SCALED = ("m", *CURVE_TERMS, "I_xx", "I_yy")

BODY = ("m", "I_xx", "I_yy", "I_zz", "kappa", "arm")

AGREEMENT_SIGMAS = 3.0
"""Standard deviations within which two results say the same."""

SAME = 1e-6
"""Relative difference of numbers that are the same but for how they were written."""


@dataclass(frozen=True, kw_only=True)
class VehicleNumber(Immutable):
    """A number of a vehicle, with its source.

    Parameters
    ----------
    value, unit
        SI.
    source
        ``identified`` from a log, ``given`` by the user, ``derived`` from others, ``default`` of something named.
    std
        One standard deviation of an identified number, random and model error together.
    of
        The result, the option or the vehicle that it comes from, for people.
    """

    value: float
    unit: str
    source: Source
    std: float | None = None
    of: str = ""


def given_number(name: str, value: float) -> VehicleNumber:
    """A number that the user gave."""
    return VehicleNumber(value=value, unit=UNITS[name], source="given", of=f"--set {name}")


def require_given(known: Mapping[str, float]) -> None:
    """Refuse given numbers that no vehicle has.

    Raises
    ------
    UsageError
        There is no such number, or it is out of range.
    """
    for name, value in known.items():
        if name not in UNITS:
            wrong = no_such("number of a vehicle", name, UNITS)
            raise UsageError(wrong.came, needed=wrong.needed, remedy=wrong.remedy)
        low = 0.0 if name in _FROM_ZERO else -math.inf
        if not math.isfinite(value) or value < low or (name in _POSITIVE and value <= 0.0):
            raise UsageError(
                f"{name} = {value:g} {UNITS[name]} is out of range",
                needed="a positive number" if name in _POSITIVE else "zero or a positive number",
            )


def number_words(number: VehicleNumber) -> str:
    """Value, error and unit of a number, for messages."""
    return f"{with_error(number.value, number.std)} {number.unit}"


def label_of(model: IdentifiedModel) -> str:
    """What messages call a result: its model and its logs."""
    logs = [Path(path).name for path in model.provenance.inputs]
    return f"{model.name} of {', '.join(logs[:2])}{' …' if len(logs) > 2 else ''}" if logs else model.name
