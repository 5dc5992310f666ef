"""A maneuver: an interval of a flight in which an axis was excited. It holds no data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from rotorid.typing import Axis

Kind: TypeAlias = Literal["sweep", "random_binary", "multisine", "doublet", "multistep", "other"]
Origin: TypeAlias = Literal["declared", "found", "given"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Maneuver:
    """An excited interval on the log's own clock.

    Parameters
    ----------
    axis
        The excited axis.
    kind
        What was flown. ``other`` is an excitation that fits no pattern, or one that the user gave by hand.
    start_s, stop_s
        Interval on the log's own clock, never shifted.
    band_rad_s
        Lowest and highest excited frequency, or ``None`` when it is not known.
    origin
        ``declared`` by the log itself, ``found`` in the signals, or ``given`` by the user.
    signal
        Channel in which the excitation was seen.
    """

    axis: Axis
    kind: Kind
    start_s: float
    stop_s: float
    band_rad_s: tuple[float, float] | None = None
    origin: Origin = "found"
    signal: str = ""

    def __post_init__(self) -> None:
        if not self.start_s < self.stop_s:
            raise ValueError(f"a maneuver must stop after it starts; {self.start_s} s to {self.stop_s} s came")

    @property
    def duration_s(self) -> float:
        return self.stop_s - self.start_s
