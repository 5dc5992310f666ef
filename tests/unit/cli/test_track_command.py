"""``rotorid track``: a log with a payload that comes, and what a slip is told."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from tests.twins import track_flights as twin
from tests.unit.cli.commands import rotorid

from rotorid.simulation.wind import Wind

pytestmark = pytest.mark.usefixtures("computed_once")

AIR = Wind(north_m_s=2.1, east_m_s=2.1, turbulence_m_s=0.5)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    before = twin.columns(twin.fly(100.0, level=0.5, wind=AIR, seed=3))
    after = twin.columns(twin.fly(40.0, level=0.5, wind=AIR, seed=4, changes=twin.payload(0.3)))
    data = twin.joined(before, after)
    names = {name: name for name in ("roll_command", "p", "roll_stick", "thrust_command")} | {"p": "p [rad/s]"}
    path = tmp_path_factory.mktemp("flight") / "flight.csv"
    head = ",".join(["time [s]", *names.values()])
    table = np.column_stack([np.arange(data["p"].size) / 50.0, *(data[name] for name in names)])
    np.savetxt(path, table, delimiter=",", header=head, comments="", fmt="%.6f")
    return path


def test_a_payload_is_found_and_written(log: Path, tmp_path: Path) -> None:
    ran = rotorid("track", log, "--model", "rate.roll", "--out", tmp_path / "out", "--json")
    assert ran.code == 0, ran.err
    document = json.loads(ran.out)
    assert document["schema"] == "rotorid.track/1"
    assert 100.0 < document["steps"][0]["at_s"] < 110.0
    assert document["gain"]["value"] == pytest.approx(1 / 1.3, abs=0.08)
    assert json.loads((tmp_path / "out" / "track.json").read_text()) == document
    assert "Changed at about" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert set(np.load(tmp_path / "out" / "track.npz")) == {"time_s", "ratio", "std", "level", "rougher"}


def with_gap(log: Path, folder: Path, start_s: float, stop_s: float) -> Path:
    head, *lines = log.read_text(encoding="utf-8").splitlines()
    kept = [line for line in lines if not start_s < float(line.partition(",")[0]) < stop_s]
    path = folder / "gap.csv"
    path.write_text("\n".join([head, *kept]), encoding="utf-8")
    return path


def test_times_are_those_of_the_log_behind_a_gap(log: Path, tmp_path: Path) -> None:
    """What lies before the gap is not followed, which is said; the payload comes when it comes."""
    ran = rotorid("track", with_gap(log, tmp_path, 12.0, 18.0), "--first", "60", "--out", tmp_path / "out", "--json")
    assert ran.code == 0, ran.err
    document = json.loads(ran.out)
    assert document["reference_s"][0] == pytest.approx(18.0, abs=0.1)
    assert 100.0 < document["steps"][0]["at_s"] < 110.0
    (message,) = [
        one["message"] for one in document["findings"] if one["kind"] == "gap" and "Tracked" in one["message"]
    ]
    assert message.startswith("Tracked from 18.0 to 140.0 s only.")


def test_a_flight_whose_pieces_are_all_too_short_is_exit_1(log: Path, tmp_path: Path) -> None:
    ran = rotorid("track", with_gap(log, tmp_path, 57.0, 83.0), "--first", "60", "--out", tmp_path / "out", "--json")
    assert ran.code == 1
    assert "57 s of flight without a gap is too short with a reference of 60 s" in ran.err


def test_too_short_a_rest_is_exit_1(log: Path, tmp_path: Path) -> None:
    ran = rotorid("track", log, "--first", "139", "--out", tmp_path / "out", "--json")
    assert ran.code == 1
    assert json.loads(ran.out)["steps"] == []
    assert "of flight is too short" in ran.err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--model", "hover.full"), "rate.roll"),
        (("--step", "2"), "0.02 to 0.5"),
        (("--first", "soon"), "expected a number in s, or with a unit"),
    ],
)
def test_a_slip_is_one_sentence(log: Path, tmp_path: Path, words: tuple[str, ...], said: str) -> None:
    ran = rotorid("track", log, *words, "--out", tmp_path / "out")
    assert ran.code == 2
    assert said in ran.err
