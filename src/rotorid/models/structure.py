"""Model structures: which parameter stands where. A structure holds no data and no result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rotorid.data.immutable import Immutable
from rotorid.errors import ModelError
from rotorid.models.entry import Entry, affine_tensor
from rotorid.models.parameter import ParameterSet
from rotorid.models.state_space import StateSpace
from rotorid.typing import ComplexArray, FloatArray

Rows = tuple[tuple[Entry, ...], ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearStructure(Immutable):
    r"""State space with parameters in its entries.

    .. math:: M \dot x = F x + G u(t - \tau), \qquad y = H_0 x + H_1 \dot x

    Parameters
    ----------
    name
        Name of the model.
    inputs, states, outputs
        Channel names; states are free to choose.
    M, F, G, H0, H1
        Rows of entries.
    input_delays, output_delays
        One entry for each input and output, seconds.
    parameters
        All parameters with units, bounds and start values.
    gain
        Parameter that scales the whole response, where there is one; a search solves for it directly.
    optional
        Parameters without which the structure still stands; a fit may drop them where the data do not show them.
    source
        Where the structure comes from.
    """

    name: str
    inputs: tuple[str, ...]
    states: tuple[str, ...]
    outputs: tuple[str, ...]
    M: Rows
    F: Rows
    G: Rows
    H0: Rows
    H1: Rows
    input_delays: tuple[Entry, ...]
    output_delays: tuple[Entry, ...]
    parameters: ParameterSet
    gain: str | None = None
    optional: tuple[str, ...] = ()
    source: str = ""

    def __post_init__(self) -> None:
        x, u, y = len(self.states), len(self.inputs), len(self.outputs)
        shapes = {"M": (x, x), "F": (x, x), "G": (x, u), "H0": (y, x), "H1": (y, x)}
        for name, shape in shapes.items():
            rows = getattr(self, name)
            if len(rows) != shape[0] or any(len(row) != shape[1] for row in rows):
                came = f"{len(rows)} x {'/'.join(sorted({str(len(row)) for row in rows}))}"
                raise ModelError(
                    f"{self.name}: matrix {name} is {came}", needed=f"{shape[0]} rows of {shape[1]} entries"
                )
        if len(self.input_delays) != u or len(self.output_delays) != y:
            raise ModelError(f"{self.name}: delays do not match", needed=f"{u} input and {y} output delays")
        used = {name for tensor_rows in self._rows() for row in tensor_rows for e in row for name, _ in e.terms}
        known = set(self.parameters.names)
        if unused := known - used:
            raise ModelError(f"{self.name}: {', '.join(sorted(unused))} stands in no matrix", remedy="remove it")
        named = used | set(self.optional) | ({self.gain} if self.gain is not None else set())
        if unknown := named - known:
            raise ModelError(
                f"{self.name} names {', '.join(sorted(unknown))}, which is no parameter of it",
                needed=f"one of {', '.join(self.parameters.names) or 'no parameters at all'}",
                remedy="correct the name or declare the parameter",
            )

    def _rows(self) -> tuple[Rows, ...]:
        return (self.M, self.F, self.G, self.H0, self.H1, (self.input_delays,), (self.output_delays,))

    @cached_property
    def _tensors(self) -> tuple[FloatArray, ...]:
        x, u, y = len(self.states), len(self.inputs), len(self.outputs)
        shapes = ((x, x), (x, x), (x, u), (y, x), (y, x), (1, u), (1, y))
        names = self.parameters.names
        return tuple(affine_tensor(rows, names, shape) for rows, shape in zip(self._rows(), shapes, strict=True))

    def matrices(self, values: Mapping[str, float]) -> StateSpace:
        """The system at given parameter values."""
        theta = np.array([1.0, *(values[name] for name in self.parameters.names)])
        M, F, G, H0, H1, tau_u, tau_y = (np.tensordot(theta, tensor, axes=1) for tensor in self._tensors)
        return StateSpace(M=M, F=F, G=G, H0=H0, H1=H1, input_delays_s=tau_u[0], output_delays_s=tau_y[0])

    def response(self, values: Mapping[str, float], omega_rad_s: FloatArray) -> ComplexArray:
        """Frequency response at given parameter values, shape ``(y, u, f)``."""
        return self.matrices(values).response(omega_rad_s)

    def response_and_jacobian(
        self, values: Mapping[str, float], omega_rad_s: FloatArray, directions: FloatArray
    ) -> tuple[ComplexArray, ComplexArray]:
        r"""Response and its exact derivatives along directions of the parameters.

        With :math:`A = j\omega M - F`, :math:`X = A^{-1} G` and :math:`L = (H_0 + j\omega H_1) A^{-1}`,

        .. math:: \frac{\partial T}{\partial\theta} = \left[ \dot H X - L (j\omega \dot M - \dot F) X + L \dot G
           \right] e^{-j\omega\tau} - j\omega \dot\tau \, T

        where a dot stands for the derivative of a matrix along a direction.

        Parameters
        ----------
        values
            Every parameter.
        omega_rad_s
            Shape ``(f,)``.
        directions
            Change of every parameter along each direction, shape ``(parameters, k)``; see
            :attr:`rotorid.models.parameter.ParameterSet.directions`.

        Returns
        -------
        numpy.ndarray
            Response, shape ``(y, u, f)``.
        numpy.ndarray
            Derivatives, shape ``(k, y, u, f)``.
        """
        theta = np.array([1.0, *(values[name] for name in self.parameters.names)])
        M, F, G, H0, H1, tau_u, tau_y = (np.tensordot(theta, tensor, axes=1) for tensor in self._tensors)
        jw = 1j * np.asarray(omega_rad_s)[:, None, None]
        inverse = np.linalg.inv(jw * M - F)
        H = H0 + jw * H1
        X, L = inverse @ G, H @ inverse
        shift = np.exp(-jw * (tau_y[0][:, None] + tau_u[0]))
        response = (H @ X) * shift
        dM, dF, dG, dH0, dH1, du, dy = (
            np.tensordot(directions.T, tensor[1:], axes=1)[:, None] for tensor in self._tensors
        )
        rational = (dH0 + jw * dH1) @ X - L @ ((jw * dM - dF) @ X) + L @ dG
        delays = np.swapaxes(dy, -1, -2) + du
        jacobian = rational * shift - jw * delays * response
        return np.moveaxis(response, 0, -1), np.moveaxis(jacobian, 1, -1)
