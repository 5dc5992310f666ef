"""Choices of the lab: its address, and who may open it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from rotorid.data.base import Immutable
from rotorid.settings.option import Option


@dataclass(frozen=True, kw_only=True)
class LabSettings(Immutable):
    """The address of the lab, and who may open it.

    Parameters
    ----------
    token
        Password for browsers, or ``@`` and the file that contains it. Without one it is random, and good for one
        browser.
    no_browser
        Whether no browser is opened.

    Raises
    ------
    UsageError
        The file of the token cannot be read.
    """

    host: Annotated[
        str,
        Option(
            "--host", "Address of this machine to serve at; any but the local one needs --token.", metavar="ADDRESS"
        ),
    ] = "127.0.0.1"
    port: Annotated[int, Option("--port", "Port; 0 takes any free one.", metavar="NUMBER", within=(0, 65535))] = 0
    token: Annotated[
        str | None,
        Option(
            "--token",
            "Password for browsers, or @FILE that contains it, which other users of this machine cannot see. "
            "[default: random, for one browser]",
            metavar="WORD|@FILE",
            variable="ROTORID_LAB_TOKEN",
        ),
    ] = None
    no_browser: Annotated[bool, Option("--no-browser", "Print the address, but open no browser.", also="--no-open")] = (
        False
    )

    def __post_init__(self) -> None:
        if self.token is not None and self.token.startswith("@"):
            self._set(token=_word_in(Path(self.token[1:])))


def _word_in(file: Path) -> str:
    from rotorid.io.documents import read_text

    return read_text(file, needed="a file that contains only the token").strip()
