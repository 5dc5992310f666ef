"""Which gains to lower, where the log does not have them."""

from __future__ import annotations

from tests.unit.signal.test_oscillations import record, slow_swing, swinging

from rotorid.flights.oscillations import remedy, reviewed_oscillations


def test_gains_that_are_not_logged_are_named_by_the_kind_of_swing() -> None:
    """With P, I and D lowered alike a loop of too much integral swings on, and slower."""
    (slow,) = reviewed_oscillations(record(slow_swing(3.0), 50.0))
    assert remedy(slow) == "Lower I and the angle gain of roll to a third before the next flight."
    (fast,) = reviewed_oscillations(record(swinging(17.0), 400.0))
    assert remedy(fast) == "Lower P, I and D of roll to a third before the next flight."
