"""The parameters of a model in a TOML text."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, get_args

import numpy as np

from rotorid.errors import ModelError
from rotorid.models.description_source import Source
from rotorid.models.expression import Expression
from rotorid.models.parameter import Parameter, ParameterSet, Status
from rotorid.models.parameter_unit import check_unit
from rotorid.models.ties import TieError

_KEYS = ("value", "unit", "lower", "upper", "status", "starts", "std", "tied", "essential")


def read_parameters(table: Any, constants: Mapping[str, float], source: Source) -> ParameterSet:
    """The parameters of a model.

    Parameters
    ----------
    table
        What stands under ``parameters``.
    constants
        Numbers that ties may name.
    source
        The text, for errors.

    Raises
    ------
    ModelError
        A parameter is wrong in itself, or its tie is.
    """
    if not isinstance(table, dict):
        raise source.error(("parameters",), "parameters is no table", needed="[parameters.NAME] tables")
    parameters = [_parameter(name, entry, source) for name, entry in table.items()]
    try:
        return ParameterSet(parameters, constants)
    except TieError as error:
        with source.about("parameters", error.parameter, "tied"):
            raise
    except ModelError as error:
        named = next((p.name for p in parameters if error.came.startswith(f"{p.name} =")), "")
        with source.about("parameters", *([named] if named else [])):
            raise


def _parameter(name: str, entry: Any, source: Source) -> Parameter:
    path = ("parameters", name)
    if not isinstance(entry, dict):
        raise source.error(path, f"the parameter {name} is no table", needed=f"[parameters.{name}] and its pairs")
    for key in entry:
        if key not in _KEYS:
            raise source.unknown(f"key of the parameter {name} called", key, _KEYS, (*path, key))
    tied = source.expression(entry["tied"], (*path, "tied")) if "tied" in entry else None
    status = _status(entry, tied, path, source)
    lower = source.number(entry.get("lower", -np.inf), (*path, "lower"))
    upper = source.number(entry.get("upper", np.inf), (*path, "upper"))
    # Without a value the start is found from the data; until then it is the number nearest to zero.
    value = source.number(entry.get("value", min(max(0.0, lower), upper)), (*path, "value"))
    essential = entry.get("essential", False)
    if not isinstance(essential, bool):
        raise source.error((*path, "essential"), f"essential of {name} is {essential!r}", needed="true or false")
    unit = source.text_of(entry.get("unit", "1"), (*path, "unit"))
    with source.about(*path, "unit"):
        check_unit(name, unit)
    with source.about(*path, "value" if lower <= upper else "lower"):
        return Parameter(
            name=name,
            value=value,
            unit=unit,
            lower=lower,
            upper=upper,
            status=status,
            starts=_starts(entry.get("starts", []), (*path, "starts"), source),
            tied=tied,
            essential=essential,
        )


def _status(entry: Mapping[str, Any], tied: Expression | None, path: tuple[str, str], source: Source) -> Status:
    name = path[1]
    status: Status = entry.get("status", "free" if tied is None else "tied")
    if status not in get_args(Status):
        came = f"{name} has the status {status!r}"
        raise source.error((*path, "status"), came, needed="free, fixed, tied or dropped")
    if (status == "tied") != (tied is not None):
        came = f"{name} is {status} and {'not ' if tied is None else ''}tied to an expression"
        raise source.error((*path, "status"), came, needed='tied = "..." for the status tied, and for no other')
    if tied is not None and "value" in entry:
        raise source.error((*path, "value"), f"{name} has a value and a tie", needed="one of them")
    if status == "fixed" and "value" not in entry:
        raise source.error((*path, "status"), f"{name} is fixed and has no value", needed="value = ...")
    if status == "dropped" and entry.get("value", 0.0) != 0.0:
        raise source.error((*path, "value"), f"{name} is dropped and is {entry['value']!r}", needed="zero, or no value")
    return status


def _starts(value: Any, path: tuple[str, ...], source: Source) -> tuple[float, ...]:
    if not isinstance(value, list):
        raise source.error(path, f"starts of {path[1]} is {value!r}", needed="a list of numbers")
    return tuple(source.number(start, path) for start in value)
