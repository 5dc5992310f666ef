"""A fleet is flown, tuned and flown again: none destabilized, margins as promised and as foretold.

The whole study, two axes of 60 vehicles of each kind, is ``python -m benchmarks.tuning_fleet``; a table of some of them
stands in ``docs/tuning-study.md``. Here are every fifth, judged on the simulator's exact plant.
"""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.tuning_fleet import AXES, MOST_PEAK, Row, one

pytestmark = pytest.mark.slow

NUMBERS = range(0, 60, 5)


@pytest.fixture(scope="module")
def rows() -> list[Row]:
    return [one((number, axis, hard)) for hard in (False, True) for number in NUMBERS for axis in AXES]


def flown(rows: list[Row], *, hard: bool | None = None, axis: str = "") -> list[Row]:
    return [row for row in rows if not row.refused and (hard is None or row.hard == hard) and axis in ("", row.axis)]


def test_none_is_destabilized(rows: list[Row]) -> None:
    assert all(row.stable for row in flown(rows) if row.changed)


def test_few_are_refused(rows: list[Row]) -> None:
    assert len(flown(rows)) >= 0.85 * len(rows)


KINDS = [(hard, axis) for hard in (False, True) for axis in AXES]


@pytest.mark.parametrize(("hard", "axis"), KINDS)
def test_sensitivity_peaks_hold_where_gains_were_proposed(rows: list[Row], hard: bool, axis: str) -> None:
    changed = [row for row in flown(rows, hard=hard, axis=axis) if row.changed]
    assert np.mean([row.peak <= MOST_PEAK for row in changed]) >= 0.98


@pytest.mark.parametrize(("hard", "axis"), KINDS)
def test_the_exact_plant_is_what_was_foretold(rows: list[Row], hard: bool, axis: str) -> None:
    inside = [value for row in flown(rows, hard=hard, axis=axis) for value in row.inside.values()]
    assert np.mean(inside) >= 0.93


def test_the_sluggish_are_stiffer(rows: list[Row]) -> None:
    better = [row.better < 1.0 for row in flown(rows) if row.sluggish]
    assert len(better) >= 5
    assert np.mean(better) >= 0.95


def test_no_proposal_is_soft(rows: list[Row]) -> None:
    """What is reached of the next test: most within a quarter of the best, none below a third.

    Where the step of one flight ends a proposal (yaw of ArduPilot: P doubles), the best lies a flight further.
    """
    stiffness = np.array([row.stiffness for row in flown(rows)])
    assert np.mean([row.stiffness >= 0.75 for row in flown(rows) if not row.capped]) >= 0.7
    assert stiffness.min() >= 1.0 / 3.0


@pytest.mark.xfail(
    raises=AssertionError,
    strict=True,
    reason="on the exact plant 74 % of loops reach it; a tenth of roll is below 0.44",
)
def test_stiffness_is_near_that_of_the_true_plant(rows: list[Row]) -> None:
    assert np.mean([row.stiffness >= 0.75 for row in flown(rows)]) >= 0.9
