"""Gains by the names, ranges and steps of each firmware.

A firmware stores a gain as a number of 32 bits, Betaflight as an integer: a proposal is rounded to what the vehicle
stores, and judged so. The names are those of :mod:`rotorid.models.autopilots.gains`.
"""

from __future__ import annotations

import math

import numpy as np

from rotorid.errors import UsageError
from rotorid.models.autopilots.gains import ahead_of, parameters_of
from rotorid.models.autopilots.settings import AxisController, Parameter
from rotorid.tuning.loops import Gains

_SAME = 1e-6


def ranges_of(controller: AxisController) -> dict[str, tuple[float, float]]:
    """Least and largest gain in SI that the firmware accepts.

    Parameters
    ----------
    controller
        As the log describes it.
    """
    return {
        letter: (parameter.low * parameter.per_si, parameter.high * parameter.per_si)
        for letter, parameter in parameters_of(controller).items()
    }


def rounded(controller: AxisController, gains: Gains) -> Gains:
    """Gains as the firmware stores them: numbers of 32 bits, or integers.

    Parameters
    ----------
    controller
        Of the axis; a gain without a parameter stays as flown.
    gains
        In SI.
    """
    flown, wanted = Gains.of(controller.controller).as_dict(), gains.as_dict()
    rounded_gains = {
        letter: _as_stored(parameter, wanted[letter]) * parameter.per_si
        for letter, parameter in parameters_of(controller).items()
        if not _is_unchanged(parameter, wanted[letter], flown[letter])
    }
    return Gains(**{**flown, **rounded_gains})


def _as_stored(parameter: Parameter, gain: float) -> float:
    """The value of a parameter for a gain, as the firmware stores it."""
    value = gain / parameter.per_si
    return float(round(value)) if parameter.integer else float(np.float32(f"{value:.4g}"))


def _is_unchanged(parameter: Parameter, gain: float, flown: float) -> bool:
    """Whether a gain equals the flown one, which is then not rounded: only its digits would change."""
    return math.isclose(_as_stored(parameter, gain), _as_stored(parameter, flown), rel_tol=_SAME, abs_tol=_SAME)


def written(controller: AxisController, gains: Gains) -> dict[str, float]:
    """Values of the firmware's parameters for some gains, by name; unchanged ones have the digits of the log.

    Parameters
    ----------
    controller
        As the log describes it, with its parameters.
    gains
        In SI.

    Raises
    ------
    UsageError
        A changed value is not finite, or outside the firmware's range.
    """
    found = {}
    flown = Gains.of(controller.controller).as_dict()
    for letter, parameter in parameters_of(controller).items():
        gain = gains.as_dict()[letter]
        if math.isfinite(gain) and _is_unchanged(parameter, gain, flown[letter]):
            found[parameter.name] = controller.gains[parameter.name]
            continue
        value = _as_stored(parameter, gain) if math.isfinite(gain) else gain
        if not (math.isfinite(value) and parameter.low * (1.0 - _SAME) <= value <= parameter.high * (1.0 + _SAME)):
            raise UsageError(
                f"{parameter.name} = {value:g} is out of range",
                needed=f"a finite value from {parameter.low:g} to {parameter.high:g}",
            )
        found[parameter.name] = value
    return found


def scaled(controller: AxisController, factor: float) -> dict[str, float]:
    """Flown values of all parameters to which the command is proportional, times a factor, by name.

    Parameters
    ----------
    controller
        As the log has it.
    factor
        On P, I, D and feed-forward, and both ends of a D that changes in flight; not on the angle gain.

    Raises
    ------
    UsageError
        A value leaves the firmware's range.
    """
    known = {parameter.name: parameter for parameter in ahead_of(controller)}
    known |= {parameter.name: parameter for letter, parameter in parameters_of(controller).items() if letter != "A"}
    found = {}
    for name, parameter in known.items():
        flown = controller.gains.get(name, 0.0)
        if flown == 0.0:
            continue
        value = _as_stored(parameter, flown * factor * parameter.per_si)
        outside = value > max(parameter.high, flown) * (1.0 + _SAME) or value < min(parameter.low, flown) * (
            1.0 - _SAME
        )
        if outside:
            raise UsageError(
                f"{name} = {value:g} is out of range",
                needed=f"a finite value from {parameter.low:g} to {parameter.high:g}",
            )
        found[name] = value
    return found
