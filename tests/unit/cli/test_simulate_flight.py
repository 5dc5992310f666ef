"""``simulate``, ``design`` and ``vehicles``: files, words and codes, as a user meets them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from tests.unit.cli.commands import rotorid

from rotorid import read
from rotorid.vehicles import rig

pytestmark = pytest.mark.usefixtures("computed_once")

HOVER = ("--plan", "none", "--duration", "4")


@pytest.fixture(scope="module")
def designed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("design")
    ran = rotorid(
        "design", "sweep", "--vehicle", "px4_quad", "--axis", "roll", "--band", "1:40", "--duration", "30",
        "--doublets", "--turbulence", "0.3", "--reach", "L_roll=2", "--out", folder,
    )  # fmt: skip
    assert ran.code == 0, ran.err
    return folder


def test_a_design_is_a_plan_its_predictions_and_files_for_pilot_and_autopilot(designed: Path) -> None:
    document = json.loads((designed / "design.json").read_text())
    (plan,) = document["plans"]
    assert set(plan["files"]) == {path.name for path in designed.iterdir()} - {"design.json", "design.html"}
    assert {"plan.json", "plan.csv", "flight-card.html", "px4_fly_plan.py", "px4.params"} <= set(plan["files"])
    assert [one["shape"] for one in plan["inputs"]] == ["pilot_sweep", "doublet", "doublet"]
    assert plan["reached"]["tilt_rad"] <= document["limits"]["tilt_rad"]
    (prediction,) = plan["predictions"]
    assert prediction["model"] == "rate.roll"
    assert prediction["parameters"]["L_roll"]["std"] > prediction["parameters"]["L_roll"]["lowest_std"] > 0.0
    (shortest,) = plan["shortest"]
    assert shortest["wanted_percent"] == {"L_roll": 2.0}


def test_a_plan_is_flown_identified_and_known_about_as_well_as_was_said(designed: Path, tmp_path: Path) -> None:
    told = json.loads((designed / "design.json").read_text())["plans"][0]["predictions"][0]["parameters"]
    ran = rotorid("simulate", "px4_quad", "--plan", designed / "plan.json", "--turbulence", "0.3", "--out", tmp_path)
    assert ran.code == 0, ran.err
    truth = json.loads((tmp_path / "simulation.json").read_text())["truth"]
    assert read(tmp_path / "flight.ulg").source.format == "PX4 ULog"
    ran = rotorid("identify", tmp_path / "flight.ulg", "--model", "rate.roll", "--out", tmp_path / "result", "--json")
    found = json.loads(ran.out)["parameters"]
    for name in ("L_roll", "T_motor"):
        std = max(found[name]["std"], told[name]["std"])
        assert abs(found[name]["value"] - truth[name]["value"]) < 4.0 * std + 0.005 * truth[name]["value"]
        # What is foretold is what noise and gusts do; what the model leaves out comes on top.
        assert 0.2 < found[name]["std_random"] / told[name]["std"] < 5.0


def test_a_previous_result_is_the_prior_of_the_next_plan(designed: Path, tmp_path: Path) -> None:
    heavy = ("--set", "m=1.3", "--set", "I_xx=0.032")
    plan = ("--plan", designed / "plan.json")
    assert rotorid("simulate", "px4_quad", *heavy, *plan, "--out", tmp_path / "first").code == 0
    ran = rotorid("identify", tmp_path / "first" / "flight.ulg", "--model", "rate.roll", "--out", tmp_path / "result")
    assert ran.code == 0
    given = ("--axis", "roll", "--amplitude", "roll=0.3", "--duration", "30", "--band", "1:40")
    ran = rotorid(
        "design", "sweep", "--vehicle", "px4_quad", *given, "--prior", tmp_path / "result", "--json",
        "--out", tmp_path / "next",
    )  # fmt: skip
    assert ran.code == 0, ran.err
    expected = json.loads(ran.out)["plans"][0]["predictions"][0]["parameters"]["L_roll"]
    # 113.1 for the vehicle of the library.
    assert expected["value"] == pytest.approx(113.1 * 0.025 / 0.032, rel=0.02)
    assert expected["expected"] == pytest.approx(expected["value"], rel=0.02)
    tuned = ("--axis", "roll", "--amplitude", "roll=0.3", "--entry", "command", "--for-tune", tmp_path / "result")
    ran = rotorid("design", "log_sweep", "--vehicle", "px4_quad", *tuned, "--json", "--out", tmp_path / "tune")
    assert ran.code == 0, ran.err
    planned = json.loads(ran.out)
    low, high = planned["plans"][0]["inputs"][0]["band_rad_s"]
    assert low == 2.0
    assert 40.0 < high < 90.0
    assert planned["plans"][0]["predictions"][0]["parameters"]["L_roll"]["value"] == expected["value"]


def test_a_log_gives_its_gains_its_noise_and_says_so(designed: Path, tmp_path: Path) -> None:
    assert rotorid("simulate", "px4_quad", "--plan", designed / "plan.json", "--out", tmp_path / "first").code == 0
    given = ("--axis", "roll", "--amplitude", "roll=0.3", "--duration", "30")
    ran = rotorid(
        "design", "sweep", "--vehicle", "px4_quad", *given, "--gains", tmp_path / "first" / "flight.ulg",
        "--out", tmp_path / "next",
    )  # fmt: skip
    assert ran.code == 0
    assert "From flight.ulg: wind 0." in ran.err
    document = json.loads((tmp_path / "next" / "design.json").read_text())
    assert document["provenance"]["settings"]["gyro_noise_rad_s"] == pytest.approx(0.066, rel=0.1)
    assert "air_of_log" in {finding["kind"] for finding in document["findings"]}


def test_several_kinds_are_compared(tmp_path: Path) -> None:
    ran = rotorid(
        "design", "multisine", "binary", "--vehicle", "ardupilot_quad", "--axis", "roll", "--duration", "20",
        "--band", "1:40", "--json", "--out", tmp_path,
    )  # fmt: skip
    document = json.loads(ran.out)
    assert [plan["kind"] for plan in document["plans"]] == ["multisine", "random_binary"]
    assert set(document["best"].values()) <= {"multisine", "random_binary"}
    # Neither is what ArduPilot flies by itself, and that is said.
    warned = [finding["kind"] for finding in document["findings"] if finding["severity"] == "warning"]
    assert warned == ["not_written", "not_written"]
    assert (tmp_path / "multisine" / "plan.json").exists()


def test_a_hover_without_a_plan_is_logged(tmp_path: Path) -> None:
    ran = rotorid("simulate", "x500", *HOVER, "--wind", "3,1", "--turbulence", "0.5", "--out", tmp_path, "--json")
    document = json.loads(ran.out)
    assert document["schema"] == "rotorid.simulation/1"
    assert document["logs"][0]["duration_s"] == pytest.approx(4.0)
    assert {path.name for path in tmp_path.iterdir()} == {"flight.ulg", "simulation.json"}


@pytest.mark.parametrize(("format", "name"), [("ulg", "PX4 ULog"), ("bin", "ArduPilot DataFlash"), ("csv", "CSV")])
def test_a_flight_is_the_same_in_every_format(tmp_path: Path, format: str, name: str) -> None:
    vehicle = "px4_quad" if format == "ulg" else "ardupilot_quad"
    ran = rotorid("simulate", vehicle, *HOVER, "--format", format, "--out", tmp_path, "--json")
    record = read(tmp_path / json.loads(ran.out)["logs"][0]["file"])
    assert record.source.format == name
    assert {"p", "q", "r", "roll_command", "thrust_command"} <= set(record.channel_names)


def test_runs_differ_in_seed_and_draws_and_are_the_same_alone(tmp_path: Path) -> None:
    common = ("simulate", "px4_quad", *HOVER, "--vary", "m=10", "--json", "--out")
    many = json.loads(rotorid(*common, tmp_path / "many", "--runs", "3").out)["logs"]
    assert [log["file"] for log in many] == ["flight_1.ulg", "flight_2.ulg", "flight_3.ulg"]
    assert len({log["changed"]["m"] for log in many}) == 3
    alone = json.loads(rotorid(*common, tmp_path / "alone", "--seed", str(many[1]["seed"])).out)["logs"][0]
    assert (alone["sha256"], alone["changed"]) == (many[1]["sha256"], many[1]["changed"])


def test_numbers_of_a_vehicle_change_what_is_true(tmp_path: Path) -> None:
    ran = rotorid("simulate", "px4_quad", *HOVER, "--set", "I_xx=0.05", "--out", tmp_path, "--json")
    truth = json.loads(ran.out)["truth"]
    assert truth["L_roll"]["value"] == pytest.approx(113.1 / 2.0, rel=1e-3)
    assert np.isclose(truth["M_pitch"]["value"], 113.1, rtol=1e-3)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("simulate", "x50"), "did you mean x500"),
        (("simulate", "rig", "--wind", "3"), "does not fly"),
        (("design", "doublet", "--vehicle", "rig"), "does not fly"),
        (("simulate", "x500", "--set", "mass=2"), "number of a vehicle 'mass'"),
        (("simulate", "x500", "--set", "m=heavy"), "NAME=VALUE"),
        (("simulate", "x500", "--wind", "strong"), "NORTH,EAST"),
        (("simulate", "x500", "--plan", "nowhere.json"), "cannot be read"),
        (("simulate", "x500", "--plan", "none", "--format", "xml"), "format"),
        (("simulate", "x500", "--plan", "none", "--runs", "0"), "--runs 0"),
        (("design", "wobble", "--vehicle", "x500"), "kind of test input 'wobble'"),
        (("design", "sweep", "--vehicle", "x500", "--axis", "rol"), "did you mean roll"),
        (("design", "sweep", "--vehicle", "x500", "--limit", "speed=3"), "limit 'speed'"),
        (("design", "sweep", "--vehicle", "x500", "--reach", "L_rol=2"), "free parameter"),
        (("design", "sweep", "--vehicle", "x500", "--entry", "sticks"), "did you mean stick"),
        (("design", "sweep", "sweep", "--vehicle", "x500"), "each once"),
        (("design", "sweep", "--vehicle", "x500", "--for-tune", "no.ulg", "--band", "1:9"), "--for-tune and --band"),
        (
            ("design", "sweep", "--vehicle", "x500", "--for-tune", "no.ulg", "--gains", "no.ulg"),
            "--for-tune and --gains",
        ),
        (("design", "sweep", "--vehicle", "x500", "--limit", "tilt=-3"), "the limit -3 deg of tilt is not positive"),
        (("design", "sweep", "--vehicle", "x500", "--model", "rate.roll,rate.rol"), "'rate.rol'"),
        (("simulate", "x500", "--turbulence", "-1"), "turbulence is -1 m/s"),
        (("simulate", "x500", "--height", "0"), "height above ground is 0 m"),
        (("simulate", "no.json", "--log", "no.csv", "--height", "3"), "--height cannot be used with --log"),
    ],
)
def test_wrong_use_is_code_2_and_says_what_to_do(arguments: tuple[str, ...], words: str, tmp_path: Path) -> None:
    ran = rotorid(*arguments, "--out", tmp_path / "out")
    assert ran.code == 2
    assert words in ran.err
    assert not (tmp_path / "out").exists()


def test_vehicles_are_listed_with_their_sources() -> None:
    listed = json.loads(rotorid("vehicles", "--json").out)["vehicles"]
    assert {"s500", "hummingbird", "bebop", "rig", "iris", "x500", "crazyflie", "ardupilot_quad"} <= {
        one["name"] for one in listed
    }
    assert all(one["source"] for one in listed)
    assert "s500" in rotorid("vehicles").out


def test_the_rig_is_moved_and_its_ratio_found(tmp_path: Path) -> None:
    ran = rotorid("simulate", "rig", "--out", tmp_path, "--json")
    truth = {name: one["value"] for name, one in json.loads(ran.out)["truth"].items()}
    given: tuple[str, ...] = ("--fix", f"L={truth['L']}", "--fix", f"J_x={truth['J_x']}")
    given = (*given, "--segment", "roll:0:119", "--outputs", "phi", "--windows", "71,60,40")
    given = (*given, "--instrument", "motor_3_excitation,motor_4_excitation")
    given = (*given, "--json", "--out", str(tmp_path / "result"))
    found = json.loads(rotorid("identify", tmp_path / "flight.csv", "--model", "rig.roll", *given).out)
    assert found["parameters"]["K_f"]["value"] == pytest.approx(truth["K_f"], rel=0.02)


def test_the_rig_as_a_new_user_would(tmp_path: Path) -> None:
    """Nothing is named by hand: the sweep is found, its test inputs are the instruments, another log verifies."""
    for seed in ("0", "1"):
        assert rotorid("simulate", "rig", "--seed", seed, "--out", tmp_path / seed, "--quiet").code == 0
    log, other = tmp_path / "0" / "flight.csv", tmp_path / "1" / "flight.csv"
    seen = json.loads(rotorid("inspect", log, "--json").out)
    assert [(one["axis"], one["kind"]) for one in seen["excitations"]] == [("roll", "sweep")]
    assert seen["supports"]["rig.roll"]["possible"]
    assert not seen["supports"]["rig.attitude"]["possible"]
    assert "sweep of single motors turns the vehicle in pitch" in seen["supports"]["rig.attitude"]["because"]
    given = ("--model", "rig.roll", "--fix", f"J_x={rig.TRUTH['J_x']}", "--verify", other, "--json")
    found = json.loads(rotorid("identify", log, *given, "--out", tmp_path / "result").out)
    for name in ("K_f", "tau_3", "tau_4"):
        one = found["parameters"][name]
        assert abs(one["value"] - rig.TRUTH[name]) <= 3.0 * one["std"]
        assert one["lower"] <= rig.TRUTH[name] <= one["upper"]
        assert one["std"] <= 0.03 * rig.TRUTH[name]
    assert "saturation" not in {one["kind"] for one in found["findings"]}
    assert "motor_3_excitation, motor_4_excitation" in next(
        one["message"] for one in found["findings"] if one["kind"] == "closed_loop_bias"
    )
    assert set(found["verification"]["frequency"]) == {"phi/motor_3", "phi/motor_4", "p/motor_3", "p/motor_4"}
    assert max(found["verification"]["frequency"].values()) < 20.0


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ((), "does not describe its rotors; expected --layout"),
        (("--layout", "quad.x"), "physical.hover needs m, D, l, rho, k_n, which no flight shows"),
        (("--layout", "quad.x", "--fix", "m=1", "--arm", "0.2"), "physical.hover needs D, rho, k_n"),
        (("--layout", "quad.x", "--arm", "-0.2", "--rotor-diameter", "0.2", "--fix", "m=1", "--fix", "rho=1.2",
          "--fix", "k_n=100"), "l = -0.2 is not positive; expected a positive arm"),
        (("--layout", "quad.x", "--arm", "0.2", "--fix", "l=0.2"), "l was given with --arm and with --fix"),
        (("--layout", "x8", "--arm", "0.2", "--rotor-diameter", "0.2", "--fix", "m=1", "--fix", "rho=1.2",
          "--fix", "k_n=100"), "above one another"),
        (("--layout", "quad.x", "--curve", "linear"), "to physical.hover; leave it out, or use physical.motors."),
    ],
)  # fmt: skip
def test_geometry_that_no_flight_tells_is_asked_for(given: tuple[str, ...], words: str, tmp_path: Path) -> None:
    log = tmp_path / "flight.csv"
    time_s = np.arange(0.0, 2.0, 0.01)
    rows = [f"{t:.2f},{np.sin(t):.4f},{np.cos(t):.4f}" for t in time_s]
    log.write_text("\n".join(["time [s],q [rad/s],pitch_command [1]", *rows]))
    ran = rotorid("identify", log, "--model", "physical.hover", *given, "--out", tmp_path / "out")
    assert ran.code == 2
    assert words in ran.err
    assert len(ran.err.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_the_bebop_shows_its_interface_alone(tmp_path: Path) -> None:
    ran = rotorid("simulate", "bebop", "--plan", "none", "--duration", "10", "--out", tmp_path, "--json")
    record = read(tmp_path / json.loads(ran.out)["logs"][0]["file"])
    assert {"phi_setpoint", "phi", "velocity_down_setpoint", "velocity_down"} <= set(record.channel_names)
    assert not {"roll_command", "p"} & set(record.channel_names)
    steps = np.diff(record.topics[0].time_s)
    assert np.median(steps) == pytest.approx(0.05, abs=0.005)
    assert np.std(steps) > 0.0


def test_a_blackbox_log_is_of_betaflight_alone(tmp_path: Path) -> None:
    toml = rotorid("vehicles", "betaflight_quad", "--toml").out
    (tmp_path / "as_it_is.toml").write_text(toml.replace('"betaflight_quad"', '"mine"'))
    other = rotorid("vehicles", "px4_quad", "--toml").out
    (tmp_path / "turned.toml").write_text(other.replace('kind = "px4"', 'kind = "betaflight"'))
    out = tmp_path / "out"
    for vehicle in ("px4_quad", "ardupilot_quad", "crazyflie", tmp_path / "turned.toml"):
        ran = rotorid("simulate", vehicle, *HOVER, "--format", "bbl", "--out", out)
        assert (ran.code, out.exists()) == (2, False), vehicle
        assert "Betaflight" in ran.err
    assert rotorid("simulate", tmp_path / "turned.toml", *HOVER, "--format", "csv", "--out", out).code == 0
    assert rotorid("simulate", tmp_path / "as_it_is.toml", *HOVER, "--out", out).code == 0
    assert (out / "flight.bbl").is_file()
