"""The page, the document and the arrays of a review."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from tests.unit.flying.test_vehicle_from_results import result
from tests.unit.report.made_reviews import made_review, noise_map, untold_review

from rotorid.data.findings import remark
from rotorid.data.quantity import Quantity
from rotorid.data.record import FlightRecord, Source
from rotorid.documents.base import to_json
from rotorid.documents.review import ReviewDocument, review_arrays, review_document
from rotorid.errors import UsageError
from rotorid.flights.oscillations import OscillationReview
from rotorid.plot.review import motor_bars, noise_maps, png, step_answers
from rotorid.report.review import pictures_of, render_reviews
from rotorid.results.provenance import LoggedManeuver
from rotorid.results.summary import Derived, MotorPhysics
from rotorid.reviewing.assembly import _with_thrust_of, has_answers, next_commands
from rotorid.reviewing.card import Card
from rotorid.reviewing.cards import cards
from rotorid.reviewing.missing import Unavailable
from rotorid.reviewing.motors import _findings
from rotorid.reviewing.values import MotorReview, Review


def test_every_part_stands_on_the_page_with_its_interval() -> None:
    page = render_reviews([made_review()])
    for words in ("follow the stick", "phase margin", "Noise and vibration", "Not enough data"):
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


def test_margins_by_a_model_are_marked_alone_and_side_by_side() -> None:
    marked = '<span class="words">7.4 to 10.6</span><span class="words">by model</span>'
    assert render_reviews([made_review()]).count(marked) == 2
    several = render_reviews([made_review("before.ulg"), made_review("after.ulg")])
    row = several.partition("roll loop: gain margin")[2].partition("</tr>")[0]
    assert row.count(marked) == 2


def test_a_log_that_tells_nothing_still_makes_a_page() -> None:
    seen = untold_review()
    assert not has_answers(seen)
    assert "this log contains no flight" in render_reviews([seen])
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
    assert (by_key["tracking"].state, by_key["margins"].state, by_key["models"].state) == ("good", "part", "cannot")
    wild = replace(
        seen.loops["p"],
        numbers={**seen.loops["p"].numbers, "overshoot_percent": Quantity.normal(60.0, 3.0, "%")},
    )
    doubtful = replace(wild, numbers={**wild.numbers, "overshoot_percent": Quantity.normal(60.0, 30.0, "%")})
    assert {card.key: card.state for card in cards(replace(seen, loops={"p": wild}))}["tracking"] == "look"
    assert {card.key: card.state for card in cards(replace(seen, loops={"p": doubtful}))}["tracking"] == "cannot"


def margins_of(**numbers: Quantity) -> Review:
    """A review whose roll loop has some numbers, beside a pitch loop that is good."""
    seen = made_review()
    return replace(seen, margins={**seen.margins, "roll": replace(seen.margins["roll"], numbers=numbers)})


def card_of(review: Review, key: str) -> Card:
    return next(card for card in cards(review) if card.key == key)


def test_a_loop_is_called_safe_only_where_its_whole_interval_is() -> None:
    wide = Quantity(value=26.3, std=28.4, lower=-7.4, upper=104.1, unit="deg")
    unsure = card_of(margins_of(phase_margin_deg=wide), "margins")
    assert (unsure.state, unsure.number) == ("cannot", "roll phase margin 30° (−10 to 100°)")
    assert "roll" in unsure.sentence
    assert "To measure it: move the roll stick for 30 s" in unsure.sentence
    narrow = card_of(margins_of(phase_margin_deg=Quantity.normal(60.0, 2.0, "deg")), "margins")
    assert narrow.state == "part"
    assert "Not measured: yaw and peak sensitivity M_s of roll." in narrow.sentence
    peak = card_of(
        margins_of(phase_margin_deg=Quantity.normal(60.0, 2.0, "deg"), sensitivity_peak=Quantity.normal(1.9, 0.2, "1")),
        "margins",
    )
    assert (peak.state, peak.number) == ("cannot", "roll M_s 1.9 ± 0.4")


def test_what_would_tell_a_margin_is_what_the_flight_lacks() -> None:
    review = margins_of(phase_margin_deg=Quantity.normal(40.0, 9.0, "deg"))
    lacking = Unavailable(what="margins.roll.sensitivity_peak", why="Too slow.", remedy="log commands and rates faster")
    assert (
        "To measure it: log commands and rates faster."
        in card_of(replace(review, cannot_tell=(lacking,)), "margins").sentence
    )


def test_number_and_sentence_of_the_margins_are_of_the_worst_loop() -> None:
    seen = margins_of(phase_margin_deg=Quantity.normal(38.0, 1.2, "deg"))
    loud = replace(
        seen.margins["pitch"],
        numbers={**seen.margins["pitch"].numbers, "sensitivity_peak": Quantity.normal(2.5, 0.2, "1")},
    )
    told = card_of(replace(seen, margins={**seen.margins, "pitch": loud}), "margins")
    assert (told.state, told.number) == ("look", "pitch M_s 2.5 ± 0.4")
    assert told.headline == "The pitch loop amplifies some disturbances 2.5 ± 0.4 times."
    worse = margins_of(phase_margin_deg=Quantity.normal(12.0, 1.0, "deg"))
    told = card_of(replace(worse, margins={**worse.margins, "pitch": loud}), "margins")
    assert told.number == "roll phase margin 12.0 ± 2.0°"
    assert told.sentence.startswith("The roll loop")


def test_motors_are_well_only_as_far_as_it_was_measured() -> None:
    seen = made_review()
    share = Quantity(value=0.0, std=0.0, lower=0.0, upper=0.001, unit="1")
    untold = Unavailable(what="motors.imbalance", why="It hovered for 0 s only.", remedy="hover for 20 s")
    flown = replace(
        seen, motors=MotorReview(numbers={"saturated_high_share": share}), cannot_tell=(untold, *seen.cannot_tell)
    )
    told = card_of(flown, "motors")
    assert told.state == "cannot"
    assert told.sentence == "It hovered for 0 s only. To measure it: hover for 20 s."
    assert card_of(replace(seen, motors=MotorReview(numbers={"output_delay_s": share})), "motors").state == "cannot"
    even = card_of(seen, "motors")
    assert (even.state, even.number) == ("part", "5.0 ± 1.2 % imbalance")
    assert even.sentence.startswith("Balanced, with 50 % headroom in hover. Desync was not checked. Not measured: ")
    wide = {**seen.motors.numbers, "imbalance": Quantity.normal(0.28, 0.03, "1")}
    assert card_of(replace(seen, motors=MotorReview(numbers=wide)), "motors").state == "cannot"


@pytest.mark.parametrize("share", [0.03, 0.08])
def test_the_card_of_the_motors_and_their_findings_say_one_thing(share: float) -> None:
    # Few long stretches at the limit: the mean over the flight is not sure, what was counted is.
    high = Quantity(value=share, std=0.066, lower=0.0, upper=0.2, unit="1")
    seen = made_review()
    motors = replace(seen.motors, numbers={**seen.motors.numbers, "saturated_high_share": high})
    warned = [finding for finding in _findings(motors) if finding.kind == "saturation"]
    card = card_of(replace(seen, motors=motors), "motors")
    assert (card.state == "look") == bool(warned) == (share > 0.05)
    assert f"at full output for {100.0 * share:.1f} % of the flight" in card.sentence


def test_noise_that_was_not_measured_is_not_called_low() -> None:
    seen = made_review()
    lines = card_of(replace(seen, noise=replace(seen.noise, numbers={})), "noise")
    assert (lines.state, lines.number) == ("cannot", "")
    wide = {"vibration_m_s2": Quantity.normal(28.0, 5.0, "m/s²")}
    assert card_of(replace(seen, noise=replace(seen.noise, numbers=wide)), "noise").state == "cannot"
    quiet = {f"{axis}_d_noise_share": Quantity.normal(0.005, 0.0005, "1") for axis in ("roll", "pitch")}
    passed = card_of(replace(seen, noise=replace(seen.noise, numbers=quiet)), "noise")
    assert passed.state == "part"
    assert passed.headline.startswith("Vibration was not measured")
    assert "little noise reaches the motors" in passed.headline.lower()
    low = card_of(seen, "noise")
    assert low.state == "part"
    assert low.sentence.startswith("Vibration is low. Not measured: accelerometer at its limits and noise through D of")


def test_power_prints_the_interval_of_the_thrust() -> None:
    seen = made_review()
    assert card_of(seen, "power").measured == "full thrust 2.1 ± 0.4 times the weight (above 1.5 is fine)"
    skewed = Quantity(value=3.0, std=0.3, lower=1.83, upper=4.27, unit="1")
    told = card_of(replace(seen, flight=replace(seen.flight, thrust_to_weight=skewed)), "power")
    assert told.number == "full thrust 3.0 ± 1.2 times the weight"
    little = replace(skewed, value=1.6, lower=1.2, upper=2.4)
    told = card_of(replace(seen, flight=replace(seen.flight, thrust_to_weight=little)), "power")
    assert told.state == "cannot"
    assert told.measured == "full thrust 1.6 (1.2 to 2.4) times the weight (the limit is 1.5)"


def log_of(form: str, **parameters: float) -> FlightRecord:
    """A log of an autopilot; what a review says of it comes from the review."""
    source = Source(name="my flight.ulg", format=form, sha256="")
    return FlightRecord(source=source, topics=(), parameters=parameters)


def test_nothing_more_is_asked_of_loops_that_swing() -> None:
    swing = OscillationReview(axis="roll", loop="rate", frequency_hz=22.9, rms=0.54, at_limit_percent=98.2)
    seen = replace(made_review("my flight.ulg"), models={})
    assert next_commands(log_of("PX4 ULog"), seen)
    assert not next_commands(log_of("PX4 ULog"), replace(seen, oscillations=(swing,)))


def test_next_commands_can_be_pasted() -> None:
    commands = next_commands(log_of("PX4 ULog"), replace(made_review("my flight.ulg"), models={}))
    assert "'my flight.ulg'" in " ".join(commands)
    assert any(command.startswith("rotorid design sweep --vehicle px4_quad --axis") for command in commands)


@pytest.mark.parametrize(
    ("form", "craft"),
    [
        ("ArduPilot DataFlash", "ardupilot_quad"),
        ("Betaflight blackbox", "betaflight_quad"),
        ("Crazyflie uSD", "crazyflie"),
    ],
)
def test_a_flight_is_planned_for_the_autopilot_of_the_log(form: str, craft: str) -> None:
    seen = replace(made_review(), models={})
    commands = next_commands(log_of(form), seen)
    assert [one for one in commands if one.startswith(f"rotorid design sweep --vehicle {craft} --axis")]


def test_models_that_were_not_looked_for_are_not_said_to_be_impossible() -> None:
    seen = replace(made_review(), models_sought=False)
    assert card_of(seen, "models").sentence == "Models were not identified (--no-models)."
    assert not [command for command in next_commands(log_of("PX4 ULog"), seen) if "design sweep" in command]


def test_full_thrust_is_that_of_the_model_where_one_tells_it() -> None:
    model = result("physical.motors", {"tau": 0.04})
    derived = {"thrust_to_weight": Derived(value=2.018, std=0.021, unit="1")}
    physics = MotorPhysics(
        layout="quad x",
        arm_m=None,
        rotors=(),
        spins=(),
        outputs="output",
        source="actuator_motors",
        outputs_rate_hz=250.0,
        curve="expo",
        hover_output=0.49,
        flown_outputs=(0.2, 0.7),
        scale=None,
        derived=derived,
    )
    summary = made_review().flight
    untold = [
        Unavailable(what="flight.thrust_to_weight", why="Not seen."),
        Unavailable(what="flight.wind", why="None."),
    ]
    told, left = _with_thrust_of({"physical.motors": replace(model, motors=physics)}, summary, untold)
    assert told.thrust_to_weight == Quantity.normal(2.018, 0.021, "1")
    assert [one.what for one in left] == ["flight.wind"]
    assert _with_thrust_of({"rate.roll": model}, summary, untold) == (summary, untold)


def test_pictures_of_broken_loops_name_their_axis_and_state_95_percent() -> None:
    figures = pictures_of([made_review()])
    for axis, margin, at in (("roll", "75.6", "21.0"), ("pitch", "78.3", "17.0")):
        figure = figures[f"broken-{axis}"]
        labels = [label["text"] for label in figure["layout"]["annotations"]]
        assert all(label.startswith(f"{axis.capitalize()}: ") for label in labels)
        (name,) = [trace["name"] for trace in figure["data"] if "phase margin" in trace.get("name", "")]
        assert name.startswith(f"phase margin {margin}° (")
        # Half a rad/s of standard deviation is one of half an interval.
        assert f"at {at} rad/s ({float(at) - 1.0:.1f} to {float(at) + 1.0:.1f})" in name


def test_a_broken_loop_is_drawn_where_it_is_seen_alone() -> None:
    seen = made_review()
    one = seen.margins["roll"]
    omega = one.loop.omega_rad_s
    # Above 40 rad/s there is nothing but noise.
    noisy = replace(one.loop, random_error=np.where(omega > 40.0, 0.6, one.loop.random_error))
    figure = pictures_of([replace(seen, margins={"roll": replace(one, loop=noisy)})])["broken-roll"]
    drawn = np.concatenate([np.asarray(trace["x"], dtype=float) for trace in figure["data"]])
    assert omega[-1] > 60.0
    assert 30.0 < drawn.max() <= 40.0


def test_no_internal_names_stand_on_the_page() -> None:
    seen = made_review()
    share = Quantity(value=0.012, std=0.004, lower=0.004, upper=0.02, unit="1")
    motors = replace(seen.motors, numbers={**seen.motors.numbers, "saturated_by_roll_share": share})
    names = ("noise.roll_p_noise_share", "loops.p.step", "models.physical.motors", "margins.yaw", "vehicle.kind")
    skew = remark("clock_skew", "p", "p is 5 ms late.", known_low_s=0.0, known_high_s=0.0)
    page = render_reviews(
        [
            replace(
                seen,
                motors=motors,
                findings=(skew,),
                cannot_tell=tuple(
                    Unavailable(what=name, why=f"{name} came.".replace(name, "Nothing")) for name in names
                ),
            )
        ]
    )
    for name in (*names, "models.physical: motors", "saturated by", "known_low_s"):
        assert name not in page
    for words in ("time with a motor at a limit while roll asked for most [%]", "model physical.motors", "1.2"):
        assert words in page
    assert "noise through P of roll" in page


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
