"""Options of ``physical.motors``, the one model that is no linear structure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

if TYPE_CHECKING:
    from rotorid.pipeline.motor_choices import MotorChoices
    from rotorid.pipeline.settings import IdentifySettings

MODEL = "physical.motors"

Layout: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--layout", help="Of physical.motors: quad.x, hexa.plus, ... or FILE.toml of rotors. [default: as the log says]"
    ),
]
Arm: TypeAlias = Annotated[
    float | None,
    typer.Option("--arm", help="Of physical.motors: meters from the center of gravity to the farthest rotor."),
]
Curve: TypeAlias = Annotated[
    str, typer.Option("--curve", help="Of physical.motors, thrust by output: linear, quadratic, affine or polynomial.")
]

RotorDiameter: TypeAlias = Annotated[
    float | None,
    typer.Option("--rotor-diameter", help="Of physical.motors, meters: judges rotors whose speed was measured."),
]

_USED = ("fix", "segments", "seed", "method")


def motor_choices(
    model: str,
    settings: IdentifySettings,
    *,
    layout: str | None,
    arm: float | None,
    curve: str,
    rotor_diameter: float | None,
    also: Mapping[str, str | None],
) -> MotorChoices | None:
    """What was chosen for ``physical.motors``; ``None`` for another model.

    ``also`` are options beside the settings that it does not have either.

    Raises
    ------
    UsageError
        An option was given that the model does not have.
    """
    from rotorid.errors import UsageError

    if model != MODEL:
        if layout is not None or arm is not None or rotor_diameter is not None or curve != "auto":
            raise UsageError(f"--layout, --arm or --curve came with {model}", needed=f"them with {MODEL} alone")
        return None
    from rotorid.pipeline.motor_choices import MotorChoices

    usual = type(settings)()
    given = [
        one.name
        for one in fields(settings)
        if one.name not in _USED and getattr(settings, one.name) != getattr(usual, one.name)
    ]
    if settings.method not in ("auto", "prediction_error"):
        given.append("method")
    given += [name for name, value in also.items() if value]
    if given:
        raise UsageError(
            f"{', '.join(name.replace('_', ' ') for name in given)} came with {MODEL}, which has no such choice",
            needed="--fix, --layout, --arm, --curve, --segment, --verify",
            remedy="leave it out, or choose another model",
        )
    return MotorChoices(
        known=settings.fix,
        layout=layout,
        arm_m=arm,
        curve=curve,  # type: ignore[arg-type]
        rotor_diameter_m=rotor_diameter,
        segments=settings.segments,
        seed=settings.seed,
    )
