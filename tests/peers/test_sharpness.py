"""The Cramér–Rao bound beside which methods are judged: it is exact for the flights of its twins."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

sharpness = pytest.importorskip(
    "benchmarks.sharpness", reason="run from the root of the source, where the benchmarks are: python -m pytest"
)
HEAVE = next(job for job in sharpness.JOBS if job.name == "Hummingbird heave")


@pytest.mark.slow
def test_the_filter_knows_the_noise_that_flew_and_longer_flights_have_more_information() -> None:
    record, data = sharpness.flight_of(HEAVE, 0)
    problem = sharpness.problem_of(HEAVE.twin, record)
    whole, white = sharpness.bound_of(HEAVE, problem, data)
    # Of 115 000 innovations.
    assert white == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / data.samples))
    half = replace(data, inputs=data.inputs[:, : data.samples // 2], outputs=data.outputs[:, : data.samples // 2])
    shorter, _ = sharpness.bound_of(HEAVE, problem, half)
    assert np.all(np.diag(shorter) > 1.5 * np.diag(whole))


def test_an_estimate_that_scatters_as_the_bound_uses_all_information() -> None:
    rng = np.random.default_rng(0)
    bound, truth = np.diag([1.0, 4.0]), np.array([10.0, -20.0])
    estimates = [
        sharpness.Estimate(truth + rng.standard_normal(2) * (1.0, 2.0), np.array([1.0, 2.0]), np.array([0.5, 1.0]))
        for _ in range(2000)
    ]
    found = sharpness.used(estimates, bound, truth)
    assert found.efficiency == pytest.approx(1.0, abs=0.1)
    assert found.stated_over_error == pytest.approx(1.0, abs=0.05)
    assert found.random_over_error == pytest.approx(0.5, abs=0.03)
    assert found.held == pytest.approx(0.95, abs=0.02)
