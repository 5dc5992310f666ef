"""What is searched in each loop contains what firmwares ship, and its frequencies contain what these loops do."""

from __future__ import annotations

import pytest

from rotorid.tuning.kinds import KINDS
from rotorid.typing import LoopName

SHIPPED: dict[LoopName, dict[str, tuple[float, float, float, float]]] = {
    "roll": {"PX4": (0.15, 0.2, 0.003, 6.5), "ArduPilot": (0.135, 0.135, 0.0036, 4.5)},
    "yaw": {"PX4": (0.2, 0.1, 0.0, 2.8), "ArduPilot": (0.18, 0.018, 0.0, 4.5)},
    "velocity": {"PX4": (1.8, 0.4, 0.2, 0.95), "ArduPilot": (2.0, 1.0, 0.5, 1.0)},
    "climb": {"PX4": (4.0, 2.0, 0.0, 1.0)},
}
"""P, I, D and the gain of the outer loop, as the firmware ships them."""

CROSSOVERS_RAD_S: dict[LoopName, tuple[float, float]] = {
    "roll": (2.0, 80.0),
    "yaw": (1.5, 40.0),
    "velocity": (0.9, 4.0),
    "climb": (0.9, 8.0),
}
"""Slowest crossover of the outer loop, and fastest one of the inner loop, of vehicles that fly well."""


@pytest.mark.parametrize(
    ("loop", "firmware"), [(loop, firmware) for loop, shipped in SHIPPED.items() for firmware in shipped]
)
def test_what_a_firmware_ships_is_among_what_is_tried(loop: LoopName, firmware: str) -> None:
    kind, (P, I, D, A) = KINDS[loop], SHIPPED[loop][firmware]  # noqa: E741 - as everybody calls it
    assert kind.integrals[0] * 0.99 <= I / P <= kind.integrals[-1]
    assert kind.derivatives[0] <= D / P <= kind.derivatives[-1]
    assert kind.angles[0] <= A <= kind.angles[-1]
    # A tenfold of what is usual would be no search but a list of accidents.
    assert kind.integrals[-1] < 100.0 * I / P


@pytest.mark.parametrize("loop", CROSSOVERS_RAD_S)
def test_a_loop_is_seen_a_decade_around_its_crossovers(loop: LoopName) -> None:
    kind, (slowest, fastest) = KINDS[loop], CROSSOVERS_RAD_S[loop]
    assert 3.0 * kind.lowest_rad_s <= slowest
    assert fastest <= kind.highest_rad_s / 7.0
    # Gusts and moments are slow against the loop that rejects them.
    assert kind.lowest_rad_s < kind.disturbance_rad_s <= slowest


@pytest.mark.parametrize(("loop", "room"), [("roll", 3.0), ("yaw", 3.0), ("velocity", 1.5), ("climb", 1.5)])
def test_an_inner_loop_is_faster_than_the_one_around_it(loop: LoopName, room: float) -> None:
    assert KINDS[loop].angle_room == room
    assert KINDS[loop].outer == (loop in ("velocity", "climb"))


def test_yaw_has_no_derivative_to_try() -> None:
    """Its noise would go to the motors, and the firmwares ship none."""
    assert KINDS["yaw"].derivatives.tolist() == [0.0]
    assert not KINDS["yaw"].adds_derivative
