"""Random binary signals of several axes at the same time."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.errors import UsageError
from rotorid.excitation.plan import planned, uncorrelated_binaries
from rotorid.typing import FloatArray

AMPLITUDES = {"roll": 0.1, "pitch": 0.2, "thrust": 0.5}
WISH = {"start_s": 0.0, "band_rad_s": (1.5, 8.5), "duration_s": 60.0, "sample_rate_hz": 100.0, "clock_hz": 20.0}


def largest(a: FloatArray, b: FloatArray, reach: int) -> float:
    """The definition, delay by delay."""
    n = a.size
    products = [a[: n - k] @ b[k:] for k in range(reach + 1)] + [b[: n - k] @ a[k:] for k in range(1, reach + 1)]
    return float(np.abs(products).max() / (n * np.abs(a).max() * np.abs(b).max()))


def test_each_axis_has_two_levels_and_switches_on_the_clock_alone() -> None:
    for one in uncorrelated_binaries(AMPLITUDES, **WISH):  # type: ignore[arg-type]
        assert np.unique(one.values).tolist() == [-AMPLITUDES[one.axis], AMPLITUDES[one.axis]]
        assert not np.any(np.flatnonzero(np.diff(one.values)) % 5 != 4)


def test_the_stated_correlation_is_the_largest_with_those_before() -> None:
    roll, pitch, thrust = uncorrelated_binaries(AMPLITUDES, **WISH)  # type: ignore[arg-type]
    assert "correlation" not in roll.settings
    assert pitch.settings["correlation"] == pytest.approx(largest(pitch.values, roll.values, 200), abs=1e-6)
    both = max(largest(thrust.values, other.values, 200) for other in (roll, pitch))
    assert thrust.settings["correlation"] == pytest.approx(both, abs=1e-6)


def test_they_share_less_than_independent_ones_do() -> None:
    chosen = [uncorrelated_binaries(AMPLITUDES, **WISH, seed=seed)[1].settings["correlation"] for seed in range(4)]  # type: ignore[arg-type]
    drawn = []
    for seed in range(12):
        one, other = (
            planned("roll", "random_binary", amplitude=1.0, seed=2 * seed + k, **WISH)  # type: ignore[arg-type]
            for k in range(2)
        )
        drawn.append(largest(one.values, other.values, 200))
    assert max(chosen) < min(np.median(drawn), 0.12)


def test_one_seed_one_answer() -> None:
    first, again = (uncorrelated_binaries(AMPLITUDES, **WISH, seed=3) for _ in range(2))  # type: ignore[arg-type]
    for one, other in zip(first, again, strict=True):
        np.testing.assert_array_equal(one.values, other.values)
        assert one.settings == other.settings


def test_a_clock_that_does_not_divide_the_rate_is_refused() -> None:
    with pytest.raises(UsageError, match="clock_hz=30 does not fit samples at 100 Hz"):
        uncorrelated_binaries(AMPLITUDES, **{**WISH, "clock_hz": 30.0})  # type: ignore[arg-type]
