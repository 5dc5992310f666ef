"""Part of a model that the data can show: excited inputs, available outputs, and the trim.

:func:`scoped` cuts a structure to the inputs that were excited and the outputs that the logs hold, and says what was
left out. :func:`trimmed` sets the speeds and angles about which the model is linearized: given ones, or the means of
the maneuvers, where these are no hover.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.data.findings import Finding, refusal, remark, warn
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fits.frequency.trim_choice import Trim
from rotorid.flights.coverage import HOVER_M_S, thrust_spread
from rotorid.flights.flights import Flight
from rotorid.flights.instruments import axis_of, is_command
from rotorid.flights.segments import holds, require_channels
from rotorid.flights.selection import Selection
from rotorid.flights.steady_wind import LEAST_LEAN_RAD, in_wind_of, mean_of
from rotorid.models.derived import SPREAD
from rotorid.models.expression import Expression
from rotorid.models.families import known_names
from rotorid.models.library import MOTOR_LAG
from rotorid.models.steady_wind import HEAVE_SHARE, HEAVE_SHARES, STEADY_DRAG, lean_of
from rotorid.models.structure import LinearStructure, connected
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.resolve import require_known
from rotorid.signal.clock import resample
from rotorid.signal.excitations import rich_excitations
from rotorid.signal.kinematics import ingredients
from rotorid.signal.quality import led_share

INERTIAL = ("p", "q", "r", "ax", "ay", "az")
"""Outputs that sensors measure. Attitude and speed of a log are estimates of a filter, with delays of its own."""

_SLOWEST_SHARE = 0.8


@dataclass(frozen=True, kw_only=True, eq=False)
class Scoped:
    """A structure cut to what can be fitted.

    Parameters
    ----------
    structure
        With the inputs and outputs that are left.
    findings
        What was left out, and why.
    """

    structure: LinearStructure
    findings: tuple[Finding, ...] = ()


def scoped(
    structure: LinearStructure,
    selection: Selection,
    records: Sequence[FlightRecord],
    settings: IdentifySettings,
    *,
    joined: bool = False,
) -> Scoped:
    """Cut a structure to the inputs that were excited and the outputs that the records hold.

    Outputs are those that were asked for, or those that sensors measure; where the log has all channels at one rate,
    as data for identification have, the estimated ones too.

    Parameters
    ----------
    structure
        The whole model.
    selection
        Maneuvers that will be fitted.
    records
        Logs behind them.
    joined
        Whether an output counts that any record holds, as for responses, each of which may come from some of the
        records; else it must be in all of them.

    Raises
    ------
    InsufficientDataError
        None of the outputs is in the records, none of them follows the inputs that were excited, or the controller
        moved an input that was not excited with one that was.
    ModelError
        A name was given that the model does not have.
    UsageError
        A parameter was given that takes no part in what is left of the model.
    """
    require_known(structure, settings)
    axes = {flight.axis for flight in selection.fitted}
    excited = [name for name in structure.inputs if not is_command(name) or axis_of(name) in axes]
    moved = connected(structure.select(inputs=excited))
    outputs = settings.outputs or (_outputs_of_any if joined else _outputs_there)(moved, records)
    if joined:
        for name in outputs:
            if not any(holds(record, name) for record in records):
                require_channels(records[0], [name])
    else:
        for record in records:
            require_channels(record, outputs)
    smaller = connected(structure.select(outputs=outputs, inputs=excited))
    lost = [name for name in structure.parameters.names if name not in smaller.parameters.names]
    _require_left(lost, smaller, structure, settings)
    _refuse_led_inputs(structure, [name for name in structure.inputs if name not in excited], selection)
    gone = [name for name in lost if name not in moved.parameters.names]
    passed = [name for name in moved.outputs if name not in smaller.outputs]
    return Scoped(
        structure=smaller,
        findings=(
            *_not_excited([name for name in structure.inputs if name not in excited], gone),
            *_without_response([name for name in excited if name not in smaller.inputs], settings.outputs, smaller),
            *_without(passed, smaller, [name for name in lost if name not in gone], settings),
        ),
    )


_LED = 0.3
"""Part of the motion of a command that goes with another one, from which on the controller counts as its cause."""


def _refuse_led_inputs(structure: LinearStructure, cut: Sequence[str], selection: Selection) -> None:
    """Refuse a model of whose inputs one was not excited and was moved by the controller with one that was.

    What that input does would be taken for what the excited one does: of pitch sweeps under a hold of height Z_w came
    out with the sign of a vehicle that runs away, 48 deviations from its value, and M_w and Z_pitch with it.

    Raises
    ------
    InsufficientDataError
        There is such an input.
    """
    for name in filter(is_command, cut):
        share, by = max((_led_share(flight, name), f"{flight.axis}_command") for flight in selection.fitted)
        if share > _LED:
            message = (
                f"{name} was not excited and {100.0 * share:.0f} % of its motion follows {by}: the controller "
                f"moved it, so {structure.name} cannot separate its effect from that of {by}."
            )
            raise InsufficientDataError(
                message.removesuffix("."),
                needed=f"an excitation of {name} in addition to {by}",
                remedy=f"sweep {name} too, or fit a model of the excited axis",
                findings=[refusal("correlated_inputs", f"{name}/{by}", message, share=share)],
            )


def _led_share(flight: Flight, other: str) -> float:
    """Share of a command's motion correlated with the axis of a maneuver; zero if one is not logged."""
    own = f"{flight.axis}_command"
    if own == other or not {own, other} <= set(flight.record.channel_names):
        return 0.0
    start_s, stop_s = flight.maneuver.start_s, flight.maneuver.stop_s
    try:
        longest = resample(flight.record, channels=(own, other), start_s=start_s, stop_s=stop_s).longest
    except InsufficientDataError:
        return 0.0
    return led_share(longest, own, other)


def with_channels_of(
    structure: LinearStructure, records: Sequence[FlightRecord], *, joined: bool = False
) -> tuple[Sequence[FlightRecord], tuple[Finding, ...]]:
    """The logs that hold what a model needs, where some do; a warning for each other one.

    Where no log holds it, all are kept: what the excited part of the model needs is found out later.

    Parameters
    ----------
    joined
        Whether one input that was excited will do, with any of the outputs, as for responses, each of which may come
        from some of the logs; else all inputs are needed.
    """
    lacking = {id(record): _lacking(structure, record) for record in records}
    if joined:
        lacking |= {id(record): "" for record in records if _excites_some_input(structure, record)}
    kept = [record for record in records if not lacking[id(record)]]
    if not kept or len(kept) == len(records):
        return records, ()
    return kept, tuple(
        warn(
            "missing_channel",
            record.source.name,
            f"{record.source.name} contains no {lacking[id(record)]} and was left out; the other logs were used.",
        )
        for record in records
        if lacking[id(record)]
    )


def require_common_axes(structure: LinearStructure, records: Sequence[FlightRecord]) -> None:
    """Refuse several logs that cannot be joined in one model.

    Raises
    ------
    UsageError
        A channel has other units in one than in another, or none of them holds an input beside an output.
    """
    if len(records) < 2:
        return
    for name in (*structure.inputs, *structure.outputs):
        units = {
            topic.channels[row].unit: record.source.name for record in records for topic, row in record.holding(name)
        }
        if len(units) > 1:
            unit_words = " and ".join(f"{unit} in {log}" for unit, log in units.items())
            raise UsageError(
                f"{name} has different units: {unit_words}",
                needed="one unit in all joined logs",
                remedy="set its unit with --map",
            )
    if not any(
        any(name in record.channel_names for name in structure.inputs)
        and any(holds(record, name) for name in structure.outputs)
        for record in records
    ):
        names = ", ".join(record.source.name for record in records)
        raise UsageError(
            f"none of {names} contains both an input and an output of {structure.name}",
            needed=f"one of {', '.join(structure.inputs)} with one of {', '.join(structure.outputs)}",
            remedy="choose the model of their axes, or name the channels with --map",
        )


def _excites_some_input(structure: LinearStructure, record: FlightRecord) -> bool:
    """Whether some input of a model was excited in a log that also has an output."""
    commands = [name for name in structure.inputs if is_command(name) and name in record.channel_names]
    excited = any(rich_excitations(record, axis_of(name)) for name in commands)
    return excited and any(holds(record, name) for name in structure.outputs)


def _lacking(structure: LinearStructure, record: FlightRecord) -> str:
    """The first channel that a log lacks for a model; empty where it lacks none."""
    logged = record.channel_names
    missing = next((name for name in structure.inputs if name not in logged), "")
    if missing:
        return missing
    there = any(name in logged or set(ingredients(name, logged) or ("",)) <= set(logged) for name in structure.outputs)
    return "" if there else " or ".join(structure.outputs)


def _outputs_there(structure: LinearStructure, records: Sequence[FlightRecord]) -> tuple[str, ...]:
    """Outputs in every record: of estimated ones those as fast as the sensors.

    What can be computed from other channels counts where nothing is logged, and in a model of the user's own, whose
    outputs were written down on purpose.
    """
    there = [name for name in structure.outputs if all(name in record.channel_names for record in records)]
    computed = [name for name in structure.outputs if name not in there and all(holds(one, name) for one in records)]
    if computed and (not there or structure.name not in known_names()):
        return tuple(name for name in structure.outputs if name in there or name in computed)
    if not there:
        # Rather the sentence that names the missing channel and what it could be made of.
        for record in records:
            require_channels(record, [name for name in structure.outputs if name in INERTIAL][:1] or structure.outputs)
        raise InsufficientDataError(
            f"the logs contain no output of {structure.name}", needed=f"one of {', '.join(structure.outputs)}"
        )
    sensed = [name for name in there if name in INERTIAL]
    if not sensed:
        return tuple(there)
    fastest = min(max(record.rate_hz(name) for name in sensed) for record in records)
    return tuple(
        name
        for name in there
        if name in INERTIAL or all(_same_topic(record, name, sensed, fastest) for record in records)
    )


def _outputs_of_any(structure: LinearStructure, records: Sequence[FlightRecord]) -> tuple[str, ...]:
    """Outputs in any record, of estimated ones those as fast as its sensors."""
    holding = [record for record in records if any(name in record.channel_names for name in structure.outputs)]
    there = {name for record in holding for name in _outputs_there(structure, [record])}
    return tuple(name for name in structure.outputs if name in there) or _outputs_there(structure, records)


def _same_topic(record: FlightRecord, name: str, sensed: Sequence[str], fastest_hz: float) -> bool:
    """Whether an estimated channel was logged together with the sensors: one topic, one clock, one rate."""
    topics = {id(topic) for other in sensed for topic, _ in record.holding(other)}
    return any(
        id(topic) in topics and topic.sample_rate_hz >= _SLOWEST_SHARE * fastest_hz for topic, _ in record.holding(name)
    )


def _holds(structure: LinearStructure, name: str, value: float) -> bool:
    parameter = structure.parameters[name]
    return parameter.status == "fixed" and parameter.value == value


def _require_left(
    lost: Sequence[str], left: LinearStructure, whole: LinearStructure, settings: IdentifySettings
) -> None:
    """Refuse choices about parameters that are no longer in the model."""
    sources = {source for text in settings.ties.values() for source in Expression.parse(text).names}
    # What the model holds at that very value anyway, as the geometry of physical.hover, is no misunderstanding.
    fixed = {name for name, value in settings.fix.items() if not _holds(whole, name, value)}
    given = [name for name in lost if name in {*fixed, *settings.ties, *settings.free, *sources}]
    if given:
        raise UsageError(
            f"no response of {', '.join(left.outputs)} to {', '.join(left.inputs)} depends on "
            f"{', '.join(given)}, given with --fix, --tie or --free",
            needed=f"parameters among {', '.join(left.parameters.names)}",
            remedy="leave it out, or add a log or outputs that show it",
        )


def _not_excited(names: Sequence[str], lost: Sequence[str]) -> list[Finding]:
    """The warning on inputs that were not excited, once for all of them."""
    if not names:
        return []
    gone = f" Without {'it' if len(names) == 1 else 'them'} {', '.join(lost)} cannot be identified." if lost else ""
    inputs = "that input" if len(names) == 1 else "those inputs"
    return [
        warn(
            "no_excitation",
            ", ".join(names),
            f"No sweep, multisine or random binary signal of {' or '.join(names)} was found, so the model is "
            f"fitted without {inputs}.{gone}",
        )
    ]


def _without_response(names: Sequence[str], asked: Sequence[str], left: LinearStructure) -> list[Finding]:
    """Warnings on inputs and requested outputs that the model does not connect."""
    names = [*names, *(name for name in asked if name not in left.outputs)]
    return [
        warn(
            "not_identifiable",
            name,
            f"The model does not connect {name} with the fitted inputs and outputs, {', '.join(left.inputs)} and "
            f"{', '.join(left.outputs)}, so it was left out.",
        )
        for name in names
    ]


def _without(
    passed: Sequence[str], smaller: LinearStructure, lost: Sequence[str], settings: IdentifySettings
) -> list[Finding]:
    """The remark on outputs that were left out by default."""
    if settings.outputs or not passed:
        return []
    single = len(passed) == 1
    gone = f" This also leaves out {', '.join(lost)}." if lost else ""
    where = "is not logged, or only as an estimate" if single else "are not logged, or only as estimates"
    return [
        remark(
            "outputs_left_out",
            ", ".join(passed),
            f"Only {', '.join(smaller.outputs)} {'was' if len(smaller.outputs) == 1 else 'were'} fitted. "
            f"{', '.join(passed)} {where} of a filter with its own delay; add {'it' if single else 'them'} with "
            f"--outputs to fit {'it' if single else 'them'} too.{gone}",
        )
    ]


_CHANNELS = {"U0": "u", "V0": "v", "W0": "w", "theta0": "theta", "phi0": "phi"}
_SPEEDS = ("U0", "V0", "W0")

_ONE_TRIM_M_S = 1.5
"""Maneuvers whose mean speeds differ by more are of several trims."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Trimmed(Trim):
    """A structure at a trim, with the remark on it where it is no level hover."""

    findings: tuple[Finding, ...] = ()


def trimmed(structure: LinearStructure, flights: Sequence[Flight], settings: IdentifySettings) -> Trimmed:
    """A structure with its trim constants set.

    Given constants count. The others are means over the maneuvers, where the record holds them, or velocities over the
    earth and attitude. Where all speeds are below 0.5 m/s it is hover: they stay zero, and so do angles below 3°.

    Parameters
    ----------
    structure
        Its constants ``U0 V0 W0 theta0 phi0`` are set; one without them stays as it is.
    settings
        Whose ``constants`` were given.

    Raises
    ------
    ModelError
        A constant was given that the structure does not have.
    """
    means = {name: mean_of(flights, channel) for name, channel in _CHANNELS.items() if name in structure.constants}
    flying = any(abs(value) >= HOVER_M_S for name, value in means.items() if name in _SPEEDS)
    measured = {
        name: value
        for name, value in means.items()
        if name not in settings.constants
        and (flying or (name not in _SPEEDS and abs(value) >= LEAST_LEAN_RAD))
        and value
    }
    constants = {**measured, **settings.constants}
    if not constants:
        return Trimmed(structure=structure, flights=tuple(flights))
    findings = [_finding(measured)] if measured else []
    if "U0" in measured:
        findings += _several(flights)
    at_trim = structure.with_constants(constants)
    return Trimmed(structure=at_trim, flights=tuple(flights), findings=tuple(findings))


def with_spread(structure: LinearStructure, flights: Sequence[Flight], settings: IdentifySettings) -> LinearStructure:
    """A structure that knows the size of the sweeps of thrust; unchanged where it has no such constant.

    Parameters
    ----------
    structure, flights, settings
        As for :func:`trimmed`; a constant that was given counts.
    """
    if SPREAD not in structure.constants or SPREAD in settings.constants:
        return structure
    lag_s = settings.fix.get(MOTOR_LAG, structure.parameters.values.get(MOTOR_LAG, 0.0))
    return structure.with_constants({SPREAD: thrust_spread(flights, lag_s)})


def trimmed_in_wind(
    structure: LinearStructure, flights: Sequence[Flight], settings: IdentifySettings
) -> tuple[Trimmed, ...]:
    """The same structure in a hover that leans against a steady wind, see :mod:`rotorid.models.steady_wind`.

    Parameters
    ----------
    structure, flights, settings
        As for :func:`trimmed`.

    Returns
    -------
    tuple
        One for each axis along which the wind may drag; empty where nothing leans by 3° and more, where the flights
        are no hover, and where the trim was given.
    """
    if set(settings.constants) & set(_CHANNELS):
        return ()
    found = []
    for share in HEAVE_SHARES:
        windy, blown = in_wind_of(structure.with_constants(settings.constants), flights, heave_share=share)
        if HEAVE_SHARE in windy.constants and (not share or "az" in structure.outputs):
            found.append(Trimmed(structure=windy, flights=blown, findings=(_leaning(windy),)))
    return tuple(found)


def _leaning(structure: LinearStructure) -> Finding:
    """The remark on a steady wind."""
    lean_rad = lean_of(structure.constants)
    drag = {name: structure.constants[name] for name in STEADY_DRAG}
    forward, right = drag.values()
    return remark(
        "trim",
        ", ".join(drag),
        f"The vehicle leaned by {math.degrees(lean_rad):.0f}° against a steady wind; the model describes motion about "
        f"this lean. Accelerations leave out the wind's drag: {forward:.2f} m/s² forward, {right:.2f} m/s² right.",
        lean_rad=lean_rad,
        **drag,
    )


def _several(flights: Sequence[Flight]) -> list[Finding]:
    """A warning if maneuvers were flown at different speeds."""
    speeds = [mean_of([flight], "u") for flight in flights]
    low, high = min(speeds), max(speeds)
    if high - low < _ONE_TRIM_M_S:
        return []
    return [
        warn(
            "several_trims",
            "U0",
            f"The maneuvers were flown at {low:.1f} to {high:.1f} m/s, but the model is for their mean: identify "
            "each speed separately (--segment AXIS:START:STOP) and stitch the results.",
            lowest_m_s=low,
            highest_m_s=high,
        )
    ]


def _finding(trim: dict[str, float]) -> Finding:
    parts = ", ".join(
        f"{name} = {value:.2f} m/s" if name in _SPEEDS else f"{name} = {np.degrees(value):.1f}°"
        for name, value in trim.items()
    )
    return remark(
        "trim",
        ", ".join(trim),
        f"The record is not a hover: {parts} on average, so the model is linearized there. Set other values with "
        "--constant NAME=VALUE.",
        **trim,
    )
