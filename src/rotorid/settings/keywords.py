"""Verbs as a program calls them: options are keywords, in signatures and in errors.

The library words its errors for the command line, which names options. :func:`for_python` makes of a verb the function
that ``rotorid`` offers to programs: its signature names every option, and its errors name keywords.
"""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, fields
from typing import Any, get_args

from rotorid.errors import RotoridError
from rotorid.settings.option import option_of
from rotorid.settings.verbs import OPTION, VERBS

_OTHERS: Mapping[str, str] = {"--map": "rotorid.read(..., mapping={})", "--model": "model={}", "--verify": "verify={}"}
"""Options that are arguments of functions, and no field of settings; the place of a text is marked."""

_TYPED = re.compile(
    rf"(?P<command>rotorid [a-z]+ [^;,]{{0,200}}?)?(?P<option>{OPTION.pattern})"
    r"(?: (?P<value>[^\s;,)]*[:=\d][^\s;,).]*(?:\.[^\s;,).]+)*|[A-Z]{2,}(?:[.=:][^\s;,).]+)*|[a-z][a-z_.]*[a-z]))?"
)
"""An option with its text, and the command before it, which then is one to type and stays as it is.

A word in small letters is its text where it is one of its choices, or a name such as ``rate.roll``.
"""


_NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e-?\d+)?")


def for_python(function: Callable[..., Any]) -> Callable[..., Any]:
    """A verb with a signature that names every option, whose errors speak of keywords.

    Parameters
    ----------
    function
        One that takes ``settings`` or ``**options``; others come back as they are.

    Examples
    --------
    >>> import rotorid
    >>> "band_rad_s" in inspect.signature(rotorid.identify).parameters
    True
    """
    kind = settings_of(function)
    if kind is None:
        return function

    @functools.wraps(function)
    def verb(*arguments: Any, **options: Any) -> Any:
        try:
            return function(*arguments, **options)
        except RotoridError as error:
            _reword(error, kind)
            raise

    # A program that hands a verb to another process names it by the place where that finds it.
    verb.__module__, verb.__qualname__ = "rotorid", function.__name__
    verb.__signature__ = _signature(function, kind)  # type: ignore[attr-defined]
    return verb


def settings_of(function: Callable[..., Any]) -> type[Any] | None:
    """The class of settings that a verb takes; ``None`` of a function that takes none."""
    if not inspect.isfunction(function):
        return None
    parameters = inspect.signature(function).parameters.values()
    if not any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters):
        return None
    named = next((str(parameter.annotation) for parameter in parameters if parameter.name == "settings"), "")
    name = named.partition(" ")[0] or f"{function.__name__.capitalize()}Settings"
    found: type[Any] | None = function.__globals__.get(name)
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


def _reword(error: RotoridError, kind: type[Any]) -> None:
    """An error with keywords in place of options."""
    for name in ("came", "needed", "remedy"):
        setattr(error, name, in_keywords(getattr(error, name), kind))
    error.args = (in_keywords(str(error), kind),)


def in_keywords(text: str, kind: type[Any]) -> str:
    """A text about options for a program that calls a verb; commands to type stay as they are.

    Parameters
    ----------
    text
        Words of an error.
    kind
        Settings of the verb that was called.

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
    """
    if "--" not in text:
        return text
    items = {option.name: item for item in fields(kind) if (option := option_of(item)) is not None}
    items |= {names[0]: item for name, item in items.items() if len(names := name.split("/")) > 1}

    def keyword(found: re.Match[str]) -> str:
        option, value = found["option"], found["value"]
        if found["command"]:
            return found[0]
        rest = ""
        if value and value.isalpha() and value.islower() and value not in _choices(items.get(option)) | {"all"}:
            value, rest = None, f" {value}"
        return _keyword(option, value, items) + rest

    return _TYPED.sub(keyword, text)


def _keyword(option: str, value: str | None, items: Mapping[str, Field[Any]]) -> str:
    """One option with its text as a keyword; an option of another verb with its command."""
    shown = value if value and _NUMBER.fullmatch(value) else f'"{value}"' if value else ""
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
