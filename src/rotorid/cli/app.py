"""The command line. Every command calls one or two functions of the library.

The command ``NAME`` is the function ``NAME_command`` of ``rotorid.cli.NAME``, loaded when it is asked for: help and
errors come without the options of all the others.
"""

from __future__ import annotations

import functools
import os
import re
import sys
from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from rotorid import __version__
from rotorid.cli.console import listen, patient_output, say, spare_warnings
from rotorid.errors import RotoridError, UsageError
from rotorid.io.formats import ENDINGS

COMMANDS = {
    "demo": "Fly the built-in vehicle, identify it, write the report.",
    "review": "Say everything that ordinary flights tell; short: rotorid LOG.",
    "inspect": "Say what is in a log and what it can support.",
    "response": "Estimate frequency responses and margins.",
    "identify": "Identify a model from flight logs.",
    "verify": "Judge an identified model on data that it has not seen.",
    "compare": "Put models and methods side by side.",
    "delay": "Estimate delays as fractions of a sample.",
    "design": "Plan a flight: test inputs, what they will tell, files.",
    "simulate": "Fly a vehicle in simulation, and write its log.",
    "stitch": "Join models of several speeds into one over speed.",
    "tune": "Propose gains that hold, and write files for the autopilot with a way back.",
    "export": "Write an identified vehicle as files of simulators and tools.",
    "fleet": "Read many logs into one table: what is normal, what differs, what changed.",
    "track": "Follow a model through a flight: what changed on the way, and when.",
    "lab": "Open a page in the browser where logs are seen, chosen and identified.",
    "run": "Carry out the steps of a project file that the page saved.",
    "models": "List the models of the library, or print one.",
    "vehicles": "List the vehicles of the library, or write a vehicle file.",
    "example": "Write a small log to try everything on.",
    "doctor": "Say whether this installation is sound.",
}
"""Every command, and what it does in a line of ``rotorid --help``; its own help says more."""

# The matrices of this package are small: threads inside one product cost more than they bring, tenfold under load.
# Read when NumPy is first imported, which the commands do later.
for _variable in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

_INTERRUPTED = 130

_WORDS: dict[str, Any] = {
    "pretty_exceptions_enable": False,
    "rich_markup_mode": None,
    "context_settings": {"help_option_names": ["-h", "--help"]},
}


_MANY = 12
"""Options beyond which a command lists them under headings."""
_LAST = ("Results", "Options")


class Grouped(TyperCommand):
    """A command that lists its options under headings where there are many."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Arguments, then options by what they are about, then those without a heading."""
        help_records = [
            (parameter, record)
            for parameter in self.get_params(ctx)
            if (record := parameter.get_help_record(ctx)) is not None
        ]
        many = len(help_records) > _MANY
        sections: dict[str, list[Any]] = {"Arguments": []}
        for parameter, record in help_records:
            heading = (getattr(parameter, "rich_help_panel", None) if many else None) or "Options"
            heading = "Arguments" if parameter.param_type_name == "argument" else heading
            # Several of a kind are written as one; what an argument is its help says.
            name = re.sub(r"<list\[(\w+)\]>", lambda kind: f"<{kind[1].lower()}>", record[0])
            name = re.sub(r"(?<=\S) <\w+>$", "", name) if heading == "Arguments" else name
            sections.setdefault(heading, []).append((name, record[1]))
        for title in (*(title for title in sections if title not in _LAST), *_LAST):
            if sections.get(title):
                with formatter.section(title):
                    formatter.write_dl(sections[title])


class Commands(Mapping[str, Any]):
    """The commands by name, each loaded when it is looked up."""

    def __iter__(self) -> Iterator[str]:
        return iter(COMMANDS)

    def __len__(self) -> int:
        return len(COMMANDS)

    def __getitem__(self, name: str) -> Any:
        if name not in COMMANDS:
            raise KeyError(name)
        from rotorid.cli.options import with_options

        command = getattr(import_module(f"rotorid.cli.{name}"), f"{name}_command")
        if name != "doctor":
            # It says itself what is wrong with the file of preferences.
            command = as_preferred(command)
        alone = typer.Typer(add_completion=False, **_WORDS)
        alone.command(name, cls=Grouped, context_settings=_WORDS["context_settings"])(with_options(command))
        return typer.main.get_command(alone)


def as_preferred(command: Any) -> Any:
    """A command whose pages look as the person at this machine prefers."""

    @functools.wraps(command)
    def run(*given: Any, **named: Any) -> None:
        from rotorid.cli.preferences import preferences

        preferred = preferences()
        if not (preferred.frequency or preferred.magnitude or preferred.theme):
            command(*given, **named)
            return
        from rotorid.report.frame import Appearance, appearance

        before = appearance.set(Appearance(preferred.frequency, preferred.magnitude, preferred.theme))
        try:
            command(*given, **named)
        finally:
            appearance.reset(before)

    return run


class Group(TyperGroup):
    """All commands, of which the list loads none."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        self.commands = Commands()  # type: ignore[assignment]

    def list_commands(self, _: Any) -> list[str]:
        """Names of the commands."""
        return list(COMMANDS)

    def format_commands(self, _: Any, formatter: Any) -> None:
        """What the help says of them."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


app = typer.Typer(
    name="rotorid",
    cls=Group,
    help="System identification for multirotors: flight log in, model with honest bounds and a report out.",
    no_args_is_help=True,
    **_WORDS,
)


def with_review(arguments: list[str]) -> list[str]:
    """The words of the command line, ``review`` put first where they begin with a log.

    Examples
    --------
    >>> with_review(["models", "--json"]), with_review(["--help"])
    (['models', '--json'], ['--help'])
    >>> with_review(["flight.ulg"])
    ['review', 'flight.ulg']
    """
    if not arguments or arguments[0] in COMMANDS or arguments[0].startswith("-"):
        return arguments
    first = Path(arguments[0])
    return ["review", *arguments] if first.suffix.lower() in ENDINGS or first.exists() else arguments


def _version(asked: bool) -> None:
    if asked:
        print(f"rotorid {__version__}")
        raise typer.Exit


@app.callback()
def _main(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    pass


_Refused: type[Any] = next(kind for kind in typer.BadParameter.__mro__ if kind.__name__ == "ClickException")
"""What the parser of the command line raises; Typer names the kinds of it alone."""


def _print_error(error: RotoridError) -> None:
    """One sentence; and JSON on standard output where that was asked for, for scripts that read nothing else."""
    say(f"rotorid: {error}")
    if "--json" in sys.argv[1:]:
        from rotorid.documents.base import to_json
        from rotorid.documents.error import error_document

        sys.stdout.write(to_json(error_document(error)))


def _parsed(words: list[str]) -> int:
    """Do what the words say, and tell the exit code.

    Raises
    ------
    UsageError
        The parser does not understand them.
    """
    try:
        return int(app(words, standalone_mode=False) or 0)
    except _Refused as error:
        context = getattr(error, "ctx", None)
        if error.__class__.__name__ == "NoArgsIsHelpError":
            error.show()
            return int(error.exit_code)
        message = " ".join(error.format_message().split()).rstrip(".")
        raise UsageError(
            f"{message[:1].lower()}{message[1:]}",
            needed=f"what {context.command_path if context else 'rotorid'} --help lists",
        ) from None


def main() -> None:
    """Entry point: errors become one sentence and an exit code."""
    patient_output()
    listen()
    spare_warnings()
    try:
        code = _parsed(with_review(sys.argv[1:]))
        # The parser turns an interrupt into this code, too.
        if code == _INTERRUPTED:
            raise KeyboardInterrupt
        sys.exit(code)
    except KeyboardInterrupt:
        say("rotorid: interrupted; files that were complete stay, and no file is left half written")
        # Python takes an interrupt of a class that was just being made (it runs their source) for one that nobody
        # caught, and would end by the signal in place of the code; source that runs through takes that back.
        exec("")
        sys.exit(_INTERRUPTED)
    except RotoridError as error:
        _print_error(error)
        sys.exit(error.exit_code)
    except BrokenPipeError:
        # Who reads has read enough; what Python would still flush at the end has nowhere to go.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except OSError as error:
        if sys.argv[1:2] == ["doctor"]:
            raise
        say(f"rotorid: the output cannot be written: {error.strerror or error}")
        sys.exit(2)
