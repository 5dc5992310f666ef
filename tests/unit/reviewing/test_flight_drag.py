"""Drag and wind in a review: one answer in numbers, card, document and page, and a reason where there is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.twins.tilt_flights import tilt_flights
from tests.unit.report.made_reviews import made_review

from rotorid.data.quantity import Quantity
from rotorid.data.record import FlightRecord
from rotorid.documents.review import review_document
from rotorid.flights.tilt_drag import tilt_drag
from rotorid.report.review import render_reviews
from rotorid.reviewing.cards import cards
from rotorid.reviewing.flight import flight
from rotorid.reviewing.missing import Unavailable
from rotorid.reviewing.values import FlightSummary

DRAG = {
    "drag_1_s": Quantity.normal(0.3, 0.016, "1/s"),
    "top_speed_m_s": Quantity.normal(18.9, 0.9, "m/s"),
}
WIND = {"speed_m_s": Quantity.normal(3.3, 0.16, "m/s"), "direction_deg": Quantity.normal(60.0, 5.0, "deg")}


def summary_of(record: FlightRecord) -> tuple[FlightSummary, tuple[Unavailable, ...]]:
    """The flight with its landed flag, which the made-up channels lack."""
    flying = replace(record.status, armed=((0.0, 90.0),), in_air=((0.0, 90.0),), flagged_in="landed flag")
    return flight(replace(record, status=flying))


def test_review_shows_the_drag_of_the_one_room_and_its_wind() -> None:
    (record,) = tilt_flights(1, seed=21, wind_m_s=(-3.0, 0.0), turning_rad_s=0.08, gust_m_s=0.2)
    summary, missing = summary_of(record)
    found = tilt_drag(record, summary.flights)
    assert summary.drag["drag_1_s"] == found.drag
    assert summary.drag["top_speed_m_s"] == found.top_speed()
    assert not any(gap.what in ("flight.drag", "flight.wind") for gap in missing)
    # A wind toward south comes from the north.
    assert abs((summary.wind["direction_deg"].value + 180.0) % 360.0 - 180.0) < 15.0
    assert summary.wind["speed_m_s"].lower < 3.0 < summary.wind["speed_m_s"].upper


def test_the_wind_of_the_autopilot_stays_where_the_flight_shows_no_drag() -> None:
    (record,) = tilt_flights(1, seed=21, tilt_rad=0.002, velocity_error_m_s=0.02)
    (topic,) = record.topics
    wind = {"wind_north": -2.0, "wind_east": 2.0}
    channels = tuple(replace(topic.channels[0], name=name, unit="m/s") for name in wind)
    rows = np.repeat(np.array([*wind.values()])[:, None], topic.time_s.size, axis=1)
    more = replace(topic, channels=topic.channels + channels, values=np.vstack([topic.values, rows]))
    summary, missing = summary_of(replace(record, topics=(more,)))
    assert not summary.drag
    assert summary.wind["direction_deg"].value == pytest.approx(315.0)
    (gap,) = [gap for gap in missing if gap.what == "flight.drag"]
    assert "horizontal motion" in gap.why
    assert "fly back and forth" in gap.remedy


def test_a_light_wind_has_no_direction() -> None:
    (record,) = tilt_flights(1, seed=23)
    summary, _ = summary_of(record)
    assert "speed_m_s" in summary.wind
    speed = summary.wind["speed_m_s"]
    assert ("direction_deg" in summary.wind) == (speed.std < 0.5 * np.pi * speed.value)


@pytest.mark.parametrize("blows", [True, False])
def test_card_document_and_page_say_drag_top_speed_and_wind(blows: bool) -> None:
    made = made_review()
    seen = replace(made, flight=replace(made.flight, drag=DRAG, wind=WIND if blows else {}))
    (card,) = [card for card in cards(seen) if card.key == "power"]
    assert "Drag is 0.30 ± 0.03 1/s: level flight at 30° of tilt would reach about 18.9 ± 1.8 m/s." in card.details
    assert ("The wind was 3.3 ± 0.3 m/s from 60 ± 10°." in card.details) == blows
    document = review_document(seen).model_dump(mode="json", by_alias=True)
    assert document["drag"]["drag_1_s"]["value"] == 0.3
    assert document["drag"]["top_speed_m_s"]["unit"] == "m/s"
    page = render_reviews([seen])
    assert "airspeed in level flight at 30° of tilt" in page


@pytest.mark.parametrize("known", ["battery", "throttle", "neither"])
def test_drag_is_said_where_power_is_not_known(known: str) -> None:
    made = made_review()
    seen = replace(made.flight, drag=DRAG, wind={}, thrust_to_weight=None)
    if known != "battery":
        seen = replace(seen, battery={})
    if known == "neither":
        seen = replace(seen, hover_throttle=None)
    (card,) = [card for card in cards(replace(made, flight=seen)) if card.key == "power"]
    assert "Drag is 0.30 ± 0.03 1/s" in card.details
    assert card.state == "cannot"


def test_a_review_without_drag_says_nothing_of_it() -> None:
    (card,) = [card for card in cards(made_review()) if card.key == "power"]
    assert "Drag" not in card.details
