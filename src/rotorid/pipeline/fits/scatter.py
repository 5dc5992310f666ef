r"""Logs of one vehicle against each other: whether each alone says the same, and what their scatter adds to intervals.

A fit of several logs together weighs them by their errors, and its interval shrinks as if they agreed. Whether they do
is seen where each is fitted alone. With values :math:`v_i` and stated deviations :math:`s_i`,

.. math:: Q = \sum_i \frac{(v_i - \bar v)^2}{s_i^2}, \qquad \bar v = \frac{\sum_i v_i / s_i^2}{\sum_i 1 / s_i^2}

is distributed as :math:`\chi^2` with one degree of freedom less than logs, if only stated errors make them differ.
Where it is beyond that, the vehicle was another one, or something acts on it that the model does not have, and another
log would scatter as these do: by the variance between logs

.. math:: \tau^2 = \frac{Q - (n - 1)}{\sum w_i - \sum w_i^2 / \sum w_i}, \qquad w_i = 1 / s_i^2

which the interval of what they say together then holds (DerSimonian and Laird, *Meta-analysis in clinical trials*,
Controlled Clinical Trials 7(3), 1986). Any method can ask: it fits each log, and gives values and deviations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, warn
from rotorid.uncertainty.cramer_rao import Bounds

_CHANCE = 0.01
"""Of a vehicle that is the same in all logs, to be told otherwise about one parameter."""

_TWO_SIDED = 1.96


@dataclass(frozen=True, kw_only=True)
class Alone(Immutable):
    """What one log says by itself.

    Parameters
    ----------
    record
        Name of the log.
    values
        Parameter to its value.
    stds
        To its stated deviation, random and model errors together; what has none is not compared.
    """

    record: str
    values: Mapping[str, float]
    stds: Mapping[str, float]

    def __post_init__(self) -> None:
        self._set(values=self.values, stds=self.stds)


@dataclass(frozen=True, kw_only=True)
class Disagreement(Immutable):
    """A parameter of which logs say different things.

    Parameters
    ----------
    parameter
        Its name.
    said
        Log to its value and deviation.
    chance
        Of such a scatter, were all logs right about their errors.
    scatter
        Standard deviation between logs, beyond their own errors.
    """

    parameter: str
    said: Mapping[str, tuple[float, float]]
    chance: float
    scatter: float

    def __post_init__(self) -> None:
        self._set(said=self.said)

    def finding(self, unit: str) -> Finding:
        """What a careful engineer would remark."""
        words = ", ".join(f"{value:.4g} ± {_TWO_SIDED * std:.2g} in {name}" for name, (value, std) in self.said.items())
        return warn(
            "logs_disagree",
            self.parameter,
            f"Each log alone says another {self.parameter}{f' in {unit}' if unit not in ('', '1') else ''}: {words}. "
            "They differ by more than their errors: battery, load or air were others, or the model lacks what moved "
            "the vehicle in one of them. The interval holds their scatter; identify them apart to see which.",
            scatter=self.scatter,
            chance=self.chance,
        )


def disagreements(alone: Sequence[Alone]) -> tuple[Disagreement, ...]:
    """Parameters that several logs know, and disagree about beyond their errors.

    Parameters
    ----------
    alone
        Each log by itself.

    Examples
    --------
    >>> logs = [Alone(record="a", values={"N": 498.0}, stds={"N": 20.0}),
    ...         Alone(record="b", values={"N": 308.0}, stds={"N": 6.0})]
    >>> (found,) = disagreements(logs)
    >>> found.parameter, round(found.scatter)
    ('N', 134)
    >>> disagreements([logs[0]])
    ()
    """
    names = dict.fromkeys(name for log in alone for name in log.stds)
    found = (_compared(name, [log for log in alone if log.stds.get(name, 0.0) > 0.0]) for name in names)
    return tuple(one for one in found if one is not None)


def _compared(name: str, logs: Sequence[Alone]) -> Disagreement | None:
    from scipy.stats import chi2

    if len(logs) < 2:
        return None
    values, stds = (np.array([getattr(log, part)[name] for log in logs]) for part in ("values", "stds"))
    weights = stds**-2.0
    mean = float(np.sum(weights * values) / np.sum(weights))
    Q, free = float(np.sum(weights * (values - mean) ** 2)), len(logs) - 1
    chance = float(chi2.sf(Q, free))
    if not chance < _CHANCE:
        return None
    between = (Q - free) / float(np.sum(weights) - np.sum(weights**2) / np.sum(weights))
    said = {log.record: (log.values[name], log.stds[name]) for log in logs}
    return Disagreement(parameter=name, said=said, chance=chance, scatter=float(np.sqrt(max(between, 0.0))))


def widened(bounds: Bounds, found: Sequence[Disagreement]) -> Bounds:
    """Bounds of logs together, that hold how they scatter."""
    scatter = {one.parameter: one.scatter for one in found}
    extra = np.array([scatter.get(name, 0.0) ** 2 for name in bounds.names])
    return replace(bounds, covariance=bounds.covariance + np.diag(extra))
