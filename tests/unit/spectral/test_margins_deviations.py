"""Errors of margins are as large as their deviations: each number over eight noisy loops and attitudes."""

from __future__ import annotations

import numpy as np
import pytest
from tests.unit.spectral.test_margins import scores

from rotorid.typing import FloatArray


@pytest.fixture(scope="module")
def over_deviation() -> dict[str, FloatArray]:
    return scores(8, 0.02)


@pytest.mark.parametrize(
    "name",
    [
        *("crossover", "phase_margin", "delay_margin", "gain_margin_up", "gain_margin_down", "modulus_margin", "peak"),
        *("rejection", "omega_180", "phase_bandwidth", "gain_bandwidth", "phase_delay"),
    ],
)
def test_errors_scatter_by_their_deviations(over_deviation: dict[str, FloatArray], name: str) -> None:
    errors = over_deviation[name]
    assert np.isfinite(errors).all()
    # Of eight normal numbers 99 % scatter between 0.4 and 1.7 of what they should.
    assert 0.4 < np.sqrt(np.mean(errors**2)) < 1.7
