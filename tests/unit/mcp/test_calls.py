"""A call becomes the words of a command line; its choices cannot become anything else."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from rotorid.errors import UsageError
from rotorid.lab.workers import Job
from rotorid.mcp.calls import TOOLS, DetailsCall, command_of, parse_call
from rotorid.mcp.folders import Folders, named_folders
from rotorid.mcp.server import Desk, tool_schema


@pytest.fixture
def folders(tmp_path: Path) -> Folders:
    for name in ("a.ulg", "b.ulg", "map.toml", "old.params"):
        (tmp_path / name).write_text(name)
    (tmp_path / "model").mkdir()
    (tmp_path / "model" / "result.json").write_text("{}")
    return named_folders([tmp_path])


def words(tool: str, folders: Folders, **arguments: Any) -> str:
    """The command line, without the folder."""
    command = command_of(parse_call(tool, arguments), folders)
    root = next(iter(folders.roots.values()))
    return " ".join(command.words).replace(f"{root}/", "")


@pytest.mark.parametrize(
    ("tool", "arguments", "line"),
    [
        ("inspect", {"log": "a.ulg", "map": "map.toml"}, "inspect a.ulg --map map.toml"),
        (
            "identify",
            {
                "logs": ["a.ulg"],
                "models": ["rate.roll", "transfer:0/2"],
                "verify": ["b.ulg"],
                "segments": [{"axis": "roll", "start_s": 1.0, "stop_s": 20.5}],
                "fix": {"T_motor": 0.05},
                "band_rad_s": [1.0, 40.0],
                "reduce": True,
            },
            "identify a.ulg --model rate.roll,transfer:0/2 --verify b.ulg --segment roll:1:20.5 --fix T_motor=0.05 "
            "--band 1:40 --reduce --seed 0",
        ),
        ("identify", {"logs": ["a.ulg"], "model_file": "map.toml"}, "identify a.ulg --model map.toml --seed 0"),
        (
            "tune",
            {"given": ["a.ulg", "model"], "judge": "old.params", "axes": ["roll"], "keep": ["D"], "noise": 1.5},
            "tune a.ulg model --judge old.params --axes roll --noise 1.5 --keep D",
        ),
        ("verify", {"result": "model", "logs": ["b.ulg"]}, "verify model b.ulg"),
        (
            "export",
            {"results": ["model"], "to": "px4-sih", "values": {"m": 1.4}, "layout": "quad.x", "draws": 5},
            "export model --to px4-sih --set m=1.4 --layout quad.x --draws 5 --seed 0",
        ),
    ],
)
def test_calls_are_command_lines(tool: str, arguments: dict[str, Any], line: str, folders: Folders) -> None:
    assert words(tool, folders, **arguments) == line


def test_results_are_named_after_logs_and_numbered(folders: Folders) -> None:
    call = parse_call("verify", {"result": "model", "logs": ["b.ulg"]})
    first = command_of(call, folders).out
    assert first == folders.out / "b-verify"
    first.mkdir(parents=True)
    assert command_of(call, folders).out == folders.out / "b-verify-2"
    named = parse_call("verify", {"result": "model", "logs": ["b.ulg"], "out": "mine"})
    assert command_of(named, folders).out == folders.out / "mine"


def test_no_call_writes_where_another_wrote_or_will(folders: Folders) -> None:
    """An assistant may ask for two models of one log at once."""
    desk = Desk(folders)
    calls = [parse_call("identify", {"logs": ["b.ulg"], "models": ["rate.roll"], "seed": seed}) for seed in (0, 1)]
    try:
        first, second = (desk.command(call) for call in calls)
        assert first.out == folders.out / "b-rate.roll"
        assert second.out == folders.out / "b-rate.roll-2"
        desk.release(first)
        assert desk.command(calls[1]).out == first.out
    finally:
        desk.close()
    (folders.out / "mine").mkdir(parents=True)
    with pytest.raises(UsageError, match="there is a folder 'mine' already; give another name for out, or none"):
        words("verify", folders, result="model", logs=["b.ulg"], out="mine")


@pytest.mark.parametrize(("text", "sentence"), [("[1]", "is no result"), ("{", "is damaged"), ("NaN", "is damaged")])
def test_a_result_that_is_none_is_refused_in_words(text: str, sentence: str, folders: Folders) -> None:
    (place := folders.find("model", "folder") / "result.json").write_text(text)
    desk = Desk(folders)
    try:
        with pytest.raises(UsageError, match=f"{place.name} of 'model' {sentence}"):
            desk.details(DetailsCall(result="model"))
    finally:
        desk.close()


@pytest.mark.parametrize(
    "document",
    [
        {"findings": [1]},
        {"cannot_tell": 5},
        {"judged": [1]},
        {"judged": {"axes": {"roll": 1}}},
        {"verification": "x"},
        {"flights_s": [1]},
        {"flights": [{"start_s": "a", "stop_s": {}}]},
        {"results": [{"findings": {"a": 1}}]},
    ],
    ids=str,
)
def test_a_result_with_parts_of_another_kind_is_refused_in_words(document: dict[str, Any], folders: Folders) -> None:
    (folders.find("model", "folder") / "result.json").write_text(json.dumps(document))
    desk = Desk(folders)
    try:
        with pytest.raises(UsageError, match="of 'model' is damaged: a part is not of the kind that it should be"):
            desk.details(DetailsCall(result="model"))
    finally:
        desk.close()


def test_an_answer_stays_when_its_log_is_gone(folders: Folders) -> None:
    log = folders.find("a.ulg", "file")
    desk = Desk(folders)
    try:
        command = desk.command(parse_call("inspect", {"log": "a.ulg"}))
        log.unlink()
        (folder := desk._place / "call").mkdir()
        job = Job([], folder, state="done", code=0)
        document = {"schema": "rotorid.inspect/1", "name": "a.ulg", "flights": [{"start_s": 1.0, "stop_s": 9.0}]}
        job.output.write_text(json.dumps(document))
        answer = desk.answer("inspect", command, job)
        assert (answer.state, answer.evidence[0].use) == ("done", "in the air")
        assert desk.flights(log) == []
    finally:
        desk.close()


@pytest.mark.parametrize(
    ("tool", "arguments", "sentence"),
    [
        ("shell", {}, "unknown tool 'shell'"),
        ("inspekt", {"log": "a.ulg"}, "did you mean inspect?"),
        ("inspect", {}, "inspect: log: Field required"),
        ("inspect", {"log": "a.ulg", "force": True}, "unknown choice of inspect 'force'; expected map or log"),
        ("identify", {"logs": ["a.ulg"], "model": "rate.roll"}, "choice of identify 'model'; did you mean models?"),
        ("files", {"folder": "logs"}, "files takes no choices"),
        ("identify", {"logs": ["a.ulg"]}, "identify needs either models or model_file"),
        ("identify", {"logs": ["a.ulg"], "models": ["../a.toml"]}, "is not a model of the list"),
        ("tune", {"given": ["a.ulg"], "judge": "old.params", "judge_text": "roll: P=1"}, "exclude each other"),
        ("export", {"results": ["model"], "to": "json", "values": {"m": "x"}}, "values.m: Input should be"),
        ("review", {"log": "a.ulg", "out": "../b"}, "out: use letters, digits"),
    ],
)
def test_a_wrong_call_is_refused_in_words(
    tool: str, arguments: dict[str, Any], sentence: str, folders: Folders
) -> None:
    with pytest.raises(UsageError) as error:
        words(tool, folders, **arguments)
    assert sentence in str(error.value)


@pytest.mark.parametrize("tool", TOOLS)
def test_every_tool_has_a_schema_and_a_sentence(tool: str) -> None:
    schema = tool_schema(tool)
    assert schema["type"] == "object"
    assert schema["additionalProperties"] is False
    assert TOOLS[tool].about.endswith(".")
