"""Voltage of the battery: that of the flights, one answer for `inspect` and `review`."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.data.record import Channel, FlightRecord, Source, Topic
from rotorid.signal.battery import battery_voltages


def monitor(volts: np.ndarray) -> FlightRecord:
    channel = Channel(name="battery_voltage", unit="V")
    topic = Topic(name="BAT", time_s=np.arange(volts.size) * 0.1, channels=(channel,), values=volts[None])
    return FlightRecord(source=Source(name="a.bin", format="CSV", sha256=""), topics=(topic,))


def test_a_full_battery_on_the_bench_is_not_that_of_the_flight() -> None:
    volts = np.concatenate([np.full(100, 16.8), np.linspace(16.0, 15.0, 400), np.full(100, 16.2)])
    found = battery_voltages(monitor(volts), [(10.0, 49.9)])
    assert found["start_v"].value == pytest.approx(15.975, abs=0.005)
    assert found["stop_v"].value == pytest.approx(15.025, abs=0.005)
    assert found["lowest_v"].value == pytest.approx(15.0, abs=0.005)


def test_one_low_sample_is_not_the_lowest() -> None:
    volts = np.full(3000, 15.0)
    volts[1000] = 3.0
    assert battery_voltages(monitor(volts))["lowest_v"].value == 15.0


@pytest.mark.parametrize("volts", [np.zeros(100), np.full(4, 15.0), np.full(100, np.nan)])
def test_a_monitor_that_is_not_connected_says_nothing(volts: np.ndarray) -> None:
    assert battery_voltages(monitor(volts)) == {}
