"""What flights of the vehicles show at single frequencies: the delays of the simulators, the responses of the Bebop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.flight_plan import Entry, FlightPlan, PlannedInput, SimulatedFlight
from rotorid.simulation.multirotor import PERFECT
from rotorid.simulation.multirotor_flight import Aircraft, fly_multirotor
from rotorid.typing import Axis, ComplexArray, FloatArray
from rotorid.vehicles import bebop
from rotorid.vehicles import bebop as bebop_flight
from rotorid.vehicles.catalog import aircraft


def waves(
    one: Aircraft, axis: Axis, omega: FloatArray, *, amplitude: float, period_s: float, entry: Entry = "command"
) -> SimulatedFlight:
    """Two periods of a sum of cosines under perfect sensors; the second one is steady."""
    rate_hz = one.autopilot.rate_hz
    time_s = np.arange(round(2.0 * period_s * rate_hz)) / rate_hz
    phases = np.random.default_rng(5).uniform(0.0, 2.0 * np.pi, omega.size)
    values = np.cos(np.outer(time_s, omega) + phases).sum(axis=1)
    planned = PlannedInput(
        axis=axis,
        shape="multisine",
        start_s=0.0,
        values=amplitude * values / np.abs(values).max(),
        sample_rate_hz=rate_hz,
        amplitude=amplitude,
        entry=entry,
    )
    return fly_multirotor(replace(one, sensors=PERFECT), FlightPlan(name="waves", inputs=(planned,), trim_s=0.0))


def ratio(flown: SimulatedFlight, y: FloatArray, u: FloatArray, omega: FloatArray) -> ComplexArray:
    """Response at the lines, from the second half."""
    half = flown.samples // 2
    motor_speed = np.exp(-1j * np.outer(omega, flown.time_s[half:]))
    return np.asarray((motor_speed @ y[half:]) / (motor_speed @ u[half:]))


LINES = 2.0 * np.pi / 20.0 * np.array([3, 5, 9, 15, 25, 41, 67, 111, 157])
"""0.9 to 49 rad/s, whole cycles in 20 s."""


@pytest.mark.parametrize(
    ("axis", "rate", "gain", "damping"),
    [("roll", "p", 113.1, 1.0), ("pitch", "q", 113.1, 1.0), ("yaw", "r", 13.33, 0.8333)],
)
def test_px4_quad_shows_lag_and_delay_of_its_simulator(axis: Axis, rate: str, gain: float, damping: float) -> None:
    """48 ms and 5.3 ms from torque set-point to angular velocity: printed to 0.1 ms, which at 50 rad/s is 0.3°."""
    flown = waves(aircraft("px4_quad"), axis, LINES, amplitude=0.03, period_s=20.0)
    found = ratio(flown, flown.columns[rate], flown.columns[f"{axis}_command"], LINES)
    s = 1j * LINES
    off = found / (gain * np.exp(-0.0053 * s) / ((0.048 * s + 1.0) * (s + damping)))
    np.testing.assert_allclose(np.abs(off), 1.0, atol=0.005)
    np.testing.assert_allclose(np.angle(off), 0.0, atol=np.radians(0.3))


@pytest.mark.parametrize(("axis", "rate", "gain"), [("roll", "p", 437.2), ("pitch", "q", 437.2), ("yaw", "r", 14.18)])
def test_ardupilot_quad_shows_the_delay_of_its_simulator(axis: Axis, rate: str, gain: float) -> None:
    """2.4 to 2.5 ms from command to the rates that the log has."""
    omega = np.append(LINES, 2.0 * np.pi * np.array([10.0, 20.0]))
    flown = waves(aircraft("ardupilot_quad"), axis, omega, amplitude=0.02, period_s=20.0)
    found = ratio(flown, flown.raw[rate], flown.columns[f"{axis}_command"], omega)
    s = 1j * omega
    off = found / (gain / (s + 1.987))
    np.testing.assert_allclose(np.abs(off), 1.0, atol=0.01)
    np.testing.assert_array_less(2.35e-3, -np.angle(off) / omega)
    np.testing.assert_array_less(-np.angle(off) / omega, 2.55e-3)


PUBLISHED = (bebop.first_order(), bebop.first_order_delay(), bebop.second_order())
BEBOP_LINES = 0.5 * np.array([1, 2, 4, 6, 8, 12, 16, 20])
"""0.5 to 10 rad/s, whole cycles in 4π s."""

BEBOP: Mapping[str, tuple[Axis, Entry, float]] = {
    "phi": ("roll", "attitude_setpoint", 0.1),
    "theta": ("pitch", "attitude_setpoint", 0.1),
    "velocity_down": ("thrust", "stick", 0.3),
}


@pytest.mark.parametrize("response", BEBOP)
def test_bebop_answers_as_much_like_the_published_models_as_they_like_each_other(response: str) -> None:
    axis, entry, amplitude = BEBOP[response]
    row = [y for _, y in bebop.PAIRS].index(response)
    flown = waves(aircraft("bebop"), axis, BEBOP_LINES, amplitude=amplitude, period_s=4.0 * np.pi, entry=entry)
    asked = -flown.columns["thrust_stick"] if entry == "stick" else flown.columns[f"{response}_setpoint"]
    found = ratio(flown, flown.columns[response], asked, BEBOP_LINES)
    models = np.array([model.response(BEBOP_LINES)[row, row] for model in PUBLISHED])
    middle = models.mean(axis=0)
    np.testing.assert_array_less(np.abs(found - middle), np.abs(models - middle).max(axis=0))


def test_bebop_slows_down_by_the_published_drag() -> None:
    air = aircraft("bebop").vehicle
    assert air.aerodynamics is not None
    np.testing.assert_allclose(np.diag(air.aerodynamics)[:2] / air.mass_kg, [-0.25, -0.33])


def test_interface_of_the_bebop_is_that_of_the_paper() -> None:
    flown = waves(aircraft("bebop"), "thrust", np.array([1.0]), amplitude=0.2, period_s=2.0 * np.pi, entry="stick")
    outside = bebop_flight.interface(flown, rng=np.random.default_rng(0))
    steps = np.diff(outside.time_s)
    assert outside.sample_rate_hz == 20.0
    assert outside.samples == pytest.approx(flown.time_s[-1] * 20.0, abs=1.0)
    assert 0.03 < steps.min() < steps.max() < 0.07
    assert {name for pair in bebop.PAIRS for name in pair} < set(outside.columns)
    assert not {"p", "motor_1", "roll_command", "thrust_stick"} & set(outside.columns)
    # One of the stick asks for 1 m/s upward.
    assert np.abs(outside.columns["velocity_down_setpoint"]).max() == pytest.approx(0.2, abs=0.005)
    np.testing.assert_array_equal(np.isin(outside.time_s, flown.time_s), True)
