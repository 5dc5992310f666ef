"""Intervals of ``physical.flight`` on twins whose winds and seeds no development used: tests.twins.flight_coverage."""

from __future__ import annotations

import numpy as np
import pytest
from tests.twins.flight_coverage import TWO_SIDED, WINDS, groups, judge

JUDGED = ("I_xx", "I_yy", "k_d", "hover.thrust_coefficient", "hover.thrust_slope")


@pytest.mark.slow
def test_intervals_of_speeds_contain_the_truth() -> None:
    rows = [
        row
        for group in groups(WINDS, (47,))
        if group.cases[0].motors == "speeds" and group.velocity and len(group.cases) == 1
        for row in judge(group)
        if row.name in JUDGED
    ]
    assert {row.name for row in rows} == set(JUDGED)
    held = [abs(row.value - row.truth) <= TWO_SIDED * row.std for row in rows]
    assert float(np.mean(held)) >= 0.90
