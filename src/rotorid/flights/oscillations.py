r"""Axes that swing by themselves, and which gains to lower by how much.

A third of P, I and D leaves simulated limit cycles a gain margin of 2 to 6 dB: they turned stable at 0.44 to 0.67 of
the gains with which they swung. That alone is not enough where the integral or the angle loop then becomes too quick
for the slower rate loop. So with the frequency :math:`\omega` of the swing

.. math:: I \le P \omega / 10, \qquad A \le \omega / 8

and where I makes more of the command at :math:`\omega` than P, as in slow swings, P and D stay and I goes to a third
at least. A log that is too slow for the frequency gets the limits of 4 Hz. Flown in simulation, one such step ended 40
of 40 limit cycles and 12 of 12 slow swings. It is a step to a safe flight, not a tuning: that comes after it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.display import capital, listed
from rotorid.data.findings import Finding, warn
from rotorid.data.record import FlightRecord
from rotorid.errors import UsageError
from rotorid.flights.controllers import controllers_of
from rotorid.models.autopilots.gains import parameters_of
from rotorid.models.autopilots.settings import AxisController
from rotorid.signal.oscillations import Oscillation, check_oscillations
from rotorid.tuning.firmware import ranges_of, scaled, written
from rotorid.tuning.loops import Gains
from rotorid.typing import Axis

RATE_GAINS = ("P", "I", "D")

_USUAL: Mapping[str, tuple[str, ...]] = {"rate": RATE_GAINS, "attitude": ("I", "A")}
"""Gains to lower where the log has none. A slow swing with too much integral swings on with all of them lowered."""

LOWERED = 1.0 / 3.0
"""Of the gains that flew."""

_INTEGRAL_BELOW, _ANGLE_BELOW = 10.0, 8.0
"""Frequency of the swing over I / P, and over A, at least."""

_UNKNOWN_HZ = 4.0
"""Frequency used if unknown: limit cycles of multirotors are rarely slower."""


@dataclass(frozen=True, kw_only=True)
class OscillationReview(Immutable):
    """An axis that swings by itself, and what to change.

    Parameters
    ----------
    axis
        ``roll``, ``pitch`` or ``yaw``.
    loop
        ``rate`` for a limit cycle, ``attitude`` for a slow swing.
    frequency_hz
        ``None`` where the log is too slow for it.
    rms
        Of the command about its mean, as a share of its range.
    at_limit_percent
        How much of the flight, or of its part that swings, a motor was at a limit; ``None`` where that is not known.
    limited
        Whether a motor was there in so many powered samples that the log shows limits on all axes.
    error_rms_rad
        Of the attitude against its set-point, for a slow swing.
    gains
        Parameter to its value as flown and as proposed for the next flight; empty where the log has no gains.
    lower
        Letters of the gains to lower: P, I and D of the rate loop, A of the angle loop.
    """

    axis: Axis
    loop: Literal["rate", "attitude"]
    frequency_hz: float | None
    rms: float
    at_limit_percent: float | None
    limited: bool = False
    error_rms_rad: float | None = None
    gains: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    lower: tuple[str, ...] = RATE_GAINS

    def __post_init__(self) -> None:
        self._set(gains=self.gains)

    @property
    def lower_words(self) -> str:
        """The gains to lower, in words."""
        return gain_words((self,))


def reviewed_oscillations(record: FlightRecord) -> tuple[OscillationReview, ...]:
    """The axes of a flight that swing, with the gains for the next one.

    Raises
    ------
    InsufficientDataError
        The vehicle never flew, or the log does not show whether it did.
    """
    return tuple(_reviewed(record, oscillation) for oscillation in check_oscillations(record).found)


def _reviewed(record: FlightRecord, found: Oscillation) -> OscillationReview:
    """An oscillation with the gains for the next flight, if the log has the gains flown."""
    axis = found.axis
    controller = controllers_of(record).axis(axis)
    gains = lowered(controller, found.frequency_hz) if controller is not None else {}
    return OscillationReview(
        axis=axis,
        loop=found.loop,
        frequency_hz=found.frequency_hz,
        rms=found.rms,
        at_limit_percent=found.at_limit_percent,
        limited=found.limited,
        error_rms_rad=found.error_rms_rad,
        gains=gains,
        lower=_letters(controller, gains) if controller is not None and gains else _USUAL[found.loop],
    )


def _by_integral(controller: AxisController, frequency_hz: float | None) -> bool:
    """Whether I makes more of the command than P at a frequency."""
    flown = Gains.of(controller.controller)
    return frequency_hz is not None and 2.0 * math.pi * frequency_hz * flown.P < flown.I


def lowered(controller: AxisController, frequency_hz: float | None) -> dict[str, tuple[float, float]]:
    """Parameters to change before the next flight: name to the value as flown and the proposed one.

    Parameters
    ----------
    controller
        Of the axis that swings, as flown.
    frequency_hz
        Of the swing; ``None`` where it is not known.
    """
    flown = Gains.of(controller.controller)
    omega = 2.0 * math.pi * (_UNKNOWN_HZ if frequency_hz is None else frequency_hz)
    slowly = _by_integral(controller, frequency_hz)
    factor = 1.0 if slowly else LOWERED
    wanted = Gains(
        P=factor * flown.P,
        I=min(LOWERED * flown.I, factor * flown.P * omega / _INTEGRAL_BELOW),
        D=factor * flown.D,
        A=min(flown.A, omega / _ANGLE_BELOW),
    )
    try:
        values = written(controller, _inside(wanted, flown, ranges_of(controller)))
        if not slowly:
            # Both ends of a D that moves.
            values = {name: value for name, value in scaled(controller, LOWERED).items() if name[:2] == "d_"} | values
    except UsageError:
        return {}
    return {
        name: (controller.gains[name], value)
        for name, value in values.items()
        if not math.isclose(value, controller.gains[name], rel_tol=1e-6)
    }


def _letters(controller: AxisController, changed: Mapping[str, tuple[float, float]]) -> tuple[str, ...]:
    """Which gains the changed parameters hold; those that the parameters of an axis do not name are ends of D."""
    names = {parameter.name: letter for letter, parameter in parameters_of(controller).items()}
    found = {names.get(name, "D") for name in changed}
    return tuple(letter for letter in "PIDA" if letter in found)


def _inside(wanted: Gains, flown: Gains, ranges: dict[str, tuple[float, float]]) -> Gains:
    """Gains that the firmware takes; one that flew below its range stays."""
    own, found = flown.as_dict(), wanted.as_dict()
    for letter, (low, high) in ranges.items():
        found[letter] = min(own[letter], float(np.clip(found[letter], low, high)))
    return Gains(**found)


def oscillation_findings(found: tuple[OscillationReview, ...]) -> tuple[Finding, ...]:
    """A warning for each axis that swings, with what to do."""
    return tuple(
        warn(
            "oscillation",
            oscillation.axis,
            f"{describe((oscillation,))} {remedy(oscillation)}",
            **numbers_of(oscillation),
        )
        for oscillation in found
    )


def numbers_of(oscillation: OscillationReview) -> dict[str, float]:
    """Those of an oscillation that are known, by name."""
    known = {
        "frequency_hz": oscillation.frequency_hz,
        "rms": oscillation.rms,
        "at_limit_percent": oscillation.at_limit_percent,
    }
    return {name: value for name, value in known.items() if value is not None}


def describe(found: tuple[OscillationReview, ...]) -> str:
    """Axes, frequency and size of oscillations, in one sentence.

    Examples
    --------
    >>> one = OscillationReview(axis="roll", loop="rate", frequency_hz=22.9, rms=0.54, at_limit_percent=98.2)
    >>> describe((one,))
    'Roll oscillates at 22.9 Hz, with a motor at a limit for 98 % of the flight.'
    >>> describe((one, OscillationReview(axis="pitch", loop="rate", frequency_hz=5.0, rms=0.2, at_limit_percent=98.2)))
    'Roll and pitch oscillate at 22.9 and 5.0 Hz, with a motor at a limit for 98 % of the flight.'
    """
    axes = capital(listed([oscillation.axis for oscillation in found]))
    verb = "oscillates" if len(found) == 1 else "oscillate"
    first = max(found, key=lambda oscillation: oscillation.rms)
    known = [f"{oscillation.frequency_hz:.1f}" for oscillation in found if oscillation.frequency_hz is not None]
    at = f" at {listed(known if len(set(known)) > 1 else known[:1])} Hz" if len(known) == len(found) else ""
    parts = []
    if first.at_limit_percent is not None and first.at_limit_percent >= 1.0:
        parts.append(f"with a motor at a limit for {first.at_limit_percent:.0f} % of the flight")
    if first.error_rms_rad is not None:
        parts.append(f"{math.degrees(first.error_rms_rad):.0f}° (rms) off its set-point")
    if not parts:
        parts.append(f"its command at {first.rms:.2f} of its range (rms)")
    return f"{axes} {verb}{at}, {' and '.join(parts)}."


def limits_shown(found: tuple[OscillationReview, ...]) -> str:
    """Why no axis of a flight can be measured: motors at their limits answer to no command, of a calm axis neither."""
    return f"{describe(found)} The log therefore shows the motor limits, not the vehicle."


def motors_limited(found: tuple[OscillationReview, ...]) -> bool:
    """Whether motors are at their limits so much that the flight shows the limits on all axes, and not the vehicle."""
    return any(oscillation.limited for oscillation in found)


def remedy(oscillation: OscillationReview) -> str:
    """Which gains to lower, with their values where the log has them.

    Examples
    --------
    >>> one = OscillationReview(axis="roll", loop="rate", frequency_hz=22.9, rms=0.54, at_limit_percent=98.2)
    >>> remedy(one)
    'Lower P, I and D of roll to a third before the next flight.'
    """
    if not oscillation.gains:
        return f"Lower {oscillation.lower_words} of {oscillation.axis} to a third before the next flight."
    values = ", ".join(f"{name} from {flown:.4g} to {new:.4g}" for name, (flown, new) in oscillation.gains.items())
    return f"Lower {oscillation.lower_words} of {oscillation.axis} before the next flight: {values}."


def gain_words(found: tuple[OscillationReview, ...]) -> str:
    """The gains to lower of some axes, in words.

    Examples
    --------
    >>> one = OscillationReview(axis="roll", loop="attitude", frequency_hz=0.9, rms=0.3, at_limit_percent=0.0,
    ...                         lower=("I", "A"))
    >>> gain_words((one,))
    'I and the angle gain'
    """
    letters = [letter for letter in "PIDA" if any(letter in oscillation.lower for oscillation in found)]
    return listed(["the angle gain" if letter == "A" else letter for letter in letters])
