"""Functions as a program calls them: options are keywords, in signatures and in errors.

The library words its errors for the command line, which names options. :func:`for_python` makes of a function the one
that ``rotorid`` offers to programs: the signature of a verb names every option, and errors name keywords.
"""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import MISSING, Field, fields
from typing import Any, get_args

from rotorid.errors import RotoridError
from rotorid.settings.option import option_of
from rotorid.settings.verbs import OPTION, VERBS

_OTHERS: Mapping[str, str] = {"--map": "rotorid.read(..., mapping={})", "--model": "model={}", "--verify": "verify={}"}
"""Options that are arguments of functions, and no field of settings; the place of a text is marked."""

_ARGUMENTS: Mapping[str, str] = {"--set": "given", "--layout": "layout", "--like": "like", "--map": "mapping"}
"""Options that are arguments of some functions, by the names that they have there."""

_WITH_TEXT = rf"{OPTION.pattern}(?: [^\s;,-][^\s;,]*)?"
_COMMAND = rf"rotorid [a-z]+ [^;,]{{0,200}}?{_WITH_TEXT}(?: {_WITH_TEXT})*"
_TYPED = re.compile(
    rf"(?P<command>{_COMMAND})|(?P<option>{OPTION.pattern})"
    r"(?: (?P<value>[^\s;,)]*[:=\d][^\s;,).]*(?:\.[^\s;,).]+)*|[A-Z]{2,}(?:[.=:][^\s;,).]+)*|[a-z][a-z_.]*[a-z]))?"
)
"""A command with its options, which is one to type and stays as it is, or an option with its text.

A word in small letters is its text where it is one of its choices, or a name such as ``rate.roll``.
"""

_NUMBERS = re.compile(r"(--set) (\w+=\w+(?: \1 \w+=\w+)*)")
"""Numbers of a vehicle, one after the other."""

_NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e-?\d+)?")


def for_python(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function whose errors speak of keywords; of a verb, with a signature that names every option.

    Parameters
    ----------
    function
        Any; a verb takes ``**options``. What is no function comes back as it is.

    Examples
    --------
    >>> import rotorid
    >>> "band_rad_s" in inspect.signature(rotorid.identify).parameters
    True
    """
    if not inspect.isfunction(function):
        return function
    verb_settings = settings_of(function)
    kind = verb_settings or _settings_named(function, ("choices", "settings"))
    arguments_of = frozenset(inspect.signature(function).parameters)

    @functools.wraps(function)
    def verb(*arguments: Any, **options: Any) -> Any:
        try:
            return function(*arguments, **options)
        except RotoridError as error:
            _reword(error, kind, arguments_of)
            raise

    # A program that hands a verb to another process names it by the place where that finds it.
    verb.__module__, verb.__qualname__ = "rotorid", function.__name__
    if verb_settings is not None:
        verb.__signature__ = _signature(function, verb_settings)  # type: ignore[attr-defined]
    return verb


def settings_of(function: Callable[..., Any]) -> type[Any] | None:
    """The class of settings that a verb takes; ``None`` of a function that takes none."""
    if not inspect.isfunction(function):
        return None
    parameters = inspect.signature(function).parameters.values()
    if not any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters):
        return None
    named = _settings_named(function, ("settings",))
    return named or function.__globals__.get(f"{function.__name__.capitalize()}Settings")


def _settings_named(function: Callable[..., Any], names: tuple[str, ...]) -> type[Any] | None:
    """The class of an argument that holds settings."""
    parameters = inspect.signature(function).parameters
    annotation = next((str(parameters[name].annotation) for name in names if name in parameters), "")
    found: type[Any] | None = function.__globals__.get(annotation.partition(" ")[0])
    return found


def _signature(function: Callable[..., Any], kind: type[Any]) -> inspect.Signature:
    """The signature of a verb with a keyword for each field of its settings in place of ``**options``."""
    whole = inspect.signature(function)
    own = [parameter for parameter in whole.parameters.values() if parameter.kind is not parameter.VAR_KEYWORD]
    taken = {parameter.name for parameter in own}
    options = [
        inspect.Parameter(
            item.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=item.default_factory() if item.default_factory is not MISSING else item.default,
            annotation=get_args(item.type)[0] if hasattr(item.type, "__metadata__") else item.type,
        )
        for item in fields(kind)
        if item.name not in taken and item.init
    ]
    return whole.replace(parameters=[*own, *options])


def _reword(error: RotoridError, kind: type[Any] | None, arguments: frozenset[str]) -> None:
    """An error with keywords in place of options; what a command prints below it, a program finds in its findings."""

    def reworded(text: str) -> str:
        return in_keywords(text.replace("see below", "see the findings of this error for"), kind, arguments)

    for name in ("came", "needed", "remedy"):
        setattr(error, name, reworded(getattr(error, name)))
    error.args = (reworded(str(error)),)


def in_keywords(text: str, kind: type[Any] | None, arguments: Collection[str] = ()) -> str:
    """A text about options for a program that calls a verb; commands to type stay as they are.

    Parameters
    ----------
    text
        Words of an error.
    kind
        Settings of the function that was called, where it has any.
    arguments
        Names of its own arguments.

    Examples
    --------
    >>> from rotorid.settings.identifying import IdentifySettings
    >>> in_keywords("name the layout with --layout, or add --fix T_motor=0.05", IdentifySettings)
    'name the layout with layout, or add fix="T_motor=0.05"'
    >>> in_keywords("name its variables with a mapping: --map FILE.toml", IdentifySettings)
    'name its variables with a mapping: rotorid.read(..., mapping="FILE.toml")'
    >>> in_keywords("use --method prediction_error, or --method and --runs 5", IdentifySettings)
    'use method="prediction_error", or method and runs=5'
    >>> in_keywords("add --model rate.roll", IdentifySettings)
    'add model="rate.roll"'
    >>> in_keywords("try rotorid identify LOG --model rate.roll", IdentifySettings)
    'try rotorid identify LOG --model rate.roll'
    >>> in_keywords("mujoco needs m and arm; add --set m=KG --set arm=M", None, ["given"])
    'mujoco needs m and arm; add given={"m": KG, "arm": M}'
    """
    if "--" not in text:
        return text
    items = {option.name: item for item in fields(kind) if (option := option_of(item)) is not None} if kind else {}
    items |= {names[0]: item for name, item in items.items() if len(names := name.split("/")) > 1}

    def keyword(found: re.Match[str]) -> str:
        option, value = found["option"], found["value"]
        if found["command"]:
            return found[0]
        rest = ""
        if value and value.isalpha() and value.islower() and value not in _choices(items.get(option)) | {"all"}:
            value, rest = None, f" {value}"
        return _keyword(option, value, items, arguments) + rest

    if "--set" not in items and "given" in arguments:
        text = _NUMBERS.sub(_mapping, text)
    return _TYPED.sub(keyword, text)


def _keyword(option: str, value: str | None, items: Mapping[str, Field[Any]], arguments: Collection[str]) -> str:
    """One option with its text as a keyword; an option of another verb with its command."""
    shown = value if value and _NUMBER.fullmatch(value) else f'"{value}"' if value else ""
    if (argument := _ARGUMENTS.get(option)) in arguments and option not in items:
        return f"{argument}={shown}" if shown else str(argument)
    if option in _OTHERS:
        call = _OTHERS[option]
        if shown:
            return call.format(shown)
        return "mapping of rotorid.read" if "rotorid" in call else call.partition("=")[0]
    item = items.get(option) or items.get(option.replace("--no-", "--", 1))
    if item is None:
        verbs = VERBS.get(option, ())
        typed = f"{option} {value}" if value else option
        return f"{typed} (rotorid {verbs[0]})" if verbs else typed
    if option.startswith("--no-") and option not in items:
        return f"{item.name}=False"
    if item.default is False:
        return f"{item.name}=True"
    if (given := option_of(item)) is not None and given.gives is not None:
        shown = f'"{given.gives}"'
    return f"{item.name}={shown}" if shown else item.name


def _choices(item: Field[Any] | None) -> frozenset[str]:
    """Words that a field with a few of them may be."""
    if item is None:
        return frozenset()
    waiting, words = [item.type], set[str]()
    while waiting:
        one = waiting.pop()
        words |= {one} if isinstance(one, str) else set()
        waiting += get_args(one)
    return frozenset(words)


def _mapping(numbers: re.Match[str]) -> str:
    """Numbers as the dictionary that a function takes."""
    pairs = (pair.split("=") for pair in numbers[2].split(f" {numbers[1]} "))
    inside = ", ".join(f'"{name}": {value}' for name, value in pairs)
    return f"{_ARGUMENTS[numbers[1]]}={{{inside}}}"
