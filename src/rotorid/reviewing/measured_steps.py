"""Measured step responses of loops, beside those of models of the same loops: the answer of a review, in its room."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from rotorid.data.record import FlightRecord
from rotorid.errors import RotoridError
from rotorid.flights.whole_flights import flown
from rotorid.flying.step_responses import MeasuredStep, StepPair
from rotorid.reviewing.loops import LOOPS, Loop, loop_of


def with_measured(pairs: Sequence[StepPair], records: Sequence[FlightRecord]) -> tuple[StepPair, ...]:
    """Step responses of models with those that logs show of the same loops.

    A loop is a pair of a state and its set-point; other pairs, such as a rate and a command, stay as they are.

    Parameters
    ----------
    pairs
        Of models.
    records
        Logs, each of which is asked on its own.

    Examples
    --------
    >>> with_measured((), ())
    ()
    """
    loops = {(loop.reference, loop.name): loop for loop in LOOPS}
    return tuple(
        replace(pair, measured=tuple(measured_step(record, loop) for record in records))
        if (loop := loops.get((pair.input, pair.output))) is not None
        else pair
        for pair in pairs
    )


def measured_step(record: FlightRecord, loop: Loop) -> MeasuredStep:
    """The step response of a loop in a log, or why the log does not show it."""
    nothing = MeasuredStep(log=record.source.name)
    try:
        review, missing = loop_of(flown(record), loop)
    except RotoridError as error:
        return replace(nothing, why=f"{error.reason.rstrip('.')}.")
    if review is None or review.step is None:
        whys = [gap.why for gap in missing if gap.why]
        return replace(nothing, why=whys[0] if whys else f"The {loop.words} was not controlled.")
    curve = review.step
    return MeasuredStep(
        log=record.source.name,
        time_s=curve.time_s,
        response=curve.value,
        lower=curve.lower,
        upper=curve.upper,
        rise=review.numbers.get("rise_time_s"),
    )
