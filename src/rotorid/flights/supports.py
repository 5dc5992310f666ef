"""Which models a log supports, by what, and why not: every verb asks here before it starts.

``inspect`` prints what :func:`supports` answers, ``identify --model all`` and ``review`` take the models that
:func:`supported_models` names, and ``identify`` of a rate model, ``tune`` and ``track`` refuse with the same sentence
(:func:`unsupported`). What was flown on purpose goes first. Without it a rate model takes the parts of the flights in
which the stick, or a set-point that is the stick, moves its axis (:func:`ordinary_flights`). Whether the model then
fits, only ``identify`` shows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

from rotorid.autopilots.advice import absence, flying_advice, logging_advice, motor_advice, slow_motor_advice
from rotorid.data.axes import ATTITUDE, RATES
from rotorid.data.base import Immutable
from rotorid.data.display import counted, listed
from rotorid.data.findings import Finding, refusal, warn
from rotorid.data.record import LOWEST_RATE_HZ, FlightRecord, Maneuver
from rotorid.data.trust import LOWEST_TOP_RAD_S
from rotorid.errors import InsufficientDataError, RotoridError
from rotorid.flights.flights import Flight, longest_flight, never_flew
from rotorid.flights.instruments import find_instrument, is_free, own_instrument
from rotorid.flights.motor_band import fastest_motors
from rotorid.flights.oscillations import limits_shown, motors_limited, reviewed_oscillations
from rotorid.flights.tilt_drag import LEAST_SPEED_M_S
from rotorid.models.autopilots.layouts import layout_of
from rotorid.models.families import FAMILIES, RATE_AXIS, Needs, family_of, rate_model_of
from rotorid.models.library import RATE_AXES, library_model
from rotorid.settings.identifying import IdentifySettings
from rotorid.signal.airborne import airborne
from rotorid.signal.bench import bench_words, is_bench
from rotorid.signal.excitations import (
    candidate_excitations,
    find_excitations,
    motor_excitations,
    rich_excitations,
    single_frequency,
)
from rotorid.signal.kinematics import ACCELERATIONS, EARTH_VELOCITIES, VELOCITIES
from rotorid.signal.motors import MotorHistory, logged_outputs, logged_speeds, or_none
from rotorid.spectral.windows import excited_to_rad_s
from rotorid.typing import Axis

SHORTEST_ORDINARY_S = 20.0
"""Less ordinary flight has too few stick movements to average over."""

SHORTEST_FLIGHT_S = 10.0
"""Less than this in the air shows no physics of flight."""

END_FIRST = "end the oscillation first"
"""Remedy for a flight that shows the limits of its motors."""

_INSTRUMENT = "an instrument free of feedback"
_WHOLE_HZ, _WHOLE_RAD_S = 100.0, 2.0
"""Rates and excitation limits above which decimals are noise."""

_LISTED = 4

By: TypeAlias = Literal["", "excitation", "ordinary flight", "motors", "flight", "motor speeds"]


@dataclass(frozen=True, kw_only=True)
class Need(Immutable):
    """One thing that a model needs.

    Parameters
    ----------
    there
        Whether the log has it.
    found
        What the log has of it.
    """

    need: str
    there: bool
    found: str


@dataclass(frozen=True, kw_only=True)
class Support(Immutable):
    """Whether a model can be identified from a log.

    Parameters
    ----------
    because
        Why, or why not.
    remedy
        What to change where it cannot, or what would give narrower intervals.
    instrument
        Channel free of feedback that a joint estimate would use.
    by
        What it would be identified from: an ``excitation``, an ``ordinary flight``, the ``motors``, a ``flight``
        through the air with them, or their ``motor speeds``; empty where it cannot.
    lacks
        Kind of the finding that says why it cannot; empty where it can.
    numbers
        Of that finding.
    """

    possible: bool
    because: str
    remedy: str = ""
    instrument: str | None = None
    needs: tuple[Need, ...] = ()
    by: By = ""
    lacks: str = ""
    numbers: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._set(numbers=self.numbers)


def supports(record: FlightRecord) -> dict[str, Support]:
    """Name of each model that ``--model all`` may choose, and of each of a rig, to whether a log supports it."""
    found = {
        model: _LOOKS[family.needs](record, model)
        for family in sorted(FAMILIES, key=lambda name: not name.in_all)
        if family.needs is not None
        for model in family.axes
    }
    return {model: support for model, support in found.items() if support is not None}


def supported_models(records: Sequence[FlightRecord], settings: IdentifySettings | None = None) -> tuple[str, ...]:
    """Names of the models that logs may support: what fits them may still be refused.

    Rate models of axes that were excited on purpose or, failing that, flown at all; hover models where all their axes
    were excited on purpose; ``physical.motors`` where motors are logged, and ``physical.flight`` where their vehicle
    moved through the air besides.

    Parameters
    ----------
    settings
        Choices of the run: an axis of a given segment counts as excited, and a vehicle whose arm or layout is given
        has a size.
    """
    given = {segment.axis for segment in settings.segments} if settings else set()
    sized = settings is not None and (settings.arm_m or settings.layout) is not None
    each = [supports(record) for record in records]
    possible = {
        name
        for found in each
        for name, support in found.items()
        if support.possible or (sized and support.lacks == _NO_SIZE)
    }
    excited = given | {
        axis for axis in RATE_AXIS.values() if any(_usable_excitations(record, axis) for record in records)
    }
    return tuple(
        name
        for family in FAMILIES
        if family.in_all
        for name, axes in family.axes.items()
        if name in possible or (axes and (given if family.of_rates else excited).issuperset(axes))
    )


def unsupported(records: Sequence[FlightRecord], model: str) -> InsufficientDataError | None:
    """The error that no log supports a rate model, as ``inspect`` words it; ``None`` if one does.

    Parameters
    ----------
    model
        One of :data:`rotorid.models.families.RATE_AXIS`.
    """
    each = [(record, rate_support(record, model)) for record in records]
    if any(support.possible for _, support in each):
        return None
    # The log that comes closest: one that lacks a channel says less of what to fly.
    record, support = max(each, key=lambda item: _CLOSER.index(item[1].lacks))
    # Without an instrument the direct estimate is left: that alone stops no fit.
    needed = ", ".join(need.need for need in support.needs if not need.there and need.need != _INSTRUMENT)
    message = f"{record.source.name}: {support.because}"
    others = f" (the best of {len(each)} logs)" if len(each) > 1 else ""
    where = (
        model
        if support.lacks in ("other_vehicle", "bench_log", "oscillation")
        else _where(record, model, support.lacks)
    )
    return InsufficientDataError(
        f"{message}{others}",
        needed=needed,
        remedy=support.remedy,
        findings=[refusal(support.lacks, where, f"{message}.", **support.numbers)],
    )


def supporting_logs(records: Sequence[FlightRecord], model: str) -> tuple[Sequence[FlightRecord], tuple[Finding, ...]]:
    """The logs that may enter a rate model, and a warning for each whose vehicle or motors rule it out.

    Parameters
    ----------
    records, model
        As for :func:`unsupported`.

    Raises
    ------
    InsufficientDataError
        No log supports the model.
    """
    if error := unsupported(records, model):
        raise error
    ruled_out = {id(record): why for record in records if (why := _no_vehicle(record) or _limited(record)) is not None}
    findings = [
        warn(
            ruled_out[id(record)].lacks,
            record.source.name,
            f"{record.source.name} was left out: {ruled_out[id(record)].because}. The other logs were used.",
        )
        for record in records
        if id(record) in ruled_out
    ]
    return [record for record in records if id(record) not in ruled_out] if ruled_out else records, tuple(findings)


_CLOSER = (
    "other_vehicle",
    "bench_log",
    "missing_channel",
    "rate_too_low",
    "never_airborne",
    "oscillation",
    "no_excitation",
)
"""Kinds of what a log lacks, the one that comes closest to a model last."""


def _where(record: FlightRecord, model: str, lacks: str) -> str:
    """The channels or the axis that a refusal is about."""
    missing = [name for name in _channels(model) if name not in record.channel_names]
    return missing[0] if lacks == "missing_channel" else RATE_AXIS[model]


def _channels(model: str) -> tuple[str, str]:
    axis = RATE_AXES[model]
    return axis.input, axis.output


def rate_support(record: FlightRecord, model: str) -> Support:
    """Whether a log supports a rate model.

    Parameters
    ----------
    model
        One of :data:`rotorid.models.families.RATE_AXIS`.
    """
    axis = RATE_AXIS[model]
    rates = {channel: record.rate_hz(channel) for channel in _channels(model)}
    rich, ordinary = rich_excitations(record, axis), ordinary_flights(record, axis)
    likely = () if rich or ordinary else candidate_excitations(record, axis)
    tried = max(likely, key=lambda maneuver: maneuver.duration_s, default=None)
    moved = rich or ordinary or ([tried] if tried else [])
    instrument = find_instrument([Flight(record, maneuver) for maneuver in moved], axis) if moved else None
    verdict = (
        _no_vehicle(record)
        or _unlogged(record, rates)
        or _limited(record)
        or (_by_excitation(rich, rates, instrument) if rich else None)
        or _too_slow(record, rates)
        or (_by_ordinary(record, axis, ordinary, rates, instrument) if ordinary else None)
        or _unflown(record, axis, tried)
    )
    needs = verdict.needs or _needs(rates, axis, rich, ordinary, instrument)
    return replace(verdict, instrument=instrument if verdict.possible else None, needs=needs)


def ordinary_flights(record: FlightRecord, axis: Axis) -> tuple[Maneuver, ...]:
    """The parts in the air in which the stick, or a set-point that is the stick, moves an axis.

    Parameters
    ----------
    record
        A log that holds the command of the axis and what answers it at 40 Hz or more; of others nothing serves. A
        stick moves too slowly to show the gain by itself where neither lag nor delay can be seen.

    Returns
    -------
    tuple of Maneuver
        Of 20 s and more each, in order of time; empty where the log does not show this axis.
    """
    model = rate_model_of(axis)
    if min(record.rate_hz(name) for name in _channels(model)) < LOWEST_RATE_HZ:
        return ()
    return tuple(part for part in _long_flights(record, axis) if _by_stick(Flight(record, part), axis))


def _long_flights(record: FlightRecord, axis: Axis) -> list[Maneuver]:
    """The flights of 20 s and more; none where the vehicle never flew, or the log does not show whether it did."""
    try:
        flights = airborne(record).intervals
    except InsufficientDataError:
        return []
    return [
        Maneuver(axis=axis, kind="other", start_s=start_s, stop_s=stop_s, origin="given")
        for start_s, stop_s in flights
        if stop_s - start_s >= SHORTEST_ORDINARY_S
    ]


def _by_stick(flight: Flight, axis: Axis) -> bool:
    instrument = find_instrument([flight], axis)
    return instrument is not None and is_free([flight], instrument)


def nothing_excites(axes: Sequence[Axis], found: Sequence[Maneuver]) -> str:
    """Statement that only short maneuvers excite axes, or none, as the end of a sentence about a log.

    Examples
    --------
    >>> nothing_excites(["roll"], [Maneuver(axis="roll", kind="doublet", start_s=80.0, stop_s=82.0, origin="found")])
    'contains only short roll maneuvers (doublet at 80.0 s)'
    >>> nothing_excites(["roll", "pitch"], [])
    'contains no excitation of roll or pitch'
    """
    wanted = " or ".join(axes)
    if not found:
        return f"contains no excitation of {wanted}"
    kinds = ", ".join(f"{maneuver.kind} at {maneuver.start_s:.1f} s" for maneuver in found[:_LISTED])
    return f"contains only short {wanted} maneuvers ({kinds}{', …' if len(found) > _LISTED else ''})"


def dwell_of(record: FlightRecord, maneuver: Maneuver) -> float | None:
    """Frequency in rad/s at which a maneuver dwells; ``None`` for one with a band, or that cannot be judged."""
    if maneuver.kind != "other":
        return None
    flight = Flight(record, maneuver)
    name = maneuver.signal or find_instrument([flight], maneuver.axis) or f"{maneuver.axis}_command"
    for samples in flight.samples(name):
        if samples.values.size > _FEWEST_OF_A_DWELL:
            return single_frequency(samples.time_s, samples.values)
    return None


_FEWEST_OF_A_DWELL = 50


def dwells_in(record: FlightRecord, axis: Axis) -> tuple[tuple[Maneuver, float], ...]:
    """Stretches in which an axis was moved by one sine, and their frequencies in rad/s."""
    found = ((maneuver, dwell_of(record, maneuver)) for maneuver in candidate_excitations(record, axis))
    return tuple((maneuver, omega_rad_s) for maneuver, omega_rad_s in found if omega_rad_s is not None)


def dwells_alone(axis: Axis, frequencies_rad_s: Sequence[float]) -> str:
    """Statement that only sines move an axis, as the end of a sentence about a log.

    Examples
    --------
    >>> dwells_alone("roll", [12.57])
    'moves roll by a sine of 12.6 rad/s (2.0 Hz) alone, and one frequency is one point of a response, no model'
    """
    listed = " and ".join(
        f"{omega_rad_s:.3g} rad/s ({omega_rad_s / math.tau:.1f} Hz)" for omega_rad_s in frequencies_rad_s[:_LISTED]
    )
    one = len(frequencies_rad_s) == 1
    count = "one frequency is one point" if one else f"{len(frequencies_rad_s)} frequencies are as many points"
    return f"moves {axis} by {'a sine' if one else 'sines'} of {listed} alone, and {count} of a response, no model"


def nothing_above(top_rad_s: float) -> str:
    """Statement that the excitations of an axis end at a frequency.

    Examples
    --------
    >>> nothing_above(6.16), nothing_above(1.64)
    ('no excitation above 6 rad/s', 'no excitation above 1.6 rad/s')
    """
    rounded = f"{top_rad_s:.0f}" if top_rad_s >= _WHOLE_RAD_S else f"{top_rad_s:.2g}"
    return f"no excitation above {rounded} rad/s"


def segment_of(axis: str, start_s: float, stop_s: float) -> str:
    """The value of ``--segment`` that takes an interval.

    Examples
    --------
    >>> segment_of("roll", 0.0, 17.5512)
    'roll:0.00:17.55'
    """
    return f"{axis}:{start_s:.2f}:{stop_s:.2f}"


def _no_vehicle(record: FlightRecord) -> Support | None:
    """The refusal of a log of another vehicle than a multirotor, or of a bench."""
    if is_bench(record):
        needs = (Need(need="a vehicle that flies", there=False, found=bench_words(record)),)
        return Support(possible=False, because=ON_A_BENCH, needs=needs, lacks="bench_log")
    if not record.status.foreign:
        return None
    needs = (Need(need="a multirotor", there=False, found=record.status.vehicle),)
    return Support(possible=False, because=foreign_vehicle(record), needs=needs, lacks="other_vehicle")


ON_A_BENCH = "the log is of a bench, where nothing flies"


def foreign_vehicle(record: FlightRecord) -> str:
    """Description of a vehicle that is not a multirotor, as a clause."""
    return f"the vehicle is a {record.status.vehicle}, not a multirotor, according to {record.status.named_in}"


def _unlogged(record: FlightRecord, rates: Mapping[str, float]) -> Support | None:
    """The refusal of a log that lacks channels."""
    missing = [name for name in rates if name not in record.channel_names]
    if not missing:
        return None
    because = _lacks(record, missing)
    remedy = logging_advice(record, min(rates.values()), tuple(missing))
    return Support(possible=False, because=because, remedy=remedy, lacks="missing_channel")


def _lacks(record: FlightRecord, missing: Sequence[str]) -> str:
    """Clause on channels that a record does not have: the log lacks them, or they could have been read from it."""
    near = absence(record, *missing) != "not logged"
    return f"no {' or '.join(missing)} was read" if near else f"the log lacks {' and '.join(missing)}"


def _limited(record: FlightRecord) -> Support | None:
    """The refusal of a flight in which motors were at their limits so much that nothing else shows."""
    try:
        found = reviewed_oscillations(record)
    except InsufficientDataError:
        return None
    if not motors_limited(found):
        return None
    return Support(possible=False, because=limits_shown(found).rstrip("."), remedy=END_FIRST, lacks="oscillation")


def _usable_excitations(record: FlightRecord, axis: Axis) -> Sequence[Maneuver]:
    """Excitations of an axis of a multirotor whose motors have room."""
    return () if _no_vehicle(record) or _limited(record) else rich_excitations(record, axis)


def _by_excitation(rich: Sequence[Maneuver], rates: Mapping[str, float], instrument: str | None) -> Support:
    """Support by an excitation; one that ends at too low a frequency gives none."""
    top_rad_s = excited_to_rad_s(rich)
    if top_rad_s < LOWEST_TOP_RAD_S:
        return Support(
            possible=False,
            because=f"{nothing_above(top_rad_s)}; a rate model needs {LOWEST_TOP_RAD_S:g} rad/s and more",
            remedy="fly a faster sweep",
            lacks="no_excitation",
            numbers={"highest_rad_s": top_rad_s, "needed_rad_s": LOWEST_TOP_RAD_S},
        )
    estimate = f"joint estimate with {instrument}" if instrument else "direct estimate only; feedback may bias it"
    rate_hz = min(rates.values())
    slow = "" if rate_hz >= LOWEST_RATE_HZ else ", too slow for motor lag and delay of a small multirotor"
    because = f"{counted(len(rich), 'rich excitation')}, {rate_hz:.0f} Hz{slow}, {estimate}"
    return Support(possible=True, because=because, by="excitation")


def _too_slow(record: FlightRecord, rates: Mapping[str, float]) -> Support | None:
    """The refusal of a log without an excitation that is too slow for ordinary flying."""
    slow = [f"{name} at {rate:.3g} Hz" for name, rate in rates.items() if rate < LOWEST_RATE_HZ]
    if not slow:
        return None
    because = f"logged too slowly ({', '.join(slow)}); without a sweep at least {LOWEST_RATE_HZ:.0f} Hz is needed"
    remedy = logging_advice(record, min(rates.values()))
    return Support(possible=False, because=because, remedy=remedy, lacks="rate_too_low")


def _by_ordinary(
    record: FlightRecord, axis: Axis, parts: Sequence[Maneuver], rates: Mapping[str, float], instrument: str | None
) -> Support:
    """Support by ordinary flight."""
    flown_s = sum(part.duration_s for part in parts)
    because = (
        f"ordinary flight of {flown_s:.0f} s, {min(rates.values()):.0f} Hz, joint estimate with {instrument}: "
        "intervals several times wider than from a sweep; run rotorid identify to see whether the model fits"
    )
    return Support(
        possible=True, because=because, remedy=f"better: {flying_advice(record, axis)}", by="ordinary flight"
    )


def _unflown(record: FlightRecord, axis: Axis, tried: Maneuver | None) -> Support:
    """The refusal of a flight that moves an axis neither on purpose nor by stick; a candidate is pointed at."""
    found = find_excitations(record, axis)
    because = f"the log {nothing_excites([axis], found)}, and {_no_ordinary(record, axis)}"
    remedy = flying_advice(record, axis)
    if not found and (dwells := dwells_in(record, axis)):
        because = f"the log {dwells_alone(axis, [omega_rad_s for _, omega_rad_s in dwells])}"
    elif tried is not None:
        remedy += f", or try --segment {segment_of(axis, tried.start_s, tried.stop_s)}"
    elif not found and (never := never_flown(record)):
        return never
    return Support(possible=False, because=because, remedy=remedy, lacks="no_excitation")


def never_flown(record: FlightRecord) -> Support | None:
    """The refusal of a log whose vehicle never flew: what to fly on each axis would hide the one reason."""
    try:
        airborne(record)
    except InsufficientDataError as error:
        if never_flew(error):
            because = f"the log {error.came.removeprefix(record.source.name).strip().rstrip('.')}"
            return Support(possible=False, because=because, remedy=error.remedy, lacks="no_excitation")
    return None


def _no_ordinary(record: FlightRecord, axis: Axis) -> str:
    """Why the flights of a log do not serve an axis."""
    try:
        airborne(record)
    except InsufficientDataError as error:
        return "the vehicle never flew" if never_flew(error) else "the flight time is unknown"
    if not _long_flights(record, axis):
        return f"no flight lasts {SHORTEST_ORDINARY_S:.0f} s"
    if f"{axis}_stick" not in record.channel_names:
        return f"no {axis} stick is logged, nor a set-point that is the stick"
    return f"the {axis} stick does not move in flight"


def _needs(
    rates: Mapping[str, float],
    axis: Axis,
    rich: Sequence[Maneuver],
    ordinary: Sequence[Maneuver],
    instrument: str | None,
) -> tuple[Need, ...]:
    """Requirements of a rate model, and what the log has of each; without the last, feedback may bias the model."""
    least_hz = 0.0 if rich else LOWEST_RATE_HZ
    rates_needed = [
        Need(
            need=f"{name} at {LOWEST_RATE_HZ:.0f} Hz or more",
            there=rate > 0.0 and rate >= least_hz,
            found=(f"{rate:.0f} Hz" if rate >= _WHOLE_HZ else f"{rate:.3g} Hz") if rate else "not logged",
        )
        for name, rate in rates.items()
    ]
    return (
        *rates_needed,
        Need(
            need=f"a sweep, multisine or random binary signal on {axis}, or {SHORTEST_ORDINARY_S:.0f} s by stick",
            there=bool(rich or ordinary),
            found=_excitation_words(rich, ordinary),
        ),
        Need(need=_INSTRUMENT, there=bool(instrument), found=instrument or "none found"),
    )


def _excitation_words(rich: Sequence[Maneuver], ordinary: Sequence[Maneuver]) -> str:
    if not rich:
        return f"{sum(part.duration_s for part in ordinary):.0f} s flown by stick" if ordinary else "none found"
    tops = [maneuver.band_rad_s[1] for maneuver in rich if maneuver.band_rad_s]
    reach = f" up to {max(tops):.3g} rad/s" if tops else ""
    return f"{len(rich)} ({', '.join(dict.fromkeys(maneuver.kind.replace('_', ' ') for maneuver in rich))}){reach}"


def _coupled_support(record: FlightRecord, model: str) -> Support:
    """Whether a log supports a model of several axes: each of them has to be excited."""
    axes = family_of(model).axes[model]
    found = {axis: rich_excitations(record, axis) for axis in axes}
    needs = tuple(
        Need(
            need=f"a sweep, multisine or random binary signal on {axis}",
            there=bool(rich),
            found=_excitation_words(rich, ()),
        )
        for axis, rich in found.items()
    )
    if refused := _no_vehicle(record) or _limited(record):
        return replace(refused, needs=refused.needs or needs)
    if still := [axis for axis, rich in found.items() if not rich]:
        nothing = not any(find_excitations(record, axis) or candidate_excitations(record, axis) for axis in axes)
        if nothing and (never := never_flown(record)):
            return replace(never, needs=needs)
        because = f"the log contains no sweep of {listed(still)}"
        remedy = flying_advice(record, *still)
        return Support(possible=False, because=because, remedy=remedy, needs=needs, lacks="no_excitation")
    because = (
        f"{listed(axes)} {'was' if len(axes) == 1 else 'were'} excited; run rotorid identify to see whether the "
        "model fits"
    )
    return Support(possible=True, because=because, needs=needs, by="excitation")


def _motor_support(record: FlightRecord, model: str) -> Support:  # noqa: ARG001 - as all that look
    """Whether a log may support the physics of the motors: their outputs are there, and have room."""
    # Measured speeds stand for outputs.
    there = bool({"motor_1", "motor_speed_1"} & set(record.channel_names))
    needs = (Need(need="outputs of all motors", there=there, found="logged" if there else absence(record, "motor_1")),)
    if refused := _no_vehicle(record) or _limited(record):
        return replace(refused, needs=refused.needs or needs)
    if not there:
        remedy, because = motor_advice(record), _lacks(record, ["motor_1", "motor_speed_1"])
        return Support(possible=False, because=because, remedy=remedy, needs=needs, lacks="missing_channel")
    because = "motors are logged; run rotorid identify to see whether they explain the motion"
    return Support(possible=True, because=because, needs=needs, by="motors")


def _flight_support(record: FlightRecord, model: str) -> Support | None:  # noqa: ARG001 - as all that look
    """Whether a log may support the physics of flight; ``None`` where a log without motors would be asked for them."""
    motors = or_none(logged_speeds, record) or or_none(logged_outputs, record)
    if motors is None:
        return None
    if motors.sample_rate_hz < LOWEST_RATE_HZ:
        # The mixer of the vehicle may give them faster.
        motors = or_none(_fastest_motors, record) or motors
    stretch = _longest_flight(record)
    flown_s = stretch.duration_s if stretch else 0.0
    sensors_hz = min(record.rate_hz(name) for name in (*RATES, *ACCELERATIONS))
    moved, enough = ("none", False) if stretch is None else _motion_words(Flight(record, stretch))
    sized = _sized(record)
    needs = (
        Need(
            need=f"motors at {LOWEST_RATE_HZ:.0f} Hz or more",
            there=motors.sample_rate_hz >= LOWEST_RATE_HZ,
            found=_logged_at(motors),
        ),
        Need(
            need=f"gyro and accelerometer of three axes at {LOWEST_RATE_HZ:.0f} Hz or more",
            there=sensors_hz >= LOWEST_RATE_HZ,
            found=f"{sensors_hz:.0f} Hz" if sensors_hz else "not logged",
        ),
        Need(
            need=f"{SHORTEST_FLIGHT_S:.0f} s in the air",
            there=flown_s >= SHORTEST_FLIGHT_S,
            found=f"{flown_s:.0f} s",
        ),
        Need(need="motion through the air", there=enough, found=moved),
        Need(need="the size of the vehicle", there=sized, found="known" if sized else "not in the log"),
    )
    if refused := _no_vehicle(record) or _limited(record) or never_flown(record):
        return replace(refused, needs=refused.needs or needs)
    missing = next((number for number, need in enumerate(needs) if not need.there), None)
    if missing is None:
        because = f"motors at {motors.sample_rate_hz:.0f} Hz, {moved} in {flown_s:.0f} s of flight"
        return Support(possible=True, because=because, needs=needs, by="flight")
    lacks, remedy = (
        ("rate_too_low", slow_motor_advice(record, motors.sample_rate_hz)),
        ("rate_too_low" if sensors_hz else "missing_channel", logging_advice(record, sensors_hz, ACCELERATIONS)),
        ("no_excitation", "fly longer"),
        ("no_excitation", "fly figures at several speeds and heights"),
        (_NO_SIZE, "measure from the center of gravity to the farthest rotor and add --arm METERS to rotorid identify"),
    )[missing]
    because = f"physical.flight needs {needs[missing].need}: {needs[missing].found}"
    return Support(possible=False, because=because, remedy=remedy, needs=needs, lacks=lacks)


_NO_SIZE = "not_identifiable"
"""What a vehicle lacks whose size nobody knows."""

_MOVED_M_S, _TILTED_RAD, _FELT_M_S2 = LEAST_SPEED_M_S, 0.1, 1.0
"""Standard deviations of horizontal velocity, tilt, or force along the rotors from which a flight shows the air."""


def _fastest_motors(record: FlightRecord) -> MotorHistory:
    """The motors as a fit takes them."""
    return fastest_motors(record, layout_of(record))


def _longest_flight(record: FlightRecord) -> Maneuver | None:
    """The longest flight; the whole log where it does not show when it flew."""
    try:
        start_s, stop_s = longest_flight(record)
    except InsufficientDataError:
        return None
    return Maneuver(axis="thrust", kind="other", start_s=start_s, stop_s=stop_s, origin="found")


def _motion_words(flight: Flight) -> tuple[str, bool]:
    """How far a flight moved, by the best channel that the log has, and whether that shows the air."""
    for names, least, unit in (
        (EARTH_VELOCITIES[:2], _MOVED_M_S, "m/s rms"),
        (VELOCITIES[:2], _MOVED_M_S, "m/s rms"),
        (ATTITUDE[:2], _TILTED_RAD, "rad of tilt rms"),
        (ACCELERATIONS[2:], _FELT_M_S2, "m/s^2 rms along the rotors"),
    ):
        parts = [next((part.values for part in flight.samples(name) if part.values.size), None) for name in names]
        known = [float(values.std()) for values in parts if values is not None]
        if len(known) == len(names) and any(known):
            moved = math.hypot(*known)
            return f"{moved:.2g} {unit}", moved >= least
    return "nothing logged", False


def _sized(record: FlightRecord) -> bool:
    """Whether the log shows how far the rotors are from the center of gravity."""
    try:
        return layout_of(record).arm_known
    except RotoridError:
        return False


def _speed_support(record: FlightRecord, model: str) -> Support | None:  # noqa: ARG001 - as all that look
    """Whether a log holds outputs and speeds of all motors, fast enough; ``None`` without speeds."""
    speeds, outputs = or_none(logged_speeds, record), or_none(logged_outputs, record)
    if speeds is None:
        return None
    rate_hz = 0.0 if outputs is None else min(speeds.sample_rate_hz, outputs.sample_rate_hz)
    needs = (
        Need(need="outputs of all motors", there=outputs is not None, found=_logged_at(outputs)),
        Need(need="speeds of all motors", there=True, found=_logged_at(speeds)),
    )
    if outputs is None:
        remedy = logging_advice(record, 0.0, ("motor_1",))
        because = "the log has speeds of the motors and no outputs"
        return Support(possible=False, because=because, remedy=remedy, needs=needs, lacks="missing_channel")
    if rate_hz < LOWEST_RATE_HZ:
        because = f"outputs and speeds of the motors at {rate_hz:.0f} Hz; {LOWEST_RATE_HZ:.0f} Hz are needed"
        remedy = slow_motor_advice(record, rate_hz)
        return Support(possible=False, because=because, remedy=remedy, needs=needs, lacks="rate_too_low")
    because = f"outputs and speeds of {min(speeds.motors, outputs.motors)} motors at {rate_hz:.0f} Hz"
    return Support(possible=True, because=because, needs=needs, by="motor speeds")


def _logged_at(history: MotorHistory | None) -> str:
    return "not logged" if history is None else f"{history.sample_rate_hz:.0f} Hz"


def _rig_support(record: FlightRecord, model: str) -> Support | None:
    """Whether a record supports a model of a vehicle on a pivot; ``None`` where no single motor was moved."""
    if not motor_excitations(record) and not is_bench(record):
        return None
    family = family_of(model)
    motors, axes, outputs = library_model(model).inputs, family.axes[model], family.outputs[model]
    flights = [Flight(record, m) for axis in axes for m in rich_excitations(record, axis)]
    missing = [name for name in motors if name not in record.channel_names]
    if len(axes) == 1 and len(missing) < len(motors):
        # One voltage may drive both motors of an axis, and one motor may stand still.
        motors, missing = tuple(name for name in motors if name not in missing), []
    instruments = [name for motor in motors if (name := own_instrument(flights, motor))] if flights else []
    unswept = [axis for axis in axes if not any(flight.axis == axis for flight in flights)]
    logged = [name for name in outputs if name in record.channel_names]
    rate = min((record.rate_hz(name) for name in (*motors, *logged)), default=0.0)
    needs = (
        Need(need=", ".join(motors), there=not missing, found=f"{rate:.3g} Hz" if not missing else "not all logged"),
        Need(need=" or ".join(outputs), there=bool(logged), found=", ".join(logged) or "not logged"),
        Need(
            need=f"single motors swept on {' and '.join(axes)}",
            there=not unswept,
            found=f"{counted(len(flights), 'sweep')}" if flights else "none found",
        ),
        Need(
            need="their test inputs, free of feedback",
            there=len(instruments) == len(motors),
            found=", ".join(instruments) or "none that move",
        ),
    )
    if missing or not logged:
        lacking = missing or [" or ".join(outputs)]
        because = _lacks(record, lacking)
        return Support(possible=False, because=because, needs=needs, lacks="missing_channel")
    if unswept:
        return Support(
            possible=False,
            because=f"no sweep of single motors turns the vehicle in {' or '.join(unswept)}",
            remedy="add a second log with it",
            needs=needs,
            lacks="no_excitation",
        )
    free = needs[-1].there
    estimate = f"joint estimate with {', '.join(instruments)}" if free else "direct estimate only; feedback may bias it"
    return Support(
        possible=True,
        because=f"{counted(len(flights), 'rich excitation')}, {rate:.0f} Hz, {estimate}",
        instrument=", ".join(instruments) if free else None,
        needs=needs,
        by="excitation",
    )


_LOOKS: Mapping[Needs, Callable[[FlightRecord, str], Support | None]] = {
    "axis": rate_support,
    "axes": _coupled_support,
    "motors": _motor_support,
    "flight": _flight_support,
    "motor speeds": _speed_support,
    "single motors": _rig_support,
}
"""Whether a log has what a family needs; no answer where nobody would ask it of such a log."""
