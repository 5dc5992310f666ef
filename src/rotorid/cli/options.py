"""Options of commands: those of settings, made from their fields, and the few that several commands share.

A command is a function. Where one of its arguments is a class of settings, :func:`with_options` puts an option for
every field with an :class:`~rotorid.settings.settings.Option` in its place, and hands the command the settings.

Numbers may be given with a unit. Options with a short list of words are completed by the shell.
"""

import functools
import inspect
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any, ForwardRef, Literal, TypeAlias, get_args, get_origin

import typer

from rotorid.settings.settings import Option, option_of, parse_names
from rotorid.units import read_measure

UNITS_OF_NAMES = {"_rad_s": "rad/s", "_m_s": "m/s", "_kg": "kg", "_rad": "rad", "_m": "m", "_s": "s", "_v": "V"}
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


def measured(name: str, unit: str, help: str, *, heading: str | None = None) -> Any:
    """An option that is a number in a unit, or comes with another one of the same kind.

    Parameters
    ----------
    name, help, heading
        As of an :class:`~rotorid.settings.settings.Option`.
    unit
        Of the number that the command is given.
    """

    def number(text: Any) -> float:
        return read_measure(str(text), unit, came=f"{name} {str(text)!r} came")

    return typer.Option(name, help=help, parser=number, metavar=_CALLED[unit], rich_help_panel=heading)


def one_of(words: Iterable[str] | Callable[[], Iterable[str]]) -> Callable[[str], list[str]]:
    """What the shell completes a word to, the last one where several have commas between them.

    Parameters
    ----------
    words
        All that there are, or what lists them.

    Examples
    --------
    >>> one_of(["hann", "half_sine"])("ha"), one_of(["roll", "pitch"])("roll,p")
    (['hann', 'half_sine'], ['roll,pitch'])
    """

    def complete(incomplete: str) -> list[str]:
        done, comma, begun = incomplete.rpartition(",")
        known = words() if callable(words) else words
        return [f"{done}{comma}{word}" for word in known if word.startswith(begun)]

    return complete


def vehicle_names() -> Iterable[str]:
    """Vehicles of the library."""
    from rotorid.vehicles.catalog import VEHICLES

    return VEHICLES


def models_known() -> Iterable[str]:
    """Models of the library that need no more than their name."""
    from rotorid.models.families import known_names
    from rotorid.settings.settings import ALL

    return (*known_names(), ALL)


Logs: TypeAlias = Annotated[
    list[Path],
    typer.Argument(
        help="Flight logs: PX4, ArduPilot, Betaflight, Crazyflie, ROS, .mat, .csv and more; also compressed."
    ),
]
Log: TypeAlias = Annotated[
    Path, typer.Argument(help="A flight log: PX4, ArduPilot, Betaflight, Crazyflie, ROS, .mat, .csv and more.")
]
Map: TypeAlias = Annotated[
    Path | None,
    typer.Option("--map", help="TOML file that names the channels of any other source.", rich_help_panel="Data"),
]
AgainstPlan: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--plan",
        metavar="PLAN.json",
        help="Compare the log with a plan of rotorid design: its firmware, and what was flown.",
        rich_help_panel="Data",
    ),
]
Json: TypeAlias = Annotated[bool, typer.Option("--json", help="Print the answer as JSON and nothing else.")]


@dataclass(frozen=True, kw_only=True)
class Output:
    """Where the results of a command go, and what it says.

    Parameters
    ----------
    out
        Folder for the files.
    json, quiet
        Print the result as JSON; print nothing.
    force
        Overwrite what is not rotorid's.
    """

    out: Annotated[
        Path | None, Option("--out", heading="Results", help="Folder for the results. [default: rotorid-out/NAME]")
    ] = None
    json: Annotated[bool, Option("--json", heading="Results", help="Print the result as JSON and nothing else.")] = (
        False
    )
    quiet: Annotated[bool, Option("--quiet", heading="Results", help="Say nothing but errors.")] = False
    force: Annotated[
        bool, Option("--force", heading="Results", help="Overwrite files at --out that are not rotorid's.")
    ] = False


def _format(text: str) -> str:
    from rotorid.plot.printed import require_format

    return require_format(text)


def _formats(text: str) -> tuple[str, ...]:
    from rotorid.report.tables import require_formats

    return require_formats(part.strip() for part in text.split(","))


@dataclass(frozen=True, kw_only=True)
class ForPaper:
    """What is written beside the report for a paper.

    Parameters
    ----------
    figures
        Kind of file of every picture; ``None`` writes none.
    tables
        Kinds of file of every table.
    pdf
        Print the pages, too.
    """

    figures: Annotated[
        Any,
        Option(
            "--figures",
            heading="Results",
            words=("svg", "pdf", "png"),
            help="Write every picture too, into figures.",
            parse=_format,
        ),
    ] = None
    tables: Annotated[
        Any,
        Option(
            "--tables",
            heading="Results",
            metavar="csv|tex|csv,tex",
            words=("csv", "tex"),
            help="Write every table too, into tables.",
            parse=_formats,
        ),
    ] = ()
    pdf: Annotated[
        bool,
        Option(
            "--pdf", heading="Results", help="Print the page as PDF too, by Chromium, Chrome or Edge on this machine."
        ),
    ] = False


class Only:
    """Beside a class of settings in ``Annotated``: the fields of it that a command has."""

    def __init__(self, *names: str) -> None:
        self.names = names


def with_options(command: Callable[..., None]) -> Callable[..., None]:
    """A command whose arguments that are settings are options on the command line.

    ``argument: Settings`` is given an instance; ``argument: Annotated[dict[str, Any], Settings]`` the fields that make
    one, for a class that needs more than options say. An option that was not given is left to the default of its field.

    Parameters
    ----------
    command
        The function behind a command.
    """
    parameters: list[inspect.Parameter] = []
    groups: dict[str, tuple[Callable[..., Any], Mapping[str, Option]]] = {}
    for parameter in inspect.signature(command, eval_str=True).parameters.values():
        kind, whole, only = _settings(parameter.annotation)
        if kind is None:
            parameters.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY))
            continue
        options = {item.name: option for item in fields(kind) if (option := option_of(item)) is not None}
        if only:
            options = {name: options[name] for name in only}
        parameters += [_parameter(item, options[item.name]) for item in fields(kind) if item.name in options]
        groups[parameter.name] = kind if whole else dict, options

    @functools.wraps(command)
    def run(**given: Any) -> None:
        for name, (make, options) in groups.items():
            read = {field: given.pop(field) for field in options}
            given[name] = make(**_parsed(read, options))
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


def _parameter(item: "Field[Any]", option: Option) -> inspect.Parameter:
    """What the command line reads for a field."""
    required = item.default is MISSING and item.default_factory is MISSING
    default = item.default if item.default is not MISSING and option.parse is None else None
    if option.parse is not None:
        default = option.default or (item.default if isinstance(item.default, str) else None)
    return inspect.Parameter(
        item.name,
        inspect.Parameter.KEYWORD_ONLY,
        default=inspect.Parameter.empty if required else default,
        annotation=Annotated[_read_as(item, option), _declared(item, option)],
    )


def _declared(item: "Field[Any]", option: Option) -> Any:
    """The option as Typer knows it."""
    if option.parse is None and (unit := _unit(item)) is not None:
        return measured(option.name, unit, option.help, heading=option.heading)
    words = option.words or _words(item)
    called = option.metavar or "|".join(words) or ("NAME,..." if option.parse is parse_names else None)
    return typer.Option(
        option.name,
        help=option.help,
        metavar=called,
        rich_help_panel=option.heading,
        autocompletion=one_of(words) if words else None,
    )


def _words(item: "Field[Any]") -> tuple[str, ...]:
    """The few words that a field takes by its type."""
    kind = get_args(item.type)[0]
    kind = next((part for part in get_args(kind) if get_origin(part) is Literal), kind)
    return tuple(map(str, get_args(kind))) if get_origin(kind) is Literal else ()


def _unit(item: "Field[Any]") -> str | None:
    """The SI unit of a number, which the name of its field ends with."""
    if get_args(item.type)[0] not in (float, float | None):
        return None
    return next((si for end, si in UNITS_OF_NAMES.items() if item.name.endswith(end)), None)


def _read_as(item: "Field[Any]", option: Option) -> Any:
    """The type by which the command line reads a text; one of a few words is text, which the settings check."""
    if option.repeats:
        return list[str] | None
    kind = get_args(item.type)[0]
    if option.parse is None and get_origin(kind) is not Literal and not isinstance(kind, ForwardRef):
        return kind
    return str | None


def _parsed(read: Mapping[str, Any], options: Mapping[str, Option]) -> dict[str, Any]:
    """Fields by what the command line read; what was not given is left to the default of its field."""
    values = {}
    for name, value in read.items():
        parse = options[name].parse
        if parse is None:
            values[name] = value
        elif value:
            values[name] = parse(value)
    return values
