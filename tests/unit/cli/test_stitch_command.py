"""``rotorid stitch``: exit codes, streams, files."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from tests.unit.cli.commands import rotorid
from tests.unit.flying.test_stitching import LONGITUDINAL, identified

from rotorid.documents.result import save
from rotorid.documents.stitched import StitchedDocument


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("results")
    paths = []
    for speed in (0.0, 4.0):
        paths.append(folder / f"at-{speed:g}")
        save(identified(LONGITUDINAL, speed), paths[-1])
    return paths


def test_json_is_the_file_and_nothing_else(results: list[Path], tmp_path: Path) -> None:
    folder = tmp_path / "stitched"
    ran = rotorid("stitch", *reversed(results), "--out", folder, "--json")
    assert ran.code == 0, ran.err
    assert ran.out == (folder / "stitched.json").read_text()
    assert json.loads(ran.out)["schema"] == "rotorid.stitched/1"
    document = StitchedDocument.model_validate_json(ran.out)
    assert [point.label for point in document.points] == ["at-0", "at-4"]
    assert document.parameters[LONGITUDINAL]["X_u"].speed_m_s == pytest.approx([0.0, 3.974], abs=1e-3)
    page = (folder / "report.html").read_text()
    assert "2 models over speed" in page
    said = rotorid("stitch", *results, "--out", folder)
    assert "hover.longitudinal at 0.0 and 4.0 m/s" in said.out


@pytest.mark.parametrize("wrong", ["one", "twice", "nothing", "log"])
def test_wrong_use_is_one_sentence_and_writes_nothing(wrong: str, results: list[Path], tmp_path: Path) -> None:
    arguments: dict[str, list[str | Path]] = {
        "one": [results[0]],
        "twice": [results[0], results[0]],
        "nothing": [results[0], tmp_path / "missing"],
        "log": [*results, "--log", tmp_path / "missing.ulg"],
    }
    folder = tmp_path / "out"
    ran = rotorid("stitch", *arguments[wrong], "--out", folder)
    assert ran.code == 2
    assert ran.err.startswith("rotorid: ")
    assert not ran.out
    assert not folder.exists()
