"""In which units a frequency response is drawn: rad/s or Hz, decibels or plain factors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from rotorid.errors import UsageError
from rotorid.plot.ticks import frequency_ticks
from rotorid.typing import FloatArray

Frequency: TypeAlias = Literal["rad/s", "Hz"]
Magnitude: TypeAlias = Literal["dB", "linear"]

_RAD_S_PER_HZ = 2.0 * np.pi


@dataclass(frozen=True, kw_only=True, slots=True)
class View:
    """The units of one picture; the arrays that come in are always rad/s.

    Parameters
    ----------
    frequency
        Unit of the horizontal axis.
    magnitude
        Decibels, or the plain factor on a linear axis.

    Raises
    ------
    UsageError
        A unit is unknown.

    Examples
    --------
    >>> View(frequency="Hz").across(np.array([6.283185307]))
    array([1.])
    """

    frequency: Frequency = "rad/s"
    magnitude: Magnitude = "dB"

    def __post_init__(self) -> None:
        for name, came, known in (
            ("frequency", self.frequency, get_args(Frequency)),
            ("magnitude", self.magnitude, get_args(Magnitude)),
        ):
            if came not in known:
                raise UsageError(f"a picture with {name}={came!r} was asked for", needed=" or ".join(map(repr, known)))

    def across(self, omega_rad_s: FloatArray) -> FloatArray:
        """Frequencies in the unit of the picture, same shape."""
        return omega_rad_s / _RAD_S_PER_HZ if self.frequency == "Hz" else omega_rad_s

    def other(self, omega_rad_s: FloatArray) -> FloatArray:
        """Frequencies in the unit that the picture does not use, for those who point at it."""
        return omega_rad_s if self.frequency == "Hz" else omega_rad_s / _RAD_S_PER_HZ

    def bands(self, bands_rad_s: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
        """Intervals of frequency in the unit of the picture."""
        factor = float(self.across(np.ones(1))[0])
        return [(low * factor, high * factor) for low, high in bands_rad_s]

    def height(self, level_db: FloatArray, *, decibels: float = 20.0) -> FloatArray:
        """Levels in the unit of the picture: ``decibels`` is 20 for amplitudes and 10 for powers."""
        return level_db if self.magnitude == "dB" else 10.0 ** (level_db / decibels)

    @property
    def pointed(self) -> str:
        """Start of the text that follows the pointer, which says a frequency in both units."""
        other = "rad/s" if self.frequency == "Hz" else "Hz"
        return f"%{{x:.3~g}} {self.frequency} (%{{customdata:.3~g}} {other})<br>"

    def axis(self, omega_rad_s: FloatArray) -> dict[str, Any]:
        """The logarithmic horizontal axis of a picture over these frequencies."""
        ticks = frequency_ticks(self.across(omega_rad_s[omega_rad_s > 0.0]))
        return {"type": "log", "title": {"text": f"Frequency [{self.frequency}]"}, "tickvals": ticks}


def decibels(magnitude: FloatArray, *, of_power: bool = False) -> FloatArray:
    """Levels in decibels, same shape; what is not positive has none and becomes not-a-number.

    Examples
    --------
    >>> decibels(np.array([10.0, 0.0])), decibels(np.array([10.0]), of_power=True)
    (array([20., nan]), array([10.]))
    """
    level = np.log10(magnitude, out=np.full(magnitude.shape, np.nan), where=magnitude > 0.0)
    return np.asarray((10.0 if of_power else 20.0) * level)
