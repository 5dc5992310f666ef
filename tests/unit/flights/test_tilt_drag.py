"""Drag and wind from tilt, velocity and specific force: the truth of flights that were made up, and refusals."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from tests.twins.tilt_flights import tilt_flights

from rotorid.data.quantity import Quantity
from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Topic
from rotorid.errors import InsufficientDataError
from rotorid.flights.tilt_drag import TiltDrag, tilt_drag, tilt_drag_of, top_speed

WHOLE = ((0.0, 90.0),)


def found_in(records: list[FlightRecord]) -> list[TiltDrag]:
    return [tilt_drag(record, WHOLE) for record in records]


def deviations(found: list[TiltDrag], number: Callable[[TiltDrag], Quantity | None], truth: float) -> np.ndarray:
    known = [quantity for one in found if (quantity := number(one)) is not None]
    return np.array([(quantity.value - truth) / quantity.std for quantity in known])


def without(record: FlightRecord, name: str) -> FlightRecord:
    (topic,) = record.topics
    kept = [place for place, channel in enumerate(topic.channels) if channel.name != name]
    channels = tuple(topic.channels[place] for place in kept)
    return replace(record, topics=(replace(topic, channels=channels, values=topic.values[kept]),))


def test_drag_and_wind_of_flights_in_gusts_come_back() -> None:
    found = found_in(tilt_flights(16, seed=11, wind_m_s=(3.0, -2.0), gust_m_s=0.6, turning_rad_s=0.06, bias_m_s2=0.2))
    numbers = ((lambda one: one.drag, 0.3), (lambda one: one.wind_north, 3.0), (lambda one: one.wind_east, -2.0))
    each = np.concatenate([deviations(found, number, truth) for number, truth in numbers])
    # Of 48 intervals that contain the truth in nine of ten, 39 and more with a chance of 98 %.
    assert np.count_nonzero(np.abs(each) < 1.96) >= 39
    assert float(np.sqrt(np.mean(each[:16] ** 2))) < 1.4
    assert np.median([one.drag.std for one in found]) < 0.06 * 0.3 + 0.005


def test_errors_of_the_velocity_spoil_plain_regression_and_not_the_instrument() -> None:
    found = found_in(tilt_flights(12, seed=3, tilt_rad=0.05, stick_s=1.0, velocity_error_m_s=0.6))
    assert np.mean([one.drag.value for one in found]) == pytest.approx(0.3, rel=0.04)
    assert np.mean([one.plain.value for one in found]) < 0.25
    assert np.max(np.abs(deviations(found, lambda one: one.drag, 0.3))) < 3.0
    telling = [one for one in found if not one.agrees]
    assert len(telling) >= 6
    (finding,) = telling[0].findings()
    assert finding.kind == "both_ways_disagree"
    assert finding.numbers == {"drag_1_s": telling[0].drag.value, "plain_1_s": telling[0].plain.value}


def test_rotors_that_carry_more_turn_faster_and_drag_by_that_more() -> None:
    """A course with a load of 0.8 to 2 g that is larger where it goes ahead: drag of one g, and no wind of its own."""
    time_s = np.arange(0.0, 90.0, 0.02)
    forward, side = (2.0 * np.sin(1.2 * time_s) + np.cos(0.7 * time_s), 2.0 * np.cos(0.9 * time_s))
    load = 1.4 + 0.6 * np.sin(1.2 * time_s + 0.4)
    drag = 0.3 * np.sqrt(load)
    theta = -np.arcsin((np.gradient(forward, time_s) + drag * forward) / 9.80665)
    phi = np.arcsin((np.gradient(side, time_s) + drag * side) / 9.80665)
    none = np.zeros_like(time_s)
    rows = {"ax": -drag * forward, "ay": -drag * side, "az": -9.80665 * load, "phi": phi, "theta": theta, "psi": none}
    rows |= {"u": forward, "v": side}
    channels = tuple(Channel(name=name, unit=STANDARD_UNITS[name]) for name in rows)
    topic = Topic(name="all", time_s=time_s, channels=channels, values=np.stack(list(rows.values())))
    record = FlightRecord(source=Source(name="load.csv", format="CSV", sha256=""), topics=(topic,))
    found = tilt_drag(record, WHOLE)
    assert found.drag.value == pytest.approx(0.3, rel=0.003)
    assert found.wind_north is not None
    assert abs(found.wind_north.value) < 0.01
    # Where the load is not logged, it counts as one g.
    blind = tilt_drag(without(record, "az"), WHOLE)
    assert blind.drag.value > 0.34
    assert blind.wind_north is not None
    assert abs(blind.wind_north.value) > 0.2


def test_a_small_difference_or_one_within_an_error_is_no_disagreement() -> None:
    (found,) = found_in(tilt_flights(1, seed=2))
    sure = replace(found, drag=Quantity.normal(0.3, 0.02, "1/s"), difference_std=0.001)
    assert replace(sure, plain=Quantity.normal(0.285, 0.001, "1/s")).agrees
    apart = replace(sure, plain=Quantity.normal(0.25, 0.02, "1/s"))
    (finding,) = apart.findings()
    # 95 %, as a card has them.
    assert "Drag is 0.30 ± 0.04 1/s with the tilt as instrument and 0.25 ± 0.04 1/s by plain" in finding.message
    assert "The difference is 0.050 ± 0.013 1/s" in finding.message
    assert replace(apart, difference_std=0.03).agrees


def test_an_accelerometer_off_the_center_of_gravity_does_not_count_as_drag() -> None:
    found = found_in(tilt_flights(12, seed=5, tilt_rad=0.06, stick_s=1.0, height_m=-0.05))
    assert np.max(np.abs(deviations(found, lambda one: one.drag, 0.3))) < 3.0
    assert np.mean([one.height.value for one in found]) == pytest.approx(-0.05, abs=0.004)


def test_drag_that_grows_with_the_square_and_logs_in_different_winds() -> None:
    made = {"drag_1_s": 0.2, "square_1_m": 0.04, "tilt_rad": 0.2, "stick_s": 3.0}
    calm = tilt_flights(8, seed=6, **made)  # type: ignore[arg-type]
    windy = tilt_flights(8, seed=7, **made, wind_m_s=(3.0, 1.0), turning_rad_s=0.1)  # type: ignore[arg-type]
    together = [tilt_drag_of([(one, WHOLE), (other, WHOLE)]) for one, other in zip(calm, windy, strict=True)]
    for number, truth in ((lambda one: one.at_rest, 0.2), (lambda one: one.quadratic, 0.04)):
        each = deviations(together, number, truth)
        assert each.size == 8
        assert np.max(np.abs(each)) < 3.0
    known = [one.quadratic.std for one in together if one.quadratic is not None]
    assert np.median(known) < 0.003
    # (d + c V cos) V cos = g sin.
    along = 0.5 * (math.sqrt(0.2**2 + 4.0 * 0.04 * 0.5 * 9.80665) - 0.2) / 0.04
    top = together[0].top_speed()
    assert top.lower < along / math.cos(math.radians(30.0)) < top.upper
    assert top.std < 0.06 * top.value


def test_a_drag_in_proportion_gives_the_tangent_of_the_tilt() -> None:
    (found,) = found_in(tilt_flights(1, seed=2))
    known = replace(found, at_rest=None, quadratic=None)
    top = known.top_speed(math.radians(30.0))
    assert top.value == pytest.approx(9.80665 * math.tan(math.radians(30.0)) / found.drag.value)
    assert top.upper == pytest.approx(9.80665 * math.tan(math.radians(30.0)) / found.drag.lower)
    # Beyond the airspeed that was flown, drag may grow with the square.
    square = found.drag.upper / found.airspeed_m_s[1]
    along = top.lower * math.cos(math.radians(30.0))
    assert square * along**2 == pytest.approx(9.80665 * math.sin(math.radians(30.0)))
    assert found.airspeed_m_s[1] < top.lower < top.value < top.upper


def test_a_top_speed_that_was_flown_is_as_sure_as_its_drag() -> None:
    top = top_speed(Quantity.normal(0.3, 0.003, "1/s"), 25.0)
    assert top.lower == pytest.approx(top.value, rel=0.03)


def test_a_vehicle_that_turns_at_speed_leans_into_the_turn_and_shows_its_drag() -> None:
    records = tilt_flights(8, seed=9, tilt_rad=0.25, stick_s=5.0, turning_rad_s=0.4, duration_s=60.0)
    found = [tilt_drag(record, ((0.0, 60.0),)) for record in records]
    assert min(one.correlation for one in found) > 0.8
    assert max(one.airspeed_m_s[1] for one in found) > 6.0
    assert np.max(np.abs(deviations(found, lambda one: one.drag, 0.3))) < 3.0
    assert np.median([one.drag.std for one in found]) < 0.015


@pytest.mark.parametrize(
    ("made", "words", "fewest"),
    [
        ({"tilt_rad": 0.005, "velocity_error_m_s": 0.02}, "horizontal motion", 6),
        ({"tilt_rad": 0.004, "velocity_error_m_s": 0.6}, "follows the tilt", 6),
        ({"tilt_rad": 0.025, "gust_m_s": 0.9}, "error below 25 %", 3),
    ],
)
def test_a_flight_that_does_not_show_drag_is_not_enough_data(made: dict[str, float], words: str, fewest: int) -> None:
    refused = []
    for record in tilt_flights(6, seed=8, wind_m_s=(2.0, 0.0), **made):  # type: ignore[arg-type]
        try:
            tilt_drag(record, WHOLE)
        except InsufficientDataError as error:
            refused.append(error)
    assert len(refused) >= fewest
    assert any(words in str(error) for error in refused)
    assert all("fly back and forth" in error.remedy for error in refused)


@pytest.mark.parametrize("name", ["ax", "phi", "psi", "velocity_east"])
def test_a_missing_channel_is_named(name: str) -> None:
    (record,) = tilt_flights(1, seed=2)
    with pytest.raises(InsufficientDataError, match=f"lacks {name}"):
        tilt_drag(without(record, name), WHOLE)


def test_short_flights_and_dead_accelerometers_show_no_drag() -> None:
    (record,) = tilt_flights(1, seed=2)
    with pytest.raises(InsufficientDataError, match="0 s in the air"):
        tilt_drag(record, ((0.0, 12.0),))
    (topic,) = record.topics
    dead = np.array([[channel.name not in ("ax", "ay", "az")] for channel in topic.channels])
    broken = replace(record, topics=(replace(topic, values=topic.values * dead),))
    with pytest.raises(InsufficientDataError, match="specific force"):
        tilt_drag(broken, WHOLE)
