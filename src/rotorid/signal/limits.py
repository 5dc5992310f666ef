r"""At a limit: signals that pile up at an end, and motors at the ends of the range in which the autopilot moves them.

The range of a motor is that of its autopilot. ArduPilot moves its outputs between ``MOT_SPIN_MIN`` and
``MOT_SPIN_MAX``; the demands of PX4, the outputs of Betaflight over idle and of a Crazyflie go from 0 to 1. Where a log
does not say the range, an end at which the outputs pile up is one; outputs that pile up nowhere were at no limit.

A motor is at a limit within 0.25 % of its range. Autopilots write whole steps of a pulse, 0.12 to 0.17 % of the range,
and round down: the last step before ``MOT_SPIN_MAX`` is full output. All limits of the flights at hand lie within
0.2 %, and up to 1 % hardly a sample follows: 97.7 % of the time within 0.1 % and 97.9 % within 1 % in a limit cycle,
31.7 and 32.3 % in freestyle.

Why a motor is at a limit shows in the thrust. Where the pilot chops the throttle, or all motors idle on the ground, the
mean of the motors is near the lower end, or the throttle that goes straight to the mixer is closed (``idle``); at full
thrust the mean is near the upper end (``full``). Where it lies in between, the commands of roll, pitch and yaw took
what was left (``loop``). A thrust that a controller demands does not count: a limit cycle loses lift, or gains it where
the mixer makes room upward, and the loop of height then asks for all thrust or for none.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Literal, TypeAlias

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.data.display import listed
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.record import FlightRecord, Intervals
from rotorid.errors import InsufficientDataError
from rotorid.signal.airborne import airborne, within
from rotorid.typing import BoolArray, FloatArray

Range: TypeAlias = tuple[float, float]
"""Outputs of no and of full thrust."""

Cause: TypeAlias = Literal["idle", "full", "loop", "unknown"]
"""``idle``: chopped throttle, or on the ground; ``full``: full thrust; ``loop``: roll, pitch or yaw commands;
``unknown``: these are not logged."""

_WORDS: Mapping[Cause, str] = MappingProxyType(
    {
        "idle": "at idle",
        "full": "at full thrust",
        "loop": "by roll, pitch and yaw commands",
        "unknown": "for an unknown reason",
    }
)

_REMARKED_SHARE, WARNED_SHARE = 1e-3, 1e-2
"""Share of the time at a limit that is remarked on, and that is worth a warning."""

_WORTH_NAMING = 5e-4
"""Share of the time from which a cause is named."""

AT_LIMIT = 0.0025
"""Distance from an end, over the range, that counts as at it: two steps of a pulse in whole microseconds."""

POWERED = 0.1
"""Mean output over the range from which motors carry the vehicle; as much below full output is full thrust."""

_CLOSED = 0.02
"""Throttle that is closed."""

_NO_CONTROLLER = "motor mix"
"""Source of a thrust command of Betaflight, whose throttle goes straight to the mixer."""

_FEWEST = 10
"""Samples without which limits are not counted."""

_EDGE = 2e-4
"""Share of the range of a channel within which samples count as at its end."""

_PILED = 3.0
"""So many times more samples at an end than next to it make a limit."""

_LEAST_PILE = 10
"""Values at an end, each as long as it lasts, that such a limit needs at least."""

_FEW_LEVELS = 16.0
"""Widths of an end that the range of a channel has at least; a coarser channel is not judged."""


def piled_ends(values: FloatArray) -> Range | None:
    r"""The ends at and beyond which samples of a signal pile up; infinite where they do not.

    A smooth signal is as often within :math:`\epsilon` of its extreme as between :math:`\epsilon` and
    :math:`4 \epsilon` away from it, since its peaks are parabolas, and a noisy one less often. Three times as often
    is a limit, when ten values or more stand there. :math:`\epsilon` is 0.02 % of the range, or half a step of a signal
    that comes in steps. A signal of few levels, like a random binary one, stands at its extremes on purpose: whether
    they are limits is not known. Resampling smears a limit, so ask before.

    Parameters
    ----------
    values
        Shape ``(samples,)``.

    Returns
    -------
    (float, float) or None
        ``None`` for a signal of few levels.

    Examples
    --------
    >>> wave = np.sin(np.linspace(0.0, 100.0, 10000))
    >>> piled_ends(np.minimum(wave, 0.9))[1] > 0.899, piled_ends(wave), piled_ends(np.sign(wave))
    (True, (-inf, inf), None)
    """
    finite = values[np.isfinite(values)]
    levels = np.unique(finite)
    if levels.size < 2:
        return None
    span = float(levels[-1] - levels[0])
    edge = max(_EDGE * span, 0.5 * float(np.median(np.diff(levels))))
    if _FEW_LEVELS * edge > span:
        return None
    # A signal that keeps each value for some samples has that many fewer values.
    median_run = float(np.median(np.diff(np.flatnonzero(np.diff(finite, prepend=np.nan, append=np.nan)))))

    def piled(away: FloatArray) -> bool:
        near = int(np.count_nonzero(away <= edge))
        next_to = int(np.count_nonzero((away > edge) & (away <= 4.0 * edge)))
        return near > max(_PILED * next_to, _LEAST_PILE * median_run)

    return (
        float(levels[0]) + edge if piled(finite - levels[0]) else -np.inf,
        float(levels[-1]) - edge if piled(levels[-1] - finite) else np.inf,
    )


def limited_share(values: FloatArray) -> float:
    """Share of samples that pile up at the lowest or highest value of a signal, by :func:`piled_ends`.

    Zero for a signal of few levels, which is never taken for limited.

    Examples
    --------
    >>> wave = np.sin(np.linspace(0.0, 100.0, 10000))
    >>> limited_share(wave), round(limited_share(np.minimum(wave, 0.9)), 3)
    (0.0, 0.145)
    """
    ends = piled_ends(values)
    if ends is None:
        return 0.0
    finite = values[np.isfinite(values)]
    return float(np.mean((finite <= ends[0]) | (finite >= ends[1])))


@dataclass(frozen=True, kw_only=True, eq=False)
class MotorLimits(Immutable):
    """When each motor was at a limit, and why.

    Parameters
    ----------
    time_s
        Stamps of the outputs on the log's own clock, shape ``(n,)``.
    outputs
        Over the range of the motors, 0 to 1, shape ``(motors, n)``; as logged where the range is not known.
    lower, upper
        Where a motor is at its lower, and at its upper end, shape ``(motors, n)``.
    mean
        Of the outputs of all motors, shape ``(n,)``.
    counted
        Samples of which shares are taken: those in flight, or of a part, shape ``(n,)``.
    idle, full
        Samples with next to no, and with next to full thrust, shape ``(n,)``.
    explained
        Whether a command of roll, pitch or yaw is logged, which says what else was asked of the motors.
    fewest
        Samples at an end without which none is seen: one, or as many as make a pile.
    unknown_range
        Why the range is not known, as the end of a sentence about the log; empty where it is.
    """

    time_s: FloatArray
    outputs: FloatArray
    lower: BoolArray
    upper: BoolArray
    mean: FloatArray
    counted: BoolArray
    idle: BoolArray
    full: BoolArray
    explained: bool = True
    fewest: int = 1
    unknown_range: str = ""

    def __post_init__(self) -> None:
        self._set(
            time_s=read_only(self.time_s, np.float64, ndim=1),
            outputs=read_only(self.outputs, np.float64, ndim=2),
            mean=read_only(self.mean, np.float64, ndim=1),
            **{name: read_only(getattr(self, name), np.bool_, ndim=2) for name in ("lower", "upper")},
            **{name: read_only(getattr(self, name), np.bool_, ndim=1) for name in ("counted", "idle", "full")},
        )

    @property
    def unknown(self) -> str:
        """Why limits are not known, as the end of a sentence about the log; empty where they are.

        All shares are then not a number: no motor that is known to be at a limit is not the same as none at a limit.
        """
        if not self.time_s.size or self.unknown_range:
            return self.unknown_range or "lacks the outputs of all motors"
        counted = int(np.count_nonzero(self.counted))
        return "" if counted >= _FEWEST else f"has {counted or 'no'} samples of its motors in flight"

    @property
    def limited(self) -> BoolArray:
        """Samples in which a motor has nothing left to give or to take, shape ``(n,)``."""
        return np.asarray((self.lower | self.upper).any(axis=0))

    @property
    def by_loop(self) -> BoolArray:
        """Samples in which a motor is at a limit that thrust alone does not explain, shape ``(n,)``."""
        return self.limited & ~self.idle & ~self.full

    @property
    def share(self) -> float:
        """Share of the counted samples with a motor at a limit."""
        return self.of(self.limited)

    @property
    def lower_share(self) -> float:
        """Share of the counted samples with a motor at its lower end."""
        return self.of(np.asarray(self.lower.any(axis=0)))

    @property
    def upper_share(self) -> float:
        """Share of the counted samples with a motor at its upper end."""
        return self.of(np.asarray(self.upper.any(axis=0)))

    @property
    def causes(self) -> Mapping[Cause, float]:
        """Share of the counted samples by why a motor is at a limit; they add up to :attr:`share`."""
        rest: Cause = "loop" if self.explained else "unknown"
        parts: Mapping[Cause, BoolArray] = {"idle": self.limited & self.idle, "full": self.limited & self.full}
        return {**{cause: self.of(part) for cause, part in parts.items()}, rest: self.of(self.by_loop)}

    def describe(self, part: str = "the flight") -> str:
        """How long a motor was at a limit, and why, in one sentence without its end.

        Examples
        --------
        >>> on, off = np.ones((1, 20), dtype=bool), np.zeros((1, 20), dtype=bool)
        >>> some = np.arange(20) < 5
        >>> MotorLimits(time_s=np.arange(20.0), outputs=np.ones((1, 20)), lower=off, upper=on & some, mean=np.ones(20),
        ...             counted=on[0], idle=off[0], full=some).describe()
        'A motor was at a limit for 25.0 % of the flight: at full thrust for 25.0 %'
        """
        named = {cause: share for cause, share in self.causes.items() if share >= _WORTH_NAMING}
        parts = [f"{_WORDS[cause]} for {100.0 * share:.1f} %" for cause, share in named.items()]
        return f"A motor was at a limit for {100.0 * self.share:.1f} % of {part}{': ' if parts else ''}{listed(parts)}"

    def finding(self, grade: Callable[..., Finding], part: str = "the flight", then: str = "") -> Finding:
        """A finding ``saturation`` of a grade, with a further sentence."""
        words = f"{self.describe(part)}.{then and ' '}{then}"
        shares = {"share": self.share, "upper_share": self.upper_share, "lower_share": self.lower_share}
        return grade("saturation", "motors", words, **shares)

    def remarks(self, part: str = "the flight") -> tuple[Finding, ...]:
        """What to say of motors at a limit: a remark from 0.1 % of the time, a warning from 1 %.

        Nothing is said of limits that are not known.
        """
        if not self.share >= _REMARKED_SHARE:
            return ()
        return (self.finding(warn if self.share >= WARNED_SHARE else remark, part),)

    def of(self, samples: BoolArray) -> float:
        """Share of the counted samples that are among some, shape ``(n,)``; not a number where limits are not known."""
        return float(np.mean(samples[self.counted])) if not self.unknown and self.counted.any() else np.nan

    def during(self, intervals: Intervals) -> MotorLimits:
        """The same, with shares of these parts of the log alone, in flight or not."""
        return replace(self, counted=within(self.time_s, intervals))


def limits_of(record: FlightRecord, time_s: FloatArray, values: FloatArray, ends: Range | None) -> MotorLimits:
    """Limits of motors.

    Parameters
    ----------
    time_s, values
        Stamps and outputs, shapes ``(n,)`` and ``(motors, n)``.
    ends
        Outputs of no and of full thrust; ``None`` where the log does not say them.
    """
    counted = in_flight(record, time_s)
    low, high = ends or (0.0, 1.0)
    outputs = (values - low) / (high - low)
    flown = outputs[:, counted] if counted.any() else outputs
    found = (AT_LIMIT, 1.0 - AT_LIMIT) if ends is not None else _piled(flown)
    low_ends, high_ends = found or (-np.inf, np.inf)
    lower, upper = outputs <= low_ends, outputs >= high_ends
    mean = outputs.mean(axis=0)
    # The mixer raises motors over a closed throttle, as far as they are asked to differ.
    chopped = (_throttle(record, time_s) < _CLOSED) & ~upper.any(axis=0)
    return MotorLimits(
        time_s=time_s,
        outputs=outputs,
        lower=lower,
        upper=upper,
        counted=counted,
        mean=mean,
        idle=np.asarray((mean < POWERED) | lower.all(axis=0) | chopped),
        full=np.asarray((mean > 1.0 - POWERED) | upper.all(axis=0)),
        explained=any(f"{axis}_command" in record.channel_names for axis in ("roll", "pitch", "yaw")),
        fewest=1 if ends is not None else _LEAST_PILE,
        unknown_range="" if found is not None or not time_s.size else "does not say in which range its motors move",
    )


def _piled(outputs: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Ends of each motor, shape ``(motors, 1)``, at which its outputs or those of all motors pile up.

    ``None`` where no motor has levels enough to show one.
    """
    each, together = [piled_ends(row) for row in outputs], piled_ends(outputs.ravel())
    if together is None and not any(each):
        return None
    nowhere = (-np.inf, np.inf)
    # A channel that never moves is no motor.
    pairs = [
        np.array([own or nowhere, together or nowhere]) if np.ptp(row) > 0.0 else np.array([nowhere])
        for own, row in zip(each, outputs, strict=True)
    ]
    return np.array([[pair[:, 0].max()] for pair in pairs]), np.array([[pair[:, 1].min()] for pair in pairs])


def in_flight(record: FlightRecord, time_s: FloatArray) -> BoolArray:
    """Which stamps lie in a flight; none where the vehicle never flew."""
    try:
        intervals = airborne(record).intervals
    except InsufficientDataError:
        intervals = ()
    return within(time_s, intervals)


def _throttle(record: FlightRecord, time_s: FloatArray) -> FloatArray:
    """Throttle that goes straight to the mixer; not a number where a controller stands between, or none is logged."""
    straight = "thrust_command" in record and record["thrust_command"].channel.source == _NO_CONTROLLER
    if not straight or "thrust_stick" not in record:
        return np.full(time_s.size, np.nan)
    track = record["thrust_stick"]
    kept = np.isfinite(track.values) & np.isfinite(track.time_s)
    stamps, first = np.unique(track.time_s[kept], return_index=True)
    return np.interp(time_s, stamps, track.values[kept][first]) if stamps.size else np.full(time_s.size, np.nan)
