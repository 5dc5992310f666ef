"""Commands that are proposed run as they are printed, on made logs of each autopilot, and plan for their vehicle."""

from __future__ import annotations

import json
import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.unit.cli.commands import rotorid

from rotorid.autopilots.autopilot import LogFormat
from rotorid.data.record import FlightRecord, Source
from rotorid.documents.vehicle import named_vehicle
from rotorid.flying.designs import computed_for, has_room, plan_with
from rotorid.flying.flight_air import flown_as
from rotorid.flying.next_steps import KnownOfLog, next_steps, sweep_for_tune
from rotorid.flying.settings import DesignSettings, PlanSettings
from rotorid.flying.simulation import everyday_plan, truth_of
from rotorid.flying.user_vehicles import hovering_at
from rotorid.io.registry import read, write_log
from rotorid.simulation.multirotor_flight import changed, fly_multirotor
from rotorid.vehicles.catalog import aircraft
from rotorid.vehicles.px4 import with_gains

MAP = """
[clock]
time = { source = "t" }
[channels.roll_command]
source = "command"
[channels.roll_excitation]
source = "test"
[channels.p]
source = "rate"
unit = "rad/s"
"""


def commands_of(*arguments: str) -> list[list[str]]:
    """The commands that a verb proposes in its JSON, as words."""
    ran = rotorid(*arguments, "--json")
    assert ran.code == 0, ran.err
    return [shlex.split(one) for one in json.loads(ran.out)["next_commands"]]


def failed(commands: Sequence[Sequence[str]]) -> dict[str, str]:
    """Those that do not end with 0, with what they said."""
    found = {}
    for words in commands:
        assert words[0] == "rotorid"
        ran = rotorid(*words[1:], "--quiet")
        if ran.code:
            found[shlex.join(words)] = ran.err
    return found


@pytest.fixture
def table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A table whose columns only a mapping names, with a name that needs quotes."""
    craft = changed(aircraft("px4_quad"), {"I_xx": 0.02})
    choices = PlanSettings(axes=("roll",), duration_s=40.0, entry="command", amplitudes={"roll": 0.1})
    flight = fly_multirotor(craft, plan_with(craft, choices, {"roll": 0.1}), seed=3)
    columns = [flight.time_s, *(flight.columns[name] for name in ("roll_command", "roll_excitation", "p"))]
    header = "t,command,test,rate"
    np.savetxt(tmp_path / "my flight.csv", np.transpose(columns), delimiter=",", header=header, comments="")
    (tmp_path / "my names.toml").write_text(MAP)
    monkeypatch.chdir(tmp_path)
    return "my flight.csv"


def test_the_mapping_of_a_table_is_part_of_each_command(table: str) -> None:
    commands = commands_of("inspect", table, "--map", "my names.toml")
    assert commands
    assert all(words[2:5] == [table, "--map", "my names.toml"] for words in commands)
    assert failed([words for words in commands if words[1] == "identify"]) == {}


def test_a_terminal_prints_the_path_of_the_mapping(table: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    place = tmp_path / "elsewhere"
    place.mkdir()
    monkeypatch.chdir(place)
    told = rotorid("inspect", Path("..") / table, "--map", Path("..") / "my names.toml").out
    (line,) = [line.strip() for line in told.splitlines() if line.strip().startswith("rotorid identify")]
    assert shlex.split(line)[2:5] == [f"../{table}", "--map", "../my names.toml"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("vehicle", "form"),
    [("px4_quad", "ulg"), ("ardupilot_quad", "bin"), ("betaflight_quad", "bbl"), ("crazyflie", "csv")],
)
def test_every_command_that_is_proposed_runs(
    vehicle: str, form: LogFormat, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    craft = aircraft(vehicle)
    flight = fly_multirotor(craft, everyday_plan(craft, duration_s=90.0, level=0.5, seed=3), seed=3)
    write_log(Path(f"my flight.{form}"), flight, format=form)
    commands = [*commands_of("inspect", f"my flight.{form}"), *commands_of("review", f"my flight.{form}")]
    assert {words[1] for words in commands} >= {"identify", "review"}
    assert failed(commands) == {}


@pytest.mark.slow
def test_the_commands_of_a_table_run_to_the_plan(table: str) -> None:
    commands = commands_of("review", table, "--map", "my names.toml")
    assert {words[1] for words in commands} == {"identify", "design"}
    assert failed(commands) == {}


def test_a_plan_takes_gains_only_where_the_log_has_them() -> None:
    gains = {"MC_ROLLRATE_P": 0.15}
    for parameters, form, mapping, taken in (
        (gains, "PX4 ULog", "", True),
        ({}, "PX4 ULog", "", False),
        (gains, "ArduPilot DataFlash", "", False),
        (gains, "CSV", "names.toml", False),
    ):
        source = Source(name="-a.ulg", format=form, sha256="", mapping=mapping)
        record = FlightRecord(source=source, topics=(), parameters=parameters)
        (command,) = next_steps(KnownOfLog(record=record, wanted_axes=("roll",)))
        assert ("--gains ./-a.ulg" in command) == taken


def test_a_plan_flies_in_simulation_as_it_was_computed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    craft = hovering_at(with_gains(aircraft("px4_quad"), {"MC_ROLLRATE_P": 0.11}, source="the test"), 0.36)
    write_log(Path("a flight.ulg"), fly_multirotor(craft, duration_s=40.0, seed=5), format="ulg")
    ran = rotorid(
        "design", "doublet", "--vehicle", "px4_quad", "--axis", "roll", "--amplitude", "roll=0.1",
        "--turbulence", "0.4", "--gains", "a flight.ulg", "--out", "the plan",
    )  # fmt: skip
    assert ran.code == 0, ran.err
    (line,) = [line for line in ran.out.splitlines() if line.startswith("fly it in simulation: ")]
    words = shlex.split(line.partition(": ")[2])
    assert words[1:3] == ["simulate", "the plan/vehicle.toml"]
    assert words[words.index("--turbulence") + 1] == "0.4"
    flies = named_vehicle([words[2]]).entry.aircraft
    assert flies.autopilot.rates.proportional[0] == pytest.approx(0.11)
    assert float(flies.autopilot.hover_commands(flies.vehicle)[-1]) == pytest.approx(0.36, abs=0.01)
    assert failed([[*words, "--out", "flown"]]) == {}
    card = Path("the plan/flight-card.html").read_text()
    kicker = card.partition('<p class="kicker">')[2].partition("</p>")[0]
    assert "a simulated 1 kg quadrotor (px4_quad), with the gains and the hover throttle of a flight.ulg" in kicker


def test_a_vehicle_of_a_rate_model_answers_as_the_log_did(table: str) -> None:
    assert rotorid("identify", table, "--map", "my names.toml", "--model", "rate.roll", "--out", "m").code == 0
    named = named_vehicle(["m"], like="px4_quad")
    assert named.own is not None
    assert named.own.answers == ("roll",)
    identified = named.own.joined.models[0].parameters["L_roll"].value
    assert truth_of(named.entry.aircraft)["L_roll"].value == pytest.approx(identified)
    usual = truth_of(aircraft("px4_quad"))
    assert identified == pytest.approx(1.25 * usual["L_roll"].value, rel=0.03)
    assert truth_of(named.entry.aircraft)["M_pitch"].value == pytest.approx(usual["M_pitch"].value)
    choices = DesignSettings(
        vehicle=named.entry, kinds=("pilot_sweep",), plan=PlanSettings(axes=("roll",)), own=named.own
    )
    words = computed_for(choices)
    assert words == "computed for a simulated 1 kg quadrotor (px4_quad) with roll as in my flight.csv"
    # Stronger rotors leave the answer that is known.
    stronger = hovering_at(named.entry.aircraft, 0.3, answers=("roll",))
    assert truth_of(stronger)["L_roll"].value == pytest.approx(identified)
    assert truth_of(stronger)["M_pitch"].value > 1.2 * usual["M_pitch"].value


def test_a_vehicle_that_cannot_hover_has_no_room() -> None:
    choices = DesignSettings(vehicle="px4_quad", kinds=("pilot_sweep",))
    assert has_room(choices)
    wild = {"MC_ROLLRATE_P": 3.0, "MC_ROLLRATE_D": 0.2}
    assert not has_room(replace(choices, gains=wild, gains_source="wild.ulg"))


def test_results_that_know_the_rotors_keep_them(tmp_path: Path) -> None:
    """The throttle of hover is taken from a log only where rotors are those of another vehicle."""
    craft = hovering_at(aircraft("px4_quad"), 0.36)
    write_log(tmp_path / "a.ulg", fly_multirotor(craft, duration_s=40.0, seed=5), format="ulg")
    record = read(tmp_path / "a.ulg")
    choices = DesignSettings(vehicle="px4_quad", kinds=("pilot_sweep",))
    assert flown_as(choices, record).hover_throttle == pytest.approx(0.36, abs=0.01)
    assert flown_as(replace(choices, changes={"m": 1.2}), record).hover_throttle is None


@pytest.mark.slow
def test_the_sweep_that_tune_asks_for_is_a_command_that_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write_log(Path("my flight.bin"), fly_multirotor(aircraft("ardupilot_quad"), duration_s=20.0, seed=2), format="bin")
    command = sweep_for_tune(read(Path("my flight.bin")), ("roll", "yaw"))
    assert shlex.split(command)[2:] == [
        "sweep", "--vehicle", "ardupilot_quad", "--for-tune", "my flight.bin", "--axis", "roll,yaw",
    ]  # fmt: skip
    assert failed([shlex.split(command)]) == {}


def test_a_vehicle_without_gains_of_its_own_is_asked_for_no_sweep() -> None:
    crazyflie = FlightRecord(source=Source(name="log10", format="Crazyflie uSD", sha256=""), topics=())
    assert sweep_for_tune(crazyflie, ("roll",)) == ""
