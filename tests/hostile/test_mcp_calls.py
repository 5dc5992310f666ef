"""Hostile calls of tools: each gets a sentence, no traceback; nothing outside the folders is read or written."""

from __future__ import annotations

import json
import logging
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from rotorid.documents.answer import AnswerDocument
from rotorid.lab.workers import Job, Workers
from rotorid.mcp.answers import MOST_BYTES, bounded
from rotorid.mcp.folders import named_folders
from rotorid.mcp.server import Desk, answered

anyio = pytest.importorskip("anyio", reason="anyio comes with the extra [mcp]")

PATHS = (
    *(
        "",
        " ",
        ".",
        "..",
        "/",
        "//",
        "~",
        "~/x",
        "~root",
        "$HOME/x",
        "%USERPROFILE%",
        "-",
        "-h",
        "--help",
        "--out",
        "@x",
    ),
    *(
        "../secret.ulg",
        "../../etc/passwd",
        "/etc/passwd",
        "//etc/passwd",
        "/proc/self/environ",
        "/dev/zero",
        "/dev/stdin",
    ),
    *("a/../../secret.ulg", "./../secret.ulg", "flight.ulg/../../secret.ulg", "up/secret.ulg", "out.ulg", "up", "loop"),
    *(
        ".hidden.ulg",
        ".git/config",
        "pipe",
        "flight.ulg;id",
        "|id",
        "`id`",
        "$(id)",
        "flight.ulg --force",
        "a\nb",
        "a\0b",
    ),
    *("file:///etc/passwd", "https://example.org/x.ulg", "\\\\host\\share", "C:\\x", "CON", "x" * 1000, "x" * 5000),
    *("\u202egpj.ulg", "\ud800", "\x1b[2J", "\ufeff", "＿／..／x", "model/../../secret.ulg", "SECRET"),
)
NO_PATHS: tuple[Any, ...] = (
    None,
    1,
    1.5,
    True,
    [],
    {},
    ["flight.ulg"] * 999,
    [["flight.ulg"]],
    {"a": {"b": {}}},
    b"x".hex() * 9000,
)
NAMES = (
    "../x",
    "/tmp/x",
    "a/b",
    "..",
    ".",
    ".x",
    "-x",
    "a\0",
    "x" * 300,
    "a b",
    "--force",
    "a\\b",
    "ä",
    "a..b",
    "$x",
    "",
)
MODELS = (
    *("../x.toml", "/etc/passwd", "a.toml", "rate.roll --out /tmp/x", "rate.roll,/etc/passwd", "black_box:1/../../x"),
    *("x.y/../z", "transfer:0/1/../..", "-h", "", "all,../x.toml", "rate.roll\0", "a.b/", "A" * 9999),
)
TARGETS = ("json --out /tmp", "../../x", "", "JSON", "json\n", "x" * 99, "json;id", "-h", "--to")


def calls() -> Iterator[tuple[str, dict[str, Any]]]:
    """Hostile calls: a place, a name or a number where another belongs."""
    good: dict[str, Any] = {"log": "flight.ulg"}
    fits: dict[str, Any] = {"logs": ["flight.ulg"], "models": ["rate.roll"]}
    for path in (*PATHS, *NO_PATHS):
        yield "inspect", {"log": path}
        yield "review", good | {"map": path}
        yield "identify", {"logs": [path], "models": ["rate.roll"]}
        yield "identify", fits | {"verify": [path]}
        yield "identify", {"logs": ["flight.ulg"], "model_file": path}
        yield "tune", {"given": [path, "flight.ulg"]}
        yield "tune", {"given": ["flight.ulg"], "judge": path}
        yield "verify", {"result": path, "logs": ["flight.ulg"]}
        yield "export", {"results": [path], "to": "json"}
        yield "details", {"result": path}
        yield "picture", {"result": "model", "name": path}
    for name in NAMES:
        yield "review", good | {"out": name}
        yield "export", {"results": ["model"], "to": "json", "out": name}
        yield "export", {"results": ["model"], "to": "json", "layout": f"{name}/"}
        yield "identify", fits | {"fix": {f"{name}=1 ": 1.0}}
    for model in MODELS:
        yield "identify", {"logs": ["flight.ulg"], "models": [model]}
    for target in TARGETS:
        yield "export", {"results": ["model"], "to": target}
    numbers: tuple[Any, ...] = ("1", "x", None, float("nan"), float("inf"), 1e400, [], {})
    for number in numbers:
        yield "tune", {"given": ["flight.ulg"], "robustness": number if number is not None else {}}
        yield "identify", fits | {"band_rad_s": [number, 1.0]}
        yield "export", {"results": ["model"], "to": "json", "values": {"m": number}}
    for draws in (-1, 10**9, 1.5, "many"):
        yield "export", {"results": ["model"], "to": "json", "draws": draws}
    for key in ("__class__", "0", "secret.0", "../..", ".", "a" * 301, "…", "-1", "rows.99", "rows.-1", "rows.1e3"):
        yield "details", {"result": "model", "key": key}
    for tool in ("", "shell", "run", "__init__", "inspect ", "Inspect", "x" * 9999, "\x1b[2J", "lab", "demo"):
        yield tool, good
    yield "files", {"folder": "/"}
    yield "tune", {"given": ["flight.ulg"], "judge_text": "x" * 4001}
    yield "inspect", good | {"force": True}
    yield "inspect", {"log": "flight.ulg", "self": "x"}


CALLS = [*calls()]


class Refusing(Workers):
    """Carries out nothing, and remembers what it was asked."""

    def __init__(self) -> None:
        super().__init__()
        self.asked: list[list[str]] = []

    def start(self, words: Any, folder: Path) -> Job:
        self.asked.append([*words])
        job = Job([*words], folder)
        job.code = 2
        job.end("refused", "rotorid: nothing was carried out.")
        return job


_opened: list[str] | None = None


def _remember(event: str, arguments: tuple[Any, ...]) -> None:
    if _opened is not None and event in ("open", "os.listdir", "os.scandir", "os.remove", "os.rename", "os.mkdir"):
        _opened.append(os.fsdecode(arguments[0]) if isinstance(arguments[0], str | bytes | Path) else "")


sys.addaudithook(_remember)


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """A folder with a log and a result, links that lead out of it, and a secret outside."""
    inside = tmp_path / "inside"
    (inside / "model").mkdir(parents=True)
    for name in ("flight.ulg", ".hidden.ulg", "../secret.ulg"):
        (inside / name).write_text(f"SECRET of {name}")
    (inside / "model" / "result.json").write_text(json.dumps({"schema": "rotorid.result/1", "rows": [1, 2]}))
    (inside / "out.ulg").symlink_to(tmp_path / "secret.ulg")
    (inside / "up").symlink_to(tmp_path)
    (inside / "loop").symlink_to(inside / "loop")
    os.mkfifo(inside / "pipe")
    return inside


def snapshot(root: Path) -> dict[str, int]:
    """Files and folders with their times; the folder of results belongs to the server."""
    paths = [path for path in root.rglob("*") if "rotorid-out" not in path.parts and path.name != "inside"]
    return {str(path): path.lstat().st_mtime_ns for path in paths}


def test_there_are_200_hostile_calls() -> None:
    assert len(CALLS) >= 200


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes and links")
def test_hostile_calls_are_answered_and_touch_nothing_outside(place: Path, caplog: pytest.LogCaptureFixture) -> None:
    global _opened
    workers = Refusing()
    desk = Desk(named_folders([place]), workers=workers)
    before = snapshot(place.parent)

    async def ask() -> list[tuple[str, str]]:
        found = []
        for tool, arguments in CALLS:
            answer = await answered(desk, tool, arguments)
            assert isinstance(answer, AnswerDocument), (tool, arguments)
            found.append((answer.state, bounded(answer)))
        return found

    run: Callable[..., list[tuple[str, str]]] = anyio.run
    opened: list[str] = []
    _opened = opened
    try:
        with caplog.at_level(logging.ERROR, logger="rotorid.mcp"):
            answers = run(ask)
    finally:
        _opened = None
        desk.close()
    assert not caplog.records
    assert snapshot(place.parent) == before
    real = os.path.realpath(place.parent)
    outside = [path for path in opened if os.path.realpath(path).startswith(real) and "/inside" not in path]
    assert not outside
    assert not [path for path in opened if path.startswith(("/etc/passwd", "/proc/self/environ", "/dev/"))]
    for (tool, arguments), (state, text) in zip(CALLS, answers, strict=True):
        assert len(text.encode()) <= MOST_BYTES
        assert "Traceback" not in text
        assert state != "failed", (tool, arguments, text)
        assert "SECRET" not in json.loads(text)["sentence"].replace("'SECRET'", "")
        assert str(place.parent) not in text
    # What reached a command names places inside, and nothing that is an option by accident.
    assert workers.asked
    own = {"--json", "--quiet", "--out", "--model", "--seed", "--to", "--set", "--map", "--brief", "--verify"}
    own |= {"--fix", "--judge", "--robustness", "--band"}
    for words in workers.asked:
        options = {word for word in words if word.startswith("-")}
        assert options <= own, words
        for word in words:
            assert not word.startswith("/") or Path(word).resolve().is_relative_to(place.resolve()), words


@pytest.mark.slow
@pytest.mark.parametrize(
    ("tool", "arguments"),
    [
        ("inspect", {"log": "flight.ulg"}),
        ("identify", {"logs": ["flight.ulg"], "models": ["a.toml"]}),
        ("tune", {"given": ["flight.ulg"], "judge_text": "\0roll: P=\x1b[2J"}),
        ("verify", {"result": "model", "logs": ["flight.ulg"]}),
        ("export", {"results": ["model"], "to": "etc-passwd", "layout": "etc.passwd"}),
        ("export", {"results": ["model"], "to": "json", "values": {"__class__": 1.0}}),
        ("review", {"log": "flight.ulg", "mass_kg": 1e-300}),
        ("inspect", {"log": "up/.."}),
    ],
)
def test_what_reaches_a_command_is_refused_by_it_in_a_sentence(
    tool: str, arguments: dict[str, Any], place: Path
) -> None:
    desk = Desk(named_folders([place]))
    before = snapshot(place)
    run: Callable[..., Any] = anyio.run
    try:
        answer = run(answered, desk, tool, arguments)
    finally:
        desk.close()
    assert answer.state in ("wrong_use", "not_enough_data"), answer
    assert answer.sentence
    assert snapshot(place) == before
