"""Logs and maneuvers of one vehicle that disagree say so, and their scatter stands in the interval."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.unit.cli.commands import fly_roll_sweeps
from tests.unit.pipeline.motor_logs import ARM_M, written

from rotorid.data.record import FlightRecord
from rotorid.io.registry import read
from rotorid.pipeline.fits.scatter import Alone, disagreements
from rotorid.pipeline.identification import identify, identify_motors
from rotorid.pipeline.settings import IdentifySettings, MotorChoices
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


@pytest.fixture(scope="module")
def sweeps(tmp_path_factory: pytest.TempPathFactory) -> FlightRecord:
    """Two sweeps in roll, from 3 and from 56 s."""
    path = tmp_path_factory.mktemp("flight") / "sweeps.csv"
    fly_roll_sweeps(path)
    return read(path)


def turning_less(record: FlightRecord, factor: float, *, from_s: float, name: str) -> FlightRecord:
    """Another log, in which commands turned the vehicle less from a moment on: more of them for the same motion."""
    (topic,) = record.topics
    values = topic.values.copy()
    values[topic.row("roll_command")] /= np.where(topic.time_s >= from_s, factor, 1.0)
    source = replace(record.source, name=name, sha256=name)
    return replace(record, topics=(replace(topic, values=values),), source=source)


SETTINGS = IdentifySettings(band_rad_s=(12.0, 50.0))


def test_logs_of_responses_that_disagree_are_told_and_wider(sweeps: FlightRecord) -> None:
    heavy = turning_less(sweeps, 0.7, from_s=0.0, name="heavy.csv")
    alone, other = (identify([record], "rate.roll", settings=SETTINGS)["L_roll"] for record in (sweeps, heavy))
    both = identify([sweeps, heavy], "rate.roll", settings=SETTINGS)
    told = {one.where for one in both.findings if one.kind == "logs_disagree"}
    assert "L_roll" in told
    low, high = both["L_roll"].lower, both["L_roll"].upper
    assert low is not None
    assert high is not None
    assert low < other.value < alone.value < high


def test_repeated_maneuvers_that_disagree_are_told(sweeps: FlightRecord) -> None:
    found = identify([turning_less(sweeps, 0.7, from_s=54.0, name="payload.csv")], "rate.roll", settings=SETTINGS)
    (told,) = (one for one in found.findings if one.kind == "logs_disagree" and one.where == "L_roll")
    assert "payload.csv at 56." in told.message


def test_maneuvers_that_agree_are_not_told_apart(sweeps: FlightRecord) -> None:
    found = identify([sweeps], "rate.roll", settings=SETTINGS)
    assert "logs_disagree" not in {one.kind for one in found.findings}
