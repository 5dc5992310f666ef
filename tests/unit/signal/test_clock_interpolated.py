"""True samples of channels that were joined by straight lines."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.signal.clock import Interpolated, interpolated
from rotorid.typing import FloatArray

SLOW = np.arange(0.0, 20.0, 0.1)
SAMPLES = np.random.default_rng(0).standard_normal((3, SLOW.size)).cumsum(axis=1)


def joined(time_s: FloatArray) -> FloatArray:
    return np.stack([np.interp(time_s, SLOW, row) for row in SAMPLES])


@pytest.mark.parametrize("offset_s", [0.0, 0.003, 0.0071])
def test_samples_are_found_wherever_they_lie_between_the_stamps(offset_s: float) -> None:
    time_s = np.arange(0.0, 19.8, 0.01) + offset_s
    found = interpolated(time_s, joined(time_s))
    assert found is not None
    start_s, stop_s = found.time_s[[0, -1]]
    inner = (start_s < SLOW) & (stop_s - 1e-9 > SLOW)
    np.testing.assert_allclose(found.time_s[1:-1], SLOW[inner], atol=1e-9)
    np.testing.assert_allclose(found.values[:, 1:-1], SAMPLES[:, inner], atol=1e-8)
    assert found.sample_rate_hz == pytest.approx(10.0)
    assert found.logged_rate_hz == pytest.approx(100.0)


def test_stamps_may_jitter() -> None:
    rng = np.random.default_rng(1)
    time_s = np.arange(0.0, 19.8, 0.01) + rng.uniform(0.0, 0.004, 1980)
    found = interpolated(time_s, joined(time_s))
    assert found is not None
    np.testing.assert_allclose(found.time_s[1:-1], SLOW[1 : found.time_s.size - 1], atol=1e-6)


@pytest.mark.parametrize("kind", ["noise", "sine", "held", "constant"])
def test_other_channels_are_left_alone(kind: str) -> None:
    time_s = np.arange(0.0, 20.0, 0.01)
    rows = {
        "noise": np.random.default_rng(2).standard_normal(time_s.size),
        "sine": np.sin(time_s),
        "held": np.repeat(np.random.default_rng(3).standard_normal(400), 5),
        "constant": np.ones(time_s.size),
    }
    assert interpolated(time_s, rows[kind][None]) is None


def test_a_smooth_motion_is_restored_better_than_by_lines() -> None:
    time_s = np.arange(0.0, 19.8, 0.01)
    motion = np.sin(2.0 * np.pi * 1.0 * time_s)
    lines = np.interp(time_s, SLOW, np.sin(2.0 * np.pi * 1.0 * SLOW))
    found = interpolated(time_s, lines[None])
    assert found is not None
    inner = slice(100, -100)
    left = np.std((found.smooth(time_s)[0] - motion)[inner])
    assert left < 0.05 * np.std((lines - motion)[inner])


def test_the_finding_says_both_rates() -> None:
    one = Interpolated(time_s=SLOW, values=SAMPLES, logged_rate_hz=100.0).finding("u0")
    assert (one.kind, one.severity) == ("interpolated_channel", "warning")
    assert one.message == (
        "u0 comes at 100 Hz, but was joined by straight lines between samples at 10.0 Hz: what is faster than 5.0 Hz "
        "is lost."
    )
