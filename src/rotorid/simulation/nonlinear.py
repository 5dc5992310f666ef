"""Time response of a nonlinear model whose sampled inputs are delayed by any fraction of a sample.

The corners of delayed inputs cut a sample interval into pieces, and no step of an integrator crosses one: so the order
of a Runge–Kutta method holds across them, and derivatives with respect to delays are exact. SciPy's adaptive
integrators on the same pieces are slow, and as exact as is asked for.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.models.nonlinear import NonlinearStructure, Program
from rotorid.models.parameter import no_such
from rotorid.simulation.linear import WHOLE_SAMPLE, Hold, checked_past, checked_vector
from rotorid.typing import FloatArray, IntArray


@dataclass(frozen=True, kw_only=True, eq=False)
class RungeKutta(Immutable):
    r"""An explicit Runge–Kutta method.

    .. math:: k_i = f\Bigl(t + c_i h, \; x + h \sum_{j<i} a_{ij} k_j\Bigr), \qquad x \to x + h \sum_i b_i k_i

    Parameters
    ----------
    order
        The error after a given time falls with this power of the step, where inputs and equations are smooth.
    a, b, c
        The tableau, shapes ``(s, s)``, ``(s,)`` and ``(s,)``.
    """

    order: int
    a: FloatArray
    b: FloatArray
    c: FloatArray

    def __post_init__(self) -> None:
        self._set(
            a=read_only(self.a, np.float64, ndim=2),
            b=read_only(self.b, np.float64, ndim=1),
            c=read_only(self.c, np.float64, ndim=1),
        )


def _method(order: int, rows: list[list[float]], weights: list[float]) -> RungeKutta:
    a = np.zeros((len(weights), len(weights)))
    for i, row in enumerate(rows, start=1):
        a[i, : len(row)] = row
    return RungeKutta(order=order, a=a, b=np.array(weights), c=a.sum(axis=1))


METHODS: Mapping[str, RungeKutta] = MappingProxyType(
    {
        "euler": _method(1, [], [1.0]),
        "heun": _method(2, [[1.0]], [0.5, 0.5]),
        # Bogacki and Shampine, the third order of MATLAB's ode23.
        "rk23": _method(3, [[1 / 2], [0.0, 3 / 4]], [2 / 9, 1 / 3, 4 / 9]),
        "rk4": _method(4, [[1 / 2], [0.0, 1 / 2], [0.0, 0.0, 1.0]], [1 / 6, 1 / 3, 1 / 3, 1 / 6]),
        # Dormand and Prince, the fifth order of MATLAB's ode45.
        "rk45": _method(
            5,
            [
                [1 / 5],
                [3 / 40, 9 / 40],
                [44 / 45, -56 / 15, 32 / 9],
                [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729],
                [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656],
            ],
            [35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
        ),
    }
)
"""Integrators by name, in the order of their accuracy."""


def runge_kutta(name: str) -> RungeKutta:
    """An integrator by its name.

    Parameters
    ----------
    name
        As settings call it.

    Raises
    ------
    UsageError
        There is none of that name.

    Examples
    --------
    >>> runge_kutta("rk4").order
    4
    """
    if name not in METHODS:
        error = no_such("fixed-step method", name, METHODS)
        raise UsageError(error.came, needed=error.needed, remedy=error.remedy)
    return METHODS[name]


@dataclass(frozen=True, kw_only=True, eq=False)
class Scheme:
    """How a model is integrated.

    Parameters
    ----------
    method
        ``euler``, ``heun``, ``rk23``, ``rk4`` or ``rk45``: explicit Runge–Kutta methods of the orders one to five.
    substeps
        Steps in a sample interval. A corner of an input inside the interval adds one.
    hold
        What the inputs do between their samples: constant until the next one (``zero``), or straight to it (``first``).

    Raises
    ------
    UsageError
        There is no such method, or less than one step.
    """

    method: str = "rk4"
    substeps: int = 1
    hold: Hold = "zero"

    def __post_init__(self) -> None:
        runge_kutta(self.method)
        if self.substeps < 1:
            raise UsageError(f"substeps is {self.substeps}", needed="one or more")
        if self.hold not in ("zero", "first"):
            raise UsageError(f"unknown hold {self.hold!r}", needed="zero or first")

    @property
    def tableau(self) -> RungeKutta:
        """Weights of the method."""
        return runge_kutta(self.method)


@dataclass(frozen=True, kw_only=True, eq=False)
class NonlinearSensitivities:
    """Outputs of a model for the inputs of one record, with derivatives.

    Parameters
    ----------
    outputs
        Shape ``(n, y)``.
    slopes
        Derivatives along the directions, shape ``(n, y, k)``.
    """

    outputs: FloatArray
    slopes: FloatArray


def simulate_nonlinear(
    structure: NonlinearStructure,
    values: Mapping[str, float],
    u: FloatArray,
    *,
    sample_rate_hz: float,
    x0: FloatArray | None = None,
    before: FloatArray | None = None,
    scheme: Scheme | None = None,
) -> FloatArray:
    r"""Outputs of a nonlinear model at the sample instants.

    .. math:: \dot x = f(x, u(t - \tau), \theta), \qquad y = g(x, u(t - \tau), \theta)

    Steps end at every corner of the delayed inputs, so the order of the method holds across their jumps, and no delay
    is rounded to a sample. Between the corners the error falls with the order of the method. A time constant of the
    model well below a step makes every explicit method unstable: take more substeps, or :func:`simulate_adaptive`.
    Where a state leaves the region in which the equations have values, the outputs are not numbers from there on; no
    error is raised, so that a fit can step back.
    A negative delay, which a fit to filtered outputs may find, is an input that arrives early.

    Parameters
    ----------
    structure
        The model.
    values
        Every parameter.
    u
        Inputs, shape ``(u, samples)``.
    sample_rate_hz
        Rate of inputs and outputs.
    x0
        States at the first sample, shape ``(x,)``. Zero by default.
    before
        Inputs before the first sample, shape ``(u,)`` or ``(u, k)`` with the latest last, which a delayed input still
        shows. Zero by default.
    scheme
        How to integrate; a step of classical Runge–Kutta for every sample of held inputs by default.

    Returns
    -------
    FloatArray
        Shape ``(y, samples)``. Where an output jumps with its input at a sample, it is the value just after the jump.

    Raises
    ------
    UsageError
        A shape does not match the model, or an input is not finite.
    ModelError
        A delay has no finite value.

    Examples
    --------
    Speed under quadratic drag, from rest, against its exact solution:

    >>> from rotorid.models.nonlinear import nonlinear_structure
    >>> from rotorid.models.parameter import Parameter, ParameterSet
    >>> drag = nonlinear_structure(
    ...     name="drag", inputs=["push"], states=["v"], equations=["v' = push - k*abs(v)*v"], outputs=["v"],
    ...     parameters=ParameterSet([Parameter(name="k", value=0.25, unit="1/m")]))
    >>> v = simulate_nonlinear(drag, {"k": 0.25}, np.ones((1, 101)), sample_rate_hz=50.0)
    >>> bool(np.allclose(v[0], 2.0 * np.tanh(0.5 * np.arange(101) / 50.0), atol=1e-9))
    True
    """
    chosen = scheme or Scheme()
    order, count = len(structure.states), len(structure.parameters)
    start = checked_vector(x0, order, "x0")
    response = _respond(
        structure,
        structure.plain,
        values,
        checked_inputs(structure, u),
        checked_past(before, len(structure.inputs)),
        start,
        (np.zeros((order, 0)), np.zeros((count, 0))),
        sample_rate_hz,
        chosen,
    )
    return np.ascontiguousarray(response.outputs.T)


def nonlinear_sensitivities(
    structure: NonlinearStructure,
    values: Mapping[str, float],
    u: FloatArray,
    *,
    sample_rate_hz: float,
    x0: FloatArray,
    before: FloatArray,
    directions: FloatArray,
    start_directions: FloatArray,
    scheme: Scheme,
) -> NonlinearSensitivities:
    """Outputs as :func:`simulate_nonlinear` gives them, and their exact derivatives along directions.

    The derivatives are those of the integrated equations, not of the true solution: what is differentiated is the
    method itself, steps that move with a delay included. They agree with differences of the simulation to rounding.
    At a whole sample a delay has the derivative of a longer one.

    Parameters
    ----------
    structure, values, u, sample_rate_hz, x0, before, scheme
        As for :func:`simulate_nonlinear`.
    directions
        Change of every parameter along each direction, shape ``(parameters, k)``; see
        :attr:`rotorid.models.parameter.ParameterSet.directions`.
    start_directions
        Change of the initial states along each direction, shape ``(x, k)``.

    Raises
    ------
    UsageError
        A shape does not match the model.
    """
    order, count, width = len(structure.states), len(structure.parameters), directions.shape[1]
    if directions.shape != (count, width) or start_directions.shape != (order, width):
        raise UsageError(
            f"the directions have shapes {directions.shape} and {start_directions.shape}",
            needed=f"({count}, k) and ({order}, k)",
        )
    return _respond(
        structure,
        (structure.dynamics, structure.measurement),
        values,
        checked_inputs(structure, u),
        checked_past(before, len(structure.inputs)),
        checked_vector(x0, order, "x0"),
        (start_directions, directions),
        sample_rate_hz,
        scheme,
    )


def _respond(
    structure: NonlinearStructure,
    programs: tuple[Program, Program],
    values: Mapping[str, float],
    u: FloatArray,
    before: FloatArray,
    x0: FloatArray,
    directions: tuple[FloatArray, FloatArray],
    sample_rate_hz: float,
    scheme: Scheme,
) -> NonlinearSensitivities:
    pieces = delayed_pieces(structure, values, directions[1], sample_rate_hz)
    plan = planned(
        pieces, scheme.tableau.c, substeps=scheme.substeps, interval_s=1.0 / sample_rate_hz, hold=scheme.hold
    )
    numbers = np.array([float(values[name]) for name in structure.parameters.names])
    start, still = np.column_stack([x0, directions[0]]), np.column_stack([numbers, directions[1]])
    states = np.empty((u.shape[1], *start.shape))
    states[0] = start
    _integrate(programs[0], plan, scheme, pieces.between(u, before), still, states)
    moving = np.concatenate([states, pieces.at_samples(u, before, hold=scheme.hold)], axis=1)
    outputs = _observed(programs[1], moving, still)
    return NonlinearSensitivities(outputs=outputs[..., 0], slopes=outputs[..., 1:])


def _integrate(
    program: Program,
    plan: Plan,
    scheme: Scheme,
    inputs: tuple[FloatArray, FloatArray],
    still: FloatArray,
    states: FloatArray,
) -> None:
    """Fill the states, whose first row is the start; derivatives follow each value."""
    from rotorid.simulation.nonlinear_kernels import integrate

    (levels, ramps), method = inputs, scheme.tableau
    names = np.vstack([states[0], np.zeros((levels.shape[2], states.shape[2])), still])
    integrate(
        *_ready(program, names[:, 0]),
        names,
        np.vstack([method.a, method.b]),
        plan.lengths,
        plan.pieces,
        levels,
        ramps,
        plan.ages,
        states,
    )


def _observed(program: Program, moving: FloatArray, still: FloatArray) -> FloatArray:
    """The outputs, shape ``(n, y, 1 + k)``."""
    from rotorid.simulation.nonlinear_kernels import observe

    outputs = np.zeros((len(moving), program.size, still.shape[1]))
    observe(*_ready(program, np.concatenate([moving[0, :, 0], still[:, 0]])), moving, still, outputs)
    return outputs


def observed_plainly(structure: NonlinearStructure, moving: FloatArray, numbers: FloatArray) -> FloatArray:
    """The outputs ``(y, n)`` at states and delayed inputs ``(n, x + u, 1)`` and values of the parameters ``(p,)``."""
    return np.ascontiguousarray(_observed(structure.plain[1], moving, numbers[:, None])[..., 0].T)


def _ready(program: Program, values: FloatArray) -> tuple[IntArray, IntArray, IntArray, int, FloatArray]:
    """A program as the kernels take it, what depends on the parameters alone already computed."""
    from rotorid.simulation.nonlinear_kernels import run

    tape, slots = program.tape, program.tape.slots(values)
    # A copy is writable: for arrays that are not, Numba would compile once more.
    operations, results = tape.operations.copy(), tape.results[: program.size].copy()
    run(operations, 0, tape.settled, slots)
    return operations, results, program.slopes, tape.settled, slots


AdaptiveMethod: TypeAlias = Literal["rk23", "rk45", "dop853", "radau", "bdf", "lsoda"]

_SCIPY: Mapping[str, str] = {
    "rk23": "RK23",
    "rk45": "RK45",
    "dop853": "DOP853",
    "radau": "Radau",
    "bdf": "BDF",
    "lsoda": "LSODA",
}


def simulate_adaptive(
    structure: NonlinearStructure,
    values: Mapping[str, float],
    u: FloatArray,
    *,
    sample_rate_hz: float,
    x0: FloatArray | None = None,
    before: FloatArray | None = None,
    hold: Hold = "zero",
    method: AdaptiveMethod = "dop853",
    relative: float = 1e-10,
    absolute: float = 1e-12,
) -> FloatArray:
    """Outputs of a nonlinear model, integrated anew from corner to corner of its inputs.

    Meant as the truth for :func:`simulate_nonlinear`, and for stiff models (``radau``,
    ``bdf``, ``lsoda``). It starts again at every corner, some milliseconds each.

    Parameters
    ----------
    structure, values, u, sample_rate_hz, x0, before
        As for :func:`simulate_nonlinear`.
    hold
        What the inputs do between their samples.
    method
        ``rk23``, ``rk45`` and ``dop853``: explicit Runge–Kutta. ``radau``, ``bdf``: implicit. ``lsoda``: Adams or
        backward differences, whichever suits.
    relative, absolute
        Tolerances of the error of each step.

    Returns
    -------
    FloatArray
        Shape ``(y, samples)``.

    Raises
    ------
    UsageError
        A shape does not match the model, or there is no such method.
    InsufficientDataError
        The integrator gives up: the model leaves the region in which it has values.
    """
    import scipy.integrate

    from rotorid.simulation.nonlinear_kernels import run

    if method not in get_args(AdaptiveMethod):
        error = no_such("adaptive method", method, _SCIPY)
        raise UsageError(error.came, needed=error.needed, remedy=error.remedy)
    inputs = checked_inputs(structure, u)
    past = checked_past(before, len(inputs))
    count = len(structure.parameters)
    pieces = delayed_pieces(structure, values, np.zeros((count, 0)), sample_rate_hz)
    levels, ramps = pieces.between(inputs, past)
    numbers = np.array([float(values[name]) for name in structure.parameters.names])
    program, order = structure.plain[0], len(structure.states)
    slots = program.tape.slots(np.concatenate([np.zeros(order + len(inputs)), numbers]))
    operations = program.tape.operations.copy()
    results = program.tape.results[: program.size]

    def rates(time: float, x: FloatArray, sample: int, piece: int) -> FloatArray:
        slots[:order] = x
        slots[order : order + len(inputs)] = levels[sample, piece]
        if hold == "first":
            ages = time - pieces.fractions + pieces.pending[piece]
            slots[order : order + len(inputs)] += ramps[sample, piece] * ages
        run(operations, 0, len(operations), slots)
        rate: FloatArray = slots[results] / sample_rate_hz
        return rate

    solve: Any = scipy.integrate.solve_ivp
    states = np.empty((inputs.shape[1], order))
    states[0] = x = checked_vector(x0, order, "x0")
    for sample in range(len(states) - 1):
        for piece, (start, length) in enumerate(zip(pieces.starts, pieces.lengths, strict=True)):
            end = solve(
                rates,
                (start, start + length),
                x,
                method=_SCIPY[method],
                rtol=relative,
                atol=absolute,
                args=(sample, piece),
            )
            if not end.success:
                raise InsufficientDataError(f"the integrator stopped at sample {sample}: {end.message}")
            x = np.asarray(end.y[:, -1], dtype=np.float64)
        states[sample + 1] = x
    delayed = pieces.at_samples(inputs, past, hold=hold)
    return observed_plainly(structure, np.concatenate([states[..., None], delayed], axis=1), numbers)


def delayed_pieces(
    structure: NonlinearStructure, values: Mapping[str, float], directions: FloatArray, sample_rate_hz: float
) -> Pieces:
    """The pieces of a sample interval between the corners of the delayed inputs of a model."""
    delays_s, slopes = structure.delays_and_jacobian(values)
    return cut(sample_rate_hz * delays_s, sample_rate_hz * (slopes @ directions))


def checked_inputs(structure: NonlinearStructure, u: FloatArray) -> FloatArray:
    """Inputs of the right shape.

    Raises
    ------
    UsageError
        They have another one, or are not finite.
    """
    inputs = len(structure.inputs)
    if np.ndim(u) != 2 or u.shape[0] != inputs or u.shape[1] == 0:
        raise UsageError(f"the inputs have shape {np.shape(u)}", needed=f"({inputs}, samples)")
    values = np.array(u, dtype=np.float64, order="C")
    if not np.isfinite(values).all():
        raise UsageError("an input is not finite", needed="finite numbers", remedy="cut the record at its gaps")
    return values


@dataclass(frozen=True, kw_only=True, eq=False)
class Pieces:
    """The parts of a sample interval on which all delayed inputs are smooth; the same in every interval.

    Times count in samples. Derivatives have the directions of the delays as last axis.

    Parameters
    ----------
    starts, dstarts
        Where each piece begins, shape ``(m,)``, and its derivatives, shape ``(m, k)``.
    lengths, dlengths
        Likewise how long it is.
    lags
        How many samples old each input is, shape ``(m, u)``.
    pending
        One where the corner of an input is still to come, zero where it has passed, shape ``(m, u)``.
    fractions, dfractions
        Where the corner of each input is, shapes ``(u,)`` and ``(u, k)``.
    whole
        Whole samples of delay, shape ``(u,)``.
    """

    starts: FloatArray
    dstarts: FloatArray
    lengths: FloatArray
    dlengths: FloatArray
    lags: IntArray
    pending: FloatArray
    fractions: FloatArray
    dfractions: FloatArray
    whole: IntArray

    def between(self, u: FloatArray, before: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The inputs in each piece of each interval and their slopes per sample, each shape ``(n - 1, m, u)``."""
        samples = np.arange(u.shape[1] - 1)[:, None, None]
        levels = _taken(u, before, samples - self.lags)
        return levels, _taken(u, before, samples - self.lags + 1) - levels

    def at_samples(self, u: FloatArray, before: FloatArray, *, hold: Hold) -> FloatArray:
        """The delayed inputs at the samples, just after their jumps, derivatives after the value: ``(n, u, 1 + k)``."""
        waiting = (self.fractions > 0.0).astype(np.int64)
        places = np.arange(u.shape[1])[:, None] - self.whole - waiting
        delayed = _taken(u, before, places)
        slopes = (_taken(u, before, places + 1) - delayed) * float(hold == "first")
        value = delayed + (waiting - self.fractions) * slopes
        return np.concatenate([value[..., None], -slopes[..., None] * self.dfractions], axis=-1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """The ``s`` steps of a method through a sample interval, of ``g`` stages each; the same in every interval.

    Parameters
    ----------
    pieces
        In which piece each step lies, shape ``(s,)``.
    lengths
        Of the steps in seconds, derivatives after the value, shape ``(s, 1 + k)``.
    ages
        Shares of a sample since the last sample of each input, shape ``(s, g, u, 1 + k)``; of no inputs where inputs do
        not ramp.
    """

    pieces: IntArray
    lengths: FloatArray
    ages: FloatArray


def planned(pieces: Pieces, times: FloatArray, *, substeps: int, interval_s: float, hold: Hold) -> Plan:
    """Lay steps into the pieces of a sample interval.

    Parameters
    ----------
    times
        When the stages of a step are, as shares of the step, shape ``(g,)``.
    substeps
        Steps of a whole interval; a piece takes its share of them, and at least one.
    hold
        What the inputs do between their samples.
    """
    counts = np.maximum(np.ceil(substeps * pieces.lengths - WHOLE_SAMPLE), 1.0).astype(np.int64)
    places = np.repeat(np.arange(counts.size), counts)
    numbers = np.concatenate([np.arange(count) for count in counts])
    starts, lengths, fractions = (
        np.column_stack(pair)
        for pair in (
            (pieces.starts, pieces.dstarts),
            (pieces.lengths, pieces.dlengths),
            (pieces.fractions, pieces.dfractions),
        )
    )
    lengths = lengths[places] / counts[places, None]
    passed = starts[places, None] + (numbers[:, None] + times)[..., None] * lengths[:, None]
    ages = passed[:, :, None] - fractions[slice(None) if hold == "first" else slice(0)]
    ages[..., 0] += pieces.pending[places, None, : ages.shape[2]]
    return Plan(pieces=places, lengths=lengths * interval_s, ages=ages)


def cut(delays: FloatArray, ddelays: FloatArray) -> Pieces:
    """Cut a sample interval at the corners of the delayed inputs.

    A delay of a whole number of samples has its corner at the start of the interval; a piece of no length stands there
    all the same when the delay can move, because its length moves.

    Parameters
    ----------
    delays
        In samples, shape ``(u,)``. A negative one is an input that arrives early.
    ddelays
        Their derivatives, shape ``(u, k)``.
    """
    lags = np.floor(delays + WHOLE_SAMPLE).astype(np.int64)
    fractions = np.maximum(delays - lags, 0.0)
    fractions[fractions < WHOLE_SAMPLE] = 0.0
    order = np.argsort(fractions, kind="stable")
    none = np.zeros((1, ddelays.shape[1]))
    corners = np.concatenate([[0.0], fractions[order], [1.0]])
    dcorners = np.concatenate([none, ddelays[order], none])
    lengths, dlengths = np.diff(corners), np.diff(dcorners, axis=0)
    rank = np.argsort(order)
    pending = (rank[None] >= np.arange(lengths.size)[:, None]).astype(np.int64)
    kept = (lengths > 0.0) | dlengths.any(axis=1)
    return Pieces(
        starts=corners[:-1][kept],
        dstarts=dcorners[:-1][kept],
        lengths=lengths[kept],
        dlengths=dlengths[kept],
        lags=(lags + pending)[kept],
        pending=pending[kept].astype(np.float64),
        fractions=fractions,
        dfractions=ddelays,
        whole=lags,
    )


def _taken(u: FloatArray, before: FloatArray, places: IntArray) -> FloatArray:
    """Samples ``places`` ``(..., u)`` of the inputs; before the first one ``before``, beyond the last one the last."""
    known = np.column_stack([before, u])
    taken: FloatArray = known[np.arange(len(u)), np.clip(places + before.shape[1], 0, known.shape[1] - 1)]
    return taken
