"""Several inputs separated, with and without instruments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from rotorid.data.record import Channel, TimeHistory
from rotorid.errors import InsufficientDataError
from rotorid.spectral.conditioning import (
    Conditioned,
    ConditionedResponse,
    condition,
    conditioned_response,
    instrument_coherence,
    output_spectra,
)
from rotorid.spectral.estimate import frequency_response
from rotorid.spectral.spectra import SpectralMatrix, spectral_matrices
from rotorid.typing import FloatArray

RATE_HZ = 100.0
OMEGA = np.geomspace(2.0, 80.0, 40)
SAMPLES = 9000


def record(signals: Mapping[str, FloatArray]) -> TimeHistory:
    channels = tuple(Channel(name=name, unit="1") for name in signals)
    return TimeHistory(values=np.stack(list(signals.values())), channels=channels, sample_rate_hz=RATE_HZ, start_s=0.0)


def spectra(signals: Mapping[str, FloatArray], window_s: float = 8.0) -> SpectralMatrix:
    (matrix,), _ = spectral_matrices([record(signals)], OMEGA, windows_s=[window_s])
    return matrix


@pytest.fixture(scope="module")
def matrix() -> SpectralMatrix:
    rng = np.random.default_rng(0)
    r, u, w, v = rng.standard_normal((4, SAMPLES))
    u = 0.6 * r + 0.5 * u
    y = np.convolve(u, [0.5, 0.3, 0.2])[:SAMPLES] + 0.4 * v
    return spectra({"r": r, "u": u, "w": w + 0.5 * u, "y": y})


R, U, W, Y = range(4)


def response(
    matrix: SpectralMatrix, instruments: Sequence[int], inputs: Sequence[int], output: int
) -> tuple[ConditionedResponse, Conditioned]:
    separated = conditioned_response(matrix, instruments=instruments, inputs=inputs)
    return separated, condition(separated, output_spectra(matrix, output))


def test_direct_single_input_is_the_ratio_of_spectra(matrix: SpectralMatrix) -> None:
    separated, part = response(matrix, [U], [U], Y)
    auto, cross, out = matrix.values[:, U, U].real, matrix.values[:, U, Y], matrix.values[:, Y, Y].real
    coherence = np.abs(cross) ** 2 / (auto * out)
    assert np.allclose(part.response[0], cross / auto, rtol=1e-12)
    assert np.allclose(separated.input_power[0], auto, rtol=1e-12)
    assert np.allclose(instrument_coherence(separated, output_spectra(matrix, Y))[0], coherence, rtol=1e-12)
    # The difference of nearly equal powers loses as many digits as the coherence is near one.
    assert np.allclose(part.noise, out * (1.0 - coherence), rtol=1e-9)


def test_joint_single_input_is_the_ratio_of_instrument_spectra(matrix: SpectralMatrix) -> None:
    separated, part = response(matrix, [R], [U], Y)
    s = matrix.values
    assert np.allclose(part.response[0], s[:, R, Y] / s[:, R, U], rtol=1e-12)
    assert np.allclose(separated.input_power[0], np.abs(s[:, R, U]) ** 2 / s[:, R, R].real, rtol=1e-12)
    expected = np.abs(s[:, R, Y]) ** 2 / (s[:, R, R] * s[:, Y, Y]).real
    assert np.allclose(instrument_coherence(separated, output_spectra(matrix, Y))[0], expected, rtol=1e-12)


def test_conditioned_power_is_what_the_other_input_does_not_explain(matrix: SpectralMatrix) -> None:
    separated, _ = response(matrix, [U, W], [U, W], Y)
    s = matrix.values
    between = np.abs(s[:, U, W]) ** 2 / (s[:, U, U] * s[:, W, W]).real
    assert np.allclose(separated.input_power[0], s[:, U, U].real * (1.0 - between), rtol=1e-10)
    assert np.allclose(separated.input_power[1], s[:, W, W].real * (1.0 - between), rtol=1e-10)


def test_input_noise_is_what_the_instruments_do_not_explain(matrix: SpectralMatrix) -> None:
    separated, _ = response(matrix, [R], [U], Y)
    s = matrix.values
    seen = np.abs(s[:, R, U]) ** 2 / (s[:, R, R] * s[:, U, U]).real
    assert np.allclose(separated.input_noise[0], s[:, U, U].real * (1.0 - seen), rtol=1e-9)
    direct, _ = response(matrix, [U, W], [U, W], Y)
    assert np.abs(direct.input_noise / s[:, [U, W], [U, W]].real.T).max() < 1e-12


def test_residual_of_the_inputs_is_zero_for_a_direct_estimate_and_that_of_feedback_for_a_joint_one(
    matrix: SpectralMatrix,
) -> None:
    _, part = response(matrix, [U, W], [U, W], Y)
    power = np.sqrt(matrix.values[:, [U, W], [U, W]].real.T * part.noise)
    assert np.abs(part.input_residual / power).max() < 1e-9
    _, part = response(matrix, [R], [U], Y)
    residual = matrix.transforms[:, Y] - part.response[0] * matrix.transforms[:, U]
    expected = np.mean(matrix.transforms[:, U].conj() * residual, axis=0)
    assert np.abs(part.input_residual[0] - expected).max() < 1e-12 * np.abs(expected).max()


def test_noise_is_the_spectrum_of_the_residual(matrix: SpectralMatrix) -> None:
    _, part = response(matrix, [R, W], [U, W], Y)
    explained = np.einsum("uf,kuf->kf", part.response, matrix.transforms[:, [U, W]])
    residual = matrix.transforms[:, Y] - explained
    assert np.allclose(part.noise, np.mean(np.abs(residual) ** 2, axis=0), rtol=1e-9)


def test_correlated_inputs_are_separated_exactly_without_noise() -> None:
    a, b = np.random.default_rng(1).standard_normal((2, SAMPLES))
    b = 0.8 * a + 0.6 * b  # coherence 0.64 between the inputs
    _, part = response(spectra({"a": a, "b": b, "y": 2.0 * a - 3.0 * b}), [0, 1], [0, 1], 2)
    # Conditioning multiplies rounding by the spread of the eigenvalues of the inputs, here some ten.
    assert np.abs(part.response[0] - 2.0).max() <= 1e-12
    assert np.abs(part.response[1] + 3.0).max() <= 1e-12


def test_composite_of_correlated_inputs_is_exact_without_noise() -> None:
    a, b = np.random.default_rng(2).standard_normal((2, SAMPLES))
    b = 0.8 * a + 0.6 * b
    signals = {"a": a, "b": b, "y": 2.0 * a - 3.0 * b, "z": a + b}
    response = frequency_response(
        [record(signals)], inputs=["a", "b"], outputs=["y", "z"], omega_rad_s=OMEGA, windows_s=[16.0, 8.0, 4.0]
    )
    expected = np.array([[2.0, -3.0], [1.0, 1.0]])[:, :, None]
    assert np.abs(response.values - expected).max() <= 1e-9
    assert response.coherence.min() >= 1.0 - 1e-9
    assert response.random_error.max() <= 1e-5


@pytest.mark.parametrize("factor", [1.0, -0.3, 1e6])
def test_proportional_inputs_are_refused(factor: float) -> None:
    a, v = np.random.default_rng(3).standard_normal((2, SAMPLES))
    with pytest.raises(InsufficientDataError, match="proportional") as caught:
        frequency_response(
            [record({"a": a, "b": factor * a, "y": a + v})],
            inputs=["a", "b"],
            outputs=["y"],
            omega_rad_s=OMEGA,
            windows_s=[8.0],
        )
    (finding,) = caught.value.findings
    assert (finding.kind, finding.severity, finding.where) == ("correlated_inputs", "error", "a, b")
    assert finding.numbers["frequencies"] == OMEGA[np.pi / 2.0 <= OMEGA].size


def test_one_instrument_for_two_inputs_is_refused() -> None:
    a, b, v = np.random.default_rng(4).standard_normal((3, SAMPLES))
    signals = {"r": a, "s": 2.0 * a, "a": a + 0.1 * b, "b": b, "y": a + b + v}
    with pytest.raises(InsufficientDataError) as caught:
        frequency_response(
            [record(signals)],
            inputs=["a", "b"],
            outputs=["y"],
            instruments=["r", "s"],
            omega_rad_s=OMEGA,
            windows_s=[8.0],
        )
    assert [finding.kind for finding in caught.value.findings] == ["correlated_inputs"]


def test_inputs_of_very_different_size_are_not_mistaken_for_correlated() -> None:
    a, b = np.random.default_rng(5).standard_normal((2, SAMPLES))
    _, part = response(spectra({"a": a, "b": 1e-7 * b, "y": a + b}), [0, 1], [0, 1], 2)
    assert np.abs(part.response[1] / 1e7 - 1.0).max() <= 1e-9
