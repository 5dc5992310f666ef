"""Options of commands, made of the fields of settings, and the few that several commands share.

A command is a function. Where one of its arguments is a class of settings, :func:`with_options` puts an option for
every field with an :class:`~rotorid.settings.option.Option` in its place, and hands the command the settings; an
argument with an option of its own is made in the same way.

Numbers may be given with a unit. Options with a short list of words are completed by the shell.
"""

import functools
import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ForwardRef, Literal, TypeAlias, get_args, get_origin

import typer

from rotorid.settings.option import Option, Text, option_of, words_of
from rotorid.units import read_measure

UNITS_OF_NAMES = {
    "_rad_s": "rad/s",
    "_m_s": "m/s",
    "_hz": "Hz",
    "_kg": "kg",
    "_rad": "rad",
    "_m": "m",
    "_s": "s",
    "_v": "V",
}
"""The SI unit of a field by how its name ends; numbers of such fields may come with another unit of the same kind."""

_CALLED = {
    "rad/s": "RAD/S",
    "m/s": "M/S",
    "kg": "KG",
    "rad": "RAD",
    "m": "METERS",
    "s": "SECONDS",
    "V": "VOLTS",
    "Hz": "HZ",
}


def complete_from(words: Iterable[str] | Callable[[], Iterable[str]]) -> Callable[[str], list[str]]:
    """What the shell completes a word to, the last one where several have commas between them.

    Parameters
    ----------
    words
        All that there are, or what lists them.

    Examples
    --------
    >>> complete_from(["hann", "half_sine"])("ha"), complete_from(["roll", "pitch"])("roll,p")
    (['hann', 'half_sine'], ['roll,pitch'])
    """

    def complete(incomplete: str) -> list[str]:
        done, comma, partial = incomplete.rpartition(",")
        known = words() if callable(words) else words
        return [f"{done}{comma}{word}" for word in known if word.startswith(partial)]

    return complete


_LOG_HELP = "PX4, ArduPilot, Betaflight, Crazyflie, ROS, .mat, .csv and more; may be compressed."

Logs: TypeAlias = Annotated[list[Path], typer.Argument(metavar="LOG...", help=f"Flight logs: {_LOG_HELP}")]
Log: TypeAlias = Annotated[Path, typer.Argument(metavar="LOG", help=f"A flight log: {_LOG_HELP}")]
Map: TypeAlias = Annotated[Path | None, Option("--map", "TOML file that names the channels of another source.", "Data")]
AgainstPlan: TypeAlias = Annotated[
    Path | None,
    Option(
        "--plan",
        "Compare the log with a plan of rotorid design.",
        "Data",
        metavar="PLAN.json",
    ),
]
Json: TypeAlias = Annotated[bool, Option("--json", "Print only the answer, as JSON.")]
VERBOSE_HELP = "Print everything. [default: at most 40 lines]"
Verbose: TypeAlias = Annotated[bool, Option("--verbose", VERBOSE_HELP, also="-v")]


@dataclass(frozen=True, kw_only=True)
class Output:
    """Where the results of a command go, and how much it prints.

    Parameters
    ----------
    verbose
        Print every row and every finding, instead of the first few.
    force
        Overwrite what is not rotorid's.
    """

    out: Annotated[Path | None, Option("--out", "Folder for the results. [default: rotorid-out/NAME]", "Results")] = (
        None
    )
    json: Annotated[bool, Option("--json", "Print only the result, as JSON.", "Results")] = False
    quiet: Annotated[bool, Option("--quiet", "Print errors only.", "Results")] = False
    verbose: Annotated[bool, Option("--verbose", VERBOSE_HELP, "Results", also="-v")] = False
    force: Annotated[bool, Option("--force", "Overwrite other files in --out.", "Results")] = False


def _format(text: str) -> str:
    from rotorid.plot.printed import require_format

    return require_format(text)


def _formats(text: str) -> tuple[str, ...]:
    from rotorid.report.tables import require_formats

    return require_formats(part.strip() for part in text.split(","))


@dataclass(frozen=True, kw_only=True)
class ForPaper:
    """Figures and tables for a paper.

    Parameters
    ----------
    figures
        Kind of file of every picture; ``None`` writes none.
    tables
        Kinds of file of every table.
    """

    figures: Annotated[
        Any,
        Option(
            "--figures",
            "Also write every figure, into figures/.",
            "Results",
            Text("", _format),
            words=("svg", "pdf", "png"),
        ),
    ] = None
    tables: Annotated[
        Any,
        Option(
            "--tables",
            "Also write every table, into tables/.",
            "Results",
            Text("csv|tex|csv,tex", _formats),
            words=("csv", "tex"),
        ),
    ] = ()
    pdf: Annotated[
        bool,
        Option("--pdf", "Also print the page as PDF (needs Chromium, Chrome or Edge).", "Results"),
    ] = False


class Only:
    """Names the fields of a class of settings that a command has, in ``Annotated``."""

    def __init__(self, *names: str) -> None:
        self.names = names


def with_options(command: Callable[..., None]) -> Callable[..., None]:
    """A command whose arguments that are settings are options on the command line.

    ``argument: Settings`` is given an instance; ``argument: Annotated[dict[str, Any], Settings]`` the fields that make
    one, for a class that needs more than options say. An option that was not given is left to the default of its field.
    ``argument: Annotated[type, Option(...)]`` is an option by itself.

    Parameters
    ----------
    command
        The function behind a command.
    """
    parameters: list[inspect.Parameter] = []
    read: dict[str, tuple[Callable[..., Any], Sequence[Field[Any]]]] = {}
    for parameter in inspect.signature(command, eval_str=True).parameters.values():
        kind, whole, only = _settings(parameter.annotation)
        if kind is not None:
            items = [field for field in fields(kind) if option_of(field) and (not only or field.name in only)]
            read[parameter.name] = kind if whole else dict, items
        elif option_of(item := _field(parameter)) is not None:
            items = [item]
            read[parameter.name] = partial(_alone, item), items
        else:
            items = []
            parameters.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY))
        parameters += map(_parameter, items)

    @functools.wraps(command)
    def run(**given: Any) -> None:
        for name, (make, items) in read.items():
            given[name] = make(**_parsed({item: given.pop(item.name) for item in items}))
        command(**given)

    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return run


def _settings(annotation: Any) -> tuple[type[Any] | None, bool, tuple[str, ...]]:
    """The class of settings that an annotation names, whether an instance is wanted, and the only fields wanted."""
    parts = get_args(annotation) if get_origin(annotation) is Annotated else (annotation,)
    kind = next((part for part in parts if inspect.isclass(part) and is_dataclass(part)), None)
    only = next((part.names for part in parts if isinstance(part, Only)), ())
    return kind, kind is parts[0], only


def _field(parameter: inspect.Parameter) -> "Field[Any]":
    """An argument of a command as a field of settings is."""
    item: Field[Any] = field(default=MISSING if parameter.default is parameter.empty else parameter.default)
    item.name, item.type = parameter.name, parameter.annotation
    return item


def _alone(item: "Field[Any]", **read: Any) -> Any:
    """The value of an argument that is an option by itself."""
    return read.get(item.name, item.default)


def _parameter(item: "Field[Any]") -> inspect.Parameter:
    """What the command line reads for a field."""
    option = option_of(item)
    assert option is not None
    required = item.default is MISSING and item.default_factory is MISSING
    return inspect.Parameter(
        item.name,
        inspect.Parameter.KEYWORD_ONLY,
        default=inspect.Parameter.empty if required else _shown_default(item, option),
        annotation=Annotated[_read_as(item, option, required=required), _declared(item, option)],
    )


def _shown_default(item: "Field[Any]", option: Option) -> Any:
    """What the command line reads where nothing is given, and its help shows."""
    if option.gives is not None:
        return False
    if option.text is not None:
        return option.default or (item.default if isinstance(item.default, str) else None)
    return None if option.hidden_default or item.default is MISSING else item.default


def _declared(item: "Field[Any]", option: Option) -> Any:
    """The option as Typer knows it."""
    names = (option.name,) if option.also is None else (option.name, option.also)
    shown: dict[str, Any] = {"help": option.help, "rich_help_panel": option.heading, "envvar": option.variable}
    if option.text is None and (unit := _unit(item)) is not None:

        def number(text: Any) -> float:
            return read_measure(str(text), unit, came=f"{option.name} {str(text)!r} cannot be read")

        return typer.Option(*names, parser=number, metavar=option.metavar or _CALLED[unit], **shown)
    words = option.words or (words_of(item) if option.gives is None else ())
    listed = "" if callable(words) else "|".join(words)
    least, most = option.within or (None, None)
    return typer.Option(
        *names,
        metavar=option.metavar or (option.text.form if option.text is not None else None) or listed or None,
        autocompletion=complete_from(words) if words else None,
        min=least,
        max=most,
        **shown,
    )


def _unit(item: "Field[Any]") -> str | None:
    """The SI unit of a number, which the name of its field ends with."""
    if get_args(item.type)[0] not in (float, float | None):
        return None
    return next((si for end, si in UNITS_OF_NAMES.items() if item.name.endswith(end)), None)


def _read_as(item: "Field[Any]", option: Option, *, required: bool) -> Any:
    """The type by which the command line reads a text; one of a few words is text, which the settings check."""
    kind = get_args(item.type)[0]
    if option.gives is not None:
        return bool
    if option.text is None and get_origin(kind) is not Literal and not isinstance(kind, ForwardRef):
        return kind | None if option.hidden_default else kind
    read = list[str] if option.text is not None and option.text.repeats else str
    return read if required else read | None


def _parsed(read: "Mapping[Field[Any], Any]") -> dict[str, Any]:
    """Fields by what the command line read; what was not given is left to the default of its field."""
    values = {}
    for item, text in read.items():
        option = option_of(item)
        assert option is not None
        if (value := _value(text, option)) is not MISSING:
            values[item.name] = value
    return values


def _value(read: Any, option: Option) -> Any:
    """The value of what the command line read; ``MISSING`` where nothing was given."""
    if option.gives is not None:
        return option.gives if read else MISSING
    if option.text is not None:
        return option.text.parse(read) if read else MISSING
    return MISSING if option.hidden_default and read is None else read
