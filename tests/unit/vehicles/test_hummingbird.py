"""The Hummingbird: the printed equations with their scaled states, and the printed mode."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.models.library import library_model
from rotorid.units import STANDARD_GRAVITY_M_S2 as G
from rotorid.vehicles import hummingbird

OMEGA = np.geomspace(0.3, 100.0, 60)


def test_mode_of_pitch_is_the_published_one() -> None:
    # Printed to three digits.
    *pair, real = sorted(hummingbird.pitch().poles(), key=lambda pole: -pole.real)
    assert real.real == pytest.approx(-3.98, abs=0.005)
    frequency = abs(pair[0])
    assert frequency == pytest.approx(3.87, abs=0.005)
    assert -pair[0].real / frequency == pytest.approx(-0.487, abs=0.0005)


def test_pitch_is_the_printed_system() -> None:
    """Eqs 17 and 18 with the scaled rate, table 2 as printed, one delay for each response."""
    F = np.array([[-0.2090, 0.0, -G], [8.207, 0.0, 0.0], [0.0, 0.7416, 0.0]])
    B = np.array([0.0, 2.977, 0.0])
    H0 = np.array([[0.0, 0.7416, 0.0], [0.0, 0.0, G]])
    H1 = np.array([[0.0, 0.0, 0.0], [1.0, -0.01, 0.0]])
    delays = np.array([0.02423, 0.05791])
    s = 1j * OMEGA[:, None, None]
    printed = ((H0 + s * H1) @ np.linalg.solve(s * np.eye(3) - F, np.tile(B[:, None], (OMEGA.size, 1, 1))))[..., 0].T
    printed = printed * np.exp(-1j * OMEGA * delays[:, None])
    outputs = library_model("axis.pitch").outputs
    ours = hummingbird.pitch().response(OMEGA)[[outputs.index("q"), outputs.index("ax")], 0]
    np.testing.assert_allclose(ours, printed, rtol=1e-11)


def test_yaw_is_the_printed_system() -> None:
    """Eq 19 with table 3, and the constant of the motor controllers that is ours."""
    pole, gain, N_omega = -42.21, 152.1, -0.5541
    motor = gain / (1j * OMEGA - pole)
    r = (N_omega * motor - hummingbird._SPEED_PER_COMMAND * N_omega) / (1j * OMEGA)
    printed = r * np.exp(-1j * OMEGA * 0.01313)
    np.testing.assert_allclose(hummingbird.yaw().response(OMEGA)[0, 0], printed, rtol=1e-11)


def test_vertical_is_the_printed_system() -> None:
    s = 1j * OMEGA
    printed = s * -0.1692 / (s + 0.5934) * np.exp(-s * 0.05202)
    outputs = library_model("axis.vertical").outputs
    ours = hummingbird.vertical().response(OMEGA)[outputs.index("az"), 0]
    np.testing.assert_allclose(ours, printed, rtol=1e-11)


@pytest.mark.parametrize("name", hummingbird.TRUTH)
def test_truth_has_every_parameter_of_its_model(name: str) -> None:
    assert set(hummingbird.TRUTH[name]) == set(library_model(name).parameters.names)


def test_accelerometer_stands_where_the_paper_says() -> None:
    assert hummingbird.PITCH["z_imu"] == pytest.approx(1.0 / 74.16, rel=1e-12)
