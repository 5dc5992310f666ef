r"""Errors of responses that a log does not let one look at: they count with their usual size.

How far a vehicle leans, how its mean thrust changes during a sweep, whether a gyro agrees with the attitude, and how
far feedback biases a response are measured where the log holds the channels for it. Where it does not, nothing is known
to be well, so each of these errors is taken as unknown, with the size that it has in logs that show it (95 % of the 24
sweeps of real autopilot stacks on which it was looked at, in simulation and in wind, and of 12 flights of real vehicles
for the gyro):

- *lean*: 1.5 % times the curvature of thrust, of responses to roll and pitch; 0.2 % where the other angle alone is
  missing;
- *slope of thrust*: 1.5 % times that curvature, of all responses to an input alike;
- *scale of a gyro*: 1 %, the tolerance of its data sheet;
- *feedback*: :math:`1.3\,\% \sqrt{\max(1, 5/\omega)}`, where commands contain feedback and no instrument is logged;
- *delays*: :math:`1 - \cos(\omega \Delta/2)` with 0.05 s between them, where one input drives two motors.

All but the scale are smooth over frequency, of unknown course
(:func:`rotorid.fitting.frequency.error_shapes.response_error_shapes`). A log that leaves channels out has wider
intervals so, and not narrower ones.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from rotorid.data.axes import RATES
from rotorid.data.display import listed
from rotorid.data.findings import Finding, remark
from rotorid.data.response import FrequencyResponse
from rotorid.flights.consistency import Consistency
from rotorid.flights.instruments import is_command
from rotorid.flights.tilt_errors import ANGLES
from rotorid.typing import FloatArray

USUAL_LEAN, USUAL_OTHER_LEAN, USUAL_SLOPE = 0.015, 0.002, 0.015
"""Relative error at a curvature of one: by tilt from the input, by tilt about the other axis (3° in wind), and by the
change of the slope of thrust.
"""

USUAL_SCALE = 0.01
"""Relative error of the scale of a gyro; a check that is less certain is none."""

USUAL_BIAS, _BIAS_GROWS_BELOW_RAD_S = 0.013, 5.0


def with_unchecked_errors(
    response: FrequencyResponse, *, angles: Collection[str], curvature: float, feedback: bool
) -> tuple[FrequencyResponse, tuple[Finding, ...]]:
    """A response with the usual size of the errors that could not be looked at, and the remarks on them.

    Parameters
    ----------
    response
        With ``lean_errors`` and ``slope_changes`` where the log shows them.
    angles
        Which of ``phi`` and ``theta`` the logs hold.
    curvature
        How thrust bends, see :func:`rotorid.flights.thrust_slope.curvature`.
    feedback
        Whether inputs may contain feedback that no instrument takes out.
    """
    commands = np.array([is_command(name) for name in response.inputs])
    tilt = USUAL_LEAN * curvature * np.array([_unchecked_tilt(response, name, angles) for name in response.inputs])
    frequencies = response.omega_rad_s
    nothing = np.zeros((len(response.inputs), frequencies.size))
    slope, own = nothing.copy(), nothing.copy()
    findings = []
    if response.slope_changes is None and commands.any() and curvature > 0.0:
        slope[commands] = USUAL_SLOPE * curvature
        findings.append(
            _remark("slope", "thrust_command is not logged as a share of full thrust", USUAL_SLOPE * curvature)
        )
    if tilt.any():
        own += tilt[:, None]
        findings.append(_remark("lean", "phi and theta are not both logged", float(tilt.max())))
    if feedback:
        growth = np.sqrt(np.maximum(1.0, _BIAS_GROWS_BELOW_RAD_S / frequencies))
        own = np.hypot(own, USUAL_BIAS * growth)
        findings.append(_remark("feedback", "no instrument is logged", USUAL_BIAS))
    if not findings:
        return response, ()
    return replace(response, unchecked_errors=np.stack([slope, own])), tuple(findings)


USUAL_DELAYS_APART_S = 0.05
"""Between two motors of the published rig, with 0.20 s in the mean."""


def with_equal_delays(
    response: FrequencyResponse, motors: Sequence[str], *, top_rad_s: float
) -> tuple[FrequencyResponse, Finding]:
    r"""A response to one input of two motors, whose delays may differ, and the remark on it.

    Half of the input through each delay is the input through their mean :math:`\tau`, less what the difference
    :math:`\Delta` takes away,

    .. math:: \tfrac12 (e^{-s\tau_3} + e^{-s\tau_4}) = e^{-s\tau} \cos(\omega \Delta / 2),

    without any phase: a few percent at the end of a band, which no fit separates from a gain.

    Parameters
    ----------
    response
        To one input.
    motors
        Those that have no input of their own.
    top_rad_s
        Highest trusted frequency, for the remark.
    """
    shape = (2, len(response.inputs), response.omega_rad_s.size)
    errors = np.zeros(shape) if response.unchecked_errors is None else np.array(response.unchecked_errors)
    errors[1] = np.hypot(errors[1], _lost_by_delays(response.omega_rad_s))
    return replace(response, unchecked_errors=errors), equal_delays(motors, top_rad_s, widened=True)


def _lost_by_delays(omega_rad_s: FloatArray) -> FloatArray:
    """Share of a response that delays of the usual difference take away."""
    return np.asarray(1.0 - np.cos(np.minimum(0.5 * omega_rad_s * USUAL_DELAYS_APART_S, 0.5 * np.pi)))


def equal_delays(motors: Sequence[str], top_rad_s: float, *, widened: bool) -> Finding:
    """The remark that motors without an input of their own have the delay of the others.

    Parameters
    ----------
    motors
        Those.
    top_rad_s
        Highest frequency of the fit.
    widened
        Whether intervals count what a difference takes away.
    """
    size = float(_lost_by_delays(np.array([top_rad_s]))[0])
    message = (
        f"{listed(list(motors))} {'has no input of its' if len(motors) == 1 else 'have no inputs of their'} own, so "
        f"one delay stands for both motors. Delays {USUAL_DELAYS_APART_S:g} s apart would take {100.0 * size:.1f} % "
        f"from the response at {top_rad_s:.3g} rad/s, which {'widens' if widened else 'does not widen'} the "
        "intervals. To measure each delay, log and sweep both motors."
    )
    return remark("error_not_checked", "delays", message, size=size)


def _unchecked_tilt(response: FrequencyResponse, name: str, angles: Collection[str]) -> float:
    """Share of the usual tilt error of an input that no log shows."""
    if name not in ANGLES:
        return 0.0
    if ANGLES[name] not in angles or response.lean_errors is None:
        return 1.0
    return 0.0 if set(ANGLES.values()) <= set(angles) else USUAL_OTHER_LEAN / USUAL_LEAN


def unchecked_scales(
    agreement: Sequence[Consistency], outputs: Sequence[str], errors: FloatArray | None
) -> tuple[FloatArray | None, tuple[Finding, ...]]:
    """Errors of sensors with the usual scale error of rates that nothing was compared with.

    Parameters
    ----------
    agreement
        What was compared, see :func:`rotorid.flights.consistency.sensor_agreement`.
    errors
        Those that comparing showed, see :func:`rotorid.flights.consistency.sensor_errors`.
    """
    checked_channels = {
        check.channel
        for consistency in agreement
        for _, check in consistency.checks
        if check.verdict == "inconsistent" or (check.verdict == "consistent" and check.scale_std <= USUAL_SCALE)
    }
    missing = [name for name in outputs if name in RATES and name not in checked_channels]
    if not missing:
        return errors, ()
    found = np.zeros((len(outputs), 2)) if errors is None else np.array(errors)
    found[[outputs.index(name) for name in missing], 0] = USUAL_SCALE
    why = f"{', '.join(missing)} could not be compared closely enough with the attitude"
    return found, (_remark("scale", why, USUAL_SCALE),)


_WHAT = {
    "slope": "The error from a changing thrust slope",
    "lean": "The error from tilt",
    "feedback": "The bias by feedback",
    "scale": "The gyro scale error",
}


def _remark(what: str, why: str, size: float) -> Finding:
    message = f"{_WHAT[what]} was not measured: {why}. Its usual size, {100.0 * size:.1f} %, widens the intervals."
    return remark("error_not_checked", what, message, size=size)
