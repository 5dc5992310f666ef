"""Which combinations of parameters the data see, and which they do not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rotorid.data.immutable import Immutable
from rotorid.models.parameter import ParameterSet
from rotorid.uncertainty.bounds import Bounds

_UNSEEN = 0.5
_PART = 0.3


@dataclass(frozen=True, kw_only=True)
class Combination(Immutable):
    """A direction in which the parameters can move with hardly a change of the response.

    Parameters
    ----------
    vector
        Parameter to its share, in relative changes; a unit vector.
    relative_std
        One standard deviation along it, relative to the values.
    """

    vector: Mapping[str, float]
    relative_std: float

    def __post_init__(self) -> None:
        self._set(vector=self.vector)

    def words(self) -> str:
        """One sentence for a person."""
        # Among very many parameters even the largest share may be small.
        least = min(_PART, 0.8 * max(abs(share) for share in self.vector.values()))
        parts = [name for name, share in self.vector.items() if abs(share) >= least]
        percent = f"{100.0 * self.relative_std:.0f} %"
        if len(parts) < 2:
            return f"{parts[0]} is known to no better than {percent}."
        *first, last = parts
        return (
            f"{', '.join(first)} and {last} can hardly be told apart: moved together they may change by {percent} "
            "and the response stays the same. Fix one of them, or excite a wider band."
        )


def unseen_combinations(parameters: ParameterSet, bounds: Bounds) -> tuple[Combination, ...]:
    """Directions with a relative standard deviation above one half, worst first.

    The eigenvectors of the covariance relative to the values; parameters at zero are left out.
    """
    values = np.array([parameters[name].value for name in bounds.names])
    kept = np.flatnonzero(np.abs(values) > 0.0)
    if kept.size == 0:
        return ()
    relative = bounds.covariance[np.ix_(kept, kept)] / np.outer(values[kept], values[kept])
    variances, vectors = np.linalg.eigh(relative)
    names = [bounds.names[index] for index in kept]
    found = [
        Combination(
            vector={name: float(share) for name, share in zip(names, vectors[:, i], strict=True)},
            relative_std=float(np.sqrt(variances[i])),
        )
        for i in np.argsort(variances)[::-1]
        if variances[i] > _UNSEEN**2
    ]
    return tuple(found)
