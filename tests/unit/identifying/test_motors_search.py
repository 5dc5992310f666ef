"""A global search of the motors' chain finds the start from which the fit comes to its one answer."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from tests.unit.identifying.motor_logs import ARM_M, flight

from rotorid.errors import UsageError
from rotorid.fitting.motors.problem import MotorProblem
from rotorid.fitting.motors.start import searched_motors
from rotorid.identifying.identification import identify_motors
from rotorid.io.registry import read
from rotorid.models.motors import motor_parameters
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.motors import MotorSettings, motor_settings
from rotorid.vehicles.motor_flight import TRUTH, flights, levers

CHOICES = MotorSettings(known={"m": TRUTH["m"]}, layout="quad.x", arm_m=ARM_M)


@pytest.mark.slow
def test_a_search_comes_to_the_answer_of_the_local_fit(tmp_path: Path) -> None:
    log = read(flight(tmp_path / "flight.csv"))
    local = identify_motors([log], CHOICES)
    sought = identify_motors([log], replace(CHOICES, search="genetic:4x3"))
    for name, found in sought.parameters.items():
        assert found.value == pytest.approx(local[name].value, abs=0.1 * (local[name].std_random or 1e-9)), name
    assert sought.fit.search is not None
    assert sought.fit.search.name == "genetic:4x3"
    assert local.fit.search is None


def test_the_problem_of_a_search_is_coarse_and_slow() -> None:
    record = flights(1, seed=3, duration_s=20.0)[0]
    problem = MotorProblem(records=(record,), levers=levers(), parameters=motor_parameters(known={"m": TRUTH["m"]}))
    coarse = searched_motors(problem)
    assert coarse.records[0].sample_rate_hz == pytest.approx(50.0)
    box = coarse.search_box
    for name, low, high in zip(coarse.parameters.free, box.lower, box.upper, strict=True):
        assert low <= TRUTH[name] <= high, name


def test_motors_take_the_options_of_a_search() -> None:
    chosen = motor_settings(IdentifySettings(search="genetic:15x50", evaluations=50))
    assert chosen is not None
    assert (chosen.search, chosen.evaluations) == ("genetic:15x50", 50)
    with pytest.raises(UsageError, match="unknown search"):
        MotorSettings(search="genetics")
