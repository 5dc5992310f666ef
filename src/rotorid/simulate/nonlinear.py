"""Time response of a nonlinear model whose sampled inputs arrive late by any fraction of a sample."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rotorid.errors import UsageError
from rotorid.models.nonlinear import NonlinearStructure, Program
from rotorid.simulate.hold import Hold
from rotorid.simulate.nonlinear_method import RungeKutta, runge_kutta
from rotorid.simulate.nonlinear_pieces import Pieces, Plan, cut, planned
from rotorid.typing import FloatArray, IntArray


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
            raise UsageError(f"{self.substeps} steps in a sample interval came", needed="one or more")
        if self.hold not in ("zero", "first"):
            raise UsageError(f"the hold {self.hold!r} came", needed="zero or first")

    @property
    def tableau(self) -> RungeKutta:
        """Weights of the method."""
        return runge_kutta(self.method)


@dataclass(frozen=True, kw_only=True, eq=False)
class NonlinearSensitivities:
    """What a model does with the inputs of one record, and how that moves.

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

    Steps end at every corner of the late inputs, so the order of the method holds across their jumps, and no delay is
    rounded to a sample. Between the corners the error falls with the order of the method. A time constant of the model
    well below a step makes every explicit method unstable: take more substeps, or
    :func:`rotorid.simulate.nonlinear_adaptive.simulate_adaptive`. Where a state leaves the region in which the
    equations have values, the outputs are not numbers from there on; no error is raised, so that a fit can step back.
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
        Inputs before the first sample, shape ``(u,)``, which a delayed input still shows. Zero by default.
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

    >>> from rotorid.models.nonlinear_equations import nonlinear_structure
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
        checked_vector(before, len(structure.inputs), "before"),
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
            f"directions of shapes {directions.shape} and {start_directions.shape} came",
            needed=f"shapes ({count}, k) and ({order}, k)",
        )
    return _respond(
        structure,
        (structure.dynamics, structure.measurement),
        values,
        checked_inputs(structure, u),
        checked_vector(before, len(structure.inputs), "before"),
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
    pieces = late_pieces(structure, values, directions[1], sample_rate_hz)
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
    from rotorid.simulate.nonlinear_kernels import integrate

    (held, ramps), method = inputs, scheme.tableau
    names = np.vstack([states[0], np.zeros((held.shape[2], states.shape[2])), still])
    integrate(
        *_ready(program, names[:, 0]),
        names,
        np.vstack([method.a, method.b]),
        plan.lengths,
        plan.pieces,
        held,
        ramps,
        plan.ages,
        states,
    )


def _observed(program: Program, moving: FloatArray, still: FloatArray) -> FloatArray:
    """The outputs, shape ``(n, y, 1 + k)``."""
    from rotorid.simulate.nonlinear_kernels import observe

    outputs = np.zeros((len(moving), program.size, still.shape[1]))
    observe(*_ready(program, np.concatenate([moving[0, :, 0], still[:, 0]])), moving, still, outputs)
    return outputs


def observed_plainly(structure: NonlinearStructure, moving: FloatArray, numbers: FloatArray) -> FloatArray:
    """The outputs ``(y, n)`` at states and late inputs ``(n, x + u, 1)`` and values of the parameters ``(p,)``."""
    return np.ascontiguousarray(_observed(structure.plain[1], moving, numbers[:, None])[..., 0].T)


def _ready(program: Program, values: FloatArray) -> tuple[IntArray, IntArray, IntArray, int, FloatArray]:
    """A program as the kernels take it, what depends on the parameters alone already computed."""
    from rotorid.simulate.nonlinear_kernels import run

    tape, slots = program.tape, program.tape.slots(values)
    # A copy is writable: for arrays that are not, Numba would compile once more.
    operations, results = tape.operations.copy(), tape.results[: program.size].copy()
    run(operations, 0, tape.settled, slots)
    return operations, results, program.slopes, tape.settled, slots


def late_pieces(
    structure: NonlinearStructure, values: Mapping[str, float], directions: FloatArray, sample_rate_hz: float
) -> Pieces:
    """The pieces of a sample interval between the corners of the late inputs of a model."""
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
        raise UsageError(f"inputs of shape {np.shape(u)} came", needed=f"shape ({inputs}, samples)")
    values = np.array(u, dtype=np.float64, order="C")
    if not np.isfinite(values).all():
        raise UsageError("an input is not finite", needed="finite numbers", remedy="cut the record at its gaps")
    return values


def checked_vector(values: FloatArray | None, size: int, name: str) -> FloatArray:
    """A vector of the right size; zeros where none was given.

    Raises
    ------
    UsageError
        It has another size.
    """
    vector = np.zeros(size) if values is None else np.array(values, dtype=np.float64)
    if vector.shape != (size,):
        raise UsageError(f"{name} of shape {vector.shape} came", needed=f"shape ({size},)")
    return vector
