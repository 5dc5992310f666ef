"""The face of a package: its public names, loaded when they are first used.

``__init__.pyi`` beside an ``__init__.py`` lists them, one import a line, for readers, type checkers and editors;
:func:`lazy` makes a package answer by that list (the pattern of Scientific Python's SPEC 1). So ``import rotorid``
loads nothing heavy, and a name is written down once.

A name that will be removed keeps its line for a release, below a comment that says so; a class under a new name keeps
the old one as an alias. Type checkers go on finding both, ``__all__``, ``dir`` and the documentation no longer show
them, and whoever takes one gets a :class:`DeprecationWarning` with the words of the comment::

    from rotorid.data.record import FlightRecord as FlightRecord

    # deprecated, removed in 0.3: use rotorid.resample
    from rotorid.signal.clock import resample as resample

    # deprecated, removed in 0.3
    from rotorid.signal.quality import battery_sag as battery_sag

    # deprecated, removed in 0.3: use rotorid.FlightRecord
    Log = FlightRecord

The release is the one after the next. A test looks for each replacement on the faces, and fails at that release until
the line is gone. A face of which everything goes says so once, ``lazy(__name__, removed_in="0.3")``: its lines name the
faces that have the names now.

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
    Listed: TypeAlias = dict[str, tuple[str, str, str]]

_FACES: dict[str, Listed] = {}
_PLACES: dict[str, str] = {}
_METHODS: dict[str, str] = {}


def lazy(package: str, *, removed_in: str = "", functions: str = "") -> Face:
    """``__getattr__``, ``__dir__`` and ``__all__`` of a package whose names its ``__init__.pyi`` lists.

    Parameters
    ----------
    package
        Its ``__name__``.
    removed_in
        The release in which the whole face goes; empty where it stays.
    functions
        ``module:name`` of what makes of a listed function the one that the face offers; empty for the function itself.

    Examples
    --------
    >>> import rotorid.spectral
    >>> "frequency_response" in dir(rotorid.spectral)
    True
    """
    module = sys.modules[package]
    names = _FACES[package] = _listed(module, removed_in)

    def load(name: str) -> Any:
        if name not in names:
            raise AttributeError(f"module {package!r} has no attribute {name!r}", name=name, obj=module)
        home, original, deprecation = names[name]
        if deprecation:
            import warnings

            warnings.warn(f"{package}.{name} is {deprecation}", DeprecationWarning, stacklevel=2)
        # A listed module is its own home, as a vehicle with its sources.
        value = import_module(f"{package}.{name}") if home == package else getattr(import_module(home), original)
        value = _offered(value, functions)
        setattr(module, name, value)
        return value

    public = sorted(name for name, (_, _, deprecation) in names.items() if not deprecation)
    return load, lambda: sorted({*public, *vars(module)}), public


def deprecated(package: str) -> dict[str, str]:
    """Names of a face that will be removed, and what its stub says of each.

    Parameters
    ----------
    package
        Its name, as ``rotorid.spectral``.
    """
    import_module(package)
    return {name: deprecation for name, (_, _, deprecation) in _FACES[package].items() if deprecation}


def _listed(module: Any, removed_in: str) -> Listed:
    """Name to its home, its name there and its deprecation, of the lines of the stub.

    They read ``from HOME import NAME as NAME``, and below them all ``OLD = NAME``.
    """
    stub = module.__spec__.loader.get_data(f"{module.__file__.removesuffix('c')}i").decode()
    names: Listed = {}
    comment = ""
    for line in stub.splitlines():
        words = line.split()
        if line.startswith("from rotorid"):
            names[words[3]] = (words[1], words[3], comment)
        elif words[1:2] == ["="]:
            names[words[0]] = (*names[words[2]][:2], comment)
        comment = line[2:] if line.startswith("# deprecated") else ""
    if removed_in:
        moved = f"deprecated, removed in {removed_in}: use "
        names = {name: (home, there, f"{moved}{home}.{there}") for name, (home, there, _) in names.items()}
    return names


def _offered(value: Any, functions: str) -> Any:
    """What a face offers for a listed value: see ``functions`` of :func:`lazy`."""
    if not functions or type(value).__name__ != "function":
        return value
    place, _, made = functions.partition(":")
    return getattr(import_module(place), made)(value)


def attach(places: Mapping[str, str], *, functions: str = "") -> None:
    """Say who takes the places of values: class name to ``module:name`` of what is made of one of its values.

    ``CLASS.METHOD`` is a class method whose work is done above the layer of its class; of its function is made what
    ``functions`` says, as of those of :func:`lazy`.
    """
    _PLACES.update(places)
    _METHODS.update((name, functions) for name in places if "." in name)


def attached_method(name: str) -> Any:
    """The function behind a class method, by ``CLASS.METHOD``.

    Examples
    --------
    >>> import rotorid
    >>> attached_method("FlightRecord.from_arrays").__name__
    'record_from_arrays'
    """
    home, _, function = _PLACES[name].partition(":")
    return _offered(getattr(import_module(home), function), _METHODS[name])


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
