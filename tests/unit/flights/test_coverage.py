"""What the data covered, and the trim."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Maneuver, Source, TimeHistory, Topic
from rotorid.errors import InsufficientDataError
from rotorid.flights.coverage import covered_by, trim_of
from rotorid.flights.flights import Flight

RATE_HZ = 50.0
TIME_S = np.arange(0.0, 10.0, 1.0 / RATE_HZ)


def history(**columns: np.ndarray) -> TimeHistory:
    return TimeHistory(
        values=np.stack(list(columns.values())),
        channels=tuple(Channel(name=name, unit=STANDARD_UNITS.get(name, "1")) for name in columns),
        sample_rate_hz=RATE_HZ,
        start_s=20.0,
    )


def flight(**columns: np.ndarray) -> Flight:
    channels = tuple(Channel(name=name, unit=STANDARD_UNITS.get(name, "1")) for name in columns)
    topic = Topic(name="all", time_s=TIME_S, channels=channels, values=np.stack(list(columns.values())))
    record = FlightRecord(source=Source(name="a", format="CSV", sha256="a"), topics=(topic,))
    return Flight(record, Maneuver(axis="roll", kind="sweep", start_s=0.0, stop_s=10.0))


def test_ranges_are_of_all_records_together() -> None:
    first, second = flight(u=np.full(500, 2.0)), flight(u=np.full(500, -4.0), theta=0.1 * np.sin(TIME_S))
    ranges = covered_by([first, second])
    assert (ranges["u"].lowest, ranges["u"].highest, ranges["u"].unit) == (-4.0, 2.0, "m/s")
    assert ranges["u"].rms == pytest.approx(np.sqrt(10.0))
    assert ranges.keys() == {"u", "theta"}


def test_what_describes_no_flight_condition_is_left_out() -> None:
    assert covered_by([flight(mystery=TIME_S, p_setpoint=TIME_S)]) == {}


def test_a_log_is_read_where_it_was_fitted_only() -> None:
    """The battery is used by no model, has its own clock, and lost a sample."""
    time_s = np.arange(0.0, 10.0)
    volts = np.where(time_s == 5.0, np.nan, 16.0 - 0.1 * time_s)
    battery = Topic(
        name="battery", time_s=time_s, channels=(Channel(name="battery_voltage", unit="V"),), values=volts[None]
    )
    record = FlightRecord(source=Source(name="a", format="CSV", sha256="a"), topics=(battery,))
    (voltage,) = covered_by([Flight(record, Maneuver(axis="roll", kind="sweep", start_s=3.5, stop_s=8.5))]).values()
    assert voltage.lowest == pytest.approx(15.2)
    assert voltage.highest == pytest.approx(15.6)
    assert voltage.unit == "V"


class TestTrim:
    def test_of_the_quiet_start(self) -> None:
        u = np.where(TIME_S < 4.0, 3.0, 9.0)
        trim = trim_of(history(u=u, theta=np.full(500, 0.05)))
        assert not trim.hover
        assert trim.values == pytest.approx({"u": 3.0, "theta": 0.05})

    def test_until_the_maneuver(self) -> None:
        u = np.where(TIME_S < 1.0, 3.0, 9.0)
        assert trim_of(history(u=u), until_s=20.99).values["u"] == pytest.approx(3.0)

    def test_a_slow_drift_is_a_hover(self) -> None:
        trim = trim_of(history(u=np.full(500, 0.3), w=np.full(500, -0.2), phi=np.full(500, 0.01)))
        assert trim.hover
        assert trim.values == pytest.approx({"u": 0.0, "w": 0.0, "phi": 0.01})

    def test_one_fast_component_is_no_hover(self) -> None:
        trim = trim_of(history(u=np.full(500, 0.3), v=np.full(500, 0.6)))
        assert not trim.hover
        assert trim.values == pytest.approx({"u": 0.3, "v": 0.6})

    def test_without_quiet_time_there_is_none(self) -> None:
        with pytest.raises(InsufficientDataError, match="samples of quiet flight"):
            trim_of(history(u=TIME_S), until_s=20.03)
