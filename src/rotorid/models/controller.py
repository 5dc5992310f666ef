"""The rate controller of an autopilot: as a frequency response, and step by step.

One :class:`RateController` for all autopilots; :mod:`rotorid.models.autopilots` reads it from the gains in a log. Where
the rate of the autopilot's program is known, its frequency response is exactly that of the program's sums and
differences; otherwise that of the same terms in continuous time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from rotorid.autopilots.filters import KnownFilter
from rotorid.data.base import Immutable, read_only
from rotorid.errors import UsageError
from rotorid.models.loop_filter import LoopFilter
from rotorid.typing import ComplexArray, FloatArray


@dataclass(frozen=True, kw_only=True)
class RateController(Immutable):
    r"""A rate controller with an angle loop around it, as it feeds back one body rate.

    The command is :math:`u = r - C y` with the rate :math:`y` and

    .. math:: C = C_y + C_r \frac{A F_a}{s}, \qquad
        C_y = F_u F_e \left[P F_P + \frac{I}{s} + D s F_d \right], \qquad
        C_r = F_u F_t \left[F_e \left(P F_P + \frac{I}{s} + d \, D s F_d\right) + K_{FF} + K_{DFF} s \right]

    where :math:`F` are filters, each a first-order one :math:`1/(1 + s/\omega_c)` with a cutoff and all that is given
    beside it, and :math:`d` is one when the derivative is taken of the error, zero when it is taken of the rate alone.
    The angle is the integral of the rate, which holds near hover; limits, anti-windup and slew rates are left out.
    Filters in front of the controller and its computing time may be given as a delay, :math:`C(s) e^{-s \tau}`.

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
    derivative_cutoff_hz, error_cutoff_hz, target_cutoff_hz, command_cutoff_hz, proportional_cutoff_hz
        First-order filters on the derivative, on the rate error, on the rate set-point, on the command, and on the
        proportional term alone; zero for none.
    feedforward, feedforward_derivative_s
        :math:`K_{FF}` and :math:`K_{DFF}`, command per rad/s and per rad/s² of the rate set-point: outside of the rate
        loop, inside of the angle loop.
    derivative_filters, error_filters, target_filters, angle_filters
        Further filters on the derivative, on the rate error, on the rate set-point, and behind the angle gain.
    delay_s
        How late the controller sees the rate.
    step_s
        Period of the program, :math:`T`; zero for continuous time.
    derivative_step_s
        Period of the derivative and its filters where a sensor's own rate makes them; zero for that of the program.
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
    proportional_cutoff_hz: float = 0.0
    feedforward: float = 0.0
    feedforward_derivative_s: float = 0.0
    derivative_filters: tuple[LoopFilter, ...] = ()
    error_filters: tuple[LoopFilter, ...] = ()
    target_filters: tuple[LoopFilter, ...] = ()
    angle_filters: tuple[LoopFilter, ...] = ()
    delay_s: float = 0.0
    step_s: float = 0.0
    derivative_step_s: float = 0.0
    late_integral: bool = False
    late_angle: bool = False

    def __post_init__(self) -> None:
        self._set(**{name: tuple(getattr(self, name)) for name in FILTERS})
        gains = (self.proportional_s, self.integral, self.derivative_s2)
        ahead = (self.feedforward, self.feedforward_derivative_s)
        cutoffs = (
            *(self.derivative_cutoff_hz, self.error_cutoff_hz, self.target_cutoff_hz),
            *(self.command_cutoff_hz, self.proportional_cutoff_hz),
        )
        numbers = (*gains, *ahead, self.angle_1_s, *cutoffs, self.delay_s, self.step_s, self.derivative_step_s)
        if not all(math.isfinite(number) and number >= 0.0 for number in numbers) or not any(gains):
            raise UsageError(
                f"got gains {gains}, an angle gain {self.angle_1_s:g}, cutoffs {cutoffs} Hz, a delay of "
                f"{self.delay_s:g} s and a step of {self.step_s:g} s",
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
        s = _imaginary(omega_rad_s)
        of_rate = self._command(s, self.derivative_s2)
        if rate_filter is not None:
            of_rate = of_rate * rate_filter
        of_angle = self.angle_response(omega_rad_s) / s
        return np.asarray((of_rate + of_angle) * np.exp(-s * self.delay_s))

    def setpoint_response(self, omega_rad_s: FloatArray) -> ComplexArray:
        r"""Command by the set-point of the rate, :math:`C_r`, per rad/s, shape ``(f,)``."""
        s = _imaginary(omega_rad_s)
        inside = self._command(s, self.derivative_s2 if self.derivative_of_error else 0.0)
        ahead = self.feedforward + self.feedforward_derivative_s * _difference(s, self.step_s)
        target = _low_pass(s, self.target_cutoff_hz, self.step_s) * _row(self.target_filters, s, self.step_s)
        return np.asarray((inside + ahead * _low_pass(s, self.command_cutoff_hz, self.step_s)) * target)

    def angle_response(self, omega_rad_s: FloatArray) -> ComplexArray:
        r"""Command by the error of the angle, :math:`C_r A F_a`, per rad, shape ``(f,)``."""
        s = _imaginary(omega_rad_s)
        late = np.exp(-s * (self.step_s if self.late_angle else 0.0))
        behind = _row(self.angle_filters, s, self.step_s) * late
        return np.asarray(self.setpoint_response(omega_rad_s) * self.angle_1_s * behind)

    def derivative_response(self, omega_rad_s: FloatArray) -> ComplexArray:
        r"""What the derivative makes of the rate, :math:`D s F_d`, command per rad/s, shape ``(f,)``."""
        s = _imaginary(omega_rad_s)
        step_s = self.derivative_step_s or self.step_s
        filters = _low_pass(s, self.derivative_cutoff_hz, step_s) * _row(self.derivative_filters, s, step_s)
        return np.asarray(self.derivative_s2 * _difference(s, step_s) * filters)

    def _command(self, s: ComplexArray, derivative_s2: float) -> ComplexArray:
        """Command by an error that all terms see, the derivative with its own gain."""
        slope = self.derivative_response(s.imag) if derivative_s2 else 0.0
        error = _low_pass(s, self.error_cutoff_hz, self.step_s) * _row(self.error_filters, s, self.step_s)
        filters = _low_pass(s, self.command_cutoff_hz, self.step_s) * error
        proportional = self.proportional_s * _low_pass(s, self.proportional_cutoff_hz, self.step_s)
        return np.asarray(filters * (proportional + self.integral * self._sum(s) + slope))

    def _sum(self, s: ComplexArray) -> ComplexArray:
        if self.step_s == 0.0:
            return np.asarray(1.0 / s)
        back = np.exp(-s * self.step_s)
        return np.asarray(self.step_s * (back if self.late_integral else 1.0) / (1.0 - back))


FILTERS = ("derivative_filters", "error_filters", "target_filters", "angle_filters")
"""Fields of a :class:`RateController` that hold filters."""


def _imaginary(omega_rad_s: FloatArray) -> ComplexArray:
    return np.asarray(1j * omega_rad_s, dtype=np.complex128)


def _difference(s: ComplexArray, step_s: float) -> ComplexArray:
    return s if step_s == 0.0 else np.asarray((1.0 - np.exp(-s * step_s)) / step_s)


def _low_pass(s: ComplexArray, cutoff_hz: float, step_s: float) -> ComplexArray:
    """A first-order filter; the one of a program passes all where its step is long."""
    if cutoff_hz == 0.0:
        return np.ones_like(s)
    corner = 2.0 * math.pi * cutoff_hz
    if step_s == 0.0:
        return np.asarray(1.0 / (1.0 + s / corner))
    share = step_s / (step_s + 1.0 / corner)
    return np.asarray(share / (1.0 - (1.0 - share) * np.exp(-s * step_s)))


def _row(filters: Sequence[LoopFilter], s: ComplexArray, step_s: float) -> ComplexArray:
    total = np.ones_like(s)
    for loop_filter in filters:
        total = total * loop_filter.response(s, step_s)
    return total


Driven: TypeAlias = Literal["angle", "rate"]
"""What the set-point of a controller is."""

STATES = ("angle", "integral", "target", "error", "damped", "seen", "slope", "proportional", "command")
"""States of every controller; those of further filters follow."""

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
    unknown
        Rows of the states in :data:`UNKNOWN`.
    """

    transition: FloatArray
    drive: FloatArray
    read: FloatArray
    direct: FloatArray
    unknown: tuple[int, ...] = tuple(STATES.index(name) for name in UNKNOWN)

    def __post_init__(self) -> None:
        names = ("transition", "drive", "read", "direct")
        self._set(**{name: read_only(getattr(self, name), np.float64, ndim=2) for name in names})


def stepped(controller: RateController, *, step_s: float, driven: Driven) -> SteppedController:
    r"""A controller at the rate of an autopilot's program.

    Each step integrates the angle, filters the rate set-point :math:`A (r - \int y)`, filters the error, differences
    and filters the derivative, integrates the error, adds what is fed forward, and filters the command. First-order
    filters are :math:`x_k = x_{k-1} + \frac{h}{h + 1/\omega_c} (v_k - x_{k-1})`, integrals
    :math:`x_k = x_{k-1} + h v_k`, as ArduPilot has them, and one step late for PX4. All of it is within the order of
    the step of :meth:`RateController.response`; the delay of the controller is not part of it.

    Parameters
    ----------
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
    program = _Program(controller, step_s, driven)
    count = len(STATES) + sum(section.order for row in program.rows for section in row)
    columns = [program.advanced(unit) for unit in np.eye(count + 2)]
    matrix = np.array(columns).T
    command = matrix[STATES.index("command")][None]
    return SteppedController(
        transition=matrix[:, :count], drive=matrix[:, count:], read=command[:, :count], direct=command[:, count:]
    )


class _Section:
    """A filter of a program, in the transposed direct form."""

    def __init__(self, known: KnownFilter) -> None:
        size = max(len(known.numerator), len(known.denominator))
        over, under = (np.pad(c, (0, size - len(c))) for c in (known.numerator, known.denominator))
        self.over, self.under, self.order = over / under[0], under / under[0], size - 1

    def advanced(self, states: list[float], value: float) -> tuple[float, list[float]]:
        """Output and states after one step."""
        out = float(self.over[0] * value + states[0])
        later = [*states[1:], 0.0]
        return out, [float(later[k] + self.over[k + 1] * value - self.under[k + 1] * out) for k in range(self.order)]


class _Program:
    """One step of a controller; filters of the error stand twice, for the error and for the rate alone."""

    def __init__(self, controller: RateController, step_s: float, driven: Driven) -> None:
        self.controller, self.step_s, self.driven = controller, step_s, driven
        own = controller
        chains = (own.angle_filters, own.target_filters, own.error_filters, own.error_filters, own.derivative_filters)
        sampled = [[loop_filter.sampled(1.0 / step_s) for loop_filter in chain] for chain in chains]
        self.rows = [[_Section(known) for known in row if known is not None] for row in sampled]

    def advanced(self, before: FloatArray) -> list[float]:
        """The states after one step, of states, set-point and rate before it."""
        own, step_s, count = self.controller, self.step_s, len(STATES)
        angle, integral, target, error, damped, seen, slope, proportional, command = before[:count].tolist()
        left, (setpoint, rate) = before[count:-2].tolist(), before[-2:].tolist()
        after: list[float] = []

        def through(row: int, value: float) -> float:
            for section in self.rows[row]:
                states = [left.pop(0) for _ in range(section.order)]
                value, states = section.advanced(states, value)
                after.extend(states)
            return value

        def low_pass(last: float, value: float, cutoff_hz: float) -> float:
            share = step_s / (step_s + 1.0 / (2.0 * math.pi * cutoff_hz)) if cutoff_hz > 0.0 else 1.0
            return last + share * (value - last)

        angle += step_s * rate
        rate_setpoint = through(0, own.angle_1_s * (setpoint - angle))
        before_target = target
        target = low_pass(
            target, through(1, rate_setpoint if self.driven == "angle" else setpoint), own.target_cutoff_hz
        )
        error = low_pass(error, through(2, target - rate), own.error_cutoff_hz)
        damped = low_pass(damped, through(3, -rate), own.error_cutoff_hz)
        now = error if own.derivative_of_error else damped
        slope = low_pass(slope, through(4, (now - seen) / step_s), own.derivative_cutoff_hz)
        before_integral = integral
        integral += step_s * error
        proportional = low_pass(proportional, own.proportional_s * error, own.proportional_cutoff_hz)
        ahead = own.feedforward * target + own.feedforward_derivative_s * (target - before_target) / step_s
        summed = before_integral if own.late_integral else integral
        total = proportional + own.integral * summed + own.derivative_s2 * slope + ahead
        command = low_pass(command, total, own.command_cutoff_hz)
        return [angle, integral, target, error, damped, now, slope, proportional, command, *after]
