"""Thrust at hover in the forms of simulators: published vehicles come back, force and slope hold."""

from __future__ import annotations

import pytest

from rotorid.errors import UsageError
from rotorid.exports.thrust import HoverThrust, expo_thrust, sih_lag

G_M_S2 = 9.80665


def hovering(c_0: float, c_1: float, c_2: float, mass: float) -> HoverThrust:
    force = mass * G_M_S2 / 4.0
    output = (-c_1 + (c_1**2 - 4.0 * c_2 * (c_0 - force)) ** 0.5) / (2.0 * c_2)
    return HoverThrust(output=output, force=force, slope=c_1 + 2.0 * c_2 * output)


def test_a_polynomial_curve_has_its_expo() -> None:
    found = expo_thrust(hovering(-0.25, 6.0, 9.0, 2.1), spin_min=0.15, spin_max=0.95)
    assert found.exact
    # To the digits that were printed.
    assert (round(found.expo, 5), round(found.hover_share, 5), round(found.full, 3)) == (0.12576, 0.41868, 12.297)


@pytest.mark.parametrize("expo", [0.0, 0.3, 0.65, 1.0])
def test_ardupilots_own_curve_comes_back(expo: float) -> None:
    c, full = 0.5508, 18.86
    force, slope = full * ((1 - expo) * c + expo * c**2), full * (1 - expo + 2 * expo * c) / 0.8
    found = expo_thrust(HoverThrust(output=0.15 + 0.8 * c, force=force, slope=slope), spin_min=0.15, spin_max=0.95)
    assert found.exact
    assert (found.expo, found.full) == pytest.approx((expo, full), rel=1e-12, abs=1e-12)


def test_a_curve_beyond_the_form_keeps_force_and_says_so() -> None:
    found = expo_thrust(HoverThrust(output=0.5, force=5.0, slope=40.0), spin_min=0.0, spin_max=1.0)
    assert not found.exact
    assert (found.expo, found.full * found.hover_share) == pytest.approx((1.0, 5.0))


def test_the_step_of_sih_has_the_pole_of_the_lag() -> None:
    assert sih_lag(0.048) == pytest.approx(0.05003, abs=5e-6)


def test_what_is_no_hover_is_refused() -> None:
    with pytest.raises(UsageError, match="positive"):
        HoverThrust(output=0.5, force=-1.0, slope=2.0)
    with pytest.raises(UsageError, match="between"):
        expo_thrust(HoverThrust(output=0.1, force=1.0, slope=2.0), spin_min=0.15, spin_max=0.95)
    with pytest.raises(UsageError, match="positive"):
        sih_lag(0.0)
