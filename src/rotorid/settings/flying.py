"""Choices of a model that flies through logs or plans."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from rotorid.errors import UsageError
from rotorid.settings.identifying import HoldChoice
from rotorid.settings.option import Option, Settings, Written, require_seed, require_words
from rotorid.settings.parsing import SEGMENTS

if TYPE_CHECKING:
    from rotorid.data.record import Maneuver


@dataclass(frozen=True, kw_only=True)
class FlySettings(Settings):
    """Choices of one run of :func:`rotorid.flying.flown_models.fly_log`.

    Parameters
    ----------
    segments
        Intervals to fly in place of the longest flight of each log.
    pieces_s
        Seconds after which the simulation restarts from the log; by default whole flights if the model allows it.
    hold
        What inputs do between their samples, as in :class:`~rotorid.settings.identifying.IdentifySettings`.
    seed
        Random seed of the draws for the bands.

    Raises
    ------
    UsageError
        A number is out of range.
    """

    segments: Annotated[
        "tuple[Maneuver, ...]",
        Option("--segment", "Fly this part of --log, in log seconds. Repeatable.", "Through a log", SEGMENTS),
    ] = ()
    pieces_s: Annotated[
        float | None,
        Option(
            "--pieces",
            "With --log: restart the simulation from the log after this time. [default: by model]",
            "Through a log",
        ),
    ] = None
    hold: Annotated[HoldChoice, Written()] = "auto"
    seed: Annotated[int, Written()] = 0

    def __post_init__(self) -> None:
        require_seed(self.seed)
        require_words(self)
        if self.pieces_s is not None and not 0.0 < self.pieces_s < math.inf:
            raise UsageError(f"--pieces {self.pieces_s:g} is not a length", needed="more than 0 s")
        self._set(segments=tuple(self.segments))
