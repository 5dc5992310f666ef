"""What the sensors of a simulated vehicle make of the truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotorid.data.immutable import Immutable
from rotorid.errors import UsageError
from rotorid.simulate.packed import Senses, plain


@dataclass(frozen=True, kw_only=True)
class Sensors(Immutable):
    r"""Gyroscopes, accelerometers and the estimates of attitude, velocity and position.

    A gyroscope reads :math:`\omega/(T s + 1) + b + \sigma n + A \sum x_i^2 \sin\varphi_i`, rounded to its step, and an
    accelerometer at :math:`r` so the specific force :math:`f + \dot\omega \times r + \omega \times (\omega \times r)`.
    The last term is vibration: one cycle a turn of every rotor, growing with the square of its speed; what lies above
    half the loop's rate folds down, as in a real log. The autopilot flies on these values, not on the true ones.

    Parameters
    ----------
    gyro_noise_rad_s, accelerometer_noise_m_s2
        Standard deviation of white noise, each sample of the control loop.
    gyro_bias_rad_s, accelerometer_bias_m_s2
        Constant, along the three axes.
    gyro_lag_s, accelerometer_lag_s
        First-order lags.
    gyro_step_rad_s, accelerometer_step_m_s2
        Steps of quantization; zero for none.
    gyro_vibration_rad_s, accelerometer_vibration_m_s2
        Amplitude of each rotor's vibration at full speed.
    rotor_speed_rad_s
        Full speed of the rotors, for that.
    accelerometer_place_m
        From the center of gravity, in body axes.
    attitude_noise_rad, velocity_noise_m_s, position_noise_m
        Standard deviations of what the estimator adds, white.

    Examples
    --------
    >>> Sensors().gyro_noise_rad_s, PERFECT.gyro_noise_rad_s
    (0.005, 0.0)
    """

    gyro_noise_rad_s: float = 0.005
    accelerometer_noise_m_s2: float = 0.08
    gyro_bias_rad_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    accelerometer_bias_m_s2: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gyro_lag_s: float = 0.0
    accelerometer_lag_s: float = 0.0
    gyro_step_rad_s: float = 0.0
    accelerometer_step_m_s2: float = 0.0
    gyro_vibration_rad_s: float = 0.0
    accelerometer_vibration_m_s2: float = 0.0
    rotor_speed_rad_s: float = 800.0
    accelerometer_place_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    attitude_noise_rad: float = 0.001
    velocity_noise_m_s: float = 0.02
    position_noise_m: float = 0.02

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            several = isinstance(value, tuple)
            if not np.isfinite(value).all() or (not several and value < 0.0):
                raise UsageError(
                    f"{name} = {value} came for a sensor",
                    needed="finite numbers" if several else "a finite number from zero up",
                )

    @property
    def noisy(self) -> bool:
        """Whether any of them has noise."""
        return any(
            (
                self.gyro_noise_rad_s,
                self.accelerometer_noise_m_s2,
                self.attitude_noise_rad,
                self.velocity_noise_m_s,
                self.position_noise_m,
            )
        )

    def senses(self) -> Senses:
        """The same as plain numbers, for the kernels."""
        return Senses(
            gyro_noise=float(self.gyro_noise_rad_s),
            gyro_bias=plain(self.gyro_bias_rad_s),
            gyro_lag_s=float(self.gyro_lag_s),
            gyro_step=float(self.gyro_step_rad_s),
            gyro_vibration=float(self.gyro_vibration_rad_s),
            accelerometer_noise=float(self.accelerometer_noise_m_s2),
            accelerometer_bias=plain(self.accelerometer_bias_m_s2),
            accelerometer_lag_s=float(self.accelerometer_lag_s),
            accelerometer_step=float(self.accelerometer_step_m_s2),
            accelerometer_vibration=float(self.accelerometer_vibration_m_s2),
            accelerometer_place=plain(self.accelerometer_place_m),
            attitude_noise=float(self.attitude_noise_rad),
            velocity_noise=float(self.velocity_noise_m_s),
            position_noise=float(self.position_noise_m),
            blade_rad_s=float(self.rotor_speed_rad_s),
        )


PERFECT = Sensors(
    gyro_noise_rad_s=0.0,
    accelerometer_noise_m_s2=0.0,
    attitude_noise_rad=0.0,
    velocity_noise_m_s=0.0,
    position_noise_m=0.0,
)
"""Sensors that read the truth."""
