r"""Propagation of the uncertainty of the parameters to tied parameters, poles and responses.

All of it is first order: a quantity :math:`g` has the variance :math:`\nabla g^T \, \mathrm{Cov}\,\theta \, \nabla g`,
with exact derivatives. For a pole :math:`\lambda` with :math:`F x = \lambda M x` and :math:`y^H F = \lambda y^H M`

.. math:: \frac{\partial \lambda}{\partial \theta} = \frac{y^H (\dot F - \lambda \dot M) x}{y^H M x}

where a dot stands for the derivative of a matrix. Poles that are equal, or that the errors of the parameters may make
meet, have no such derivative: they move like a root. What stays smooth is their common invariant subspace. With bases
:math:`X` and :math:`Y` of it, :math:`Y^H M X = 1`, they are the eigenvalues of the small matrix

.. math:: A = Y^H F X, \qquad \dot A = Y^H (\dot F X - \dot M X A)

whose errors are carried to its eigenvalues by points spread over a normal distribution, not by a slope (G. W. Stewart,
J. Sun, "Matrix Perturbation Theory", Academic Press, 1990, sections V.2 and VI.2).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.data.quantity import with_error
from rotorid.errors import UsageError
from rotorid.models.parameter import ParameterSet
from rotorid.models.state_space import StateSpace
from rotorid.models.structure import LinearStructure
from rotorid.typing import BoolArray, ComplexArray, FloatArray
from rotorid.uncertainty.cramer_rao import Bounds

# Poles a +- sqrt(d) lie 2 sqrt(d) apart, known to std(d) / sqrt(d): four of these make d two of its own from zero.
_DISTINCT_STDS = 4.0
_COINCIDENT = 1e-6
# Sigma points of a normal distribution of the errors; second moments are then good to a few percent.
_POINTS = 512
_FLAT = 1e-9
_SHARE_OF_STD = 1e-3
_DEFECTIVE = 1e10


@dataclass(frozen=True, kw_only=True, eq=False)
class Pole(Immutable):
    """A pole and how well it is known.

    Parameters
    ----------
    value
        In 1/s.
    covariance
        Of its real and imaginary part, shape ``(2, 2)``; ``None`` where nobody stated one.
    meets
        Whether it lies so near to another pole that within the errors of the parameters they may meet. The covariance
        then holds the mean squares of how far the pole may move, a pair that becomes two real poles included.
    """

    value: complex
    covariance: FloatArray | None
    meets: bool = False

    def __post_init__(self) -> None:
        if self.covariance is not None:
            self._set(covariance=read_only(self.covariance, np.float64, ndim=2))

    @property
    def frequency_rad_s(self) -> float:
        """Natural frequency, the distance from the origin."""
        return abs(self.value)

    @property
    def damping(self) -> float | None:
        """Damping ratio, negative where the mode grows; ``None`` at the origin."""
        return -self.value.real / abs(self.value) if self.value else None

    @property
    def frequency_std_rad_s(self) -> float | None:
        """Standard deviation of the natural frequency."""
        if not self.value:
            return None if self.covariance is None else float(np.sqrt(np.trace(self.covariance)))
        return self._std(self.value.real / abs(self.value), self.value.imag / abs(self.value))

    @property
    def damping_std(self) -> float | None:
        """Standard deviation of the damping ratio; zero for a real pole that meets no other."""
        if not self.value:
            return None
        real, imaginary, size = self.value.real, self.value.imag, abs(self.value)
        std = self._std(-(imaginary**2) / size**3, real * imaginary / size**3)
        if std is None or self.covariance is None or not self.meets:
            return std
        # Two real poles that may become a pair lose damping with the square of their imaginary part.
        return math.hypot(std, float(self.covariance[1, 1]) / (math.sqrt(2.0) * size**2))

    def _std(self, *gradient: float) -> float | None:
        if self.covariance is None:
            return None
        slope = np.array(gradient)
        return float(np.sqrt(max(0.0, slope @ self.covariance @ slope)))

    def words(self) -> str:
        """One sentence for a person.

        Examples
        --------
        >>> Pole(value=-2.0 + 0j, covariance=np.diag([0.01, 0.0])).words()
        'The pole at -2 1/s is uncertain by 0.1 1/s.'
        """
        real, imaginary = self.value.real, self.value.imag
        place = f"{real:.4g} 1/s" if imaginary == 0.0 else f"{real:.4g}{imaginary:+.4g}j 1/s"
        if self.covariance is None:
            return f"The pole at {place} has no standard deviation."
        if self.meets:
            spread = math.sqrt(float(np.trace(self.covariance)))
            return (
                f"The pole at {place} is uncertain by {spread:.2g} 1/s in the plane: it is so close to another "
                "one that they may coincide within the uncertainty of the parameters."
            )
        if imaginary == 0.0 or not self.value:
            return f"The pole at {place} is uncertain by {np.sqrt(self.covariance[0, 0]):.2g} 1/s."
        return (
            f"The pole at {place} has a natural frequency of "
            f"{with_error(self.frequency_rad_s, self.frequency_std_rad_s)} rad/s and a damping ratio of "
            f"{with_error(self.damping, self.damping_std, digits=3)}."
        )


def covariance_of_all(parameters: ParameterSet, bounds: Bounds) -> FloatArray:
    """Covariance of all parameters in their order, tied ones included, shape ``(parameters, parameters)``.

    Fixed and dropped parameters have none.

    Parameters
    ----------
    parameters
        With their ties.
    bounds
        Uncertainty of the free ones.

    Raises
    ------
    UsageError
        The bounds are of other free parameters.
    """
    root = parameters.directions @ _root(parameters, bounds)
    return np.asarray(root @ root.T)


def covariance_of(
    made: Callable[[Mapping[str, float]], Sequence[float] | FloatArray], values: Mapping[str, float], bounds: Bounds
) -> FloatArray:
    """Covariance of numbers that follow from parameters by a function without exact derivatives.

    Parameters
    ----------
    made
        Makes the numbers of values by name.
    values
        At which they are wanted, those that no fit had free included.
    bounds
        Covariance of the free ones; others of its names have no part.

    Examples
    --------
    >>> from rotorid.uncertainty.cramer_rao import Bounds
    >>> P = np.array([[0.04, -0.02], [-0.02, 0.01]])
    >>> known = Bounds(names=("a", "b"), cramer_rao=np.zeros(2), insensitivity=np.zeros(2), covariance=P, random=P)
    >>> covariance_of(lambda of: [of["a"] + 2.0 * of["b"], of["a"]], {"a": 1.0, "b": 1.0}, known).round(6) + 0.0
    array([[0.  , 0.  ],
           [0.  , 0.04]])
    """
    slopes = np.zeros((len(made(values)), len(bounds.names)))
    for column, (name, std) in enumerate(zip(bounds.names, np.sqrt(bounds.covariance.diagonal()), strict=True)):
        if name in values and std > 0.0:
            step = _SHARE_OF_STD * float(std)
            up, down = (np.asarray(made({**values, name: values[name] + side * step})) for side in (1.0, -1.0))
            slopes[:, column] = (up - down) / (2.0 * step)
    return np.asarray(slopes @ bounds.covariance @ slopes.T)


def response_confidence(
    structure: LinearStructure, parameters: ParameterSet, bounds: Bounds, omega_rad_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Standard deviation of the model's response, which is that of the parameters carried over.

    It says how well the model is known if its structure holds, and nothing of what the structure leaves out.

    Parameters
    ----------
    structure
        The identified structure.
    parameters
        With the identified values.
    bounds
        Of the same solution.
    omega_rad_s
        Shape ``(f,)``.

    Returns
    -------
    numpy.ndarray
        Of the magnitude, relative, shape ``(y, u, f)``; infinite where the model does not respond.
    numpy.ndarray
        Of the phase in radians, shape ``(y, u, f)``.

    Raises
    ------
    UsageError
        The bounds are of other free parameters.
    """
    root, directions = _moved(parameters, bounds)
    response, derivative = structure.response_and_jacobian(parameters.values, omega_rad_s, directions)
    silent = response == 0.0
    slope = derivative / np.where(silent, 1.0, response)
    spread = np.tensordot(root.T, slope, axes=1)
    magnitude, phase = (np.sqrt(np.sum(part**2, axis=0)) for part in (spread.real, spread.imag))
    return np.where(silent, np.inf, magnitude), np.where(silent, np.inf, phase)


def pole_confidence(structure: LinearStructure, parameters: ParameterSet, bounds: Bounds) -> tuple[Pole, ...]:
    """Finite poles of the identified model with their uncertainty, slowest first.

    First order in the errors of the parameters. Poles nearer to each other than four standard deviations of their
    difference may meet or change from a pair into two real ones; their covariance is that of the eigenvalues of their
    common block, whose errors are of first order.

    Parameters
    ----------
    structure
        The identified structure.
    parameters
        With the identified values.
    bounds
        Of the same solution.

    Raises
    ------
    UsageError
        The bounds are of other free parameters.
    ModelError
        The algebraic equations of the model do not determine their states.
    """
    root, directions = _moved(parameters, bounds)
    system, derivatives = structure.matrices_and_jacobian(parameters.values, directions)
    poles, left, right = _modes(system)
    dM, dF = derivatives[0], derivatives[1]
    normal = np.einsum("xi,xz,zi->i", left.conj(), system.M, right)
    # A defective pole has no derivative; it coincides with another one and finds its place in a cluster below.
    normal = np.where(np.abs(normal) > 0.0, normal, 1.0)
    moved = np.einsum("xi,kxz,zi->ik", left.conj(), dF, right)
    moved = moved - poles[:, None] * np.einsum("xi,kxz,zi->ik", left.conj(), dM, right)
    spread = (moved / normal[:, None]) @ root

    clusters: list[_Cluster] = [_Cluster((place,), spread[[place]], False) for place in range(poles.size)]
    while (near := _closest_pair(poles, clusters)) is not None:
        members = tuple(sorted(clusters[near[0]].members + clusters[near[1]].members))
        moves = _moves(system, np.tensordot(dM, root, (0, 0)), np.tensordot(dF, root, (0, 0)), poles, members)
        clusters = [cluster for place, cluster in enumerate(clusters) if place not in near]
        clusters.append(_Cluster(members, moves, True))

    found: dict[int, Pole] = {}
    for cluster in clusters:
        for place, moves in zip(cluster.members, cluster.moves, strict=True):
            parts = np.stack([moves.real, moves.imag])
            found[place] = Pole(value=complex(poles[place]), covariance=parts @ parts.T, meets=cluster.meets)
    return tuple(_as_its_conjugate(found[place], found.values()) for place in range(poles.size))


class _Cluster(NamedTuple):
    """Poles that may meet, or one alone; rows of ``moves`` are roots of the covariance of each."""

    members: tuple[int, ...]
    moves: ComplexArray
    meets: bool


def _closest_pair(poles: ComplexArray, clusters: Sequence[_Cluster]) -> tuple[int, int] | None:
    """The two clusters, nearest first, that may coincide within the errors of the parameters."""
    together = []
    for one, two in itertools.combinations(range(len(clusters)), 2):
        first, second = clusters[one], clusters[two]
        for i, j in itertools.product(range(len(first.members)), range(len(second.members))):
            here, there = poles[first.members[i]], poles[second.members[j]]
            if first.meets or second.meets:
                doubt = np.hypot(np.linalg.norm(first.moves[i]), np.linalg.norm(second.moves[j]))
            else:
                doubt = np.linalg.norm(first.moves[i] - second.moves[j])
            distance = abs(here - there)
            if distance <= max(_DISTINCT_STDS * float(doubt), _COINCIDENT * max(abs(here), abs(there))):
                together.append((float(distance), (one, two)))
    return min(together)[1] if together else None


def _moves(
    system: StateSpace, dM: FloatArray, dF: FloatArray, poles: ComplexArray, members: tuple[int, ...]
) -> ComplexArray:
    """How far poles of a cluster move, root mean squares over points of the errors, shape ``(members, points)``.

    ``dM`` and ``dF`` have the shape ``(x, x, p)``: derivatives along independent errors of unit variance.
    """
    from scipy.optimize import linear_sum_assignment

    right = _invariant(system.F, system.M, poles, members)
    left = _invariant(system.F.T, system.M.T, poles.conj(), members)
    together = left.conj().T @ system.M @ right
    if np.linalg.cond(together) > _DEFECTIVE:
        # Another pole is equal to these but for rounding: they have a common block with it only.
        return np.full((len(members), 1), np.inf + 0j)
    left = left @ np.linalg.inv(together).conj().T
    block = left.conj().T @ system.F @ right
    slopes = np.einsum("xi,xzp,zj->pij", left.conj(), dF, right)
    slopes = slopes - np.einsum("xi,xzp,zj->pij", left.conj(), dM, right @ block)

    flat = slopes.reshape(len(slopes), -1)
    turns, sizes, directions = np.linalg.svd(np.hstack([flat.real, flat.imag]), full_matrices=False)
    directions = directions * _signs(turns)[:, None]
    significant = sizes > _FLAT * sizes.max(initial=0.0)
    real, imaginary = np.split(sizes[significant, None] * directions[significant], 2, axis=1)
    changes = (_normal_points(int(significant.sum())) @ (real + 1j * imaginary)).reshape(-1, *block.shape)
    drawn = np.linalg.eigvals(block + changes)
    nominal = poles[list(members)]
    far = drawn[:, None, :] - nominal[:, None]
    moves = np.stack([index[linear_sum_assignment(np.abs(index) ** 2)] for index in far], axis=1)
    # Which of several equal poles went where has no meaning: they share their mean squares.
    equal = np.abs(nominal[:, None] - nominal) <= _COINCIDENT * np.abs(nominal)
    shares = np.sqrt(equal / equal.sum(axis=1, keepdims=True) / len(drawn))
    return np.asarray((shares[:, :, None] * moves).reshape(len(members), -1))


def _invariant(F: FloatArray, M: FloatArray, poles: ComplexArray, members: tuple[int, ...]) -> ComplexArray:
    """An orthonormal basis of the right deflating subspace of some poles, shape ``(x, members)``."""
    from scipy.linalg import ordqz

    inside = np.isin(np.arange(poles.size), members)

    def chosen(alpha: ComplexArray, beta: ComplexArray) -> BoolArray:
        # The poles of the pencil come in any order, infinite ones among them: the nearest to each member is taken.
        values = np.where(np.abs(beta) > 0.0, alpha / np.where(np.abs(beta) > 0.0, beta, 1.0), np.inf)
        taken = np.zeros(values.size, dtype=bool)
        for pole in poles[inside]:
            taken[np.argmin(np.where(taken, np.inf, np.abs(values - pole)))] = True
        return taken

    # The stubs of scipy promise single numbers to ``sort``, and arrays come.
    sort: Any = chosen
    basis: Any = ordqz(F, M, sort=sort, output="complex")[-1]
    return np.asarray(basis[:, : inside.sum()])


def _normal_points(size: int) -> FloatArray:
    r"""Points that fill a normal distribution evenly, shape ``(points, size)``; the same ones every time.

    A Kronecker sequence with the powers of the root of :math:`x^{n+1} = x + 1`, with each point its opposite.
    """
    from scipy.special import ndtri

    golden = 2.0
    for _ in range(64):
        golden = (1.0 + golden) ** (1.0 / (size + 1))
    count = np.arange(1, _POINTS // 2 + 1)[:, None]
    points = ndtri((0.5 + count * golden ** -np.arange(1.0, size + 1)) % 1.0)
    return np.vstack([points, -points])


def _as_its_conjugate(pole: Pole, others: Iterable[Pole]) -> Pole:
    """A pole that meets another is known as well as its conjugate, whichever of two real poles it may become."""
    if not pole.meets or pole.value.imag == 0.0 or pole.covariance is None:
        return pole
    twin = min(others, key=lambda other: abs(other.value - pole.value.conjugate()))
    if twin.covariance is None or not twin.meets:
        return pole
    mirror = np.array([[1.0, -1.0], [-1.0, 1.0]])
    return Pole(value=pole.value, covariance=0.5 * (pole.covariance + twin.covariance * mirror), meets=True)


def _modes(system: StateSpace) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Finite poles, slowest first, with left and right eigenvectors in columns."""
    from scipy.linalg import eig

    count = system.poles().size
    # The stubs of scipy promise two arrays here, and three come.
    decomposition: Any = eig(system.F, system.M, left=True, right=True)
    values, left, right = decomposition
    # Algebraic states give infinite poles, which rounding may make very large ones.
    finite = np.argsort(np.abs(values))[:count]
    poles = np.asarray(values[finite], dtype=np.complex128)
    # A pair is equally far from the origin but for rounding.
    order = np.lexsort((poles.imag, np.array([float(f"{size:.9g}") for size in np.abs(poles)])))
    return poles[order], left[:, finite[order]], right[:, finite[order]]


def _moved(parameters: ParameterSet, bounds: Bounds) -> tuple[FloatArray, FloatArray]:
    """What moves a response, and a root of its covariance: free parameters, and each contradicted tie alone."""
    root, directions = _root(parameters, bounds.of_measured(())), parameters.directions
    count = len(bounds.implied)
    alone = np.zeros((len(directions), count))
    for column, (tie, moved) in enumerate(bounds.implied.items()):
        row = parameters.names.index(tie)
        alone[row, column] = directions[row] @ moved
    root = np.block([[root, np.zeros((len(root), count))], [np.zeros((count, root.shape[1])), np.eye(count)]])
    return root, np.hstack([directions, alone])


def _root(parameters: ParameterSet, bounds: Bounds) -> FloatArray:
    """A root of the covariance of the free parameters, ``covariance = root @ root.T``.

    Squares of a root keep their digits along directions that the data do not see, which would cancel otherwise.
    """
    if bounds.names != parameters.free:
        raise UsageError(
            f"the bounds are for {', '.join(bounds.names) or 'no parameters'}",
            needed=f"bounds of {', '.join(parameters.free) or 'no parameters'}",
        )
    scale = np.where(bounds.std > 0.0, bounds.std, 1.0)
    variances, vectors = np.linalg.eigh(bounds.covariance / np.outer(scale, scale))
    return np.asarray(scale[:, None] * vectors * _signs(vectors) * np.sqrt(np.maximum(variances, 0.0)))


def _signs(vectors: FloatArray) -> FloatArray:
    """A sign for each column that does not depend on the one that rounding gave it, shape ``(k,)``.

    Points of a normal distribution are few, and those of one sign are not those of the other.
    """
    return np.where(np.sqrt(np.arange(1.0, len(vectors) + 1.0)) @ vectors < 0.0, -1.0, 1.0)
