"""Whole flights: delays, batteries, steps of the integrator, seeds, flights that end."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from tests.unit.simulation import craft

from rotorid.autopilots.thrust import Linearization
from rotorid.data.flight_plan import FlightPlan, PlannedInput
from rotorid.errors import UsageError
from rotorid.simulation.flight_kernels import flight
from rotorid.simulation.multirotor import MOTORS, PERFECT, STATES, Battery
from rotorid.simulation.multirotor_flight import Aircraft, LostError, _steps, fly_multirotor
from rotorid.simulation.wind import Wind
from rotorid.typing import FloatArray
from rotorid.vehicles.catalog import aircraft

GUSTY = Wind(north_m_s=4.0, turbulence_m_s=0.8)


def stepped(delay_s: tuple[float, float, float, float], *, stride: int) -> FloatArray:
    """Speeds of the rotors of a vehicle whose thrust command steps at a tick, at every tick."""
    vehicle = craft.vehicle(rotors=craft.rotors(lag_down_s=0.03), center_of_gravity_m=(0.0, 0.0, 0.0))
    autopilot = craft.idle(delay_s=delay_s)
    ticks = 60
    asked, log, truth = np.zeros((ticks, 16)), np.zeros((ticks, MOTORS + 4)), np.zeros((ticks, STATES + 4 + 3))
    asked[20:, 3] = 0.05
    control = autopilot.control(vehicle, substeps=4)
    flown = flight(
        vehicle.hovering(),
        asked,
        np.zeros((ticks, 3)),
        np.zeros((ticks, 15)),
        vehicle.body(),
        vehicle.supply(),
        PERFECT.senses(),
        control,
        log,
        truth,
        stride,
    )
    assert flown == ticks
    return truth[:, STATES]


@pytest.mark.parametrize("stride", [1, 2, 4])
@pytest.mark.parametrize("delay_ms", [0, 1, 7, 22])
def test_commands_arrive_after_their_delay(delay_ms: int, stride: int) -> None:
    speeds = stepped((0.001, 0.002, 0.003, 1e-3 * delay_ms), stride=stride)
    hover = speeds[0]
    elapsed = np.maximum(4e-3 * (np.arange(speeds.size) - 20) - 1e-3 * delay_ms, 0.0)
    exact = hover + 0.05 * (1.0 - np.exp(-elapsed / 0.04))
    longest = 1e-3 * stride / 0.04
    assert np.abs(speeds - exact).max() < 0.05 * 40 * longest**5 / 120.0 * 1.5 + 1e-13


def flown_at(step_rate_hz: float | None, *, gyro_lag_s: float) -> FloatArray:
    """Rates of a flight through gusts, with everything in the loop."""
    flying = Aircraft(
        vehicle=craft.vehicle(),
        autopilot=craft.autopilot(rate_hz=250.0, delay_s=(0.004, 0.004, 0.004, 0.008)),
        sensors=replace(PERFECT, gyro_lag_s=gyro_lag_s),
    )
    values = np.repeat([0.1, -0.1, 0.1, 0.0], 100)
    one = PlannedInput(axis="roll", shape="doublet", start_s=0.1, values=values, sample_rate_hz=250.0, amplitude=0.1)
    plan = FlightPlan(name="steps", inputs=(one,), trim_s=1.0)
    flown = fly_multirotor(flying, plan, wind=GUSTY, seed=1, settle_s=1.0, step_rate_hz=step_rate_hz)
    return np.stack([flown.truth[name] for name in ("p", "q", "r")])


@pytest.mark.parametrize("gyro_lag_s", [0.0, 0.002])
def test_a_flight_is_of_fourth_order_in_its_step(gyro_lag_s: float) -> None:
    finest = flown_at(4000.0, gyro_lag_s=gyro_lag_s)
    errors = [np.abs(flown_at(rate, gyro_lag_s=gyro_lag_s) - finest).max() for rate in (250.0, 500.0, 1000.0)]
    slopes = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(slopes > 3.7)
    assert errors[0] < 1e-5 * np.abs(finest).max()
    assert np.abs(flown_at(None, gyro_lag_s=gyro_lag_s) - finest).max() < 1e-5 * np.abs(finest).max()


def test_steps_are_an_eighth_of_the_shortest_lag_or_a_turn() -> None:
    def steps(lag_up_s: float, rate_hz: float) -> tuple[int, int]:
        vehicle = craft.vehicle(rotors=craft.rotors(lag_up_s=lag_up_s, lag_down_s=None))
        return _steps(Aircraft(vehicle=vehicle, autopilot=craft.autopilot(rate_hz=rate_hz)), None)

    assert steps(0.04, 250.0) == (4, 4)
    assert steps(0.02, 250.0) == (4, 2)
    assert steps(0.001, 250.0) == (4, 1)
    assert steps(0.0, 50.0) == (20, 20)
    assert steps(0.04, 2000.0) == (1, 1)


def test_one_compilation_serves_all_vehicles() -> None:
    fly_multirotor(aircraft("x500"), duration_s=0.1, settle_s=0.0)
    kernel = cast(Any, flight)
    compiled = list(kernel.signatures)
    whole = replace(
        craft.vehicle(), mass_kg=1, quadratic_drag_n_s2_m2=(0, 0, 0), aerodynamics=np.zeros((6, 6), order="F")
    )
    fixed = craft.autopilot(mixer=craft.autopilot().mixer_for(whole), motor_range=(0, 1))
    for one in (aircraft("crazyflie"), aircraft("s500"), Aircraft(vehicle=whole, autopilot=fixed)):
        fly_multirotor(one, duration_s=0.1, settle_s=0.0)
    assert kernel.signatures == compiled


def test_same_seed_same_flight_bit_for_bit() -> None:
    flying = Aircraft(vehicle=craft.vehicle(), autopilot=craft.autopilot())
    one, two, other = (
        fly_multirotor(flying, duration_s=2.0, wind=GUSTY, seed=seed, settle_s=0.5) for seed in (3, 3, 4)
    )
    for where in ("columns", "raw", "truth"):
        for name, values in getattr(one, where).items():
            np.testing.assert_array_equal(values, getattr(two, where)[name])
    assert np.abs(one.raw["p"] - other.raw["p"]).min() > 0.0


def test_wind_leaves_the_noise_as_it_was() -> None:
    flying = Aircraft(vehicle=craft.vehicle(), autopilot=craft.autopilot("simple"))
    noises = []
    for wind in (Wind(), GUSTY):
        flown = fly_multirotor(flying, duration_s=1.0, wind=wind, settle_s=0.5)
        noises.append(flown.raw["p"] - flown.truth["p"])
    np.testing.assert_allclose(noises[0], noises[1], atol=1e-14)


BATTERY = Battery(full_v=16.8, empty_v=13.2, rated_v=15.5, resistance_ohm=0.02, capacity_ah=0.1, hover_current_a=18.0)


def test_a_battery_sags_and_empties() -> None:
    vehicle = craft.vehicle(battery=BATTERY)
    flying = Aircraft(vehicle=vehicle, autopilot=craft.autopilot(), sensors=PERFECT)
    flown = fly_multirotor(flying, duration_s=10.0, settle_s=0.0)
    voltage = flown.columns["battery_voltage"]
    # It begins with hover's current at full charge.
    assert voltage[0] == pytest.approx(16.8 - 0.02 * 18.0, abs=1e-12)
    shares = np.stack([flown.truth[f"motor_speed_{number}"] for number in (1, 2, 3, 4)])
    power = sum(np.maximum(0.0, vehicle.rotors.thrust[1] * x + vehicle.rotors.thrust[2] * x**2) ** 1.5 for x in shares)
    current = 18.0 * power / power[0]
    drawn = np.concatenate([[0.0], np.cumsum(current)[:-1]]) / 400.0
    wanted = 16.8 - 3.6 * drawn / 360.0 - 0.02 * current
    np.testing.assert_allclose(voltage, wanted, atol=1e-9)
    assert voltage[-1] < 15.0


def test_outputs_grow_as_the_battery_sags() -> None:
    vehicle = craft.vehicle(battery=BATTERY)
    flown = fly_multirotor(
        Aircraft(vehicle=vehicle, autopilot=craft.autopilot(), sensors=PERFECT), duration_s=10.0, settle_s=5.0
    )
    asked, speed, voltage = (
        flown.columns[name] if name in flown.columns else flown.truth[name]
        for name in ("motor_1", "motor_speed_1", "battery_voltage")
    )
    # The slow fall of voltage: what is asked for, times the voltage over the rated one, is what the rotor does.
    np.testing.assert_allclose(asked[-400:] * voltage[-400:] / 15.5, speed[-400:], rtol=2e-3)


def test_without_a_battery_its_voltage_is_not_compensated() -> None:
    line = Linearization(expo=0.65, low=0.1, high=0.95)
    plain, compensating = (
        fly_multirotor(
            Aircraft(vehicle=craft.vehicle(), autopilot=craft.autopilot(linearization=one), sensors=PERFECT),
            duration_s=0.5,
            settle_s=0.0,
        )
        for one in (line, replace(line, voltage_max=16.8, voltage_min=13.2))
    )
    np.testing.assert_array_equal(plain.columns["motor_1"], compensating.columns["motor_1"])


def test_a_vehicle_that_tumbles_is_lost() -> None:
    autopilot = craft.idle(rates=replace(craft.autopilot().rates, proportional=(-50.0, -50.0, -50.0)))
    vehicle = craft.vehicle(quadratic_drag_n_s2_m2=(1e6, 1e6, 1e6))
    with pytest.raises(LostError, match="turned over"):
        fly_multirotor(Aircraft(vehicle=vehicle, autopilot=autopilot), duration_s=20.0, wind=Wind(north_m_s=30.0))


def test_lags_shorter_than_the_steps_are_refused() -> None:
    vehicle = craft.vehicle(rotors=craft.rotors(lag_up_s=1e-4))
    with pytest.raises(UsageError, match="steps"):
        fly_multirotor(Aircraft(vehicle=vehicle, autopilot=craft.autopilot()), duration_s=1.0)
    with pytest.raises(UsageError, match="neither a plan nor a duration"):
        fly_multirotor(Aircraft(vehicle=craft.vehicle(), autopilot=craft.autopilot()))
