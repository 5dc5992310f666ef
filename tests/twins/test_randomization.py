"""Vehicles drawn from the covariance track in MuJoCo as the true one does: the study, its figure, its controller."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from benchmarks.randomization import ERRORS, LIBRARY, loop_of, one, reference, table, tracking, truth_of

from rotorid.exports import export
from rotorid.models import library_layout
from rotorid.vehicles import aircraft

ROWS = [
    {"vehicle": 0, "error": name, "true": 20.0, "covariance": [18.0, 20.0, 22.0], "20 %": [21.0, 25.0, 41.0]}
    for name in ERRORS
]


@pytest.mark.parametrize("time_s", [0.4, 1.2, 2.5, 3.9])
def test_velocity_and_acceleration_are_those_of_the_position(time_s: float) -> None:
    step_s = 1e-5
    (before, early, _), (after, late, _) = reference(time_s - step_s), reference(time_s + step_s)
    _, velocity, acceleration = reference(time_s)
    np.testing.assert_allclose((after - before) / (2.0 * step_s), velocity, atol=1e-6)
    np.testing.assert_allclose((late - early) / (2.0 * step_s), acceleration, atol=1e-5)


def test_the_controller_flies_the_vehicle_that_it_is_designed_for(tmp_path: Path) -> None:
    pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    truth = truth_of(aircraft("px4_quad"))
    assert truth["m"] == LIBRARY["m"]
    errors = tracking(loop_of(export([], "mujoco", given=truth, layout=library_layout("quad.x")), tmp_path))
    assert 5.0 < errors["position"] < 40.0
    assert 5.0 < errors["tilt"] < 30.0


def test_the_table_counts_what_is_inside() -> None:
    lines = table([*ROWS, {"vehicle": 1, "refused": "the log is too short"}])
    assert "| position | 20.0/20.0/20.0 cm | covariance | 1 of 1 | 20 % | 20 % |" in lines
    assert "| tilt | 20.0/20.0/20.0 deg | 20 % | 0 of 1 | 100 % | 100 % |" in lines
    assert lines[-1] == "vehicle 1 refused: the log is too short"


@pytest.mark.slow
def test_the_true_error_is_within_the_range_of_the_draws() -> None:
    pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    for row in one((0,)):
        low, _, high = row["covariance"]
        assert low <= row["true"] <= high
        assert high - low < 0.5 * (row["20 %"][2] - row["20 %"][0])
