"""Writing a structure as TOML text."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from rotorid.models.equations import can_be_equations, written_equations, written_outputs
from rotorid.models.expression import Expression
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.models.structure import LinearStructure

SCHEMA = "rotorid.model/1"


def to_toml(structure: LinearStructure, parameters: ParameterSet, std: Mapping[str, float]) -> str:
    """A structure with values, as text that :func:`~rotorid.models.description.from_toml` reads back.

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
        lines += ["", *_parameter(parameter, std)]
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


def _parameter(parameter: Parameter, std: Mapping[str, float]) -> list[str]:
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
