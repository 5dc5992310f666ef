r"""Consistency of logs of one vehicle, and the scatter between them that intervals have to cover.

A fit of several logs together weighs them by their errors, and its interval shrinks as if they agreed. Whether they do
is seen where each is fitted alone. With values :math:`v_i` and stated deviations :math:`s_i`,

.. math:: Q = \sum_i \frac{(v_i - \bar v)^2}{s_i^2}, \qquad \bar v = \frac{\sum_i v_i / s_i^2}{\sum_i 1 / s_i^2}

is distributed as :math:`\chi^2` with one degree of freedom less than logs, if only stated errors make them differ.
Where it is beyond that, the vehicle was another one, or something acts on it that the model does not have, and another
log would scatter as these do: by the variance between logs

.. math:: \tau^2 = \frac{Q - (n - 1)}{\sum w_i - \sum w_i^2 / \sum w_i}, \qquad w_i = 1 / s_i^2

which the interval of what they say together then holds (DerSimonian and Laird, *Meta-analysis in clinical trials*,
Controlled Clinical Trials 7(3), 1986). Any method can ask: it fits each log, and gives values and deviations.

Maneuvers of one log in which inputs and outputs swing differently far show more; where only one of both does, the
vehicle was another one. What the structure leaves out is nearly the same in all of them and cancels, so that they may
differ by their random errors and by the 0.5 % that no instrument is better than. Drag that grows with the square of
speed differs by more: to a sine it is a slope in proportion to the swing :math:`A_i` of the outputs, and leaves no
residual. So a line :math:`v_i = v_0 + b A_i` is laid through the values; where :math:`b` is certain, the interval
reaches as far as :math:`v_0`, the slope of small motions, on either side. Lags and delays are no slopes, and follow
what bends: they are left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, warn
from rotorid.data.quantity import with_error
from rotorid.uncertainty.cramer_rao import Bounds
from rotorid.uncertainty.differences import homogeneity, scatter_between
from rotorid.uncertainty.model_error import SMALLEST_MODEL_ERROR

_CHANCE = 0.01
"""Probability of a false alarm about one parameter, for a vehicle that is the same in all logs."""

_LEAST_RATIO = 1.3
"""Of swings, below which a difference between them is meaningless."""


@dataclass(frozen=True, kw_only=True)
class LogEstimate(Immutable):
    """The estimate of one log.

    Parameters
    ----------
    record
        Name of the log.
    values
        Parameter to its value.
    stds
        To its stated deviation, random and model errors together; what has none is not compared.
    random
        To its random deviation, where swings are to be compared.
    missing
        Parameter without a value of this log alone, to the reason.
    asked, moved
        How far inputs and outputs moved, as root mean squares that can be compared with those of others; zero where
        unknown.
    """

    record: str
    values: Mapping[str, float]
    stds: Mapping[str, float]
    random: Mapping[str, float] = field(default_factory=dict)
    missing: Mapping[str, str] = field(default_factory=dict)
    asked: float = 0.0
    moved: float = 0.0

    def __post_init__(self) -> None:
        self._set(values=self.values, stds=self.stds, random=self.random, missing=self.missing)


def name_of_stretch(record: str, start_s: float) -> str:
    """What a stretch of a log is called in its estimate.

    Examples
    --------
    >>> name_of_stretch("flight.csv", 66.04)
    'flight.csv at 66.0 s'
    """
    return f"{record} at {start_s:.1f} s"


@dataclass(frozen=True, kw_only=True)
class Disagreement(Immutable):
    """A parameter about which logs disagree.

    Parameters
    ----------
    parameter
        Its name.
    estimates
        Log to its value and deviation.
    chance
        Of such a scatter, were all logs right about their errors.
    scatter
        Standard deviation between logs, beyond their own errors.
    """

    parameter: str
    estimates: Mapping[str, tuple[float, float]]
    chance: float
    scatter: float

    def __post_init__(self) -> None:
        self._set(estimates=self.estimates)

    def finding(self, unit: str) -> Finding:
        """The finding on it."""
        words = ", ".join(f"{with_error(value, std)} in {name}" for name, (value, std) in self.estimates.items())
        several = len({name.rsplit(" at ", 1)[0] for name in self.estimates}) > 1
        parts, remedy = ("logs", "log separately") if several else ("maneuvers", "maneuver with --segment")
        return warn(
            "logs_disagree",
            self.parameter,
            f"The {parts} disagree about {self.parameter}{f' in {unit}' if unit not in ('', '1') else ''}: {words}. "
            "They differ by more than their errors: battery, load or air changed, or the model lacks something "
            f"that moved the vehicle in one of them. The interval covers them all; identify each {remedy} "
            "to see which differs.",
            scatter=self.scatter,
            chance=self.chance,
        )


def disagreements(estimates: Sequence[LogEstimate]) -> tuple[Disagreement, ...]:
    """Parameters that several logs know, and disagree about beyond their errors.

    Parameters
    ----------
    estimates
        Each log by itself.

    Examples
    --------
    >>> logs = [LogEstimate(record="a", values={"N": 498.0}, stds={"N": 20.0}),
    ...         LogEstimate(record="b", values={"N": 308.0}, stds={"N": 6.0})]
    >>> (found,) = disagreements(logs)
    >>> found.parameter, round(found.scatter)
    ('N', 134)
    >>> disagreements([logs[0]])
    ()
    """
    names = dict.fromkeys(name for log in estimates for name in log.stds)
    found = (_compared(name, [log for log in estimates if log.stds.get(name, 0.0) > 0.0]) for name in names)
    return tuple(disagreement for disagreement in found if disagreement is not None)


def _compared(name: str, logs: Sequence[LogEstimate]) -> Disagreement | None:
    if len(logs) < 2:
        return None
    values, stds = (np.array([getattr(log, part)[name] for log in logs]) for part in ("values", "stds"))
    _, chance = homogeneity(values, stds)
    if not chance < _CHANCE:
        return None
    estimates = {log.record: (log.values[name], log.stds[name]) for log in logs}
    return Disagreement(parameter=name, estimates=estimates, chance=chance, scatter=scatter_between(values, stds))


@dataclass(frozen=True, kw_only=True)
class AmplitudeDependence(Immutable):
    """A parameter that is another one the farther inputs and outputs swing.

    Parameters
    ----------
    parameter
        Its name.
    estimates
        Maneuver to value, deviation, and swing of the outputs as a multiple of the smallest; the smallest first.
    at_rest
        Where a line through the values ends at no swing.
    sigmas
        How many deviations the slope of that line lies from zero.
    """

    parameter: str
    estimates: Mapping[str, tuple[float, float, float]]
    at_rest: float
    sigmas: float

    def __post_init__(self) -> None:
        self._set(estimates=self.estimates)

    def finding(self, unit: str) -> Finding:
        """The finding on it."""
        words = ", ".join(
            f"{with_error(value, std)} in {name}" + (f" ({swing:.2g} times the amplitude)" if swing > 1.0 else "")
            for name, (value, std, swing) in self.estimates.items()
        )
        return warn(
            "amplitude_dependent",
            self.parameter,
            f"{self.parameter} depends on the amplitude{f', in {unit}' if unit not in ('', '1') else ''}: "
            f"{words}. Drag that grows faster than speed does this, and so does a falling battery voltage. "
            f"Extrapolated to small motions it is {self.at_rest:.4g}, which the interval covers.",
            at_rest=self.at_rest,
            distance_std=self.sigmas,
        )


def amplitude_dependences(estimates: Sequence[LogEstimate]) -> tuple[AmplitudeDependence, ...]:
    """Parameters that maneuvers of one log know, and that change with their swing.

    Parameters
    ----------
    estimates
        Each maneuver by itself, with random deviations and swings; those without are not compared.

    Examples
    --------
    >>> def sweep(Z_w, swing):
    ...     said = {"values": {"Z_w": Z_w}, "stds": {"Z_w": 0.01}, "random": {"Z_w": 0.004}}
    ...     return LogEstimate(record=f"{swing}", **said, asked=swing, moved=swing)
    >>> (found,) = amplitude_dependences([sweep(-0.281, 0.034), sweep(-0.300, 0.055)])
    >>> found.parameter, round(found.at_rest, 2)
    ('Z_w', -0.25)
    """
    by_swing = sorted(
        (estimate for estimate in estimates if min(estimate.asked, estimate.moved) > 0.0),
        key=lambda estimate: estimate.moved,
    )
    names = dict.fromkeys(name for estimate in by_swing for name in estimate.random)
    found = (
        _along_swing(name, [estimate for estimate in by_swing if estimate.random.get(name, 0.0) > 0.0])
        for name in names
    )
    return tuple(dependence for dependence in found if dependence is not None)


def _unlike(by_swing: Sequence[LogEstimate]) -> bool:
    """Whether the last of maneuvers swung farther than the first, as it was asked to."""
    return len(by_swing) > 1 and all(
        last >= _LEAST_RATIO * first
        for first, last in ((by_swing[0].asked, by_swing[-1].asked), (by_swing[0].moved, by_swing[-1].moved))
    )


def _along_swing(name: str, by_swing: Sequence[LogEstimate]) -> AmplitudeDependence | None:
    from scipy.stats import norm

    if not _unlike(by_swing):
        return None
    swings, values = (
        np.array([estimate.moved for estimate in by_swing]),
        np.array([estimate.values[name] for estimate in by_swing]),
    )
    stds = np.hypot([estimate.random[name] for estimate in by_swing], SMALLEST_MODEL_ERROR * np.abs(values))
    line = np.column_stack([np.ones(swings.size), swings]) / stds[:, None]
    covariance = np.linalg.inv(line.T @ line)
    at_rest, slope = covariance @ line.T @ (values / stds)
    sigmas = abs(float(slope)) / float(np.sqrt(covariance[1, 1]))
    if not 2.0 * norm.sf(sigmas) < _CHANCE:
        return None
    estimates = {
        estimate.record: (estimate.values[name], estimate.stds[name], estimate.moved / by_swing[0].moved)
        for estimate in by_swing
    }
    return AmplitudeDependence(parameter=name, estimates=estimates, at_rest=float(at_rest), sigmas=sigmas)


def with_scatter(bounds: Bounds, disagreeing: Sequence[Disagreement]) -> Bounds:
    """Bounds of random errors, with the scatter of records that disagree.

    The model error in time judges the same misfit by other counterparts, of which the largest counts: it comes after.
    """
    return widened(bounds, {disagreement.parameter: disagreement.scatter for disagreement in disagreeing})


def widened(bounds: Bounds, added: Mapping[str, float]) -> Bounds:
    """Bounds of parts together, with what each parameter's deviation gains by how the parts differ."""
    extra = np.array([added.get(name, 0.0) ** 2 for name in bounds.names])
    return replace(bounds, covariance=bounds.covariance + np.diag(extra))
