"""Logs that ``simulate`` makes of a result of ``physical.flight`` give it back: to 8 m/s and back, and by a plan."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from tests.unit.cli.commands import rotorid
from tests.unit.flying.flights import DISC_M2, OF_OUTPUTS, flight, layout
from tests.unit.identifying.flight_logs import layout_file

from rotorid.documents.result import load, save
from rotorid.results.model import IdentifiedModel

THERE_AND_BACK = ("0:8", "8:0")


@pytest.mark.slow
def test_a_simulated_result_is_identified_as_itself(tmp_path: Path) -> None:
    save(flight(), tmp_path / "result")
    logs = []
    for seed, speed in enumerate(THERE_AND_BACK):
        logs.append(tmp_path / speed.replace(":", "-"))
        ran = rotorid(
            *("simulate", tmp_path / "result", "--like", "x500", "--plan", "everyday", "--duration", "40"),
            *("--speed", speed, "--seed", str(seed), "--out", logs[-1], "--quiet"),
        )
        assert ran.code == 0, ran.err
    ran = rotorid(
        *("identify", *(folder / "flight.ulg" for folder in logs), "--model", "physical.flight"),
        *("--layout", layout_file(tmp_path, layout()), "--rotor-diameter", str(math.sqrt(4.0 * DISC_M2 / math.pi))),
        *("--fix", f"m={OF_OUTPUTS['m']}", "--fix", f"I_zz={OF_OUTPUTS['I_zz']}"),
        *("--out", tmp_path / "again", "--quiet"),
    )
    assert ran.code == 0, ran.err
    again, was = load(tmp_path / "again"), flight()
    free = {name: found for name, found in again.parameters.items() if found.std}
    assert {"c_2", "k_d", "T_motor", "I_xx", "I_yy", "kappa", "x_imu"} <= set(free)
    for name, found in free.items():
        # What the ladder adds in vain is zero within its error.
        assert abs(found.value - OF_OUTPUTS.get(name, 0.0)) < 3.0 * (found.std or 0.0), name
    assert again["k_d"].value == pytest.approx(OF_OUTPUTS["k_d"], rel=0.05)
    assert again.flight is not None
    assert was.flight is not None
    for name, stated in was.flight.hover.items():
        assert again.flight.hover[name].value == pytest.approx(stated.value, rel=0.08), name


@pytest.fixture(scope="module")
def closed(tmp_path_factory: pytest.TempPathFactory) -> IdentifiedModel:
    """Plan, fly the result by the plan, identify: what comes back."""
    place = tmp_path_factory.mktemp("closed")
    save(flight(), place / "result")
    sweeps = ("--axis", "roll,pitch,yaw,thrust", "--duration", "20", "--out", place / "plan")
    flown = ("--seed", "1", "--out", place / "flown")
    rotors = ("--layout", layout_file(place, layout()), "--rotor-diameter", str(math.sqrt(4.0 * DISC_M2 / math.pi)))
    known = ("--fix", f"m={OF_OUTPUTS['m']}", "--fix", f"I_zz={OF_OUTPUTS['I_zz']}", "--out", place / "again")
    for words in (
        ("design", "sweep", "--vehicle", "x500", *sweeps),
        ("simulate", place / "result", "--like", "x500", "--plan", place / "plan" / "plan.json", *flown),
        ("identify", place / "flown" / "flight.ulg", "--model", "physical.flight", *rotors, *known),
    ):
        ran = rotorid(*words, "--quiet")
        assert ran.code == 0, ran.err
    found = load(place / "again")
    assert isinstance(found, IdentifiedModel)
    return found


def sigmas(model: IdentifiedModel, name: str) -> float:
    """Distance of a parameter from the truth; what the ladder adds in vain is zero in truth."""
    found = model.parameters[name]
    return abs(found.value - OF_OUTPUTS.get(name, 0.0)) / (found.std or math.inf)


@pytest.mark.slow
def test_a_result_flown_by_a_plan_is_identified_as_itself(closed: IdentifiedModel) -> None:
    free = {name for name, found in closed.parameters.items() if found.std}
    assert {"c_2", "k_d", "T_motor", "I_xx", "I_yy", "kappa", "J_r", "x_imu", "y_imu", "z_imu"} <= free
    far = {name: sigmas(closed, name) for name in free - {"c_2"}}
    assert max(far.values()) < 3.0, far
    # A hover shows the thrust of a rotor, and less surely which part of it is inflow.
    assert sigmas(closed, "c_2") < 4.0
    assert closed.flight is not None
    was = flight().flight
    assert was is not None
    for name, stated in was.hover.items():
        again = closed.flight.hover[name]
        assert abs(again.value - stated.value) < 3.0 * again.std, name


@pytest.mark.slow
@pytest.mark.xfail(
    raises=AssertionError,
    strict=True,
    reason="at hover a part of the square of the thrust curve goes into lower powers and inflow: 3.3 deviations",
)
def test_the_thrust_curve_of_a_result_flown_by_a_plan(closed: IdentifiedModel) -> None:
    assert sigmas(closed, "c_2") < 3.0
