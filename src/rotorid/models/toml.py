"""Model structures as TOML text: written with the identified values, and read back as a model.

The equations or matrices of a model in a TOML text.

The parameters of a model in a TOML text.

Writing a structure as TOML text.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np

from rotorid.errors import ModelError
from rotorid.models.equations import (
    DynamicRows,
    OutputRows,
    Symbols,
    can_be_equations,
    check_delayed,
    check_equations,
    check_once,
    dynamic_rows,
    output_rows,
    written_equations,
    written_outputs,
)
from rotorid.models.expression import Expression
from rotorid.models.parameter import Parameter, ParameterSet, Status, TieError, check_unit
from rotorid.models.structure import LinearStructure, Row, Rows
from rotorid.models.toml_source import Path, Source

_ROWS = ("M", "F", "G", "H0", "H1")


def read_structure(
    table: Mapping[str, Any], parameters: ParameterSet, constants: Mapping[str, float], source: Source
) -> LinearStructure:
    """The structure that a table says.

    Parameters
    ----------
    table
        The whole model; its keys are known to be right.
    parameters, constants
        Already read.
    source
        The text, for errors.

    Raises
    ------
    ModelError
        What stands there is no structure.
    """
    inputs, states = (source.texts(table[key], (key,)) for key in ("inputs", "states"))
    for name in constants:
        if name in parameters.names:
            raise source.error(("constants", name), f"{name} is a parameter and a constant", needed="different names")
    form = _Equations if "equations" in table else _Matrices
    entries = form(source, table, inputs, states, parameters, constants).read()
    gain = source.text_of(table["gain"], ("gain",)) if "gain" in table else None
    optional = source.texts(table.get("optional", []), ("optional",))
    for key, names in (("gain", [gain] if gain is not None else []), ("optional", optional)):
        for name in names:
            if name not in parameters.names:
                raise source.unknown(f"parameter ({key})", name, parameters.names, (key,))
    _check_used(entries, parameters, source)
    with source.about():
        return LinearStructure(
            name=source.text_of(table["name"], ("name",)),
            inputs=inputs,
            states=states,
            parameters=parameters,
            constants=constants,
            gain=gain,
            optional=optional,
            source=source.text_of(table.get("source", ""), ("source",)),
            **entries,
        )


def _check_used(entries: Mapping[str, Any], parameters: ParameterSet, source: Source) -> None:
    rows: list[Row] = [row for name in _ROWS for row in entries[name]]
    rows += [entries["input_delays"], entries["output_delays"]]
    used = frozenset().union(*(entry.names for row in rows for entry in row))
    reached = parameters.only(name for name in parameters.names if name in used).names
    for parameter in parameters:
        if parameter.name not in reached and parameter.status != "dropped":
            came = f"{parameter.name} stands nowhere in the model"
            raise source.error(("parameters", parameter.name), came, remedy="remove it, or use it")


@dataclass(frozen=True, slots=True)
class _Form:
    """What both ways of writing a model share."""

    source: Source
    table: Mapping[str, Any]
    inputs: tuple[str, ...]
    states: tuple[str, ...]
    parameters: ParameterSet
    constants: Mapping[str, float]

    def check(self, entry: Expression, path: Path) -> Expression:
        """Refuse an entry of unknown names, or one whose numbers alone have no value."""
        known = (*self.parameters.names, *self.constants)
        for name in sorted(entry.names - set(known)):
            raise self.source.unknown("parameter or constant", name, known, path)
        with self.source.about(*path):
            entry.substitute(self.constants).as_affine()
        return entry

    def entry(self, value: Any, path: Path) -> Expression:
        return self.check(self.source.expression(value, path), path)

    def delay(self, value: Any, path: Path) -> Expression:
        """A delay; where it is one parameter whose unit is given, that is seconds."""
        entry = self.entry(value, path)
        if entry.kind == "name" and entry.name in self.parameters.names:
            given = self.table["parameters"][entry.name]
            if given.get("unit", "s") != "s":
                came = f"{entry.name} is a delay and its unit is {given['unit']!r}"
                raise self.source.error(("parameters", entry.name, "unit"), came, needed="'s'")
        return entry


class _Equations(_Form):
    """A model written as a paper prints it."""

    def read(self) -> dict[str, Any]:
        symbols = self.symbols()
        rows = self.rows(symbols)
        outputs = self.outputs(symbols)
        names = tuple(output.name for output in outputs)
        late = {}
        for name, value in self.source.table(self.table.get("delays", {}), ("delays",)).items():
            with self.source.about("delays", name):
                check_delayed(name, self.inputs, names)
            late[name] = self.delay(value, ("delays", name))
        return {
            "outputs": names,
            "M": tuple(row.M for row in rows),
            "F": tuple(row.F for row in rows),
            "G": tuple(row.G for row in rows),
            "H0": tuple(output.H0 for output in outputs),
            "H1": tuple(output.H1 for output in outputs),
            "input_delays": tuple(late.get(name, Expression()) for name in self.inputs),
            "output_delays": tuple(late.get(name, Expression()) for name in names),
        }

    def symbols(self) -> Symbols:
        symbols = Symbols(self.inputs, self.states, (*self.parameters.names, *self.constants))
        kinds = (("inputs", self.inputs), ("states", self.states))
        places: list[tuple[str, Path]] = [(name, (key, i)) for key, names in kinds for i, name in enumerate(names)]
        places += [(name, ("parameters", name)) for name in self.parameters.names]
        places += [(name, ("constants", name)) for name in self.constants]
        for name, path in places:
            with self.source.about(*path):
                symbols.check(name)
        return symbols

    def rows(self, symbols: Symbols) -> list[DynamicRows]:
        rows: list[DynamicRows] = []
        for place, text in enumerate(self.source.texts(self.table["equations"], ("equations",))):
            path = ("equations", place)
            with self.source.about(*path):
                rows.append(dynamic_rows(text, symbols))
                check_once(rows, self.states)
            for entry in (*rows[-1].M, *rows[-1].F, *rows[-1].G):
                self.check(entry, path)
        with self.source.about("equations"):
            check_equations(rows, self.states)
        return rows

    def outputs(self, symbols: Symbols) -> list[OutputRows]:
        outputs: list[OutputRows] = []
        for place, text in enumerate(self.source.texts(self.table["outputs"], ("outputs",))):
            path = ("outputs", place)
            with self.source.about(*path):
                outputs.append(output_rows(text, symbols))
                if outputs[-1].name in [output.name for output in outputs[:-1]]:
                    raise ModelError(f"two outputs are called {outputs[-1].name}", needed="a name each")
            for entry in (*outputs[-1].H0, *outputs[-1].H1):
                self.check(entry, path)
        return outputs


class _Matrices(_Form):
    """A model written as its matrices."""

    def read(self) -> dict[str, Any]:
        outputs = self.source.texts(self.table["outputs"], ("outputs",))
        x, u, y = len(self.states), len(self.inputs), len(outputs)
        identity = [[float(i == j) for j in range(x)] for i in range(x)]
        shapes = {"M": (x, x), "F": (x, x), "G": (x, u), "H0": (y, x), "H1": (y, x)}
        plain = {"M": identity, "H1": [[0.0] * x] * y}
        entries: dict[str, Any] = {
            name: self.matrix(name, self.table.get(name, plain.get(name)), shape) for name, shape in shapes.items()
        }
        delays = {name: self.delays(name, count) for name, count in (("input_delays", u), ("output_delays", y))}
        return {"outputs": outputs, **entries, **delays}

    def matrix(self, name: str, value: Any, shape: tuple[int, int]) -> Rows:
        if not isinstance(value, list):
            raise self.source.error((name,), f"{name} is no list of rows", needed="rows of entries in square brackets")
        if len(value) != shape[0]:
            came = f"matrix {name} has {len(value)} rows"
            raise self.source.error((name,), came, needed=f"{shape[0]} rows of {shape[1]} entries")
        return tuple(self.row(name, i, row, shape[1]) for i, row in enumerate(value))

    def row(self, name: str, i: int, value: Any, width: int) -> Row:
        if not isinstance(value, list):
            came = f"{name} holds something else than rows of entries"
            raise self.source.error((name, i), came, needed="rows of entries in square brackets")
        if len(value) != width:
            came = f"row {i + 1} of matrix {name} has {len(value)} entries"
            raise self.source.error((name, i), came, needed=f"{width} entries")
        return tuple(self.entry(entry, (name, i, j)) for j, entry in enumerate(value))

    def delays(self, name: str, count: int) -> Row:
        value = self.table.get(name, [0.0] * count)
        if not isinstance(value, list):
            raise self.source.error((name,), f"{name} is {value!r}", needed=f"a list of {count} delays")
        if len(value) != count:
            raise self.source.error((name,), f"{name} has {len(value)} entries", needed=f"{count} entries")
        return tuple(self.delay(entry, (name, i)) for i, entry in enumerate(value))


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


SCHEMA = "rotorid.model/1"


def to_toml(structure: LinearStructure, parameters: ParameterSet, std: Mapping[str, float]) -> str:
    """A structure with values, as text that :func:`~rotorid.models.toml.from_toml` reads back.

    It is written as equations; as matrices where a name cannot stand in an equation.

    Parameters
    ----------
    structure, parameters
        The structure and the values to write.
    std
        Standard deviations of the parameters that have one; for people, ignored when read back.
    """
    equations = can_be_equations(structure)
    outputs = written_outputs(structure) if equations else structure.outputs
    lines = [
        f'schema = "{SCHEMA}"',
        f"name = {_quoted(structure.name)}",
        *([f"source = {_quoted(structure.source)}"] if structure.source else []),
        f"inputs = {_list(structure.inputs)}",
        f"states = {_list(structure.states)}",
        *(_listed("equations", written_equations(structure)) if equations else _matrices(structure)),
        *(_listed("outputs", outputs) if equations else [f"outputs = {_list(outputs)}"]),
        *([f"gain = {_quoted(structure.gain)}"] if structure.gain else []),
        *([f"optional = {_list(structure.optional)}"] if structure.optional else []),
        *(_delays(structure) if equations else []),
    ]
    if structure.constants:
        lines += [
            "",
            "[constants]",
            *(f"{_key(name)} = {_number(value)}" for name, value in structure.constants.items()),
        ]
    for parameter in parameters:
        lines += ["", *_parameter_lines(parameter, std)]
    # A table without entries is still needed.
    return "\n".join(lines if len(parameters) else [*lines, "", "[parameters]"]) + "\n"


def _matrices(structure: LinearStructure) -> list[str]:
    lines = ["# M x' = F x + G u(t - input_delays),  y = H0 x + H1 x'"]
    for name in ("M", "F", "G", "H0", "H1"):
        rows = ", ".join(_list(map(str, row)) for row in getattr(structure, name))
        lines.append(f"{name} = [{rows}]")
    lines.append(f"input_delays = {_list(map(str, structure.input_delays))}")
    return [*lines, f"output_delays = {_list(map(str, structure.output_delays))}"]


def _delays(structure: LinearStructure) -> list[str]:
    every = ((structure.inputs, structure.input_delays), (structure.outputs, structure.output_delays))
    late = [pair for names, delays in every for pair in zip(names, delays, strict=True) if not pair[1].is_zero]
    return ["", "[delays]", *(f"{_key(name)} = {_entry(delay)}" for name, delay in late)] if late else []


def _parameter_lines(parameter: Parameter, std: Mapping[str, float]) -> list[str]:
    name = parameter.name
    if parameter.tied is None:
        lines = [f"value = {_number(parameter.value)}"]
    else:
        lines = [f"tied = {_entry(parameter.tied)}  # {_number(parameter.value)}"]
    lines.append(f"unit = {_quoted(parameter.unit)}")
    lines += [f'status = "{parameter.status}"'] if parameter.tied is None else []
    lines += ["essential = true"] if parameter.essential else []
    lines += [f"std = {_number(std[name])}"] if name in std else []
    lines += [f"lower = {_number(parameter.lower)}"] if np.isfinite(parameter.lower) else []
    lines += [f"upper = {_number(parameter.upper)}"] if np.isfinite(parameter.upper) else []
    lines += [f"starts = [{', '.join(map(_number, parameter.starts))}]"] if parameter.starts else []
    return [f"[parameters.{_key(name)}]", *lines]


def _entry(expression: Expression) -> str:
    return _number(expression.number) if expression.kind == "number" else _quoted(str(expression))


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\U{ord(c):08x}" for c in escaped) + '"'


def _key(name: str) -> str:
    # Without quotes TOML allows ASCII only, and a Greek letter is a fine name for a parameter.
    return name if name.isascii() and name.replace("_", "").isalnum() else _quoted(name)


def _list(texts: Iterable[str]) -> str:
    return "[" + ", ".join(_quoted(text) for text in texts) + "]"


def _listed(name: str, texts: Iterable[str]) -> list[str]:
    return [f"{name} = [", *(f"  {_quoted(text)}," for text in texts), "]"]


def _number(value: float) -> str:
    text = repr(float(value))
    return text if any(c in text for c in ".einf") else text + ".0"


__all__ = ["SCHEMA", "from_toml", "to_toml"]

_BOTH = ("schema", "name", "inputs", "states", "outputs", "gain", "optional", "source", "constants", "parameters")
_EQUATIONS = (*_BOTH, "equations", "delays")
_MATRICES = (*_BOTH, "M", "F", "G", "H0", "H1", "input_delays", "output_delays")
_NEEDED = ("name", "inputs", "states", "outputs", "parameters")


def from_toml(text: str, *, where: str = "the model") -> LinearStructure:
    """Read a structure; its parameters start from the values in the text.

    A model is written with equations, as a paper prints them, or with matrices::

        equations = ["q' = M_q*q + M_pitch*pitch_command"]     F = [["M_q"]]
        outputs = ["q"]                                        G = [["M_pitch"]]
        [delays]                                               H0 = [[1]]
        pitch_command = "tau_pitch"                            input_delays = ["tau_pitch"]

    Parameters
    ----------
    text
        As :func:`to_toml` writes it, or by hand.
    where
        Name of the file, for messages.

    Raises
    ------
    ModelError
        The text is no TOML, or what it says is no model. Name of the file, line and the text of that line are given.

    Examples
    --------
    >>> lag = from_toml('''
    ... name = "lag"
    ... inputs = ["u"]
    ... states = ["x"]
    ... equations = ["T*x' = -x + u"]
    ... outputs = ["x"]
    ... [parameters.T]
    ... value = 0.1
    ... unit = "s"
    ... ''')
    >>> lag.parameters.values
    {'T': 0.1}
    """
    source = Source(text=text, where=where)
    table = _table(source)
    _check_keys(table, source)
    constants = source.numbers(table.get("constants", {}), ("constants",))
    parameters = read_parameters(table["parameters"], constants, source)
    return read_structure(table, parameters, constants, source)


def _table(source: Source) -> Mapping[str, object]:
    try:
        return tomllib.loads(source.text)
    except (ValueError, RecursionError) as error:  # too long a number and too deep a nesting are no decode errors
        message = str(error)
        line = re.search(r"at line (\d+)", message)
        last = 1 + source.text.rstrip("\n").count("\n")
        at = int(line[1]) if line else last if "end of document" in message else 1
        raise source.error_at(at, f"this is not valid TOML: {message}", remedy="correct the line it names") from error


def _check_keys(table: Mapping[str, object], source: Source) -> None:
    schema = table.get("schema", SCHEMA)
    if schema != SCHEMA:
        raise source.error(("schema",), f"the model has the schema {schema!r}", needed=SCHEMA)
    known = _EQUATIONS if "equations" in table else _MATRICES
    if unknown := [key for key in table if key not in known]:
        if unknown[0] in (*_EQUATIONS, *_MATRICES):
            came = f"the model has both equations and {unknown[0]}"
            raise source.error((unknown[0],), came, needed="equations and delays, or matrices")
        raise source.unknown("key", unknown[0], known, (unknown[0],))
    needed = _NEEDED if "equations" in table else (*_NEEDED, "F", "G", "H0")
    if missing := [key for key in needed if key not in table]:
        came = f"the model lacks {', '.join(missing)}"
        form = "" if "equations" in table else "; with equations instead of F, G and H0"
        raise source.error((), came, needed=f"a model of the schema {SCHEMA}{form}")
