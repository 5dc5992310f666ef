"""Words of a review: a row for several quantities is true of each of them."""

from __future__ import annotations

from rotorid.reviewing.missing import Unavailable
from rotorid.reviewing.missing_words import gathered


def test_a_row_for_several_axes_names_each_of_them() -> None:
    rows = gathered(
        Unavailable(
            what=f"loops.{state}",
            why=f"The {axis} stick did not move.",
            remedy=f"move the {axis} stick for 30 s",
        )
        for state, axis in (("q", "pitch"), ("r", "yaw"), ("theta", "pitch"))
    )
    (row,) = rows
    assert row.what == "pitch rate loop; yaw rate loop; pitch angle loop"
    assert row.why == "The pitch and yaw sticks did not move."
    assert row.remedy == "move the pitch and yaw sticks for 30 s"
