"""Model structures as TOML text: written with the identified values, and read back as a model."""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Mapping
from typing import Any

import numpy as np

from rotorid.errors import ModelError
from rotorid.models.entry import Entry
from rotorid.models.parameter import Parameter, ParameterSet, Status
from rotorid.models.structure import LinearStructure, Rows

SCHEMA = "rotorid.model/1"

_MATRICES = ("M", "F", "G", "H0", "H1")
_KEYS = {"schema", "name", "inputs", "states", "outputs", "gain", "optional", "source", *_MATRICES}
_KEYS |= {"input_delays", "output_delays", "parameters"}
_PARAMETER_KEYS = {"value", "unit", "lower", "upper", "status", "starts", "std"}


def to_toml(structure: LinearStructure, parameters: ParameterSet, std: Mapping[str, float]) -> str:
    """A structure with values, as text that :func:`from_toml` reads back.

    Parameters
    ----------
    structure, parameters
        The structure and the values to write.
    std
        Standard deviations of the parameters that have one; for people, ignored when read back.
    """
    lines = [
        f'schema = "{SCHEMA}"',
        f"name = {_quoted(structure.name)}",
        f"inputs = {_list(structure.inputs)}",
        f"states = {_list(structure.states)}",
        f"outputs = {_list(structure.outputs)}",
    ]
    lines += [f"gain = {_quoted(structure.gain)}"] if structure.gain else []
    lines += [f"optional = {_list(structure.optional)}"] if structure.optional else []
    lines += [f"source = {_quoted(structure.source)}"] if structure.source else []
    lines += ["", "# M x' = F x + G u(t - input_delays),  y = H0 x + H1 x'"]
    for name in _MATRICES:
        rows = ", ".join(_list([str(entry) for entry in row]) for row in getattr(structure, name))
        lines.append(f"{name} = [{rows}]")
    lines.append(f"input_delays = {_list([str(entry) for entry in structure.input_delays])}")
    lines.append(f"output_delays = {_list([str(entry) for entry in structure.output_delays])}")
    for parameter in parameters:
        lines += ["", f"[parameters.{_key(parameter.name)}]", f"value = {_number(parameter.value)}"]
        lines += [f"unit = {_quoted(parameter.unit)}", f'status = "{parameter.status}"']
        lines += [f"std = {_number(std[parameter.name])}"] if parameter.name in std else []
        lines += [f"lower = {_number(parameter.lower)}"] if np.isfinite(parameter.lower) else []
        lines += [f"upper = {_number(parameter.upper)}"] if np.isfinite(parameter.upper) else []
        lines += [f"starts = [{', '.join(map(_number, parameter.starts))}]"] if parameter.starts else []
    return "\n".join(lines) + "\n"


def from_toml(text: str, *, where: str = "the model") -> LinearStructure:
    """Read a structure; its parameters start from the values in the text.

    Parameters
    ----------
    text
        As :func:`to_toml` writes it.
    where
        Name of the file, for messages.

    Raises
    ------
    ModelError
        The text is no TOML, a key is missing or unknown, or a matrix does not fit.
    """
    try:
        table = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # too long a number and too deep a nesting are no decode errors
        raise ModelError(f"{where} is not valid TOML: {error}", remedy="correct the line it names") from error
    unknown = set(table) - _KEYS
    missing = {"name", "inputs", "states", "outputs", "F", "G", "H0", "parameters"} - set(table)
    if table.get("schema", SCHEMA) != SCHEMA or unknown or missing:
        parts = [f"lacks {', '.join(sorted(missing))}"] if missing else []
        parts += [f"has unknown keys {', '.join(sorted(unknown))}"] if unknown else []
        parts += [] if table.get("schema", SCHEMA) == SCHEMA else [f"has the schema {table['schema']!r}"]
        raise ModelError(f"{where} {' and '.join(parts)}", needed=f"a model of the schema {SCHEMA}")
    states, outputs, inputs = (_names(table[key], key, where) for key in ("states", "outputs", "inputs"))
    identity = [[float(i == j) for j in range(len(states))] for i in range(len(states))]
    zero = [[0.0] * len(states) for _ in outputs]
    rows = {name: _rows(table[name], name, where) for name in ("F", "G", "H0")}
    return LinearStructure(
        name=_text(table["name"], "name", where),
        inputs=inputs,
        states=states,
        outputs=outputs,
        **rows,
        M=_rows(table.get("M", identity), "M", where),
        H1=_rows(table.get("H1", zero), "H1", where),
        input_delays=_entries(table.get("input_delays", [0.0] * len(inputs)), "input_delays", where),
        output_delays=_entries(table.get("output_delays", [0.0] * len(outputs)), "output_delays", where),
        parameters=_parameters(table["parameters"], where),
        gain=_text(table["gain"], "gain", where) if "gain" in table else None,
        optional=_names(table.get("optional", []), "optional", where),
        source=_text(table.get("source", ""), "source", where),
    )


def _text(value: Any, name: str, where: str) -> str:
    if not isinstance(value, str):
        raise ModelError(f"{where}: {name} is {value!r}", needed="a text in quotes")
    return value


def _names(value: Any, name: str, where: str) -> tuple[str, ...]:
    if not isinstance(value, list) or not all(isinstance(item, str) for item in value) or len(set(value)) < len(value):
        raise ModelError(f"{where}: {name} is {value!r}", needed="a list of texts, each once")
    return tuple(value)


def _real(value: Any, name: str, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise ModelError(f"{where}: {name} is {value!r}", needed="a number", remedy="write it without quotes")
    if abs(value) > sys.float_info.max and not isinstance(value, float):
        raise ModelError(f"{where}: {name} is too large for a number", needed=f"at most {sys.float_info.max:.3g}")
    return float(value)


def _rows(value: Any, name: str, where: str) -> Rows:
    if not isinstance(value, list):
        raise ModelError(f"{where}: {name} is no list of rows", needed="rows of entries in square brackets")
    return tuple(_entries(row, name, where) for row in value)


def _entries(value: Any, name: str, where: str) -> tuple[Entry, ...]:
    if not isinstance(value, list) or not all(isinstance(item, (str, int, float)) for item in value):
        raise ModelError(f"{where}: {name} holds something else than entries", needed="numbers or texts like '-L_p'")
    return tuple(Entry.parse(item) for item in value)


def _parameters(table: Any, where: str) -> ParameterSet:
    if not isinstance(table, dict):
        raise ModelError(f"{where}: parameters is no table", needed="[parameters.NAME] tables")
    return ParameterSet(tuple(_parameter(name, entry, where) for name, entry in table.items()))


def _parameter(name: str, entry: Any, where: str) -> Parameter:
    if not isinstance(entry, dict) or "value" not in entry or set(entry) - _PARAMETER_KEYS:
        raise ModelError(
            f"{where}: the parameter {name} cannot be read",
            needed=f"a value, and of {', '.join(sorted(_PARAMETER_KEYS))} what applies",
        )
    status: Status = entry.get("status", "free")
    if status not in ("free", "fixed", "tied", "dropped"):
        raise ModelError(f"{where}: {name} has the status {status!r}", needed="free, fixed, tied or dropped")
    starts = entry.get("starts", [])
    if not isinstance(starts, list):
        raise ModelError(f"{where}: starts of {name} is {starts!r}", needed="a list of numbers")
    return Parameter(
        name=name,
        value=_real(entry["value"], f"value of {name}", where),
        unit=_text(entry.get("unit", "1"), f"unit of {name}", where),
        lower=_real(entry.get("lower", -np.inf), f"lower of {name}", where),
        upper=_real(entry.get("upper", np.inf), f"upper of {name}", where),
        status=status,
        starts=tuple(_real(start, f"a start of {name}", where) for start in starts),
    )


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\U{ord(c):08x}" for c in escaped) + '"'


def _key(name: str) -> str:
    # Without quotes TOML allows ASCII only, and a Greek letter is a fine name for a parameter.
    return name if name.isascii() and name.replace("_", "").isalnum() else _quoted(name)


def _list(texts: tuple[str, ...] | list[str]) -> str:
    return "[" + ", ".join(_quoted(text) for text in texts) + "]"


def _number(value: float) -> str:
    text = repr(float(value))
    return text if any(c in text for c in ".einf") else text + ".0"
