r"""Vehicles that could have been identified as well: drawn from the covariance of the results.

.. math:: \theta^{(k)} \sim \mathcal N(\hat\theta, \, P)

jointly for the parameters of one result, independently for those of several, and joined anew. A draw that is no
vehicle, as one with a negative inertia or one that the air drives where it brakes the identified one, is drawn again
and counted.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from rotorid.errors import ModelError, UsageError
from rotorid.models.motors import POSITIVE

if TYPE_CHECKING:
    from rotorid.flying.vehicle_from_results import JoinedVehicle
    from rotorid.results.model import IdentifiedModel

_BRAKING = ("X_u", "Y_v", "Z_w", "L_p", "M_q", "N_r")

_TRIALS_PER_DRAW = 100
"""Impossible vehicles for each one that was wanted, beyond which the results are known too badly."""


Made = TypeVar("Made")


def draws(
    models: Sequence[IdentifiedModel],
    count: int,
    make: Callable[[Sequence[IdentifiedModel]], Made],
    *,
    rng: np.random.Generator,
) -> tuple[list[Made], int]:
    """Make something of results drawn from their covariance, and say how many draws were impossible.

    Parameters
    ----------
    make
        What is made of each; an error of its says that this draw is none.

    Raises
    ------
    ModelError
        Hardly any draw is possible.
    """
    made: list[Made] = []
    redrawn = 0
    while len(made) < count:
        drawn = [drawn_model(model, rng=rng) for model in models]
        found = [model for model in drawn if model is not None]
        try:
            if len(found) == len(models):
                made.append(make(found))
                continue
        except (ModelError, UsageError):
            pass
        redrawn += 1
        if redrawn > _TRIALS_PER_DRAW * count:
            raise ModelError(
                f"of {redrawn + len(made)} vehicles drawn from the covariance {len(made)} are possible",
                needed="more accurate results",
                remedy="set the uncertain values with --set",
            )
    return made, redrawn


def require_possible(vehicle: JoinedVehicle, identified: JoinedVehicle) -> None:
    """Refuse a drawn vehicle that cannot be.

    Parameters
    ----------
    vehicle
        As it was drawn.
    identified
        Of the same results as they are: only drag and damping that brake it have to brake each draw.

    Raises
    ------
    ModelError
        A mass, an inertia, a lag or the torque of the rotors is not positive, drag or damping drives the motion, or the
        rotors do not carry the weight.
    """
    numbers = vehicle.numbers
    if wrong := [name for name in POSITIVE if name in numbers and numbers[name].value <= 0.0]:
        raise ModelError(f"{', '.join(wrong)} would be negative", needed="positive numbers")
    braking = [name for name in _BRAKING if name in identified.numbers and identified.numbers[name].value < 0.0]
    if driving := [name for name in braking if name in numbers and numbers[name].value > 0.0]:
        raise ModelError(f"{', '.join(driving)} would drive the motion", needed="negative numbers")
    if vehicle.multirotor is not None:
        _ = vehicle.multirotor.hover_shares


def drawn_model(model: IdentifiedModel, *, rng: np.random.Generator) -> IdentifiedModel | None:
    """The model at parameters drawn from its covariance; ``None`` where they cannot be."""
    names = model.bounds.names
    values, vectors = np.linalg.eigh(model.bounds.covariance) if names else (np.zeros(0), np.zeros((0, 0)))
    # Rounding may leave a variance below zero.
    steps = vectors @ (np.sqrt(np.maximum(values, 0.0)) * rng.standard_normal(len(names)))
    drawn = {name: model.parameters[name].value + float(step) for name, step in zip(names, steps, strict=True)}
    own = model.structure.parameters
    try:
        moved = own.with_values({name: value for name, value in drawn.items() if name in own.names})
    except ModelError:
        return None
    drawn = {**moved.values, **drawn}
    parameters = {
        name: replace(estimate, value=drawn[name])
        if estimate.status in ("free", "tied") and name in drawn
        else estimate
        for name, estimate in model.parameters.items()
    }
    return replace(model, structure=replace(model.structure, parameters=moved), parameters=parameters)
