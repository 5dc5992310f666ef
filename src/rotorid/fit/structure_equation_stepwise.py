"""Which states and inputs one equation of a structure needs, found by stepwise regression on records."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.errors import UsageError
from rotorid.fit.parameter_map import ParameterMap
from rotorid.fit.regression import CONSTANT
from rotorid.fit.stepwise import StepwiseRegression, stepwise
from rotorid.fit.structure_equation_rows import EquationDomain, EquationRows
from rotorid.fit.time_data import TimeData
from rotorid.fit.time_equation_error import InTime
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.models.ties import no_such
from rotorid.simulate.hold import Hold
from rotorid.typing import FloatArray


def stepwise_equation(
    structure: LinearStructure,
    parameters: ParameterSet,
    equation: str,
    records: Sequence[TimeData],
    *,
    candidates: Sequence[str] | None = None,
    domain: EquationDomain | None = None,
    hold: Hold = "first",
    keep: Sequence[str] = (),
) -> StepwiseRegression:
    """Enter and remove states and inputs of one equation by their partial F; the model of least PRESS is the answer.

    The left side is the derivative of the state, without the terms that the structure knows: gravity, as a rule.

    Parameters
    ----------
    structure, parameters, records, domain, hold
        As for :func:`rotorid.fit.structure_equation_error.fit_equation_error`; delays are those of ``parameters``.
    equation
        State whose equation it is, such as ``q``, or an output that sees its derivative, such as ``ax``.
    candidates
        States and inputs that may stand on the right; by default all states that the outputs show and all inputs.
    keep
        Candidates that stand there in any case.

    Raises
    ------
    UsageError
        There is no such equation with measured states, or a candidate is neither a measured state nor an input.
    InsufficientDataError
        As for :func:`rotorid.fit.stepwise.stepwise`.

    Notes
    -----
    Biased as any equation error: noise in a state lets others enter in its place, see
    :mod:`rotorid.fit.structure_equation_error`.

    Examples
    --------
    >>> from rotorid.models.response import response_model
    >>> from rotorid.simulate.linear import simulate_linear
    >>> structure = response_model("response.first_order", [("r_setpoint", "r")])
    >>> u = np.sin(np.arange(2000) ** 1.5 / 1e3)[None]
    >>> system = structure.matrices(structure.parameters.values)
    >>> y = simulate_linear(system, u, sample_rate_hz=50.0, hold="first")
    >>> record = TimeData(name="twin", inputs=u, outputs=y, sample_rate_hz=50.0)
    >>> stepwise_equation(structure, structure.parameters, "r", [record]).regression.names
    ('constant', 'r_setpoint', 'r')
    """
    rows = EquationRows(ParameterMap(structure, parameters), tuple(records), domain or InTime(), hold).checked()
    # A derivative is written as the state in the call, and with a stroke where outputs stand beside it.
    names = [name.removesuffix("'") for name in rows.names]
    if equation not in names:
        raise UsageError(
            f"{structure.name} has no equation {equation} whose states were all measured",
            needed=f"one of {', '.join(names)}",
        )
    row = names.index(equation)
    known = [structure.states[source.state] for source in rows.plan.sources]
    offered = tuple(candidates) if candidates is not None else (*known, *structure.inputs)
    for name in offered:
        if name not in known and name not in structure.inputs:
            raise no_such("measured state or input", name, (*known, *structure.inputs))
    delays_s = rows.start[0].input_delays_s
    blocks = [_block(rows, record, row, offered, delays_s) for record in range(len(records))]
    return stepwise(
        np.concatenate([matrix for matrix, _ in blocks]),
        np.concatenate([left for _, left in blocks]),
        (*offered, CONSTANT),
        keep=(CONSTANT, *keep),
        constant=False,
        ordered=rows.domain.ordered and len(records) == 1,
    )


def _block(
    rows: EquationRows, record: int, row: int, offered: Sequence[str], delays_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Candidates and a constant, shape ``(n, c)``, and the left side of one equation, ``(n,)``."""
    structure, (system, slopes) = rows.map.structure, rows.start
    now, moves = rows.rows(system), rows.rows(slopes)
    columns = rows.columns(record, delays_s)
    firm = np.where(moves.B[:, row].any(axis=0), 0.0, now.B[row])
    left = now.A[row] @ columns.slopes + now.D[row] @ columns.outputs - firm @ columns.levels
    levels = dict(zip(structure.states, columns.levels, strict=True))
    inputs = dict(zip(structure.inputs, columns.inputs, strict=True))
    one = rows.domain.one(rows.histories[record])
    chosen = [inputs[name] if name in inputs else levels[name] for name in offered]
    return np.stack([*chosen, one], axis=1), left
