"""Why the noise of a gyro was not measured."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Status, Topic
from rotorid.errors import InsufficientDataError
from rotorid.flights.gyro_noise import gyro_noise

RATE_HZ = 2000.0


def record(length_s: float, gap_every: int) -> FlightRecord:
    """A flight of a gyro at 2 kHz with a pause of 5 ms after so many samples."""
    count = np.arange(round(length_s * RATE_HZ))
    time_s = count / RATE_HZ + 0.005 * (count // gap_every)
    values = np.random.default_rng(1).standard_normal((3, time_s.size))
    channels = tuple(Channel(name=name, unit=STANDARD_UNITS[name]) for name in "pqr")
    return FlightRecord(
        source=Source(name="flight.bbl", format="Betaflight blackbox", sha256=""),
        topics=(Topic(name="main", time_s=time_s, channels=channels, values=values),),
        status=Status(in_air=((0.0, float(time_s[-1])),), flagged_in="flags"),
    )


@pytest.mark.parametrize(
    ("length_s", "gap_every", "why", "remedy"),
    [(20.0, 12, "too many gaps", "lower the logging rate"), (2.01, 100_000, "too short", "fly and log for 20 s")],
)
def test_a_flight_with_gaps_is_not_called_too_short(length_s: float, gap_every: int, why: str, remedy: str) -> None:
    with pytest.raises(InsufficientDataError, match=why) as caught:
        gyro_noise(record(length_s, gap_every))
    assert caught.value.remedy.startswith(remedy)
