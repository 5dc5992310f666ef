"""Compiled kernels without a place or without room: they are compiled anew, and nothing is left behind."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Any

import pytest

from rotorid import compiling
from rotorid.compiling import kept_apart, kept_in, njit

PACKAGE = Path(compiling.__file__).resolve().parent


def homeless(_: Path) -> Path:
    raise RuntimeError("Could not determine home directory.")


def twice() -> Any:
    @njit(cache=True)
    def kernel(x: int) -> int:
        return 2 * x

    return kernel


@pytest.fixture(autouse=True)
def _usual(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.chdir(tmp_path)


def test_compiled_code_is_kept_with_the_package_or_with_the_user(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert kept_in() == (PACKAGE, tmp_path / "numba")
    assert kept_apart(tmp_path / "job") == tmp_path / "numba" / "confined"
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "mine"))
    assert kept_in() == (tmp_path / "mine",)
    assert kept_apart(tmp_path / "job") == tmp_path / "mine" / "confined"


def test_without_a_home_there_is_the_package_alone(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(Path, "expanduser", homeless)
    assert kept_in() == (PACKAGE,)
    assert kept_apart(tmp_path) == tmp_path / "compiled"


def test_without_a_home_and_a_package_that_can_be_written_no_folder_is_made(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(Path, "expanduser", homeless)
    monkeypatch.setattr(os, "access", lambda *_: False)
    assert twice()(4) == 8
    assert list(tmp_path.iterdir()) == []


def test_a_kernel_without_a_place_is_compiled_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    caching = pytest.importorskip("numba.core.caching")
    monkeypatch.setattr(caching.CacheImpl, "_locator_classes", [])
    assert twice()(4) == 8


@pytest.mark.parametrize("name", ["save", "load"])
def test_a_kernel_whose_place_fails_is_compiled_anew(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    caching = pytest.importorskip("numba.core.caching")

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(caching.IndexDataCacheFile, name, full)
    assert twice()(4) == 8
