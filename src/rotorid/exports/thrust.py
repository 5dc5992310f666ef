"""Thrust and lag of a rotor about hover, in the forms that simulators have for them.

Whether a simulator flies like the vehicle is decided by the slope of thrust by output at hover, and by the lag: these
two are matched exactly, and the curve away from hover as far as the form goes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rotorid.errors import UsageError

if TYPE_CHECKING:
    from rotorid.flying.vehicle_from_results import JoinedVehicle


@dataclass(frozen=True, kw_only=True, slots=True)
class HoverThrust:
    """Thrust of one rotor at hover.

    Parameters
    ----------
    output
        Share of the output in hover, 0 to 1.
    force
        Thrust there, newtons.
    slope
        Its derivative by the output there, newtons.

    Raises
    ------
    UsageError
        One of the three is not positive.
    """

    output: float
    force: float
    slope: float

    def __post_init__(self) -> None:
        values = (self.output, self.force, self.slope)
        if not (all(math.isfinite(value) and value > 0.0 for value in values) and self.output < 1.0):
            raise UsageError(
                f"thrust at hover is {self.force:g} N with a slope of {self.slope:g} N at an output of {self.output:g}",
                needed="positive numbers, and an output below 1",
            )


@dataclass(frozen=True, kw_only=True, slots=True)
class ExpoThrust:
    """ArduPilot's thrust of a motor, ``full ((1 - expo) c + expo c²)`` of the share c of the spin range.

    Parameters
    ----------
    expo
        ``propExpo``.
    hover_share
        ``hoverThrOut``: thrust in hover as share of the full one.
    full
        Thrust at ``spin_max``, newtons.
    exact
        Whether force and slope are both matched; where not, force alone is.
    """

    expo: float
    hover_share: float
    full: float
    exact: bool


def expo_thrust(hover: HoverThrust, *, spin_min: float, spin_max: float) -> ExpoThrust:
    r"""The curve of ArduPilot's form with the force and the slope of a rotor at hover.

    With :math:`c = (x_h - x_{min})/(x_{max} - x_{min})` and :math:`r = F' (x_{max} - x_{min}) c / F`,

    .. math:: e = \frac{r - 1}{(r - 1) + c (2 - r)}, \qquad \mathrm{hoverThrOut} = c (1 - e + e c)

    Assumes :math:`1 \le r \le 2`, a curve between straight and square; beyond that the expo is the nearest end, force
    is matched and the slope is not.

    Parameters
    ----------
    hover
        Thrust of one rotor.
    spin_min, spin_max
        Shares of the output between which the motor is commanded.

    Raises
    ------
    UsageError
        The output in hover is not between the two.

    Examples
    --------
    >>> curve = expo_thrust(HoverThrust(output=0.5, force=5.0, slope=14.0), spin_min=0.1, spin_max=0.9)
    >>> round(curve.expo, 4), round(curve.hover_share, 4), curve.exact
    (0.2143, 0.4464, True)
    """
    if not spin_min < hover.output < spin_max:
        raise UsageError(
            f"the output in hover is {hover.output:g}", needed=f"one between {spin_min:g} and {spin_max:g}"
        )
    span = spin_max - spin_min
    c = (hover.output - spin_min) / span
    r = hover.slope * span * c / hover.force
    within = min(max(r, 1.0), 2.0)
    expo = (within - 1.0) / ((within - 1.0) + c * (2.0 - within))
    share = c * (1.0 - expo + expo * c)
    return ExpoThrust(expo=expo, hover_share=share, full=hover.force / share, exact=math.isclose(r, within))


def sih_lag(lag_s: float, *, step_s: float = 0.004) -> float:
    r"""``SIH_T_TAU`` by which PX4's simulation, that steps by Euler's rule, has the pole of a lag.

    .. math:: T_{TAU} = \Delta t / (1 - e^{-\Delta t / T})

    Parameters
    ----------
    lag_s
        Lag of the motors, seconds.
    step_s
        Step of the simulation, 4 ms where nothing else was set.

    Raises
    ------
    UsageError
        One of the two is not positive.

    Examples
    --------
    >>> round(sih_lag(0.048), 5)
    0.05003
    """
    if not (lag_s > 0.0 and step_s > 0.0):
        raise UsageError(f"invalid lag of {lag_s:g} s with a step of {step_s:g} s", needed="positive numbers")
    return -step_s / math.expm1(-step_s / lag_s)


def full_thrust_words(form: str, exported_n: float, identified_n: float) -> list[str]:
    """A sentence on thrust at full output, where the form of a target bends otherwise than the identified curve.

    Parameters
    ----------
    form
        What thrust is in the target.
    exported_n, identified_n
        Thrust of one rotor at full output, newtons.

    Examples
    --------
    >>> full_thrust_words("a line", 12.0, 9.0)
    ['Thrust is a line: one rotor makes 12 N at full output, where the identified curve has 9 N.']
    >>> full_thrust_words("a line", 9.0, 9.01)
    []
    """
    if abs(exported_n - identified_n) <= _SAME_THRUST * abs(identified_n):
        return []
    return [
        f"Thrust is {form}: one rotor makes {exported_n:.4g} N at full output, where the identified curve has "
        f"{identified_n:.4g} N."
    ]


def delay_words(vehicle: JoinedVehicle, otherwise: str, *, as_lag: bool) -> list[str]:
    """A sentence on the delay where there is one: a part of the lag, or ``otherwise`` with its milliseconds."""
    late = vehicle.numbers.get("delay")
    if late is None or late.value <= 0.0:
        return []
    words = "The delay of {} is part of the lag." if as_lag else otherwise
    return [words.format(f"{1e3 * late.value:.2g} ms")]


def lag_words(vehicle: JoinedVehicle) -> list[str]:
    """A sentence where the lag of the motors is not known."""
    return [] if "T_motor" in vehicle.numbers else ["The lag of the motors is not identified."]


_SAME_THRUST = 0.01
"""Share by which thrust at full output may differ without a sentence."""
