"""Derivatives of the vehicles in hover, by finite differences of their equations, against their sources."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from tests.unit.simulation.craft import outputs_for

from rotorid.data.record import AXES
from rotorid.io.registry import read
from rotorid.models.physical import hover_derivatives
from rotorid.simulation.multirotor import STATES
from rotorid.simulation.multirotor_flight import Aircraft, fly_multirotor
from rotorid.simulation.wind import Wind
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2 as G
from rotorid.vehicles import ardupilot as ardupilot_quad
from rotorid.vehicles import crazyflie, gazebo, s500
from rotorid.vehicles import hummingbird as hummingbird_flight
from rotorid.vehicles import px4 as px4_quad
from rotorid.vehicles import s500 as s500_flight
from rotorid.vehicles.catalog import aircraft

MOTIONS = {"u": 3, "v": 4, "w": 5, "p": 10, "q": 11, "r": 12}
"""In level flight to the north, velocities over ground are those of the body."""

ACCELERATIONS = {"X": -3, "Y": -2, "Z": -1, "L": 10, "M": 11, "N": 12}
"""Places in what the equations give; forces are specific ones, at the end."""

STEP = 1e-5


def rate_of(one: Aircraft, state: FloatArray, outputs: FloatArray) -> FloatArray:
    from rotorid.simulation.flight_kernels import derivative

    out = np.empty(state.size + 3)
    derivative(state, outputs, np.zeros(3), 1.0, one.vehicle.body(), out)
    return out


def derivatives(one: Aircraft) -> Mapping[str, float]:
    """Accelerations per motion, and per command once the rotors have followed it."""
    hover, commands = one.vehicle.hovering(), one.autopilot.hover_commands(one.vehicle)
    found: dict[str, float] = {}
    for name, place in MOTIONS.items():
        step = np.zeros(hover.size)
        step[place] = STEP
        slope = (rate_of(one, hover + step, hover[STATES:]) - rate_of(one, hover - step, hover[STATES:])) / (2.0 * STEP)
        found |= {f"{force}_{name}": slope[row] for force, row in ACCELERATIONS.items()}
    for row, axis in enumerate(AXES):
        rates = []
        for sign in (1.0, -1.0):
            outputs = outputs_for(one.autopilot, one.vehicle, commands + sign * STEP * np.eye(4)[row])
            rates.append(rate_of(one, np.concatenate([hover[:STATES], outputs]), outputs))
        slope = (rates[0] - rates[1]) / (2.0 * STEP)
        found |= {f"{force}_{axis}": slope[row] for force, row in ACCELERATIONS.items()}
    return found


def same(one: Aircraft, expected: Mapping[str, float], *, rtol: float) -> None:
    found = derivatives(one)
    np.testing.assert_allclose([found[name] for name in expected], list(expected.values()), rtol=rtol, atol=1e-6)


def test_px4_quad_answers_as_its_simulator() -> None:
    """113.1 rad/s² is four motors at 1/√2 of 5 N and 0.2 m over 0.025 kg m², and so on."""
    expected = {
        "L_roll": 4.0 * 0.5**0.5 * 5.0 * 0.2 / 0.025,
        "M_pitch": 4.0 * 0.5**0.5 * 5.0 * 0.2 / 0.025,
        "N_yaw": 4.0 * 0.1 / 0.030,
        "Z_thrust": -20.0,
        "L_p": -1.0,
        "M_q": -1.0,
        "N_r": -0.025 / 0.030,
        "X_u": -1.0,
        "Y_v": -1.0,
        "Z_w": -1.0,
        "M_u": 0.0,
        "L_yaw": 0.0,
    }
    same(aircraft("px4_quad"), expected, rtol=1e-9)


def test_ardupilot_quad_answers_as_measured_in_its_logs() -> None:
    """Measured to four digits in calm air; 20.29 N per unit are four digits too."""
    expected = {
        **dict.fromkeys(("L_roll", "M_pitch"), 437.2),
        "N_yaw": 14.18,
        "Z_thrust": -27.05,
        **dict.fromkeys(("L_p", "M_q", "N_r"), -1.987),
        **dict.fromkeys(("X_u", "Y_v", "Z_w"), -0.241),
    }
    same(aircraft("ardupilot_quad"), expected, rtol=5e-4)


def test_ardupilot_quad_hovers_at_the_outputs_of_its_logs() -> None:
    one = aircraft("ardupilot_quad")
    # In the calm log: 0.363 to 0.366 of thrust, 0.591 to 0.592 to the motors.
    assert one.autopilot.hover_commands(one.vehicle)[3] == pytest.approx(0.363, abs=0.001)
    np.testing.assert_allclose(one.vehicle.hover_shares, 0.591, atol=0.001)


def test_torque_of_ardupilot_quad_has_the_slope_of_its_simulator() -> None:
    """There Q = 0.05 d c T(c); its slope over thrust, where a quarter of the weight is carried."""
    thrust = G * ardupilot_quad.MASS_KG / 4.0
    c = np.roots([0.65, 0.35, -thrust / ardupilot_quad.LARGEST_THRUST_N]).max()
    slope = ardupilot_quad.LARGEST_THRUST_N * (0.35 + 1.3 * c)
    assert pytest.approx(0.05 * 0.35 * (c + thrust / slope), abs=5e-6) == ardupilot_quad.TORQUE_PER_THRUST_M


def test_s500_has_every_published_derivative() -> None:
    expected = {name: value for name, value in s500.TRUTH.items() if not name.startswith("tau")}
    same(aircraft("s500"), expected, rtol=1e-7)


def test_s500_has_no_other_derivatives() -> None:
    others = {name: value for name, value in derivatives(aircraft("s500")).items() if name not in s500.TRUTH}
    assert others
    np.testing.assert_allclose(list(others.values()), 0.0, atol=1e-6)


def test_s500_shows_the_published_delays() -> None:
    autopilot = aircraft("s500").autopilot
    shown = np.array(autopilot.delay_s) + 0.5 / autopilot.rate_hz
    np.testing.assert_allclose(shown, [s500.TRUTH[f"tau_{axis}"] for axis in AXES], atol=1e-12)
    # They are counted in steps of the integrator, of 1 ms, which they are whole multiples of.
    np.testing.assert_allclose(np.array(autopilot.delay_s) * 1000.0, np.rint(np.array(autopilot.delay_s) * 1000.0))


@pytest.mark.parametrize("seed", range(4))
def test_s500_flies_ten_minutes_in_gusts(seed: int) -> None:
    """Far from the angles, of more than one, at which those flights end that it does not survive."""
    flown = fly_multirotor(aircraft("s500"), duration_s=600.0, wind=Wind(turbulence_m_s=0.4), seed=seed)
    assert max(np.abs(flown.truth["phi"]).max(), np.abs(flown.truth["theta"]).max()) < 0.4
    assert flown.saturated == 0.0


def test_hummingbird_answers_as_the_forces_of_its_rotors() -> None:
    expected = hover_derivatives(hummingbird_flight.PHYSICS)
    scale = {name: hummingbird_flight.STEPS if name.split("_")[1] in AXES else 1.0 for name in expected}
    same(aircraft("hummingbird"), {name: value * scale[name] for name, value in expected.items()}, rtol=1e-6)


def test_hummingbird_has_the_published_derivatives() -> None:
    steps = hummingbird_flight.STEPS
    expected = {
        "X_u": -0.2090,
        "M_u": 8.207 * 0.7416,
        "M_pitch": 2.977 * 0.7416 * steps,
        "Z_w": -0.5934,
        "Z_thrust": -0.1692 * steps,
        # Table 3: N_omega times what friction leaves of k, with the steady 3.603 rad/s a step.
        "N_yaw": 0.5541 * (3.94 - 152.1 / 42.21) * steps,
    }
    same(aircraft("hummingbird"), expected, rtol=1e-6)


def test_hummingbird_yaws_against_the_acceleration_of_its_rotors() -> None:
    """N_spin of the yaw model: rad/s of yaw rate per step of a command that the rotors have followed."""
    one = aircraft("hummingbird")
    hover = one.vehicle.hovering()
    asked = one.autopilot.hover_commands(one.vehicle) + STEP * np.eye(4)[2]
    outputs = outputs_for(one.autopilot, one.vehicle, asked)
    # Lag times angular acceleration, before the rotors have moved at all.
    kick = rate_of(one, hover, outputs)[12] * one.vehicle.rotors.lag_up_s / STEP
    assert kick == pytest.approx(0.5541 * 3.94 / 42.21 * hummingbird_flight.STEPS, rel=1e-6)


@pytest.mark.parametrize(
    ("name", "motor", "mass_kg"),
    [("x500", gazebo.X500_MOTOR, gazebo.X500_MASS_KG), ("iris", gazebo.IRIS_MOTOR, gazebo.IRIS_MASS_KG)],
)
def test_gazebo_quads_answer_as_their_motor_models(name: str, motor: gazebo.Motor, mass_kg: float) -> None:
    speed = (mass_kg * G / 4.0 / motor.thrust_n_s2) ** 0.5
    slope = 2.0 * motor.thrust_n_s2 * speed * (motor.full_rad_s - motor.idle_rad_s)
    drag = 4.0 * motor.drag_n_s2_m * speed
    inertia = np.diag(aircraft(name).vehicle.inertia_kg_m2)
    height = {"x500": 0.06, "iris": 0.023}[name]
    expected = {
        "Z_thrust": -4.0 * slope / mass_kg,
        "N_yaw": 4.0 * motor.torque_per_thrust_m * slope / inertia[2],
        "X_u": -drag / mass_kg,
        "Y_v": -drag / mass_kg,
        "M_u": drag * height / inertia[1],
        "L_v": -drag * height / inertia[0],
    }
    if name == "iris":
        # Of unequal arms: its mixer does not ask the same of every motor to yaw.
        del expected["N_yaw"]
    same(aircraft(name), expected, rtol=1e-6)


def test_crazyflie_answers_as_its_curve_and_its_inertia() -> None:
    one = aircraft("crazyflie")
    c_0, c_1, c_2 = crazyflie.THRUST_N
    share = np.roots([c_2, c_1, c_0 - crazyflie.MASS_KG * G / 4.0]).max()
    slope = c_1 + 2.0 * c_2 * share
    expected = {
        "L_roll": 4.0 * 0.5 * slope * 0.028 / crazyflie.INERTIA_KG_M2[0],
        "M_pitch": 4.0 * 0.5 * slope * 0.028 / crazyflie.INERTIA_KG_M2[1],
        "N_yaw": 4.0 * slope * 0.005964552 / crazyflie.INERTIA_KG_M2[2],
        "Z_thrust": -4.0 * slope / crazyflie.MASS_KG,
        "X_u": -9.1785e-7 * 4.0 * 1862.0 / crazyflie.MASS_KG,
    }
    same(one, expected, rtol=1e-6)


def test_crazyflie_hovers_at_the_speed_of_its_bench_curves() -> None:
    """Förster: thrust and speed after a 16-bit command; at a quarter of the weight."""
    command = np.roots([2.130295e-11, 1.032633e-6, 5.484560e-4 - crazyflie.MASS_KG * G / 4.0]).max()
    assert 0.04076521 * command + 380.8359 == pytest.approx(crazyflie.HOVER_RAD_S, abs=1.0)


def test_parameters_of_px4_quad_are_those_of_the_log(shared_data: Path) -> None:
    log = read(shared_data / "px4_sitl" / "roll.ulg").parameters
    ours = {"IMU_GYRO_CUTOFF"}
    for name, value in px4_quad.PARAMETERS.items():
        assert name in ours or log[name] == pytest.approx(value, rel=1e-6), name


def test_parameters_of_ardupilot_quad_are_those_of_the_log(shared_data: Path) -> None:
    log = read(shared_data / "ardupilot_sitl" / "x_calm_roll.BIN").parameters
    ours = {"MOT_THST_HOVER", "MOT_BAT_VOLT_MAX", "MOT_BAT_VOLT_MIN"}
    for name, value in ardupilot_quad.PARAMETERS.items():
        if name not in ours:
            assert log[name] == pytest.approx(value, rel=1e-6), name


def test_s500_gains_of_velocity_are_those_of_the_linear_vehicle() -> None:
    guidance = s500_flight.aircraft().autopilot.guidance
    assert guidance.velocity_p_1_s / G == pytest.approx(s500.CONTROLLER.lean_rad_per_m_s)
    assert (guidance.climb_p, guidance.climb_i) == pytest.approx((s500.CONTROLLER.climb_p, s500.CONTROLLER.climb_i))
