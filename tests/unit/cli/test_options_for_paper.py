"""``--figures`` and ``--tables``: every picture and table of a report as files of their own."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import pytest
from tests.unit.cli.commands import ROLL, rotorid

from rotorid.plot.printed import printed
from rotorid.report.publication import CAPTIONS, of_model
from rotorid.report.tables import Column, Table, as_csv, as_latex, escaped, symbol
from rotorid.results.model import IdentifiedModel

pytestmark = pytest.mark.usefixtures("computed_once")


@pytest.fixture(scope="module")
def published(flight: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("published")
    ran = rotorid("identify", flight, *ROLL, "--figures", "svg", "--tables", "csv,tex", "--quiet", "--out", folder)
    assert (ran.code, ran.err) == (0, "")
    return folder


def test_every_picture_is_a_file_with_a_caption(published: Path, by_api: IdentifiedModel) -> None:
    files = {path.name for path in (published / "figures").iterdir()} - {CAPTIONS}
    captions = (published / "figures" / CAPTIONS).read_text(encoding="utf-8").splitlines()
    assert {line.partition(": ")[0] for line in captions} == files
    assert files == {f"{name}.svg" for name in of_model(by_api).pictures} | {"responses-roll_command.svg"}
    assert all((published / "figures" / name).read_text(encoding="utf-8").startswith("<?xml") for name in files)


def test_tables_hold_the_numbers_of_the_result(published: Path, by_api: IdentifiedModel) -> None:
    with (published / "tables" / "parameters.csv").open(encoding="utf-8", newline="") as file:
        rows = {row["parameter"]: row for row in csv.DictReader(file)}
    assert rows.keys() == by_api.parameters.keys()
    for name, row in rows.items():
        known = by_api.parameters[name]
        assert float(row["value"]) == known.value
        assert row["std"] == ("" if known.std is None else str(known.std))
        assert row["cramer_rao_percent"] == ("" if known.cramer_rao_percent is None else str(known.cramer_rao_percent))
    assert {path.stem for path in (published / "tables").glob("*.csv")} == {
        path.stem for path in (published / "tables").glob("*.tex")
    }


def test_a_table_on_paper_is_balanced(published: Path) -> None:
    for path in (published / "tables").glob("*.tex"):
        text = path.read_text(encoding="utf-8")
        columns = len(re.search(r"begin\{tabular\}\{([lr]+)\}", text)[1])  # type: ignore[index]
        lines = [line for line in text.splitlines() if line.endswith(r"\\")]
        assert len(lines) > 1
        assert all(len(re.findall(r"(?<!\\)&", line)) == columns - 1 for line in lines), path.name
        assert text.count("$") % 2 == 0


def test_the_same_result_is_the_same_file(by_api: IdentifiedModel) -> None:
    picture = next(iter(of_model(by_api).pictures.values()))
    for kind in ("svg", "pdf"):
        assert printed(picture.figure, kind) == printed(picture.figure, kind)  # type: ignore[arg-type]


def test_response_and_verify_have_them_too(flight: Path, published: Path, tmp_path: Path) -> None:
    channels = ("--inputs", "roll_command", "--outputs", "p", "--band", "12:50")
    ran = rotorid(
        "response", flight, *channels, "--tables", "csv", "--figures", "pdf", "--quiet", "--out", tmp_path / "r"
    )
    assert ran.code == 0
    assert (tmp_path / "r" / "tables" / "responses.csv").read_text().startswith("response,unit,from_rad_s")
    assert (tmp_path / "r" / "figures" / "responses-roll_command.pdf").read_bytes().startswith(b"%PDF")
    unseen = ("--segment", "roll:56.2:105.9", "--tables", "tex", "--quiet")
    assert rotorid("verify", published, flight, *unseen, "--out", tmp_path / "v").code == 0
    assert "p/roll\\_command" in (tmp_path / "v" / "tables" / "unseen_responses.tex").read_text()
    assert not (tmp_path / "v" / "figures").exists()


def test_several_models_have_them_in_their_folders(flight: Path, tmp_path: Path) -> None:
    band = ("--band", "12:50", "--quiet")
    ran = rotorid("identify", flight, "--model", "rate.roll,rate.yaw", *band, "--tables", "csv", "--out", tmp_path)
    assert ran.code == 0
    assert (tmp_path / "rate.roll" / "tables" / "parameters.csv").exists()


@pytest.mark.parametrize(("option", "value"), [("--figures", "gif"), ("--tables", "xlsx"), ("--tables", "csv,")])
def test_an_unknown_kind_is_refused_before_any_work(flight: Path, tmp_path: Path, option: str, value: str) -> None:
    ran = rotorid("identify", flight, *ROLL, option, value, "--out", tmp_path / "none")
    assert ran.code == 2
    assert "one of" in ran.err
    assert not (tmp_path / "none").exists()


def test_text_of_a_log_is_text_in_latex() -> None:
    name = r"50% of a_b & \input{secret} $x$ ~^#"
    table = Table(name="t", caption="Any.", columns=(Column("record", "Record"),), rows=((name,),))
    assert re.sub(r"\\(textbackslash|textasciitilde|textasciicircum)\{\}|\\[&%$#_{}]", "", escaped(name)).isprintable()
    body = as_latex(table).split("midrule")[1]
    assert "\\input" not in body
    assert not re.search(r"(?<!\\)[&%$#_]", body.partition("\\\\")[0])


def test_names_of_parameters_are_formulas() -> None:
    assert [symbol(name) for name in ("I_xx", "c_2", "V0")] == [r"$I_{\mathrm{xx}}$", "$c_{2}$", r"$\mathrm{V0}$"]


def test_text_of_a_log_is_no_formula_in_a_spreadsheet() -> None:
    table = Table(
        name="t", caption="Any.", columns=(Column("record", "Record"), Column("x", "x")), rows=(("=1+1", -2.0),)
    )
    assert as_csv(table) == "record,x\n'=1+1,-2.0\n"
