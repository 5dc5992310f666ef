"""Gains are proposed from flights in which the motors had room, by the range in which each autopilot moves them."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.data.record import Channel, FlightRecord, Source, Topic
from rotorid.errors import InsufficientDataError
from rotorid.pipeline.tuning.flown import require_room
from rotorid.typing import FloatArray

SPIN = {"MOT_SPIN_MIN": 0.15, "MOT_SPIN_MAX": 0.95, "MOT_THST_EXPO": 0.65}
FORMATS: dict[str, dict[str, float]] = {"ArduPilot DataFlash": SPIN, "PX4 ULog": {}, "Betaflight blackbox": {}}
SQUARE = np.where(np.arange(1000) // 25 % 2 == 0, 1.0, -1.0)


def log(values: FloatArray, kind: str, parameters: dict[str, float]) -> FlightRecord:
    """Four motors, two of which do the opposite of the others."""
    channels = tuple(Channel(name=f"motor_{number}", unit="1") for number in range(1, 5))
    both = np.stack([values, values.max() + values.min() - values] * 2)
    topic = Topic(name="motors", time_s=np.arange(values.size) / 100.0, channels=channels, values=both)
    return FlightRecord(source=Source(name="flight", format=kind, sha256=""), topics=(topic,), parameters=parameters)


@pytest.mark.parametrize("kind", FORMATS)
def test_a_limit_cycle_between_both_ends_is_refused(kind: str) -> None:
    parameters = FORMATS[kind]
    low, high = (0.15, 0.95) if parameters else (0.0, 1.0)
    middle, half = (high + low) / 2.0, (high - low) / 2.0
    with pytest.raises(InsufficientDataError, match="at a limit for 100 %"):
        require_room(log(middle + half * SQUARE, kind, parameters))
    assert require_room(log(middle + 0.5 * half * SQUARE, kind, parameters)) == []


def test_motors_that_idle_on_the_ground_are_at_no_limit() -> None:
    idle = np.where(np.arange(1000) < 500, 0.1, 0.4)
    channels = tuple(Channel(name=f"motor_{number}", unit="1") for number in range(1, 5))
    topic = Topic(name="RCOU", time_s=np.arange(1000) / 100.0, channels=channels, values=np.stack([idle] * 4))
    source = Source(name="flight", format="ArduPilot DataFlash", sha256="")
    assert require_room(FlightRecord(source=source, topics=(topic,), parameters=SPIN)) == []


def test_what_is_not_seen_is_said() -> None:
    nothing = FlightRecord(source=Source(name="flight", format="PX4 ULog", sha256=""), topics=(), parameters={})
    (said,) = require_room(nothing)
    assert (said.kind, "outputs of all motors" in said.message) == ("room_not_checked", True)
    (said,) = require_room(log(0.5 + 0.1 * SQUARE, "ArduPilot DataFlash", {}))
    assert "in which range" in said.message
