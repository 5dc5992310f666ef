"""The covariance under colored residuals."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import matmul_toeplitz
from scipy.signal import lfilter

from rotorid.errors import InsufficientDataError
from rotorid.fitting.problem import Part
from rotorid.typing import FloatArray
from rotorid.uncertainty.colored import ColoredNoise, autoregression, colored_covariance, residual_processes

SAMPLES, MEMORY, SEEDS = 1500, 0.9, 40


def regression(seed: int, slopes: FloatArray, *, memory: float = MEMORY) -> tuple[Part, float]:
    """Residuals of a regression of colored noise on one regressor and a shift, and the estimate itself."""
    rng = np.random.default_rng(seed)
    noise = lfilter([1.0], [1.0, -memory], rng.standard_normal(SAMPLES + 200))[200:]
    unknown = np.full((SAMPLES, 1), SAMPLES**-0.5)
    column = slopes - unknown @ (unknown.T @ slopes)
    estimate = float((column.T @ noise)[0] / (column.T @ column)[0, 0])
    left = noise - unknown[:, 0] * (unknown[:, 0] @ noise) - column[:, 0] * estimate
    return Part(residual=left[:, None], slopes=column[:, None, :], unknown=unknown[:, None, :]), estimate


@pytest.mark.slow
@pytest.mark.parametrize("memory", [0.0, 0.9])
def test_stated_errors_are_the_scatter_of_many_estimates(memory: float) -> None:
    slopes = np.repeat(np.sign(np.random.default_rng(99).standard_normal((SAMPLES // 50, 1))), 50, axis=0)
    runs = [regression(seed, slopes, memory=memory) for seed in range(SEEDS)]
    scatter = np.std([estimate for _, estimate in runs])
    stated = np.sqrt([colored_covariance([part]).corrected[0, 0] for part, _ in runs])
    # Three deviations of a standard deviation of so many estimates.
    assert np.median(stated) == pytest.approx(scatter, rel=3.0 / np.sqrt(2.0 * SEEDS))
    if memory:
        white = np.sqrt(colored_covariance([runs[0][0]]).white[0, 0])
        assert white < 0.5 * scatter


def test_what_the_fit_took_from_the_residuals_is_given_back() -> None:
    """Six slow waves take the slowest part of a short record's errors with them: what is left states two thirds."""
    samples, waves, seeds = 400, 3, 8
    time = np.arange(samples) + 0.5
    turns = [2.0 * np.pi * wave * time / samples for wave in range(1, waves + 1)]
    columns = np.stack([wave(turn) for turn in turns for wave in (np.sin, np.cos)], axis=1) * np.sqrt(2.0 / samples)
    unknown = np.full((samples, 1), samples**-0.5)
    taken = np.hstack([unknown, columns])
    stated = []
    for seed in range(seeds):
        noise = lfilter([1.0], [1.0, -MEMORY], np.random.default_rng(seed).standard_normal(samples + 200))[200:]
        left = noise - taken @ (taken.T @ noise)
        part = Part(residual=left[:, None], slopes=columns[:, None, :], unknown=unknown[:, None, :])
        stated.append(colored_covariance([part]).corrected.diagonal())
    lags = np.abs(np.subtract.outer(np.arange(samples), np.arange(samples)))
    true = np.diag(columns.T @ MEMORY**lags @ columns) / (1.0 - MEMORY**2)
    # The power of a first order at rest, known from so many records, scatters by some 12 %, its root by 6 %.
    assert np.sqrt(np.mean(np.mean(stated, axis=0) / true)) == pytest.approx(1.0, abs=0.15)


def test_rounds_that_rise_and_fall_are_taken() -> None:
    """Fifteen records of three seconds, shifts and slopes of two outputs unknown: residuals alone state 72 %."""
    samples, records, outputs, pole = 75, 15, 2, 0.99
    time = np.linspace(-1.0, 1.0, samples)
    slow = np.linalg.qr(np.stack([np.ones(samples), time], axis=1))[0]
    unknown = np.kron(slow, np.eye(outputs))
    lags = pole ** np.abs(np.subtract.outer(np.arange(samples), np.arange(samples))) / (1.0 - pole**2)
    covariance, ratios = np.kron(lags, np.eye(outputs)), []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        errors = lfilter([1.0], [1.0, -pole], rng.normal(size=(records, outputs, 675)))[..., 600:]
        columns = lfilter([1.0], [1.0, -0.95], rng.normal(size=(records, outputs, 2, 275)))[..., 200:]
        e = errors.transpose(0, 2, 1).reshape(records, -1)
        S = columns.transpose(0, 3, 1, 2).reshape(records, -1, 2)
        S = S - unknown @ (unknown.T @ S)
        inverse = np.linalg.inv(np.einsum("rna,rnb->ab", S, S))
        found = inverse @ np.einsum("rna,rn->a", S, e)
        left = e - (e @ unknown) @ unknown.T - S @ found
        basis = unknown.reshape(samples, outputs, -1)
        parts = [
            Part(one.reshape(samples, outputs), slopes.reshape(samples, outputs, 2), basis, 25.0)
            for one, slopes in zip(left, S, strict=True)
        ]
        middle = np.einsum("rna,nm,rmb->ab", S, covariance, S)
        ratios.append(colored_covariance(parts).corrected.diagonal() / (inverse @ middle @ inverse).diagonal())
    assert 0.8 < np.sqrt(np.mean(ratios)) < 1.1


@pytest.mark.parametrize("seed", range(4))
def test_nothing_is_given_back_where_that_has_no_end(seed: int) -> None:
    """Slow columns of three outputs, and errors slower still: rounds of giving back jump from a tenth to five times."""
    rng = np.random.default_rng(seed)
    memory = np.convolve([1.0, -0.995], [1.0, -1.96, 0.9604])
    errors = lfilter([1.0], memory, rng.normal(size=(3, 1000))).T
    slopes = lfilter([1.0], [1.0, -0.97], rng.normal(size=(6, 3, 1000))).transpose(2, 1, 0)
    left = errors - slopes @ np.linalg.lstsq(slopes.reshape(-1, 6), errors.ravel(), rcond=None)[0]
    part = Part(left, slopes, np.zeros((1000, 3, 0)), 50.0)
    toeplitz = np.zeros(1000)
    impulse = lfilter([1.0], memory, np.r_[1.0, np.zeros(9999)])
    for lag in range(1000):
        toeplitz[lag] = impulse[lag:] @ impulse[: impulse.size - lag]
    middle = sum(slopes[:, y].T @ matmul_toeplitz(toeplitz, slopes[:, y]) for y in range(3))
    inverse = np.linalg.inv(np.einsum("nya,nyb->ab", slopes, slopes))
    exact = np.sqrt((inverse @ middle @ inverse).diagonal())
    assert np.all(np.abs(np.log2(np.sqrt(colored_covariance([part]).corrected.diagonal()) / exact)) < 1.5)


def test_records_add_up() -> None:
    slopes = np.repeat(np.sign(np.random.default_rng(9).standard_normal((SAMPLES // 50, 1))), 50, axis=0)
    part, _ = regression(0, slopes)
    one, two = colored_covariance([part]), colored_covariance([part, part])
    assert two.corrected[0, 0] == pytest.approx(one.corrected[0, 0] / 2.0, rel=0.05)


LASTING_S = 0.1
RECORDS = ((50.0, 300.0, 0.1), (200.0, 60.0, 1.0))
"""Sample rate in Hz, seconds, and how far the parameter moves the output: most is told by the faster record."""


def at_two_rates(seed: int) -> tuple[list[Part], float]:
    """What one error that lasts 0.1 s leaves of two records of different rate, and the true variance of the estimate.

    The parameter turns the sign of the output every two seconds, which takes nothing noticeable from the residuals.
    """
    rng, parts, middle, information = np.random.default_rng(seed), [], 0.0, 0.0
    for rate_hz, long_s, size in RECORDS:
        memory, samples = np.exp(-1.0 / (LASTING_S * rate_hz)), round(long_s * rate_hz)
        white = np.sqrt(1.0 - memory**2) * rng.standard_normal(samples + 1000)
        noise = lfilter([1.0], [1.0, -memory], white)[1000:]
        slopes = size * np.repeat((-1.0) ** np.arange(long_s / 2.0), 2 * round(rate_hz))
        unknown = np.zeros((samples, 1, 0))
        parts.append(Part(noise[:, None], slopes[:, None, None], unknown, rate_hz))
        middle += slopes @ matmul_toeplitz(memory ** np.arange(samples), slopes)  # type: ignore[assignment]
        information += slopes @ slopes  # type: ignore[assignment]
    return parts, middle / information**2


def test_an_error_that_lasts_as_long_lasts_more_samples_of_a_faster_record() -> None:
    found = [at_two_rates(seed) for seed in range(6)]
    true = found[0][1]
    stated = np.mean([colored_covariance(parts).corrected[0, 0] for parts, _ in found])
    # An autoregression in common states little more than half of the variance.
    assert stated == pytest.approx(true, rel=0.1)
    slopes = [part.slopes[:, 0, 0] for part in found[0][0]]
    noise = ColoredNoise.of(found[0][0])
    drawn = [noise.draw(np.random.default_rng(seed)) for seed in range(400)]
    information = sum(s @ s for s in slopes)
    estimates = [sum(s @ e[:, 0] for s, e in zip(slopes, one, strict=True)) / information for one in drawn]
    stated_here = colored_covariance(found[0][0]).corrected[0, 0]
    # Four deviations of a variance of so many draws.
    assert np.var(estimates) == pytest.approx(stated_here, rel=4.0 * np.sqrt(2.0 / len(drawn)))


def test_records_of_about_one_rate_share_what_is_known_of_their_errors() -> None:
    """Clocks that differ by a thousandth make no two kinds of errors of one."""
    parts = [regression(seed, np.ones((SAMPLES, 1)) * np.sin(np.arange(SAMPLES))[:, None])[0] for seed in range(3)]
    alike = [part._replace(sample_rate_hz=rate) for part, rate in zip(parts, (249.9, 100.0, 250.1), strict=True)]
    first, slower, last = residual_processes(alike)
    assert first is last
    assert slower is not first


def test_a_vector_process_is_found() -> None:
    rng = np.random.default_rng(1)
    A = np.array([[0.7, 0.2], [0.0, 0.5]])
    e = np.zeros((6000, 2))
    for k in range(1, len(e)):
        e[k] = A @ e[k - 1] + rng.standard_normal(2) * [1.0, 0.3]
    process = autoregression([e])
    assert np.allclose(process.coefficients[0], A, atol=0.1)
    assert np.allclose(process.noise, np.diag([1.0, 0.09]), atol=0.05)


def test_a_parameter_without_effect_is_refused() -> None:
    part, _ = regression(0, np.ones((SAMPLES, 1)))
    dead = Part(part.residual, np.zeros((SAMPLES, 1, 1)), part.unknown)
    with pytest.raises(InsufficientDataError, match="no effect"):
        colored_covariance([dead])
