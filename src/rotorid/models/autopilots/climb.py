r"""Climb loops of PX4 and ArduPilot: vertical velocity with height, by the parameters of every firmware generation.

The controller of the climb asks for an acceleration, as that of the horizontal velocity does
(:mod:`rotorid.models.autopilots.outer`). What makes thrust of it differs:

- **PX4** scales by the hover thrust :math:`T_h`, :math:`\delta = T_h + a T_h / g`: a hover thrust wrong by 20 % is 20 %
  of the loop gain;
- **ArduPilot** closes a loop around the measured acceleration, whose throttle passes a low-pass of 2 Hz,

.. math:: \delta = F_{2 Hz} F_e \left[ P_a + \frac{I_a}{s} + D_a s F_d \right] (a_t - F_a a)

PX4 divides by the cosine of the tilt, ArduPilot multiplies by its angle boost: both are one in a hover.

References
----------
PX4/PX4-Autopilot ``src/modules/mc_pos_control/PositionControl``; ArduPilot/ardupilot
``libraries/AC_AttitudeControl/AC_PosControl.cpp`` and ``libraries/AP_Motors/AP_MotorsMulticopter.cpp``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from rotorid.autopilots.ardupilot.autopilot import ARDUPILOT
from rotorid.autopilots.px4.autopilot import PX4
from rotorid.models.autopilots.settings import Parameter
from rotorid.models.controller import RateController
from rotorid.models.loop_filter import LoopFilter
from rotorid.typing import ComplexArray, FloatArray

THROTTLE_HZ = 2.0
"""Of ArduPilot's low-pass on the throttle of its height controllers."""

_ACCELEROMETER_HZ = 20.0
"""Default of ``INS_ACCEL_FILTER``."""

_NEW, _OLD = "PSC_D_ACC_", "PSC_ACCZ_"
_OLD_PER_SI = 0.1
"""Before 4.7 throttle in thousandths by cm/s²."""


class ClimbNames(NamedTuple):
    """Names and ranges of the climb loop in one generation of a firmware, as for the loops of ``outer``."""

    autopilot: str
    gains: Mapping[str, Parameter]
    limits: tuple[str, ...]
    filters: tuple[str, ...]


_PX4_CLIMB = ClimbNames(
    PX4.name,
    {
        "P": Parameter("MPC_Z_VEL_P_ACC", 2.0, 15.0),
        "I": Parameter("MPC_Z_VEL_I_ACC", 0.2, 3.0),
        "D": Parameter("MPC_Z_VEL_D_ACC", 0.0, 2.0),
        "A": Parameter("MPC_Z_P", 0.1, 1.5),
    },
    limits=("MPC_USE_HTE", "MPC_THR_HOVER"),
    filters=("MPC_VEL_LP", "MPC_VEL_NF_FRQ", "MPC_VEL_NF_BW", "MPC_VELD_LP"),
)


def _of_ardupilot(velocity: str, position: str, acceleration: str) -> ClimbNames:
    """Without I and D, which are zero by default: the integral of the acceleration does their work."""
    return ClimbNames(
        ARDUPILOT.name,
        {"P": Parameter(f"{velocity}P", 1.0, 10.0), "A": Parameter(position, 0.5, 4.0)},
        limits=(
            *(f"{velocity}{name}" for name in ("I", "D", "FF", "IMAX")),
            *(f"{acceleration}{name}" for name in ("P", "I", "D", "FF", "IMAX")),
        ),
        filters=tuple(f"{loop}{name}" for loop in (velocity, acceleration) for name in ("FLTE", "FLTD")),
    )


CLIMB: tuple[ClimbNames, ...] = (
    _PX4_CLIMB,
    _of_ardupilot("PSC_D_VEL_", "PSC_D_POS_P", _NEW),
    _of_ardupilot("PSC_VELZ_", "PSC_POSZ_P", _OLD),
)
"""Newest names first."""


def read_climb(names: Mapping[str, str], parameters: Mapping[str, float], *, position_rate_hz: float) -> RateController:
    """The controller of the climb, with P in 1/s and A, of the height, in 1/s.

    Parameters
    ----------
    names
        ``P``, ``I``, ``D`` and ``A`` to the parameters of this generation, as far as it has them.
    parameters
        Of the log.
    position_rate_hz
        Steps of PX4's position controller per second; ArduPilot's runs in the main loop.
    """

    def value(name: str, default: float = 0.0) -> float:
        return float(parameters.get(name, default))

    P, A = (value(names[letter]) for letter in "PA")
    if "I" not in names:
        velocity = names["P"].removesuffix("P")
        return RateController(
            proportional_s=P,
            integral=value(f"{velocity}I"),
            derivative_s2=value(f"{velocity}D"),
            angle_1_s=A,
            derivative_of_error=True,
            error_cutoff_hz=value(f"{velocity}FLTE"),
            derivative_cutoff_hz=value(f"{velocity}FLTD"),
            feedforward=value(f"{velocity}FF"),
            step_s=1.0 / value("SCHED_LOOP_RATE", 400.0),
        )
    step_s = 1.0 / position_rate_hz
    return RateController(
        proportional_s=P,
        integral=value(names["I"]),
        derivative_s2=value(names["D"]),
        angle_1_s=A,
        derivative_cutoff_hz=value("MPC_VELD_LP", 5.0),
        late_integral=True,
        step_s=step_s,
        delay_s=0.5 * step_s,
    )


class AccelerationLoop(NamedTuple):
    """ArduPilot's loop around the vertical acceleration.

    Parameters
    ----------
    controller
        Throttle by the error of the acceleration, with its low-pass of 2 Hz.
    filters
        In front of the measured acceleration.
    """

    controller: RateController
    filters: Sequence[LoopFilter]

    def loop(self, velocity_by_throttle: ComplexArray, omega_rad_s: FloatArray) -> ComplexArray:
        """The loop broken at the throttle, of the shape of the plants."""
        acceleration = velocity_by_throttle * 1j * omega_rad_s
        return np.asarray(acceleration * self.controller.response(omega_rad_s) * self._measured(omega_rad_s))

    def closed(self, velocity_by_throttle: ComplexArray, omega_rad_s: FloatArray) -> ComplexArray:
        """Velocity by the acceleration that is asked for, of the shape of the plants."""
        made = velocity_by_throttle * self.controller.setpoint_response(omega_rad_s)
        return np.asarray(made / (1.0 + self.loop(velocity_by_throttle, omega_rad_s)))

    def _measured(self, omega_rad_s: FloatArray) -> ComplexArray:
        s = np.asarray(1j * omega_rad_s)
        total = np.ones_like(s)
        for one in self.filters:
            total = total * one.response(s, self.controller.step_s)
        return total


def acceleration_gains(names: Iterable[str]) -> tuple[str, ...]:
    """Those of some parameters that are P, I and D of ArduPilot's loop around the vertical acceleration.

    Examples
    --------
    >>> acceleration_gains(["PSC_D_VEL_P", "PSC_D_ACC_P", "PSC_D_ACC_IMAX", "PSC_ACCZ_I"])
    ('PSC_D_ACC_P', 'PSC_ACCZ_I')
    """
    known = {f"{prefix}{letter}" for prefix in (_NEW, _OLD) for letter in "PID"}
    return tuple(name for name in names if name in known)


def acceleration_loop(parameters: Mapping[str, float]) -> AccelerationLoop | None:
    """ArduPilot's loop around the vertical acceleration; ``None`` where the parameters have none.

    Parameters
    ----------
    parameters
        Of the log, by name.

    Examples
    --------
    >>> old, new = {"PSC_ACCZ_P": 0.5, "PSC_ACCZ_I": 1.0}, {"PSC_D_ACC_P": 0.05, "PSC_D_ACC_I": 0.1}
    >>> [acceleration_loop(one).controller.proportional_s for one in (old, new)]
    [0.05, 0.05]
    """
    prefix = next((prefix for prefix in (_NEW, _OLD) if f"{prefix}P" in parameters), None)
    if prefix is None:
        return None
    per_si = _OLD_PER_SI if prefix == _OLD else 1.0

    def value(name: str, default: float = 0.0) -> float:
        return float(parameters.get(f"{prefix}{name}", default))

    gains = [per_si * value(letter) for letter in "PID"]
    if min(gains) < 0.0 or not any(gains):
        return None
    controller = RateController(
        proportional_s=gains[0],
        integral=gains[1],
        derivative_s2=gains[2],
        feedforward=per_si * value("FF"),
        derivative_of_error=True,
        error_cutoff_hz=value("FLTE", 20.0),
        derivative_cutoff_hz=value("FLTD"),
        target_cutoff_hz=value("FLTT"),
        command_cutoff_hz=THROTTLE_HZ,
        step_s=1.0 / parameters.get("SCHED_LOOP_RATE", 400.0),
    )
    cutoff_hz = float(parameters.get("INS_ACCEL_FILTER", _ACCELEROMETER_HZ))
    filters = (LoopFilter(kind="Butterworth", frequency_hz=cutoff_hz),) if cutoff_hz > 0.0 else ()
    return AccelerationLoop(controller, filters)
