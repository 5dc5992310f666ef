"""Flights by stick in wind and gusts of a vehicle whose drag is known, logged as slowly as people log."""

from __future__ import annotations

import numpy as np

from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Topic
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

_STEP_S = 0.02
_TILT_RAD_S, _DAMPING = 7.0, 0.8


def tilt_flights(
    count: int,
    *,
    seed: int,
    drag_1_s: float = 0.3,
    square_1_m: float = 0.0,
    wind_m_s: tuple[float, float] = (0.0, 0.0),
    gust_m_s: float = 0.0,
    tilt_rad: float = 0.12,
    stick_s: float = 2.0,
    hold_1_s: float = 0.0,
    turning_rad_s: float = 0.0,
    height_m: float = 0.0,
    velocity_error_m_s: float = 0.15,
    attitude_error_rad: float = 0.005,
    bias_m_s2: float = 0.1,
    duration_s: float = 90.0,
) -> list[FlightRecord]:
    r"""Flights at constant height.

    .. math:: \dot v = R(\phi, \theta, \psi) f + g, \qquad f = (-(d + c|u_a|) u_a, -(d + c|v_a|) v_a, -T)

    Tilts follow the stick, which the pilot moves at random, with 7 rad/s; the log has 25 Hz.

    Parameters
    ----------
    gust_m_s
        Standard deviation of gusts along each axis, correlated over 8 s.
    tilt_rad, stick_s
        Size of the tilts that the pilot asks for, and how long each lasts on average.
    hold_1_s
        Gain of a loop that takes the logged velocity, errors included, to zero.
    turning_rad_s
        Rate at which the heading turns throughout.
    height_m
        Place of the accelerometer along z, down from the center of gravity.
    velocity_error_m_s, attitude_error_rad
        Standard deviations of slow errors of the estimator, correlated over 10 and 20 s.
    bias_m_s2
        Standard deviation of the bias of the accelerometer.
    """
    rng = np.random.default_rng(seed)
    samples, g = round(duration_s / _STEP_S), STANDARD_GRAVITY_M_S2

    def slow(size: float, over_s: float) -> FloatArray:
        keep = np.exp(-_STEP_S / over_s)
        values = size * rng.standard_normal((samples, 2, count))
        values[1:] *= np.sqrt(1.0 - keep**2)
        for place in range(1, samples):
            values[place] += keep * values[place - 1]
        return values

    wrong_speed, wrong_tilt = slow(velocity_error_m_s, 10.0), slow(attitude_error_rad, 20.0)
    wind = np.array(wind_m_s)[:, None] + slow(gust_m_s, 8.0)
    changes = rng.random((samples, 2, count)) < _STEP_S / stick_s
    asked = tilt_rad * rng.standard_normal((samples, 2, count))
    bias = bias_m_s2 * rng.standard_normal((2, count))
    psi0 = rng.uniform(-np.pi, np.pi, count)
    stick, tilt, rate, speed = (np.zeros((2, count)) for _ in range(4))
    rows = np.zeros((samples, 9, count))
    for place in range(samples):
        psi = psi0 + turning_rad_s * _STEP_S * place
        cos_psi, sin_psi = np.cos(psi), np.sin(psi)
        stick = np.where(changes[place], asked[place], stick)
        known = speed + wrong_speed[place]
        back = hold_1_s * np.stack([cos_psi * known[0] + sin_psi * known[1], cos_psi * known[1] - sin_psi * known[0]])
        # Of roll, which leans to the right, and pitch, which leans back.
        target = stick + np.stack([-back[1], back[0]]) / g
        turn = _TILT_RAD_S * (_TILT_RAD_S * (target - tilt) - 2.0 * _DAMPING * rate)
        cos, sin = np.cos(tilt), np.sin(tilt)
        down = np.stack([cos[1] * cos_psi, cos[1] * sin_psi, -sin[1]])
        right = np.stack(
            [
                sin[0] * sin[1] * cos_psi - cos[0] * sin_psi,
                sin[0] * sin[1] * sin_psi + cos[0] * cos_psi,
                sin[0] * cos[1],
            ]
        )
        along = np.stack(
            [
                cos[0] * sin[1] * cos_psi + sin[0] * sin_psi,
                cos[0] * sin[1] * sin_psi - sin[0] * cos_psi,
                cos[0] * cos[1],
            ]
        )
        air = speed - wind[place]
        moving = np.stack([np.sum(down[:2] * air, axis=0), np.sum(right[:2] * air, axis=0)])
        force = -(drag_1_s + square_1_m * np.abs(moving)) * moving
        lift = (g + force[0] * down[2] + force[1] * right[2]) / along[2]
        # With rates of a level vehicle, up to the square of its tilt.
        measured = force + height_m * np.stack([turn[1], -turn[0]]) + bias
        rows[place] = np.vstack(
            [measured, tilt + wrong_tilt[place], psi[None], known, np.zeros((1, count)), -lift[None]]
        )
        speed = speed + _STEP_S * (force[0] * down[:2] + force[1] * right[:2] - lift * along[:2])
        rate = rate + _STEP_S * turn
        tilt = tilt + _STEP_S * rate
    rows[:, :2] += 0.1 * rng.standard_normal(rows[:, :2].shape)
    names = ("ax", "ay", "phi", "theta", "psi", "velocity_north", "velocity_east", "velocity_down", "az")
    channels = tuple(Channel(name=name, unit=STANDARD_UNITS[name]) for name in names)
    time_s = _STEP_S * np.arange(samples)[::2]
    return [
        FlightRecord(
            source=Source(name=f"twin{number}.csv", format="CSV", sha256=""),
            topics=(Topic(name="all", time_s=time_s, channels=channels, values=rows[::2, :, number].T.copy()),),
        )
        for number in range(count)
    ]
