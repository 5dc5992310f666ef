"""Filters inside a controller, as its parameters describe them: at the rate of its program, or in continuous time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import numpy as np

from rotorid.autopilots.filters import KnownFilter, butterworth_low_pass, notch
from rotorid.errors import UsageError
from rotorid.typing import ComplexArray

FilterKind: TypeAlias = Literal["PT1", "PT2", "PT3", "Butterworth", "notch"]
"""One to three equal first-order low-passes in a row, a second-order Butterworth low-pass, a second-order notch."""

_STAGES = {"PT1": 1, "PT2": 2, "PT3": 3}


@dataclass(frozen=True, kw_only=True, slots=True)
class LoopFilter:
    r"""One filter.

    .. math:: \text{PT}n: \left( \frac{1}{1 + c s / \omega_0} \right)^n, \; c = \sqrt{2^{1/n} - 1}; \qquad
        \text{Butterworth}: \frac{1}{x^2 + \sqrt 2 x + 1}; \qquad
        \text{notch}: \frac{x^2 + d x / Q + 1}{x^2 + x / Q + 1}, \qquad x = \frac{s}{\omega_0}

    and with a step the digital filters of :mod:`rotorid.autopilots.filters`: first-order stages are backward
    differences, the others come by the bilinear transformation, exact at :math:`\omega_0`. A Butterworth low-pass or a
    notch at half of the program's rate or beyond is none, as in the firmware.

    Parameters
    ----------
    kind
        What it is.
    frequency_hz
        Cutoff, or center of a notch.
    quality, floor
        :math:`Q` of a notch and what it leaves at its center, :math:`d`.

    Raises
    ------
    UsageError
        The kind is none of these, or a number cannot be.

    Examples
    --------
    >>> low_pass = LoopFilter(kind="PT1", frequency_hz=20.0)
    >>> round(float(abs(low_pass.response(np.array([2j * np.pi * 20.0]))[0])), 4)
    0.7071
    """

    kind: FilterKind
    frequency_hz: float
    quality: float = 0.0
    floor: float = 0.0

    def __post_init__(self) -> None:
        if self.kind not in get_args(FilterKind):
            raise UsageError(f"unknown filter kind {self.kind!r}", needed=", ".join(get_args(FilterKind)))
        if not (0.0 < self.frequency_hz < math.inf and 0.0 <= self.floor < math.inf):
            raise UsageError(f"got {self.kind} at {self.frequency_hz:g} Hz", needed="a positive, finite frequency")
        if self.kind == "notch" and not 0.0 < self.quality < math.inf:
            raise UsageError(f"got a notch of quality {self.quality:g}", needed="a positive quality")

    def sampled(self, rate_hz: float) -> KnownFilter | None:
        """The digital filter of a program, or ``None`` where the program leaves it out.

        Parameters
        ----------
        rate_hz
            Steps of the program per second.
        """
        if self.kind in _STAGES:
            # Firmwares take these at any cutoff: one beyond half of the rate passes nearly all.
            stages = _STAGES[self.kind]
            gain = 1.0 / (1.0 + _slower(stages) * rate_hz / (2.0 * math.pi * self.frequency_hz))
            return KnownFilter(
                name=f"{self.kind} low-pass at {self.frequency_hz:.4g} Hz",
                numerator=(gain**stages,),
                denominator=tuple(np.polynomial.polynomial.polypow([1.0, gain - 1.0], stages).tolist()),
                rate_hz=rate_hz,
            )
        if self.frequency_hz >= 0.5 * rate_hz:
            return None
        if self.kind == "Butterworth":
            return butterworth_low_pass(self.frequency_hz, rate_hz)
        return notch(self.frequency_hz, self.quality, rate_hz, floor=self.floor)

    def response(self, s: ComplexArray, step_s: float = 0.0) -> ComplexArray:
        r"""Response at values of :math:`s`, on the imaginary axis, shape ``(f,)``.

        Parameters
        ----------
        s
            :math:`j\omega`, shape ``(f,)``.
        step_s
            Step of the program; zero for continuous time.
        """
        if step_s > 0.0:
            known = self.sampled(1.0 / step_s)
            return np.ones_like(s) if known is None else known.response(s.imag)
        x = s / (2.0 * math.pi * self.frequency_hz)
        if self.kind in _STAGES:
            stages = _STAGES[self.kind]
            return np.asarray((1.0 + _slower(stages) * x) ** -stages)
        if self.kind == "Butterworth":
            return np.asarray(1.0 / (x**2 + math.sqrt(2.0) * x + 1.0))
        return np.asarray((x**2 + self.floor * x / self.quality + 1.0) / (x**2 + x / self.quality + 1.0))


def _slower(stages: int) -> float:
    """Time constant of each of some equal stages, relative to that of one with the same cutoff."""
    return math.sqrt(2.0 ** (1.0 / stages) - 1.0)
