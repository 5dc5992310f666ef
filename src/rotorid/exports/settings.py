"""Choices of ``export``."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from keyword import iskeyword
from typing import TYPE_CHECKING, Annotated, Literal

from rotorid.data.base import Immutable
from rotorid.errors import UsageError
from rotorid.exports.targets import TARGETS, target_named
from rotorid.flying.settings import CHANGES, vehicle_names
from rotorid.settings.option import Option, Text, require_seed, require_words

if TYPE_CHECKING:
    from rotorid.models.rotors import RotorLayout

_LONGEST_NAME = 40

_HIGHEST_ORDER = 10
"""Of a Padé approximation."""

_FLAGS = {"lag": "--delay-as-lag", "none": "--no-delay"}

_MOST_DRAWS = 10_000


def parse_target(name: str) -> str:
    """The name of a target that there is.

    Raises
    ------
    UsageError
        There is none of this name, or several are named.
    """
    if "," in name:
        first = name.partition(",")[0].strip()
        raise UsageError(
            f"--to takes one target, but {name!r} names several",
            remedy=f"export once for each, such as --to {first}",
        )
    return target_named(name).name


def parse_layout(text: str) -> "RotorLayout":
    """A layout of the library, or of a file of rotors."""
    from rotorid.settings.motors import chosen_layout

    return chosen_layout(text)


@dataclass(frozen=True, kw_only=True)
class ExportSettings(Immutable):
    """What a person chooses of an export.

    Parameters
    ----------
    names
        What the vehicle is called in files: letters, digits and underscores, a letter first.
    delay
        The delay from output to motion: as states by a Padé approximation, as a lag, or left out. By default
        linear models have states, and simulators of vehicles what they can hold. These know a lag alone, to which it
        is then added; those without a lag refuse it.
    pade_order
        Order of the approximation; by default one whose phase is right up to the crossover and the end of the band,
        see :func:`rotorid.simulation.rational_model.sufficient_order`.
    sample_rate_hz
        Discrete state spaces at this rate; continuous without it.

    Raises
    ------
    UsageError
        A number or the name is out of range.
    """

    names: Annotated[str, Option("--name", "Name of the vehicle.", "What is written", metavar="NAME")] = "vehicle"
    delay: Annotated[
        Literal["states", "lag", "none"] | None,
        Option(
            "--delay-as-lag", "Add the delay to the lag, for targets without delay.", "What is written", gives="lag"
        ),
    ] = None
    pade_order: Annotated[
        int | None,
        Option(
            "--pade",
            "Order of the Padé approximations of delays. [default: phase right to 0.01 deg over the band and at "
            "crossovers]",
            "What is written",
        ),
    ] = None
    sample_rate_hz: Annotated[
        float | None, Option("--sample-rate", "Rate of discrete state spaces. [default: continuous]", "What is written")
    ] = None

    def __post_init__(self) -> None:
        allowed = self.names.isascii() and self.names.isidentifier() and not iskeyword(self.names)
        if not (allowed and len(self.names) <= _LONGEST_NAME):
            raise UsageError(
                f"invalid name {self.names!r}",
                needed=f"letters, digits and underscores, a letter first, at most {_LONGEST_NAME}, and no keyword",
                remedy="choose another with --name",
            )
        require_words(self)
        if self.pade_order is not None and not 1 <= self.pade_order <= _HIGHEST_ORDER:
            raise UsageError(f"--pade {self.pade_order} is out of range", needed=f"an order from 1 to {_HIGHEST_ORDER}")
        if self.pade_order is not None and self.delay not in (None, "states"):
            raise UsageError(f"--pade has no effect with {_FLAGS[self.delay]}", remedy="give one of them")
        rate = self.sample_rate_hz
        if rate is not None and not (math.isfinite(rate) and rate > 0.0):
            raise UsageError(f"--sample-rate {rate:g} is not positive", needed="a positive number")

    @property
    def model_delay(self) -> Literal["states", "lag", "none"]:
        """What becomes of delays in linear models: states, where nothing was chosen."""
        return self.delay or "states"


@dataclass(frozen=True, kw_only=True)
class TargetSettings(Immutable):
    """What is exported, and to which tool."""

    to: Annotated[
        str,
        Option(
            "--to",
            "px4-sih, ardupilot, gazebo, mujoco, rotorpy, urdf, rl-tools (l2f, RAPTOR), crazyflow, pyflyt, "
            "aerial-gym, flightmare, "
            "allocation (ArduPilot, Betaflight, PX4), "
            "matlab (Simulink, Octave), control (python-control), fmu (Simulink, Modelica) or json.",
            "What is written",
            Text("TARGET", parse_target),
            words=tuple(TARGETS),
        ),
    ]
    given: Annotated[
        Mapping[str, float],
        Option("--set", "Value that the results do not contain, such as m=1.4. Repeatable.", "Vehicle", CHANGES),
    ] = field(default_factory=dict)
    layout: Annotated[
        "RotorLayout | None",
        Option(
            "--layout",
            "Rotor layout, if the results have none: quad.x, ..., or a file.",
            "Vehicle",
            Text("NAME|FILE.toml", parse_layout),
        ),
    ] = None
    like: Annotated[
        str | None,
        Option(
            "--like",
            "Library vehicle that supplies numbers which neither results nor --set give.",
            "Vehicle",
            metavar="NAME",
            words=vehicle_names,
        ),
    ] = None


@dataclass(frozen=True, kw_only=True)
class DrawSettings(Immutable):
    """Further vehicles, drawn from the covariance of the results.

    Raises
    ------
    UsageError
        The seed is negative.
    """

    draws: Annotated[
        int,
        Option(
            "--draws",
            "Also write N vehicles drawn from the covariance.",
            "What is written",
            within=(0, _MOST_DRAWS),
        ),
    ] = 0
    seed: Annotated[int, Option("--seed", "Random seed.")] = 0

    def __post_init__(self) -> None:
        require_seed(self.seed)
