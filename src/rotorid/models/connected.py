"""The part of a structure that leads from its inputs to its outputs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rotorid.models.condense import Rows
from rotorid.models.structure import LinearStructure
from rotorid.typing import BoolArray


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
    inputs, outputs = responses.any(axis=0), responses.any(axis=1)
    if not responses.any():
        return structure
    states = moved[:, inputs].any(axis=1) & seen[:, outputs].any(axis=1)
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
    chosen = {"states": states, "inputs": inputs, "outputs": outputs}
    axes = {
        "M": (states, states),
        "F": (states, states),
        "G": (states, inputs),
        "H0": (outputs, states),
        "H1": (outputs, states),
    }
    rows = {
        name: tuple(
            tuple(entry for entry, kept in zip(row, columns, strict=True) if kept)
            for row, kept_row in zip(getattr(structure, name), lines, strict=True)
            if kept_row
        )
        for name, (lines, columns) in axes.items()
    }
    names = {
        name: tuple(one for one, kept in zip(getattr(structure, name), mask, strict=True) if kept)
        for name, mask in chosen.items()
    }
    delays = {
        "input_delays": tuple(one for one, kept in zip(structure.input_delays, inputs, strict=True) if kept),
        "output_delays": tuple(one for one, kept in zip(structure.output_delays, outputs, strict=True) if kept),
    }
    entries = [entry for matrix in rows.values() for row in matrix for entry in row]
    entries += [entry for row in delays.values() for entry in row]
    used = frozenset[str]().union(*(entry.names for entry in entries))
    left = structure.parameters.only(name for name in structure.parameters.names if name in used)
    return replace(
        structure,
        **names,
        **rows,
        **delays,
        parameters=left,
        gain=structure.gain if structure.gain in left.names else None,
        optional=tuple(name for name in structure.optional if name in left.names),
    )
