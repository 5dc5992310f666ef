"""Data and calls that cannot give a response are refused with their reason."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.data.record import Channel, TimeHistory
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.spectral.estimate import frequency_response
from rotorid.typing import FloatArray

RATE_HZ = 100.0
OMEGA = np.geomspace(3.0, 60.0, 12)


def record(values: FloatArray, names: tuple[str, ...] = ("u", "y")) -> TimeHistory:
    channels = tuple(Channel(name=name, unit="1") for name in names)
    return TimeHistory(values=values, channels=channels, sample_rate_hz=RATE_HZ, start_s=0.0)


def noise(samples: int = 3000, rows: int = 2, seed: int = 0) -> FloatArray:
    return np.random.default_rng(seed).standard_normal((rows, samples))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("row", [0, 1])
def test_samples_that_are_not_finite_are_counted_and_named(bad: float, row: int) -> None:
    values = noise()
    values[row, 100:103] = bad
    with pytest.raises(InsufficientDataError, match="not finite") as caught:
        frequency_response([record(values)], inputs=["u"], outputs=["y"], omega_rad_s=OMEGA, windows_s=[5.0])
    (finding,) = caught.value.findings
    assert (finding.kind, finding.where, finding.numbers["samples"]) == ("gap", "uy"[row], 3.0)


def test_a_gap_in_a_channel_that_is_not_used_does_not_matter() -> None:
    values = noise(rows=3)
    values[2] = np.nan
    history = record(values, ("u", "y", "q"))
    response = frequency_response([history], inputs=["u"], outputs=["y"], omega_rad_s=OMEGA, windows_s=[5.0])
    assert np.all(np.isfinite(response.values))


# The mean of many times 0.1 is not 0.1: without a look at the samples rounding errors would pass for an input.
@pytest.mark.parametrize("level", [0.0, 0.1, -9.81])
@pytest.mark.parametrize("row", [0, 1])
def test_a_constant_channel_is_refused(level: float, row: int) -> None:
    values = noise()
    values[row] = level
    with pytest.raises(InsufficientDataError, match="constant") as caught:
        frequency_response([record(values)], inputs=["u"], outputs=["y"], omega_rad_s=OMEGA, windows_s=[5.0])
    (finding,) = caught.value.findings
    assert (finding.kind, finding.where) == ("no_excitation", "uy"[row])


def test_an_input_may_rest_in_one_of_two_records() -> None:
    resting = noise(seed=1)
    resting[0] = 0.1
    history = [record(noise()), record(resting)]
    response = frequency_response(history, inputs=["u"], outputs=["y"], omega_rad_s=OMEGA, windows_s=[5.0])
    assert np.all(np.isfinite(response.random_error))


def test_a_record_shorter_than_a_window_is_refused() -> None:
    with pytest.raises(InsufficientDataError, match="window") as caught:
        frequency_response([record(noise(400))], inputs=["u"], outputs=["y"], omega_rad_s=OMEGA, windows_s=[5.0])
    assert [finding.kind for finding in caught.value.findings] == ["record_too_short"]


def test_one_window_alone_is_refused_because_it_explains_everything() -> None:
    # Five and a half seconds hold one window of five: coherence one and error zero, for two channels of noise.
    with pytest.raises(InsufficientDataError, match="several such windows"):
        frequency_response([record(noise(550))], inputs=["u"], outputs=["y"], omega_rad_s=OMEGA, windows_s=[5.0])
    response = frequency_response(
        [record(noise(550))], inputs=["u"], outputs=["y"], omega_rad_s=OMEGA, windows_s=[5.0, 2.5]
    )
    assert response.windows_s == pytest.approx((2.5,))


@pytest.mark.parametrize(
    ("inputs", "outputs", "instruments", "word"),
    [
        (["w"], ["y"], [], "no channel w"),
        (["u"], ["q", "y"], [], "no channel q"),
        (["u"], ["y"], ["r"], "no channel r"),
        (["u"], ["y"], ["u", "y"], "2 instruments for 1 inputs"),
        (["u"], ["y"], ["y"], "y is both an instrument and an output"),
        ([], ["y"], [], "0 inputs"),
        (["u"], [], [], "0 outputs"),
    ],
)
def test_wrong_names_are_refused_in_words(
    inputs: list[str], outputs: list[str], instruments: list[str], word: str
) -> None:
    with pytest.raises(UsageError, match=word):
        frequency_response(
            [record(noise())],
            inputs=inputs,
            outputs=outputs,
            instruments=instruments,
            omega_rad_s=OMEGA,
            windows_s=[5.0],
        )


def test_a_band_above_the_nyquist_frequency_is_refused() -> None:
    with pytest.raises(UsageError, match="Nyquist"):
        frequency_response(
            [record(noise())], inputs=["u"], outputs=["y"], omega_rad_s=np.array([10.0, 400.0]), windows_s=[5.0]
        )


def test_a_band_below_every_window_is_refused() -> None:
    with pytest.raises(InsufficientDataError, match="two periods"):
        frequency_response(
            [record(noise())], inputs=["u"], outputs=["y"], omega_rad_s=np.array([0.1, 0.2]), windows_s=[5.0]
        )


def test_choices_that_do_not_exist_are_refused_by_name() -> None:
    for choice in ("composition", "leakage"):
        with pytest.raises(UsageError, match=f"unknown {choice} 'best'"):
            frequency_response(
                [record(noise())],
                inputs=["u"],
                outputs=["y"],
                omega_rad_s=OMEGA,
                windows_s=[5.0],
                **{choice: "best"},  # type: ignore[arg-type]
            )
