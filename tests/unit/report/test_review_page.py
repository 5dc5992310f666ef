"""The page, the document and the arrays of a review."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from tests.unit.pipeline.test_joined import result
from tests.unit.report.made_reviews import made_review, noise_map, untold_review

from rotorid.data.quantity import Quantity
from rotorid.documents.base import to_json
from rotorid.documents.review import ReviewDocument, review_arrays, review_document
from rotorid.errors import UsageError
from rotorid.pipeline.provenance import LoggedManeuver
from rotorid.pipeline.review.cards import cards
from rotorid.pipeline.review.review import next_commands, told_anything
from rotorid.plot.review import motor_bars, noise_maps, png, step_answers
from rotorid.report.review import render_reviews


def test_every_part_stands_on_the_page_with_its_interval() -> None:
    page = render_reviews([made_review()])
    for words in ("follow the stick", "phase margin", "Noise and vibration", "What this flight cannot tell"):
        assert words in page
    assert "21.6 to 22.4" in page  # bandwidth at -90 degrees of roll
    assert "The yaw stick rested." in page
    assert "rotorid identify flight.ulg --model rate.roll,rate.pitch" in page
    assert page.count('aria-roledescription="picture"') == len(re.findall(r'data-picture="[^"]+"', page))


def test_names_of_a_log_are_text_and_nothing_else() -> None:
    page = render_reviews([replace(made_review(), name="<script>alert(1)</script>.ulg")])
    assert "<script>alert(1)" not in page


def test_two_flights_stand_side_by_side() -> None:
    page = render_reviews([made_review("before.ulg"), made_review("after.ulg")])
    assert "Side by side" in page
    assert page.count("roll rate: rise time") == 1
    assert page.index("before.ulg") < page.index("after.ulg")


def test_a_log_that_tells_nothing_still_makes_a_page() -> None:
    seen = untold_review()
    assert not told_anything(seen)
    assert "this log holds no flight" in render_reviews([seen])
    assert {card.state for card in cards(seen)} >= {"cannot"}
    with pytest.raises(UsageError, match="no review"):
        render_reviews([])


def test_document_has_the_keys_that_scripts_rely_on_and_no_gaps() -> None:
    told = json.loads(to_json(review_document(made_review())))
    assert told["schema"] == "rotorid.review/1"
    assert told["flights"] == [{"start_s": 12.0, "stop_s": 95.5}]
    loop = told["loops"]["p"]
    assert loop["rise_time_s"].keys() == {"value", "std", "lower", "upper", "unit"}
    assert loop["estimate"] == "joint"
    assert "peak_db" not in loop
    assert told["margins"]["roll"]["by_model"] == ["gain_margin_db"]
    assert told["cannot_tell"][0].keys() == {"what", "why", "remedy"}
    assert "wind" in told
    assert "thrust_to_weight" in told
    assert ReviewDocument.model_validate(told).loops["p"].rise_time_s is not None


def test_an_interval_without_an_end_is_null() -> None:
    seen = made_review()
    open_ended = Quantity(value=3.0, std=1.0, lower=1.0, upper=float("inf"), unit="dB")
    margin = replace(seen.margins["roll"], numbers={"gain_margin_db": open_ended})
    seen = replace(seen, margins={"roll": margin})
    told = json.loads(to_json(review_document(seen)))
    assert told["margins"]["roll"]["gain_margin_db"]["upper"] is None
    assert "1.0 to ∞" in render_reviews([seen])


def test_arrays_hold_steps_responses_and_maps() -> None:
    arrays = review_arrays(made_review())
    assert arrays["step_p_time_s"].shape == arrays["step_p_upper"].shape
    assert arrays["loop_p_values"].dtype == np.complex128
    assert any(name.startswith("noise_p_before") for name in arrays)


def test_cards_judge_by_what_is_sure() -> None:
    seen = made_review()
    by_key = {card.key: card for card in cards(seen)}
    assert (by_key["tracking"].state, by_key["margins"].state, by_key["models"].state) == ("good", "good", "cannot")
    wild = replace(
        seen.loops["p"],
        numbers={**seen.loops["p"].numbers, "overshoot_percent": Quantity.normal(60.0, 3.0, "%")},
    )
    doubtful = replace(wild, numbers={**wild.numbers, "overshoot_percent": Quantity.normal(60.0, 30.0, "%")})
    assert {card.key: card.state for card in cards(replace(seen, loops={"p": wild}))}["tracking"] == "look"
    assert {card.key: card.state for card in cards(replace(seen, loops={"p": doubtful}))}["tracking"] == "good"


def test_next_commands_can_be_pasted() -> None:
    commands = list(next_commands(replace(made_review("my flight.ulg"), models={})))
    assert "'my flight.ulg'" in " ".join(commands)
    assert any(command.startswith("rotorid design sweep --vehicle px4_quad --axis") for command in commands)


def test_a_map_is_drawn_with_the_strongest_noise_brightest_and_grey_where_nothing_flew() -> None:
    one = noise_map("before")
    figure = noise_maps({"roll gyro before the filters": one}, against="throttle", unit="(°/s)²/Hz")
    (image,) = figure["layout"]["images"]
    assert image["source"].startswith("data:image/png;base64,")
    # The picture spans the bins that were flown, from their lower to their upper edges.
    assert image["y"] == pytest.approx(0.92)
    assert image["sizey"] == pytest.approx(0.92 - 0.2)
    with pytest.raises(UsageError, match="no noise"):
        noise_maps({}, against="throttle", unit="")


def test_a_png_is_one() -> None:
    import base64
    import struct

    data = base64.b64decode(png(np.zeros((3, 5, 4), dtype=np.uint8)).partition(",")[2])
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    assert struct.unpack(">II", data[16:24]) == (5, 3)


def test_pictures_need_something_to_show() -> None:
    with pytest.raises(UsageError, match="no step response"):
        step_answers({})
    assert motor_bars({"motor 1": (0.4, 0.01), "motor 2": (0.5, 0.01)})["layout"]["shapes"][0]["y0"] == 0.45


@pytest.mark.parametrize(("kind", "asked"), [("other", True), ("sweep", False), ("multisine", False)])
def test_a_swept_flight_is_not_asked_for_a_sweep(kind: Literal["other", "sweep", "multisine"], asked: bool) -> None:
    model = result("rate.roll", {"L_p": -1.0})
    maneuver = LoggedManeuver(axis="roll", kind=kind, start_s=1.0, stop_s=9.0, record="flight.ulg")
    model = replace(model, provenance=replace(model.provenance, maneuvers=(maneuver,)))
    review = replace(made_review(), models={"rate.roll": model})
    assert ("Without a sweep" in render_reviews([review])) == asked
    # The page and its first screen say one thing.
    (sentence,) = [card.sentence for card in cards(review) if card.key == "models"]
    assert ("A sweep would make them" in sentence) == asked


def test_a_page_links_to_the_files_of_its_review() -> None:
    page = render_reviews([made_review()])
    assert 'href="review.json"' in page
    assert 'href="review.npz"' in page
    several = render_reviews([made_review("a.ulg"), made_review("b.ulg")])
    assert 'href="review-2.npz"' in several
    assert 'href="review.npz"' not in several
