"""Outputs that the inputs of a record moved: no other shows how much a model explains.

An output at rest, or one that wind and drift alone move, has a share of motion too: that of its noise, about zero for
any model. It says nothing against the model, and nothing for it. So a fit has three answers: a share, a low share, and
not enough data.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.data.record import STANDARD_UNITS
from rotorid.models.nonlinear import NonlinearStructure
from rotorid.models.structure import LinearStructure, answers
from rotorid.signal.excitations import LEAST_MOTION
from rotorid.typing import BoolArray, FloatArray
from rotorid.verification.scores import GOOD_FIT_PERCENT

_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class Driven:
    """Outputs of a model that the inputs of a record moved.

    Parameters
    ----------
    outputs
        Those that an input acts on which moved at all.
    clearly
        Those that an input acts on which moved by more than noise and corrections of a pilot.
    """

    outputs: frozenset[str]
    clearly: frozenset[str]

    def judged(self, output: str, fit_percent: float) -> float:
        """A fit in percent, or minus infinity where the record does not show it.

        A good fit is evidence however little the inputs moved; a low one is none unless they moved clearly.

        Examples
        --------
        >>> little = Driven(outputs=frozenset({"phi"}), clearly=frozenset())
        >>> little.judged("phi", 92.0), little.judged("phi", 3.0), little.judged("psi", 92.0)
        (92.0, -inf, -inf)
        """
        shown = output in self.clearly or (output in self.outputs and fit_percent >= GOOD_FIT_PERCENT)
        return fit_percent if shown else -math.inf


def driven(structure: LinearStructure | NonlinearStructure, inputs: FloatArray) -> Driven:
    """Outputs of a structure that the inputs of a record moved.

    Parameters
    ----------
    structure
        Its equations say on which outputs an input acts, directly or through states.
    inputs
        Shape ``(u, samples)``.

    Examples
    --------
    >>> from rotorid.models.library import response_model
    >>> model = response_model("response.first_order", [("phi_setpoint", "phi"), ("theta_setpoint", "theta")])
    >>> sorted(driven(model, np.array([[0.0, 0.2, 0.0], [0.1, 0.1, 0.1]])).outputs)
    ['phi']
    """
    usual = np.array([LEAST_MOTION.get(STANDARD_UNITS.get(name, "1"), 0.02) for name in structure.inputs])
    size = np.abs(inputs).max(axis=1)
    moved = np.ptp(inputs, axis=1) > _ROUNDING * np.maximum(size, usual)
    motion = np.percentile(np.abs(inputs - np.median(inputs, axis=1, keepdims=True)), 99.8, axis=1)
    reached = _reached(structure)

    def names(rows: BoolArray) -> frozenset[str]:
        return frozenset(np.array(structure.outputs)[(reached & rows).any(axis=1)].tolist())

    return Driven(outputs=names(moved), clearly=names(moved & (motion >= usual)))


def undriven_words(structure: LinearStructure | NonlinearStructure, output: str, found: Sequence[Driven] = ()) -> str:
    """Why the records do not judge an output, as the start of a sentence.

    Examples
    --------
    >>> from rotorid.models.library import response_model
    >>> undriven_words(response_model("response.first_order", [("phi_setpoint", "phi")]), "phi")
    'phi_setpoint did not move'
    """
    row = structure.outputs.index(output)
    names = [name for name, acts in zip(structure.inputs, _reached(structure)[row], strict=True) if acts]
    if not names:
        return f"No input moves {output}"
    moved = any(output in one.outputs for one in found)
    if any(output in one.clearly for one in found):
        return f"{output} did not move"
    return f"{' and '.join(names)} {'moved too little' if moved else 'did not move'}"


def _reached(structure: LinearStructure | NonlinearStructure) -> BoolArray:
    """Which input acts on which output, shape ``(y, u)``."""
    if isinstance(structure, LinearStructure):
        return answers(structure)
    columns = []
    for name in structure.inputs:
        reached = structure.reached([name]) | {name}
        columns.append([bool(output.names & reached) for output in structure.output_equations])
    return np.array(columns, dtype=np.bool_).T
