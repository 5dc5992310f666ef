r"""Whether the motors of a log are numbered and turn as a layout says: from the flight itself.

Angular accelerations follow the motors by the places of the rotors. With :math:`x_i` the thrust of motor :math:`i`
(squared speed, or output), lagged, and all of it in the band of torques, one regression gives how much each motor turns
the vehicle about each axis:

.. math:: \dot\omega = B x, \qquad B_{roll} \propto (-y_i), \quad B_{pitch} \propto (x_i), \quad B_{yaw} \propto (s_i)

Each order of the rotors of the layout predicts other proportions :math:`s`. Its misfit is

.. math:: \chi^2 = \sum_{roll, pitch} \min_{g \ge 0} (B - g s)^T V^{-1} (B - g s), \qquad
          V = V_{blocks} + (\epsilon\, g_0)^2 I

with the covariance of the regression from blocks of one second (residuals are colored) and what rotors and lags differ
by in any case, :math:`\epsilon`. An order is named only where the second best is far behind, the best fits, and the
motors explain both axes; directions follow from the sign of :math:`g` in yaw. Otherwise the flight does not have enough
data, and what is missing is named.

Assumes that the vehicle is moved by its motors: a controller that only answers to gusts turns the signs around, which
is why axes that the motors do not explain decide nothing.

References
----------
White, *A heteroskedasticity-consistent covariance matrix estimator and a direct test for heteroskedasticity*,
Econometrica 48 (1980): the covariance by blocks.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import permutations
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np

from rotorid.autopilots.advice import logging_advice, slow_motor_advice
from rotorid.data.axes import RATES
from rotorid.data.base import Immutable, cached_by_value
from rotorid.data.display import listed
from rotorid.data.findings import Finding, refusal, remark, warn
from rotorid.data.record import LOWEST_RATE_HZ, FlightRecord, Intervals
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.flights.motor_band import BLOCK_S, LEAST_S, fastest_motors, flights_off_ground, motor_bands
from rotorid.models.autopilots.layouts import layout_of
from rotorid.models.rotors import SPINS, RotorLayout, layout_names, library_layout
from rotorid.signal.motors import MotorHistory
from rotorid.typing import FloatArray, IntArray

Verdict: TypeAlias = Literal["fits", "wrong", "not enough data"]

LEAST_CORRELATION = 0.6
"""Of the regression with the accelerations of roll and pitch; where motors explain less, gusts and noise decide.

At 0.5, windows of a soft controller in noise named a wrong order when all windows moved by a second.
"""

LEAST_GAP = 10.0
"""Misfit by which the second best order must exceed the best, which is e^5 in likelihood."""

_LEAST_RATIO = 3.0
"""The same as a ratio: where nothing fits well, a gap says little."""

LARGEST_MISFIT = 25.0
"""Of a quadrotor's best order: six degrees of freedom exceed it once in three thousand flights."""

WINDOW_S = 10.0
"""Windows that are asked where the whole flight does not decide."""

_LEAST_WINDOWS = 2

_YAW_CORRELATION, _YAW_SIGNIFICANCE = 0.3, 3.5
"""Of the regression in yaw, and errors by which its sign must differ from zero."""

_SCATTER = 0.2
"""What rotors of one vehicle and the shape of their lag differ by, as a part of the largest gain."""

_LAGS_S = (0.0, 0.02, 0.05, 0.08)
_EARLY_S = -0.02
"""Motors that explain the motion this long before they act follow it: a controller that answers to noise or gusts."""

_STILL = 1e-4
"""Smallest variance of a combination of motors over the largest, below which it counts as still."""

_NOTHING = 1e-12
"""Variance of motors about their mean output that is rounding."""

_FOUR, _MOST_RULED_OUT = 4, 0.9
"""Share of the orders of more than four rotors that must be far behind the best."""

_MOST_ROTORS = 8
"""Orders of more rotors are too many to try."""

_ALIKE = 1e-3
_SAME_ANGLE = np.radians(20.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class RotorOrder(Immutable):
    r"""Answer whether motors are where, and turn as, a layout says.

    Parameters
    ----------
    layout
        The layout that was asked about.
    verdict
        Of the order of the motors.
    directions
        Of the directions of rotation; judged only with a known order.
    fitting
        The layout that fits; that of the question where it does, ``None`` where none is known.
    why, remedy
        What is missing where an order or a direction cannot be decided, and what to change.
    misfit, best, second
        :math:`\chi^2` of the layout, of the best order and of the next.
    correlation
        Axis to the correlation of the regression with its acceleration.
    duration_s
        Seconds that were used.
    """

    layout: RotorLayout
    verdict: Verdict = "not enough data"
    directions: Verdict = "not enough data"
    fitting: RotorLayout | None = None
    why: str = ""
    remedy: str = ""
    misfit: float = float("nan")
    best: float = float("nan")
    second: float = float("nan")
    correlation: Mapping[str, float] = field(default_factory=dict)
    duration_s: float = 0.0

    def __post_init__(self) -> None:
        self._set(correlation=self.correlation)

    @property
    def numbers(self) -> dict[str, float]:
        """The statistics, for findings; those that were measured."""
        numbers = {"misfit": self.misfit, "best": self.best, "second": self.second, "duration_s": self.duration_s}
        numbers |= {f"correlation_{axis}": value for axis, value in self.correlation.items()}
        return {name: value for name, value in numbers.items() if np.isfinite(value)}

    @property
    def contradicted(self) -> bool:
        """Whether the flight shows another order or other directions."""
        return "wrong" in (self.verdict, self.directions)

    @property
    def to_type(self) -> str:
        """What names the layout that fits; empty where it is the one that was asked about, or none is known."""
        return "" if self.fitting is None or not self.contradicted else _to_type(self.fitting, self.directions)

    def sentence(self) -> str:
        """The answer for a reader, with its statistic."""
        name = self.layout.name
        if self.verdict == "not enough data":
            return f"Rotor order: not enough data. {self.why}"
        if self.verdict == "fits":
            turning = {
                "fits": "order and directions of the motors agree with",
                "wrong": f"the motors turn the other way round than in {name}; their order agrees with",
                "not enough data": "the order of the motors agrees with",
            }[self.directions]
            text = f"{turning} {name if self.directions != 'wrong' else 'it'} (misfit {self.misfit:.0f}, next order"
            return f"{text[0].upper()}{text[1:]} {self.second:.0f})."
        found = "no other order fits clearly" if self.fitting is None else f"{_places(self.fitting)} fits"
        return (
            f"The motors are not numbered as in {name} (misfit {self.misfit:.0f}): {found} "
            f"(misfit {self.best:.0f}, next {self.second:.0f})."
        )

    def findings(self, where: str) -> tuple[Finding, ...]:
        """A warning where the flight contradicts the layout, else a remark."""
        message = self.sentence()
        if not self.contradicted:
            if self.verdict == "not enough data" and self.remedy:
                message = f"{message} {self.remedy[0].upper()}{self.remedy[1:]}."
            return (remark("rotor_order", where, message, **self.numbers),)
        return (warn("rotor_order", where, f"{message} {self.advice()}", **self.numbers),)

    def advice(self) -> str:
        """What to do where the flight contradicts the layout."""
        typed = self.to_type or "--layout with a TOML file that describes the rotors"
        return f"Use {typed}; check the axes of the gyro too."


def _unknown(layout: RotorLayout, why: str, remedy: str = "", **known: Any) -> RotorOrder:
    return RotorOrder(layout=layout, why=why, remedy=remedy, **known)


def require_order(order: RotorOrder, where: str) -> tuple[Finding, ...]:
    """The answer as findings, for what takes the layout as given.

    Raises
    ------
    InsufficientDataError
        The motors are numbered in another order: nothing that is computed with the layout would be true.
    """
    if order.verdict == "wrong":
        message, advice = order.sentence(), order.advice()
        raise InsufficientDataError(
            message.rstrip("."),
            needed="the rotors in the order of the motors",
            remedy=f"{advice[0].lower()}{advice[1:].rstrip('.')}",
            findings=[refusal("rotor_order", where, f"{message} {advice}", **order.numbers)],
        )
    return () if order.verdict == "not enough data" else order.findings(where)


@cached_by_value
def order_of_log(record: FlightRecord) -> RotorOrder | None:
    """The answer for the layout that a log names; ``None`` where it names none or has no motors."""
    try:
        layout = layout_of(record)
        return rotor_order(record, layout)
    except (InsufficientDataError, UsageError):
        return None


@cached_by_value
def rotor_order(record: FlightRecord, layout: RotorLayout, *, intervals: Intervals = ()) -> RotorOrder:
    """Whether a flight agrees with the order and the directions of a layout.

    Parameters
    ----------
    record
        Rates, and motor outputs, motor speeds, or commands with the autopilot's mixer.
    layout
        The rotors in the order of the motors.
    intervals
        Start and stop of what to use; the flights of the log by default.

    Raises
    ------
    InsufficientDataError
        The log holds no motors or no rates.
    UsageError
        It has another number of motors than the layout.

    Examples
    --------
    >>> order = rotor_order(rotorid.read("flight.ulg"), library_layout("quad.x"))  # doctest: +SKIP
    >>> order.verdict, order.to_type  # doctest: +SKIP
    ('wrong', '--layout quad.x.betaflight')
    """
    found = _prepared(record, layout, intervals)
    return found if isinstance(found, RotorOrder) else _of_windows(layout, found, _judged(layout, found))


def window_orders(record: FlightRecord, layout: RotorLayout, *, window_s: float = WINDOW_S) -> tuple[RotorOrder, ...]:
    """The same for each window of the flights: empty where the log does not serve at all.

    Parameters
    ----------
    record, layout
        As for :func:`rotor_order`.
    window_s
        Length, five seconds or more; windows with gaps, or with motors at their limits, are left out.
    """
    found = _prepared(record, layout, ())
    if isinstance(found, RotorOrder):
        return ()
    return tuple(_judged(layout, [cut]) for part in found for cut in _cut(part, window_s))


def _prepared(record: FlightRecord, layout: RotorLayout, intervals: Intervals) -> Sequence[_Part] | RotorOrder:
    """The flights as the regression needs them, or what is missing."""
    history = fastest_motors(record, layout)
    if history.motors != layout.rotors:
        raise UsageError(
            f"{record.source.name} has {history.motors} motors, but {layout.name} has {layout.rotors} rotors",
            needed="the layout of the vehicle that flew",
            remedy="name it with --layout",
        )
    rates = {name: record.rate_hz(name) for name in RATES}
    if missing := [name for name in RATES if rates[name] <= 0.0 or not np.isfinite(record[name].values).any()]:
        return _unknown(layout, f"The log has no {listed(missing)}.", logging_advice(record, 0.0, tuple(missing)))
    slowest = min(history.sample_rate_hz, *rates.values())
    if slowest < LOWEST_RATE_HZ:
        of_motors = history.sample_rate_hz <= slowest
        what = "motors" if of_motors else "rates"
        why = f"The {what} are logged at {slowest:.0f} Hz; {LOWEST_RATE_HZ:.0f} Hz are needed."
        remedy = slow_motor_advice(record, slowest) if of_motors else logging_advice(record, slowest)
        return _unknown(layout, why, remedy)
    if layout.rotors > _MOST_ROTORS:
        return _unknown(layout, f"{layout.rotors} rotors have too many orders to try.")
    parts = _parts(record, history, intervals or flights_off_ground(record))
    duration_s = _duration_s(parts)
    if duration_s < LEAST_S:
        why = f"{duration_s:.0f} s without gaps and motor limits; {LEAST_S:.0f} s are needed."
        return _unknown(layout, why, "log a longer flight", duration_s=duration_s)
    return parts


def _duration_s(parts: Sequence[_Part]) -> float:
    return BLOCK_S * sum(np.unique(part.block).size for part in parts)


def _of_windows(layout: RotorLayout, parts: Sequence[_Part], whole: RotorOrder) -> RotorOrder:
    """The answer of a whole flight; else that of its windows, where several decide and all of these agree.

    An axis that rests for most of a flight hides in its whole what a few seconds show.
    """
    if whole.verdict != "not enough data" or whole.duration_s < 2.0 * WINDOW_S:
        return whole
    decided = [
        found
        for part in parts
        for cut in _cut(part, WINDOW_S)
        if (found := _judged(layout, [cut])).verdict != "not enough data"
    ]
    answers = {
        (found.verdict, () if found.fitting is None else tuple(map(tuple, found.fitting.positions)))
        for found in decided
    }
    if len(decided) < _LEAST_WINDOWS or len(answers) > 1:
        return whole
    turning = {found.directions for found in decided} - {"not enough data"}
    same = [found for found in decided if len(turning) != 1 or found.directions in turning]
    surest = max(same, key=lambda found: found.second - found.best)
    return surest if len(turning) < 2 else replace(surest, directions="not enough data")


def _cut(part: _Part, window_s: float) -> Iterator[_Part]:
    """Whole windows of a flight."""
    window = part.block // round(window_s / BLOCK_S)
    for number in np.unique(window):
        kept = window == number
        if np.unique(part.block[kept]).size * BLOCK_S >= window_s:
            yield _Part(part.motors[:, :, kept], part.accelerations[:, kept], part.block[kept])


class _Part(NamedTuple):
    """One flight on an even clock, in its band: motors at each lag, accelerations, and the block of each sample."""

    motors: FloatArray
    accelerations: FloatArray
    block: IntArray


def _parts(record: FlightRecord, history: MotorHistory, intervals: Intervals) -> list[_Part]:
    """Each flight in the band, with its motors at each lag, as far as its blocks serve."""
    parts = []
    for band in motor_bands(record, history, intervals):
        lags_s = (*_LAGS_S, _EARLY_S)
        lagged = np.stack([band.passed(_lagged(band.thrust, lag_s, band.step_s)) for lag_s in lags_s])
        kept = band.kept
        parts.append(_Part(lagged[:, :, kept], band.accelerations[:, kept], band.block[kept]))
    return parts


def _lagged(values: FloatArray, lag_s: float, step_s: float) -> FloatArray:
    from scipy.signal import lfilter

    values = values - values[:, :1]
    if lag_s < 0.0:
        ahead = round(-lag_s / step_s)
        return np.concatenate([values[:, ahead:], np.repeat(values[:, -1:], ahead, axis=1)], axis=1)
    share = 1.0 if lag_s == 0.0 else float(-np.expm1(-step_s / lag_s))
    return np.asarray(lfilter([share], [1.0, share - 1.0], values, axis=1))


class _Regression(NamedTuple):
    """Accelerations by motors, in the combinations of motors that moved (columns of ``moved``)."""

    gains: FloatArray
    covariances: tuple[FloatArray, ...]
    moved: FloatArray
    correlation: FloatArray

    @property
    def score(self) -> float:
        """How much is explained of roll and pitch."""
        return float(np.sum(self.correlation[:2] ** 2))


def _regression(parts: Sequence[_Part], lag: int) -> _Regression | None:
    """Accelerations by motors at one lag; ``None`` where no motor moves."""
    accelerations = np.concatenate([part.accelerations for part in parts], axis=1)
    motors = np.concatenate([part.motors[lag] for part in parts], axis=1)
    size, vectors = np.linalg.eigh(motors @ motors.T)
    if not size[-1] > _NOTHING * motors.shape[1]:
        return None
    moved = vectors[:, size > _STILL * size[-1]]
    rows = moved.T @ motors
    inverse = np.linalg.inv(rows @ rows.T)
    gains = accelerations @ rows.T @ inverse
    made = gains @ rows
    power = np.sqrt(np.sum(made**2, axis=1) * np.sum(accelerations**2, axis=1))
    correlation = np.divide(np.sum(made * accelerations, axis=1), power, out=np.zeros(3), where=power > 0.0)
    # Blocks of different flights are different blocks.
    starts = np.concatenate([np.r_[True, np.diff(part.block) != 0] for part in parts]).nonzero()[0]
    scores = np.add.reduceat(rows * (accelerations - made)[:, None, :], starts, axis=2)
    spread = starts.size / max(starts.size - rows.shape[0], 1)
    covariances = tuple(spread * inverse @ (axis @ axis.T) @ inverse for axis in scores)
    return _Regression(gains, covariances, moved, correlation)


def _judged(layout: RotorLayout, parts: Sequence[_Part]) -> RotorOrder:
    """The answer of the lag that explains most, unless motors that act too early explain more and say otherwise."""
    duration_s = _duration_s(parts)
    fits = [_regression(parts, lag) for lag in range(len(_LAGS_S) + 1)]
    moving = [fit for fit in fits if fit is not None]
    if len(moving) < len(fits):
        remedy = "move the sticks in roll and pitch"
        return _unknown(layout, "The motors do not move.", remedy, duration_s=duration_s)
    *causal, early = moving
    best = max(causal, key=lambda fit: fit.score)
    found = _judged_by(layout, best, duration_s)
    weak = min(best.correlation[:2]) < LEAST_CORRELATION
    if weak or early.score <= best.score:
        return found
    # Motors with late stamps seem to act early too, but name the same order.
    if np.array_equal(_least(layout, early), _least(layout, best)):
        return found
    why = "The motors follow the motion rather than cause it: a controller answers to noise or gusts."
    remedy = "move the sticks quickly in roll and pitch"
    return _unknown(layout, why, remedy, duration_s=duration_s, correlation=found.correlation)


class _Orders(NamedTuple):
    """Distinct orders of the rotors of a layout: what each predicts of roll and pitch, and its misfit."""

    orders: IntArray
    patterns: FloatArray
    misfits: FloatArray


def _of_orders(layout: RotorLayout, fit: _Regression) -> _Orders:
    levers = _levers(layout)
    orders = np.array(_permutations(layout.rotors))
    # Rotors above each other have the same levers.
    patterns, first = np.unique(levers[:, orders].transpose(1, 0, 2), axis=0, return_index=True)
    misfits = sum(_misfits(fit, axis, patterns[:, axis]) for axis in (0, 1))
    return _Orders(orders[first], patterns, np.asarray(misfits))


def _levers(layout: RotorLayout) -> FloatArray:
    """Levers of roll and pitch in parts of the largest, shape ``(2, rotors)``."""
    levers = layout.moment_arms[:2]
    return np.asarray((levers / np.abs(levers).max()).round(6))


def _least(layout: RotorLayout, fit: _Regression) -> FloatArray:
    """What the order with the least misfit predicts."""
    tried = _of_orders(layout, fit)
    return np.asarray(tried.patterns[int(np.argmin(tried.misfits))])


@cache
def _permutations(rotors: int) -> tuple[tuple[int, ...], ...]:
    return tuple(permutations(range(rotors)))


def _judged_by(layout: RotorLayout, fit: _Regression, duration_s: float) -> RotorOrder:
    correlation = dict(zip(("roll", "pitch", "yaw"), fit.correlation.tolist(), strict=True))
    known: dict[str, Any] = {"duration_s": duration_s, "correlation": correlation}
    weak = [axis for axis in ("roll", "pitch") if correlation[axis] < LEAST_CORRELATION]
    if weak:
        values = " and ".join(f"{correlation[axis]:.2f} in {axis}" for axis in weak)
        why = f"The motors explain too little: correlation {values}, {LEAST_CORRELATION:g} needed."
        return _unknown(layout, why, f"move the stick quickly in {listed(weak)}", **known)
    orders, patterns, misfits = _of_orders(layout, fit)
    ranks = np.argsort(misfits, kind="stable")
    own = int(np.flatnonzero(np.all(patterns == _levers(layout), axis=(1, 2)))[0])
    best = int(ranks[0])
    # Where motors moved together only, some orders act alike and are one.
    alike = np.flatnonzero(misfits - misfits[best] <= _ALIKE)
    others = np.delete(misfits, alike)
    second = float(others.min()) if others.size else np.inf
    known |= {"misfit": float(misfits[own]), "best": float(misfits[best]), "second": second}
    if known["best"] > LARGEST_MISFIT:
        why = f"No order of {layout.name} fits (least misfit {known['best']:.0f}, {LARGEST_MISFIT:.0f} allowed)."
        return _unknown(layout, why, "if the rotors sit elsewhere, describe them in a TOML file for --layout", **known)
    behind = (misfits - misfits[best] > LEAST_GAP) & (misfits > _LEAST_RATIO * misfits[best])
    clear = bool(np.delete(behind, alike).all())
    # More than four motors never move in all ways: many orders act nearly alike, and most must be ruled out.
    enough = clear if layout.rotors <= _FOUR else bool(behind[own]) or float(behind.mean()) >= _MOST_RULED_OUT
    if not enough:
        why = f"Two orders of the motors fit (misfits {known['best']:.0f} and {second:.0f}), too alike to choose."
        return _unknown(layout, why, "fly quicker roll and pitch movements", **known)
    fits = not behind[own]
    order = orders[own] if fits else orders[best]
    fitting = layout if fits else _reordered(layout, order) if clear and alike.size == 1 else None
    directions, why = _directions(fit, layout.spins[order]) if fitting is not None else ("not enough data", "")
    if fitting is not None and directions == "wrong":
        fitting = replace(fitting, spins=-fitting.spins, yaw_weights=None)
    return RotorOrder(
        layout=layout,
        verdict="fits" if fits else "wrong",
        directions=directions,
        fitting=fitting,
        why=why,
        **known,
    )


def _misfits(fit: _Regression, axis: int, patterns: FloatArray) -> FloatArray:
    """Misfit of each pattern, shape ``(orders, rotors)``, to the gains of an axis."""
    gains, columns = fit.gains[axis], patterns @ fit.moved
    explained, factor = _explained(gains, columns, fit.covariances[axis])
    scale = factor[int(np.argmax(explained))]
    covariance = fit.covariances[axis] + (_SCATTER * scale) ** 2 * np.eye(gains.size)
    explained, _ = _explained(gains, columns, covariance)
    return np.asarray(gains @ np.linalg.solve(covariance, gains) - explained)


def _explained(gains: FloatArray, columns: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Part of the weighted squares that each pattern explains with a factor from zero up, and that factor."""
    weights = np.linalg.pinv(covariance, hermitian=True)
    power = np.sum(columns @ weights * columns, axis=1)
    along = np.maximum(columns @ weights @ gains, 0.0)
    factor = np.divide(along, power, out=np.zeros(power.size), where=power > 0.0)
    return factor * along, factor


def _directions(fit: _Regression, spins: FloatArray) -> tuple[Verdict, str]:
    """Whether yaw follows the directions of the layout, or the opposite ones; other directions are never tried."""
    if abs(float(spins.sum())) > 0.0:
        return "not enough data", "The directions of the layout do not balance."
    if fit.correlation[2] < _YAW_CORRELATION:
        why = f"Directions: correlation {fit.correlation[2]:.2f} in yaw, {_YAW_CORRELATION:g} needed."
        return "not enough data", why
    column, covariance = spins @ fit.moved, fit.covariances[2]
    weights = np.linalg.pinv(covariance, hermitian=True)
    factor = float(column @ weights @ fit.gains[2] / (column @ weights @ column))
    covariance = covariance + (_SCATTER * factor) ** 2 * np.eye(column.size)
    weights = np.linalg.pinv(covariance, hermitian=True)
    power = float(column @ weights @ column)
    factor = float(column @ weights @ fit.gains[2]) / power
    significance = factor * np.sqrt(power)
    rest = fit.gains[2] - factor * column
    if abs(significance) < _YAW_SIGNIFICANCE or float(rest @ weights @ rest) > LARGEST_MISFIT:
        return "not enough data", f"Directions: the yaw of the motors is {significance:.1f} errors from zero."
    return ("fits" if factor > 0.0 else "wrong"), ""


def _reordered(layout: RotorLayout, order: FloatArray) -> RotorLayout:
    assert layout.axes is not None
    assert layout.yaw_weights is not None
    return replace(
        layout,
        name=f"{layout.name} in another order",
        positions=layout.positions[order],
        spins=layout.spins[order],
        axes=layout.axes[order],
        yaw_weights=layout.yaw_weights[order],
        findings=(),
    )


def _to_type(fitting: RotorLayout, directions: Verdict) -> str:
    """The option that names a layout: of the library, or a description with the rotors in their order."""
    # A mixer of its own, as that of a V, is no reason to name a layout.
    known = sorted(map(library_layout, layout_names()), key=_mixes_by_spins, reverse=True)
    for layout in known:
        if _alike(layout, fitting):
            return f"--layout {layout.name}"
    spins = "" if directions == "not enough data" else " and directions"
    return f"--layout with a TOML file of [[rotor]] tables in this order{spins}: {_places(fitting)}"


def _mixes_by_spins(layout: RotorLayout) -> bool:
    return layout.yaw_weights is not None and np.array_equal(layout.yaw_weights, layout.spins)


def _alike(layout: RotorLayout, other: RotorLayout) -> bool:
    """Whether rotors sit in the same directions and turn the same way."""
    if layout.rotors != other.rotors or not np.array_equal(layout.spins, other.spins):
        return False
    angles = [np.arctan2(item.positions[:, 1], item.positions[:, 0]) for item in (layout, other)]
    return bool(np.all(np.abs(np.angle(np.exp(1j * (angles[0] - angles[1])))) < _SAME_ANGLE))


def _places(layout: RotorLayout) -> str:
    """Where each motor is, and which way it turns."""
    return ", ".join(f"motor {number} {place}" for number, place in enumerate(_place_words(layout), start=1))


def _place_words(layout: RotorLayout) -> Iterator[str]:
    turns = {sign: word for word, sign in SPINS.items()}
    for (forward, right, _), spin in zip(layout.positions / layout.arm, layout.spins, strict=True):
        words = [word for word, value in (("front", forward), ("rear", -forward)) if value > 0.3]
        words += [word for word, value in (("right", right), ("left", -right)) if value > 0.3]
        yield f"{' '.join(words) or 'center'} {turns[float(spin)]}"
