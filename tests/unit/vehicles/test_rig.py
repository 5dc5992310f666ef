"""The rig: the ratio that its roll angle shows, its signs, its delays."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.models.library import library_model
from rotorid.vehicles import rig


def gain(values: dict[str, float]) -> float:
    return values["L"] * values["K_f"] / values["J_x"]


def test_gain_is_the_published_one() -> None:
    # Printed as 0.458, from numbers of three digits.
    assert rig.roll().G[1, 0] == pytest.approx(gain(rig.TRUTH), rel=1e-12)
    assert gain(rig.TRUTH) == pytest.approx(0.458, abs=0.002)
    assert gain(rig.DOCUMENTATION) == pytest.approx(0.424, abs=0.0005)


def test_errors_are_the_published_ones() -> None:
    # Printed in percent with one digit.
    assert abs(rig.TRUTH["J_x"] / rig.DOCUMENTATION["J_x"] - 1.0) == pytest.approx(0.148, abs=0.001)
    assert abs(rig.TRUTH["K_f"] / rig.DOCUMENTATION["K_f"] - 1.0) == pytest.approx(0.082, abs=0.001)


def test_motors_pull_against_each_other_each_with_its_delay() -> None:
    omega = np.geomspace(0.2, 10.0, 20)
    phi = rig.roll().response(omega)[0]
    expected = gain(rig.TRUTH) / (1j * omega) ** 2
    np.testing.assert_allclose(phi[0], expected * np.exp(-1j * omega * 0.2279), rtol=1e-12)
    np.testing.assert_allclose(phi[1], -expected * np.exp(-1j * omega * 0.1770), rtol=1e-12)


def test_only_the_ratio_of_thrust_and_inertia_is_seen() -> None:
    doubled = dict(rig.TRUTH) | {"J_x": 2.0 * rig.TRUTH["J_x"], "K_f": 2.0 * rig.TRUTH["K_f"]}
    np.testing.assert_allclose(library_model("rig.roll").matrices(doubled).G, rig.roll().G, rtol=1e-12)
    assert set(rig.TRUTH) == set(library_model("rig.roll").parameters.names)
