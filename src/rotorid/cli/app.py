"""The command line. Every command calls one or two functions of the library.

The command ``NAME`` is the function ``NAME_command`` of ``rotorid.cli.NAME``. It is loaded when it is used, so help and
errors do not load the options of all others.
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
from typer.core import TyperGroup

from rotorid import __version__
from rotorid.cli.console import for_reader, listen, patient_output, say, spare_warnings
from rotorid.cli.help import HELP, HelpfulCommand, argument_name
from rotorid.data import synonyms
from rotorid.errors import RotoridError, UsageError, nearest_name, unknown_name
from rotorid.io.formats import ENDINGS

COMMANDS = {
    "demo": "Fly the built-in vehicle, identify it, write the report.",
    "review": "Analyze an ordinary flight (same as rotorid LOG).",
    "inspect": "Show what is in a log and what it is good for.",
    "response": "Estimate frequency responses and margins.",
    "identify": "Identify a model from flight logs.",
    "verify": "Check a model on data it was not fitted to.",
    "compare": "Compare models and methods in one table.",
    "bench": "Score models on a public benchmark, next to published errors.",
    "delay": "Estimate delays between channels.",
    "design": "Plan an identification flight: test inputs, expected accuracy, files.",
    "simulate": "Simulate a flight and write its log.",
    "stitch": "Join models of several speeds into one.",
    "tune": "Propose new gains, with files to load them and to go back.",
    "export": "Write a model for a simulator or tool: PX4 SIH, Gazebo, MATLAB, ...",
    "fleet": "Analyze many logs: what is normal, what differs, what changed.",
    "track": "Follow a model through a flight to find changes.",
    "lab": "Open the interactive page in the browser.",
    "mcp": "Offer the commands as tools to an assistant (Model Context Protocol).",
    "run": "Repeat the steps of a project saved in the lab.",
    "models": "List the models, or print one as TOML.",
    "vehicles": "List the vehicles, or print one as a file.",
    "example": "Write a small log to try things on.",
    "doctor": "Check this installation.",
}
"""Every command with its line in ``rotorid --help``; its own help says more."""

# The matrices of this package are small, so threads inside one product cost more than they save, tenfold under load.
# NumPy reads this when it is first imported, which the commands do later.
for _variable in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

_INTERRUPTED = 130

_WORDS: dict[str, Any] = {
    "pretty_exceptions_enable": False,
    "rich_markup_mode": None,
    "context_settings": {"help_option_names": ["-h", "--help"]},
}


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
            # It reports what is wrong with the file of preferences itself.
            command = as_preferred(command)
        alone = typer.Typer(add_completion=False, **_WORDS)
        alone.command(name, cls=HelpfulCommand, context_settings=_WORDS["context_settings"])(with_options(command))
        return typer.main.get_command(alone)


def as_preferred(command: Any) -> Any:
    """A command whose pages follow the preferences of the user."""

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
    """All commands; listing them loads none."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        self.commands = Commands()  # type: ignore[assignment]

    def list_commands(self, _: Any) -> list[str]:
        """Names of the commands."""
        return list(COMMANDS)

    def format_usage(self, _: Any, formatter: Any) -> None:
        """The two ways to call it."""
        formatter.write("Usage: rotorid LOG...                  analyze a flight\n")
        formatter.write("       rotorid COMMAND ... [OPTIONS]\n")

    def format_commands(self, _: Any, formatter: Any) -> None:
        """The list of commands."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


app = typer.Typer(
    name="rotorid",
    cls=Group,
    help="System identification for multirotors: from a flight log to a model with error bounds and a report.",
    no_args_is_help=True,
    **_WORDS,
)


def with_review(arguments: list[str]) -> list[str]:
    """The words of the command line, with ``review`` in front if they begin with a log.

    Raises
    ------
    UsageError
        The first word is neither a command nor a log.

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
    if first.suffix.lower() in ENDINGS or first.exists():
        return ["review", *arguments]
    if len(first.parts) > 1 or first.suffix:
        raise UsageError(f"{arguments[0]!r} is no file and no command", remedy="rotorid --help lists the commands")
    raise unknown_name("command", arguments[0], COMMANDS, synonyms=synonyms.COMMANDS, see="rotorid --help")


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
"""What the parser of the command line raises; Typer exports only its subclasses."""


def _print_error(error: RotoridError) -> None:
    """Print one sentence, and with ``--json`` an object on standard output for scripts."""
    say(f"rotorid: {for_reader(str(error))}")
    if "--json" in sys.argv[1:]:
        from rotorid.documents.base import to_json
        from rotorid.documents.error import error_document

        sys.stdout.write(to_json(error_document(error, worded=for_reader)))


def _parsed(words: list[str]) -> int:
    """The exit code of a command line.

    Raises
    ------
    UsageError
        The parser does not understand it.
    """
    try:
        return int(app(words, standalone_mode=False) or 0)
    except _Refused as error:
        if error.__class__.__name__ == "NoArgsIsHelpError":
            error.show()
            return int(error.exit_code)
        raise _in_words(error, words) from None


_NUMBERS = {"a valid integer": "a whole number", "a valid number": "a number"}


def _in_words(error: Any, words: list[str]) -> UsageError:
    """An error of the parser as one of rotorid."""
    context: Any = getattr(error, "ctx", None)
    param, kind = getattr(error, "param", None), error.__class__.__name__
    command = words[0] if words and words[0] in COMMANDS else ""
    path = f"rotorid {command}".strip()
    name = "" if param is None else param.opts[0] if param.param_type_name == "option" else argument_name(param)
    if kind == "MissingParameter":
        typed = HELP[command].missing.get(name, "") if command else ""
        return UsageError(f"missing {name}", remedy=f"{f'try {typed}, or ' if typed else ''}see {path} --help")
    if kind == "NoSuchOption":
        known = [
            option for param in context.command.get_params(context) for option in (*param.opts, *param.secondary_opts)
        ]
        words_of_options = [option.removeprefix("--") for option in known if option.startswith("--")]
        near = nearest_name(error.option_name.lstrip("-"), words_of_options)
        came = f"unknown option {error.option_name}"
        return UsageError(came, remedy=f"did you mean --{near}?" if near else f"see {path} --help-all")
    message = " ".join(error.format_message().split()).rstrip(".")
    if found := re.search(r"Input should be (a valid \w+)", message):
        return UsageError(f"{name} needs {_NUMBERS.get(found[1], found[1])}")
    message = re.sub(r"^Option '(.*)' requires an argument$", r"\1 needs a value", message)
    message = re.sub(r"^Got unexpected extra argument\(s\) \((.*)\)$", r"unexpected argument \1", message)
    return UsageError(f"{message[:1].lower()}{message[1:]}", remedy=f"see {path} --help")


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
        say("rotorid: interrupted; complete files are kept, and no file is left half written")
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
