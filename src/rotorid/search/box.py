"""The box in which parameters are searched when no other is given."""

from __future__ import annotations

import numpy as np

from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.search.design_of_starts import Scale, StartBox

_WIDER = 3.0
_LEAST_SIZE = 1e-3


def search_box(parameters: ParameterSet, *, wider: float = _WIDER) -> StartBox:
    """The box of the free parameters, from their start values.

    It reaches from the smallest start value over ``wider`` to the largest times ``wider``; without start values, as far
    about the value. Values of both signs, or zero, have a box about zero. Bounds cut it. A side without zero is divided
    by its logarithm.

    Parameters
    ----------
    parameters
        Of a problem.
    wider
        How far the box reaches beyond the start values; ten for what may be off by a decade.

    Returns
    -------
    StartBox
        With as many sides as there are free parameters.

    Raises
    ------
    UsageError
        The bounds leave nothing of a side.

    Examples
    --------
    >>> lag = Parameter(name="T_motor", value=0.05, unit="s", lower=0.0, starts=(0.03, 0.1))
    >>> box = search_box(ParameterSet([lag]))
    >>> box.lower.round(3).tolist(), box.upper.round(3).tolist(), box.scales
    ([0.01], [0.3], ('logarithmic',))
    """
    sides = [_side(parameters[name], wider) for name in parameters.free]
    scales: tuple[Scale, ...] = tuple("logarithmic" if low * high > 0.0 else "linear" for low, high in sides)
    lower, upper = np.array(sides, dtype=np.float64).reshape(-1, 2).T
    return StartBox(lower=lower, upper=upper, scales=scales)


def _side(one: Parameter, wider: float) -> tuple[float, float]:
    values = one.starts or (one.value,)
    low, high = min(values), max(values)
    if low > 0.0:
        low, high = low / wider, high * wider
    elif high < 0.0:
        low, high = low * wider, high / wider
    else:
        size = wider * max(abs(low), abs(high), _LEAST_SIZE)
        low, high = -size, size
    return max(low, one.lower), min(high, one.upper)
