"""From selected maneuvers to frequency responses: windows, grid, joint and direct estimates.

Logs that hold different channels are estimated apart and joined. Where every input has an instrument the estimate is
the joint input–output one, which feedback does not bias, with the direct one beside it; :func:`feedback_bias` says how
far the two differ. Known filters of the autopilot in front of an output can be taken off the measured response
(:func:`without_known_filters`).
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import NamedTuple, TypeAlias

import numpy as np

from rotorid.autopilots.filters import KnownFilter
from rotorid.data.base import cached_by_value
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.record import AXES, STANDARD_UNITS, FlightRecord, Maneuver, TimeHistory
from rotorid.data.response import FrequencyResponse
from rotorid.errors import UsageError
from rotorid.fitting.frequency.problem import usable_points
from rotorid.flights.consistency import data_quality, sensor_agreement, sensor_errors
from rotorid.flights.controllers import LoggedController, logged_controller
from rotorid.flights.flights import Flight, SteadyDrag
from rotorid.flights.instruments import (
    band_of_instrument,
    by_instruments,
    choose_instruments,
    excited_band,
    is_command,
    is_free,
    no_instrument,
    open_loop,
)
from rotorid.flights.segments import cut, histories, holds, require_known, source_of, with_surroundings
from rotorid.flights.thrust_slope import curvature, with_slope_changes
from rotorid.flights.tilt_errors import logged_angles, with_tilt_errors
from rotorid.flights.unchecked import unchecked_scales, with_unchecked_errors
from rotorid.results.segment import Segment
from rotorid.results.summary import RemovedFilters
from rotorid.settings.measuring import CompositionChoice, MeasureSettings, TaperChoice
from rotorid.signal.autopilot_filters import filter_findings, given_filters, known_filters
from rotorid.signal.stamps import clock_error_s, largest_clock_s
from rotorid.spectral.composite import Composition
from rotorid.spectral.derived import corrected
from rotorid.spectral.estimate import Diagnostics, Known, measured_spectra, response_from
from rotorid.spectral.joined import by_input, joined_diagnostics, joined_responses
from rotorid.spectral.spectra import Spectra
from rotorid.spectral.windows import (
    ENDING,
    HALF_SINE,
    HANN,
    Taper,
    WindowPlan,
    band_of,
    excited_to_rad_s,
    grid_rad_s,
    margin_s,
    plan_of_records,
    trusted_to_rad_s,
)
from rotorid.typing import BoolArray, FloatArray

_PROGRESS = logging.getLogger("rotorid.progress")


class Measurement(NamedTuple):
    """How records that hold the same channels were measured, so that it can be repeated with other outputs.

    Parameters
    ----------
    records
        Maneuvers on one clock, with what lies around them.
    inputs, outputs, instruments
        Channels; no instruments for a direct estimate.
    omega_rad_s
        Grid that was asked for, shape ``(f,)``.
    windows
        Windows of each input.
    """

    records: tuple[TimeHistory, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    instruments: tuple[str, ...]
    omega_rad_s: FloatArray
    windows: Mapping[str, WindowPlan]

    def repeated(self, records: Sequence[TimeHistory], settings: MeasureSettings, known: Known) -> FrequencyResponse:
        """The response of records without a known response, and that, by the same windows, grid and instruments."""
        channels = self.inputs, self.outputs, self.instruments
        spectra = _spectra(records, *channels, self.omega_rad_s, self.windows, settings)
        return _respond(spectra, *channels, self.windows, settings, known)[0]


@dataclass(frozen=True, kw_only=True, eq=False)
class Measured:
    """Measured responses and their source.

    Parameters
    ----------
    response
        The estimate to fit.
    direct
        The direct estimate, when ``response`` is a joint one.
    segments
        The data behind them.
    asked_rad_s
        Band that was looked at.
    excited_rad_s
        Input to the highest frequency that its sweeps reached; infinite where other excitations leave that to the
        coherence.
    diagnostics
        What stands behind ``response``.
    lowest_rad_s
        Input to the lowest frequency that its own windows reach, where windows were chosen by input.
    removed
        Outputs that known filters were taken off, with these filters.
    measurements
        How each group of records was measured.
    """

    response: FrequencyResponse
    direct: FrequencyResponse | None
    diagnostics: Diagnostics
    segments: tuple[Segment, ...]
    asked_rad_s: tuple[float, float]
    excited_rad_s: Mapping[str, float]
    findings: tuple[Finding, ...]
    lowest_rad_s: Mapping[str, float] = field(default_factory=dict)
    removed: Mapping[str, tuple[KnownFilter, ...]] = field(default_factory=dict)
    measurements: tuple[Measurement, ...] = ()

    @property
    def unfiltered(self) -> tuple[str, ...]:
        """Outputs that known filters were taken off."""
        return tuple(self.removed)

    @property
    def filters_removed(self) -> dict[str, RemovedFilters]:
        """The same in words and numbers."""
        return {
            name: RemovedFilters(
                filters=tuple(known.name for known in chain), delay_s=sum(known.delay_s for known in chain)
            )
            for name, chain in self.removed.items()
        }

    @property
    def excited_to_rad_s(self) -> float:
        """Highest frequency that the sweeps of any input reached."""
        return max(self.excited_rad_s.values())

    @property
    def trusted_rad_s(self) -> tuple[float, float]:
        """The requested band, limited to that of the sweeps.

        Above a sweep there is coherence too: tapers leak, and feedback turns noise into input. It means nothing. Just
        below its end a response is biased, because there the sweep fills one flank of the spectral line only: with a
        delay of 40 ms and windows of 2.5 s by 3° and 2 %. So the line of the shortest window must lie inside.
        """
        return self._trusted_to(self.excited_to_rad_s)

    def trusted_points(self, data: FrequencyResponse, coherence: float) -> BoolArray:
        """Trusted points of a response, each input within the band of its own sweeps.

        Parameters
        ----------
        data
            The estimate or the one beside it.
        coherence
            The least that counts.

        Returns
        -------
        numpy.ndarray
            Shape ``(y, u, f)``.
        """
        bands = {name: self._trusted_to(top) for name, top in self.excited_rad_s.items()}
        bands = {name: (max(low, self.lowest_rad_s.get(name, low)), high) for name, (low, high) in bands.items()}
        each = [
            usable_points(data, coherence=coherence, band_rad_s=bands[name])[:, u] for u, name in enumerate(data.inputs)
        ]
        return np.stack(each, axis=1)

    def _trusted_to(self, top_rad_s: float) -> tuple[float, float]:
        low, high = self.asked_rad_s
        return low, min(high, trusted_to_rad_s(top_rad_s, self.response.windows_s))


def measure(
    flights: Sequence[Flight],
    *,
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    settings: MeasureSettings,
    also: Sequence[str] = (),
) -> Measured:
    """Frequency responses of the outputs to the inputs over all maneuvers together.

    Joint input–output whenever every input has an instrument, and the direct estimate beside it. Channels in ``also``
    are taken along where every record has them. Records that hold some of the channels each are estimated apart, and
    each response is that of the records that hold it.

    Raises
    ------
    InsufficientDataError
        A channel is missing, or the maneuvers are too short for the band.
    UsageError
        A shift is of a channel that takes no part, or longer than a maneuver.
    """
    own = MeasureSettings(**{choice.name: getattr(settings, choice.name) for choice in fields(MeasureSettings)})
    record = flights[0].record
    if any(flight.record is not record for flight in flights):
        return _measured_together(flights, tuple(inputs), tuple(outputs), own, tuple(also))
    flown = tuple((flight.maneuver, flight.steady_drag) for flight in flights)
    return _measured_alone(record, flown, tuple(inputs), tuple(outputs), own, tuple(also))


@cached_by_value
def _measured_alone(
    record: FlightRecord,
    flown: tuple[tuple[Maneuver, SteadyDrag | None], ...],
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    settings: MeasureSettings,
    also: tuple[str, ...],
) -> Measured:
    """Responses of maneuvers of one log: a fit asks for them, its check, its scatter and the loops of a review."""
    flights = [Flight(record, maneuver, drag) for maneuver, drag in flown]
    return _measured_together(flights, inputs, outputs, settings, also)


def _measured_together(
    flights: Sequence[Flight],
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    settings: MeasureSettings,
    also: tuple[str, ...],
) -> Measured:
    groups, left = _drop_mixed_inputs(_groups(flights, inputs, outputs, settings))
    prepared = [_prepare(group, settings, also) for group in groups]
    require_known(settings.shifts, [name for item in prepared for name in item.channels])
    band = settings.band_rad_s or _common_band(prepared)
    longest = max((plan for item in prepared for plan in item.windows.values()), key=lambda plan: max(plan.lengths_s))
    omega = grid_rad_s(band, longest)
    _PROGRESS.info("frequency responses")
    parts = [_measured(item, omega, band, settings) for item in prepared]
    whole = parts[0] if len(parts) == 1 and not left else _joined(parts, groups, inputs, outputs)
    units = {
        name: unit
        for name in (*inputs, *outputs)
        for unit in {flight.record.unit_of(name) for flight in flights if name in flight.record.channel_names}
        if unit != STANDARD_UNITS.get(name, "1")
    }
    return replace(
        whole,
        response=replace(whole.response, units=units),
        direct=whole.direct and replace(whole.direct, units=units),
        findings=(*left, *whole.findings),
    )


class _Group(NamedTuple):
    """Maneuvers of records that hold the same channels of a response."""

    flights: tuple[Flight, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    instruments: tuple[str, ...]
    unmodeled_inputs: tuple[str, ...] = ()


class _Prepared(NamedTuple):
    """A group on one clock, with the windows of each input."""

    group: _Group
    segments: tuple[Segment, ...]
    channels: tuple[str, ...]
    band_rad_s: tuple[float, float]
    windows: Mapping[str, WindowPlan]
    findings: tuple[Finding, ...]


def _groups(
    flights: Sequence[Flight], inputs: tuple[str, ...], outputs: tuple[str, ...], settings: MeasureSettings
) -> list[_Group]:
    """Maneuvers by what their records hold; all in one group where all hold the same.

    An output is estimated from all records that hold it beside the same inputs.
    """
    by_channels: dict[tuple[str, ...], list[Flight]] = {}
    for flight in flights:
        by_channels.setdefault(tuple(name for name in inputs if holds(flight.record, name)), []).append(flight)
    by_output: dict[tuple[tuple[str, ...], tuple[int, ...]], list[str]] = {}
    for sources, every in by_channels.items():
        for name in outputs:
            rows = tuple(row for row, flight in enumerate(every) if holds(flight.record, name))
            if sources and rows:
                by_output.setdefault((sources, rows), []).append(name)
    nowhere = [name for name in (*inputs, *outputs) if not any(holds(flight.record, name) for flight in flights)]
    if nowhere or len(by_output) == 1:
        return _by_instruments(flights, inputs, outputs, settings)
    given = settings.instruments if len(settings.instruments) == len(inputs) else ()
    chosen = dict(zip(inputs, given, strict=False))
    groups = []
    for (sources, rows), answers in by_output.items():
        own = [by_channels[sources][row] for row in rows]
        own = [flight for flight in own if not _of_axis_of(flight, inputs) or _of_axis_of(flight, sources)]
        # What only feedback moves, and nothing free of feedback separates, cannot be accounted for.
        swept = tuple(name for name in sources if _flown_for(own, name) or chosen.get(name))
        wanted = replace(settings, instruments=tuple(chosen[name] for name in swept if name in chosen))
        if own and swept:
            instruments = choose_instruments(own, swept, answers, wanted)
            unmodeled = tuple(name for name in inputs if name not in swept)
            groups.append(_Group(tuple(own), swept, tuple(answers), instruments, unmodeled))
    return groups


def _by_instruments(
    flights: Sequence[Flight], inputs: tuple[str, ...], outputs: tuple[str, ...], settings: MeasureSettings
) -> list[_Group]:
    """Maneuvers of logs that hold the same channels, those of each instrument by themselves."""
    parts = by_instruments(flights, inputs, settings)
    groups = []
    for part in parts:
        swept = inputs if len(parts) == 1 else tuple(name for name in inputs if _flown_for(part, name))
        unmodeled = tuple(name for name in inputs if name not in swept)
        groups.append(_Group(part, swept, outputs, choose_instruments(part, swept, outputs, settings), unmodeled))
    return groups


def _drop_mixed_inputs(groups: Sequence[_Group]) -> tuple[list[_Group], tuple[Finding, ...]]:
    """Groups without those in which an input moved that is logged and cannot be separated, where others do without.

    Feedback moves such an input in step with the one that was swept: the response would hold both.
    """
    mixed = [
        group
        for group in groups
        if any(holds(flight.record, name) for name in group.unmodeled_inputs for flight in group.flights)
    ]
    clean = [group for group in groups if group not in mixed]
    covered = {name for group in clean for name in group.inputs}
    left = [group for group in mixed if covered.issuperset(group.inputs)]
    return [group for group in groups if group not in left], tuple(_left_out(group) for group in left)


def _left_out(group: _Group) -> Finding:
    names = ", ".join(dict.fromkeys(flight.record.source.name for flight in group.flights))
    outputs, moved = ", ".join(group.outputs), " and ".join(group.unmodeled_inputs)
    return warn(
        "joined_records",
        names,
        f"{outputs} of {names} {'was' if len(group.outputs) == 1 else 'were'} left out: {moved} moved together "
        f"with {' and '.join(group.inputs)}, and no other log with {outputs} separates them.",
    )


def _of_axis_of(flight: Flight, inputs: Sequence[str]) -> bool:
    """Whether a maneuver was flown for one of some commands."""
    return any(name == f"{flight.axis}_command" for name in inputs)


def _flown_for(flights: Sequence[Flight], input: str) -> bool:
    return not is_command(input) or any(_of_axis_of(flight, (input,)) for flight in flights)


def _prepare(group: _Group, settings: MeasureSettings, also: Sequence[str]) -> _Prepared:
    flights, instruments = group.flights, group.instruments
    channels = (*group.inputs, *group.outputs)
    extra = [n for n in also if n not in channels and all(n in flight.record.channel_names for flight in flights)]
    followers = tuple(dict.fromkeys((*instruments, *_other_commands(flights, group.inputs), *extra)))
    # Without an instrument the quiet time would only add what feedback makes of gusts.
    wider = flights
    if instruments:
        wider = with_surroundings(flights, _margin_s(flights, settings), (*channels, *instruments))
    segments, findings = cut(wider, channels=channels, followers=followers, shifts=settings.shifts)
    records = histories(segments)
    band = settings.band_rad_s or default_band(flights, records[0].sample_rate_hz)
    windows = _windows(records, band, settings, group.inputs)
    return _Prepared(group, segments, (*channels, *followers), band, windows, findings)


def _clock_error_s(flights: Sequence[Flight], channels: Sequence[str]) -> float | None:
    """What stamps show of the clocks of all flights; ``None`` where one of them shows nothing."""
    return largest_clock_s(
        clock_error_s(flight.record, channels, [(flight.maneuver.start_s, flight.maneuver.stop_s)])
        for flight in flights
    )


def _common_band(prepared: Sequence[_Prepared]) -> tuple[float, float]:
    """From the lowest to the highest frequency of any group that the rates of all groups allow."""
    low = min(item.band_rad_s[0] for item in prepared)
    high = max(item.band_rad_s[1] for item in prepared)
    carried = min(item.segments[0].history.sample_rate_hz for item in prepared)
    return low, min(high, 0.8 * np.pi * carried)


def _measured(
    prepared: _Prepared, omega_rad_s: FloatArray, band_rad_s: tuple[float, float], settings: MeasureSettings
) -> Measured:
    """Responses of one group on a grid."""
    (flights, inputs, outputs, instruments, _), segments, windows = prepared.group, prepared.segments, prepared.windows
    records = histories(segments)
    agreement = sensor_agreement(flights)
    errors, unchecked = unchecked_scales(agreement, outputs, sensor_errors(agreement, outputs))
    spectra = _spectra(records, inputs, outputs, instruments, omega_rad_s, windows, settings)
    direct, diagnostics = _respond(spectra, inputs, outputs, (), windows, settings)
    joint = None
    if instruments:
        joint, diagnostics = _respond(spectra, inputs, outputs, instruments, windows, settings)
    # An input that is the excitation itself needs no instrument, nor does one that comes straight from the stick.
    free = open_loop(flights, *inputs) or all(is_free(flights, name) for name in inputs)
    unknown = settings.estimate == "auto" and not instruments and not free
    known = replace(joint or direct, sensor_errors=errors, clock_error_s=_clock_error_s(flights, (*inputs, *outputs)))
    bands = _bands_of_sticks(flights, inputs, instruments)
    bent = 0.0
    if any(is_command(name) for name in inputs):
        bent = curvature(
            [flight.record for flight in flights], [flight for flight in flights if flight.maneuver.axis == "thrust"]
        )
        known = with_tilt_errors(with_slope_changes(known, records, bent), flights, segments, bent)
    angles = logged_angles(flight.record for flight in flights)
    known, left = with_unchecked_errors(known, angles=angles, curvature=bent, feedback=unknown)
    measured = Measured(
        response=known,
        direct=direct if joint else None,
        diagnostics=diagnostics,
        segments=segments,
        asked_rad_s=band_rad_s,
        excited_rad_s={
            name: min(excited_to_rad_s(_of_input(flights, name)), bands.get(name, _ANY)[1]) for name in inputs
        },
        lowest_rad_s={
            name: max(windows[name].lowest_rad_s if name in settings.input_windows_s else 0.0, bands.get(name, _ANY)[0])
            for name in inputs
            if name in settings.input_windows_s or bands.get(name, _ANY)[0] > 0.0
        },
        findings=(
            *prepared.findings,
            *data_quality(flights, segments, inputs, agreement),
            *(finding for plan in _different(windows) for finding in plan.findings),
            *((no_instrument(inputs),) if unknown else ()),
            *unchecked,
            *left,
            *_band_outside_excitation(settings.band_rad_s, flights, inputs),
        ),
        measurements=(Measurement((*records,), inputs, outputs, tuple(instruments), omega_rad_s, windows),),
    )
    return without_known_filters(measured, flights) if settings.correct_filters else measured


_ANY = (0.0, np.inf)


def _bands_of_sticks(
    flights: Sequence[Flight], inputs: Sequence[str], instruments: Sequence[str]
) -> dict[str, tuple[float, float]]:
    """Inputs that a stick excites, to the band in which it has power; a program's signal has it all over its own."""
    return {
        name: band_of_instrument(_moved_by(flights, name), instrument)
        for name, instrument in zip(inputs, instruments, strict=False)
        if instrument.endswith("_stick")
    }


_LEAST_KEPT = 0.4
"""Share of the octaves that were excited, below which a band that was given is remarked on."""


def _band_outside_excitation(
    band_rad_s: tuple[float, float] | None, flights: Sequence[Flight], inputs: Sequence[str] = ()
) -> tuple[Finding, ...]:
    """A remark where a band that was given drops most of what was excited, as one in Hz does that is taken as rad/s.

    Of a test signal and the input that it moves the one counts of which the band keeps more.
    """
    if band_rad_s is None:
        return ()
    found = [
        (_octaves_kept(band, band_rad_s) / octaves, band, octaves)
        for band in _excited_bands(flights, inputs)
        if (octaves := _octaves_kept(band, band)) > 0.0
    ]
    share, (low, high), octaves = max(found, default=(1.0, band_rad_s, 1.0))
    if share >= _LEAST_KEPT:
        return ()
    hertz = 2.0 * np.pi * band_rad_s[0], 2.0 * np.pi * band_rad_s[1]
    meant = _octaves_kept((low, high), hertz) / octaves > share
    proposed = f"{band_rad_s[0]:g}:{band_rad_s[1]:g}Hz" if meant else f"{low:.3g}:{high:.3g}"
    return (
        warn(
            "band_beside_excitation",
            "--band",
            f"The fitted band ({band_rad_s[0]:.3g}–{band_rad_s[1]:.3g} rad/s) contains "
            f"{f'{100.0 * share:.0f} %' if share else 'none'} of the excitation ({low:.3g}–{high:.3g} rad/s). "
            f"{'If you meant Hz, use' if meant else 'To use all of it, give'} --band {proposed}.",
            kept_percent=100.0 * share,
        ),
    )


def _octaves_kept(excited_rad_s: tuple[float, float], band_rad_s: tuple[float, float]) -> float:
    """Octaves that two bands share."""
    low, high = (max(excited_rad_s[0], band_rad_s[0]), min(excited_rad_s[1], band_rad_s[1]))
    return float(np.log2(high / low)) if high > low > 0.0 else 0.0


def _excited_bands(flights: Sequence[Flight], inputs: Sequence[str]) -> list[tuple[float, float]]:
    """What was excited: from sweeps by their own band, from binary signals and steps by the power of each channel.

    The half periods of the latter are no band, and behind a controller the input has power where its set-point has
    little: that of steps of an angle lies octaves below the torque that follows them.
    """
    bounded = [flight for flight in flights if flight.maneuver.band_rad_s is not None]
    others = [flight for flight in bounded if flight.maneuver.kind not in ENDING]
    bands = [flight.maneuver.band_rad_s for flight in bounded if flight.maneuver.kind in ENDING]
    names = {name for flight in others for name in (flight.maneuver.signal, *inputs) if name}
    own = [[*bands, excited_band(_moved_by(others, name), name)] for name in names] or [bands]
    known = [[band for band in each if band is not None] for each in own]
    return [(min(band[0] for band in each), max(band[1] for band in each)) for each in known if each]


def _moved_by(flights: Sequence[Flight], name: str) -> Sequence[Flight]:
    """The maneuvers of an input's own axis; all, where it has none."""
    return [flight for flight in flights if _of_axis_of(flight, (name,))] or flights


def _joined(
    parts: Sequence[Measured], groups: Sequence[_Group], inputs: tuple[str, ...], outputs: tuple[str, ...]
) -> Measured:
    """Responses of several groups as one, each pair from the records that hold it."""
    response = joined_responses([part.response for part in parts], inputs=inputs, outputs=outputs)
    direct = [part.direct for part in parts if part.direct is not None]
    measured = [(part.response, part.diagnostics) for part in parts]
    tops = {name: [part.excited_rad_s[name] for part in parts if name in part.excited_rad_s] for name in inputs}
    lows = {name: [part.lowest_rad_s[name] for part in parts if name in part.lowest_rad_s] for name in inputs}
    return Measured(
        response=replace(
            response,
            clock_error_s=largest_clock_s(part.response.clock_error_s for part in parts),
            sensor_errors=_largest_errors(parts, response.outputs),
            slope_changes=_largest(parts, response, lambda response: response.slope_changes),
            lean_errors=_largest(parts, response, lambda response: response.lean_errors),
            unchecked_errors=_unchecked(parts, response),
        ),
        direct=joined_responses(direct, inputs=inputs, outputs=outputs) if len(direct) == len(parts) else None,
        diagnostics=joined_diagnostics(measured, response),
        segments=tuple(segment for part in parts for segment in part.segments),
        asked_rad_s=parts[0].asked_rad_s,
        excited_rad_s={name: max(own, default=np.inf) for name, own in tops.items()},
        lowest_rad_s={name: min(own) for name, own in lows.items() if own},
        removed={name: chain for part in parts for name, chain in part.removed.items()},
        measurements=tuple(measurement for part in parts for measurement in part.measurements),
        findings=(
            *_each_once(finding for part in parts for finding in part.findings),
            *(_unmodeled_inputs(group) for group in groups if group.unmodeled_inputs),
            *_several_instruments(groups, inputs),
        ),
    )


def _largest_errors(parts: Sequence[Measured], outputs: Sequence[str]) -> FloatArray | None:
    """How far each output disagrees with other sensors, where it does most."""
    if all(part.response.sensor_errors is None for part in parts):
        return None
    errors = np.zeros((len(outputs), 2))
    for part in parts:
        if part.response.sensor_errors is not None:
            for name, own in zip(part.response.outputs, part.response.sensor_errors, strict=True):
                if name in outputs:
                    errors[outputs.index(name)] = np.maximum(errors[outputs.index(name)], own)
    return errors


def _unchecked(parts: Sequence[Measured], joined: FrequencyResponse) -> FloatArray | None:
    """Errors that no log shows; an error shown by one group counts for this input."""
    known = np.full((2, len(joined.inputs), joined.omega_rad_s.size), np.inf)
    for part in parts:
        own, shape = part.response.unchecked_errors, (2, len(part.response.inputs), part.response.omega_rad_s.size)
        for u, name in enumerate(part.response.inputs):
            row = joined.inputs.index(name)
            for kind, errors in enumerate(np.zeros(shape) if own is None else own):
                there = np.interp(joined.omega_rad_s, part.response.omega_rad_s, errors[u])
                known[kind, row] = np.minimum(known[kind, row], there)
    return known if known.any() else None


def _largest(
    parts: Sequence[Measured], joined: FrequencyResponse, of: Callable[[FrequencyResponse], FloatArray | None]
) -> FloatArray | None:
    """Knowledge about each input over frequency, ``(u, f)``, from the group in which it varies most."""
    if all(of(part.response) is None for part in parts):
        return None
    known = np.zeros((len(joined.inputs), joined.omega_rad_s.size))
    for part in parts:
        rows = of(part.response)
        if rows is not None:
            for name, own in zip(part.response.inputs, rows, strict=True):
                row, interpolated = (
                    joined.inputs.index(name),
                    np.interp(joined.omega_rad_s, part.response.omega_rad_s, own),
                )
                known[row] = interpolated if np.ptp(interpolated) > np.ptp(known[row]) else known[row]
    return known


def _each_once(findings: Iterable[Finding]) -> list[Finding]:
    once: list[Finding] = []
    for finding in findings:
        if finding not in once:
            once.append(finding)
    return once


def _several_instruments(groups: Sequence[_Group], inputs: Sequence[str]) -> Iterable[Finding]:
    """A remark for each input that some maneuvers show with another instrument than others."""
    for name in inputs:
        used = {
            instrument: ", ".join(
                f"{flight.maneuver.start_s:.1f} s of {flight.record.source.name}" for flight in group.flights
            )
            for group in groups
            for source, instrument in zip(group.inputs, group.instruments, strict=False)
            if source == name
        }
        if len(used) > 1:
            instrument_words = "; ".join(f"{instrument} at {flown}" for instrument, flown in used.items())
            yield remark(
                "joined_records",
                name,
                f"The maneuvers of {name} have several instruments ({instrument_words}). Each was measured with "
                "its own, and the responses were averaged by their variances.",
            )


def _unmodeled_inputs(group: _Group) -> Finding:
    names = ", ".join(dict.fromkeys(flight.record.source.name for flight in group.flights))
    missing, swept = " and ".join(group.unmodeled_inputs), " and ".join(group.inputs)
    return warn(
        "joined_records",
        names,
        f"{names} shows responses to {swept} only; {missing} moved together with "
        f"{'it' if len(group.inputs) == 1 else 'them'}, so its effect is included in them. Log the commands of "
        "all axes.",
    )


_COMPOSITIONS: Mapping[CompositionChoice, Composition] = {
    "variance": "minimum_variance",
    "least_squares": "least_squares",
    "weights": "weights",
}
_TAPERS: Mapping[TaperChoice, Taper] = {"hann": HANN, "half_sine": HALF_SINE}


_Spectra: TypeAlias = Mapping[tuple[float, ...], tuple[Spectra, BoolArray]]
"""Lengths of windows to the spectra by them."""


def _spectra(
    records: Sequence[TimeHistory],
    inputs: Sequence[str],
    outputs: Sequence[str],
    instruments: Sequence[str],
    omega_rad_s: FloatArray,
    windows: Mapping[str, WindowPlan],
    settings: MeasureSettings,
) -> _Spectra:
    """Spectra for responses with and without instruments, by the windows that were planned for each input."""
    return {
        plan.lengths_s: measured_spectra(
            records,
            inputs=inputs,
            outputs=outputs,
            instruments=instruments,
            omega_rad_s=omega_rad_s,
            windows_s=plan.lengths_s,
            overlap=settings.overlap,
            taper=_TAPERS[settings.taper],
            within=plan.within,
        )
        for plan in _different(windows)
    }


def _respond(
    spectra: _Spectra,
    inputs: Sequence[str],
    outputs: Sequence[str],
    instruments: Sequence[str],
    windows: Mapping[str, WindowPlan],
    settings: MeasureSettings,
    known: Known | None = None,
) -> tuple[FrequencyResponse, Diagnostics]:
    """Responses with the windows that were planned for each input."""
    found = {
        lengths_s: response_from(
            of_lengths,
            inputs=inputs,
            outputs=outputs,
            instruments=instruments,
            asked=asked,
            composition=_COMPOSITIONS[settings.composition],
            known=known,
        )
        for lengths_s, (of_lengths, asked) in spectra.items()
    }
    if len(found) == 1:
        return next(iter(found.values()))
    whole = by_input({name: found[plan.lengths_s][0] for name, plan in windows.items()})
    lengths = list(found)
    columns = [lengths.index(windows[name].lengths_s) for name in inputs]
    return whole, joined_diagnostics(list(found.values()), whole, columns=columns)


def _different(windows: Mapping[str, WindowPlan]) -> tuple[WindowPlan, ...]:
    """Plans of inputs, each once."""
    return tuple({plan.lengths_s: plan for plan in windows.values()}.values())


def _margin_s(flights: Sequence[Flight], settings: MeasureSettings) -> float:
    """Quiet time to include: that of the longest known window."""
    given = [*settings.windows_s, *(length for lengths in settings.input_windows_s.values() for length in lengths)]
    if given:
        return max(given)
    return margin_s([flight.maneuver for flight in flights])


def _windows(
    records: Sequence[TimeHistory], band_rad_s: tuple[float, float], settings: MeasureSettings, inputs: Sequence[str]
) -> dict[str, WindowPlan]:
    """Windows of each input."""
    lengths = [record.duration_s for record in records]
    given = {name: settings.input_windows_s.get(name, settings.windows_s) for name in inputs}
    plans = {own: plan_of_records(lengths, band_rad_s, own) for own in dict.fromkeys(given.values())}
    return {name: plans[own] for name, own in given.items()}


def default_band(flights: Sequence[Flight], sample_rate_hz: float) -> tuple[float, float]:
    """Band to look at: that of the sweeps, or whatever the sample rate carries for other excitations."""
    return band_of([flight.maneuver for flight in flights], sample_rate_hz)


def _of_input(flights: Sequence[Flight], input: str) -> Sequence[Maneuver]:
    """The maneuvers of an input's own axis; all, where it has none."""
    maneuvers = [flight.maneuver for flight in flights]
    return [maneuver for maneuver in maneuvers if input == f"{maneuver.axis}_command"] or maneuvers


def _other_commands(flights: Sequence[Flight], inputs: Sequence[str]) -> tuple[str, ...]:
    """Commands of the other axes that every record contains."""
    names = [f"{axis}_command" for axis in AXES]
    return tuple(n for n in names if n not in inputs and all(n in flight.record.channel_names for flight in flights))


def without_known_filters(measured: Measured, flights: Sequence[Flight]) -> Measured:
    """Responses with the effect of the logged filters of their outputs removed.

    Parameters
    ----------
    flights
        Records and maneuvers behind them; the filters follow from the parameters of the records.

    Raises
    ------
    UsageError
        The records were filtered differently, so that one response of all of them cannot be corrected.
    """
    chains: dict[str, tuple[KnownFilter, ...]] = {}
    findings: list[Finding] = []
    for output in measured.response.outputs:
        sources = {source_of(segment, output) for segment in _holding(measured, output)}
        found = [known_filters(flight.record, source) for source in sorted(sources) for flight in flights]
        if any(chain != found[0] for chain in found):
            raise UsageError(
                f"{output} was filtered differently in the logs",
                needed="the same filters in all logs",
                remedy="estimate each log by itself, or leave out --correct-filters",
            )
        if found[0]:
            chains[output] = found[0]
        known = [f for source in sorted(sources) for f in filter_findings(flights[0].record, source)]
        findings += [_with_removal(finding, output, removed=bool(found[0])) for finding in known]
        if not known:
            message = f"Nothing was removed from {output}: by the parameters of the log it has passed no filter."
            findings.append(remark("known_filter", output, message))
    remarked = replace(measured, findings=(*measured.findings, *findings))
    if not chains:
        return remarked
    direct = None if measured.direct is None else corrected(measured.direct, chains)
    return replace(remarked, response=corrected(measured.response, chains), direct=direct, removed=chains)


def given_filters_kept(
    flights: Sequence[Flight], segments: Sequence[Segment], outputs: Sequence[str]
) -> tuple[Finding, ...]:
    """One remark for each output whose filters the user gave, of a result that contains them."""
    findings = []
    for output in outputs:
        sources = sorted({source_of(segment, output) for segment in segments if output in segment.history.names})
        given = [
            finding
            for source in sources
            if given_filters(flights[0].record, source)
            for finding in filter_findings(flights[0].record, source)
            if finding.kind == "known_filter"
        ]
        for finding in given:
            message = (
                f"{finding.message.rstrip('.')}. It was not removed from {output}; --correct-filters removes it from "
                "responses, and from models that are fitted to them."
            )
            findings.append(replace(finding, message=message))
    return tuple(findings)


def _with_removal(finding: Finding, output: str, *, removed: bool) -> Finding:
    """A finding on filters that says whether they were taken out of an output."""
    message = finding.message.rstrip(".")
    if finding.kind == "known_filter":
        return replace(finding, message=f"{message}. It was removed from {output}.")
    if removed:
        return finding
    remedy = f"If you know its filter, give it: --filter {output}=lp:HZ or delay:SECONDS"
    return replace(finding, message=f"{message}. Nothing was removed from {output}. {remedy}.")


def _holding(measured: Measured, name: str) -> list[Segment]:
    return [segment for segment in measured.segments if name in segment.history.names]


def filter_delays(measured: Measured, flights: Sequence[Flight]) -> dict[str, float]:
    """Output to the delay in seconds of the known filters in its response, where all logs had the same ones.

    Parameters
    ----------
    flights
        Records and maneuvers behind them.
    """
    delays: dict[str, float] = {}
    for output in measured.response.outputs:
        if output in measured.unfiltered:
            continue
        sources = sorted({source_of(segment, output) for segment in _holding(measured, output)})
        chains = [known_filters(flight.record, source) for source in sources for flight in flights]
        if chains and chains[0] and all(chain == chains[0] for chain in chains):
            delays[output] = sum(known.delay_s for known in chains[0])
    return delays


def logged_controllers(
    flights: Sequence[Flight], measured: Measured, command: str, rate: str
) -> tuple[LoggedController, ...]:
    """The controllers of a command in the logs of some flights, one for each that differs."""
    sources = dict.fromkeys(source_of(segment, rate) for segment in measured.segments if rate in segment.history.names)
    found = (
        logged_controller(flight.record, command, source=source) for source in sources or [""] for flight in flights
    )
    return tuple(dict.fromkeys(controller for controller in found if controller is not None))


_BIAS_LIMIT_DB = 1.0


def feedback_bias(measured: Measured, used: BoolArray) -> tuple[Finding, ...]:
    """How far direct estimates lie from the joint ones where those were used.

    One warning for each response that feedback biases seriously; where there is none, one remark on the worst.
    """
    if measured.direct is None or not used.any():
        return ()
    pairs = np.argwhere(used.any(axis=-1))
    judged = [_joint_estimate_finding(measured.response, measured.direct, used, int(y), int(u)) for y, u in pairs]
    serious = tuple(finding for finding in judged if finding.severity == "warning")
    return serious or (max(judged, key=lambda finding: finding.numbers["rms_db"]),)


def _joint_estimate_finding(
    response: FrequencyResponse, direct: FrequencyResponse, used: BoolArray, y: int, u: int
) -> Finding:
    points = used[y, u]
    decibel = 20.0 * np.log10(np.abs(direct.values[y, u, points] / response.values[y, u, points]))
    worst = float(decibel[np.argmax(np.abs(decibel))])
    typical = float(np.sqrt(np.mean(decibel**2)))
    serious = typical > _BIAS_LIMIT_DB
    return (warn if serious else remark)(
        "closed_loop_bias",
        f"{response.outputs[y]}/{response.inputs[u]}",
        f"The joint estimate with {', '.join(response.instruments)} was used for "
        f"{response.outputs[y]}/{response.inputs[u]}. A direct estimate would differ by {typical:.1f} dB (rms) in the "
        f"used band, at most by {abs(worst):.1f} dB"
        + (
            ": feedback biases it, unless the instrument itself contains feedback."
            if serious
            else "; feedback barely biases this flight."
        ),
        largest_db=worst,
        rms_db=typical,
    )
