"""Results that follow from an identified model and given quantities: rotors, motors, thrust over inflow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rotorid.data.findings import Finding
from rotorid.data.quantity import TWO_SIDED_95
from rotorid.flights.coverage import thrust_spread
from rotorid.flights.flights import Flight
from rotorid.models.derived import KNOWN_UNITS, RELATIONS, DerivedQuantities, derived_quantities, thrust_coefficient
from rotorid.models.library import MOTOR_LAG
from rotorid.models.parameter import ParameterSet
from rotorid.models.physical import check_signs
from rotorid.results.summary import Correlation, DerivedQuantity, DerivedSummary, KnownQuantity, Range, ThrustPoint
from rotorid.typing import FloatArray
from rotorid.uncertainty.cramer_rao import Bounds
from rotorid.uncertainty.propagation import covariance_of_all

_POINTS = 5
"""Of the table on either side of hover."""

_LEAST_ADVANCE_RATIO = 0.05
_CLEAR_STDS = 2.0
_COEFFICIENTS = ("c_T", "dc_T_dJ")


def derivation(
    parameters: ParameterSet,
    bounds: Bounds,
    *,
    known: Mapping[str, tuple[float, float]],
    covered: Mapping[str, Range],
    flights: Sequence[Flight] = (),
) -> DerivedSummary | None:
    """Quantities behind identified parameters.

    Parameters
    ----------
    parameters, bounds
        Of one solution; parameters that were dropped say nothing.
    known
        Value and standard deviation of what is known beside them.
    covered
        What was flown; of ``w`` follows which advance ratios the rotors saw.
    flights
        That were fitted; of their sweeps of thrust follows the mean speed of the rotors.

    Returns
    -------
    DerivedSummary or None
        Nothing where nothing is known beside the model and it has no thrust coefficient itself.
    """
    values = parameters.values
    if not known and not all(name in values for name in _COEFFICIENTS):
        return None
    # A dropped parameter is zero because the data do not show it: nothing follows from it.
    rows = [place for place, parameter in enumerate(parameters) if parameter.status != "dropped"]
    kept = [name for place, name in enumerate(parameters.names) if place in rows]
    covariance = covariance_of_all(parameters, bounds)[np.ix_(rows, rows)]
    spread = thrust_spread(flights, values.get(MOTOR_LAG, 0.0))
    found = derived_quantities({name: values[name] for name in kept}, covariance, known, thrust_spread=spread)
    std, identified = found.std, np.sqrt(np.diag(found.of_identified))
    by_name = {relation.name: relation for relation in RELATIONS}
    return DerivedSummary(
        known={
            name: KnownQuantity(value=value, std=spread, unit=KNOWN_UNITS[name])
            for name, (value, spread) in known.items()
        },
        quantities={
            name: DerivedQuantity(
                value=value,
                std=std[name],
                std_identified=float(part),
                unit=by_name[name].unit,
                words=by_name[name].words,
            )
            for (name, value), part in zip(found.values.items(), identified, strict=True)
        },
        correlation=_correlation(found),
        missing=dict(found.missing),
        thrust=_thrust({name: values[name] for name in kept}, covariance, found, known=known, covered=covered),
    )


def derivation_findings(derived: DerivedSummary | None) -> list[Finding]:
    """Remarks on coefficients whose sign is clearly one that they cannot have."""
    quantities = derived.quantities if derived else {}
    return [
        finding
        for name, quantity in quantities.items()
        if abs(quantity.value) > _CLEAR_STDS * quantity.std
        for finding in check_signs({name: quantity.value})
    ]


def _correlation(found: DerivedQuantities) -> Correlation | None:
    """Of those that are not exact."""
    std = np.sqrt(np.diag(found.covariance))
    spread = np.flatnonzero(std > 0.0)
    if not spread.size:
        return None
    matrix = (found.covariance / np.outer(std, std).clip(min=np.finfo(float).tiny))[np.ix_(spread, spread)]
    names = tuple(found.values)
    return Correlation(
        names=tuple(names[place] for place in spread), matrix=tuple(tuple(row) for row in matrix.tolist())
    )


def _thrust(
    parameters: Mapping[str, float],
    covariance: FloatArray,
    found: DerivedQuantities,
    *,
    known: Mapping[str, tuple[float, float]],
    covered: Mapping[str, Range],
) -> tuple[ThrustPoint, ...]:
    """The coefficient over the advance ratios that the rotors saw, where model or relations have its line."""
    values = {**parameters, **{name: value for name, (value, _) in known.items()}, **found.values}
    names = tuple(parameters)
    if all(name in found.values for name in _COEFFICIENTS):
        places, whole = [tuple(found.values).index(name) for name in _COEFFICIENTS], found.covariance
    elif all(name in names for name in _COEFFICIENTS):
        places, whole = [names.index(name) for name in _COEFFICIENTS], covariance
    else:
        return ()
    flown = None
    if "w" in covered and {"n_h", "D"} <= values.keys():
        tip = values["n_h"] * values["D"]
        flown = (-covered["w"].highest / tip, -covered["w"].lowest / tip)
    most = max(_LEAST_ADVANCE_RATIO, *map(abs, flown or (0.0, 0.0)))
    ratios = most * np.arange(-_POINTS, _POINTS + 1) / _POINTS
    line, std = thrust_coefficient(ratios, values["c_T"], values["dc_T_dJ"], whole[np.ix_(places, places)])
    return tuple(
        ThrustPoint(
            advance_ratio=float(ratio),
            c_T=float(value),
            std=float(spread),
            lower=float(value - TWO_SIDED_95 * spread),
            upper=float(value + TWO_SIDED_95 * spread),
            flown=None if flown is None else bool(flown[0] - 1e-12 <= ratio <= flown[1] + 1e-12),
        )
        for ratio, value, spread in zip(ratios, line, std, strict=True)
    )
