"""The filters of a review: what its card, its document and its files say of flights whose noise is known."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from tests.twins.filter_flights import fly
from tests.unit.loops.test_filter_choice import ARDUPILOT, CRAFTS, SPECTRUM, loops_of

from rotorid.documents.filters import filter_documents
from rotorid.flights.gyro_noise import gyro_noise
from rotorid.loops.filter_choice import FilterProposal, propose_filters
from rotorid.reviewing.filters import MOTOR_NOISE_SCALE, filter_card, filter_files, filters
from rotorid.reviewing.missing import Unavailable


def seen(name: str, found: FilterProposal | None, *gaps: Unavailable, idle: tuple[str, ...] = ()) -> Any:
    vehicle = SimpleNamespace(autopilot=name, firmware=CRAFTS[name].firmware)
    numbers = dict.fromkeys(("phase_margin_deg", "sensitivity_peak"))
    margins = {
        axis: SimpleNamespace(stick_idle=axis in idle, numbers=numbers)
        for axis in (() if found is None else found.verdicts)
    }
    return SimpleNamespace(filters=found, oscillations=(), cannot_tell=gaps, vehicle=vehicle, margins=margins)


@pytest.fixture(scope="module")
def noisy() -> FilterProposal:
    record = fly(ARDUPILOT, seconds=15.0)
    return propose_filters(record, gyro_noise(record), loops_of("ArduPilot"))


def test_the_card_says_what_to_set_what_it_saves_and_costs(noisy: FilterProposal) -> None:
    card = filter_card(seen("ArduPilot", noisy))
    assert card.state == "look"
    assert "notch that follows the motors" in card.headline
    assert "would cut motor noise by" in card.headline
    assert "° of phase" in card.headline
    assert "INS_HNTCH_ENABLE = 1" in card.details
    # Yaw has no gains in this log, and no noise of its own.
    assert card.number.endswith("% of the motor range")


def test_the_files_set_the_filters_and_go_back(noisy: FilterProposal) -> None:
    files = filter_files(seen("ArduPilot", noisy))
    assert set(files) == {"filters.param", "filters_rollback.param"}
    assert "INS_HNTCH_ENABLE,1\n" in files["filters.param"]
    assert "load it again" in files["filters.param"]
    assert "INS_HNTCH_ENABLE,0\n" in files["filters_rollback.param"]
    assert "load it again" not in files["filters_rollback.param"]


def test_the_document_has_what_each_parameter_costs_and_saves(noisy: FilterProposal) -> None:
    found = filter_documents(noisy)["INS_HNTCH_FREQ"]
    assert found.flown is None
    assert found.saves_percent_interval[0] < found.saves_percent < found.saves_percent_interval[1]
    assert 0.0 < found.costs_deg < 10.0
    kept = filter_documents(noisy)["INS_GYRO_FILTER"]
    assert kept.flown == 60.0


def test_a_clean_vehicle_keeps_its_filters_on_the_card_too() -> None:
    record = fly(replace(ARDUPILOT, tones=(0.002,), white=0.0007), seconds=15.0)
    found = propose_filters(record, gyro_noise(record), loops_of("ArduPilot"))
    card = filter_card(seen("ArduPilot", found))
    assert (card.state, card.headline) == ("good", "Keep your filters: little noise reaches the motors.")
    assert filter_files(seen("ArduPilot", found)) == {}
    assert all(one.flown == one.proposed for one in filter_documents(found).values())


@pytest.mark.parametrize("unknown", ["its stick was idle", "its verdict is open"])
def test_filters_of_an_axis_without_margins_are_not_called_right(unknown: str) -> None:
    record = fly(replace(ARDUPILOT, tones=(0.002,), white=0.0007), seconds=15.0)
    found = propose_filters(record, gyro_noise(record), loops_of("ArduPilot"))
    if unknown == "its verdict is open":
        open_verdict = replace(found.verdicts["pitch"], verdict="not_enough_data")
        found = replace(found, verdicts={**found.verdicts, "pitch": open_verdict})
    card = filter_card(seen("ArduPilot", found, idle=("pitch",) if "idle" in unknown else ()))
    assert (card.state, card.details) == ("part", "Not checked, since their margins are not known: pitch.")


def test_a_notch_whose_place_is_unknown_is_not_called_right() -> None:
    craft = replace(ARDUPILOT, tones=(0.002,), white=0.0007, speeds=False)
    record = fly(craft, seconds=15.0, **SPECTRUM)
    found = propose_filters(record, gyro_noise(record), loops_of("ArduPilot"))
    card = filter_card(seen("ArduPilot", found))
    assert card.state == "part"
    assert card.details.startswith("Moving notches were not checked: the notch follows the spectrum")


def test_motor_noise_has_one_scale_on_the_page(noisy: FilterProposal) -> None:
    card = filter_card(seen("ArduPilot", noisy))
    assert card.scale == MOTOR_NOISE_SCALE == "below 1 % is quiet, above 2 % is trouble"
    assert card.number.startswith("noise through P and D ")


def test_a_slow_log_gets_the_one_remedy() -> None:
    idle = Unavailable(what="margins.roll", why="The roll stick did not move.", remedy="move the roll stick")
    found, gaps = filters(fly(replace(ARDUPILOT, log_hz=50.0), seconds=15.0), {}, (idle,))
    (gap,) = gaps
    assert found is None
    assert "stick" not in gap.remedy
    card = filter_card(seen("ArduPilot", found, gap))
    assert (card.state, card.remedy) == ("cannot", gap.remedy)
    assert "logged at 50 Hz" in card.headline
    assert filter_documents(None) == {}


def test_without_margins_the_remedy_is_theirs() -> None:
    other = Unavailable(what="margins.roll", why="RATE is logged at 5 Hz.", remedy="set LOG_BITMASK")
    _, (gap,) = filters(fly(ARDUPILOT, seconds=15.0), {}, (other,))
    assert "phase that a filter may cost is not known" in gap.why
    assert gap.remedy == "set LOG_BITMASK"
