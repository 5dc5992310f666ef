"""Analysis of a fleet: normal values, odd vehicles and flights, changes, and differences between groups.

The flights of each vehicle are put in order. Odd flights go first, then steps or drifts are looked for in what is left;
a vehicle counts for the population with its flights before its first change, and a vehicle that is odd does not count.
What is called odd or changed is chosen over the whole fleet so that at most 5 % of it is false. What was not found is
*unchanged* where a change of 20 % would have been found, and *undecided* elsewhere.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from scipy import stats

from rotorid.data.base import Immutable
from rotorid.data.quantity import Quantity, error_columns
from rotorid.fleets.balance import BALANCE, MotorChange, OutOfBalance, motor_changes, out_of_balance
from rotorid.fleets.changes import (
    Change,
    Drift,
    OddFlight,
    Scatter,
    Spread,
    drift,
    first_step,
    least_step,
    odd_flights,
    places_of_steps,
    shown_scatter,
    stated_scatter,
    steps,
)
from rotorid.fleets.names import words_of
from rotorid.fleets.populations import Population, population, random_effects
from rotorid.fleets.table import REVIEW, Row
from rotorid.fleets.vehicles import SeveralVehicles, order_of, separated
from rotorid.fleets.yaw_drift import YawOverVoltage, yaw_over_voltage
from rotorid.flights.same_vehicle import different_gains
from rotorid.identifying.comparison import other_basis
from rotorid.typing import BoolArray, FloatArray
from rotorid.uncertainty.differences import (
    Scale,
    Verdict,
    chance,
    detectable,
    discoveries,
    is_clear_of_zero,
    scale_of,
    verdict,
)

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
    rows
        In the order of the flights.
    level
        Mean of the flights that count: before the first change, without odd ones; ``None`` where none does.
    changes, drift, odd
        What was found in it.
    odd_vehicle
        Probability that a vehicle lies so far from the others by chance, where that is small; else ``None``.
    verdict
        Whether it changed, as far as its flights decide that.
    detectable
        The change, as a share, that would have been found; infinite where none would.
    scatter_known
        Whether two flights of it can be compared: measures that follow wind and battery need the scatter of several.
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
    verdict: Verdict = "undecided"
    detectable: float = math.inf
    scatter_known: bool = True


@dataclass(frozen=True, kw_only=True)
class Difference(Immutable):
    """The difference between two groups of flights; positive where ``group`` is larger."""

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
    """Changes of one vehicle at one flight, and their usual cause."""

    vehicle: str
    at_flight: int
    log: str
    words: str
    usual: str


@dataclass(frozen=True, kw_only=True)
class OtherGains(Immutable):
    """A log that was flown with other gains than the one before it, of the same vehicle.

    Parameters
    ----------
    at_flight
        Number of its first flight, from 1.
    gains
        Name to the value before and since.
    """

    vehicle: str
    log: str
    at_flight: int
    gains: Mapping[str, tuple[float, float]]

    def __post_init__(self) -> None:
        self._set(gains=self.gains)


@dataclass(frozen=True, kw_only=True, eq=False)
class FleetAnalysis(Immutable):
    """The analysis of a table.

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
    several
        Names that stood for several vehicles, which are taken apart.
    other_gains
        Logs that were flown with other gains than those before them.
    unbalanced
        Vehicles whose motors share the work less evenly than those of healthy vehicles.
    yaw
        Drift and trim of yaw over the voltage of the battery, where flights show them.
    """

    populations: Mapping[Name, Population]
    histories: tuple[History, ...]
    differences: tuple[Difference, ...] = ()
    causes: tuple[Cause, ...] = ()
    several: tuple[SeveralVehicles, ...] = ()
    other_gains: tuple[OtherGains, ...] = ()
    unbalanced: tuple[OutOfBalance, ...] = ()
    yaw: tuple[YawOverVoltage, ...] = ()

    def __post_init__(self) -> None:
        self._set(populations=self.populations)

    @property
    def changed(self) -> tuple[History, ...]:
        """Histories with steps."""
        return tuple(history for history in self.histories if history.changes)


class _Series(NamedTuple):
    """The parts of a history while it is looked at: values on their scale, errors that count, random errors alone."""

    vehicle: str
    rows: list[Row]
    y: FloatArray
    s: FloatArray
    random: FloatArray


class _Parameter(NamedTuple):
    """One parameter of all vehicles."""

    scale: Scale
    scatter: Scatter
    many: list[_Series]

    @property
    def spread(self) -> Spread:
        return self.scatter.spread

    @property
    def unit(self) -> str:
        return self.many[0].rows[0].unit


def analyze(
    rows: Iterable[Row],
    *,
    groups: Mapping[str, str] | None = None,
    gains: Mapping[str, Mapping[str, float]] | None = None,
    patterns: Mapping[str, FloatArray] | None = None,
) -> FleetAnalysis:
    """Look at a table as a fleet.

    Parameters
    ----------
    rows
        Any number, of any models.
    groups
        Hash of a log to the name of its group.
    gains
        Hash of a log to the gains that it was flown with.
    patterns
        Hash of a log to the patterns over its rotors, to name the motor that changed.

    Returns
    -------
    FleetAnalysis
        Empty where there is no row.

    Examples
    --------
    >>> analyze([]).histories
    ()
    """
    known, several = separated(rows)
    found = _parameters(known)
    series = {(name, series.vehicle): (of, series) for name, of in found.items() for series in of.many}
    tested = {key: odd_flights(member.y, member.s, of.spread) for key, (of, member) in series.items()}
    odd = _odd(
        {key: tested[key] if of.scatter.known else np.ones(member.y.size) for key, (of, member) in series.items()}
    )
    changes = _changes(series, odd)
    kept = {key: ~odd[key] & _before(changes.get(key), len(member.rows)) for key, (_, member) in series.items()}
    strange = _odd_vehicles(found, kept)
    tests = sum(_compared(of, member) for of, member in series.values())
    histories = []
    for key, (of, member) in series.items():
        name, vehicle = key
        stepped, slope = changes.get(key, ((), None))
        reach = _detectable(of, member, tests=tests)
        histories.append(
            History(
                vehicle=vehicle,
                model=name[0],
                parameter=name[1],
                unit=of.unit,
                rows=tuple(member.rows),
                level=_level(of, member, kept[key]),
                changes=stepped,
                drift=slope,
                odd=_odd_ones(of.scale, member, odd[key], tested[key]),
                odd_vehicle=strange.get(key),
                verdict=verdict(found=bool(stepped or slope), detectable_share=reach),
                detectable=reach,
                scatter_known=of.scatter.known,
            )
        )
    motors = motor_changes(known, patterns or {})
    changed_motors = {one.vehicle for one in motors}
    histories = [
        replace(one, verdict="changed") if one.vehicle in changed_motors and one.parameter in BALANCE else one
        for one in histories
    ]
    populations = {
        name: _population(
            of, [(series, kept[name, series.vehicle], (name, series.vehicle) in strange) for series in of.many]
        )
        for name, of in found.items()
    }
    return FleetAnalysis(
        populations=populations,
        histories=tuple(histories),
        differences=_differences(found, groups or {}),
        causes=_causes(histories, motors),
        unbalanced=out_of_balance(known),
        yaw=yaw_over_voltage(known, populations),
        several=several,
        other_gains=tuple(_other_gains(known, gains or {})),
    )


def _other_gains(rows: Sequence[Row], gains: Mapping[str, Mapping[str, float]]) -> Iterator[OtherGains]:
    """Logs of a vehicle, in their order, whose gains are not those of the log before."""
    vehicles: dict[str, dict[tuple[str, int], Row]] = defaultdict(dict)
    for row in sorted(rows, key=order_of):
        vehicles[row.vehicle].setdefault((row.log_sha256, row.flight), row)
    for vehicle, flights in sorted(vehicles.items()):
        before: dict[str, float] = {}
        for number, row in enumerate(flights.values(), start=1):
            own = gains.get(row.log_sha256, {})
            if changed := different_gains(before, own):
                yield OtherGains(vehicle=vehicle, log=row.log, at_flight=number, gains=changed)
            before |= own


def _population(of: _Parameter, many: Sequence[tuple[_Series, BoolArray, bool]]) -> Population:
    """Normal values, without odd vehicles unless there are no others."""
    counted = [(series, keep) for series, keep, strange in many if not strange] or [
        (series, keep) for series, keep, _ in many
    ]
    values = [[row.value for row, counts in zip(series.rows, keep, strict=True) if counts] for series, keep in counted]
    return population(
        np.concatenate(values),
        np.concatenate([series.random[keep] for series, keep in counted]),
        np.concatenate([np.full(int(keep.sum()), k) for k, (_, keep) in enumerate(counted)]),
        unit=of.unit,
        model_std=_model_std(of.many),
        scale=of.scale,
    )


def _parameters(rows: Iterable[Row]) -> dict[Name, _Parameter]:
    """Histories by parameter and vehicle; values without an error are left out.

    A parameter that some logs state in another unit than most, such as inertia without a known arm, or that was
    measured in another way, such as a delay fitted without a lag, or that a fit left at its bound of zero, has a
    history of its own there: numbers of two quantities have no mean.
    """
    stated = [row for row in rows if math.isfinite(row.value) and math.isfinite(row.std) and row.std > 0.0]
    kinds: dict[Name, Counter[_Kind]] = defaultdict(Counter)
    for row in stated:
        kinds[row.model, row.parameter][_kind(row)] += 1
    # Of kinds that are as frequent, the one that is clear of zero, and with a lag that was not dropped.
    usual = {
        name: max(counted, key=lambda kind: (counted[kind], kind.clear, -kind.basis.count("without"), kind))
        for name, counted in kinds.items()
    }
    gathered: dict[Name, dict[str, list[Row]]] = defaultdict(lambda: defaultdict(list))
    for row in stated:
        own = _otherwise(_kind(row), usual[row.model, row.parameter])
        gathered[row.model, row.parameter + own][row.vehicle].append(row)
    return {
        name: _parameter(name, {vehicle: sorted(gathered[name][vehicle], key=order_of) for vehicle in sorted(many)})
        for name, many in sorted(gathered.items())
    }


class _Kind(NamedTuple):
    """The key that separates quantities of the same name."""

    unit: str
    basis: str
    clear: bool


def _kind(row: Row) -> _Kind:
    return _Kind(row.unit, row.basis, is_clear_of_zero(row.parameter, row.value, row.std))


_CLEAR, _ZERO = " (clear of zero)", " (zero within its error)"


def _otherwise(kind: _Kind, usual: _Kind) -> str:
    """What sets a quantity apart from the usual one of its name; empty for the usual one."""
    words = "" if kind.unit == usual.unit else f" in {kind.unit or '1'}"
    if kind.basis != usual.basis:
        words += f" ({other_basis(kind.basis, usual.basis)})"
    if kind.clear != usual.clear:
        words += _CLEAR if kind.clear else _ZERO
    return words


def quantity_of(parameter: str) -> str:
    """The quantity of a history: what is clear of zero in some flights and not in others has two histories.

    Examples
    --------
    >>> quantity_of("tau_roll (zero within its error)"), quantity_of("tau_roll")
    ('tau_roll', 'tau_roll')
    """
    return parameter.removesuffix(_CLEAR).removesuffix(_ZERO)


def _parameter(name: Name, many: Mapping[str, list[Row]]) -> _Parameter:
    every = [row for rows in many.values() for row in rows]
    scale = scale_of(
        name[1].partition(" ")[0], np.array([row.value for row in every]), np.array([row.std for row in every])
    )
    values = [np.array([row.value for row in rows]) for rows in many.values()]
    random = [np.array([_random(row) for row in rows]) for rows in many.values()]
    model = [np.array([math.sqrt(_model_variance(row)) for row in rows]) for rows in many.values()]
    y = [scale.values(own) for own in values]
    r, m = ([scale.stds(own, s) for own, s in zip(values, stds, strict=True)] for stds in (random, model))
    if name[0] == REVIEW:
        scatter = shown_scatter(list(zip(y, r, strict=True)))
    else:
        scatter = stated_scatter(list(zip(y, r, m, strict=True)))
    columns = zip(many, many.values(), y, scatter.stds, random, strict=True)
    return _Parameter(scale, scatter, [_Series(*column) for column in columns])


def _random(row: Row) -> float:
    return row.std_random if math.isfinite(row.std_random) else row.std


def _model_variance(row: Row) -> float:
    return max(row.std**2 - _random(row) ** 2, 0.0)


def _compared(of: _Parameter, series: _Series) -> bool:
    """Whether flights of a vehicle can be compared at all."""
    return of.scatter.known and series.y.size > 1


def _detectable(of: _Parameter, series: _Series, *, tests: int) -> float:
    """The change of a series that would have been found, as a share of its level."""
    if not _compared(of, series):
        return math.inf
    count = tests * places_of_steps(series.y.size)
    reach = detectable(least_step(series.s, of.spread), tests=count, freedom=of.spread.freedom)
    level, std = _mean(series, np.ones(series.y.size, dtype=np.bool_), of.spread) or (0.0, math.inf)
    return of.scale.share(reach, level, std)


def _mean(series: _Series, keep: BoolArray, spread: Spread) -> tuple[float, float] | None:
    """Weighted mean of the flights that count with its error, on the scale of the values."""
    if not keep.any():
        return None
    weight = 1.0 / np.maximum(series.s[keep] ** 2 + spread.within**2, 1e-300)
    total = float(weight.sum())
    return float(weight @ series.y[keep]) / total, math.sqrt(1.0 / total)


def _level(of: _Parameter, series: _Series, keep: BoolArray) -> Quantity | None:
    mean = _mean(series, keep, of.spread)
    return None if mean is None else of.scale.quantity(*mean, of.unit)


def _model_std(series: Sequence[_Series]) -> float:
    return math.sqrt(float(np.median([_model_variance(row) for member in series for row in member.rows])))


def _odd(tested: Mapping[tuple[Name, str], FloatArray]) -> dict[tuple[Name, str], BoolArray]:
    """Odd flights of each series: its smallest probability is the one test of it, and takes those as small along."""
    least = np.array([float(p.min()) for p in tested.values()])
    found = discoveries(least)
    limit = float(least[found].max()) if found.any() else -1.0
    return {key: p <= limit for key, p in tested.items()}


_Found: TypeAlias = dict[tuple[Name, str], tuple[tuple[Change, ...], Drift | None]]


def _changes(
    series: Mapping[tuple[Name, str], tuple[_Parameter, _Series]], odd: Mapping[tuple[Name, str], BoolArray]
) -> _Found:
    """Steps, or a drift where that explains more, of the series in which something changed."""
    entries = []
    for key, (of, member) in series.items():
        if not _compared(of, member):
            continue
        y, s = member.y[~odd[key]], member.s[~odd[key]]
        slope = drift(y, s, of.spread, unit="")
        stepped = first_step(y, s, of.spread)
        either = stepped if slope is None else min(1.0, 2.0 * min(stepped, slope.probability))
        entries.append((key, slope, stepped, either))
    chosen = discoveries([entry[3] for entry in entries])
    found: _Found = {}
    for (key, slope, stepped, _), is_found in zip(entries, chosen, strict=True):
        if not is_found:
            continue
        of, member = series[key]
        keep = ~odd[key]
        y, s = member.y[keep], member.s[keep]
        changes = steps(y, s, of.spread, unit="") if stepped < 1.0 else ()
        if slope is not None and _drifts(y, s, of.spread, changes, slope):
            found[key] = ((), _in_unit(of, member, slope))
            continue
        # Numbers of the flights with the odd ones among them.
        numbers = np.flatnonzero(keep)
        found[key] = (
            tuple(
                Change(
                    at_flight=int(numbers[change.at_flight - 1]) + 1,
                    before=of.scale.quantity(change.before.value, change.before.std, of.unit),
                    after=of.scale.quantity(change.after.value, change.after.std, of.unit),
                    probability=change.probability,
                )
                for change in changes
            ),
            None,
        )
    return found


def _in_unit(of: _Parameter, series: _Series, slope: Drift) -> Drift:
    """A slope of the scale as one of the unit, at the mean of the flights."""
    level = float(np.mean(series.y))
    rises = of.scale.sign if of.scale.logarithmic else 1.0
    return Drift(
        slope=Quantity.normal(
            rises * of.scale.size(slope.slope.value, level), of.scale.size(slope.slope.std, level), of.unit
        ),
        probability=slope.probability,
    )


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
    found: Mapping[Name, _Parameter], kept: Mapping[tuple[Name, str], BoolArray]
) -> dict[tuple[Name, str], float]:
    """Vehicles unlike all others, each compared with the others; repeated without those that were found."""
    out: dict[tuple[Name, str], float] = {}
    for _ in range(3):
        entries = []
        for name, of in found.items():
            means = []
            for series in of.many:
                mean = _mean(series, kept[name, series.vehicle], of.spread)
                if (name, series.vehicle) not in out and mean is not None:
                    means.append((series.vehicle, mean[0], mean[1] ** 2))
            if len(means) < _FEWEST_FLIGHTS:
                continue
            entries += [((name, vehicle), p) for vehicle, p in _outlier_probabilities(means)]
        chosen = discoveries([p for _, p in entries])
        new = {key: p for (key, p), is_found in zip(entries, chosen, strict=True) if is_found}
        if not new:
            return out
        out |= new
    return out


def _outlier_probabilities(means: Sequence[tuple[str, float, float]]) -> list[tuple[str, float]]:
    """For each vehicle the probability that it lies so far from all others by chance."""
    m, v = np.array([mean[1] for mean in means]), np.array([mean[2] for mean in means])
    found = []
    for k, (vehicle, own, variance) in enumerate(means):
        others, errors = np.delete(m, k), np.delete(v, k)
        # Moments: what the others scatter beyond their own errors.
        between = max(float(np.var(others, ddof=1)) - float(errors.mean()), 0.0)
        weight = 1.0 / (between + errors)
        center = float(weight @ others / weight.sum())
        std = math.sqrt(between + variance + 1.0 / float(weight.sum()))
        found.append((vehicle, chance((own - center) / std, others.size - 1)))
    return found


def _odd_ones(scale: Scale, series: _Series, odd: BoolArray, p: FloatArray) -> tuple[OddFlight, ...]:
    found = []
    for k in np.flatnonzero(odd):
        around = [j for j in (k - 2, k - 1, k + 1, k + 2) if 0 <= j < series.y.size and not odd[j]]
        expected = scale.back(float(np.mean(series.y[around])) if around else float(np.median(series.y)))
        value = scale.quantity(float(series.y[k]), float(series.s[k]), series.rows[k].unit)
        found.append(OddFlight(flight=int(k) + 1, value=value, expected=expected, probability=float(p[k])))
    return tuple(found)


def _differences(parameters: Mapping[Name, _Parameter], groups: Mapping[str, str]) -> tuple[Difference, ...]:
    """Differences of each group from the first by name."""
    found: list[dict[str, Any]] = []
    for name, of in parameters.items():
        rows = [
            (k, row, s) for k, series in enumerate(of.many) for row, s in zip(series.rows, series.random, strict=True)
        ]
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
    chosen = discoveries([difference["probability"] for difference in found])
    return tuple(
        Difference(**difference, found=bool(is_found)) for difference, is_found in zip(found, chosen, strict=True)
    )


_POWERS = ("L_roll", "M_pitch", "N_yaw", "Z_thrust", "thrust_slope", "thrust_full")
_INERTIAS = ("I_xx", "I_yy", "I_zz")
_LAGS = ("T_motor", "tau_roll", "tau_pitch", "tau_yaw")

_ALIKE = 0.05
"""Ratios of control derivatives that lie nearer changed alike, as thrust changes all of them."""


def _causes(histories: Sequence[History], motors: Sequence[MotorChange] = ()) -> tuple[Cause, ...]:
    """Steps of one vehicle at one flight together, and the usual cause of such a pattern.

    Where the balance of the motors names one, its words stand for the outputs of the motors.
    """
    known = {(one.vehicle, one.log): one for one in motors}
    events: dict[tuple[str, str], list[tuple[History, Change]]] = defaultdict(list)
    for history in histories:
        for change in history.changes:
            events[history.vehicle, history.rows[change.at_flight - 1].log].append((history, change))
    found = []
    for one in motors:
        events.setdefault((one.vehicle, one.log), [])
    for (vehicle, log), many in sorted(events.items()):
        balance = known.get((vehicle, log))
        if balance is not None:
            many = [entry for entry in many if not entry[0].parameter.startswith("motors.")]
        named = [(words_of(history.model, quantity_of(history.parameter)), change) for history, change in many]
        words = ", ".join(
            f"{words} {_percents([change for name, change in named if name == words])}"
            for words in dict.fromkeys(name for name, _ in named)
        )
        number = min([change.at_flight for _, change in many] + ([balance.at_flight] if balance else []))
        usual = _usual(many)
        if balance is not None:
            words = ", ".join(part for part in (balance.change.words, words) if part)
            usual = "; ".join(part for part in (balance.change.usual, usual) if part)
        found.append(Cause(vehicle=vehicle, at_flight=number, log=log, words=words, usual=usual))
    return tuple(found)


def _percents(changes: Sequence[Change]) -> str:
    """The relative change of a quantity in one or several models, rounded to its error.

    Examples
    --------
    >>> before, after = Quantity.normal(2.0, 0.01, "s"), Quantity.normal(2.2, 0.01, "s")
    >>> _percents([Change(at_flight=3, before=before, after=after, probability=0.001)])
    '+10.0 %'
    """
    known = sorted((change for change in changes if math.isfinite(change.ratio)), key=lambda change: change.ratio)
    ends = dict.fromkeys(_percent(change) for change in known[:1] + known[-1:])
    return f"{' to '.join(ends)} %" if ends else "changed"


def _percent(change: Change) -> str:
    error = math.hypot(change.before.std / change.before.value, change.after.std / change.after.value)
    number, _ = error_columns(100.0 * (change.ratio - 1.0), 100.0 * abs(change.ratio) * error)
    return number if change.ratio < 1.0 else f"+{number}"


def _usual(many: Sequence[tuple[History, Change]]) -> str:
    powers = {history.parameter: change.ratio for history, change in many if history.parameter in _POWERS}
    lags = [history.parameter for history, change in many if history.parameter.startswith(_LAGS) and change.ratio > 1.0]
    inertias = [history.parameter for history, _ in many if history.parameter in _INERTIAS]
    causes = []
    thrust = [ratio for name, ratio in powers.items() if name in ("Z_thrust", "thrust_slope", "thrust_full")]
    turning = [ratio for name, ratio in powers.items() if name in ("L_roll", "M_pitch", "N_yaw")]
    if inertias or (turning and not thrust and len(turning) < 3 and max(turning) - min(turning) > _ALIKE):
        causes.append("a payload or another change of inertia")
    elif thrust or (turning and max(turning) - min(turning) <= _ALIKE):
        fell = min([*thrust, *turning]) < 1.0
        causes.append("worn or other propellers, motors, a sagging battery" if fell else "other propellers or motors")
    elif turning:
        causes.append("a payload, propellers or motors")
    if lags:
        causes.append("motors, ESCs or their settings")
    return "; ".join(causes)
