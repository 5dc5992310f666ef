"""Horizontal motion in a frame that turns with the heading, and back to earth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from rotorid.data.history import TimeHistory
from rotorid.errors import UsageError

_PLAIN: Mapping[tuple[str, str], tuple[str, str]] = {
    ("north", "east"): ("forward", "right"),
    ("velocity_north", "velocity_east"): ("velocity_forward", "velocity_right"),
}
EARTH_TO_HEADING: Mapping[tuple[str, str], tuple[str, str]] = {
    **_PLAIN,
    **{(f"{a}_setpoint", f"{b}_setpoint"): (f"{c}_setpoint", f"{d}_setpoint") for (a, b), (c, d) in _PLAIN.items()},
}
"""Horizontal channels in earth axes, and their names in the frame that turns with the heading."""


def to_heading(history: TimeHistory, *, yaw: str = "psi") -> TimeHistory:
    r"""Turn positions, velocities and their commands by the heading: what was north and east is forward and right.

    .. math::

        \begin{bmatrix} x_{fwd} \\ x_{right} \end{bmatrix} =
        \begin{bmatrix} \cos\psi & \sin\psi \\ -\sin\psi & \cos\psi \end{bmatrix}
        \begin{bmatrix} x_{north} \\ x_{east} \end{bmatrix}

    Takes a slow drift of the heading out of the motion, so that a pitch maneuver moves one channel only. The down axis
    stays, so tilt is not taken out: these are not ``u`` and ``v``. While the heading turns, the derivative of the
    turned position is not the turned velocity; they differ by the turn rate times the distance from the origin.

    Parameters
    ----------
    history
        Holds the heading and at least one pair of ``north``/``east`` or ``velocity_north``/``velocity_east``, or of
        their set-points. Every pair is turned and renamed; other channels stay.
    yaw
        Channel of the heading, rad.

    Raises
    ------
    UsageError
        The heading, any pair, or the partner of a channel is missing.

    References
    ----------
    The derotation by the measured yaw angle is common with motion capture; see the identification of the Parrot
    Bebop 2 with random binary signals, appendix "Yaw drift".

    Examples
    --------
    Flying east with the nose to the east is flying forward:

    >>> from rotorid.data.channel import Channel
    >>> names = {"velocity_north": "m/s", "velocity_east": "m/s", "psi": "rad"}
    >>> history = TimeHistory(
    ...     values=np.array([[0.0], [2.0], [np.pi / 2.0]]), sample_rate_hz=100.0, start_s=0.0,
    ...     channels=tuple(Channel(name=name, unit=unit) for name, unit in names.items()),
    ... )
    >>> turned = to_heading(history)
    >>> turned.names, turned["velocity_forward"].round(6).tolist()
    (('velocity_forward', 'velocity_right', 'psi'), [2.0])
    """
    return _turned(history, EARTH_TO_HEADING, yaw, -1.0, "turned by the heading")


def to_earth(history: TimeHistory, *, yaw: str = "psi") -> TimeHistory:
    """The way back of :func:`to_heading`: forward and right become north and east.

    Parameters
    ----------
    history
        As :func:`to_heading` gives it.
    yaw
        Channel of the heading, rad: the same as on the way there.

    Raises
    ------
    UsageError
        The heading, any pair, or the partner of a channel is missing.
    """
    pairs = {turned: plain for plain, turned in EARTH_TO_HEADING.items()}
    return _turned(history, pairs, yaw, 1.0, "turned back to earth")


def _turned(
    history: TimeHistory, pairs: Mapping[tuple[str, str], tuple[str, str]], yaw: str, sense: float, what: str
) -> TimeHistory:
    names = history.names
    if yaw not in names:
        raise UsageError(
            f"there is no heading {yaw} in the data",
            needed=f"one of {', '.join(names)}",
            remedy="log the attitude, or name its channel",
        )
    present = [pair for pair in pairs if set(pair) & set(names)]
    lonely = [name for pair in present for name in pair if name not in names]
    if lonely or not present:
        raise UsageError(
            f"there is no {' and no '.join(lonely) or 'pair of horizontal channels'} in the data",
            needed="both of " + " or both of ".join(" and ".join(pair) for pair in present or pairs),
        )
    cosine, sine = np.cos(history[yaw]), sense * np.sin(history[yaw])
    values, channels = history.values.copy(), list(history.channels)
    for pair in present:
        first, second = (names.index(name) for name in pair)
        a, b = history.values[first], history.values[second]
        values[first], values[second] = cosine * a - sine * b, sine * a + cosine * b
        for row, name in zip((first, second), pairs[pair], strict=True):
            origin = channels[row].source or channels[row].name
            channels[row] = replace(channels[row], name=name, source=f"{origin} {what}")
    turned = ", ".join(name for pair in present for name in pair)
    return replace(
        history,
        values=values,
        channels=tuple(channels),
        processing=(*history.processing, f"{turned} {what} {yaw}"),
    )
