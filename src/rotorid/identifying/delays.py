"""Logs in, delays out: how late each output answers its input, as a fraction of a sample."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Unpack

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.display import counted, html_table, lines_of
from rotorid.data.findings import Finding, refusal, warn, worst_first
from rotorid.data.quantity import milliseconds, with_ends
from rotorid.data.record import FlightRecord
from rotorid.data.response import FrequencyResponse
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fitting.delay.estimate import DelayAnalysis, DelayEstimate, estimate_delay, same_rate
from rotorid.fitting.delay.fit import Order
from rotorid.flights.flights import Flight, never_flew
from rotorid.flights.instruments import axes_of, find_instrument, is_command, is_free
from rotorid.flights.measure import measure
from rotorid.flights.segments import cut, histories, other_sources, require_known_names
from rotorid.flights.selection import chosen_maneuvers, default_pairs, each_once
from rotorid.identifying.command_rates import CommandRate, buffered, command_rates
from rotorid.io.records import as_records
from rotorid.results.model import Records
from rotorid.results.provenance import LoggedManeuver, Provenance, Refused, logged, provenance, refused
from rotorid.results.segment import Segment
from rotorid.settings.measuring import MeasureSettings
from rotorid.settings.option import as_settings
from rotorid.signal.clock import missing_channel
from rotorid.signal.excitations import excitation_signals
from rotorid.signal.stamps import CLOCK_SAMPLES, clock_error_s, largest_clock_s
from rotorid.typing import BoolArray

if TYPE_CHECKING:
    from rotorid.settings.option_types import MeasureOptions

_PROGRESS = logging.getLogger("rotorid.progress")

_HIGHEST_ORDER = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class PairDelay(Immutable):
    """The delay from one input to one output.

    Parameters
    ----------
    analysis
        Estimates by all methods.
    feedback
        Whether the input contains feedback of the output.
    instrument
        The channel that removes the bias of feedback; ``None`` where there is no feedback, or no such channel.
    alone
        Of several logs, the estimate of each by itself, all with a lag of one order; ``None`` where a log shows none.
    """

    analysis: DelayAnalysis
    feedback: bool
    instrument: str | None
    flights: tuple[Flight, ...]
    findings: tuple[Finding, ...]
    alone: Mapping[str, DelayEstimate | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._set(alone=self.alone)

    @property
    def recommended(self) -> DelayEstimate:
        """The estimate to use."""
        return self.analysis.recommended

    @property
    def others(self) -> tuple[DelayEstimate, ...]:
        """Estimates by other methods, for comparison."""
        return self.analysis.others

    @property
    def whole_band(self) -> DelayEstimate | None:
        """The delay from a fit of the whole band, for outputs filtered without phase."""
        return self.analysis.as_filtered

    @property
    def sample_s(self) -> float:
        """Longest sample interval of the records."""
        return self.analysis.sample_s

    @property
    def hold(self) -> str:
        """Whether the input is ``held`` between its samples or ``smooth``; ``mixed`` if records differ."""
        return self.analysis.hold

    @property
    def maneuvers(self) -> tuple[LoggedManeuver, ...]:
        """The maneuvers that were used."""
        return tuple(logged(flight.record, flight.maneuver) for flight in self.flights)


@dataclass(frozen=True, kw_only=True, eq=False)
class Delays(Immutable):
    """A finished run of :func:`delay`.

    Parameters
    ----------
    pairs
        Delays by pair ``output/input``.
    findings
        Remarks, the grave ones first; an error for each pair that was refused because the data contradict a delay.
    provenance
        Where all of it came from.
    rates
        Of every pair and log, how often commands came and how late the answer was.
    """

    pairs: Mapping[str, PairDelay]
    findings: tuple[Finding, ...]
    provenance: Provenance
    rates: tuple[CommandRate, ...] = ()

    def __post_init__(self) -> None:
        self._set(pairs=self.pairs)

    def __repr__(self) -> str:
        return lines_of(self._heading, self._rows())

    def _repr_html_(self) -> str:
        return html_table(self._heading, ("what", "which", "says"), self._rows())

    @property
    def _heading(self) -> str:
        return f"delays of {counted(len(self.pairs), 'pair')} of channels"

    def _rows(self) -> list[tuple[str, str, str]]:
        rows = []
        for name, pair in self.pairs.items():
            estimate = pair.recommended
            rows.append((name, _with_error(estimate), estimate.meaning))
        return rows + [(f"{f.severity} {f.kind}", f.where, f.message) for f in self.findings]


def _with_error(estimate: DelayEstimate) -> str:
    """A delay with its deviation, or with its interval where that has no such width."""
    if estimate.std_s is None and estimate.interval_s is not None:
        low_s, high_s = estimate.interval_s
        return with_ends(1e3 * estimate.delay_s, 1e3 * low_s, 1e3 * high_s, "ms")
    return f"{milliseconds(estimate.delay_s, estimate.std_s)} ms"


def delay(
    records: Records,
    *,
    input: str | None = None,
    output: str | None = None,
    order: int | None = None,
    settings: MeasureSettings | None = None,
    **options: Unpack[MeasureOptions],
) -> Delays:
    """Delays between channels of flight records: what ``rotorid delay`` does.

    The excitations of the pair's axis are used; where there are none, stretches that look like one, and else the whole
    record. Where the input contains feedback of the output and an instrument is logged, the joint frequency response
    gives the recommended estimate, otherwise the records themselves.

    Parameters
    ----------
    records
        Logs as :func:`rotorid.read` gives them, or their files; one may come without a list around it.
    input, output
        Channels; without them every logged set-point that moves and its response, or the commands and their rates
        where no set-point is logged.
    order
        Of the lag that is no delay, 1 to 4; by default what the data show. Delays compare only within one order: of
        several logs each is estimated by itself too, with the order of all together.
    settings
        Choices; everything has a default.
    **options
        Fields of :class:`rotorid.settings.measuring.MeasureSettings`, which go before ``settings``.

    Returns
    -------
    Delays
        Estimates of every pair, findings and where all came from.

    Raises
    ------
    InsufficientDataError
        No pair gives a delay; the findings say why.
    UsageError
        A channel or an option is wrong.

    Examples
    --------
    >>> result = delay("flight.ulg", input="phi_setpoint", output="phi")  # doctest: +SKIP
    >>> result.pairs["phi/phi_setpoint"].recommended.delay_s  # doctest: +SKIP
    0.071
    """
    settings, records = as_settings(MeasureSettings, settings, options), as_records(records)
    each_once(records)
    require_known_names(settings.instruments, records)
    pairs = _pairs(records, input, output)
    orders = () if order is None else (_order(order),)
    found: dict[str, PairDelay] = {}
    refusals: list[Finding] = []
    errors: list[InsufficientDataError] = []
    for source, answer in pairs:
        try:
            found[f"{answer}/{source}"] = _pair(records, source, answer, settings, orders)
        except InsufficientDataError as error:
            if input is not None:
                raise
            errors.append(error)
            refusals.append(_refusal(error, source, answer))
    # A number that shows no delay is left out, also when others do show one.
    for name in [name for name, pair in found.items() if pair.recommended.unseen]:
        pair = found.pop(name)
        refusals += [replace(f, severity="error") if f.kind == "no_delay" else f for f in pair.findings]
    if len(errors) == len(pairs) and all(map(never_flew, errors)):
        raise errors[0]
    found = {name: _with_each(pair, settings) for name, pair in found.items()}
    if not found:
        raise InsufficientDataError(
            "no pair of channels shows a delay",
            needed="a set-point that moves and its response",
            remedy="choose another pair with --input and --output"
            if input
            else "choose a pair with --input and --output",
            findings=refusals,
        )
    rates = {name: _rates(pair) for name, pair in found.items()}
    remarks = (
        *(finding for record in records for finding in record.findings),
        *(finding for pair in found.values() for finding in pair.findings),
        *(finding for of_pair in rates.values() for finding in buffered(of_pair)),
        *refusals,
    )
    flights = dict.fromkeys(flight for pair in found.values() for flight in pair.flights)
    return Delays(
        pairs=found,
        findings=worst_first(remarks),
        provenance=provenance(records, settings, flights=tuple(flights)),
        rates=tuple(rate for of_pair in rates.values() for rate in of_pair),
    )


def _rates(pair: PairDelay) -> tuple[CommandRate, ...]:
    """Rates of the commands of a pair, with the delay of each log alone."""
    delays = pair.alone or {pair.flights[0].record.source.name: pair.recommended}
    logs = {id(flight.record) for flight in pair.flights}
    if len(logs) != len(delays):  # without an order no log has a delay of its own
        delays = {str(place): None for place in range(len(logs))}
    return command_rates(pair.flights, pair.analysis.input, pair.analysis.output, delays)


def refused_delay(
    error: InsufficientDataError, records: Sequence[FlightRecord], *, settings: MeasureSettings
) -> Refused:
    """Why data show no delay: findings alone, and no number."""
    return refused(error, records, settings, otherwise=refusal("no_delay", "delay", str(error)))


def _pairs(records: Sequence[FlightRecord], input: str | None, output: str | None) -> tuple[tuple[str, str], ...]:
    if (input is None) != (output is None):
        given, other = ("--input", "--output") if output is None else ("--output", "--input")
        raise UsageError(f"{given} was given without {other}", remedy="give both, or neither")
    if input is None or output is None:
        return default_pairs(records)
    if input == output:
        raise UsageError(f"{input} is both input and output", needed="different channels")
    require_known_names((input, output), records)
    return ((input, output),)


def _order(poles: int) -> Order:
    if not 1 <= poles <= _HIGHEST_ORDER:
        raise UsageError(f"--order {poles} was given", needed=f"the order of a lag, 1 to {_HIGHEST_ORDER}")
    return Order(0, poles)


def _with_each(pair: PairDelay, settings: MeasureSettings) -> PairDelay:
    """A pair with the delay of each log alone: a lag of another order would put it elsewhere."""
    order, analysis = pair.recommended.order, pair.analysis
    flown = dict.fromkeys(flight.record for flight in pair.flights)
    if order is None or len(flown) < 2:
        return pair
    alone: dict[str, DelayEstimate | None] = {}
    for record in flown:
        name = record.source.name
        if name in alone:
            name = f"{name} ({len(alone) + 1})"
        try:
            estimate = _pair([record], analysis.input, analysis.output, settings, (order,)).recommended
        except (InsufficientDataError, UsageError):
            alone[name] = None
        else:
            alone[name] = None if estimate.unseen else estimate
    return replace(pair, alone=alone)


def _pair(
    records: Sequence[FlightRecord], input: str, output: str, settings: MeasureSettings, orders: Sequence[Order]
) -> PairDelay:
    _PROGRESS.info(f"delay from {input} to {output}")
    flown, remarks = chosen_maneuvers(records, input, output, settings)
    instrument = _instrument(flown, input, output, settings)
    feedback = instrument != input
    segments, cutting = _cut_by_record(flown, input, output, settings)
    joint = settings.estimate != "direct" and feedback and instrument is not None
    one_rate = same_rate(histories(segments))
    if joint and not one_rate:
        raise _needs_one_rate(segments, input)
    response, cause = (
        _response(flown, input, output, instrument if joint else None, settings) if one_rate else (None, "")
    )
    analysis = estimate_delay(
        histories(segments),
        input=input,
        output=output,
        feedback=feedback,
        airframe=is_command(input),
        response=response,
        orders=orders,
        highest_rad_s=settings.band_rad_s[1] if settings.band_rad_s else np.inf,
    )
    late_s = largest_clock_s(clock_error_s(flight.record, (input, output), [_interval(flight)]) for flight in flown)
    analysis = analysis.with_clocks(math.sqrt(2.0) * (CLOCK_SAMPLES * analysis.sample_s if late_s is None else late_s))
    by_joint = joint and analysis.recommended.method == "response"
    biased = [_biased(input, output, joint=joint, cause=cause)] if feedback and not by_joint else []
    return PairDelay(
        analysis=analysis,
        feedback=feedback,
        instrument=instrument if feedback else None,
        flights=tuple(flown),
        findings=(*remarks, *cutting, *biased, *analysis.findings),
    )


def _interval(flight: Flight) -> tuple[float, float]:
    return flight.maneuver.start_s, flight.maneuver.stop_s


def _cut_by_record(
    flown: Sequence[Flight], input: str, output: str, settings: MeasureSettings
) -> tuple[tuple[Segment, ...], tuple[Finding, ...]]:
    """Maneuvers of each record by itself, at its own rate: resampling would move the delay."""
    segments: list[Segment] = []
    findings: list[Finding] = []
    for record in {id(flight.record): flight.record for flight in flown}.values():
        own = [flight for flight in flown if flight.record is record]
        found, remarks = cut(own, channels=(input, output), shifts=settings.shifts)
        segments += found
        findings += remarks
    findings += [remark for remark in other_sources(segments, segments, (input, output)) if remark not in findings]
    return tuple(segments), tuple(findings)


def _needs_one_rate(segments: Sequence[Segment], input: str) -> UsageError:
    rates = [segment.history.sample_rate_hz for segment in segments]
    return UsageError(
        f"records of {min(rates):.4g} to {max(rates):.4g} Hz cannot be combined for {input}, which contains feedback",
        needed="records of one rate, because they give one frequency response",
        remedy="give the logs of each rate separately, or use --estimate direct",
    )


def _instrument(flown: Sequence[Flight], input: str, output: str, settings: MeasureSettings) -> str | None:
    """The channel without feedback: the input itself, one that excites it, or ``None`` if unknown."""
    if settings.instruments:
        return _given_instrument(flown, output, settings.instruments)
    if is_free(flown, input):
        return input
    axis = axes_of((input,), (output,))[0]
    found = find_instrument(flown, axis)
    if found is not None:
        return found
    # A set-point of the outermost logged loop comes from a person or a program; a command from a controller.
    outside = excitation_signals(flown[0].record, axis)
    return input if not is_command(input) and outside and outside[0] == input else None


def _given_instrument(flown: Sequence[Flight], output: str, names: Sequence[str]) -> str:
    if len(names) != 1:
        raise UsageError(f"{len(names)} instruments for one input", needed="one")
    (name,) = names
    if name == output:
        raise UsageError(
            f"{name} is the output itself",
            needed="an instrument: a channel that excites the input and contains no feedback",
            remedy="name another one, or use --estimate direct",
        )
    for flight in flown:
        if name not in flight.record.channel_names:
            raise missing_channel(flight.record, name, remedy="name a channel of the log with --instrument")
    return name


def _response(
    flown: Sequence[Flight], input: str, output: str, instrument: str | None, settings: MeasureSettings
) -> tuple[tuple[FrequencyResponse, BoolArray] | None, str]:
    """The frequency response of the pair, joint where there is an instrument, and its usable points; or why not."""
    chosen = replace(
        settings,
        instruments=(instrument,) if instrument else (),
        estimate="joint" if instrument else "direct",
    )
    try:
        measured = measure(flown, inputs=(input,), outputs=(output,), settings=chosen)
    except InsufficientDataError as error:
        # Too short for a window: the records themselves may still answer.
        return None, str(error).rstrip(".")
    used = measured.trusted_points(measured.response, settings.least_coherence(joint=instrument is not None))
    return ((measured.response, used), "") if np.any(used) else (None, "none of its points is coherent")


def _biased(input: str, output: str, *, joint: bool, cause: str) -> Finding:
    """The warning on a delay from records alone if the input contains feedback."""
    if joint:
        why = f"no joint frequency response was usable ({cause or 'too few of its points are coherent'})"
    else:
        why = "no excitation without feedback is logged or named"
    return warn(
        "closed_loop_bias",
        f"{output}/{input}",
        f"{input} may contain feedback of {output} and {why}, so its delay comes from the records alone. In "
        "closed loop gusts and noise return through the controller and make the estimated delay too small, even "
        "negative.",
    )


def _refusal(error: InsufficientDataError, input: str, output: str) -> Finding:
    return warn("no_delay", f"{output}/{input}", str(error))
