r"""Units of what drives motors, and of the parameters in front of it.

A model of a vehicle on a pivot has a thrust gain :math:`K_f` in newtons per unit of its inputs: volts in the library,
and whatever a log has: V, a share of full output, µs of pulses, rad/s. Seen in a log is :math:`L K_f/J_x`, in rad/s²
per that unit, so that a parameter takes the unit of the log with it, and its start values the scale.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from rotorid.data.record import FlightRecord, units_of
from rotorid.errors import UsageError
from rotorid.models.families import family_of
from rotorid.models.library import library_model
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.models.structure import LinearStructure

_NEEDED_BY_A_MOTOR: Mapping[str, float] = {"V": 10.0, "1": 1.0, "us": 1000.0, "rad/s": 1000.0}
"""What about a motor needs for full thrust, by unit: the scale of start values."""

_MARKED = ("V", "us")
"""Units of inputs that show in the unit of a parameter."""


def input_unit(structure: LinearStructure) -> str:
    """Unit of the motors that a structure is about: ``V`` or ``us``, as its parameters have it, else empty.

    Examples
    --------
    >>> from rotorid.models.library import library_model
    >>> input_unit(library_model("rig.roll")), input_unit(library_model("axis.roll"))
    ('V', '')
    """
    if not _motors(structure):
        return ""
    units = [_factors(parameter.unit)[1] for parameter in structure.parameters]
    return next((mark for mark in _MARKED if any(mark in below for below in units)), "")


def logged_unit(structure: LinearStructure, records: Sequence[FlightRecord]) -> str:
    """Unit of the motors of a structure in logs; empty where they hold none of them.

    Raises
    ------
    UsageError
        They are in several units.
    """
    found = {
        (name, record.source.name): record.unit_of(name)
        for record in records
        for name in _motors(structure)
        if name in record.channel_names
    }
    units = list(dict.fromkeys(found.values()))
    if len(units) > 1:
        ((first, one), (second, other)) = (
            next(key for key, unit in found.items() if unit == each) for each in units[:2]
        )
        same = one == other
        raise UsageError(
            f"{first}{'' if same else f' of {one}'} is in {units[0]} and {second}{'' if same else f' of {other}'} is "
            f"in {units[1]}",
            needed="one unit for all motors of a model, since they share a gain",
            remedy="correct `unit` in the mapping or in the header",
        )
    return units[0] if units else ""


def in_logged_units(structure: LinearStructure, records: Sequence[FlightRecord]) -> LinearStructure:
    """A structure whose parameters have the units that the motors have in logs.

    Parameters
    ----------
    structure
        One whose parameters name volts or pulses; others come back as they are.
    records
        The logs that it will be fitted to.

    Raises
    ------
    UsageError
        The motors are in several units, or a value in another unit is fixed.

    Examples
    --------
    >>> import numpy as np
    >>> from rotorid.data.record import Channel, Source, Topic
    >>> from rotorid.models.library import library_model
    >>> topic = Topic(name="t", time_s=[0.0], channels=(Channel(name="motor_3", unit="us"),), values=np.zeros((1, 1)))
    >>> record = FlightRecord(source=Source(name="a.csv", format="CSV", sha256=""), topics=(topic,))
    >>> in_logged_units(library_model("rig.roll"), [record]).parameters["K_f"].unit
    'N/us'
    """
    own, logged = input_unit(structure), logged_unit(structure, records)
    if not own or not logged or own == logged:
        return structure
    changed = [p for p in structure.parameters if own in _factors(p.unit)[1]]
    if fixed := [p for p in changed if p.status == "fixed"]:
        raise UsageError(
            f"{structure.name} has {fixed[0].name} = {fixed[0].value:g} {fixed[0].unit}, and the motors of "
            f"{records[0].source.name} are in {logged}",
            needed=f"motors in {own}",
            remedy=f"correct `unit` in the mapping, or write {fixed[0].name} in {_per(fixed[0].unit, own, logged)}",
        )
    scale = _NEEDED_BY_A_MOTOR[own] / _NEEDED_BY_A_MOTOR[logged]
    parameters = [_scaled(p, scale, _per(p.unit, own, logged)) if p in changed else p for p in structure.parameters]
    return replace(structure, parameters=ParameterSet(parameters, structure.parameters.constants))


def require_same_unit(structure: LinearStructure, record: FlightRecord) -> None:
    """Refuse a log whose motors are in another unit than those that a model was identified from.

    Raises
    ------
    UsageError
        They are.
    """
    logged = logged_unit(structure, [record])
    own = identified_unit(structure)
    if logged and own and logged != own:
        raise UsageError(
            f"the motors of {record.source.name} are in {logged}, and {structure.name} is of motors in {own}",
            needed=f"a log with motors in {own}",
            remedy="correct `unit` in the mapping, or identify the model from logs in one unit",
        )


def absent_motors(structure: LinearStructure) -> tuple[str, ...]:
    """Motors of a model of one axis on a pivot that a structure leaves out: another input drives them too, or none.

    Examples
    --------
    >>> absent_motors(library_model("rig.roll").select(inputs=("motor_3",)))
    ('motor_4',)
    """
    family = family_of(structure)
    if len(family.axes.get(structure.name, ())) != 1 or family.needs != "single motors":
        return ()
    return tuple(name for name in library_model(structure.name).inputs if name not in structure.inputs)


def identified_unit(structure: LinearStructure) -> str:
    """Unit of the motors that a result was identified from; empty where a model of one's own does not show it.

    Speeds and shares of full output show in whether radians are below a gain of force.

    Examples
    --------
    >>> from rotorid.models.library import library_model
    >>> identified_unit(library_model("rig.roll")), identified_unit(library_model("axis.roll"))
    ('V', '')
    """
    if (marked := input_unit(structure)) or family_of(structure).needs != "single motors":
        return marked
    return "rad/s" if any("rad" in _factors(p.unit)[1] for p in structure.parameters) else "1"


def _motors(structure: LinearStructure) -> list[str]:
    return [name for name in structure.inputs if len(units_of(name)) > 1]


def _factors(unit: str) -> tuple[list[str], list[str]]:
    above, _, below = unit.partition("/")
    return above.split(" "), below.strip("()").split(" ") if below else []


def _per(unit: str, own: str, logged: str) -> str:
    """A unit with that of the inputs exchanged.

    Examples
    --------
    >>> _per("N/V", "V", "us"), _per("N m/V", "V", "1"), _per("N m/V", "V", "rad/s"), _per("N/V", "V", "V")
    ('N/us', 'N m', 'N m s/rad', 'N/V')
    """
    above, below = _factors(unit)
    below.remove(own)
    new_below, new_above = {"1": ([], []), "rad/s": (["rad"], ["s"])}.get(logged, ([logged], []))
    above, below = [*above, *new_above], [*below, *new_below]
    if not below:
        return " ".join(above)
    return f"{' '.join(above)}/{below[0]}" if len(below) == 1 else f"{' '.join(above)}/({' '.join(below)})"


def _scaled(parameter: Parameter, scale: float, unit: str) -> Parameter:
    return replace(
        parameter,
        value=parameter.value * scale,
        lower=parameter.lower * scale,
        upper=parameter.upper * scale,
        starts=tuple(value * scale for value in parameter.starts),
        unit=unit,
    )
