"""The face of a package: its public names, loaded when they are first used.

``__init__.pyi`` beside an ``__init__.py`` lists them, one import a line, for readers, type checkers and editors;
:func:`lazy` makes a package answer by that list (the pattern of Scientific Python's SPEC 1). So ``import rotorid``
loads nothing heavy, and a name is written down once.

Values also have places that a higher layer takes: ``record.plot`` belongs to the record and is drawn by the pictures,
which no value may import. The values say that there is a place (:func:`attached`); ``rotorid/__init__.py``, which sees
everything, says who takes it.
"""

from __future__ import annotations

import sys
from importlib import import_module

TYPE_CHECKING = False  # that of ``typing``, whose import would take longer than all of this
if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from typing import Any, TypeAlias

    Face: TypeAlias = tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]

_PLACES: dict[str, str] = {}


def lazy(package: str) -> Face:
    """``__getattr__``, ``__dir__`` and ``__all__`` of a package whose names its ``__init__.pyi`` lists.

    Parameters
    ----------
    package
        Its ``__name__``.

    Examples
    --------
    >>> import rotorid.spectral
    >>> "frequency_response" in dir(rotorid.spectral)
    True
    """
    module = sys.modules[package]
    homes = _listed(module)

    def load(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}", name=name, obj=module)
        home = homes[name]
        # A listed module is its own home, as a vehicle with its sources.
        value = import_module(f"{package}.{name}") if home == package else getattr(import_module(home), name)
        setattr(module, name, value)
        return value

    public = sorted(homes)
    return load, lambda: sorted({*public, *vars(module)}), public


def _listed(module: Any) -> dict[str, str]:
    """Name to home of every line ``from HOME import NAME as NAME`` of the stub."""
    stub = module.__spec__.loader.get_data(f"{module.__file__.removesuffix('c')}i").decode()
    lines = (line.split() for line in stub.splitlines() if line.startswith("from rotorid"))
    return {words[3]: words[1] for words in lines}


def attach(places: Mapping[str, str]) -> None:
    """Say who takes the places of values: class name to ``module:name`` of what is made of one of its values."""
    _PLACES.update(places)


def attached(value: Any) -> Any:
    """What takes the place of a value, made of it.

    Raises
    ------
    AttributeError
        Nothing takes it.
    """
    for kind in type(value).__mro__:
        if kind.__name__ in _PLACES:
            home, _, name = _PLACES[kind.__name__].partition(":")
            return getattr(import_module(home), name)(value)
    raise AttributeError(f"nothing is attached to {type(value).__name__}")
