"""What a tool of ``rotorid mcp`` answers, schema ``rotorid.answer/1``."""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeAlias

from pydantic import Field

from rotorid.documents.base import Document

State: TypeAlias = Literal["done", "not_enough_data", "wrong_use", "failed", "canceled"]


class SpanDocument(Document):
    """A part of a log, on the log's own clock, and what it was used for."""

    log: str
    use: str
    start_s: float
    stop_s: float


class AnswerDocument(Document):
    """The answer of a tool.

    ``state`` is ``not_enough_data`` where the log was read and cannot support an answer, and ``wrong_use`` where the
    call was refused. ``evidence`` has the spans of the log behind the answer; statements of a review have their own.
    ``not_checked`` has what the command could not measure or check, ``left_out`` the keys that were cut for size.
    """

    schema_name: Annotated[Literal["rotorid.answer/1"], Field(alias="schema")] = "rotorid.answer/1"
    tool: str
    state: State
    sentence: str = ""
    evidence: list[SpanDocument] = Field(default_factory=list)
    not_checked: list[str] = Field(default_factory=list)
    answer: Any = None
    left_out: list[str] = Field(default_factory=list)
    folder: str | None = None
    files: list[str] = Field(default_factory=list)
