"""Choices of ``tune``."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated

from rotorid.data.trust import COMMAND_NOISE, ROBUSTNESS
from rotorid.errors import UsageError
from rotorid.settings.option import Option, Settings, Text, Written, require_seed
from rotorid.settings.parsing import NAMES, parse_assignments

if TYPE_CHECKING:
    from rotorid.typing import Axis, LoopName

TUNED_AXES: "tuple[Axis, ...]" = ("roll", "pitch", "yaw")
_OUTER: "tuple[LoopName, ...]" = ("velocity", "climb")
_POSITION = "position"
"""Its gain is the A of the velocity, as that of the angle is the A of a rate: both are tuned together."""
GAINS = ("P", "I", "D", "A")
"""A is the angle gain."""


def parse_filters(texts: Sequence[str]) -> dict[str, float]:
    """Read ``NAME=VALUE`` of one or more filters; the type of a low-pass may be a word."""
    from rotorid.proposing.filters import numbered

    return parse_assignments([numbered(text) for text in texts], option="--set", units={})


def write_filters(filters: Mapping[str, float]) -> list[str]:
    """Filters as :func:`parse_filters` reads them."""
    return [f"{name}={value:g}" for name, value in filters.items()]


FILTERS = Text("NAME=VALUE", parse_filters, repeats=True, write=write_filters)


def _draws() -> int:
    from rotorid.tuning.plant import DRAWS

    return DRAWS


@dataclass(frozen=True, kw_only=True)
class TuneSettings(Settings):
    """Choices of one run of ``tune``.

    Parameters
    ----------
    axes
        Axes to tune; roll, pitch and yaw by default. ``velocity`` is the horizontal velocity with its position
        (``position`` means the same), ``climb`` the vertical one with the height.
    robustness
        Largest sensitivity peak M_s of the rate loop and of the whole loop, on 95 of 100 likely plants.
    noise
        Largest noise of the command, relative to the flown gains.
    keep
        Gains to leave unchanged, of P, I, D and A.
    only
        Gains that may change; a short form of ``keep``.
    filters
        Filters to fly instead of those of the log, by the firmware's names.
    filter_choice
        ``keep`` for the flown filters, ``curve`` to look for others too, ``propose`` to fly the recommended ones, or
        the number of a point of the curve.
    scale
        Scale factor to a full-size helicopter, for its guidelines; ``None`` to take it from ``physical.motors``, if
        given.
    draws, seed
        Number of likely plants, and the random seed. With 50, gains of equal plants differ by a step of the grid.

    Raises
    ------
    UsageError
        A number is out of range, or a gain is unknown.

    Examples
    --------
    >>> TuneSettings(only=("P", "D")).keep
    ('I', 'A')
    """

    axes: Annotated[
        "tuple[LoopName, ...]",
        Option(
            "--axes",
            f"Axes to tune, and outer loops: velocity (with position), climb. [default: {','.join(TUNED_AXES)}]",
            "Gains",
            NAMES,
            metavar="AXIS,...",
            also="--axis",
            words=(*TUNED_AXES, "velocity", _POSITION, "climb"),
        ),
    ] = TUNED_AXES
    robustness: Annotated[
        float,
        Option(
            "--robustness",
            "Largest peak sensitivity M_s: 1.4 soft, 1.7 recommended, 2 firm, 2.5 little reserve. --check uses that "
            "of the "
            "proposal.",
            "Gains",
        ),
    ] = ROBUSTNESS
    noise: Annotated[
        float, Option("--noise", "Largest noise in the motor commands, relative to today's gains.", "Gains")
    ] = COMMAND_NOISE
    keep: Annotated[
        tuple[str, ...],
        Option(
            "--keep", "Gains to leave unchanged: P, I, D, A (angle).", "Gains", NAMES, metavar="GAIN,...", words=GAINS
        ),
    ] = ()
    only: Annotated[
        tuple[str, ...],
        Option("--only", "Gains that may change; all others stay.", "Gains", NAMES, metavar="GAIN,...", words=GAINS),
        Written("never"),
    ] = ()
    filters: Annotated[
        Mapping[str, float],
        Option("--set", "Filter to fly, by the firmware's name. Repeatable.", "Gains", FILTERS),
    ] = field(default_factory=dict)
    filter_choice: Annotated[
        str,
        Option(
            "--filters",
            "Filters with the gains: keep (as flown), curve (list what else could fly), propose, or the number of a "
            "point of that curve.",
            "Gains",
            metavar="keep|curve|propose|POINT",
        ),
        Written("given"),
    ] = "keep"
    scale: Annotated[
        float | None,
        Option("--scale", "Scale factor to a full-size helicopter.", "Judging"),
    ] = None
    draws: Annotated[int, Written()] = field(default_factory=_draws)
    seed: Annotated[int, Option("--seed", "Random seed.")] = 0

    def __post_init__(self) -> None:
        if self.keep and self.only:
            raise UsageError("--keep and --only exclude each other", remedy="give one of them")
        if wrong := [name for name in (*self.keep, *self.only) if name not in GAINS]:
            raise UsageError(f"unknown gain {wrong[0]!r}", remedy="use P, I, D or A (angle)")
        # Stored as the gains that stay, so that a choice is written in one way.
        keep = tuple(name for name in GAINS if name not in self.only) if self.only else tuple(self.keep)
        axes = dict.fromkeys("velocity" if axis == _POSITION else axis for axis in self.axes)
        self._set(axes=tuple(axes), keep=keep, only=(), filters=self.filters)
        require_seed(self.seed)
        if self.filter_choice not in ("keep", "curve", "propose") and not self.filter_choice.isdecimal():
            raise UsageError(
                f"--filters {self.filter_choice!r} is unknown",
                remedy="use keep, curve, propose or the number of a point",
            )
        if not 1.2 <= self.robustness <= 2.5:
            raise UsageError(f"--robustness {self.robustness:g} is out of range", needed="M_s from 1.2 to 2.5")
        if not 0.1 <= self.noise <= 10.0:
            raise UsageError(f"--noise {self.noise:g} is out of range", needed="a factor from 0.1 to 10")
        if len(set(self.keep)) == len(GAINS):
            raise UsageError("no gain may change", needed="at least one gain that is not kept")
        if wrong_axes := [axis for axis in self.axes if axis not in (*TUNED_AXES, *_OUTER)]:
            remedy = "use roll, pitch, yaw, velocity, position or climb"
            raise UsageError(f"unknown axis {wrong_axes[0]!r}", remedy=remedy)
        if self.scale is not None and not 1.0 <= self.scale <= 1000.0:
            raise UsageError(f"--scale {self.scale:g} is out of range", needed="a factor from 1 to 1000")
        if not 10 <= self.draws <= 1000:
            raise UsageError(f"{self.draws} draws are out of range", needed="10 to 1000 draws")

    @property
    def inner(self) -> "tuple[Axis, ...]":
        """The axes among them whose rate and angle loops are tuned."""
        return tuple(axis for loop in self.axes for axis in TUNED_AXES if axis == loop)

    @property
    def outer(self) -> "tuple[LoopName, ...]":
        """The outer loops among them."""
        return tuple(loop for loop in self.axes if loop in _OUTER)
