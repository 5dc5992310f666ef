"""The model ``physical.hover`` of the vehicle that flew: rotors from the log or the user, geometry from the user.

Mass, propeller, arm, density and speed of the rotors scale what the data show; a value that stands in the library by
default would end up in every inertia and coefficient, so that each one has to be given.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.flights.flights import Flight
from rotorid.models.autopilots.layouts import layout_of, mixer_of
from rotorid.models.families import family_of
from rotorid.models.hover_layouts import GEOMETRY, HOVER, physical_hover, plain_mixer
from rotorid.models.rotors import RotorLayout
from rotorid.models.structure import LinearStructure
from rotorid.results.summary import HoverRotors
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.motors import chosen_layout
from rotorid.signal.motors import logged_outputs, or_none

_WHAT: Mapping[str, str] = {
    "m": "mass m in kg (--fix m=VALUE)",
    "D": "diameter D of a propeller in m (--rotor-diameter)",
    "l": "arm l in m, from the center of gravity to the farthest rotor (--arm)",
    "rho": "density rho of the air in kg/m^3 (--fix rho=VALUE, 1.225 at sea level and 15 degrees)",
    "k_n": "k_n, the rev/s that a rotor gains per motor output of one around hover (--fix k_n=VALUE)",
}


def hover_of_vehicle(records: Sequence[FlightRecord], settings: IdentifySettings) -> LinearStructure:
    """The model with the layout of the vehicle, and its geometry fixed if a length was given.

    Parameters
    ----------
    records
        Logs of one vehicle; the first says how its rotors stand, unless ``settings.layout`` does.
    settings
        Choices of the run: ``layout``, ``arm_m``, ``rotor_diameter_m``, and what is fixed, tied or free.

    Raises
    ------
    UsageError
        Geometry is missing, impossible or given twice, or nothing says how the rotors stand.
    ModelError
        The model does not hold for such rotors.
    """
    layout = _layout(records, settings)
    lengths = _lengths(layout, settings)
    named = {*settings.fix, *settings.ties, *settings.free, *lengths}
    if missing := [name for name in GEOMETRY if name not in named]:
        raise UsageError(
            f"{HOVER} needs {', '.join(missing)}, which no flight shows",
            remedy=f"give {'; '.join(_WHAT[name] for name in missing)}",
        )
    for name, value in {**settings.fix, **lengths}.items():
        if name in GEOMETRY and not 0.0 < value < math.inf:
            raise UsageError(f"{name} = {value:g} is not positive", needed=f"a positive {_WHAT[name]}")
    structure = physical_hover(layout, mixer_of(layout, records[0].source.format) if records else None)
    parameters = structure.parameters
    for name, value in {**{n: v for n, v in settings.fix.items() if n in GEOMETRY}, **lengths}.items():
        parameters = parameters.fix(name, value)
    return replace(structure, parameters=parameters)


def rotors_of_hover(name: str, flights: Sequence[Flight], settings: object) -> HoverRotors | None:
    """The rotors of the vehicle that flew and their mean output; ``None`` of another model.

    Parameters
    ----------
    name
        Of the model.
    flights
        That were fitted.
    settings
        Choices of the run.
    """
    if not family_of(name).drags_by_rotors or not flights or not isinstance(settings, IdentifySettings):
        return None
    record = flights[0].record
    layout = _layout([record], settings)
    mixer = mixer_of(layout, record.source.format)
    outputs = [mean for flight in flights if (mean := _mean_output(flight, layout.rotors)) is not None]
    return HoverRotors(
        layout=layout.name,
        rotors=tuple(map(tuple, (layout.positions / layout.arm).tolist())),
        spins=tuple(layout.spins.tolist()),
        mixer=tuple(map(tuple, (plain_mixer(layout) if mixer is None else mixer).tolist())),
        hover_output=float(np.mean(outputs)) if outputs else None,
    )


def _mean_output(flight: Flight, rotors: int) -> float | None:
    """Mean output of all motors during a maneuver about hover, where the log has them as shares of the largest."""
    history = or_none(logged_outputs, flight.record)
    if history is None or history.motors != rotors:
        return None
    start_s, stop_s = flight.maneuver.start_s, flight.maneuver.stop_s
    inside = history.values[:, (history.time_s >= start_s) & (history.time_s <= stop_s)]
    mean = float(np.nanmean(inside)) if inside.size and np.isfinite(inside).any() else 0.0
    return mean if 0.0 < mean < 1.0 else None


def _layout(records: Sequence[FlightRecord], settings: IdentifySettings) -> RotorLayout:
    if settings.layout is not None:
        return chosen_layout(settings.layout)
    try:
        return layout_of(records[0])
    except InsufficientDataError as error:
        raise UsageError(
            error.came.rstrip("."),
            needed="--layout quad.x, quad.plus, hexa.x or another, or FILE.toml of [[rotor]] tables",
        ) from None


def _lengths(layout: RotorLayout, settings: IdentifySettings) -> dict[str, float]:
    """Diameter and arm from their options; the layout itself may contain an arm in meters."""
    given = {"D": ("--rotor-diameter", settings.rotor_diameter_m), "l": ("--arm", settings.arm_m)}
    lengths = {}
    for name, (option, value) in given.items():
        if value is None:
            continue
        if name in settings.fix or name in settings.ties:
            raise UsageError(f"{name} was given with {option} and with --fix or --tie", needed="only one of them")
        lengths[name] = value
    if layout.arm_known and not {"l"} & {*lengths, *settings.fix, *settings.ties, *settings.free}:
        lengths["l"] = layout.arm
    return lengths
