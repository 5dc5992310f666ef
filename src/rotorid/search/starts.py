"""Where local searches begin: designs of points over a box of parameters."""

from __future__ import annotations

import numpy as np

from rotorid.errors import UsageError
from rotorid.fitting.problem import StartBox
from rotorid.typing import FloatArray

MOST_IN_COMPOSITE = 12
"""A cube of twelve parameters has 4096 corners; that of the next is not worth its searches."""


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
            f"a central composite design of {k} parameters has {2**k + 2 * k + centers} points, too many",
            needed=f"{MOST_IN_COMPOSITE} parameters or fewer",
            remedy="use a Sobol or a random design, or fix some parameters",
        )
    if centers < 1:
        raise UsageError(f"{centers} centers are too few", needed="one or more")
    cube = np.stack(np.meshgrid(*[[-1.0, 1.0]] * k, indexing="ij"), axis=-1).reshape(-1, k)
    star = np.concatenate([-np.eye(k), np.eye(k)])
    points = np.concatenate([np.zeros((centers, k)), cube / 2.0 ** (k / 4.0), star])
    return box.at(0.5 + 0.5 * points)


def sobol(box: StartBox, count: int, *, rng: np.random.Generator) -> FloatArray:
    """Scrambled Sobol points, which fill a box more evenly than random ones; shape ``(count, p)``.

    The same generator state gives the same points. Powers of two are evened out best.

    Parameters
    ----------
    box
        Limits of each parameter.
    count
        How many points.
    rng
        Source of what is random.

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

    Parameters
    ----------
    box
        Limits of each parameter.
    count
        How many points.
    rng
        Source of what is random.

    Raises
    ------
    UsageError
        The count is not positive.
    """
    _require(count)
    return box.at(rng.random((count, box.lower.size)))


def _require(count: int) -> None:
    if count < 1:
        raise UsageError(f"{count} starts are too few", needed="one or more")
