"""Spectra of disturbances."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.errors import UsageError
from rotorid.planning.loop import Dryden, GaussMarkov, Tabulated, White


def test_the_power_of_white_samples_is_their_variance() -> None:
    hertz = np.linspace(0.05, 100.0, 2001)
    density = White(std=(0.3,), sample_rate_hz=200.0).density(2.0 * np.pi * hertz)[0, 0].real
    assert np.trapezoid(density, hertz) == pytest.approx(0.3**2, rel=1e-3)


def test_the_power_of_gusts_is_their_variance() -> None:
    hertz = np.geomspace(1e-5, 1e4, 20001)
    density = GaussMarkov(std=(0.5, 0.1), correlation_s=2.0).density(2.0 * np.pi * hertz)
    power = np.trapezoid(density.real, hertz, axis=2)
    np.testing.assert_allclose(power, np.diag([0.25, 0.01]), rtol=1e-3, atol=1e-12)


def test_the_power_of_dryden_gusts_is_their_variance_wherever_they_blow() -> None:
    hertz = np.geomspace(1e-5, 1e4, 20001)
    north = Dryden(level_std=0.5, vertical_std=0.3, level_s=7.0, vertical_s=2.0)
    for gusts in (north, Dryden(level_std=0.5, vertical_std=0.3, level_s=7.0, vertical_s=2.0, heading_rad=0.7)):
        power = np.trapezoid(gusts.density(2.0 * np.pi * hertz).real, hertz, axis=2)
        np.testing.assert_allclose(power, np.diag([0.25, 0.25, 0.09]), rtol=2e-3, atol=1e-3)


def test_gusts_across_the_wind_are_those_that_are_flown() -> None:
    """The density is the transform of the autocorrelation that :func:`rotorid.simulation.wind.transverse` states."""
    late_s = np.linspace(0.0, 60.0, 60001)
    shape = 0.25 * (1.0 - late_s / 6.0) * np.exp(-late_s / 3.0)
    omega = np.array([0.1, 0.5, 2.0])
    expected = [4.0 * np.trapezoid(shape * np.cos(one * late_s), late_s) for one in omega]
    gusts = Dryden(level_std=0.5, vertical_std=0.0, level_s=3.0, vertical_s=1.0)
    np.testing.assert_allclose(gusts.density(omega)[1, 1].real, expected, rtol=1e-4)


def test_a_table_gives_back_its_points_and_never_a_negative_power() -> None:
    rng = np.random.default_rng(0)
    factors = rng.standard_normal((7, 2, 1)) + 1j * rng.standard_normal((7, 2, 1))
    omega = np.geomspace(1.0, 50.0, 7)
    table = Tabulated(omega_rad_s=omega, values=np.moveaxis(factors @ factors.conj().swapaxes(1, 2), 0, -1))
    np.testing.assert_allclose(table.density(omega), table.values, atol=1e-12)
    between = np.moveaxis(table.density(np.geomspace(0.2, 200.0, 99)), -1, 0)
    assert np.linalg.eigvalsh(between).min() > -1e-12
    np.testing.assert_allclose(table.density(np.array([0.1]))[..., 0], table.values[..., 0])
    np.testing.assert_allclose(table.density(np.array([99.0]))[..., 0], table.values[..., -1])


def test_a_table_of_one_point_is_flat() -> None:
    table = Tabulated(omega_rad_s=[2.0], values=np.full((1, 1, 1), 3.0))
    np.testing.assert_allclose(table.density(np.array([1.0, 2.0, 5.0])), 3.0)


def test_a_table_without_order_is_refused() -> None:
    with pytest.raises(UsageError, match="rising"):
        Tabulated(omega_rad_s=[2.0, 1.0], values=np.ones((1, 1, 2)))
