"""The trim of a vehicle that leans, by which one explains its responses.

A vehicle leans against a steady wind, whose drag is fixed to the earth, or because its sensors or its load stand askew,
which turns with it; and drag acts along the rotors as across them, as that of a body, or in their plane alone. Attitude
shows none of that, responses do: the model is fitted at each trim, and the best fit counts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol, TypeVar

from rotorid.errors import InsufficientDataError
from rotorid.fits.frequency.fit import cost_of
from rotorid.fits.frequency.inverse import pose_screened
from rotorid.fitting.frequency.fit import fit_frequency
from rotorid.fitting.frequency.problem import ACCEPTABLE_COST
from rotorid.flights.flights import Flight
from rotorid.flights.measure import measure
from rotorid.models.steady_wind import HEAVE_SHARE
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


def best_trim(trims: Sequence[TrimT], settings: IdentifySettings) -> TrimT:
    """The trim at which a model explains the flights best; without a choice nothing is fitted.

    A trim that misses no response comes first, then the one that has most of them, then the lowest cost. How much of a
    steady drag acts along the rotors the heave alone shows.

    Parameters
    ----------
    trims
        A model and its flights at each.
    """
    if len(trims) == 1:
        return trims[0]
    costs = [(trim, _cost(trim, settings)) for trim in trims]
    level = [item for item in costs if HEAVE_SHARE not in item[0].structure.constants]
    windy = [item for item in costs if HEAVE_SHARE in item[0].structure.constants]
    best = [min(windy, key=lambda item: _misfit(item[1], _HEAVE))] if windy else []
    return min([*level, *best], key=lambda item: _misfit(item[1]))[0]


def _cost(trim: _Trim, settings: IdentifySettings) -> Mapping[str, float]:
    """Cost of each response; empty where a fit is refused."""
    structure, flights = trim.structure, trim.flights
    try:
        measured = measure(flights, inputs=structure.inputs, outputs=structure.outputs, settings=settings)
        problem = pose_screened(structure, measured, settings, flights).problem
        solution = fit_frequency(problem)
    except InsufficientDataError:
        return {}
    return {name: pair.value for name, pair in cost_of(problem, problem.costs(solution.theta)).pairs.items()}


def _misfit(costs: Mapping[str, float], output: str = "") -> tuple[bool, int, float]:
    """Whether a response is missed, how many there are (of a single output that does not count), and the mean cost."""
    own = [cost for name, cost in costs.items() if name.startswith(f"{output}/" if output else "")]
    missed = not own or any(not cost <= ACCEPTABLE_COST for cost in costs.values())
    return missed, 0 if output else -len(own), sum(own) / max(len(own), 1)
