r"""The equations of a structure as rows whose residuals are computed from records.

.. math:: e = A \dot x - B x - C u(t - \tau) + D y

A state equation has :math:`A = M`, :math:`B = F`, :math:`C = G`. An output that sees a derivative,
:math:`y = H_0 x + H_1 \dot x`, has the right sides of the equations in its place: with :math:`c M = H_1` it is
:math:`D = 1`, :math:`B = H_0 + c F`, :math:`C = c G`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, TypeAlias

import numpy as np

from rotorid.data.history import TimeHistory
from rotorid.errors import InsufficientDataError
from rotorid.fit.parameter_map import Matrices, ParameterMap
from rotorid.fit.structure_equation_states import RAMP, StatePlan, plan_states, state_history
from rotorid.fit.time_data import TimeData
from rotorid.fit.time_equation_error import InBand, InTime
from rotorid.simulate.hold import Hold
from rotorid.typing import FloatArray

EquationDomain: TypeAlias = InTime | InBand
"""Where equations are compared."""

_EXACT = 1e-9
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
    records
        What was measured.
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
        """What of the left sides of outputs is known of the states, shape ``(e, x)``: gravity, as a rule."""
        outputs = [output for output, _ in self.output_rows]
        return np.concatenate([np.zeros((len(self.state_rows), system.H0.shape[1])), system.H0[outputs]])

    @cached_property
    def _still(self) -> list[tuple[FloatArray, FloatArray, FloatArray, FloatArray]]:
        """Slopes, levels and outputs of each record, which no delay moves, and a basis of what is not known of it."""
        found = []
        for history in self.histories:
            sizes = [len(self.start[0].F), len(self.start[0].H0)]
            simulated = set(self.plan.of("simulated"))
            zero = np.zeros_like(self.domain.one(history))
            slopes = [zero if k in simulated else self.domain.slope(history, f"x{k}") for k in range(sizes[0])]
            levels = [zero if k in simulated else self.domain.level(history, f"x{k}", 0.0) for k in range(sizes[0])]
            outputs = [self.domain.level(history, f"y{k}", 0.0) for k in range(sizes[1])]
            open_ = [self.domain.one(history)]
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
        """Errors of the equations and their derivatives, for each record, beside constants that are not known.

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
            found.append(Errors(*(_beside(basis, part) for part in (error, change, target))))
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
            f"the outputs of {self.map.structure.name} show the states {', '.join(known) or '(none)'}",
            needed="all states of an equation with free parameters",
            remedy="fit by output error, which needs no measured states",
        )


def _beside(basis: FloatArray, values: FloatArray) -> FloatArray:
    """What is left of rows ``(..., n)`` beside a basis ``(n, k)``."""
    return np.asarray(values - (values @ basis) @ basis.T)


def stacked(parts: Sequence[Errors], weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Weighted residual of all records, shape ``(n,)``, and its Jacobian ``(n, p)``."""
    residual = np.concatenate([(weights[:, None] * part.error).ravel() for part in parts])
    flat = [(weights[:, None] * part.slopes).reshape(len(part.slopes), -1).T for part in parts]
    return residual, np.concatenate(flat)
