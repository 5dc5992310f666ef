r"""Gains within limits for every likely plant, by a grid of shapes where each limit bounds P in closed form.

For a shape :math:`(a, d, A)` of I/P, D/P and the angle gain a loop is linear in :math:`k = P`, :math:`L = k L_0`, and

- :math:`M_s \le M`: :math:`k^2 |L_0|^2 + 2 k \, \mathrm{Re} L_0 + 1 - M^{-2} \ge 0`; between its roots k is forbidden,
  above the frequency of the highest phase a bound from above, below it one from below, since an integral with too
  little gain is as bad as one with too much;
- a phase margin: :math:`k \le 1/|L_0|` where the phase falls through it, and :math:`k \ge 1/|L_0|` where it rises;
- a gain margin: :math:`k \le 1/(GM \, |L_0|)` at -180 degrees;
- room for the angle loop: :math:`\omega_c \ge 3 A`, :math:`k \ge 1/|L_0(3A)|` of the rate loop;
- noise of the command: :math:`k \, \|C_0\|` at most twice as large as flown.

Where I or D stays, its ratio to P moves with P, and L is no multiple of one loop any more: values of P are tried, each
a shape of its own, and the same bounds accept or refuse it.

Both loops count, the rate loop alone and the whole loop. The shape with the smallest attitude error under a disturbance
is proposed. The best on the most likely plant are checked on all draws; a bound counts by its quantile.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.trust import (
    COMMAND_NOISE,
    REFUSED_PEAK,
    REFUSED_QUANTILE,
    ROBUSTNESS,
    SAFE_PEAK,
    SAFE_PHASE_MARGIN_DEG,
)
from rotorid.models.controller import RateController
from rotorid.tuning.kinds import KINDS
from rotorid.tuning.loops import (
    AttitudeFigures,
    ControllerParts,
    Gains,
    LoopFigures,
    attitude_figures,
    first_counted,
    frequency_grid,
    loop_figures,
    loop_phases,
)
from rotorid.tuning.plant import UncertainPlant
from rotorid.typing import ComplexArray, FloatArray, LoopName

QUANTILE = 0.05
"""Share of the draws that may miss a limit."""

_AS_GOOD = 1.01
"""Attitude error relative to the best gains, up to which the simplest gains are proposed."""

_KEPT_SHAPES = 60
_ROOM = 1.3
_MOST_UP, _MOST_DOWN = 2.0, 0.4

_GOAL_UP = 16.0
"""Largest factor between flown gains and the goal of several flights: four doublings."""

_MOST = 0.5
"""Share of the draws on which flown gains must break a limit that is fine."""

_CALMER = 0.1
"""Share of an integral that no longer makes a loop oscillate."""

_QUIET = 0.01
"""Noise of a command, over its range, that does not matter."""

_WORTH = 0.97
"""Attitude error relative to the flown gains below which a proposal is worth a flight, if those keep the limits."""

_AT_CAP = 0.99
"""Share of a step from which it counts as reached: gains are rounded."""

_ROBUSTNESS = ((1.45, "soft"), (1.75, "recommended"), (2.1, "firm"))
_LITTLE_RESERVE = "little reserve, like a firmware's AutoTune"

_SOFTER = "angle P is lowered further than usual, because P cannot grow enough in one flight"
_NAMES = {"A": "angle P"}
"""What a pilot calls a gain, where not by its letter."""
_SHRINK, _STEPS_DOWN = 0.97, 12
_PROPORTIONALS = 24
"""Values of P that are tried where I or D stays."""

_EXACT = 1e-9

_NEVER = 1e12
"""Least factor of a loop that stays outside its limits with any factor."""

_ALIKE = 1.05
"""Ratio of two sensitivity peaks up to which neither is worse."""
_SOFT_ANGLES = np.array([0.3, 0.5])

_SOFT_ANGLES_DOWN = (0.3, 0.2, 0.1)
"""For a yaw whose P cannot grow enough in one flight: a softer angle loop is slow, but safe."""


@dataclass(frozen=True, kw_only=True)
class Wishes(Immutable):
    """Limits of a loop, and how far its gains may change.

    Parameters
    ----------
    sensitivity_peak
        Largest M_s of the rate loop and of the whole one.
    phase_margin_rad
        Least phase margin of the rate loop.
    gain_margin
        Least gain margin of the rate loop.
    noise
        Largest noise of the command, relative to the flown gains.
    keep
        Gains that are not changed: of ``P``, ``I``, ``D``, ``A``.
    most_up
        How much P, D and A may grow in one flight.
    most_down
        How far P may fall in one flight, as a share of the flown one.
    angle_down
        How far A may fall in one flight, likewise.
    gain_range
        Least and largest gain of the plant relative to hover, over the flown throttle.
    ranges
        Lowest and highest value of a gain that the firmware takes, by its name.
    angle_1_s
        The angle gain to fly, where another axis shares it; ``None`` where it is free.
    angle_room
        Least crossover of the inner loop over the angle gain.
    """

    sensitivity_peak: float = ROBUSTNESS
    phase_margin_rad: float = float(np.radians(45.0))
    gain_margin: float = 2.0
    noise: float = COMMAND_NOISE
    keep: tuple[str, ...] = ()
    most_up: float = _MOST_UP
    most_down: float = _MOST_DOWN
    angle_down: float = _MOST_DOWN
    gain_range: tuple[float, float] = (1.0, 1.0)
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    angle_1_s: float | None = None
    angle_room: float = KINDS["roll"].angle_room

    def __post_init__(self) -> None:
        self._set(keep=tuple(self.keep), gain_range=tuple(self.gain_range), ranges=self.ranges)


def robustness_in_words(sensitivity_peak: float) -> str:
    r"""The reserve of a loop with a largest sensitivity peak, for people.

    .. math:: \text{gain margin} \ge \frac{M}{M - 1}, \qquad \text{phase margin} \ge 2 \arcsin \frac{1}{2 M}

    Parameters
    ----------
    sensitivity_peak
        :math:`M`, above one.

    Examples
    --------
    >>> robustness_in_words(1.7)
    'M_s up to 1.7 (recommended): stable if the gain grows 2.4 times or the phase drops 34°'
    """
    kind = next((words for most, words in _ROBUSTNESS if sensitivity_peak <= most), _LITTLE_RESERVE)
    gain = sensitivity_peak / (sensitivity_peak - 1.0)
    phase = np.degrees(2.0 * np.arcsin(0.5 / sensitivity_peak))
    return (
        f"M_s up to {sensitivity_peak:g} ({kind}): stable if the gain grows {gain:.1f} times or the phase drops "
        f"{phase:.0f}°"
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Judged(Immutable):
    """Gains, and their effect on every draw.

    Parameters
    ----------
    gains
        The gains.
    rate, whole
        Figures of the rate loop alone, and with the angle loop, over the draws.
    attitude
        How the attitude follows its set-point, over the draws.
    attitude_rms
        Of an attitude under a moment, over the draws, in a unit of its own.
    noise
        Root mean square of the command by noise of the rate: of its range where the log shows the noise, in a unit of
        its own where it does not.
    """

    gains: Gains
    rate: LoopFigures
    whole: LoopFigures
    attitude: AttitudeFigures
    attitude_rms: FloatArray
    noise: float


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisProposal(Immutable):
    """Gains proposed for an axis, with the flown gains.

    Parameters
    ----------
    axis
        ``roll``, ``pitch`` or ``yaw``.
    controller
        As flown, with its filters.
    flown, proposed
        Both judged on all draws; the same where the flown gains stay.
    better
        Root mean square of the attitude under a moment, proposed over flown: its median.
    reasons
        Why the flown gains stay, or what limits the proposal.
    keeps_limits
        Whether any tried gains keep the limits; otherwise the flown gains are proposed.
    """

    axis: LoopName
    controller: RateController
    flown: Judged
    proposed: Judged
    better: float
    reasons: tuple[str, ...] = ()
    keeps_limits: bool = True

    @property
    def changed(self) -> bool:
        """Whether anything is proposed."""
        return self.proposed.gains != self.flown.gains


def propose(
    axis: LoopName,
    plant: UncertainPlant,
    controller: RateController,
    *,
    parts: ControllerParts | None = None,
    flown_parts: ControllerParts | None = None,
    ends: Sequence[ControllerParts] = (),
    wishes: Wishes | None = None,
) -> AxisProposal:
    """Gains for an axis that keep their limits on all likely plants.

    Parameters
    ----------
    axis
        Which one; yaw has no D and a slower integral, an outer loop has slower gains (:mod:`rotorid.tuning.kinds`).
    plant
        Rate by command, as it was logged.
    controller
        As flown.
    parts
        Transfer functions of its gains, with the filters to fly; without it, no filters.
    flown_parts
        The same with the filters as they were flown, where others are to be.
    ends
        The same at the ends of a D that changes in flight: the limits apply there too.
    wishes
        Limits.

    Examples
    --------
    >>> from rotorid.tuning.plant import uncertain_plant
    >>> def model(w):
    ...     return 113.1 / ((0.048j * w + 1.0) * (1j * w + 1.0)) * np.exp(-0.012j * w)
    >>> plant = uncertain_plant(model, None, band_rad_s=(1.0, 100.0), draws=20)
    >>> soft = RateController(proportional_s=0.08, integral=0.08, derivative_s2=0.001, angle_1_s=4.0,
    ...                       derivative_cutoff_hz=30.0, step_s=1.0 / 400.0, late_integral=True)
    >>> found = propose("roll", plant, soft)
    >>> found.changed, bool(found.better < 0.8), bool(np.quantile(found.proposed.whole.sensitivity_peak, 0.9) < 1.75)
    (True, True, True)
    """
    wishes = replace(wishes or Wishes(), angle_room=KINDS[axis].angle_room)
    if parts is None:
        omega = frequency_grid(controller)
        ones = np.ones(omega.size, dtype=np.complex128)
        parts = ControllerParts(controller=controller, omega_rad_s=omega, filters=ones, logged=ones)
    omega = parts.omega_rad_s
    drawn = plant.drawn(omega)
    flown = judged(flown_parts or parts, drawn, Gains.of(controller), from_rad_s=plant.known_from_rad_s)
    wishes = replace(wishes, angle_room=_angle_room(flown, wishes))
    reasons: list[str] = []
    plants = _Plants(nominal=plant.response(omega)[None], drawn=drawn, from_rad_s=plant.known_from_rad_s)
    best = _searched(axis, parts, plants, flown, wishes, reasons, ends)
    if best is None and axis == "yaw" and _broken_limit(flown, plant, wishes):
        for down in _SOFT_ANGLES_DOWN:
            softer, why = replace(wishes, angle_down=down), [_SOFTER]
            best = _searched(axis, parts, plants, flown, softer, why, ends)
            if best is not None:
                wishes, reasons = softer, why
                break
    if best is None:
        if hot := _broken_limit(flown, plant, wishes):
            lower = "I" if _swings_slowly(flown, flown_parts or parts, plants) else "P and D"
            reasons.append(f"today {hot}: lower {lower} by hand and fly again")
        return AxisProposal(
            axis=axis,
            controller=controller,
            flown=flown,
            proposed=flown,
            better=1.0,
            reasons=tuple(map(KINDS[axis].worded, reasons)),
            keeps_limits=False,
        )
    better = _over(best, flown)
    broken = _broken_limit(flown, plant, wishes)
    same = flown_parts is None and wishes.angle_1_s in (None, flown.gains.A)
    if better > _WORTH and not broken and same:
        reasons.append("no gains within the limits are clearly better")
        return AxisProposal(
            axis=axis,
            controller=controller,
            flown=flown,
            proposed=flown,
            better=1.0,
            reasons=tuple(map(KINDS[axis].worded, reasons)),
        )
    if broken:
        reasons.append(f"today {broken}")
    reasons += _bound_by(best.gains, flown.gains, wishes)
    return AxisProposal(
        axis=axis,
        controller=controller,
        flown=flown,
        proposed=best,
        better=better,
        reasons=tuple(map(KINDS[axis].worded, reasons)),
    )


def _angle_room(flown: Judged, wishes: Wishes) -> float:
    """Least crossover over A: of gains that flew with less, less where the firmware takes no A that is low enough.

    ArduPilot's yaw crosses over at 3 rad/s, and its A is 3 and more: M_s of the whole loop limits it.
    """
    lowest, crossover = wishes.ranges.get("A", (0.0, 0.0))[0], flown.rate.usual_crossover_rad_s
    if lowest <= 0.0 or flown.gains.A <= 0.0 or crossover >= wishes.angle_room * lowest:
        return wishes.angle_room
    return min(wishes.angle_room, crossover / flown.gains.A)


def steps_beyond(
    axis: LoopName,
    plant: UncertainPlant,
    first: AxisProposal,
    *,
    parts: ControllerParts,
    flown_parts: ControllerParts | None = None,
    ends: Sequence[ControllerParts] = (),
    wishes: Wishes,
) -> tuple[Judged, ...]:
    """Gains of the flights after the proposed one, predicted with the plant of today; the last is the goal.

    A gain may double in one flight, so that a proposal often ends at that and not at the limits of the loop. The goal
    keeps these limits and no others. Between both the gains of the second flight are looked for as those of the first
    were. None of it is to be flown before the flight in front of it was checked.

    Parameters
    ----------
    axis, plant, parts, flown_parts, ends, wishes
        As for :func:`propose`.

    Returns
    -------
    tuple of Judged
        Empty where no step ended the proposal, or nothing clearly better lies beyond; the goal alone where the second
        flight reaches it.
    """
    if not first.changed or not _capped(first.proposed.gains, first.flown.gains, wishes):
        return ()
    far = replace(wishes, most_up=_GOAL_UP, most_down=1.0 / _GOAL_UP, angle_down=1.0 / _GOAL_UP)
    given: dict[str, Any] = {"parts": parts, "ends": ends}
    goal = propose(axis, plant, first.controller, flown_parts=flown_parts, wishes=far, **given)
    if not goal.changed or _over(goal.proposed, first.proposed) > _WORTH:
        return ()
    if _within_a_step(goal.proposed.gains, first.proposed.gains, wishes):
        return (goal.proposed,)
    # Noise may grow over that of the first flight by the same factor, however many flights there are.
    quiet = replace(wishes, noise=wishes.noise * first.flown.noise / first.proposed.noise)
    second = propose(axis, plant, first.proposed.gains.on(first.controller), wishes=quiet, **given)
    return (second.proposed, goal.proposed) if second.changed else (goal.proposed,)


def flights_between(gains: Gains, other: Gains, wishes: Wishes) -> int:
    """Number of flights from one set of gains to another, each at most one step."""
    count = 0
    for name, before, after in _changing(gains, other):
        if after > before:
            count = max(count, math.ceil(math.log(after / before) / math.log(wishes.most_up) - _EXACT))
        elif name in ("P", "A"):
            down = wishes.most_down if name == "P" else wishes.angle_down
            count = max(count, math.ceil(math.log(after / before) / math.log(down) - _EXACT))
    return count


def _changing(gains: Gains, other: Gains) -> list[tuple[str, float, float]]:
    """Gains that one flight may change by one step only, in both sets."""
    both = [(name, getattr(gains, name), getattr(other, name)) for name in ("P", "D", "A")]
    return [(name, before, after) for name, before, after in both if before > 0.0 and after > 0.0]


def _within_a_step(gains: Gains, flown: Gains, wishes: Wishes) -> bool:
    return flights_between(flown, gains, wishes) <= 1


def _capped(gains: Gains, flown: Gains, wishes: Wishes) -> bool:
    """Whether the limit of one flight stopped a gain."""
    for name, before, after in _changing(flown, gains):
        down = {"P": wishes.most_down, "A": wishes.angle_down}.get(name, 0.0)
        if after >= _AT_CAP * wishes.most_up * before or after <= down * before / _AT_CAP:
            return True
    return False


def _over(scores: Judged, other: Judged) -> float:
    """Attitude error of one set of gains relative to another: the median over the draws."""
    return float(np.median(scores.attitude_rms / other.attitude_rms))


def _swings_slowly(flown: Judged, parts: ControllerParts, plants: _Plants) -> bool:
    """Whether too much integral makes a loop unstable: with less, it is stable."""
    calmer = judged(parts, plants.drawn, replace(flown.gains, I=_CALMER * flown.gains.I), from_rad_s=plants.from_rad_s)
    before, after = (float(np.mean(scores.rate.stable * scores.whole.stable)) for scores in (flown, calmer))
    return before < _MOST < after


def judged(parts: ControllerParts, plants: ComplexArray, gains: Gains, *, from_rad_s: float = 0.0) -> Judged:
    """Effect of gains on all plants, shape ``(draws, f)``; stability counts from a frequency on, as in loop_figures.

    Parameters
    ----------
    parts
        What each gain does.
    plants
        Rates by command on their frequencies.
    gains
        To judge.
    from_rad_s
        From where stability counts.
    """
    omega = parts.omega_rad_s
    rate, whole = plants * parts.rate(gains), plants * parts.whole(gains)
    return Judged(
        gains=gains,
        rate=loop_figures(omega, rate, from_rad_s=from_rad_s),
        whole=loop_figures(omega, whole, from_rad_s=from_rad_s),
        attitude=attitude_figures(omega, plants * parts.angle(gains) / (1.0 + whole)),
        attitude_rms=parts.attitude_rms(plants, whole),
        noise=parts.noise(gains),
    )


class _Plants(NamedTuple):
    """The most likely plant, ``(1, f)``, all draws, ``(draws, f)``, and from where their loops are counted."""

    nominal: ComplexArray
    drawn: ComplexArray
    from_rad_s: float


def _searched(
    axis: LoopName,
    parts: ControllerParts,
    plants: _Plants,
    flown: Judged,
    wishes: Wishes,
    reasons: list[str],
    ends: Sequence[ControllerParts],
) -> Judged | None:
    """The best gains of the grid that keep the limits on the draws; ``None``, with the reason, where none do."""
    ranked: list[tuple[float, _Shape]] = []
    nominal, drawn, start = plants.nominal, plants.drawn, first_counted(parts.omega_rad_s, plants.from_rad_s)
    kept = _kept(flown.gains, wishes)
    for _, alike in groupby(_shapes(axis, flown.gains, wishes), key=lambda shape: (shape.a, shape.d)):
        shapes = list(alike)
        for shape, limits in zip(shapes, _limits_of_loops(parts, nominal, start, shapes, wishes), strict=True):
            gains = _best_of(shape, parts, nominal, limits, flown, wishes, kept)
            if gains is None:
                continue
            rms = float(parts.attitude_rms(nominal, nominal * parts.whole(gains))[0])
            ranked.append((rms, shape))
    if not ranked:
        reasons.append("no gains that were tried keep the limits on the identified plant")
        return None
    ranked.sort(key=lambda item: item[0])
    found: list[tuple[float, Gains]] = []
    for _, shape in ranked[:_KEPT_SHAPES]:
        (limits,) = _limits_of_loops(parts, drawn, start, [shape], wishes)
        gains = _best_of(shape, parts, drawn, limits, flown, wishes, kept)
        if gains is None:
            continue
        over = float(np.median(parts.attitude_rms(drawn, drawn * parts.whole(gains))))
        found.append((over, gains))
    if not found:
        reasons.append(
            "no gains keep the limits on all likely vehicles: this flight does not show the vehicle well enough"
        )
        return None
    return _inside(parts, plants, _simplest(found, flown.gains), flown, wishes, reasons, ends)


def _simplest(found: Sequence[tuple[float, Gains]], flown: Gains) -> Gains:
    """Of gains that hold an attitude as well as the best, with its A, those of the least D, then the least changed.

    Where D or I hardly matters, the best of them is an accident of the draws.
    """
    least, best = min(found, key=lambda item: item[0])

    def change(gains: Gains) -> tuple[float, float]:
        pairs = [(value, getattr(flown, name)) for name, value in gains.as_dict().items() if name != "D"]
        return gains.D, sum(abs(math.log(now / before)) for now, before in pairs if now > 0.0 and before > 0.0)

    return min((gains for over, gains in found if over <= _AS_GOOD * least and gains.A == best.A), key=change)


class _Shape(NamedTuple):
    """Ratios I/P and D/P, the angle gain, and P where it is given."""

    a: float
    d: float
    A: float
    P: float | None = None


def _shapes(axis: LoopName, flown: Gains, wishes: Wishes) -> list[_Shape]:
    """Shapes to look at."""
    kind = KINDS[axis]
    integrals = kind.integrals
    # Without a D of its own an axis has no filter for it that anybody chose.
    derivatives = kind.derivatives if flown.D > 0.0 or kind.adds_derivative else np.zeros(1)
    angles = kind.angles if flown.A > 0.0 else np.zeros(1)
    if flown.A > 0.0 and wishes.angle_down < _MOST_DOWN:
        angles = np.concatenate([_SOFT_ANGLES, angles])
    kept = _kept(flown, wishes)
    if flown.A > 0.0 and "A" not in kept:
        angles = np.unique(np.clip(angles, *_limits("A", flown.A, wishes)))
    if "A" in kept:
        angles = np.array([kept["A"]])
    found = []
    for P in _proportionals(flown, kept, wishes):
        of_i, of_d = (
            [kept[name] / (P or 1.0)] if name in kept else free for name, free in (("I", integrals), ("D", derivatives))
        )
        found += [_Shape(float(a), float(d), float(A), P) for a in of_i for d in of_d for A in angles]
    return found


def _kept(flown: Gains, wishes: Wishes) -> dict[str, float]:
    """Gains that are not changed, and their values; a given angle gain is among them."""
    found = {
        name: value
        for name, value in flown.as_dict().items()
        if name in wishes.keep or _out_of_reach(name, value, wishes)
    }
    return found if wishes.angle_1_s is None else {**found, "A": wishes.angle_1_s}


def _out_of_reach(name: str, flown: float, wishes: Wishes) -> bool:
    """Whether one flight cannot bring a gain into the range of its firmware."""
    least, most = _limits(name, flown, wishes)
    return least > most


def _proportionals(flown: Gains, kept: Mapping[str, float], wishes: Wishes) -> list[float | None]:
    """Values of P to try; ``None`` where a loop is a multiple of P, so that its bounds give P."""
    if "P" not in kept and not any(kept.get(name, 0.0) > 0.0 for name in ("I", "D")):
        return [None]
    if flown.P <= 0.0:
        return []
    if "P" in kept:
        return [kept["P"]]
    least, most = _limits("P", flown.P, wishes)
    return [float(P) for P in np.unique([*np.geomspace(least, most, _PROPORTIONALS), np.clip(flown.P, least, most)])]


def _best_of(
    shape: _Shape,
    parts: ControllerParts,
    plants: ComplexArray,
    limits: _LoopLimits,
    flown: Judged,
    wishes: Wishes,
    kept: Mapping[str, float],
) -> Gains | None:
    """The gains of a shape with the largest P that holds on the plants, kept ones as they are; ``None`` where none."""
    k = _gain(parts, plants, limits, shape, flown, wishes, kept)
    if k is None:
        return None
    return Gains(**{"P": k, "I": shape.a * k, "D": shape.d * k, "A": shape.A, **kept})


def _limits(name: str, flown: float, wishes: Wishes) -> tuple[float, float]:
    """Least and largest value of a gain: the range of the firmware, and what one flight may change.

    The least is above the largest where the two exclude each other.
    """
    low, high = wishes.ranges.get(name, (0.0, np.inf))
    if flown > 0.0 and name != "I":
        high = min(high, wishes.most_up * flown)
        if name in ("P", "A"):
            low = max(low, (wishes.most_down if name == "P" else wishes.angle_down) * flown)
    return low, high


class _LoopLimits(NamedTuple):
    """Least and largest P by the limits of the loops, each of shape ``(draws,)``.

    Of a P of one, the command by the rate, shape ``(f,)``, and its noise: shapes of equal I/P and D/P share them.
    """

    low: FloatArray
    high: FloatArray
    rate: ComplexArray
    noise: float


def _limits_of_loops(
    parts: ControllerParts, plants: ComplexArray, start: int, shapes: Sequence[_Shape], wishes: Wishes
) -> list[_LoopLimits]:
    """Limits of P for shapes of equal I/P and D/P: they have one rate loop, whatever their angle gain."""
    units = [Gains(P=1.0, I=a, D=d, A=A) for a, d, A, _ in shapes]
    rate, noise = parts.rate(units[0]), parts.noise(units[0])
    low, high = _bounds(plants * rate, wishes, wishes.phase_margin_rad, start=start)
    # Most of the time of a search goes into calls for few numbers: one call for all angle gains.
    whole = np.concatenate([plants * parts.whole(unit) for unit in units])
    lows, highs = (side.reshape(len(shapes), -1) for side in _bounds(whole, wishes, None, start=start))
    return [
        _LoopLimits(np.maximum(low, below), np.minimum(high, above), rate, noise)
        for below, above in zip(lows, highs, strict=True)
    ]


def _gain(
    parts: ControllerParts,
    plants: ComplexArray,
    limits: _LoopLimits,
    shape: _Shape,
    flown: Judged,
    wishes: Wishes,
    kept: Mapping[str, float],
) -> float | None:
    """The largest P of a shape that keeps the limits on the plants; ``None`` where none does."""
    a, d, A, given = shape
    low, high, rate, noise = limits
    apart = np.zeros(len(plants))
    if A > 0.0:
        at = np.searchsorted(parts.omega_rad_s, wishes.angle_room * A)
        column = min(at, plants.shape[1] - 1)
        apart = 1.0 / np.abs(plants[:, column] * rate[column])
    if len(plants) > 1:
        k_low, k_high = float(np.quantile(low, 1.0 - QUANTILE)), float(np.quantile(high, QUANTILE))
        k_apart = float(np.quantile(apart, 1.0 - QUANTILE))
    else:
        k_low, k_high, k_apart = float(low[0]), float(high[0]), float(apart[0])
    # Room is for a battery that sags, against what would swing; that both loops are apart is no matter of safety.
    room = max(_ROOM, wishes.gain_range[1] / wishes.gain_range[0])
    if not k_high >= room * k_low:
        return None
    k_low = max(k_low, k_apart)
    k_low, k_high = k_low / wishes.gain_range[0], k_high / wishes.gain_range[1]
    least_noise = _QUIET if parts.shows_noise else 0.0
    k_high = min(k_high, max(wishes.noise * flown.noise, least_noise) / noise)
    for name, factor in (("P", 1.0), ("I", a), ("D", d)):
        least, most = _limits(name, getattr(flown.gains, name), wishes)
        if factor > 0.0 and name not in kept:
            k_high, k_low = min(k_high, most / factor), max(k_low, least / factor)
    if given is not None:
        return given if k_low * (1.0 - _EXACT) <= given <= k_high * (1.0 + _EXACT) else None
    return k_high if k_high >= k_low else None


@np.errstate(divide="ignore")  # a phase that falls through a level nowhere bounds nothing
def _bounds(
    loops: ComplexArray, wishes: Wishes, phase_margin_rad: float | None, *, start: int = 0
) -> tuple[FloatArray, FloatArray]:
    """Least and largest factor on loops for every limit, shapes ``(draws,)``; none, where no factor keeps them.

    From the frequency of index ``start`` on the phase has to rise above a limit at all.
    """
    real = loops.real
    square = real**2 + loops.imag**2
    size, phase = np.sqrt(square), loop_phases(loops, start)
    # Where speed modes below the band raise the phase above all others, every bound is one from above: I stays smaller.
    top, highest = np.argmax(phase, axis=1), phase[:, start:].max(axis=1)
    fast = np.arange(loops.shape[1])[None] >= top[:, None]
    # A search asks this a thousand times: what few points need is worked out for them alone, once per loop.
    under = real**2 - square * (1.0 - wishes.sensitivity_peak**-2)
    forbidden = (under > 0.0) & (real < 0.0)
    root, back, length = np.sqrt(under[forbidden]), -real[forbidden], square[forbidden]
    highs, lows = np.full(loops.shape, np.inf), np.zeros(loops.shape)
    highs[forbidden] = np.where(fast[forbidden], (back - root) / length, np.inf)
    lows[forbidden] = np.where(fast[forbidden], 0.0, (back + root) / length)
    high, low = highs.min(axis=1), lows.max(axis=1)
    levels = [(-np.pi, wishes.gain_margin)]
    if phase_margin_rad is not None:
        levels.append((phase_margin_rad - np.pi, 1.0))
    for level, factor in levels:
        above, below = phase > level, phase <= level
        falls = fast[:, 1:] & above[:, :-1] & below[:, 1:]
        largest = np.max(np.where(falls, size[:, :-1], 0.0), axis=1)
        high = np.minimum(high, 1.0 / (factor * largest))
        rises = ~fast[:, :-1] & below[:, :-1] & above[:, 1:]
        smallest = np.min(np.where(rises, size[:, 1:], np.inf), axis=1)
        low = np.maximum(low, factor / smallest)
        # A phase that never rises above a level falls through it nowhere, and no factor brings a margin.
        low, high = np.where(highest <= level, _NEVER, low), np.where(highest <= level, 0.0, high)
    return low, high


def _inside(
    parts: ControllerParts,
    plants: _Plants,
    gains: Gains,
    flown: Judged,
    wishes: Wishes,
    reasons: list[str],
    ends: Sequence[ControllerParts],
) -> Judged | None:
    """Gains that keep the limits with everything exact, feed-forward included: a little smaller if necessary."""
    for _ in range(_STEPS_DOWN):
        found = judged(parts, plants.drawn, gains, from_rad_s=plants.from_rad_s)
        moved = [
            judged(end, plants.drawn, replace(gains, D=end.controller.derivative_s2), from_rad_s=plants.from_rad_s)
            for end in ends
        ]
        broken = next((words for scores in (found, *moved) if (words := _broken(scores, wishes))), "")
        if not broken:
            return found
        gains = _step_down(gains, flown.gains, wishes)
    reasons.append(f"{broken} with every set of gains that was tried")
    return None


def _step_down(gains: Gains, flown: Gains, wishes: Wishes) -> Gains:
    """All changeable gains one step lower, within their ranges."""
    found, kept = {}, _kept(flown, wishes)
    for name, value in gains.as_dict().items():
        least = min(value, _limits(name, getattr(flown, name), wishes)[0])
        found[name] = max(_SHRINK * value, least)
    return Gains(**{**found, **kept})


def _limits_of_flown(wishes: Wishes, sensitivity_peak: float, phase_margin_deg: float) -> Wishes:
    """Limits of gains that fly already; of another robustness than the usual one they move by the same share."""
    usual = Wishes()
    return replace(
        wishes,
        sensitivity_peak=wishes.sensitivity_peak * sensitivity_peak / usual.sensitivity_peak,
        phase_margin_rad=wishes.phase_margin_rad * math.radians(phase_margin_deg) / usual.phase_margin_rad,
    )


def _broken_limit(flown: Judged, plant: UncertainPlant, wishes: Wishes) -> str:
    """The limit that the flown gains break, in words; empty where they keep all.

    As every command answers it: they are not fine where half of the plants say so, and not to be flown where a tenth
    of them says that. Where the plant was not measured at their crossover, its draws are wide, and the tenth does not
    count, or every badly measured loop would be slowed down.
    """
    likely = _broken(flown, _limits_of_flown(wishes, SAFE_PEAK, SAFE_PHASE_MARGIN_DEG), share=_MOST)
    if likely or flown.rate.usual_crossover_rad_s > plant.band_rad_s[1]:
        return likely
    return _broken(flown, _limits_of_flown(wishes, REFUSED_PEAK, 0.0), share=1.0 - REFUSED_QUANTILE)


def newly_broken_limit(flown: Judged, then: Judged, plant: UncertainPlant, wishes: Wishes) -> str:
    """The limit that the same gains newly break with other filters, in words; empty where there is none.

    Parameters
    ----------
    flown, then
        Gains with the filters as flown, and with the others.
    plant
        Of which both were judged.
    """
    limit = _broken_limit(then, plant, wishes)
    if not limit or not _broken_limit(flown, plant, wishes):
        return limit
    before, after = (_worst_peak(scores) for scores in (flown, then))
    steady = np.mean(then.whole.stable * then.rate.stable) >= np.mean(flown.whole.stable * flown.rate.stable)
    return "" if steady and after <= _ALIKE * before else limit


def _worst_peak(scores: Judged) -> float:
    return float(np.median(np.maximum(scores.rate.sensitivity_peak, scores.whole.sensitivity_peak)))


def _broken(scores: Judged, wishes: Wishes, *, share: float = 2.0 * QUANTILE) -> str:
    """The limit that gains break on more than a share of the plants, in words; empty where none."""
    worst = {
        "the loop may be unstable": np.maximum(1.0 - scores.rate.stable, 1.0 - scores.whole.stable) > 0.0,
        f"M_s of the rate loop exceeds {wishes.sensitivity_peak:g}": scores.rate.sensitivity_peak
        > wishes.sensitivity_peak,
        (f"M_s with the angle loop exceeds {wishes.sensitivity_peak:g}"): scores.whole.sensitivity_peak
        > wishes.sensitivity_peak,
        f"the phase margin is below {np.degrees(wishes.phase_margin_rad):.0f}°": scores.rate.phase_margin_rad
        < wishes.phase_margin_rad,
    }
    return next((name for name, found in worst.items() if float(np.mean(found)) > share), "")


def _bound_by(gains: Gains, flown: Gains, wishes: Wishes) -> Sequence[str]:
    """The caps of one flight that limit the gains, in words."""
    found = _kept_outside(flown, wishes)
    for name in ("P", "D", "A"):
        before, now = getattr(flown, name), getattr(gains, name)
        if before > 0.0 and now >= _AT_CAP * wishes.most_up * before:
            found.append(f"{_NAMES.get(name, name)} {_growth(wishes.most_up)}, the most allowed in one flight")
    return found


def _growth(most_up: float) -> str:
    """How much a gain grows, in words.

    Examples
    --------
    >>> _growth(2.0), _growth(1.5)
    ('doubles', 'grows 1.5 times')
    """
    return "doubles" if most_up == 2.0 else f"grows {most_up:g} times"


def _kept_outside(flown: Gains, wishes: Wishes) -> list[str]:
    """Gains that one flight cannot bring into the range of the firmware, in words."""
    found = []
    for name, value in flown.as_dict().items():
        if name not in wishes.keep and _out_of_reach(name, value, wishes):
            least, most = wishes.ranges[name]
            words = f"{least:.4g} to {most:.4g}"
            found.append(
                f"{_NAMES.get(name, name)} stays at {value:.4g}: too far from the firmware's range ({words}) for one "
                "flight"
            )
    return found
