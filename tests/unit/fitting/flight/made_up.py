"""Flights whose physics are known: motion is drawn, and rotor speeds are those that make it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rotorid.data.record import MotorRecord
from rotorid.models.flight import Airframe, felt, flight_loads
from rotorid.signal.kinematics import derivative
from rotorid.typing import FloatArray

RATE_HZ = 200.0
FRAME = Airframe(
    positions=np.array([[0.09, 0.11, 0.0], [-0.09, -0.11, 0.0], [0.09, -0.11, 0.0], [-0.09, 0.11, 0.0]]),
    spins=np.array([1.0, 1.0, -1.0, -1.0]),
    mass_kg=0.8,
    disc_m2=0.0132,
)
TRUTH = {
    "c_2": 2.2e-6,
    "c_lambda": 9e-5,
    "k_d": 4e-5,
    "x_imu": -0.02,
    "y_imu": 0.03,
    "z_imu": -0.025,
    "I_xx": 3.2e-3,
    "I_yy": 2.8e-3,
    "I_zz": 5.2e-3,
    "kappa": 0.012,
    "J_r": 4e-6,
    "m_f": 8e-6,
}
_ITERATIONS, _HOVER = 20, 1150.0


def made_up_flight(
    seed: int,
    *,
    seconds: float = 30.0,
    speed: float = 4.0,
    gusts_nm: float = 0.0,
    turning: tuple[float, ...] = (2.0, 2.0, 0.3),
    truth: Mapping[str, float] = TRUTH,
) -> MotorRecord:
    """A flight with measured speeds, motion and specific force.

    Parameters
    ----------
    seed
        Of what is drawn.
    speed
        Root mean square of each horizontal component, m/s; a third of it vertically.
    gusts_nm
        Moments of the air that motors do not know about, root mean square.
    turning
        Root mean square of each rate, rad/s.
    truth
        Numbers of the vehicle.
    """
    rng = np.random.default_rng(seed)
    count = round(seconds * RATE_HZ)
    rates = np.stack([size * _colored(rng, count, high) for size, high in zip(turning, (8.0, 8.0, 3.0), strict=True)])
    velocity = speed * np.stack([_colored(rng, count, 0.3) * size for size in (1.0, 1.0, 1.0 / 3.0)])
    load = 9.81 * (1.0 + 0.15 * _colored(rng, count, 1.0))
    acceleration = derivative(rates, RATE_HZ)
    inertia = np.array([truth[name] for name in ("I_xx", "I_yy", "I_zz")])[:, None]
    gust = gusts_nm * np.stack([_colored(rng, count, 3.0) for _ in range(3)])
    wanted = inertia * acceleration + np.cross(rates, inertia * rates, axis=0) - gust
    speeds = _speeds_for(truth, FRAME.mass_kg * load, wanted, velocity, rates)
    loads = flight_loads(truth, FRAME, speeds=speeds, velocity=velocity, rates=rates)
    force = felt(loads, truth, FRAME.mass_kg, rates, acceleration)
    noise = 0.003 * rng.normal(size=rates.shape)
    force = force + 0.05 * rng.normal(size=force.shape)
    return MotorRecord(
        name=f"flight {seed}",
        sample_rate_hz=RATE_HZ,
        outputs=speeds,
        rates=rates + noise,
        az=force[2],
        force=force,
        velocity=velocity,
        between="lines",
    )


def _colored(rng: np.random.Generator, count: int, high_hz: float) -> FloatArray:
    """Noise up to a frequency, of variance one."""
    from scipy.signal import butter, sosfiltfilt

    row = sosfiltfilt(butter(2, high_hz, fs=RATE_HZ, output="sos"), rng.normal(size=count + 400))[200:-200]
    return np.asarray((row - row.mean()) / row.std())


def _speeds_for(
    truth: Mapping[str, float], thrust_n: FloatArray, moment: FloatArray, velocity: FloatArray, rates: FloatArray
) -> FloatArray:
    """Speeds that make a thrust and a moment, by steps along the linear part; yaw by its transfer function."""
    x, y, _ = FRAME.positions.T
    tilting = np.linalg.pinv(np.stack([np.ones(4), -y, x]))
    hertz = np.fft.rfftfreq(thrust_n.size, 1.0 / RATE_HZ)
    yawing = 2.0 * truth["kappa"] * truth["c_2"] * _HOVER + 2j * np.pi * hertz * truth["J_r"]
    speeds = np.full((4, thrust_n.size), _HOVER)
    for _ in range(_ITERATIONS):
        loads = flight_loads(
            truth,
            FRAME,
            speeds=speeds,
            velocity=velocity,
            rates=rates,
            spin_up=derivative(speeds, RATE_HZ),
        )
        turn = np.fft.irfft(np.fft.rfft(moment[2] - loads.moment[2]) / yawing, thrust_n.size)
        off = np.vstack([thrust_n + loads.force[2], moment[:2] - loads.moment[:2]])
        step = tilting @ off / (3.0 * truth["c_2"] * speeds) + FRAME.spins[:, None] * turn / 4.0
        speeds = np.maximum(speeds + 0.7 * step, 200.0)
    return speeds
