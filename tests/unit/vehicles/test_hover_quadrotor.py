"""The quadrotor of the paper on genetic algorithms: what is said of its flight, and what is wrong with it in print."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.models.physical import check_inertia
from rotorid.models.rotors import check_mixer
from rotorid.units import STANDARD_GRAVITY_M_S2
from rotorid.vehicles import hover_quadrotor
from rotorid.vehicles.hover_quadrotor import PUBLISHED, SAMPLE_RATE_HZ, TRUTH, fly


def test_full_thrust_is_four_and_a_half_weights() -> None:
    full = 4.0 * TRUTH["c_t"] * TRUTH["omega_max"] ** 2
    assert full / (TRUTH["m"] * STANDARD_GRAVITY_M_S2) == pytest.approx(4.6, abs=0.05)


def test_it_stays_around_hover() -> None:
    flight = fly(np.random.default_rng(0))
    assert flight.motors.shape == (4, 6000)
    assert flight.time_s[1] == pytest.approx(0.01)
    hover = TRUTH["m"] * STANDARD_GRAVITY_M_S2 / (4.0 * TRUTH["c_t"] * TRUTH["omega_max"] ** 2)
    assert np.abs(flight.motors - hover).max() < 0.1
    assert np.degrees(np.abs(flight.attitude[:2])).max() < 15.0


def test_every_axis_has_a_doublet_every_four_seconds() -> None:
    asked = hover_quadrotor.excitation()
    for row in asked:
        begins = np.flatnonzero((row[1:] > 0.0) & (row[:-1] == 0.0)) / SAMPLE_RATE_HZ
        assert begins.size == 15
        np.testing.assert_allclose(np.diff(begins), 4.0)
        assert row.sum() == pytest.approx(0.0, abs=1e-12)
    assert np.count_nonzero(asked, axis=0).max() == 1


def test_noise_is_as_stated_and_comes_from_the_seed() -> None:
    flight = fly(np.random.default_rng(3))
    noise = (flight.accelerations - flight.exact).std(axis=1)
    # The standard deviation of 6000 samples scatters by 0.9 %.
    np.testing.assert_allclose(noise, [0.1, 0.5, 0.5, 0.5], rtol=0.04)
    np.testing.assert_array_equal(fly(np.random.default_rng(3)).accelerations, flight.accelerations)
    np.testing.assert_array_equal(fly(np.random.default_rng(4)).motors, flight.motors)
    assert np.abs(fly(np.random.default_rng(3), noise=0.0).accelerations - flight.exact).max() == 0.0


def test_attitude_is_the_integral_of_its_accelerations() -> None:
    flight = fly(np.random.default_rng(0))
    # Second differences of three angles are the mean acceleration about the middle one, which changes with the motors.
    twice = np.diff(flight.attitude, 2, axis=1) * SAMPLE_RATE_HZ**2
    change = np.abs(np.diff(flight.exact[1:], axis=1)).max(axis=1)
    assert np.all(np.abs(twice - flight.exact[1:, 1:-1]).max(axis=1) < 0.5 * change)


def test_printed_inertias_are_impossible_and_ours_are_not() -> None:
    (finding,) = check_inertia(*(PUBLISHED[name] for name in ("I_xx", "I_yy", "I_zz")))
    assert finding.kind == "impossible_physics"
    assert finding.numbers == {"kg_m2": 1.15, "sum_of_others_kg_m2": pytest.approx(0.36)}
    assert check_inertia(*(TRUTH[name] for name in ("I_xx", "I_yy", "I_zz"))) == []


def test_printed_mixer_is_singular_and_ours_is_not() -> None:
    (finding,) = check_mixer(hover_quadrotor.printed_mixer())
    ratio = TRUTH["kappa"] / hover_quadrotor.ARM_M
    assert finding.kind == "singular_mixer"
    assert f"U4 = -{ratio:.4g} U2 + {ratio:.4g} U3" in finding.message
    assert check_mixer(hover_quadrotor.mixer()) == []
    assert hover_quadrotor.layout().uncontrollable == ()
