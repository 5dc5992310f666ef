"""An estimate in place of a default: a weak one is better than a number of another vehicle that it excludes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from rotorid.data.findings import Finding, warn
from rotorid.data.quantity import with_error

if TYPE_CHECKING:
    from rotorid.flying.vehicle_from_results import JoinedVehicle
    from rotorid.flying.vehicle_numbers import VehicleNumber

_EXCLUDED_SIGMAS = 3.0
"""Standard deviations from which an estimate excludes a default."""


def instead_of_default(
    vehicle: JoinedVehicle, sizes: Mapping[str, float], parameter: str, usual: float, unit: str, findings: list[Finding]
) -> float | None:
    r"""What results show of a parameter that none of them knows well; ``None`` where the default may as well be.

    .. math:: \hat\theta = \frac{\sum_i \theta_i/\sigma_i^2}{\sum_i 1/\sigma_i^2}, \qquad
        |\hat\theta - \theta_{usual}| > 3 \sigma

    The estimates are of other axes, for which the target has the same number, or of parameters that a fit dropped, as
    they were before. Their own standard deviations are a lower limit of their errors.

    Parameters
    ----------
    vehicle
        Its numbers, and what its fits dropped.
    sizes
        By the name of a derivative, minus what makes a value of the parameter of it: mass, or an inertia.
    parameter, usual, unit
        Of the target, with its default.
    findings
        Says what was taken.
    """
    found = {
        name: number for name in sizes if (number := vehicle.numbers.get(name) or vehicle.dropped.get(name)) is not None
    }
    # Of an estimate without an interval it is not known what it excludes; what a person gives is certain.
    known = {name: number for name, number in found.items() if number.std or number.source == "given"}
    if not known:
        return None
    value, std = _mean(
        {name: (-number.value * sizes[name], (number.std or 0.0) * sizes[name]) for name, number in known.items()}
    )
    if abs(value - usual) <= _EXCLUDED_SIGMAS * std or value < 0.0:
        return None
    shown = f"{with_error(value, std, digits=3)} {unit}"
    away = f"{abs(value - usual) / std:.1f} standard deviations away" if std else "another number"
    message = (
        f"{parameter} is {shown}, by "
        f"{' and '.join(_words(name, number) for name, number in known.items())}: the default of "
        f"{usual:.3g} is {away}. --set {next(iter(sizes))}=… decides otherwise."
    )
    findings.append(warn("export_compromise", parameter, message, value=value, usual=usual, std=std))
    return value


def _mean(values: Mapping[str, tuple[float, float]]) -> tuple[float, float]:
    """Mean weighted by variances, with its standard deviation; one that is certain counts alone."""
    for value, std in values.values():
        if std == 0.0:
            return value, 0.0
    weight = sum(1.0 / std**2 for _, std in values.values())
    return sum(value / std**2 for value, std in values.values()) / weight, 1.0 / math.sqrt(weight)


def _words(name: str, number: VehicleNumber) -> str:
    return (
        f"{name} = {with_error(number.value, number.std, digits=3)} "
        f"{number.unit}{f' ({number.of})' if number.of else ''}"
    )
