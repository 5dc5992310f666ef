"""Documents from elsewhere, TOML and JSON: whatever is in them costs a sentence, by one reader for all of them."""

from __future__ import annotations

import ast
import json
import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType

import pytest
from tests.hostile.damage import ROOT, assert_complete, hang_limit

from rotorid.checking.candidate import read_candidate
from rotorid.cli.preferences import read_preferences
from rotorid.documents.compare import read_results
from rotorid.documents.design import read_plan
from rotorid.documents.result import load
from rotorid.documents.vehicle import read_vehicle
from rotorid.errors import RotoridError
from rotorid.fleets.identity import read_named, read_salt
from rotorid.fleets.table import SCHEMA, Journal, LogAnswer, require_table, sorted_failures, sorted_rows
from rotorid.io.documents import DocumentError, parse_json, parse_toml
from rotorid.io.folders import ResultKind, clear_leftovers, own_files, target_folder
from rotorid.io.tables.mapping import read_mapping
from rotorid.lab.settings import LabSettings
from rotorid.lab.steps import read_project
from rotorid.planning import read_prior
from rotorid.proposing.judging import load_gains
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
        "project": read_project,
        "preferences": read_preferences,
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
OTHERS: Mapping[str, Callable[[Path], object]] = MappingProxyType(
    {
        "journal": lambda path: Journal(path).read(),
        "salt": read_salt,
        "vehicles": read_named,
        "gains": load_gains,
        "token": lambda path: LabSettings(token=f"@{path}"),
        "table": require_table,
    }
)
"""Every document that is read, by the function that commands and programs read it with."""

LOGS = "a log, which the registry has found to be a file"
OURS = "what the program wrote itself, or is part of it"
NOT_A_FILE = "no reading of a file"
BY_ITS_OWN = {
    **dict.fromkeys(
        (
            "fleets.engines",
            "fleets.places",
            "io.ardupilot.text",
            "io.betaflight.decoded",
            "io.betaflight.log",
            "io.blank",
            "io.crazyflie",
            "io.files",
            "io.mavlink.tlog",
            "io.paparazzi",
            "io.px4.folder",
            "io.registry",
            "io.ros.containers",
            "io.tables.csv",
            "io.tables.dialect",
            "io.tables.matlab",
            "io.tables.npz",
            "io.tables.parquet",
            "io.tables.scattered",
        ),
        LOGS,
    ),
    **dict.fromkeys(
        (
            "cli.installation",
            "exports.crazyflow",
            "exports.fmu",
            "exports.json_model",
            "exports.rl_tools",
            "fleets.worker",
            "io.copies",
            "io.pool",
            "io.sandbox",
            "io.sandbox_worker",
            "lab.session",
            "lab.tracks",
            "lab.workers",
            "models.library",
            "models.rotors",
            "plans.csv",
            "plot.figure",
            "report.files",
            "report.frame",
        ),
        OURS,
    ),
    "io.documents": "the reader",
    "io.folders": "a hash of any file in a folder of results",
    "fleets.table": "the end of a journal, to write behind it",
    "models.toml_source": "a key of a text that the reader has parsed",
    "benchmarking.flights": "a hash of a log, and a mapping that is part of the program",
    "benchmarking.foreign": "a table of predictions, line by line",
    "cli.lab_worker": NOT_A_FILE,
    "mcp.server": OURS,
    "lab.server": NOT_A_FILE,
    "lab.serving": NOT_A_FILE,
}
"""Modules that open or parse something else than a document, and what."""

PARSERS = frozenset(
    {"json.load", "json.loads", "tomllib.load", "tomllib.loads", "np.load", "np.loadtxt", "loadmat", "open"}
)
PARQUET = frozenset({"read_schema", "read_metadata", "read_table", "ParquetFile"})
OPENING = frozenset({"open", "read_text", "read_bytes"})

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
        if name == "preferences" and not content:  # who prefers nothing
            continue
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


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes here")
@pytest.mark.parametrize("name", OTHERS)
def test_what_is_no_text_is_refused_at_once(name: str, tmp_path: Path) -> None:
    if name == "table":
        pytest.importorskip("pyarrow", reason="the extra [parquet] is not installed")
    os.mkfifo(tmp_path / "pipe")
    assert "is a pipe" in str(refused(OTHERS[name], tmp_path / "pipe"))
    (tmp_path / "folder").mkdir()
    refused(OTHERS[name], tmp_path / "folder")
    if name != "gains":  # whatever is no letter in them is in a comment
        (tmp_path / "bytes").write_bytes(b"\xff\xfe\x00" * 100)
        refused(OTHERS[name], tmp_path / "bytes")
        assert (tmp_path / "bytes").stat().st_size == 300


def test_no_pipe_in_a_folder_of_results_holds_a_run_up(tmp_path: Path) -> None:
    """Neither in the place of a result, nor in what a killed run left behind."""
    if not hasattr(os, "mkfifo"):
        pytest.skip("there are no pipes here")
    out = tmp_path / "out"
    out.mkdir()
    leftover = tmp_path / f".rotorid-making-{'0' * 16}"
    leftover.mkdir()
    os.mkfifo(leftover / "job.json")
    listing = ResultKind(mains=("a.json",), listed=lambda _: {"b.csv": "0" * 64})
    (out / "a.json").write_text('{"schema": "rotorid.a/1"}')
    os.mkfifo(out / "b.csv")
    with hang_limit():
        clear_leftovers(tmp_path)
        assert own_files(out, listing) == {"a.json"}
        with pytest.raises(RotoridError, match=r"b\.csv"):
            target_folder(out, out, ResultKind(mains=("b.csv",)))


def test_every_document_goes_through_the_one_reader() -> None:
    found = set()
    for path in (ROOT / "src/rotorid").rglob("*.py"):
        module = ".".join(path.relative_to(ROOT / "src/rotorid").with_suffix("").parts)
        found |= {module for call in calls(path) if reads(call)}
    assert found - set(BY_ITS_OWN) == set(), "use rotorid.io.documents, or say what else it reads"
    assert set(BY_ITS_OWN) - found == set(), "reads nothing any more"


def calls(path: Path) -> Iterator[ast.Call]:
    """Calls in a module."""
    return (node for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, ast.Call))


def reads(call: ast.Call) -> bool:
    """Whether it opens a file to be read, or parses what is in one."""
    name = ast.unparse(call.func)
    if not isinstance(call.func, ast.Attribute):
        return name in PARSERS
    if name.startswith(("os.", "documents.", "self.open")):
        return False
    return name in PARSERS or call.func.attr in OPENING or call.func.attr in PARQUET


HOSTILE_LINES = (
    b"[" * 100_000,
    b'{"a":' * 5_000,
    b"9" * 5_000,
    b'"\xff"',
    b"[]",
    b"{}",
    b"null",
    b'{"rows": 1, "failed": []}',
)


def test_a_line_of_a_journal_is_an_answer_or_nothing(tmp_path: Path) -> None:
    """Whatever type a value has: what is kept can be sorted, hashed and written down."""
    text = dict.fromkeys(("log", "log_sha256", "vehicle", "model"), "a")
    row = {
        **text,
        **dict.fromkeys(("time_utc", "parameter", "unit", "findings", "format", "firmware", "settings"), "a"),
        **dict.fromkeys(("value", "std", "std_random", "lower", "upper"), 1.0),
        "flight": 1,
    }
    failure = {**text, "flight": 1, "kind": "refused", "reason": "a"}
    whole = {"log": "a", "place": "a", "mark": "a", "log_sha256": "a", "settings": "a"}
    whole |= {"rows": [row], "failed": [failure], "gains": {"P": None}, "patterns": [[1.0]], "seconds": 1}
    lines = [json.dumps(whole).encode(), *HOSTILE_LINES]
    values: tuple[object, ...] = (None, True, 3, 1e308, "x", "\x1b", [], [[]], {}, {"a": []}, 2**40)
    for value in values:
        lines += [json.dumps(whole | {"place": "b", key: value}).encode() for key in whole]
        lines += [json.dumps(whole | {"rows": [row | {key: value}], "place": "c"}).encode() for key in row]
        lines += [json.dumps(whole | {"failed": [failure | {key: value}], "place": "d"}).encode() for key in failure]
    path = tmp_path / "fleet.journal"
    head = b'{"schema": "rotorid.fleet.journal/1"}\n'
    path.write_bytes(head + b"\n".join(lines) + b"\n" + lines[0][:40])
    journal = Journal(path)
    journal.read()
    answers = list(journal.answers.values())
    assert journal.known("a", "a") is not None
    sorted_rows(answers)
    sorted_failures(answers)
    for answer in answers:
        assert LogAnswer.from_json(answer.as_json()).place == answer.place
    assert path.read_bytes().endswith(b"\n")


def test_a_foreign_file_in_the_place_of_a_journal_stays_whole(tmp_path: Path) -> None:
    """A last line without an end is cut off where it is the journal's own, and only there."""
    path = tmp_path / "fleet.journal"
    for content in (b"notes of mine", b'{"schema": "somebody/1"}\n'):
        path.write_bytes(content)
        refused(OTHERS["journal"], path)
        assert path.read_bytes() == content
    path.write_bytes(b'{"schema": "rotor')
    Journal(path).read()
    assert path.read_bytes() == b""


def test_a_salt_is_made_once(tmp_path: Path) -> None:
    path = tmp_path / "fleet.salt"
    path.write_bytes(b"")
    assert read_salt(path) == read_salt(path) == path.read_bytes() != b""


def test_metadata_of_a_table_is_read_in_the_child(tmp_path: Path) -> None:
    """Whose flipped bit may take the parser's process with it."""
    arrow = pytest.importorskip("pyarrow", reason="the extra [parquet] is not installed")
    from pyarrow import parquet

    for number, said in enumerate((SCHEMA, "rotorid.fleet.table/9\x1b", "")):
        schema = arrow.schema([("a", arrow.float64())], metadata={"rotorid": said})
        parquet.write_table(arrow.table({"a": [1.0]}, schema=schema), tmp_path / f"{number}")
    require_table(tmp_path / "0")
    assert r"rotorid.fleet.table/9\x1b" in str(refused(require_table, tmp_path / "1"))
    refused(require_table, tmp_path / "2")


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
