"""Many flights at once of a quadrotor whose motors, thrust and inertia are known, in closed loop."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotorid.data.motor_record import MotorRecord
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

LEVERS = np.array([[-0.2, 0.2, 0.2, -0.2], [0.2, -0.2, 0.2, -0.2], [1.0, 1.0, -1.0, -1.0]])
"""Of an X: front right and rear left turn counterclockwise, front left and rear right clockwise."""

TRUTH = {
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

_SUBSTEPS = 4
_GUSTS = np.array([1.0, 1.0, 0.15])
_CYCLES_HZ = (np.array([0.3, 0.9, 1.7, 3.1, 5.3]), np.array([0.4, 1.1, 2.1, 3.7, 6.1]), np.array([0.5, 1.3, 2.3, 4.1]))
_THRUST_HZ = np.array([0.35, 0.7, 1.5, 2.7, 4.7])


@dataclass(frozen=True, kw_only=True)
class Air:
    """What disturbs the flight.

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


def flights(
    count: int,
    *,
    seed: int,
    duration_s: float = 30.0,
    sample_rate_hz: float = 200.0,
    air: Air = USUAL,
    size: float = 1.0,
) -> list[MotorRecord]:
    """Flights that differ in noise, gusts and phases of the excitation alone.

    A controller of rate and attitude feeds the measured, noisy rates back from sample to sample; sums of sines are
    added to its torques and to the thrust. Motion is integrated in steps a quarter as long as the samples.

    Parameters
    ----------
    count
        How many.
    seed
        Of all that is random.
    duration_s, sample_rate_hz
        Of each; the delays are whole quarters of samples at 200 Hz, and nearly so at other rates.
    air
        What disturbs them.
    size
        Of the excitation; zero for a controller that answers to noise and gusts alone.
    """
    rng = np.random.default_rng(seed)
    samples, step = round(duration_s * sample_rate_hz), 1.0 / sample_rate_hz
    short = step / _SUBSTEPS
    late = round(TRUTH["tau_gyro"] / short)
    decay = np.exp(-short / TRUTH["T_motor"])
    excitation = size * _excitation(rng, count, step * np.arange(samples, dtype=np.float64))
    inertia = np.array([1.0 / TRUTH["I_xx"], 1.0 / TRUTH["I_yy"], TRUTH["kappa_per_I_zz"]])
    damping = np.array([TRUTH["L_p"], TRUTH["M_q"], TRUTH["N_r"]])
    calm = np.exp(-short / 0.2)
    hover = _hover()
    mixer = np.array([[-1.0, 1.0, 1.0, -1.0], [1.0, -1.0, 1.0, -1.0], [1.0, 1.0, -1.0, -1.0], [1.0, 1.0, 1.0, 1.0]]).T

    turning = np.full((count, 4), hover)
    waiting = [turning.copy() for _ in range(late)]
    rate, angle, gust, w = np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((count, 3)), np.zeros(count)
    sway = np.zeros(count)
    measured = np.zeros((count, 3, samples))
    outputs = np.zeros((count, 4, samples))
    force, speed = np.zeros((count, samples)), np.zeros((count, samples))
    gain = np.array([0.02, 0.024, 0.08])
    for place in range(samples):
        seen = rate + air.gyro * rng.standard_normal((count, 3))
        angle = angle + step * seen
        command = excitation[:, :, place] - np.column_stack([gain * (seen + 3.0 * angle), -0.05 * w])
        output = np.clip(hover + command @ mixer.T, 0.1, 0.95)
        measured[:, :, place], outputs[:, :, place], speed[:, place] = seen, output, w
        sway = calm**_SUBSTEPS * sway + np.sqrt(1.0 - calm ** (2 * _SUBSTEPS)) * rng.standard_normal(count)
        noise = air.accelerometer * (sway + rng.standard_normal(count))
        force[:, place] = -_thrust(turning).sum(axis=1) / TRUTH["m"] + TRUTH["Z_w"] * w + noise
        for _ in range(_SUBSTEPS):
            waiting.append(output)
            held = waiting.pop(0)
            before, turning = turning, held + (turning - held) * decay
            thrust = (_thrust(before) + _thrust(turning) + 4.0 * _thrust(held + (before - held) * np.sqrt(decay))) / 6.0
            gust = calm * gust + np.sqrt(1.0 - calm**2) * air.gust * _GUSTS * rng.standard_normal((count, 3))
            pushed = inertia * (thrust @ LEVERS.T) + gust
            rate = rate * np.exp(damping * short) + short * np.exp(0.5 * damping * short) * pushed
            w = w + short * (STANDARD_GRAVITY_M_S2 - thrust.sum(axis=1) / TRUTH["m"] + TRUTH["Z_w"] * w)
    return [
        MotorRecord(
            name=f"flight {number}",
            sample_rate_hz=sample_rate_hz,
            outputs=outputs[number],
            rates=measured[number],
            az=force[number],
            w=speed[number],
        )
        for number in range(count)
    ]


def _thrust(turning: FloatArray) -> FloatArray:
    return TRUTH["c_0"] + TRUTH["c_1"] * turning + TRUTH["c_2"] * turning**2


def _hover() -> float:
    weight = TRUTH["m"] * STANDARD_GRAVITY_M_S2 / 4.0
    return float(max(np.roots([TRUTH["c_2"], TRUTH["c_1"], TRUTH["c_0"] - weight]).real))


def _excitation(rng: np.random.Generator, count: int, time_s: FloatArray) -> FloatArray:
    """Shares of output for roll, pitch, yaw and thrust, shape ``(count, 4, samples)``."""
    rows = []
    for cycles_hz, amplitude in zip((*_CYCLES_HZ, _THRUST_HZ), (0.008, 0.008, 0.02, 0.03), strict=True):
        phases = rng.uniform(0.0, 2.0 * np.pi, (count, cycles_hz.size, 1))
        rows.append(amplitude * np.sin(2.0 * np.pi * cycles_hz[:, None] * time_s + phases).sum(axis=1))
    return np.stack(rows, axis=1)
