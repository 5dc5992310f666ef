"""The man page, from the commands themselves: ``python -m tests.docs.man_page`` writes ``docs/rotorid.1`` again."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from typer.main import get_command

from rotorid.cli.app import COMMANDS, app

PLACE = Path(__file__).resolve().parents[2] / "docs" / "rotorid.1"


def escaped(text: str) -> str:
    """Text that means nothing to troff."""
    plain = re.sub(r"\s+", " ", text).replace("\\", "\\e").replace("-", "\\-")
    return "\\&" + plain if plain.startswith((".", "'")) else plain


def described(option: Any) -> str:
    """An option and its help."""
    taken = f" \\fI{escaped(option.metavar)}\\fR" if option.metavar else ""
    names = ", ".join(escaped(name) + taken for name in (*option.opts, *option.secondary_opts))
    return f".TP\n.B {names}\n{escaped(option.help or '')}\n"


def man_page() -> str:
    """All commands with their options."""
    group = get_command(app)
    parts = [
        '.TH ROTORID 1 "" "rotorid" "User Commands"\n',
        f".SH NAME\nrotorid \\- {escaped(str(group.help))}\n",
        ".SH SYNOPSIS\n.B rotorid\nCOMMAND [ARGUMENT]... [OPTION]...\n.br\n.B rotorid\nLOG...\n",
        ".SH COMMANDS\n",
    ]
    for name, about in COMMANDS.items():
        command = group.commands[name]  # type: ignore[attr-defined]
        parts.append(f".SS {escaped(name)}\n{escaped(command.help or about)}\n")
        parts += [described(one) for one in command.params if one.opts[0].startswith("-")]
    parts.append(
        ".SH EXIT STATUS\n.TP\n.B 0\nThere is a result.\n"
        ".TP\n.B 1\nThe data do not support what was asked; findings say why.\n"
        ".TP\n.B 2\nWrong use, or a file that cannot be read.\n"
    )
    return "".join(parts)


if __name__ == "__main__":
    PLACE.write_text(man_page(), encoding="utf-8")
