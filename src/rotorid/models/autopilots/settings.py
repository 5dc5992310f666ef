"""What the parameters of an autopilot say of the controller of one axis, in its own names and in SI."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from rotorid.data.base import Immutable
from rotorid.models.controller import RateController
from rotorid.typing import LoopName


class Parameter(NamedTuple):
    """A parameter of a firmware that holds a gain.

    Parameters
    ----------
    low, high
        Range that it takes.
    per_si
        What a gain in SI is divided by to give its value.
    integer
        Whether it is a whole number.
    shared
        Whether another axis has the same one.
    """

    name: str
    low: float
    high: float
    per_si: float = 1.0
    integer: bool = False
    shared: bool = False


@dataclass(frozen=True, kw_only=True)
class AxisController(Immutable):
    """The controller of one axis of an autopilot.

    Parameters
    ----------
    autopilot
        ``PX4``, ``ArduPilot`` or ``Betaflight``.
    firmware
        As the log names it; empty where it does not.
    axis
        ``roll``, ``pitch`` or ``yaw``; of an outer loop ``velocity`` or ``climb``.
    controller
        Rate controller with its angle loop; of an outer loop that of a velocity with its position, which makes an
        acceleration in m/s².
    gains, filters
        Names and values as the firmware has them, as far as the log holds them.
    ends
        Names of states between which the controller moves in flight, to the controllers there; empty for one that
        stays as it is.
    left
        What the throttle that was flown had left of P and D, where the controller holds less of them than its
        parameters say; by their letters.
    notes
        Sentences on what is on and not part of the linear controller.
    """

    autopilot: str
    firmware: str
    axis: LoopName
    controller: RateController
    gains: Mapping[str, float]
    filters: Mapping[str, float]
    ends: Mapping[str, RateController] = field(default_factory=dict)
    left: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        self._set(gains=self.gains, filters=self.filters, ends=self.ends, left=self.left, notes=tuple(self.notes))

    @property
    def loop_rate_hz(self) -> float | None:
        """Steps of the controller per second; ``None`` where the log does not say."""
        return 1.0 / self.controller.step_s if self.controller.step_s > 0.0 else None

    def described(self) -> dict[str, Any]:
        """As the documents have it: ``autopilot``, ``firmware``, ``loop_rate_hz``, ``gains``, ``filters``."""
        return described([self])


def described(controllers: Sequence[AxisController]) -> dict[str, Any]:
    """Controllers of some axes of one vehicle as the documents have them, names and values of the firmware.

    Parameters
    ----------
    controllers
        At least one.

    Examples
    --------
    >>> from rotorid.models.autopilots.reading import axis_controller
    >>> parameters = {"MC_YAWRATE_P": 0.2, "MC_YAW_TQ_CUTOFF": 2.0, "IMU_GYRO_RATEMAX": 400.0}
    >>> yaw = axis_controller(parameters, "yaw", firmware="PX4 1.16.0")
    >>> described([yaw])["gains"], described([yaw])["filters"]
    ({'MC_YAWRATE_P': 0.2}, {'MC_YAW_TQ_CUTOFF': 2.0})
    """
    first = controllers[0]
    return {
        "autopilot": first.autopilot,
        "firmware": first.firmware,
        "loop_rate_hz": first.loop_rate_hz,
        "gains": {name: value for controller in controllers for name, value in controller.gains.items()},
        "filters": {name: value for controller in controllers for name, value in controller.filters.items()},
    }


_LOOP_SETTINGS = (
    *("IMU_GYRO_", "IMU_DGYRO_CUTOFF", "IMU_INTEG_RATE", "MC_", "THR_MDL_FAC", "MOT_SLEW_"),
    *("INS_GYRO_FILTER", "INS_GYRO_RATE", "INS_FAST_SAMPLE", "INS_HNTCH_", "INS_HNTC2_", "INS_NOTCH_", "FILT"),
    *("SCHED_LOOP_RATE", "ATC_RAT_", "ATC_ANG_", "ATC_THR_G_BOOST", "MOT_THST_EXPO", "MOT_SPIN_", "MOT_BAT_VOLT_"),
    *("gyro_", "dterm_", "looptime", "pid_process_denom", "features", "dshot_bidir", "rpm_filter_", "yaw_lowpass_hz"),
    *("rollPID", "pitchPID", "yawPID", "levelPID", "d_min", "d_max", "tpa_"),
    *("iterm_relax", "anti_gravity", "abs_control", "use_integrated_yaw", "thrust_linear", "dyn_"),
)
"""Beginnings of the names of parameters by which controllers, the filters in front of them and thrust are made."""


def loop_settings(parameters: Mapping[str, float]) -> dict[str, float]:
    """The parameters of a log on which its rate loops depend: gains, filters of loop and gyro, steps, curve of thrust.

    Examples
    --------
    >>> loop_settings({"IMU_GYRO_CUTOFF": 40.0, "BAT1_CAPACITY": 4000.0})
    {'IMU_GYRO_CUTOFF': 40.0}
    """
    return {name: float(value) for name, value in parameters.items() if name.startswith(_LOOP_SETTINGS)}


def present(parameters: Mapping[str, float], names: Sequence[str]) -> dict[str, float]:
    """Those of some parameters that a log holds."""
    return {name: float(parameters[name]) for name in names if name in parameters}
