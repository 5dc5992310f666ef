r"""Where the states of a structure come from, when they are read off records and not simulated.

A state is measured where outputs without parameters show it by themselves or together; it is the slope of a measured
one where an equation without parameters says so (:math:`\dot\theta = q`), and an integral where that is all there is.
A motor lag that no sensor sees is simulated from its input at the values its parameters have.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from rotorid.data.channel import Channel
from rotorid.data.history import TimeHistory
from rotorid.fit.parameter_map import Matrices
from rotorid.fit.time_data import TimeData
from rotorid.typing import BoolArray, FloatArray

Origin: TypeAlias = Literal["measured", "differentiated", "integrated", "integrated_output", "simulated"]
RAMP = "ramp"
"""Name of the channel that rises evenly: what an integral may drift by."""

_EXACT = 1e-9


class StateSource(NamedTuple):
    """How one state is had.

    Parameters
    ----------
    state
        Its index.
    origin
        What is done.
    row
        Of the state equations, or of the outputs for ``integrated_output``; nothing for measured ones.
    input
        The input whose delay the state has, for simulated ones; otherwise -1.
    """

    state: int
    origin: Origin
    row: int = -1
    input: int = -1


@dataclass(frozen=True, eq=False)
class StatePlan:
    """Sources in the order in which they can be had, and which rows hold no free parameter.

    Parameters
    ----------
    sources
        One for each state that can be had.
    weights
        Measured states from outputs, shape ``(x, y)``.
    settled_rows, settled_outputs
        State equations and outputs without free parameters, shapes ``(x,)`` and ``(y,)``.
    """

    sources: tuple[StateSource, ...]
    weights: FloatArray
    settled_rows: BoolArray
    settled_outputs: BoolArray

    @property
    def known(self) -> BoolArray:
        """States that can be had, shape ``(x,)``."""
        known = np.zeros(len(self.weights), dtype=np.bool_)
        known[[source.state for source in self.sources]] = True
        return known

    def of(self, *origins: Origin) -> list[int]:
        """States of some origins."""
        return [source.state for source in self.sources if source.origin in origins]


def plan_states(system: Matrices, slopes: Matrices) -> StatePlan:
    """Which states records show, and how.

    Parameters
    ----------
    system, slopes
        Matrices at some values and their derivatives, as :meth:`rotorid.fit.parameter_map.ParameterMap.tangent` gives
        them.
    """
    settled_rows = ~np.any([slope.any(axis=(0, 2)) for slope in (slopes.M, slopes.F, slopes.G)], axis=0)
    moving = slopes.H0.any(axis=(0, 2)) | slopes.H1.any(axis=(0, 2)) | slopes.output_delays_s.any(axis=0)
    settled_outputs = ~moving & (system.output_delays_s == 0.0)
    direct = settled_outputs & ~system.H1.any(axis=1)
    weights = np.zeros(system.H0.T.shape)
    weights[:, direct] = np.linalg.pinv(system.H0[direct])
    seen = np.abs(weights @ system.H0 - np.eye(len(system.F))).max(axis=1) < _EXACT
    weights[~seen] = 0.0
    sources = [StateSource(int(state), "measured") for state in np.flatnonzero(seen)]
    known = seen.copy()
    while not known.all():
        found = (
            _from_equation(system, known, settled_rows)
            or _from_output(system, known, settled_outputs)
            or _from_input(system, slopes, known)
        )
        if found is None:
            break
        sources.append(found)
        known[found.state] = True
    return StatePlan(tuple(sources), weights, settled_rows, settled_outputs)


def _from_equation(system: Matrices, known: BoolArray, settled: BoolArray) -> StateSource | None:
    """The next state that an equation without parameters and without inputs gives from known ones: as slope first."""
    found = []
    for row in np.flatnonzero(settled & ~system.G.any(axis=1)):
        moved, level = np.flatnonzero(system.M[row] * ~known), np.flatnonzero(system.F[row] * ~known)
        if moved.size == 0 and level.size == 1:
            return StateSource(int(level[0]), "differentiated", int(row))
        if moved.size == 1 and np.count_nonzero(system.M[row]) == 1 and level.size == 0:
            found.append(StateSource(int(moved[0]), "integrated", int(row)))
    return found[0] if found else None


def _from_output(system: Matrices, known: BoolArray, settled: BoolArray) -> StateSource | None:
    """The next state whose derivative an output gives."""
    for row in np.flatnonzero(settled & ~(system.H0[:, ~known].any(axis=1))):
        moved = np.flatnonzero(system.H1[row])
        if moved.size == 1 and not known[moved[0]]:
            return StateSource(int(moved[0]), "integrated_output", int(row))
    return None


def _from_input(system: Matrices, slopes: Matrices, known: BoolArray) -> StateSource | None:
    """The lag behind one input that has the fewest parameters of its own."""
    entries = [np.abs(matrix) + np.abs(slope).sum(axis=0) for matrix, slope in zip(system[:3], slopes[:3], strict=True)]
    counts = sum(np.any(slope, axis=2).sum(axis=0) for slope in slopes[:3])
    found = []
    for row in range(len(system.F)):
        M, F, G = (np.flatnonzero(entry[row]) for entry in entries)
        alone = F.size == 1 and G.size == 1 and set(M.tolist()) <= set(F.tolist())
        if alone and not known[F[0]] and system.F[row, F[0]] * system.M[row, F[0]] <= 0.0 != system.F[row, F[0]]:
            found.append((int(np.asarray(counts)[row]), StateSource(int(F[0]), "simulated", row, int(G[0]))))
    return min(found)[1] if found else None


def state_history(plan: StatePlan, system: Matrices, record: TimeData) -> TimeHistory:
    """A record with its states, as channels ``x0`` and on, inputs ``u0`` and on, outputs ``y0`` and on.

    States that cannot be had are zero. Simulated ones are without the delay of their input.

    Parameters
    ----------
    plan
        As :func:`plan_states` gives it.
    system
        Matrices at the values of lags.
    record
        What was measured.
    """
    step_s = 1.0 / record.sample_rate_hz
    x = plan.weights @ record.outputs
    for source in plan.sources:
        state, row = source.state, source.row
        if source.origin == "differentiated":
            rest = _slope(system.M[row] @ x, step_s) - system.F[row] @ x
            x[state] = rest / system.F[row, state]
        elif source.origin == "integrated":
            size = system.M[row, state]
            x[state] = _lagged(system.F[row] @ x / size, system.F[row, state] / size, step_s)
        elif source.origin == "integrated_output":
            rest = (record.outputs[row] - system.H0[row] @ x) / system.H1[row, state]
            x[state] = _lagged(rest, 0.0, step_s)
        elif source.origin == "simulated":
            drive, size, lag = system.G[row] @ record.inputs, system.M[row, state], system.F[row, state]
            x[state] = -drive / lag if size == 0.0 else _lagged(drive / size, lag / size, step_s)
    ramp = np.linspace(-1.0, 1.0, record.samples)
    values = np.vstack([x, record.inputs, record.outputs, ramp])
    names = [
        f"{letter}{k}"
        for letter, rows in (("x", x), ("u", record.inputs), ("y", record.outputs))
        for k in range(len(rows))
    ]
    channels = tuple(Channel(name=name, unit="1") for name in (*names, RAMP))
    return TimeHistory(values=values, channels=channels, sample_rate_hz=record.sample_rate_hz, start_s=0.0)


def held_parameters(plan: StatePlan, slopes: Matrices, names: Sequence[str]) -> tuple[str, ...]:
    """Free parameters of the rows that states are simulated with."""
    rows = [source.row for source in plan.sources if source.origin == "simulated"]
    moving = [slope[:, rows].any(axis=(1, 2)) for slope in (slopes.M, slopes.F, slopes.G)]
    return tuple(name for name, moves in zip(names, np.any(moving, axis=0), strict=True) if moves)


def _slope(values: FloatArray, step_s: float) -> FloatArray:
    """Derivative at the samples, by a cubic through them."""
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(np.arange(values.size) * step_s, values)(np.arange(values.size) * step_s, 1))


def _lagged(drive: FloatArray, pole_1_s: float, step_s: float) -> FloatArray:
    r"""Solution of :math:`\dot x = \lambda x + d` for a drive that goes straight between samples, from rest."""
    from scipy.signal import lfilter

    turn = pole_1_s * step_s
    decay = float(np.exp(turn))
    if turn == 0.0:
        whole, late = step_s, 0.5 * step_s
    else:
        whole = step_s * float(np.expm1(turn)) / turn
        late = (whole - step_s) / turn
    start = 0.0 if turn == 0.0 else -drive[0] / pole_1_s
    later = lfilter([1.0], [1.0, -decay], (whole - late) * drive[:-1] + late * drive[1:], zi=[decay * start])[0]
    return np.concatenate([[start], np.asarray(later)])
