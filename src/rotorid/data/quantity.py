"""A number with its error and its unit: what every page, file and sentence about a flight is made of."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rotorid.data.base import Immutable
from rotorid.errors import UsageError

TWO_SIDED_95 = 1.959963984540054
"""Half width of a 95 % interval of a normal error, in standard deviations."""


@dataclass(frozen=True, kw_only=True)
class Quantity(Immutable):
    """An estimate with a 95 % interval, random and model error together.

    Parameters
    ----------
    value
        Best single number.
    std
        One standard deviation; of a skewed error, half of what holds 68 %.
    lower, upper
        Ends of the 95 % interval; infinite where a side has no bound.
    unit
        SI, ``1`` for shares; ``dB``, ``deg``, ``%`` where the field speaks so.

    Raises
    ------
    UsageError
        The value is not a finite number, or lies outside of its interval.

    Examples
    --------
    >>> Quantity.normal(39.7, 1.0, "deg").lower
    37.74003601545995
    """

    value: float
    std: float
    lower: float
    upper: float
    unit: str

    def __post_init__(self) -> None:
        if not math.isfinite(self.value) or not self.lower <= self.value <= self.upper:
            raise UsageError(f"A quantity lies within its interval; came {self.value} of {self.lower} to {self.upper}.")

    @classmethod
    def normal(cls, value: float, std: float, unit: str) -> Quantity:
        """A number with a normal error."""
        half = TWO_SIDED_95 * std
        return cls(value=value, std=std, lower=value - half, upper=value + half, unit=unit)
