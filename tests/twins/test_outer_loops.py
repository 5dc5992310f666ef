"""Velocity loops of a fleet, tuned with their attitude loops: as predicted on the simulator's exact plant.

The whole study, 60 vehicles of each kind, is ``python -m benchmarks.outer_fleet``; a table of some of them stands in
``docs/tuning-study.md``.
"""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.outer_fleet import Row, one
from benchmarks.tuning_fleet import MOST_PEAK

pytestmark = pytest.mark.slow

NUMBERS = (0, 1, 2, 3, 7, 11)


@pytest.fixture(scope="module")
def rows() -> list[Row]:
    return [row for hard in (False, True) for number in NUMBERS if not (row := one((number, hard))).refused]


def test_none_is_destabilized(rows: list[Row]) -> None:
    assert len(rows) >= len(NUMBERS)
    assert all(row.stable for row in rows)


def test_sensitivity_peaks_hold_where_gains_were_proposed(rows: list[Row]) -> None:
    assert np.mean([row.peak <= MOST_PEAK for row in rows if row.changed]) >= 0.98


def test_the_exact_plant_is_what_was_predicted(rows: list[Row]) -> None:
    assert np.mean([value for row in rows for value in row.inside.values()]) >= 0.93


def test_places_are_held_better_or_with_more_reserve(rows: list[Row]) -> None:
    assert all(row.better < 1.0 or row.peak < row.before for row in rows if row.changed)
