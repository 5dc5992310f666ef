from __future__ import annotations

import csv
import io
from typing import Any

import numpy as np
import pytest
from tests.unit.report.plan_sample import by_hand, chirp, multisine, step

from rotorid.data.flight_plan import FlightPlan
from rotorid.plans.csv import plan_csv


def read(text: str) -> dict[str, np.ndarray]:
    rows = list(csv.reader(io.StringIO(text)))
    columns = np.array([[float(cell) for cell in row] for row in rows[1:]]).T
    return dict(zip(rows[0], columns, strict=True))


def test_every_column_names_its_axis_its_place_and_its_si_unit() -> None:
    inputs = (
        chirp("roll"),
        chirp("pitch", entry="rate_setpoint"),
        chirp("yaw", entry="attitude_setpoint"),
        chirp("thrust"),
        by_hand("roll"),
    )
    table = read(plan_csv(FlightPlan(name="all", inputs=inputs))["plan.csv"])
    assert set(table) == {
        "time [s]",
        "roll_excitation [1]",
        "pitch_rate_setpoint [rad/s]",
        "yaw_attitude_setpoint [rad]",
        "thrust_excitation [1]",
        "roll_stick [1]",
    }


def test_values_are_those_of_the_plan_at_their_times() -> None:
    short: dict[str, Any] = {"duration_s": 20.0, "band_hz": (0.5, 20.0)}
    first, second = chirp("roll", start_s=1.5, **short), chirp("pitch", start_s=30.0, amplitude=0.08, **short)
    plan = FlightPlan(name="two", inputs=(second, first), trim_s=2.0)
    table = read(plan_csv(plan)["plan.csv"])
    time_s = table["time [s]"]
    assert time_s == pytest.approx(np.arange(round(plan.duration_s * 400.0)) / 400.0, abs=1e-7)
    for name, planned in (("roll_excitation [1]", first), ("pitch_excitation [1]", second)):
        # Seven digits are written.
        assert table[name] == pytest.approx(planned.at(time_s), abs=5e-7 * planned.amplitude)
        begin = round(planned.start_s * 400.0)
        assert table[name][begin : begin + planned.values.size] == pytest.approx(planned.values, abs=1e-7)


def test_inputs_at_the_same_place_add_up() -> None:
    plan = FlightPlan(name="sum", inputs=(step("roll"), step("roll", start_s=0.5, amplitude=0.02)))
    table = read(plan_csv(plan)["plan.csv"])
    assert table["roll_excitation [1]"][round(0.75 * 50.0)] == pytest.approx(0.12)


def test_the_fastest_input_sets_the_rate() -> None:
    plan = FlightPlan(name="mixed", inputs=(step("roll"), *multisine(("pitch",))))
    assert np.diff(read(plan_csv(plan)["plan.csv"])["time [s]"]).max() == pytest.approx(0.01)
