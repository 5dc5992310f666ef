"""The trim of a vehicle that leans, by which one explains its responses.

A vehicle leans against a steady wind, whose drag is fixed to the earth, or because its sensors or its load stand askew,
which turns with it; and drag acts along the rotors as across them, as that of a body, or in their plane alone. Attitude
shows the first alone, where headings differ. Responses show the rest: the model is fitted at each trim, and the best
fit counts.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

from rotorid.data.trust import ACCEPTABLE_COST
from rotorid.errors import InsufficientDataError
from rotorid.fits.frequency.fit import cost_of
from rotorid.fits.frequency.inverse import pose_screened
from rotorid.fitting.frequency.fit import fit_frequency
from rotorid.flights.flights import Flight
from rotorid.flights.measure import measure
from rotorid.flights.steady_wind import fixed_to_earth
from rotorid.models.steady_wind import TURNING_DRAG
from rotorid.models.structure import LinearStructure
from rotorid.settings.identifying import IdentifySettings


@dataclass(frozen=True, kw_only=True, eq=False)
class Trim:
    """A structure and its flights at a trim.

    Parameters
    ----------
    flights
        Maneuvers, which know the drag of a steady wind where the structure counts from it.
    """

    structure: LinearStructure
    flights: tuple[Flight, ...]


TrimT = TypeVar("TrimT", bound=Trim)


_HEAVE, _YAW, _RATE_OF_YAW = "az", "yaw_command", "r"

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

    @property
    def turned(self) -> bool:
        """Whether a response to yaw shows more than the heading."""
        return any(name.endswith(f"/{_YAW}") and not name.startswith(f"{_RATE_OF_YAW}/") for name in self.costs)

    def surely_below(self, other: _Fitted) -> bool:
        """Whether it misses no response where the other does, or costs clearly less over those that both have."""
        if self.missed is not other.missed:
            return other.missed
        common = self.costs.keys() & other.costs.keys()
        return sum(self.costs[name] for name in common) < _CLEARLY * sum(other.costs[name] for name in common)


def best_trim(trims: Sequence[TrimT], settings: IdentifySettings) -> TrimT:
    """The trim at which a model explains the flights best; without a choice nothing is fitted.

    A vehicle leans against a wind, unless its lean turns with it; where headings do not show that, unless the trim that
    turns with it misses no response where that of the wind does, or costs clearly less. Drag acts along the rotors as
    across them, unless heave costs surely less without. What the wind does to a vehicle that turns counts where a
    response to yaw shows it: where only the heading answers, nothing but products of couplings would.

    Parameters
    ----------
    trims
        A model and its flights: first the trim that turns with the vehicle, then those of a steady wind.
    """
    of_wind = fixed_to_earth(trims[0].flights) if len(trims) > 1 else False
    if of_wind is False:
        return trims[0]
    found = [(trim, _fitted(trim, settings)) for trim in trims]
    turning, *windy = found
    best = windy[0]
    if len(windy) > 1:
        plane, body = windy
        heaves = plane[1].heave, body[1].heave
        best = plane if _SURELY_LOWER * heaves[0] < heaves[1] else body
    gives_up = best[1].missed and not turning[1].missed if of_wind else turning[1].surely_below(best[1])
    if gives_up:
        return turning[0]
    trim, fitted = best
    if fitted.turned or TURNING_DRAG[0] not in trim.structure.constants:
        return trim
    return replace(trim, structure=trim.structure.with_constants(dict.fromkeys(TURNING_DRAG, 0.0)))


def _fitted(trim: Trim, settings: IdentifySettings) -> _Fitted:
    structure, flights = trim.structure, trim.flights
    try:
        measured = measure(flights, inputs=structure.inputs, outputs=structure.outputs, settings=settings)
        problem = pose_screened(structure, measured, settings, flights).problem
        solution = fit_frequency(problem)
    except InsufficientDataError:
        return _Fitted({})
    costs = cost_of(problem, problem.costs(solution.theta)).pairs
    return _Fitted({name: pair.value for name, pair in costs.items()})
