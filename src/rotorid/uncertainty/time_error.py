r"""Model error of fits in time: how far the values lie from those that other data would have given.

Residuals of records in time do not say which part of them is noise. Where the structure is wrong they follow the
inputs, and a covariance that takes them for noise is too small. Its counterparts judge the same misfit by what
repeats:

- :math:`C_{time}`: blocks of 2 s pull the values apart (:func:`rotorid.uncertainty.sandwich.by_blocks`).
- :math:`C_{freq}`: bands of half an octave do, as an input of another spectrum would (:func:`~.sandwich.by_bands`).
- :math:`C_{out}`: so do outputs, where these repeat one experiment, as motors do (:func:`~.sandwich.by_outputs`).
- :math:`C_{rec}`: each of *n* records has values of its own. With their standard deviation *S*,

  .. math:: C_{rec} = \left( \frac{t_{0.975, n-1}}{1.96} \right)^2 \frac{S^2}{n}

For errors that are noise, each expects the random covariance. They see one misfit, so the largest counts:

.. math:: \sigma^2 = \max(C_{rand}, C_{time}, C_{freq}, C_{out}, C_{rec}) + \sum_k d_k^2

with what clocks and scales move, :math:`d_k`, which no residual shows. Records of one plan repeat one misfit and
agree by it: a small *S* makes no interval small. The correlations are those of the random errors.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from rotorid.data.quantity import TWO_SIDED_95
from rotorid.fitting.problem import Part
from rotorid.typing import FloatArray
from rotorid.uncertainty.cramer_rao import Bounds
from rotorid.uncertainty.sandwich import by_bands, by_blocks, by_outputs

FEWEST_RECORDS = 3
"""Below that, Student's factor is so large that the scatter says nothing."""

_INFORMED = 4.0
"""Of the random variance, up to which the mean of the records may lie and they be counted as repetitions."""


class Estimate(Protocol):
    """The estimate of one record."""

    @property
    def values(self) -> Mapping[str, float]:
        """Parameter to its value."""
        ...

    @property
    def stds(self) -> Mapping[str, float]:
        """To its standard deviation; what has none is not compared."""
        ...

    @property
    def random(self) -> Mapping[str, float]:
        """To that of its random errors alone, where known."""
        ...


def with_time_error(
    bounds: Bounds,
    parts: Sequence[Part],
    *,
    alone: Sequence[Estimate] = (),
    alike: bool = False,
    held: Collection[str] = (),
    added: Sequence[Mapping[str, float]] = (),
) -> Bounds:
    """Bounds of a fit in time with its model error.

    Parameters
    ----------
    bounds
        By colored residuals, as :func:`rotorid.uncertainty.cramer_rao.bounds_of_parts` gives them.
    parts
        Whitened residuals and slopes at the solution. Columns beyond the names are those of a noise model.
    alone
        Each record fitted alone.
    alike
        Whether the outputs repeat one experiment.
    held
        Parameters on a bound that the data push against: other data would have left them there, so the others move
        without them, and they keep their bounds.
    added
        For each clock or sensor, how far its error moves parameters, in their units.

    Examples
    --------
    >>> from rotorid.uncertainty.cramer_rao import bounds_of_parts
    >>> rng = np.random.default_rng(0)
    >>> driven = rng.normal(size=4000)
    >>> late = np.convolve(driven, [0.5, 0.5], mode="same")
    >>> left = late - driven * float(late @ driven) / float(driven @ driven)
    >>> part = Part(left[:, None], driven[:, None, None], np.zeros((4000, 1, 0)), sample_rate_hz=50.0)
    >>> bounds = with_time_error(bounds_of_parts([part], ("gain",)), [part])
    >>> bool(bounds.std[0] > 5.0 * bounds.random_std[0])
    True
    """
    moving = np.array([name not in held for name in bounds.names], dtype=np.bool_)
    columns = np.ones(parts[0].slopes.shape[2], dtype=np.bool_)
    columns[: moving.size] = moving
    pulling = [part._replace(slopes=part.slopes[:, :, columns]) for part in parts]
    found = [by_records(bounds, alone)]
    for way in (by_blocks, by_bands, *([by_outputs] if alike else [])):
        pulled = np.zeros(moving.size)
        pulled[moving] = way(pulling).diagonal()[: moving.sum()]
        found.append(pulled)
    return grown(bounds, found, added)


def grown(bounds: Bounds, variances: Sequence[FloatArray], added: Sequence[Mapping[str, float]] = ()) -> Bounds:
    """Bounds with the largest of several variances of each parameter, shape ``(p,)`` each, and errors on top.

    Parameters
    ----------
    bounds
        Whose covariance is one of them, and has the correlations.
    added
        As in :func:`with_time_error`.
    """
    stated = bounds.covariance.diagonal()
    factor = np.sqrt(np.max([stated, *variances], axis=0) / np.where(stated > 0.0, stated, 1.0))
    covariance = bounds.covariance * np.outer(factor, factor)
    for each in added:
        moved = np.array([each.get(name, 0.0) for name in bounds.names])
        covariance = covariance + np.outer(moved, moved)
    return replace(bounds, covariance=covariance)


def by_records(bounds: Bounds, alone: Sequence[Estimate]) -> FloatArray:
    """Variances of the mean of records by their scatter, Student's factor included, shape ``(p,)``; zero where unknown.

    Parameters
    ----------
    bounds
        Of all records together.
    alone
        Each record fitted alone. What is known by the difference between records, each alone says too little of.
    """
    from scipy.stats import t

    found = np.zeros(len(bounds.names))
    for place, name in enumerate(bounds.names):
        known = [estimate for estimate in alone if name in estimate.stds]
        values = [estimate.values[name] for estimate in known]
        stated = sum(estimate.random.get(name, estimate.stds[name]) ** 2 for estimate in known)
        if len(known) >= FEWEST_RECORDS and stated <= _INFORMED * len(known) ** 2 * bounds.random[place, place]:
            factor = float(t.ppf(0.975, len(values) - 1)) / TWO_SIDED_95
            found[place] = factor**2 * float(np.var(values, ddof=1)) / len(values)
    return found
