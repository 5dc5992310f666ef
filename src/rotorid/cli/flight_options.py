"""Options of the commands that fly in simulation: wind, numbers of the vehicle, limits, shapes of test inputs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

if TYPE_CHECKING:
    from rotorid.data.flight_plan import Shape
    from rotorid.design.amplitude import Limits
    from rotorid.simulate.wind import Wind
    from rotorid.typing import Axis

WindOption: TypeAlias = Annotated[
    str | None, typer.Option("--wind", help="NORTH,EAST in m/s, where the air moves; one number blows north.")
]
Turbulence: TypeAlias = Annotated[
    float, typer.Option("--turbulence", help="Standard deviation of horizontal gusts in m/s.")
]
Height: TypeAlias = Annotated[float, typer.Option("--height", help="Meters above ground, for the size of the gusts.")]
Changes: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="A number of the vehicle: m, I_xx, I_yy, I_zz, T_motor, T_motor_up, T_motor_down, kappa, tau in SI units; "
        "thrust and drag as factors. Repeatable.",
    ),
]
LimitOptions: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        "--limit",
        metavar="NAME=VALUE",
        help="What a flight may reach: tilt (deg), rate (deg/s), position (m), height (m), motor_low, motor_high. "
        "[default: tilt=25, rate=180, position=10, height=5, motor_low=0.05, motor_high=0.95] Repeatable.",
    ),
]

_DEGREES = ("tilt", "rate")
_LIMITS = {
    "tilt": "tilt_rad",
    "rate": "rate_rad_s",
    "position": "position_m",
    "height": "height_m",
    "motor_low": "motor_low",
    "motor_high": "motor_high",
}
_SHAPES = {
    "sweep": "pilot_sweep",
    "log_sweep": "logarithmic_sweep",
    "multisine": "multisine",
    "binary": "random_binary",
    "doublet": "doublet",
    "2-1-1": "two_one_one",
    "3-2-1-1": "three_two_one_one",
}


def named_numbers(texts: Sequence[str] | None, option: str) -> dict[str, float]:
    """Pairs ``NAME=VALUE`` of an option that may be repeated.

    Examples
    --------
    >>> named_numbers(["m=1.5", "tau=0.01"], "--set")
    {'m': 1.5, 'tau': 0.01}
    """
    from rotorid.errors import UsageError

    numbers: dict[str, float] = {}
    for text in texts or ():
        name, sign, value = text.partition("=")
        try:
            numbers[name.strip()] = float(value)
        except ValueError:
            sign = ""
        if not sign or not math.isfinite(numbers[name.strip()]):
            raise UsageError(f"{option} {text} came", needed=f"{option} NAME=VALUE with a finite number")
    return numbers


def wind_of(text: str | None, turbulence_m_s: float, height_m: float) -> Wind:
    """The wind that options describe."""
    from rotorid.errors import UsageError
    from rotorid.simulate.wind import Wind

    parts = (text or "0").split(",")
    try:
        north, east = float(parts[0]), float(parts[1]) if len(parts) > 1 else 0.0
    except ValueError:
        parts = []
        north = east = 0.0
    if len(parts) not in (1, 2):
        raise UsageError(f"--wind {text} came", needed="--wind NORTH or --wind NORTH,EAST in m/s")
    return Wind(north_m_s=north, east_m_s=east, turbulence_m_s=turbulence_m_s, height_m=height_m)


def limits_of(texts: Sequence[str] | None) -> Limits:
    """The limits that options describe."""
    from rotorid.design.amplitude import Limits
    from rotorid.models.ties import no_such

    given = named_numbers(texts, "--limit")
    if wrong := [name for name in given if name not in _LIMITS]:
        raise no_such("limit", wrong[0], tuple(_LIMITS))
    return Limits(
        **{_LIMITS[name]: math.radians(value) if name in _DEGREES else value for name, value in given.items()}
    )


def shape_of(kind: str) -> Shape:
    """The shape behind the name that a user types.

    Examples
    --------
    >>> shape_of("3-2-1-1")
    'three_two_one_one'
    """
    from rotorid.models.ties import no_such

    known = {**_SHAPES, **{shape: shape for shape in _SHAPES.values()}}
    if kind not in known:
        raise no_such("kind of test input", kind, tuple(_SHAPES))
    return known[kind]  # type: ignore[return-value]


def axes_of(text: str) -> tuple[Axis, ...]:
    """Axes, separated by commas; ``all`` is all four."""
    from rotorid.data.channel import AXES
    from rotorid.models.ties import no_such

    names = AXES if text == "all" else tuple(part.strip() for part in text.split(","))
    if wrong := [name for name in names if name not in AXES]:
        raise no_such("axis", wrong[0], AXES)
    return names  # type: ignore[return-value]
