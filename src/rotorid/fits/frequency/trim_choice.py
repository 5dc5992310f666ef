"""The trim of a vehicle that leans, by which one explains its responses.

A vehicle leans against a steady wind, whose drag is fixed to the earth, or because its sensors or its load stand askew,
which turns with it; and drag acts along the rotors as across them, as that of a body, or in their plane alone. Attitude
shows none of that, responses do: the model is fitted at each trim, and the best fit counts.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol, TypeVar

from rotorid.errors import InsufficientDataError
from rotorid.fits.frequency.fit import cost_of
from rotorid.fits.frequency.inverse import pose_screened
from rotorid.fitting.frequency.fit import fit_frequency
from rotorid.fitting.frequency.problem import ACCEPTABLE_COST
from rotorid.flights.flights import Flight
from rotorid.flights.measure import measure
from rotorid.models.structure import LinearStructure
from rotorid.settings.identifying import IdentifySettings


class _Trim(Protocol):
    """A model and its flights at a trim."""

    @property
    def structure(self) -> LinearStructure: ...

    @property
    def flights(self) -> tuple[Flight, ...]: ...


TrimT = TypeVar("TrimT", bound=_Trim)


_HEAVE = "az"

_SURELY_LOWER = 2.0
"""Ratio of costs of heave from which drag in the plane of the rotors alone counts; below it both fit."""

_CLEARLY = 0.8
"""A trim that turns with the vehicle has to cost less than this share, as most leans are those of a wind."""


class _Fitted(NamedTuple):
    """Cost of each response; empty where a fit is refused."""

    costs: Mapping[str, float]

    @property
    def missed(self) -> bool:
        return not self.costs or any(not cost <= ACCEPTABLE_COST for cost in self.costs.values())

    @property
    def heave(self) -> float:
        own = [cost for name, cost in self.costs.items() if name.startswith(f"{_HEAVE}/")]
        return math.inf if self.missed or not own else sum(own) / len(own)

    def surely_below(self, other: _Fitted) -> bool:
        """Whether it misses no response where the other does, or costs clearly less over those that both have."""
        if self.missed is not other.missed:
            return other.missed
        common = self.costs.keys() & other.costs.keys()
        return sum(self.costs[name] for name in common) < _CLEARLY * sum(other.costs[name] for name in common)


def best_trim(trims: Sequence[TrimT], settings: IdentifySettings) -> TrimT:
    """The trim at which a model explains the flights best; without a choice nothing is fitted.

    A vehicle leans against a wind, unless the trim that turns with it misses no response where that of the wind does,
    or costs clearly less. Its drag acts along the rotors as across them, unless heave costs surely less without.

    Parameters
    ----------
    trims
        A model and its flights: first the trim that turns with the vehicle, then those of a steady wind.
    """
    if len(trims) == 1:
        return trims[0]
    found = [(trim, _fitted(trim, settings)) for trim in trims]
    turning, *windy = found
    best = windy[0]
    if len(windy) > 1:
        plane, body = windy
        heaves = plane[1].heave, body[1].heave
        best = plane if _SURELY_LOWER * heaves[0] < heaves[1] else body
    return turning[0] if turning[1].surely_below(best[1]) else best[0]


def _fitted(trim: _Trim, settings: IdentifySettings) -> _Fitted:
    structure, flights = trim.structure, trim.flights
    try:
        measured = measure(flights, inputs=structure.inputs, outputs=structure.outputs, settings=settings)
        problem = pose_screened(structure, measured, settings, flights).problem
        solution = fit_frequency(problem)
    except InsufficientDataError:
        return _Fitted({})
    costs = cost_of(problem, problem.costs(solution.theta)).pairs
    return _Fitted({name: pair.value for name, pair in costs.items()})
