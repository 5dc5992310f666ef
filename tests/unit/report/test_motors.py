"""The page of a fit of physical.motors: the vehicle in numbers, its rotors, its flights, unseen ones."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from tests.unit.report.motor_sample import document, identified, motors
from tests.unit.report.page_parser import Page
from tests.unit.report.sample import HOSTILE, shown_with
from tests.unit.report.sample import document as other_document

from rotorid.documents.base import FindingDocument
from rotorid.documents.result import ResultDocument
from rotorid.report.identification import render_sections, section
from rotorid.report.motors import MotorsShown, curve_with_error, motors_shown
from rotorid.report.parts import Shown, parameter_groups
from rotorid.report.words import (
    method_sentences,
    motor_sentences,
    motor_warnings,
    open_questions,
    scale_sentence,
    summary,
    time_sentences,
)
from rotorid.results.summary import ParameterEstimate


def shown(one: Shown | None = None) -> MotorsShown:
    found = motors_shown(one or identified(), key="m")
    assert found is not None
    return found


def changed(of: ResultDocument | None = None, **motor: Any) -> ResultDocument:
    """The sample with other things said of its motors."""
    return (of or document()).model_copy(update={"motors": dataclasses.replace(motors(), **motor)})


def without(*names: str) -> ResultDocument:
    one = document()
    return one.model_copy(update={"parameters": {k: v for k, v in one.parameters.items() if k not in names}})


def test_the_page_tells_the_vehicle_first() -> None:
    page = Page(render_sections([identified()], title="t"))
    vehicle = [tuple(row[:4]) for row in page.tables[0]]
    assert ("Mass", "m", "1.2", "kg") in vehicle
    assert ("Roll inertia", "I_xx", "0.01500 ± 0.00020", "kg m²") in vehicle
    assert ("Motor lag", "T_motor", "35.0 ± 1.1", "ms") in vehicle
    assert ("Thrust to weight", "", "2.650 ± 0.010", "") in vehicle
    assert ("Pitch inertia", "I_yy", "–", "") in vehicle
    words = " ".join(page.text)
    assert "The given mass of 1.2 kg sets the scale" in words
    assert "Inertia and damping of roll" not in words
    assert "Inertia and damping of pitch and yaw" in words
    assert "simulated" not in words.lower()


def test_every_picture_of_the_page_is_placed() -> None:
    one = section(identified(), anchor="s1", truth={})
    page = Page(render_sections([identified()], title="t"))
    placed = {attributes["data-picture"] for _, attributes in page.elements if "data-picture" in attributes}
    assert {picture.key for picture in one.pictures} == placed
    assert "s1-motors-layout" in placed
    assert one.checks == ()
    assert one.time is None


def test_only_what_was_excited_is_drawn() -> None:
    roll, thrust = shown().flights
    labels = [[panel["text"] for panel in one.picture.figure["layout"]["annotations"]] for one in (roll, thrust)]
    assert labels[0] == ["roll acceleration [°/s²]", "motor 1", "motor 2", "motor 3", "motor 4"]
    assert labels[1][0] == "downward specific force az [m/s²]"
    # Rows of channels, not of the order in which they count: the second flight shows the second row.
    drawn = np.array(thrust.picture.figure["data"][0]["y"])
    np.testing.assert_allclose(drawn, identified().data.simulated[1].measured[1], rtol=1e-4)


def test_a_stretch_that_excites_nothing_has_no_picture() -> None:
    one = identified()
    records = [dataclasses.replace(record, fit_percent={}) for record in one.document.records]
    quiet = shown_with(one, document=one.document.model_copy(update={"records": records}))
    found = shown(quiet)
    assert found.flights == ()
    assert all(verdict is None for row in found.excitation for _, verdict in row.axes)


def test_each_axis_stands_in_its_column() -> None:
    first, second = shown().excitation
    assert [verdict.words if verdict else "" for _, verdict in first.axes] == ["", "91.0 %", "", ""]
    assert [verdict.words if verdict else "" for _, verdict in second.axes] == ["82.0 %", "", "", ""]
    assert [correlation for correlation, _ in first.axes] == ["0.10", "0.97", "0.50", "0.30"]


def test_unseen_flight_stands_on_the_page_and_in_its_summary() -> None:
    found = shown()
    assert [(row.channel, row.verdict.level) for row in found.unseen] == [
        ("roll acceleration", "good"),
        ("downward specific force az", "fair"),
    ]
    # Rows of the prediction are found by name: its order is its own.
    (flight,) = found.unseen_flights
    np.testing.assert_allclose(
        flight.picture.figure["data"][2]["y"], identified().verifications.maneuvers[0].measured[0], rtol=1e-4
    )
    sentence = summary(identified().document)[-1]
    assert sentence.startswith("Unseen flight: 1 of 2 predicted well. Worst: downward specific force az")
    verdict = section(identified(), anchor="s", truth={}).unseen
    assert verdict is not None
    assert verdict.words == "fit below the guideline"


@pytest.mark.parametrize(
    ("scale", "said"), [("m", "The given m sets the scale"), ("I_zz", "The given I_zz sets the scale")]
)
def test_a_scale_that_is_no_parameter_is_named_without_a_value(scale: str, said: str) -> None:
    assert said in scale_sentence(changed(without("m"), scale=scale))


def test_only_what_scales_with_the_mass_is_to_be_multiplied_by_it() -> None:
    # Damping, lag and delay beside it have no mass in their units.
    assert "Thrust and inertia assume a vehicle of 1 kg" in scale_sentence(changed(without("m"), scale=None))


@pytest.mark.parametrize("names", [("c_1",), ("c_0", "c_1"), ("c_0", "c_1", "c_2")])
def test_the_band_of_thrust_is_the_covariance_of_its_coefficients(names: tuple[str, ...]) -> None:
    one = without(*({"c_0", "c_1", "c_2"} - set(names)))
    outputs = np.linspace(0.0, 1.0, 7)
    thrust, std = curve_with_error(one, outputs)
    powers = np.stack([outputs ** int(name[-1]) for name in names])
    deviations = np.diag([one.parameters[name].std or 0.0 for name in names])
    correlation = np.eye(len(names))
    if "c_2" in names:
        correlation[1, 2] = correlation[2, 1] = -0.9
    covariance = deviations @ correlation @ deviations
    np.testing.assert_allclose(thrust, np.array([one.parameters[name].value for name in names]) @ powers, rtol=1e-12)
    np.testing.assert_allclose(std, np.sqrt(np.diag(powers.T @ covariance @ powers)), rtol=1e-12)


def test_a_given_curve_has_no_band() -> None:
    one = without("c_0", "c_2")
    given = dataclasses.replace(one.parameters["c_1"], status="fixed", std=None)
    one = one.model_copy(update={"parameters": one.parameters | {"c_1": given}})
    thrust, std = curve_with_error(one, np.array([0.5]))
    assert thrust.tolist() == [0.75]
    assert std.tolist() == [0.0]


def test_slow_motors_are_said_above_everything() -> None:
    findings = [FindingDocument(kind="not_converged", severity="warning", where="physical.motors", message="Moved.")]
    slow = changed(document().model_copy(update={"findings": findings}), outputs_rate_hz=9.4)
    page = render_sections([shown_with(identified(), document=slow)], title="t")
    words = " ".join(Page(page).text)
    assert words.index("Motors were logged at 9.4 Hz") < words.index("Inertia: I_xx")
    assert "did not converge" in words
    assert motor_warnings(document()) == ()
    lost = document().model_copy(update={"fit_percent": {"p_dot": -38.0}})
    assert motor_warnings(lost) == (
        "The motors do not explain roll acceleration: do not use the values identified from it.",
    )


def test_what_was_assumed_is_said_with_its_remedy() -> None:
    bare = changed(scale=None, arm_m=None)
    sentences = " ".join(motor_sentences(bare))
    assert "per kilogram of mass and meter of arm" in sentences
    assert "a vehicle of 1 kg" in sentences
    told = " ".join(open_questions(bare))
    assert "--fix m=KILOGRAMS" in told
    assert "--arm METERS" in told
    ratio = document().model_copy(
        update={
            "parameters": {
                **document().parameters,
                "kappa_per_I_zz": ParameterEstimate(value=0.7, unit="1/(kg m)", std=0.01, status="free"),
            }
        }
    )
    assert "--fix kappa=METERS" in " ".join(open_questions(ratio))
    assert "--fix" not in " ".join(open_questions(document()))


def test_a_lag_that_is_not_there_is_not_invented() -> None:
    assert "too short to separate from the delay tau_gyro" in " ".join(motor_sentences(without("T_motor")))
    calm = without("T_motor")
    none = dataclasses.replace(calm.parameters["tau_gyro"], value=0.0, status="fixed", std=None)
    calm = calm.model_copy(update={"parameters": calm.parameters | {"tau_gyro": none}})
    assert "none found, and no delay either" in " ".join(motor_sentences(calm))
    assert "lag" not in " ".join(motor_sentences(changed(without("T_motor"), outputs="speed")))


def test_measured_speeds_are_joined_and_have_their_unit() -> None:
    fast = changed(outputs="speed", hover_output=660.0, flown_outputs=(500.0, 900.0))
    found = shown(shown_with(identified(), document=fast))
    assert found.curve.figure["layout"]["xaxis"]["title"]["text"] == "Motor speed [rad/s]"
    assert "shape" not in found.flights[0].picture.figure["data"][-1]["line"]
    assert shown().flights[0].picture.figure["data"][-1]["line"]["shape"] == "hv"
    assert method_sentences(fast)[-1].startswith("Motor speeds are interpolated")


def test_words_of_the_method_are_those_of_this_fit() -> None:
    one = document()
    assert one.fit is not None
    told = time_sentences(one, one.fit)
    assert told[0].startswith("Prediction error method: the motors predict")
    assert told[-1] == "The last search ended after 3 evaluations: the cost rests."
    vertical = changed(excitation=[motors().excitation[1]])
    assert not any("rates" in sentence for sentence in method_sentences(vertical))


def test_parameters_have_a_group_of_their_own() -> None:
    groups = parameter_groups(document(), {})
    assert groups[0].title == "Mass, thrust and inertia"
    assert [row.name for row in groups[0].rows] == ["m", "c_0", "c_1", "c_2", "I_xx"]
    assert all(row.words for group in groups for row in group.rows)


def test_names_of_a_log_do_not_act() -> None:
    excitation = [dataclasses.replace(one, record=HOSTILE) for one in motors().excitation]
    hostile = changed(excitation=excitation, source=HOSTILE, layout=HOSTILE)
    simulated = tuple(dataclasses.replace(one, record=HOSTILE) for one in identified().data.simulated)
    page = render_sections([shown_with(identified(), document=hostile, simulated=simulated)], title="t")
    assert HOSTILE not in page


def test_another_model_shows_none_of_it() -> None:
    other = shown_with(identified(), document=other_document())
    assert motors_shown(other, key="m") is None
    assert motor_sentences(other_document()) == motor_warnings(other_document()) == ()
    assert open_questions(other_document()) == method_sentences(other_document()) == ()
