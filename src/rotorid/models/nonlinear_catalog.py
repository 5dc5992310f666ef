"""The library of nonlinear models: one TOML file each, read by name."""

from __future__ import annotations

from importlib.resources import files

from rotorid.errors import ModelError
from rotorid.models.nonlinear import NonlinearStructure
from rotorid.models.nonlinear_description import nonlinear_from_toml
from rotorid.models.ties import no_such

_SUFFIX = ".toml"
_FOLDER = "nonlinear_library"


def nonlinear_model_names() -> tuple[str, ...]:
    """Names of the nonlinear models in the library, sorted.

    Examples
    --------
    >>> nonlinear_model_names()
    ('drag.linear', 'drag.quadratic', 'flight.first_order')
    """
    folder = files("rotorid.models").joinpath(_FOLDER)
    return tuple(sorted(file.name.removesuffix(_SUFFIX) for file in folder.iterdir() if file.name.endswith(_SUFFIX)))


def nonlinear_library_text(name: str) -> str:
    """The file of a nonlinear model as it ships, comments included.

    Raises
    ------
    ModelError
        There is no such model.
    """
    names = nonlinear_model_names()
    if name not in names:
        error = no_such("nonlinear model", name, names)
        raise ModelError(error.came, needed=error.needed, remedy=error.remedy)
    return files("rotorid.models").joinpath(_FOLDER, name + _SUFFIX).read_text(encoding="utf-8")


def nonlinear_model(name: str) -> NonlinearStructure:
    """A nonlinear model of the library, its parameters at typical start values.

    Parameters
    ----------
    name
        One of :func:`nonlinear_model_names`.

    Raises
    ------
    ModelError
        There is no such model.

    Examples
    --------
    >>> nonlinear_model("drag.linear").parameters.names
    ('k_Dx', 'k_Dy')
    """
    return nonlinear_from_toml(nonlinear_library_text(name), where=f"the model {name}")
