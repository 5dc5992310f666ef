r"""Published rules for gains, as formulas, to stand beside a proposal.

All but one take the plant as an integrator with a lag and a delay,

.. math:: \hat P(s) \approx \frac{k e^{-\theta s}}{s (T s + 1)}

where the delay holds all that is late: the filters of the gyro and of D. None knows how well the plant is known.

References
----------
S. Skogestad, *Simple analytic rules for model reduction and PID controller tuning*, Journal of Process Control (2003).
K. J. Åström and T. Hägglund, *Advanced PID Control* (2006), AMIGO. PX4-Autopilot,
``src/modules/mc_autotune_attitude_control`` and ``src/lib/pid_design``. ArduPilot, ``libraries/AP_Quicktune``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rotorid.errors import UsageError
from rotorid.tuning import ControllerParts, Gains, loop_figures
from rotorid.typing import ComplexArray, FloatArray

_ANGLE_BELOW_CROSSOVER = 4.0
_PX4_ANGLES = (2.0, 6.5)
_PX4_LAMBDA, _PX4_DAMPING = 0.7, 0.0


class IntegratingPlant(NamedTuple):
    """An integrator with a gain, a lag and a delay.

    Parameters
    ----------
    gain
        rad/s² by a command of one.
    lag_s, delay_s
        Seconds.
    """

    gain: float
    lag_s: float
    delay_s: float

    def response(self, omega_rad_s: FloatArray) -> ComplexArray:
        """Rate by command, shape ``(f,)``."""
        s = 1j * omega_rad_s
        return np.asarray(self.gain * np.exp(-self.delay_s * s) / (s * (self.lag_s * s + 1.0)))


def integrating_plant(omega_rad_s: FloatArray, response: ComplexArray) -> IntegratingPlant:
    """The integrator with lag and delay that is nearest to a response, in gain and phase alike.

    Parameters
    ----------
    omega_rad_s
        Where it is to be near, shape ``(f,)``.
    response
        Shape ``(f,)``.
    """
    from scipy.optimize import least_squares

    wanted = np.log(np.abs(response)) + 1j * np.unwrap(np.angle(response))
    wanted = wanted - 2j * np.pi * np.round((wanted[0].imag + 0.5 * np.pi) / (2.0 * np.pi))

    def misses(numbers: FloatArray) -> FloatArray:
        gain, lag, delay = np.exp(numbers)
        modeled = np.log(gain / omega_rad_s) - 0.5 * np.log1p((lag * omega_rad_s) ** 2)
        phase = -0.5 * np.pi - np.arctan(lag * omega_rad_s) - delay * omega_rad_s
        return np.concatenate([modeled - wanted.real, phase - wanted.imag])

    start = np.log([np.abs(response[0]) * omega_rad_s[0], 0.03, 0.01])
    gain, lag, delay = np.exp(least_squares(misses, start).x)
    return IntegratingPlant(float(gain), float(lag), float(delay))


def simc(plant: IntegratingPlant, wish: float = 1.0) -> tuple[float, float, float]:
    r"""Skogestad's rule, P, I and D in parallel.

    .. math:: K = \frac{1}{k \theta (1 + \lambda)}, \quad T_i = 4 \theta (1 + \lambda), \quad T_d = T, \qquad
        P = K (1 + T_d / T_i), \quad I = K / T_i, \quad D = K T_d

    Parameters
    ----------
    plant
        What is controlled.
    wish
        λ, the closed loop's time constant over the delay; more is softer.
    """
    gain = 1.0 / (plant.gain * plant.delay_s * (1.0 + wish))
    integral_s = 4.0 * plant.delay_s * (1.0 + wish)
    return gain * (1.0 + plant.lag_s / integral_s), gain / integral_s, gain * plant.lag_s


def amigo(plant: IntegratingPlant) -> tuple[float, float, float]:
    r"""AMIGO for integrating plants, with all that is late in one delay :math:`L`.

    .. math:: K = \frac{0.45}{k L}, \quad T_i = 8 L, \quad T_d = 0.5 L
    """
    late = plant.lag_s + plant.delay_s
    gain = 0.45 / (plant.gain * late)
    return gain, gain / (8.0 * late), 0.5 * gain * late


def px4_autotune(
    response: ComplexArray, omega_rad_s: FloatArray, *, step_s: float, rise_time_s: float = 0.14
) -> tuple[float, float, float]:
    r"""What PX4's autotune makes of a plant without noise: a model with two poles, and a minimum-variance controller.

    .. math:: y_k = -a_1 y_{k-1} - a_2 y_{k-2} + b_0 u_{k-1} + b_1 u_{k-2} + b_2 u_{k-3}

    Parameters
    ----------
    response
        Rate by command behind its filters, shape ``(f,)``.
    omega_rad_s
        From 0.5 Hz to the cutoff of the gyro's filter, where it identifies.
    step_s
        Of its model, 2 to 10 ms.
    rise_time_s
        ``MC_AT_RISE_TIME``, 0.14 s; 0.2 s in yaw.
    """
    back = np.exp(-1j * omega_rad_s * step_s)
    columns = np.stack([-response * back, -response * back**2, back, back**2, back**3], axis=1)
    size = 1.0 / np.abs(response)
    rows = np.concatenate([(columns * size[:, None]).real, (columns * size[:, None]).imag])
    wanted = np.concatenate([(response * size).real, (response * size).imag])
    a_1, a_2, b_0, b_1, b_2 = np.linalg.lstsq(rows, wanted, rcond=None)[0]
    speed = step_s / rise_time_s
    shape = 0.25 * (1.0 - _PX4_DAMPING) + 0.51 * _PX4_DAMPING
    turn = np.emath.sqrt(4.0 * shape - 1.0) * speed / (2.0 * shape)
    p_1 = float(np.real(-2.0 * np.exp(-speed / (2.0 * shape)) * np.cos(turn)))
    p_2 = float(np.exp(-speed / shape))
    e = -a_1 + p_1 + 1.0
    f_0 = -a_1 * e + a_1 - a_2 + e + p_2
    f_1 = a_1 * e - a_2 * e + a_2
    f_2 = a_2 * e
    over = _PX4_LAMBDA + (e + 1.0) * (b_0 + b_1 + b_2)
    gain = -(f_1 + 2.0 * f_2) / over
    integral = -(f_0 + f_1 + f_2) / (step_s * (f_1 + 2.0 * f_2)) / 5.0
    slope = -step_s * f_2 / (f_1 + 2.0 * f_2)
    return float(gain), float(gain * integral), float(gain * slope)


def px4_angle(proportional: float) -> float:
    """The angle gain that PX4's autotune takes beside its P, 1/s."""
    return float(np.clip(1.0 / (proportional * np.radians(60.0)), *_PX4_ANGLES))


def quicktune(parts: ControllerParts, plant: ComplexArray, flown: Gains, *, yaw: bool = False) -> Gains:
    """ArduPilot's Quicktune on a plant without noise: D, then P up to the limit of stability, each times 0.4; I like P.

    The vehicle stops earlier, when its slew rate tells of oscillation: read it as a bound.

    Parameters
    ----------
    parts
        What the gains do.
    plant
        Rate by command, shape ``(f,)``.
    flown
        Where it begins.
    yaw
        Whether I is a tenth of P.

    Raises
    ------
    UsageError
        No gain makes the loop unstable.
    """
    found = flown
    for name in ("D", "P") if flown.D > 0.0 else ("P",):
        edge = _limit(parts, plant, found, name)
        values = {**found.as_dict(), name: 0.4 * edge}
        found = Gains(**values)
    return Gains(P=found.P, I=0.1 * found.P if yaw else found.P, D=found.D, A=found.A)


def _limit(parts: ControllerParts, plant: ComplexArray, gains: Gains, name: str) -> float:
    """The value of a gain at which the rate loop begins to swing."""
    value = getattr(gains, name)
    for _ in range(200):
        value *= 1.05
        tried = Gains(**{**gains.as_dict(), name: value})
        if not loop_figures(parts.omega_rad_s, (plant * parts.rate(tried))[None]).stable[0]:
            return float(value)
    raise UsageError("no gain makes the loop swing", needed="a plant with a delay")


def with_angle(gains: tuple[float, float, float], parts: ControllerParts, plant: ComplexArray) -> Gains:
    """Gains of the rate with the usual angle gain beside them: a quarter of the crossover."""
    rate = Gains(P=gains[0], I=gains[1], D=gains[2], A=0.0)
    crossover = float(loop_figures(parts.omega_rad_s, (plant * parts.rate(rate))[None]).crossover_rad_s[0])
    return Gains(P=rate.P, I=rate.I, D=rate.D, A=crossover / _ANGLE_BELOW_CROSSOVER)
