"""Documents from elsewhere, TOML and JSON: whatever is in them costs a sentence, by one reader for all of them."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

import pytest
from tests.hostile.damage import assert_complete, hang_limit

from rotorid.checking.candidate import read_candidate
from rotorid.documents.compare import read_results
from rotorid.documents.design import read_plan
from rotorid.documents.result import load
from rotorid.documents.vehicle import read_vehicle
from rotorid.errors import RotoridError
from rotorid.io.documents import DocumentError, parse_json, parse_toml
from rotorid.io.tables.mapping import read_mapping
from rotorid.planning import read_prior
from rotorid.settings.given_controllers import read_controllers
from rotorid.settings.motors import chosen_layout
from rotorid.settings.resolve import resolve_model

TOML: Mapping[str, Callable[[Path], object]] = MappingProxyType(
    {
        "layout": lambda path: chosen_layout(str(path)),
        "model": resolve_model,
        "mapping": read_mapping,
        "controllers": read_controllers,
        "candidate": read_candidate,
        "vehicle": read_vehicle,
    }
)
JSON: Mapping[str, Callable[[Path], object]] = MappingProxyType(
    {
        "plan": read_plan,
        "result": load,
        "prior": read_prior,
        "compared": lambda path: read_results([path, path.with_name("other.json")]),
    }
)
"""Every document that is read, by the function that commands and programs read it with."""

BAD_TOML = {
    "brackets": "x = " + "[" * 20_000,
    "tables in tables": "x = " + "{a=" * 5_000,
    "a key of many parts": "a." * 50_000 + "a = 1",
    "a header of many parts": "[" + "a." * 50_000 + "a]",
    "digits": "x = " + "9" * 5_000,
    "digits of a part": "x = 0." + "9" * 5_000,
    "more than a double": "[[rotor]]\nposition_m = [1" + "0" * 400 + ', 0, 0]\nspin = "cw"\n',
    "infinite": "x = 1e999",
    "too long": "# " + "x" * 300_000,
    "no end of a text": 'x = "' + "\\" * 100_000,
    "no text": b"x = \xff",
    "nothing": "",
    "a null": "\0",
}
BAD_JSON = {
    "brackets": "[" * 200_000,
    "tables in tables": '{"a":' * 5_000,
    "digits": "9" * 5_000,
    "more than 64 bits": '{"schema": 123456789012345678901234567890}',
    "infinite": '{"schema": 1e999}',
    "no number": '{"schema": NaN}',
    "half a letter": '{"schema": "\\ud800"}',
    "no text": b'"\xff"',
    "nothing": "",
    "a list": "[1, 2]",
    "another": '{"schema": "rotorid.result/1"}',
    "of the wrong kind": '{"schema": "rotorid.result/1", "parameters": [], "provenance": 3}',
}


def refused(read: Callable[[Path], object], path: Path) -> RotoridError:
    with hang_limit(), pytest.raises(RotoridError) as raised:
        read(path)
    assert "\n" not in str(raised.value)
    assert len(str(raised.value)) < 2000
    return raised.value


@pytest.mark.parametrize("name", TOML)
def test_no_toml_raises_anything_but_a_sentence(name: str, tmp_path: Path) -> None:
    for number, content in enumerate(BAD_TOML.values()):
        path = tmp_path / f"{number}.toml"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())  # type: ignore[attr-defined]
        refused(TOML[name], path)


@pytest.mark.parametrize("name", JSON)
def test_no_json_raises_anything_but_a_sentence(name: str, tmp_path: Path) -> None:
    (tmp_path / "model.toml").write_text("")
    for number, content in enumerate(BAD_JSON.values()):
        folder = tmp_path / str(number)
        folder.mkdir()
        (folder / "model.toml").write_text("")
        path = folder / "result.json"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())  # type: ignore[attr-defined]
        refused(JSON[name], path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes here")
@pytest.mark.parametrize("name", [*TOML, *JSON])
def test_a_pipe_is_refused_at_once(name: str, tmp_path: Path) -> None:
    path = tmp_path / ("pipe.toml" if name in TOML else "result.json")
    os.mkfifo(path)
    assert "is a pipe" in str(refused({**TOML, **JSON}[name], path))


@pytest.mark.parametrize("read", [read_mapping, read_plan], ids=["mapping", "plan"])
def test_a_document_that_is_missing_says_what_was_needed(read: Callable[[Path], object], tmp_path: Path) -> None:
    assert "expected " in str(refused(read, tmp_path / "nowhere"))


def test_sound_documents_pass_unchanged() -> None:
    text = 'a = ["]", \'[\', """{""", 1.5, inf] # [\n[b.c."d.e"]\nx = 2026-01-01\ny = -9223372036854775808'
    assert parse_toml(text)["b"]["c"]["d.e"]["y"] == -(2**63)
    assert parse_json('{"a": "[[\\\\\\"[[", "b": [1e308, -1]}') == {"a": '[[\\"[[', "b": [1e308, -1]}


def test_faults_name_their_line() -> None:
    for text, line in (("a = 1\nb =", 2), ("\n\nx = " + "[" * 100, 3), ("\n" + "a." * 20 + "a = 1", 2)):
        with pytest.raises(DocumentError) as raised:
            parse_toml(text)
        assert raised.value.line == line


def test_an_error_about_a_document_is_complete(tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text("x = " + "[" * 1000)
    assert_complete(refused(read_mapping, tmp_path / "map.toml"))
