"""Choices of ``tune``."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated

from rotorid.data.trust import COMMAND_NOISE, ROBUSTNESS
from rotorid.errors import UsageError
from rotorid.settings.option import Option, Settings, Text, Written, require_seed
from rotorid.settings.parsing import NAMES, parse_assignments

if TYPE_CHECKING:
    from rotorid.typing import Axis

TUNED_AXES: "tuple[Axis, ...]" = ("roll", "pitch", "yaw")
GAINS = ("P", "I", "D", "A")
"""A is that of the angle."""


def parse_filters(texts: Sequence[str]) -> dict[str, float]:
    """Read ``NAME=VALUE`` of filters once or more; a type of low-pass may come as its word."""
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
        Those to look at; all by default.
    robustness
        Largest sensitivity peak M_s of the rate loop and of the whole one, on 95 of 100 likely plants.
    noise
        Noise of the command at most, as a factor on that of the flown gains.
    keep
        Gains that stay, of P, I, D and A.
    only
        Gains that may change, in place of ``keep``.
    filters
        Filters that are to be flown, by the firmware's names, where they are not those of the log.
    scale
        How many times larger a helicopter of full scale is, for guidelines made for those; ``None`` where the fit of
        ``physical.motors`` is to say, or none.
    draws, seed
        How many likely plants, and the seed of the draws. Of 50 the gains of equal plants differ by a step of the grid.

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
        "tuple[Axis, ...]",
        Option(
            "--axes",
            f"Axes to tune. [default: {','.join(TUNED_AXES)}]",
            "Gains",
            NAMES,
            metavar="AXIS,...",
            also="--axis",
            words=TUNED_AXES,
        ),
    ] = TUNED_AXES
    robustness: Annotated[
        float,
        Option(
            "--robustness",
            "Largest sensitivity peak M_s of every loop: 1.4 soft, 1.7 recommended, 2 firm, 2.5 little reserve; "
            "--check takes that of the proposal.",
            "Gains",
        ),
    ] = ROBUSTNESS
    noise: Annotated[
        float, Option("--noise", "Noise of the motors at most, as a factor on that of the flown gains.", "Gains")
    ] = COMMAND_NOISE
    keep: Annotated[
        tuple[str, ...],
        Option(
            "--keep", "Those that stay, of P, I, D and A (the angle).", "Gains", NAMES, metavar="GAIN,...", words=GAINS
        ),
    ] = ()
    only: Annotated[
        tuple[str, ...],
        Option("--only", "Those that may change; all others stay.", "Gains", NAMES, metavar="GAIN,...", words=GAINS),
        Written("never"),
    ] = ()
    filters: Annotated[
        Mapping[str, float],
        Option("--set", "A filter that is to be flown, by the firmware's name. Repeatable.", "Gains", FILTERS),
    ] = field(default_factory=dict)
    scale: Annotated[
        float | None,
        Option("--scale", "How many times larger a helicopter of full scale is, for its guidelines.", "Judging"),
    ] = None
    draws: Annotated[int, Written()] = field(default_factory=_draws)
    seed: Annotated[int, Option("--seed", "Of the draws of likely plants.")] = 0

    def __post_init__(self) -> None:
        if self.keep and self.only:
            raise UsageError("--keep and --only came together", needed="one of them")
        if wrong := [name for name in (*self.keep, *self.only) if name not in GAINS]:
            raise UsageError(f"the gain {wrong[0]} came", needed="of P, I, D and A")
        # What may change is held as what stays, so that a choice is written in one way.
        keep = tuple(name for name in GAINS if name not in self.only) if self.only else tuple(self.keep)
        self._set(axes=tuple(self.axes), keep=keep, only=(), filters=self.filters)
        require_seed(self.seed)
        if not 1.2 <= self.robustness <= 2.5:
            raise UsageError(f"--robustness {self.robustness:g} came", needed="a largest M_s from 1.2 to 2.5")
        if not 0.1 <= self.noise <= 10.0:
            raise UsageError(f"--noise {self.noise:g} came", needed="a factor from 0.1 to 10")
        if len(set(self.keep)) == len(GAINS):
            raise UsageError("all gains stay", needed="at least one that may change")
        if wrong_axes := [axis for axis in self.axes if axis not in TUNED_AXES]:
            raise UsageError(f"the axis {wrong_axes[0]} came", needed=", ".join(TUNED_AXES))
        if self.scale is not None and not 1.0 <= self.scale <= 1000.0:
            raise UsageError(f"--scale {self.scale:g} came", needed="full scale over the vehicle, from 1 to 1000")
        if not 10 <= self.draws <= 1000:
            raise UsageError(f"{self.draws} draws came", needed="10 to 1000")
