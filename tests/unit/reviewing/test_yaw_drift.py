"""Yaw drift over battery voltage: known slopes come back inside their intervals, and no slope comes from nothing."""

from __future__ import annotations

import numpy as np
import pytest
from tests.twins.yaw_drift_flights import yaw_drift_flight, yaw_drift_record

from rotorid.data.quantity import Quantity
from rotorid.reviewing.missing import Unavailable
from rotorid.reviewing.yaw_drift import yaw_drift

FLOWN = ((2.0, 238.0),)


def found_in(columns: dict[str, np.ndarray]) -> tuple[dict[str, Quantity], dict[str, Unavailable]]:
    numbers, unavailable = yaw_drift(yaw_drift_record(columns), FLOWN)
    return numbers, {gap.what: gap for gap in unavailable}


@pytest.mark.parametrize(("drift", "trim"), [(0.04, 0.02), (0.0, 0.0)])
def test_intervals_of_slopes_contain_the_truth(drift: float, trim: float) -> None:
    names = {"drift_per_volt": drift, "yaw_trim_per_volt": trim}
    flights = [found_in(yaw_drift_flight(seed=k, drift_per_volt=drift, trim_per_volt=trim))[0] for k in range(60)]
    for name, truth in names.items():
        inside = sum(found[name].lower < truth < found[name].upper for found in flights)
        # Of 60 intervals of 95 %, fewer than 51 contain the truth in one study of ten thousand.
        assert inside >= 51, name
        spread = float(np.std([found[name].value for found in flights], ddof=1))
        stated = float(np.median([found[name].std for found in flights]))
        # Stated errors are as wide as Student's.
        assert 0.7 * spread < stated < 1.8 * spread, name


def test_turns_by_the_stick_are_no_drift() -> None:
    turning, _ = found_in(yaw_drift_flight(seed=3, drift_rad_s=0.1, fall_v=0.0, start_v=15.5))
    assert turning["drift_rad_s"].lower < 0.1 < turning["drift_rad_s"].upper


def test_the_heading_counts_before_a_biased_gyro() -> None:
    columns = yaw_drift_flight(seed=4)
    columns["r"] = columns["r"] + 1.0
    assert abs(found_in(columns)[0]["drift_rad_s"].value) < 0.1
    del columns["psi"]
    assert found_in(columns)[0]["drift_rad_s"].value > 0.9


def test_a_set_point_that_turns_is_not_at_rest() -> None:
    columns = yaw_drift_flight(seed=5)
    columns["psi_setpoint"] = 0.1 * columns["time"]
    numbers, gaps = found_in(columns)
    assert not numbers
    assert gaps["yaw.drift_rad_s"].why == "The yaw stick was centered for 0 s of level flight; 40 s are needed."


def test_a_voltage_that_does_not_move_shows_no_slope() -> None:
    numbers, gaps = found_in(yaw_drift_flight(seed=6, drift_per_volt=0.05, fall_v=0.1))
    assert set(numbers) == {"drift_rad_s", "yaw_trim"}
    assert set(gaps) == {"yaw.drift_per_volt", "yaw.yaw_trim_per_volt"}
    assert "The battery voltage changed by 0." in gaps["yaw.drift_per_volt"].why


@pytest.mark.parametrize(
    ("lacks", "why"),
    [
        (("psi", "r"), "Neither heading nor yaw rate is logged."),
        (("yaw_stick",), "Neither the yaw stick nor a set-point of yaw is logged."),
        (("battery_voltage",), "Battery voltage is not logged in the air."),
    ],
)
def test_what_is_not_logged_is_said(lacks: tuple[str, ...], why: str) -> None:
    columns = {name: values for name, values in yaw_drift_flight(seed=7).items() if name not in lacks}
    _, gaps = found_in(columns)
    assert why in {gap.why for gap in gaps.values()}
