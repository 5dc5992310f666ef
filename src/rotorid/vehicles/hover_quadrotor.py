r"""A quadrotor of 1 kg in hover, with the values of a paper on genetic algorithms, in a flight of one minute.

Motors in a plus, driven by normalized outputs :math:`\sigma_i`, that settle in :math:`T_{motor}` and carry

.. math:: F_i = c_t \, \omega_{max}^2 \, \sigma_i, \qquad \ddot z = \frac{U_1}{m} \cos\phi \cos\theta - g, \qquad
    \dot p = \frac{U_2}{I_{xx}}, \quad \dot q = \frac{U_3}{I_{yy}}, \quad \dot r = \frac{U_4}{I_{zz}}

(*Parameter identification of a quadrotor drone with a real-coded genetic algorithm*). Mass, arm, thrust and drag
constants are the published ones. The published inertias are ten times and more what a vehicle of 1 kg can have, and
break the triangle inequality; the published mixer has the moments of a plus and the yaw of an X, and is singular. Here
stand inertias that are possible and the mixer of a plus, :math:`U_4 = \kappa (F_1 - F_2 + F_3 - F_4)`. Full speed
and the lag of the motors, which were not printed, are ours.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.excitation.switching import doublet
from rotorid.models.rotors import RotorLayout
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

ARM_M = 0.23

TRUTH: Mapping[str, float] = MappingProxyType(
    {
        "m": 1.023,
        "omega_max": 900.0,
        "T_motor": 0.1,
        "c_t": 1.4161e-5,
        "kappa": 0.05,
        "I_xx": 0.016,
        "I_yy": 0.020,
        "I_zz": 0.030,
    }
)
"""What flies: kg, rad/s, s, N/(rad/s)², m, kg m²."""

PUBLISHED: Mapping[str, float] = MappingProxyType(
    {"c_t": 1.4161e-5, "kappa": 0.05, "I_xx": 0.16, "I_yy": 0.20, "I_zz": 1.15}
)
"""As printed in its table 1."""

PUBLISHED_SPREAD: Mapping[str, tuple[float, float]] = MappingProxyType(
    {
        "c_t": (1.415e-5, 0.012e-5),
        "kappa": (0.051, 0.003),
        "I_xx": (0.161, 0.005),
        "I_yy": (0.199, 0.006),
        "I_zz": (1.148, 0.015),
    }
)
"""Mean and standard deviation of 100 runs, its table 2."""

SAMPLE_RATE_HZ = 100.0
DURATION_S = 60.0
_EVERY_S = 4.0
_PULSE_S = 0.25
# Accelerations asked for: a vehicle of this size leaves its place by decimeters and its attitude by some 12 degrees.
_DOUBLETS = np.array([1.0, 6.0, 6.0, 4.0])
_NOISE_STD = np.array([0.1, 0.5, 0.5, 0.5])
# Poles of the loops that hold height and attitude, slow enough for the motors.
_LOOP_RAD_S = np.array([1.0, 2.0, 2.0, 1.0])


@dataclass(frozen=True, kw_only=True, eq=False)
class HoverFlight(Immutable):
    """What was logged.

    Parameters
    ----------
    time_s
        Shape ``(n,)``.
    motors
        Normalized outputs, each held until the next sample, shape ``(4, n)``.
    attitude
        ``phi theta psi``, without noise, shape ``(3, n)``.
    accelerations
        ``z_ddot`` upward in m/s² and ``p_dot q_dot r_dot`` in rad/s², with noise, shape ``(4, n)``.
    exact
        The same without noise.
    """

    time_s: FloatArray
    motors: FloatArray
    attitude: FloatArray
    accelerations: FloatArray
    exact: FloatArray

    def __post_init__(self) -> None:
        matrices = {name: getattr(self, name) for name in ("motors", "attitude", "accelerations", "exact")}
        self._set(time_s=read_only(self.time_s, np.float64, ndim=1))
        self._set(**{name: read_only(matrix, np.float64, ndim=2) for name, matrix in matrices.items()})

    @property
    def tilt(self) -> FloatArray:
        """Share of the thrust that carries, cos φ cos θ, shape ``(n,)``."""
        return np.asarray(np.cos(self.attitude[0]) * np.cos(self.attitude[1]))


def layout() -> RotorLayout:
    """Motors in a plus, in the order of the paper: front, right, rear, left; front and rear turn counterclockwise."""
    arms = ARM_M * np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    return RotorLayout(
        name="plus, from the front clockwise",
        positions=arms,
        spins=np.array([1.0, -1.0, 1.0, -1.0]),
        arm_known=True,
        source="the paper, with its mixer corrected",
    )


def mixer() -> FloatArray:
    """Thrust and moments of roll, pitch and yaw of each newton of each motor, shape ``(4, 4)``.

    Examples
    --------
    >>> mixer().tolist()[3]
    [0.05, -0.05, 0.05, -0.05]
    """
    upward = np.array([-1.0, 1.0, 1.0, 1.0])
    return upward[:, None] * layout().effectiveness(TRUTH["kappa"])[2:]


def printed_mixer() -> FloatArray:
    """The mixer as printed, shape ``(4, 4)``, which is singular."""
    yaw = TRUTH["kappa"] * np.array([1.0, 1.0, -1.0, -1.0])
    return np.vstack([mixer()[:3], yaw])


def fly(rng: np.random.Generator, *, noise: float = 1.0) -> HoverFlight:
    """A minute around hover with a doublet on every axis every 4 s.

    Loops hold height and attitude, so outputs of the motors and accelerations are correlated as in any flight. Noise
    is white and on the accelerations only: 0.1 m/s² on the vertical one and 0.5 rad/s² on the others.

    Parameters
    ----------
    rng
        Of the noise; the flight itself is always the same.
    noise
        Factor on the noise.

    Examples
    --------
    >>> flight = fly(np.random.default_rng(0))
    >>> flight.motors.shape, round(float(flight.motors.mean()), 3)
    ((4, 6000), 0.22)
    """
    motors, attitude, exact = _motion()
    scatter = noise * _NOISE_STD[:, None] * rng.standard_normal(exact.shape)
    return HoverFlight(
        time_s=np.arange(exact.shape[1]) / SAMPLE_RATE_HZ,
        motors=motors,
        attitude=attitude,
        accelerations=exact + scatter,
        exact=exact,
    )


def excitation() -> FloatArray:
    """Accelerations that the doublets ask for in turn: climb, roll, pitch, yaw; shape ``(4, n)``."""
    asked = np.zeros((4, round(DURATION_S * SAMPLE_RATE_HZ)))
    for axis, amplitude in enumerate(_DOUBLETS.tolist()):
        pulses = doublet(amplitude=amplitude, pulse_s=_PULSE_S, sample_rate_hz=SAMPLE_RATE_HZ, trim_s=0.0)
        for start_s in np.arange(0.25 + axis * _EVERY_S / 4.0, DURATION_S, _EVERY_S):
            first = round(start_s * SAMPLE_RATE_HZ)
            asked[axis, first : first + pulses.size] = pulses
    return asked


@lru_cache(maxsize=1)
def _motion() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Outputs of the motors, attitude and exact accelerations."""
    asked = excitation()
    samples, step_s = asked.shape[1], 1.0 / SAMPLE_RATE_HZ
    inertia = np.array([TRUTH[name] for name in ("m", "I_xx", "I_yy", "I_zz")])
    thrust_n = TRUTH["c_t"] * TRUTH["omega_max"] ** 2
    answer = thrust_n * mixer() / inertia[:, None]
    outputs_of = np.linalg.inv(answer)
    weight = np.array([STANDARD_GRAVITY_M_S2, 0.0, 0.0, 0.0])
    lag_s = TRUTH["T_motor"]
    kept = np.exp(-step_s / lag_s)
    motors, exact, places = (np.empty((4, samples)) for _ in range(3))
    # Height and attitude; thrust that tilts away is small here and is left to the loop of height.
    place, speed = np.zeros(4), np.zeros(4)
    settled = outputs_of @ weight
    for k in range(samples):
        places[:, k] = place
        tilt = np.array([np.cos(place[1]) * np.cos(place[2]), 1.0, 1.0, 1.0])
        now = tilt * (answer @ settled) - weight
        loop = -(_LOOP_RAD_S**2) * place - 2.0 * _LOOP_RAD_S * speed
        motors[:, k] = outputs_of @ (weight + asked[:, k] + loop)
        exact[:, k] = now
        later = tilt * (answer @ motors[:, k]) - weight
        fading = (now - later) * lag_s
        place = place + speed * step_s + 0.5 * later * step_s**2 + fading * (step_s - lag_s * (1.0 - kept))
        speed = speed + later * step_s + fading * (1.0 - kept)
        settled = kept * settled + (1.0 - kept) * motors[:, k]
    return motors, places[1:], exact
