"""The demonstration flight: its plan, and that it stays a sane hover."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.data.record import AXES
from rotorid.simulation.hover_flight import Flight, fly
from rotorid.vehicles import demo_plan, s500

LONGEST_S = 8.0 * 60.0


@pytest.fixture(scope="module")
def flight() -> Flight:
    return fly(s500.vehicle(), demo_plan(rng=np.random.default_rng(1)), rng=np.random.default_rng(2))


def test_every_axis_is_swept_and_then_verified_twice() -> None:
    plan = demo_plan(rng=np.random.default_rng(0))
    flown = [(part.maneuver.axis, part.maneuver.kind) for part in plan]
    assert flown == [(axis, kind) for kind in ("sweep", "doublet") for axis in AXES for _ in range(2)]
    assert {part.maneuver.origin for part in plan} == {"declared"}
    assert plan[-1].maneuver.stop_s < LONGEST_S


def test_there_is_trim_between_the_maneuvers() -> None:
    plan = demo_plan(rng=np.random.default_rng(0))
    starts = [part.maneuver.start_s for part in plan]
    stops = [0.0, *(part.maneuver.stop_s for part in plan)]
    assert min(start - stop for start, stop in zip(starts, stops, strict=False)) >= 3.0 - 1e-9


def test_repeated_sweeps_differ_and_the_seed_decides() -> None:
    one, two = (demo_plan(rng=np.random.default_rng(3)) for _ in range(2))
    assert np.any(one[0].values != one[1].values)
    for first, second in zip(one, two, strict=True):
        np.testing.assert_array_equal(first.values, second.values)


def test_only_the_excited_axis_is_excited(flight: Flight) -> None:
    for maneuver in flight.maneuvers:
        inside = (flight.time_s > maneuver.start_s) & (flight.time_s < maneuver.stop_s)
        active = {axis for axis in AXES if flight.columns[f"{axis}_excitation"][inside].any()}
        assert active == {maneuver.axis}


def test_flight_stays_a_hover(flight: Flight) -> None:
    columns = flight.columns
    assert max(np.abs(columns[name]).max() for name in ("phi", "theta")) < 0.45
    assert max(np.abs(columns[name]).max() for name in ("u", "v", "w")) < 2.0
    assert max(np.abs(columns[f"{axis}_command"]).max() for axis in ("roll", "pitch", "yaw")) < 0.5
    assert 0.1 < columns["thrust_command"].min() < columns["thrust_command"].max() < 0.9
