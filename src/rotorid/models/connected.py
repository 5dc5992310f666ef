"""The part of a structure that leads from its inputs to its outputs."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from rotorid.models.condense import Rows
from rotorid.models.structure import LinearStructure
from rotorid.typing import BoolArray

_T = TypeVar("_T")


def connected(structure: LinearStructure) -> LinearStructure:
    """A structure without what no response of it can show.

    States that no input moves stay at rest, and states that no output follows from change nothing; both go, with the
    parameters that then stand nowhere. Inputs and outputs without a response go too, unless none has one.

    Parameters
    ----------
    structure
        Such as one of which some inputs and outputs were selected. Entries count as they stand, whatever the values.

    Examples
    --------
    Without a command in yaw nothing moves its motors:

    >>> from rotorid.models.catalog import library_model
    >>> roll = connected(library_model("hover.lateral").select(inputs=["roll_command"]))
    >>> "motor_yaw" in roll.states, "L_yaw" in roll.parameters.names
    (False, False)
    """
    links = _filled(structure.M) | _filled(structure.F)
    moved = _spread(_filled(structure.G), links)
    seen = _spread((_filled(structure.H0) | _filled(structure.H1)).T, links.T)
    # From each input to each output there is a response where one state is both moved and seen.
    responses = np.asarray(seen.T @ moved)
    if not responses.any():
        return structure
    inputs, outputs = np.asarray(responses.any(axis=0)), np.asarray(responses.any(axis=1))
    states = np.asarray(moved[:, inputs].any(axis=1) & seen[:, outputs].any(axis=1))
    if states.all() and inputs.all() and outputs.all():
        return structure
    return _part(structure, states, inputs, outputs)


def _filled(rows: Rows) -> BoolArray:
    return np.array([[not entry.is_zero for entry in row] for row in rows], dtype=np.bool_)


def _spread(first: BoolArray, links: BoolArray) -> BoolArray:
    """States reached from each column of ``first`` along links from column to row, shape ``(x, n)``."""
    reached = first
    for _ in range(len(links)):
        reached = reached | (links @ reached)
    return reached


def _part(structure: LinearStructure, states: BoolArray, inputs: BoolArray, outputs: BoolArray) -> LinearStructure:
    """Some states, inputs and outputs, and the parameters that stand there."""
    change: dict[str, Any] = {
        "M": _block(structure.M, states, states),
        "F": _block(structure.F, states, states),
        "G": _block(structure.G, states, inputs),
        "H0": _block(structure.H0, outputs, states),
        "H1": _block(structure.H1, outputs, states),
        "input_delays": _kept(structure.input_delays, inputs),
        "output_delays": _kept(structure.output_delays, outputs),
    }
    rows = [row for name in ("M", "F", "G", "H0", "H1") for row in change[name]]
    entries = [entry for row in (*rows, change["input_delays"], change["output_delays"]) for entry in row]
    used = frozenset[str]().union(*(entry.names for entry in entries))
    left = structure.parameters.only(name for name in structure.parameters.names if name in used)
    return replace(
        structure,
        **change,
        states=_kept(structure.states, states),
        inputs=_kept(structure.inputs, inputs),
        outputs=_kept(structure.outputs, outputs),
        parameters=left,
        gain=structure.gain if structure.gain in left.names else None,
        optional=tuple(name for name in structure.optional if name in left.names),
    )


def _block(rows: Rows, kept_rows: BoolArray, kept_columns: BoolArray) -> Rows:
    return tuple(_kept(row, kept_columns) for row in _kept(rows, kept_rows))


def _kept(items: tuple[_T, ...], kept: BoolArray) -> tuple[_T, ...]:
    return tuple(item for item, stays in zip(items, kept, strict=True) if stays)
