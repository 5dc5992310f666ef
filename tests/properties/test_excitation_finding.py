"""Properties of finding excitations: neither scale nor offset nor clock change what was flown."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotorid.data.record import Channel, FlightRecord, Maneuver, Source, Topic
from rotorid.excitation.sweep import pilot_sweep
from rotorid.excitation.switching import doublet
from rotorid.signal.excitations import find_excitations
from rotorid.typing import FloatArray

BAND = (2.0 * math.pi * 0.2, 2.0 * math.pi * 4.0)


def flight(rate_hz: float) -> FloatArray:
    """A sweep of 30 s and a doublet, with rest around both; 56 s."""
    sweep = pilot_sweep(amplitude=1.0, band_rad_s=BAND, duration_s=30.0, sample_rate_hz=rate_hz, trim_s=6.0)
    pair = doublet(amplitude=0.8, pulse_s=1.0, sample_rate_hz=rate_hz, trim_s=6.0)
    return np.concatenate([sweep, pair])


def find(values: FloatArray, rate_hz: float, start_s: float = 0.0) -> tuple[Maneuver, ...]:
    topic = Topic(
        name="t",
        time_s=start_s + np.arange(values.size) / rate_hz,
        channels=(Channel(name="roll_command", unit="1"),),
        values=values[None],
    )
    source = Source(name="a.csv", format="csv", sha256="0" * 64)
    return find_excitations(FlightRecord(source=source, topics=(topic,)), "roll")


@given(
    amplitude=st.floats(0.05, 1e4),
    sign=st.sampled_from([-1.0, 1.0]),
    offset=st.floats(-1e3, 1e3),
    start_s=st.floats(0.0, 1e6),
)
@settings(max_examples=40, deadline=None)
def test_scale_offset_and_clock_do_not_matter(amplitude: float, sign: float, offset: float, start_s: float) -> None:
    rate_hz = 100.0
    plain = find(flight(rate_hz), rate_hz)
    assert [maneuver.kind for maneuver in plain] == ["sweep", "doublet"]
    moved = find(sign * amplitude * flight(rate_hz) + offset, rate_hz, start_s)
    assert [maneuver.kind for maneuver in moved] == ["sweep", "doublet"]
    for one, other in zip(plain, moved, strict=True):
        # Rounding of the offset may move a threshold by one sample.
        assert other.start_s - start_s == pytest.approx(one.start_s, abs=1.5 / rate_hz)
        assert other.stop_s - start_s == pytest.approx(one.stop_s, abs=1.5 / rate_hz)


@given(rate_hz=st.floats(40.0, 1000.0))
@settings(max_examples=25, deadline=None)
def test_the_rate_of_the_log_does_not_matter(rate_hz: float) -> None:
    sweep, pair = find(flight(rate_hz), rate_hz)
    assert (sweep.kind, pair.kind) == ("sweep", "doublet")
    assert sweep.start_s == pytest.approx(6.0, abs=1.0)
    assert sweep.stop_s == pytest.approx(36.0, abs=1.0)
    assert pair.duration_s == pytest.approx(2.0, abs=3.0 / rate_hz)
    assert sweep.band_rad_s is not None
    # Zero crossings are seen to one sample: at 4 Hz a half period is 5 samples at the lowest of these rates.
    assert sweep.band_rad_s[0] == pytest.approx(BAND[0], rel=0.3)
    assert sweep.band_rad_s[1] == pytest.approx(BAND[1], rel=0.3)
