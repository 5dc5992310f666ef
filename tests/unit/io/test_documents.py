"""Who gives the folder of one command to another reads what it holds, and what was wanted."""

from __future__ import annotations

from pathlib import Path

import pytest

from rotorid.checking.candidate import read_candidate
from rotorid.documents.compare import read_results
from rotorid.documents.results import load_results
from rotorid.errors import RotoridError
from rotorid.io import read


@pytest.fixture
def review(tmp_path: Path) -> Path:
    folder = tmp_path / "rev"
    folder.mkdir()
    (folder / "review.json").write_text('{"schema": "rotorid.review/1"}', encoding="utf-8")
    (folder / "others.json").write_text('{"schema": "mine/1"}', encoding="utf-8")
    return folder


@pytest.mark.parametrize(
    ("read", "wanted"),
    [
        (read_candidate, "model.toml"),
        (lambda one: load_results([one]), "result.json"),
        (lambda one: read_results([one]), "result.json"),
    ],
)
def test_a_review_is_no_model(review: Path, read: object, wanted: str) -> None:
    assert callable(read)
    with pytest.raises(RotoridError, match=rf"rev contains review\.json and no {wanted}; expected a folder"):
        read(review)


def test_a_review_is_no_log(review: Path) -> None:
    with pytest.raises(RotoridError, match=r"rev is a folder with review\.json and no log; .*; give the log itself"):
        read(review)


@pytest.mark.parametrize("read", [read_candidate, lambda one: load_results([one / "result.json"])])
def test_a_folder_that_is_not_there(tmp_path: Path, read: object) -> None:
    assert callable(read)
    with pytest.raises(RotoridError, match="none does not exist; expected a folder"):
        read(tmp_path / "none")
