"""The page of a fit of physical.flight: drag and inflow in numbers, thrust by flow, drag by airspeed, wind, terms."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from tests.unit.report.motor_sample import document as motor_document
from tests.unit.report.motor_sample import free, identified, motors
from tests.unit.report.page_parser import Page

from rotorid.documents.result import ResultDocument
from rotorid.report.flight import FlightShown, air_rows, drag_words, flight_shown, limits_sentence, thrust_by_flow
from rotorid.report.identification import render_sections
from rotorid.report.motors import curve_with_error
from rotorid.report.parts import Shown
from rotorid.report.tables import flight_tables
from rotorid.report.words import method_sentences, motor_sentences
from rotorid.results.summary import (
    Derived,
    DragPoint,
    FlightLimits,
    FlightOfLog,
    FlightPhysics,
    LadderStep,
    MotorOctave,
)

SPEED, INDUCED = 800.0, 6.0


def flight(**changes: Any) -> FlightPhysics:
    known = {
        "velocity": "measured",
        "velocity_source": "vehicle_local_position",
        "disc_m2": 0.05,
        "disc_assumed": True,
        "density_kg_m3": 1.225,
        "ladder": (
            LadderStep(terms=("k_w",), before_n=0.62, after_n=0.55, entered=True),
            LadderStep(terms=("c_h", "c_hw"), before_n=0.55, after_n=0.549, entered=False, why="no gain"),
        ),
        "missing": {"d_z": "the flight stays below 8 m/s"},
        "octaves": (
            MotorOctave(axis="p", low_hz=1.0, high_hz=2.0, correlation=0.31, fitted=False),
            MotorOctave(axis="p", low_hz=2.0, high_hz=4.0, correlation=0.91, fitted=True),
        ),
        "logs": (
            FlightOfLog(
                record="a.ulg",
                start_s=10.0,
                stop_s=42.0,
                sample_rate_hz=250.0,
                wind_m_s=(3.1, -1.9),
                wind_std_m_s=(0.2, 0.3),
                skew_s=0.012,
                force_rms_n=0.61,
                force_axes_n=(0.2, 0.13, 0.56),
                moment_rms_nm=0.024,
            ),
        ),
        "limits": FlightLimits(edge_m_s=(0.1, 10.8), climb_m_s=(-7.2, 5.6), load=(0.7, 2.0), motors=(600.0, 1600.0)),
        "hover": {
            "thrust_coefficient": Derived(value=4.6e-6, std=1e-8, unit="N s^2/rad^2"),
            "thrust_slope": Derived(value=0.0073, std=1e-4, unit="N s/rad"),
            "speed": Derived(value=SPEED, std=2.0, unit="rad/s"),
            "induced_velocity": Derived(value=INDUCED, std=0.0, unit="m/s"),
            "drag": Derived(value=0.3, std=0.01, unit="1/s"),
        },
        "drag": (
            DragPoint(airspeed_m_s=1.0, measured_n=0.3, modeled_n=0.31, seconds=4.0),
            DragPoint(airspeed_m_s=8.0, measured_n=2.6, modeled_n=2.5, seconds=2.0),
        ),
        "scatter": "assumed",
    }
    return FlightPhysics(**(known | changes))  # type: ignore[arg-type]


def document(**changes: Any) -> ResultDocument:
    of_motors = motor_document()
    parameters = {
        "m": of_motors.parameters["m"],
        "c_2": free(5.6e-6, "N s^2/rad^2", 1e-7),
        "c_lambda": free(1.3e-4, "N s^2/(m rad)", 1e-5),
        "k_d": free(1.1e-4, "N s^2/(m rad)", 2e-6),
        "x_imu": free(-0.02, "m", 0.003),
        "I_xx": free(0.015, "kg m^2", 0.001),
    }
    changed = dataclasses.replace(motors(), outputs="speed", flown_outputs=(600.0, 1600.0), hover_output=SPEED)
    return of_motors.model_copy(
        update={"parameters": parameters, "motors": changed, "flight": flight(**changes), "correlation": None}
    )


def page_of(of: ResultDocument) -> Page:
    sample = identified()
    return Page(render_sections([Shown(of, sample.data, sample.verifications)], title="t"))


def shown(of: ResultDocument | None = None) -> FlightShown:
    sample = identified()
    found = flight_shown(Shown(of or document(), sample.data, sample.verifications), key="k")
    assert found is not None
    return found


def test_other_models_have_no_air() -> None:
    assert flight_shown(identified(), key="k") is None


def test_the_page_says_drag_wind_and_terms() -> None:
    page = page_of(document())
    words = " ".join(page.text)
    assert "top speed at 30° of tilt 19 m/s (15 to 20 m/s)" in words
    assert "Rotor drag: 0.300 ± 0.010 1/s in hover." in words
    assert shown().logs[0].wind == "3.10 ± 0.20 north, −1.90 ± 0.30 east"
    assert shown().ladder[1].result == "left out: no gain"
    cells = [cell for table in page.tables for row in table for cell in row]
    assert "the flight stays below 8 m/s" in cells
    assert "usual scatter between flights" in words
    assert "Velocity was logged (vehicle_local_position)" in words


def test_every_number_of_the_air_has_a_row() -> None:
    rows = {row.symbol: row for row in air_rows(document(), flight())}
    assert {"c_2", "c_lambda", "k_d", "x_imu", "d_z"} <= set(rows)
    assert not rows["d_z"].known
    # Mass and inertia are in the table of the vehicle.
    assert not {"m", "I_xx"} & set(rows)


def test_the_range_is_a_sentence() -> None:
    found = limits_sentence(flight(), motors())
    assert "up to 11 m/s" in found
    assert "load factor 0.7 to 2" in found


def test_thrust_falls_in_climb_and_rises_in_fast_flight() -> None:
    of = document()
    assert of.flight is not None
    assert of.motors is not None
    flows = thrust_by_flow(of, of.flight, of.motors, np.array([SPEED]))
    hover, climb, ahead = (float(row[0]) for row in flows.values())
    # Fast flight takes induced velocity away.
    assert climb < hover < ahead
    # The curve of the rotors is that of hover.
    assert hover == pytest.approx(float(curve_with_error(of, np.array([SPEED]))[0][0]), rel=0.15)


def test_pictures_are_there_where_their_data_are() -> None:
    assert [picture.key for picture in shown().pictures] == ["k-thrust", "k-drag"]
    assert [picture.key for picture in shown(document(drag=())).pictures] == ["k-thrust"]


def test_numbers_of_a_closed_loop_are_named_so() -> None:
    assert "never exported" in shown(document(predictor={"I_xx": 0.03})).predictor
    assert shown().predictor == ""


def test_octaves_name_the_used_ones() -> None:
    ((axis, cells),) = shown().octaves
    assert axis == "roll"
    assert cells == (("0.31", False), ("0.91", True))


def test_without_drag_there_is_no_top_speed() -> None:
    hover = {name: value for name, value in flight().hover.items() if name != "drag"}
    assert drag_words(flight(hover=hover)) == ""
    assert "Rotor drag" not in " ".join(motor_sentences(document(hover=hover)))


def test_the_method_is_said() -> None:
    sentences = " ".join(method_sentences(document()))
    assert "momentum theory" in sentences
    assert "octaves" in sentences


def test_tables_for_a_paper() -> None:
    logs, ladder = flight_tables(flight())
    assert logs.rows[0][3:5] == (3.1, -1.9)
    assert [row[-1] for row in ladder.rows] == ["used", "no gain"]
