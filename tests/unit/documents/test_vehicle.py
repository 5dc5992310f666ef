"""Vehicle files: what flies from them, what is refused, and what results make of them."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.unit.cli.commands import rotorid
from tests.unit.flying.test_vehicle_from_results import ARM_M, hover, motors

from rotorid.documents.result import save
from rotorid.documents.vehicle import named_vehicle, parse_vehicle, read_vehicle, vehicle_toml
from rotorid.errors import ModelError, UsageError
from rotorid.flying.simulation import simulate
from rotorid.flying.user_vehicles import own_vehicle
from rotorid.results.summary import ControllerSettings, Straightening
from rotorid.simulation.linearization import hover_derivatives_of
from rotorid.simulation.multirotor import RotorFlow
from rotorid.simulation.multirotor_flight import Aircraft
from rotorid.simulation.wind import Wind
from rotorid.vehicles.catalog import VEHICLES, aircraft, aircraft_names, entry_of

MINE = """
schema = "rotorid.vehicle/1"
name = "mine"
autopilot = "px4_quad"

[body]
mass_kg = 1.2
inertia_kg_m2 = [0.012, 0.012, 0.02]
derivatives = { X_u = -0.3, L_p = -1.0 }

[rotors]
layout = "quad.x"
arm_m = 0.25
thrust_n = [0.0, 0.0, 9.0]
torque_per_thrust_m = 0.02
lag_up_s = 0.03
"""


def refused(text: str) -> str:
    with pytest.raises(UsageError) as error:
        parse_vehicle(text, where="mine.toml")
    return str(error.value)


@pytest.mark.parametrize("name", aircraft_names())
def test_a_vehicle_of_the_library_is_the_same_from_its_file(name: str) -> None:
    text = vehicle_toml(VEHICLES[name])
    again = parse_vehicle(text, where=name)
    assert vehicle_toml(again) == text
    assert again.source == VEHICLES[name].source


@pytest.mark.parametrize("base", [None, "x500", "px4_quad"])
def test_a_flight_from_a_file_is_that_of_the_library(tmp_path: Path, base: str | None) -> None:
    path = tmp_path / "x500.toml"
    path.write_text(vehicle_toml(VEHICLES["x500"], base=base), encoding="utf-8")
    air = Wind(north_m_s=2.0, turbulence_m_s=0.5)
    own, library = (simulate(one, duration_s=2.0, wind=air, seed=3) for one in (read_vehicle(path), "x500"))
    assert set(own.columns) == set(library.columns)
    for name, column in library.columns.items():
        np.testing.assert_allclose(own.columns[name], column, rtol=1e-12, atol=1e-14, err_msg=name)


def test_a_file_written_by_hand_flies() -> None:
    entry = parse_vehicle(MINE, where="mine.toml")
    body = entry.aircraft.vehicle
    assert body.aerodynamics is not None
    assert (body.aerodynamics[0, 0], body.aerodynamics[3, 3]) == (pytest.approx(-0.36), -0.012)
    assert entry.aircraft.autopilot.rates == aircraft("px4_quad").autopilot.rates
    assert np.abs(simulate(entry, duration_s=1.0).columns["p"]).max() < 1.0


def test_the_file_in_the_docs_flies() -> None:
    page = (Path(__file__).resolve().parents[3] / "docs" / "vehicles.md").read_text(encoding="utf-8")
    (text,) = re.findall(r"^```toml\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    assert parse_vehicle(text, where="vehicles.md").aircraft.vehicle.mass_kg == 1.2


def test_moving_air_comes_back_from_a_file() -> None:
    craft = aircraft("forward_quad")
    flow = RotorFlow(disc_m2=0.05, flapping_n_s=0.001, wake_n_s2_m3=-0.02)
    rotors = replace(craft.vehicle.rotors, flow=flow)
    flying = replace(craft, vehicle=replace(craft.vehicle, rotors=rotors, vertical_drag_n_s2_m2=0.01))
    text = vehicle_toml(replace(VEHICLES["forward_quad"], make=lambda: flying))
    again = parse_vehicle(text, where="mine.toml").aircraft.vehicle
    assert (again.rotors.flow, again.vertical_drag_n_s2_m2) == (flow, 0.01)
    assert "[flow] has the unknown key disk_m2; did you mean disc_m2?" in refused(text.replace("disc_m2", "disk_m2"))


def test_numbers_on_top_of_a_base_count() -> None:
    table = '[autopilot]\nbase = "px4_quad"\ngyro_cutoff_hz = 30.0\nrates.integral = [0.1, 0.1, 0.1]\n'
    text = MINE.replace('autopilot = "px4_quad"\n', "") + table
    own = parse_vehicle(text, where="mine.toml").aircraft.autopilot
    assert (own.gyro_cutoff_hz, own.rates.integral) == (30.0, (0.1, 0.1, 0.1))
    gains = parse_vehicle(text + "parameters = { MC_ROLLRATE_P = 0.05 }\n", where="mine.toml").aircraft.autopilot
    assert gains.rates.proportional[0] == 0.05
    assert gains.gyro_cutoff_hz == 30.0


def test_rotors_are_placed_one_by_one() -> None:
    places = [(0.2, 0.25, "ccw"), (-0.2, -0.25, "ccw"), (0.2, -0.25, "cw"), (-0.2, 0.25, "cw")]
    tables = "".join(f'[[rotor]]\nposition_m = [{x}, {y}, 0.0]\nspin = "{spin}"\n' for x, y, spin in places)
    text = MINE.replace('layout = "quad.x"\narm_m = 0.25\n', "") + tables
    layout = parse_vehicle(text, where="mine.toml").aircraft.vehicle.rotors.layout
    np.testing.assert_array_equal(layout.positions[:, :2], [place[:2] for place in places])
    assert "not said once" in refused(MINE + tables)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("mass_kg", "mas_kg", r"mine.toml, [body] has the unknown key mas_kg; did you mean mass_kg?"),
        ("name =", "nmae =", "did you mean name?"),
        ("lag_up_s", "lag_s", "[rotors] has the unknown key lag_s"),
        ("0.02]", "0.05]", "principal moments of inertia 0.012, 0.012, 0.05"),
        ("9.0]", "1.0]", "would hover at 1.7"),
        ("mass_kg = 1.2", "mass_kg = nan", "body.mass_kg = nan"),
        ("mass_kg = 1.2", "mass_kg = -1.2", "positive mass"),
        ("0.02\nlag", "1e308\nlag", "numbers up to 1e+12"),
        ("mass_kg = 1.2", "mass_kg = 'heavy'", "body.mass_kg"),
        ("L_p = -1.0", "L_q = -1.0", "there is no derivative L_q"),
        ('"quad.x"', '"quad.xx"', "did you mean quad.x?"),
        ('"px4_quad"', '"px4_qaud"', "did you mean px4_quad?"),
        ('"mine"', '"../mine"', "the name '../mine' is not allowed"),
        ("vehicle/1", "vehicle/9", "has the schema rotorid.vehicle/9"),
        ("[body]", "[body", "is no vehicle"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(old: str, new: str, said: str) -> None:
    assert said in refused(MINE.replace(old, new, 1))


def test_an_autopilot_without_a_base_is_whole() -> None:
    said = refused(MINE.replace('autopilot = "px4_quad"', "") + '[autopilot]\nkind = "px4"\n')
    assert "[autopilot] lacks rate_hz, angle_1_s, rates.proportional" in said


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("results")
    for name, model in {"motors": motors(), "hover": hover(X_u=-0.2, M_u=3.0)}.items():
        save(model, folder / name)
    return {"motors": folder / "motors", "hover": folder / "hover"}


def test_results_and_a_similar_vehicle_make_one_that_flies(results: dict[str, Path]) -> None:
    named = named_vehicle([str(one) for one in results.values()], like="px4_quad", given={"kappa": 0.02, "tau": 0.004})
    assert named.entry.name == "motors"
    assert named.changes == {"tau": 0.004}
    body, own = named.entry.aircraft.vehicle, named.own
    assert own is not None
    assert body.aerodynamics is not None
    assert body.aerodynamics[0, 0] == pytest.approx(-0.3)
    assert "Y_v = -1 1/s" in own.taken
    assert not any("kappa" in words or "I_xx" in words for words in own.taken)
    again = parse_vehicle(named.toml, where="mine.toml").aircraft
    assert_same(again, named.entry.aircraft)
    assert named.entry.aircraft.autopilot.delay_s == (0.004,) * 4
    assert named.entry.aircraft.autopilot.parameters["CA_ROTOR0_PX"] == pytest.approx(ARM_M / 2.0**0.5)


def assert_same(one: Aircraft, other: Aircraft) -> None:
    for mine, theirs in zip(one.vehicle.body(), other.vehicle.body(), strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=1e-12, atol=1e-15)
    for mine, theirs in zip(
        one.autopilot.control(one.vehicle, substeps=4), other.autopilot.control(other.vehicle, substeps=4), strict=True
    ):
        np.testing.assert_allclose(mine, theirs, rtol=1e-12)
    assert one.sensors == other.sensors


def test_gains_are_those_of_the_log() -> None:
    flew = ControllerSettings(
        autopilot="PX4",
        firmware="1.17",
        loop_rate_hz=250.0,
        gains={"MC_ROLLRATE_P": 0.07},
        filters={},
        settings={"IMU_GYRO_CUTOFF": 47.0},
    )
    model = replace(motors(), controller=flew)
    own = own_vehicle([model], like=aircraft("px4_quad"), given={"kappa": 0.02})
    assert own.aircraft.autopilot.rates.proportional[0] == 0.07
    assert own.aircraft.autopilot.gyro_cutoff_hz == 47.0
    assert "gains and filters" not in own.taken
    assert "gains and filters" in own_vehicle([motors()], like=aircraft("px4_quad"), given={"kappa": 0.02}).taken


def test_results_of_a_whole_body_fly_without_another_vehicle() -> None:
    """Gains are those of the log, or make loops as fast as a plain one's, slower by the lag."""
    flew = ControllerSettings(
        autopilot="PX4", firmware="1.17", loop_rate_hz=250.0, gains={"MC_ROLLRATE_P": 0.07}, filters={}
    )
    logged = own_vehicle([replace(motors(), controller=flew)], like=None, given={"kappa": 0.02})
    assert (logged.whole, logged.like, logged.aircraft.autopilot.rates.proportional[0]) == (True, "px4_quad", 0.07)
    assert not any(number.source == "default" for number in logged.joined.numbers.values())
    derived, plain = own_vehicle([motors()], like=None, given={"kappa": 0.02}), aircraft("hummingbird")
    assert derived.aircraft.autopilot.kind == plain.autopilot.kind
    assert any("gains of hummingbird, for the answer" in words for words in derived.taken)
    crossover, other = (
        np.array(one.autopilot.rates.proportional)
        * [hover_derivatives_of(one.vehicle, one.autopilot)[name] for name in ("L_roll", "M_pitch", "N_yaw")]
        for one in (derived.aircraft, plain)
    )
    slow = np.array(derived.aircraft.autopilot.angle_1_s) / plain.autopilot.angle_1_s
    assert (slow <= 1.0).all()
    np.testing.assert_allclose(crossover, slow * other, rtol=1e-9)
    with pytest.raises(UsageError, match="--like px4_quad"):
        own_vehicle([hover(X_u=-0.2)], like=None)


def test_results_name_the_firmware_that_flew(tmp_path: Path) -> None:
    flew = ControllerSettings(
        autopilot="ArduPilot", firmware="ArduCopter V4.7.0", loop_rate_hz=400.0, gains={}, filters={}
    )
    for name, model in {"known": replace(motors(), controller=flew), "unknown": motors()}.items():
        save(model, tmp_path / name)
    known, unknown = (
        named_vehicle([str(tmp_path / name)], like="ardupilot_quad", given={"kappa": 0.02, "m": 1.0})
        for name in ("known", "unknown")
    )
    assert (known.firmware, unknown.firmware, named_vehicle(["x500"]).firmware) == ("ArduCopter V4.7.0", "", "")


def test_thrust_by_demand_flies_without_a_curve() -> None:
    """ArduPilot's mixer in the library holds a factor of its simulator, which is in the identified thrust here."""
    model = motors(scale="m")
    assert model.motors is not None
    line = Straightening(expo=0.65, low=0.15, high=0.95, hover_share=0.39)
    model = replace(model, motors=replace(model.motors, outputs="thrust_demand", straightening=line))
    own = own_vehicle([model], like=aircraft("ardupilot_quad"), given={"kappa": 0.02})
    autopilot = own.aircraft.autopilot
    assert (autopilot.linearization.expo, autopilot.parameters["MOT_THST_EXPO"], autopilot.mixer) == (0.0, 0.0, None)
    assert autopilot.parameters["FRAME_TYPE"] == 1.0
    assert any("demands of thrust" in words for words in own.taken)
    assert_same(
        parse_vehicle(vehicle_toml(entry_of(own.aircraft), base="ardupilot_quad"), where="a").aircraft, own.aircraft
    )


@pytest.mark.parametrize(
    ("words", "options", "said"),
    [
        (["x50"], {}, "did you mean x500"),
        (["x500", "iris"], {}, "x500 and iris came; expected one vehicle"),
        (["x500"], {"like": "iris"}, "--like iris does not apply to x500"),
        ([], {}, "no vehicle came"),
        (["mine.toml"], {}, "mine.toml cannot be read"),
    ],
)
def test_words_that_name_no_vehicle(words: list[str], options: dict[str, str], said: str) -> None:
    with pytest.raises((UsageError, ModelError), match=said):
        named_vehicle(words, **options)  # type: ignore[arg-type]


def test_a_vehicle_may_be_what_flies_itself() -> None:
    assert entry_of(aircraft("x500")).aircraft.name == "x500"


def test_files_are_printed_and_flown(results: dict[str, Path], tmp_path: Path) -> None:
    ran = rotorid(
        "vehicles", "--from", results["motors"], results["hover"], "--like", "px4_quad", "--set", "kappa=0.02"
    )
    assert ran.code == 0
    assert ran.err.startswith("not identified, so taken from px4_quad: ")
    assert "#   m = 1.5 kg, given: physical.motors of one.ulg" in ran.out
    own = tmp_path / "mine.toml"
    own.write_text(ran.out, encoding="utf-8")
    hovering = ("--plan", "none", "--duration", "3")
    flown = rotorid("simulate", own, *hovering, "--out", tmp_path / "file")
    assert flown.code == 0, flown.err
    direct = rotorid(
        "simulate",
        *results.values(),
        "--like",
        "px4_quad",
        "--set",
        "kappa=0.02",
        *hovering,
        "--out",
        tmp_path / "results",
    )
    assert direct.code == 0
    assert "taken from px4_quad" in direct.err
    same = [(tmp_path / name / "flight.ulg").read_bytes() for name in ("file", "results")]
    assert len(same[0]) == len(same[1])


def test_wrong_use_of_the_commands(results: dict[str, Path], tmp_path: Path) -> None:
    for words, said in {
        ("vehicles", "--from", str(results["motors"])): "--like px4_quad",
        ("vehicles", "x500"): "add --toml",
        ("vehicles", "--toml"): "--toml needs a vehicle",
        ("vehicles", "x500", "--toml", "--set", "m=3"): "--set m cannot be written to a vehicle file",
        ("simulate", "x50", "--out", str(tmp_path / "a")): "did you mean x500",
        ("design", "sweep", "--vehicle", "motros", "--out", str(tmp_path / "a")): "a vehicle file .toml",
        ("simulate", str(results["motors"]), "--like", "px4_quad", "--set", "kappa=0.2"): "no rigid body",
    }.items():
        ran = rotorid(*words)
        assert ran.code == 2, words
        assert said in ran.err
        assert ran.out == ""
    assert not list(tmp_path.iterdir())


def test_a_vehicle_of_the_library_is_printed() -> None:
    ran = rotorid("vehicles", "x500", "--toml")
    assert ran.code == 0, ran.err
    assert parse_vehicle(ran.out, where="x500").name == "x500"
