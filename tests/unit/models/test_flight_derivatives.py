"""Derivatives of the physics of flight: those of the simulated vehicle with the same numbers, and their errors."""

from __future__ import annotations

import numpy as np
import pytest
from tests.unit.simulation import craft

from rotorid.errors import ModelError
from rotorid.models.flight import Airframe
from rotorid.models.flight_derivatives import flight_derivatives, flight_trim
from rotorid.simulation.flight_physics import with_flight
from rotorid.simulation.linearization import hover_derivatives_of, trimmed
from rotorid.simulation.multirotor import Multirotor

DISC_M2 = 0.05
NUMBERS = {
    "m": 1.2,
    "c_2": 12.0,
    "c_lambda": 0.45,
    "k_d": 0.12,
    "k_w": 0.004,
    "c_h": 0.03,
    "c_hw": 0.002,
    "c_ha": -0.003,
    "d_z": 0.02,
    "c_wake": 0.05,
    "I_xx": 0.012,
    "I_yy": 0.013,
    "I_zz": 0.02,
    "kappa": 0.018,
    "m_s": 0.003,
    "kappa_lambda": 0.0004,
    "k_r": 0.002,
}
SPEEDS = (0.0, 3.0, 9.0)


@pytest.fixture(scope="module")
def vehicle() -> Multirotor:
    return with_flight(craft.vehicle(), NUMBERS, disc_m2=DISC_M2)


@pytest.fixture(scope="module")
def numbers() -> dict[str, float]:
    return dict(NUMBERS)


@pytest.fixture(scope="module")
def frame(vehicle: Multirotor) -> Airframe:
    return Airframe(
        positions=vehicle.hubs_m, spins=vehicle.rotors.layout.spins, mass_kg=vehicle.mass_kg, disc_m2=DISC_M2
    )


def test_the_trim_is_that_of_the_simulated_vehicle(
    vehicle: Multirotor, numbers: dict[str, float], frame: Airframe
) -> None:
    for speed in SPEEDS[1:]:
        ours, theirs = flight_trim(numbers, frame, speed), trimmed(vehicle, speed)
        assert [ours.phi_rad, ours.theta_rad] == pytest.approx(theirs.angles_rad[:2], abs=1e-6)
        np.testing.assert_allclose(ours.rotors, theirs.shares, rtol=1e-5)


def test_derivatives_are_the_exact_slopes_of_the_simulated_vehicle(
    vehicle: Multirotor, numbers: dict[str, float], frame: Airframe
) -> None:
    """Its slopes are those of complex steps through other code."""
    found = flight_derivatives(numbers, frame, SPEEDS[1:])
    for place, speed in enumerate(SPEEDS[1:]):
        exact = hover_derivatives_of(vehicle, craft.autopilot(), airspeed_m_s=speed)
        ours = dict(zip(found.names, found.values[place].tolist(), strict=True))
        assert len(ours) == 36
        off = {name: (value, exact[name]) for name, value in ours.items() if abs(value - exact[name]) > 2e-4}
        assert not off


def test_drag_and_flapping_in_hover_are_those_of_formulas(numbers: dict[str, float], frame: Airframe) -> None:
    """The wake of hover is not skewed yet: its gradient is half the edgewise speed."""
    held = {"m": 1.2, "c_2": 12.0, "k_d": 0.12, "I_xx": 0.012, "I_yy": 0.013, "kappa": 0.018}
    found = flight_derivatives({**held, "m_f": 0.002}, frame, [0.0])
    turning = float(found.trims[0].rotors.sum())
    height = -float(frame.positions[0, 2])
    expected = {
        "X_u": -0.12 * turning / 1.2,
        "Y_v": -0.12 * turning / 1.2,
        "M_u": (0.002 / 2.0 + 0.12 * height) * turning / 0.013,
        "L_v": -(0.002 / 2.0 + 0.12 * height) * turning / 0.012,
        "Z_w": 0.0,
        "X_w": 0.0,
    }
    ours = dict(zip(found.names, found.values[0].tolist(), strict=True))
    assert {name: ours[name] for name in expected} == pytest.approx(expected, rel=1e-4, abs=1e-6)


def test_errors_go_over_as_many_draws_say(numbers: dict[str, float], frame: Airframe) -> None:
    free = ("c_lambda", "k_d", "I_yy")
    std = np.array([0.1 * numbers[name] for name in free])
    correlation = np.array([[1.0, 0.5, 0.0], [0.5, 1.0, 0.0], [0.0, 0.0, 1.0]])
    covariance = correlation * np.outer(std, std)
    found = flight_derivatives(numbers, frame, SPEEDS, free=free, covariance=covariance)
    draws = np.random.default_rng(1).multivariate_normal([numbers[name] for name in free], covariance, size=120)
    drawn = np.array(
        [
            flight_derivatives({**numbers, **dict(zip(free, draw.tolist(), strict=True))}, frame, SPEEDS).values
            for draw in draws
        ]
    )
    for name in ("X_u", "Z_w", "M_u", "Y_v"):
        place = found.names.index(name)
        np.testing.assert_allclose(drawn.std(axis=0)[:, place], found.std[:, place], rtol=0.25)
    values, spread = found.at(2, ["Z_w", "X_u"])
    assert values == pytest.approx([found.values[2, found.names.index(name)] for name in ("Z_w", "X_u")])
    assert np.sqrt(spread.diagonal()) == pytest.approx(
        [found.std[2, found.names.index(name)] for name in ("Z_w", "X_u")]
    )


def test_without_inertia_there_are_no_derivatives_of_moments(numbers: dict[str, float], frame: Airframe) -> None:
    found = flight_derivatives({**numbers, "I_xx": 0.0, "I_zz": 0.0}, frame, [0.0])
    assert {name[0] for name in found.names} == {"X", "Y", "Z", "M"}


def test_a_speed_beyond_the_rotors_is_refused(numbers: dict[str, float], frame: Airframe) -> None:
    with pytest.raises(ModelError, match="do not carry"):
        flight_trim(numbers, frame, 400.0)


def test_what_tilts_back_is_that_of_the_simulated_vehicle(frame: Airframe) -> None:
    """Skewed wakes, and drag above the center of gravity, by whichever of frame and number that is known."""
    tilting = {**NUMBERS, "m_f": 0.004, "m_fx": 0.002}
    flying = with_flight(craft.vehicle(), {**tilting, "z_cg": 0.03}, disc_m2=DISC_M2)
    ours = flight_derivatives({**tilting, "z_cg": 0.03}, frame, SPEEDS)
    for place, speed in enumerate(SPEEDS):
        theirs = hover_derivatives_of(flying, craft.autopilot(), airspeed_m_s=speed)
        for name in ("M_u", "L_v", "M_w"):
            value = ours.values[place, ours.names.index(name)]
            assert value == pytest.approx(theirs[name], rel=0.02, abs=0.01), (name, speed)
