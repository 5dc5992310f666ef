r"""Linear models of one vehicle as one: longitudinal and lateral motion side by side, with one covariance.

.. math:: M = \mathrm{diag}(M_1, M_2), \quad F = \mathrm{diag}(F_1, F_2), \quad \dots, \qquad
    \mathrm{Cov}\,\theta = \mathrm{diag}(\mathrm{Cov}\,\theta_1, \mathrm{Cov}\,\theta_2)

The parts do not couple: what a pitch command does to the roll rate is in neither. Their parameters were fitted to other
outputs, so their errors are taken as independent; gusts of one flight that move both halves are the exception.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain
from typing import TypeVar

import numpy as np

from rotorid.data.findings import Finding, remark
from rotorid.errors import UsageError
from rotorid.models.expression import Expression
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.results.model import (
    FittedData,
    IdentifiedModel,
    as_models,
    bounds_of,
    no_response,
    parameter_estimates,
    pole_estimates,
)
from rotorid.results.summary import Cost
from rotorid.typing import FloatArray
from rotorid.uncertainty.cramer_rao import Bounds, colored_of
from rotorid.uncertainty.propagation import pole_confidence

Value = TypeVar("Value")

JOINED = "hover.joined"
"""Name of what ``hover.longitudinal`` and ``hover.lateral`` give together."""

HALVES: tuple[str, str] = ("hover.longitudinal", "hover.lateral")


def joined_halves(models: Sequence[IdentifiedModel]) -> IdentifiedModel | None:
    """The model of both halves of the motion, where there is one of each; ``None`` elsewhere.

    Parameters
    ----------
    models
        Of one vehicle.
    """
    found = [[model for model in models if model.name == name] for name in HALVES]
    return joined_model([model for (model,) in found]) if all(len(models) == 1 for models in found) else None


def joined_model(models: Sequence[IdentifiedModel], *, name: str = JOINED) -> IdentifiedModel:
    """Several linear models of one vehicle as one, block by block.

    Parameters that several of them have, such as ``T_motor``, keep the name of their model behind their own, and so do
    states and constants that differ.

    Parameters
    ----------
    models
        Identified from logs of one vehicle, of different inputs and outputs: ``hover.longitudinal`` and
        ``hover.lateral``.
    name
        Of the whole.

    Returns
    -------
    IdentifiedModel
        It answers, simulates, exports and saves itself as the others. Costs and delays are those of its parts; the
        measured responses stay with them.

    Raises
    ------
    UsageError
        Fewer than two came, one is of ``physical.motors``, or two have an input or an output in common.

    Examples
    --------
    >>> whole = joined_model([longitudinal, lateral])  # doctest: +SKIP
    >>> whole.structure.states  # doctest: +SKIP
    ('q', 'u', 'w', 'theta', 'p', 'r', 'v', 'phi')
    """
    _require_separate(models)
    parts = [_renamed(model, names) for model, names in zip(models, _new_names(models), strict=True)]
    structures = [structure for structure, _ in parts]
    whole = _side_by_side(structures, name)
    bounds = _bounds([bounds for _, bounds in parts], whole.parameters.free)
    pairs = {pair: cost for model in models if model.fit.cost for pair, cost in model.fit.cost.pairs.items()}
    first = models[0]
    return replace(
        first,
        structure=whole,
        parameters=parameter_estimates(whole.parameters, bounds),
        bounds=bounds,
        fit=replace(
            first.fit,
            outputs=whole.outputs,
            cost=Cost(average=float(np.mean([pair.value for pair in pairs.values()])), pairs=pairs) if pairs else None,
            fit_percent=_merged([model.fit.fit_percent or {} for model in models]) or None,
            noise=_merged([model.fit.noise or {} for model in models]) or None,
            records=(),
            log_likelihood=None,
            information=None,
            residuals=None,
            minima=(),
            search=None,
            bootstrap=None,
            equations=(),
            frequency_fit=None,
            reduction=(),
        ),
        data=FittedData(
            response=no_response(whole),
            direct=None,
            model_response=np.zeros((len(whole.outputs), len(whole.inputs), 0), dtype=np.complex128),
            used=np.zeros((len(whole.outputs), len(whole.inputs), 0), dtype=np.bool_),
            least_coherence=first.data.least_coherence,
        ),
        provenance=replace(
            first.provenance,
            inputs=_merged([model.provenance.inputs for model in models]),
            sources=_merged([model.provenance.sources for model in models]),
            maneuvers=tuple(dict.fromkeys(chain.from_iterable(model.provenance.maneuvers for model in models))),
        ),
        verification=type(first.verification)(),
        verifications=type(first.verifications)(),
        pole_estimates=pole_estimates(pole_confidence(whole, whole.parameters, bounds)),
        delays=_merged([model.delays for model in models]),
        covered=_merged([model.covered for model in models]),
        combinations=(),
        cross_validation=None,
        findings=(_joined_remark(models, name),),
    )


def _require_separate(models: Sequence[IdentifiedModel]) -> None:
    as_models(models)
    if len(models) < 2:
        raise UsageError(
            f"only {len(models)} model to join", needed="two or more, such as hover.longitudinal and hover.lateral"
        )
    for model in models:
        if model.motors is not None:
            raise UsageError(f"{model.name} is not linear and cannot be joined", needed="linear models")
    for kind in ("inputs", "outputs"):
        counts = Counter(chain.from_iterable(getattr(model.structure, kind) for model in models))
        if shared := [name for name, count in counts.items() if count > 1]:
            names = " and ".join(model.name for model in models)
            raise UsageError(
                f"{names} both have {', '.join(shared)}", needed=f"models of different {kind}", remedy="leave one out"
            )


def _new_names(models: Sequence[IdentifiedModel]) -> list[dict[str, str]]:
    """For each model its parameters, states and constants that another has too, with their new names."""
    structures = [model.structure for model in models]
    states = Counter(chain.from_iterable(structure.states for structure in structures))
    parameters = Counter(chain.from_iterable(structure.parameters.names for structure in structures))
    constants: dict[str, set[float]] = {}
    for structure in structures:
        for name, value in structure.constants.items():
            constants.setdefault(name, set()).add(value)
    found = []
    for structure in structures:
        own = structure.name.rpartition(".")[2]
        shared = [
            name for name in (*structure.states, *structure.parameters.names) if states[name] + parameters[name] > 1
        ]
        shared += [name for name in structure.constants if len(constants[name]) > 1]
        found.append({name: f"{name}_{own}" for name in shared})
    return found


def _renamed(model: IdentifiedModel, names: Mapping[str, str]) -> tuple[LinearStructure, Bounds]:
    """A structure and its bounds with other names of parameters, states and constants."""
    structure = model.structure
    own = bounds_of(model.bounds, structure.parameters.free)
    if not names:
        return structure, own
    symbols = {old: Expression.symbol(new) for old, new in names.items()}

    def entry(expression: Expression) -> Expression:
        return expression.substitute(symbols)

    def rows(matrix: Sequence[Sequence[Expression]]) -> tuple[tuple[Expression, ...], ...]:
        return tuple(tuple(entry(expression) for expression in row) for row in matrix)

    def parameter(parameter: Parameter) -> Parameter:
        return replace(
            parameter,
            name=names.get(parameter.name, parameter.name),
            tied=None if parameter.tied is None else entry(parameter.tied),
        )

    constants = {names.get(name, name): value for name, value in structure.constants.items()}
    changed = replace(
        structure,
        states=tuple(names.get(name, name) for name in structure.states),
        M=rows(structure.M),
        F=rows(structure.F),
        G=rows(structure.G),
        H0=rows(structure.H0),
        H1=rows(structure.H1),
        input_delays=tuple(entry(expression) for expression in structure.input_delays),
        output_delays=tuple(entry(expression) for expression in structure.output_delays),
        parameters=ParameterSet(map(parameter, structure.parameters), constants),
        constants=constants,
        gain=None,
        optional=tuple(names.get(name, name) for name in structure.optional),
    )
    return changed, replace(own, names=tuple(names.get(name, name) for name in own.names))


def _side_by_side(parts: Sequence[LinearStructure], name: str) -> LinearStructure:
    zero = Expression.constant(0.0)

    def blocks(matrix: str) -> tuple[tuple[Expression, ...], ...]:
        own = [getattr(part, matrix) for part in parts]
        columns = "states" if matrix != "G" else "inputs"
        widths = [len(getattr(part, columns)) for part in parts]
        return tuple(
            (zero,) * sum(widths[:place]) + tuple(row) + (zero,) * sum(widths[place + 1 :])
            for place, rows in enumerate(own)
            for row in rows
        )

    constants = _merged([part.constants for part in parts])
    return LinearStructure(
        name=name,
        inputs=tuple(chain.from_iterable(part.inputs for part in parts)),
        states=tuple(chain.from_iterable(part.states for part in parts)),
        outputs=tuple(chain.from_iterable(part.outputs for part in parts)),
        M=blocks("M"),
        F=blocks("F"),
        G=blocks("G"),
        H0=blocks("H0"),
        H1=blocks("H1"),
        input_delays=tuple(chain.from_iterable(part.input_delays for part in parts)),
        output_delays=tuple(chain.from_iterable(part.output_delays for part in parts)),
        parameters=ParameterSet(chain.from_iterable(part.parameters for part in parts), constants),
        constants=constants,
        optional=tuple(chain.from_iterable(part.optional for part in parts)),
        source="; ".join(dict.fromkeys(part.source for part in parts if part.source)),
    )


def _bounds(parts: Sequence[Bounds], names: tuple[str, ...]) -> Bounds:
    from scipy.linalg import block_diag

    together = Bounds(
        names=tuple(chain.from_iterable(part.names for part in parts)),
        cramer_rao=_stacked([part.cramer_rao for part in parts]),
        insensitivity=_stacked([part.insensitivity for part in parts]),
        covariance=block_diag(*(part.covariance for part in parts)),
        random=block_diag(*(part.random for part in parts)),
        colored=colored_of(parts),
    )
    return bounds_of(together, names)


def _stacked(parts: Sequence[FloatArray]) -> FloatArray:
    return np.concatenate(parts)


def _merged(parts: Sequence[Mapping[str, Value]]) -> dict[str, Value]:
    return {name: value for part in parts for name, value in part.items()}


def _joined_remark(models: Sequence[IdentifiedModel], name: str) -> Finding:
    names = " and ".join(model.name for model in models)
    used = [{maneuver.record for maneuver in model.provenance.maneuvers} for model in models]
    shared = sorted(set.intersection(*used))
    same = (
        f" Gusts of {', '.join(shared)} moved both, and the correlation of errors by them is not known."
        if shared
        else ""
    )
    return remark(
        "joined_models",
        name,
        f"{names} were fitted separately: the joined model has no coupling between them, neither in its dynamics nor "
        f"in its covariance.{same}",
    )
