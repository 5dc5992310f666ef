"""Base of the value objects: arrays are copied in, read-only, and still so after pickling."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from functools import wraps
from importlib import import_module
from inspect import signature
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar
from weakref import WeakKeyDictionary

from rotorid._faces import attached
from rotorid.data.display import counted, dataclass_text
from rotorid.errors import UsageError

if TYPE_CHECKING:
    from numpy.typing import NDArray

Value = TypeVar("Value")
Parameters = ParamSpec("Parameters")


def read_only(values: Any, dtype: type[Any], *, ndim: int) -> NDArray[Any]:
    """A private, read-only copy of ``values`` with the given type and number of dimensions."""
    # Settings are values too, and the command line reads them for its help: it has no use for NumPy.
    import numpy as np

    array = np.array(values, dtype=dtype, copy=True)
    if array.ndim != ndim:
        raise ValueError(f"an array with {counted(ndim, 'dimension')} is required, not shape {array.shape}")
    array.setflags(write=False)
    return array


class Immutable:
    """Mixin of the frozen dataclasses: they pickle through their constructor, so that arrays stay read-only.

    Plain pickling restores the fields one by one, which silently hands back writable arrays. Their ``repr`` shows long
    arrays by their size.
    """

    def __init_subclass__(cls, **keywords: Any) -> None:
        super().__init_subclass__(**keywords)
        # ``dataclass`` writes a repr of every number, unless the class has its own.
        if "__repr__" not in vars(cls):
            cls.__repr__ = cls.__repr__  # type: ignore[method-assign]

    def __repr__(self) -> str:
        return dataclass_text(self)

    def __reduce__(self) -> tuple[Any, ...]:
        assert is_dataclass(self)
        state = {field.name: getattr(self, field.name) for field in fields(self) if field.init}
        plain = {name: dict(value) if isinstance(value, Mapping) else value for name, value in state.items()}
        return _rebuild, (type(self), plain)

    def _set(self, **values: Any) -> None:
        """Normalize fields inside ``__post_init__`` of a frozen dataclass."""
        for name, value in values.items():
            object.__setattr__(self, name, MappingProxyType(dict(value)) if isinstance(value, Mapping) else value)


class ShownByDocument:
    """Mixin of results that show themselves as the document that a command writes of them does."""

    def __repr__(self) -> str:
        return repr(attached(self))

    def _repr_html_(self) -> str:
        html: str = attached(self)._repr_html_()
        return html


def _rebuild(kind: type[Value], state: Mapping[str, Any]) -> Value:
    return kind(**state)


def cached_by_value(function: Callable[Parameters, Value]) -> Callable[Parameters, Value]:
    """Keep what a function of a value answers for as long as the value lives: values do not change.

    The first argument is the value; the others have to be hashable. A default that is named asks for the same again.
    Errors are not kept.

    Examples
    --------
    >>> asked = []
    >>> class Log(Immutable):
    ...     pass
    >>> @cached_by_value
    ... def length(log, unit="s"):
    ...     asked.append(unit)
    ...     return 10.0
    >>> log = Log()
    >>> length(log), length(log), length(log, unit="s"), asked
    (10.0, 10.0, 10.0, ['s'])
    """
    kept: WeakKeyDictionary[Any, dict[Any, Value]] = WeakKeyDictionary()
    usual = {choice.name: choice.default for choice in signature(function).parameters.values()}.items()

    @wraps(function)
    def answer(*arguments: Parameters.args, **named: Parameters.kwargs) -> Value:
        if not arguments:
            # The value was given by name, or is missing, which the function reports better.
            return function(*arguments, **named)
        value, *others = arguments
        answers = kept.setdefault(value, {})
        key = (*others, *sorted(item for item in named.items() if item not in usual))
        if key not in answers:
            answers[key] = function(*arguments, **named)
        return answers[key]

    return answer


def optional(package: str) -> Any:
    """An optional package, or an error that says how to install it.

    Raises
    ------
    UsageError
        It is not installed.

    Examples
    --------
    >>> optional("no_such_package")
    Traceback (most recent call last):
    ...
    rotorid.errors.UsageError: no_such_package is not installed; pip install no_such_package.
    """
    try:
        return import_module(package)
    except ImportError as error:
        raise UsageError(f"{package} is not installed", remedy=f"pip install {package}") from error
