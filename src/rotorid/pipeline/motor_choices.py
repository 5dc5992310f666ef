"""What a user chooses for the physics of motors."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, TypeAlias

from rotorid.data.maneuver import Maneuver
from rotorid.errors import UsageError
from rotorid.models.motor_parameters import CURVE_TERMS, Curve
from rotorid.models.rotor_layout import RotorLayout
from rotorid.models.rotor_layout_library import layout_from_toml, layout_names, library_layout

MODEL = "physical.motors"
"""Name of the model, which is no linear structure."""

ChosenCurve: TypeAlias = Literal["auto"] | Curve
"""``auto``: linear for demands of thrust, quadratic for speeds, and for outputs all that the flight can tell."""


@dataclass(frozen=True, kw_only=True)
class MotorChoices:
    """Choices of one run.

    Parameters
    ----------
    known
        Values that were measured otherwise, by parameter.
    layout
        Name of a layout or a TOML file of rotors; what the log says by default.
    arm_m
        Horizontal distance of the farthest rotor from the center of gravity.
    curve
        Thrust of a rotor by its output.
    rotor_diameter_m
        Of each rotor, to judge its figure of merit where speeds were measured.
    segments
        Stretches to use instead of the excitations that are found.
    voltage
        Whether thrust follows the voltage of the battery, where outputs of motors were logged.
    seed
        Nothing is drawn; it stands in the provenance.

    Raises
    ------
    UsageError
        A length is not positive, or there is no such curve.
    """

    known: Mapping[str, float] = field(default_factory=dict)
    layout: str | None = None
    arm_m: float | None = None
    curve: ChosenCurve = "auto"
    rotor_diameter_m: float | None = None
    segments: tuple[Maneuver, ...] = ()
    voltage: bool = True
    seed: int = 0

    def __post_init__(self) -> None:
        for name, length_m in (("an arm", self.arm_m), ("a rotor diameter", self.rotor_diameter_m)):
            if length_m is not None and not length_m > 0.0:
                raise UsageError(f"{name} of {length_m:g} m came", needed="a positive length")
        if self.curve not in ("auto", *CURVE_TERMS):
            near = difflib.get_close_matches(self.curve, ["auto", *CURVE_TERMS], n=1)
            raise UsageError(
                f"the curve {self.curve!r} came",
                needed=f"auto, {', '.join(CURVE_TERMS)}",
                remedy=f"did you mean {near[0]}?" if near else "",
            )

    def as_json(self) -> dict[str, str | int | float | bool | list[str] | list[float] | None]:
        """The choices for a provenance."""
        return {
            "known": [f"{name}={value:g}" for name, value in self.known.items()],
            "layout": self.layout,
            "arm_m": self.arm_m,
            "curve": self.curve,
            "rotor_diameter_m": self.rotor_diameter_m,
            "segments": [f"{m.axis}:{m.start_s:g}:{m.stop_s:g}" for m in self.segments],
            "voltage": self.voltage,
        }


def chosen_layout(text: str) -> RotorLayout:
    """A layout of the library by its name, or that of a TOML file.

    Raises
    ------
    UsageError
        There is neither; the nearest name is suggested.
    ModelError
        The file does not describe rotors.
    """
    if text in layout_names():
        return library_layout(text)
    path = Path(text)
    if path.suffix != ".toml":
        near = difflib.get_close_matches(text, layout_names(), n=1)
        raise UsageError(
            f"there is no layout {text!r}",
            needed=f"a TOML file, or one of {', '.join(layout_names())}",
            remedy=f"did you mean {near[0]}?" if near else "",
        )
    try:
        return layout_from_toml(path.read_text(encoding="utf-8"), where=path.name)
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"{path} cannot be read: {error}", needed="a TOML file of [[rotor]] tables") from error
