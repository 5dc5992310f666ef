"""What is fitted to what: a structure to measured frequency responses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from rotorid.data.immutable import Immutable, read_only
from rotorid.data.response import FrequencyResponse
from rotorid.errors import UsageError
from rotorid.fit.error_covariance import ResidualErrors, residual_errors
from rotorid.fit.frequency_cost import PHASE_WEIGHT, pair_costs, point_weights, residual_scales
from rotorid.fit.log_errors import Points, log_errors, sums_of_squares
from rotorid.fit.pairs import pair_index
from rotorid.fit.parameter_map import ParameterMap
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.typing import BoolArray, ComplexArray, FloatArray

_OF_THE_DATA = ("weights", "scales", "points", "point_scales", "errors")
_LARGEST_ERROR = 0.3
_LONGEST_DIP = 3
_FEWEST_POINTS = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class FrequencyProblem(Immutable):
    """Fit a linear structure to frequency responses in CIFER's cost.

    Weights change what is minimized, and never what is reported: :meth:`costs` are CIFER's own numbers, comparable
    between problems, while :meth:`residuals` and the cost of a solution carry the weights.

    Parameters
    ----------
    structure
        Its inputs and outputs name the responses, in this order.
    parameters
        Which parameters are free, and from where to start.
    data
        Measured responses of exactly these inputs and outputs.
    used
        Points that count, shape ``(y, u, f)``.
    pair_weights
        Factors on the costs of single responses ``output/input``; one where nothing is said.
    phase_weight
        Weight of a squared degree against a squared decibel; CIFER's 0.01745 makes 7.57° one decibel.
    """

    structure: LinearStructure
    parameters: ParameterSet
    data: FrequencyResponse
    used: BoolArray
    pair_weights: Mapping[str, float] = field(default_factory=dict)
    phase_weight: float = PHASE_WEIGHT

    def __post_init__(self) -> None:
        if self.data.inputs != self.structure.inputs or self.data.outputs != self.structure.outputs:
            raise UsageError(
                f"responses of {', '.join(self.data.outputs)} to {', '.join(self.data.inputs)} came",
                needed=f"{', '.join(self.structure.outputs)} to {', '.join(self.structure.inputs)}",
            )
        used = read_only(self.used, np.bool_, ndim=3)
        if used.shape != self.data.values.shape:
            raise UsageError(f"a selection of shape {used.shape} came", needed=f"shape {self.data.values.shape}")
        for name, weight in self.pair_weights.items():
            pair_index(self.data, name)
            if not 0.0 < weight < np.inf:
                raise UsageError(
                    f"the weight {weight:g} of {name} came",
                    needed="a positive number",
                    remedy="leave the response out of the points that count instead",
                )
        if not 0.0 <= self.phase_weight < np.inf:
            raise UsageError(f"the phase weight {self.phase_weight:g} came", needed="zero or a positive number")
        self._set(used=used, pair_weights=self.pair_weights)

    @cached_property
    def weights(self) -> FloatArray:
        """CIFER's weights of the points, shape ``(y, u, f)``."""
        return point_weights(self.data, self.used)

    @cached_property
    def scales(self) -> tuple[FloatArray, FloatArray]:
        """Factors of magnitude (neper) and phase (radian) errors in the residuals, each ``(y, u, f)``."""
        factors = np.ones(self.used.shape[:2])
        for name, weight in self.pair_weights.items():
            factors[pair_index(self.data, name)] = np.sqrt(weight)
        magnitude, phase = residual_scales(self.weights, self.phase_weight)
        return factors[..., None] * magnitude, factors[..., None] * phase

    @cached_property
    def parameter_map(self) -> ParameterMap:
        """From the free parameters to the matrices."""
        return ParameterMap(self.structure, self.parameters)

    @cached_property
    def points(self) -> Points:
        """The points that count, in the order of the residuals."""
        return Points.of(self.data.omega_rad_s, self.data.values, self.used)

    @cached_property
    def point_scales(self) -> tuple[FloatArray, FloatArray]:
        """The scales at these points, each shape ``(n,)``."""
        magnitude, phase = self.scales
        return magnitude[self.used], phase[self.used]

    @cached_property
    def box(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds of the free parameters, each shape ``(p,)``."""
        free = [self.parameters[name] for name in self.parameters.free]
        return np.array([one.lower for one in free]), np.array([one.upper for one in free])

    @cached_property
    def errors(self) -> ResidualErrors:
        """What the errors of the data make of the residuals."""
        return residual_errors(self.data, self.used, self.point_scales)

    def errors_about(self, theta: FloatArray) -> ResidualErrors:
        """What the errors of the data make of the residuals, about the model at ``theta``."""
        model = self.structure.response(self.parameters.unpack(theta).values, self.data.omega_rad_s)
        return residual_errors(self.data, self.used, self.point_scales, model=model)

    def with_parameters(self, parameters: ParameterSet) -> FrequencyProblem:
        """The same problem with other free parameters or another start."""
        changed = replace(self, parameters=parameters)
        # What follows from the data alone need not be worked out again.
        changed.__dict__.update({name: self.__dict__[name] for name in _OF_THE_DATA if name in self.__dict__})
        return changed

    def residuals(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals whose squares sum to the weighted cost, shape ``(2 n,)``, and their Jacobian ``(2 n, p)``.

        Magnitudes come first, then phases. They are finite also where a response of the model is zero, see
        :func:`rotorid.fit.frequency_cost.log_error`, and not a number where it has a pole at a point.
        """
        residual, jacobian = self.many_residuals(np.asarray(theta)[None])
        return residual[0], jacobian[0].T

    def many_residuals(self, thetas: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals of many parameter vectors ``(b, p)``, shape ``(b, 2 n)``, and derivatives ``(b, p, 2 n)``."""
        error, slope = log_errors(self.parameter_map, thetas, self.points)
        magnitude, phase = self.point_scales
        return _weighted(error, magnitude, phase), _weighted(slope, magnitude, phase)

    def many_costs(self, thetas: FloatArray) -> FloatArray:
        """Sum of the squared residuals for many parameter vectors ``(b, p)``, shape ``(b,)``; infinite at a pole."""
        return sums_of_squares(self.parameter_map, thetas, self.points, self.point_scales)

    def costs(self, theta: FloatArray) -> FloatArray:
        """Cost of each response without weights of pairs, shape ``(y, u)``."""
        model = self.structure.response(self.parameters.unpack(theta).values, self.data.omega_rad_s)
        return pair_costs(model, self.data.values, self.weights)


def _weighted(values: ComplexArray, magnitude: FloatArray, phase: FloatArray) -> FloatArray:
    """Real and imaginary parts of ``(..., n)`` with their weights, one after the other, shape ``(..., 2 n)``."""
    parts = np.empty((*values.shape[:-1], 2 * values.shape[-1]))
    np.multiply(values.real, magnitude, out=parts[..., : magnitude.size])
    np.multiply(values.imag, phase, out=parts[..., magnitude.size :])
    return parts


def usable_points(
    data: FrequencyResponse, *, coherence: float, band_rad_s: tuple[float, float] | None = None
) -> BoolArray:
    """Points of a response that can be trusted, shape ``(y, u, f)``.

    A point counts where the coherence reaches the limit and the random error stays below 0.3; of these the longest
    stretch is taken, across dips of up to three points, and within the band that was asked for.
    """
    good = (data.coherence >= coherence) & (data.random_error <= _LARGEST_ERROR)
    if band_rad_s is not None:
        low, high = band_rad_s
        good &= (data.omega_rad_s >= low * (1 - 1e-9)) & (data.omega_rad_s <= high * (1 + 1e-9))
    return np.apply_along_axis(_longest_stretch, -1, good)


def _longest_stretch(good: BoolArray) -> BoolArray:
    index = np.flatnonzero(good)
    if index.size == 0:
        return good
    runs = np.split(index, np.flatnonzero(np.diff(index) > _LONGEST_DIP + 1) + 1)
    longest = max(runs, key=len)
    kept = np.zeros_like(good)
    # A point or two among many are coherent by chance.
    kept[longest] = longest.size >= min(_FEWEST_POINTS, good.size)
    return kept
