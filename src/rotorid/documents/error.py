"""What a command prints under ``--json`` when it refuses a call, schema ``rotorid.error/1``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Literal

from pydantic import Field

from rotorid.documents.base import Document
from rotorid.errors import RotoridError


class ErrorDocument(Document):
    """A call that was refused: what came, what was needed, what to do; ``message`` is all of it as one sentence."""

    schema_name: Annotated[Literal["rotorid.error/1"], Field(alias="schema")] = "rotorid.error/1"
    exit_code: int
    came: str
    needed: str
    remedy: str
    message: str


def error_document(error: RotoridError, *, worded: Callable[[str], str] = str) -> ErrorDocument:
    """An error as JSON holds it.

    Parameters
    ----------
    worded
        Puts its texts into the words of the reader's command.
    """
    return ErrorDocument(
        exit_code=error.exit_code,
        came=error.came,
        needed=worded(error.needed),
        remedy=worded(error.remedy),
        message=worded(str(error)),
    )
