"""The trim of a vehicle that leans, by which one explains its responses.

A vehicle leans against a steady wind, whose drag is fixed to the earth, or because its sensors or its load stand askew,
which turns with it; and drag acts along the rotors as across them, as that of a body, or in their plane alone. Attitude
shows none of that, responses do: the model is fitted at each trim, and the best fit counts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol, TypeVar

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


def best_trim(trims: Sequence[TrimT], settings: IdentifySettings) -> TrimT:
    """The trim at which a model explains the flights best; without a choice nothing is fitted.

    A trim that misses no response comes first, then the one that has most of them, then the lowest cost.

    Parameters
    ----------
    trims
        A model and its flights at each.
    """
    return trims[0] if len(trims) == 1 else min(trims, key=lambda trim: _misfit(trim, settings))


def _misfit(trim: _Trim, settings: IdentifySettings) -> tuple[bool, int, float]:
    structure, flights = trim.structure, trim.flights
    try:
        measured = measure(flights, inputs=structure.inputs, outputs=structure.outputs, settings=settings)
        problem = pose_screened(structure, measured, settings, flights).problem
        solution = fit_frequency(problem)
    except InsufficientDataError:
        return True, 0, math.inf
    cost = cost_of(problem, problem.costs(solution.theta))
    missed = any(not pair.value <= ACCEPTABLE_COST for pair in cost.pairs.values())
    return missed, -len(cost.pairs), cost.average
