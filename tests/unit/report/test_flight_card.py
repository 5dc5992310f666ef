from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.browser.chromium import browser
from tests.unit.report.page_parser import Page
from tests.unit.report.plan_sample import (
    by_hand,
    chirp,
    facts,
    four_chirps,
    multisine,
    step,
    sweeps_then_doublets,
)

from rotorid.data.flight_plan import FlightPlan, PlannedInput
from rotorid.errors import UsageError
from rotorid.flying.designs import Designed, Planned
from rotorid.flying.settings import DesignSettings, PlanSettings
from rotorid.planning.amplitude import Reached
from rotorid.plans.facts import HOLD, FlightFacts, PredictedBound, excited_s, throttle_by_hand
from rotorid.report.files import _facts
from rotorid.report.flight_card import MOST_BOUNDS, flight_card, flight_card_html, least_rate_hz
from rotorid.report.printing import print_pages
from rotorid.typing import Axis

AXES: tuple[Axis, ...] = ("roll", "pitch", "yaw", "thrust")


def many() -> FlightPlan:
    """Everything at its largest: eight runs, a long name."""
    inputs = tuple(by_hand(axis, start_s=50.0 * index) for index, axis in enumerate(AXES * 2))
    return FlightPlan(name="A name that is a good deal longer than a name of a plan should be", inputs=inputs)


def at_once() -> FlightPlan:
    inputs = (*multisine(("roll", "pitch", "yaw")), step("roll", start_s=26.0, entry="attitude_setpoint"))
    return FlightPlan(name="All axes at once", inputs=inputs)


def crowded() -> FlightFacts:
    """As many bounds as are shown and more, two notes, and a name."""
    bounds = tuple(
        PredictedBound(
            name=f"X_long_{n}", unit="rad/s^2", value=-1234.5, std=12.0, model="rate response of roll" if n else "hover"
        )
        for n in range(MOST_BOUNDS + 3)
    )
    return facts("other", vehicle="A vehicle of some name", bounds=bounds, notes=("One note.", "Another note, longer."))


CARDS = {
    "ardupilot": (four_chirps(), facts()),
    "px4": (at_once(), facts("PX4")),
    "betaflight": (FlightPlan(name="One", inputs=(chirp("roll", entry="rate_setpoint"),)), facts("Betaflight")),
    "other": (many(), crowded()),
    "planner": (sweeps_then_doublets(repeats=2), facts()),
}


def rows(plan: FlightPlan, about: FlightFacts | None = None) -> list[list[str]]:
    return Page(flight_card_html(plan, about or facts())).tables[0][1:]


def words(plan: FlightPlan, about: FlightFacts) -> str:
    return " ".join(" ".join(Page(flight_card_html(plan, about)).text).split())


def test_runs_stand_in_the_order_of_their_times() -> None:
    shown = rows(four_chirps())
    assert [row[0] for row in shown] == ["1", "2", "3", "4"]
    assert [row[1].split()[0] for row in shown] == ["Roll", "Pitch", "Yaw", "Thrust"]
    # The fades begin with a zero sample, and the first of the last chirp is 300 s after that of the first.
    assert [row[4] for row in shown] == ["0:00", "1:40", "3:20", "5:00"]
    assert [row[5] for row in shown] == ["90 s"] * 4
    assert shown[0][2] == "± 15 % of full control 0.1 to 20 Hz"
    assert shown[3][2] == "± 8 % of full thrust 0.1 to 20 Hz"


def test_inputs_at_the_same_time_are_one_run() -> None:
    shown = rows(at_once())
    assert [row[1] for row in shown] == ["Roll, pitch, yaw multisine", "Roll doublet"]
    assert shown[0][2].startswith("± 2.9°")
    assert shown[1][2] == "± 5.7° steps of 1 s"


def test_repeats_are_one_row_and_steps_beside_sweeps_are_flown_by_hand() -> None:
    shown = rows(sweeps_then_doublets(repeats=2), facts("ArduPilot"))
    assert [row[1] for row in shown] == [
        f"{axis} 2 × {shape}" for shape in ("sweep", "doublet") for axis in ("Roll", "Pitch", "Yaw", "Thrust")
    ]
    assert shown[0][2] == "± 10 % of full control 0.2 to 12 Hz"
    assert shown[0][5] == "60 s each"
    assert shown[4][2] == "by hand steps of 0.3 s"
    assert shown[4][5] == "0.6 s each"
    # Another autopilot's script flies them all.
    assert rows(sweeps_then_doublets(), facts("other"))[4][2] == "± 12 % of full control steps of 0.3 s"


@pytest.mark.parametrize(
    ("planned", "size"),
    [
        (chirp("roll", entry="rate_setpoint", amplitude=math.radians(200.0)), "± 200°/s"),
        (chirp("roll", entry="attitude_setpoint", amplitude=math.radians(5.0)), "± 5°"),
        (by_hand("yaw"), "± 30 % of the stick"),
    ],
)
def test_sizes_are_in_the_units_of_pilots(planned: PlannedInput, size: str) -> None:
    assert rows(FlightPlan(name="one", inputs=(planned,)))[0][2].startswith(size)


def test_limits_have_a_margin_over_what_was_predicted() -> None:
    about = facts(tilt_rad=math.radians(16.0), rate_rad_s=math.radians(84.0), room_m=7.4, climb_m=2.6)
    assert math.degrees(about.stop_tilt_rad) == pytest.approx(25.0)  # 24, to the next 5
    assert math.degrees(about.stop_rate_rad_s) == pytest.approx(130.0)
    assert (about.stop_room_m, about.stop_climb_m) == (12.0, 4.0)
    text = words(four_chirps(), about)
    for limit in ("25°", "130°/s", "12 m", "4 m", "30 %"):
        assert limit in text


def test_limits_stay_sane() -> None:
    assert math.degrees(facts(tilt_rad=math.radians(20.0)).stop_tilt_rad) == pytest.approx(30.0)  # a step stays
    assert math.degrees(facts(tilt_rad=1.2).stop_tilt_rad) == pytest.approx(60.0)
    assert facts(room_m=0.1).stop_room_m == 2.0
    assert facts(height_m=4.0, climb_m=3.0).stop_climb_m == 2.0  # never down to the ground
    still = facts(tilt_rad=0.0, rate_rad_s=math.radians(3.0))
    assert math.degrees(still.stop_tilt_rad) == pytest.approx(15.0)
    assert math.degrees(still.stop_rate_rad_s) == pytest.approx(60.0)
    assert math.degrees(still.stop_tilt_rad) > HOLD["lean_deg"]  # what holds the place breaks nothing off


@pytest.mark.parametrize("height_m", [0.0, 0.15, 0.5, 1.0, 3.3, 4.0, 20.0, 31.4159, 290.139706])
@pytest.mark.parametrize("share", [0.0, 0.1, 0.4, 0.5, 2.0])
def test_a_start_is_higher_than_what_may_be_lost(height_m: float, share: float) -> None:
    about = facts(height_m=height_m, climb_m=share * height_m)
    assert 0.0 < about.stop_climb_m < about.least_height_m
    # Half of the height, or what is a quarter above the loss, and a rounding up.
    assert about.least_height_m <= max(0.625 * height_m + 0.1, 0.2)
    for number in (about.stop_climb_m, about.least_height_m):
        assert number == round(number, 1)


@pytest.mark.parametrize(
    ("plan", "autopilot", "by_hand"),
    [
        (four_chirps(), "ArduPilot", True),
        (at_once(), "ArduPilot", False),
        (at_once(), "PX4", False),
        (FlightPlan(name="one", inputs=(chirp("roll", entry="rate_setpoint"),)), "Betaflight", True),
    ],
)
def test_it_is_known_whose_hand_works_the_throttle(plan: FlightPlan, autopilot: str, by_hand: bool) -> None:
    assert throttle_by_hand(plan, autopilot) == by_hand
    assert ("You work the throttle" in words(plan, facts(autopilot))) == by_hand


@pytest.mark.parametrize("change", [{"room_m": -1.0}, {"tilt_rad": math.nan}, {"motors": (0.1, 1.2)}])
def test_impossible_predictions_are_refused(change: dict[str, object]) -> None:
    with pytest.raises(UsageError, match="predictions"):
        facts(**change)


def test_it_says_what_the_flight_will_tell() -> None:
    page = Page(flight_card_html(four_chirps(), facts()))
    found = {row[0]: row[1:] for table in page.tables[1:] for row in table[1:]}
    assert list(found) == [bound.name for bound in facts().bounds]
    assert found["L_roll"] == ["437 ± 11", "rad/s²", "2.6"]
    assert "more parameters" not in " ".join(page.text)
    assert "3 more parameters" in words(many(), crowded())


def test_what_the_flight_does_not_tell_is_not_known() -> None:
    bounds = (
        PredictedBound(name="X_u", unit="1/s", value=-0.2, std=0.21),
        PredictedBound(name="Y_v", unit="1/s", value=-0.2, std=math.inf),
        PredictedBound(name="Z_w", unit="1/s", value=-0.2, std=0.19),
        PredictedBound(name="N_r", unit="1/s", value=0.0, std=0.1),
    )
    page = Page(flight_card_html(four_chirps(), facts(bounds=bounds)))
    found = {row[0]: row[1:] for table in page.tables[1:] for row in table[1:]}
    assert found["X_u"] == found["Y_v"] == ["too uncertain", "", "–"]
    assert found["Z_w"] == ["−0.20 ± 0.19", "1/s", "95"]
    assert found["N_r"][0] == "0.00 ± 0.10"


@pytest.mark.parametrize(("autopilot", "climb_m"), [("ArduPilot", 2.0), ("PX4", 0.1)])
def test_a_hand_on_the_throttle_has_two_meters_of_height(autopilot: str, climb_m: float) -> None:
    """The simulated pilot holds it to a tenth of a meter, which no hand does: the script would end every flight."""
    reached = Reached(
        tilt_rad=0.3, rate_rad_s=1.0, position_m=3.0, height_m=0.1, motor_low=0.4, motor_high=0.7, saturated=0.0
    )
    planned = Planned(plan=FlightPlan(name="one", inputs=(chirp("roll"),)), amplitudes={}, reached=reached)
    designed = Designed(kind="logarithmic_sweep", planned=planned, told=(), shortest={}, wanted={})
    choices = DesignSettings(vehicle="ardupilot_quad", kinds=("logarithmic_sweep",), plan=PlanSettings(axes=("roll",)))
    assert _facts(designed, choices, autopilot).climb_m == climb_m


def test_models_are_told_apart_where_there_are_several() -> None:
    def told(*models: str) -> list[str]:
        bounds = tuple(PredictedBound(name="T_motor", unit="s", value=0.05, std=0.001, model=one) for one in models)
        page = Page(flight_card_html(four_chirps(), facts(bounds=bounds)))
        return [row[0] for table in page.tables[1:] for row in table[1:]]

    assert told("roll", "pitch", "yaw") == ["T_motor roll", "T_motor pitch", "T_motor yaw"]
    assert told("roll") == ["T_motor"]


def test_large_numbers_are_written_out() -> None:
    about = facts(room_m=1234.5, climb_m=150.2, height_m=1290.139706, rate_rad_s=70.0)
    text = words(four_chirps(), about)
    assert "height, ± 150 m" in text
    assert "1290 m" in text
    assert "226 m" in text  # 1.5 times the climb
    long = by_hand("roll")
    html = flight_card_html(
        FlightPlan(name="long", inputs=(replace(long, values=np.tile(long.values, 40)),)), facts(climb_m=0.04)
    )
    for page in (flight_card_html(four_chirps(), about), html):
        assert not re.search(r"\de[+-]?\d", re.sub(r"<style>.*</style>", "", page, flags=re.DOTALL))


@pytest.mark.parametrize(
    ("inputs", "said", "unsaid"),
    [
        ((by_hand("roll"),), "from slow to fast, never faster", "quickly to each level"),
        ((step("roll", entry="stick"),), "quickly to each level", "slow to fast"),
        ((by_hand("roll"), step("roll", start_s=60.0, entry="stick")), "steps quickly from level to level", "smooth"),
    ],
)
def test_the_hand_is_told_what_the_picture_asks_for(inputs: tuple[PlannedInput, ...], said: str, unsaid: str) -> None:
    text = words(FlightPlan(name="by hand", inputs=inputs), facts("other"))
    assert said in text
    assert unsaid not in text


def test_it_says_what_holds_the_vehicle() -> None:
    assert "Hands off: the script keeps position and height slowly" in words(at_once(), facts("PX4"))
    guided = words(at_once(), facts("ArduPilot"))
    assert "Hands off: the script keeps the position slowly, and the autopilot works the throttle" in guided
    by_mode = words(four_chirps(), facts("ArduPilot"))
    assert "script keeps" not in by_mode  # System ID: the pilot keeps it
    assert "You work the throttle" in by_mode
    assert (
        "Tested in hover: Stabilize, throttle near the middle; way to stop: switch to Loiter, throttle near the middle"
        in by_mode
    )
    assert "Stabilize" not in guided


@pytest.mark.parametrize(
    ("firmware", "said"),
    [
        ("", "in Stabilize in the middle of the room (firmware 4.6 and later refuses other modes"),
        ("ArduCopter V4.7.0", "in Stabilize in the middle of the room (ArduCopter 4.7 refuses other modes"),
        ("ArduCopter V4.5.7", "in Stabilize in the middle of the room (there your hand is on the throttle already)"),
    ],
)
def test_system_id_is_entered_as_the_firmware_wants_it(firmware: str, said: str) -> None:
    assert said in words(four_chirps(), facts(firmware=firmware))


def test_runs_by_hand_beside_sweeps_only_check_the_model() -> None:
    plan = sweeps_then_doublets()
    said = "Fly the runs by hand last, in Stabilize: they only check the model. Keep the sticks still for 3 s before"
    assert said in words(plan, facts())
    assert "4 maneuvers found on roll, pitch, yaw and thrust, without gaps; 8 more by hand" in words(plan, facts())
    assert "by hand last, in ANGLE" in words(plan, facts("Betaflight"))
    for none in (words(four_chirps(), facts()), words(many(), facts()), words(plan, facts("PX4"))):
        assert "only check the model" not in none


@pytest.mark.parametrize(
    ("autopilot", "parameter"), [("ArduPilot", "176127"), ("PX4", "SDLOG_PROFILE reads 25"), ("Betaflight", "CHIRP")]
)
def test_it_names_the_logging_of_the_autopilot(autopilot: str, parameter: str) -> None:
    assert parameter in words(four_chirps(), facts(autopilot))


@pytest.mark.parametrize("autopilot", ["ArduPilot", "PX4", "Betaflight", "other"])
def test_sticks_are_flown_by_hand_whatever_the_autopilot(autopilot: str) -> None:
    assert "Follow the picture with the stick" in words(many(), facts(autopilot))


def test_a_plan_by_hand_asks_for_no_file_and_no_mode_that_flies_it() -> None:
    text = words(many(), facts("Betaflight"))
    assert "Commands, rates and attitude logged at" in text
    assert "start and end in trimmed hover, in ANGLE." in text
    assert "To stop: level, land." in text
    assert "CHIRP" not in text
    assert "LOG_BITMASK" not in words(many(), facts("ArduPilot"))


def test_what_system_id_mode_cannot_fly_is_flown_by_the_script() -> None:
    text = words(at_once(), facts("ArduPilot"))
    assert "switch to Guided" in text
    assert "LOG_BITMASK reads 438271" in text
    assert "switch to System ID or let the script" in words(four_chirps(), facts("ArduPilot"))


def test_it_asks_for_ten_samples_in_a_period() -> None:
    assert least_rate_hz(four_chirps()) == 200.0
    assert least_rate_hz(at_once()) == 50.0
    assert "200 Hz or more" in words(four_chirps(), facts())


@pytest.mark.parametrize("name", list(CARDS))
def test_the_page_holds_everything_it_shows(name: str) -> None:
    html = flight_card(*CARDS[name])["flight-card.html"]
    page = Page(html)
    assert not page.scripts
    assert {element for element, _ in page.elements}.isdisjoint({"script", "link", "img", "iframe", "object"})
    assert not re.search(r"https?:|url\(|@import", html)
    assert "default-src 'none'" in page.attributes("content")[0]
    assert len(page.attributes("aria-label")) == len(page.tables[0]) - 1


def test_the_card_of_an_old_px4_asks_for_the_list_that_it_has() -> None:
    text = words(FlightPlan(name="one", inputs=(chirp(),)), facts(autopilot="PX4", firmware="PX4 1.6.5"))
    assert "SDLOG_PROFILE reads 2;" in text


def test_the_first_line_says_for_which_vehicle_it_was_computed() -> None:
    about = facts(computed_for="computed for a simulated 1 kg quadrotor (px4_quad)")
    html = flight_card_html(FlightPlan(name="one", inputs=(chirp(),)), about)
    kicker = html.partition('<p class="kicker">')[2].partition("</p>")[0]
    assert kicker.endswith("computed for a simulated 1 kg quadrotor (px4_quad)")


def test_no_name_becomes_markup() -> None:
    bad = '<script>alert(1)</script><img src="http://x/">'
    plan = FlightPlan(name=bad, inputs=(step("roll"),))
    html = flight_card_html(
        plan, facts(vehicle=bad, notes=(bad,), bounds=(PredictedBound(name=bad, unit=bad, value=1.0, std=0.1),))
    )
    page = Page(html)
    assert not page.scripts
    assert "img" not in {element for element, _ in page.elements}
    assert html.count("&lt;script&gt;") == 7  # title twice, kicker, heading, parameter, unit and note


def test_pictures_are_the_inputs() -> None:
    """The outline of a drawing against the input: highest and lowest in each column."""
    planned = chirp("roll", fade_in_s=0.0, fade_out_s=0.0, band_hz=(0.1, 2.0))
    html = flight_card_html(FlightPlan(name="one", inputs=(planned,)), facts())
    outline = re.findall(r'<path d="M([\d.,\- L]+) Z"', html)[0]
    points = np.array([[float(number) for number in pair.split(",")] for pair in outline.split(" L")])
    columns = len(points) // 2
    begin_s, end_s = excited_s(planned)
    pad_s = 0.02 * (end_s - begin_s)
    edges = np.linspace(max(begin_s - pad_s, 0.0), end_s + pad_s, columns + 1)
    heights = (27.0 - points[:, 1]) / (0.44 * 54.0)
    for index in (5, 60, 150, 222):
        inside = planned.at(np.linspace(edges[index], edges[index + 1], 500)) / planned.amplitude
        # 32 samples in a column miss a peak by less than half a step of the steepest phase; heights have two decimals.
        step_rad = 2.0 * math.pi * 2.0 * (edges[1] - edges[0]) / 32.0
        assert heights[index] == pytest.approx(inside.max(), abs=step_rad + 0.001)
        assert heights[2 * columns - 1 - index] == pytest.approx(inside.min(), abs=step_rad + 0.001)


def test_more_runs_than_can_be_read_are_refused() -> None:
    inputs = tuple(by_hand(AXES[index % 2], start_s=50.0 * index) for index in range(9))
    with pytest.raises(UsageError, match="at most 8"):
        flight_card_html(FlightPlan(name="nine", inputs=inputs), facts())


def test_an_input_of_zeros_is_refused() -> None:
    still = PlannedInput(
        axis="roll", shape="doublet", start_s=0.0, values=np.zeros(5), sample_rate_hz=5.0, amplitude=0.1
    )
    with pytest.raises(UsageError, match="is zero"):
        flight_card_html(FlightPlan(name="still", inputs=(still,)), facts())


@pytest.mark.parametrize("name", list(CARDS))
def test_the_card_is_one_page_on_paper(name: str, tmp_path: Path) -> None:
    browser()
    (tmp_path / "flight-card.html").write_text(flight_card_html(*CARDS[name]), encoding="utf-8")
    (printed,) = print_pages(tmp_path)
    document = printed.read_bytes()
    assert document.startswith(b"%PDF")
    assert len(re.findall(rb"/Type\s*/Page\b", document)) == 1


def test_a_parameter_that_will_come_out_elsewhere_is_marked_and_its_percent_is_of_the_value_given() -> None:
    bounds = (
        PredictedBound(name="tau_roll", unit="s", value=0.029, std=0.00036, given=0.0111),
        PredictedBound(name="L_roll", unit="1/s", value=224.0, std=14.0, given=250.0),
    )
    page = Page(flight_card_html(four_chirps(), facts(bounds=bounds)))
    found = {row[0]: row[1:] for table in page.tables[1:] for row in table[1:]}
    assert found["tau_roll"][0].endswith("50 σ off 0.0111")
    assert found["tau_roll"][2] == "3.2"
    assert "off" not in found["L_roll"][0]
    assert found["L_roll"][2] == "5.6"
