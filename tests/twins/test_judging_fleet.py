"""Gains that nobody flew are judged after one flight: none that is unstable is called safe, and no good one refused.

The whole study, three axes of 60 vehicles of each kind, is ``python -m benchmarks.judging_fleet``; a table of some of
them stands in ``docs/tuning-study.md``. Here are some of all kinds, judged on the simulator's exact plant.
"""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.judging_fleet import AXES, Judgment, one

pytestmark = pytest.mark.slow

NUMBERS = (0, 4, 7, 9, 13)


@pytest.fixture(scope="module")
def rows() -> list[Judgment]:
    return [row for number in NUMBERS for hard in (False, True) for axis in AXES for row in one((number, axis, hard))]


def test_what_would_swing_is_not_flown(rows: list[Judgment]) -> None:
    bad = [row.verdict for row in rows if row.bad]
    assert len(bad) > 100
    assert np.mean([verdict == "do_not_fly" for verdict in bad]) >= 0.99
    assert not [row for row in rows if not np.isfinite(row.truth) and row.flies]


def test_good_gains_are_not_refused(rows: list[Judgment]) -> None:
    good = [row.verdict for row in rows if row.good]
    assert len(good) > 50
    assert np.mean([verdict == "do_not_fly" for verdict in good]) <= 0.03
    assert np.mean([verdict in ("fly", "gently") for verdict in good]) >= 0.85
