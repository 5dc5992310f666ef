"""Black boxes of an order by maximum likelihood: subspace starts, parallel sections, output error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np

from rotorid.data.findings import Finding
from rotorid.data.immutable import Immutable, read_only
from rotorid.errors import InsufficientDataError, ModelError
from rotorid.fit.black_box_starts import Start, StartPlan, black_box_starts
from rotorid.fit.levenberg_marquardt import LevenbergMarquardt
from rotorid.fit.output_error import OutputErrorFit, fit_output_error
from rotorid.fit.time_data import TimeData, require_records
from rotorid.fit.time_problem import TimeProblem, Unknown
from rotorid.models.black_box import best_references, black_box, black_box_pairs, from_state_space
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.simulate.hold import Hold
from rotorid.typing import FloatArray

_DELAY_SAMPLES = (0, 1, 2, 3)
"""Delays that starts take off where delays are free."""

_SEARCH = LevenbergMarquardt(iterations=150, tolerance=1e-9)


@dataclass(frozen=True, kw_only=True, eq=False)
class BlackBoxFit(Immutable):
    """A black box that was fitted.

    Parameters
    ----------
    structure
        Parallel sections; see :mod:`rotorid.models.black_box`.
    fit
        The output-error fit, with the other minima that its starts came to.
    singular_values
        Of the first subspace, largest first: evidence of the order. Empty where there was none.
    findings
        What an engineer would remark on.
    """

    structure: LinearStructure
    fit: OutputErrorFit
    singular_values: FloatArray
    findings: tuple[Finding, ...] = ()

    def __post_init__(self) -> None:
        self._set(singular_values=read_only(self.singular_values, np.float64, ndim=1), findings=tuple(self.findings))

    @property
    def parameters(self) -> ParameterSet:
        """The identified values."""
        return self.fit.parameters


def fit_black_box(
    records: Sequence[TimeData],
    order: int,
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    delays: bool = False,
    stable: bool = True,
    hold: Hold = "zero",
    unknowns: tuple[Unknown, ...] = ("initial_state", "output_shift"),
    plan: StartPlan | None = None,
    solver: LevenbergMarquardt | None = None,
) -> BlackBoxFit:
    """Fit a state space of an order with the error at the outputs.

    Systems from several subspaces and from drawn poles are brought to parallel sections, and each is the start of a
    search; the lowest end counts and the others are kept. Where a controller was at work an output error is biased;
    then the structure found here is the start of a prediction-error fit.

    Parameters
    ----------
    records
        Inputs and outputs, of one sample rate.
    order
        Number of states, from 1 to 20.
    inputs, outputs
        Names of the rows of the records.
    delays
        Whether inputs may come late; the delays are estimated as fractions of a sample.
    stable
        Whether modes must decay, as those of records without feedback do.
    hold
        What the inputs do between their samples.
    unknowns
        What is estimated beside the parameters, for each record.
    plan
        Which starts to make.
    solver
        Local solver.

    Raises
    ------
    InsufficientDataError
        The records are too short, or no start has a bounded response.
    UsageError
        The records do not go with the names or with each other.
    """
    require_records(records, inputs=inputs, outputs=outputs, unknowns=unknowns, known=get_args(Unknown))
    plan = replace(plan or StartPlan(), stable=stable)
    starts = _starts(records, order, delays=delays, hold=hold, unknowns=unknowns, plan=plan)
    size = np.hstack([record.outputs for record in records]).std(axis=1)
    size = np.where(size > 0.0, size, 1.0)
    references = _references(starts, outputs, size)
    structure = black_box(order, inputs, outputs, delays=delays, stable=stable, references=references)
    sets = list(_sets(starts, structure, delays=delays))
    if not sets:
        raise InsufficientDataError(
            f"no start of order {order} can be written in sections", remedy="take another order"
        )
    problem = TimeProblem(structure=structure, parameters=sets[0], records=tuple(records), hold=hold, unknowns=unknowns)
    fit = fit_output_error(problem, starts=[one.pack() for one in sets], solver=solver or _SEARCH)
    return BlackBoxFit(
        structure=structure,
        fit=fit,
        singular_values=next((one.singular_values for one in starts if one.singular_values.size), np.zeros(0)),
        findings=_remarks(starts, structure.name),
    )


def fit_black_box_pairs(
    records: Sequence[TimeData],
    order: int,
    *,
    pairs: Sequence[tuple[str, str]],
    delays: bool = False,
    stable: bool = True,
    hold: Hold = "zero",
    unknowns: tuple[Unknown, ...] = ("initial_state", "output_shift"),
    plan: StartPlan | None = None,
    solver: LevenbergMarquardt | None = None,
) -> BlackBoxFit:
    """Fit black boxes of one order side by side, each from one input to one output.

    Each pair is fitted alone, then all together, with the correlation of their errors.

    Parameters
    ----------
    records
        Rows of the inputs and of the outputs in the order of the pairs.
    order
        Number of states of each pair.
    pairs
        Input and output of each pair.
    delays, stable, hold, unknowns, plan, solver
        As for :func:`fit_black_box`.

    Raises
    ------
    InsufficientDataError, UsageError
        As for :func:`fit_black_box`.
    """
    structure = black_box_pairs(order, pairs, delays=delays, stable=stable)
    require_records(
        records, inputs=structure.inputs, outputs=structure.outputs, unknowns=unknowns, known=get_args(Unknown)
    )
    alone = [
        fit_black_box(
            [_row(record, number) for record in records],
            order,
            inputs=[u],
            outputs=[y],
            delays=delays,
            stable=stable,
            hold=hold,
            unknowns=unknowns,
            plan=plan,
            solver=solver,
        )
        for number, (u, y) in enumerate(pairs)
    ]
    values = {
        f"{name}_{y}": value
        for (_, y), one in zip(pairs, alone, strict=True)
        for name, value in one.parameters.values.items()
    }
    problem = TimeProblem(
        structure=structure,
        parameters=structure.parameters.with_values(values),
        records=tuple(records),
        hold=hold,
        unknowns=unknowns,
    )
    return BlackBoxFit(
        structure=structure,
        fit=fit_output_error(problem, solver=solver or _SEARCH),
        singular_values=np.sort(np.concatenate([one.singular_values for one in alone]))[::-1],
        findings=tuple(finding for one in alone for finding in one.findings),
    )


def _row(record: TimeData, number: int) -> TimeData:
    row = slice(number, number + 1)
    return replace(record, inputs=record.inputs[row], outputs=record.outputs[row], before=record.before[row])


def _starts(
    records: Sequence[TimeData],
    order: int,
    *,
    delays: bool,
    hold: Hold,
    unknowns: tuple[Unknown, ...],
    plan: StartPlan,
) -> tuple[Start, ...]:
    if delays and plan.delay_samples == (0,):
        plan = replace(plan, delay_samples=_DELAY_SAMPLES)
    if {"output_shift", "state_bias"} & set(unknowns):
        records = [_centered(record) for record in records]
    return black_box_starts(records, order, plan, hold=hold)


def _centered(record: TimeData) -> TimeData:
    mean = record.inputs.mean(axis=1)
    return replace(
        record,
        inputs=record.inputs - mean[:, None],
        outputs=record.outputs - record.outputs.mean(axis=1, keepdims=True),
        before=record.before - mean,
    )


def _references(starts: Sequence[Start], outputs: Sequence[str], size: FloatArray) -> tuple[str, ...]:
    """The outputs that see the sections best, in the first start that can be split."""
    for start in starts:
        try:
            return best_references(start.A, start.C / size[:, None], outputs)
        except ModelError:
            continue
    return ()


def _sets(starts: Sequence[Start], structure: LinearStructure, *, delays: bool) -> list[ParameterSet]:
    """Parameters of the starts that sections can hold."""
    found = []
    late = ["tau" if len(structure.inputs) == 1 else f"tau_{u}" for u in structure.inputs]
    for start in starts:
        try:
            parameters = from_state_space(start.A, start.B, start.C, structure)
        except ModelError:
            # Modes that coincide or are hidden: another start has them apart.
            continue
        if delays:
            parameters = parameters.with_values(dict(zip(late, start.delays_s.tolist(), strict=True)))
        found.append(parameters)
    return found


def _remarks(starts: Sequence[Start], name: str) -> tuple[Finding, ...]:
    remarks = []
    subspaces = [start for start in starts if start.singular_values.size]
    lost = [start for start in subspaces if start.replaced]
    if subspaces and len(lost) == len(subspaces):
        remarks.append(
            Finding(
                kind="order_too_high",
                severity="warning",
                where=name,
                message="Every subspace of this order has a mode that changes its sign with each sample: "
                "it describes noise, or a delay that the model has no parameter for.",
                numbers={"starts": float(len(subspaces)), "replaced": float(min(one.replaced for one in lost))},
            )
        )
    return tuple(remarks)
