"""Records of motors: checks at the border, and what they may leave out."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest

from rotorid.data.record import MotorRecord
from rotorid.errors import UsageError


def record(**changed: Any) -> MotorRecord:
    usual: dict[str, Any] = {
        "name": "hover",
        "sample_rate_hz": 50.0,
        "outputs": np.full((4, 10), 0.5),
        "rates": np.zeros((3, 10)),
        "az": np.full(10, -9.81),
        "start_s": 3.0,
    }
    return MotorRecord(**(usual | changed))


def test_times_and_voltage_have_defaults() -> None:
    one = record()
    assert (one.samples, one.duration_s) == (10, 0.2)
    np.testing.assert_allclose(one.time_s[[0, 1]], [3.0, 3.02])
    np.testing.assert_array_equal(one.strength, np.ones(10))
    assert one.w.size == 0


@pytest.mark.parametrize(
    ("name", "values"),
    [("rates", np.zeros((3, 9))), ("az", np.zeros(11)), ("w", np.zeros(5)), ("strength", np.ones(3))],
)
def test_other_lengths_are_refused(name: str, values: np.ndarray) -> None:
    with pytest.raises(UsageError, match=rf"hover has {values.shape[-1]} samples of {name} and 10 of motor outputs"):
        record(**{name: values})


@pytest.mark.parametrize("name", ["outputs", "rates", "az", "w", "strength"])
def test_samples_that_are_no_numbers_are_refused(name: str) -> None:
    shape = {"outputs": (4, 10), "rates": (3, 10)}.get(name, (10,))
    values = np.ones(shape)
    values[..., 4] = np.nan
    with pytest.raises(UsageError, match="hover contains samples that are not finite"):
        record(**{name: values})


def test_records_cannot_be_changed_and_can_be_sent() -> None:
    one = record()
    with pytest.raises(ValueError, match="read-only"):
        one.outputs[0, 0] = 1.0
    again = pickle.loads(pickle.dumps(one))
    np.testing.assert_array_equal(again.outputs, one.outputs)
    assert again.start_s == one.start_s
