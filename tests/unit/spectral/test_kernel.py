"""The fast transform against the sum that defines it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotorid.data.record import Channel, TimeHistory
from rotorid.spectral.kernel import BlockGrid, BlockWindow, band_basis, compress, transform
from rotorid.spectral.spectra import spectral_matrices
from rotorid.spectral.windows import HALF_SINE, HANN, Taper, WindowPlan, given_windows
from rotorid.typing import ComplexArray, FloatArray

BAR = 1e-11
"""The basis is cut at 1e-13 of its largest singular value; some hundred rounding errors of 1e-16 add to that."""


def direct_sum(
    values: FloatArray, omega_rad_s: FloatArray, taper: Taper, *, length: int, hop: int, usable: int, rate_hz: float
) -> ComplexArray:
    """The definition, one window after the other: shape ``(positions, channels, f)``."""
    sample = np.arange(length)
    line = np.exp(-1j * sample[:, None] * omega_rad_s / rate_hz) * taper.samples(length)[:, None]
    starts = range(0, usable - length + 1, hop)
    return np.stack([values[:, start : start + length] @ line for start in starts])


@settings(max_examples=60, deadline=None)
@given(
    taper=st.sampled_from([HALF_SINE, HANN, HALF_SINE.slope, HANN.slope]),
    rate_hz=st.sampled_from([37.0, 100.0, 250.0]),
    samples_per_block=st.integers(1, 60),
    blocks=st.integers(1, 13),
    hop=st.integers(1, 6),
    surplus=st.integers(0, 75),
    top=st.floats(0.05, 0.8),
    seed=st.integers(0, 2**32 - 1),
)
def test_equals_the_direct_sum(
    taper: Taper,
    rate_hz: float,
    samples_per_block: int,
    blocks: int,
    hop: int,
    surplus: int,
    top: float,
    seed: int,
) -> None:
    rng = np.random.default_rng(seed)
    grid = BlockGrid(samples_per_block=samples_per_block, sample_rate_hz=rate_hz)
    window = BlockWindow(blocks=blocks, hop=hop)
    length = blocks * samples_per_block
    values = rng.standard_normal((2, length + 2 * hop * samples_per_block + surplus))
    omega = np.sort(rng.uniform(0.01, 1.0, 7)) * top * np.pi * rate_hz
    basis = band_basis(grid, omega[-1] + 2.0 * np.pi * rate_hz / length)
    fast = transform(compress(values, grid, basis), window, omega, grid=grid, basis=basis, taper=taper)
    usable = values.shape[1] // samples_per_block * samples_per_block
    exact = direct_sum(values, omega, taper, length=length, hop=hop * samples_per_block, usable=usable, rate_hz=rate_hz)
    assert fast.shape == exact.shape
    # Relative to what a sum of that many random samples can be, not to a value that happens to be near zero.
    size = np.sqrt(np.sum(values**2, axis=1).max())
    assert np.abs(fast - exact).max() <= BAR * size


@pytest.mark.parametrize("taper", [HALF_SINE, HANN], ids=lambda taper: taper.name)
@pytest.mark.parametrize("rate_hz", [50.0, 200.0, 1000.0])
def test_flight_sized_windows_are_exact_at_the_top_of_the_band(taper: Taper, rate_hz: float) -> None:
    rng = np.random.default_rng(5)
    values = rng.standard_normal((3, int(30 * rate_hz) + 17))
    omega = np.geomspace(2.0, 60.0, 25)
    grid = BlockGrid.for_windows([10.0, 6.3], 0.8, rate_hz)
    window = grid.window(10.0, 0.8)
    basis = band_basis(grid, omega[-1] + 2.0 * np.pi / 6.3)
    fast = transform(compress(values, grid, basis), window, omega, grid=grid, basis=basis, taper=taper)
    usable = values.shape[1] // grid.samples_per_block * grid.samples_per_block
    exact = direct_sum(
        values,
        omega,
        taper,
        length=window.blocks * grid.samples_per_block,
        hop=window.hop * grid.samples_per_block,
        usable=usable,
        rate_hz=rate_hz,
    )
    assert np.abs(fast - exact).max() <= 1e-12 * np.abs(exact).max()


def test_basis_is_orthonormal_and_knows_its_parity() -> None:
    basis = band_basis(BlockGrid(samples_per_block=41, sample_rate_hz=200.0), 60.0)
    functions = basis.functions
    assert np.allclose(functions.T @ functions, np.eye(functions.shape[1]), atol=1e-12)
    assert np.allclose(functions[::-1], functions * basis.parity, atol=1e-12)


def test_rank_follows_the_band_not_the_sample_rate() -> None:
    ranks = {
        rate: band_basis(BlockGrid(samples_per_block=rate, sample_rate_hz=float(rate)), 60.0).functions.shape[1]
        for rate in (200, 1000)
    }
    assert abs(ranks[200] - ranks[1000]) <= 1
    # Degrees of freedom of a band of 60 rad/s on one second, and a tail that grows with the digits asked for.
    assert 60.0 / np.pi < ranks[1000] < 60.0 / np.pi + 30


def test_no_window_straddles_two_records() -> None:
    rng = np.random.default_rng(3)
    rate_hz, omega = 50.0, np.geomspace(3.0, 40.0, 9)
    channels = (Channel(name="u", unit="1"), Channel(name="y", unit="1"))
    records = [
        TimeHistory(values=rng.standard_normal((2, n)), channels=channels, sample_rate_hz=rate_hz, start_s=0.0)
        for n in (997, 212, 661)
    ]
    (matrix,), grid = spectral_matrices(records, omega, windows_s=[5.0], taper=HALF_SINE)
    length, hop = matrix.window.blocks * grid.samples_per_block, matrix.window.hop * grid.samples_per_block
    parts, starts, first_block = [], [], 0
    for record in records:
        blocks = record.values.shape[1] // grid.samples_per_block
        if record.values.shape[1] >= length:
            centered = record.values - record.values.mean(axis=1, keepdims=True)
            usable = blocks * grid.samples_per_block
            parts.append(direct_sum(centered, omega, HALF_SINE, length=length, hop=hop, usable=usable, rate_hz=rate_hz))
            starts += [first_block + k * matrix.window.hop for k in range(len(parts[-1]))]
        first_block += blocks
    exact = np.concatenate(parts) * np.sqrt(2.0 / (rate_hz * length * HALF_SINE.mean_square))
    assert matrix.transforms.shape == exact.shape
    assert np.abs(matrix.transforms - exact).max() <= 1e-12 * np.abs(exact).max()
    assert matrix.starts.tolist() == starts
    assert matrix.averages == pytest.approx((997 // 50 + 661 // 50) * 50 / length)


def test_windows_that_were_given_are_kept_and_those_by_rule_are_whole_hops_of_the_shortest() -> None:
    asked = (71.0, 60.0, 40.0)
    for plan, expected in ((given_windows(asked, 150.0), asked), (WindowPlan(lengths_s=asked), (72.0, 64.0, 40.0))):
        grid = BlockGrid.for_windows(plan.lengths_s, 0.8, 100.0, within=plan.within)
        windows = [grid.window(length, 0.8) for length in plan.lengths_s]
        assert [window.blocks * grid.block_s for window in windows] == pytest.approx(expected, rel=0.005)
        assert [window.hop / window.blocks for window in windows] == pytest.approx([0.2] * 3, abs=0.05)
