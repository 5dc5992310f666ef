"""The whole way of ``identify --model physical.flight`` on flights of which something is known."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from rotorid.identifying.identification import identify
from rotorid.io.registry import read
from rotorid.results.model import IdentifiedModel

ARM_M = 0.2 * 2.0**0.5
DRAG_1_S = 1.0
"""Of PX4's simulator, over mass."""


def simulated(file: Path) -> IdentifiedModel:
    return identify(read(file), "physical.flight", fix={"m": 1.0}, arm_m=ARM_M)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["roll.ulg", "pitch.ulg.xz"])
def test_drag_of_a_slow_flight_is_from_the_tilt(name: str, unpacked: Callable[[str], Path]) -> None:
    found = simulated(unpacked(f"px4_sitl/{name}"))
    assert found.flight is not None
    drag = found.flight.hover["drag"]
    assert abs(drag.value - DRAG_1_S) < 2.0 * drag.std
    assert drag.std < 0.15
    assert "drag_by_tilt" in {finding.kind for finding in found.findings}
    assert "k_d" not in found.flight.missing


@pytest.mark.slow
def test_a_thrust_sweep_shows_no_drag(unpacked: Callable[[str], Path]) -> None:
    found = simulated(unpacked("px4_sitl/thrust.ulg.xz"))
    assert found.flight is not None
    assert "k_d" in found.flight.missing
    assert "drag" not in found.flight.hover
