"""Dependence on other commands: found where it is, and as often by chance as the probability says."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import binom

from rotorid.data.record import Channel, TimeHistory
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.signal.step_response import CrossTerms, cross_terms
from rotorid.typing import FloatArray

SEEDS = 40


def random_binary(rng: np.random.Generator, samples: int) -> FloatArray:
    """Levels that change with one chance in eight at every sample."""
    return np.asarray(np.where(np.cumsum(rng.uniform(size=samples) < 0.125) % 2, 1.0, -1.0))


@lru_cache
def trial(seed: int, *, coupling: float, color: float) -> CrossTerms:
    rng = np.random.default_rng(seed)
    u, w = random_binary(rng, 200), random_binary(rng, 200)
    noise = lfilter([1.0], [1.0, -color], rng.standard_normal(200)) * 0.2
    y = lfilter([0.2], [1.0, -0.8], u + coupling * w) + noise
    history = TimeHistory(
        values=np.stack([y, u, w]),
        channels=tuple(Channel(name=name, unit="1") for name in ("y", "u", "w")),
        sample_rate_hz=20.0,
        start_s=0.0,
    )
    return cross_terms(history, output="y", own="u", others=["w"], memory_s=0.5)


@pytest.mark.parametrize("color", [0.0, pytest.param(0.97, marks=pytest.mark.slow)])
def test_chance_is_as_rare_as_stated(color: float) -> None:
    found = [trial(seed, coupling=0.0, color=color) for seed in range(SEEDS)]
    least, most = binom.interval(0.999, SEEDS, 0.1)
    shifted = sum(one.p_shifted <= 0.1 for one in found)
    assert least <= shifted <= most
    if color == 0.0:
        assert least <= sum(one.p_white <= 0.1 for one in found) <= most


def test_the_f_distribution_is_fooled_by_colored_noise() -> None:
    found = [trial(seed, coupling=0.0, color=0.97) for seed in range(SEEDS)]
    assert sum(one.p_white <= 0.1 for one in found) > binom.ppf(0.9999, SEEDS, 0.1)


def test_a_coupling_is_found_and_measured() -> None:
    found = [trial(seed, coupling=0.4, color=0.5) for seed in range(5)]
    assert all(one.p_shifted < 0.02 for one in found)
    # Commands of one spectrum: the coupled one adds the square of its share.
    assert np.mean([one.added_share / one.own_share for one in found]) == pytest.approx(0.16, rel=0.5)


def test_what_cannot_be_tested_is_said() -> None:
    history = TimeHistory(
        values=np.zeros((3, 40)),
        channels=tuple(Channel(name=name, unit="1") for name in ("y", "u", "w")),
        sample_rate_hz=20.0,
        start_s=0.0,
    )
    with pytest.raises(InsufficientDataError, match="20 samples for 43 terms"):
        cross_terms(history, output="y", own="u", others=["w"], memory_s=1.0)
    with pytest.raises(UsageError, match="no channel 'v'"):
        cross_terms(history, output="y", own="u", others=["v"], memory_s=0.1)
