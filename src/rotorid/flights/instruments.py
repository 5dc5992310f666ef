"""Instruments: the channels that excite the inputs of a model and contain no feedback.

An instrument is what a joint input–output estimate needs in closed loop: an injected test signal, a stick, or a
set-point that no outer loop moves. It belongs to a maneuver (:func:`instrument_of`) and to the band in which it has
power (:func:`band_of_instrument`). Maneuvers count as far as the vehicle was in the air (:func:`while_flying`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rotorid.data.findings import Finding, warn
from rotorid.data.record import AXES, FlightRecord, Maneuver
from rotorid.errors import ModelError, UsageError
from rotorid.flights.flights import Flight
from rotorid.settings.measuring import MeasureSettings
from rotorid.signal.airborne import Airborne, airborne_by_thrust, evidence_words
from rotorid.signal.clock import even_step_s, missing_channel
from rotorid.signal.excitations import (
    RATE_SETPOINTS,
    excitation_signals,
    find_excitations,
    least_motion,
    sets_rates_directly,
)
from rotorid.typing import Axis, FloatArray


def axis_of(input: str) -> Axis:
    """Axis of a command channel.

    Raises
    ------
    ModelError
        The input of a model is something else than one of the four commands.
    """
    axis = input.removesuffix("_command")
    if axis not in AXES or axis == input:
        raise ModelError(
            f"the input {input} is no controller command",
            needed=f"one of {', '.join(f'{axis}_command' for axis in AXES)}",
        )
    return axis  # type: ignore[return-value]


def is_command(input: str) -> bool:
    """Whether a channel is the command of an axis.

    Examples
    --------
    >>> is_command("roll_command"), is_command("theta")
    (True, False)
    """
    return input.removesuffix("_command") in AXES and input.endswith("_command")


_AXIS_OF_OUTPUT: Mapping[str, Axis] = {
    **dict.fromkeys(("p", "phi", "p_dot", "ay", "v", "v_dot"), "roll"),
    **dict.fromkeys(("q", "theta", "q_dot", "ax", "u", "u_dot"), "pitch"),
    **dict.fromkeys(("r", "psi", "r_dot"), "yaw"),
}


def axes_of(inputs: Sequence[str], outputs: Sequence[str]) -> tuple[Axis, ...]:
    """Axes whose excitations show responses: those of the commands, or of the outputs where no input is a command.

    Examples
    --------
    >>> axes_of(("pitch_command", "thrust_command"), ("q", "az")), axes_of(("theta",), ("u_dot",))
    (('pitch', 'thrust'), ('pitch',))
    """
    named = [axis_of(name) for name in inputs if is_command(name)]
    guessed = [_AXIS_OF_OUTPUT.get(name, "thrust") for name in outputs]
    return tuple(dict.fromkeys(named or guessed))


def instrument_of(flight: Flight, axis: Axis) -> str | None:
    """The channel that excites ``axis`` in one maneuver and contains no feedback, or ``None``.

    The signal that the log declares or that shows the maneuver; of an interval without a name, the one that shows what
    was flown there; else the best candidate that moves. Candidates are what the reader knows to be free of feedback,
    set-points of rates that are the stick, then set-points from the outermost loop inward: as soon as an outer loop is
    excited, the set-points inside it contain its feedback. A pilot who corrects a drift while a program flies a sweep
    moves the stick too, and excites nothing where the sweep is fast.
    """
    record, maneuver = flight.record, flight.maneuver
    within = (maneuver.start_s, maneuver.stop_s)
    own: tuple[str, ...] = (
        (maneuver.signal,) if maneuver.axis == axis and maneuver.signal in record.channel_names else ()
    )
    named = tuple(dict.fromkeys((*excitation_signals(record, axis, within=within), *own)))
    moving = [name for name in named if not name.endswith("_command") and _moves(flight, name)]
    if moving and moving[0] == RATE_SETPOINTS.get(axis) and sets_rates_directly(record, within):
        # It is the stick, and logged faster.
        return moving[0]
    shown = [maneuver] if own else _flown_in(record, axis, within)
    ranked = [*(maneuver.signal for maneuver in shown if maneuver.signal in moving), *moving]
    return ranked[0] if ranked else None


def _flown_in(record: FlightRecord, axis: Axis, within: tuple[float, float]) -> list[Maneuver]:
    """Excitations of an axis that fill most of an interval, what the log declares first, then the longest."""
    start_s, stop_s = within
    found = [
        (min(m.stop_s, stop_s) - max(m.start_s, start_s), m)
        for m in find_excitations(record, axis)
        if m.start_s < stop_s and m.stop_s > start_s
    ]
    filling = [(shared_s, m) for shared_s, m in found if shared_s > 0.5 * (stop_s - start_s)]
    return [m for _, m in sorted(filling, key=lambda item: (item[1].origin == "found", -item[0]))]


def find_instrument(flights: Sequence[Flight], axis: Axis) -> str | None:
    """The channel that excites ``axis`` in all its maneuvers and contains no feedback, or ``None``.

    The instrument of all of them (:func:`instrument_of`), or where they have several, the best candidate that moves in
    each. Maneuvers of different instruments are better measured apart (:func:`by_instruments`).
    """
    own = [flight for flight in flights if flight.axis == axis] or list(flights)
    each = {instrument_of(flight, axis) for flight in own}
    if len(each) == 1:
        return each.pop()
    candidates = [
        excitation_signals(flight.record, axis, within=(flight.maneuver.start_s, flight.maneuver.stop_s))
        for flight in own
    ]
    shared = set.intersection(*map(set, candidates)) if candidates else set()
    for name in candidates[0]:
        if name not in shared or name.endswith("_command") or not all(_moves(flight, name) for flight in own):
            continue
        # A log of another axis without the channel counts as one in which it did not move.
        return name
    return None


def by_instruments(
    flights: Sequence[Flight], inputs: Sequence[str], settings: MeasureSettings
) -> list[tuple[Flight, ...]]:
    """Maneuvers in groups with one instrument for each input; all in one group if that is impossible.

    Parameters
    ----------
    inputs
        Of the responses.
    settings
        Instruments that were given hold for all of them, and a direct estimate needs none.
    """
    whole = [tuple(flights)]
    if settings.estimate == "direct" or settings.instruments:
        return whole
    axes = [axis_of(name) for name in inputs if is_command(name)]
    own = {flight: instrument_of(flight, flight.axis) if flight.axis in axes else "" for flight in flights}
    if None in own.values() or all(len({own[f] for f in flights if f.axis == axis}) < 2 for axis in axes):
        return whole
    if len(inputs) == 1:
        keys: dict[Flight, object] = dict(own)
    else:
        # Of several inputs only whole logs: each shows what the others do at the same time.
        logs = {id(f.record): frozenset((g.axis, own[g]) for g in flights if g.record is f.record) for f in flights}
        if any(len({axis for axis, _ in pairs}) < len(pairs) for pairs in logs.values()):
            return whole
        keys = {flight: logs[id(flight.record)] for flight in flights}
    groups: dict[object, list[Flight]] = {}
    for flight in flights:
        groups.setdefault(keys[flight], []).append(flight)
    return [tuple(group) for group in groups.values()]


def own_instrument(flights: Sequence[Flight], input: str) -> str | None:
    """The test input of an input that is no command, ``motor_3_excitation`` of ``motor_3``, or ``None``.

    Every record holds it, and it moves in one maneuver at least: in the others another motor was swept.
    """
    name = f"{input}_excitation"
    logged = all(name in flight.record.channel_names for flight in flights)
    return name if logged and any(_moves(flight, name) for flight in flights) else None


def is_free(flights: Sequence[Flight], name: str) -> bool:
    """Whether a channel contains no feedback in any of the maneuvers: a stick, or a set-point that is one."""
    axis = next((axis for axis, setpoint in RATE_SETPOINTS.items() if setpoint == name), None)
    if axis is None:
        return name.endswith("_stick")
    return all(
        sets_rates_directly(flight.record, (flight.maneuver.start_s, flight.maneuver.stop_s)) for flight in flights
    )


def open_loop(flights: Sequence[Flight], *inputs: str) -> bool:
    """Whether the log declares inputs as the excitation itself, so that nothing was fed back."""
    return all(flight.maneuver.signal in inputs and flight.maneuver.origin == "declared" for flight in flights)


def is_injection(name: str) -> bool:
    """Whether a channel is a test signal that the autopilot adds: where it is not logged, it was zero.

    Examples
    --------
    >>> is_injection("roll_excitation"), is_injection("roll_stick")
    (True, False)
    """
    return name.endswith("_excitation")


_FEWEST_SAMPLES = 10


def _moves(flight: Flight, name: str) -> bool:
    for samples in flight.samples(name):
        if samples.values.size > _FEWEST_SAMPLES:
            return float(np.ptp(samples.values)) > least_motion(flight.record, name)
    return False


_LEAST_OF_LARGEST = 1e-4
"""Share of its largest power in an octave below which an instrument has none: the steps of a radio make as much."""

_MOST_OF_LARGEST = 0.1
"""Share of its largest power in an octave from which a test signal excites: 3 octaves on both sides of its clock."""

_LOWEST_RAD_S, _OCTAVES = 0.1, 19

_FLANKS = 40.0


def band_of_instrument(flights: Sequence[Flight], name: str) -> tuple[float, float]:
    """Lowest and highest frequency in rad/s between which an instrument has power, over all maneuvers together.

    Octave by octave, down to a ten-thousandth of the largest; beyond that a joint estimate shows steps of the radio and
    what a slow log makes of them. It ends at 80 % of the Nyquist frequency of its log.

    Parameters
    ----------
    name
        The instrument. One that no log holds, or that stands still, has no limits.
    """
    low, high = _band_of_power(flights, name, _LEAST_OF_LARGEST) or (0.0, np.inf)
    return (0.0 if low <= _LOWEST_RAD_S else low), high


def excited_band(flights: Sequence[Flight], name: str) -> tuple[float, float] | None:
    """Lowest and highest frequency in rad/s of the octaves in which a channel has most of its power.

    That is a tenth of the octave with the most. Half periods do not show it: a square wave has power far above the
    frequency at which it switches, and a random one far below.

    Parameters
    ----------
    name
        A test signal, or the input that it moves.

    Returns
    -------
    tuple of float, optional
        ``None`` where no log holds the channel, or it stands still.
    """
    return _band_of_power(flights, name, _MOST_OF_LARGEST)


def _band_of_power(flights: Sequence[Flight], name: str, least: float) -> tuple[float, float] | None:
    """Band of the octaves in which a channel has this share of the largest power; ``None`` if it does not move."""
    edges = np.geomspace(_LOWEST_RAD_S, _LOWEST_RAD_S * 2.0**_OCTAVES, _OCTAVES + 1, dtype=np.float64)
    powers = [found for flight in flights if (found := _octaves(flight, name, edges)).size]
    if not powers or not np.any(powers):
        return None
    power = np.max(powers, axis=0)
    excited = np.flatnonzero(power > least * power.max())
    fastest = max(0.8 * np.pi * topic.sample_rate_hz for flight in flights for topic, _ in flight.record.holding(name))
    return float(edges[excited[0]]), min(float(edges[excited[-1] + 1]), fastest)


def _octaves(flight: Flight, name: str, edges_rad_s: FloatArray) -> FloatArray:
    """Power of a channel between frequencies, shape ``(edges - 1,)``; empty if it does not move or has few samples."""
    for samples in flight.samples(name):
        if samples.values.size > _FEWEST_SAMPLES and np.ptp(samples.values) > 0.0:
            step_s = even_step_s(samples.time_s)
            grid = np.arange(samples.time_s[0], samples.time_s[-1], step_s)
            values = np.interp(grid, samples.time_s, samples.values)
            # Flanks of a fortieth of the time: a sweep begins and ends within a few seconds of its ends.
            place = np.linspace(0.0, 1.0, values.size)
            taper = np.sin(0.5 * np.pi * np.clip(_FLANKS * np.minimum(place, 1.0 - place), 0.0, 1.0)) ** 2
            power = np.abs(np.fft.rfft((values - values.mean()) * taper)) ** 2
            omega = 2.0 * np.pi * np.fft.rfftfreq(values.size, step_s)
            summed = np.concatenate([[0.0], np.cumsum(power)])
            return np.diff(summed[np.searchsorted(omega, edges_rad_s)])
    return np.zeros(0)


def choose_instruments(
    flights: Sequence[Flight], inputs: Sequence[str], outputs: Sequence[str], settings: MeasureSettings
) -> tuple[str, ...]:
    """Instruments for all inputs, or none.

    Raises
    ------
    UsageError
        The joint estimate was asked for and an instrument is missing, or the number does not match.
    """
    if settings.estimate == "direct":
        return ()
    if settings.instruments:
        _require_instruments(flights, inputs, outputs, settings.instruments)
        if len(settings.instruments) != len(inputs):
            raise UsageError(
                f"{len(settings.instruments)} instruments for {len(inputs)} inputs", needed="one for each input"
            )
        return settings.instruments
    found = [
        find_instrument(flights, axis_of(name)) if is_command(name) else own_instrument(flights, name)
        for name in inputs
    ]
    if all(found):
        return tuple(name for name in found if name)
    if settings.estimate == "joint":
        missing = ", ".join(name for name, instrument in zip(inputs, found, strict=True) if not instrument)
        raise UsageError(
            f"no instrument for {missing} was found in the log",
            needed="a channel that excites it and contains no feedback",
            remedy="name one with --instrument, or use --estimate direct",
        )
    return ()


def _require_instruments(
    flights: Sequence[Flight], inputs: Sequence[str], outputs: Sequence[str], instruments: Sequence[str]
) -> None:
    for name in instruments:
        if name in (*inputs, *outputs):
            raise UsageError(
                f"{name} is part of the response itself",
                needed="an instrument: a channel that excites the input and contains no feedback",
                remedy="name another one, or use --estimate direct",
            )
        for flight in flights:
            if name not in flight.record.channel_names:
                raise missing_channel(flight.record, name, remedy="name a channel of the log with --instrument")


def _instruments_of(inputs: Sequence[str]) -> str:
    """Names of the channels that would excite an input without feedback."""
    axes = [name.removesuffix("_command") for name in inputs if is_command(name)]
    return f"{axes[0]}_stick or {axes[0]}_excitation" if axes else "roll_stick or roll_excitation"


def no_instrument(inputs: Sequence[str]) -> Finding:
    """The warning that only the direct estimate is available."""
    names = ", ".join(inputs)
    return warn(
        "closed_loop_bias",
        names,
        f"No excitation without feedback is logged for {names}, so the direct estimate was used. In closed loop "
        "it is biased toward the inverse of the controller wherever gusts and noise dominate. Log the sticks or the "
        f"injected signals, in a mapping as {_instruments_of(inputs)}.",
    )


_WORTH_CUTTING_S = 0.25
"""A maneuver that loses less on the ground stays as it is."""

_SHORTEST_LEFT = 0.5
"""A maneuver of which a smaller share was flown is more likely mistaken for landed."""

_SHORTEST_LEFT_S = 2.0
"""Least duration that flags have to leave of a maneuver."""


def while_flying(flights: Sequence[Flight]) -> tuple[list[Flight], list[Finding]]:
    """Maneuvers without what lies before take-off or after landing, and a warning for each that lost something."""
    airborne_parts: dict[str, Airborne | None] = {}
    cut_down, findings = [], []
    for flight in flights:
        record = flight.record
        key = record.source.sha256 or record.source.name
        if key not in airborne_parts:
            airborne_parts[key] = airborne_by_thrust(record)
        kept, remark = _flying_part(flight.maneuver, airborne_parts[key])
        cut_down.append(replace(flight, maneuver=kept))
        findings += remark
    return cut_down, findings


def _flying_part(maneuver: Maneuver, flight: Airborne | None) -> tuple[Maneuver, list[Finding]]:
    if flight is None:
        return maneuver, []
    shared = [(max(a, maneuver.start_s), min(b, maneuver.stop_s)) for a, b in flight.intervals]
    start_s, stop_s = max(shared, key=lambda part: part[1] - part[0], default=(maneuver.start_s, maneuver.start_s))
    lost_s = maneuver.duration_s - max(stop_s - start_s, 0.0)
    if lost_s <= _WORTH_CUTTING_S:
        return maneuver, []
    whole = f"{maneuver.axis} {maneuver.start_s:.2f} to {maneuver.stop_s:.2f} s"
    least_s = _SHORTEST_LEFT * maneuver.duration_s
    if stop_s - start_s < (min(_SHORTEST_LEFT_S, least_s) if flight.by_flags else least_s):
        kept, message = (
            maneuver,
            f"{whole} lies mostly on the ground, {evidence_words(flight.seen_in)}; it was used unchanged.",
        )
    else:
        kept = replace(maneuver, start_s=start_s, stop_s=stop_s)
        message = (
            f"{whole} reaches beyond the flight, {evidence_words(flight.seen_in)}; {start_s:.2f} to {stop_s:.2f} "
            "s was used."
        )
    numbers = {"start_s": kept.start_s, "stop_s": kept.stop_s, "on_ground_s": lost_s}
    return kept, [warn("airborne", whole, message, **numbers)]
