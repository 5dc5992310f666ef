"""Bounds of fits in time that simulate or predict, with each record fitted alone.

What the structure lacks comes by :mod:`rotorid.uncertainty.time_error`, clocks and scales by
:mod:`rotorid.uncertainty.clocks`.
Records that each move every input are fitted alone, from the values of all together: how they scatter is evidence that
no model of the errors gives. A predictor has the noise of all together. A record that does not determine the parameters
is not compared.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from rotorid.data.display import listed
from rotorid.errors import RotoridError
from rotorid.fits.scatter import LogEstimate, disagreements, name_of_stretch, with_scatter
from rotorid.fitting.least_squares import Solution
from rotorid.fitting.problem import Fit, Part, Problem
from rotorid.fitting.time.output_error import (
    RecordsProblem,
    TimeData,
    TimeProblem,
    fit_output_error,
    moving,
    own_starts,
)
from rotorid.flights.segments import TimeRecords
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure, answers
from rotorid.results.segment import Segment
from rotorid.signal.stamps import CLOCK_SAMPLES
from rotorid.typing import FloatArray
from rotorid.uncertainty.clocks import channel_errors, clock_groups
from rotorid.uncertainty.cramer_rao import Bounds, bounds_of_parts
from rotorid.uncertainty.time_error import with_time_error

_PROGRESS = logging.getLogger("rotorid.progress")


def parts_at(problem: Problem, solution: Solution) -> list[Part]:
    """Whitened residuals and slopes at the end of a fit; a noise on its bound has no effect any more."""
    beyond = np.arange(solution.theta.size) >= len(problem.parameters.free)
    kept = ~(np.array(solution.at_bound, dtype=np.bool_) & beyond)
    return [part._replace(slopes=part.slopes[:, :, kept]) for part in problem.parts(solution.theta)]


def bounds_in_time(
    problem: RecordsProblem,
    solution: Solution,
    *,
    alone: Sequence[LogEstimate] = (),
    clocks: Mapping[str, float] = MappingProxyType({}),
) -> Bounds:
    """Uncertainty at the end of a fit: random errors by the color of the residuals, model error, clocks and scales.

    Parameters
    ----------
    problem
        With the noise that the fit ended with.
    alone
        Each record fitted alone.
    clocks
        Of the channels, as :class:`rotorid.flights.segments.TimeRecords` has them.

    Raises
    ------
    InsufficientDataError
        The records do not determine the parameters.
    """
    random, parts, held = _random(problem, solution)
    added = errors_of_channels(problem, solution.theta, clocks, held)
    random = with_scatter(random, disagreements(alone))
    return with_time_error(random, parts, alone=alone, held=held, added=added)


def _random(problem: Problem, solution: Solution) -> tuple[Bounds, list[Part], list[str]]:
    names = problem.parameters.free
    parts = parts_at(problem, solution)
    held = [name for name, on_bound in zip(names, solution.at_bound, strict=False) if on_bound]
    return bounds_of_parts(parts, names), parts, held


def errors_of_channels(
    problem: RecordsProblem, theta: FloatArray, clocks: Mapping[str, float], held: Sequence[str] = ()
) -> list[dict[str, float]]:
    """For each clock and each scale, by how much it moves the parameters."""
    found = channel_errors(problem, theta, clocks, held=held)
    delayed = _clocks_of_delays(problem, clocks)
    # What a bound keeps from a delay the others take.
    of_clocks = [{**row, **exact} if held else exact for row, exact in zip(found, delayed, strict=False)]
    return [*of_clocks, *found[len(of_clocks) :]]


def _clocks_of_delays(problem: RecordsProblem, clocks: Mapping[str, float]) -> list[dict[str, float]]:
    """What clocks move where every output answers to one input, with a delay of its own: exactly that delay.

    Channels read between their samples would lose the edges of held inputs, which show a delay best. Empty elsewhere.
    """
    structure = problem.structure
    if not isinstance(structure, LinearStructure):
        return []
    delays = [str(entry) for entry in structure.input_delays]
    if not set(delays) <= set(problem.parameters.free) or len(set(delays)) < len(delays):
        return []
    answered = answers(structure)
    if not ((answered.sum(axis=0) == 1).all() and (answered.sum(axis=1) == 1).all()):
        return []
    step_s = 1.0 / min(record.sample_rate_hz for record in problem.records)
    of_output = [delays[int(row.argmax())] for row in answered]
    found = []
    for group in clock_groups(structure.inputs, structure.outputs):
        names = [*(structure.inputs[row] for row in group.inputs), *(structure.outputs[row] for row in group.outputs)]
        late_s = step_s * max(clocks.get(name, CLOCK_SAMPLES) for name in names)
        found.append(
            {**{delays[row]: late_s for row in group.inputs}, **{of_output[row]: -late_s for row in group.outputs}}
        )
    return found


def fit_each_record(problem: RecordsProblem, solution: Solution, records: TimeRecords) -> tuple[LogEstimate, ...]:
    """Each record fitted alone, where there are several that move every input, or why it was not.

    Parameters
    ----------
    problem, solution
        The fit of all together.
    records
        What was fitted, which the problem may hold in pieces.
    """
    free = problem.parameters.free
    if not repeated(records):
        return not_repeated(problem.structure.inputs, records, free)
    found, groups = [], _grouped(problem.records, records.data)
    for place, (segment, data) in enumerate(zip(records.segments, groups, strict=True)):
        _PROGRESS.info(f"fitting {segment.record} alone", extra={"done": place, "total": len(records.data)})
        try:
            found.append(_alone(replace(problem, records=data), solution, segment))
        except RotoridError as error:  # a record may be too short for what all show together
            found.append(nothing_alone(segment, free, error.came))
    return tuple(found)


def repeated(records: TimeRecords) -> bool:
    """Whether there are several records that each move every input."""
    return len(records.data) > 1 and all(bool(moving(data.inputs).all()) for data in records.data)


def not_repeated(inputs: Sequence[str], records: TimeRecords, parameters: Sequence[str]) -> tuple[LogEstimate, ...]:
    """Records that are not fitted alone, since not each moves every input; none, where there is only one."""
    if len(records.data) < 2:
        return ()
    still = {
        name_of_stretch(segment.record, segment.history.start_s): [
            name for name, moves in zip(inputs, moving(data.inputs), strict=True) if not moves
        ]
        for segment, data in zip(records.segments, records.data, strict=True)
    }
    first = next(name for name, names in still.items() if names)
    found = []
    for segment in records.segments:
        name = name_of_stretch(segment.record, segment.history.start_s)
        where = name if still[name] else first
        reason = f"{listed(still[where])} did not move in {where}; each record must move every input"
        found.append(nothing_alone(segment, parameters, reason))
    return tuple(found)


def estimate_of(segment: Segment, parameters: ParameterSet, bounds: Bounds) -> LogEstimate:
    """What one record alone says, named by its start."""
    name = name_of_stretch(segment.record, segment.history.start_s)
    return LogEstimate(record=name, values=parameters.values, stds=bounds.stds, random=bounds.random_stds)


def nothing_alone(segment: Segment, parameters: Sequence[str], reason: str) -> LogEstimate:
    """A record that alone says nothing of some parameters."""
    name = name_of_stretch(segment.record, segment.history.start_s)
    return LogEstimate(record=name, values={}, stds={}, missing=dict.fromkeys(parameters, reason.rstrip(".")))


def _grouped(parts: Sequence[TimeData], records: Sequence[TimeData]) -> Iterator[tuple[TimeData, ...]]:
    """The pieces of each record."""
    pieces = iter(parts)
    for record in records:
        group = [next(pieces)]
        while sum(piece.samples for piece in group) < record.samples:
            group.append(next(pieces))
        yield tuple(group)


def _alone(problem: RecordsProblem, solution: Solution, segment: Segment) -> LogEstimate:
    fit = _fitted(problem, solution.theta)
    random, parts, held = _random(fit.problem, fit.solution)
    return estimate_of(segment, fit.parameters, with_time_error(random, parts, held=held))


def _fitted(problem: RecordsProblem, start: FloatArray) -> Fit:
    if isinstance(problem, TimeProblem):
        own = own_starts(problem) if any(problem.parameters[name].starts for name in problem.parameters.free) else []
        return fit_output_error(problem, starts=[start, *own])
    from rotorid.fitting.time.prediction_error import InnovationsProblem, fit_with_noise

    assert isinstance(problem, InnovationsProblem)
    return fit_with_noise(problem, start)
