"""What a fleet's table says: what is normal, which vehicles and flights are odd, what changed, what groups differ in.

The flights of each vehicle are put in order. Odd flights go first, then steps or drifts are looked for in what is left;
a vehicle counts for the population with its flights before its first change, and a vehicle that is odd does not count.
What is called odd or changed is chosen over the whole fleet so that at most 5 % of it is false.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from scipy import stats

from rotorid.data.base import Immutable
from rotorid.data.quantity import Quantity
from rotorid.fleets.changes import (
    Change,
    Drift,
    OddFlight,
    Spread,
    discoveries,
    drift,
    first_step,
    odd_flights,
    steps,
    within_by_neighbors,
)
from rotorid.fleets.populations import Population, population, random_effects
from rotorid.fleets.runs import order_of
from rotorid.fleets.table import Row
from rotorid.typing import BoolArray, FloatArray

Name: TypeAlias = tuple[str, str]
"""Model and parameter."""

_FEWEST_FLIGHTS = 4
"""Vehicles, or flights of groups, without which they are not compared."""

_LEAST_RATIO = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class History(Immutable):
    """One parameter of one vehicle, flight by flight.

    Parameters
    ----------
    vehicle, model, parameter, unit
        Of what.
    rows
        In the order of the flights.
    level
        Mean of the flights that count: before the first change, without odd ones; ``None`` where none does.
    changes, drift, odd
        What was found in it.
    odd_vehicle
        Probability that a vehicle lies so far from the others by chance, where that is small; else ``None``.
    """

    vehicle: str
    model: str
    parameter: str
    unit: str
    rows: tuple[Row, ...]
    level: Quantity | None = None
    changes: tuple[Change, ...] = ()
    drift: Drift | None = None
    odd: tuple[OddFlight, ...] = ()
    odd_vehicle: float | None = None


@dataclass(frozen=True, kw_only=True)
class Difference(Immutable):
    """What a group of flights differs in from another; positive where ``group`` is larger."""

    model: str
    parameter: str
    group: str
    against: str
    difference: Quantity
    relative: float
    probability: float
    found: bool


@dataclass(frozen=True, kw_only=True)
class Cause(Immutable):
    """What happened to one vehicle at one flight, and what usually does that."""

    vehicle: str
    at_flight: int
    log: str
    words: str
    usual: str


@dataclass(frozen=True, kw_only=True, eq=False)
class FleetAnalysis(Immutable):
    """All that a table says.

    Parameters
    ----------
    populations
        By model and parameter.
    histories
        All of them, those of one parameter together.
    differences
        Between groups of flights.
    causes
        Changes of one flight together, in words.
    """

    populations: Mapping[Name, Population]
    histories: tuple[History, ...]
    differences: tuple[Difference, ...] = ()
    causes: tuple[Cause, ...] = ()

    def __post_init__(self) -> None:
        self._set(populations=self.populations)

    @property
    def changed(self) -> tuple[History, ...]:
        """Histories with steps."""
        return tuple(one for one in self.histories if one.changes)


class _Series(NamedTuple):
    """The parts of a history while it is looked at."""

    vehicle: str
    rows: list[Row]
    y: FloatArray
    s: FloatArray


def analyze(rows: Iterable[Row], *, groups: Mapping[str, str] | None = None) -> FleetAnalysis:
    """Look at a table as a fleet.

    Parameters
    ----------
    rows
        Any number, of any models.
    groups
        Hash of a log to the name of its group.

    Returns
    -------
    FleetAnalysis
        Empty where there is no row.

    Examples
    --------
    >>> analyze([]).histories
    ()
    """
    by_name = _sorted_series(rows)
    spreads = {name: within_by_neighbors([(one.y, one.s) for one in series]) for name, series in by_name.items()}
    tested = {
        (name, one.vehicle): odd_flights(one.y, one.s, spreads[name]) for name, many in by_name.items() for one in many
    }
    odd = _odd(tested)
    found = _changes(by_name, spreads, odd)
    kept = {
        (name, one.vehicle): ~odd[name, one.vehicle] & _before(found.get((name, one.vehicle)), len(one.rows))
        for name, series in by_name.items()
        for one in series
    }
    strange = _odd_vehicles(by_name, kept, spreads)
    histories = []
    populations: dict[Name, Population] = {}
    for name, series in by_name.items():
        for one in series:
            changes, slope = found.get((name, one.vehicle), ((), None))
            histories.append(
                History(
                    vehicle=one.vehicle,
                    model=name[0],
                    parameter=name[1],
                    unit=one.rows[0].unit,
                    rows=tuple(one.rows),
                    level=_level(one, kept[name, one.vehicle], spreads[name]),
                    changes=changes,
                    drift=slope,
                    odd=_said(one, odd[name, one.vehicle], tested[name, one.vehicle]),
                    odd_vehicle=strange.get((name, one.vehicle)),
                )
            )
        counted = [(one, kept[name, one.vehicle]) for one in series if (name, one.vehicle) not in strange]
        counted = counted or [(one, kept[name, one.vehicle]) for one in series]
        y = np.concatenate([one.y[keep] for one, keep in counted])
        s = np.concatenate([one.s[keep] for one, keep in counted])
        who = np.concatenate([np.full(int(keep.sum()), k) for k, (_, keep) in enumerate(counted)])
        populations[name] = population(y, s, who, unit=series[0].rows[0].unit, model_std=_model_std(series))
    return FleetAnalysis(
        populations=populations,
        histories=tuple(histories),
        differences=_differences(by_name, groups or {}),
        causes=_causes(histories),
    )


def _sorted_series(rows: Iterable[Row]) -> dict[Name, list[_Series]]:
    """Histories by parameter and vehicle; values without an error say nothing.

    A parameter that some logs state in another unit than most, such as inertia without a known arm, has a history of
    its own there: numbers of two units have no mean.
    """
    told = [row for row in rows if math.isfinite(row.value) and math.isfinite(row.std) and row.std > 0.0]
    units: dict[Name, Counter[str]] = defaultdict(Counter)
    for row in told:
        units[row.model, row.parameter][row.unit] += 1
    usual = {name: max(counted, key=lambda unit: (counted[unit], unit)) for name, counted in units.items()}
    gathered: dict[Name, dict[str, list[Row]]] = defaultdict(lambda: defaultdict(list))
    for row in told:
        own = "" if row.unit == usual[row.model, row.parameter] else f" in {row.unit or '1'}"
        gathered[row.model, row.parameter + own][row.vehicle].append(row)
    found: dict[Name, list[_Series]] = {}
    for name in sorted(gathered):
        for vehicle in sorted(gathered[name]):
            ordered = sorted(gathered[name][vehicle], key=order_of)
            y = np.array([row.value for row in ordered])
            random = [row.std_random if math.isfinite(row.std_random) else row.std for row in ordered]
            found.setdefault(name, []).append(_Series(vehicle, ordered, y, np.array(random)))
    return found


def _level(one: _Series, keep: BoolArray, spread: Spread) -> Quantity | None:
    """Weighted mean of the flights that count."""
    if not keep.any():
        return None
    weight = 1.0 / np.maximum(one.s[keep] ** 2 + spread.within**2, 1e-300)
    total = float(weight.sum())
    return Quantity.normal(float(weight @ one.y[keep]) / total, math.sqrt(1.0 / total), one.rows[0].unit)


def _model_std(series: Sequence[_Series]) -> float:
    variances = [
        max(row.std**2 - row.std_random**2, 0.0) if math.isfinite(row.std_random) else 0.0
        for one in series
        for row in one.rows
    ]
    return math.sqrt(float(np.median(variances)))


def _odd(tested: Mapping[tuple[Name, str], FloatArray]) -> dict[tuple[Name, str], BoolArray]:
    """Odd flights of each series: its smallest probability is the one test of it, and takes those as small along."""
    least = np.array([float(p.min()) for p in tested.values()])
    found = discoveries(least)
    limit = float(least[found].max()) if found.any() else -1.0
    return {key: p <= limit for key, p in tested.items()}


_Found: TypeAlias = dict[tuple[Name, str], tuple[tuple[Change, ...], Drift | None]]


def _changes(
    by_name: Mapping[Name, Sequence[_Series]],
    spreads: Mapping[Name, Spread],
    odd: Mapping[tuple[Name, str], BoolArray],
) -> _Found:
    """Steps, or a drift where that explains more, of the series in which something changed."""
    entries = []
    for name, many in by_name.items():
        for one in many:
            keep = ~odd[name, one.vehicle]
            y, s = one.y[keep], one.s[keep]
            slope = drift(y, s, spreads[name], unit=one.rows[0].unit)
            stepped = first_step(y, s, spreads[name])
            entries.append((name, one, keep, stepped, slope, min(1.0, 2.0 * min(stepped, _probability(slope)))))
    chosen = discoveries([entry[5] for entry in entries])
    found: _Found = {}
    for (name, one, keep, stepped, slope, _), is_found in zip(entries, chosen, strict=True):
        if not is_found:
            continue
        y, s = one.y[keep], one.s[keep]
        changes = steps(y, s, spreads[name], unit=one.rows[0].unit) if stepped < 1.0 else ()
        if slope is not None and _drifts(y, s, spreads[name], changes, slope):
            found[name, one.vehicle] = ((), slope)
            continue
        # Numbers of the flights with the odd ones among them.
        numbers = np.flatnonzero(keep)
        found[name, one.vehicle] = (
            tuple(
                Change(
                    at_flight=int(numbers[change.at_flight - 1]) + 1,
                    before=change.before,
                    after=change.after,
                    probability=change.probability,
                )
                for change in changes
            ),
            None,
        )
    return found


def _probability(slope: Drift | None) -> float:
    return 1.0 if slope is None else slope.probability


def _drifts(y: FloatArray, s: FloatArray, spread: Spread, changes: Sequence[Change], slope: Drift) -> bool:
    """Whether a straight line leaves less than the steps do; each step costs its size and its place."""
    weight = 1.0 / np.maximum(s**2 + spread.within**2, 1e-300)
    flight = np.arange(y.size)
    line = slope.slope.value * flight
    line = y - line - float(weight @ (y - line) / weight.sum())
    ends = [0, *(change.at_flight - 1 for change in changes), y.size]
    levels = np.concatenate(
        [np.full(b - a, float(weight[a:b] @ y[a:b] / weight[a:b].sum())) for a, b in itertools.pairwise(ends)]
    )
    cost = math.log(max(y.size, 2))
    left_by_steps = float(weight @ (y - levels) ** 2) + 2.0 * cost * len(changes)
    return not changes or float(weight @ line**2) + cost < left_by_steps


def _before(found: tuple[tuple[Change, ...], Drift | None] | None, flights: int) -> BoolArray:
    """Flights before the first step."""
    keep = np.ones(flights, dtype=np.bool_)
    if found is not None and found[0]:
        keep[found[0][0].at_flight - 1 :] = False
    return keep


def _odd_vehicles(
    by_name: Mapping[Name, Sequence[_Series]],
    kept: Mapping[tuple[Name, str], BoolArray],
    spreads: Mapping[Name, Spread],
) -> dict[tuple[Name, str], float]:
    """Vehicles that lie apart from all others, each judged by the others; again without those that were found."""
    out: dict[tuple[Name, str], float] = {}
    for _ in range(3):
        entries = []
        for name, many in by_name.items():
            means = []
            for one in many:
                level = _level(one, kept[name, one.vehicle], spreads[name])
                if (name, one.vehicle) not in out and level is not None:
                    means.append((one.vehicle, level.value, level.std**2))
            if len(means) < _FEWEST_FLIGHTS:
                continue
            entries += [((name, vehicle), p) for vehicle, p in _apart(means)]
        found = discoveries([p for _, p in entries])
        new = {key: p for (key, p), chosen in zip(entries, found, strict=True) if chosen}
        if not new:
            return out
        out |= new
    return out


def _apart(means: Sequence[tuple[str, float, float]]) -> list[tuple[str, float]]:
    """For each vehicle the probability that it lies so far from all others by chance."""
    m, v = np.array([one[1] for one in means]), np.array([one[2] for one in means])
    found = []
    for k, (vehicle, own, variance) in enumerate(means):
        others, errors = np.delete(m, k), np.delete(v, k)
        # Moments: what the others scatter beyond their own errors.
        between = max(float(np.var(others, ddof=1)) - float(errors.mean()), 0.0)
        weight = 1.0 / (between + errors)
        center = float(weight @ others / weight.sum())
        std = math.sqrt(between + variance + 1.0 / float(weight.sum()))
        found.append((vehicle, float(2.0 * stats.t.sf(abs(own - center) / std, others.size - 1))))
    return found


def _said(one: _Series, odd: BoolArray, p: FloatArray) -> tuple[OddFlight, ...]:
    found = []
    for k in np.flatnonzero(odd):
        around = [j for j in (k - 2, k - 1, k + 1, k + 2) if 0 <= j < one.y.size and not odd[j]]
        expected = float(np.mean(one.y[around])) if around else float(np.median(one.y))
        value = Quantity.normal(float(one.y[k]), float(one.s[k]), one.rows[k].unit)
        found.append(OddFlight(flight=int(k) + 1, value=value, expected=expected, probability=float(p[k])))
    return tuple(found)


def _differences(by_name: Mapping[Name, Sequence[_Series]], groups: Mapping[str, str]) -> tuple[Difference, ...]:
    """What each group differs in from the one that comes first by its name."""
    found: list[dict[str, Any]] = []
    for name, many in by_name.items():
        rows = [(k, row, s) for k, one in enumerate(many) for row, s in zip(one.rows, one.s, strict=True)]
        rows = [entry for entry in rows if entry[1].log_sha256 in groups]
        names = sorted({groups[row.log_sha256] for _, row, _ in rows})
        if len(names) < 2 or len(rows) < _FEWEST_FLIGHTS:
            continue
        columns = [[1.0, *(float(groups[row.log_sha256] == other) for other in names[1:])] for _, row, _ in rows]
        y, s = np.array([row.value for _, row, _ in rows]), np.array([s for _, _, s in rows])
        effects = random_effects(y, s, np.array([k for k, _, _ in rows]), design=np.array(columns), intervals=False)
        freedom = max(len({k for k, _, _ in rows}) - 2, 1)
        base = float(effects.beta[0])
        for k, other in enumerate(names[1:], start=1):
            value, std = float(effects.beta[k]), math.sqrt(float(effects.covariance[k, k]))
            half = float(stats.t.ppf(0.975, freedom)) * std
            found.append(
                {
                    "model": name[0],
                    "parameter": name[1],
                    "group": other,
                    "against": names[0],
                    "difference": Quantity(
                        value=value, std=std, lower=value - half, upper=value + half, unit=rows[0][1].unit
                    ),
                    "relative": value / base if abs(base) > _LEAST_RATIO else math.nan,
                    "probability": float(2.0 * stats.t.sf(abs(value) / max(std, 1e-300), freedom)),
                }
            )
    chosen = discoveries([one["probability"] for one in found])
    return tuple(Difference(**one, found=bool(is_found)) for one, is_found in zip(found, chosen, strict=True))


_POWERS = ("L_roll", "M_pitch", "N_yaw", "Z_thrust", "thrust_slope", "thrust_full")
_INERTIAS = ("I_xx", "I_yy", "I_zz")
_LAGS = ("T_motor", "tau_roll", "tau_pitch", "tau_yaw")

_ALIKE = 0.05
"""Ratios of control derivatives that lie nearer changed alike, as thrust changes all of them."""


def _causes(histories: Sequence[History]) -> tuple[Cause, ...]:
    """Steps of one vehicle at one flight together, and what usually lies behind such a pattern."""
    events: dict[tuple[str, str], list[tuple[History, Change]]] = defaultdict(list)
    for one in histories:
        for change in one.changes:
            events[one.vehicle, one.rows[change.at_flight - 1].log].append((one, change))
    found = []
    for (vehicle, log), many in sorted(events.items()):
        words = ", ".join(
            f"{name} {_percents([change for one, change in many if one.parameter == name])}"
            for name in dict.fromkeys(one.parameter for one, _ in many)
        )
        number = min(change.at_flight for _, change in many)
        found.append(Cause(vehicle=vehicle, at_flight=number, log=log, words=words, usual=_usual(many)))
    return tuple(found)


def _percents(changes: Sequence[Change]) -> str:
    """How far a parameter of one or several models went.

    Examples
    --------
    >>> before, after = Quantity.normal(2.0, 0.1, "s"), Quantity.normal(2.2, 0.1, "s")
    >>> _percents([Change(at_flight=3, before=before, after=after, probability=0.001)])
    '+10.0 %'
    """
    ratios = sorted(100.0 * (change.ratio - 1.0) for change in changes if math.isfinite(change.ratio))
    if not ratios:
        return "changed"
    low, high = f"{ratios[0]:+.1f}", f"{ratios[-1]:+.1f}"
    return f"{low} %" if low == high else f"{low} to {high} %"


def _usual(many: Sequence[tuple[History, Change]]) -> str:
    powers = {one.parameter: change.ratio for one, change in many if one.parameter in _POWERS}
    lags = [one.parameter for one, change in many if one.parameter.startswith(_LAGS) and change.ratio > 1.0]
    inertias = [one.parameter for one, _ in many if one.parameter in _INERTIAS]
    said = []
    thrust = [ratio for name, ratio in powers.items() if name in ("Z_thrust", "thrust_slope", "thrust_full")]
    turning = [ratio for name, ratio in powers.items() if name in ("L_roll", "M_pitch", "N_yaw")]
    if inertias or (turning and not thrust and len(turning) < 3 and max(turning) - min(turning) > _ALIKE):
        said.append("a payload or anything else that changes the inertia")
    elif thrust or (turning and max(turning) - min(turning) <= _ALIKE):
        fell = min([*thrust, *turning]) < 1.0
        said.append("worn or other propellers, motors, a sagging battery" if fell else "other propellers or motors")
    elif turning:
        said.append("a payload, propellers or motors")
    if lags:
        said.append("motors, ESCs or their settings")
    return "; ".join(said)
