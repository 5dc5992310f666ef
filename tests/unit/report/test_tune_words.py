"""Words about new gains and the flights to the best ones."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from rotorid.report.tune_words import _less, path_sentence


def step(ratio: float) -> SimpleNamespace:
    return SimpleNamespace(attitude_ratio=SimpleNamespace(value=ratio), sweep_to_rad_s=120.0)


@pytest.mark.parametrize(("goal", "words"), [(0.25, "2 times less"), (0.48, "4 % less"), (0.35, "30 % less")])
def test_a_small_gain_is_given_in_percent_and_never_as_one_time(goal: float, words: str) -> None:
    way: Any = [step(0.5), step(goal)]
    assert path_sentence(way).endswith(f"tilts the vehicle {words} than with the gains proposed now.")


@pytest.mark.parametrize(
    ("ratio", "words"),
    [(0.25, "4 times less than"), (0.9, "10 % less than"), (1.2, "20 % more than"), (5.3, "5.3 times more than")],
)
def test_a_disturbance_that_tilts_much_more_is_a_factor(ratio: float, words: str) -> None:
    assert _less(SimpleNamespace(value=ratio)) == words  # type: ignore[arg-type]
