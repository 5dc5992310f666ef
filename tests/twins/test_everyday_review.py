"""Loops and margins of ordinary flights against the truth along each of them.

96 flights by stick alone: four vehicles, three gain sets, four winds, two stick levels (`everyday_flights`). A number
is right when it lies within what was planned for it, or has the truth inside its stated 95 % interval.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from tests.twins.everyday_flights import Case, Score, cases, fly, hover_delay, record_of, scores

from rotorid.flights.whole_flights import flown
from rotorid.reviewing.loops import LOOPS, loop_of

PLANNED: Mapping[str, tuple[str, float]] = {
    "rise_time_s": ("relative", 0.05),
    "delay_s": ("absolute", 1.5e-3),
    "overshoot_percent": ("absolute", 2.0),
    "bandwidth_90deg_rad_s": ("relative", 0.05),
    "bandwidth_3db_rad_s": ("relative", 0.05),
    "peak_db": ("absolute", 0.5),
    "crossover_rad_s": ("relative", 0.05),
    "phase_margin_deg": ("absolute", 3.0),
    "gain_margin_db": ("absolute", 1.0),
    "sensitivity_peak": ("relative", 0.1),
}
"""Largest error that each number should have, of its truth or as it is."""

RIGHT, HELD, FAR = 0.95, 0.93, 0.01
TOLD: Mapping[str, float] = {
    "rise_time_s": 0.95,
    "bandwidth_90deg_rad_s": 0.95,
    "phase_margin_deg": 0.95,
    "sensitivity_peak": 0.8,
}
MEASURED_GAIN_MARGINS, MEASURED_WITH_LESS_STICK = 0.45, 0.3
WIDEST = 2.0


@dataclass(frozen=True)
class Tally:
    """How often a number was told, right, inside its interval, and beyond twice that; and how wide that is."""

    asked: int
    told: int
    within: int
    inside: int
    right: int
    far: int
    half_width: float
    """Median, over what was planned."""

    by_model: int


@dataclass(frozen=True)
class Study:
    """A set of flights and their scores."""

    name: str
    scores: list[Mapping[str, Score]]


def tally(all_scores: Iterable[Mapping[str, Score]], name: str) -> Tally:
    kind, planned = PLANNED[name]
    asked = [one[name] for one in all_scores if name in one and np.isfinite(one[name].truth)]
    within = inside = right = far = 0
    widths = []
    for score in asked:
        if score.told is None:
            continue
        told, truth = score.told, score.truth
        allowed = planned * (abs(truth) if kind == "relative" else 1.0)
        near = abs(told.value - truth) <= allowed
        held = told.lower <= truth <= told.upper
        twice = 2.0 * told.lower - told.value <= truth <= 2.0 * told.upper - told.value
        within, inside, right, far = within + near, inside + held, right + (near or held), far + (not (twice or near))
        widths.append(0.5 * (told.upper - told.lower) / allowed)
    return Tally(
        asked=len(asked),
        told=len(widths),
        within=within,
        inside=inside,
        right=right,
        far=far,
        half_width=float(np.median(widths)) if widths else 0.0,
        by_model=sum(score.by_model for score in asked if score.told is not None),
    )


def table(all_scores: list[Mapping[str, Score]]) -> str:
    lines = ["| number | told | within | inside | either | half width |", "|---|---|---|---|---|---|"]
    for name in PLANNED:
        found = tally(all_scores, name)
        share = [f"{100.0 * count / max(found.told, 1):.0f} %" for count in (found.within, found.inside, found.right)]
        lines.append(f"| {name} | {found.told} of {found.asked} | {' | '.join(share)} | {found.half_width:.2f} |")
    return "\n".join(lines)


QUICK = (
    Case(vehicle="x500", gain=1.0, wind_m_s=4.0, level=0.5, duration_s=60.0, seed=7),
    Case(vehicle="acro", gain=1.0, wind_m_s=3.0, level=0.5, duration_s=60.0, seed=8),
    Case(vehicle="ardupilot_quad", gain=0.5, wind_m_s=3.0, level=0.25, duration_s=60.0, seed=9),
)
"""A gain set of three autopilots, in wind; with the stick at 50 Hz, none, and at 10 Hz."""


@pytest.mark.parametrize("case", QUICK, ids=lambda case: case.vehicle)
def test_an_ordinary_flight_tells_its_loop(case: Case) -> None:
    found = scores(case)
    expected = {"rise_time_s", "delay_s", "overshoot_percent", "bandwidth_90deg_rad_s", "bandwidth_3db_rad_s"}
    expected |= set() if case.acro else {"phase_margin_deg", "crossover_rad_s"}
    told = {name: tally([found], name) for name in expected}
    for name, one in told.items():
        assert one.told == 1, name
        assert one.right == 1, (name, found[name])
    assert np.median([one.half_width for one in told.values()]) < WIDEST


SLOWER = [
    Case(vehicle=vehicle, gain=gain, wind_m_s=wind_m_s, level=0.5, duration_s=90.0, seed=40 + number)
    for number, (vehicle, gain) in enumerate({"px4_quad": 1.0, "x500": 1.0, "ardupilot_quad": 0.5}.items())
    for wind_m_s in (0.0, 4.0)
]


@pytest.mark.slow
@pytest.mark.parametrize("case", SLOWER, ids=lambda case: f"{case.vehicle}, {case.wind_m_s:g} m/s")
@pytest.mark.parametrize("name", ["r", "phi"])
def test_delays_of_attitude_and_yaw_loops(case: Case, name: str) -> None:
    """Within 3 %, or inside the interval; the truth is that of hover."""
    loop = next(one for one in LOOPS if one.name == name)
    seen, untold = loop_of(flown(record_of(case, fly(case))), loop)
    assert seen is not None, untold
    told, truth = seen.numbers["delay_s"], hover_delay(case.vehicle, case.gain, name)
    assert abs(told.value - truth) <= 0.03 * truth or told.lower <= truth <= told.upper, (told, truth)


SETS: Mapping[str, Mapping[str, Any]] = {
    "as planned": {},
    "less stick": {"seed": 5000, "levels": (0.35, 0.15), "winds": (0.0, 2.0, 4.0, 5.0)},
}
"""The flights on which intervals were widened, and others."""


@pytest.fixture(scope="module", params=SETS)
def study(request: pytest.FixtureRequest) -> Study:
    """All flights of a set; a quarter of an hour."""
    found = [scores(case) for case in cases(**SETS[request.param])]
    print(table(found))
    return Study(name=request.param, scores=found)


@pytest.mark.slow
@pytest.mark.parametrize("name", PLANNED)
def test_numbers_are_right_as_often_as_planned(study: Study, name: str) -> None:
    found = tally(study.scores, name)
    assert found.right >= RIGHT * found.told, found
    assert found.inside >= HELD * found.told, found
    assert found.far <= max(FAR * found.told, 1.0), found
    assert found.half_width <= WIDEST, found


@pytest.mark.slow
@pytest.mark.parametrize("name", TOLD)
def test_silence_does_not_pass(study: Study, name: str) -> None:
    found = tally(study.scores, name)
    assert found.told >= TOLD[name] * found.asked, found


@pytest.mark.slow
def test_gain_margins_are_measured_in_many_flights(study: Study) -> None:
    """Where the sticks move as much as they did when that was planned."""
    found = tally(study.scores, "gain_margin_db")
    wanted = MEASURED_GAIN_MARGINS if study.name == "as planned" else MEASURED_WITH_LESS_STICK
    assert found.told - found.by_model >= wanted * found.asked, found
