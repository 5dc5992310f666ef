"""The equations or matrices of a model in a TOML text."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rotorid.errors import ModelError
from rotorid.models.condense import Row, Rows
from rotorid.models.description_source import Path, Source
from rotorid.models.equations import (
    DynamicRows,
    OutputRows,
    Symbols,
    check_delayed,
    check_equations,
    check_once,
    dynamic_rows,
    output_rows,
)
from rotorid.models.expression import Expression
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure

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
