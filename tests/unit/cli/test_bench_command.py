"""``rotorid bench``: exit codes, streams, files, tables; nothing is written where something is wrong."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest
from tests.unit.benchmarking.made_flights import neurobem_folder
from tests.unit.cli.commands import Ran, rotorid
from tests.unit.cli.test_console_forty_lines import rows

from rotorid.benchmarking import loads
from rotorid.benchmarking.catalog import LOADS
from rotorid.benchmarking.scores import LoadErrorsOf, load_rows
from rotorid.cli.console import MOST_LINES
from rotorid.documents.benchmark import BenchDocument

PREDICTS = "tests.unit.benchmarking.made_flights:thrust_by_speed"


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return neurobem_folder(tmp_path_factory.mktemp("data"))


@pytest.fixture(autouse=True)
def without_long_fits(monkeypatch: pytest.MonkeyPatch) -> None:
    """The flights last five seconds and hardly move: no vehicle can be identified from them."""

    def rows_of_rotorid(flights: object, folds: object, vehicle: object) -> list[object]:
        import numpy as np

        errors = [LoadErrorsOf(np.full((3, 2), 0.1), np.full((3, 2), 1e-3))] * 2
        return [*load_rows("physical.flight", "fitted here to the other flights", LOADS, errors, 11)]

    monkeypatch.setattr(loads, "_of_rotorid", rows_of_rotorid)


def test_a_table_for_a_person_and_for_a_paper(data: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = ("bench", "neurobem", "--data", data, "--predictions", PREDICTS, "--label", "mine", "--tables", "csv,tex")
    ran: Ran = rotorid(*words, "--out", out)
    assert ran.code == 0
    assert rows(ran.out) <= MOST_LINES
    assert ran.out.startswith("physical.flight misses force by 0.173 N and moment by ")
    assert "Each of 2 flights by a fit of the others." in ran.out
    assert "mine: Python function thrust_by_speed" in ran.out
    assert "moment [mN m]" in ran.out
    document = BenchDocument.model_validate_json((out / "bench.json").read_text())
    assert document.schema_name == "rotorid.bench/1"
    assert document.provenance.command[:2] == ["rotorid", "bench"]
    assert len(document.provenance.inputs) == 2
    page = (out / "report.html").read_text()
    assert "Fairness and notes" in page
    assert "license: none stated" in page
    with (out / "tables" / "bench.csv").open() as file:
        table = {row["model"]: row for row in csv.DictReader(file)}
    assert float(table["physical.flight"]["force [N]"]) == pytest.approx(0.1 * 3**0.5)
    assert table["NeuroBEM's network"]["source"].startswith("predictions in the files")
    assert table["physical.flight"]["parameters"] == "11"
    printed = (out / "tables" / "bench.tex").read_text()
    assert "Bauersfeld" in printed
    assert r"\toprule" in printed


def test_json_is_the_file_and_nothing_else(data: Path, tmp_path: Path) -> None:
    ran = rotorid("bench", "neurobem", "--data", data, "--out", tmp_path / "out", "--json")
    assert ran.code == 0
    assert ran.out == (tmp_path / "out" / "bench.json").read_text()
    assert {row["metric"] for row in json.loads(ran.out)["rows"]} == {metric.name for metric in LOADS}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("neuro-bem",), "unknown benchmark 'neuro-bem'; did you mean neurobem?"),
        (("neurobem",), "neurobem needs its data, which are not shipped (license: none stated); download github.com"),
        (("idsia", "--data", "nowhere"), "there is no folder 'nowhere'; expected the data of idsia"),
        (
            ("nanobench", "--data", "."),
            "'.' contains no flight of nanobench; expected files such as B2_circle_fast_rep2",
        ),
        (("neurobem", "--data", ".", "--predictions", "x.csv"), "'x.csv' cannot be read"),
        (("neurobem", "--data", ".", "--predictions", "no_module:f"), "the module 'no_module' cannot be imported"),
    ],
)
def test_wrong_use_is_a_sentence_and_writes_nothing(
    words: tuple[str, ...], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    ran = rotorid("bench", *words)
    assert (ran.code, ran.out) == (2, "")
    assert said in " ".join(ran.err.split())
    assert not list(tmp_path.iterdir())


def test_a_file_of_other_columns_writes_nothing(data: Path, tmp_path: Path) -> None:
    mine = tmp_path / "mine.csv"
    mine.write_text("fx,fy\n1,2\n")
    ran = rotorid("bench", "neurobem", "--data", data, "--predictions", mine, "--out", tmp_path / "out")
    assert ran.code == 2
    assert "mine.csv has no column force_x, force_y, force_z and moment_x and 2 more" in " ".join(ran.err.split())
    assert [path.name for path in tmp_path.iterdir()] == ["mine.csv"]


def test_a_label_that_is_taken_writes_nothing(data: Path, tmp_path: Path) -> None:
    words = ("--predictions", PREDICTS, "--label", "physical.flight", "--out", tmp_path / "out")
    ran = rotorid("bench", "neurobem", "--data", data, *words)
    assert ran.code == 2
    assert "the table has a row 'physical.flight' already; add --label NAME" in " ".join(ran.err.split())
    assert not list(tmp_path.iterdir())
