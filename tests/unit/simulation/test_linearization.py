"""The linear hover model: against finite perturbations, published derivatives and flights of the nonlinear one."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Literal, TypeAlias

import numpy as np
import pytest
from tests.unit.simulation import craft
from tests.unit.simulation.test_multirotor import plus

from rotorid.data.flight_plan import Entry, FlightPlan, PlannedInput, SimulatedFlight
from rotorid.data.record import AXES
from rotorid.models.physical import MIXER, hover_derivatives
from rotorid.simulation.autopilot import Autopilot
from rotorid.simulation.flight_kernels import derivative, glide
from rotorid.simulation.hover_flight import OUTPUTS
from rotorid.simulation.linearization import (
    MOTION,
    entry_of,
    feedback_of,
    hover_derivatives_of,
    hover_states,
    linearize,
)
from rotorid.simulation.multirotor import PERFECT, STATES, Multirotor, Sensors
from rotorid.simulation.multirotor_flight import Aircraft, fly_multirotor
from rotorid.typing import Axis, ComplexArray, FloatArray

PLACE = (0.03, 0.02, -0.04)


def test_derivatives_are_those_of_the_published_equations() -> None:
    physics, vehicle = plus()
    autopilot = craft.idle(mixer=MIXER * physics["k_n"] / 200.0)
    found = hover_derivatives_of(vehicle, autopilot)
    wanted = hover_derivatives(physics)
    np.testing.assert_allclose([found[name] for name in wanted], list(wanted.values()), rtol=1e-12)
    others = np.array([value for name, value in found.items() if name not in wanted])
    assert len(others) == 61 - len(wanted)
    np.testing.assert_allclose(others, 0.0, atol=1e-12)


def quaternion(phi: float, theta: float, psi: float) -> FloatArray:
    """By three turns, one after the other."""

    def product(a: FloatArray, b: FloatArray) -> FloatArray:
        vector = a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])
        return np.array([a[0] * b[0] - a[1:] @ b[1:], *vector])

    roll, pitch, yaw = (
        np.array([np.cos(0.5 * angle), *(np.sin(0.5 * angle) * np.eye(3)[axis])])
        for axis, angle in enumerate((phi, theta, psi))
    )
    return product(product(yaw, pitch), roll)


def body_rates(vehicle: Multirotor, point: FloatArray, outputs: FloatArray) -> FloatArray:
    """Rates of the states of the hover model, by the compiled equations and by differences of attitude."""
    turn = quaternion(*point[6:9])
    w, vector = turn[0], turn[1:]

    def to_earth(one: FloatArray) -> FloatArray:
        return np.asarray(one + 2.0 * np.cross(vector, np.cross(vector, one) + w * one))

    def to_body(one: FloatArray) -> FloatArray:
        return np.asarray(one + 2.0 * np.cross(vector, np.cross(vector, one) - w * one))

    state = np.concatenate([np.zeros(3), to_earth(point[:3]), turn, point[3:6], point[9:]])
    out = np.zeros(STATES + 4 + 3)
    derivative(state, outputs, np.zeros(3), 1.0, vehicle.body(), out)
    phi, theta = point[6:8]
    p, q, r = point[3:6]
    angles = (
        p + np.tan(theta) * (q * np.sin(phi) + r * np.cos(phi)),
        q * np.cos(phi) - r * np.sin(phi),
        (q * np.sin(phi) + r * np.cos(phi)) / np.cos(theta),
    )
    moving = to_body(out[3:6]) - np.cross(point[3:6], point[:3])
    return np.concatenate([moving, out[10:13], angles, out[STATES:]])


def test_slopes_are_those_of_finite_perturbations() -> None:
    vehicle, autopilot = craft.vehicle(), craft.autopilot()
    system = linearize(vehicle, autopilot, accelerometer_m=PLACE)
    hover = np.concatenate([np.zeros(9), vehicle.hover_shares])
    commands = autopilot.hover_commands(vehicle)
    size, inputs, step = hover.size, len(AXES), 1e-5
    found = np.zeros((size + 3, size + inputs))
    for column in range(size + inputs):
        ends = []
        for side in (step, -step):
            point, asked = hover.copy(), commands.copy()
            if column < size:
                point[column] += side
            else:
                asked[column - size] += side
            rates = body_rates(vehicle, point, craft.outputs_for(autopilot, vehicle, asked))
            rates[-3:] += np.cross(rates[3:6], PLACE)
            ends.append(rates)
        found[:, column] = (ends[0] - ends[1]) / (2.0 * step)
    accelerations = slice(OUTPUTS.index("ax"), None)
    felt = np.hstack([system.H0 + system.H1 @ system.F, system.H1 @ system.G])[accelerations]
    exact = np.vstack([np.hstack([system.F, system.G]), felt])
    # Central differences leave out a third derivative times the square of the step, and lose a rounding over the step.
    scale = np.abs(exact).max()
    np.testing.assert_allclose(found, exact, rtol=0.0, atol=scale * (step**2 + 1e-15 / step) * 10.0)
    np.testing.assert_array_equal(system.M, np.eye(size))
    assert hover_states(vehicle) == (*MOTION, *(f"motor_speed_{number}" for number in (1, 2, 3, 4)))


def test_rotors_without_lag_are_algebraic() -> None:
    lagged = craft.vehicle(rotors=craft.rotors(lag_up_s=1e-6, inertia_kg_m2=0.0))
    quick = craft.vehicle(rotors=craft.rotors(lag_up_s=0.0, inertia_kg_m2=0.0))
    autopilot, omega = craft.autopilot(), np.geomspace(0.3, 60.0, 9)
    first, second = (linearize(one, autopilot, accelerometer_m=PLACE) for one in (lagged, quick))
    with_lag, without = first.response(omega), second.response(omega)
    # What is left is the lag itself: omega T of every entry.
    np.testing.assert_allclose(without, with_lag, rtol=2.0 * omega[-1] * 1e-6, atol=1e-12)
    assert second.poles().size == len(MOTION)
    one, two = (hover_derivatives_of(each, autopilot) for each in (lagged, quick))
    np.testing.assert_allclose(list(one.values()), list(two.values()), rtol=1e-12, atol=1e-12)


def test_inputs_are_late_by_the_delays_and_half_a_turn() -> None:
    autopilot = craft.autopilot(delay_s=(0.01, 0.02, 0.03, 0.04))
    late = linearize(craft.vehicle(), autopilot).input_delays_s
    np.testing.assert_allclose(late, np.array([0.01, 0.02, 0.03, 0.04]) + 0.5 / 400.0, rtol=1e-12)


@pytest.mark.parametrize("slow", [True, False])
def test_two_lags_are_replaced_by_their_mean(slow: bool) -> None:
    """The first harmonic of a rotor that rises and falls by different lags, against that of the mean lag."""
    up_s, down_s = 0.045, 0.075
    mean_s, unequal = 0.06, 0.25
    vehicle = craft.vehicle(rotors=craft.rotors(lag_up_s=up_s, lag_down_s=down_s))
    omega, turns, samples = (0.05 if slow else 20.0) / mean_s, 12, 2000
    step_s = 2.0 * np.pi / omega / samples
    phase = 2.0 * np.pi * (np.arange(turns * samples) + 0.5) / samples
    outputs = np.tile(0.5 + 0.1 * np.sin(phase)[:, None], (1, 4))
    state = vehicle.hovering()
    state[STATES:] = 0.5
    states = glide(state, outputs, np.zeros((phase.size, 3)), 1.0, vehicle.body(), step_s)
    speed = states[-samples:, STATES] - states[-samples:, STATES].mean()
    at = np.exp(-2j * np.pi * np.arange(turns * samples - samples + 1, turns * samples + 1) / samples)
    response = 2.0 * np.mean(speed * at) / 0.1 * 1j
    seen_s = float((1.0 / response).imag / omega)
    fall = 1.0 - (0.0 if slow else 1.0 - 8.0 / np.pi**2) * unequal**2
    # The expansions are of second order in omega T, or in one over it, and in the difference of the lags.
    assert seen_s / mean_s == pytest.approx(fall, abs=unequal**2 * (0.05**2 + unequal**2 / 4.0))
    system = linearize(vehicle, craft.autopilot())
    np.testing.assert_allclose(np.diag(system.F)[len(MOTION) :], -1.0 / mean_s, rtol=1e-12)


Kind: TypeAlias = Literal["px4", "ardupilot"]


@cache
def small_aircraft(kind: Kind) -> Aircraft:
    sensors = replace(PERFECT, gyro_lag_s=0.002, accelerometer_place_m=PLACE)
    return Aircraft(vehicle=craft.vehicle(), autopilot=craft.autopilot(kind, rate_hz=800.0), sensors=sensors)


@cache
def still_flight(kind: Kind, duration_s: float) -> SimulatedFlight:
    """The same flight without a test input."""
    return fly_multirotor(small_aircraft(kind), duration_s=duration_s, settle_s=5.0)


@cache
def linear_loop(kind: Kind, samples: int) -> tuple[FloatArray, ComplexArray, ComplexArray]:
    """Frequencies of a flight, and its vehicle and the loop around it there."""
    aircraft = small_aircraft(kind)
    autopilot, sensors = aircraft.autopilot, aircraft.sensors
    plant = linearize(aircraft.vehicle, autopilot, accelerometer_m=sensors.accelerometer_place_m)
    omega = 2.0 * np.pi * autopilot.rate_hz / samples * np.arange(1.0, samples // 2 + 1)
    responses = np.moveaxis(plant.response(omega), -1, 0)
    feedback = np.moveaxis(feedback_of(autopilot, gyro_lag_s=sensors.gyro_lag_s).response(omega), -1, 0)
    return omega, responses, np.eye(4) - feedback @ responses


def linear_flight(kind: Kind, axis: int, entry: Entry, added: FloatArray) -> FloatArray:
    """Outputs of the linear loop under a test input that comes back at rest, shape ``(12, n)``."""
    omega, responses, loop = linear_loop(kind, added.size)
    autopilot = small_aircraft(kind).autopilot
    entering = np.moveaxis(entry_of(autopilot, entry).response(omega), -1, 0)[:, :, axis, None]
    commands = np.linalg.solve(loop, entering)
    spectrum = (responses @ commands)[:, :, 0].T * np.fft.rfft(added)[1:]
    whole = np.concatenate([np.zeros((len(OUTPUTS), 1)), spectrum], axis=1)
    return np.fft.irfft(whole, added.size, axis=1)


@pytest.mark.parametrize("kind", ["px4", "ardupilot"])
@pytest.mark.parametrize(
    ("axis", "entry", "shown"),
    [
        ("roll", "command", ("p", "phi", "v")),
        ("pitch", "command", ("q", "theta", "u")),
        ("yaw", "command", ("r", "psi")),
        ("thrust", "command", ("w", "az")),
        ("pitch", "attitude_setpoint", ("q", "theta", "u")),
        ("pitch", "stick", ("q", "theta", "u")),
    ],
)
def test_a_small_doublet_flies_as_the_linear_loop_says(
    kind: Kind, axis: Axis, entry: Entry, shown: tuple[str, ...]
) -> None:
    size, rate_hz = 1e-4, small_aircraft(kind).autopilot.rate_hz
    values = np.repeat([size, -size, 0.0], [160, 160, 1])
    one = PlannedInput(
        axis=axis, shape="doublet", start_s=0.5, values=values, sample_rate_hz=rate_hz, amplitude=size, entry=entry
    )
    plan = FlightPlan(name="small", inputs=(one,), trim_s=30.0)
    moved = fly_multirotor(small_aircraft(kind), plan, settle_s=5.0)
    still = still_flight(kind, plan.duration_s)
    added = np.zeros(moved.samples)
    added[400 : 400 + values.size] = values
    predicted = linear_flight(kind, AXES.index(axis), entry, added)
    places = dict(zip("uvw", ("velocity_north", "velocity_east", "velocity_down"), strict=True))
    for name in shown:
        source = "raw" if name == "az" else "truth"
        after, before = (getattr(one, source)[places.get(name, name)] for one in (moved, still))
        found, wanted = after - before, predicted[OUTPUTS.index(name)]
        if name == "az" and kind != "simple":
            # They log the mean of two samples.
            wanted = 0.5 * (wanted + np.roll(wanted, 1))
        # The mean of a response that comes to rest is lost with the zero frequency.
        wanted = wanted - wanted[:400].mean()
        assert np.abs(found - wanted).max() < 0.01 * np.abs(wanted).max(), name


def test_feedback_is_that_of_the_rate_controllers() -> None:
    """With no filter but first-order ones, at frequencies where a turn of the loop is short."""
    from rotorid.models.controller import RateController

    autopilot = craft.autopilot("ardupilot", gyro_cutoff_hz=0.0, rate_hz=8000.0)
    omega = np.geomspace(0.5, 30.0, 12)
    feedback = feedback_of(autopilot).response(omega)
    gains = autopilot.rates
    for axis, (rate, angle) in enumerate((("p", "phi"), ("q", "theta"))):
        controller = RateController(
            proportional_s=gains.proportional[axis],
            integral=gains.integral[axis],
            derivative_s2=gains.derivative[axis],
            angle_1_s=autopilot.angle_1_s[axis],
            derivative_of_error=True,
            derivative_cutoff_hz=gains.derivative_cutoff_hz[axis],
            target_cutoff_hz=gains.target_cutoff_hz[axis],
        )
        around = feedback[axis, OUTPUTS.index(rate)] + feedback[axis, OUTPUTS.index(angle)] / (1j * omega)
        wanted = -controller.response(omega)
        # Sums and differences of a loop are half a turn late, which the analog controller is not.
        np.testing.assert_allclose(around, wanted, rtol=omega[-1] / autopilot.rate_hz)


def test_autopilots_without_gains_feed_nothing_back() -> None:
    response = feedback_of(craft.idle()).response(np.array([1.0, 10.0]))
    np.testing.assert_array_equal(response, 0.0)
    assert isinstance(craft.idle(), Autopilot)
    assert Sensors().gyro_lag_s == 0.0
