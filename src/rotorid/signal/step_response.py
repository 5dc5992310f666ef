r"""What a step of a command says without a model: gain, delay, rise time, and the bandwidth that follows from it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.data.history import TimeHistory
from rotorid.data.immutable import Immutable
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.typing import FloatArray

BANDWIDTH_TIMES_RISE = 0.35
"""Half-power bandwidth (Hz) times rise time of a first-order lag, ln 9 / 2π; a second order has 0.32 at damping 0.4."""

LARGEST_CREEP = 0.1
"""Up to this share of the step a response may still move in its last third and count as settled."""

_JUMP = 0.5
_SHORTEST = 6
_SETTLING = 3


@dataclass(frozen=True, kw_only=True)
class StepResponse(Immutable):
    r"""Answer of one channel to one step.

    Parameters
    ----------
    start_s
        Time of the first sample of the new command, on the clock of the log.
    step
        Change of the command.
    change
        Change of the response, from its mean before the step to the median of the last third after it.
    delay_s
        From the step until 10 % of the change is there: pure delay, and the first part of the lag.
    half_s
        From the step until half of the change is there.
    rise_s
        From 10 % to 90 %, between samples interpolated.
    rise_noise_s
        Standard deviation of the rise time from the noise before the step alone, by the slopes at its two ends.
    creep
        How far the response still moves in the last third, as a share of the change. A steady value that is not steady
        makes a rise time of anything.
    overshoot
        Highest value over the change, less one.
    """

    start_s: float
    step: float
    change: float
    delay_s: float
    half_s: float
    rise_s: float
    rise_noise_s: float
    creep: float
    overshoot: float

    @property
    def gain(self) -> float:
        """Change of the response over that of the command."""
        return self.change / self.step

    @property
    def settled(self) -> bool:
        return abs(self.creep) <= LARGEST_CREEP


@dataclass(frozen=True, kw_only=True)
class Bandwidth(Immutable):
    r"""Rise time of several steps, and the bandwidth that follows.

    Parameters
    ----------
    rise_s, rise_std_s
        Mean, and standard deviation of a single step; of one step alone that from its noise.
    bandwidth_hz, bandwidth_std_hz
        :math:`0.35 / t_r` and :math:`0.35 \, \sigma / t_r^2`.
    steps
        How many there were.
    """

    rise_s: float
    rise_std_s: float
    bandwidth_hz: float
    bandwidth_std_hz: float
    steps: int


def step_responses(history: TimeHistory, *, command: str, response: str) -> tuple[StepResponse, ...]:
    r"""Every step of a command in a record, and what a channel answered.

    A step is a change between two samples of at least half the range of the command. Its answer lasts until the next
    step or the end. Times count from the first sample of the new command: a log that shows a command before it was
    sent makes every delay too long, by up to a sample.

    Parameters
    ----------
    history
        Holds both channels.
    command, response
        Their names.

    Returns
    -------
    tuple
        In order of time; empty for a command without a step.

    Raises
    ------
    InsufficientDataError
        An answer is shorter than six samples, or never leaves its initial value.
    UsageError
        A channel is not there.

    Examples
    --------
    A lag of 0.2 s, asked at 1 s; its rise time is 0.2 ln 9:

    >>> from rotorid.data.channel import Channel
    >>> time_s = np.arange(0.0, 4.0, 0.01)
    >>> asked = (time_s >= 1.0).astype(float)
    >>> answer = np.where(time_s >= 1.0, 1.0 - np.exp(-(time_s - 1.0) / 0.2), 0.0)
    >>> history = TimeHistory(values=np.stack([asked, answer]), sample_rate_hz=100.0, start_s=0.0,
    ...                       channels=(Channel(name="phi_setpoint", unit="rad"), Channel(name="phi", unit="rad")))
    >>> (step,) = step_responses(history, command="phi_setpoint", response="phi")
    >>> round(step.rise_s, 3), round(0.2 * math.log(9.0), 3), round(step.gain, 4)
    (0.439, 0.439, 1.0)
    """
    for name in (command, response):
        if name not in history.names:
            raise UsageError(f"there is no channel {name!r}", needed=f"one of {', '.join(history.names)}")
    asked, answer = history[command], history[response]
    starts = _starts(asked)
    ends = [0, *starts, asked.size]
    return tuple(_one(history.time_s, asked, answer, part) for part in zip(ends, ends[1:], ends[2:], strict=False))


def rise_time_bandwidth(steps: Sequence[StepResponse]) -> Bandwidth:
    r"""Bandwidth of the channel from the rise times of several steps.

    .. math:: f_b = \frac{0.35}{\bar t_r}, \qquad \sigma_{f} = \frac{0.35}{\bar t_r^2} \, \sigma_{t_r}

    The product is that of a first-order lag, whose half-power bandwidth this is, and within a tenth right for second
    orders with a damping of 0.4 and more. The spread of the steps is that of a single step, not of the mean.

    Parameters
    ----------
    steps
        Of one channel.

    Raises
    ------
    InsufficientDataError
        There is none.

    References
    ----------
    The design of the random binary signals of the Bebop 2, appendix "System bandwidth" and its footnote.

    Examples
    --------
    >>> from dataclasses import replace
    >>> one = StepResponse(start_s=0.0, step=1.0, change=1.0, delay_s=0.05, half_s=0.1, rise_s=0.25, rise_noise_s=0.0,
    ...                    creep=0.0, overshoot=0.0)
    >>> found = rise_time_bandwidth([one, replace(one, rise_s=0.35)])
    >>> round(found.bandwidth_hz, 3), round(found.bandwidth_std_hz, 3)
    (1.167, 0.275)
    """
    if not steps:
        raise InsufficientDataError("no step came", needed="one and more", remedy="name the command that was stepped")
    rise = np.array([step.rise_s for step in steps])
    mean = float(rise.mean())
    spread = float(rise.std(ddof=1)) if rise.size > 1 else steps[0].rise_noise_s
    return Bandwidth(
        rise_s=mean,
        rise_std_s=spread,
        bandwidth_hz=BANDWIDTH_TIMES_RISE / mean,
        bandwidth_std_hz=BANDWIDTH_TIMES_RISE * spread / mean**2,
        steps=rise.size,
    )


def _starts(asked: FloatArray) -> list[int]:
    """Samples that are the first of a new command."""
    changes = np.abs(np.diff(asked))
    span = float(np.ptp(asked))
    return [] if span == 0.0 else [int(k) + 1 for k in np.flatnonzero(changes >= _JUMP * span)]


def _one(time_s: FloatArray, asked: FloatArray, answer: FloatArray, part: tuple[int, int, int]) -> StepResponse:
    before, start, stop = part
    after = answer[start:stop]
    if after.size < _SHORTEST:
        raise InsufficientDataError(
            f"the step at {time_s[start]:.2f} s is followed by {after.size} samples",
            needed=f"{_SHORTEST} and more before the next step or the end",
        )
    # Half of what lies before: the first half may still answer an earlier step.
    rest = answer[before + (start - before) // 2 : start + 1]
    last = after[after.size - after.size // _SETTLING :]
    initial = float(rest.mean())
    change = float(np.median(last)) - initial
    noise = float(rest.std())
    if not abs(change) > 2.0 * noise:
        raise InsufficientDataError(
            f"the response to the step at {time_s[start]:.2f} s does not leave its initial value",
            needed="a change of more than twice the noise before it",
            remedy="name the channel that answers to this command",
        )
    share = (after - initial) / change
    step_s = float(time_s[1] - time_s[0])
    first, early, half, late, most = (_passed(share, level) * step_s for level in (0.1, 0.2, 0.5, 0.8, 0.9))
    return StepResponse(
        start_s=float(time_s[start]),
        step=float(np.median(asked[start:stop]) - asked[start - 1]),
        change=change,
        delay_s=first,
        half_s=half,
        rise_s=most - first,
        # Noise over slope at both ends; the slopes are those of a tenth of the change beside them.
        rise_noise_s=noise / abs(change) * math.hypot(early - first, most - late) / 0.1,
        creep=float(np.polyfit(np.linspace(0.0, 1.0, last.size), last, 1)[0]) / change,
        overshoot=float(share.max()) - 1.0,
    )


def _passed(share: FloatArray, level: float) -> float:
    """Samples after the step at which a level is first passed, between two of them on a straight line."""
    later = int(np.argmax(share >= level))
    if later == 0:
        return 0.0
    return later - 1 + (level - float(share[later - 1])) / float(share[later] - share[later - 1])
