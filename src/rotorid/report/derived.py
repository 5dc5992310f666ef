"""Quantities computed from the parameters, as a page shows them: motors, rotors, thrust over the advance ratio."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotorid.data.quantity import significant, unit, with_error, with_interval
from rotorid.plot.motors import thrust_over_inflow
from rotorid.report.frame import Picture, drawn
from rotorid.results.summary import DerivedSummary, ThrustPoint


@dataclass(frozen=True, kw_only=True, slots=True)
class QuantityRow:
    """A quantity with its deviation, and the part of the deviation that is from the parameters."""

    name: str
    words: str
    value: str
    identified: str
    unit: str


@dataclass(frozen=True, kw_only=True, slots=True)
class ThrustRow:
    """The thrust coefficient at an advance ratio."""

    advance_ratio: str
    value: str
    interval: str
    flown: str


@dataclass(frozen=True, kw_only=True, slots=True)
class DerivedShown:
    """Quantities, the given values, what is missing, and thrust over the advance ratio."""

    rows: tuple[QuantityRow, ...]
    known: str
    missing: tuple[str, ...]
    thrust: tuple[ThrustRow, ...]
    picture: Picture | None


def derived_shown(derived: DerivedSummary | None, *, key: str) -> DerivedShown | None:
    """Nothing where nothing follows and nothing was known.

    Parameters
    ----------
    derived
        Of a result.
    key
        Of its picture on the page.
    """
    if derived is None:
        return None
    known = (
        f"{name} = {with_error(quantity.value, quantity.std)} {unit(quantity.unit)}".strip()
        for name, quantity in derived.known.items()
    )
    return DerivedShown(
        rows=tuple(
            QuantityRow(
                name=name,
                words=quantity.words,
                value=with_error(quantity.value, quantity.std),
                identified=significant(quantity.std_identified, digits=2),
                unit=unit(quantity.unit),
            )
            for name, quantity in derived.quantities.items()
        ),
        known=", ".join(known),
        missing=tuple(f"{name} needs {', '.join(needed)}" for name, needed in derived.missing.items()),
        thrust=tuple(
            ThrustRow(
                advance_ratio=significant(point.advance_ratio),
                value=with_error(point.c_T, point.std),
                interval=with_interval(point.c_T, point.lower, point.upper)[1],
                flown={True: "yes", False: "no", None: "unknown"}[point.flown],
            )
            for point in derived.thrust
        ),
        picture=_picture(derived.thrust, key) if derived.thrust else None,
    )


def _picture(thrust: tuple[ThrustPoint, ...], key: str) -> Picture:
    flown = [point.advance_ratio for point in thrust if point.flown]
    ratio, value, std = (
        np.array([getattr(point, name) for point in thrust]) for name in ("advance_ratio", "c_T", "std")
    )
    return Picture(
        key=key,
        description="Thrust coefficient over the advance ratio, with one standard deviation",
        figure=drawn(thrust_over_inflow, ratio, value, std, flown=(min(flown), max(flown)) if flown else None),
    )
