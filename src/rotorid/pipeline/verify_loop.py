"""One unseen maneuver in closed loop."""

from __future__ import annotations

import numpy as np

from rotorid.data.findings import Finding
from rotorid.data.history import TimeHistory
from rotorid.data.maneuver import Maneuver
from rotorid.models.state_space import StateSpace
from rotorid.pipeline.instruments import axis_of, is_command
from rotorid.pipeline.verify_controller import RATES, Controllers, no_controller, other_controller
from rotorid.typing import Axis
from rotorid.verify.closed_loop import ClosedLoop, closed_loop, scored
from rotorid.verify.matching import Filter
from rotorid.verify.scores import GOOD_TIC


def looped_axes(inputs: tuple[str, ...], outputs: tuple[str, ...]) -> tuple[Axis, ...]:
    """Axes of a model whose command and rate it has."""
    axes = [axis_of(name) for name in inputs if is_command(name)]
    return tuple(axis for axis in axes if axis in RATES and RATES[axis][0] in outputs)


def fly_maneuver(
    system: StateSpace,
    history: TimeHistory,
    maneuver: Maneuver,
    controllers: Controllers,
    *,
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    filtered: Filter,
) -> tuple[ClosedLoop | None, tuple[Finding, ...]]:
    """Fly a model under the controllers of the log, and say where that is not possible.

    The loop of the maneuver's own axis must be closed; those of other axes are as far as their controllers are known
    and explain their commands, else their measured commands drive the model.

    Parameters
    ----------
    system
        The airframe.
    history
        The maneuver with time around it: inputs, outputs and what drives the controllers.
    maneuver
        What was flown.
    controllers
        What is known of the controllers.
    inputs, outputs
        Of the system.
    filtered
        What measurement and prediction pass alike.
    """
    own = [axis for axis in looped_axes(inputs, outputs) if axis == maneuver.axis]
    if not own:
        return None, ()
    tried = {axis: controllers.loop(axis, history, filtered) for axis in looped_axes(inputs, outputs)}
    found = {axis: item for axis, item in tried.items() if item is not None}
    record = controllers.record.source.name
    if maneuver.axis not in found:
        return None, (no_controller(record, own),)
    _, setpoint, scores = found[maneuver.axis]
    if scores.tic > GOOD_TIC:
        return None, (other_controller(record, maneuver.axis, setpoint, scores),)
    closed = {axis: item for axis, item in found.items() if item[2].tic <= GOOD_TIC}
    loops = [loop for loop, _, _ in closed.values()]
    u = np.stack([history[name] for name in inputs])
    measured, predicted = closed_loop(
        system,
        u - u.mean(axis=1, keepdims=True),
        loops=loops,
        input_names=inputs,
        output_names=outputs,
        measured=np.stack([history[name] for name in outputs]),
        commands=np.stack([history[loop.command] for loop in loops]),
        filtered=filtered,
        sample_rate_hz=history.sample_rate_hz,
    )
    names = (*outputs, *(loop.command for loop in loops))
    flown = ClosedLoop(
        time_s=history.time_s,
        names=names,
        outputs=len(outputs),
        measured=measured,
        predicted=predicted,
        scores={name: scored(*pair) for name, *pair in zip(names, measured, predicted, strict=True)},
        setpoints={loop.command: name for loop, name, _ in closed.values()},
        controller_tic={loop.command: scores.tic for loop, _, scores in closed.values()},
    )
    return flown, ()
