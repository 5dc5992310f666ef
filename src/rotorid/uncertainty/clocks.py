r"""Clocks and scales in time: what a fit would have found, were some of its channels late, or a little larger.

No log says where within a sample a value belongs, and no residual shows it: a channel that is late by :math:`\tau`
moves parameters, and leaves nothing. So all channels of one unit, inputs and outputs each, are moved against the others
by one standard deviation either way, and the records fitted again. Half the difference of the two is an error of the
parameters; those of all groups add in squares. So do those of the scales of every input and every output, known to
0.25 % (:data:`rotorid.fitting.frequency.error_shapes.SCALE_ERROR`), which leave nothing either.

A refit is one step of Gauss and Newton from the old solution, with the slopes beside all unknowns of a record:

.. math:: \delta\theta = -\frac12 F^{-1} (S_+^T r_+ - S_-^T r_-), \qquad F = \frac12 (S_+^T S_+ + S_-^T S_-)

Slopes that leave the initial states where they were would give a third of that.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rotorid.data.record import STANDARD_UNITS
from rotorid.fitting.frequency.error_shapes import SCALE_ERROR
from rotorid.fitting.time.output_error import NormalEquations, RecordsProblem, TimeData
from rotorid.signal.stamps import CLOCK_SAMPLES
from rotorid.typing import FloatArray


class ClockGroup(NamedTuple):
    """Rows of the inputs and of the outputs of a record that share a clock."""

    inputs: tuple[int, ...]
    outputs: tuple[int, ...]


def clock_groups(inputs: Sequence[str], outputs: Sequence[str]) -> tuple[ClockGroup, ...]:
    """Channels of one unit, inputs and outputs each; a channel of no known unit has a clock of its own.

    Examples
    --------
    >>> clock_groups(["phi", "theta", "velocity_down_dot"], ["velocity_forward", "velocity_right"])
    (ClockGroup(inputs=(0, 1), outputs=()), ClockGroup(inputs=(2,), outputs=()), ClockGroup(inputs=(), outputs=(0, 1)))
    """
    return (
        *(ClockGroup(rows, ()) for rows in _by_unit(inputs)),
        *(ClockGroup((), rows) for rows in _by_unit(outputs)),
    )


def _by_unit(names: Sequence[str]) -> list[tuple[int, ...]]:
    found: dict[str, list[int]] = {}
    for row, name in enumerate(names):
        found.setdefault(STANDARD_UNITS.get(name, name), []).append(row)
    return [tuple(rows) for rows in found.values()]


def clock_shifts(
    problem: RecordsProblem, theta: FloatArray, *, late: Callable[[str], float] = lambda _: CLOCK_SAMPLES
) -> FloatArray:
    """By how much each group of channels moves the parameters, were its clock late by a standard deviation.

    Parameters
    ----------
    problem
        Of records in time, as it was fitted, with the noise that the fit ended with.
    theta
        Where the fit ended.
    late
        Channel to the standard deviation of its clock, in samples of the records; in a group the largest counts.

    Returns
    -------
    FloatArray
        Shape ``(groups, p)``: one row for each of :func:`clock_groups`, a column for each slope of the parts. With
        ``C`` for it, the covariance is ``C.T @ C``.

    Examples
    --------
    A clock that is late by 7.5 ms looks like a delay; straight lines between samples lose a little of it at steps:

    >>> from rotorid.fitting.time.output_error import TimeProblem
    >>> from rotorid.models.library import response_model
    >>> lag = response_model("response.first_order_delay", [("phi_setpoint", "phi")])
    >>> values = lag.parameters.with_values({"K_phi": 1.0, "T_phi": 0.2, "tau_phi": 0.07})
    >>> steps = np.repeat([[0.1, -0.1, 0.1, -0.1]], 20, axis=1)
    >>> record = TimeData(name="steps", inputs=steps, outputs=0.0 * steps, sample_rate_hz=20.0)
    >>> problem = TimeProblem(structure=lag, parameters=values, records=(record,), unknowns=("initial_state",))
    >>> exact = problem.noiseless(values.pack())
    >>> shifts = clock_shifts(exact, values.pack())
    >>> [name for name in values.free], (1e3 * shifts[:, 2]).round().tolist()
    (['K_phi', 'T_phi', 'tau_phi'], [-7.0, 6.0])
    """
    structure = problem.structure
    rows = []
    for group in clock_groups(structure.inputs, structure.outputs):
        names = [*(structure.inputs[row] for row in group.inputs), *(structure.outputs[row] for row in group.outputs)]
        samples = max(late(name) for name in names)
        sides = [
            replace(
                problem, records=tuple(shifted(record, group, moved) for record in problem.records)
            ).normal_equations(theta)
            for moved in (samples, -samples)
        ]
        rows.append(_half_difference(*sides))
    return np.array(rows)


def scale_shifts(problem: RecordsProblem, theta: FloatArray) -> FloatArray:
    """By how much the scale of each channel moves the parameters, were it larger by a standard deviation.

    Parameters
    ----------
    problem, theta
        As for :func:`clock_shifts`.

    Returns
    -------
    FloatArray
        Shape ``(u + y, p)``: inputs, then outputs.
    """
    structure = problem.structure
    rows = []
    for channel in range(len(structure.inputs) + len(structure.outputs)):
        sides = [
            replace(
                problem, records=tuple(scaled(record, channel, share) for record in problem.records)
            ).normal_equations(theta)
            for share in (SCALE_ERROR, -SCALE_ERROR)
        ]
        rows.append(_half_difference(*sides))
    return np.array(rows)


def channel_errors(
    problem: RecordsProblem, theta: FloatArray, clocks: Mapping[str, float], *, held: Collection[str] = ()
) -> list[dict[str, float]]:
    """For each clock and each scale, by how much it moves the free parameters.

    Parameters
    ----------
    problem, theta
        As for :func:`clock_shifts`.
    clocks
        Channel to the standard deviation of its clock in samples; others have the usual one.
    held
        Parameters on a bound that the data push against. The others move without them; they move as if they were free,
        for other clocks would have let them go.
    """

    def late(name: str) -> float:
        return clocks.get(name, CLOCK_SAMPLES)

    def rows(problem: RecordsProblem, theta: FloatArray) -> list[dict[str, float]]:
        moved = np.vstack([clock_shifts(problem, theta, late=late), scale_shifts(problem, theta)])
        return [dict(zip(problem.parameters.free, row, strict=False)) for row in moved.tolist()]

    names = problem.parameters.free
    together = rows(problem, theta)
    if not held:
        return together
    parameters = problem.parameters.unpack(theta[: len(names)])
    for name in held:
        parameters = parameters.fix(name, parameters[name].value)
    kept = np.array([name not in held for name in names] + [True] * (theta.size - len(names)), dtype=np.bool_)
    without: list[dict[str, float]] = []
    if kept[: len(names)].any():
        without = rows(problem.with_parameters(parameters), theta[kept])
    alone = [{name: row[name] for name in held} for row in together]
    return [{**of_held, **others} for of_held, others in zip(alone, without or alone, strict=True)]


def scaled(record: TimeData, channel: int, share: float) -> TimeData:
    """A record in which one channel, of the inputs and then the outputs, is larger by a share."""
    factors = np.ones((len(record.inputs) + len(record.outputs), 1))
    factors[channel] += share
    of_inputs, of_outputs = factors[: len(record.inputs)], factors[len(record.inputs) :]
    return replace(
        record,
        inputs=of_inputs * record.inputs,
        outputs=of_outputs * record.outputs,
        before=of_inputs * record.before,
    )


def shifted(record: TimeData, group: ClockGroup, samples: float) -> TimeData:
    """A record in which some channels come later by a fraction of a sample, read along straight lines."""
    inputs, outputs = record.inputs.copy(), record.outputs.copy()
    for row in group.inputs:
        inputs[row] = _later(record.inputs[row], float(record.before[row, -1]), samples)
    for row in group.outputs:
        outputs[row] = _later(record.outputs[row], None, samples)
    return replace(record, inputs=inputs, outputs=outputs)


def _later(values: FloatArray, before: float | None, samples: float) -> FloatArray:
    """Values at a time before each sample; beyond the ends along the last line."""
    first = 2.0 * values[0] - values[1] if before is None else before
    known = np.concatenate([[first], values, [2.0 * values[-1] - values[-2]]])
    return np.asarray(np.interp(np.arange(values.size) + 1.0 - samples, np.arange(known.size), known))


def _half_difference(after: NormalEquations, before: NormalEquations) -> FloatArray:
    """Half the difference of what two problems move the parameters by."""
    pull, fisher = 0.5 * (after.pull - before.pull), 0.5 * (after.fisher + before.fisher)
    size = np.sqrt(fisher.diagonal())
    size[size == 0.0] = np.inf
    return np.asarray(-np.linalg.pinv(fisher / np.outer(size, size), hermitian=True) @ (pull / size) / size)
