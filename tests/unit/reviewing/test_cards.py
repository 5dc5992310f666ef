"""Cards of a review: green only where everything that their question covers was measured and is good."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
from tests.unit.flying.test_vehicle_from_results import result
from tests.unit.report.made_reviews import made_review, margin

from rotorid.data.findings import warn
from rotorid.data.quantity import Quantity
from rotorid.results.model import IdentifiedModel, Refused
from rotorid.results.summary import Cost
from rotorid.reviewing.card import STATES, Card
from rotorid.reviewing.cards import cards
from rotorid.reviewing.missing import Unavailable
from rotorid.reviewing.values import Review
from rotorid.tuning.judging import Breaking, LoopVerdict, Verdict

MODELS = ("rate.roll", "rate.pitch")


def measured() -> Review:
    """A flight that shows everything, and everything is good."""
    seen = made_review()
    counted = Quantity(value=0.0, std=0.0, lower=0.0, upper=1e-4, unit="1")
    noise = {
        **seen.noise.numbers,
        "clipping_share": counted,
        **{f"{axis}_d_noise_share": Quantity.normal(0.005, 0.0005, "1") for axis in ("roll", "pitch", "yaw")},
    }
    motors = {**seen.motors.numbers, "saturated_high_share": counted}
    battery = {**seen.flight.battery, "sag_v": Quantity.normal(0.6, 0.05, "V")}
    return replace(
        seen,
        margins={**seen.margins, "yaw": margin("yaw", 12.0)},
        calm=("roll", "pitch", "yaw"),
        noise=replace(seen.noise, numbers=noise),
        motors=replace(seen.motors, numbers=motors, steps_checked=True),
        flight=replace(seen.flight, battery=battery),
        models={name: fitted(name) for name in MODELS},
    )


def fitted(name: str) -> IdentifiedModel:
    model = result(name, {"L_p": -1.0})
    return replace(model, fit=replace(model.fit, cost=Cost(average=0.4, pairs={})))


def without(numbers: object, *names: str) -> dict[str, Quantity]:
    assert isinstance(numbers, dict) or hasattr(numbers, "items")
    return {name: one for name, one in numbers.items() if name not in names}  # type: ignore[attr-defined]


def loop_without(loop: str, *names: str) -> Callable[[Review], Review]:
    def change(seen: Review) -> Review:
        one = seen.loops[loop]
        return replace(seen, loops={**seen.loops, loop: replace(one, numbers=without(one.numbers, *names))})

    return change


def margin_without(axis: str, *names: str) -> Callable[[Review], Review]:
    def change(seen: Review) -> Review:
        one = seen.margins[axis]  # type: ignore[index]
        return replace(seen, margins={**seen.margins, axis: replace(one, numbers=without(one.numbers, *names))})

    return change


def by_gusts(axis: str) -> Callable[[Review], Review]:
    return lambda seen: replace(
        seen,
        margins={**seen.margins, axis: replace(seen.margins[axis], stick_idle=True)},  # type: ignore[index]
    )


def not_calm(axis: str) -> Callable[[Review], Review]:
    return lambda seen: replace(seen, calm=tuple(one for one in seen.calm if one != axis))


def noise_without(*names: str) -> Callable[[Review], Review]:
    return lambda seen: replace(seen, noise=replace(seen.noise, numbers=without(seen.noise.numbers, *names)))


def motors_without(*names: str) -> Callable[[Review], Review]:
    return lambda seen: replace(seen, motors=replace(seen.motors, numbers=without(seen.motors.numbers, *names)))


def refused(name: str) -> Callable[[Review], Review]:
    def change(seen: Review) -> Review:
        no = Refused(name=name, structure=None, findings=(), provenance=seen.models[name].provenance)
        return replace(seen, models={**seen.models, name: no})

    return change


def follows_the_data_only(seen: Review) -> Review:
    missed = warn("structure_error", "p/roll_command", "It misses.", model_error_percent=18.0)
    return replace(seen, models={**seen.models, "rate.roll": replace(seen.models["rate.roll"], findings=(missed,))})


def misses_unseen_flight(seen: Review) -> Review:
    missed = warn("poor_verification", "p/roll_command", "It misses.", cost=170.0)
    return replace(seen, models={**seen.models, "rate.roll": replace(seen.models["rate.roll"], findings=(missed,))})


PIECES: list[tuple[str, str, Callable[[Review], Review]]] = [
    *[("tracking", "loop", lambda seen, gone=gone: replace(seen, loops=without(seen.loops, gone))) for gone in "pq"],
    *[("tracking", "overshoot", loop_without(loop, "overshoot_percent")) for loop in "pq"],
    *[("margins", "axis", lambda seen, axis=axis: replace(seen, margins=without(seen.margins, axis)))
      for axis in ("roll", "pitch", "yaw")],
    *[("margins", "phase", margin_without(axis, "phase_margin_deg")) for axis in ("roll", "pitch", "yaw")],
    *[("margins", "M_s", margin_without(axis, "sensitivity_peak")) for axis in ("roll", "pitch", "yaw")],
    *[("margins", "gusts", by_gusts(axis)) for axis in ("roll", "pitch", "yaw")],
    *[("margins", "calm", not_calm(axis)) for axis in ("roll", "pitch", "yaw")],
    ("noise", "vibration", noise_without("vibration_m_s2")),
    ("noise", "clipping", noise_without("clipping_share")),
    ("noise", "D of roll", noise_without("roll_d_noise_share")),
    ("noise", "D of pitch", noise_without("pitch_d_noise_share")),
    ("motors", "imbalance", motors_without("imbalance")),
    ("motors", "headroom", motors_without("headroom")),
    ("motors", "limit", motors_without("saturated_high_share")),
    ("power", "thrust", lambda seen: replace(seen, flight=replace(seen.flight, thrust_to_weight=None))),
    ("power", "sag", lambda seen: replace(
        seen, flight=replace(seen.flight, battery=without(seen.flight.battery, "sag_v")))),
    *[("models", "refused", refused(name)) for name in MODELS],
    ("models", "data only", follows_the_data_only),
    ("models", "unseen", misses_unseen_flight),
    ("models", "not sought", lambda seen: replace(seen, models_sought=False)),
]  # fmt: skip
"""Card, what of its question is taken away, and how."""


def states(seen: Review) -> dict[str, str]:
    return {card.key: card.state for card in cards(seen)}


def test_everything_that_was_measured_and_is_good_is_green() -> None:
    assert set(states(measured()).values()) == {"good"}


@pytest.mark.parametrize(("key", "piece", "change"), PIECES, ids=[f"{key}-{what}" for key, what, _ in PIECES])
def test_no_card_is_green_without_a_part_of_its_question(
    key: str, piece: str, change: Callable[[Review], Review]
) -> None:
    before, after = states(measured()), states(change(measured()))
    assert after[key] in ("part", "cannot"), piece
    # Others do not change: nothing is asked twice. Filters are right only where margins are known.
    asks = {key, "filters"} if key == "margins" and piece != "calm" else {key}
    assert after["filters"] == ("part" if "filters" in asks else "good")
    assert {name: state for name, state in after.items() if name not in asks} == {
        name: state for name, state in before.items() if name not in asks
    }


def card(seen: Review, key: str) -> Card:
    return next(one for one in cards(seen) if one.key == key)


def test_a_part_names_what_is_missing_and_is_gray() -> None:
    part = card(by_gusts("yaw")(measured()), "margins")
    assert (part.state, part.word, part.color) == ("part", "good in part", "gray")
    assert part.headline == "The roll and pitch loops are far from oscillation."
    assert part.details == "Yaw does not oscillate. Not measured: yaw (its stick barely moved)."


def test_only_what_is_good_is_green() -> None:
    assert {state for state, (_, color) in STATES.items() if color == "green"} == {"good"}
    assert {STATES[state][1] for state in ("part", "cannot")} == {"gray"}


def test_bad_goes_before_unknown() -> None:
    seen = margin_without("pitch", "phase_margin_deg")(measured())
    bad = Quantity.normal(12.0, 1.0, "deg")
    roll = replace(seen.margins["roll"], numbers={**seen.margins["roll"].numbers, "phase_margin_deg": bad})
    assert states(replace(seen, margins={**seen.margins, "roll": roll}))["margins"] == "look"


def test_a_model_that_follows_the_data_only_is_named() -> None:
    told = card(follows_the_data_only(measured()), "models")
    assert (told.state, told.number) == ("part", "2 models")
    assert "Follows the data only: rate.roll." in told.sentence


def test_motors_that_were_logged_in_an_unknown_range_are_not_called_missing() -> None:
    seen = motors_without("imbalance", "headroom", "saturated_high_share")(measured())
    seen = replace(seen, logging=replace(seen.logging, rates_hz={"motor_1": 100.0}))
    why = "The log does not say in which range its motors move."
    flown = replace(seen, cannot_tell=(Unavailable(what="motors.saturated_high_share", why=why),))
    assert card(flown, "motors").headline == why
    still = replace(seen, cannot_tell=(Unavailable(what="motors", why="The motor outputs are not logged in the air."),))
    assert card(still, "motors").headline == "The motor outputs are not logged in the air."


def test_motor_outputs_alone_answer_their_question_and_loss_of_step_is_named_where_speeds_are_logged() -> None:
    by_speeds = card(measured(), "motors")
    seen = measured()
    by_outputs = card(replace(seen, motors=replace(seen.motors, steps_checked=False)), "motors")
    assert by_outputs.state == by_speeds.state == "good"
    assert by_speeds.headline == by_outputs.headline
    assert "No desync was found." in by_speeds.details
    assert "Desync was not checked." in by_outputs.details


def test_a_model_that_the_log_does_not_support_is_named_and_makes_no_part() -> None:
    seen = refused("rate.pitch")(measured())
    lacks = card(seen, "models")
    assert (lacks.state, lacks.number) == ("part", "1 of 2 models")
    assert "Not identified: rate.pitch." in lacks.sentence
    short = card(replace(seen, unsupported=("rate.pitch",)), "models")
    assert (short.state, short.number) == ("good", "1 model")
    assert "Not enough data: rate.pitch." in short.sentence


def test_a_margin_names_the_end_of_a_derivative_that_moves_in_flight() -> None:
    seen = measured()
    crossover = Quantity.normal(60.0, 2.0, "rad/s")
    pitch = replace(
        seen.margins["pitch"],
        numbers={
            **seen.margins["pitch"].numbers,
            "sensitivity_peak": Quantity.normal(3.0, 0.1, "1"),
            "crossover_rad_s": crossover,
        },
        ends={
            "D at its base": {"crossover_rad_s": Quantity.normal(50.0, 2.0, "rad/s")},
            "D at its top": {"crossover_rad_s": crossover},
        },
    )
    told = card(replace(seen, margins={**seen.margins, "pitch": pitch}), "margins")
    assert told.number == "pitch M_s 3.00 ± 0.20 with D at its top"


def test_a_margin_is_bad_at_the_other_end_of_a_derivative_that_moves_in_flight() -> None:
    seen = measured()
    flown = dict(seen.margins["roll"].numbers, crossover_rad_s=Quantity.normal(60.0, 2.0, "rad/s"))
    base = {
        "crossover_rad_s": Quantity.normal(50.0, 2.0, "rad/s"),
        "phase_margin_deg": Quantity.normal(33.0, 1.0, "deg"),
    }
    roll = replace(seen.margins["roll"], numbers=flown, ends={"D at its top": flown, "D at its base": base})
    told = card(replace(seen, margins={**seen.margins, "roll": roll}), "margins")
    assert (told.state, told.number) == ("look", "roll phase margin 33.0 ± 2.0° with D at its base")
    safe = replace(
        roll,
        ends={"D at its top": flown, "D at its base": {**base, "phase_margin_deg": Quantity.normal(55.0, 1.0, "deg")}},
    )
    calm = card(replace(seen, margins={**seen.margins, "roll": safe}), "margins")
    assert (calm.state, calm.headline) == ("good", card(seen, "margins").headline)


def judged(seen: Review, **verdicts: Verdict) -> Card:
    """The card of margins of a flight whose gains were judged so."""
    breaking = Breaking(
        draw=0, situation="", loop="rate", omega_rad_s=60.0, sensitivity_peak=2.6, gain=1.1, phase_deg=-5.0
    )
    margins = {
        axis: replace(
            one,
            verdict=LoopVerdict(
                verdict=verdicts[axis],
                usual_peak=1.5,
                refused_peak=1.6,
                safe_peak=1.7,
                unstable=0.0,
                breaking=breaking,
            ),
        )
        if axis in verdicts
        else one
        for axis, one in seen.margins.items()
    }
    return card(replace(seen, margins=margins), "margins")


def test_the_verdict_on_the_flown_gains_is_on_the_card_the_worst_first() -> None:
    good = judged(measured(), roll="fly", pitch="fly")
    assert good.state == "good"
    assert good.details.startswith("Verdict on the flown gains: fly (roll and pitch).")
    mixed = judged(measured(), roll="fly", pitch="gently")
    assert mixed.details.startswith("Verdict on the flown gains: fly gently (pitch) and fly (roll).")
    assert "Verdict" not in card(measured(), "margins").sentence


def test_gains_that_must_not_fly_are_no_good_card() -> None:
    bad = judged(measured(), roll="fly", pitch="do_not_fly")
    assert bad.state == "look"
    assert bad.headline == "The pitch loop is too close to shaking on a likely vehicle."
    assert bad.details.startswith("Verdict on the flown gains: do not fly (pitch) and fly (roll).")
    # Gusts are no test of a loop whose stick was idle.
    assert judged(by_gusts("pitch")(measured()), pitch="do_not_fly").state == "part"
