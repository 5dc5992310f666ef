"""Motors of a log that is checked by their speeds."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.checking.motor_speed import stretches, with_speeds
from rotorid.data.record import Channel, FlightRecord, Source, Topic
from rotorid.errors import InsufficientDataError


def _record(rate_hz: float, samples: int) -> FlightRecord:
    names = [f"motor_{number}" for number in (1, 2)] + [f"motor_speed_{number}" for number in (1, 2)]
    channels = tuple(Channel(name=name, unit="rad/s" if "speed" in name else "1") for name in names)
    values = np.tile(np.arange(samples) % 7.0, (4, 1)) + 100.0
    topic = Topic(name="motors", time_s=np.arange(samples) / rate_hz, channels=channels, values=values)
    return FlightRecord(source=Source(name="fast.csv", format="CSV", sha256=""), topics=(topic,))


def test_fast_motors_become_means() -> None:
    record = with_speeds(_record(2000.0, 4000))
    first = record.topics[0]
    assert first.values.shape == (2, 400)
    assert first.sample_rate_hz == pytest.approx(200.0)


def test_stamps_of_a_wrong_unit_end_in_a_sentence() -> None:
    record = with_speeds(_record(1e6, 50))
    with pytest.raises(InsufficientDataError, match="turn together for 0"):
        stretches(record)
