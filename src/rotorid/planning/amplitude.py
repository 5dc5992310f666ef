"""How large a test input may be: the plan is flown in the simulator, larger and larger, until a limit is reached."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.flight_plan import FlightPlan, SimulatedFlight
from rotorid.errors import UsageError
from rotorid.simulation.multirotor_flight import Aircraft, LostError, fly_multirotor
from rotorid.simulation.wind import CALM, Wind
from rotorid.typing import FloatArray

_TOLERANCE = 0.02
_SMALLEST = 1e-5

_QUANTILE = 0.25
"""Of the flights of a plan, that may pass a limit."""

_NEAR, _NEAR_TOLERANCE = 1.1, 0.05
"""Steps of the search, and its final accuracy, where another flight gives the size."""
_MOTORS = tuple(f"motor_{number}" for number in range(1, 17))


@dataclass(frozen=True, kw_only=True)
class Limits(Immutable):
    """What a flight may reach.

    Parameters
    ----------
    tilt_rad
        Between the vehicle's axis and the vertical.
    rate_rad_s
        Of roll, pitch or yaw.
    position_m
        Horizontally from where it began.
    height_m
        Above or below where it began.
    motor_low, motor_high
        Least and greatest output to a motor.
    saturated
        Share of the time with motors at a limit of their own.
    """

    tilt_rad: float = math.radians(25.0)
    rate_rad_s: float = math.radians(180.0)
    position_m: float = 10.0
    height_m: float = 5.0
    motor_low: float = 0.05
    motor_high: float = 0.95
    saturated: float = 0.0

    def __post_init__(self) -> None:
        for name in ("tilt_rad", "rate_rad_s", "position_m", "height_m"):
            if not getattr(self, name) > 0.0:
                raise UsageError(
                    f"the limit {self.words(name)} of {limit_words([name])} is not positive",
                    needed="a limit above zero",
                )
        if not self.motor_low < self.motor_high:
            raise UsageError(
                f"the motor limits {self.motor_low:g} to {self.motor_high:g} are empty",
                needed="motor_low below motor_high",
            )

    def words(self, name: str, value: float | None = None) -> str:
        """A limit, or another value of the same kind, as a person says it.

        Examples
        --------
        >>> Limits().words("tilt_rad"), Limits().words("position_m", 12.3)
        ('25 deg', '12.3 m')
        """
        number = getattr(self, name) if value is None else value
        for ending, unit in (("_rad_s", "deg/s"), ("_rad", "deg")):
            if name.endswith(ending):
                return f"{math.degrees(number):.3g} {unit}"
        return f"{number:.3g} m" if name.endswith("_m") else f"{number:.3g}"


@dataclass(frozen=True, kw_only=True)
class Reached(Immutable):
    """What a flight reached; the names are those of :class:`Limits`.

    Parameters
    ----------
    tilt_rad, rate_rad_s, position_m, height_m, motor_low, motor_high
        Extremes of the whole flight.
    saturated
        Share of the ticks at which the motors could not do what was asked of them.
    """

    tilt_rad: float
    rate_rad_s: float
    position_m: float
    height_m: float
    motor_low: float
    motor_high: float
    saturated: float

    def beyond(self, limits: Limits) -> tuple[str, ...]:
        """Names of the limits that were passed."""
        higher = ("tilt_rad", "rate_rad_s", "position_m", "height_m", "motor_high", "saturated")
        passed = [name for name in higher if getattr(self, name) > getattr(limits, name)]
        return (*passed, *(("motor_low",) if self.motor_low < limits.motor_low else ()))


@dataclass(frozen=True, kw_only=True)
class Amplitude(Immutable):
    """The largest amplitude within limits.

    Parameters
    ----------
    value
        In the unit of the test input, to 2 %.
    reached
        What the flight with it reached.
    limited_by
        The limit that a larger one would pass; empty where the largest one asked for stays within all.
    flights
        How many were simulated.
    spread
        Smallest and largest amplitude of single flights, where several draws of noise and gusts were flown.
    """

    value: float
    reached: Reached
    limited_by: str
    flights: int
    spread: tuple[float, float] = (0.0, 0.0)


_NOWHERE = Reached(
    tilt_rad=0.0, rate_rad_s=0.0, position_m=0.0, height_m=0.0, motor_low=0.0, motor_high=0.0, saturated=0.0
)


def limit_words(names: Sequence[str]) -> str:
    """Names of limits as a person says them.

    Examples
    --------
    >>> limit_words(["tilt_rad", "motor_low", "position_m"])
    'tilt, motor low, position'
    """
    plain = [re.sub(r"_(rad|rad_s|m)$", "", name).replace("_", " ") for name in names]
    return ", ".join(plain)


def reached(flown: SimulatedFlight) -> Reached:
    """Extremes of a flight, of its truth and of its motor outputs.

    Examples
    --------
    >>> still = {name: [0.0, 0.0] for name in ("p", "q", "r", "phi", "theta", "north", "east", "down")}
    >>> flown = SimulatedFlight(vehicle="demo", autopilot="simple", sample_rate_hz=1.0, time_s=[0.0, 1.0],
    ...               columns={"motor_1": [0.4, 0.5]}, truth=still | {"phi": [0.0, 0.1]})
    >>> round(reached(flown).tilt_rad, 6), reached(flown).motor_high
    (0.1, 0.5)
    """
    truth = flown.truth
    motors = np.stack([flown.columns[name] for name in _MOTORS if name in flown.columns])
    upright = np.clip(np.cos(truth["phi"]) * np.cos(truth["theta"]), -1.0, 1.0)
    away = np.hypot(truth["north"] - truth["north"][0], truth["east"] - truth["east"][0])
    low, high = float(motors.min()), float(motors.max())
    return Reached(
        tilt_rad=_largest(np.arccos(upright)),
        rate_rad_s=max(_largest(truth[name]) for name in "pqr"),
        position_m=_largest(away),
        height_m=_largest(truth["down"] - truth["down"][0]),
        motor_low=low,
        motor_high=high,
        saturated=flown.saturated,
    )


def largest_amplitude(
    aircraft: Aircraft,
    plan_of: Callable[[float], FlightPlan],
    limits: Limits,
    *,
    start: float = 0.02,
    largest: float = 1.0,
    wind: Wind = CALM,
    seed: int = 0,
) -> Amplitude:
    """Largest amplitude whose flight stays within limits.

    The plan is flown in closed loop by the nonlinear simulator, with sensors' noise and wind: what gusts already use
    of the room is not there for the test input. The search doubles or halves until it has the limit between two
    amplitudes, and then halves the ratio of the two.

    Parameters
    ----------
    aircraft
        What will fly.
    plan_of
        The plan for an amplitude.
    limits
        See :class:`Limits`.
    start
        Where the search begins.
    largest
        Where it ends.
    wind, seed
        As :func:`~rotorid.simulation.multirotor_flight.fly_multirotor` takes them.

    Raises
    ------
    UsageError
        Even a flight with almost no test input passes a limit.
    """
    tries = _Tries(aircraft=aircraft, limits=limits, wind=wind)
    found = tries.largest(plan_of, seed, start=start, largest=largest)
    if found.value == 0.0:
        raise _no_room(aircraft, found)
    return found


def common_amplitude(
    aircraft: Aircraft,
    plans: Sequence[Callable[[float], FlightPlan]],
    limits: Limits,
    *,
    start: float = 0.02,
    largest: float = 1.0,
    wind: Wind = CALM,
    seeds: Sequence[int] = (0,),
) -> Amplitude:
    """The amplitude whose flights stay within limits in three of four draws of noise and gusts.

    One flight meets one draw: the largest amplitude within its limits is as much a property of its gusts as of the
    vehicle. Each plan is flown with each seed, each flight has a largest amplitude of its own
    (:func:`largest_amplitude`), and the lower quartile of all of them is taken. Of eight seeds and two plans whose
    amplitudes scatter by 12 %, it scatters by 4 %.

    Parameters
    ----------
    plans
        Plans for an amplitude; those of axes that are equal share one.
    limits, start, largest, wind
        As for :func:`largest_amplitude`.
    seeds
        Of noise and gusts.

    Raises
    ------
    UsageError
        More than a quarter of the flights pass a limit with almost no test input.
    """
    tries = _Tries(aircraft=aircraft, limits=limits, wind=wind)
    found: list[Amplitude] = []
    for plan_of in plans:
        for seed in seeds:
            if not found or not found[0].value:
                amplitude = tries.largest(plan_of, seed, start=start, largest=largest)
            else:
                near = found[0].value
                amplitude = tries.largest(
                    plan_of, seed, start=near, largest=largest, widen=_NEAR, tolerance=_NEAR_TOLERANCE
                )
            found.append(amplitude)
    ranked = sorted(found, key=lambda amplitude: amplitude.value)
    taken = ranked[math.floor(_QUANTILE * (len(ranked) - 1))]
    if taken.value == 0.0:
        raise _no_room(aircraft, taken)
    # What limits most flights is what a larger amplitude would meet.
    limited = Counter(amplitude.limited_by for amplitude in found if amplitude.limited_by or not taken.limited_by)
    return replace(
        taken,
        limited_by=limited.most_common(1)[0][0] if limited else "",
        flights=sum(amplitude.flights for amplitude in found),
        spread=(ranked[0].value, ranked[-1].value),
    )


def usual_reached(flights: Sequence[Reached]) -> Reached:
    """What three of four flights stay within, each number by itself.

    Examples
    --------
    >>> one = Reached(tilt_rad=0.2, rate_rad_s=1.0, position_m=1.0, height_m=0.1, motor_low=0.4, motor_high=0.6,
    ...               saturated=0.0)
    >>> usual_reached([one, one, one, replace(one, tilt_rad=0.5)]).tilt_rad
    0.2
    """
    last = len(flights) - 1

    def usual(name: str) -> float:
        ordered = sorted(getattr(flight, name) for flight in flights)
        place = math.ceil(_QUANTILE * last) if name == "motor_low" else math.floor((1.0 - _QUANTILE) * last)
        return float(ordered[place])

    return Reached(**{field.name: usual(field.name) for field in fields(Reached)})


def _no_room(aircraft: Aircraft, found: Amplitude) -> UsageError:
    return UsageError(
        f"{aircraft.name} exceeds its limits of {found.limited_by} even with a tiny test input",
        remedy="raise the limits, plan for less wind, or first lower gains that oscillate",
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Tries:
    """Flights of plans of growing amplitude."""

    aircraft: Aircraft
    limits: Limits
    wind: Wind

    def flown(self, plan: FlightPlan, seed: int) -> tuple[Reached | None, tuple[str, ...]]:
        """What a flight reaches, and the limits that it passes."""
        try:
            result = reached(fly_multirotor(self.aircraft, plan, wind=self.wind, seed=seed))
        except LostError:
            return None, ("control",)
        return result, result.beyond(self.limits)

    def largest(
        self,
        plan_of: Callable[[float], FlightPlan],
        seed: int,
        *,
        start: float,
        largest: float,
        widen: float = 2.0,
        tolerance: float = _TOLERANCE,
    ) -> Amplitude:
        """The largest amplitude of one flight; zero, with the limits that it passes, where there is none."""
        low, high, count = 0.0, math.inf, 0
        low_reached: Reached | None = None
        names: tuple[str, ...] = ()
        value = min(start, largest)
        while high > (1.0 + tolerance) * low:
            count += 1
            found, passed = self.flown(plan_of(value), seed)
            if passed or found is None:
                high, names = value, passed
            else:
                low, low_reached = value, found
            if low >= largest:
                break
            if high < _SMALLEST:
                return Amplitude(value=0.0, reached=_NOWHERE, limited_by=limit_words(names), flights=count)
            if low and high < math.inf:
                value = math.sqrt(low * high)
            else:
                value = min(widen * low, largest) if low else high / widen
                widen = min(widen**2, 2.0)
        assert low_reached is not None
        return Amplitude(
            value=low,
            reached=low_reached,
            limited_by=names[0] if names else "",
            flights=count,
            spread=(low, low),
        )


def _largest(values: FloatArray) -> float:
    return float(np.abs(values).max())
