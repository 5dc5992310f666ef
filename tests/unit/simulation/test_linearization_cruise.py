"""Flights at speed: they are in the trim of level flight, and hover is what it was."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotorid.errors import ModelError, UsageError
from rotorid.flying.settings import SimulateSettings, parse_speed
from rotorid.flying.simulation import truth_of
from rotorid.simulation import PERFECT, fly_multirotor, hover_derivatives_of, linearize, trimmed
from rotorid.simulation.linearization import MOTION
from rotorid.simulation.multirotor_flight import piloted
from rotorid.vehicles import aircraft

CRAFT = piloted(replace(aircraft("forward_quad"), sensors=PERFECT))


@pytest.mark.parametrize("speed_m_s", [-3.0, 4.0, 8.0])
def test_a_flight_at_speed_is_in_trim(speed_m_s: float) -> None:
    flown = fly_multirotor(CRAFT, duration_s=2.0, speed_m_s=(speed_m_s, speed_m_s)).truth
    trim = trimmed(CRAFT.vehicle, speed_m_s)
    assert flown["velocity_north"].mean() == pytest.approx(speed_m_s, abs=0.05)
    assert flown["theta"].mean() == pytest.approx(trim.angles_rad[1], abs=2e-3)
    shares = [flown[f"motor_speed_{number}"].mean() for number in range(1, 5)]
    np.testing.assert_allclose(shares, trim.shares, atol=2e-3)


def test_the_speed_goes_straight_from_the_first_to_the_last() -> None:
    flown = fly_multirotor(CRAFT, duration_s=20.0, speed_m_s=(2.0, 5.0))
    asked = np.linspace(2.0, 5.0, flown.samples)
    # It lags by the loop's answer, about a second.
    assert np.abs(flown.truth["velocity_north"] - asked).max() < 0.4


def test_derivatives_at_speed_are_those_of_the_forces_alone() -> None:
    found = hover_derivatives_of(CRAFT.vehicle, CRAFT.autopilot, airspeed_m_s=8.0)
    system = linearize(CRAFT.vehicle, CRAFT.autopilot, airspeed_m_s=8.0)
    u_0, _, w_0 = trimmed(CRAFT.vehicle, 8.0).velocity_m_s
    row = {name: place for place, name in enumerate(MOTION)}
    assert found["Z_q"] == pytest.approx(system.F[row["w"], row["q"]] - u_0, abs=1e-9)
    assert found["X_q"] == pytest.approx(system.F[row["u"], row["q"]] + w_0, abs=1e-9)
    assert found["Y_r"] == pytest.approx(system.F[row["v"], row["r"]] + u_0, abs=1e-9)
    assert found["Y_p"] == pytest.approx(system.F[row["v"], row["p"]] - w_0, abs=1e-9)
    # Rotors off the center of gravity leave a hundredth of it.
    assert max(abs(found[name]) for name in ("X_q", "Z_q", "Y_p", "Y_r")) < 0.05


def test_the_truth_of_a_flight_is_that_of_its_speed() -> None:
    hover, fast, between = (truth_of(CRAFT, speeds) for speeds in ((0.0, 0.0), (8.0, 8.0), (0.0, 8.0)))
    assert fast["X_u"].value < hover["X_u"].value < 0.0
    assert "X_u" not in between
    assert between["T_motor"] == hover["T_motor"]


def test_an_autopilot_that_holds_no_speed_is_refused() -> None:
    craft = aircraft("forward_quad")
    guidance = replace(craft.autopilot.guidance, hold_velocity=False)
    loose = replace(craft, autopilot=replace(craft.autopilot, guidance=guidance))
    with pytest.raises(UsageError, match="does not control velocity"):
        fly_multirotor(loose, duration_s=1.0, speed_m_s=(4.0, 4.0))


def test_a_speed_that_cannot_be_flown_is_refused() -> None:
    with pytest.raises(ModelError, match="cannot fly level at 30 m/s"):
        fly_multirotor(CRAFT, duration_s=1.0, speed_m_s=(30.0, 30.0))


@pytest.mark.parametrize("text", ["", "fast", "1:x", "nan", "0:inf"])
def test_a_speed_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="--speed"):
        parse_speed(text)


def test_a_speed_beyond_all_vehicles_is_refused() -> None:
    with pytest.raises(UsageError, match="--speed -400 is out of range"):
        SimulateSettings(vehicle="forward_quad", speed_m_s=(0.0, -400.0))


def test_a_wind_from_the_side_drags_as_one_from_ahead() -> None:
    vehicle, autopilot = CRAFT.vehicle, CRAFT.autopilot
    still = hover_derivatives_of(vehicle, autopilot)
    ahead = hover_derivatives_of(vehicle, autopilot, airspeed_m_s=3.0)
    aside = hover_derivatives_of(vehicle, autopilot, aside_m_s=3.0)
    assert aside["Y_v"] / still["Y_v"] == pytest.approx(ahead["X_u"] / still["X_u"], rel=0.1)
    # A rotor drags by its own speed: rolling in wind from ahead turns the vehicle as pitching does in one from aside.
    assert (ahead["N_roll"], aside["N_pitch"]) == (
        pytest.approx(ahead["N_roll"]),
        pytest.approx(ahead["N_roll"], rel=0.2),
    )
    assert abs(ahead["N_roll"]) > 0.1 > abs(still["N_roll"])
