"""Horizontal accelerations by thrust, tilt and drag: geometry, slopes, and what counts as motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.record import MotorRecord
from rotorid.fitting.motors.problem import MotorProblem
from rotorid.fitting.motors.translation import DRAG, translated_axes, translation, translation_behind, with_translation
from rotorid.frames import body_to_earth, earth_to_body
from rotorid.models.motors import motor_parameters
from rotorid.vehicles.motor_flight import TRUTH, flights, levers

RATE_HZ = 100.0


@pytest.fixture(scope="module")
def turning() -> MotorRecord:
    """A vehicle that leans, turns through north and gains a smooth speed over the earth."""
    (record,) = flights(1, seed=0, duration_s=10.0, sample_rate_hz=RATE_HZ)
    time_s = record.time_s
    attitude = np.stack([0.2 * np.sin(2.0 * time_s), 0.1 * np.cos(3.0 * time_s), 3.0 + 0.5 * time_s])
    attitude[2] = np.angle(np.exp(1j * attitude[2]))
    earth = np.stack([np.sin(1.5 * time_s), 2.0 * np.cos(time_s), 0.1 * np.sin(time_s)])
    return replace(record, attitude=attitude, velocity=earth_to_body(attitude, earth))


def test_a_turning_heading_adds_no_acceleration(turning: MotorRecord) -> None:
    middle = turning.time_s[:-1] + 0.5 / RATE_HZ
    north, east = 1.5 * np.cos(1.5 * middle), -2.0 * np.sin(middle)
    psi = 3.0 + 0.5 * middle
    expected = np.stack([np.cos(psi) * north + np.sin(psi) * east, np.cos(psi) * east - np.sin(psi) * north])
    # The slope over a sample is that at its middle but for a 24th of the third derivative times its square.
    np.testing.assert_allclose(translation(turning).measured, expected, atol=np.hypot(1.5**3, 2.0) / 24.0 / RATE_HZ**2)


def test_lean_and_drag_are_body_axes_in_level_ones(turning: MotorRecord) -> None:
    moved = translation(turning)
    level = turning.attitude * [[1.0], [1.0], [0.0]]
    up = np.zeros((3, turning.samples))
    up[2] = 1.0
    np.testing.assert_allclose(moved.lean, body_to_earth(level, up)[:2], atol=1e-12)
    for row, name in enumerate(DRAG.values()):
        along = np.zeros((3, turning.samples))
        along[row] = turning.velocity[row]
        pushed = body_to_earth(level, along)[:2]
        np.testing.assert_allclose(moved.drag[name], 0.5 * (pushed[:, 1:] + pushed[:, :-1]), atol=1e-12)


def test_derivatives_are_those_of_differences(turning: MotorRecord) -> None:
    parameters = motor_parameters(known={"m": TRUTH["m"]}, axes=("az", "x", "y"), delays=False)
    parameters = parameters.with_values({"c_1": 2.0, "c_2": 5.0, "Z_w": -0.3, "X_u": -0.4, "Y_v": -0.2})
    problem = MotorProblem(records=(turning,), levers=levers(), parameters=parameters, axes=("x", "y"))
    theta = parameters.pack()
    for place, value in enumerate(theta):
        step = 1e-6 * max(abs(value), 1e-2)
        above, below = theta.copy(), theta.copy()
        above[place], below[place] = value + step, value - step
        for here, more, less in zip(
            problem.equations(theta, moved=True)[0],
            problem.equations(above)[0],
            problem.equations(below)[0],
            strict=True,
        ):
            slope = here.slopes[parameters.names.index(parameters.free[place])]
            expected = (more.predicted - less.predicted) / (2.0 * step)
            np.testing.assert_allclose(slope, expected, atol=1e-5 * np.abs(expected).max() + 1e-9)


def test_a_filter_of_the_sensors_delays_it_alike(turning: MotorRecord) -> None:
    # A pure delay of two samples.
    late = translation_behind(turning, np.array([0.0, 0.0, 1.0]))
    now, then = translation(turning), translation(late)
    np.testing.assert_allclose(then.measured[:, 3:], now.measured[:, 1:-2], atol=1e-9)
    np.testing.assert_allclose(then.lean[:, 3:], now.lean[:, 1:-2], atol=1e-9)
    assert translation_behind(turning, np.ones(1)) is turning


def test_only_motion_by_tilt_counts(turning: MotorRecord) -> None:
    (bare,) = flights(1, seed=0, duration_s=10.0, sample_rate_hz=RATE_HZ)
    # The turning one moves as no tilt moves it.
    found = with_translation([{}, {}], [turning, bare])
    assert found[1] == {}
    assert translated_axes(found) == ()
    moved = translation(turning)
    speed = np.cumsum(np.hstack([np.zeros((2, 1)), -9.81 * 0.5 * (moved.lean[:, 1:] + moved.lean[:, :-1])]), axis=1)
    level = turning.attitude * [[1.0], [1.0], [0.0]]
    pushed = replace(
        turning, attitude=level, velocity=earth_to_body(level, np.vstack([speed / RATE_HZ, 0.0 * speed[:1]]))
    )
    assert translated_axes(with_translation([{}], [pushed])) == ("x", "y")
