"""One list of formats: what is read, how its files are called, and what is written."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import get_args

import pytest

from rotorid.autopilots.autopilot import LogFormat
from rotorid.autopilots.registry import AUTOPILOTS, named
from rotorid.io.formats import ENDINGS, PACKED, READ, READERS, WRITERS
from rotorid.io.named import is_log
from rotorid.lab.session import _ENDINGS

MODULES = {reader.module: import_module(reader.module) for reader in READERS}


@pytest.mark.parametrize("module", MODULES)
def test_every_row_is_a_reader(module: str) -> None:
    found = MODULES[module]
    assert found.FORMAT
    assert found.sniff(b"") in (False, None)
    assert callable(found.read)


def test_every_module_that_sniffs_has_a_row() -> None:
    root = Path(import_module("rotorid.io").__file__ or "").parent
    named_formats = (
        "rotorid.io." + ".".join(file.relative_to(root).with_suffix("").parts)
        for file in root.rglob("*.py")
        if "\nFORMAT = " in file.read_text(encoding="utf-8")
    )
    sniffing = {module for module in named_formats if hasattr(import_module(module), "sniff")}
    assert sniffing == set(MODULES)


def test_formats_of_autopilots_begin_with_their_names() -> None:
    formats = {found.FORMAT for found in MODULES.values()}
    assert all(any(format.startswith(one.name) for format in formats) for one in AUTOPILOTS)


def test_an_ending_belongs_to_one_row() -> None:
    endings = [ending for reader in READERS for ending in reader.endings]
    assert len(endings) == len(set(endings)) == len(ENDINGS)
    assert all(ending == ending.lower() and ending.startswith(".") for ending in endings)
    assert all(reader.words in READ for reader in READERS)


@pytest.mark.parametrize("packed", ["", *PACKED])
@pytest.mark.parametrize("ending", sorted(ENDINGS))
def test_folders_and_the_page_know_the_same_files(ending: str, packed: str) -> None:
    assert is_log(Path(f"flight{ending.upper()}{packed}"))
    assert _ENDINGS.search(f"flight{ending}{packed}")
    assert not is_log(Path(f"flight{ending}.pdf"))
    assert not _ENDINGS.search(f"flight{ending}.pdf")


def test_every_format_that_is_written_has_a_row() -> None:
    assert tuple(WRITERS) == get_args(LogFormat)
    assert all(callable(getattr(import_module(row.module), row.name)) for row in WRITERS.values())
    assert [named(key).log_format for key in ("px4", "ardupilot", "betaflight", "simple")] == list(WRITERS)
