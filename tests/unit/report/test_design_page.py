"""The page of a design shows the numbers of its plans, stands alone, and shows hostile text as text."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest
from tests.unit.report.page_parser import Page
from tests.unit.report.response_sample import HOLLOW, OMEGA, measured_response
from tests.unit.report.sample import HOSTILE

from rotorid.data.findings import Finding
from rotorid.data.flight_plan import FlightPlan, PlannedInput, Shape
from rotorid.errors import UsageError
from rotorid.excitation.plan import planned, sequence, together
from rotorid.flying.designs import Designed, Planned, PlanPrediction
from rotorid.flying.settings import DesignSettings, PlanSettings
from rotorid.planning.amplitude import Amplitude, Limits, Reached, reached
from rotorid.planning.duration import Attempt, Shortest
from rotorid.planning.prediction import PredictedParameter, Prediction
from rotorid.report.design import compared, density, design_summary, flown, input_channel, reached_rows, render_design
from rotorid.report.files import write_design
from rotorid.simulation.wind import Wind

RATE_HZ = 100.0
BAND = (1.0, 20.0)
KINDS: tuple[Shape, ...] = ("pilot_sweep", "multisine")
REACHED = Reached(
    tilt_rad=0.3,
    rate_rad_s=2.0,
    position_m=3.0,
    height_m=1.0,
    motor_low=0.02,
    motor_high=0.7,
    saturated=0.0,
)
CHOICES = DesignSettings(
    vehicle="px4_quad",
    kinds=KINDS,
    plan=PlanSettings(axes=("roll", "pitch"), wind=Wind(turbulence_m_s=0.5), repeats=2),
    reach={"L_roll": 1.5},
)


def sweeps() -> FlightPlan:
    parts = [
        planned(
            axis,
            "pilot_sweep",
            start_s=0.0,
            amplitude=0.1,
            duration_s=20.0,
            sample_rate_hz=RATE_HZ,
            band_rad_s=BAND,
            entry="attitude_setpoint",
        )
        for axis in ("roll", "pitch")
    ]
    return sequence("sweeps of both", parts)


def multisines() -> FlightPlan:
    both = together(
        {"roll": 0.1, "pitch": 0.1},
        start_s=0.0,
        band_rad_s=BAND,
        period_s=10.0,
        sample_rate_hz=RATE_HZ,
        entry="attitude_setpoint",
    )
    return sequence("both at once", [both])


def parameter(name: str, percent: float, *, value: float = 100.0, off: float = 0.0) -> PredictedParameter:
    std = abs(value) * percent / 100.0
    return PredictedParameter(
        name=name,
        unit="rad/s^2",
        value=value,
        expected=value + off * std,
        std=std,
        std_random=0.6 * std,
        scatter=0.5 * std,
        cramer_rao=10.0 * std,
        insensitivity=4.0 * std,
        lowest_std=0.25 * std,
    )


def prediction(*parameters: PredictedParameter, findings: tuple[Finding, ...] = ()) -> Prediction:
    response = measured_response()
    return Prediction(
        plan="sweeps of both",
        duration_s=50.0,
        parameters=parameters,
        covariance=np.diag([one.std**2 for one in parameters]),
        inflation=1.4,
        response=response,
        used=response.coherence >= 0.3,
        findings=findings,
    )


def shortest(percent: tuple[float, ...] = (3.0, 1.4, 1.0)) -> Shortest:
    tried = [
        Attempt(duration_s, one / 1.5, "L_roll", prediction(parameter("L_roll", one)))
        for duration_s, one in zip((15.0, 40.0, 300.0), percent, strict=True)
    ]
    return Shortest(
        duration_s=40.0,
        limiting="L_roll",
        prediction=tried[1].prediction,
        tried=(Attempt(10.0, math.inf, "", None), *tried),
        words="40 s are enough; L_roll asks for the most.",
    )


def designed(*, hostile: str = "", percent: tuple[float, float] = (2.0, 1.0)) -> tuple[Designed, ...]:
    finding = Finding(
        kind="insensitive_parameter", severity="warning", where=hostile or "tau", message=f"It is {hostile or 'weak'}."
    )
    plans = (sweeps(), multisines())
    found = Amplitude(value=0.125, reached=REACHED, limited_by="tilt_rad", flights=9)
    return tuple(
        Designed(
            kind=kind,
            planned=Planned(
                plan=dataclasses.replace(plan, name=hostile or plan.name),
                amplitudes={f"{kind} of roll": found},
                reached=REACHED,
            ),
            told=(
                PlanPrediction(
                    model=hostile or "rate.roll",
                    prediction=prediction(
                        parameter("L_roll", first),
                        parameter(hostile or "L_p", 5.0, value=-4.0, off=5.0),
                        findings=(finding,),
                    ),
                ),
                PlanPrediction(model="rate.yaw", prediction=None, refused=f"nothing excites {hostile or 'yaw'}"),
            ),
            shortest={hostile or "rate.roll": shortest()},
            wanted={hostile or "rate.roll": {"L_roll": 1.5}, "rate.yaw": {}},
        )
        for kind, plan, first in zip(KINDS, plans, percent, strict=True)
    )


@pytest.fixture(scope="module")
def page() -> Page:
    return Page(render_design(designed(), CHOICES, title="Two plans"))


@pytest.fixture(scope="module")
def alone() -> Page:
    return Page(render_design(designed()[:1], CHOICES, title="One plan"))


@pytest.fixture(scope="module")
def hostile() -> Page:
    return Page(render_design(designed(hostile=HOSTILE), CHOICES, title=HOSTILE))


def test_test_inputs_stand_in_the_table_with_what_limits_them(alone: Page) -> None:
    roll, pitch = alone.rows("Added to")
    assert roll == [
        "roll",
        "pilot sweep",
        "attitude setpoint",
        "3.0 to 23.0",
        "1 to 20",
        "0.1 rad ± 5.7°",
        "tilt on this axis alone, up to 0.125 rad",
    ]
    # Its amplitude was not looked for.
    assert pitch[-1] == "given"


def test_what_is_reached_stands_against_its_limit() -> None:
    rows = {row.words: row for row in reached_rows(REACHED, Limits(tilt_rad=0.4, rate_rad_s=1.0))}
    assert (rows["Largest tilt"].reached.text, rows["Largest tilt"].limit) == ("17.2", "at most 22.9")
    marked = {words for words, row in rows.items() if row.reached.marked}
    assert marked == {"Largest rate", "Lowest motor output"}


def test_parameters_are_shown_in_percent_and_marked_beyond_guidelines(alone: Page) -> None:
    gain, damping = alone.rows("Scatter")
    assert gain == [
        "L_roll rolling moment due to roll command",
        "rad/s²",
        "100",
        "100.0 ± 2.0",
        "2",
        "1.2",
        "1",
        "0.5",
        "20",
        "8",
    ]
    assert damping[2:] == ["−4", "−3.00 ± 0.20 5.0 σ off", "5", "3", "2.5", "1.2", "67", "27"]
    marked = [attributes for _, attributes in alone.elements if attributes.get("class") == "marked"]
    # The distance from the value, two bounds of L_p, and the lowest motor output.
    assert len(marked) == 4
    assert "errors are 1.4 times larger" in alone.words


def test_a_refused_model_is_refused_in_words(alone: Page) -> None:
    assert "not enough data nothing excites yaw" in alone.words
    assert "not enough data for rate.yaw." in alone.words


def test_usable_bands_are_those_of_the_prediction(alone: Page) -> None:
    rows = {row[0].split()[0]: row for row in alone.rows("Usable")}
    used = measured_response().coherence[0, 0] >= 0.3
    assert rows["p/roll_command"][2] == str(used.sum())
    low, high = OMEGA[used][[0, -1]]
    assert rows["p/roll_command"][1].startswith(f"{low:.3g} to {high:.3g} ")
    assert HOLLOW not in rows
    assert f"No usable points: {HOLLOW}." in alone.words


def test_plans_stand_side_by_side_and_the_best_is_marked(page: Page) -> None:
    gain, damping = page.rows("Multisine")
    assert gain == ["L_roll rate.roll", "2 1.8 of a minute", "1 0.66 of a minute"]
    best = [attributes.get("title") for tag, attributes in page.elements if attributes.get("class") == "badge good"]
    # L_p is known equally well by both.
    assert best == ["best"] * 3
    assert damping[1].startswith("5 ")


def test_the_best_of_a_row_is_the_least_and_nothing_is_not_the_best() -> None:
    rows = {row.name: row for row in compared(designed(percent=(math.inf, 3.0))).rows}
    assert rows["L_roll"].texts == ("–", "3")
    assert rows["L_roll"].best == (False, True)
    assert rows["L_roll"].minutes[0] == ""
    assert {row.name: row.best for row in compared(designed()).rows}["L_roll"] == (False, True)


def test_a_parameter_of_the_value_zero_has_no_percent() -> None:
    (one, _) = designed()
    zero = PredictedParameter(
        name="L_v",
        unit="rad/(m s)",
        value=0.0,
        expected=0.1,
        std=0.2,
        std_random=0.1,
        scatter=0.1,
        cramer_rao=0.2,
        insensitivity=0.1,
        lowest_std=0.1,
    )
    with_zero = dataclasses.replace(
        one,
        told=(PlanPrediction(model="rate.roll", prediction=prediction(parameter("L_roll", 2.0), zero)),),
        shortest={},
    )
    assert [row.name for row in compared([with_zero]).rows] == ["L_roll"]
    assert design_summary([with_zero], CHOICES)[0].endswith(
        "expected error of 1 parameter: 2 %; 1 parameter with the value zero has no percentage."
    )
    shown = Page(render_design([with_zero], CHOICES, title="t"))
    assert shown.rows("Scatter")[1][2:] == ["0", "0.10 ± 0.20", "–", "–", "–", "–", "–", "–"]
    marked = [attributes for _, attributes in shown.elements if attributes.get("class") == "marked"]
    # The lowest motor output alone: a dash is beyond no guideline.
    assert len(marked) == 1


def test_a_plan_that_is_best_in_everything_is_said_to_be() -> None:
    first, second = designed()
    other = dataclasses.replace(
        second, told=(PlanPrediction(model="rate.roll", prediction=prediction(parameter("L_p", 4.0))),)
    )
    assert design_summary([other, first], CHOICES)[:2] == (
        "Multisine is best for L_p.",
        "Pilot sweep is best for L_roll.",
    )
    worse = dataclasses.replace(
        first, told=(PlanPrediction(model="rate.roll", prediction=prediction(parameter("L_p", 6.0))),)
    )
    assert design_summary([other, worse], CHOICES)[0] == "Multisine is best for every parameter."


def test_one_name_in_two_models_is_told_apart() -> None:
    (one, _) = designed()
    twice = dataclasses.replace(one, told=(one.told[0], dataclasses.replace(one.told[0], model="rate.pitch")))
    labels = [row.label for row in compared([twice]).rows]
    assert labels == ["L_roll of rate.roll", "L_p of rate.roll", "L_roll of rate.pitch", "L_p of rate.pitch"]


def test_words_come_first(page: Page) -> None:
    sentences = design_summary(designed(), CHOICES)
    assert sentences == (
        "Multisine is best for L_roll.",
        "Pilot sweep on roll and pitch, 49 s in all: expected error of 2 parameters: 2 to 5 % "
        "(L_p is the least accurate); biased estimates: L_p −3 instead of −4, 5 σ off; not enough data for rate.yaw.",
        "Multisine on roll and pitch, 26 s in all: expected error of 2 parameters: 1 to 5 % "
        "(L_p is the least accurate); biased estimates: L_p −3 instead of −4, 5 σ off; not enough data for rate.yaw.",
        "Expected errors are random and model error, as identify will state them.",
        "L_roll to 1.5 % in rate.roll: 40 s of pilot sweep and 40 s of multisine are enough.",
        "Planned for px4_quad in turbulence of 0.5 m/s.",
    )
    order = [page.words.index(words) for words in (*sentences, "Which plan measures best", "Expected accuracy of")]
    assert order == sorted(order)


def test_what_is_not_reached_says_so_in_its_own_words() -> None:
    first, second = designed()
    unreached = dataclasses.replace(shortest(), duration_s=None, words="300 s bring L_roll to 2 %.")
    mixed = design_summary([first, dataclasses.replace(second, shortest={"rate.roll": unreached})], CHOICES)
    assert mixed[4:6] == (
        "L_roll to 1.5 % in rate.roll: 40 s of pilot sweep are enough.",
        "L_roll to 1.5 % in rate.roll: multisine: 300 s bring L_roll to 2 %.",
    )


def test_the_answer_is_drawn_over_what_was_tried(alone: Page) -> None:
    picture = alone.figures["pictures"]["plan-1-duration-0"]
    assert picture["data"][0]["x"] == [15.0, 40.0, 300.0]
    assert picture["data"][0]["y"] == [3.0, 1.4, 1.0]
    assert "L_roll to 1.5 % in rate.roll: 40 s are enough" in alone.words
    assert "each test input, flown 2 times" in alone.words


def test_one_attempt_makes_no_picture() -> None:
    (one, _) = designed()
    found = dataclasses.replace(shortest(), tried=shortest().tried[:2])
    shown = Page(render_design([dataclasses.replace(one, shortest={"rate.roll": found})], CHOICES, title="t"))
    assert not [key for key in shown.attributes("data-picture") if "duration" in key]


def test_pictures_fit_their_places(page: Page, alone: Page) -> None:
    for shown in (page, alone):
        placed = shown.attributes("data-picture")
        assert sorted(placed) == sorted(shown.figures["pictures"])
    assert "comparison" in page.attributes("data-picture")
    assert "comparison" not in alone.attributes("data-picture")
    assert {"plan-1-flight", "plan-2-spectrum", "plan-2-model-0-0"} <= set(page.attributes("data-picture"))


def test_the_flight_is_the_one_whose_extremes_are_told(alone: Page) -> None:
    (one, _) = designed()
    extremes = reached(flown(one, CHOICES))
    traces = alone.figures["pictures"]["plan-1-flight"]["data"]
    (tilt,) = (trace for trace in traces if trace["name"] == "tilt")
    # Five digits are written, and thinning keeps the highest sample.
    assert max(tilt["y"]) == pytest.approx(math.degrees(extremes.tilt_rad), rel=1e-4)
    motors = [value for trace in traces if trace["name"] == "motors" for value in trace["y"]]
    assert (min(motors), max(motors)) == pytest.approx((extremes.motor_low, extremes.motor_high), rel=1e-4)
    (roll, *_) = (trace for trace in traces if trace["name"] == "roll")
    assert max(np.abs(roll["y"])) == pytest.approx(math.degrees(np.abs(one.planned.plan.inputs[0].values).max()), 1e-4)


def test_the_density_of_a_multisine_holds_its_power_at_its_lines() -> None:
    for one in multisines().inputs:
        omega, values = density(one, lines=True)
        lines = omega * 10.0 / (2.0 * math.pi)
        np.testing.assert_allclose(lines, np.round(lines), atol=1e-9)
        assert BAND[0] <= omega[0] < omega[-1] <= BAND[1]
        # Every other harmonic of 10 s belongs to each axis, so lines are 0.2 Hz apart.
        assert values.sum() * 0.2 == pytest.approx(np.mean(one.values[:-1] ** 2), rel=1e-9)


def test_the_density_of_a_sweep_lies_in_its_band_and_holds_its_power() -> None:
    (one, _) = sweeps().inputs
    omega, values = density(one)
    inside = (omega > BAND[0]) & (omega < BAND[1])
    power = np.trapezoid(values, omega / (2.0 * math.pi))
    # Trapezoids over bins of a tenth of their frequency, and what lies beyond the curve.
    assert power == pytest.approx(np.mean(one.values**2), rel=0.1)
    assert np.trapezoid(values[inside], omega[inside]) > 0.8 * np.trapezoid(values, omega)


def test_a_doublet_has_a_density_over_all_frequencies() -> None:
    one = planned("roll", "doublet", start_s=0.0, amplitude=0.1, duration_s=0.6, sample_rate_hz=250.0)
    omega, values = density(one)
    assert np.isfinite(values).all()
    # Two opposite steps of a length T excite most where sin(w T / 2)^4 / w^2 is highest: at 2.33 / T.
    assert omega[values.argmax()] == pytest.approx(2.33 / 0.3, rel=0.15)


@pytest.mark.parametrize(
    ("axis", "entry", "channel"),
    [
        ("roll", "command", "roll_excitation"),
        ("pitch", "attitude_setpoint", "theta_setpoint"),
        ("yaw", "rate_setpoint", "r_setpoint"),
        ("roll", "stick", "roll_stick"),
        ("thrust", "attitude_setpoint", "thrust_excitation"),
    ],
)
def test_a_test_input_is_drawn_in_the_unit_of_where_it_is_added(axis: str, entry: str, channel: str) -> None:
    one = PlannedInput(
        axis=axis,  # type: ignore[arg-type]
        shape="doublet",
        start_s=0.0,
        values=np.array([0.1, -0.1]),
        sample_rate_hz=1.0,
        amplitude=0.1,
        entry=entry,  # type: ignore[arg-type]
    )
    assert input_channel(one) == channel


def test_hostile_text_makes_no_element(page: Page, hostile: Page) -> None:
    assert len(hostile.scripts) == len(page.scripts) == 3
    assert HOSTILE in hostile.words
    assert not any(name.startswith("on") for _, attributes in hostile.elements for name in attributes)
    names = [text for trace in hostile.figures["pictures"]["comparison"]["data"] for text in trace["text"]]
    assert HOSTILE not in names
    assert any("&lt;script&gt;" in name for name in names)


def test_nothing_is_asked_from_the_network_and_links_have_targets(hostile: Page) -> None:
    assert not hostile.attributes("src")
    identifiers = hostile.attributes("id")
    assert len(set(identifiers)) == len(identifiers)
    assert {f"#{name}" for name in identifiers} >= set(hostile.attributes("href"))
    assert not {"link", "img", "iframe", "object", "form", "base"} & {tag for tag, _ in hostile.elements}


def test_a_page_of_nothing_is_refused() -> None:
    with pytest.raises(UsageError, match="at least one"):
        render_design([], CHOICES, title="t")


def test_the_page_is_written_beside_the_document(tmp_path: Path) -> None:
    (one, _) = designed()
    write_design(tmp_path, CHOICES, [one], autopilot=None, command=["rotorid", "design", "sweep"])
    assert json.loads((tmp_path / "design.json").read_text(encoding="utf-8"))["schema"] == "rotorid.design/1"
    shown = Page((tmp_path / "design.html").read_text(encoding="utf-8"))
    assert "A flight plan for px4_quad" in shown.words
    assert "rotorid design sweep" in shown.words
