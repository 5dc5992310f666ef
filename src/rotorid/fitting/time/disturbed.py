r"""Flights in wind: nonlinear models whose equations hold an unknown constant, over pieces of a record.

Output error takes what a simulation misses for noise of sensors. Wind is none: it moves the vehicle, the simulation
adds it up, and drag that is fitted to the drift says nothing of drag. What wind does within some seconds is nearly a
constant in the equations. So a record is cut into pieces, each with a start and with constants of its own,

.. math:: \dot x = f(x, u, \theta) + d, \qquad \dot d = 0

in every equation that a free parameter stands in. They are states without a rate, whose initial values are unknown as
those of all others. Long pieces say more of the parameters, short ones know more of the wind: the longest is taken that
leaves little more than the shortest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rotorid.fitting.time.nonlinear import NonlinearFit
from rotorid.models.expression import Expression
from rotorid.models.nonlinear import NonlinearStructure
from rotorid.typing import FloatArray

PIECES_S = (3.0, 6.0)
"""Lengths of pieces, the shortest first: gusts last some seconds, and drag slows a multirotor within one to four."""

DISTURBED = 2.0
"""Factor by which the variance of an output falls where shorter pieces explain what inputs do not."""

_PUSH = "push_on_"


def pushed(structure: NonlinearStructure, free: Sequence[str]) -> NonlinearStructure:
    """A structure with a constant in each equation that has a free parameter.

    Examples
    --------
    >>> from rotorid.models.library import nonlinear_model
    >>> drag = nonlinear_model("drag.linear")
    >>> pushed(drag, ["k_Dx"]).states, str(pushed(drag, ["k_Dx"]).equations[2])
    (('velocity_forward', 'velocity_right', 'push_on_velocity_forward'), '0')
    """
    names = set(free)
    moved = [
        state
        for state, rate in zip(structure.states, structure.equations, strict=True)
        if set(structure.parameters.only(rate.names & set(structure.parameters.names)).names) & names
    ]
    rates = tuple(
        rate + Expression.symbol(_PUSH + state) if state in moved else rate
        for state, rate in zip(structure.states, structure.equations, strict=True)
    )
    return replace(
        structure,
        states=(*structure.states, *(_PUSH + state for state in moved)),
        equations=(*rates, *(Expression() for _ in moved)),
    )


def falls(whole: FloatArray, least: FloatArray) -> FloatArray:
    """Variances of some outputs over those in the shortest pieces, shape ``(y,)``; one where both are zero.

    Examples
    --------
    >>> falls(np.array([4.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])).tolist()
    [4.0, inf, 1.0]
    """
    return np.asarray(np.divide(whole, least, out=np.where(whole > 0.0, np.inf, 1.0), where=least > 0.0))


def left_over(fit: NonlinearFit) -> FloatArray:
    """Variances of what a fit misses of each output, unknowns counted, shape ``(y,)``."""
    problem = fit.problem
    errors = problem.errors(fit.solution.theta)
    unknowns = (problem.most_unknowns + len(problem.parameters.free)) / errors.shape[1]
    return np.asarray(np.sum(errors**2, axis=0) / max(len(errors) - unknowns, 1.0))
