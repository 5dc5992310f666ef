r"""Models as TOML text: equations or matrices, parameters and constants, read back as they were written.

A model is a table of names, equations and parameters::

    name = "lag"
    inputs = ["u"]
    states = ["x"]
    equations = ["T*x' = -x + u"]
    outputs = ["x"]
    [parameters.T]
    value = 0.1
    unit = "s"

Linear models may be written as matrices instead; nonlinear ones say ``kind = "nonlinear"``. Reading refuses what is no
model and names file, line and the text of that line. Writing is for people as much as for :func:`from_toml`: one line
for each equation and for each matrix, and beside a tied parameter the number that its tie gives: layout and comments,
which a general writer of TOML does not keep.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar, get_args

import numpy as np

from rotorid.errors import ModelError
from rotorid.io.documents import DocumentError, parse_toml, toml_text
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
    with_direct_inputs,
    written_equations,
    written_outputs,
)
from rotorid.models.expression import Expression
from rotorid.models.nonlinear import NonlinearStructure, equation, explicit, output
from rotorid.models.parameter import Parameter, ParameterSet, Status, TieError, check_unit
from rotorid.models.structure import LinearStructure, Row, Rows
from rotorid.models.toml_source import Path, Source

SCHEMA = "rotorid.model/1"

_NEEDED = ("name", "inputs", "states", "outputs", "parameters")
_LINEAR = ("schema", "name", "inputs", "states", "outputs", "gain", "optional", "source", "constants", "parameters")
_EQUATIONS = (*_LINEAR, "equations", "delays")
_ENTRIES = ("M", "F", "G", "H0", "H1")
_MATRICES = (*_LINEAR, *_ENTRIES, "input_delays", "output_delays")
_NONLINEAR_NEEDED = ("kind", "name", "inputs", "states", "equations", "outputs", "parameters")
_NONLINEAR = ("schema", *_NONLINEAR_NEEDED, "source", "delays", "constants", "starts")
_PARAMETER = ("value", "unit", "lower", "upper", "status", "starts", "std", "tied", "essential")


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
    _check_linear_keys(table, source)
    table = _with_direct_inputs(table)
    model: _Equations | _Matrices
    model = _model(_Equations, table, source) if "equations" in table else _model(_Matrices, table, source)
    for name in model.constants:
        if name in model.parameters.names:
            raise source.error(("constants", name), f"{name} is a parameter and a constant", needed="different names")
    entries = model.entries()
    gain = source.text_of(table["gain"], ("gain",)) if "gain" in table else None
    optional = source.texts(table.get("optional", []), ("optional",))
    for key, names in (("gain", [gain] if gain is not None else []), ("optional", optional)):
        for name in names:
            if name not in model.parameters.names:
                raise source.unknown(f"parameter ({key})", name, model.parameters.names, (key,))
    _check_used(entries, model.parameters, source)
    with source.about():
        return LinearStructure(
            name=source.text_of(table["name"], ("name",)),
            inputs=model.inputs,
            states=model.states,
            parameters=model.parameters,
            constants=model.constants,
            gain=gain,
            optional=optional,
            source=source.text_of(table.get("source", ""), ("source",)),
            **entries,
        )


def nonlinear_from_toml(text: str, *, where: str = "the model") -> NonlinearStructure:
    """Read a nonlinear structure; its parameters start from the values in the text.

    It is written as a linear one is with equations, see :func:`from_toml`, with
    ``kind = "nonlinear"``. Right sides may be any expression; a derivative on a right side stands for what its own
    equation says. Inputs may have delays. Under ``starts`` stands what the first sample says of the states.

    Parameters
    ----------
    text
        The text.
    where
        Name of the file, for messages.

    Raises
    ------
    ModelError
        The text is no TOML, or what it says is no model. Name of the file, line and the text of that line are given.

    Examples
    --------
    >>> drag = nonlinear_from_toml('''
    ... kind = "nonlinear"
    ... name = "drag"
    ... inputs = ["push"]
    ... states = ["v"]
    ... equations = ["v' = push - k*abs(v)*v"]
    ... outputs = ["v"]
    ... [starts]
    ... v = "v"
    ... [parameters.k]
    ... value = 0.3
    ... unit = "1/m"
    ... ''')
    >>> str(drag.equations[0]), drag.parameters.values
    ('push - k*abs(v)*v', {'k': 0.3})
    """
    source = Source(text=text, where=where)
    table = _table(source)
    _check_nonlinear_keys(table, source)
    model = _model(_Reading, table, source)
    symbols = model.symbols()
    rows = []
    for place, line in enumerate(source.texts(table["equations"], ("equations",))):
        with source.about("equations", place):
            rows.append(equation(line, symbols))
    with source.about("equations"):
        rates = explicit(rows, symbols.states)
    outputs = []
    for place, line in enumerate(source.texts(table["outputs"], ("outputs",))):
        with source.about("outputs", place):
            outputs.append(output(line, symbols, rates))
    names = tuple(name for name, _ in outputs)
    delays = model.delays()
    starts = _starting_states(model, names)
    with source.about():
        return NonlinearStructure(
            name=source.text_of(table["name"], ("name",)),
            inputs=symbols.inputs,
            states=symbols.states,
            outputs=names,
            equations=tuple(rates[f"{state}'"] for state in symbols.states),
            output_equations=tuple(expression for _, expression in outputs),
            input_delays=tuple(delays.get(name, Expression()) for name in symbols.inputs),
            parameters=model.parameters,
            constants=model.constants,
            starts=starts,
            source=source.text_of(table.get("source", ""), ("source",)),
        )


def _with_direct_inputs(table: Mapping[str, Any]) -> dict[str, Any]:
    """A table whose outputs name inputs, with a state for each of these; of wrong types it stays as it is."""
    rows = [table.get(name) for name in ("inputs", "states", "equations", "outputs")]
    if not all(isinstance(row, list) and all(isinstance(text, str) for text in row) for row in rows):
        return dict(table)
    written = with_direct_inputs(*rows)  # type: ignore[arg-type]
    return {**table, **{name: list(texts) for name, texts in written._asdict().items()}}


def to_toml(structure: LinearStructure, parameters: ParameterSet, std: Mapping[str, float]) -> str:
    """A structure with values, as text that :func:`from_toml` reads back.

    It is written as equations; as matrices where a name is not allowed in an equation.

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
        f"name = {toml_text(structure.name)}",
        *([f"source = {toml_text(structure.source)}"] if structure.source else []),
        f"inputs = {_list(structure.inputs)}",
        f"states = {_list(structure.states)}",
        *(_listed("equations", written_equations(structure)) if equations else _matrices(structure)),
        *(_listed("outputs", outputs) if equations else [f"outputs = {_list(outputs)}"]),
        *([f"gain = {toml_text(structure.gain)}"] if structure.gain else []),
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


def nonlinear_to_toml(structure: NonlinearStructure, std: Mapping[str, float]) -> str:
    """A nonlinear structure with its values, as text that :func:`nonlinear_from_toml` reads back.

    Parameters
    ----------
    structure
        Derivatives on right sides were put in, so that the text may be longer than the one it was read from.
    std
        Standard deviations of the parameters that have one; for people, ignored when read back.
    """
    rates = zip(structure.states, structure.equations, strict=True)
    equations = zip(structure.outputs, structure.output_equations, strict=True)
    delays = zip(structure.inputs, structure.input_delays, strict=True)
    tables: dict[str, list[str]] = {
        "delays": [f"{_key(name)} = {_entry(delay)}" for name, delay in delays if not delay.is_zero],
        "starts": [f"{_key(name)} = {_entry(start)}" for name, start in structure.starts.items()],
        "constants": [f"{_key(name)} = {_number(value)}" for name, value in structure.constants.items()],
    }
    lines = [
        f'schema = "{SCHEMA}"',
        'kind = "nonlinear"',
        f"name = {toml_text(structure.name)}",
        *([f"source = {toml_text(structure.source)}"] if structure.source else []),
        f"inputs = {_list(structure.inputs)}",
        f"states = {_list(structure.states)}",
        *_listed("equations", (f"{state}' = {rate}" for state, rate in rates)),
        *_listed(
            "outputs", (name if name == str(expression) else f"{name} = {expression}" for name, expression in equations)
        ),
    ]
    for name, entries in tables.items():
        lines += ["", f"[{name}]", *entries] if entries else []
    for parameter in structure.parameters:
        lines += ["", *_parameter_lines(parameter, std)]
    return "\n".join(lines if len(structure.parameters) else [*lines, "", "[parameters]"]) + "\n"


def structure_from_toml(text: str, *, where: str = "the model") -> LinearStructure | NonlinearStructure:
    """Read a structure of either kind: nonlinear where the text says ``kind = "nonlinear"``.

    Raises
    ------
    ModelError
        As :func:`from_toml` and :func:`nonlinear_from_toml` do.
    """
    nonlinear = "kind" in _table(Source(text=text, where=where))
    return nonlinear_from_toml(text, where=where) if nonlinear else from_toml(text, where=where)


def _table(source: Source) -> Mapping[str, Any]:
    try:
        table = parse_toml(source.text, any_integer=True)
    except DocumentError as error:
        came = f"this is not valid TOML: {error}"
        raise source.error_at(error.line or 1, came, remedy="correct the line it names") from error
    if (schema := table.get("schema", SCHEMA)) != SCHEMA:
        raise source.error(("schema",), f"the model has the schema {schema!r}", needed=SCHEMA)
    return table


def _check_linear_keys(table: Mapping[str, Any], source: Source) -> None:
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


def _check_nonlinear_keys(table: Mapping[str, Any], source: Source) -> None:
    if (kind := table.get("kind")) != "nonlinear":
        raise source.error(("kind",), f"the model is of the kind {kind!r}", needed='kind = "nonlinear"')
    for key in table:
        if key not in _NONLINEAR:
            raise source.unknown("key", key, _NONLINEAR, (key,))
    if missing := [key for key in _NONLINEAR_NEEDED if key not in table]:
        raise source.error((), f"the model lacks {', '.join(missing)}", needed=", ".join(_NONLINEAR_NEEDED))


@dataclass(frozen=True, slots=True)
class _Reading:
    """A model of which inputs, states, parameters and constants are read: what every way of writing one shares."""

    source: Source
    table: Mapping[str, Any]
    inputs: tuple[str, ...]
    states: tuple[str, ...]
    parameters: ParameterSet
    constants: Mapping[str, float]

    def symbols(self) -> Symbols:
        """The names that may stand in equations, each with one meaning."""
        symbols = Symbols(self.inputs, self.states, (*self.parameters.names, *self.constants))
        places: list[tuple[str, Path]] = [(name, ("inputs", i)) for i, name in enumerate(self.inputs)]
        places += [(name, ("states", i)) for i, name in enumerate(self.states)]
        places += [(name, ("constants", name)) for name in self.constants]
        places += [(name, ("parameters", name)) for name in self.parameters.names]
        for name, path in places:
            with self.source.about(*path):
                symbols.check(name)
        return symbols

    def check_names(self, expression: Expression, known: Sequence[str], kind: str, path: Path) -> Expression:
        """Refuse an expression of other names than known ones."""
        for name in sorted(expression.names - set(known)):
            raise self.source.unknown(kind, name, known, path)
        return expression

    def check(self, entry: Expression, path: Path) -> Expression:
        """Refuse an entry of anything but parameters and constants."""
        return self.check_names(entry, (*self.parameters.names, *self.constants), "parameter or constant", path)

    def delay(self, value: Any, path: Path) -> Expression:
        return self.check(self.source.expression(value, path), path)

    def delays(self, outputs: Sequence[str] = ()) -> dict[str, Expression]:
        """What stands under ``delays``: for inputs, and for outputs where a model may have such delays."""
        delays = {}
        for name, value in self.source.table(self.table.get("delays", {}), ("delays",)).items():
            with self.source.about("delays", name):
                check_delayed(name, self.inputs, outputs)
            delays[name] = self.delay(value, ("delays", name))
        return delays


def _starting_states(model: _Reading, outputs: Sequence[str]) -> dict[str, Expression]:
    """What the first sample says of the states of a nonlinear model."""
    starts, known = {}, (*outputs, *model.inputs, *model.constants)
    for state, value in model.source.table(model.table.get("starts", {}), ("starts",)).items():
        path = ("starts", state)
        if state not in model.states:
            raise model.source.unknown("state", state, model.states, path)
        expression = model.source.expression(value, path)
        starts[state] = model.check_names(expression, known, "output, input or constant", path)
    return starts


_T = TypeVar("_T", bound=_Reading)


class _Linear(_Reading):
    """Entries of matrices: expressions of parameters and constants."""

    __slots__ = ()

    def check(self, entry: Expression, path: Path) -> Expression:
        """Refuse also an entry whose numbers alone have no value."""
        _Reading.check(self, entry, path)
        with self.source.about(*path):
            entry.substitute(self.constants).as_affine()
        return entry

    def delay(self, value: Any, path: Path) -> Expression:
        """A delay; where it is one parameter whose unit is given, that is seconds."""
        entry = _Reading.delay(self, value, path)
        if entry.kind == "name" and entry.name in self.parameters.names:
            given = self.table["parameters"][entry.name]
            if given.get("unit", "s") != "s":
                came = f"{entry.name} is a delay and its unit is {given['unit']!r}"
                raise self.source.error(("parameters", entry.name, "unit"), came, needed="'s'")
        return entry


class _Equations(_Linear):
    """A model written as a paper prints it."""

    def entries(self) -> dict[str, Any]:
        symbols = self.symbols()
        rows = self.rows(symbols)
        outputs = self.outputs(symbols)
        names = tuple(output.name for output in outputs)
        delays = self.delays(names)
        return {
            "outputs": names,
            "M": tuple(row.M for row in rows),
            "F": tuple(row.F for row in rows),
            "G": tuple(row.G for row in rows),
            "H0": tuple(output.H0 for output in outputs),
            "H1": tuple(output.H1 for output in outputs),
            "input_delays": tuple(delays.get(name, Expression()) for name in self.inputs),
            "output_delays": tuple(delays.get(name, Expression()) for name in names),
        }

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


class _Matrices(_Linear):
    """A model written as its matrices."""

    def entries(self) -> dict[str, Any]:
        outputs = self.source.texts(self.table["outputs"], ("outputs",))
        x, u, y = len(self.states), len(self.inputs), len(outputs)
        identity = [[float(i == j) for j in range(x)] for i in range(x)]
        shapes = {"M": (x, x), "F": (x, x), "G": (x, u), "H0": (y, x), "H1": (y, x)}
        plain = {"M": identity, "H1": [[0.0] * x] * y}
        entries: dict[str, Any] = {
            name: self.matrix(name, self.table.get(name, plain.get(name)), shape) for name, shape in shapes.items()
        }
        delays = {name: self.channel_delays(name, count) for name, count in (("input_delays", u), ("output_delays", y))}
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
            came = f"{name} contains something other than rows of entries"
            raise self.source.error((name, i), came, needed="rows of entries in square brackets")
        if len(value) != width:
            came = f"row {i + 1} of matrix {name} has {len(value)} entries"
            raise self.source.error((name, i), came, needed=f"{width} entries")
        return tuple(
            self.check(self.source.expression(entry, (name, i, j)), (name, i, j)) for j, entry in enumerate(value)
        )

    def channel_delays(self, name: str, count: int) -> Row:
        value = self.table.get(name, [0.0] * count)
        if not isinstance(value, list):
            raise self.source.error((name,), f"{name} is {value!r}", needed=f"a list of {count} delays")
        if len(value) != count:
            raise self.source.error((name,), f"{name} has {len(value)} entries", needed=f"{count} entries")
        return tuple(self.delay(entry, (name, i)) for i, entry in enumerate(value))


def _model(form: type[_T], table: Mapping[str, Any], source: Source) -> _T:
    """Names, parameters and constants of a model, for one way of writing it."""
    constants = source.numbers(table.get("constants", {}), ("constants",))
    parameters = _parameters(table["parameters"], constants, source)
    inputs, states = (source.texts(table[key], (key,)) for key in ("inputs", "states"))
    return form(source, table, inputs, states, parameters, constants)


def _parameters(table: Any, constants: Mapping[str, float], source: Source) -> ParameterSet:
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
        if key not in _PARAMETER:
            raise source.unknown(f"key of the parameter {name} called", key, _PARAMETER, (*path, key))
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
            starts=_start_values(entry.get("starts", []), (*path, "starts"), source),
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


def _start_values(value: Any, path: tuple[str, ...], source: Source) -> tuple[float, ...]:
    if not isinstance(value, list):
        raise source.error(path, f"starts of {path[1]} is {value!r}", needed="a list of numbers")
    return tuple(source.number(start, path) for start in value)


def _check_used(entries: Mapping[str, Any], parameters: ParameterSet, source: Source) -> None:
    rows: list[Row] = [row for name in _ENTRIES for row in entries[name]]
    rows += [entries["input_delays"], entries["output_delays"]]
    used = frozenset().union(*(entry.names for row in rows for entry in row))
    reached = parameters.only(name for name in parameters.names if name in used).names
    for parameter in parameters:
        if parameter.name not in reached and parameter.status != "dropped":
            came = f"{parameter.name} stands nowhere in the model"
            raise source.error(("parameters", parameter.name), came, remedy="remove it, or use it")


def _matrices(structure: LinearStructure) -> list[str]:
    lines = ["# M x' = F x + G u(t - input_delays),  y = H0 x + H1 x'"]
    for name in _ENTRIES:
        rows = ", ".join(_list(map(str, row)) for row in getattr(structure, name))
        lines.append(f"{name} = [{rows}]")
    lines.append(f"input_delays = {_list(map(str, structure.input_delays))}")
    return [*lines, f"output_delays = {_list(map(str, structure.output_delays))}"]


def _delays(structure: LinearStructure) -> list[str]:
    every = ((structure.inputs, structure.input_delays), (structure.outputs, structure.output_delays))
    delayed = [pair for names, delays in every for pair in zip(names, delays, strict=True) if not pair[1].is_zero]
    return ["", "[delays]", *(f"{_key(name)} = {_entry(delay)}" for name, delay in delayed)] if delayed else []


def _parameter_lines(parameter: Parameter, std: Mapping[str, float]) -> list[str]:
    name = parameter.name
    if parameter.tied is None:
        lines = [f"value = {_number(parameter.value)}"]
    else:
        lines = [f"tied = {_entry(parameter.tied)}  # {_number(parameter.value)}"]
    lines.append(f"unit = {toml_text(parameter.unit)}")
    lines += [f'status = "{parameter.status}"'] if parameter.tied is None else []
    lines += ["essential = true"] if parameter.essential else []
    lines += [f"std = {_number(std[name])}"] if name in std else []
    lines += [f"lower = {_number(parameter.lower)}"] if np.isfinite(parameter.lower) else []
    lines += [f"upper = {_number(parameter.upper)}"] if np.isfinite(parameter.upper) else []
    lines += [f"starts = [{', '.join(map(_number, parameter.starts))}]"] if parameter.starts else []
    return [f"[parameters.{_key(name)}]", *lines]


def _entry(expression: Expression) -> str:
    return _number(expression.number) if expression.kind == "number" else toml_text(str(expression))


def _key(name: str) -> str:
    # Without quotes TOML allows ASCII only, and a Greek letter is a fine name for a parameter.
    return name if name.isascii() and name.replace("_", "").isalnum() else toml_text(name)


def _list(texts: Iterable[str]) -> str:
    return "[" + ", ".join(toml_text(text) for text in texts) + "]"


def _listed(name: str, texts: Iterable[str]) -> list[str]:
    return [f"{name} = [", *(f"  {toml_text(text)}," for text in texts), "]"]


def _number(value: float) -> str:
    text = repr(float(value))
    return text if any(c in text for c in ".einf") else text + ".0"
