"""What moved the outputs of an estimate beside its inputs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotorid.data.immutable import Immutable, read_only
from rotorid.typing import ComplexArray, FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Disturbance(Immutable):
    r"""Densities of disturbances and inputs, from which the disturbance about any other response follows.

    About another response :math:`T` the disturbance is :math:`Y - T U = V + (H - T) U`. Feedback correlates :math:`V`
    with :math:`U`, and an estimate has adapted to the disturbance that it saw: about the model that fits all of the
    data, the disturbance shows itself better.

    Parameters
    ----------
    densities
        :math:`E[a b^*]` of the disturbances :math:`V = Y - H U` of all outputs and then of all inputs, shape
        ``(y + u, y + u, f)``.
    level
        Densities of the disturbances as the errors of the estimate were stated with, shape ``(y, f)``.
    weakness
        Factor on the stated errors because instruments are weak, shape ``(y, u, f)``; one for a strong one.
    """

    densities: ComplexArray
    level: FloatArray
    weakness: FloatArray

    def __post_init__(self) -> None:
        self._set(
            densities=read_only(self.densities, np.complex128, ndim=3),
            level=read_only(self.level, np.float64, ndim=2),
            weakness=read_only(self.weakness, np.float64, ndim=3),
        )
