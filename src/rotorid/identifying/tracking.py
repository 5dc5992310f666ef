"""Tracking of a model through a flight: whether the gain at the start is valid to the end.

The gain of a rate model says payload, propellers and battery; the mean commands (trims) say a damaged propeller or a
center of gravity that moved, which the gain hardly shows: one of four propellers with 8 % less thrust changes the gain
by 2 % and the roll command at rest at once.
"""

from __future__ import annotations

import logging
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

import numpy as np

from rotorid.data.axes import RATE_OF
from rotorid.data.base import Immutable, ShownByDocument
from rotorid.data.findings import Finding, remark, warn, worst_first
from rotorid.data.record import AXES, FlightRecord, Maneuver, TimeHistory
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.flights.flights import Flight, longest_flight
from rotorid.flights.instruments import find_instrument
from rotorid.flights.same_vehicle import require_one_autopilot
from rotorid.flights.supports import unsupported
from rotorid.identifying.identification import identify
from rotorid.identifying.settings import TrackSettings
from rotorid.io.records import as_record
from rotorid.models.families import RATE_AXIS, rate_model_of
from rotorid.models.parameter import no_such
from rotorid.results.model import IdentifiedModel
from rotorid.results.provenance import Provenance, provenance
from rotorid.settings.option import as_settings
from rotorid.signal.clock import resample
from rotorid.signal.motors import motor_limits
from rotorid.signal.stretch import stretch
from rotorid.typing import Axis, FloatArray
from rotorid.verification.tracking import BAND_HZ, RATE_HZ, Tracking, require_length, track_gain

if TYPE_CHECKING:
    from rotorid.settings.option_types import TrackOptions

_PROGRESS = logging.getLogger("rotorid.progress")

_FULL: Mapping[str, float] = {"rad": 0.6, "rad/s": 3.0}
"""Set-point angle that counts as a full stick: 0.3 rad is half a stick."""

TRIM_S = 8.0
"""Length over which a mean is taken, to see whether a trim moved."""

_TRIM_SIGMAS = 4.0
"""Standard deviations by which it must have moved."""

_TRIM_LEAST = 0.004
"""Least standard deviation of such a mean."""

_TRIM_LASTS = 2
"""Means in a row that have to be off, and to the same side."""

_LEAST_LOST_S = 2.0
"""Less than that of a flight is lost at its ends."""


@dataclass(frozen=True, kw_only=True)
class TrimStep(Immutable):
    """A mean command that moved and stayed.

    Parameters
    ----------
    at_s
        When it was seen.
    before, after
        Means over the reference and since.
    std
        Of a mean over eight seconds in the reference.
    """

    channel: str
    at_s: float
    before: float
    after: float
    std: float


@dataclass(frozen=True, kw_only=True, eq=False)
class FlightTracking(ShownByDocument, Immutable):
    """A model through a flight.

    Parameters
    ----------
    log, model, axis
        What was followed.
    parameters, parameter_stds, parameter_units
        Of the model: name to value, to one standard deviation where it is known, and to unit.
    given
        Whether the model came from elsewhere and not from the beginning of this flight.
    instrument
        What stands for the stick.
    reference_s
        Start and stop of what all else is compared with.
    tracking
        The gain.
    trims
        Mean commands that moved.
    """

    log: str
    model: str
    axis: Axis
    parameters: Mapping[str, float]
    given: bool
    instrument: str
    reference_s: tuple[float, float]
    tracking: Tracking
    trims: tuple[TrimStep, ...]
    findings: tuple[Finding, ...]
    provenance: Provenance
    parameter_stds: Mapping[str, float | None] = field(default_factory=dict)
    parameter_units: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._set(parameters=self.parameters, parameter_stds=self.parameter_stds, parameter_units=self.parameter_units)


def track(
    record: FlightRecord | str | Path,
    model: str | IdentifiedModel = "rate.roll",
    *,
    settings: TrackSettings | None = None,
    **options: Unpack[TrackOptions],
) -> FlightTracking:
    """Follow the gain of a rate model through a flight.

    Parameters
    ----------
    record
        A log, or its file.
    model
        ``rate.roll``, ``rate.pitch`` or ``rate.yaw``, identified on the beginning of the flight; or a result of the
        same vehicle with such a rate: ``rate.*``, ``axis.*`` or ``hover.*``.
    settings
        Choices; everything has a default.
    **options
        Fields of :class:`rotorid.identifying.settings.TrackSettings`, which go before ``settings``.

    Raises
    ------
    InsufficientDataError
        The flight is too short, its stick rests, or its beginning does not support the model.
    UsageError, ModelError
        A choice is wrong.

    Examples
    --------
    >>> found = track("flight.ulg", "rate.roll")  # doctest: +SKIP
    >>> found.tracking.steps  # doctest: +SKIP
    """
    chosen = as_settings(TrackSettings, settings, options)
    log = as_record(record)
    name = model if isinstance(model, str) else model.name
    axis, chosen_axis = _axis(model, chosen.axis)
    findings = require_one_autopilot([model], [log]) if isinstance(model, IdentifiedModel) else ()
    if not isinstance(model, IdentifiedModel) and (error := unsupported([log], name)):
        raise error
    start_s, stop_s = longest_flight(log, or_whole=False)
    require_length(stop_s - start_s, chosen.first_s)
    maneuver = Maneuver(axis=axis, kind="other", start_s=start_s, stop_s=stop_s, origin="given")
    instrument = find_instrument([Flight(log, maneuver)], axis)
    if instrument is None:
        raise InsufficientDataError(
            f"the {axis} stick is not in {log.source.name}",
            needed="the stick, or a set-point that follows it",
            remedy="log the sticks or the set-points of the outer loops",
        )
    piece = _longest_piece(log, axis, instrument, start_s, stop_s)
    signals, left_out = _signals(log, piece, axis, instrument), tuple(_left_out(piece, start_s, stop_s))
    start_s, stop_s = piece.start_s, piece.start_s + piece.duration_s
    limits = motor_limits(log).during(((start_s, stop_s),)).remarks("the tracked flight")
    require_length(piece.duration_s, chosen.first_s, what="flight without a gap")
    fitted = model if isinstance(model, IdentifiedModel) else _reference(log, name, start_s, start_s + chosen.first_s)
    _PROGRESS.info(f"tracking {name}")
    tracking = track_gain(
        signals["command"],
        signals["rate"],
        signals["stick"],
        predict=partial(predicted, fitted, axis),
        thrust=signals.get("thrust"),
        thrust_exponent=chosen.thrust_exponent,
        start_s=start_s,
        reference_s=chosen.first_s,
        step_share=chosen.step_share,
    )
    return FlightTracking(
        log=log.source.name,
        model=name,
        axis=axis,
        parameters={key: estimate.value for key, estimate in fitted.parameters.items()},
        parameter_stds={key: estimate.std for key, estimate in fitted.parameters.items()},
        parameter_units={key: estimate.unit for key, estimate in fitted.parameters.items()},
        given=isinstance(model, IdentifiedModel),
        instrument=instrument,
        reference_s=(start_s, start_s + chosen.first_s),
        tracking=tracking,
        trims=tuple(_trims(log, start_s, stop_s, chosen.first_s)),
        # What was remarked on a model that was given is of other logs.
        findings=worst_first(
            [
                *log.findings,
                *chosen_axis,
                *left_out,
                *limits,
                *(findings if isinstance(model, IdentifiedModel) else _reference_remarks(fitted)),
            ]
        ),
        provenance=provenance([log], chosen),
    )


def _axis(model: str | IdentifiedModel, chosen: Axis | None) -> tuple[Axis, list[Finding]]:
    """Whose rate is followed, with a remark where others could be.

    Raises
    ------
    UsageError, ModelError
        The model has no such rate.
    """
    if isinstance(model, IdentifiedModel):
        name, axes = model.name, model.rate_axes
    else:
        name, own = model, RATE_AXIS.get(model)
        if own is None or own not in RATE_OF:
            raise no_such("model to track", model, [rate_model_of(axis) for axis in RATE_OF])
        axes = (own,)
    if not axes:
        raise UsageError(
            f"{name} has no rate by its command",
            needed="a result of rate.*, axis.* or hover.* with p, q or r among its outputs",
        )
    if chosen is not None and chosen not in axes:
        raise UsageError(f"{name} has no rate of {chosen}", needed=f"--axis {' or '.join(axes)}")
    axis = chosen or axes[0]
    others = " or ".join(f"--axis {other}" for other in axes if other != axis)
    if chosen is not None or not others:
        return axis, []
    return axis, [remark("unused_choice", axis, f"{name} was tracked in {axis}. For another axis, add {others}.")]


def _reference_remarks(reference: IdentifiedModel) -> Iterator[Finding]:
    """Remarks on a model that was made on the way, without advice on options that only identify has."""
    for finding in reference.findings:
        words = re.sub(r" ?\([^()]{1,80}\)", lambda aside: "" if "--" in aside[0] else aside[0], finding.message)
        kept = [sentence for sentence in re.split(r"(?<=[.;]) ", words) if "--" not in sentence]
        if kept:
            yield replace(finding, message=re.sub(r";$", ".", " ".join(kept)))


def _reference(record: FlightRecord, name: str, start_s: float, stop_s: float) -> IdentifiedModel:
    """A model of the beginning of a flight, over the band in which it will be used."""
    part = stretch(record, start_s, stop_s)
    low, high = (2.0 * math.pi * edge for edge in BAND_HZ)
    try:
        return identify(part, name, band_rad_s=(low, high))
    except InsufficientDataError as error:
        raise InsufficientDataError(
            f"the first {stop_s - start_s:.0f} s of the flight are no reference for {name}: {error.came}",
            needed=error.needed,
            remedy=f"use a longer reference with --first, or give a result of {name} with --model RESULT",
            findings=error.findings,
        ) from error


def _names(record: FlightRecord, axis: Axis, instrument: str) -> dict[str, str]:
    names = {"command": f"{axis}_command", "rate": RATE_OF[axis], "stick": instrument}
    return names | ({"thrust": "thrust_command"} if "thrust_command" in record.channel_names else {})


def _longest_piece(record: FlightRecord, axis: Axis, instrument: str, start_s: float, stop_s: float) -> TimeHistory:
    """Command, rate, stick and thrust on one clock over the longest piece of a flight without a gap.

    Raises
    ------
    InsufficientDataError
        There is none.
    """
    names = _names(record, axis, instrument)
    return resample(
        record,
        channels=(names["command"], names["rate"]),
        auxiliary=[names[key] for key in ("stick", "thrust") if key in names],
        start_s=start_s,
        stop_s=stop_s,
        sample_rate_hz=RATE_HZ,
    ).longest


def _signals(record: FlightRecord, piece: TimeHistory, axis: Axis, instrument: str) -> dict[str, FloatArray]:
    signals = {key: np.array(piece[name]) for key, name in _names(record, axis, instrument).items()}
    signals["stick"] = signals["stick"] / _FULL.get(record[instrument].unit, 1.0)
    return signals


def _left_out(piece: TimeHistory, start_s: float, stop_s: float) -> Iterator[Finding]:
    """The warning on parts of a flight lost by gaps."""
    end_s = piece.start_s + piece.duration_s
    lost_s = (stop_s - start_s) - piece.duration_s
    if lost_s > _LEAST_LOST_S:
        yield warn(
            "gap",
            "flight",
            f"Tracked from {piece.start_s:.1f} to {end_s:.1f} s only. Gaps in the log cut off the other {lost_s:.0f} s "
            f"of the flight from {start_s:.1f} to {stop_s:.1f} s.",
            lost_s=lost_s,
        )


def predicted(model: IdentifiedModel, axis: Axis, command: FloatArray) -> FloatArray:
    """Rate of a model from its command at the rate of the tracker: the bounded motion, of unstable models too."""
    count = 2 * command.size
    omega = 2.0 * np.pi * np.fft.rfftfreq(count, 1.0 / RATE_HZ)
    response = model.rate_response(axis, np.maximum(omega, 1e-6))
    return np.asarray(np.fft.irfft(np.fft.rfft(command, count) * response, count)[: command.size])


def _trims(record: FlightRecord, start_s: float, stop_s: float, first_s: float) -> Iterator[TrimStep]:
    """Mean commands that moved by more than those of the reference scatter, and stayed."""
    for axis in AXES[:3]:
        name = f"{axis}_command"
        if name not in record.channel_names:
            continue
        track_ = record[name]
        kept = (track_.time_s >= start_s) & (track_.time_s < stop_s) & np.isfinite(track_.values)
        number = ((track_.time_s[kept] - start_s) // TRIM_S).astype(np.int64)
        if not number.size:
            continue
        counts = np.bincount(number)
        # A gap has no mean, and a few samples next to it do not represent eight seconds.
        whole = counts >= 0.5 * np.median(counts[counts > 0])
        means = np.bincount(number, track_.values[kept]) / np.maximum(counts, 1)
        first = max(int(first_s // TRIM_S), 3)
        reference = means[:first][whole[:first]]
        if means.size < first + _TRIM_LASTS or reference.size < 3:
            continue
        before = float(np.mean(reference))
        std = max(float(np.std(reference, ddof=1)), _TRIM_LEAST)
        off = whole & (np.abs(means - before) > _TRIM_SIGMAS * std * math.sqrt(1.0 + 1.0 / reference.size))
        for k in range(first, means.size - _TRIM_LASTS + 1):
            part = slice(k, k + _TRIM_LASTS)
            if off[part].all() and (np.sign(means[part] - before) == np.sign(means[k] - before)).all():
                after = float(np.mean(means[k:][whole[k:]]))
                yield TrimStep(
                    channel=name, at_s=start_s + (k + _TRIM_LASTS) * TRIM_S, before=before, after=after, std=std
                )
                break
