"""Calls name places inside the folders of the start, and no others."""

from __future__ import annotations

from pathlib import Path

import pytest

from rotorid.errors import UsageError
from rotorid.mcp.folders import Folders, named_folders


@pytest.fixture
def folders(tmp_path: Path) -> Folders:
    (tmp_path / "logs" / "sub").mkdir(parents=True)
    (tmp_path / "logs" / "sub" / "a.ulg").write_text("a")
    (tmp_path / "logs" / ".hidden.ulg").write_text("h")
    (tmp_path / "secret.ulg").write_text("s")
    (tmp_path / "logs" / "out.ulg").symlink_to(tmp_path / "secret.ulg")
    (tmp_path / "logs" / "up").symlink_to(tmp_path)
    (tmp_path / "logs" / "in.ulg").symlink_to(tmp_path / "logs" / "sub" / "a.ulg")
    return named_folders([tmp_path / "logs"])


@pytest.mark.parametrize("name", ["sub/a.ulg", "./sub/a.ulg", "in.ulg", "sub/../sub/a.ulg"])
def test_places_inside_are_found(name: str, folders: Folders, tmp_path: Path) -> None:
    found = folders.find(name)
    assert found == tmp_path.resolve() / "logs" / "sub" / "a.ulg"
    assert folders.find(str(found)) == found
    assert folders.name_of(found) == "sub/a.ulg"


@pytest.mark.parametrize("name", ["../secret.ulg", "out.ulg", "up/secret.ulg", "/etc/passwd", ".hidden.ulg", "a\0b"])
def test_places_outside_are_refused_whether_they_exist_or_not(name: str, folders: Folders) -> None:
    with pytest.raises(UsageError, match="is outside the folders named at start"):
        folders.find(name)


def test_a_place_that_does_not_exist_is_named(folders: Folders) -> None:
    with pytest.raises(UsageError, match=r"there is no file or folder 'b.ulg'"):
        folders.find("b.ulg")
    with pytest.raises(UsageError, match="there is no file 'sub'"):
        folders.find("sub", "file")


def test_lists_follow_no_link(folders: Folders) -> None:
    assert [folders.name_of(path) for path in folders.entries()] == ["sub", "sub/a.ulg"]


def test_several_folders_have_labels(tmp_path: Path) -> None:
    for parent in ("a", "b"):
        (tmp_path / parent / "logs").mkdir(parents=True)
        (tmp_path / parent / "logs" / "x.ulg").write_text(parent)
    folders = named_folders([tmp_path / "a" / "logs", tmp_path / "b" / "logs", tmp_path / "a" / "logs"])
    assert [*folders.roots] == ["logs", "logs-2"]
    assert folders.find("logs-2/x.ulg").read_text() == "b"
    assert folders.name_of(folders.find("logs/x.ulg")) == "logs/x.ulg"
    with pytest.raises(UsageError, match="expected logs/ or logs-2/"):
        folders.find("x.ulg")


def test_results_stay_inside(folders: Folders, tmp_path: Path) -> None:
    logs = tmp_path.resolve() / "logs"
    assert folders.new("a") == logs / "rotorid-out" / "a"
    assert named_folders([logs], logs / "results").new("a") == logs / "results" / "a"
    with pytest.raises(UsageError, match="outside the named folders"):
        named_folders([logs], tmp_path / "elsewhere")
    (logs / "rotorid-out").mkdir()
    (logs / "rotorid-out" / "a").symlink_to(tmp_path)
    with pytest.raises(UsageError, match="outside the folders"):
        folders.new("a")
    (logs / "rotorid-out" / "b").symlink_to(logs / "sub")
    with pytest.raises(UsageError, match="outside the folders"):
        folders.new("b")
    with pytest.raises(UsageError, match="is hidden; expected a folder that the tools can read again"):
        named_folders([logs], logs / ".results")
    (tmp_path / "led").mkdir()
    (tmp_path / "led" / "rotorid-out").symlink_to(logs)
    with pytest.raises(UsageError, match="outside the named folders"):
        named_folders([tmp_path / "led"])


def test_a_server_needs_folders(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="there is no folder"):
        named_folders([tmp_path / "none"])
    with pytest.raises(UsageError, match="no folder was named"):
        named_folders([])
