"""A flight beside earlier ones: which logs count, what changed, and what the answer says."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from tests.twins.health_flights import Loss, flight_of

import rotorid
from rotorid.data.quantity import Quantity
from rotorid.data.record import FlightRecord
from rotorid.documents.base import to_json
from rotorid.documents.review import review_document
from rotorid.errors import UsageError
from rotorid.report.review import render_reviews
from rotorid.reviewing.baseline import compared, earlier_logs
from rotorid.reviewing.cards import cards
from rotorid.reviewing.values import Review
from rotorid.uncertainty.next_flight import next_flights

DAMAGED = 3


@cache
def healthy() -> tuple[FlightRecord, ...]:
    return tuple(flight_of("crazyflie", 1, number) for number in range(1, 6))


@cache
def damaged() -> Review:
    return rotorid.review(
        flight_of("crazyflie", 1, 6, Loss(rotor=DAMAGED, share=0.12)), models=False, baseline=healthy()
    )


@cache
def sound() -> Review:
    return rotorid.review(flight_of("crazyflie", 1, 7), models=False, baseline=healthy())


def card_of(review: Review, key: str = "motors"):  # type: ignore[no-untyped-def]
    return next(card for card in cards(review) if card.key == key)


def test_a_rotor_that_lost_thrust_is_named_with_its_usual_cause() -> None:
    found = damaged()
    assert found.baseline is not None
    assert found.baseline.balance is not None

    assert found.baseline.verdict == "changed"
    assert found.baseline.balance.motor == DAMAGED
    assert len(found.baseline.flights) == 5
    card = card_of(found)
    assert card.state == "look"
    assert card.headline.startswith(f"Motor {DAMAGED} works ")
    assert f"damaged propeller or weak motor {DAMAGED}" in card.details
    (finding,) = (one for one in found.findings if one.kind == "changed_since_earlier" and one.where == "motors")
    assert f"Motor {DAMAGED} works" in finding.message


def test_a_sound_vehicle_did_not_change_and_no_card_is_yellow() -> None:
    found = sound()
    assert found.baseline is not None

    assert found.baseline.verdict == "unchanged"
    assert found.baseline.sentences[0] == "No change found since 5 earlier flights."
    assert not [one for one in found.findings if one.kind == "changed_since_earlier"]
    assert card_of(found).state != "look"


def test_what_the_vehicle_always_had_is_no_fault() -> None:
    """An imbalance beyond that of most vehicles, in all flights alike."""

    def uneven(record: FlightRecord) -> FlightRecord:
        topics = []
        for topic in record.topics:
            names = [channel.name for channel in topic.channels]
            factor = np.array([{"motor_1": 0.5, "motor_3": 0.5}.get(name, 1.0) for name in names])
            topics.append(replace(topic, values=topic.values * factor[:, None]))
        return replace(record, topics=tuple(topics))

    alone = rotorid.review(uneven(flight_of("crazyflie", 1, 7)), models=False)
    beside = rotorid.review(uneven(flight_of("crazyflie", 1, 7)), models=False, baseline=[*map(uneven, healthy())])

    assert card_of(alone).state == "look"
    assert {one.kind for one in alone.findings} & {"motor_imbalance"}
    assert card_of(beside).state != "look"
    assert card_of(beside).headline.startswith("Balanced as in earlier flights")
    assert not {one.kind for one in beside.findings} & {"motor_imbalance", "changed_since_earlier"}


@pytest.mark.parametrize("count", [0, 1])
def test_too_few_earlier_flights_decide_nothing(count: int) -> None:
    found = rotorid.review(flight_of("crazyflie", 1, 7), models=False, baseline=healthy()[:count])
    assert found.baseline is not None

    assert found.baseline.verdict == "undecided"
    assert f"{count} earlier flight" in found.baseline.sentences[0]
    assert "3 are needed" in found.baseline.sentences[0]
    # The possible causes are still given, and none is named.
    assert card_of(found).state in ("good", "part", "cannot")


def test_document_and_page_hold_the_answer() -> None:
    document = json.loads(to_json(review_document(damaged())))["baseline"]

    assert document["verdict"] == "changed"
    assert document["balance"]["motor"] == DAMAGED
    assert document["balance"]["usual"] == f"damaged propeller or weak motor {DAMAGED}"
    assert document["figures"]["battery.hover_output_v"]["verdict"] in ("unchanged", "undecided")
    page = render_reviews([damaged()])
    assert "Since 5 earlier flights" in page
    assert f"Motor {DAMAGED} works" in page
    assert "baseline" not in json.loads(to_json(review_document(rotorid.review(healthy()[0], models=False))))


def named(record: FlightRecord, name: str, sha256: str, **more: object) -> FlightRecord:
    source = replace(record.source, name=name, sha256=sha256, **more)  # type: ignore[arg-type]
    return replace(record, source=source)


def test_only_earlier_flights_of_the_vehicle_count() -> None:
    record = healthy()[0]
    flown = named(record, "log-2025-03-05.csv", "own")
    given = [
        named(record, "log-2025-03-01.csv", "a"),
        named(record, "log-2025-03-02.csv", "b", format="PX4 ULog", firmware="PX4 1.15"),
        named(record, "log-2025-03-03.csv", "a"),
        named(record, "log-2025-03-05.csv", "own"),
        named(record, "log-2025-03-09.csv", "c"),
    ]

    found = earlier_logs(flown, given)

    assert [one.source.name for one in found.records] == ["log-2025-03-01.csv"]
    why = {one.log: one.why for one in found.left_out}
    assert why["log-2025-03-02.csv"].startswith("is from another vehicle: ")
    assert why["log-2025-03-03.csv"] == "is a copy of another"
    assert why["log-2025-03-05.csv"] == "is the log itself"
    assert why["log-2025-03-09.csv"] == "is later"


def test_a_log_in_its_own_folder_is_compared_with_those_before_it(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    for number in range(1, 5):
        rows = rng.normal(size=(50, 1))
        lines = [f"{0.1 * place:.1f},{float(row[0])!r}" for place, row in enumerate(rows)]
        (tmp_path / f"log{number}.csv").write_text("time [s],p [rad/s]\n" + "\n".join(lines), encoding="utf-8")
    (tmp_path / "log2b.csv").write_text("no log at all", encoding="utf-8")
    third = rotorid.read(tmp_path / "log3.csv")

    found = earlier_logs(third, tmp_path)

    assert [one.source.name for one in found.records] == ["log1.csv", "log2.csv"]
    why = {one.log: one.why for one in found.left_out}
    assert why["log4.csv"] == "is later"
    assert why["log2b.csv"].startswith("cannot be read: ")
    with pytest.raises(UsageError, match="does not exist"):
        earlier_logs(third, tmp_path / "nothing")


def test_flights_with_other_gains_show_no_change_of_the_loops() -> None:
    seen = sound()
    now = replace(seen, baseline=None, margins={})
    answer = compared(now, [now, now, now], gains={"P": 0.2}, earlier_gains=[{"P": 0.1}, {"P": 0.2}, {"P": 0.2}])
    assert any("other gains (P)" in sentence for sentence in answer.sentences)


def scattered(rng: np.random.Generator, count: int, spread: float) -> Callable[[], list[Quantity]]:
    return lambda: [Quantity.normal(float(np.exp(rng.normal(0.0, spread))), 0.01, "s") for _ in range(count)]


def test_a_healthy_flight_is_seldom_called_changed_over_all_figures() -> None:
    rng = np.random.default_rng(1)
    alarms = 0
    for _ in range(200):
        draw = scattered(rng, 6, 0.2)
        drawn = {f"loops.{k}.rise_time_s": draw() for k in range(20)}
        found = next_flights({name: (all_of[:-1], all_of[-1]) for name, all_of in drawn.items()}, false_alarms=0.05)
        alarms += any(one.verdict == "changed" for one in found.values())
    # 5 % are meant: 10 of 200, with three standard deviations.
    assert alarms <= 10 + 3 * 3.1
