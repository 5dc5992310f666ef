"""Many flights: other vehicles, plans, winds and seeds, on as many threads as are wanted, each the same as alone."""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import islice
from typing import Generic, TypeVar, cast

import numpy as np

from rotorid.data.flight_plan import FlightPlan
from rotorid.data.immutable import Immutable, read_only
from rotorid.data.simulated_flight import SimulatedFlight
from rotorid.errors import RotoridError, UsageError
from rotorid.simulate.multirotor_flight import SETTLE_S, Aircraft, Desk, FlightTables, flight_tables
from rotorid.simulate.wind import CALM, Wind
from rotorid.typing import FloatArray

Kept = TypeVar("Kept")

_WAITING = 4
"""Flights that are flown ahead of the one that is asked for, per thread."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Sortie(Immutable):
    """One of many flights.

    Parameters
    ----------
    aircraft, plan, duration_s, wind
        See :func:`~rotorid.simulate.multirotor_flight.fly_multirotor`.
    seed
        Of turbulence and noise; by its place among the flights when none is given, see :func:`seed_of`.
    """

    aircraft: Aircraft
    plan: FlightPlan | None = None
    duration_s: float | None = None
    wind: Wind = CALM
    seed: int | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome(Immutable, Generic[Kept]):
    """What came of a flight.

    Parameters
    ----------
    index
        Its place among the flights, from zero.
    seed
        With which it was flown: ``fly_multirotor`` with it is the same flight.
    kept
        What was kept of it; ``None`` when it failed.
    error
        Why it failed.
    """

    index: int
    seed: int
    kept: Kept | None = None
    error: RotoridError | None = None

    @property
    def result(self) -> Kept:
        """What was kept of the flight.

        Raises
        ------
        RotoridError
            It failed.
        """
        if self.error is not None or self.kept is None:
            raise self.error or UsageError(f"nothing was kept of flight {self.index}", needed="a flight that is kept")
        return self.kept


def seed_of(seed: int, index: int) -> int:
    """Seed of one of many flights: independent of all others, whatever their number.

    Parameters
    ----------
    seed
        Of all flights.
    index
        Place of the flight, from zero.

    Examples
    --------
    >>> seed_of(1, 0) == seed_of(1, 0), seed_of(1, 0) == seed_of(0, 1)
    (True, False)
    """
    words = np.random.SeedSequence(seed, spawn_key=(index,)).generate_state(2, np.uint64)
    return (int(words[0]) << 64) | int(words[1])


def whole(flown: SimulatedFlight) -> SimulatedFlight:
    """Keep everything. A minute at 400 Hz takes about 13 MB."""
    return flown


@dataclass(frozen=True)
class Columns(Immutable):
    """Keeps some channels. :func:`fly_many` makes no more of a flight than these."""

    names: tuple[str, ...]

    def __call__(self, flown: SimulatedFlight | FlightTables) -> Mapping[str, FloatArray]:
        if missing := [name for name in self.names if name not in flown.columns]:
            raise UsageError(
                f"{', '.join(missing)} should be kept of a flight that has none",
                needed=f"some of {', '.join(flown.columns)}",
            )
        return {name: read_only(flown.columns[name], np.float64, ndim=1) for name in self.names}


def columns(*names: str) -> Columns:
    """Keep some channels, as the autopilot had them; quicker than anything that takes the whole flight.

    Parameters
    ----------
    names
        Of the channels, such as ``p`` and ``roll_command``.

    Raises
    ------
    UsageError
        From what is returned: the flight has no such channel.
    """
    return Columns(names)


def fly_many(
    sorties: Iterable[Sortie],
    keep: Callable[[SimulatedFlight], Kept],
    *,
    seed: int = 0,
    workers: int | None = None,
    step_rate_hz: float | None = None,
    settle_s: float = SETTLE_S,
    progress: Callable[[int], None] | None = None,
) -> Iterator[Outcome[Kept]]:
    """Fly many times; outcomes come in the order of the flights, as soon as they are there.

    Flights are taken from ``sorties`` as they are flown and forgotten once ``keep`` has made of them what is wanted, so
    that thousands need no more memory than a few. The answer does not depend on the number of threads.

    Parameters
    ----------
    sorties
        What to fly, each as a value; may be a generator of any length.
    keep
        What to keep of a flight: :func:`whole`, :func:`columns`, or any function of it, which is called in the threads.
    seed
        Of all flights that have none of their own.
    workers
        Threads; as many as the machine has cores when none is given. The compiled part of a flight runs beside others,
        the rest does not.
    step_rate_hz, settle_s
        See :func:`~rotorid.simulate.multirotor_flight.fly_multirotor`.
    progress
        Is told how many flights are done, after each.

    Yields
    ------
    Outcome
        A flight that cannot be flown, or of which ``keep`` raises a
        :class:`~rotorid.errors.RotoridError`, is an outcome with its error; the others go on.

    Examples
    --------
    >>> from rotorid.models.rotor_layout_library import library_layout
    >>> from rotorid.simulate.autopilot import Autopilot, RateLoop
    >>> from rotorid.simulate.multirotor import Multirotor, Rotors
    >>> rotors = Rotors(layout=library_layout("quad.x").scaled(0.25), thrust=(0, 0, 9.0), torque_per_thrust_m=0.02)
    >>> gains = RateLoop(proportional=(0.1, 0.1, 0.2))
    >>> autopilot = Autopilot(kind="simple", rate_hz=250.0, rates=gains, angle_1_s=(4.0, 4.0, 2.0))
    >>> heavy = [Multirotor(name="demo", mass_kg=mass, inertia_kg_m2=(0.012, 0.012, 0.02), rotors=rotors)
    ...          for mass in (1.0, 1.2)]
    >>> sorties = (Sortie(aircraft=Aircraft(vehicle=one, autopilot=autopilot), duration_s=0.5) for one in heavy)
    >>> found = fly_many(sorties, lambda flown: float(flown.columns["thrust_command"].mean()))
    >>> [round(one.result, 3) for one in found]
    [0.522, 0.572]
    """
    threads = max(1, workers or os.cpu_count() or 1)
    own_desk = threading.local()

    def desk() -> Desk:
        if not hasattr(own_desk, "desk"):
            own_desk.desk = Desk()
        held: Desk = own_desk.desk
        return held

    def flight(index: int, sortie: Sortie) -> Outcome[Kept]:
        own = seed_of(seed, index) if sortie.seed is None else sortie.seed
        try:
            flown = flight_tables(
                sortie.aircraft,
                sortie.plan,
                desk(),
                duration_s=sortie.duration_s,
                wind=sortie.wind,
                seed=own,
                step_rate_hz=step_rate_hz,
                settle_s=settle_s,
            )
            kept = cast("Kept", keep(flown)) if isinstance(keep, Columns) else keep(flown.flight())
            return Outcome(index=index, seed=own, kept=kept)
        except RotoridError as error:
            return Outcome(index=index, seed=own, error=error)

    with ThreadPoolExecutor(threads) as pool:
        coming = enumerate(sorties)
        started: deque[Future[Outcome[Kept]]] = deque()

        def start(count: int) -> None:
            started.extend(pool.submit(flight, index, sortie) for index, sortie in islice(coming, count))

        try:
            start(_WAITING * threads)
            while started:
                outcome = started.popleft().result()
                start(1)
                if progress is not None:
                    progress(outcome.index + 1)
                yield outcome
        finally:
            # Nobody may want the rest.
            for waiting in started:
                waiting.cancel()
