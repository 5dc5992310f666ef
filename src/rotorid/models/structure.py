"""Linear model structures: which parameter stands where, without data or results.

From a structure and values follow matrices; from these the frequency response and how it moves with every entry. States
that have become algebraic, because a lag is zero, leave the equations; so does what leads from no input to any output.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple, TypeVar

import numpy as np

from rotorid.data.base import Immutable
from rotorid.errors import ModelError
from rotorid.models.compiled import Entries
from rotorid.models.expression import Expression
from rotorid.models.parameter import ParameterSet, changed_constants, no_such
from rotorid.models.state_space import StateSpace
from rotorid.typing import BoolArray, ComplexArray, FloatArray, IntArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Places(Immutable):
    r"""Where the entries stand that move, those of matrices first and the delays behind them.

    An entry in row :math:`a` and column :math:`b` moves the response by :math:`l_a x_b^T`, and one in front of a
    derivative by :math:`j\omega` times as much. The left factor has a column for each state and then for each output,
    the right one a row for each state and then for each input.

    Parameters
    ----------
    rows, columns
        Column of the left and row of the right factor, shape ``(n,)``.
    signs
        Minus one for the entries of ``M``, shape ``(n,)``.
    derivative
        Whether the entry stands in front of a derivative, shape ``(n,)``.
    delayed
        Which responses each delay enters, shape ``(y, u, delays)``.
    """

    rows: IntArray
    columns: IntArray
    signs: FloatArray
    derivative: BoolArray
    delayed: FloatArray

    @classmethod
    def of(cls, moving: BoolArray, states: int, inputs: int, outputs: int) -> Places:
        """The places of the moving ones among all entries: M, F, G, H0, H1 row by row, then delays."""
        blocks = (
            ("M", states, states),
            ("F", states, states),
            ("G", states, inputs),
            ("H0", outputs, states),
            ("H1", outputs, states),
        )
        every = [(name, i, j) for name, height, width in blocks for i, j in np.ndindex(height, width)]
        moved = [place for place, moves in zip(every, moving, strict=False) if moves]
        delayed = np.zeros((outputs, inputs, inputs + outputs))
        delayed[:, range(inputs), range(inputs)] = 1.0
        delayed[range(outputs), :, range(inputs, inputs + outputs)] = 1.0
        return cls(
            rows=np.array([states + i if name in ("H0", "H1") else i for name, i, _ in moved], dtype=int),
            columns=np.array([states + j if name == "G" else j for name, _, j in moved], dtype=int),
            signs=np.array([-1.0 if name == "M" else 1.0 for name, _, _ in moved]),
            derivative=np.array([name in ("M", "H1") for name, _, _ in moved], dtype=bool),
            delayed=delayed[:, :, moving[len(every) :]],
        )

    def jacobian(
        self,
        moves: FloatArray,
        jw: ComplexArray,
        left: tuple[ComplexArray, ComplexArray],
        right: tuple[ComplexArray, ComplexArray],
        response: ComplexArray,
    ) -> ComplexArray:
        """Derivatives of the response along the directions in which the entries move.

        Parameters
        ----------
        moves
            Derivatives of the moving entries, shape ``(n + delays, k)``.
        jw
            Imaginary frequency, shape ``(f,)``.
        left, right
            Factors of shapes ``(x, y, f)`` and ``(x, u, f)`` and the delays of outputs and inputs, ``(y, f)`` and
            ``(u, f)``.
        response
            With its delays, shape ``(y, u, f)``.

        Returns
        -------
        numpy.ndarray
            Shape ``(k, y, u, f)``.
        """
        n, (y, u, f), k = self.rows.size, response.shape, moves.shape[1]
        each = _with_diagonal(*left)[self.rows][:, :, None] * _with_diagonal(*right)[self.columns][:, None]
        each[self.derivative] *= jw
        # The moves are real: a real product is half the work.
        moved = (moves[:n] * self.signs[:, None]).T @ each.reshape(n, y * u * f).view(np.float64)
        jacobian = moved.view(np.complex128).reshape(k, y, u, f)
        delays = moves[n:]
        for direction in np.flatnonzero(delays.any(axis=0)):
            longer_s = self.delayed @ delays[:, direction]
            jacobian[direction] -= longer_s[..., None] * (jw * response)
        return jacobian


def _with_diagonal(factor: ComplexArray, delays: ComplexArray) -> ComplexArray:
    """The factor, and under it the diagonal matrix of the delays: shape ``(x + n, n, f)``."""
    states, channels, points = factor.shape
    whole = np.zeros((states + channels, channels, points), dtype=np.complex128)
    whole[:states] = factor
    whole[range(states, states + channels), range(channels)] = delays
    return whole


Row = tuple[Expression, ...]
Rows = tuple[Row, ...]

_MINUS_ONE = Expression(number=-1.0)


class Matrices(NamedTuple):
    """The entries of a structure, and which of its states they still have."""

    states: tuple[str, ...]
    M: Rows
    F: Rows
    G: Rows
    H0: Rows
    H1: Rows


def condense(matrices: Matrices, zero: Set[str]) -> Matrices:
    """The same equations without the states that follow the inputs at once.

    A row :math:`0 = -x_j + G_i u`, which is one only because parameters are zero, says what :math:`x_j` is; it then
    stands for it in the others, as long as no output and no derivative needs the state itself.

    Parameters
    ----------
    matrices
        Entries of the structure.
    zero
        Parameters that are zero for good.
    """
    while (found := _algebraic(matrices, zero)) is not None:
        matrices = _without(matrices, *found)
    return matrices


def _algebraic(matrices: Matrices, zero: Set[str]) -> tuple[int, int] | None:
    """The first row that says what a state is, and that state."""
    nothing = dict.fromkeys(zero, 0.0)
    lags = [[entry.substitute(nothing) if entry.names & zero else entry for entry in row] for row in matrices.M]
    for i, row in enumerate(matrices.F):
        own = [j for j, entry in enumerate(row) if not entry.is_zero]
        became = any(entry.names & zero for entry in matrices.M[i]) and all(lag.is_zero for lag in lags[i])
        if not became or len(own) != 1 or row[own[0]] != _MINUS_ONE:
            continue
        j = own[0]
        columns = (*lags, *matrices.H0, *matrices.H1)
        if all(column[j].is_zero for column in columns):
            return i, j
    return None


def _without(matrices: Matrices, i: int, j: int) -> Matrices:
    """The equations with row ``i`` used up to replace state ``j`` by the inputs."""

    def cut(row: Row) -> Row:
        return row[:j] + row[j + 1 :]

    rows = [r for r in range(len(matrices.F)) if r != i]
    input_row = matrices.G[i]
    return Matrices(
        states=tuple(state for k, state in enumerate(matrices.states) if k != j),
        M=tuple(cut(matrices.M[r]) for r in rows),
        F=tuple(cut(matrices.F[r]) for r in rows),
        G=tuple(
            tuple(own + matrices.F[r][j] * through for own, through in zip(matrices.G[r], input_row, strict=True))
            for r in rows
        ),
        H0=tuple(cut(row) for row in matrices.H0),
        H1=tuple(cut(row) for row in matrices.H1),
    )


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
                f"{self.name} names {', '.join(unknown)}, which is not one of its parameters",
                needed=nearest.needed,
                remedy=nearest.remedy or "correct the name or declare the parameter",
            )
        reached = self.parameters.only(used).names
        if lost := [p.name for p in self.parameters if p.name not in reached and p.status != "dropped"]:
            raise ModelError(f"{self.name}: {', '.join(sorted(lost))} is in no matrix", remedy="remove it")

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
        changed = changed_constants(self.constants, constants)
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


_T = TypeVar("_T")


def connected(structure: LinearStructure) -> LinearStructure:
    """A structure without what no response of it can show.

    States that no input moves stay at rest, and states that no output follows from change nothing; both go, with the
    parameters that then stand nowhere. Inputs and outputs without a response go too, unless none has one.

    Parameters
    ----------
    structure
        Such as one of which some inputs and outputs were selected. Entries count as they stand, whatever the values.

    Examples
    --------
    Without a command in yaw nothing moves its motors:

    >>> from rotorid.models.library import library_model
    >>> roll = connected(library_model("hover.lateral").select(inputs=["roll_command"]))
    >>> "motor_yaw" in roll.states, "L_yaw" in roll.parameters.names
    (False, False)
    """
    moved, observed = _reached(structure)
    responses = answers(structure)
    if not responses.any():
        return structure
    inputs, outputs = np.asarray(responses.any(axis=0)), np.asarray(responses.any(axis=1))
    states = np.asarray(moved[:, inputs].any(axis=1) & observed[:, outputs].any(axis=1))
    if states.all() and inputs.all() and outputs.all():
        return structure
    return _part(structure, states, inputs, outputs)


def answers(structure: LinearStructure) -> BoolArray:
    """Which output answers to which input, shape ``(y, u)``; entries count as they stand, whatever the values.

    Examples
    --------
    >>> from rotorid.models.library import response_model
    >>> pairs = [("phi_setpoint", "phi"), ("theta_setpoint", "theta")]
    >>> answers(response_model("response.first_order", pairs)).tolist()
    [[True, False], [False, True]]
    """
    moved, observed = _reached(structure)
    # From each input to each output there is a response where one state is both moved and seen.
    return np.asarray(observed.T @ moved)


def _reached(structure: LinearStructure) -> tuple[BoolArray, BoolArray]:
    """States that each input moves, shape ``(x, u)``, and that each output follows, shape ``(x, y)``."""
    links = _filled(structure.M) | _filled(structure.F)
    return (
        _spread(_filled(structure.G), links),
        _spread((_filled(structure.H0) | _filled(structure.H1)).T, links.T),
    )


def _filled(rows: Rows) -> BoolArray:
    return np.array([[not entry.is_zero for entry in row] for row in rows], dtype=np.bool_)


def _spread(first: BoolArray, links: BoolArray) -> BoolArray:
    """States reached from each column of ``first`` along links from column to row, shape ``(x, n)``."""
    reached = first
    for _ in range(len(links)):
        reached = reached | (links @ reached)
    return reached


def _part(structure: LinearStructure, states: BoolArray, inputs: BoolArray, outputs: BoolArray) -> LinearStructure:
    """Some states, inputs and outputs, and the parameters that stand there."""
    change: dict[str, Any] = {
        "M": _block(structure.M, states, states),
        "F": _block(structure.F, states, states),
        "G": _block(structure.G, states, inputs),
        "H0": _block(structure.H0, outputs, states),
        "H1": _block(structure.H1, outputs, states),
        "input_delays": _kept(structure.input_delays, inputs),
        "output_delays": _kept(structure.output_delays, outputs),
    }
    rows = [row for name in ("M", "F", "G", "H0", "H1") for row in change[name]]
    entries = [entry for row in (*rows, change["input_delays"], change["output_delays"]) for entry in row]
    used = frozenset[str]().union(*(entry.names for entry in entries))
    left = structure.parameters.only(name for name in structure.parameters.names if name in used)
    return replace(
        structure,
        **change,
        states=_kept(structure.states, states),
        inputs=_kept(structure.inputs, inputs),
        outputs=_kept(structure.outputs, outputs),
        parameters=left,
        gain=structure.gain if structure.gain in left.names else None,
        optional=tuple(name for name in structure.optional if name in left.names),
    )


def _block(rows: Rows, kept_rows: BoolArray, kept_columns: BoolArray) -> Rows:
    return tuple(_kept(row, kept_columns) for row in _kept(rows, kept_rows))


def _kept(items: tuple[_T, ...], kept: BoolArray) -> tuple[_T, ...]:
    return tuple(item for item, stays in zip(items, kept, strict=True) if stays)


def silent_structure(
    name: str, *, inputs: Sequence[str], states: Sequence[str], outputs: Sequence[str]
) -> LinearStructure:
    """A structure of names that says nothing: all responses are zero.

    Examples
    --------
    >>> silent_structure("none", inputs=["u"], states=["x"], outputs=["y"]).parameters.names
    ()
    """

    def zeros(rows: int, columns: int) -> Rows:
        return ((Expression(),) * columns,) * rows

    x, u, y = len(states), len(inputs), len(outputs)
    return LinearStructure(
        name=name,
        inputs=tuple(inputs),
        states=tuple(states),
        outputs=tuple(outputs),
        M=tuple(tuple(Expression.constant(float(i == j)) for j in range(x)) for i in range(x)),
        F=zeros(x, x),
        G=zeros(x, u),
        H0=zeros(y, x),
        H1=zeros(y, x),
        input_delays=(Expression(),) * u,
        output_delays=(Expression(),) * y,
        parameters=ParameterSet(()),
    )
