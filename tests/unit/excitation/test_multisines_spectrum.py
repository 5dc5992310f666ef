"""Shares of energy and peak factors, against signals whose spectra are known; sweeps inside their bands."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from rotorid.errors import UsageError
from rotorid.excitation import energy_share, logarithmic_sweep, pilot_sweep, relative_peak_factor

HZ = 2.0 * math.pi


@given(edge=st.floats(0.1, 3.0))
@example(edge=0.3125)
@settings(max_examples=30, deadline=None)
def test_a_pulse_has_the_share_of_its_transform(edge: float) -> None:
    # Of a pulse of length L the energy below w is (1/pi) times the integral of sinc^2 to w L / 2.
    rate_hz, length_s = 200.0, 10.0
    pulse = np.ones(round(rate_hz * length_s))
    phase = np.linspace(0.0, 0.5 * edge * length_s, 20_001)
    expected = 2.0 / math.pi * np.trapezoid(np.sinc(phase / math.pi) ** 2, phase)
    # Lines stand every 2 pi / (4 L): half a line at the edge, of the largest density that this half can have.
    width = 2.0 * math.pi / (4.0 * length_s)
    half = np.clip(phase[-1] + np.linspace(-0.25, 0.25, 101) * width * length_s, 0.0, None)
    tolerance = 0.5 * width * length_s / math.pi * float(np.max(np.sinc(half / math.pi) ** 2)) + 0.01
    assert energy_share(pulse, (-1.0, edge), sample_rate_hz=rate_hz) == pytest.approx(expected, abs=tolerance)


@given(cuts=st.lists(st.floats(0.5, 300.0), min_size=2, max_size=2, unique=True), seed=st.integers(0, 99))
@settings(max_examples=30, deadline=None)
def test_shares_of_neighboring_bands_add_up(cuts: list[float], seed: int) -> None:
    values = np.random.default_rng(seed).standard_normal(501)
    low, high = sorted(cuts)
    bands = [(-1.0, low), (np.nextafter(low, 1e9), high), (np.nextafter(high, 1e9), math.pi * 100.0 + 1.0)]
    shares = [energy_share(values, band, sample_rate_hz=100.0) for band in bands if band[0] < band[1]]
    assert sum(shares) == pytest.approx(1.0, abs=1e-12)


def test_share_knows_neither_amplitude_nor_rest_around() -> None:
    values = np.random.default_rng(0).standard_normal(400)
    once = energy_share(values, (5.0, 50.0), sample_rate_hz=100.0)
    assert energy_share(-7.0 * values, (5.0, 50.0), sample_rate_hz=100.0) == pytest.approx(once, abs=1e-12)
    # Another length has other lines: one more or less at each edge of 130 inside.
    padded = energy_share(np.pad(values, 300), (5.0, 50.0), sample_rate_hz=100.0)
    assert padded == pytest.approx(once, abs=0.02)


@pytest.mark.parametrize(
    ("values", "expected"),
    [(np.sin(HZ * np.arange(64) / 64), 1.0), (np.repeat([2.0, -2.0], 5), math.sqrt(0.5))],
)
def test_peak_factor_of_a_sine_and_of_two_levels(values: np.ndarray, expected: float) -> None:
    assert relative_peak_factor(values) == pytest.approx(expected, abs=1e-12)


def test_silence_is_refused() -> None:
    with pytest.raises(UsageError, match="not all zero"):
        energy_share(np.zeros(10), (1.0, 2.0), sample_rate_hz=10.0)
    with pytest.raises(UsageError, match="rising band"):
        energy_share(np.ones(10), (2.0, 1.0), sample_rate_hz=10.0)
    with pytest.raises(UsageError, match="samples are zero"):
        relative_peak_factor(np.zeros(10))


SWEEPS = [((0.1, 8.0), 50.0), ((0.1, 8.0), 90.0), ((0.2, 20.0), 40.0), ((0.5, 5.0), 20.0)]


@pytest.mark.parametrize(("band_hz", "duration_s"), SWEEPS)
@pytest.mark.parametrize("make", [pilot_sweep, logarithmic_sweep])
def test_sweeps_stay_inside_their_bands(make: Any, band_hz: tuple[float, float], duration_s: float) -> None:
    band = (HZ * band_hz[0], HZ * band_hz[1])
    # At least four periods of the lowest frequency, as a record needs; fades of one such period at both ends.
    fade_s = 1.0 / band_hz[0]
    fades = {"fade_s": fade_s} if make is pilot_sweep else {"fade_in_s": fade_s, "fade_out_s": fade_s}
    values = make(amplitude=1.0, band_rad_s=band, duration_s=duration_s, sample_rate_hz=25.0 * band_hz[1], **fades)
    assert energy_share(values, band, sample_rate_hz=25.0 * band_hz[1]) > 0.97
    # The little outside lies next to the band: an edge is as wide as the rate of the sweep there makes it.
    wide = (0.7 * band[0], 1.1 * band[1])
    assert energy_share(values, wide, sample_rate_hz=25.0 * band_hz[1]) > 0.995


@pytest.mark.parametrize("make", [pilot_sweep, logarithmic_sweep])
def test_slow_cycles_stand_on_the_lower_edge_and_half_of_them_outside(make: Any) -> None:
    band = (HZ * 0.1, HZ * 8.0)
    slow = {"slow_cycles": 2.0, "fade_s": 0.0} if make is pilot_sweep else {"constant_s": 20.0, "fade_in_s": 0.0}
    values = make(amplitude=1.0, band_rad_s=band, duration_s=110.0, sample_rate_hz=200.0, **slow)
    inside = energy_share(values, band, sample_rate_hz=200.0)
    # Two of eleven parts of the time are a line on the edge; the sweep of 90 s alone has 2 % outside.
    assert inside == pytest.approx(1.0 - 0.5 * 2.0 / 11.0 - 0.02, abs=0.03)
    # Its lobe of two cycles ends at half the frequency.
    assert energy_share(values, (0.5 * band[0], 1.1 * band[1]), sample_rate_hz=200.0) > 0.98


@pytest.mark.parametrize("make", [pilot_sweep, logarithmic_sweep])
def test_fades_put_energy_back_into_the_band(make: Any) -> None:
    band = (HZ * 0.1, HZ * 8.0)
    common: dict[str, Any] = {"amplitude": 1.0, "band_rad_s": band, "duration_s": 60.0, "sample_rate_hz": 200.0}
    shares = []
    for fade_s in (0.0, 1.0, 5.0):
        fades = {"fade_s": fade_s} if make is pilot_sweep else {"fade_in_s": fade_s, "fade_out_s": fade_s}
        shares.append(energy_share(make(**common, **fades), band, sample_rate_hz=200.0))
    assert shares == sorted(shares)
    assert shares[0] > 0.95


def test_energy_of_the_sweeps_lies_where_their_laws_spend_their_time() -> None:
    band = (HZ * 0.1, HZ * 8.0)
    common: dict[str, Any] = {"amplitude": 1.0, "band_rad_s": band, "duration_s": 90.0, "sample_rate_hz": 200.0}
    octave = (HZ * 1.0, HZ * 2.0)
    # Logarithmic: every octave the same time. Exponential: omega - omega_min + C2 (span) grows as exp(4 t / T).
    expected = {
        logarithmic_sweep: math.log(2.0) / math.log(80.0),
        pilot_sweep: math.log((1.9 + 0.0187 * 7.9) / (0.9 + 0.0187 * 7.9)) / 4.0,
    }
    for make, share in expected.items():
        fades = {"fade_s": 0.0} if make is pilot_sweep else {"fade_in_s": 0.0, "fade_out_s": 0.0}
        found = energy_share(make(**common, **fades), octave, sample_rate_hz=200.0)  # type: ignore[operator]
        # Ripples of the stationary phase at both edges, of the order of one cycle in the octave's many.
        assert found == pytest.approx(share, rel=0.06)
