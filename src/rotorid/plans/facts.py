"""Facts of a planned flight for its files: the vehicle, the limits, and the predicted accuracy."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from rotorid.autopilots.registry import named
from rotorid.data.base import Immutable
from rotorid.data.flight_plan import FlightPlan, PlannedInput
from rotorid.errors import UsageError
from rotorid.simulation.multirotor_flight import HOLD_1_S, HOLD_1_S2, HOLD_PLACE_1_S

STOP_MARGIN = 1.5
"""Limits at which a flight is broken off, over the largest values that were predicted for it."""

HOLD: Mapping[str, float] = MappingProxyType(
    {
        "speed": HOLD_1_S,
        "integral": HOLD_1_S2,
        "place": HOLD_PLACE_1_S,
        "climb_integral": HOLD_1_S * HOLD_PLACE_1_S,
        "lean_deg": 10.0,
    }
)
"""How scripts hold place and height: the loops of :func:`rotorid.simulation.multirotor_flight.piloted`, and the largest
lean.

Acceleration for a drift (1/s) and for its integral (1/s²), speed for a distance (1/s), and the gain of the integral in
height (1/s²). The lean stays below every limit of tilt, so that the hold alone breaks off no flight."""

HAND_CLIMB_M = 2.0
"""Departure from the height that is planned where a hand works the throttle: the simulated pilot keeps it closer."""

_ZERO = 1e-14
_STOP_STEP_RAD = math.radians(5.0)
_LEAST_STOP_TILT_RAD, _MOST_STOP_TILT_RAD = math.radians(15.0), math.radians(60.0)
_LEAST_STOP_RATE_RAD_S = math.radians(60.0)
_STOP_ABOVE_GROUND = 1.25
"""Least height of the start over the loss of height that ends the flight."""


@dataclass(frozen=True, kw_only=True)
class PredictedBound(Immutable):
    """The predicted accuracy of one parameter.

    Parameters
    ----------
    value
        Expected value, in ``unit``.
    std
        Predicted standard deviation of its estimate, in ``unit``.
    model
        Of which model, where several are predicted.
    given
        The value that the prediction began with, which the estimate may miss; ``value`` when omitted.
    """

    name: str
    unit: str
    value: float
    std: float
    model: str = ""
    given: float | None = None

    @property
    def percent(self) -> float | None:
        """Predicted standard deviation in percent of the value that was given; ``None`` where that is zero."""
        given = self.value if self.given is None else self.given
        return 100.0 * self.std / abs(given) if given else None

    @property
    def off_sigmas(self) -> float:
        """How far the estimate will end from the value that was given, in standard deviations."""
        return 0.0 if self.given is None or not self.std > 0.0 else abs(self.value - self.given) / self.std

    @property
    def known(self) -> bool:
        """Whether the deviation is no larger than the value, so that the parameter is not compatible with zero."""
        return self.std <= abs(self.value) if self.value else math.isfinite(self.std)


@dataclass(frozen=True, kw_only=True)
class FlightFacts(Immutable):
    """A planned flight besides its test inputs. All numbers are predictions, and SI.

    Parameters
    ----------
    vehicle
        Its name.
    autopilot
        Whose files and words are needed, by its name; ``other`` for one that is not known.
    room_m
        Farthest horizontal distance from the place where the flight begins.
    height_m
        Height above ground at which it should be flown.
    climb_m
        Largest departure from that height.
    tilt_rad, rate_rad_s
        Largest attitude angle of roll and pitch, and largest body rate.
    motors
        Lowest and highest motor output, 0 to 1.
    bounds
        Predicted accuracy of parameters.
    notes
        Sentences for the pilot that nothing else on the card says.
    firmware
        Of the autopilot that will fly, as its logs name it; empty where it is not known.
    computed_for
        For which vehicle its numbers were computed, in words; empty where nobody says it.

    Raises
    ------
    UsageError
        A number is negative, infinite or none, or motors are outside 0 to 1.
    """

    vehicle: str
    autopilot: str
    room_m: float
    height_m: float
    climb_m: float
    tilt_rad: float
    rate_rad_s: float
    motors: tuple[float, float]
    bounds: tuple[PredictedBound, ...] = ()
    notes: tuple[str, ...] = ()
    firmware: str = ""
    computed_for: str = ""

    def __post_init__(self) -> None:
        numbers = (self.room_m, self.height_m, self.climb_m, self.tilt_rad, self.rate_rad_s, *self.motors)
        if not all(math.isfinite(number) and number >= 0.0 for number in numbers) or max(self.motors) > 1.0:
            raise UsageError(
                f"invalid predictions for {self.vehicle}: {', '.join(f'{number:g}' for number in numbers)}",
                needed="finite numbers of 0 or more, and motor outputs from 0 to 1",
            )

    @property
    def stop_tilt_rad(self) -> float:
        """Attitude angle at which to stop: the predicted one with a margin, in steps of 5° from 15° to 60°."""
        return min(max(_stepped(STOP_MARGIN * self.tilt_rad), _LEAST_STOP_TILT_RAD), _MOST_STOP_TILT_RAD)

    @property
    def stop_rate_rad_s(self) -> float:
        """Body rate at which to break off: the predicted one with a margin, in steps of 5°/s from 60°/s up."""
        return max(_stepped(STOP_MARGIN * self.rate_rad_s), _LEAST_STOP_RATE_RAD_S)

    @property
    def stop_room_m(self) -> float:
        """Horizontal distance from the start at which to break off, in whole meters."""
        return float(max(math.ceil(STOP_MARGIN * self.room_m), 2))

    @property
    def stop_climb_m(self) -> float:
        """Departure from the height at which to break off: whole meters, or half of a low height, in decimeters."""
        wanted = float(max(math.ceil(STOP_MARGIN * self.climb_m), 2))
        return min(wanted, max(math.floor(5.0 * self.height_m + 1e-9), 1) / 10.0)

    @property
    def least_height_m(self) -> float:
        """Height above which a script starts: half of the planned one, and more than may be lost, in decimeters."""
        wanted = max(0.5 * self.height_m, _STOP_ABOVE_GROUND * self.stop_climb_m)
        return math.ceil(10.0 * wanted - 1e-9) / 10.0


def column_name(planned: PlannedInput) -> str:
    """Name of a test input in files: its axis and where it enters.

    Examples
    --------
    >>> column_name(PlannedInput(axis="roll", shape="doublet", start_s=0.0, values=[0.1, -0.1], sample_rate_hz=2.0,
    ...                          amplitude=0.1, entry="rate_setpoint"))
    'roll_rate_setpoint'
    """
    if planned.motor:
        return planned.signal
    return f"{planned.axis}_{'excitation' if planned.entry == 'command' else planned.entry}"


def excited_s(planned: PlannedInput) -> tuple[float, float]:
    """When the input moves, on the clock of the plan: without the zeros at both ends, which are rest.

    Its setting ``trim_s`` gives them. Without it they are counted; the first sample of a sweep is zero anyway.

    Raises
    ------
    UsageError
        All samples are zero.
    """
    size, rate_hz = np.abs(planned.values), planned.sample_rate_hz
    if not size.any():
        raise UsageError(f"the test input on {planned.axis} is zero", needed="samples other than zero")
    if "trim_s" in planned.settings:
        trim_s = planned.settings["trim_s"]
        return planned.start_s + trim_s, planned.stop_s - trim_s
    # A sine at a multiple of π is zero.
    moving = np.flatnonzero(size > _ZERO * size.max())
    first = int(moving[0]) - (planned.maneuver.kind == "sweep")
    return planned.start_s + max(first, 0) / rate_hz, planned.start_s + (int(moving[-1]) + 1) / rate_hz


def flown_by_hand(plan: FlightPlan, autopilot: str) -> tuple[PlannedInput, ...]:
    """Inputs that no file can fly and a pilot can: those at the sticks, and steps beside the sweeps of an autopilot."""
    sweeps = any(planned.shape == "logarithmic_sweep" for planned in plan.inputs)
    left_over = sweeps and named(autopilot).leaves_steps
    return tuple(
        planned
        for planned in plan.inputs
        if planned.entry == "stick" or (left_over and planned.maneuver.kind in ("doublet", "multistep"))
    )


def all_by_hand(plan: FlightPlan, autopilot: str) -> bool:
    """Whether a pilot flies the whole plan, so that no files are loaded."""
    return len(flown_by_hand(plan, autopilot)) == len(plan.inputs)


def throttle_by_hand(plan: FlightPlan, autopilot: str) -> bool:
    """Whether the pilot's hand keeps the height during the runs that an autopilot makes."""
    return named(autopilot).hand_on_throttle(plan)


def how_to_stop(plan: FlightPlan, autopilot: str) -> str:
    """How the pilot stops a run: the same words on the card and in every file."""
    card = named(autopilot).card
    height = f", {card.way_height}" if card.way_height and throttle_by_hand(plan, autopilot) else ""
    way_out = card.hand_way_out if card.hand_way_out and all_by_hand(plan, autopilot) else card.way_out
    return f"{way_out}{height}"


def _stepped(value: float) -> float:
    # A hair below the next step, so that a value that is a step stays it.
    return max(math.ceil(value / _STOP_STEP_RAD - 1e-9), 1) * _STOP_STEP_RAD
