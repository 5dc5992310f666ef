r"""Yaw drift and yaw trim of many flights over the voltage of the battery: two slopes that must agree.

Within flights: the slopes of single flights (:mod:`rotorid.reviewing.yaw_drift`), as a population. Between flights: the
means of flights that began with another charge, by random effects,

.. math:: y_{ij} = \beta_0 + b_i + \beta_1 (V_{ij} - \bar V_i) + w_{ij} + e_{ij}

with the voltage about the mean of its vehicle, so that vehicles with other batteries say nothing. Both are of other
data. Within a flight whatever else changes with time is in the slope; between flights it is not. Where the two differ,
voltage alone is not the cause.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from rotorid.data.base import Immutable
from rotorid.data.quantity import Quantity
from rotorid.fleets.populations import LEAST_FLIGHTS, Population, random_effects
from rotorid.fleets.table import REVIEW, Row

_LEAST_MOTION = 0.02
"""Change of the voltage between flights of a vehicle from which it shows a slope, as a share."""

SLOPES = {"yaw.drift_rad_s": "yaw.drift_per_volt", "yaw.yaw_trim": "yaw.yaw_trim_per_volt"}
"""Number of a review to its slope over the voltage of the battery."""

_ENDS = ("battery.start_v", "battery.stop_v")


@dataclass(frozen=True, kw_only=True)
class YawFlight(Immutable):
    """One flight: its mean voltage, and what yaw did on average, with its slope where the voltage moved."""

    vehicle: str
    log: str
    flight: int
    voltage_v: float
    value: Quantity
    slope: Quantity | None


@dataclass(frozen=True, kw_only=True)
class YawOverVoltage(Immutable):
    """Drift or trim of yaw over the voltage of the battery.

    Parameters
    ----------
    parameter
        ``yaw.drift_rad_s`` or ``yaw.yaw_trim``.
    flights
        All flights that show it, by vehicle.
    within, between
        Slope within flights, and between flights of a vehicle; ``None`` where there are not enough data.
    why_within, why_between
        What was missing; empty where nothing was.
    """

    parameter: str
    flights: tuple[YawFlight, ...]
    within: Quantity | None
    between: Quantity | None
    why_within: str = ""
    why_between: str = ""


def yaw_over_voltage(
    rows: Sequence[Row], populations: Mapping[tuple[str, str], Population]
) -> tuple[YawOverVoltage, ...]:
    """Drift and trim over the voltage, where flights show them.

    Parameters
    ----------
    rows
        A table, of any models.
    populations
        Of the table.

    Examples
    --------
    >>> yaw_over_voltage([], {})
    ()
    """
    by_flight: dict[tuple[str, str, str, int], dict[str, Row]] = defaultdict(dict)
    for row in rows:
        if row.model == REVIEW:
            by_flight[row.vehicle, row.log, row.log_sha256, row.flight][row.parameter] = row
    return tuple(_over_voltage(by_flight, populations, mean) for mean in SLOPES if _any(by_flight, mean))


def _any(by_flight: Mapping[tuple[str, str, str, int], Mapping[str, Row]], mean: str) -> bool:
    return any(mean in found for found in by_flight.values())


def _over_voltage(
    by_flight: Mapping[tuple[str, str, str, int], Mapping[str, Row]],
    populations: Mapping[tuple[str, str], Population],
    mean: str,
) -> YawOverVoltage:
    flights = tuple(_flights(by_flight, mean))
    slopes = populations.get((REVIEW, SLOPES[mean]))
    between, why = _between(flights)
    return YawOverVoltage(
        parameter=mean,
        flights=flights,
        within=None if slopes is None else slopes.mean,
        between=between,
        why_within="" if slopes is not None else "the voltage changed by less than 2 % in each flight",
        why_between=why,
    )


def _flights(by_flight: Mapping[tuple[str, str, str, int], Mapping[str, Row]], mean: str) -> Iterator[YawFlight]:
    for (vehicle, log, _, number), found in sorted(by_flight.items()):
        volts = [found[end].value for end in _ENDS if end in found]
        if mean in found and found[mean].std > 0.0 and len(volts) == len(_ENDS):
            slope = found.get(SLOPES[mean])
            yield YawFlight(
                vehicle=vehicle,
                log=log,
                flight=number,
                voltage_v=float(np.mean(volts)),
                value=_quantity(found[mean]),
                slope=None if slope is None else _quantity(slope),
            )


def _quantity(row: Row) -> Quantity:
    return Quantity.normal(row.value, row.std, row.unit)


def _between(flights: Sequence[YawFlight]) -> tuple[Quantity | None, str]:
    """The slope between flights of a vehicle, or why there is none."""
    names, who = np.unique([flight.vehicle for flight in flights], return_inverse=True)
    freedom = len(flights) - len(names) - 1
    if freedom < LEAST_FLIGHTS - 2:
        return None, f"{LEAST_FLIGHTS} flights of a vehicle are needed"
    volts = np.array([flight.voltage_v for flight in flights])
    means = np.bincount(who, volts) / np.bincount(who)
    moved = volts - means[who]
    if np.ptp(moved) < _LEAST_MOTION * float(np.median(volts)):
        return None, "flights of a vehicle differed by less than 2 % in voltage"
    values = np.array([flight.value.value for flight in flights])
    stds = np.array([flight.value.std for flight in flights])
    found = random_effects(values, stds, who, design=np.stack([np.ones(values.size), moved], axis=1), intervals=False)
    std = math.sqrt(float(found.covariance[1, 1]))
    half = float(stats.t.ppf(0.975, freedom)) * std
    value = float(found.beta[1])
    unit = f"{flights[0].value.unit}/V"
    return Quantity(value=value, std=std, lower=value - half, upper=value + half, unit=unit), ""
