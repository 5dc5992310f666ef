"""Selection of the log segments to fit and of those kept for validation.

For frequency responses: sweeps, random binary signals and multisines are fitted, doublets and multisteps are kept
unseen (:func:`select_maneuvers`). A fit in time takes the same for commands, and excitations of the set-points or whole
records for set-points (:func:`select_records`). A delay takes the pairs of channels that move (:func:`default_pairs`)
and whatever excites them (:func:`chosen_maneuvers`). Segments that the user gave go before all that
(:func:`given_flights`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from rotorid.autopilots.advice import flying_advice
from rotorid.data.axes import RATE_OF
from rotorid.data.findings import Finding, refusal, remark
from rotorid.data.record import AXES, STANDARD_UNITS, FlightRecord, Maneuver
from rotorid.data.trust import RICH_KINDS
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.flights.flights import Flight, longest_flight, overlap, require_duration
from rotorid.flights.instruments import (
    axes_of,
    find_instrument,
    is_command,
    is_injection,
)
from rotorid.flights.supports import dwell_of, dwells_alone, dwells_in, nothing_excites, ordinary_flights
from rotorid.models.families import is_rate_model
from rotorid.models.structure import LinearStructure
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.measuring import MeasureSettings
from rotorid.signal.airborne import airborne_by_thrust
from rotorid.signal.bench import driven_motors, is_bench
from rotorid.signal.clock import missing_channel
from rotorid.signal.excitations import (
    candidate_excitations,
    classify,
    excitation_signals,
    find_excitations,
    least_motion,
    rich_excitations,
    verifying_excitations,
)
from rotorid.signal.limits import limited_share
from rotorid.typing import Axis


@dataclass(frozen=True, kw_only=True)
class Selection:
    """Maneuvers of the axes of a model.

    Parameters
    ----------
    fitted
        Rich enough to fit: sweeps, random binary signals, or what the user gave.
    unseen
        Doublets, multisteps and what ranks lower of the same logs, kept for verification.
    """

    fitted: tuple[Flight, ...]
    unseen: tuple[Flight, ...]

    def fits(self, flight: Flight) -> bool:
        """Whether any part of a flight is fitted, also when its log was read again."""
        return any(flight.overlaps(fitted) for fitted in self.fitted)


def select_maneuvers(
    records: Sequence[FlightRecord],
    axes: Sequence[Axis],
    settings: IdentifySettings,
    *,
    otherwise: Callable[[Sequence[FlightRecord], Sequence[Axis]], list[Flight]] | None = None,
) -> Selection:
    """Split the excitations of the axes into those to fit and those to keep unseen.

    What the log declares is fitted alone: sweeps that are only seen in its signals are kept unseen then.
    Left out is what only looks like a maneuver: set-points that an outer loop moves while the signal rests in which the
    fitted excitations of the axis were seen, and what ends on the ground, where no model of a free flight holds.

    Parameters
    ----------
    otherwise
        What to fit where nothing was excited: whole flights (:func:`whole_flights`) of an input that is no command and
        in which nothing can be found, ordinary ones (:func:`by_stick`) for a rate model.

    Raises
    ------
    InsufficientDataError
        Nothing rich enough was flown on these axes.
    UsageError
        No record came, the same one twice, or no given segment lies inside one.
    """
    each_once(records)
    # Without its command a log shows nothing of an axis that others show.
    logged_axes = {axis for axis in axes if any(f"{axis}_command" in record.channel_names for record in records)}
    found = [
        Flight(record, m)
        for record in records
        for axis in axes
        if axis not in logged_axes or f"{axis}_command" in record.channel_names
        for m in find_excitations(record, axis)
    ]
    if settings.segments:
        fitted = [
            described(flight)
            for flight in given_flights(records, of_axes(settings.segments, axes))
            if flight.axis not in logged_axes or f"{flight.axis}_command" in flight.record.channel_names
        ]
    else:
        fitted = [
            described(flight) if flight.maneuver.origin == "given" else flight
            for flight in found
            if flight.maneuver in rich_excitations(flight.record, flight.axis)
        ]
    if not fitted and otherwise is not None and not settings.segments:
        fitted = otherwise(records, axes)
    if not fitted:
        raise _nothing_flown(records, axes, [flight.maneuver for flight in found])
    _require_band(fitted)
    unseen = [
        flight
        for flight in found
        if (
            flight.maneuver.kind in ("doublet", "multistep")
            or flight.maneuver in verifying_excitations(flight.record, flight.axis)
        )
        and not any(overlap(flight.maneuver, other.maneuver) for other in fitted if other.record is flight.record)
        and not _answers(flight, fitted)
    ]
    return Selection(fitted=tuple(fitted), unseen=wholly_flown(unseen))


def _require_band(fitted: Sequence[Flight]) -> None:
    """Refuse maneuvers that all dwell at one frequency: no structure can be fitted to one point of a response.

    Raises
    ------
    InsufficientDataError
        No maneuver has a band.
    """
    dwells = [dwell_of(flight.record, flight.maneuver) for flight in fitted]
    frequencies = [omega_rad_s for omega_rad_s in dwells if omega_rad_s is not None]
    if not frequencies or len(frequencies) < len(dwells):
        return
    flight = fitted[0]
    came = f"{flight.record.source.name} {dwells_alone(flight.axis, frequencies)}"
    raise InsufficientDataError(
        came,
        needed="a sweep, multisine or random binary signal of about 20 s or more",
        remedy=flying_advice(flight.record, flight.axis),
        findings=[refusal("no_excitation", flight.axis, f"{came}.")],
    )


def wholly_flown(flights: Sequence[Flight]) -> tuple[Flight, ...]:
    """Maneuvers that begin and end in the air, judged by thrust."""
    airborne_parts = {id(flight.record): airborne_by_thrust(flight.record) for flight in flights}

    def flies(flight: Flight) -> bool:
        maneuver, found = flight.maneuver, airborne_parts[id(flight.record)]
        return found is None or any(
            start_s <= maneuver.start_s and maneuver.stop_s <= stop_s for start_s, stop_s in found.intervals
        )

    return tuple(flight for flight in flights if flies(flight))


def _answers(flight: Flight, fitted: Sequence[Flight]) -> bool:
    """Whether a set-point only passes on the output of an outer loop."""
    names, own = excitation_signals(flight.record, flight.axis), flight.maneuver.signal
    signals = [item.maneuver.signal for item in fitted if item.axis == flight.axis]
    # An injection enters far inside, and says nothing of the loops around it.
    outer = [names.index(signal) for signal in signals if signal in names and not is_injection(signal)]
    return bool(outer) and own in names and names.index(own) > max(outer)


def whole_flights(records: Sequence[FlightRecord], axes: Sequence[Axis]) -> list[Flight]:
    """The airborne part of each record in which no excitation is found."""
    flights = []
    for record in records:
        if is_bench(record):
            raise _nothing_moved(record, axes)
        start_s, stop_s = longest_flight(record, or_whole=False)
        flights.append(
            Flight(record, Maneuver(axis=axes[0], kind="other", start_s=start_s, stop_s=stop_s, origin="found"))
        )
    return flights


def _nothing_moved(record: FlightRecord, axes: Sequence[Axis]) -> InsufficientDataError:
    """No motor of a bench was moved on purpose, or what moved them does not show it."""
    wanted = " or ".join(axes)
    shares = {name: limited_share(record[name].values) for name in driven_motors(record)}
    limited = [f"{name} for {100.0 * share:.0f} %" for name, share in shares.items() if share > _LIMITED]
    why = f"; at a limit were {', '.join(limited)} of the time" if limited else ""
    came = f"{record.source.name} contains no sweep of single motors that moves {wanted}{why}"
    segment = f"--segment {axes[0]}:{record.start_s:.4g}:{record.stop_s:.4g}"
    return InsufficientDataError(
        came,
        needed="a sweep of each motor for a minute or more, within its limits",
        remedy=f"plan one with rotorid design sweep --vehicle rig, or name what was one: {segment}",
        findings=[refusal("no_excitation", wanted, f"{came}.")],
    )


_LIMITED = 0.02
"""Share of the time at a limit from which it may hide a sweep."""


def by_stick(records: Sequence[FlightRecord], axes: Sequence[Axis]) -> list[Flight]:
    """The parts of each record in which the stick moves an axis, where nothing was excited on purpose.

    ``identify`` and ``response`` measure the answer to the command of an axis over them.
    """
    return [
        described(Flight(record, part))
        for record in records
        for axis in axes
        for part in ordinary_flights(record, axis)
    ]


def of_axes(segments: Sequence[Maneuver], axes: Sequence[Axis]) -> list[Maneuver]:
    """The given segments, all of which must be of an axis of the model."""
    for segment in segments:
        if segment.axis not in axes:
            raise UsageError(
                f"the segment {segment.axis}:{segment.start_s:g}:{segment.stop_s:g} is on another axis",
                needed=f"segments of {' or '.join(axes)}",
                remedy="leave it out, or choose the inputs or the model of that axis",
            )
    return list(segments)


def each_once(records: Sequence[FlightRecord]) -> None:
    """Refuse duplicate data: they would count as twice the evidence, and validate themselves."""
    if not records:
        raise UsageError("no log was given", needed="at least one flight log")
    sources: dict[str, str] = {}
    for record in records:
        # Folders of tables have no hash of their own.
        key = record.source.sha256 or str(id(record))
        name, other = record.source.name, sources.get(key)
        if other is not None:
            came = f"{name} was given twice" if name == other else f"{name} and {other} are the same log"
            raise UsageError(came, needed="each log once", remedy="leave one of them out")
        sources[key] = name


def given_flights(records: Sequence[FlightRecord], segments: Sequence[Maneuver]) -> tuple[Flight, ...]:
    """Given segments in every log that they reach into.

    Raises
    ------
    UsageError
        They reach into none.
    """
    flights = tuple(
        flight for record in records for maneuver in segments if (flight := Flight(record, maneuver)).inside
    )
    if not flights:
        given = " and ".join(f"{maneuver.axis}:{maneuver.start_s:.10g}:{maneuver.stop_s:.10g}" for maneuver in segments)
        came = f"the segment {given} lies" if len(segments) == 1 else f"the segments {given} lie"
        spans = ", ".join(
            f"{record.start_s:.1f} to {record.stop_s:.1f} s of {record.source.name}" for record in records
        )
        raise UsageError(
            f"{came} outside every log",
            needed=f"a segment within {spans}",
            remedy="see the excitations that rotorid inspect finds",
        )
    return flights


def require_inside(records: Sequence[FlightRecord], segments: Sequence[Maneuver]) -> None:
    """Refuse segments outside every log, before the logs are examined one by one.

    Raises
    ------
    UsageError
        Segments were given and reach into no log.
    """
    if records and segments:
        given_flights(records, segments)


def require_reached(record: FlightRecord, segments: Sequence[Maneuver]) -> None:
    """Refuse one of several logs into which no given segment reaches: it takes no part, and the others may.

    Raises
    ------
    InsufficientDataError
        Segments were given, and none lies inside this log.
    """
    if segments and not any(Flight(record, maneuver).inside for maneuver in segments):
        raise InsufficientDataError("it contains no given segment")


def described(given: Flight) -> Flight:
    """A given segment with the kind and band of what its best excitation signal does there, unless it has them."""
    if given.maneuver.kind != "other":
        return given
    name = find_instrument([given], given.axis) or f"{given.axis}_command"
    for samples in given.samples(name):
        if samples.values.size > 10:
            kind, band = classify(samples.time_s, samples.values - np.median(samples.values))
            return replace(given, maneuver=replace(given.maneuver, kind=kind, band_rad_s=band, signal=name))
    return given


def _nothing_flown(
    records: Sequence[FlightRecord], axes: Sequence[Axis], found: Sequence[Maneuver]
) -> InsufficientDataError:
    names, wanted = ", ".join(record.source.name for record in records), " or ".join(axes)
    needed = "a sweep, multisine or random binary signal of about 20 s or more"
    remedy = f"{flying_advice(records[0], axes[0])}, or name an interval with --segment"
    if any(record.status.foreign for record in records):
        # What helps there is nobody's test input: turns, pulses and steps of ordinary driving or flying.
        needed = f"about 20 s in which {wanted} moves slowly and fast: weaving, pulses or steps both ways"
        remedy = "name such an interval with --segment"
    came = f"{names} {nothing_excites(axes, found)}"
    sines = {axis: [omega_rad_s for record in records for _, omega_rad_s in dwells_in(record, axis)] for axis in axes}
    for axis, frequencies in sines.items():
        if frequencies and not found:
            came, remedy = f"{names} {dwells_alone(axis, frequencies)}", flying_advice(records[0], axis)
    for record in records:
        for axis in axes:
            if f"{axis}_command" not in record.channel_names:
                return missing_channel(record, f"{axis}_command")
    return InsufficientDataError(
        came,
        needed=needed,
        remedy=remedy,
        findings=[refusal("no_excitation", wanted, f"{came}.")],
    )


class TimeSelection(NamedTuple):
    """Maneuvers to fit, those that are kept unseen, and remarks."""

    selection: Selection
    findings: tuple[Finding, ...] = ()


def select_records(
    structure: LinearStructure, records: Sequence[FlightRecord], settings: IdentifySettings, *, in_time: bool = True
) -> TimeSelection:
    """The stretches to fit.

    For commands of the mixer those that the frequency domain fits too. For set-points the segments that were given,
    the excitations that stand in the set-points themselves, if every one has some, or whole records: to a response in
    time any motion of its inputs is an excitation. Doublets and multisteps beside longer excitations of several
    set-points are kept unseen.

    Raises
    ------
    InsufficientDataError
        Nothing was flown that shows the model, or a record holds one sample.
    UsageError
        No record came, the same one twice, or no given segment lies inside one.
    """
    axes = axes_of(structure.inputs, structure.outputs)
    commands = all(is_command(name) for name in structure.inputs)
    if in_time:
        for record in records:
            require_duration(record)
    if commands:
        selected = select_maneuvers(records, axes, settings, otherwise=by_stick if is_rate_model(structure) else None)
        return TimeSelection(selected, () if settings.segments else _fitted_by_stick(selected.fitted))
    if not in_time:
        return TimeSelection(select_maneuvers(records, axes, settings, otherwise=whole_flights))
    each_once(records)
    if settings.segments:
        given = tuple(described(flight) for flight in given_flights(records, settings.segments))
        return TimeSelection(Selection(fitted=given, unseen=()))
    by_setpoints = _of_setpoints(structure.inputs, records)
    if by_setpoints is not None:
        return TimeSelection(by_setpoints)
    whole = [whole_record(record, axes) for record in records]
    return TimeSelection(Selection(fitted=tuple(whole), unseen=()), tuple(_fitted_whole(flight) for flight in whole))


def _of_setpoints(inputs: Sequence[str], records: Sequence[FlightRecord]) -> Selection | None:
    """Excitations in the set-points themselves; ``None`` if one of several shows none in any record."""
    every = {
        name: [Flight(record, m) for record in records for m in _excitations_of_input(record, name)] for name in inputs
    }
    rich = {name: [flight for flight in flights if _is_rich(flight.maneuver)] for name, flights in every.items()}
    if len(inputs) == 1 and not rich[inputs[0]]:
        # Of a single set-point even steps are better than whole records.
        short_ones = tuple(every[inputs[0]])
        return Selection(fitted=short_ones, unseen=()) if short_ones else None
    if not all(rich.values()):
        return None
    fitted = tuple(_joined([flight for flights in rich.values() for flight in flights], records))
    short = (
        flight
        for flights in every.values()
        for flight in flights
        if flight.maneuver.kind in ("doublet", "multistep") and not any(flight.overlaps(other) for other in fitted)
    )
    return Selection(fitted=fitted, unseen=wholly_flown(sorted(short, key=lambda flight: flight.maneuver.start_s)))


def _joined(flights: Sequence[Flight], records: Sequence[FlightRecord]) -> Iterator[Flight]:
    """Maneuvers of each record in the order of time, those that touch each other as one."""
    for record in records:
        own = sorted((flight.maneuver for flight in flights if flight.record is record), key=lambda m: m.start_s)
        kept: list[Maneuver] = []
        for maneuver in own:
            if kept and maneuver.start_s <= kept[-1].stop_s:
                kept[-1] = replace(kept[-1], stop_s=max(kept[-1].stop_s, maneuver.stop_s))
            else:
                kept.append(maneuver)
        yield from (Flight(record, maneuver) for maneuver in kept)


def _excitations_of_input(record: FlightRecord, input: str) -> list[Maneuver]:
    """Excitations in an input itself, each interval once."""
    found = [m for axis in AXES for m in find_excitations(record, axis) if m.signal == input]  # type: ignore[arg-type]
    return sorted({(m.start_s, m.stop_s): m for m in found}.values(), key=lambda m: m.start_s)


def _shown_in(record: FlightRecord, input: str) -> list[Maneuver]:
    """Excitations, including one that fills its whole log."""
    likely = [m for axis in AXES for m in candidate_excitations(record, axis) if m.signal == input]  # type: ignore[arg-type]
    return [*_excitations_of_input(record, input), *likely]


def whole_record(record: FlightRecord, axes: Sequence[Axis]) -> Flight:
    """The longest flight of a record, or all of it if it shows neither take-off nor landing.

    Raises
    ------
    InsufficientDataError
        It never flew, or holds one sample.
    """
    start_s, stop_s = longest_flight(record)
    return Flight(record, Maneuver(axis=axes[0], kind="other", start_s=start_s, stop_s=stop_s, origin="found"))


def _fitted_whole(flight: Flight) -> Finding:
    name, maneuver = flight.record.source.name, flight.maneuver
    return remark(
        "no_excitation",
        name,
        f"No excitation of all inputs was found in {name}, so the whole log was fitted, {maneuver.start_s:.1f} to "
        f"{maneuver.stop_s:.1f} s. Choose a part with --segment.",
        start_s=maneuver.start_s,
        stop_s=maneuver.stop_s,
    )


def _fitted_by_stick(fitted: Sequence[Flight]) -> tuple[Finding, ...]:
    """A remark for each ordinary flight used instead of an excitation."""
    return tuple(
        remark(
            "no_excitation",
            flight.record.source.name,
            f"No sweep, multisine or random binary signal of {flight.axis} was found in "
            f"{flight.record.source.name}, so the flight from {flight.maneuver.start_s:.1f} to "
            f"{flight.maneuver.stop_s:.1f} s was fitted with the stick as instrument. A sweep gives intervals "
            "several times narrower.",
            start_s=flight.maneuver.start_s,
            stop_s=flight.maneuver.stop_s,
        )
        for flight in fitted
        if not rich_excitations(flight.record, flight.axis)
    )


_SETPOINT = "_setpoint"


def default_pairs(records: Sequence[FlightRecord]) -> tuple[tuple[str, str], ...]:
    """Every set-point that moves, with its response; commands with their rates where no set-point does.

    Where any axis was excited on purpose, only pairs of such axes count: what feedback moves shows no delay.

    Raises
    ------
    InsufficientDataError
        No such pair is logged.
    """
    setpoints = [(name, name.removesuffix(_SETPOINT)) for name in STANDARD_UNITS if name.endswith(_SETPOINT)]
    for offered in (setpoints, [(f"{axis}_command", rate) for axis, rate in RATE_OF.items()]):
        pairs = [pair for pair in offered if all(_logged(record, *pair) for record in records)]
        excited = [pair for pair in pairs if any(_excited(record, *pair) for record in records)]
        if excited or pairs:
            return tuple(excited or pairs)
    message = "The log contains neither a set-point with its response nor a command with its rate."
    raise InsufficientDataError(
        "no pair of set-point and response is logged",
        needed="channels such as phi_setpoint and phi",
        remedy="name a pair with --input and --output, or the channels with --map",
        findings=[refusal("missing_channel", "set-points", message)],
    )


def excited_pairs(records: Sequence[FlightRecord]) -> tuple[tuple[str, str], ...]:
    """Every set-point with an excitation, with its response; else the commands excited at the mixer.

    Raises
    ------
    UsageError
        None has any.
    """
    setpoints = [(name, name.removesuffix(_SETPOINT)) for name in STANDARD_UNITS if name.endswith(_SETPOINT)]
    found = tuple(
        pair
        for pair in setpoints
        if _all_log(records, pair)
        and any(_is_rich(maneuver) for record in records for maneuver in _shown_in(record, pair[0]))
    ) or tuple(
        (f"{axis}_command", rate)
        for axis, rate in RATE_OF.items()
        if _all_log(records, (f"{axis}_command", rate)) and any(rich_excitations(record, axis) for record in records)
    )
    if not found:
        names = ", ".join(record.source.name for record in records)
        raise UsageError(
            f"no excitation was found in {names}",
            needed="the pair to measure, such as --inputs roll_command --outputs p",
        )
    return found


def _all_log(records: Sequence[FlightRecord], pair: tuple[str, str]) -> bool:
    return all(set(pair) <= set(record.channel_names) for record in records)


def chosen_maneuvers(
    records: Sequence[FlightRecord], input: str, output: str, settings: MeasureSettings
) -> tuple[tuple[Flight, ...], tuple[Finding, ...]]:
    """Stretches to use for one pair: given ones, excitations, what looks like one, or else whole records.

    Raises
    ------
    InsufficientDataError
        Nothing is excited in a record, and the vehicle never flew, or the record has one sample.
    UsageError
        No given segment lies inside a record, or one is of another axis.
    """
    axes = axes_of((input,), (output,))
    if settings.segments:
        given = given_flights(records, of_axes(settings.segments, axes))
        return tuple(described(flight) for flight in given), ()
    parts = [_of_record(record, axes, input) for record in records]
    return tuple(item for flights, _ in parts for item in flights), tuple(f for _, findings in parts for f in findings)


def _of_record(record: FlightRecord, axes: Sequence[Axis], input: str) -> tuple[list[Flight], list[Finding]]:
    """Excitations of one record, or likely ones, or all of it with a remark."""
    rich = [Flight(record, m) for axis in axes for m in rich_excitations(record, axis)]
    likely = rich or [Flight(record, m) for axis in axes for m in candidate_excitations(record, axis)]
    if likely:
        return likely, []
    whole = whole_record(record, axes)
    return [whole], [_delay_read_whole(record, whole.maneuver, input)]


def _is_rich(maneuver: Maneuver) -> bool:
    return maneuver.kind in RICH_KINDS or maneuver.origin == "given"


def _delay_read_whole(record: FlightRecord, maneuver: Maneuver, input: str) -> Finding:
    return remark(
        "no_excitation",
        record.source.name,
        f"No excitation was found in {record.source.name}, so {input} was used from {maneuver.start_s:.1f} to "
        f"{maneuver.stop_s:.1f} s.",
        start_s=maneuver.start_s,
        stop_s=maneuver.stop_s,
    )


def _logged(record: FlightRecord, input: str, output: str) -> bool:
    """Whether both channels are there and the input moves."""
    if output not in record.channel_names:
        return False
    least = least_motion(record, input)
    return any(
        values.size > 1 and float(np.ptp(values)) > least
        for topic, row in record.holding(input)
        if (values := topic.values[row][np.isfinite(topic.values[row])]).size
    )


def _excited(record: FlightRecord, input: str, output: str) -> bool:
    axes = axes_of((input,), (output,))
    return any(rich_excitations(record, axis) for axis in axes) or any(
        candidate_excitations(record, axis) for axis in axes
    )
