"""Choices of the lab: where it listens, and who may come in."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from rotorid.data.base import Immutable
from rotorid.errors import UsageError
from rotorid.settings.option import Option


@dataclass(frozen=True, kw_only=True)
class LabSettings(Immutable):
    """Where the lab listens, and who may come in.

    Parameters
    ----------
    token
        What lets browsers in, or the file that holds it behind an ``@``; without one it is drawn at random, and lets in
        one.
    no_browser
        Whether no browser is opened.

    Raises
    ------
    UsageError
        The file of the token cannot be read.
    """

    host: Annotated[
        str, Option("--host", "Of this machine, to listen at; others than its own need a token.", metavar="ADDRESS")
    ] = "127.0.0.1"
    port: Annotated[int, Option("--port", "0 takes any free one.", metavar="NUMBER", within=(0, 65535))] = 0
    token: Annotated[
        str | None,
        Option(
            "--token",
            "Word that lets browsers in, or a file with it, which others on this machine do not see. "
            "[default: drawn at random, for one browser]",
            metavar="WORD|@FILE",
            variable="ROTORID_LAB_TOKEN",
        ),
    ] = None
    no_browser: Annotated[bool, Option("--no-browser", "Print the address, and open no browser.", also="--no-open")] = (
        False
    )

    def __post_init__(self) -> None:
        if self.token is not None and self.token.startswith("@"):
            self._set(token=_word_in(Path(self.token[1:])))


def _word_in(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8").strip()
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or "it is no text"
        raise UsageError(
            f"the token in {file} cannot be read: {why}", needed="a file that contains only the token"
        ) from None
