"""Filters together with gains: less noise or a stiffer attitude, as a curve of points from which the user picks.

Each point is a set of filters of the firmware, a limit of noise, and the gains of all axes that are best with them: the
limits of :mod:`rotorid.tuning.proposal` apply to the combination on all likely plants, with notches that follow the
motors where these are slowest. Points that another one beats in noise and attitude are left out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rotorid.data.axes import RATE_OF
from rotorid.data.base import Immutable
from rotorid.data.quantity import Quantity
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.flights.filter_effects import command_powers, filtered_density, saved
from rotorid.flights.gyro_noise import GyroNoise, gyro_noise
from rotorid.loops.filter_choice import FilterSet, KnownLoop, filter_sets
from rotorid.proposing.axis import KnownAxis
from rotorid.proposing.filters import with_filters
from rotorid.proposing.new_gains import agreed_gains
from rotorid.tuning.firmware import written
from rotorid.tuning.loops import Gains, loop_figures, over_draws
from rotorid.tuning.proposal import Judged, Wishes
from rotorid.typing import Axis, FloatArray

SETS = 4
"""Sets of filters that are tried with gains, besides the flown ones."""

MOST_COST_DEG = 12.0
"""Most phase that a set may cost at the crossover of the flown loop: gains would have to give it back."""

_SAME_NOISE = 0.03
"""Share of the noise, and of the attitude error, that makes no difference between two points."""

_QUIETER = 0.97
"""Noise over that of the set before, up to which a set that costs more is worth a look."""

_NOISE_LIMITS = (1.0, 0.5)
"""Noise that gains may make over the flown ones, besides the limit that was asked for, the largest first."""

_LEAST_SAVED = 10.0
"""Saved noise in per cent from which new filters are recommended."""

_AS_STIFF = 1.02
"""Attitude error over that with the flown filters, up to which less noise is recommended."""


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisPoint(Immutable):
    """An axis at a point of the curve.

    Parameters
    ----------
    judged
        Its gains, and what they do on every draw.
    parameters
        The gains by the firmware's names.
    sensitivity_peak
        The larger M_s of rate loop and whole loop.
    attitude_ratio
        Attitude error under a disturbance, over that of the flown gains and filters.
    """

    judged: Judged
    parameters: Mapping[str, float]
    sensitivity_peak: Quantity
    attitude_ratio: Quantity

    def __post_init__(self) -> None:
        self._set(parameters=self.parameters)


@dataclass(frozen=True, kw_only=True, eq=False)
class FilterPoint(Immutable):
    """Filters and gains that may be flown together.

    Parameters
    ----------
    number
        By which the user picks it, from one; zero for the flown filters with the proposed gains.
    filters
        Parameters that change: flown and new value.
    noise_limit
        Largest noise of each command that was allowed, over the flown one.
    axes
        What each axis gets.
    saves_percent
        Noise at the motors that is saved over the flown gains and filters, of all axes together.
    """

    number: int
    filters: Mapping[str, tuple[float | None, float]]
    noise_limit: float
    axes: Mapping[Axis, AxisPoint]
    saves_percent: Quantity

    def __post_init__(self) -> None:
        self._set(filters=self.filters, axes=self.axes)

    @property
    def values(self) -> dict[str, float]:
        """New values of the filters."""
        return {name: new for name, (_, new) in self.filters.items()}

    @property
    def noise(self) -> float:
        """Noise at the motors over the flown one."""
        return 1.0 - 0.01 * self.saves_percent.value

    @property
    def attitude(self) -> float:
        """Attitude error over the flown one, of all axes the geometric mean."""
        return float(np.exp(np.mean([np.log(point.attitude_ratio.value) for point in self.axes.values()])))


@dataclass(frozen=True, kw_only=True, eq=False)
class FilterCurve(Immutable):
    """The points, of which each has less noise or a smaller attitude error than every other one.

    Parameters
    ----------
    points
        The least noise first; the flown filters are always among them.
    recommended
        Number of the point with the least noise whose attitude is as stiff as with the flown filters; zero where the
        flown filters are to stay.
    picked
        Number of the point whose filters and gains are proposed; ``None`` where the filters stay as flown.
    """

    points: tuple[FilterPoint, ...]
    recommended: int
    picked: int | None = None

    def __post_init__(self) -> None:
        self._set(points=tuple(self.points))

    def point(self, number: int) -> FilterPoint:
        """The point of a number.

        Raises
        ------
        UsageError
            There is none.
        """
        found = next((point for point in self.points if point.number == number), None)
        if found is None:
            known = ", ".join(str(point.number) for point in sorted(self.points, key=lambda one: one.number))
            raise UsageError(f"--filters {number}: no such point", remedy=f"use one of {known}, keep or propose")
        return found


def filter_curve(
    known: Mapping[Axis, KnownAxis], wishes: Callable[[KnownAxis], Wishes], flown_filters: Mapping[str, float]
) -> FilterCurve:
    """The curve of filters with gains.

    Parameters
    ----------
    known
        Axes with their flown loops, with the filters that the user asked for.
    wishes
        Limits of the gains of an axis.
    flown_filters
        Filters that the user asked for: every point has them too.

    Raises
    ------
    InsufficientDataError
        The log does not show the noise of the gyro, or no point keeps the limits.
    AxisError
        The search of gains failed.
    """
    record = next(iter(known.values())).flown.record
    noise = gyro_noise(record)
    loops = {axis: _loop(one) for axis, one in known.items()}
    sets = _spread(filter_sets(record, noise, {axis: loop for axis, loop in loops.items() if loop is not None}))
    powers = {axis: _powers(record, noise, one.flown_parts.controller, record, axis) for axis, one in known.items()}
    before = np.sum(list(powers.values()), axis=0)
    asked = next(iter(map(wishes, known.values()))).noise
    found: list[FilterPoint] = []
    for one in sets:
        values = {**flown_filters, **one.values}
        try:
            then = with_filters(record, values) if values else record
            changed = {axis: changed_axis(one, then) for axis, one in known.items()}
        except (UsageError, InsufficientDataError):
            continue
        loudest = np.inf
        for limit in [asked, *(limit for limit in _NOISE_LIMITS if limit < asked)]:
            # A limit above what the gains make binds nothing.
            if loudest <= limit:
                continue
            point = _point(record, noise, changed, then, one, limit, wishes, before)
            if point is not None:
                found.append(point)
                loudest = max(point.axes[axis].judged.noise / _flown_noise(one) for axis, one in known.items())
    kept = [point for point in found if not point.filters]
    if not kept:
        raise InsufficientDataError(
            "no gains keep the limits with the flown filters", remedy="see what limits the gains of each axis"
        )
    return _numbered(_undominated(found, kept[0]), kept[0])


def _flown_noise(known: KnownAxis) -> float:
    return known.flown_parts.noise(known.gains)


def _loop(known: KnownAxis) -> KnownLoop | None:
    figures = loop_figures(
        known.omega_rad_s,
        known.drawn() * known.flown_parts.rate(known.gains),
        from_rad_s=known.plant.known_from_rad_s,
    )
    crossover = figures.usual_crossover_rad_s
    if crossover <= 0.0:
        return None
    return KnownLoop(plant=known.plant, source=known.flown.source, crossover_rad_s=crossover)


def _spread(sets: Sequence[FilterSet]) -> list[FilterSet]:
    """The flown filters, and some of those that no other set beats in phase and noise, evenly from loud to quiet."""
    flown, *others = sets
    front: list[FilterSet] = []
    for one in sorted(others, key=lambda one: (one.cost_deg, one.rms, len(one.changes))):
        if one.cost_deg <= MOST_COST_DEG and (not front or one.rms < _QUIETER * front[-1].rms):
            front.append(one)
    if not front:
        return [flown]
    levels = np.log([one.rms for one in front])
    wanted = np.linspace(levels[0], levels[-1], SETS)
    chosen = dict.fromkeys(int(np.abs(levels - level).argmin()) for level in wanted)
    return [flown, *(front[place] for place in chosen)]


def _powers(record: FlightRecord, noise: GyroNoise, controller: object, then: FlightRecord, axis: Axis) -> FloatArray:
    density = filtered_density(record, then, noise)[RATE_OF[axis]]
    return command_powers(controller, noise, density)  # type: ignore[arg-type]


def changed_axis(known: KnownAxis, then: FlightRecord) -> KnownAxis:
    """An axis with the filters of another record's parameters.

    Parameters
    ----------
    known
        As it flew.
    then
        Its log with other filters among its parameters.
    """
    if then is known.flown.record:
        return replace(known, then=None, controller=known.flown.controller, parts=known.flown_parts)
    return replace(
        known,
        then=then,
        controller=known.flown.with_parameters(then),
        parts=known.flown.parts(known.omega_rad_s, then=then, noise=known.flown_parts.rate_noise),
    )


def with_point(
    known: Mapping[Axis, KnownAxis], point: FilterPoint, flown_filters: Mapping[str, float]
) -> dict[Axis, KnownAxis]:
    """The axes with the filters of a point.

    Parameters
    ----------
    known, flown_filters
        As for :func:`filter_curve`.
    """
    record = next(iter(known.values())).flown.record
    values = {**flown_filters, **point.values}
    then = with_filters(record, values) if values else record
    return {axis: changed_axis(one, then) for axis, one in known.items()}


def _point(
    record: FlightRecord,
    noise: GyroNoise,
    known: Mapping[Axis, KnownAxis],
    then: FlightRecord,
    filters: FilterSet,
    limit: float,
    wishes: Callable[[KnownAxis], Wishes],
    before: FloatArray,
) -> FilterPoint | None:
    """Filters with the best gains of every axis; ``None`` where an axis has none that keep the limits."""
    agreed, _ = agreed_gains(known, lambda one: replace(wishes(one), noise=limit))
    if not all(found.proposal.keeps_limits for found in agreed.values()):
        return None
    axes: dict[Axis, AxisPoint] = {}
    powers = []
    for axis, one in known.items():
        found = agreed[axis].proposal
        scores = found.proposed
        axes[axis] = AxisPoint(
            judged=scores,
            parameters=written(one.controller, scores.gains),
            sensitivity_peak=over_draws(np.maximum(scores.rate.sensitivity_peak, scores.whole.sensitivity_peak), "1"),
            attitude_ratio=over_draws(scores.attitude_rms / found.flown.attitude_rms, "1"),
        )
        powers.append(_powers(record, noise, Gains.on(scores.gains, one.parts.controller), then, axis))
    changes = {
        name: (record.parameters.get(name), value)
        for name, value in filters.values.items()
        if record.parameters.get(name) != value
    }
    return FilterPoint(
        number=0,
        filters=changes,
        noise_limit=limit,
        axes=axes,
        saves_percent=saved(before, np.sum(powers, axis=0)),
    )


def _undominated(points: Sequence[FilterPoint], kept: FilterPoint) -> list[FilterPoint]:
    """Points that no other one beats in both, quietest first; the flown filters stay among them.

    Noise that differs by less than its error counts as the same.
    """
    found: list[FilterPoint] = []
    for point in sorted(points, key=lambda point: (point.noise, point.attitude)):
        if point is kept or all(point.attitude < 0.995 * other.attitude for other in found):
            found.append(point)
    return [
        point
        for point in found
        if point is kept
        or not any(
            other is not point
            and other.noise <= (1.0 + _SAME_NOISE) * point.noise
            and other.attitude < (1.0 - _SAME_NOISE) * point.attitude
            for other in found
        )
    ]


def _numbered(points: Sequence[FilterPoint], kept: FilterPoint) -> FilterCurve:
    others = [point for point in points if point is not kept]
    numbers = {id(point): number for number, point in enumerate(others, start=1)} | {id(kept): 0}
    numbered = tuple(replace(point, number=numbers[id(point)]) for point in points)
    good = [
        point
        for point in numbered
        if point.filters
        and point.attitude <= _AS_STIFF * kept.attitude
        and point.noise <= (1.0 - 0.01 * _LEAST_SAVED) * kept.noise
    ]
    return FilterCurve(points=numbered, recommended=good[0].number if good else 0)
