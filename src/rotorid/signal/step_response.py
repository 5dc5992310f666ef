"""What a flight says without a model: step responses, the limit of thrust, and how strongly the axes are coupled.

A step of a command has a gain, a delay and a rise time, and the bandwidth follows from the rise time. Thrust over
weight follows from the motion alone. Whether an output answers to the commands of other axes is a test by least
squares.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.record import TimeHistory
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.signal.filters import low_pass
from rotorid.signal.kinematics import derivative, has_channels
from rotorid.typing import BoolArray, FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

BANDWIDTH_TIMES_RISE = 0.35
"""Half-power bandwidth (Hz) times rise time of a first-order lag, ln 9 / 2π; a second order has 0.32 at damping 0.4."""

LARGEST_CREEP = 0.1
"""Up to this share of the step a response may still move in its last third and count as settled."""

_JUMP = 0.5
"""Share of the range of the command from which a change is a step."""

_SHORTEST = 6
"""Samples after a step without which its response is not read."""

_SETTLING = 3
"""The last of so many parts of a response is its end."""


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

    >>> from rotorid.data.record import Channel
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
    return tuple(
        _step_response(history.time_s, asked, answer, part) for part in zip(ends, ends[1:], ends[2:], strict=False)
    )


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
    >>> step = StepResponse(start_s=0.0, step=1.0, change=1.0, delay_s=0.05, half_s=0.1, rise_s=0.25, rise_noise_s=0.0,
    ...                    creep=0.0, overshoot=0.0)
    >>> found = rise_time_bandwidth([step, replace(step, rise_s=0.35)])
    >>> round(found.bandwidth_hz, 3), round(found.bandwidth_std_hz, 3)
    (1.167, 0.275)
    """
    if not steps:
        raise InsufficientDataError("got no step", needed="one and more", remedy="name the command that was stepped")
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


def _step_response(
    time_s: FloatArray, asked: FloatArray, answer: FloatArray, part: tuple[int, int, int]
) -> StepResponse:
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


CHANNELS = ("velocity_down", "phi", "theta")
"""What the thrust follows from."""

_WIDTH = 0.02
"""Share of the range of thrust within which it counts as at its highest value."""

_FLAT = 2.0 / 3.0
"""A parabola stays near its top for half of the time that it stays within four times as far; a limit, longer."""

_LEAST_STAY_S = 0.3
"""A limit lasts as long."""


@dataclass(frozen=True, kw_only=True)
class ThrustLimit(Immutable):
    """Whether thrust stood still at the highest value that it reached.

    Parameters
    ----------
    highest
        Highest thrust over weight.
    longest_stay_s
        Longest time without a break within ``width`` of it.
    width
        What counted as the same value, thrust over weight.
    flatness
        That time over the one within four times ``width`` around it: a half for the top of a parabola, one for a
        plateau with steep sides.
    saturated
        Whether it is a plateau.
    finding
        The same in a sentence.
    """

    highest: float
    longest_stay_s: float
    width: float
    flatness: float
    saturated: bool
    finding: Finding


def thrust_over_weight(history: TimeHistory, *, cutoff_rad_s: float | None = None) -> FloatArray:
    r"""Thrust over weight that the vertical motion and the attitude imply.

    .. math:: \frac{T}{m g} = \frac{1 - \dot v_{down} / g}{\cos\phi \, \cos\theta}

    Holds where thrust is all that acts vertically besides weight: vertical drag and gusts count as thrust.

    Parameters
    ----------
    history
        Holds ``velocity_down``, ``phi`` and ``theta``.
    cutoff_rad_s
        Zero-phase low-pass before the derivative, which would otherwise make noise of motion capture a thrust:
        0.02 m/s at 20 Hz is 0.05 of the weight. Nothing by default, for velocities that were filtered already. A limit
        that lasts less than about :math:`2 / \omega_c` is rounded off.

    Returns
    -------
    FloatArray
        Shape ``(samples,)``.

    Raises
    ------
    UsageError
        A channel is missing.

    References
    ----------
    Identification of the Bebop 2 with random binary signals, appendix "Thrust saturation".

    Examples
    --------
    Level hover carries the weight, and so does a constant climb:

    >>> from rotorid.data.record import Channel
    >>> history = TimeHistory(values=np.stack([np.full(50, -1.0), np.zeros(50), np.zeros(50)]), sample_rate_hz=20.0,
    ...                       start_s=0.0, channels=tuple(Channel(name=name, unit="1") for name in CHANNELS))
    >>> bool(np.allclose(thrust_over_weight(history), 1.0))
    True
    """
    if not has_channels(history, CHANNELS):
        missing = [name for name in CHANNELS if name not in history.names]
        raise UsageError(f"there is no {' and no '.join(missing)}", needed=", ".join(CHANNELS))
    smooth = history if cutoff_rad_s is None else low_pass(history, cutoff_rad_s=cutoff_rad_s)
    climb = -derivative(smooth["velocity_down"], smooth.sample_rate_hz)
    upright = np.cos(smooth["phi"]) * np.cos(smooth["theta"])
    ratio: FloatArray = (1.0 + climb / STANDARD_GRAVITY_M_S2) / upright
    return ratio


def thrust_limit(ratio: FloatArray, *, sample_rate_hz: float, width: float | None = None) -> ThrustLimit:
    r"""Look for a plateau at the top of the thrust.

    The peaks of a smooth signal are parabolas: it stays within :math:`4 \epsilon` of its extreme twice as long as
    within :math:`\epsilon`. Less than one and a half times as long, and 0.3 s and more, is a limit. Its absence shows
    only that these maneuvers did not reach it; and one motor may be at its limit while the sum of all four is not.

    Parameters
    ----------
    ratio
        Thrust over weight, shape ``(samples,)``; see :func:`thrust_over_weight`.
    sample_rate_hz
        Its rate.
    width
        :math:`\epsilon`: 2 % of the range of the signal by default; at least twice the noise of the thrust, or a
        limit is not seen.

    Examples
    --------
    >>> time_s = np.arange(0.0, 20.0, 0.05)
    >>> thrust = 1.0 + 0.3 * np.sin(3.0 * time_s)
    >>> [thrust_limit(samples, sample_rate_hz=20.0).saturated for samples in (thrust, np.minimum(thrust, 1.2))]
    [False, True]
    """
    highest = float(ratio.max())
    epsilon = _WIDTH * float(np.ptp(ratio)) if width is None else width
    start, stop = _longest(ratio >= highest - epsilon)
    wide = ratio >= highest - 4.0 * epsilon
    left, right = np.flatnonzero(~wide[:start]), np.flatnonzero(~wide[stop:])
    around = (stop + int(right[0]) if right.size else ratio.size) - (int(left[-1]) + 1 if left.size else 0)
    stay_s, flatness = (stop - start) / sample_rate_hz, (stop - start) / around
    # A constant thrust, as in hover, has no highest value to stand at.
    moving = bool(np.ptp(ratio) > 4.0 * epsilon)
    saturated = moving and flatness > _FLAT and stay_s >= _LEAST_STAY_S
    return ThrustLimit(
        highest=highest,
        longest_stay_s=stay_s,
        width=epsilon,
        flatness=flatness,
        saturated=saturated,
        finding=_finding(highest, stay_s, saturated),
    )


def _longest(near: BoolArray) -> tuple[int, int]:
    """First sample of the longest row of true ones, and the one after its last."""
    edges = np.flatnonzero(np.diff(near.astype(np.int8), prepend=0, append=0))
    best = int(np.argmax(edges[1::2] - edges[::2]))
    return int(edges[2 * best]), int(edges[2 * best + 1])


def _finding(highest: float, stay_s: float, saturated: bool) -> Finding:
    message = (
        f"Thrust stood for {stay_s:.2f} s at {highest:.2f} times the weight, the highest value of the record; models "
        "without that limit are not valid there."
        if saturated
        else f"Thrust reached {highest:.2f} times the weight and stayed at that for {stay_s:.2f} s at most; no limit "
        "shows."
    )
    return (warn if saturated else remark)(
        "thrust_limit", "velocity_down", message, highest=highest, longest_stay_s=stay_s
    )


_LEAST_SAMPLES_PER_TERM = 3


@dataclass(frozen=True, kw_only=True)
class CrossTerms(Immutable):
    """What the commands of other axes add to the explanation of one output.

    Parameters
    ----------
    output, own, others
        Channels.
    own_share
        Share of the variance of the output that its own command explains.
    added_share
        Share of it that the others add.
    f_value
        Their F statistic.
    p_white
        Probability of a larger F where others do nothing, by the F distribution. It takes residuals for independent
        from sample to sample; they seldom are, and then it is far too small.
    p_shifted
        The same by experiment: the share of all cyclic shifts of the other commands, which destroy any answer to
        them and keep all spectra, with an F as large.
    """

    output: str
    own: str
    others: tuple[str, ...]
    own_share: float
    added_share: float
    f_value: float
    p_white: float
    p_shifted: float


def cross_terms(
    history: TimeHistory, *, output: str, own: str, others: Sequence[str], memory_s: float = 1.0
) -> CrossTerms:
    r"""Test whether an output depends on the commands of other axes.

    .. math:: y_k = c + \sum_{j=0}^{m} h_j u_{k-j} + \sum_i \sum_{j=0}^{m} g_{ij} w_{i,k-j} + e_k, \qquad
        F = \frac{(S_0 - S_1) / q}{S_1 / (n - r)}

    with S the residual sum of squares without and with the q terms of the other commands. Linear in everything: an
    effect that is a product, as of two tilts on the vertical thrust, is not seen.

    Parameters
    ----------
    history
        Holds the channels. All commands must move at once and independently: a command that follows another one, or
        the output, explains what is not its own.
    output, own, others
        The output, the command that it belongs to, and the commands to be tested.
    memory_s
        Length of the impulse responses, longer than the answers last.

    Raises
    ------
    UsageError
        A channel is missing.
    InsufficientDataError
        There are fewer than three samples for each term.

    References
    ----------
    Draper and Smith, *Applied Regression Analysis*, 3rd ed., section 6.1 (extra sum of squares). Shifted surrogates:
    Efron and Tibshirani, *An Introduction to the Bootstrap*, chapter 15 (permutation tests).

    Examples
    --------
    >>> from rotorid.data.record import Channel
    >>> rng = np.random.default_rng(0)
    >>> u, w, e = rng.standard_normal((3, 400))
    >>> names = ("y", "z", "u", "w")
    >>> history = TimeHistory(values=np.stack([u + 0.3 * e, u + 0.2 * w + 0.3 * e, u, w]), sample_rate_hz=20.0,
    ...                       start_s=0.0, channels=tuple(Channel(name=name, unit="1") for name in names))
    >>> [cross_terms(history, output=y, own="u", others=["w"], memory_s=0.2).p_shifted < 0.01 for y in ("y", "z")]
    [False, True]
    """
    for name in (output, own, *others):
        if name not in history.names:
            raise UsageError(f"there is no channel {name!r}", needed=f"one of {', '.join(history.names)}")
    lags = round(memory_s * history.sample_rate_hz) + 1
    samples = history.values.shape[1] - lags + 1
    terms = 1 + lags * (1 + len(others))
    if samples < _LEAST_SAMPLES_PER_TERM * terms:
        raise InsufficientDataError(
            f"got {max(samples, 0)} samples for {terms} terms",
            needed=f"{_LEAST_SAMPLES_PER_TERM} for each term",
            remedy="shorten the memory or take a longer record",
        )
    y = history[output][lags - 1 :]
    basis, _ = np.linalg.qr(np.column_stack([np.ones(samples), _lagged(history[own], lags)]))
    rest = y - basis @ (basis.T @ y)
    moved = np.stack([history[name] for name in others])
    added = np.array([_explained(np.roll(moved, shift, axis=1), lags, basis, rest) for shift in range(moved.shape[1])])
    total, left = float(np.sum((y - y.mean()) ** 2)), float(rest @ rest)
    free = samples - terms
    # A shift by less than the memory, either way, still holds some of the answer.
    apart = added[lags:-lags]
    from scipy.stats import f

    f_value = (float(added[0]) / (terms - 1 - lags)) / ((left - float(added[0])) / free)
    return CrossTerms(
        output=output,
        own=own,
        others=tuple(others),
        own_share=1.0 - left / total,
        added_share=float(added[0]) / total,
        f_value=f_value,
        p_white=float(f.sf(f_value, terms - 1 - lags, free)),
        p_shifted=(1.0 + float(np.sum(apart >= added[0]))) / (1.0 + apart.size),
    )


def _explained(commands: FloatArray, lags: int, basis: FloatArray, rest: FloatArray) -> float:
    """Sum of squares that commands explain of what the basis leaves over."""
    terms = np.column_stack([_lagged(command, lags) for command in commands])
    terms -= basis @ (basis.T @ terms)
    fitted = terms @ np.linalg.lstsq(terms, rest, rcond=None)[0]
    return float(fitted @ rest)


def _lagged(u: FloatArray, lags: int) -> FloatArray:
    """Rows of present and past samples, shape ``(samples - lags + 1, lags)``."""
    return np.lib.stride_tricks.sliding_window_view(u, lags)[:, ::-1]
