"""Predictions over many steps against an exact flight of the same vehicle."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from rotorid.errors import InsufficientDataError
from rotorid.frames import euler_from_quaternion
from rotorid.models.flight import Airframe, flight_loads
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2
from rotorid.verification.multistep import QUANTITIES, FlightState, measured_states, pieces, pooled, slower, step_errors

FRAME = Airframe(
    positions=np.array([[0.1, 0.12, -0.01], [-0.1, -0.12, -0.01], [0.1, -0.12, -0.01], [-0.1, 0.12, -0.01]]),
    spins=np.array([1.0, 1.0, -1.0, -1.0]),
    mass_kg=0.75,
    disc_m2=0.05,
)
VALUES = {
    "c_2": 1.9e-6,
    "c_lambda": 2e-4,
    "k_d": 4e-5,
    "m_f": 3e-6,
    "kappa": 0.014,
    "J_r": 1e-5,
    "I_xx": 2.5e-3,
    "I_yy": 2.1e-3,
    "I_zz": 4.3e-3,
}
WIND = np.array([2.0, -1.0])
STEP_S = 0.01
SAMPLES = 60


def motors(time_s: FloatArray | float) -> FloatArray:
    """Speeds that go in lines between samples, of any time."""
    stamps = STEP_S * np.arange(SAMPLES + 1)
    rows = [1100.0 + 25.0 * np.sin((7.0 + 3.0 * i) * stamps + i) + 6.0 * (-1) ** i for i in range(4)]
    return np.array([np.interp(time_s, stamps, row) for row in rows])


def flown(values: dict[str, float]) -> FlightState:
    """The exact flight, in another attitude and by another integrator than those under test."""
    inertia = np.array([values["I_xx"], values["I_yy"], values["I_zz"]])

    def slope(time_s: float, state: FloatArray, early: float) -> FloatArray:
        turn = Rotation.from_quat(state[6:10])
        rates = state[10:]
        loads = flight_loads(
            values,
            FRAME,
            speeds=motors(time_s)[:, None],
            velocity=turn.inv().apply(state[3:6] - [*WIND, 0.0])[:, None],
            rates=rates[:, None],
            spin_up=((motors(early + STEP_S) - motors(early)) / STEP_S)[:, None],
        )
        acceleration = turn.apply(loads.force[:, 0]) / FRAME.mass_kg + [0.0, 0.0, STANDARD_GRAVITY_M_S2]
        x, y, z, w = state[6:10]
        p, q, r = rates
        turned = [w * p + y * r - z * q, w * q + z * p - x * r, w * r + x * q - y * p, -x * p - y * q - z * r]
        swung = (loads.moment[:, 0] - np.cross(rates, inertia * rates)) / inertia
        return np.concatenate([state[3:6], acceleration, 0.5 * np.array(turned), swung])

    begin = np.concatenate([[1.0, 2.0, -3.0, 1.5, -0.5, 0.2], Rotation.from_euler("ZYX", [0.4, 0.1, -0.2]).as_quat()])
    states = [np.concatenate([begin, [0.2, -0.1, 0.3]])]
    for k in range(SAMPLES - 1):
        span = (k * STEP_S, (k + 1) * STEP_S)
        states.append(solve_ivp(slope, span, states[-1], "DOP853", args=span[:1], rtol=1e-8, atol=1e-10).y[:, -1])
    found = np.array(states).T
    return FlightState(found[:3], found[3:6], found[[9, 6, 7, 8]], found[10:])


@pytest.fixture(scope="module")
def truth() -> FlightState:
    return flown(VALUES)


@pytest.fixture(scope="module")
def speeds() -> FloatArray:
    return motors(STEP_S * np.arange(SAMPLES))


def test_the_true_vehicle_predicts_its_flight(truth: FlightState, speeds: FloatArray) -> None:
    found = step_errors(VALUES, FRAME, truth, speeds, step_s=STEP_S, steps=40, wind=WIND)
    assert found.starts == SAMPLES - 40
    for name in QUANTITIES:
        # Order four: 40 steps of 10 ms with rates of change below 10 1/s.
        assert found.model[name].max() < 1e-5, name
        assert found.naive[name][-1] > 0.1, name
        assert found.ratios[name] < 1e-4, name


def test_errors_of_integration_are_of_the_fourth_order(truth: FlightState, speeds: FloatArray) -> None:
    """Twice the step, sixteen times the error: of motors that go in lines over the longer step too."""
    coarse = truth.at(np.arange(0, SAMPLES, 2))
    lines = 0.5 * (speeds[:, :-2:2] + speeds[:, 2::2])
    bent = np.abs(speeds[:, 1:-1:2] - lines).max()
    found = step_errors(VALUES, FRAME, coarse, speeds[:, ::2], step_s=2 * STEP_S, steps=10, wind=WIND)
    # What is left is that the motors bend between the samples, here by a part of 1e-4.
    assert bent / speeds.mean() < 1e-3
    assert found.ratios["velocity"] < 1e-3


def test_a_wrong_vehicle_falls_short_by_its_missing_force(truth: FlightState, speeds: FloatArray) -> None:
    rolling = {**VALUES, "k_d": 0.0}
    found = step_errors(rolling, FRAME, truth, speeds, step_s=STEP_S, steps=5, wind=WIND)
    against = truth.velocity - np.array([*WIND, 0.0])[:, None]
    body = Rotation.from_quat(truth.attitude[[1, 2, 3, 0]].T).inv().apply(against.T).T
    drag = VALUES["k_d"] * speeds.sum(axis=0) * np.hypot(body[0], body[1]) / FRAME.mass_kg
    # The air velocity of the body stands for that of the hubs, which turn about it.
    np.testing.assert_allclose(found.model["velocity"], drag[:-5].mean() * found.horizons_s, rtol=0.1)


def test_wind_matters(truth: FlightState, speeds: FloatArray) -> None:
    calm = step_errors(VALUES, FRAME, truth, speeds, step_s=STEP_S, steps=30)
    assert calm.model["velocity"][-1] > 100.0 * 1e-5


def test_an_axis_without_inertia_keeps_its_rate(truth: FlightState, speeds: FloatArray) -> None:
    known = {name: value for name, value in VALUES.items() if not name.startswith("I_")}
    found = step_errors(known, FRAME, truth, speeds, step_s=STEP_S, steps=20, wind=WIND)
    np.testing.assert_allclose(found.model["rates"], found.naive["rates"])


def test_states_of_a_log(truth: FlightState) -> None:
    """Angles and body velocities lead to the states, and positions are integrals of velocities."""
    angles = euler_from_quaternion(truth.attitude)
    turns = Rotation.from_quat(truth.attitude[[1, 2, 3, 0]].T)
    body = turns.inv().apply(truth.velocity.T).T
    found = measured_states(angles, body, truth.rates, step_s=STEP_S)
    signs = np.sign((found.attitude * truth.attitude).sum(axis=0))
    np.testing.assert_allclose(signs * found.attitude, truth.attitude, atol=1e-12)
    np.testing.assert_allclose(found.velocity, truth.velocity, atol=1e-12)
    # The trapezoidal rule: a twelfth of the squared step times the change of acceleration.
    np.testing.assert_allclose(found.position, truth.position - truth.position[:, :1], atol=STEP_S**2)


def test_stretches_are_pooled_by_their_starts(truth: FlightState, speeds: FloatArray) -> None:
    whole = step_errors(VALUES, FRAME, truth, speeds, step_s=STEP_S, steps=10)
    halves = [
        step_errors(
            VALUES, FRAME, FlightState(*(rows[:, part] for rows in truth)), speeds[:, part], step_s=STEP_S, steps=10
        )
        for part in (slice(0, 35), slice(25, SAMPLES))
    ]
    found = pooled(halves)
    assert found.starts == whole.starts
    np.testing.assert_allclose(found.model["velocity"], whole.model["velocity"], rtol=1e-12)


def test_a_stretch_shorter_than_the_horizon_is_refused(truth: FlightState, speeds: FloatArray) -> None:
    with pytest.raises(InsufficientDataError, match=r"0\.6 s.*0\.6 s of prediction"):
        step_errors(VALUES, FRAME, truth, speeds, step_s=STEP_S, steps=SAMPLES)


def test_pieces_begin_anew_and_are_the_same_flight(truth: FlightState, speeds: FloatArray) -> None:
    starts = [0, 20, 45]
    found = pieces(VALUES, FRAME, truth, speeds, step_s=STEP_S, starts=starts, wind=WIND)
    for name, rows, exact in zip(FlightState._fields, found, truth, strict=True):
        assert np.abs(rows - exact).max() < 1e-5, name
        np.testing.assert_array_equal(rows[:, starts], exact[:, starts])


def test_a_fast_log_is_flown_at_longer_steps(truth: FlightState, speeds: FloatArray) -> None:
    states, slow = slower(truth, speeds, step_s=STEP_S, least_s=2 * STEP_S)
    assert slow.shape[1] == states.rates.shape[1] == SAMPLES // 2
    found = step_errors(VALUES, FRAME, states, slow, step_s=2 * STEP_S, steps=10, wind=WIND)
    # Means flatten motors that turn by 0.3 rad in a step by 1 to 2 %.
    assert max(found.ratios.values()) < 0.02
    same, fast = slower(truth, speeds, step_s=STEP_S, least_s=STEP_S)
    assert same is truth
    assert fast is speeds
