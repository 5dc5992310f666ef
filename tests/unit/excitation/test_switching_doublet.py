"""Doublets and multisteps: widths, signs, balance."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotorid.errors import UsageError
from rotorid.excitation.switching import balanced_three_two_one_one, doublet, multistep, three_two_one_one, two_one_one


def test_doublet_is_two_opposite_steps_between_trims() -> None:
    values = doublet(amplitude=-0.2, pulse_s=0.5, sample_rate_hz=100.0, trim_s=1.0)
    np.testing.assert_array_equal(values, np.repeat([0.0, -0.2, 0.2, 0.0], [100, 50, 50, 100]))


def test_three_two_one_one_alternates() -> None:
    values = three_two_one_one(amplitude=1.0, unit_s=0.1, sample_rate_hz=50.0, trim_s=0.2)
    np.testing.assert_array_equal(values, np.repeat([0.0, 1.0, -1.0, 1.0, -1.0, 0.0], [10, 15, 10, 5, 5, 10]))


def test_two_one_one_alternates() -> None:
    values = two_one_one(amplitude=-0.5, unit_s=0.1, sample_rate_hz=50.0, trim_s=0.2)
    np.testing.assert_array_equal(values, np.repeat([0.0, -0.5, 0.5, -0.5, 0.0], [10, 10, 5, 5, 10]))


def test_balanced_steps_leave_no_area_and_keep_their_amplitude() -> None:
    values = balanced_three_two_one_one(amplitude=0.3, unit_s=0.1, sample_rate_hz=50.0, trim_s=0.2)
    assert abs(values.sum()) < 1e-12
    assert np.abs(values).max() == 0.3
    plain = three_two_one_one(amplitude=0.3, unit_s=0.1, sample_rate_hz=50.0, trim_s=0.2)
    np.testing.assert_array_equal(np.sign(values), np.sign(plain))


def test_heights_must_be_as_many_as_steps() -> None:
    with pytest.raises(UsageError, match="a height for each"):
        multistep((1, 1), amplitude=1.0, unit_s=1.0, sample_rate_hz=10.0, heights=(1.0,))


@given(widths=st.lists(st.floats(1.0, 5.0), min_size=1, max_size=8), unit=st.floats(0.05, 1.0))
def test_rounding_does_not_add_up(widths: list[float], unit: float) -> None:
    values = multistep(widths, amplitude=1.0, unit_s=unit, sample_rate_hz=100.0, trim_s=0.0)
    assert abs(values.size - sum(widths) * unit * 100.0) <= 0.5 + 1e-9
    assert set(np.abs(values)) == {1.0}
    assert np.count_nonzero(np.diff(values)) == len(widths) - 1


@pytest.mark.parametrize("widths", [(), (1.0, 0.0), (1.0, 0.001)])
def test_steps_shorter_than_a_sample_are_refused(widths: tuple[float, ...]) -> None:
    with pytest.raises(UsageError, match="shorter than a sample"):
        multistep(widths, amplitude=1.0, unit_s=0.1, sample_rate_hz=100.0)
