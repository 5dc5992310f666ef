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


@pytest.mark.slow
def test_a_calm_fit_finds_the_wind_of_another_log(unpacked: Callable[[str], Path]) -> None:
    """ArduPilot's simulator in 3.3 m/s toward (-1.65, -2.86); without it, fits along x and y are below -100 %."""
    calm = identify(
        read(unpacked("ardupilot_sitl/x_calm_verify.BIN.xz")),
        "physical.flight",
        verify=[read(unpacked("ardupilot_sitl/x_wind_rollpitch.BIN.xz"))],
        fix={"m": 3.0},
        arm_m=0.35,
    )
    assert calm.flight is not None
    assert not any(log.wind_m_s for log in calm.flight.logs)
    (check,) = calm.verifications.maneuvers
    assert check.flight is not None
    assert check.flight.wind == pytest.approx((-1.65, -2.86), abs=0.3)
    assert min(check.scores[name].nrmse_fit_percent for name in ("ax", "ay")) > 50.0
    # At one heading, part of it may be a bias.
    assert "wind_or_bias" in {finding.kind for finding in calm.findings}
