r"""Thrust over weight from the motion alone, and whether it ever stood at a limit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotorid.data.findings import Finding
from rotorid.data.history import TimeHistory
from rotorid.data.immutable import Immutable
from rotorid.errors import UsageError
from rotorid.signal.filters import low_pass
from rotorid.signal.reconstruct import derivative, has_channels
from rotorid.typing import BoolArray, FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

CHANNELS = ("velocity_down", "phi", "theta")
"""What the thrust follows from."""

_WIDTH = 0.02
_FLAT = 2.0 / 3.0
_LEAST_STAY_S = 0.3


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

    >>> from rotorid.data.channel import Channel
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
    >>> [thrust_limit(one, sample_rate_hz=20.0).saturated for one in (thrust, np.minimum(thrust, 1.2))]
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
    said = (
        f"Thrust stood for {stay_s:.2f} s at {highest:.2f} times the weight, the highest value of the record; models "
        "without that limit are not valid there."
        if saturated
        else f"Thrust reached {highest:.2f} times the weight and stayed at that for {stay_s:.2f} s at most; no limit "
        "shows."
    )
    return Finding(
        kind="thrust_limit",
        severity="warning" if saturated else "info",
        where="velocity_down",
        message=said,
        numbers={"highest": highest, "longest_stay_s": stay_s},
    )
