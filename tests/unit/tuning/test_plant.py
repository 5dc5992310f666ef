"""Likely plants by a measurement whose errors are shared between frequencies."""

from __future__ import annotations

import numpy as np

from rotorid.tuning.plant import MeasuredRatio, uncertain_plant


def test_errors_that_neighbors_share_are_not_carried_far() -> None:
    """Windows make errors of neighbors alike to .99; what is left between them is no sure sign of a slope."""
    x = np.linspace(0.0, np.log(20.0), 60)
    alike = np.exp(-0.5 * ((x[:, None] - x) / 0.3) ** 2)
    root, rng = np.linalg.cholesky(alike + 1e-10 * np.eye(x.size)), np.random.default_rng(3)

    def noise() -> np.ndarray:
        return rng.standard_normal(x.size) + 1j * rng.standard_normal(x.size)

    error = 0.03 * (root @ noise()) + 0.002 * noise()
    measured = MeasuredRatio(
        omega_rad_s=np.exp(x), ratio=np.exp(error), covariance=(2.0 * 0.03**2 * alike).astype(complex)
    )
    plant = uncertain_plant(lambda omega: np.ones(np.shape(omega)), measured, band_rad_s=(1.0, 20.0))
    # The truth is one; without a share of their own the mean is off by .11 inside of the band and .17 beyond it.
    assert np.abs(np.log(plant.response(np.geomspace(1.0, 40.0, 100)))).max() < 0.05
