r"""Tracking of the gain of a model through a flight, with detection of its steps.

The model predicts the body rate from the logged command; prediction :math:`z` and rate :math:`p` pass the same
band-pass, and both are whitened by what the reference leaves unexplained. Under feedback the command answers gusts, so
the instrument :math:`w` is the part of :math:`z` that the stick explains (eight Laguerre filters, fitted to the
reference). In blocks of half a second

.. math:: N = \sum w (p - g_0 z), \quad D = g_0 \sum w z, \quad v = \sigma^2 \sum w^2 + (f D)^2

two cumulative sums of :math:`(\pm \delta N D - \delta^2 D^2 / 2) / v`, each step held within :math:`\pm 3` and each sum
above zero, ask whether the gain rose or fell by the share :math:`\delta`. A block without excitation counts nothing.
One is an alarm beyond :math:`\ln` of twice the blocks of an hour: about one false alarm an hour, if the noise is what
it is held to be. After one the gain is measured anew, over eight seconds of usable blocks. What is not known to hold, a
stick that hardly moves or air that became rougher than that of the reference, makes a block unusable.

References
----------
Basseville and Nikiforov, "Detection of Abrupt Changes", 1993.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from scipy import linalg, signal

from rotorid.data.base import Immutable, read_only
from rotorid.data.trust import REFERENCE_S, STEP_SHARE
from rotorid.errors import InsufficientDataError
from rotorid.typing import FloatArray

RATE_HZ = 50.0
"""Sample rate of the signals; the band ends well below half of it."""

BAND_HZ = (0.5, 6.0)
"""Band in which prediction and rate are compared."""

LEAST_LEVEL = 0.15
"""Stick motion below which a block is unusable."""

THRESHOLD = math.log(2.0 * 3600.0 / 0.5)
"""Of a cumulative sum: one false alarm an hour by the blocks of an hour, both directions counted."""

BLOCK_S = 0.5
"""Length of a block."""

_BLOCK = round(BLOCK_S * RATE_HZ)
_SETTLED = round(2.0 * RATE_HZ)
_LAGUERRE, _LAGUERRE_RAD_S = 8, 12.0
_RIDGE = 1e-3
_WHITENING = 8

_SHAPE_SHARE = 0.02
"""Share of the prediction by which the model may err in shape, in addition to noise; it does not average out."""

_CLIP = 3.0
"""The most by which one block moves a cumulative sum."""

_LEVEL_BLOCKS = 30
"""Blocks over which the largest stick is looked for: 15 s."""

_NOISE_BLOCKS = 40
"""Blocks over which the noise is remembered: 20 s."""

_NEW_GAIN_BLOCKS = 16
"""Usable blocks over which the gain is measured again after an alarm: 8 s."""

_ROUGHER, _CALM_AGAIN = 2.0, 1.3
"""Power of what is unexplained over that of the reference from which air is too rough, and below which it
is trusted again."""

_FOLLOW_S = 8.0
"""Time constant with which the gain is followed."""

_WIDER = 1.5

_THRUST_UNKNOWN = 0.8
"""Relative error of the gain by unit of the logarithm of thrust where the power of thrust is not known."""

_LEAST_REFERENCE_S, _LEAST_AFTER_S = 30.0, 5.0
"""Seconds of the reference at least, and of the flight after it."""

Why: TypeAlias = Literal["", "reference", "stick", "air"]
"""Why a block is unusable: it is part of the reference, the stick barely moves, or the air is rougher."""


@dataclass(frozen=True, kw_only=True)
class Step(Immutable):
    """A step of the gain that was found.

    Parameters
    ----------
    at_s
        When the sum passed its threshold.
    since_s
        When it began to grow, which is about when the gain changed.
    ratio, std
        Gain after it over that of the reference, from what came since.
    """

    at_s: float
    since_s: float
    ratio: float
    std: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Tracking(Immutable):
    """A gain through a flight, in blocks of half a second.

    Parameters
    ----------
    time_s
        End of each block, shape ``(blocks,)``.
    ratio, std
        Gain over that of the reference, followed with a time constant of 8 s, and its standard deviation.
    cannot_tell
        Why a block is unusable; empty where it is usable.
    steps
        What was found.
    reference_gain
        Gain of the reference over that of the model.
    thrust_exponent
        Power of the thrust command that schedules the gain; ``None`` where it is unknown.
    level
        Largest stick of the last 15 s at each block.
    rougher
        Power of what is left unexplained over that of the reference.
    """

    time_s: FloatArray
    ratio: FloatArray
    std: FloatArray
    cannot_tell: tuple[Why, ...]
    steps: tuple[Step, ...]
    reference_gain: float
    thrust_exponent: float | None
    level: FloatArray
    rougher: FloatArray

    def __post_init__(self) -> None:
        for name in ("time_s", "ratio", "std", "level", "rougher"):
            self._set(**{name: read_only(getattr(self, name), np.float64, ndim=1)})

    @property
    def told_s(self) -> float:
        """Usable seconds."""
        return BLOCK_S * sum(not why for why in self.cannot_tell)


def track_gain(
    command: FloatArray,
    measured: FloatArray,
    stick: FloatArray,
    *,
    predict: Callable[[FloatArray], FloatArray],
    thrust: FloatArray | None = None,
    thrust_exponent: float | None = None,
    start_s: float = 0.0,
    reference_s: float = REFERENCE_S,
    step_share: float = STEP_SHARE,
) -> Tracking:
    """Follow the gain of a model through a flight.

    Parameters
    ----------
    command, measured
        Command of the axis and rate as logged, at :data:`RATE_HZ`, shape ``(n,)``.
    stick
        What excites the axis and holds no feedback, 1 for full.
    predict
        The model: rate of a command, linear.
    thrust
        Thrust command, by a power of which the gain grows where thrust is not linear; ``None`` where it is not logged.
    thrust_exponent
        That power; where it is not known it is taken from the reference if the throttle moved there.
    start_s
        Time of the first sample.
    reference_s
        At the beginning, what all else is compared with.
    step_share
        The change that is looked for.

    Raises
    ------
    InsufficientDataError
        The flight is no longer than its reference, or the stick did not move in it.
    """
    whole = measured.size // _BLOCK * _BLOCK
    first = round(reference_s / BLOCK_S) * _BLOCK
    require_length(measured.size / RATE_HZ, reference_s)
    level = _levels(stick[:whole])
    if float(np.quantile(level[: first // _BLOCK], 0.9)) < LEAST_LEVEL:
        raise InsufficientDataError(
            f"the stick moved only {float(level[: first // _BLOCK].max()):.2f} of full in the reference",
            needed=f"{LEAST_LEVEL:g} and more",
            remedy="lengthen the reference with --first, or track another axis with --model",
        )
    logs = _log_thrust(thrust, whole, first)
    moved = command[:whole] - float(np.median(command[:whole]))
    exponent = thrust_exponent
    if exponent is None:
        exponent = _exponent(predict(moved), predict(moved * logs), measured, float(np.std(logs[:first])), first)
    # Thrust acts on what is asked of the rotors, before it turns the vehicle.
    scheduled = predict(moved * np.exp((exponent or 0.0) * logs))
    p, z, s = (_banded(values) for values in (measured[:whole], scheduled, stick[:whole]))
    w = _explained(z, s, first)
    gain = float(w[_SETTLED:first] @ p[_SETTLED:first]) / float(w[_SETTLED:first] @ z[_SETTLED:first])
    whitening = _whitening((p - gain * z)[_SETTLED:first])
    _, rougher = _noise(p, z, gain, first)
    p, z, w = (_filtered(whitening, [1.0], values) for values in (p, z, w))
    used = slice(_SETTLED, first)
    gain = float(w[used] @ p[used]) / float(w[used] @ z[used])
    blocks = _Blocks(p, z, w, logs if exponent is None else None, gain, rougher)
    noise, _ = _noise(p, z, gain, first)
    noise = noise * _scatter(blocks, noise, first)
    why = _why(level, rougher, first)
    steps = tuple(_steps(blocks, noise, why, step_share, start_s))
    ratio, std = _followed(blocks, noise, why)
    return Tracking(
        time_s=np.asarray(start_s + BLOCK_S * np.arange(1, whole // _BLOCK + 1), dtype=np.float64),
        ratio=ratio,
        std=std,
        cannot_tell=why,
        steps=steps,
        reference_gain=gain,
        thrust_exponent=exponent,
        level=level,
        rougher=rougher,
    )


def _banded(values: FloatArray) -> FloatArray:
    """Causal, as all of this could be done while flying."""
    sections = signal.butter(2, BAND_HZ, "bandpass", fs=RATE_HZ, output="sos")
    return np.asarray(signal.sosfilt(sections, values - values[0]))


def require_length(flight_s: float, reference_s: float, *, what: str = "flight") -> None:
    """Refuse a reference that is too short, or a flight that ends with it.

    Raises
    ------
    InsufficientDataError
        It is so.
    """
    if not reference_s >= _LEAST_REFERENCE_S or flight_s < reference_s + _LEAST_AFTER_S:
        raise InsufficientDataError(
            f"{flight_s:.0f} s of {what} is too short with a reference of {reference_s:g} s",
            needed=f"a reference of {_LEAST_REFERENCE_S:g} s or more, and {_LEAST_AFTER_S:g} s of flight after it",
            remedy="choose another length of the reference with --first",
        )


def _filtered(b: Sequence[float] | FloatArray, a: Sequence[float], values: FloatArray) -> FloatArray:
    return np.asarray(signal.lfilter(np.asarray(b, dtype=np.float64), np.asarray(a, dtype=np.float64), values))


def _levels(stick: FloatArray) -> FloatArray:
    """Largest deflection from the middle of the last seconds, at the end of each block."""
    middle = float(np.median(stick))
    peaks = np.abs(stick - middle).reshape(-1, _BLOCK).max(axis=1)
    return np.array([peaks[max(k - _LEVEL_BLOCKS + 1, 0) : k + 1].max() for k in range(peaks.size)])


def _log_thrust(thrust: FloatArray | None, whole: int, first: int) -> FloatArray:
    if thrust is None:
        return np.zeros(whole)
    hover = float(np.median(thrust[:first]))
    if not hover > 0.0:
        return np.zeros(whole)
    sections = signal.butter(1, 5.0, fs=RATE_HZ, output="sos")
    smooth = np.asarray(signal.sosfilt(sections, thrust[:whole] - hover)) + hover
    return np.asarray(np.log(np.clip(smooth / hover, 0.2, 5.0)), dtype=np.float64)


def _exponent(
    predicted: FloatArray, of_thrust: FloatArray, measured: FloatArray, moved: float, first: int
) -> float | None:
    """Power of thrust, by least squares over the reference; zero if the throttle did not move."""
    if moved < 0.02:
        return None if float(np.std(of_thrust)) > 0.02 * float(np.std(predicted)) else 0.0
    z, zt, p = (_banded(values)[:first] for values in (predicted, of_thrust, measured))
    found, *_ = np.linalg.lstsq(np.stack([z, zt], axis=1), p, rcond=None)
    rest = p - found[0] * z - found[1] * zt
    # Errors are colored: a tenth of the samples counts.
    own = zt - float(z @ zt) / float(z @ z) * z
    std = math.sqrt(10.0 * float(rest @ rest) / first / max(float(own @ own), 1e-300)) / max(
        abs(float(found[0])), 1e-12
    )
    return float(found[1] / found[0]) if std < 0.15 else None


def _explained(z: FloatArray, stick: FloatArray, first: int) -> FloatArray:
    """The part of the prediction that the stick explains, by Laguerre filters with weights that the reference gives."""
    pole = math.exp(-_LAGUERRE_RAD_S / RATE_HZ)
    filtered = _filtered([math.sqrt(1.0 - pole**2)], [1.0, -pole], stick)
    columns = []
    for _ in range(_LAGUERRE):
        columns.append(filtered)
        filtered = _filtered([-pole, 1.0], [1.0, -pole], filtered)
    basis = np.stack(columns, axis=1)
    gram = basis[:first].T @ basis[:first]
    gram[np.diag_indices(_LAGUERRE)] += _RIDGE * float(np.trace(gram)) / _LAGUERRE
    return np.asarray(basis @ linalg.solve(gram, basis[:first].T @ z[:first], assume_a="pos"))


def _whitening(rest: FloatArray) -> FloatArray:
    """Coefficients of a filter that makes the residual white, by Yule and Walker."""
    lags = np.array([float(rest[k:] @ rest[: rest.size - k]) for k in range(_WHITENING + 1)])
    lags[0] *= 1.0 + 1e-4
    return np.concatenate([[1.0], -np.asarray(linalg.solve_toeplitz(lags[:-1], lags[1:]), dtype=np.float64)])


class _Blocks:
    """Sums of each block."""

    def __init__(
        self,
        p: FloatArray,
        z: FloatArray,
        w: FloatArray,
        logs: FloatArray | None,
        gain: float,
        rougher: FloatArray,
    ) -> None:
        def summed(values: FloatArray) -> FloatArray:
            return np.asarray(values.reshape(-1, _BLOCK).sum(axis=1))

        self.n = summed(w * (p - gain * z))
        self.d = gain * summed(w * z)
        self.w2 = summed(w * w)
        # Where the power of thrust is not known, a block under other thrust errs by as much as it could be.
        moved = np.zeros(self.n.size) if logs is None else np.abs(logs).reshape(-1, _BLOCK).max(axis=1)
        # Rougher air moves the vehicle as its model does not, and more than by noise.
        share = _SHAPE_SHARE * np.maximum(rougher, 1.0)
        self.shape = np.hypot(share, _THRUST_UNKNOWN * moved) * np.abs(self.d)


def _noise(p: FloatArray, z: FloatArray, gain: float, first: int) -> tuple[FloatArray, FloatArray]:
    """Variance of what is unexplained at each block, from the seconds before it, and over that of the reference.

    The gain of each four seconds is taken out, so that a step of it is no noise.
    """
    length = 4 * round(RATE_HZ)
    variance = []
    for start in range(0, p.size, _BLOCK):
        part = slice(max(start + _BLOCK - length, 0), start + _BLOCK)
        power = float(z[part] @ z[part])
        local = float(z[part] @ p[part]) / power if power > 0.0 else gain
        rest = p[part] - np.clip(local, 0.5 * gain, 1.5 * gain) * z[part]
        variance.append(float(rest @ rest) / rest.size)
    found = np.array(variance)
    usual = float(np.median(found[8 : first // _BLOCK]))
    followed = np.array([float(np.median(found[max(k - _NOISE_BLOCKS, 8) : max(k, 9)])) for k in range(found.size)])
    # A gust counts when it comes, and for as long as it is remembered.
    return np.maximum(np.maximum(followed, found), 0.5 * usual), followed / max(usual, 1e-300)


def _scatter(blocks: _Blocks, noise: FloatArray, first: int) -> float:
    """How much more the sums of the reference scatter than white noise would, one at least."""
    used = slice(_SETTLED // _BLOCK, first // _BLOCK)
    expected = noise[used] * blocks.w2[used] + blocks.shape[used] ** 2
    kept = expected > 0.0
    return max(float(np.mean(blocks.n[used][kept] ** 2 / expected[kept])), 1.0)


def _why(level: FloatArray, rougher: FloatArray, first: int) -> tuple[Why, ...]:
    reasons: list[Why] = []
    rough = False
    for k in range(level.size):
        # Air that became rough is trusted again when it is nearly as calm as it was.
        rough = rougher[k] > (_CALM_AGAIN if rough else _ROUGHER)
        if k < first // _BLOCK:
            reasons.append("reference")
            rough = False
        elif rough:
            reasons.append("air")
        else:
            reasons.append("stick" if level[k] < LEAST_LEVEL else "")
    return tuple(reasons)


class _Sums:
    """Both cumulative sums against a gain, and since when each has grown."""

    def __init__(self, base: float) -> None:
        self.base = base
        self.sums = {1.0: 0.0, -1.0: 0.0}
        self.since = {1.0: 0, -1.0: 0}

    def forget(self) -> None:
        self.sums = dict.fromkeys(self.sums, 0.0)

    def add(self, k: int, n: float, d: float, v: float, share: float) -> float | None:
        """Take one block in; the direction of a step that is beyond the threshold."""
        share *= self.base
        for sign in self.sums:
            grown = (sign * share * n * d - 0.5 * (share * d) ** 2) / max(v, 1e-300)
            if self.sums[sign] <= 0.0:
                self.since[sign] = k
            self.sums[sign] = max(self.sums[sign] + float(np.clip(grown, -_CLIP, _CLIP)), 0.0)
        sign = max(self.sums, key=lambda sign: self.sums[sign])
        return sign if self.sums[sign] > THRESHOLD else None


def _steps(blocks: _Blocks, noise: FloatArray, why: tuple[Why, ...], share: float, start_s: float) -> Iterator[Step]:
    """Alarms of both sums; after each the gain is measured again from the data since the change."""
    v = noise * blocks.w2 + blocks.shape**2
    sums = _Sums(1.0)
    found: tuple[int, int] | None = None
    seen = 0
    for k, cannot in enumerate(why):
        if cannot:
            if cannot == "air":
                sums.forget()
            continue
        if found is not None:
            # The new gain is measured before the next step is looked for.
            seen += 1
            if seen < _NEW_GAIN_BLOCKS:
                continue
            step = _step(blocks, v, why, found[0], found[1], k + 1, start_s)
            yield step
            # What passed by leaves the gain where it was.
            stays = abs(step.ratio - sums.base) > 0.5 * share * sums.base
            sums, found, seen = _Sums(step.ratio if stays else sums.base), None, 0
            continue
        n = float(blocks.n[k] - (sums.base - 1.0) * blocks.d[k])
        sign = sums.add(k, n, float(blocks.d[k]), float(v[k]), share)
        if sign is not None:
            found = sums.since[sign], k + 1
    if found is not None:
        yield _step(blocks, v, why, found[0], found[1], len(why), start_s)


def _step(
    blocks: _Blocks, v: FloatArray, why: tuple[Why, ...], since: int, seen: int, stop: int, start_s: float
) -> Step:
    """A step with the gain of the blocks since it began."""
    part = [k for k in range(since, stop) if not why[k]]
    weight = 1.0 / np.maximum(v[part], 1e-300)
    information = float((blocks.d[part] ** 2 * weight).sum())
    change = float((blocks.n[part] * blocks.d[part] * weight).sum()) / information
    return Step(
        at_s=start_s + BLOCK_S * seen,
        since_s=start_s + BLOCK_S * since,
        ratio=1.0 + change,
        std=_WIDER / math.sqrt(information),
    )


def _followed(blocks: _Blocks, noise: FloatArray, why: tuple[Why, ...]) -> tuple[FloatArray, FloatArray]:
    """The gain with exponential forgetting of usable blocks, over that of the reference."""
    keep = math.exp(-BLOCK_S / _FOLLOW_S)
    up = down = spread = 0.0
    ratio, std = np.ones(len(why)), np.full(len(why), np.inf)
    for k, cannot in enumerate(why):
        if cannot not in ("stick", "air"):
            up, down = keep * up + blocks.n[k], keep * down + blocks.d[k]
            spread = keep**2 * spread + noise[k] * blocks.w2[k]
        if down > 0.0:
            ratio[k] = 1.0 + up / down
            std[k] = _WIDER * math.hypot(math.sqrt(spread) / down, _SHAPE_SHARE)
        std[k] = min(float(std[k]), 10.0)
    return ratio, std
