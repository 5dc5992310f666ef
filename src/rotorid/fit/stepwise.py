"""Stepwise regression: which of many candidate terms a model needs, one step after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from rotorid.data.immutable import Immutable
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fit.regression import CONSTANT, Regression, regress
from rotorid.typing import FloatArray

Action: TypeAlias = Literal["start", "enter", "remove"]

F_TO_ENTER = 4.0
"""Partial F that a candidate must reach: two standard errors of white residuals."""

F_TO_REMOVE = 4.0
"""Partial F below which a term is taken out again; equal to that of entering at most, or steps would go in circles."""

_MOST_STEPS_PER_CANDIDATE = 4


@dataclass(frozen=True, kw_only=True)
class RegressionStep(Immutable):
    """One step of the search and what it left.

    Parameters
    ----------
    action, name
        What was done to which term.
    partial_f
        Partial F of that term: on entering in the model with it, on removal in the model before.
    names
        Terms of the model after the step.
    r_squared, press
        Of that model.
    """

    action: Action
    name: str
    partial_f: float
    names: tuple[str, ...]
    r_squared: float
    press: float


@dataclass(frozen=True, kw_only=True, eq=False)
class StepwiseRegression(Immutable):
    """The model that was chosen, and the way there.

    Parameters
    ----------
    regression
        The model of least PRESS on the way.
    steps
        All steps in order.
    chosen
        Index of the step after which that model stood.
    """

    regression: Regression
    steps: tuple[RegressionStep, ...]
    chosen: int


def stepwise(
    regressors: FloatArray,
    target: FloatArray,
    names: Sequence[str],
    *,
    keep: Sequence[str] = (),
    constant: bool = True,
    ordered: bool = True,
    f_to_enter: float = F_TO_ENTER,
    f_to_remove: float = F_TO_REMOVE,
) -> StepwiseRegression:
    r"""Enter and remove terms by their partial F; the model of least PRESS is the answer.

    In each step the candidate enters that correlates best with what is left, if its partial F reaches the limit; then
    every term whose partial F has fallen below the limit leaves, the weakest first. Models that stand after that count.

    .. math:: F_j = (SSE_{-j} - SSE_{+j}) / s_{+j}^2

    F values take residuals as white. Colored residuals make them too large, and noise in regressors lets terms enter
    that stand for others; PRESS guards against the first and not against the second.

    Parameters
    ----------
    regressors, target, names
        Candidates, shape ``(n, p)``, what they are to explain, shape ``(n,)``, and their names.
    keep
        Candidates that stand from the start and never leave.
    constant, ordered
        As in :func:`rotorid.fit.regression.regress`.
    f_to_enter, f_to_remove
        Limits of the partial F.

    Raises
    ------
    UsageError
        A name is unknown, or the limit of entering lies below that of removal.
    InsufficientDataError
        No term reaches the limit and nothing stands from the start.

    References
    ----------
    V. Klein and E. A. Morelli, *Aircraft System Identification: Theory and Practice*, AIAA 2006, section 5.4.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(1)
    >>> x = rng.normal(size=(200, 4))
    >>> found = stepwise(x, 2.0 * x[:, 2] - x[:, 0] + 0.1 * rng.normal(size=200), ["a", "b", "c", "d"])
    >>> [(step.action, step.name) for step in found.steps[: found.chosen + 1]]
    [('start', ''), ('enter', 'c'), ('enter', 'a')]
    """
    if f_to_enter < f_to_remove:
        raise UsageError(
            f"F to enter {f_to_enter:g} and F to remove {f_to_remove:g} came", needed="F to enter not below the other"
        )
    columns = {name: np.asarray(regressors, dtype=np.float64)[:, index] for index, name in enumerate(names)}
    if unknown := [name for name in keep if name not in columns]:
        raise UsageError(f"{unknown[0]} is no candidate", needed=f"some of {', '.join(names)}")
    search = _Search(columns, np.asarray(target, dtype=np.float64), constant, ordered)
    terms = tuple(keep)
    met = [search.fit(terms)] if terms or constant else []
    steps = [_step("start", "", np.nan, terms, met[0])] if met else []
    settled = list(range(len(met)))
    for _ in range(_MOST_STEPS_PER_CANDIDATE * len(columns)):
        entering = search.best_entry(terms, met[-1] if met else None)
        if entering is None or entering[1] < f_to_enter:
            break
        name, strength, model = entering
        terms = (*terms, name)
        met.append(model)
        steps.append(_step("enter", name, strength, terms, model))
        while (weakest := _weakest(met[-1], keep)) is not None and weakest[1] < f_to_remove:
            terms = tuple(term for term in terms if term != weakest[0])
            met.append(search.fit(terms))
            steps.append(_step("remove", *weakest, terms, met[-1]))
        settled.append(len(met) - 1)
    if not met:
        raise InsufficientDataError(
            f"none of {', '.join(names)} reaches a partial F of {f_to_enter:g}",
            needed="a candidate that explains the target",
            remedy="lower the limit, or offer other candidates",
        )
    chosen = min(settled, key=lambda index: met[index].press)
    return StepwiseRegression(regression=met[chosen], steps=tuple(steps), chosen=chosen)


@dataclass(frozen=True)
class _Search:
    columns: dict[str, FloatArray]
    target: FloatArray
    constant: bool
    ordered: bool

    def fit(self, terms: tuple[str, ...]) -> Regression:
        matrix = np.stack([self.columns[name] for name in terms], axis=1) if terms else np.empty((self.target.size, 0))
        return regress(matrix, self.target, terms, constant=self.constant, ordered=self.ordered)

    def best_entry(self, terms: tuple[str, ...], present: Regression | None) -> tuple[str, float, Regression] | None:
        """The candidate that correlates best with what is left, its partial F, and the model with it."""
        left = self.target if present is None else present.residual
        others = {name: self._remainder(name, terms) for name in self.columns if name not in terms}
        usable = {name: column for name, column in others.items() if column is not None}
        if not usable or self.target.size <= len(terms) + 1 + self.constant:
            return None
        name = max(usable, key=lambda one: abs(float(usable[one] @ left)))
        model = self.fit((*terms, name))
        return name, float(model.partial_f[model.names.index(name)]), model

    def _remainder(self, name: str, terms: tuple[str, ...]) -> FloatArray | None:
        """What a candidate has that the terms do not, with unit length; ``None`` where that is nothing."""
        basis = [self.columns[term] for term in terms] + ([np.ones(self.target.size)] if self.constant else [])
        column, length = self.columns[name], float(np.linalg.norm(self.columns[name]))
        if basis:
            Q = np.linalg.qr(np.stack(basis, axis=1))[0]
            column = column - Q @ (Q.T @ column)
        rest = float(np.linalg.norm(column))
        return column / rest if rest > _SAME * length else None


_SAME = 1e-8


def _weakest(model: Regression, keep: Sequence[str]) -> tuple[str, float] | None:
    strengths = dict(zip(model.names, model.partial_f.tolist(), strict=True))
    free = [name for name in model.names if name not in keep and name != CONSTANT]
    if len(free) < 2:
        return None
    name = min(free, key=lambda one: strengths[one])
    return name, strengths[name]


def _step(action: Action, name: str, strength: float, terms: tuple[str, ...], model: Regression) -> RegressionStep:
    return RegressionStep(
        action=action,
        name=name,
        partial_f=strength,
        names=terms,
        r_squared=model.r_squared,
        press=model.press,
    )
