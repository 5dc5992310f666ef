"""Oscillation in flights of real autopilots, with what is known of each: two limit cycles, all others calm."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

import rotorid
from rotorid.documents.review import review_document
from rotorid.errors import InsufficientDataError
from rotorid.proposing.flown_gains import require_room
from rotorid.reviewing.cards import cards
from rotorid.reviewing.missing_words import gathered
from rotorid.signal.oscillations import check_oscillations

Read = Callable[[str], rotorid.FlightRecord]

SWINGS: Mapping[str, float | None] = {
    "real_stacks/ap_x_wind_limit_cycle.BIN.xz": 22.9,
    "real_stacks/ap_x_wind_ordinary_hard.BIN.xz": None,
}
"""Logs of the same gains: at 400 Hz with its frequency, at 10 Hz without."""

SOFT = "real_stacks/ap_x_wind_ordinary_soft.BIN.xz"

CALM = [
    SOFT,
    "real_stacks/ap_x_guided_multisine.BIN.xz",
    "real_stacks/px4_sih_offboard_plan.ulg.xz",
    "ardupilot/beast_0036.BIN",
    "ardupilot/erle_brain3.BIN",
    "everyday/arducopter_462_log_5.bin.xz",
    "everyday/betaflight_431_freestyle.bbl.xz",
    "everyday/betaflight_damaged_test_log.BFL.xz",
    "everyday/px4_115_s500.ulg.xz",
    "px4/sample_old_1MB.ulg",
]

OTHERS = [
    "real_stacks/ap_x_wind_soft_card_flight.BIN.xz",
    "real_stacks/ap_x_wind_soft_tuned_card_flight.BIN.xz",
    "real_stacks/ap_x_wind_soft_wide.BIN.xz",
    "ardupilot_sitl/x_calm_roll.BIN",
    "ardupilot_sitl/x_calm_thrust.BIN.xz",
    "ardupilot_sitl/x_calm_verify.BIN.xz",
    "ardupilot_sitl/x_wind_rollpitch.BIN.xz",
    "ardupilot_sitl/x_wind_yawthrust.BIN.xz",
    "betaflight/smooth_tune.BBL",
    "px4_sitl/roll.ulg",
    "px4_sitl/pitch.ulg.xz",
    "px4_sitl/yaw.ulg.xz",
    "px4_sitl/thrust.ulg.xz",
    "px4_sitl/verify.ulg.xz",
]
"""As calm, and larger."""


@pytest.fixture(scope="module")
def read(unpacked: Callable[[str], Path]) -> Read:
    held: dict[str, rotorid.FlightRecord] = {}

    def log(name: str) -> rotorid.FlightRecord:
        if name not in held:
            held[name] = rotorid.read(unpacked(name), sandbox=False)
        return held[name]

    return log


@pytest.mark.parametrize("name", SWINGS)
def test_the_limit_cycle_is_found_whatever_the_rate_of_the_log(read: Read, name: str) -> None:
    check = check_oscillations(read(name))
    assert [one.axis for one in check.found] == ["roll", "pitch"]
    known_hz = SWINGS[name]
    for one in check.found:
        assert one.rms == pytest.approx(0.54, abs=0.01)
        assert one.at_limit_percent == pytest.approx(98.8, abs=2.0)
        assert one.frequency_hz == (None if known_hz is None else pytest.approx(known_hz, rel=0.01))


@pytest.mark.parametrize("name", SWINGS)
def test_its_review_is_green_nowhere_that_shakes(read: Read, name: str) -> None:
    seen = rotorid.review(read(name))
    shown = {card.key: card for card in cards(seen)}
    assert {key for key, card in shown.items() if card.state == "good"} <= {"power"}
    assert shown["margins"].state == "look"
    assert "Roll and pitch oscillate" in shown["margins"].sentence
    assert shown["noise"].state == shown["motors"].state == "look"
    # The cards give one number for the time at a limit: 98.8 % are known of the flight at 10 Hz.
    percent = 99 if "hard" in name else 98
    assert shown["motors"].number == f"{percent} % at a limit"
    assert f"at a limit for {percent} %" in shown["margins"].sentence
    # Motors at their limits hide the loops of calm axes too, and one line says so of all.
    assert (seen.loops, seen.margins, seen.models) == ({}, {}, {})
    hidden = [one.what for one in gathered(seen.cannot_tell) if "shows the motor limits" in one.why]
    assert hidden == ["loops; margins; models"]
    # A sweep on top of a limit cycle is no next step.
    assert not any("design" in command for command in seen.next_commands)
    written = review_document(seen).model_dump(by_alias=True, mode="json")
    assert [one["axis"] for one in written["oscillations"]] == ["roll", "pitch"]
    assert {"axis", "frequency_hz", "rms", "at_limit_percent"} <= written["oscillations"][0].keys()
    assert {one["kind"] for one in written["findings"]} >= {"oscillation"}


@pytest.mark.parametrize("name", SWINGS)
def test_the_proposed_gains_are_those_that_flew_calmly(read: Read, name: str) -> None:
    """The same vehicle flew with P 0.0675 and D 0.0018, and was calm with a sensitivity of 1.89."""
    for one in rotorid.review(read(name), models=False).oscillations:
        letters = {"roll": "RLL", "pitch": "PIT"}[one.axis]
        assert one.gains[f"ATC_RAT_{letters}_P"] == pytest.approx((0.216, 0.072), rel=1e-3)
        assert one.gains[f"ATC_RAT_{letters}_D"] == pytest.approx((0.00576, 0.00192), rel=1e-3)


@pytest.mark.parametrize("name", SWINGS)
def test_no_gains_are_proposed_from_it(read: Read, name: str) -> None:
    with pytest.raises(InsufficientDataError, match="Roll and pitch oscillate") as refused:
        require_room(read(name))
    assert {finding.kind for finding in refused.value.findings} == {"oscillation"}


def test_the_soft_flight_is_calm_and_too_slow_for_more(read: Read) -> None:
    seen = rotorid.review(read(SOFT), models=False)
    assert (seen.oscillations, seen.calm) == ((), ("roll", "pitch", "yaw"))
    shaking = next(card for card in cards(seen) if card.key == "margins")
    assert (shaking.state, shaking.number) == ("cannot", "")
    assert shaking.details.startswith("Roll and pitch do not oscillate.")
    assert any(one.what.startswith("margins.roll") and "10 Hz" in one.why for one in seen.cannot_tell)


@pytest.mark.parametrize("name", CALM)
def test_all_other_flights_are_calm(read: Read, name: str) -> None:
    check = check_oscillations(read(name))
    assert (check.found, check.calm) == ((), ("roll", "pitch", "yaw"))


@pytest.mark.slow
@pytest.mark.parametrize("name", OTHERS)
def test_flights_with_sweeps_are_calm(read: Read, name: str) -> None:
    check = check_oscillations(read(name))
    assert (check.found, check.calm) == ((), ("roll", "pitch", "yaw"))
