"""Lines for Betaflight's command line: its chirp generator, and what to log.

Betaflight's CHIRP mode adds an exponential sweep to the rate set-point of one axis. Each time its switch is turned on
it sweeps the next axis, roll, pitch, yaw and again roll, all with one band and one duration.
"""

from __future__ import annotations

import math
from itertools import pairwise

from rotorid.data.flight_plan import FlightPlan, PlannedInput
from rotorid.errors import UsageError
from rotorid.plans.csv import filled, one_line
from rotorid.plans.facts import FlightFacts, excited_s, flown_by_hand, how_to_stop
from rotorid.typing import Axis

FILE = "betaflight-cli.txt"
ORDER: tuple[Axis, ...] = ("roll", "pitch", "yaw")
"""In which the switch goes through the axes, beginning with the first after power-on."""

SHAPING_HZ = 30
"""Pole and zero of the filter that shapes the chirp. Equal ones take its effect away: all frequencies get the same."""

_FREQUENCY_DECI_HZ = (1, 1000), (1, 10000)
"""Lowest and highest setting of the first and of the last frequency, tenths of a hertz."""

_TIME_S = (1, 255)
"""Shortest and longest sweep."""

_AMPLITUDE_DEG_S = (1, 500)
"""Smallest and largest amplitude."""

_ROUNDING = 0.05
"""Share by which a whole number may differ from what was planned."""


def betaflight_files(plan: FlightPlan, facts: FlightFacts) -> dict[str, str]:
    """Lines to paste into Betaflight's command line, for firmware 2025.12 or later, built with the option CHIRP.

    The generator's numbers are whole: frequencies in tenths of a hertz, degrees per second, seconds. Its sweep has the
    law of frequency of a logarithmic sweep, no fades, and below 1 Hz an amplitude that falls with the frequency, so
    what is flown is not the plan's samples but a sweep of the same band, duration and amplitude.

    Parameters
    ----------
    plan
        Logarithmic sweeps of the rate set-points of roll, pitch and yaw, at most one on each axis, in this order, with
        the same band and duration. An axis without one gets the amplitude zero, and is passed over by switching on and
        off. Steps beside them are left to the pilot's hand.

    Returns
    -------
    dict[str, str]
        File name to text.

    Raises
    ------
    UsageError
        The generator cannot fly this, or rounding to its whole numbers would change a value by more than 5 %.
    """
    by_hand = flown_by_hand(plan, "Betaflight")
    sweeps = [planned for planned in plan.inputs if planned not in by_hand]
    if not sweeps:
        raise UsageError(
            "Betaflight has no files for test inputs at the sticks",
            needed="logarithmic sweeps of the rate set-points of roll, pitch and yaw",
            remedy="fly them by hand with the flight card, or plan such sweeps",
        )
    for planned in sweeps:
        _require_chirp(planned)
    for before, after in pairwise(sweeps):
        if ORDER.index(after.axis) <= ORDER.index(before.axis) or _shared(after) != _shared(before):
            raise UsageError(
                f"Betaflight cannot fly a sweep on {before.axis} and then on {after.axis}",
                needed="one sweep for each axis, in the order roll, pitch, yaw, with the same band and duration",
                remedy="split the plan, and paste the lines of each part before its flight",
            )
    start, end, duration_s = _shared(sweeps[0])
    amplitudes = {planned.axis: math.degrees(planned.amplitude) for planned in sweeps}
    return {
        FILE: filled(
            "betaflight_cli.txt",
            plan=one_line(plan.name),
            vehicle=one_line(facts.vehicle),
            stop=how_to_stop(plan, "Betaflight"),
            axes=[planned.axis for planned in sweeps],
            by_hand=[f"{planned.shape.replace('_', ' ')} on {planned.axis}" for planned in by_hand],
            start=_whole("the lowest frequency in tenths of a hertz", start, _FREQUENCY_DECI_HZ[0]),
            end=_whole("the highest frequency in tenths of a hertz", end, _FREQUENCY_DECI_HZ[1]),
            time=_whole("the duration in seconds", duration_s, _TIME_S),
            amplitudes={
                axis: _whole(f"the amplitude of {axis} in deg/s", amplitudes[axis], _AMPLITUDE_DEG_S)
                if axis in amplitudes
                else 0
                for axis in ORDER
            },
            shaping=SHAPING_HZ,
        )
    }


def _require_chirp(planned: PlannedInput) -> None:
    if planned.shape != "logarithmic_sweep" or planned.entry != "rate_setpoint" or planned.axis not in ORDER:
        raise UsageError(
            f"Betaflight cannot fly a {planned.shape.replace('_', ' ')} as {planned.entry.replace('_', ' ')} of "
            f"{planned.axis}",
            needed="logarithmic sweeps of the rate set-points of roll, pitch and yaw",
            remedy="plan such sweeps, or fly the plan by hand with the flight card",
        )


def _shared(planned: PlannedInput) -> tuple[float, float, float]:
    """Band in tenths of a hertz, and duration."""
    low, high = planned.band_rad_s or (0.0, 0.0)
    begin_s, end_s = excited_s(planned)
    per_deci_hz = 10.0 / (2.0 * math.pi)
    return round(per_deci_hz * low, 6), round(per_deci_hz * high, 6), round(end_s - begin_s, 6)


def _whole(what: str, value: float, limits: tuple[int, int]) -> int:
    least, most = limits
    rounded = round(value)
    if not least <= rounded <= most or abs(rounded - value) > _ROUNDING * value:
        raise UsageError(
            f"Betaflight cannot set {what} to {value:.4g}",
            needed=f"a whole number from {least} to {most}",
            remedy="change the plan",
        )
    return rounded
