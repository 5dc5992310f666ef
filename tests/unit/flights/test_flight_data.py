"""Whole flights on one clock: what of a log the physics of flight sees."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.identifying.flight_logs import DIAMETER_M, flown, layout_file, without

from rotorid.data.record import FlightRecord, Maneuver
from rotorid.errors import InsufficientDataError, ModelError
from rotorid.flights.flight_data import USUAL_DISC_SHARE, FlightMotion, flight_data, given_airframe, neighbor_distance
from rotorid.flights.motor_stamps import motor_skew
from rotorid.models.rotors import library_layout
from rotorid.settings.motors import MotorSettings

VELOCITY = ("velocity_north", "velocity_east", "velocity_down")


@pytest.fixture(scope="module")
def layout(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(layout_file(tmp_path_factory.mktemp("layout")))


def read(record: FlightRecord, layout: str, **choices: object) -> FlightMotion:
    settings = MotorSettings(known={"m": 0.52}, layout=layout, rotor_diameter_m=DIAMETER_M)
    return flight_data([record], replace(settings, **choices))  # type: ignore[arg-type]


def test_a_flight_comes_whole_with_all_axes(layout: str) -> None:
    twin = flown()
    data = read(twin.record, layout)
    (record,) = data.records
    assert data.velocity == "measured"
    assert data.sources == {"motors": "flight", "velocity": "flight"}
    assert record.duration_s > 19.0
    first = round(record.start_s * record.sample_rate_hz)
    kept = slice(first, first + record.samples)
    assert np.allclose(record.force, twin.motors.force[:, kept])
    assert np.allclose(record.velocity, twin.motors.velocity[:, kept], atol=1e-9)
    assert np.allclose(record.attitude[:2], twin.motors.attitude[:2, kept])
    assert abs(data.skews_s[0]) < 0.004


def test_the_skew_of_whole_flights_is_that_of_inspect(layout: str) -> None:
    record = flown().record
    data = read(record, layout)
    assert data.skews_s == (motor_skew(record, data.layout).late_s.value,)


@pytest.mark.parametrize(
    ("lacking", "velocity"), [(VELOCITY, "attitude"), ((*VELOCITY, "psi"), "none"), (("psi",), "none")]
)
def test_what_is_not_logged_is_left_out(lacking: tuple[str, ...], velocity: str, layout: str) -> None:
    data = read(without(flown().record, *lacking), layout)
    assert data.velocity == velocity
    assert "velocity" not in data.sources


def test_a_velocity_that_never_moves_counts_as_not_logged(layout: str) -> None:
    record = flown().record
    (topic,) = record.topics
    values = np.array(topic.values)
    for row, channel in enumerate(topic.channels):
        if channel.name in VELOCITY:
            values[row] = 0.0
    data = read(replace(record, topics=(replace(topic, values=values),)), layout)
    assert data.velocity == "attitude"


@pytest.mark.parametrize(("rising_m_s", "begins_s"), [(0.0, 0.0), (1.5, 1.0)])
def test_a_log_that_begins_with_lift_off_loses_its_first_second(
    rising_m_s: float, begins_s: float, layout: str
) -> None:
    record = flown().record
    (topic,) = record.topics
    values = np.array(topic.values)
    rows = [row for row, channel in enumerate(topic.channels) if channel.name in VELOCITY]
    first = topic.time_s < topic.time_s[0] + 1.0
    values[np.ix_(rows, first)] = 0.0
    down = next(row for row, channel in enumerate(topic.channels) if channel.name == "velocity_down")
    values[down, first] = -rising_m_s * (topic.time_s[first] - topic.time_s[0])
    (found,) = read(replace(record, topics=(replace(topic, values=values),)), layout).records
    assert found.start_s - topic.time_s[0] == pytest.approx(begins_s, abs=0.05)


def test_a_given_stretch_is_taken_as_it_is(layout: str) -> None:
    part = Maneuver(axis="thrust", kind="other", start_s=4.0, stop_s=17.0, origin="given")
    (record,) = read(flown().record, layout, segments=(part,)).records
    assert record.start_s == pytest.approx(4.0, abs=0.01)
    assert record.time_s[-1] == pytest.approx(17.0, abs=0.01)


def test_a_missing_accelerometer_axis_is_refused(layout: str) -> None:
    with pytest.raises(InsufficientDataError, match="ax") as failed:
        read(without(flown().record, "ax"), layout)
    assert failed.value.findings[0].kind == "missing_channel"


def test_motors_of_another_time_are_refused(layout: str) -> None:
    record = flown().record
    (topic,) = record.topics
    values = np.array(topic.values)
    rows = [row for row, channel in enumerate(topic.channels) if channel.name.startswith("motor_speed_")]
    values[rows] = np.roll(values[rows], 1500, axis=1)
    with pytest.raises(InsufficientDataError, match="do not explain its motion"):
        read(replace(record, topics=(replace(topic, values=values),)), layout)


def test_a_skew_of_speeds_is_found(layout: str) -> None:
    record = flown().record
    (topic,) = record.topics
    values = np.array(topic.values)
    rows = [row for row, channel in enumerate(topic.channels) if channel.name.startswith("motor_speed_")]
    values[rows] = np.roll(values[rows], -5, axis=1)
    late = read(replace(record, topics=(replace(topic, values=values),)), layout).skews_s[0]
    assert late - read(record, layout).skews_s[0] == pytest.approx(5 / 250.0, abs=0.001)


def test_the_disc_is_assumed_where_nobody_gave_it() -> None:
    layout = library_layout("quad.x").scaled(0.25)
    given = given_airframe(layout, MotorSettings(known={"m": 1.5}, rotor_diameter_m=0.254))
    assert (given.scaled, given.disc_assumed) == (True, False)
    assert given.diameter_m == pytest.approx(0.254)
    assumed = given_airframe(layout, MotorSettings(known={"m": 1.5}))
    assert assumed.disc_assumed
    assert assumed.diameter_m == pytest.approx(USUAL_DISC_SHARE * neighbor_distance(layout))


def test_without_a_mass_numbers_are_of_a_kilogram() -> None:
    given = given_airframe(library_layout("quad.x").scaled(0.25), MotorSettings(rotor_diameter_m=0.254))
    assert given.airframe.mass_kg == 1.0
    assert (given.scaled, given.disc_assumed) == (False, True)


def test_rotors_on_one_axis_are_no_neighbors() -> None:
    layout = library_layout("y6").scaled(0.3)
    assert neighbor_distance(layout) > 0.3


def test_the_size_has_to_be_known() -> None:
    with pytest.raises(InsufficientDataError, match="--arm"):
        given_airframe(library_layout("quad.x"), MotorSettings(known={"m": 1.5}))


@pytest.mark.parametrize(
    ("known", "said"),
    [
        ({"c_lamda": 1e-4}, "did you mean c_lambda"),
        ({"m": -1.0}, "not possible"),
        ({"kappa": 0.016, "I_zz": 0.01}, "both kappa and I_zz"),
    ],
)
def test_impossible_values_are_refused(known: dict[str, float], said: str) -> None:
    with pytest.raises(ModelError, match=said):
        given_airframe(library_layout("quad.x").scaled(0.25), MotorSettings(known=known))
