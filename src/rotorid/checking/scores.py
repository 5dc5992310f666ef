"""Scores of a linear model with fixed parameters on flights, by the same data and rules for any method.

:mod:`rotorid.identifying.comparison` and :mod:`rotorid.identifying.cross_validation` are made of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from rotorid.fits.time.fit import unknowns_of
from rotorid.fitting.time.output_error import TimeData
from rotorid.flights.flights import Flight
from rotorid.flights.segments import holds, require_channels, time_records
from rotorid.models.structure import LinearStructure
from rotorid.results.model import IdentifiedModel
from rotorid.settings.identifying import IdentifySettings
from rotorid.verification.fixed_parameters import FixedParameterScores, score_frozen
from rotorid.verification.sampled import band_pass


def score_flights(
    structure: LinearStructure,
    flights: Sequence[Flight],
    settings: IdentifySettings,
    horizon_s: float | None = None,
    band_rad_s: tuple[float, float] | None = None,
) -> tuple[FixedParameterScores, ...]:
    """Scores of a model on each maneuver, with its outputs that the logs hold.

    Without a band nothing is filtered, and noise counts as error for every model alike. With a band inputs and outputs
    pass the same zero-phase filter first, as in a verification: a model of frequency responses is judged where it was
    identified, and what it leaves out below its band, such as speed modes, is no fault of it.

    With a band and a finite horizon a filter without phase goes before the prediction: at every sample it has mixed in
    what comes after, over about one period of the edges of the band. Such a prediction is no longer made of the past
    alone. Its scores compare models, and are higher than those of a prediction in flight.

    Parameters
    ----------
    structure
        The model; its parameters have their values.
    settings
        Whose hold and shifts count.
    horizon_s
        How far ahead to predict, infinite for a simulation; by default what the poles of the model ask for.
    band_rad_s
        What to look at; everything by default.

    Raises
    ------
    InsufficientDataError
        A log lacks an input or all outputs, is too short, or moves no input.
    """
    there = _held_outputs(structure, flights)
    kept = structure if there == structure.outputs else structure.select(outputs=there)
    records = time_records(kept, flights, settings, every_input=False)
    # A record in which nothing moves says nothing of the model, and would be scored on its noise.
    moved = [part for part in zip(records.segments, records.data, strict=True) if part[1].inputs.any()]
    scores = (
        score_frozen(
            kept,
            kept.parameters.values,
            data if band_rad_s is None else _within(band_rad_s, data),
            horizon_s=horizon_s,
            # A filtered command is no longer constant between its samples.
            hold=records.hold if band_rad_s is None else "first",
            unknowns=unknowns_of(kept),
        )
        for _, data in moved
    )
    return tuple(
        replace(score, record=segment.record, time_s=score.time_s + segment.history.start_s)
        for score, (segment, _) in zip(scores, moved, strict=True)
    )


def _within(band_rad_s: tuple[float, float], data: TimeData) -> TimeData:
    """A record within a band: the model is linear, so filtered inputs drive it to filtered outputs."""
    filtered = band_pass(band_rad_s, data.sample_rate_hz, data.duration_s)
    inputs = filtered(data.inputs)
    return replace(data, inputs=inputs, outputs=filtered(data.outputs), before=inputs[:, 0])


def _held_outputs(structure: LinearStructure, flights: Sequence[Flight]) -> tuple[str, ...]:
    """Outputs of a model that all logs hold; refuses logs without an input, or without any output."""
    for flight in flights:
        require_channels(flight.record, structure.inputs)
    there = tuple(name for name in structure.outputs if all(holds(flight.record, name) for flight in flights))
    if not there:
        for flight in flights:
            require_channels(flight.record, structure.outputs)
    return there


def common_band(models: Sequence[IdentifiedModel]) -> tuple[float, float] | None:
    """The band that all models of frequency responses were fitted in; ``None`` without such, or without a common one.

    Examples
    --------
    >>> common_band(()) is None
    True
    """
    bands = [model.band_rad_s for model in models if model.fit.method == "frequency"]
    low = max((band[0] for band in bands if band), default=0.0)
    high = min((band[1] for band in bands if band), default=0.0)
    return (low, high) if 0.0 < low < high else None


def common_horizon_s(scores: Sequence[FixedParameterScores]) -> float | None:
    """The horizon over which all can be judged, where they were judged over different ones; ``None`` where they agree.

    Examples
    --------
    >>> common_horizon_s(()) is None
    True
    """
    horizons_s = {score.horizon_s for score in scores}
    return min(horizons_s, default=math.inf) if len(horizons_s) > 1 else None
