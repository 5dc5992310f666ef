"""Derotation: there and back is nothing, and straight flight stays straight while the heading drifts."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.data.record import Channel, TimeHistory
from rotorid.errors import UsageError
from rotorid.signal.kinematics import EARTH_TO_HEADING, to_heading
from rotorid.typing import FloatArray


def history(**channels: FloatArray) -> TimeHistory:
    return TimeHistory(
        values=np.stack(list(channels.values())),
        channels=tuple(Channel(name=name, unit="1", source=f"log.{name}") for name in channels),
        sample_rate_hz=20.0,
        start_s=0.0,
    )


def test_there_and_back_is_nothing() -> None:
    rng = np.random.default_rng(0)
    names = [name for pair in EARTH_TO_HEADING for name in pair]
    given = history(**{name: rng.standard_normal(50) for name in [*names, "psi", "theta"]})
    turned = to_heading(given)
    assert not set(names) & set(turned.names)
    cosine, sine = np.cos(given["psi"]), np.sin(given["psi"])
    for (north, east), (forward, right) in EARTH_TO_HEADING.items():
        np.testing.assert_allclose(cosine * turned[forward] - sine * turned[right], given[north], atol=1e-14)
        np.testing.assert_allclose(sine * turned[forward] + cosine * turned[right], given[east], atol=1e-14)
    np.testing.assert_array_equal(turned["theta"], given["theta"])
    assert len(turned.processing) == 1


def test_flight_along_a_drifting_nose_is_forward() -> None:
    psi = np.linspace(0.0, 1.0, 100)
    speed = np.linspace(0.0, 3.0, 100)
    turned = to_heading(history(velocity_north=speed * np.cos(psi), velocity_east=speed * np.sin(psi), psi=psi))
    np.testing.assert_allclose(turned["velocity_forward"], speed, atol=1e-14)
    np.testing.assert_allclose(turned["velocity_right"], 0.0, atol=1e-14)
    np.testing.assert_array_equal(turned["psi"], psi)
    assert turned.channels[0].source == "log.velocity_north turned by the heading"


def test_facing_east_north_is_to_the_left() -> None:
    turned = to_heading(history(north=np.ones(3), east=np.zeros(3), psi=np.full(3, np.pi / 2.0)))
    np.testing.assert_allclose(turned["forward"], 0.0, atol=1e-15)
    np.testing.assert_allclose(turned["right"], -1.0)


@pytest.mark.parametrize(
    ("names", "missing"),
    [
        (("north", "east"), "no heading psi"),
        (("north", "psi"), "no east"),
        (("velocity_east_setpoint", "psi"), "no velocity_north_setpoint"),
        (("u", "psi"), "no pair"),
    ],
)
def test_what_is_missing_is_said(names: tuple[str, ...], missing: str) -> None:
    with pytest.raises(UsageError, match=missing):
        to_heading(history(**{name: np.zeros(3) for name in names}))
