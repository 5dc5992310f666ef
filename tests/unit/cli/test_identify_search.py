"""``--search`` and ``--bootstrap`` of ``rotorid identify``: files, words and exit codes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from tests.unit.cli.commands import ROLL, Ran, rotorid

from rotorid.documents.result import ResultDocument
from rotorid.search.catalog import searches

ASKED = ("--search", "sobol:4", "--evaluations", "200", "--bootstrap", "40", "--seed", "5")


@pytest.fixture(scope="module")
def ran(flight: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Ran]:
    folder = tmp_path_factory.mktemp("searched")
    return folder, rotorid("identify", flight, *ROLL, *ASKED, "--out", folder)


def test_a_person_sees_what_was_searched_and_how_it_scatters(ran: tuple[Path, Ran]) -> None:
    folder, told = ran
    assert (told.code, told.err) == (0, "")
    assert "search by sobol:4: 4 evaluations and 4 local searches" in told.out
    assert "bootstrap: standard deviations of 40 refits with new noise" in told.out
    header = next(line for line in told.out.splitlines() if line.startswith("parameter"))
    assert "bootstrap" in header
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert '<details class="card fold" id="s1-search">' in page
    assert '<details class="card fold" id="s1-bootstrap">' in page


def test_the_result_holds_both_and_how_to_make_them_again(ran: tuple[Path, Ran], flight: Path, tmp_path: Path) -> None:
    document = ResultDocument.model_validate_json((ran[0] / "result.json").read_text(encoding="utf-8"))
    assert document.search is not None
    assert document.bootstrap is not None
    assert (document.bootstrap.runs, document.bootstrap.seed) == (40, 5)
    settings = document.provenance.settings
    assert (settings["search"], settings["evaluations"], settings["bootstrap"]) == ("sobol:4", 200, 40)
    again = json.loads(rotorid("identify", flight, *ROLL, *ASKED, "--out", tmp_path, "--json").out)
    first = json.loads(document.model_dump_json(by_alias=True))
    assert [again[name] for name in ("parameters", "search", "bootstrap")] == [
        first[name] for name in ("parameters", "search", "bootstrap")
    ]


def test_a_plain_run_has_neither(results: tuple[Path, Ran]) -> None:
    document = json.loads(results[1].out)
    assert (document["search"], document["bootstrap"]) == (None, None)


def test_help_lists_every_search(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    told = rotorid("identify", "--help-all").out
    option = told.split("--search", 1)[1].split("--evaluations", 1)[0]
    assert [name for name in searches() if name not in option] == []


@pytest.mark.parametrize(
    ("wrong", "came"),
    [
        (("--search", "evolutoin"), "did you mean evolution?"),
        (("--search", "central:5"), "central, which has no options"),
        (("--search", "evolution", "--evaluations", "3"), "a budget of 3"),
        (("--evaluations", "300"), "--evaluations needs a search"),
        (("--bootstrap", "1"), "--bootstrap 1 is too few"),
        (("--method", "prediction_error", "--bootstrap", "20"), "prediction error"),
        (("--method", "equation_error", "--search", "sobol:4"), "equation error"),
    ],
)
def test_wrong_use_ends_with_two(wrong: tuple[str, ...], came: str, flight: Path, tmp_path: Path) -> None:
    told = rotorid("identify", flight, *ROLL, *wrong, "--out", tmp_path / "o", "--quiet")
    assert (told.code, told.out) == (2, "")
    assert came in told.err
    assert not (tmp_path / "o").exists()
