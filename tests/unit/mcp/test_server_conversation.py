"""The server speaks the protocol, and answers as it did when the conversation was recorded."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from tests.unit.mcp.conversation import LONG, RECORD, SHORT, comparable, make_folder, spoken

from rotorid.mcp.answers import MOST_BYTES

pytest.importorskip("mcp", reason="the MCP SDK is not installed; it comes with the extra [mcp]")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_folder(tmp_path_factory.mktemp("mcp"))


def recorded(start: int, count: int) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = json.loads(RECORD.read_text(encoding="utf-8"))[start : start + count]
    return rows


def require_same(found: list[dict[str, Any]], before: list[dict[str, Any]]) -> None:
    for row, old in zip(found, before, strict=True):
        assert row["bytes"] <= MOST_BYTES
        assert (row["tool"], row["arguments"], row["error"]) == (old["tool"], old["arguments"], old["error"])
        assert comparable(row["answer"]) == comparable(old["answer"]), "renew it: python -m tests.unit.mcp.conversation"


def test_a_short_conversation(folder: Path) -> None:
    found = spoken(folder, SHORT)
    require_same(found, recorded(0, len(SHORT)))
    states = [row["answer"]["state"] for row in found]
    assert states == ["done", "wrong_use", "wrong_use", "wrong_use", "not_enough_data"]


@pytest.mark.slow
def test_the_whole_way_from_a_log_to_a_model_that_travels(tmp_path: Path) -> None:
    found = spoken(make_folder(tmp_path), [*SHORT, *LONG])[len(SHORT) :]
    require_same(found, recorded(len(SHORT), len(LONG)))
    by_tool = {row["tool"]: row["answer"] for row in found}
    assert by_tool["review"]["not_checked"]
    for tool in ("inspect", "review", "identify", "verify", "tune", "export"):
        assert by_tool[tool]["evidence"], tool
