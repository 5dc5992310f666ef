r"""What the uncertainty of the parameters makes uncertain: tied parameters, poles, the response itself.

All of it is first order: a quantity :math:`g` has the variance :math:`\nabla g^T \, \mathrm{Cov}\,\theta \, \nabla g`,
with exact derivatives. For a pole :math:`\lambda` with :math:`F x = \lambda M x` and :math:`y^H F = \lambda y^H M`

.. math:: \frac{\partial \lambda}{\partial \theta} = \frac{y^H (\dot F - \lambda \dot M) x}{y^H M x}

where a dot stands for the derivative of a matrix. Where two poles lie so near that the parameters may make them meet,
this has no meaning, because poles that meet move like a square root; such poles are given without a covariance.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.errors import UsageError
from rotorid.models.parameter import ParameterSet
from rotorid.models.state_space import StateSpace
from rotorid.models.structure import LinearStructure
from rotorid.typing import ComplexArray, FloatArray
from rotorid.uncertainty.cramer_rao import Bounds

# Poles a +- sqrt(d) lie 2 sqrt(d) apart, known to std(d) / sqrt(d): four of these make d two of its own from zero.
_DISTINCT_STDS = 4.0
_COINCIDENT = 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class Pole(Immutable):
    """A pole and how well it is known.

    Parameters
    ----------
    value
        In 1/s.
    covariance
        Of its real and imaginary part, shape ``(2, 2)``; ``None`` where it lies too near to another pole.
    """

    value: complex
    covariance: FloatArray | None

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
        """Standard deviation of the damping ratio; zero for a real pole."""
        if not self.value:
            return None
        real, imaginary, size = self.value.real, self.value.imag, abs(self.value)
        return self._std(-(imaginary**2) / size**3, real * imaginary / size**3)

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
        'The pole at -2 1/s is known to 0.1 1/s.'
        """
        real, imaginary = self.value.real, self.value.imag
        place = f"{real:.4g} 1/s" if imaginary == 0.0 else f"{real:.4g}{imaginary:+.4g}j 1/s"
        if self.covariance is None:
            return (
                f"The pole at {place} lies so near to another one that within the uncertainty of the parameters they "
                "may meet; no standard deviation describes it."
            )
        if imaginary == 0.0 or not self.value:
            return f"The pole at {place} is known to {np.sqrt(self.covariance[0, 0]):.2g} 1/s."
        return (
            f"The pole at {place} has a natural frequency of {self.frequency_rad_s:.4g} ± "
            f"{self.frequency_std_rad_s:.2g} rad/s and a damping ratio of {self.damping:.3g} ± {self.damping_std:.2g}."
        )


def covariance_of_all(parameters: ParameterSet, bounds: Bounds) -> FloatArray:
    """Covariance of all parameters in their order, tied ones included, shape ``(parameters, parameters)``.

    Fixed and dropped parameters have none.

    Raises
    ------
    UsageError
        The bounds are of other free parameters.
    """
    root = parameters.directions @ _root(parameters, bounds)
    return np.asarray(root @ root.T)


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
    root = _root(parameters, bounds)
    response, derivative = structure.response_and_jacobian(parameters.values, omega_rad_s, parameters.directions)
    silent = response == 0.0
    slope = derivative / np.where(silent, 1.0, response)
    spread = np.tensordot(root.T, slope, axes=1)
    magnitude, phase = (np.sqrt(np.sum(part**2, axis=0)) for part in (spread.real, spread.imag))
    return np.where(silent, np.inf, magnitude), np.where(silent, np.inf, phase)


def pole_confidence(structure: LinearStructure, parameters: ParameterSet, bounds: Bounds) -> tuple[Pole, ...]:
    """Finite poles of the identified model with their uncertainty, slowest first.

    First order in the errors of the parameters. Two poles nearer to each other than four standard deviations of their
    difference may meet or change from a pair into two real ones; they have no covariance.

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
    root = _root(parameters, bounds)
    system, derivatives = structure.matrices_and_jacobian(parameters.values, parameters.directions)
    poles, left, right = _modes(system)
    dM, dF = derivatives[0], derivatives[1]
    normal = np.einsum("xi,xz,zi->i", left.conj(), system.M, right)
    # A defective pole has no derivative; it coincides with another one and is sorted out below.
    normal = np.where(np.abs(normal) > 0.0, normal, 1.0)
    moved = np.einsum("xi,kxz,zi->ik", left.conj(), dF, right)
    moved = moved - poles[:, None] * np.einsum("xi,kxz,zi->ik", left.conj(), dM, right)
    spread = (moved / normal[:, None]) @ root
    parts = np.stack([spread.real, spread.imag], axis=1)
    return tuple(
        Pole(value=complex(pole), covariance=part @ part.T if apart else None)
        for pole, part, apart in zip(poles, parts, _distinct(poles, spread), strict=True)
    )


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


def _distinct(poles: ComplexArray, spread: ComplexArray) -> list[bool]:
    """Whether each pole stays apart from every other within the errors of the parameters."""
    distance = np.abs(poles[:, None] - poles)
    np.fill_diagonal(distance, np.inf)
    doubt = np.sqrt(np.sum(np.abs(spread[:, None] - spread) ** 2, axis=-1))
    size = np.maximum(np.abs(poles)[:, None], np.abs(poles))
    apart = (distance > _DISTINCT_STDS * doubt) & (distance > _COINCIDENT * size)
    return [bool(row) for row in apart.all(axis=1)]


def _root(parameters: ParameterSet, bounds: Bounds) -> FloatArray:
    """A root of the covariance of the free parameters, ``covariance = root @ root.T``.

    Squares of a root keep their digits along directions that the data do not see, which would cancel otherwise.
    """
    if bounds.names != parameters.free:
        raise UsageError(
            f"bounds of {', '.join(bounds.names) or 'no parameters'} came",
            needed=f"bounds of {', '.join(parameters.free) or 'no parameters'}",
        )
    scale = np.where(bounds.std > 0.0, bounds.std, 1.0)
    variances, vectors = np.linalg.eigh(bounds.covariance / np.outer(scale, scale))
    return np.asarray(scale[:, None] * vectors * np.sqrt(np.maximum(variances, 0.0)))
