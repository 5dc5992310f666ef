"""Channels that someone joined by straight lines between slower samples, and the samples that they were."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from rotorid.data.findings import Finding
from rotorid.data.immutable import Immutable, read_only
from rotorid.typing import FloatArray

_STRAIGHT = 1e-6
_LEAST_KNOTS = 5
_MOST_KNOTS = 0.35
_LEVEL = 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class Interpolated(Immutable):
    """The samples between which channels were joined by straight lines.

    Parameters
    ----------
    time_s
        Of the samples, shape ``(n,)``; the ends of the record are among them.
    values
        Shape ``(channels, n)``.
    logged_rate_hz
        At which the joined channels came.
    """

    time_s: FloatArray
    values: FloatArray
    logged_rate_hz: float

    def __post_init__(self) -> None:
        self._set(time_s=read_only(self.time_s, np.float64, ndim=1), values=read_only(self.values, np.float64, ndim=2))

    @property
    def sample_rate_hz(self) -> float:
        """Median rate of the true samples."""
        return float(1.0 / np.median(np.diff(self.time_s)))

    def smooth(self, time_s: FloatArray) -> FloatArray:
        """Channels joined anew by a cubic spline, shape ``(channels, m)``.

        Holds for motion that the true samples follow; what was faster is lost, and the spline invents nothing for it.
        """
        from scipy.interpolate import CubicSpline

        return np.asarray(CubicSpline(self.time_s, self.values, axis=1)(time_s), dtype=np.float64)

    def finding(self, where: str) -> Finding:
        """A remark that the channels are slower than they look."""
        return Finding(
            kind="interpolated_channel",
            severity="warning",
            where=where,
            message=f"{where} comes at {self.logged_rate_hz:.0f} Hz, but was joined by straight lines between samples "
            f"at {self.sample_rate_hz:.1f} Hz: what is faster than {0.5 * self.sample_rate_hz:.1f} Hz is lost.",
            numbers={"rate_hz": self.sample_rate_hz, "logged_rate_hz": self.logged_rate_hz},
        )


def interpolated(time_s: FloatArray, values: FloatArray) -> Interpolated | None:
    """The true samples of channels that are straight lines in between; ``None`` where they are not.

    Parameters
    ----------
    time_s
        Stamps, rising, shape ``(n,)``.
    values
        Channels that were sampled and joined together, shape ``(channels, n)``. True samples need not fall on stamps:
        each is where the lines beside it meet, in the channel that bends most there.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> slow, fast = np.arange(0.0, 10.0, 0.1), np.arange(0.0, 9.9, 0.01)
    >>> found = interpolated(fast + 0.003, np.interp(fast + 0.003, slow, rng.standard_normal(slow.size))[None])
    >>> round(found.sample_rate_hz, 3)
    10.0
    """
    if time_s.size < 3 * _LEAST_KNOTS:
        return None
    slopes = np.diff(values, axis=1) / np.diff(time_s)
    span = np.ptp(values, axis=1, keepdims=True) / np.median(np.diff(time_s))
    bends = np.abs(np.diff(slopes, axis=1)) > _STRAIGHT * np.where(span > 0.0, span, np.inf)
    bent = np.flatnonzero(bends.any(axis=0)) + 1
    if bent.size < _LEAST_KNOTS or bent.size > 2 * _MOST_KNOTS * time_s.size:
        return None
    edges = np.concatenate([[0], bent, [time_s.size - 1]])
    lines = [(begin, end) for begin, end in itertools.pairwise(edges) if end - begin >= 2]
    if len(lines) < _LEAST_KNOTS or len(lines) > _MOST_KNOTS * time_s.size or _held(values, lines):
        return None
    knots = [_meeting(time_s, values, before, after) for before, after in itertools.pairwise(lines)]
    times = np.array([time_s[0], *(at for at, _ in knots), time_s[-1]])
    levels = np.column_stack([values[:, 0], *(level for _, level in knots), values[:, -1]])
    kept = np.concatenate([[True], np.diff(times) > 0.0])
    rate_hz = float(1.0 / np.median(np.diff(time_s)))
    return Interpolated(time_s=times[kept], values=levels[:, kept], logged_rate_hz=rate_hz)


def _held(values: FloatArray, lines: list[tuple[int, int]]) -> bool:
    """Whether most lines are level: samples that were held are no joined ones."""
    level = [np.array_equal(values[:, begin], values[:, end]) for begin, end in lines]
    return float(np.mean(level)) > _LEVEL


def _meeting(
    time_s: FloatArray, values: FloatArray, before: tuple[int, int], after: tuple[int, int]
) -> tuple[float, FloatArray]:
    """Where two lines meet, and the values of all channels there."""
    (start, end), (begin, stop) = before, after
    early = (values[:, end] - values[:, start]) / (time_s[end] - time_s[start])
    late = (values[:, stop] - values[:, begin]) / (time_s[stop] - time_s[begin])
    most = int(np.argmax(np.abs(late - early)))
    turn = float(late[most] - early[most])
    at = time_s[end]
    if turn != 0.0:
        reached = values[most, end] + late[most] * (time_s[begin] - time_s[end])
        at = time_s[end] + float((values[most, begin] - reached) / -turn)
    at = float(np.clip(at, time_s[end], time_s[begin]))
    return at, values[:, end] + early * (at - time_s[end])
