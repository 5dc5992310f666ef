"""Choices of ``track``."""

from dataclasses import dataclass
from typing import Annotated

from rotorid.data.trust import REFERENCE_S, STEP_SHARE
from rotorid.errors import UsageError
from rotorid.settings.option import Option, Settings, Written, require_words
from rotorid.typing import Axis


@dataclass(frozen=True, kw_only=True)
class TrackSettings(Settings):
    """How a model is followed through a flight.

    Parameters
    ----------
    first_s
        Of the flight, what all else is compared with.
    step_share
        The change that is looked for; 13 % by default, as of a payload that adds 15 % of inertia.
    thrust_exponent
        Power of the thrust command by which the gain grows, such as 0.8 for thrust that grows with its square; zero for
        linear thrust. Where it is not known it is taken from the reference if the throttle moved there.
    axis
        Whose rate is followed, of a result with several; the first by default.
    seed
        Of everything random; there is nothing.

    Raises
    ------
    UsageError
        The step is out of range.
    """

    first_s: Annotated[float, Option("--first", "Reference part at the start of the flight.")] = REFERENCE_S
    step_share: Annotated[float, Option("--step", "Smallest change of the gain to detect, as a share.")] = STEP_SHARE
    thrust_exponent: Annotated[
        float | None,
        Option(
            "--thrust-exponent",
            "Exponent of the gain over thrust command: 0 for linear thrust, 0.8 for quadratic. [default: from "
            "the first seconds]",
        ),
    ] = None
    axis: Annotated[
        Axis | None,
        Option("--axis", "Axis to track, of a result with several rates. [default: the first]"),
        Written("given"),
    ] = None
    seed: int = 0

    def __post_init__(self) -> None:
        require_words(self)
        if not 0.02 <= self.step_share <= 0.5:
            raise UsageError(f"--step {self.step_share:g} is out of range", needed="a share from 0.02 to 0.5")
