r"""PX4's rate and attitude controller of a multicopter.

.. math:: \tau = K P e + \int K I e \, dt - K D \dot\omega + F \omega_{sp}, \qquad e = \omega_{sp} - \omega,
    \qquad \omega_{sp} = A (\varphi_{sp} - \varphi)

The integral is used before the error of the same step is added to it. The derivative is that of the filtered rate and
is filtered once more: by a first-order filter since version 1.12, by a Butterworth filter of second order before. The
torque of yaw is filtered by a first-order filter.

References
----------
PX4 parameter reference, multicopter rate and attitude control; ``src/lib/rate_control``,
``src/modules/mc_rate_control`` and ``src/modules/sensors/vehicle_angular_velocity`` of PX4/PX4-Autopilot.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from rotorid.autopilots.firmware import Version, version_of
from rotorid.autopilots.px4.autopilot import PX4
from rotorid.models.autopilots.settings import AxisController, present
from rotorid.models.controller import RateController
from rotorid.models.loop_filter import LoopFilter
from rotorid.typing import Axis

NAME = PX4.name

_AXES: Mapping[Axis, tuple[str, str]] = MappingProxyType(
    {"roll": ("ROLL", "RR"), "pitch": ("PITCH", "PR"), "yaw": ("YAW", "YR")}
)
_GAINS = ("MC_{}RATE_K", "MC_{}RATE_P", "MC_{}RATE_I", "MC_{}RATE_D", "MC_{}RATE_FF", "MC_{}_P")
ALPHA_SINCE: Version = (1, 12)
"""From this version on the derivative has a filter of first order."""

_NEW, _OLD = "IMU_DGYRO_CUTOFF", "MC_DTERM_CUTOFF"


def read(
    parameters: Mapping[str, float],
    axis: Axis,
    *,
    firmware: str = "",
    loop_rate_hz: float | None = None,
    sensor_rate_hz: float | None = None,
) -> AxisController | None:
    """The controller of an axis, or ``None`` where the parameters are not PX4's, or none to fly with.

    Parameters
    ----------
    parameters, axis, firmware, loop_rate_hz
        As for :func:`rotorid.models.autopilots.reading.axis_controller`.
    sensor_rate_hz
        Rate of the gyro's samples, at which the derivative is made.
    """
    if axis not in _AXES:
        return None
    name, short = _AXES[axis]

    def value(parameter: str, default: float = 0.0) -> float:
        return float(parameters.get(parameter.format(name), default))

    factor = value("MC_{}RATE_K", 1.0)
    gains = [factor * value(f"MC_{{}}RATE_{letter}") for letter in "PID"]
    # Before 1.11 the rate controller filtered its own derivative, with a filter of second order.
    cutoff = _NEW if _NEW in parameters else _OLD
    cutoffs = (value(cutoff), value("MC_{}_TQ_CUTOFF"))
    if not any(gains) or min(*gains, value("MC_{}RATE_FF"), value("MC_{}_P"), *cutoffs) < 0.0:
        return None
    version = version_of(firmware)
    second = cutoffs[0] > 0.0 and (cutoff == _OLD or (version is not None and version < ALPHA_SINCE))
    rate_hz = value("IMU_GYRO_RATEMAX") if loop_rate_hz is None else loop_rate_hz
    controller = RateController(
        proportional_s=gains[0],
        integral=gains[1],
        derivative_s2=gains[2],
        angle_1_s=value("MC_{}_P"),
        feedforward=value("MC_{}RATE_FF"),
        derivative_cutoff_hz=0.0 if second else cutoffs[0],
        derivative_filters=(LoopFilter(kind="Butterworth", frequency_hz=cutoffs[0]),) if second else (),
        command_cutoff_hz=cutoffs[1],
        step_s=1.0 / rate_hz if rate_hz > 0.0 else 0.0,
        derivative_step_s=1.0 / sensor_rate_hz if sensor_rate_hz and rate_hz > 0.0 else 0.0,
        late_integral=True,
    )
    limit = (f"MC_{short}_INT_LIM",)
    return AxisController(
        autopilot=NAME,
        firmware=firmware,
        axis=axis,
        controller=controller,
        gains=present(parameters, (*(gain.format(name) for gain in _GAINS), *limit)),
        filters=present(parameters, (cutoff, f"MC_{name}_TQ_CUTOFF")),
        notes=tuple(_notes(parameters)),
    )


def _notes(parameters: Mapping[str, float]) -> list[str]:
    if parameters.get("MC_BAT_SCALE_EN", 0.0) > 0.0:
        return ["MC_BAT_SCALE_EN scales the torques with the battery: the gains grow while it empties."]
    return []
