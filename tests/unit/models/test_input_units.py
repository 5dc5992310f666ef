"""A thrust gain has the unit of the motors in the log: by derivation, and never mixed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.record import Channel, FlightRecord, Source, Topic
from rotorid.errors import UsageError
from rotorid.models.input_units import in_logged_units, input_unit, logged_unit, require_same_unit
from rotorid.models.library import library_model


def log(*units: str, name: str = "rig.csv") -> FlightRecord:
    channels = tuple(Channel(name=f"motor_{n}", unit=unit) for n, unit in zip((3, 4, 1, 2), units, strict=False))
    topic = Topic(name="t", time_s=[0.0, 1.0], channels=channels, values=np.zeros((len(channels), 2)))
    return FlightRecord(source=Source(name=name, format="CSV", sha256=""), topics=(topic,))


@pytest.mark.parametrize(
    ("unit", "force", "torque"),
    [("V", "N/V", "N m/V"), ("1", "N", "N m"), ("us", "N/us", "N m/us"), ("rad/s", "N s/rad", "N m s/rad")],
)
def test_gains_have_the_unit_of_the_motors(unit: str, force: str, torque: str) -> None:
    model = in_logged_units(library_model("rig.attitude"), [log(unit, unit, unit, unit)])
    assert (model.parameters["K_f"].unit, model.parameters["K_t"].unit) == (force, torque)
    assert model.parameters["J_x"].unit == "kg m^2"
    require_same_unit(model, log(unit, unit))


@pytest.mark.parametrize(("unit", "needed"), [("V", 10.0), ("1", 1.0), ("us", 1000.0), ("rad/s", 1000.0)])
def test_a_start_value_asks_a_motor_for_the_same_thrust(unit: str, needed: float) -> None:
    before, after = library_model("rig.roll"), in_logged_units(library_model("rig.roll"), [log(unit, unit)])
    assert needed * after.parameters["K_f"].value == pytest.approx(10.0 * before.parameters["K_f"].value)


def test_a_model_of_commands_has_no_unit_of_motors() -> None:
    model = library_model("axis.roll")
    assert input_unit(model) == logged_unit(model, [log("V", "V")]) == ""
    assert in_logged_units(model, [log("V", "V")]) is model


def test_motors_in_two_units_are_refused() -> None:
    with pytest.raises(UsageError, match="motor_3 is in V and motor_4 is in us; expected one unit for all motors"):
        in_logged_units(library_model("rig.roll"), [log("V", "us")])
    with pytest.raises(UsageError, match=r"motor_3 of a\.csv is in V and motor_3 of b\.csv is in 1"):
        in_logged_units(library_model("rig.roll"), [log("V", "V", name="a.csv"), log("1", "1", name="b.csv")])


def test_a_value_that_a_model_fixes_per_volt_asks_for_volts() -> None:
    model = library_model("rig.roll")
    fixed = replace(model, parameters=model.parameters.fix("K_f", 0.109))
    with pytest.raises(UsageError, match=r"K_f = 0.109 N/V.*are in us; expected motors in V"):
        in_logged_units(fixed, [log("us", "us")])


@pytest.mark.parametrize(("own", "other"), [("V", "us"), ("1", "V"), ("rad/s", "1"), ("us", "V")])
def test_a_result_in_one_unit_predicts_no_log_in_another(own: str, other: str) -> None:
    model = in_logged_units(library_model("rig.roll"), [log(own, own)])
    with pytest.raises(UsageError, match=f"are in {other}, and rig.roll is of motors in {own}"):
        require_same_unit(model, log(other, other))
