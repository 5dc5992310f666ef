r"""Notches that follow the motors, and which filters a firmware offers against noise.

All firmwares run the notch

.. math:: H = \frac{(1 + \alpha d) - 2 \cos\omega_0 z^{-1} + (1 - \alpha d) z^{-2}}
    {(1 + \alpha) - 2 \cos\omega_0 z^{-1} + (1 - \alpha) z^{-2}}, \qquad \omega_0 = \frac{2 \pi f_0}{f_s}

and differ in how :math:`\alpha` and the floor :math:`d` follow from their parameters, and in what :math:`f_0` follows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.typing import ComplexArray, FloatArray, IntArray

FilterGroup: TypeAlias = Literal["moving notch", "fixed notch", "gyro low-pass", "D low-pass"]
"""What one change of filters is about; a proposal takes one change of each group at most."""


class Motion(NamedTuple):
    """What notches follow, in ``n`` moments of a flight."""

    speeds_hz: FloatArray | None
    """Turns per second, shape ``(motors, n)``; ``None`` where they are not logged."""
    throttle: FloatArray | None
    """Share of the throttle, shape ``(n,)``; ``None`` where it is not logged."""
    centers_hz: FloatArray | None = None
    """Logged centers of the first notch that moves, shape ``(centers, n)``; ``None`` where they are not logged."""

    def at(self, rows: IntArray) -> Motion:
        """Some of the moments."""
        return Motion(*(None if one is None else one[..., rows] for one in self))


class NoiseLines(NamedTuple):
    """Lines in the noise of a gyro, by which filters are chosen."""

    rotor_hz: tuple[float, float] | None
    """Lowest and usual frequency of the rotors' first line; ``None`` where none was found."""
    speeds_logged: bool
    """Whether the motors' speeds are in the log, so that the firmware knows them too."""
    throttle: float
    """Usual throttle, at which the usual frequency belongs."""
    fixed_hz: tuple[float, ...] = ()
    """Lines that stay where they are, the strongest first."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MovingNotches(Immutable):
    r"""Notches in ``n`` moments of a flight.

    Parameters
    ----------
    center_hz, damping, floor
        Each notch in each moment, shape ``(notches, n)``: its frequency, :math:`\alpha`, and what it leaves at its
        center.
    rate_hz
        Samples per second that they work on.
    unknown
        Why their centers are not known; empty where they are.
    settings
        Parameters that make them; empty where there is none.
    """

    center_hz: FloatArray
    damping: FloatArray
    floor: FloatArray
    rate_hz: float
    unknown: str = ""
    settings: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        names = ("center_hz", "damping", "floor")
        self._set(**{name: read_only(getattr(self, name), np.float64, ndim=2) for name in names})
        self._set(settings=self.settings)

    def response(self, omega_rad_s: FloatArray) -> ComplexArray:
        """All of them in a row, shape ``(n, f)``, at frequencies of shape ``(f,)``."""
        back = np.exp(-1j * omega_rad_s / self.rate_hz)
        total = np.ones((self.center_hz.shape[1], omega_rad_s.size), dtype=np.complex128)
        for center, damping, floor in zip(self.center_hz, self.damping, self.floor, strict=True):
            middle = -2.0 * np.cos(2.0 * np.pi * center / self.rate_hz)[:, None] * back
            square = back**2
            deep = (damping * floor)[:, None]
            over = (1.0 + deep) + middle + (1.0 - deep) * square
            total *= over / ((1.0 + damping[:, None]) + middle + (1.0 - damping[:, None]) * square)
        return total


def no_notches(unknown: str = "", settings: Mapping[str, float] | None = None) -> MovingNotches:
    """No notch that moves, or one of which it is not known where it was."""
    none = np.zeros((0, 1))
    return MovingNotches(
        center_hz=none, damping=none, floor=none, rate_hz=1.0, unknown=unknown, settings=settings or {}
    )


def rows_of(
    center_hz: FloatArray, damping: FloatArray, floor: FloatArray, rate_hz: float, settings: Mapping[str, float]
) -> MovingNotches:
    """Notches of any leading shape, the moments last."""
    count = center_hz.shape[-1]
    full = np.broadcast_arrays(center_hz, damping, floor)
    center, alpha, left = (row.reshape(-1, count) for row in full)
    return MovingNotches(center_hz=center, damping=alpha, floor=left, rate_hz=rate_hz, settings=settings)


SPEEDS_UNKNOWN = "the log does not contain the motor speeds that the notch follows"
SPECTRUM = "the notch follows the spectrum, and the log does not contain where it was"


@dataclass(frozen=True, kw_only=True)
class FilterChange(Immutable):
    """Parameters that are changed together.

    Parameters
    ----------
    group
        What it is about.
    values
        Parameters by the names of the log's parameters.
    """

    group: FilterGroup
    values: Mapping[str, float]

    def __post_init__(self) -> None:
        self._set(values=self.values)


FACTORS = (0.6, 0.75, 1.33, 1.6, 2.0)
"""Cutoffs of low-passes that are tried, relative to the flown one."""

LOWEST_CUTOFF_HZ = 15.0
"""A low-pass below it is no filter of noise any more."""


def scaled_cutoffs(
    group: FilterGroup,
    flown: Mapping[str, float],
    names: Sequence[str],
    *,
    low_hz: float = LOWEST_CUTOFF_HZ,
    high_hz: float = 1000.0,
) -> list[FilterChange]:
    """Low-passes with all cutoffs moved by one factor, in whole hertz; those that are off stay off.

    Examples
    --------
    >>> [dict(one.values) for one in scaled_cutoffs("gyro low-pass", {"IMU_GYRO_CUTOFF": 40.0}, ["IMU_GYRO_CUTOFF"])]
    [{'IMU_GYRO_CUTOFF': 24.0}, {'IMU_GYRO_CUTOFF': 30.0}, {'IMU_GYRO_CUTOFF': 53.0}, {'IMU_GYRO_CUTOFF': 64.0}, \
{'IMU_GYRO_CUTOFF': 80.0}]
    """
    own = {name: flown[name] for name in names if flown.get(name, 0.0) > 0.0}
    found = []
    for factor in FACTORS:
        values = {name: float(round(factor * value)) for name, value in own.items()}
        if values and all(low_hz <= value <= high_hz for value in values.values()):
            found.append(FilterChange(group=group, values=values))
    return found
