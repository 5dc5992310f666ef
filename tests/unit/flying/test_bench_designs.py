"""Sweeps for a rig: within the angle that was stated, independent of each other, and as exact as was foretold."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

import rotorid
from rotorid.cli.app import app
from rotorid.errors import RotoridError, UsageError
from rotorid.flying.bench_designs import BenchDesign, BenchSettings, design_bench, flown_on_rig
from rotorid.models.input_units import in_logged_units
from rotorid.models.library import library_model
from rotorid.planning.prior import Prior
from rotorid.vehicles import rig

LIMIT_RAD = math.radians(6.0)


@pytest.fixture(scope="module")
def settings() -> BenchSettings:
    return BenchSettings(limit_rad=LIMIT_RAD, duration_s=80.0)


@pytest.fixture(scope="module")
def found(settings: BenchSettings) -> BenchDesign:
    return design_bench(settings)


@pytest.fixture(scope="module")
def usual() -> BenchDesign:
    """For the rig that is known, in volts."""
    return design_bench(BenchSettings(limit_rad=LIMIT_RAD, duration_s=40.0, band_rad_s=(0.5, 12.0)))


def test_the_angle_stays_within_the_limit(found: BenchDesign) -> None:
    assert 0.7 * LIMIT_RAD < found.reached_rad < LIMIT_RAD
    unseen = flown_on_rig(found.plan, seed=99, noise=0.0)
    assert np.abs(unseen["phi"].values).max() < LIMIT_RAD
    first, second = found.plan.inputs
    assert [(part.motor, part.unit, part.start_s) for part in found.plan.inputs] == [
        ("motor_3", "V", 4.0),
        ("motor_4", "V", 4.0),
    ]
    # Two motors that move alike show no delay of their own.
    assert abs(np.corrcoef(first.values, second.values)[0, 1]) < 0.2
    assert not found.findings


def test_a_log_of_the_plan_gives_the_truth_with_the_errors_that_were_foretold(found: BenchDesign) -> None:
    log = flown_on_rig(found.plan, seed=5)
    model = rotorid.identify([log], "rig.roll", outputs=("phi",), fix={"J_x": rig.TRUTH["J_x"]})
    assert found.model == "rig.roll"
    for name, expected in found.expected.items():
        parameter = model.parameters[name]
        assert (expected.value, expected.unit) == (rig.TRUTH[name], parameter.unit)
        assert 0.4 < expected.std / parameter.std < 2.5, name
        assert abs(parameter.value - expected.value) < 3.0 * parameter.std, name


def test_an_amplitude_by_hand_says_where_it_ends(settings: BenchSettings) -> None:
    found = design_bench(
        BenchSettings(limit_rad=LIMIT_RAD, duration_s=80.0, amplitudes={"roll": 0.6}, axes=settings.axes)
    )
    assert [finding.kind for finding in found.findings] == ["beyond_limits"]
    assert found.reached_rad > LIMIT_RAD


@pytest.mark.parametrize(("unit", "volt"), [("us", 80.0), ("rad/s", 70.0), ("1", 0.08)])
def test_a_rig_of_ones_own_is_swept_in_its_own_unit(usual: BenchDesign, unit: str, volt: float) -> None:
    from rotorid.data.record import Channel, FlightRecord, Source, Topic

    topic = Topic(name="t", time_s=[0.0], channels=(Channel(name="motor_3", unit=unit),), values=np.zeros((1, 1)))
    log = FlightRecord(source=Source(name="a.csv", format="CSV", sha256=""), topics=(topic,))
    structure = in_logged_units(library_model("rig.roll"), [log])
    prior = Prior(structure=structure, values={**rig.TRUTH, "K_f": rig.TRUTH["K_f"] / volt}, source="own")
    own = design_bench(BenchSettings(limit_rad=LIMIT_RAD, duration_s=40.0, band_rad_s=(0.5, 12.0), prior=prior))
    assert {part.unit for part in own.plan.inputs} == {unit}
    assert own.plan.inputs[0].amplitude == pytest.approx(volt * usual.plan.inputs[0].amplitude, rel=0.1)
    with pytest.raises(UsageError, match=f"drives motor_3_excitation in {unit}; expected single motors in V"):
        flown_on_rig(own.plan, seed=0)


def test_what_no_rig_can_do_is_refused() -> None:
    with pytest.raises(UsageError, match="yaw has no pair of motors"):
        BenchSettings(axes=("yaw",))
    with pytest.raises(UsageError, match=r"periods of 0\.3 rad/s"):
        BenchSettings(duration_s=10.0)


def run(*words: str) -> int:
    return int(app(list(words), standalone_mode=False) or 0)


def test_the_command_writes_plan_card_and_a_flight_of_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan = tmp_path / "plan"
    words = ("--limit", "tilt=6", "--duration", "40", "--band", "0.5:12", "--out", str(plan))
    run("design", "sweep", "--vehicle", "rig", *words)
    said = capsys.readouterr().out
    assert "Predicted angle: ± " in said
    document = json.loads((plan / "design.json").read_text(encoding="utf-8"))
    assert document["schema"] == "rotorid.design-bench/1"
    assert document["reached_rad"] < document["limit_rad"] == pytest.approx(LIMIT_RAD)
    assert [sweep["unit"] for sweep in document["sweeps"]] == ["V", "V"]
    card = (plan / "bench-card.html").read_text(encoding="utf-8")
    assert "± 6°" in card
    assert "motor_3" in card
    header = (plan / "plan.csv").read_text(encoding="utf-8").splitlines()[0]
    assert header == "time [s],motor_3_excitation [V],motor_4_excitation [V]"
    run("simulate", "rig", "--plan", str(plan / "plan.json"), "--out", str(tmp_path / "flown"))
    flown = rotorid.read(tmp_path / "flown" / "flight.csv")
    assert flown["motor_3_excitation"].unit == "V"
    assert flown.stop_s == pytest.approx(48.0, abs=0.1)
    with pytest.raises(UsageError, match="--doublets cannot be used for a rig"):
        run("design", "sweep", "--vehicle", "rig", "--doublets", "--out", str(plan))


def test_a_plan_for_a_rig_of_ones_own_is_flown_by_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, result, plan = tmp_path / "log", tmp_path / "result", tmp_path / "plan"
    run("simulate", "rig", "--set", "K_f=0.2", "--set", "tau_4=0.12", "--out", str(log))
    run(
        *("identify", str(log / "flight.csv"), "--model", "rig.roll", "--outputs", "phi", "--fix", "J_x=0.047"),
        "--out",
        str(result),
    )
    words = ("--duration", "40", "--band", "0.5:12", "--out", str(plan))
    run("design", "sweep", "--vehicle", "rig", "--prior", str(result), *words)
    assert f"rotorid simulate {result} --plan {plan / 'plan.json'}" in capsys.readouterr().out
    run("simulate", str(result), "--plan", str(plan / "plan.json"), "--out", str(tmp_path / "flown"))
    flown = json.loads((tmp_path / "flown" / "simulation.json").read_text(encoding="utf-8"))
    known = json.loads((result / "result.json").read_text(encoding="utf-8"))["parameters"]
    assert flown["truth"]["K_f"] == {"value": known["K_f"]["value"], "unit": "N/V"}
    assert flown["truth"]["K_f"]["value"] == pytest.approx(0.2, rel=0.03)
    assert flown["truth"]["tau_4"]["value"] == pytest.approx(0.12, abs=0.03)
    assert flown["vehicle"]["description"].startswith("identified: rig.roll")


@pytest.mark.parametrize(("given", "said"), [("Kf=1", "did you mean K_f"), ("K_f=-1", "K_f is -1; expected more than")])
def test_numbers_that_no_rig_has_are_refused(given: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(RotoridError, match=said):
        run("simulate", "rig", "--set", given, "--out", str(tmp_path / "rig"))
