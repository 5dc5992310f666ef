r"""The equations of a structure as rows whose residuals are computed from records.

.. math:: e = A \dot x - B x - C u(t - \tau) + D y

A state equation has :math:`A = M`, :math:`B = F`, :math:`C = G`. An output that sees a derivative,
:math:`y = H_0 x + H_1 \dot x`, has the right sides of the equations in its place: with :math:`c M = H_1` it is
:math:`D = 1`, :math:`B = H_0 + c F`, :math:`C = c G`.

States are read off records and not simulated. A state is measured where outputs without parameters show it by
themselves or together; it is the slope of a measured one where an equation without parameters says so
(:math:`\dot\theta = q`), and an integral where that is all there is. A motor lag that no sensor sees is simulated from
its input at the values its parameters have.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from rotorid.data.record import Channel, TimeHistory
from rotorid.errors import InsufficientDataError
from rotorid.fitting.equations.regression import InBand, InTime
from rotorid.fitting.frequency.parameter_map import Matrices, ParameterMap
from rotorid.fitting.time.output_error import TimeData
from rotorid.simulation.linear import Hold
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
        Matrices at some values and their derivatives, as
        :meth:`rotorid.fitting.frequency.parameter_map.ParameterMap.tangent` gives them.
    """
    settled_rows = ~np.any([slope.any(axis=(0, 2)) for slope in (slopes.M, slopes.F, slopes.G)], axis=0)
    moving = slopes.H0.any(axis=(0, 2)) | slopes.H1.any(axis=(0, 2)) | slopes.output_delays_s.any(axis=0)
    settled_outputs = ~moving & (system.output_delays_s == 0.0)
    direct = settled_outputs & ~system.H1.any(axis=1)
    weights = np.zeros(system.H0.T.shape)
    weights[:, direct] = np.linalg.pinv(system.H0[direct])
    observed = np.abs(weights @ system.H0 - np.eye(len(system.F))).max(axis=1) < _EXACT
    weights[~observed] = 0.0
    sources = [StateSource(int(state), "measured") for state in np.flatnonzero(observed)]
    known = observed.copy()
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
        separate = F.size == 1 and G.size == 1 and set(M.tolist()) <= set(F.tolist())
        if separate and not known[F[0]] and system.F[row, F[0]] * system.M[row, F[0]] <= 0.0 != system.F[row, F[0]]:
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


def simulated_parameters(plan: StatePlan, slopes: Matrices, names: Sequence[str]) -> tuple[str, ...]:
    """Free parameters of the rows that states are simulated with."""
    rows = [source.row for source in plan.sources if source.origin == "simulated"]
    moving = [slope[:, rows].any(axis=(1, 2)) for slope in (slopes.M, slopes.F, slopes.G)]
    return tuple(name for name, moves in zip(names, np.any(moving, axis=0), strict=True) if moves)


def _slope(values: FloatArray, step_s: float) -> FloatArray:
    """Derivative at the samples, by a cubic through them."""
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(np.arange(values.size) * step_s, values)(np.arange(values.size) * step_s, 1))


def _lagged(drive: FloatArray, pole_1_s: float, step_s: float) -> FloatArray:
    r"""Solution of :math:`\dot x = \lambda x + d` for a drive linear between samples, from zero initial state."""
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


EquationDomain: TypeAlias = InTime | InBand
"""Where equations are compared."""

_NUDGE = 0.25
"""Of a sample: by which a delay is moved to see what it does."""


class Rows(NamedTuple):
    """Coefficients of the equations, with any leading axes: ``(e, x)``, ``(e, x)``, ``(e, u)``, ``(e, y)``."""

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray


class Columns(NamedTuple):
    """One record in its domain: slopes and levels ``(x, n)``, inputs ``(u, n)``, outputs ``(y, n)``.

    ``levels_move`` and ``inputs_move`` are derivatives with respect to the delays.
    """

    slopes: FloatArray
    levels: FloatArray
    inputs: FloatArray
    outputs: FloatArray
    levels_move: FloatArray
    inputs_move: FloatArray


class Errors(NamedTuple):
    """One record: errors of the equations ``(e, n)``, derivatives ``(p, e, n)``, left sides ``(e, n)``."""

    error: FloatArray
    slopes: FloatArray
    target: FloatArray


@dataclass(frozen=True, eq=False)
class EquationRows:
    """The equations of a structure that records can answer.

    Parameters
    ----------
    map
        Structure and free parameters.
    domain
        Where equations are compared.
    hold
        What the inputs do between their samples; a held one acts half a sample later than a straight line.
    """

    map: ParameterMap
    records: tuple[TimeData, ...]
    domain: EquationDomain
    hold: Hold

    @cached_property
    def start(self) -> tuple[Matrices, Matrices]:
        """Matrices and derivatives at the start values."""
        return self.map.tangent(self.map.parameters.pack())

    @cached_property
    def plan(self) -> StatePlan:
        """Where the states come from."""
        return plan_states(*self.start)

    @cached_property
    def state_rows(self) -> tuple[int, ...]:
        """State equations with free parameters, all of whose states can be had."""
        system, slopes = self.start
        used = [
            np.abs(matrix) + np.abs(slope).sum(axis=0) for matrix, slope in zip(system[:2], slopes[:2], strict=True)
        ]
        unknown = used[0][:, ~self.plan.known].any(axis=1) | used[1][:, ~self.plan.known].any(axis=1)
        spent = np.zeros_like(unknown)
        spent[[source.row for source in self.plan.sources if source.origin == "simulated"]] = True
        unclear = used[0][:, self.plan.of("simulated")].any(axis=1)
        return tuple(np.flatnonzero(~self.plan.settled_rows & ~unknown & ~spent & ~unclear).tolist())

    @cached_property
    def output_rows(self) -> tuple[tuple[int, FloatArray], ...]:
        """Outputs that see derivatives of such equations, each with its factors :math:`c`, shape ``(x,)``."""
        system, slopes = self.start
        spent = {source.row for source in self.plan.sources if source.origin == "integrated_output"}
        firm = [row for row in range(len(system.M)) if not slopes.M[:, row].any()]
        found = []
        for output in np.flatnonzero(self.plan.settled_outputs & system.H1.any(axis=1)):
            factor = np.zeros(len(system.M))
            factor[firm] = np.linalg.pinv(system.M[firm].T) @ system.H1[output]
            factor[np.abs(factor) < _EXACT] = 0.0
            exact = np.abs(factor @ system.M - system.H1[output]).max() < _EXACT
            needed = [row for row in np.flatnonzero(factor).tolist() if not self.plan.settled_rows[row]]
            shown = not system.H0[output, ~self.plan.known].any()
            if exact and needed and shown and int(output) not in spent and set(needed) <= set(self.state_rows):
                found.append((int(output), factor))
        return tuple(found)

    @property
    def names(self) -> tuple[str, ...]:
        """The left sides: derivatives of states as ``q'``, outputs as they are."""
        structure = self.map.structure
        states = tuple(f"{structure.states[row]}'" for row in self.state_rows)
        return states + tuple(structure.outputs[output] for output, _ in self.output_rows)

    @cached_property
    def histories(self) -> tuple[TimeHistory, ...]:
        """Records with their states."""
        return tuple(state_history(self.plan, self.start[0], record) for record in self.records)

    def rows(self, matrices: Matrices) -> Rows:
        """Coefficients from matrices, or with a leading axis from their derivatives; D means nothing there."""
        states, outputs = list(self.state_rows), [output for output, _ in self.output_rows]
        factors = np.array([factor for _, factor in self.output_rows]).reshape(-1, matrices.F.shape[-1])
        A, H0 = matrices.M[..., states, :], matrices.H0[..., outputs, :]
        D = np.zeros((len(states) + len(outputs), matrices.H0.shape[-2]))
        D[len(states) + np.arange(len(outputs)), outputs] = 1.0
        return Rows(
            np.concatenate([A, np.zeros_like(H0)], axis=-2),
            np.concatenate([matrices.F[..., states, :], H0 + factors @ matrices.F], axis=-2),
            np.concatenate([matrices.G[..., states, :], factors @ matrices.G], axis=-2),
            D,
        )

    def known_levels(self, system: Matrices) -> FloatArray:
        """Known contributions to the left sides of outputs from the states, shape ``(e, x)``: gravity, as a rule."""
        outputs = [output for output, _ in self.output_rows]
        return np.concatenate([np.zeros((len(self.state_rows), system.H0.shape[1])), system.H0[outputs]])

    @cached_property
    def _still(self) -> list[tuple[FloatArray, FloatArray, FloatArray, FloatArray]]:
        """Slopes, levels and outputs of each record that no delay moves, and a basis of its unknowns."""
        found = []
        for history in self.histories:
            sizes = [len(self.start[0].F), len(self.start[0].H0)]
            simulated = set(self.plan.of("simulated"))
            zero = np.zeros_like(self.domain.constant_term(history))
            slopes = [zero if k in simulated else self.domain.slope(history, f"x{k}") for k in range(sizes[0])]
            levels = [zero if k in simulated else self.domain.level(history, f"x{k}", 0.0) for k in range(sizes[0])]
            outputs = [self.domain.level(history, f"y{k}", 0.0) for k in range(sizes[1])]
            open_ = [self.domain.constant_term(history)]
            if self.plan.of("integrated", "integrated_output"):
                open_.append(self.domain.level(history, RAMP, 0.0))
            basis = np.linalg.qr(np.stack(open_, axis=1))[0]
            found.append((np.stack(slopes), np.stack(levels), np.stack(outputs), np.asarray(basis)))
        return found

    def columns(self, record: int, delays_s: FloatArray) -> Columns:
        """One record in its domain, inputs late by their delays, shape ``(u,)``."""
        history, (slopes, levels, outputs, _) = self.histories[record], self._still[record]
        extra_s = 0.5 / history.sample_rate_hz if self.hold == "zero" else 0.0
        inputs, inputs_move = zip(
            *(self._late(record, f"u{k}", delay + extra_s) for k, delay in enumerate(delays_s.tolist())), strict=True
        )
        levels, levels_move = levels.copy(), np.zeros_like(levels)
        for source in self.plan.sources:
            if source.origin == "simulated":
                levels[source.state], levels_move[source.state] = self._late(
                    record, f"x{source.state}", float(delays_s[source.input]) + extra_s
                )
        return Columns(slopes, levels, np.stack(inputs), outputs, levels_move, np.stack(inputs_move))

    def _late(self, record: int, name: str, delay_s: float) -> tuple[FloatArray, FloatArray]:
        """A late channel and how it moves with its delay; a search asks for the same ones again and again."""
        key = (record, name, delay_s)
        if key not in self._met:
            history = self.histories[record]
            nudge_s = _NUDGE / history.sample_rate_hz
            before, now, after = (
                self.domain.level(history, name, delay_s + shift) for shift in (-nudge_s, 0.0, nudge_s)
            )
            self._met[key] = now, (after - before) / (2.0 * nudge_s)
        return self._met[key]

    @cached_property
    def _met(self) -> dict[tuple[int, str, float], tuple[FloatArray, FloatArray]]:
        return {}

    def errors(self, theta: FloatArray) -> list[Errors]:
        """Errors of the equations and their derivatives, for each record, with unknown constants removed.

        Parameters
        ----------
        theta
            Free parameters, shape ``(p,)``.
        """
        system, slopes = self.map.tangent(theta)
        rows, moves, known = self.rows(system), self.rows(slopes), self.known_levels(system)
        by_state = np.zeros((len(theta), len(system.F)))
        for source in self.plan.sources:
            if source.origin == "simulated":
                by_state[:, source.state] = slopes.input_delays_s[:, source.input]
        found = []
        for record, (_, _, _, basis) in enumerate(self._still):
            c = self.columns(record, system.input_delays_s)
            target = rows.A @ c.slopes + rows.D @ c.outputs - known @ c.levels
            error = rows.A @ c.slopes - rows.B @ c.levels - rows.C @ c.inputs + rows.D @ c.outputs
            change = moves.A @ c.slopes - moves.B @ c.levels - moves.C @ c.inputs
            change -= (slopes.input_delays_s[:, None, :] * rows.C) @ c.inputs_move
            change -= (by_state[:, None, :] * rows.B) @ c.levels_move
            found.append(Errors(*(_orthogonal_to(basis, part) for part in (error, change, target))))
        return found

    def checked(self) -> EquationRows:
        """These rows, if there are any.

        Raises
        ------
        InsufficientDataError
            No equation has all its states among what the outputs show.
        """
        if self.names:
            return self
        known = [name for name, had in zip(self.map.structure.states, self.plan.known, strict=True) if had]
        raise InsufficientDataError(
            f"the outputs of {self.map.structure.name} measure only the states {', '.join(known) or '(none)'}",
            needed="all states of an equation with free parameters",
            remedy="fit by output error, which needs no measured states",
        )


def _orthogonal_to(basis: FloatArray, values: FloatArray) -> FloatArray:
    """Rows ``(..., n)`` with a basis ``(n, k)`` projected out."""
    return np.asarray(values - (values @ basis) @ basis.T)


def stacked(parts: Sequence[Errors], weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Weighted residual of all records, shape ``(n,)``, and its Jacobian ``(n, p)``."""
    residual = np.concatenate([(weights[:, None] * part.error).ravel() for part in parts])
    flat = [(weights[:, None] * part.slopes).reshape(len(part.slopes), -1).T for part in parts]
    return residual, np.concatenate(flat)
