"""Rates and specific force out of angles and height: what comes back, what it costs, what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.record import Channel, FlightRecord, Source, Topic
from rotorid.errors import InsufficientDataError
from rotorid.flights.differentiated import from_angles, noise_gain
from rotorid.units import STANDARD_GRAVITY_M_S2

TIME_S = np.arange(0.0, 10.0, 0.01)
UNITS = {"phi": "rad", "theta": "rad", "psi": "rad", "down": "m"}


def record(rate_hz: float = 100.0, *, height_hz: float = 25.0, noise: float = 0.0) -> FlightRecord:
    def at(hz: float) -> np.ndarray:
        return np.arange(0.0, 10.0, 1.0 / hz)

    t, h = at(rate_hz), at(height_hz)
    rng = np.random.default_rng(0)
    angles = np.stack([0.1 * np.sin(2.0 * t), 0.05 * np.cos(3.0 * t), 3.0 + 0.1 * t])
    angles = np.angle(np.exp(1j * (angles + noise * rng.standard_normal(angles.shape))))  # psi jumps by a turn
    down = -5.0 + 0.2 * np.sin(2.0 * h)
    channels = {name: Channel(name=name, unit=unit) for name, unit in UNITS.items()}
    topics = (
        Topic(name="ATT", time_s=t, channels=tuple(channels[name] for name in ("phi", "theta", "psi")), values=angles),
        Topic(name="POS", time_s=h, channels=(channels["down"],), values=down[None]),
    )
    return FlightRecord(source=Source(name="angles.csv", format="csv", sha256="0"), topics=topics)


def test_rates_and_force_are_those_of_the_motion() -> None:
    made, findings = from_angles(record())
    t = made["p"].time_s
    inside = (t > 0.5) & (t < 9.5)
    phi, theta = 0.1 * np.sin(2.0 * t), 0.05 * np.cos(3.0 * t)
    p = 0.2 * np.cos(2.0 * t) - 0.1 * np.sin(theta)
    q = -0.15 * np.sin(3.0 * t) * np.cos(phi) + 0.1 * np.sin(phi) * np.cos(theta)
    assert made["p"].values[inside] == pytest.approx(p[inside], abs=1e-5)
    assert made["q"].values[inside] == pytest.approx(q[inside], abs=1e-5)
    clock = made["az"].time_s
    expected = (-0.8 * np.sin(2.0 * clock) - STANDARD_GRAVITY_M_S2) / (
        np.cos(0.1 * np.sin(2.0 * clock)) * np.cos(0.05 * np.cos(3.0 * clock))
    )
    inside = (clock > 0.5) & (clock < 9.0)
    assert made["az"].values[inside] == pytest.approx(expected[inside], abs=1e-3)
    # The slower height does not slow the angles down.
    assert made["az"].sample_rate_hz == pytest.approx(100.0)
    assert [finding.kind for finding in findings] == ["differentiated", "differentiated"]


def test_the_price_is_that_of_the_noise() -> None:
    _, (finding, _) = from_angles(record(noise=1e-3))
    assert finding.numbers["scatter"] == pytest.approx(1e-3, rel=0.15)
    assert finding.numbers["noise_gain_1_s2"] == pytest.approx(noise_gain(100.0))
    assert finding.numbers["acceleration_noise"] == pytest.approx(1e-3 * noise_gain(100.0), rel=0.15)
    assert "Derivatives of phi, theta and psi at 100 Hz replace p, q and r" in finding.message
    assert f"contain {finding.numbers['acceleration_noise']:.2g} rad/s^2 of noise" in finding.message
    # White noise through the same low-pass and derivative has what the formula says.
    from scipy.signal import butter, sosfilt

    white = np.random.default_rng(1).standard_normal(200_000)
    slow = sosfilt(butter(2, 5.0, fs=100.0, output="sos"), white)
    measured = np.diff(slow, 2).std() * 100.0**2
    assert measured == pytest.approx(noise_gain(100.0), rel=0.02)


def test_sensors_are_taken_where_there_are_some() -> None:
    made, _ = from_angles(record())
    whole = replace(made, topics=made.topics[:2])
    assert from_angles(whole) == (whole, ())
    again, findings = from_angles(made, ("phi",))
    assert len(findings) == 1
    assert again.topics[0].name == "ATT, differentiated"


def test_angles_at_ten_hertz_are_refused() -> None:
    with pytest.raises(InsufficientDataError, match="10 Hz") as caught:
        from_angles(record(10.0))
    assert caught.value.findings[0].kind == "rate_too_low"


def test_what_is_missing_is_named() -> None:
    bare = record()
    with pytest.raises(InsufficientDataError, match="no down"):
        from_angles(replace(bare, topics=bare.topics[:1]))
