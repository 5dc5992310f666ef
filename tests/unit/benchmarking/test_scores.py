"""Scores and their standard deviations: of flights with a known scatter they are what other flights would show."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.benchmarking.scores import Part, StepErrorsOf, jackknife, step_rows
from rotorid.verification.multistep import StepErrors


def test_the_deviation_is_the_scatter_of_the_score_over_sets_of_flights() -> None:
    rng = np.random.default_rng(0)
    sizes = rng.chisquare(8, (2000, 12)) / 8
    found = [jackknife([Part(float(size), 1.0) for size in row], power=0.5) for row in sizes]
    values, stds = (np.array(column) for column in zip(*found, strict=True))
    # The root of a mean of twelve squares: the spread over 2000 sets is known to 2 %.
    assert np.sqrt((stds**2).mean()) == pytest.approx(values.std(), rel=0.08)


def test_a_flight_alone_has_no_deviation() -> None:
    assert jackknife([Part(3.0, 2.0)]) == (1.5, None)


def test_a_kept_state_is_one_by_definition() -> None:
    def errors(scale: float) -> StepErrors:
        rows = {name: np.array([1.0, 2.0]) for name in ("position", "velocity", "attitude", "rates")}
        return StepErrors(
            horizons_s=np.array([0.01, 0.02]),
            model={name: scale * row for name, row in rows.items()},
            naive=rows,
            starts=4,
        )

    both = [StepErrorsOf(errors(0.5), errors(0.25)), StepErrorsOf(errors(0.5), errors(0.25))]
    rows = {row.metric: (row.value, row.std) for row in step_rows("m", "s", both, 3)}
    assert rows["position"] == (0.5, 0.0)
    assert rows["displacement"] == (0.25, 0.0)
    assert rows["position_sum"] == (1.5, 0.0)
    kept = {row.metric: row.value for row in step_rows("m", "s", both, 0, naive=True)}
    assert kept["rates"] == 1.0
    assert kept["rates_sum"] == 3.0
