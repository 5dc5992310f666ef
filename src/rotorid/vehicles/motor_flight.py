r"""Flights of a quadrotor of 1.2 kg whose motors, thrust and inertia are known, in closed loop, with gusts and noise.

Four rotors in an X, 0.2 m forward or back and 0.2 m to a side, each with

.. math::

    T_{motor} \dot x_i = u_i(t) - x_i, \qquad F_i = c_0 + c_1 x_i + c_2 x_i^2

    a_z = -\tfrac{1}{m} \sum F_i + Z_w w, \qquad
    \dot p = \tfrac{1}{I_{xx}} \sum (-y_i) F_i + L_p p + g_p

and so for pitch and yaw, with gusts :math:`g`. The motors receive their outputs late, by the delays that gyros and
accelerometer are given. Inertia does not couple the axes, and thrust that tilts away is not modeled: a turn is flown as
a hover of more weight, by its load factor.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.record import MotorRecord
from rotorid.models.rotors import RotorLayout, library_layout
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

if TYPE_CHECKING:
    from rotorid.vehicles.motor_flight_kernels import Loop

ARM_M = 0.2 * 2.0**0.5
"""Center of gravity to each rotor."""

KAPPA_M = 0.02
"""Torque by thrust of a rotor."""

TRUTH: Mapping[str, float] = MappingProxyType(
    {
        "m": 1.2,
        "c_0": 0.3,
        "c_1": 1.5,
        "c_2": 6.0,
        "I_xx": 0.015,
        "I_yy": 0.018,
        "kappa_per_I_zz": 0.7,
        "T_motor": 0.035,
        "tau_gyro": 0.00625,
        "tau_accel": 0.00625,
        "L_p": -1.0,
        "M_q": -1.2,
        "N_r": -0.6,
        "Z_w": -0.4,
    }
)
"""What flies, in SI units."""

_SUBSTEPS = 4
_SLOW_S = 0.2
_GUSTS = (1.0, 1.0, 0.15)
_CYCLES_HZ = (
    np.array([0.3, 0.9, 1.7, 3.1, 5.3]),
    np.array([0.4, 1.1, 2.1, 3.7, 6.1]),
    np.array([0.5, 1.3, 2.3, 4.1]),
    np.array([0.35, 0.7, 1.5, 2.7, 4.7]),
)
_AMPLITUDES = (0.008, 0.008, 0.02, 0.03)
_RATE_GAINS = (0.02, 0.024, 0.08)
_ATTITUDE_RAD_S = 3.0
_HEAVE_GAIN = 0.05
_LOWEST, _HIGHEST = 0.1, 0.95
_AT_ONCE = 1 << 10
"""Samples whose noise is drawn at once."""


@dataclass(frozen=True, kw_only=True)
class Air(Immutable):
    """What disturbs a flight.

    Parameters
    ----------
    gyro
        White noise of the gyros, standard deviation in rad/s.
    gust
        Angular acceleration of roll and pitch by gusts, standard deviation in rad/s², correlated over a fifth of a
        second; that of yaw is a seventh.
    accelerometer
        White noise, and as much again correlated over a fifth of a second, in m/s².
    """

    gyro: float = 0.01
    gust: float = 1.0
    accelerometer: float = 0.3


USUAL = Air()


def layout() -> RotorLayout:
    """The X, motors in the order of ArduPilot and PX4: front right, rear left, front left, rear right.

    Examples
    --------
    >>> layout().moment_arms[0].round(6).tolist(), layout().spins.tolist()
    ([-0.2, 0.2, 0.2, -0.2], [1.0, 1.0, -1.0, -1.0])
    """
    return library_layout("quad.x").scaled(ARM_M)


def levers() -> FloatArray:
    """Roll and pitch moment, and yaw moment by κ, of a newton of each rotor, shape ``(3, 4)``."""
    frame = layout()
    return np.stack([*frame.moment_arms[:2], frame.spins])


def thrust(motor_speed: FloatArray) -> FloatArray:
    """Thrust of a rotor in N at an output that its motor has reached.

    Examples
    --------
    >>> thrust(np.array([0.0, 0.5, 1.0])).tolist()
    [0.3, 2.55, 7.8]
    """
    return TRUTH["c_0"] + TRUTH["c_1"] * motor_speed + TRUTH["c_2"] * motor_speed**2


def hover_output(load_factor: float = 1.0) -> float:
    """The output at which four rotors carry the weight, or more of it in a turn.

    Examples
    --------
    >>> round(hover_output(), 4), round(hover_output(1.16), 4)
    (0.5502, 0.606)
    """
    return float(_trim_outputs(np.array([load_factor]))[0])


def _trim_outputs(load_factor: FloatArray) -> FloatArray:
    """Outputs of four rotors at which they make some load factors, of the same shape."""
    missing = TRUTH["c_0"] - TRUTH["m"] * STANDARD_GRAVITY_M_S2 / 4.0 * load_factor
    half = 0.5 * TRUTH["c_1"] / TRUTH["c_2"]
    return np.asarray(np.sqrt(half**2 - missing / TRUTH["c_2"]) - half)


def flights(
    count: int,
    *,
    seed: int,
    duration_s: float = 30.0,
    sample_rate_hz: float = 200.0,
    air: Air = USUAL,
    size: float | Sequence[float] | Sequence[Sequence[float]] = 1.0,
    load_factor: float | FloatArray = 1.0,
    climb_m_s: float = 0.0,
) -> list[MotorRecord]:
    """Flights that differ in noise, gusts and phases of the excitation, and in its size where that is asked.

    A controller of rate and attitude feeds the measured, noisy rates back from sample to sample; sums of sines are
    added to its torques and to the thrust. Motion is integrated in steps a quarter as long as the samples.

    Parameters
    ----------
    count
        How many.
    seed
        Of all that is random; the same numbers give the same flights.
    duration_s, sample_rate_hz
        Of each; the delays are whole quarters of samples at 200 Hz, and nearly so at other rates.
    air
        What disturbs them.
    size
        Of the excitation: one number, or one each for roll, pitch, yaw and thrust, or a row of four for each flight;
        zero for a controller that answers to noise and gusts alone.
    load_factor
        Thrust over weight that keeps the height: one number, 1.16 in a circle of 30° of bank, or one for each sample.
    climb_m_s
        Speed upward that is held.

    Examples
    --------
    >>> first, second = flights(2, seed=0, duration_s=1.0)
    >>> first.outputs.shape, first.rates.shape, second.w.shape
    ((4, 200), (3, 200), (200,))
    """
    from rotorid.vehicles.motor_flight_kernels import Flying, fly

    rng = np.random.default_rng(seed)
    samples, step = round(duration_s * sample_rate_hz), 1.0 / sample_rate_hz
    excitation = _excitation(rng, count, step * np.arange(samples, dtype=np.float64))
    excitation = np.broadcast_to(np.asarray(size, dtype=np.float64), (count, 4))[..., None] * excitation
    load = np.broadcast_to(np.asarray(load_factor, dtype=np.float64), (samples,))
    # A climb asks for the thrust that its damping takes.
    trim = _trim_outputs(load - TRUTH["Z_w"] * climb_m_s / STANDARD_GRAVITY_M_S2)
    flying = Flying(
        motor_speed=np.full((count, 4), trim[0]),
        rate=np.zeros((count, 3)),
        w=np.full(count, -climb_m_s),
        gust=np.zeros((count, 3)),
        angle=np.zeros((count, 3)),
        sway=np.zeros(count),
    )
    outputs, rates = np.zeros((count, 4, samples)), np.zeros((count, 3, samples))
    force, speed = np.zeros((count, samples)), np.zeros((count, samples))
    loop, pull = _loop(step, air, climb_m_s), STANDARD_GRAVITY_M_S2 * load
    drawn = count * (3 + 1 + 1 + 3 * _SUBSTEPS)
    for first in range(0, samples, _AT_ONCE):
        noise = rng.standard_normal((min(_AT_ONCE, samples - first), drawn))
        fly(loop, flying, noise, first, excitation, trim, pull, outputs, rates, force, speed)
    return [
        MotorRecord(
            name=f"flight {number}",
            sample_rate_hz=sample_rate_hz,
            outputs=outputs[number],
            rates=rates[number],
            az=force[number],
            w=speed[number],
        )
        for number in range(count)
    ]


def channels(record: MotorRecord) -> dict[str, FloatArray]:
    """A flight as the columns of a log, by channel.

    Examples
    --------
    >>> list(channels(flights(1, seed=0, duration_s=0.1)[0]))
    ['motor_1', 'motor_2', 'motor_3', 'motor_4', 'p', 'q', 'r', 'az', 'w']
    """
    motors = {f"motor_{number}": row for number, row in enumerate(record.outputs, start=1)}
    return {**motors, **dict(zip("pqr", record.rates, strict=True)), "az": record.az, "w": record.w}


def _loop(step_s: float, air: Air, climb_m_s: float) -> Loop:
    from rotorid.vehicles.motor_flight_kernels import Loop

    inverse = np.array([1.0 / TRUTH["I_xx"], 1.0 / TRUTH["I_yy"], TRUTH["kappa_per_I_zz"]])
    return Loop(
        step_s=step_s,
        substeps=_SUBSTEPS,
        late=round(TRUTH["tau_gyro"] / (step_s / _SUBSTEPS)),
        mass_kg=TRUTH["m"],
        curve=(TRUTH["c_0"], TRUTH["c_1"], TRUTH["c_2"]),
        heave_1_s=TRUTH["Z_w"],
        lag_s=TRUTH["T_motor"],
        slow_s=_SLOW_S,
        damping=(TRUTH["L_p"], TRUTH["M_q"], TRUTH["N_r"]),
        gains=inverse[:, None] * levers(),
        mixer=np.vstack([np.sign(levers()), np.ones(4)]),
        rate_gains=_RATE_GAINS,
        attitude_rad_s=_ATTITUDE_RAD_S,
        heave_gain=_HEAVE_GAIN,
        lowest=_LOWEST,
        highest=_HIGHEST,
        gyro=float(air.gyro),
        gusts=(_GUSTS[0] * air.gust, _GUSTS[1] * air.gust, _GUSTS[2] * air.gust),
        accelerometer=float(air.accelerometer),
        climb_m_s=float(climb_m_s),
    )


def _excitation(rng: np.random.Generator, count: int, time_s: FloatArray) -> FloatArray:
    """Shares of output for roll, pitch, yaw and thrust, shape ``(count, 4, samples)``."""
    rows = []
    for cycles_hz, amplitude in zip(_CYCLES_HZ, _AMPLITUDES, strict=True):
        phases = rng.uniform(0.0, 2.0 * np.pi, (count, cycles_hz.size, 1))
        rows.append(amplitude * np.sin(2.0 * np.pi * cycles_hz[:, None] * time_s + phases).sum(axis=1))
    return np.stack(rows, axis=1)
