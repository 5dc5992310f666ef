r"""Balance of the motors in hover, and which motor changed since earlier flights of the vehicle.

The logarithms of the mean outputs :math:`u_i` in steady flight, less their mean, are split into patterns over the
rotors' places and directions of rotation, right to left (moments of roll), front to back (pitch), and by direction
(yaw), made orthogonal in this order:

.. math:: \ln u_i - \overline{\ln u} = \sum_k b_{ik} a_k + \mathrm{rest}, \qquad
          \frac{1}{M} \sum_i b_{ik} b_{il} = \delta_{kl}

A load off the middle moves the first two amplitudes, a twisted arm or yaw trim the third, and a rotor :math:`i` whose
output alone rises by :math:`\epsilon` all three by :math:`\epsilon \, b_{ik} / M`. A rotor that loses thrust by
:math:`\delta` needs :math:`\epsilon \approx \delta / \alpha` more output, where thrust grows as the power
:math:`\alpha` of the output (1 to 2).

A further flight is compared with :math:`n` earlier ones. Each amplitude scatters from flight to flight by battery,
load, wind and trim; few flights show its variance badly, so that the usual one of a vehicle counts as two flights:

.. math:: s_k^2 = \frac{\nu_0 s_0^2 + \sum_j (a_{jk} - \bar a_k)^2}{\nu_0 + n - 1}, \qquad
          t_k = \frac{a_k - \bar a_k}{s_k \sqrt{1 + 1/n}}

:math:`t_k` is distributed as Student's with :math:`\nu_0 + n - 1` degrees of freedom where nothing changed. Its normal
scores, squared, add to :math:`\chi^2`, whose tail is the probability of a false alarm. What changed is the hypothesis
(one motor, a side, a direction of rotation) that explains most of :math:`\sum_k t_k^2`; two that explain as much are
both given.

It is blind to what all motors do alike (the throttle of hover shows that), and a loss of thrust without a loss of
torque looks like a load that moved toward that rotor.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from scipy import special

from rotorid.data.base import Immutable, read_only
from rotorid.data.quantity import Quantity, with_half
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError, ModelError
from rotorid.models.autopilots.layouts import layout_of
from rotorid.typing import AnyArray, FloatArray
from rotorid.uncertainty.differences import POWER_QUANTILE, Verdict, verdict

PATTERNS = ("balance_roll", "balance_pitch", "balance_yaw")
"""Figures of a review that hold the amplitudes, in the order of the patterns."""

PAIRS = ("balance_12", "balance_13", "balance_14")
"""The same of a quadrotor whose layout is not known: motors 1 and 2, 1 and 3, 1 and 4 against the others.

Of a quadrotor in X these are roll, pitch and yaw in an unknown order, so that a motor is named as well.
"""

PAIR_PATTERNS = read_only(
    [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]], np.float64, ndim=2
)
"""Patterns of :data:`PAIRS`, shape ``(4, 3)``."""

USUAL_SCATTER = 0.004
"""Of an amplitude between flights of a vehicle that nothing happened to.

Six flights of one nano quadrotor on one day scatter by 0.3 (roll), 0.8 (pitch) and 1.2 % (yaw), errors of the means
included; flights of simulated autopilots by less than 0.1 %.
"""

USUAL_WEIGHT = 2.0
"""So many earlier flights weigh as much as :data:`USUAL_SCATTER`."""

FEWEST_EARLIER = 2
"""Earlier flights without which nothing is compared."""

FALSE_ALARM = 0.005
"""Probability up to which a healthy flight is called changed: half of what a whole comparison may have."""

_CLEARER = 2.2
"""What explains less than another hypothesis by more than this (a likelihood ratio of 3) is no longer given."""

_PER_PART = 2.0
"""What a further part of an explanation costs (Akaike)."""

_SELDOM = 5.0
"""What a motor that works less than before costs: rotors get worse of themselves, and better by a repair alone.

Of more than four rotors one that works harder looks like its opposite that works less.
"""

_UNEXPLAINED = 16.0
"""Squares that the best explanation may leave: Student's tails with few flights reach far."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BalanceChange(Immutable):
    """The balance of one flight compared with that of earlier ones.

    Parameters
    ----------
    verdict
        ``changed``, ``unchanged`` (a change of one motor by a fifth would have been found) or ``undecided``.
    probability
        That a healthy flight differs as much.
    motor
        Number of the motor that changed; ``None`` where none is named.
    patterns
        What explains the change: ``motor_N``, ``side``, ``diagonal``, of an unknown layout ``pair``; several where the
        data cannot decide, none where no single one does.
    outputs
        Relative change of each motor's output against the mean of all, by its number.
    rise
        That of the motor alone, where one is named.
    detectable
        Rise of one motor that would have been found four times out of five.
    flights
        Earlier flights.
    """

    verdict: Verdict
    probability: float
    motor: int | None = None
    patterns: tuple[str, ...] = ()
    outputs: Mapping[int, Quantity]
    rise: Quantity | None = None
    detectable: float = math.inf
    flights: int

    def __post_init__(self) -> None:
        self._set(outputs=self.outputs)

    @property
    def words(self) -> str:
        """What changed, for a sentence; empty where nothing did."""
        if self.verdict != "changed":
            return ""
        if self.motor is not None and self.rise is not None:
            return f"output of motor {self.motor} {percent(self.rise)}"
        shown = [f"motor {number} {percent(change)}" for number, change in self.outputs.items()]
        return f"balance of the motors ({', '.join(shown)})"

    @property
    def usual(self) -> str:
        """The usual cause of such a change; empty where nothing changed."""
        if self.verdict != "changed":
            return ""
        if self.rise is not None and self.rise.value < 0.0:
            return f"another propeller or motor {self.motor}"
        causes = [
            f"damaged propeller or weak motor {key.removeprefix('motor_')}" if key.startswith("motor_") else USUAL[key]
            for key in self.patterns
        ]
        return " or ".join(causes) if causes else "several causes together"


USUAL: Mapping[str, str] = MappingProxyType(
    {
        "side": "battery or load in another place",
        "diagonal": "twisted arm, other propellers or yaw trim",
        "pair": "load in another place, twisted arm or yaw trim",
    }
)
"""Usual cause of a change of a pattern."""


def percent(change: Quantity) -> str:
    """A relative change with its 95 % interval, for a sentence.

    Examples
    --------
    >>> percent(Quantity.normal(0.051, 0.004, "1"))
    '+5.1 ± 0.8 %'
    """
    shown = with_half(100.0 * change.value, 100.0 * change.lower, 100.0 * change.upper, unit="%")
    return shown if change.value < 0.0 else f"+{shown}"


def patterns_of(positions: AnyArray, spins: AnyArray) -> FloatArray:
    """Patterns over the rotors, shape ``(rotors, 3)``: roll, pitch, yaw; nan where the rotors have fewer.

    Parameters
    ----------
    positions
        Forward and right, shape ``(rotors, 2)``.
    spins
        +1 and -1, shape ``(rotors,)``.

    Examples
    --------
    >>> x = [[1.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0]]
    >>> patterns_of(x, [1.0, 1.0, -1.0, -1.0]).T.round(6).tolist()[0]
    [1.0, -1.0, -1.0, 1.0]
    """
    place = np.asarray(positions, dtype=np.float64)
    count = place.shape[0]
    known = [np.full(count, 1.0)]
    found = np.full((count, len(PATTERNS)), np.nan)
    for pattern, column in enumerate((place[:, 1], place[:, 0], np.asarray(spins, dtype=np.float64))):
        left = column.astype(np.float64)
        for other in known:
            left = left - float(left @ other) / count * other
        size = math.sqrt(float(left @ left) / count)
        if size > 1e-6 * max(float(np.abs(column).max()), 1e-300):
            found[:, pattern] = left / size
            known.append(found[:, pattern])
    return found


def patterns_or_pairs(record: FlightRecord, count: int) -> tuple[FloatArray | None, tuple[str, ...]]:
    """Patterns over the rotors of a log, and the figures of a review that hold their amplitudes."""
    positions, spins = rotor_geometry(record, count)
    if positions is not None and spins is not None:
        return patterns_of(positions, spins), PATTERNS
    return (PAIR_PATTERNS, PAIRS) if count == PAIR_PATTERNS.shape[0] else (None, ())


def rotor_geometry(record: FlightRecord, count: int | None = None) -> tuple[FloatArray | None, FloatArray | None]:
    """Forward and right in parts of the longest arm, shape ``(rotors, 2)``, and directions of rotation.

    Parameters
    ----------
    count
        Of the motors; another layout is none. Any by default.
    """
    try:
        layout = layout_of(record)
    except (InsufficientDataError, ModelError):
        return None, None
    positions = np.asarray(layout.positions[:, :2])
    if count is not None and positions.shape[0] != count:
        return None, None
    return positions / float(np.abs(np.hypot(*positions.T)).max()), np.asarray(layout.spins, dtype=np.float64)


def amplitudes(outputs: AnyArray, patterns: AnyArray) -> FloatArray:
    """Amplitude of each pattern in mean outputs, shape ``(..., 3)``.

    Parameters
    ----------
    outputs
        Above zero, shape ``(..., rotors)``.
    patterns
        Of :func:`patterns_of`.
    """
    logs = np.log(np.maximum(np.asarray(outputs, dtype=np.float64), 1e-6))
    centered = logs - logs.mean(axis=-1, keepdims=True)
    return np.asarray(centered @ np.asarray(patterns, dtype=np.float64) / logs.shape[-1])


def balance_change(
    earlier: AnyArray,
    earlier_stds: AnyArray,
    now: AnyArray,
    now_stds: AnyArray,
    *,
    patterns: AnyArray,
    placed: bool = True,
) -> BalanceChange:
    """Compare the balance of a flight with that of earlier ones.

    Parameters
    ----------
    earlier, earlier_stds
        Amplitudes of earlier flights and their random errors, shape ``(flights, 3)``.
    now, now_stds
        Of the flight, shape ``(3,)``.
    patterns
        Of :func:`patterns_of`, shape ``(rotors, 3)``.
    placed
        Whether the patterns are roll, pitch and yaw, and not :data:`PAIRS`.

    Examples
    --------
    >>> x = patterns_of([[1.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0]], [1.0, 1.0, -1.0, -1.0])
    >>> rng = np.random.default_rng(0)
    >>> before, error = rng.normal(0, 0.003, (5, 3)), np.full(3, 1e-3)
    >>> now = amplitudes([0.5, 0.5, 0.55, 0.5], x)
    >>> found = balance_change(before, np.tile(error, (5, 1)), now, error, patterns=x)
    >>> found.verdict, found.motor, found.usual
    ('changed', 3, 'damaged propeller or weak motor 3')
    """
    b = np.asarray(patterns, dtype=np.float64)
    known = np.asarray(np.isfinite(b).all(axis=0))
    a, s = np.asarray(earlier, dtype=np.float64)[:, known], np.asarray(earlier_stds, dtype=np.float64)[:, known]
    change_stds = np.asarray(now_stds, dtype=np.float64)[known]
    flights, b = a.shape[0], b[:, known]
    if flights < FEWEST_EARLIER or not known.any():
        return BalanceChange(verdict="undecided", probability=1.0, outputs={}, flights=flights)
    freedom = USUAL_WEIGHT + flights - 1.0
    scatter = (USUAL_WEIGHT * USUAL_SCATTER**2 + ((a - a.mean(axis=0)) ** 2).sum(axis=0)) / freedom
    # A shorter flight has a larger error than those that showed the scatter.
    further = np.maximum(change_stds**2 - (s**2).mean(axis=0), 0.0)
    change, variance = (
        np.asarray(now, dtype=np.float64)[known] - a.mean(axis=0),
        scatter * (1.0 + 1.0 / flights) + further,
    )
    t = change / np.sqrt(variance)
    scores = -special.ndtri(np.maximum(special.stdtr(freedom, -np.abs(t)), 1e-300))
    probability = float(special.chdtrc(scores.size, float(scores @ scores)))
    outputs, half = _by_motor(b, change, variance, freedom)
    reach = _detectable(b, variance, freedom)
    found = probability <= FALSE_ALARM
    common: dict[str, Any] = {"probability": probability, "outputs": outputs, "detectable": reach, "flights": flights}
    if not found:
        return BalanceChange(verdict=verdict(found=False, detectable_share=reach), **common)
    explained = _explanations(b, known, change, variance, placed=placed)
    keys = tuple(key for key, score in explained.items() if score > max(explained.values()) - _CLEARER)
    keys = tuple(sorted(keys, key=lambda key: -explained[key]))
    left = float(np.sum(change**2 / variance)) - max(explained.values()) - _PER_PART - _SELDOM
    if left > _UNEXPLAINED:
        keys = ()
    motor = int(keys[0].removeprefix("motor_")) if len(keys) == 1 and keys[0].startswith("motor_") else None
    rise = None if motor is None else _alone(b[motor - 1] / b.shape[0], change, variance, half)
    return BalanceChange(verdict="changed", motor=motor, patterns=keys, rise=rise, **common)


def _by_motor(
    b: FloatArray, change: FloatArray, variance: FloatArray, freedom: float
) -> tuple[dict[int, Quantity], float]:
    """Change of each motor against the mean, and half an interval over a standard deviation."""
    half = float(special.stdtrit(freedom, 0.975))
    values, stds = b @ change, np.sqrt(np.square(b) @ variance)
    return {
        number: _interval(float(value), float(std), half)
        for number, (value, std) in enumerate(zip(values, stds, strict=True), start=1)
    }, half


def _interval(value: float, std: float, half: float) -> Quantity:
    return Quantity(value=value, std=std, lower=value - half * std, upper=value + half * std, unit="1")


def _alone(direction: FloatArray, change: FloatArray, variance: FloatArray, half: float) -> Quantity:
    """Rise of one motor's output alone, by weighted least squares."""
    information = float(direction**2 @ (1.0 / variance))
    return _interval(float(direction @ (change / variance)) / information, information**-0.5, half)


def _explanations(
    b: FloatArray, known: AnyArray, change: FloatArray, variance: FloatArray, *, placed: bool
) -> dict[str, float]:
    """What each hypothesis explains of the squares, less what its parts cost."""
    found = {}
    for motor, direction in enumerate(b, start=1):
        information = float(direction**2 @ (1.0 / variance))
        along = float(direction @ (change / variance))
        found[f"motor_{motor}"] = along**2 / information - _PER_PART - (_SELDOM if along < 0.0 else 0.0)
    squares = change**2 / variance
    if not placed:
        largest = np.sort(squares)[::-1]
        found["pair"] = float(max(largest[0] - _PER_PART, largest[:2].sum() - 2.0 * _PER_PART))
        return found
    sides = np.flatnonzero(known) < 2
    if sides.any():
        found["side"] = float(squares[sides].sum()) - _PER_PART * int(sides.sum())
    if (~sides).any():
        found["diagonal"] = float(squares[~sides].sum()) - _PER_PART
    return found


def _detectable(b: FloatArray, variance: FloatArray, freedom: float) -> float:
    """Rise of the motor that shows least, which would have been found four times out of five."""
    score = math.sqrt(float(special.chdtri(b.shape[1], FALSE_ALARM))) + POWER_QUANTILE
    # A score of so many normal deviations is one of more deviations of Student's.
    wider = float(-special.stdtrit(freedom, float(special.ndtr(-score)))) / score
    information = np.square(b / b.shape[0]) @ (1.0 / variance)
    return score * wider / math.sqrt(float(information.min())) if float(information.min()) > 0.0 else math.inf
