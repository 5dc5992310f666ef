"""Gains by the names, ranges and steps of each firmware.

A firmware keeps a gain as a number of 32 bits, Betaflight as an integer: a proposal is rounded to what the vehicle will
hold, and judged as that. Which parameters hold it is a question to :mod:`rotorid.models.autopilots.gains`.
"""

from __future__ import annotations

import math

import numpy as np

from rotorid.errors import UsageError
from rotorid.models.autopilots.gains import Parameter, ahead_of, parameters_of
from rotorid.models.autopilots.settings import AxisController
from rotorid.tuning.loops import Gains

_SAME = 1e-6


def ranges_of(controller: AxisController) -> dict[str, tuple[float, float]]:
    """Least and largest gain in SI that the firmware takes."""
    return {letter: (one.low * one.per_si, one.high * one.per_si) for letter, one in parameters_of(controller).items()}


def rounded(controller: AxisController, gains: Gains) -> Gains:
    """Gains as the firmware will hold them: numbers of 32 bits, or integers.

    Parameters
    ----------
    controller
        Of the axis; what it has no parameter for stays as flown.
    gains
        In SI.
    """
    flown, wanted = Gains.of(controller.controller).as_dict(), gains.as_dict()
    held = {
        letter: _held(one, wanted[letter]) * one.per_si
        for letter, one in parameters_of(controller).items()
        if not _stays(one, wanted[letter], flown[letter])
    }
    return Gains(**{**flown, **held})


def _held(one: Parameter, gain: float) -> float:
    """The value of a parameter for a gain, as the firmware keeps it."""
    value = gain / one.per_si
    return float(round(value)) if one.integer else float(np.float32(f"{value:.4g}"))


def _stays(one: Parameter, gain: float, flown: float) -> bool:
    """Whether a gain is the flown one, which is then not rounded: nothing would have changed but its digits."""
    return math.isclose(_held(one, gain), _held(one, flown), rel_tol=_SAME, abs_tol=_SAME)


def written(controller: AxisController, gains: Gains) -> dict[str, float]:
    """Values of the firmware's parameters for some gains, by name; one that stays has the digits of the log.

    Raises
    ------
    UsageError
        A value is not finite, or outside the firmware's range; one that stays as it was flown may be.
    """
    found = {}
    flown = Gains.of(controller.controller).as_dict()
    for letter, one in parameters_of(controller).items():
        gain = gains.as_dict()[letter]
        if math.isfinite(gain) and _stays(one, gain, flown[letter]):
            found[one.name] = controller.gains[one.name]
            continue
        value = _held(one, gain) if math.isfinite(gain) else gain
        if not (math.isfinite(value) and one.low * (1.0 - _SAME) <= value <= one.high * (1.0 + _SAME)):
            raise UsageError(f"{one.name} = {value:g} came", needed=f"a finite value from {one.low:g} to {one.high:g}")
        found[one.name] = value
    return found


def scaled(controller: AxisController, factor: float) -> dict[str, float]:
    """Flown values of all parameters to which the command is proportional, times a factor, by name.

    Parameters
    ----------
    controller
        As the log tells it.
    factor
        On P, I, D and feed-forward, and both ends of a D that moves; the angle gain asks for a rate, and stays.

    Raises
    ------
    UsageError
        A value leaves the firmware's range, which the flown one had kept.
    """
    known = {one.name: one for one in ahead_of(controller)}
    known |= {one.name: one for letter, one in parameters_of(controller).items() if letter != "A"}
    found = {}
    for name, one in known.items():
        flown = controller.gains.get(name, 0.0)
        if flown == 0.0:
            continue
        value = _held(one, flown * factor * one.per_si)
        outside = value > max(one.high, flown) * (1.0 + _SAME) or value < min(one.low, flown) * (1.0 - _SAME)
        if outside:
            raise UsageError(f"{name} = {value:g} came", needed=f"a finite value from {one.low:g} to {one.high:g}")
        found[name] = value
    return found
