"""What a command prints under ``--json`` when it refuses a call, schema ``rotorid.error/1``."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from rotorid.data.display import visible
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


def error_document(error: RotoridError) -> ErrorDocument:
    """An error as JSON holds it."""
    return ErrorDocument(
        exit_code=error.exit_code,
        came=visible(error.came),
        needed=visible(error.needed),
        remedy=visible(error.remedy),
        message=visible(str(error)),
    )
