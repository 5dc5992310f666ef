r"""Errors of responses that a log does not let one look at: they count with their usual size.

How far a vehicle leans, how its mean thrust changes during a sweep, whether a gyro agrees with the attitude, and how
far feedback biases a response are measured where the log holds the channels for it. Where it does not, nothing is known
to be well, so each of these errors is taken as unknown, with the size that it has in logs that show it (95 % of the 24
sweeps of real autopilot stacks on which it was looked at, in simulation and in wind, and of 12 flights of real vehicles
for the gyro):

- *lean*: 1.5 % times the curvature of thrust, of responses to roll and pitch;
- *slope of thrust*: 1.5 % times that curvature, of all responses to an input alike;
- *scale of a gyro*: 1 %, the tolerance of its data sheet;
- *feedback*: :math:`1.3\,\% \sqrt{\max(1, 5/\omega)}`, where commands contain feedback and no instrument is logged.

The first two and the last are smooth over frequency, of unknown course
(:func:`rotorid.fitting.frequency.error_shapes.response_error_shapes`). A log that leaves channels out has wider
intervals so, and not narrower ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rotorid.data.axes import RATES
from rotorid.data.findings import Finding, remark
from rotorid.data.response import FrequencyResponse
from rotorid.pipeline.preparation.consistency import Consistency
from rotorid.pipeline.preparation.instruments import is_command
from rotorid.typing import FloatArray

USUAL_LEAN, USUAL_SLOPE = 0.015, 0.015
"""Relative error by lean, and by the change of the slope of thrust, at a curvature of one."""

USUAL_SCALE = 0.01
"""Relative error of the scale of a gyro; a check that is less certain is none."""

USUAL_BIAS, _BIAS_GROWS_BELOW_RAD_S = 0.013, 5.0

_LEANING = ("roll_command", "pitch_command")
"""Inputs that make a vehicle lean."""


def with_unchecked_errors(
    response: FrequencyResponse, *, curvature: float, feedback: bool
) -> tuple[FrequencyResponse, tuple[Finding, ...]]:
    """A response with the usual size of the errors that could not be looked at, and the remarks on them.

    Parameters
    ----------
    response
        With ``lean_errors`` and ``slope_changes`` where the log shows them.
    curvature
        How thrust bends, see :func:`rotorid.pipeline.preparation.thrust_slope.curvature`.
    feedback
        Whether inputs may contain feedback that no instrument takes out.
    """
    commands = np.array([is_command(name) for name in response.inputs])
    leaning = np.array([name in _LEANING for name in response.inputs])
    frequencies = response.omega_rad_s
    nothing = np.zeros((len(response.inputs), frequencies.size))
    slope, own = nothing.copy(), nothing.copy()
    findings = []
    if response.slope_changes is None and commands.any() and curvature > 0.0:
        slope[commands] = USUAL_SLOPE * curvature
        findings.append(
            _remark("slope", "thrust_command is not logged as a share of full thrust", USUAL_SLOPE * curvature)
        )
    if response.lean_errors is None and leaning.any() and curvature > 0.0:
        own[leaning] = USUAL_LEAN * curvature
        findings.append(_remark("lean", "phi and theta are not both logged", USUAL_LEAN * curvature))
    if feedback:
        grown = np.sqrt(np.maximum(1.0, _BIAS_GROWS_BELOW_RAD_S / frequencies))
        own = np.hypot(own, USUAL_BIAS * grown)
        findings.append(_remark("feedback", "no instrument is logged", USUAL_BIAS))
    if not findings:
        return response, ()
    return replace(response, unchecked_errors=np.stack([slope, own])), tuple(findings)


def unchecked_scales(
    agreement: Sequence[Consistency], outputs: Sequence[str], errors: FloatArray | None
) -> tuple[FloatArray | None, tuple[Finding, ...]]:
    """Errors of sensors with the usual scale error of rates that nothing was compared with.

    Parameters
    ----------
    agreement
        What was compared, see :func:`rotorid.pipeline.preparation.consistency.sensor_agreement`.
    outputs
        Channels.
    errors
        Those that comparing showed, see :func:`rotorid.pipeline.preparation.consistency.sensor_errors`.
    """
    told = {
        check.channel
        for one in agreement
        for _, check in one.checks
        if check.verdict == "inconsistent" or (check.verdict == "consistent" and check.scale_std <= USUAL_SCALE)
    }
    missing = [name for name in outputs if name in RATES and name not in told]
    if not missing:
        return errors, ()
    found = np.zeros((len(outputs), 2)) if errors is None else np.array(errors)
    found[[outputs.index(name) for name in missing], 0] = USUAL_SCALE
    why = f"{', '.join(missing)} could not be compared with the attitude closely enough"
    return found, (_remark("scale", why, USUAL_SCALE),)


_WHAT = {
    "slope": "The error by changes of the slope of thrust",
    "lean": "The error by leaning",
    "feedback": "The bias by feedback",
    "scale": "The error of the gyro's scale",
}


def _remark(what: str, why: str, size: float) -> Finding:
    message = f"{_WHAT[what]} was not measured: {why}. Its usual size, {100.0 * size:.1f} %, widens the intervals."
    return remark("error_not_checked", what, message, size=size)
