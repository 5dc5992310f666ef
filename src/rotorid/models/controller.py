"""The rate controller of an autopilot, from the gains in its log: as a frequency response, and step by step.

One :class:`RateController` for all autopilots. Where the rate of the autopilot's program is known, its frequency
response is exactly that of the program's sums and differences; otherwise that of the same terms in continuous time.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.errors import UsageError
from rotorid.typing import Axis, ComplexArray, FloatArray


@dataclass(frozen=True, kw_only=True)
class RateController(Immutable):
    r"""A rate controller with an angle loop around it, as it feeds back one body rate.

    The command is :math:`u = r - C y` with the rate :math:`y` and

    .. math:: C(s) = F_u F_e \left[ \left(P + \frac{I}{s}\right) \left(1 + F_t \frac{A}{s}\right)
        + D s F_d \left(1 + F_t \frac{A}{s}\right)^{d} \right]

    where :math:`F = 1/(1 + s/\omega_c)` are first-order filters and :math:`d` is one when the derivative is taken of
    the error, zero when it is taken of the rate alone. The angle is the integral of the rate, which holds near hover;
    limits, anti-windup and slew rates are left out. Filters in front of the controller and its computing time may be
    given as a delay, :math:`C(s) e^{-s \tau}`.

    With a step :math:`T` the terms are those of a program that runs every :math:`T`, with :math:`z = e^{sT}`,

    .. math:: F = \frac{\alpha}{1 - (1 - \alpha) z^{-1}}, \quad \alpha = \frac{T}{T + 1/\omega_c}, \qquad
        s \to \frac{1 - z^{-1}}{T}, \qquad \frac{1}{s} \to \frac{T}{1 - z^{-1}}

    but for the angle, which the vehicle integrates itself. At 400 Hz the difference to continuous time is 1 % of a
    loop's gain and half a degree of its phase margin, 5° for a derivative at 20 Hz.

    Parameters
    ----------
    proportional_s
        :math:`P`, command per rad/s.
    integral
        :math:`I`, command per rad.
    derivative_s2
        :math:`D`, command per rad/s².
    angle_1_s
        :math:`A`, rate set-point per rad of angle error; zero without an angle loop.
    derivative_of_error
        Whether the derivative sees the set-point too.
    derivative_cutoff_hz, error_cutoff_hz, target_cutoff_hz, command_cutoff_hz
        Filters on the derivative, on the rate error, on the rate set-point and on the command; zero for none.
    delay_s
        How late the controller sees the rate.
    step_s
        Period of the program, :math:`T`; zero for continuous time.
    late_integral
        Whether the sum is used before the error of the same step is added to it, as PX4 does: one :math:`z^{-1}` more.
    late_angle
        Whether the rate loop runs before the angle loop and takes its set-point of the last step, as ArduPilot does:
        one :math:`z^{-1}` more in the angle loop.

    Raises
    ------
    UsageError
        A gain, a cutoff, the delay or the step is negative or not finite, or all gains of the rate are zero.

    Examples
    --------
    >>> controller = RateController(proportional_s=0.15, integral=0.3)
    >>> controller.response(np.array([2.0]))
    array([0.15-0.15j])
    """

    proportional_s: float
    integral: float = 0.0
    derivative_s2: float = 0.0
    angle_1_s: float = 0.0
    derivative_of_error: bool = False
    derivative_cutoff_hz: float = 0.0
    error_cutoff_hz: float = 0.0
    target_cutoff_hz: float = 0.0
    command_cutoff_hz: float = 0.0
    delay_s: float = 0.0
    step_s: float = 0.0
    late_integral: bool = False
    late_angle: bool = False

    def __post_init__(self) -> None:
        gains = (self.proportional_s, self.integral, self.derivative_s2)
        cutoffs = (self.derivative_cutoff_hz, self.error_cutoff_hz, self.target_cutoff_hz, self.command_cutoff_hz)
        numbers = (*gains, self.angle_1_s, *cutoffs, self.delay_s, self.step_s)
        if not all(math.isfinite(number) and number >= 0.0 for number in numbers) or not any(gains):
            raise UsageError(
                f"gains {gains}, an angle gain {self.angle_1_s:g}, cutoffs {cutoffs} Hz, a delay of "
                f"{self.delay_s:g} s and a step of {self.step_s:g} s came",
                needed="finite numbers from zero up, and a gain that is not zero",
            )

    @property
    def rate_loop(self) -> RateController:
        """The same controller without its angle loop, as rate modes fly it."""
        return replace(self, angle_1_s=0.0)

    def response(self, omega_rad_s: FloatArray, rate_filter: ComplexArray | None = None) -> ComplexArray:
        r"""Frequency response :math:`C(j\omega)` from the rate of the vehicle, command per rad/s.

        .. math:: C = C_y F_\omega + C_r F_t \frac{A}{s}

        with the responses :math:`C_y` by the rate that the controller sees and :math:`C_r` by its set-point. An
        autopilot filters the rate, :math:`F_\omega`, and takes its attitude of what no such filter has delayed; with
        one filter in front of both the loop of an ArduPilot vehicle comes out 3 % too small.

        Parameters
        ----------
        omega_rad_s
            Frequencies above zero, shape ``(f,)``.
        rate_filter
            What stands in front of the rate alone, :math:`F_\omega`, shape ``(f,)``; none when omitted.

        Returns
        -------
        numpy.ndarray
            Shape ``(f,)``.

        Examples
        --------
        A filter that takes half of the rate leaves the angle loop alone:

        >>> controller = RateController(proportional_s=0.2, angle_1_s=4.0)
        >>> controller.response(np.array([4.0]), np.array([0.5])).round(3)
        array([0.1-0.2j])
        """
        s = np.asarray(1j * omega_rad_s, dtype=np.complex128)
        of_rate = self._command(s, self.derivative_s2)
        if rate_filter is not None:
            of_rate = of_rate * rate_filter
        of_angle = self.angle_response(omega_rad_s) / s
        return np.asarray((of_rate + of_angle) * np.exp(-s * self.delay_s))

    def setpoint_response(self, omega_rad_s: FloatArray) -> ComplexArray:
        r"""Command by the set-point of the rate, :math:`C_r F_t`, per rad/s, shape ``(f,)``."""
        s = np.asarray(1j * omega_rad_s, dtype=np.complex128)
        inside = self._command(s, self.derivative_s2 if self.derivative_of_error else 0.0)
        return np.asarray(inside * self._low_pass(s, self.target_cutoff_hz))

    def angle_response(self, omega_rad_s: FloatArray) -> ComplexArray:
        r"""Command by the error of the angle, :math:`C_r F_t A`, per rad, shape ``(f,)``."""
        late = np.exp(-1j * omega_rad_s * (self.step_s if self.late_angle else 0.0))
        return np.asarray(self.setpoint_response(omega_rad_s) * self.angle_1_s * late)

    def _command(self, s: ComplexArray, derivative_s2: float) -> ComplexArray:
        """Command by an error that all terms see, the derivative with its own gain."""
        slope = derivative_s2 * self._difference(s) * self._low_pass(s, self.derivative_cutoff_hz)
        filters = self._low_pass(s, self.command_cutoff_hz) * self._low_pass(s, self.error_cutoff_hz)
        return np.asarray(filters * (self.proportional_s + self.integral * self._sum(s) + slope))

    def _sum(self, s: ComplexArray) -> ComplexArray:
        if self.step_s == 0.0:
            return np.asarray(1.0 / s)
        back = np.exp(-s * self.step_s)
        return np.asarray(self.step_s * (back if self.late_integral else 1.0) / (1.0 - back))

    def _difference(self, s: ComplexArray) -> ComplexArray:
        return s if self.step_s == 0.0 else np.asarray((1.0 - np.exp(-s * self.step_s)) / self.step_s)

    def _low_pass(self, s: ComplexArray, cutoff_hz: float) -> ComplexArray:
        """A first-order filter; the one of a program passes all where its step is long."""
        if cutoff_hz == 0.0:
            return np.ones_like(s)
        corner = 2.0 * math.pi * cutoff_hz
        if self.step_s == 0.0:
            return np.asarray(1.0 / (1.0 + s / corner))
        share = self.step_s / (self.step_s + 1.0 / corner)
        return np.asarray(share / (1.0 - (1.0 - share) * np.exp(-s * self.step_s)))


class _Autopilot(NamedTuple):
    """Where an autopilot keeps what a :class:`RateController` needs; the first name that is there counts."""

    axes: Mapping[Axis, str]
    gains: Mapping[str, tuple[str, ...]]
    factor: str
    loop_rate: str
    derivative_of_error: bool
    late_integral: bool
    late_angle: bool


_PX4 = _Autopilot(
    axes={"roll": "ROLL", "pitch": "PITCH", "yaw": "YAW"},
    gains={
        "proportional_s": ("MC_{}RATE_P",),
        "integral": ("MC_{}RATE_I",),
        "derivative_s2": ("MC_{}RATE_D",),
        "angle_1_s": ("MC_{}_P",),
        "derivative_cutoff_hz": ("IMU_DGYRO_CUTOFF", "MC_DTERM_CUTOFF"),
        "command_cutoff_hz": ("MC_{}_TQ_CUTOFF",),
    },
    factor="MC_{}RATE_K",
    loop_rate="IMU_GYRO_RATEMAX",
    derivative_of_error=False,
    late_integral=True,
    late_angle=False,
)

_ARDUPILOT = _Autopilot(
    axes={"roll": "RLL", "pitch": "PIT", "yaw": "YAW"},
    gains={
        "proportional_s": ("ATC_RAT_{}_P",),
        "integral": ("ATC_RAT_{}_I",),
        "derivative_s2": ("ATC_RAT_{}_D",),
        "angle_1_s": ("ATC_ANG_{}_P",),
        "derivative_cutoff_hz": ("ATC_RAT_{}_FLTD",),
        # Before version 4 one filter stood on the error, under another name.
        "error_cutoff_hz": ("ATC_RAT_{}_FLTE", "ATC_RAT_{}_FILT"),
        "target_cutoff_hz": ("ATC_RAT_{}_FLTT",),
    },
    factor="",
    loop_rate="SCHED_LOOP_RATE",
    derivative_of_error=True,
    late_integral=False,
    late_angle=True,
)

_SCALED = ("proportional_s", "integral", "derivative_s2")


def rate_controller(
    parameters: Mapping[str, float], axis: Axis, *, loop_rate_hz: float | None = None
) -> RateController | None:
    """The controller of an axis, from the parameters of a PX4 or ArduPilot log.

    Parameters
    ----------
    parameters
        Names and values as the autopilot has them.
    axis
        ``roll``, ``pitch`` or ``yaw``; thrust is not controlled by a rate.
    loop_rate_hz
        Steps of the program per second, where the caller knows better than the parameters (a slow sensor holds PX4's
        loop back, whatever ``IMU_GYRO_RATEMAX`` allows); zero for continuous time. Where neither says it, time is
        continuous.

    Returns
    -------
    RateController or None
        ``None`` when the gains are not there, are all zero, or are none that an autopilot could fly with.

    Notes
    -----
    A gain that changed in flight, a reduction of gains at high throttle and a scaling with the battery are not seen.
    Whether the angle loop was closed depends on the flight mode; see :attr:`RateController.rate_loop`.

    References
    ----------
    PX4 parameter reference, multicopter rate and attitude control; ArduPilot Copter parameter reference, ``ATC_``.

    Examples
    --------
    >>> rate_controller({"MC_YAWRATE_P": 0.15, "MC_YAWRATE_I": 0.2, "MC_YAW_P": 1.0}, "yaw").angle_1_s
    1.0
    >>> rate_controller({}, "yaw") is None
    True
    """
    for autopilot in (_PX4, _ARDUPILOT):
        letters = autopilot.axes.get(axis)
        if letters is None:
            continue
        found = {
            field: next((parameters[name.format(letters)] for name in names if name.format(letters) in parameters), 0.0)
            for field, names in autopilot.gains.items()
        }
        factor = parameters.get(autopilot.factor.format(letters), 1.0)
        found |= {field: factor * found[field] for field in _SCALED}
        if any(found[field] for field in _SCALED) and min(found.values()) >= 0.0:
            rate_hz = parameters.get(autopilot.loop_rate, 0.0) if loop_rate_hz is None else loop_rate_hz
            return RateController(
                **found,
                derivative_of_error=autopilot.derivative_of_error,
                step_s=1.0 / rate_hz if rate_hz > 0.0 else 0.0,
                late_integral=autopilot.late_integral,
                late_angle=autopilot.late_angle,
            )
    return None


Driven: TypeAlias = Literal["angle", "rate"]
"""What the set-point of a controller is."""

STATES = ("angle", "integral", "target", "error", "damped", "seen", "slope", "command")
UNKNOWN = ("angle", "integral")
"""States that remember for long, so that no record shows how they began; the others settle within their filters."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SteppedController(Immutable):
    r"""A controller as a linear recursion.

    .. math:: z_{k+1} = A z_k + B [r_k, y_k]^T, \qquad u_k = C z_k + D [r_k, y_k]^T

    with the set-point :math:`r`, the measured rate :math:`y` and the command :math:`u`.

    Parameters
    ----------
    transition, drive, read, direct
        A, B, C and D, shapes ``(z, z)``, ``(z, 2)``, ``(1, z)`` and ``(1, 2)``.
    """

    transition: FloatArray
    drive: FloatArray
    read: FloatArray
    direct: FloatArray

    def __post_init__(self) -> None:
        names = ("transition", "drive", "read", "direct")
        self._set(**{name: read_only(getattr(self, name), np.float64, ndim=2) for name in names})


def stepped(controller: RateController, *, step_s: float, driven: Driven) -> SteppedController:
    r"""A controller at the rate of an autopilot's program.

    Each step integrates the angle, filters the rate set-point :math:`A (r - \int y)`, filters the error, differences
    and filters the derivative, integrates the error, and filters the command. Filters are
    :math:`x_k = x_{k-1} + \frac{h}{h + 1/\omega_c} (v_k - x_{k-1})`, integrals :math:`x_k = x_{k-1} + h v_k`, as PX4
    and ArduPilot have them. All of it is within the order of the step of :meth:`RateController.response`; the delay
    of the controller is not part of it.

    Parameters
    ----------
    controller
        Gains and filters.
    step_s
        Length of a step.
    driven
        Whether the set-point is an angle or, as rate modes fly it, a rate.

    Examples
    --------
    >>> half = stepped(RateController(proportional_s=0.5), step_s=0.001, driven="rate")
    >>> half.direct
    array([[ 0.5, -0.5]])
    """
    count = len(STATES)
    columns = [_advanced(controller, step_s, driven, unit) for unit in np.eye(count + 2)]
    matrix = np.array(columns).T
    command = matrix[-1:]
    return SteppedController(
        transition=matrix[:, :count], drive=matrix[:, count:], read=command[:, :count], direct=command[:, count:]
    )


def _advanced(controller: RateController, step_s: float, driven: Driven, before: FloatArray) -> list[float]:
    """The states after one step; the command is the last of them."""
    angle, integral, target, error, damped, seen, slope, command, setpoint, rate = before.tolist()

    def low_pass(last: float, value: float, cutoff_hz: float) -> float:
        share = step_s / (step_s + 1.0 / (2.0 * math.pi * cutoff_hz)) if cutoff_hz > 0.0 else 1.0
        return last + share * (value - last)

    angle += step_s * rate
    wanted = controller.angle_1_s * (setpoint - angle) if driven == "angle" else setpoint
    target = low_pass(target, wanted, controller.target_cutoff_hz)
    error = low_pass(error, target - rate, controller.error_cutoff_hz)
    damped = low_pass(damped, -rate, controller.error_cutoff_hz)
    now = error if controller.derivative_of_error else damped
    slope = low_pass(slope, (now - seen) / step_s, controller.derivative_cutoff_hz)
    integral += step_s * error
    total = controller.proportional_s * error + controller.integral * integral + controller.derivative_s2 * slope
    command = low_pass(command, total, controller.command_cutoff_hz)
    return [angle, integral, target, error, damped, now, slope, command]
