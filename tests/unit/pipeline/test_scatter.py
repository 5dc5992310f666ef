"""Logs of one vehicle that disagree say so, and their scatter stands in the interval."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.unit.pipeline.motor_logs import ARM_M, written

from rotorid.io.registry import read
from rotorid.pipeline.fits.scatter import Alone, disagreements
from rotorid.pipeline.identification import identify_motors
from rotorid.pipeline.settings import MotorChoices
from rotorid.vehicles.motor_flight import TRUTH, flights


def test_logs_with_honest_errors_rarely_disagree() -> None:
    rng = np.random.default_rng(5)
    told = 0
    for _ in range(400):
        logs = [
            Alone(record=f"{i}", values={"x": 3.0 + 0.2 * rng.standard_normal()}, stds={"x": 0.2}) for i in range(4)
        ]
        told += len(disagreements(logs))
    # One in a hundred is expected, of 400: four, and three deviations of that.
    assert told <= 4 + 3 * 2


def test_scatter_between_logs_comes_back() -> None:
    rng = np.random.default_rng(6)
    values = 3.0 + 0.5 * rng.standard_normal(200) + 0.1 * rng.standard_normal(200)
    (found,) = disagreements(
        [Alone(record=f"{i}", values={"x": value}, stds={"x": 0.1}) for i, value in enumerate(values.tolist())]
    )
    # Of 200 a standard deviation is known to 5 %.
    assert found.scatter == pytest.approx(0.5, rel=0.15)


@pytest.mark.slow
def test_two_flights_of_vehicles_that_differ_are_told_and_wider(tmp_path: Path) -> None:
    """The second one yaws half as much by the same motors."""
    first, second = flights(2, seed=31, duration_s=12.0)
    rates = second.rates.copy()
    rates[2] *= 0.5
    choices = MotorChoices(known={"m": TRUTH["m"]}, layout="quad.x", arm_m=ARM_M)
    logs = [read(written(first, tmp_path / "a.csv")), read(written(replace(second, rates=rates), tmp_path / "b.csv"))]
    apart = identify_motors(logs, choices)
    told = {one.where for one in apart.findings if one.kind == "logs_disagree"}
    # Yaw alone: inertia and thrust are those of one vehicle, and its damping too.
    assert told == {"kappa_per_I_zz"}
    low, high = apart["kappa_per_I_zz"].lower, apart["kappa_per_I_zz"].upper
    assert low is not None
    assert high is not None
    assert low < 0.5 * TRUTH["kappa_per_I_zz"] * 1.1
    assert high > TRUTH["kappa_per_I_zz"] * 0.9
