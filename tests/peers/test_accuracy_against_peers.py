"""Responses of noisy closed-loop flights against the truth, and beside those of peers tuned with the truth."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np
import pytest

if TYPE_CHECKING:
    from benchmarks.accuracy import Errors

accuracy = pytest.importorskip(
    "benchmarks.accuracy", reason="run from the root of the source, where the benchmarks are: python -m pytest"
)

SEEDS = 12
PEERS = ("ARX by least squares", "python-control, ERA", "SIPPY CVA", "Octave n4sid")


@cache
def found() -> dict[str, Errors]:
    """Errors of our methods over three flights."""
    job = accuracy.closed_loop()
    flights = [job.fly(seed) for seed in range(SEEDS)]
    truth = job.truth.response(accuracy.OMEGA_RAD_S)
    return {name: accuracy.errors([method(one) for one in flights], truth) for name, method in job.ours.items()}


def test_the_polished_response_is_within_the_bar_and_better_than_its_start() -> None:
    start, polished = found().values()
    assert polished.within_bar
    assert polished.size < start.size


def test_the_truth_of_samples_is_what_a_long_simulation_settles_to() -> None:
    job = accuracy.closed_loop()
    slow = accuracy.held(job.truth) / job.truth.response(accuracy.OMEGA_RAD_S)
    half = 0.5 * accuracy.OMEGA_RAD_S / accuracy.RATE_HZ
    # A hold delays by half a sample and fades; what aliases of a second order is the square of frequency over rate.
    hold = np.sinc(half / np.pi) * np.exp(-1j * half)
    assert np.abs(slow / hold - 1.0).max() < (accuracy.OMEGA_RAD_S[-1] / (np.pi * accuracy.RATE_HZ)) ** 2


@pytest.mark.parametrize("name", PEERS)
def test_it_is_no_worse_than_a_peer_tuned_with_the_truth(name: str) -> None:
    job = accuracy.closed_loop()
    here = {peer.name: peer for peer in accuracy.peers(outputs=1, orders=job.orders, delays=job.delays)}
    if name not in here:
        pytest.skip(f"{name} is not installed")
    records = [job.fly(seed).record for seed in range(SEEDS)]
    theirs = accuracy.best_tuned(here[name], records, accuracy.held(job.truth))
    assert found()["rotorid, then output error"].size <= theirs.size
