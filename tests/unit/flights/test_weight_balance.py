"""Thrust coefficients from the weight balance, of hovers whose coefficient is known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from tests.unit.flights.hovers import C_2, MASS_KG, hovers

from rotorid.data.record import Channel, FlightRecord, Topic
from rotorid.errors import InsufficientDataError
from rotorid.fits.motors.fit import fit_motor_data
from rotorid.flights.motor_data import motor_data
from rotorid.flights.supports import supports
from rotorid.flights.weight_balance import WeightBalance, weight_balance
from rotorid.reviewing.motors import motors
from rotorid.settings.motors import MotorSettings
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

WHOLE = ((0.0, 40.0),)
WITH_MASS = MotorSettings(known={"m": MASS_KG}, layout="quad.x", arm_m=0.05)


def changed(record: FlightRecord, change: Callable[[dict[str, FloatArray]], dict[str, FloatArray]]) -> FlightRecord:
    """The record with other columns."""
    (topic,) = record.topics
    rows = change(dict(zip((channel.name for channel in topic.channels), topic.values.copy(), strict=True)))
    units = {channel.name: channel.unit for channel in topic.channels}
    channels = tuple(Channel(name=name, unit=units.get(name, "1")) for name in rows)
    values = np.stack(list(rows.values()))
    return replace(record, topics=(Topic(name="all", time_s=topic.time_s, channels=channels, values=values),))


@pytest.fixture(scope="module")
def hover() -> FlightRecord:
    return hovers(1, seed=1, rate_hz=100.0)[0]


def errors_and_hits(found: list[WeightBalance]) -> tuple[FloatArray, float]:
    errors = np.array([balance.coefficient.value / C_2 - 1.0 for balance in found])
    hits = [balance.coefficient.lower <= C_2 <= balance.coefficient.upper for balance in found]
    return errors, float(np.mean(hits))


@pytest.mark.parametrize("rate_hz", [10.0, 50.0, 500.0])
def test_coefficients_of_gusty_hovers_are_within_a_percent(rate_hz: float) -> None:
    """Vertical gusts of 0.3 m/s, accelerometers off by up to 0.1 m/s²."""
    found = [
        weight_balance(record, WHOLE, mass_kg=MASS_KG)
        for record in hovers(16, seed=int(rate_hz), rate_hz=rate_hz, gust_m_s=0.3)
    ]
    errors, hits = errors_and_hits(found)
    assert float(np.sqrt(np.mean(errors**2))) < 0.006
    assert hits >= 0.87
    assert all(balance.coefficient.std < 0.015 * C_2 for balance in found)


@pytest.mark.slow
@pytest.mark.parametrize("gust_m_s", [0.3, 0.6])
@pytest.mark.parametrize("rate_hz", [10.0, 50.0, 500.0])
@pytest.mark.parametrize("logged", [("phi", "theta", "velocity_down"), ("phi", "theta"), ()])
def test_intervals_contain_the_truth(rate_hz: float, gust_m_s: float, logged: tuple[str, ...]) -> None:
    records = hovers(60, seed=int(rate_hz), rate_hz=rate_hz, gust_m_s=gust_m_s, logged=logged)
    _, hits = errors_and_hits([weight_balance(record, WHOLE, mass_kg=MASS_KG) for record in records])
    assert hits >= 0.9


def test_without_a_mass_the_coefficient_is_per_kilogram(hover: FlightRecord) -> None:
    weighed, plain = weight_balance(hover, WHOLE, mass_kg=MASS_KG), weight_balance(hover, WHOLE)
    assert plain.coefficient.value == pytest.approx(weighed.coefficient.value / MASS_KG)
    assert (plain.coefficient.unit, weighed.coefficient.unit) == ("m/rad^2", "N s^2/rad^2")
    assert weighed.level == pytest.approx(np.sqrt(MASS_KG * STANDARD_GRAVITY_M_S2 / 4.0 / C_2), rel=0.02)


def test_gravity_weighs_where_the_accelerometer_is_not_calibrated(hover: FlightRecord) -> None:
    """It shows 5 % too much, which the attitude and the vertical speed of a hover contradict."""
    wrong = changed(hover, lambda rows: {**rows, "az": 1.05 * rows["az"]})
    found = weight_balance(wrong, WHOLE, mass_kg=MASS_KG).coefficient
    assert found.lower <= C_2 <= found.upper
    assert found.value == pytest.approx(C_2, rel=0.015)


def test_a_steady_climb_weighs_nothing() -> None:
    (climbing,) = hovers(1, seed=2, rate_hz=50.0, climb_m_s=3.0)
    with pytest.raises(InsufficientDataError, match="0 s of steady flight"):
        weight_balance(climbing, WHOLE)


def test_seconds_in_which_a_rotor_is_not_seen_are_left_out(hover: FlightRecord) -> None:
    def dropped(rows: dict[str, FloatArray]) -> dict[str, FloatArray]:
        rows["motor_speed_2"][1000:1500] = 0.0
        return rows

    found, whole = (weight_balance(one, WHOLE, mass_kg=MASS_KG) for one in (changed(hover, dropped), hover))
    assert whole.seconds - 7 <= found.seconds <= whole.seconds - 5
    assert found.coefficient.value == pytest.approx(whole.coefficient.value, rel=0.01)


def test_outputs_are_weighed_at_one_voltage(hover: FlightRecord) -> None:
    """Outputs rise while the battery falls from 4.2 to 3.4 V; thrust is 0.5 N of a full output at 3.8 V."""

    def with_outputs(rows: dict[str, FloatArray]) -> dict[str, FloatArray]:
        volts = np.linspace(4.2, 3.4, rows["az"].size)
        outputs = {
            f"motor_{number}": rows[f"motor_speed_{number}"] * np.sqrt(C_2 / 0.5) * 3.8 / volts
            for number in range(1, 5)
        }
        kept = {name: row for name, row in rows.items() if not name.startswith("motor_speed")}
        return {**kept, **outputs, "battery_voltage": volts}

    found = weight_balance(changed(hover, with_outputs), WHOLE, mass_kg=MASS_KG)
    assert (found.kind, found.coefficient.unit) == ("output", "N")
    assert found.reference_v == pytest.approx(3.8, abs=0.02)
    assert found.coefficient.value == pytest.approx(0.5, rel=0.015)
    numbers = motors(changed(hover, with_outputs), mass_kg=MASS_KG)[0].numbers
    assert numbers["thrust_by_output"] == found.coefficient


def test_a_flight_too_short_or_without_an_accelerometer_is_refused(hover: FlightRecord) -> None:
    with pytest.raises(InsufficientDataError, match="2 s of steady flight"):
        weight_balance(hover, ((0.0, 6.0),))
    deaf = changed(hover, lambda rows: {name: row for name, row in rows.items() if name != "az"})
    with pytest.raises(InsufficientDataError, match="lacks az"):
        weight_balance(deaf, WHOLE)
    (why,) = (gap.why for gap in motors(deaf)[1] if gap.what == "motors.thrust_coefficient")
    assert why == "0.csv lacks az; this needs the accelerometer."


def test_a_hover_that_excites_nothing_still_gives_the_coefficient(hover: FlightRecord) -> None:
    found = fit_motor_data(motor_data([hover], WITH_MASS), WITH_MASS)
    balance = weight_balance(hover, ((0.0, 40.0),), mass_kg=MASS_KG)
    assert found.axes == ()
    assert found.parameters["c_2"].value == pytest.approx(balance.coefficient.value, rel=2e-3)
    assert found.bounds.std == pytest.approx([balance.coefficient.std], rel=0.2)
    assert "weight_balance" in {finding.kind for finding in found.left_out}
    assert found.derived["thrust_hover"].value == pytest.approx(MASS_KG * STANDARD_GRAVITY_M_S2 / 4.0, rel=0.02)


def test_without_steady_seconds_a_flight_that_excites_nothing_is_refused() -> None:
    (climbing,) = hovers(1, seed=2, rate_hz=100.0, climb_m_s=3.0)
    with pytest.raises(InsufficientDataError, match="explain its motion on no axis"):
        fit_motor_data(motor_data([climbing], WITH_MASS), WITH_MASS)


def test_measured_speeds_support_the_physics_of_motors(hover: FlightRecord) -> None:
    needs = supports(hover)["physical.motors"].needs
    assert needs[0].there


@pytest.mark.parametrize("factor", [0.0, -1.0, 0.1])
def test_an_accelerometer_that_does_not_carry_the_vehicle_gives_no_coefficient(
    hover: FlightRecord, factor: float
) -> None:
    record = changed(hover, lambda rows: {**rows, "az": factor * rows["az"]})
    with pytest.raises(InsufficientDataError, match="mean az"):
        weight_balance(record, WHOLE)


def test_samples_that_are_no_numbers_change_nothing_else(hover: FlightRecord) -> None:
    def holes(rows: dict[str, FloatArray]) -> dict[str, FloatArray]:
        for name in ("p", "az", "phi", "velocity_down"):
            rows[name][1000:1010] = np.nan
        return rows

    whole, found = weight_balance(hover, WHOLE), weight_balance(changed(hover, holes), WHOLE)
    assert whole.seconds - 2 <= found.seconds <= whole.seconds
    assert found.coefficient.value == pytest.approx(whole.coefficient.value, rel=2e-3)
    assert np.isfinite(found.coefficient.std)
