"""Filters against the noise of a flight: all that the firmware offers, what each saves and costs, and which to fly.

Of every group (a notch that follows the motors, a fixed notch, the low-passes of gyro and D) one change at most is
tried. Noise is that of the commands of all axes through P and D (:mod:`rotorid.flights.filter_effects`), phase that at
the crossover of each axis. Filters are changed for a reason only: where noise reaches the motors, or where a quiet
vehicle has little margin. A set is proposed if the flown gains keep their verdict with it on all likely plants.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from rotorid.autopilots.notches import FilterChange, FilterGroup
from rotorid.autopilots.registry import autopilot_of
from rotorid.data.axes import RATE_OF
from rotorid.data.base import Immutable
from rotorid.data.quantity import Quantity
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.flights.controllers import LogControllers, controller_as_logged, controllers_of
from rotorid.flights.filter_effects import (
    command_powers,
    filtered_density,
    phase_cost,
    ratio_at_slowest,
    saved,
    with_parameters,
)
from rotorid.flights.gyro_noise import GyroNoise
from rotorid.models.autopilots.settings import AxisController
from rotorid.models.controller import RateController
from rotorid.tuning.judging import WORST_FIRST, LoopVerdict, loop_verdict, situations_of
from rotorid.tuning.loops import frequency_grid
from rotorid.tuning.plant import UncertainPlant
from rotorid.typing import Axis, ComplexArray, FloatArray

Need: TypeAlias = Literal["noise", "margin", ""]
"""Why filters are to change: noise reaches the motors, or little margin is left; empty where neither is so."""

NOISY = 0.01
"""Root mean square of a command by noise, over its range, from which less of it is worth a change of filters."""

_QUIET = 0.5
"""Part of it below which a vehicle can afford more."""

MOST_COST_DEG = 3.0
"""Most phase that less noise may cost at the crossover of an axis."""

_LEAST_SAVED = 10.0
_LEAST_GAINED_DEG = 3.0
"""Saved noise in per cent, and gained phase, below which filters are not worth a flight."""

_AS_GOOD = 3.0
"""Difference in per cent of noise that another change of filters has to be worth."""

_MOST_TRIED = 8
"""Sets that are judged on all plants before none is proposed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownLoop(Immutable):
    """A loop around which filters are changed.

    Parameters
    ----------
    plant
        With its draws.
    source
        Where the rate of the plant stands in the log.
    crossover_rad_s
        Of the rate loop as flown.
    """

    plant: UncertainPlant
    source: str
    crossover_rad_s: float


@dataclass(frozen=True, kw_only=True, eq=False)
class FilterSet(Immutable):
    """Filters that could be flown with the flown gains.

    Parameters
    ----------
    changes
        By group; none for the flown filters.
    powers
        Mean square of the command of each axis in each part of the flight, shape ``(parts,)``.
    costs_deg
        Phase at the crossover of each axis whose loop is known; negative where it is gained.
    """

    changes: tuple[FilterChange, ...]
    powers: Mapping[Axis, FloatArray]
    costs_deg: Mapping[Axis, Quantity]

    def __post_init__(self) -> None:
        self._set(changes=tuple(self.changes), powers=self.powers, costs_deg=self.costs_deg)

    @property
    def values(self) -> dict[str, float]:
        """Parameters that change, by the names of the log."""
        return {name: value for change in self.changes for name, value in change.values.items()}

    @property
    def power(self) -> FloatArray:
        """Mean square of all commands together, in each part, shape ``(parts,)``."""
        return np.asarray(np.sum(list(self.powers.values()), axis=0))

    @property
    def rms(self) -> float:
        """Largest root mean square of a command, over its range."""
        return max(math.sqrt(float(power.mean())) for power in self.powers.values())

    @property
    def cost_deg(self) -> float:
        """Largest cost of an axis, with the upper end of its interval; zero where no loop is known."""
        return max((cost.upper for cost in self.costs_deg.values()), default=0.0)

    def saves_over(self, flown: FilterSet) -> Quantity:
        """Noise at the motors that it saves over others, per cent of the root mean square."""
        return saved(flown.power, self.power)


def filter_sets(record: FlightRecord, noise: GyroNoise, loops: Mapping[Axis, KnownLoop]) -> list[FilterSet]:
    """All filters that the firmware offers against the noise of a flight, the flown ones first.

    Parameters
    ----------
    record
        The log.
    noise
        Of its gyro.
    loops
        Axes whose loop is known.

    Raises
    ------
    InsufficientDataError
        The gains of no axis are known.
    """
    flown = controllers_of(record)
    axes = [axis for axis in RATE_OF if flown.axis(axis) is not None]
    if not axes:
        why, remedy = flown.unknown_gains("roll")
        raise InsufficientDataError(why[:1].lower() + why[1:], remedy=remedy)
    offered = autopilot_of(record).log.filter_changes(record, noise.lines)
    groups: dict[FilterGroup, list[FilterChange | None]] = {}
    for change in offered:
        groups.setdefault(change.group, [None]).append(change)
    of_d = groups.pop("D low-pass", [None])
    found = []
    for behind in itertools.product(*groups.values()):
        gyro = tuple(change for change in behind if change is not None)
        for last in of_d:
            changes = (*gyro, *([last] if last is not None else []))
            found.append((gyro, changes))
    return list(_scored(record, noise, loops, axes, flown, found))


def _scored(
    record: FlightRecord,
    noise: GyroNoise,
    loops: Mapping[Axis, KnownLoop],
    axes: Sequence[Axis],
    flown: LogControllers,
    sets: Iterable[tuple[tuple[FilterChange, ...], tuple[FilterChange, ...]]],
) -> Iterator[FilterSet]:
    """Sets with what they do; one that the firmware cannot fly, or that cannot be judged, is left out."""
    behind: dict[tuple[tuple[str, float], ...], Mapping[str, FloatArray]] = {}
    for gyro, changes in sets:
        values = {name: value for change in changes for name, value in change.values.items()}
        key = tuple((name, value) for change in gyro for name, value in change.values.items())
        then = with_parameters(record, values)
        controllers = flown.with_parameters(then.parameters)
        try:
            if key not in behind:
                behind[key] = filtered_density(record, then, noise)
            own = {axis: controllers.axis(axis) for axis in axes}
            powers = {
                axis: command_powers(found.controller, noise, behind[key][RATE_OF[axis]])
                for axis, found in own.items()
                if found is not None
            }
            costs = {
                axis: phase_cost(record, then, noise, axis, loop.crossover_rad_s, flown=flown)
                for axis, loop in loops.items()
            }
        except (UsageError, InsufficientDataError):
            continue
        yield FilterSet(changes=changes, powers=powers, costs_deg=costs)


@dataclass(frozen=True, kw_only=True, eq=False)
class FilterPart(Immutable):
    """One change of a proposal: parameters with flown (``None`` where the log has none) and proposed values.

    ``costs_deg`` and ``saves_percent`` are what the set would cost less, and save less, without it.
    """

    group: FilterGroup
    values: Mapping[str, tuple[float | None, float]]
    costs_deg: Quantity
    saves_percent: Quantity

    def __post_init__(self) -> None:
        self._set(values=self.values)


@dataclass(frozen=True, kw_only=True, eq=False)
class FilterProposal(Immutable):
    """Filters to fly, or that the flown ones stay.

    Parameters
    ----------
    need
        Why filters would change.
    flown, proposed
        Both; the same where the flown ones stay.
    offered
        Parameters that were looked at, with their flown values.
    parts
        What changes.
    lines
        Lines of the noise, in words that name their frequency.
    rms
        Noise of the loudest command as flown, over its range.
    saves_percent
        Noise at the motors that is saved, of all axes together.
    verdicts
        Verdict on the flown gains with the proposed filters, by axis.
    unchecked
        Axes whose loop is not known, which the filters reach all the same.
    refused
        Why a set that would save more is not proposed; empty where there is none.
    unseen
        Why it is not known where notches that fly were; empty where it is, or none flies.
    """

    need: Need
    flown: FilterSet
    proposed: FilterSet
    offered: Mapping[str, float]
    parts: tuple[FilterPart, ...]
    rms: float
    saves_percent: Quantity
    verdicts: Mapping[Axis, LoopVerdict]
    unchecked: tuple[Axis, ...] = ()
    refused: str = ""
    unseen: str = ""

    def __post_init__(self) -> None:
        self._set(offered=self.offered, parts=tuple(self.parts), verdicts=self.verdicts)

    @property
    def changed(self) -> bool:
        """Whether any filter is to change."""
        return bool(self.parts)


def propose_filters(record: FlightRecord, noise: GyroNoise, loops: Mapping[Axis, KnownLoop]) -> FilterProposal:
    """Filters to fly with the flown gains, or the flown ones.

    Parameters
    ----------
    record, noise, loops
        As for :func:`filter_sets`; of roll and pitch one at least.

    Raises
    ------
    InsufficientDataError
        Neither the loop of roll nor that of pitch is known, or one of them where filters are to change, or no gains.
    """
    if not {"roll", "pitch"} & loops.keys():
        raise InsufficientDataError(
            "the loops of roll and pitch were not measured, so the phase that a filter may cost is not known",
            remedy="move the roll and pitch sticks for 30 s",
        )
    sets = filter_sets(record, noise, loops)
    flown = sets[0]
    before = {axis: verdict_with(record, axis, loop, {}) for axis, loop in loops.items()}
    weak = any(found.verdict in ("gently", "do_not_fly") for found in before.values())
    need: Need = "noise" if flown.rms > NOISY else "margin" if weak and flown.rms < _QUIET * NOISY else ""
    unknown = [axis for axis in ("roll", "pitch") if axis in flown.powers and axis not in loops]
    if need and unknown:
        raise InsufficientDataError(
            f"other filters would act on {unknown[0]} too, whose loop was not measured",
            remedy=f"move the {unknown[0]} stick for 30 s",
        )
    proposed, verdicts, refused = flown, before, ""
    for tried in _wanted(sets, need)[:_MOST_TRIED]:
        then = {axis: verdict_with(record, axis, loop, tried.values) for axis, loop in loops.items()}
        worse = [axis for axis, found in then.items() if _is_worse(before[axis], found)]
        if not worse:
            proposed, verdicts = tried, then
            break
        refused = refused or f"margins of {worse[0]} would become too small"
    return FilterProposal(
        need=need,
        flown=flown,
        proposed=proposed,
        offered=_offered(record, sets),
        parts=tuple(_parts(record, noise, loops, proposed)),
        rms=flown.rms,
        saves_percent=proposed.saves_over(flown),
        verdicts=verdicts,
        unchecked=tuple(axis for axis in RATE_OF if axis not in loops and axis in flown.powers),
        refused=refused,
        unseen=autopilot_of(record).log.moving_notches(record, noise.motion).unknown,
    )


def _offered(record: FlightRecord, sets: Sequence[FilterSet]) -> dict[str, float]:
    names = {name: record.parameters[name] for one in sets for name in one.values if name in record.parameters}
    return dict(sorted(names.items()))


def _wanted(sets: Sequence[FilterSet], need: Need) -> list[FilterSet]:
    """Sets that answer a need, the best first; of equally good ones that with the fewest changes."""
    flown, *others = sets
    if need == "noise":
        fit = [one for one in others if one.cost_deg <= MOST_COST_DEG]
        scored = [(one.saves_over(flown), one) for one in fit]
        worth = [(found.value, one) for found, one in scored if found.lower > 0.0 and found.value >= _LEAST_SAVED]
        return _simplest_first([(value / _AS_GOOD, one) for value, one in worth])
    if need == "margin":
        fit = [one for one in others if one.rms <= _QUIET * NOISY]
        gained = [(-one.cost_deg, one) for one in fit]
        return _simplest_first([(value, one) for value, one in gained if value >= _LEAST_GAINED_DEG])
    return []


def _simplest_first(scored: Sequence[tuple[float, FilterSet]]) -> list[FilterSet]:
    """Sets by their score, where each further change has to be worth one."""
    return [one for _, one in sorted(scored, key=lambda pair: (-(pair[0] - len(pair[1].changes)), pair[1].cost_deg))]


def _is_worse(before: LoopVerdict, then: LoopVerdict) -> bool:
    """Whether a verdict is worse, or as bad with a larger peak."""
    ranks = [WORST_FIRST.index(found.verdict) for found in (before, then)]
    return ranks[1] < ranks[0] or (then.verdict != "fly" and then.refused_peak > 1.02 * before.refused_peak)


def verdict_with(record: FlightRecord, axis: Axis, loop: KnownLoop, values: Mapping[str, float]) -> LoopVerdict:
    """The verdict on the flown gains with other filters, on all likely plants.

    Raises
    ------
    InsufficientDataError
        A notch that changes follows something that is not in the log.
    """
    then = with_parameters(record, values)
    flown = controllers_of(record)
    known = flown.with_parameters(then.parameters).axis(axis)
    before = flown.axis(axis)
    if known is None or before is None:
        why, remedy = flown.unknown_gains(axis)
        raise InsufficientDataError(why, remedy=remedy)
    omega = frequency_grid(before.controller)
    moved = ratio_at_slowest(record, then, omega)
    made = {name: _response(record, loop.source, one, omega, moved) for name, one in _ends(known).items()}
    return loop_verdict(loop.plant, situations_of(loop.plant, omega, made))


def _ends(known: AxisController) -> dict[str, RateController]:
    return dict(known.ends) or {"": known.controller}


def _response(
    record: FlightRecord, source: str, controller: RateController, omega: FloatArray, moved: ComplexArray
) -> tuple[ComplexArray, ComplexArray]:
    """Command by the logged rate without and with the angle loop, whose attitude passes no filter of the gyro."""
    acting = controller_as_logged(record, controller, source=source)
    rate = acting.rate_loop.response(omega)
    return np.asarray(rate * moved), np.asarray(acting.response(omega) - rate + rate * moved)


def _parts(
    record: FlightRecord, noise: GyroNoise, loops: Mapping[Axis, KnownLoop], proposed: FilterSet
) -> Iterator[FilterPart]:
    """What each change of a set does: the set with and without it."""
    flown = controllers_of(record)
    for change in proposed.changes:
        rest = tuple(one for one in proposed.changes if one is not change)
        gyro = tuple(one for one in rest if one.group != "D low-pass")
        (without,) = _scored(record, noise, loops, list(proposed.powers), flown, [(gyro, rest)])
        worst = max(loops, key=lambda axis: proposed.costs_deg[axis].value)
        cost, left = proposed.costs_deg[worst], without.costs_deg[worst]
        yield FilterPart(
            group=change.group,
            values={name: (record.parameters.get(name), value) for name, value in change.values.items()},
            costs_deg=replace(
                cost,
                value=cost.value - left.value,
                lower=min(cost.lower - left.lower, cost.value - left.value),
                upper=max(cost.upper - left.upper, cost.value - left.value),
            ),
            saves_percent=saved(without.power, proposed.power),
        )
