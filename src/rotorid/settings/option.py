"""What a choice is: a field of settings with its default, its check, its option, and how a provenance holds it.

A verb takes its choices whole (``settings=``), or one by one as keywords (:func:`as_settings`). An :class:`Option` on
a field makes an option of the command line of it, and :meth:`Settings.as_json` the settings of a result. Nothing here
is heavy: ``rotorid --help`` reads it.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, replace
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias, TypeVar, get_args, get_origin

from rotorid.data.base import Immutable
from rotorid.errors import UsageError, nearest_name, unknown_name

if TYPE_CHECKING:
    from dataclasses import Field

    from _typeshed import DataclassInstance

Kind = TypeVar("Kind", bound=Immutable)
Setting: TypeAlias = str | int | float | bool | list[str] | list[float] | None
"""A choice as a provenance holds it."""


@dataclass(frozen=True)
class Text:
    """How a choice is written as text.

    Parameters
    ----------
    form
        What ``--help`` calls it; empty where words that the option lists say more.
    parse
        Makes the value out of the text, or out of all texts where there may be several.
    repeats
        Whether there may be several.
    write
        What a provenance holds of the value; by default the value itself, of a mapping ``NAME=VALUE``.
    """

    form: str
    parse: Callable[[Any], Any]
    repeats: bool = False
    write: "Callable[[Any], Setting] | None" = None


@dataclass(frozen=True)
class Option:
    """How a field is written on the command line, in the metadata of its ``Annotated`` type.

    Parameters
    ----------
    name
        Such as ``--band``.
    help
        A line for ``--help``.
    heading
        Where ``--help`` lists it.
    text
        How it is written; without it the command line reads what the type of the field says.
    metavar
        What ``--help`` calls the text, where the form of the text does not say.
    words
        What the shell completes, or what lists it, where the type does not list all that there is.
    default
        Text that stands where nothing is given, for fields whose own default is no text.
    also
        A second name.
    gives
        What a flag without a text gives, where the field is no yes or no.
    hidden_default
        Whether ``--help`` leaves out the default: it holds where another option is given.
    within
        Least and greatest of a whole number.
    variable
        Of the environment, that is taken where the option is not given.
    """

    name: str
    help: str
    heading: str | None = None
    text: Text | None = None
    metavar: str | None = None
    words: tuple[str, ...] | Callable[[], Iterable[str]] = ()
    default: str | None = None
    also: str | None = None
    gives: str | None = None
    hidden_default: bool = False
    within: tuple[int, int] | None = None
    variable: str | None = None


@dataclass(frozen=True)
class Written:
    """Whether a provenance holds a field, in the metadata of its ``Annotated`` type; an option alone is always held.

    Parameters
    ----------
    when
        ``given`` holds it only where it differs from its default: most runs know nothing of it.
    write
        What is held of the value, for fields without an option.
    """

    when: Literal["always", "given", "never"] = "always"
    write: Callable[[Any], Setting] | None = None


Seed: TypeAlias = Annotated[int, Option("--seed", "Random seed."), Written("never")]
"""A provenance holds it by itself."""


class Settings(Immutable):
    """Choices of a run; its dataclass says which."""

    seed: int

    def as_json(self) -> dict[str, Setting]:
        """The choices for the provenance of a result, what only some runs know of at the end."""
        always: dict[str, Setting] = {}
        given: dict[str, Setting] = {}
        for item in fields(self):  # type: ignore[arg-type]
            option, value = option_of(item), getattr(self, item.name)
            written = _metadata(item, Written) or Written("never" if option is None else "always")
            write = written.write or (option.text.write if option is not None and option.text is not None else None)
            if written.when == "always":
                always[item.name] = (write or _fixed)(value)
            elif written.when == "given" and value != _default(item):
                given[item.name] = (write or _fixed)(value)
        return always | given


def require_words(settings: "DataclassInstance") -> None:
    """Raise for a word that the type of its field does not list.

    Raises
    ------
    UsageError
        A field has another one.
    """
    for item in fields(settings):
        known, value = words_of(item), getattr(settings, item.name)
        if known and value not in (*known, _default(item)):
            raise unknown_name(item.name.replace("_", " "), str(value), known)


def _fixed(value: Any) -> Setting:
    """A value with all its digits, so that the text gives the same run again."""
    if isinstance(value, Mapping):
        return [f"{name}={item if isinstance(item, str) else repr(float(item))}" for name, item in value.items()]
    return list(value) if isinstance(value, tuple) else value


def _metadata(item: "Field[Any]", kind: type[Any]) -> Any:
    return next((part for part in getattr(item.type, "__metadata__", ()) if isinstance(part, kind)), None)


def _default(item: "Field[Any]") -> Any:
    return item.default if item.default_factory is MISSING else item.default_factory()


def option_of(item: "Field[Any]") -> Option | None:
    """How a field of settings is written on the command line; ``None`` where it is not."""
    found: Option | None = _metadata(item, Option)
    return found


def words_of(item: "Field[Any]") -> tuple[str, ...]:
    """The few words that a field takes by its type."""
    kind = next(iter(get_args(item.type)), None) if option_of(item) is not None else item.type
    kind = next((part for part in get_args(kind) if get_origin(part) is Literal), kind)
    return tuple(map(str, get_args(kind))) if get_origin(kind) is Literal else ()


def options_given(settings: "DataclassInstance") -> dict[str, str]:
    """Fields that differ from their defaults, with the options that set them.

    Examples
    --------
    >>> from rotorid.settings.identifying import IdentifySettings
    >>> options_given(IdentifySettings(reduce=True, arm_m=0.2))
    {'reduce': '--reduce', 'arm_m': '--arm'}
    """
    return changed_options(type(settings), {item.name: getattr(settings, item.name) for item in fields(settings)})


def changed_options(kind: "type[DataclassInstance]", values: Mapping[str, Any]) -> dict[str, str]:
    """Fields whose values differ from their defaults, with the options that set them."""
    changed = [item for item in fields(kind) if item.name in values and values[item.name] != _default(item)]
    return {item.name: option.name if (option := option_of(item)) is not None else item.name for item in changed}


def options_of(settings: "type[DataclassInstance]", names: Sequence[str]) -> tuple[str, ...]:
    """The options of some fields.

    Examples
    --------
    >>> from rotorid.settings.identifying import IdentifySettings
    >>> options_of(IdentifySettings, ("fix", "arm_m"))
    ('--fix', '--arm')
    """
    found = {item.name: option.name for item in fields(settings) if (option := option_of(item)) is not None}
    return tuple(found[name] for name in names if name in found)


def as_settings(kind: type[Kind], settings: Kind | None, options: Mapping[str, Any]) -> Kind:
    """Choices of a verb, given whole, one by one, or both; one by one goes before.

    Parameters
    ----------
    kind
        Their class.
    settings
        All of them; by default those of the class.
    options
        Fields by name; a value may also be the text of the command line, such as ``band_rad_s="0.3:8Hz"``.

    Raises
    ------
    TypeError
        There is no such field; the error suggests the nearest name.
    UsageError
        A value cannot be.

    Examples
    --------
    >>> from rotorid.settings.measuring import ResponseSettings
    >>> as_settings(ResponseSettings, None, {"band_rad_s": (1.0, 60.0)}).band_rad_s
    (1.0, 60.0)
    >>> as_settings(ResponseSettings, None, {"band_rad_s": "1:60"}).band_rad_s
    (1.0, 60.0)
    """
    known = {item.name: item for item in fields(kind)}  # type: ignore[arg-type]
    for name in options:
        if name not in known:
            near = nearest_name(name, known)
            raise TypeError(f"unknown option {name!r}{f'; did you mean {near}?' if near else ''}")
    given = {name: _from_text(known[name], value) for name, value in options.items()}
    if settings is None:
        return kind(**given)
    return replace(settings, **given) if given else settings  # type: ignore[type-var]


def _from_text(item: "Field[Any]", value: Any) -> Any:
    """A value of a keyword; a text of the command line is read as there.

    Raises
    ------
    UsageError
        It cannot be a value of the field.
    """
    option = option_of(item)
    if option is not None and option.text is not None:
        texts = [value] if isinstance(value, str) else value
        if isinstance(value, str) and not option.text.repeats:
            return option.text.parse(value)
        if option.text.repeats and isinstance(texts, list | tuple) and texts and all(map(_is_text, texts)):
            return option.text.parse(list(texts))
    if item.default_factory is dict and not isinstance(value, Mapping):
        form = f", or a text such as {option.text.form!r}" if option is not None and option.text is not None else ""
        raise UsageError(f"{item.name}={value!r} cannot be read", needed=f"a mapping of names{form}")
    if isinstance(value, str) and _numeric(item):
        raise UsageError(f"{item.name}={value!r} is a text", needed="a number")
    if isinstance(value, Mapping) and get_args(_kind(item))[1:] == (float,):
        for name, number in value.items():
            if isinstance(number, str):
                raise UsageError(f"{item.name} of {name} is the text {number!r}", needed="a number")
    return value


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _numeric(item: "Field[Any]") -> bool:
    """Whether a field takes numbers alone, or yes and no."""
    kind = _kind(item)
    return {*(get_args(kind) or (kind,))} <= {float, int, bool, type(None)}


def _kind(item: "Field[Any]") -> Any:
    """The type of a field without what its annotation adds."""
    return getattr(item.type, "__origin__", item.type) if hasattr(item.type, "__metadata__") else item.type


def as_names(names: str | Iterable[str]) -> tuple[str, ...]:
    """Names of channels or parameters; a single one may come without a list around it.

    Examples
    --------
    >>> as_names("roll_command"), as_names(["p", "ay"])
    (('roll_command',), ('p', 'ay'))
    """
    return (names,) if isinstance(names, str) else tuple(names)


MOST_WORKERS = 1024


def require_workers(workers: int | None) -> None:
    """Raise for a number of processes that cannot be.

    Raises
    ------
    UsageError
        There are none, or too many.
    """
    if workers is not None and not 1 <= workers <= MOST_WORKERS:
        raise UsageError(f"--workers {workers} is out of range", needed=f"1 to {MOST_WORKERS}")


def require_seed(seed: int) -> None:
    """Raise for a seed that no generator takes.

    Raises
    ------
    UsageError
        It is negative.
    """
    if seed < 0:
        raise UsageError(f"the seed {seed} is negative", needed="0 or a positive whole number")
