"""Where local searches begin: designs over a box of parameters, and the search from every point of one.

The box in which parameters are searched when no other is given.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.errors import UsageError
from rotorid.fitting.least_squares import Solution, best_of
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.typing import BoolArray, FloatArray

Scale: TypeAlias = Literal["linear", "logarithmic"]

MOST_IN_COMPOSITE = 12
"""A cube of twelve parameters has 4096 corners; that of the next is not worth its searches."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StartBox(Immutable):
    """A box in which starts are laid out.

    Parameters
    ----------
    lower, upper
        Shape ``(p,)``.
    scales
        How each side is divided: ``linear``, or ``logarithmic`` for what may lie anywhere in several decades of one
        sign.

    Raises
    ------
    UsageError
        A side is empty or infinite, or a logarithmic one reaches zero.

    Examples
    --------
    >>> box = StartBox(lower=np.array([-1.0, 0.01]), upper=np.array([1.0, 1.0]), scales=("linear", "logarithmic"))
    >>> box.at(np.array([[0.5, 0.5]])).round(6).tolist()
    [[0.0, 0.1]]
    """

    lower: FloatArray
    upper: FloatArray
    scales: tuple[Scale, ...]

    def __post_init__(self) -> None:
        lower, upper = (read_only(side, np.float64, ndim=1) for side in (self.lower, self.upper))
        if not lower.size == upper.size == len(self.scales):
            raise UsageError(
                f"{lower.size} lower and {upper.size} upper bounds and {len(self.scales)} scales came",
                needed="one of each for each parameter",
            )
        for low, high, scale in zip(lower.tolist(), upper.tolist(), self.scales, strict=True):
            if not -np.inf < low < high < np.inf:
                raise UsageError(f"a side from {low:g} to {high:g} came", needed="finite bounds with lower < upper")
            if scale == "logarithmic" and low * high <= 0.0:
                raise UsageError(f"a logarithmic side from {low:g} to {high:g} came", needed="bounds of one sign")
        self._set(lower=lower, upper=upper, scales=tuple(self.scales))

    def at(self, share: FloatArray) -> FloatArray:
        """Points at given shares of every side, zero to one; shape ``(..., p)`` as it comes."""
        logarithmic: BoolArray = np.array([scale == "logarithmic" for scale in self.scales], dtype=np.bool_)
        sign = np.where(logarithmic, np.sign(self.lower), 1.0)
        low = np.where(logarithmic, np.log(np.abs(np.where(logarithmic, self.lower, 1.0))), self.lower)
        high = np.where(logarithmic, np.log(np.abs(np.where(logarithmic, self.upper, 1.0))), self.upper)
        inside = low + share * (high - low)
        return np.where(logarithmic, sign * np.exp(np.where(logarithmic, inside, 0.0)), inside)


def central_composite(box: StartBox, *, centers: int = 1) -> FloatArray:
    r"""Central composite design, circumscribed: center, corners of a cube, and a star that reaches farther.

    .. math:: N = 2^k + 2 k + N_c

    points for k parameters. The star stands on the faces of the box, at the distance :math:`2^{k/4}` from the center in
    units of the cube's half side, at which the design can be rotated; the cube lies inside of it.

    Parameters
    ----------
    box
        Where.
    centers
        How often the center is in it; a search needs it once.

    Returns
    -------
    numpy.ndarray
        Shape ``(N, p)``, the center first.

    Raises
    ------
    UsageError
        There are more parameters than twelve: use :func:`sobol` or :func:`at_random`.

    References
    ----------
    G. E. P. Box and K. B. Wilson, *On the Experimental Attainment of Optimum Conditions*, Journal of the Royal
    Statistical Society B, 1951.

    Examples
    --------
    >>> box = StartBox(lower=-np.ones(2), upper=np.ones(2), scales=("linear", "linear"))
    >>> len(central_composite(box)), central_composite(box)[0].tolist()
    (9, [0.0, 0.0])
    """
    k = box.lower.size
    if k > MOST_IN_COMPOSITE:
        raise UsageError(
            f"a central composite design of {k} parameters came, which has {2**k + 2 * k + centers} points",
            needed=f"{MOST_IN_COMPOSITE} parameters or fewer",
            remedy="use a Sobol or a random design, or hold some parameters",
        )
    if centers < 1:
        raise UsageError(f"{centers} centers came", needed="one or more")
    cube = np.stack(np.meshgrid(*[[-1.0, 1.0]] * k, indexing="ij"), axis=-1).reshape(-1, k)
    star = np.concatenate([-np.eye(k), np.eye(k)])
    points = np.concatenate([np.zeros((centers, k)), cube / 2.0 ** (k / 4.0), star])
    return box.at(0.5 + 0.5 * points)


def sobol(box: StartBox, count: int, *, rng: np.random.Generator) -> FloatArray:
    """Scrambled Sobol points, which fill a box more evenly than random ones; shape ``(count, p)``.

    The same generator state gives the same points. Powers of two are evened out best.

    Raises
    ------
    UsageError
        The count is not positive.
    """
    from scipy.stats import qmc

    _require(count)
    engine = qmc.Sobol(d=box.lower.size, scramble=True, rng=rng)
    # The whole block of a power of two keeps the points balanced; what is not asked for is left.
    return box.at(np.asarray(engine.random_base2(int(np.ceil(np.log2(count)))))[:count])


def at_random(box: StartBox, count: int, *, rng: np.random.Generator) -> FloatArray:
    """Points drawn evenly over the box, shape ``(count, p)``.

    Raises
    ------
    UsageError
        The count is not positive.
    """
    _require(count)
    return box.at(rng.random((count, box.lower.size)))


def _require(count: int) -> None:
    if count < 1:
        raise UsageError(f"{count} starts came", needed="one or more")


def multistart(
    minimize: Callable[[FloatArray], Solution], starts: Iterable[FloatArray] | Sequence[FloatArray], *, name: str
) -> Solution:
    """Search from every start; the lowest minimum, with all others that were met in ``others``.

    Parameters
    ----------
    minimize
        From a start, shape ``(p,)``, to where the search ends.
    starts
        Best guess first: of minima with one cost the first counts.
    name
        What is fitted, for the message.

    Raises
    ------
    InsufficientDataError
        No start has a finite cost.

    Examples
    --------
    >>> from rotorid.fitting.least_squares import LevenbergMarquardt
    >>> def residuals(x):
    ...     return np.array([x[0] ** 2 - 1.0, 0.1 * (x[0] - 1.0)]), np.array([[2.0 * x[0]], [0.1]])
    >>> wide = np.array([np.inf])
    >>> found = multistart(
    ...     lambda start: LevenbergMarquardt().minimize(residuals, start, -wide, wide),
    ...     [np.array([-2.0]), np.array([2.0])], name="a well with two valleys",
    ... )
    >>> round(float(found.theta[0]), 6), len(found.others)
    (1.0, 1)
    """
    return best_of([minimize(np.asarray(start, dtype=np.float64)) for start in starts], name=name)


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
