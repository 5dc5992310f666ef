"""``rotorid fleet``: a folder of real flights into a table, and what a slip is told."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from tests.fleet_logs import read_table
from tests.unit.cli.commands import rotorid

from rotorid import Wind, simulate, write_log
from rotorid.flying.examples import EXAMPLES

pytest.importorskip("pyarrow")


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("logs")
    (folder / "quad").mkdir()
    log = folder / "quad" / "2025-03-09-12-00-00.ulg"
    write_log(log, simulate("px4_quad", EXAMPLES["px4"].plan(), duration_s=45.0, wind=Wind(), seed=1), format="ulg")
    (folder / "quad" / "copy.ulg").write_bytes(log.read_bytes())
    (folder / "quad" / "broken.ulg").write_bytes(b"ULog\x01\x12\x35 and then nothing")
    return folder


def test_a_folder_becomes_a_table_and_a_page(logs: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = ("fleet", logs, "--models", "rate.roll,rate.yaw", "--workers", "1", "--out", out, "--json")
    ran = rotorid(*words)
    assert ran.code == 0, ran.err
    document = json.loads(ran.out)
    assert document["schema"] == "rotorid.fleet/1"
    assert (document["logs"], document["done"], document["duplicates"]) == (3, 1, 1)
    assert {one["kind"] for one in document["failed"]} == {"unreadable", "refused"}
    rows = read_table(out / "fleet.parquet")
    assert {row.parameter for row in rows} >= {"L_roll"}
    assert {(row.vehicle, row.time_utc, row.model) for row in rows} == {("quad", "2025-03-09T12:00:00", "rate.roll")}
    assert "L_roll" in document["population"]["rate.roll"]
    assert json.loads((out / "fleet.json").read_text()) == document
    page = (out / "fleet.html").read_text(encoding="utf-8")
    assert "broken.ulg" in page
    again = json.loads(rotorid(*words).out)
    assert again["resumed"] == 3
    assert again["population"] == document["population"]


def test_all_failed_is_exit_1(tmp_path: Path) -> None:
    (tmp_path / "a.ulg").write_bytes(b"ULog\x01\x12\x35 and then nothing")
    ran = rotorid("fleet", tmp_path / "a.ulg", "--models", "rate.roll", "--workers", "1", "--out", tmp_path / "out")
    assert ran.code == 1
    assert "no log gave an answer" in ran.err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("nowhere.ulg",), "does not exist"),
        (("--models", "rate.rol", "@"), "rate.roll"),
        (("--models", "none", "@"), "leaves nothing to do"),
        (("--workers", "0", "@"), "1 to 1024"),
        (("--timeout", "-1", "@"), "more than 0 s"),
        (("--memory", "lots", "@"), "is not a size"),
        (("--vehicles", "none.csv", "@"), "none.csv"),
        (("--workers", "2", "--scheduler", "tcp://127.0.0.1:1", "@"), "leave out --workers"),
    ],
)
def test_a_slip_is_one_sentence(logs: Path, tmp_path: Path, words: tuple[str, ...], said: str) -> None:
    ran = rotorid("fleet", *(logs if word == "@" else word for word in words), "--out", tmp_path / "out")
    assert ran.code == 2
    assert said in ran.err
    assert ran.err.count("\n") == 1
