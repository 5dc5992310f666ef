"""What limits the trust in a maneuver before anything is estimated: limits, other axes, the battery."""

from __future__ import annotations

from collections.abc import Collection, Iterator

import numpy as np

from rotorid.data.findings import Finding, remark, warn
from rotorid.data.record import AXES, FlightRecord, Maneuver, TimeHistory, units_of
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.signal.limits import WARNED_SHARE, MotorLimits, limited_share
from rotorid.signal.skew import CrossSpectrum, cross_spectrum
from rotorid.typing import Axis, FloatArray

OFF_AXIS_SHARE = 0.5
"""Another command that moves by more than this share of the excited one is worth a warning; half of it, a remark."""

CORRELATED = 0.5
"""Inputs more coherent than this cannot be separated, after Tischler and Remple."""

SAG = 0.05
"""Thrust goes about with the square of the voltage: a change by this share moves gains by a tenth."""

_REMARKED_SHARE = 0.1
"""Share of that for a warning from which time at a limit is remarked on."""

_LEAST_MOTION = 0.05
"""Share of the excited input from which another one counts as moved with it."""

_HARD_LIMIT = 1e-6
"""Distance from an end of the range that counts as at it."""

_NORMALIZED = 1.5
"""Above this, commands are steps of a motor controller or microseconds, whose range is not known."""

_SENSORS = ("p", "q", "r", "ax", "ay", "az")


def quality_findings(
    history: TimeHistory, *, axis: Axis, accounted: Collection[str] = (), limits: MotorLimits | None = None
) -> tuple[Finding, ...]:
    r"""Remarks with numbers about the data of one maneuver.

    ``saturation``
        Share of samples of a command at a limit: 0, 1 (−1 and 1 for roll, pitch, yaw), or a value at which samples
        pile up, see :func:`rotorid.signal.limits.limited_share`; and share of those with a motor at one.
    ``sensor_clipping``
        The same pile-up at an end of an accelerometer or gyro.
    ``off_axis_input``
        Spread of every other command relative to that of the excited one.
    ``correlated_inputs``
        Coherence of every other command with the excited one, averaged over frequency by the power of the excited one,
        where it moves by a twentieth and more of it. Feedback and pilots make it; it biases single-input estimates.

    Parameters
    ----------
    history
        One maneuver. Channels that are not there are not judged, and constant ones are taken for unused.
    axis
        The excited axis.
    accounted
        Commands whose effects are accounted for, because they are inputs of what is estimated: their motion is not
        remarked on.
    limits
        Of the motors of its log.

    Raises
    ------
    UsageError
        The axis is unknown.

    Examples
    --------
    >>> from rotorid.data.record import Channel
    >>> motion = 1.3 * np.sin(np.linspace(0.0, 60.0, 4000) ** 1.5)
    >>> history = TimeHistory(
    ...     values=np.clip(motion, -1.0, 1.0)[None], sample_rate_hz=100.0, start_s=0.0,
    ...     channels=(Channel(name="roll_command", unit="1"),),
    ... )
    >>> [(finding.kind, round(finding.numbers["share"], 2)) for finding in quality_findings(history, axis="roll")]
    [('saturation', 0.44)]
    """
    if axis not in AXES:
        raise UsageError(f"unknown axis {axis!r}", needed=f"one of {', '.join(AXES)}")
    part = (history.start_s, float(history.time_s[-1]))
    motors = () if limits is None else limits.during((part,)).remarks("the maneuver")
    return (*_limits(history), *motors, *_other_axes(history, f"{axis}_command", accounted))


def battery_sag(record: FlightRecord, maneuver: Maneuver) -> Finding | None:
    r"""How much the voltage fell over a maneuver: the slope of a straight line times the duration, in percent.

    .. math:: \Delta = 100 \, \frac{\dot U \, T}{\bar U}

    Thrust per unit command goes about with :math:`U^2` unless the autopilot compensates, so gains drift by twice that
    within the maneuver, and between maneuvers. The line averages over the dips that thrust itself makes.

    Parameters
    ----------
    record
        The log.
    maneuver
        The interval.

    Returns
    -------
    Finding or None
        ``battery_sag``, a warning from 5 % on; ``None`` when fewer than three samples of the voltage lie inside.
    """
    for topic, row in record.holding("battery_voltage"):
        time_s, voltage = topic.time_s, topic.values[row]
        inside = (time_s >= maneuver.start_s) & (time_s <= maneuver.stop_s) & np.isfinite(voltage) & (voltage > 0.0)
        time_s, voltage = time_s[inside], voltage[inside]
        if time_s.size >= 3 and np.ptp(time_s) > 0.0:
            return _sag(time_s - time_s.mean(), voltage, maneuver)
    return None


def _limits(history: TimeHistory) -> Iterator[Finding]:
    """Channels at their limits, the worst first."""
    shares = {name: _saturated(name, history[name]) for name in history.names if _is_input(name)}
    clipped = {name: limited_share(history[name]) for name in history.names if name in _SENSORS}
    for name, share in sorted({**shares, **clipped}.items(), key=lambda item: -item[1]):
        if share < _REMARKED_SHARE * WARNED_SHARE:
            continue
        sensor = name in clipped
        place = "the end of its range" if sensor else "a limit"
        yield (warn if share >= WARNED_SHARE else remark)(
            "sensor_clipping" if sensor else "saturation",
            name,
            f"{name} was at {place} for {100.0 * share:.1f} % of the maneuver.",
            share=share,
        )


_FEW_VALUES = 4
"""A signal of so few values is switched between them on purpose."""


def _is_input(name: str) -> bool:
    return name in {f"{axis}_command" for axis in AXES} or _is_motor(name)


def _is_motor(name: str) -> bool:
    """Whether a channel drives a motor, in a unit whose range is not known."""
    return len(units_of(name)) > 1 and not name.endswith("_excitation")


def _saturated(name: str, values: FloatArray) -> float:
    if np.ptp(values) == 0.0:
        return 0.0
    if np.unique(values).size <= _FEW_VALUES:
        # A random binary signal stands at its levels on purpose.
        return 0.0
    if _is_motor(name):
        return limited_share(values)
    # A thrust that goes below zero is counted from hover, and zero is no end of its range.
    signed = float(np.mean(values < -_HARD_LIMIT)) >= _HARD_LIMIT
    lowest = 0.0 if name == "thrust_command" and not signed else -1.0
    if np.abs(values).max() > _NORMALIZED:
        # Steps of a motor controller, or microseconds: where their range ends is not known.
        return limited_share(values)
    hard = np.mean((values <= lowest + _HARD_LIMIT) | (values >= 1.0 - _HARD_LIMIT))
    return max(float(hard), limited_share(values))


def _other_axes(history: TimeHistory, excited: str, accounted: Collection[str]) -> Iterator[Finding]:
    if excited not in history.names or not np.std(history[excited]) > 0.0:
        return
    for other in (f"{axis}_command" for axis in AXES):
        if other in (excited, *accounted):
            continue
        if other in history.names and np.std(history[other]) > 0.0:
            spread, reference = float(np.std(history[other])), float(np.std(history[excited]))
            yield from _off_axis(excited, other, spread, reference)
            lines = _lines(history, excited, other)
            coherence = float(np.average(lines.coherence, weights=lines.first)) if lines else 0.0
            if coherence > CORRELATED:
                yield warn(
                    "correlated_inputs",
                    f"{other}/{excited}",
                    f"{other} follows {excited} with a coherence of {coherence:.2f}; their effects "
                    "cannot be separated well; use both as inputs.",
                    coherence=coherence,
                )


def _off_axis(excited: str, other: str, spread: float, reference: float) -> Iterator[Finding]:
    ratio = spread / reference
    if ratio >= 0.5 * OFF_AXIS_SHARE:
        yield (warn if ratio >= OFF_AXIS_SHARE else remark)(
            "off_axis_input",
            other,
            f"{other} moved {ratio:.2g} times as much as {excited} ({spread:.3g} and {reference:.3g} rms).",
            ratio=ratio,
            rms=spread,
            excited_rms=reference,
        )


def led_share(history: TimeHistory, excited: str, other: str) -> float:
    """What part of the motion of a command goes with the one that was excited; zero where it hardly moved.

    Its coherence with that one on average over its own power. Controllers that hold height, heading or place move other
    commands with the excited one, by half and more where the vehicle couples, and by a tenth where gusts alone do.

    Parameters
    ----------
    history
        Both commands during a maneuver.
    excited, other
        Their channels.
    """
    lines = _lines(history, excited, other)
    return float(np.average(lines.coherence, weights=lines.second)) if lines else 0.0


def _lines(history: TimeHistory, excited: str, other: str) -> CrossSpectrum | None:
    reference, spread = float(np.std(history[excited])), float(np.std(history[other]))
    if not reference > 0.0 or spread < _LEAST_MOTION * reference:
        return None
    try:
        lines = cross_spectrum(history, excited, other)
    except InsufficientDataError:
        # Too short for a coherence: a doublet has none, and nothing can be said.
        return None
    return lines if min(lines.first.sum(), lines.second.sum()) > 0.0 else None


def _sag(time_s: FloatArray, voltage: FloatArray, maneuver: Maneuver) -> Finding:
    mean = float(voltage.mean())
    slope = float(np.sum(time_s * voltage) / np.sum(time_s**2))
    change = slope * maneuver.duration_s / mean
    return (warn if abs(change) >= SAG else remark)(
        "battery_sag",
        "battery_voltage",
        f"The voltage {'fell' if change < 0.0 else 'rose'} by {100.0 * abs(change):.1f} % of {mean:.4g} V over the "
        f"{maneuver.axis} maneuver of {maneuver.duration_s:.3g} s.",
        change_percent=100.0 * change,
        mean_v=mean,
        slope_v_per_s=slope,
    )
