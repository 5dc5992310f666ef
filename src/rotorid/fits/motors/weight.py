"""The thrust coefficient of flights that excite no axis: from the weight that the rotors carry, without a fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rotorid.data.findings import Finding, remark
from rotorid.data.quantity import Quantity
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.fitting.motors.fit import MotorFit
from rotorid.flights.motor_data import MotorData
from rotorid.flights.weight_balance import WeightBalance, weight_balance
from rotorid.models.parameter import ParameterSet
from rotorid.uncertainty.cramer_rao import Bounds

WEIGHT_ALONE = ("weight",)
"""Equations of a problem that only weighs."""


def weighed(data: MotorData, mass_kg: float) -> WeightBalance | None:
    """The weight balance of all flights; ``None`` where speeds were not measured, or no flight is steady.

    Several logs are averaged by the inverse of their variances. What they have in common, such as a bias of the
    accelerometer, does not average out: the error stays that of the best log.
    """
    if data.kind != "speed":
        return None
    found: list[WeightBalance] = []
    for record, stretches in _stretches(data):
        try:
            found.append(weight_balance(record, stretches, mass_kg=mass_kg))
        except InsufficientDataError:
            continue
    if not found:
        return None
    weights = np.array([balance.coefficient.std**-2.0 for balance in found])
    value = float(weights @ [balance.coefficient.value for balance in found] / weights.sum())
    best = min(found, key=lambda balance: balance.coefficient.std)
    coefficient = Quantity.normal(value, best.coefficient.std, best.coefficient.unit)
    return replace(best, coefficient=coefficient, seconds=sum(balance.seconds for balance in found))


def _stretches(data: MotorData) -> Sequence[tuple[FlightRecord, tuple[tuple[float, float], ...]]]:
    """Each log once, with its stretches."""
    records = {id(flight.record): flight.record for flight in data.flights}
    return [
        (
            record,
            tuple(
                (flight.maneuver.start_s, flight.maneuver.stop_s) for flight in data.flights if flight.record is record
            ),
        )
        for record in records.values()
    ]


def with_balance(fit: MotorFit, balance: WeightBalance) -> tuple[MotorFit, Bounds]:
    """A fit that only weighs, at the coefficient of the balance, and its bounds.

    Parameters
    ----------
    fit
        Of ``c_2`` alone.
    balance
        Of the same flights.
    """
    (name,) = fit.parameters.free
    value, std = balance.coefficient.value, balance.coefficient.std
    solution = replace(fit.solution, theta=np.array([value]))
    parameters: ParameterSet = fit.problem.parameters.with_values({name: value})
    covariance = np.array([[std**2]])
    bounds = Bounds(
        names=(name,),
        cramer_rao=np.array([2.0 * std]),
        insensitivity=np.array([std]),
        covariance=covariance,
        random=covariance,
        colored=1.0,
    )
    return replace(fit, problem=fit.problem.with_parameters(parameters), solution=solution), bounds


def balance_finding(balance: WeightBalance) -> Finding:
    """What stands behind a coefficient that was weighed."""
    message = (
        f"c_2 follows from the weight balance of {balance.seconds} s of steady flight; no axis was excited, so inertia "
        "and torque are not identified."
    )
    numbers = {"seconds": float(balance.seconds), "force_m_s2": balance.force_m_s2.value}
    return remark("weight_balance", "c_2", message, **numbers)
