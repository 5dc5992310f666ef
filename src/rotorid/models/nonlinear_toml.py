"""Nonlinear structures as TOML text."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from typing import Any

from rotorid.models.equations import Symbols
from rotorid.models.expression import Expression
from rotorid.models.nonlinear import NonlinearStructure, check_late, equation, explicit, output
from rotorid.models.parameter import ParameterSet
from rotorid.models.toml import SCHEMA, read_parameters
from rotorid.models.toml_source import Path, Source

KIND = "nonlinear"

_NEEDED = ("kind", "name", "inputs", "states", "equations", "outputs", "parameters")
_KEYS = ("schema", *_NEEDED, "source", "delays", "constants", "starts")


def nonlinear_from_toml(text: str, *, where: str = "the model") -> NonlinearStructure:
    """Read a nonlinear structure; its parameters start from the values in the text.

    It is written as a linear one is with equations, see :func:`rotorid.models.toml.from_toml`, with
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
    constants = source.numbers(table.get("constants", {}), ("constants",))
    parameters = read_parameters(table["parameters"], constants, source)
    symbols = _symbols(table, parameters, constants, source)
    rows = []
    for place, line in enumerate(source.texts(table["equations"], ("equations",))):
        with source.about("equations", place):
            rows.append(equation(line, symbols))
    with source.about("equations"):
        rates = explicit(rows, symbols.states)
    seen = []
    for place, line in enumerate(source.texts(table["outputs"], ("outputs",))):
        with source.about("outputs", place):
            seen.append(output(line, symbols, rates))
    late = _delays(table, symbols, source)
    with source.about():
        return NonlinearStructure(
            name=source.text_of(table["name"], ("name",)),
            inputs=symbols.inputs,
            states=symbols.states,
            outputs=tuple(name for name, _ in seen),
            equations=tuple(rates[f"{state}'"] for state in symbols.states),
            output_equations=tuple(expression for _, expression in seen),
            input_delays=tuple(late.get(name, Expression()) for name in symbols.inputs),
            parameters=parameters,
            constants=constants,
            starts=_starts(table, symbols, tuple(name for name, _ in seen), constants, source),
            source=source.text_of(table.get("source", ""), ("source",)),
        )


def _table(source: Source) -> Mapping[str, Any]:
    try:
        table = tomllib.loads(source.text)
    except (ValueError, RecursionError) as error:  # too long a number and too deep a nesting are no decode errors
        line = re.search(r"at line (\d+)", str(error))
        came = f"this is not valid TOML: {error}"
        raise source.error_at(int(line[1]) if line else 1, came, remedy="correct the line it names") from error
    if (schema := table.get("schema", SCHEMA)) != SCHEMA:
        raise source.error(("schema",), f"the model has the schema {schema!r}", needed=SCHEMA)
    if (kind := table.get("kind")) != KIND:
        raise source.error(("kind",), f"the model is of the kind {kind!r}", needed=f'kind = "{KIND}"')
    for key in table:
        if key not in _KEYS:
            raise source.unknown("key", key, _KEYS, (key,))
    if missing := [key for key in _NEEDED if key not in table]:
        raise source.error((), f"the model lacks {', '.join(missing)}", needed=", ".join(_NEEDED))
    return table


def _symbols(
    table: Mapping[str, Any], parameters: ParameterSet, constants: Mapping[str, float], source: Source
) -> Symbols:
    inputs, states = (source.texts(table[key], (key,)) for key in ("inputs", "states"))
    symbols = Symbols(inputs, states, (*parameters.names, *constants))
    places: list[tuple[str, Path]] = [(name, ("inputs", i)) for i, name in enumerate(inputs)]
    places += [(name, ("states", i)) for i, name in enumerate(states)]
    places += [(name, ("constants", name)) for name in constants]
    places += [(name, ("parameters", name)) for name in parameters.names]
    for name, path in places:
        with source.about(*path):
            symbols.check(name)
    return symbols


def _delays(table: Mapping[str, Any], symbols: Symbols, source: Source) -> dict[str, Expression]:
    late = {}
    for name, value in source.table(table.get("delays", {}), ("delays",)).items():
        path = ("delays", name)
        with source.about(*path):
            check_late(name, symbols)
        late[name] = _known(value, symbols.coefficients, "parameter or constant", path, source)
    return late


def _starts(
    table: Mapping[str, Any],
    symbols: Symbols,
    outputs: tuple[str, ...],
    constants: Mapping[str, float],
    source: Source,
) -> dict[str, Expression]:
    starts = {}
    for state, value in source.table(table.get("starts", {}), ("starts",)).items():
        path = ("starts", state)
        if state not in symbols.states:
            raise source.unknown("state", state, symbols.states, path)
        known = (*outputs, *symbols.inputs, *constants)
        starts[state] = _known(value, known, "output, input or constant", path, source)
    return starts


def _known(value: Any, known: tuple[str, ...], kind: str, path: Path, source: Source) -> Expression:
    """An expression of known names only."""
    expression = source.expression(value, path)
    for name in sorted(expression.names - set(known)):
        raise source.unknown(kind, name, known, path)
    return expression
