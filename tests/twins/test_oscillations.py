"""Loops that swing by themselves, in simulated flights with known truth: found at any rate, never where nothing swings.

The truth is a second flight in still air without noise (``oscillating_flights``). The study goes over all flights; what
runs every day takes the same way with a few of them, and through the autopilots' own logs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.twins.oscillating_flights import (
    AXES,
    Case,
    Score,
    beyond_the_limit,
    calm_flights,
    fly,
    frequency_hz,
    hard_flights,
    limit_cycles,
    logged_rates_hz,
    record_of,
    score,
    slow_swings,
    swings,
    with_gains_of,
)

import rotorid
from rotorid.data.flight_plan import SimulatedFlight
from rotorid.flights.oscillations import reviewed_oscillations
from rotorid.io.ardupilot.writer import write_ardupilot
from rotorid.io.betaflight.writer import write_betaflight
from rotorid.io.px4.writer import write_px4
from rotorid.signal.oscillations import check_oscillations

JITTERS = (0.0, 0.3)


def scores(cases: Sequence[Case]) -> list[tuple[Case, float, float, Score]]:
    return [
        (case, log_hz, jitter, score(case, log_hz=log_hz, jitter=jitter))
        for case in cases
        for log_hz in logged_rates_hz(case)
        for jitter in JITTERS
    ]


def shares(found: Sequence[tuple[Case, float, float, Score]]) -> tuple[float, float]:
    """Share of records with the right axes, and of the due frequencies that are within 5 %."""
    right = float(np.mean([one.right for *_, one in found]))
    due = [one.frequency_right for *_, one in found if one.frequency_due]
    return right, float(np.mean(due)) if due else 1.0


FEW = [*(limit_cycles()[place] for place in (1, 16, 21, 29, 38)), slow_swings()[4], slow_swings()[18]]


@pytest.mark.parametrize("case", FEW, ids=lambda case: f"{case.vehicle}-{case.seed}")
def test_what_swings_is_found_at_every_rate(case: Case) -> None:
    assert swings(case)
    for log_hz in logged_rates_hz(case):
        found = score(case, log_hz=log_hz)
        assert (log_hz, found.right, found.frequency_right) == (log_hz, True, True)


@pytest.mark.parametrize("case", [*calm_flights()[7::16], *hard_flights()[2::6]], ids=lambda c: f"{c.vehicle}-{c.seed}")
def test_what_does_not_swing_is_not_named(case: Case) -> None:
    assert swings(case) == ()
    for log_hz in logged_rates_hz(case):
        check = check_oscillations(record_of(case, log_hz=log_hz))
        assert check.found == ()
        # Full sticks in a slow log cannot be told from a loop that swings.
        assert log_hz < 25.0 or check.calm == AXES


WRITERS: dict[str, tuple[Case, str, Callable[[Path, SimulatedFlight], None], float | None]] = {
    "ardupilot at its usual 10 Hz": (
        limit_cycles()[16],
        "flight.BIN",
        lambda path, flight: write_ardupilot(path, flight, rates_hz={"RATE": 10.0}),
        None,
    ),
    "ardupilot fast": (
        limit_cycles()[16],
        "fast.BIN",
        lambda path, flight: write_ardupilot(path, flight, rates_hz={"RATE": 400.0, "RCOU": 10.0}),
        23.8,
    ),
    "px4": (limit_cycles()[1], "flight.ulg", write_px4, 17.4),
    "betaflight": (limit_cycles()[32], "flight.bbl", write_betaflight, 11.8),
}


@pytest.mark.parametrize("name", WRITERS)
def test_logs_of_the_autopilots_say_it_too(name: str, tmp_path: Path) -> None:
    case, file, write, known_hz = WRITERS[name]
    write(tmp_path / file, fly(case))
    found = check_oscillations(rotorid.read(tmp_path / file)).found
    assert tuple(one.axis for one in found) == case.axes
    for one in found:
        assert one.frequency_hz == (None if known_hz is None else pytest.approx(known_hz, rel=0.05))


def stopped(case: Case, log_hz: float) -> tuple[str, ...]:
    """The axes of a case that still swing in a flight with the gains that its review proposes."""
    changed = case
    for one in reviewed_oscillations(record_of(case, log_hz=log_hz)):
        if one.axis in case.axes:
            assert one.gains
            changed = with_gains_of(case, one.axis, dict(one.gains))
    return tuple(axis for axis in swings(replace(changed, wind_m_s=0.0, gusts_m_s=0.0, stick=0.0)) if axis in case.axes)


@pytest.mark.parametrize("case", [*FEW[:2], *FEW[4:6], slow_swings()[2]], ids=lambda c: f"{c.vehicle}-{c.seed}")
@pytest.mark.parametrize("log_hz", [10.0, 400.0])
def test_the_proposed_gains_end_the_oscillation(case: Case, log_hz: float) -> None:
    assert stopped(case, log_hz) == ()


@pytest.mark.slow
def test_limit_cycles_are_found() -> None:
    """40 flights of three autopilots from 4 to 40 Hz at every rate that they log, with even and late stamps."""
    cases = limit_cycles()
    assert len(cases) == 40
    true = [frequency_hz(fly(case), case.axes[0]) for case in cases]
    assert min(true) < 5.0
    assert max(true) > 37.0
    found = scores(cases)
    right, frequency = shares(found)
    wrong = [(case.vehicle, case.seed, hz, late) for case, hz, late, one in found if not one.right]
    assert right >= 0.95, wrong
    assert frequency >= 0.95
    # A frequency that is stated is never an image.
    assert all(one.frequency_right for *_, one in found if not one.frequency_due)


@pytest.mark.slow
def test_gains_just_beyond_the_limit_are_never_calm() -> None:
    """Flights that chose no limit of the check: roll is found, or a stronger axis is and roll is left unchecked."""
    looks = [
        ("roll" in [one.axis for one in check.found], "roll" in check.calm)
        for case in beyond_the_limit()
        for log_hz in logged_rates_hz(case)
        for check in [check_oscillations(record_of(case, log_hz=log_hz))]
    ]
    found, calm = np.mean(looks, axis=0)
    assert len(looks) > 350
    assert found >= 0.95
    assert calm == 0.0


@pytest.mark.slow
def test_slow_swings_are_found() -> None:
    right, frequency = shares(scores(slow_swings()))
    assert right >= 0.95
    assert frequency >= 0.95


@pytest.mark.slow
def test_calm_and_hard_flights_are_not_named() -> None:
    """60 calm and gusty flights, 24 with full sticks, chopped throttle and gains that are nearly too high."""
    assert len(calm_flights()) == 60
    assert [found for found in scores(calm_flights()) if not found[-1].right] == []
    assert [found for found in scores(hard_flights()) if not found[-1].right] == []


@pytest.mark.slow
def test_one_step_of_the_proposed_gains_ends_all_of_them() -> None:
    left = {
        (case.vehicle, case.seed, log_hz): axes
        for case in (*limit_cycles(), *slow_swings()[:12])
        for log_hz in (10.0, 400.0)
        if (axes := stopped(case, log_hz))
    }
    assert left == {}
