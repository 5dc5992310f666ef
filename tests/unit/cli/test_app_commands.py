"""``inspect``, ``demo``, ``--version`` and ``--help``."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import NamedTuple

import pytest
from tests.unit.cli.commands import Ran, rotorid

from rotorid import __version__
from rotorid.cli.command import command_line
from rotorid.cli.console import MOST_LINES
from rotorid.documents.inspection import inspect_document
from rotorid.flying.demo import Demonstration
from rotorid.flying.simulation import truth_of
from rotorid.io.registry import read
from rotorid.results.model import IdentifiedModel
from rotorid.reviewing.inspection import inspect
from rotorid.vehicles.catalog import aircraft

pytestmark = pytest.mark.usefixtures("computed_once")


def test_version() -> None:
    assert rotorid("--version") == (0, f"rotorid {__version__}\n", "")


@pytest.mark.parametrize("command", ["identify", "inspect", "demo"])
def test_help_names_every_command(command: str) -> None:
    assert command in rotorid("--help").out
    helped = rotorid(command, "--help-all")
    assert helped.code == 0
    assert "--json" in helped.out


def test_identify_takes_the_options_of_the_contract() -> None:
    text = rotorid("identify", "--help-all").out
    options = ("model", "band", "windows", "coherence", "estimate", "instrument", "fix", "segment", "verify", "map")
    for option in (*options, "seed", "out", "json", "quiet"):
        assert f"--{option}" in text


def test_inspect_json_is_the_document_of_the_api(flight: Path) -> None:
    ran = rotorid("inspect", flight, "--json")
    assert (ran.code, ran.err) == (0, "")
    assert json.loads(ran.out) == json.loads(inspect_document(inspect(read(flight))).model_dump_json(by_alias=True))


def test_inspect_writes_its_object_and_its_page(flight: Path, tmp_path: Path) -> None:
    ran = rotorid("inspect", flight, "--out", tmp_path / "seen")
    assert ran.code == 0
    assert str(tmp_path / "seen" / "inspect.json") in ran.out
    table = json.loads((tmp_path / "seen" / "inspect.json").read_text())
    assert table["schema"] == "rotorid.inspect/1"
    assert [sorted(flight) for flight in table["flights"]] == [["seen_in", "start_s", "stop_s"]] * len(table["flights"])
    assert (tmp_path / "seen" / "report.html").exists()


def test_the_command_of_a_result_names_files_and_not_their_folders(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs" / "a.ulg").touch()
    monkeypatch.chdir(tmp_path)
    typed = [
        "rotorid",
        "identify",
        "logs/a.ulg",
        f"--out={tmp_path}/x",
        "--map",
        "~/m.toml",
        "--pair",
        "p/roll_command",
    ]
    monkeypatch.setattr("sys.argv", typed)
    assert command_line() == ["rotorid", "identify", "a.ulg", "--out=x", "--map", "m.toml", "--pair", "p/roll_command"]


def test_inspect_shows_channels_excitations_and_what_they_support(flight: Path) -> None:
    short = rotorid("inspect", flight)
    assert (short.code, short.err) == (0, "")
    assert short.out.count("\n") <= MOST_LINES
    good, _, others = short.out.partition("good for\n")[2].partition("not for\n")
    assert "rate.roll: from its test inputs" in good
    assert "rate.pitch" in others
    assert "fly a pitch, yaw and thrust sweep" in others
    ran = rotorid("inspect", flight, "-v")
    assert "roll_excitation" in ran.out
    assert sum(line.split()[:2] == ["roll", "sweep"] for line in ran.out.splitlines()) == 2


def test_inspect_says_whether_sensors_and_clocks_agree(flight: Path) -> None:
    out = rotorid("inspect", flight, "-v").out
    lines = out[out.index("do sensors and clocks agree") : out.index("\nnext")].splitlines()[1:]
    assert "against attitude" in lines[0] or "against a small phi" in lines[0]
    assert "consistent" in lines[0]
    assert any("behind roll_command (vehicle, motors, filters and stamps together)" in line for line in lines)
    # What these lines say is not said again among the findings.
    assert "kinematic_consistency" not in out


def test_inspect_writes_nothing(flight: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert rotorid("inspect", flight, "--quiet") == (0, "", "")
    assert list(tmp_path.iterdir()) == []


class Demonstrated(NamedTuple):
    ran: Ran
    folder: Path


@pytest.fixture(scope="module")
def demonstrated(tmp_path_factory: pytest.TempPathFactory) -> Demonstrated:
    folder = tmp_path_factory.mktemp("demo")
    return Demonstrated(rotorid("demo", "--out", folder, "--json"), folder)


def test_demo_writes_two_results_and_one_report_and_leaves_no_log(demonstrated: Demonstrated) -> None:
    ran, folder = demonstrated
    assert ran.code == 0
    # Long work shows how far it is.
    assert all(re.match(r"rotorid: [\d.]+ (s|min): ", line) for line in ran.err.splitlines())
    models = [document["model"] for document in json.loads(ran.out)]
    assert models == ["hover.lateral", "hover.longitudinal"]
    assert {path.name for path in folder.iterdir()} >= {"report.html", *models}
    assert not list(folder.glob("*.ulg"))


@pytest.mark.parametrize("kept", [False, True])
def test_demo_keeps_its_log_where_asked(
    kept: bool, by_api: IdentifiedModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    demonstration = Demonstration(identifications=(by_api,), truth={})
    monkeypatch.setattr("rotorid.flying.demo.fly_demo", lambda log, *, seed: log.write_bytes(b"a log"))
    monkeypatch.setattr("rotorid.io.registry.read", lambda log: log)
    monkeypatch.setattr("rotorid.flying.demo.identify_demo", lambda record, *, seed: demonstration)
    monkeypatch.setattr("rotorid.cli.demo.find_spec", lambda _: None)
    ran = rotorid("demo", *(["--keep-log"] if kept else []), "--out", tmp_path / "out")
    assert ran.code == 0
    assert (tmp_path / "out" / "flight.ulg").exists() == kept
    assert ("flight.ulg" in ran.out) == kept


def test_demo_identifies_what_flew(demonstrated: Demonstrated) -> None:
    """Nine in ten intervals of two deviations hold what flew; what is told from zero has its sign."""
    truth = {name: true.value for name, true in truth_of(aircraft("s500")).items()}
    found = {
        name: (value["value"], value["std"])
        for document in json.loads(demonstrated.ran.out)
        for name, value in document["parameters"].items()
        if value["std"]
    }
    assert len(found) >= 30
    off = {name: (value - truth[name]) / std for name, (value, std) in found.items()}
    holds = [abs(distance) <= 2.0 for distance in off.values()]
    assert sum(holds) >= 0.9 * len(holds), off
    assert max(map(abs, off.values())) < 4.0, off
    sure = {name: value for name, (value, std) in found.items() if abs(value) > 2.0 * std and truth[name]}
    assert len(sure) >= 15
    assert all(value * truth[name] > 0.0 for name, value in sure.items())


@pytest.mark.parametrize("words", [("inspect", "nowhere.ulg"), ("identify", "nowhere.ulg", "--model", "rate.rol")])
def test_a_refused_call_is_json_too(words: tuple[str, ...]) -> None:
    ran = rotorid(*words, "--json")
    told = json.loads(ran.out)
    assert (ran.code, told["schema"], told["exit_code"]) == (2, "rotorid.error/1", 2)
    assert ran.err == f"rotorid: {told['message']}\n"
    assert told["came"]
    assert told["came"] in told["message"]


@pytest.mark.parametrize(
    ("motors", "words"), [("", "does not show whether the vehicle flew"), ("motor_1 [1]", "contains no flight")]
)
def test_a_log_too_short_to_show_a_flight_is_not_said_to_contain_none(tmp_path: Path, motors: str, words: str) -> None:
    rows = [f"{0.02 * i},{0.1 * math.sin(0.06 * i)},{0.1 * math.cos(0.04 * i)}{',0' * bool(motors)}" for i in range(90)]
    log = tmp_path / "cut.csv"
    log.write_text("\n".join([",".join(filter(None, ["t [s]", "phi [rad]", "theta [rad]", motors])), *rows]))
    assert f"fly: this log {words}" in rotorid("inspect", log).out
