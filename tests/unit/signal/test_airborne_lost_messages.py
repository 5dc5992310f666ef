"""A landed flag whose message of the take-off was lost comes late: thrust and height show the take-off."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.data.record import Channel, FlightRecord, Source, Status, Topic
from rotorid.signal.airborne import airborne


def record_with(height: np.ndarray, time_s: np.ndarray, flag_s: float) -> FlightRecord:
    thrust = np.where((time_s >= 10.0) & (time_s < 40.0), 0.5, 0.05)
    rows = {"thrust_command": thrust, "down": -height}
    channels = tuple(Channel(name=name, unit="1") for name in rows)
    topic = Topic(name="main", time_s=time_s, channels=channels, values=np.stack([*rows.values()]))
    status = Status(armed=((5.0, 45.0),), in_air=((flag_s, 40.0),), flagged_in="vehicle_land_detected")
    source = Source(name="flight.ulg", format="ULog", sha256="")
    return FlightRecord(source=source, topics=(topic,), status=status)


@pytest.mark.parametrize(("climbs_at_s", "start_s"), [(10.0, 10.0), (13.5, 13.0)])
def test_a_late_flag_is_corrected_where_the_vehicle_had_climbed(climbs_at_s: float, start_s: float) -> None:
    time_s = np.arange(0.0, 50.0, 0.1)
    height = np.clip(time_s - climbs_at_s, 0.0, 5.0) * (time_s < 40.0)
    flight = airborne(record_with(height, time_s, flag_s=13.0))
    assert flight.intervals[0][0] == pytest.approx(start_s, abs=0.15)
