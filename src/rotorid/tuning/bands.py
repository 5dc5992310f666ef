r"""The band in which a plant has to be measured for gains to be proposed on it.

A loop :math:`L` of a gain below a third cannot lift the sensitivity above :math:`1/(1 - 1/3) = 1.5`, whatever the error
of the plant: what has to be known ends where :math:`|L|` of the gains *that would be proposed* falls below it, some
three times their crossover. The flown gains do not count. Weak ones cross over too low, and gains whose derivative
alone has a gain of one cross over where their filters end them, where no motion is left to measure.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from rotorid.models.controller import RateController
from rotorid.tuning.loops import ControllerParts
from rotorid.tuning.plant import certain_plant
from rotorid.tuning.proposal import AxisProposal, Judged, Wishes, propose
from rotorid.typing import ComplexArray, FloatArray, LoopName

BAND_OVER_CROSSOVER = 1.5
"""A plant that was not measured so far beyond the crossover of its loop is the model's there."""

_WHOLE_OVER_CROSSOVER = 3.0
_BEYOND_REVERSAL = 1.5
"""No loop crosses over where a proportional gain alone has lost 180 degrees, and none matters so far beyond it."""

LOWEST_RAD_S = 2.0
"""Below it the speed of a vehicle acts, which rate models lack, and no margin lies there."""


def needed_band(
    axis: LoopName,
    plant: Callable[[FloatArray], ComplexArray],
    controller: RateController,
    parts: ControllerParts,
    *,
    wishes: Wishes | None = None,
    ends: Sequence[ControllerParts] = (),
) -> tuple[float, float]:
    """Lowest and highest frequency, in rad/s, of a sweep on which gains can be proposed for an axis.

    Parameters
    ----------
    axis
        ``roll``, ``pitch`` or ``yaw``.
    plant
        The most likely one, rate by command, by frequencies of shape ``(f,)``; it counts as certain here.
    controller, parts, wishes, ends
        As for :func:`rotorid.tuning.proposal.propose`.

    Examples
    --------
    >>> def plant(w):
    ...     return 437.0 / (1j * w + 2.0) * np.exp(-0.0025j * w)
    >>> from rotorid.tuning.loops import frequency_grid
    >>> flown = RateController(proportional_s=0.0675, integral=0.0675, angle_1_s=3.0, step_s=1.0 / 400.0)
    >>> omega = frequency_grid(flown)
    >>> ones = np.ones(omega.size, dtype=complex)
    >>> parts = ControllerParts(controller=flown, omega_rad_s=omega, filters=ones, logged=ones)
    >>> low, high = needed_band("roll", plant, flown, parts)
    >>> low, 90.0 < high < 300.0
    (2.0, True)
    """
    return band_of(foreseen(axis, plant, controller, parts, wishes=wishes, ends=ends), plant, parts)


def foreseen(
    axis: LoopName,
    plant: Callable[[FloatArray], ComplexArray],
    controller: RateController,
    parts: ControllerParts,
    *,
    wishes: Wishes | None = None,
    ends: Sequence[ControllerParts] = (),
) -> AxisProposal:
    """The gains that would be proposed after the sweep, if the plant were found as it is believed to be.

    Parameters
    ----------
    axis, plant, controller, parts, wishes, ends
        As for :func:`needed_band`.
    """
    # As after the sweep: modes of the speed lie below its band, and with them good loops would count as unstable.
    certain = certain_plant(plant, lowest_rad_s=LOWEST_RAD_S)
    return propose(axis, certain, controller, parts=parts, ends=ends, wishes=wishes)


def band_of(
    found: AxisProposal, plant: Callable[[FloatArray], ComplexArray], parts: ControllerParts
) -> tuple[float, float]:
    """Lowest and highest frequency, in rad/s, of a sweep on which gains that are foreseen can be proposed.

    Parameters
    ----------
    found
        See :func:`foreseen`.
    plant, parts
        As for :func:`needed_band`.
    """
    highest = min(_WHOLE_OVER_CROSSOVER * crossover_rad_s(found.proposed), _reversal_rad_s(plant, parts))
    return LOWEST_RAD_S, max(highest, 2.0 * LOWEST_RAD_S)


def crossover_rad_s(gains: Judged) -> float:
    """Higher of the usual crossovers of the rate loop and of the whole one."""
    return max(gains.rate.usual_crossover_rad_s, gains.whole.usual_crossover_rad_s)


def _reversal_rad_s(plant: Callable[[FloatArray], ComplexArray], parts: ControllerParts) -> float:
    """Some way beyond where the loop of a proportional gain alone has lost 180 degrees."""
    omega = parts.omega_rad_s
    fast = omega >= LOWEST_RAD_S
    phase = np.unwrap(np.angle(plant(omega[fast]) * parts.by_rate["P"][fast]))
    # It begins as an integral, at -90 degrees, whatever turn the first angle was taken on.
    phase -= 2.0 * np.pi * np.round((phase[0] + 0.5 * np.pi) / (2.0 * np.pi))
    behind = np.flatnonzero(phase <= -np.pi)
    return float(_BEYOND_REVERSAL * omega[fast][behind[0]]) if behind.size else np.inf
