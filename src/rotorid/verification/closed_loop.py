"""Verification of the loop: an identified airframe flown under its controller, against what both did in flight.

First the controller alone is checked: driven by the measured set-point and rate it must reproduce the logged command
(:func:`controller_alone`). That needs no model of the airframe.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.models.controller import UNKNOWN, Driven, RateController, SteppedController, stepped
from rotorid.models.state_space import StateSpace
from rotorid.simulation.linear import Discretized, discretize
from rotorid.typing import FloatArray
from rotorid.verification.sampled import BoundedResponses, Filter, adjust
from rotorid.verification.scores import nrmse_fit_percent, rms, theil_inequality

STEP_RATE_HZ = 1000.0
"""Airframe and controller advance at least as often as this."""

_OF_A_STEP = 0.05
"""Of a step: logs whose rate is that of the program are off by less."""

ALIKE_TIC = 0.1
"""Of a controller that is the one that flew; no guideline of the field."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Loop(Immutable):
    """One loop to close, with what drove it in flight.

    Parameters
    ----------
    command
        Which input of the airframe the controller commands.
    rate
        Which output of the airframe it feeds back.
    controller
        Its gains and filters.
    driven
        What its set-point is.
    setpoint
        Samples of the set-point, shape ``(samples,)``.
    excitation
        Test signal that is added to its command, shape ``(samples,)``; zeros for none.
    """

    command: str
    rate: str
    controller: RateController
    driven: Driven
    setpoint: FloatArray
    excitation: FloatArray

    def __post_init__(self) -> None:
        self._set(
            setpoint=read_only(self.setpoint, np.float64, ndim=1),
            excitation=read_only(self.excitation, np.float64, ndim=1),
        )


@dataclass(frozen=True, kw_only=True, slots=True)
class LoopScores:
    """How one signal was predicted, about its mean; see :class:`rotorid.verification.verification.Scores`."""

    nrmse_fit_percent: float
    tic: float
    rms: float

    @property
    def alike(self) -> bool:
        """Whether the error is within a fifth of the motion, as that of a controller that flew is."""
        return self.tic <= ALIKE_TIC


@dataclass(frozen=True, kw_only=True, eq=False)
class ClosedLoop(Immutable):
    """One maneuver in closed loop.

    Parameters
    ----------
    time_s
        Shape ``(samples,)``.
    names
        Outputs of the airframe, then the commands of the closed loops.
    outputs
        How many of the names are outputs.
    measured, predicted
        Shape ``(names, samples)``, filtered alike.
    scores
        Name to scores.
    setpoints
        Command to the channel that drove its controller.
    controller_tic
        Command to the Theil coefficient of the controller alone, on the measured rate.
    """

    time_s: FloatArray
    names: tuple[str, ...]
    outputs: int
    measured: FloatArray
    predicted: FloatArray
    scores: Mapping[str, LoopScores]
    setpoints: Mapping[str, str]
    controller_tic: Mapping[str, float]

    def __post_init__(self) -> None:
        self._set(
            time_s=read_only(self.time_s, np.float64, ndim=1),
            names=tuple(self.names),
            measured=read_only(self.measured, np.float64, ndim=2),
            predicted=read_only(self.predicted, np.float64, ndim=2),
            scores=self.scores,
            setpoints=self.setpoints,
            controller_tic=self.controller_tic,
        )


@np.errstate(over="ignore", invalid="ignore")  # a loop that is unstable may leave all numbers behind
def closed_loop(
    system: StateSpace,
    inputs: FloatArray,
    *,
    loops: Sequence[Loop],
    input_names: Sequence[str],
    output_names: Sequence[str],
    measured: FloatArray,
    commands: FloatArray,
    filtered: Filter,
    sample_rate_hz: float,
) -> tuple[FloatArray, FloatArray]:
    r"""Measured and predicted outputs and commands of a model that flies under its controllers.

    .. math:: u = C_r(s) \, r - C_y(s) \, y_{model} + d, \qquad y_{model} = G(s) \, u

    Only set-points :math:`r` and test signals :math:`d` come from the flight, with the commands of inputs whose loop is
    not closed. What no model can know is estimated by linear least squares, as in open loop: a shift of each output and
    of each command (its trim), a steady torque or force along each command, and the initial states of airframe, angle
    and integral.

    An unstable airframe can be judged so for as long as one likes. But a good controller makes the rate follow its
    set-point with almost any airframe: the rate flatters the model. The command shows what the controller had to do
    for it, and accelerations what the airframe made of that; they show more (Niermeyer, Raffler and Holzapfel,
    *Open-Loop Quadrotor Flight Dynamics Identification in Frequency Domain via Closed-Loop Flight Testing*, section
    V.B).

    Controllers advance in steps of 1 ms or a little less, the airframe exactly between them, with commands that go
    straight from step to step: the delays of a model that was fitted to samples hold the autopilot's own hold already.
    An input that is less than a step late is taken as a step late. Limits of commands and of integrals are left out.

    Parameters
    ----------
    system
        The identified airframe.
    inputs
        Measured inputs about their mean, shape ``(u, samples)``.
    loops
        Loops to close, at least one.
    input_names, output_names
        Of the system.
    measured
        Measured outputs, shape ``(y, samples)``.
    commands
        Measured commands of the loops, shape ``(loops, samples)``.
    filtered
        What measurement and prediction pass alike, for arrays ``(rows, samples)``.

    Returns
    -------
    tuple of FloatArray
        Measured and predicted, each of shape ``(y + loops, samples)``.
    """
    samples = inputs.shape[1]
    fine = max(1, math.ceil(STEP_RATE_HZ / sample_rate_hz - 1e-9))
    rate_hz = fine * sample_rate_hz
    grid = np.arange((samples - 1) * fine + 1) / fine

    def finer(rows: FloatArray) -> FloatArray:
        return np.array([np.interp(grid, np.arange(samples), row) for row in rows]).reshape(len(rows), grid.size)

    flown = _Simulation(
        plant=_plant(system, rate_hz),
        inputs=finer(inputs),
        controlled=[list(input_names).index(loop.command) for loop in loops],
        fed_back=[list(output_names).index(loop.rate) for loop in loops],
        reading_delays=np.array([loop.controller.delay_s for loop in loops]) * rate_hz,
        controller=_together([stepped(loop.controller, step_s=1.0 / rate_hz, driven=loop.driven) for loop in loops]),
        setpoints=finer(np.array([loop.setpoint - loop.setpoint.mean() for loop in loops])),
        excitations=finer(np.array([loop.excitation for loop in loops])),
    )
    responses = flown.responses()[:, :, ::fine]
    states = len(flown.plant.step.transition) + len(UNKNOWN) * len(loops)
    parts = BoundedResponses(forced=responses[0], free=responses[1 : 1 + states], biased=responses[1 + states :])
    forced, target = filtered(parts.forced), filtered(np.vstack([measured, commands]))
    size = target.std(axis=1)
    weights = 1.0 / np.where(size > 0.0, size, 1.0)
    return target, forced + adjust(parts, target - forced, weights=weights, filtered=filtered).response


def scored(measured: FloatArray, predicted: FloatArray) -> LoopScores:
    """Scores of one signal about its mean, shape ``(samples,)``."""
    mean = measured.mean()
    return LoopScores(
        nrmse_fit_percent=nrmse_fit_percent(measured, predicted),
        tic=theil_inequality(measured - mean, predicted - mean),
        rms=rms(measured - predicted),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Plant:
    """The airframe from step to step; output delays in steps."""

    step: Discretized
    C: FloatArray
    D: FloatArray
    input_delays: FloatArray
    output_delays: FloatArray


def _plant(system: StateSpace, rate_hz: float) -> _Plant:
    late = replace(system, input_delays_s=np.maximum(system.input_delays_s, 1.0 / rate_hz))
    A, B, C, D = late.proper()
    step = discretize(A, B, delays_s=late.input_delays_s, step_s=1.0 / rate_hz, hold="first")
    return _Plant(
        step=step,
        C=C,
        D=D,
        input_delays=late.input_delays_s * rate_hz,
        output_delays=late.output_delays_s * rate_hz,
    )


def _together(controllers: Sequence[SteppedController]) -> SteppedController:
    """Several controllers as one; its inputs are all set-points, then all rates."""
    from scipy.linalg import block_diag

    def wide(name: str) -> FloatArray:
        halves = [block_diag(*(getattr(stepped, name)[:, [side]] for stepped in controllers)) for side in range(2)]
        return np.hstack(halves)

    return SteppedController(
        transition=block_diag(*(stepped.transition for stepped in controllers)),
        drive=wide("drive"),
        read=block_diag(*(stepped.read for stepped in controllers)),
        direct=wide("direct"),
        unknown=tuple(
            row + sum(len(other.transition) for other in controllers[:place])
            for place, stepped in enumerate(controllers)
            for row in stepped.unknown
        ),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Simulation:
    """A flight to compute: airframe, controllers, and what drives them on the fine clock."""

    plant: _Plant
    inputs: FloatArray
    controlled: list[int]
    fed_back: list[int]
    reading_delays: FloatArray
    controller: SteppedController
    setpoints: FloatArray
    excitations: FloatArray

    def responses(self) -> FloatArray:
        """The forced response, those to each initial state and each steady force, shape ``(r, y + loops, steps)``."""
        from rotorid.verification.kernels import fly_loops

        step, loops, steps = self.plant.step, len(self.controlled), self.inputs.shape[1]
        start, state, steady = self._starts()
        lead = 1 + int(step.lags.max())
        # Commands before the record are those of its first sample, for the forced response alone.
        given = np.zeros((lead + steps, loops, start.shape[1]))
        given[:lead, :, 0] = self.inputs[self.controlled, 0]
        delays = self.plant.output_delays[self.fed_back] + self.reading_delays
        whole = delays.astype(np.int64)
        states = fly_loops(
            np.ascontiguousarray(step.transition),
            np.ascontiguousarray(step.taps[:, self.controlled].transpose(1, 2, 0)),
            step.lags[self.controlled],
            np.ascontiguousarray(self._forcing()),
            np.ascontiguousarray(self.plant.C[self.fed_back]),
            whole,
            delays - whole,
            self.controller.transition,
            self.controller.drive,
            self.controller.read,
            self.controller.direct,
            np.vstack([self.setpoints, self.excitations]).T.copy(),
            start,
            state,
            steady,
            given,
            lead,
        )
        return self._outputs_and_commands(states, given, steady, lead)

    def _starts(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Initial states of airframe and controllers and steady forces, a column for each response."""
        order, loops = len(self.plant.step.transition), len(self.controlled)
        unknown = list(self.controller.unknown)
        columns = 1 + order + len(unknown) + loops
        start, state, steady = (
            np.zeros((order, columns)),
            np.zeros((len(self.controller.transition), columns)),
            np.zeros((loops, columns)),
        )
        start[:, 1 : 1 + order] = np.eye(order)
        state[unknown, range(1 + order, 1 + order + len(unknown))] = 1.0
        steady[:, -loops:] = np.eye(loops)
        return start, state, steady

    def _open(self) -> FloatArray:
        """Inputs whose loop is not closed; the others are zero."""
        left = self.inputs.copy()
        left[self.controlled] = 0.0
        return left

    def _forcing(self) -> FloatArray:
        left = self._open()
        return self.plant.step.forcing(left, left[:, 0])

    def _outputs_and_commands(self, states: FloatArray, given: FloatArray, steady: FloatArray, lead: int) -> FloatArray:
        """Outputs and commands of all responses, shape ``(r, y + loops, steps)``."""
        outputs = np.einsum("yx,kxr->ykr", self.plant.C, states)
        late_outputs = np.stack(
            [_later(row, delay) for row, delay in zip(outputs, self.plant.output_delays, strict=True)]
        )
        left = self._open()
        for y, u in zip(*np.nonzero(self.plant.D), strict=True):
            delay = self.plant.input_delays[u] + self.plant.output_delays[y]
            if u in self.controlled:
                loop = self.controlled.index(u)
                late_outputs[y] += self.plant.D[y, u] * _later(given[:, loop] + steady[loop], delay)[lead:]
            else:
                late_outputs[y, :, 0] += self.plant.D[y, u] * _later(left[u], delay)
        return np.concatenate(
            [np.moveaxis(late_outputs, 2, 0), np.moveaxis(given[lead:], 0, 2).transpose(1, 0, 2)], axis=1
        )


def _later(values: FloatArray, delay: float) -> FloatArray:
    """Rows ``(steps, ...)`` that go straight from step to step, so many steps later."""
    if not delay:
        return values
    whole = int(delay)
    index = np.arange(len(values)) - whole
    newer, older = values[np.maximum(index, 0)], values[np.maximum(index - 1, 0)]
    late: FloatArray = newer + (delay - whole) * (older - newer)
    return late


def controller_alone(
    loop: Loop, rate: FloatArray, command: FloatArray, *, filtered: Filter, sample_rate_hz: float
) -> LoopScores:
    """How well a controller makes the measured command of the measured rate and set-point, step by step.

    This needs no model of the airframe: it says whether the controller is the one that flew. It runs at the rate of its
    own program, where that is known, on samples that go straight from one to the next. Offset, angle and integral at
    the beginning are estimated. A program whose rate loop runs before its angle loop takes the set-point of the step
    before.

    Parameters
    ----------
    loop
        The controller and what drove it.
    rate, command
        As measured, shape ``(samples,)``.
    filtered
        As in :func:`rotorid.verification.closed_loop.closed_loop`.
    sample_rate_hz
        Their rate.
    """
    from rotorid.simulation.linear_kernels import recursion

    step_rate_hz = 1.0 / loop.controller.step_s if loop.controller.step_s > 0.0 else STEP_RATE_HZ
    fine = max(1, math.ceil(step_rate_hz / sample_rate_hz - _OF_A_STEP))
    samples = np.arange(rate.size)
    grid = np.arange((rate.size - 1) * fine + 1) / fine
    older = 1.0 / fine if loop.controller.late_angle and loop.driven == "rate" else 0.0
    own = stepped(loop.controller, step_s=1.0 / (fine * sample_rate_hz), driven=loop.driven)
    late = grid - loop.controller.delay_s * sample_rate_hz
    driving = np.stack(
        [
            np.interp(grid - older, samples, loop.setpoint - loop.setpoint.mean()),
            np.interp(late, samples, rate - rate.mean()),
        ]
    )
    forcing = np.ascontiguousarray((own.drive @ driving).T)
    count = len(own.transition)
    starts = [np.zeros(count), *(np.eye(count)[row] for row in own.unknown)]
    made = np.array(
        [
            recursion(own.transition, forcing if not start.any() else np.zeros_like(forcing), start) @ own.read[0]
            for start in starts
        ]
    )
    made[0] += (own.direct @ driving)[0] + np.interp(grid, samples, loop.excitation)
    whole = made[:, ::fine]
    columns = filtered(np.vstack([whole[1:], np.ones((1, rate.size))]))
    target, forced = filtered(command[None])[0], filtered(whole[:1])[0]
    predicted = forced + columns.T @ np.linalg.lstsq(columns.T, target - forced, rcond=1e-9)[0]
    return scored(target, predicted)
