"""What a search minimizes: one face for every cost of the package."""

from __future__ import annotations

from typing import ClassVar, Protocol

from rotorid.fit.solution import Solution
from rotorid.search.design_of_starts import StartBox
from rotorid.typing import FloatArray


class Objective(Protocol):
    """A cost over a box of parameters, with a local search of its own.

    Every search works on these few verbs alone, so that it knows nothing of frequency responses, simulations or forces.
    An objective is a value: the cost of a vector depends on that vector only, and it pickles, so that workers in other
    processes can compute it.
    """

    at_once: ClassVar[int]
    """How many vectors a worker is given at least: hundreds where one costs microseconds."""

    @property
    def name(self) -> str:
        """What is fitted, for messages."""
        ...

    @property
    def box(self) -> StartBox:
        """Where to search; the local search may leave it as far as its own bounds allow."""
        ...

    def costs(self, thetas: FloatArray) -> FloatArray:
        """Cost of many parameter vectors ``(b, p)``, shape ``(b,)``; infinite where the model has no value."""
        ...

    def point_costs(self, thetas: FloatArray) -> FloatArray:
        """What every point of the data adds to the cost, ``(b, p)`` to ``(b, n)``; infinite where there is no value.

        A point is what is measured at once: magnitude and phase at one frequency, all outputs at one sample.
        """
        ...

    def polish(self, start: FloatArray) -> Solution:
        """Local search from a start ``(p,)``; the cost of the solution is that of :meth:`costs`."""
        ...

    def polish_points(self, start: FloatArray, points: FloatArray) -> Solution:
        """A few steps of it for a part of the data: weights of the points, zero or more, shape ``(n,)``."""
        ...
