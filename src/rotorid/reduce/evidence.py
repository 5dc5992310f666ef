"""What speaks against a parameter of a fit: CIFER's percents, its standard deviation, its partner."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from rotorid.fit.problem import FrequencyProblem
from rotorid.fit.solution import Solution
from rotorid.typing import FloatArray
from rotorid.uncertainty.bounds import (
    CRAMER_RAO_GUIDELINE_PERCENT,
    INSENSITIVITY_GUIDELINE_PERCENT,
    bounds,
)


@dataclass(frozen=True, kw_only=True, slots=True)
class Evidence:
    """How well the data show one free parameter.

    Parameters
    ----------
    name, unit, value
        The parameter as identified.
    std
        Honest standard deviation; zero where the data state no errors, infinite where the parameter has no effect.
    insensitivity_percent, cramer_rao_percent
        CIFER's bounds in percent of the value, infinite at a value of zero.
    partner
        The parameter whose estimate is most correlated with it, ``None`` for a single parameter.
    """

    name: str
    unit: str
    value: float
    std: float
    insensitivity_percent: float
    cramer_rao_percent: float
    partner: str | None

    @property
    def insensitive(self) -> bool:
        """The cost hardly depends on it."""
        return self.insensitivity_percent > INSENSITIVITY_GUIDELINE_PERCENT

    @property
    def uncertain(self) -> bool:
        """It is not determined apart from the others."""
        return self.cramer_rao_percent > CRAMER_RAO_GUIDELINE_PERCENT


def gather_evidence(problem: FrequencyProblem, solution: Solution) -> tuple[Evidence, ...]:
    """Evidence on every free parameter, or on those alone that change nothing in the fitted responses.

    As long as a parameter without any effect is free, the others have no bounds.
    """
    free = problem.parameters.free
    values = dict(zip(free, map(float, solution.theta), strict=True))
    units = {name: problem.parameters[name].unit for name in free}
    silent = [name for name, column in zip(free, solution.jacobian.T, strict=True) if not column.any()]
    if silent:
        return tuple(
            Evidence(
                name=name,
                unit=units[name],
                value=values[name],
                std=np.inf,
                insensitivity_percent=np.inf,
                cramer_rao_percent=np.inf,
                partner=None,
            )
            for name in silent
        )
    limits = bounds(problem, solution)
    partners = _partners(solution.jacobian)
    return tuple(
        Evidence(
            name=name,
            unit=units[name],
            value=values[name],
            std=float(limits.std[i]),
            insensitivity_percent=_percent(limits.insensitivity[i], values[name]),
            cramer_rao_percent=_percent(limits.cramer_rao[i], values[name]),
            partner=free[partners[i]] if len(free) > 1 else None,
        )
        for i, name in enumerate(free)
    )


def worst(evidence: Collection[Evidence]) -> Evidence | None:
    """The parameter to look at next: the most insensitive, else the most uncertain; ``None`` if all are good."""
    if insensitive := [item for item in evidence if item.insensitive]:
        return max(insensitive, key=lambda item: (item.insensitivity_percent, item.cramer_rao_percent))
    return max((item for item in evidence if item.uncertain), key=lambda item: item.cramer_rao_percent, default=None)


def _percent(bound: float, value: float) -> float:
    return float(100.0 * bound / abs(value)) if value else np.inf


def _partners(jacobian: FloatArray) -> list[int]:
    """Index of the most correlated other parameter, from the curvature of the cost as the Cramér–Rao bound is."""
    unit = jacobian / np.sqrt(np.sum(jacobian**2, axis=0))
    _, singular, right = np.linalg.svd(unit, full_matrices=False)
    root = right.T / np.maximum(singular, np.finfo(float).eps * singular.max(initial=0.0))
    root /= np.sqrt(np.sum(root**2, axis=1, keepdims=True))
    correlation = np.abs(root @ root.T)
    np.fill_diagonal(correlation, -1.0)
    return [int(index) for index in np.argmax(correlation, axis=1)]
