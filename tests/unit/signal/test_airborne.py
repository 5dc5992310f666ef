"""Airborne: flights are told from waiting on the ground, by thrust or by what sensors feel."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Topic
from rotorid.errors import InsufficientDataError
from rotorid.signal.airborne import airborne, not_flown
from rotorid.typing import FloatArray

TIME_S = 200.0 + np.arange(0.0, 100.0, 0.01)


def topic(time_s: FloatArray = TIME_S, **channels: FloatArray) -> Topic:
    return Topic(
        name="t",
        time_s=time_s,
        channels=tuple(Channel(name=name, unit=STANDARD_UNITS[name]) for name in channels),
        values=np.stack(list(channels.values())),
    )


def record(*topics: Topic) -> FlightRecord:
    return FlightRecord(source=Source(name="a.ulg", format="ulog", sha256="0" * 64), topics=topics)


def between(start_s: float, stop_s: float) -> FloatArray:
    return np.asarray(((start_s <= TIME_S) & (stop_s > TIME_S)).astype(float))


def thrust(idle: float = 0.1) -> FloatArray:
    """Idle, lift-off at 220 s, hover with maneuvers, landing at 280 s."""
    rng = np.random.default_rng(0)
    flying = between(220.0, 280.0)
    return np.asarray(idle + flying * (0.4 - idle + 0.03 * rng.standard_normal(TIME_S.size)))


@pytest.mark.parametrize("idle", [0.0, 0.1, 0.15])
def test_a_flight_is_from_take_off_to_landing(idle: float) -> None:
    found = airborne(record(topic(thrust_command=thrust(idle))))
    assert found.seen_in == "thrust_command"
    assert found.longest == pytest.approx((220.0, 279.99), abs=0.03)
    (finding,) = found.findings
    assert (finding.kind, finding.severity) == ("airborne", "info")
    assert finding.numbers == pytest.approx({"start_s": 220.0, "stop_s": 279.99, "flights": 1.0}, abs=0.03)
    # Where the ground still acts, a margin is cut from each end.
    cut = airborne(record(topic(thrust_command=thrust(idle))), margin_s=1.0)
    assert cut.longest == pytest.approx((221.0, 278.99), abs=0.03)


def test_motors_stand_in_for_thrust() -> None:
    rng = np.random.default_rng(1)
    motors = {f"motor_{i}": thrust() + 0.1 * between(220.0, 280.0) * rng.standard_normal(TIME_S.size) for i in (1, 2)}
    found = airborne(record(topic(**motors)), margin_s=0.0)
    assert found.seen_in == "the mean of the motors"
    assert found.longest == pytest.approx((220.0, 279.99), abs=0.05)


@pytest.mark.parametrize("names", [("p", "q", "r"), ("ax", "ay", "az"), ("p", "az")])
def test_sensors_stand_in_for_motors(names: tuple[str, ...]) -> None:
    rng = np.random.default_rng(2)
    size = 0.01 + between(220.0, 280.0)
    rows = {name: size * rng.standard_normal(TIME_S.size) - 9.81 * (name == "az") for name in names}
    found = airborne(record(topic(**rows)), margin_s=0.0)
    assert found.seen_in.startswith("the activity of")
    # Activity is felt within half a second around.
    assert found.longest == pytest.approx((220.0, 280.0), abs=0.5)


def test_a_record_that_begins_and_ends_in_the_air_is_not_cut() -> None:
    found = airborne(record(topic(thrust_command=0.4 + 0.05 * np.sin(TIME_S))))
    assert found.longest == (TIME_S[0], TIME_S[-1])
    assert "whole record" in found.findings[0].message
    rates = {name: np.random.default_rng(3).standard_normal(TIME_S.size) for name in ("p", "q")}
    assert airborne(record(topic(**rates))).longest == (TIME_S[0], TIME_S[-1])


def test_dips_belong_to_a_flight_and_landings_do_not() -> None:
    level = 0.4 * (between(210.0, 280.0) - between(230.0, 230.9) - between(250.0, 255.0) - between(281.0, 282.0))
    found = airborne(record(topic(thrust_command=np.maximum(level, 0.0))), margin_s=0.0)
    assert np.ravel(found.intervals) == pytest.approx([210.0, 249.99, 255.0, 279.99], abs=1e-9)
    assert found.longest == found.intervals[0]
    assert found.findings[0].numbers["flights"] == 2.0


def test_missing_samples_and_disordered_stamps_do_no_harm() -> None:
    values = thrust()
    values[::5] = np.nan
    time_s = TIME_S.copy()
    time_s[500], time_s[501] = time_s[501], time_s[500]
    found = airborne(record(topic(time_s, thrust_command=values)), margin_s=0.0)
    assert found.longest == pytest.approx((220.0, 280.0), abs=0.03)


def test_a_dead_thrust_channel_is_passed_over() -> None:
    flight = record(topic(thrust_command=np.zeros(TIME_S.size), motor_1=thrust()))
    assert airborne(flight).seen_in == "the mean of the motors"


def test_no_flight_is_said() -> None:
    with pytest.raises(InsufficientDataError, match="no flight") as caught:
        airborne(record(topic(p=np.zeros(TIME_S.size))))
    assert [finding.kind for finding in caught.value.findings] == ["never_airborne"]
    with pytest.raises(InsufficientDataError, match="no flight"):
        airborne(record(topic(thrust_command=0.4 * between(230.0, 231.0) + 0.0)))
    for nothing in (record(), record(topic(phi=TIME_S)), record(topic(p=np.full(TIME_S.size, np.nan)))):
        with pytest.raises(InsufficientDataError, match="neither thrust"):
            airborne(nothing)


def test_a_record_shorter_than_a_flight_may_be_a_part_of_one() -> None:
    def cut(length_s: float, **others: FloatArray) -> FlightRecord:
        time_s = TIME_S[TIME_S[0] + length_s > TIME_S]
        angles = {"phi": 0.1 * np.sin(3.0 * time_s), "theta": 0.1 * np.cos(2.0 * time_s)}
        return record(topic(time_s, **angles, **{name: values[: time_s.size] for name, values in others.items()}))

    assert airborne(cut(2.5)).seen_in == "the activity of phi, theta"
    with pytest.raises(InsufficientDataError, match="lasts only") as caught:
        airborne(cut(1.8))
    assert not caught.value.findings
    stopped = cut(1.8, motor_1=np.zeros(TIME_S.size))
    assert [finding.kind for finding in not_flown(stopped)] == ["never_airborne"]


def test_a_thrust_around_hover_tells_nothing() -> None:
    rng = np.random.default_rng(3)
    rates = {name: 0.2 * rng.standard_normal(TIME_S.size) for name in ("p", "q")}
    sweep = 0.1 * np.sin(TIME_S) * between(230.0, 260.0)
    found = airborne(record(topic(thrust_command=sweep, **rates)))
    assert found.seen_in == "the activity of p, q"
    assert not found.by_thrust
    assert found.longest == (TIME_S[0], TIME_S[-1])


@pytest.mark.parametrize("calm", [0.1, 0.15])
def test_calm_between_sweeps_is_no_landing(calm: float) -> None:
    rng = np.random.default_rng(4)
    rates = (calm + (1.0 - calm) * between(220.0, 280.0)) * rng.standard_normal(TIME_S.size)
    assert airborne(record(topic(p=rates))).longest == (TIME_S[0], TIME_S[-1])
