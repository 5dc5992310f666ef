"""What is fitted to what: a structure to measured frequency responses."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from rotorid.data.immutable import Immutable, read_only
from rotorid.data.response import FrequencyResponse
from rotorid.errors import UsageError
from rotorid.fit.frequency_cost import log_error, pair_costs, point_weights, residual_scales
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.typing import BoolArray, FloatArray

_LARGEST_ERROR = 0.3
_LONGEST_DIP = 3
_FEWEST_POINTS = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class FrequencyProblem(Immutable):
    """Fit a linear structure to frequency responses in CIFER's cost.

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
    """

    structure: LinearStructure
    parameters: ParameterSet
    data: FrequencyResponse
    used: BoolArray

    def __post_init__(self) -> None:
        if self.data.inputs != self.structure.inputs or self.data.outputs != self.structure.outputs:
            raise UsageError(
                f"responses of {', '.join(self.data.outputs)} to {', '.join(self.data.inputs)} came",
                needed=f"{', '.join(self.structure.outputs)} to {', '.join(self.structure.inputs)}",
            )
        used = read_only(self.used, np.bool_, ndim=3)
        if used.shape != self.data.values.shape:
            raise UsageError(f"a selection of shape {used.shape} came", needed=f"shape {self.data.values.shape}")
        self._set(used=used)

    @cached_property
    def weights(self) -> FloatArray:
        """Weights of the points, shape ``(y, u, f)``."""
        return point_weights(self.data, self.used)

    @cached_property
    def _columns(self) -> BoolArray:
        return np.asarray(self.used.any(axis=(0, 1)))

    @cached_property
    def _selected(self) -> BoolArray:
        return self.used[:, :, self._columns]

    def with_parameters(self, parameters: ParameterSet) -> FrequencyProblem:
        """The same problem with other free parameters or another start."""
        return replace(self, parameters=parameters)

    def residuals(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals whose squares sum to the cost of all responses, shape ``(2 n,)``, and their Jacobian ``(2 n, p)``.

        Magnitudes come first, then phases.
        """
        omega = self.data.omega_rad_s[self._columns]
        values = self.parameters.unpack(theta).values
        model, derivative = self.structure.response_and_jacobian(values, omega, self.parameters.directions)
        magnitude, phase = (scale[:, :, self._columns][self._selected] for scale in residual_scales(self.weights))
        error = log_error(model[self._selected], self.data.values[:, :, self._columns][self._selected])
        slope = derivative[:, self._selected] / model[self._selected]
        residual = np.concatenate([magnitude * error.real, phase * error.imag])
        jacobian = np.concatenate([magnitude * slope.real, phase * slope.imag], axis=1).T
        return residual, jacobian

    def costs(self, theta: FloatArray) -> FloatArray:
        """Cost of each response, shape ``(y, u)``."""
        model = self.structure.response(self.parameters.unpack(theta).values, self.data.omega_rad_s)
        return pair_costs(model, self.data.values, self.weights)


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
