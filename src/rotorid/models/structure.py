"""Model structures: which parameter stands where. A structure holds no data and no result."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from rotorid.data.immutable import Immutable
from rotorid.errors import ModelError
from rotorid.models.condense import Matrices, Row, Rows, condense
from rotorid.models.entries import Entries
from rotorid.models.expression import Expression
from rotorid.models.parameter import ParameterSet
from rotorid.models.sensitivity import Places
from rotorid.models.state_space import StateSpace
from rotorid.models.ties import no_such
from rotorid.typing import ComplexArray, FloatArray

_DELAYS = ("input_delays", "output_delays")


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
        Rows of entries: expressions of parameters and constants.
    input_delays, output_delays
        One entry for each input and output, seconds.
    parameters
        All parameters with units, bounds and start values.
    constants
        Numbers that are no parameters, such as gravity or the trim of a flight.
    gain
        Parameter that scales the whole response, where there is one; a search solves for it directly.
    optional
        Parameters without which the structure still stands; a fit may drop them where the data do not show them.
    source
        Where the structure comes from.

    Raises
    ------
    ModelError
        A matrix has another shape, an entry names neither parameter nor constant, or a parameter that is not dropped
        stands nowhere: neither in an entry nor in the tie of one that does.
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
    input_delays: Row
    output_delays: Row
    parameters: ParameterSet
    constants: Mapping[str, float] = field(default_factory=dict)
    gain: str | None = None
    optional: tuple[str, ...] = ()
    source: str = ""

    def __post_init__(self) -> None:
        for name, shape in self._shapes.items():
            rows = getattr(self, name)
            if len(rows) != shape[0] or any(len(row) != shape[1] for row in rows):
                came = f"{len(rows)} x {'/'.join(sorted({str(len(row)) for row in rows}))}"
                raise ModelError(
                    f"{self.name}: matrix {name} is {came}", needed=f"{shape[0]} rows of {shape[1]} entries"
                )
        u, y = len(self.inputs), len(self.outputs)
        if len(self.input_delays) != u or len(self.output_delays) != y:
            raise ModelError(f"{self.name}: delays do not match", needed=f"{u} input and {y} output delays")
        if both := set(self.parameters.names) & set(self.constants):
            raise ModelError(f"{self.name}: {', '.join(sorted(both))} is a parameter and a constant")
        if odd := [name for name, value in self.constants.items() if not math.isfinite(value)]:
            raise ModelError(f"{self.name}: the constant {odd[0]} is {self.constants[odd[0]]}", needed="finite numbers")
        constants = dict(self.constants)
        parameters = self.parameters
        if constants != parameters.constants:
            parameters = parameters.with_constants(constants)
        self._set(constants=constants, parameters=parameters)
        used = frozenset().union(*(entry.names for entry in self._entries)) - set(self.constants)
        self._check_names(used)

    def _check_names(self, used: frozenset[str]) -> None:
        known = set(self.parameters.names)
        named = used | set(self.optional) | ({self.gain} if self.gain is not None else set())
        if unknown := sorted(named - known):
            nearest = no_such("parameter", unknown[0], (*self.parameters.names, *self.constants))
            raise ModelError(
                f"{self.name} names {', '.join(unknown)}, which is no parameter of it",
                needed=nearest.needed,
                remedy=nearest.remedy or "correct the name or declare the parameter",
            )
        reached = self.parameters.only(used).names
        if lost := [p.name for p in self.parameters if p.name not in reached and p.status != "dropped"]:
            raise ModelError(f"{self.name}: {', '.join(sorted(lost))} stands in no matrix", remedy="remove it")

    @property
    def _shapes(self) -> dict[str, tuple[int, int]]:
        x, u, y = len(self.states), len(self.inputs), len(self.outputs)
        return {"M": (x, x), "F": (x, x), "G": (x, u), "H0": (y, x), "H1": (y, x)}

    @property
    def _entries(self) -> list[Expression]:
        """Every entry: the matrices row by row, then the delays of inputs and outputs."""
        rows = [row for name in self._shapes for row in getattr(self, name)]
        return [entry for row in (*rows, self.input_delays, self.output_delays) for entry in row]

    @cached_property
    def _compiled(self) -> Entries:
        return Entries(self._entries, self.parameters.names, self.constants)

    @cached_property
    def _places(self) -> Places:
        return Places.of(self._compiled.moving, len(self.states), len(self.inputs), len(self.outputs))

    @cached_property
    def _blocks(self) -> tuple[tuple[slice, tuple[int, ...]], ...]:
        """Where each matrix and delay vector stands among the entries, and its shape."""
        shapes = [*self._shapes.values(), (len(self.inputs),), (len(self.outputs),)]
        ends = np.cumsum([math.prod(shape) for shape in shapes]).tolist()
        return tuple((slice(end - math.prod(shape), end), shape) for end, shape in zip(ends, shapes, strict=True))

    def with_constants(self, constants: Mapping[str, float]) -> LinearStructure:
        """The same structure with other values of some constants.

        Raises
        ------
        ModelError
            There is no such constant, or a value is not finite.
        """
        for name in constants:
            if name not in self.constants:
                raise no_such("constant", name, self.constants)
        changed = {**self.constants, **constants}
        return replace(self, constants=changed, parameters=self.parameters.with_constants(changed))

    def select(self, outputs: Sequence[str] | None = None, inputs: Sequence[str] | None = None) -> LinearStructure:
        """The structure of some outputs and inputs only, in the order given.

        Parameters that then stand nowhere are left out; states stay.

        Parameters
        ----------
        outputs, inputs
            Names; all of them by default.

        Raises
        ------
        ModelError
            There is no such output or input, or it was named twice.
        """
        y = _slots("output", self.outputs if outputs is None else outputs, self.outputs)
        u = _slots("input", self.inputs if inputs is None else inputs, self.inputs)
        change = {
            "inputs": tuple(self.inputs[j] for j in u),
            "outputs": tuple(self.outputs[i] for i in y),
            "G": tuple(tuple(row[j] for j in u) for row in self.G),
            "H0": tuple(self.H0[i] for i in y),
            "H1": tuple(self.H1[i] for i in y),
            "input_delays": tuple(self.input_delays[j] for j in u),
            "output_delays": tuple(self.output_delays[i] for i in y),
        }
        return self._changed(self.parameters, **change)

    def condensed(self, parameters: ParameterSet) -> LinearStructure:
        r"""The structure without the states that follow an input at once, because their lag is zero for good.

        A motor lag that was dropped leaves :math:`0 = -x + G u`; the state is then written as what it is, and the
        structure has the states that are left. Dropped parameters stay in the set, as part of the record.

        Parameters
        ----------
        parameters
            The parameters with their values; those dropped, or fixed at zero, are zero for good.
        """
        zero = {p.name for p in parameters if p.status == "dropped" or (p.status == "fixed" and p.value == 0.0)}
        left = condense(Matrices(self.states, self.M, self.F, self.G, self.H0, self.H1), zero)
        if left.states == self.states:
            return replace(self, parameters=parameters)
        dropped = [parameter.name for parameter in parameters if parameter.status == "dropped"]
        return self._changed(parameters, *dropped, **left._asdict())

    def _changed(self, parameters: ParameterSet, *kept: str, **change: Any) -> LinearStructure:
        """The structure with other rows, and of the parameters those that stand in them or are kept."""
        fields = {name: change.get(name, getattr(self, name)) for name in (*self._shapes, *_DELAYS)}
        rows = [row for name in self._shapes for row in fields[name]] + [fields[name] for name in _DELAYS]
        used = frozenset().union(*(entry.names for row in rows for entry in row)).union(kept)
        left = parameters.only(name for name in parameters.names if name in used)
        return replace(
            self,
            **change,
            parameters=left,
            gain=self.gain if self.gain in left.names else None,
            optional=tuple(name for name in self.optional if name in left.names),
        )

    def matrices(self, values: Mapping[str, float]) -> StateSpace:
        """The system at given parameter values.

        Raises
        ------
        ModelError
            An entry has no finite value there.
        """
        return self._system(self._compiled.at(values))

    def _system(self, numbers: FloatArray) -> StateSpace:
        M, F, G, H0, H1, tau_u, tau_y = (numbers[where].reshape(shape) for where, shape in self._blocks)
        return StateSpace(M=M, F=F, G=G, H0=H0, H1=H1, input_delays_s=tau_u, output_delays_s=tau_y)

    def response(self, values: Mapping[str, float], omega_rad_s: FloatArray) -> ComplexArray:
        """Frequency response at given parameter values, shape ``(y, u, f)``."""
        return self.matrices(values).response(omega_rad_s)

    def matrices_and_jacobian(
        self, values: Mapping[str, float], directions: FloatArray
    ) -> tuple[StateSpace, tuple[FloatArray, ...]]:
        """The system and its exact derivatives along directions of the parameters.

        Parameters
        ----------
        values, directions
            As for :meth:`response_and_jacobian`.

        Returns
        -------
        StateSpace
            The system.
        tuple
            Derivatives of M, F, G, H0, H1 and of the delays of inputs and outputs, each with a leading axis ``k``.

        Raises
        ------
        ModelError
            An entry or its derivative has no finite value there.
        """
        numbers, slopes = self._compiled.with_slopes(values)
        moves = np.zeros((directions.shape[1], numbers.size))
        moves[:, self._compiled.moving] = (slopes @ directions).T
        return self._system(numbers), tuple(moves[:, where].reshape(-1, *shape) for where, shape in self._blocks)

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

        Raises
        ------
        ModelError
            An entry or its derivative has no finite value there.
        """
        numbers, slopes = self._compiled.with_slopes(values)
        M, F, G, H0, H1, tau_u, tau_y = (numbers[where].reshape(shape) for where, shape in self._blocks)
        jw = np.asarray(1j * np.asarray(omega_rad_s), dtype=np.complex128)
        inverse = np.linalg.inv(jw[:, None, None] * M - F)
        H = H0 + jw[:, None, None] * H1
        X = inverse @ G
        late_u, late_y = np.exp(-jw * tau_u[:, None]), np.exp(-jw * tau_y[:, None])
        response = (H @ X).transpose(1, 2, 0) * late_u * late_y[:, None]
        left = (H @ inverse).transpose(2, 1, 0) * late_y
        right = X.transpose(1, 2, 0) * late_u
        moves = slopes @ directions
        return response, self._places.jacobian(moves, jw, (left, late_y), (right, late_u), response)


def _slots(kind: str, chosen: Sequence[str], known: Sequence[str]) -> list[int]:
    for name in chosen:
        if name not in known:
            raise no_such(kind, name, known)
    if not chosen or len(set(chosen)) < len(chosen):
        raise ModelError(f"the {kind}s {', '.join(chosen) or '(none)'} were selected", needed="at least one, each once")
    return [known.index(name) for name in chosen]
