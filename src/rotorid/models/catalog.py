"""The library of hover models: one TOML file each, read by name."""

from __future__ import annotations

import difflib
from importlib.resources import files

from rotorid.errors import ModelError
from rotorid.models.description import from_toml
from rotorid.models.structure import LinearStructure

_SUFFIX = ".toml"


def model_names() -> tuple[str, ...]:
    """Names of the models in the library, sorted.

    Examples
    --------
    >>> [name for name in model_names() if name.startswith("hover")]
    ['hover.full', 'hover.lateral', 'hover.longitudinal']
    """
    folder = files("rotorid.models").joinpath("library")
    return tuple(sorted(file.name.removesuffix(_SUFFIX) for file in folder.iterdir() if file.name.endswith(_SUFFIX)))


def library_text(name: str) -> str:
    """The file of a model as it ships, comments included: what a user copies to write a model of one's own.

    Parameters
    ----------
    name
        One of :func:`model_names`.

    Raises
    ------
    ModelError
        There is no such model.

    Examples
    --------
    >>> print(library_text("rig.roll").splitlines()[0])
    # Roll of a quadrotor on a pivot without friction, driven by two opposite motors, each with its own delay.
    """
    names = model_names()
    if name not in names:
        near = difflib.get_close_matches(name, names, n=1)
        raise ModelError(
            f"the library has no model {name!r}",
            needed=f"one of {', '.join(names)}",
            remedy=f"did you mean {near[0]}?" if near else "",
        )
    return files("rotorid.models").joinpath("library", name + _SUFFIX).read_text(encoding="utf-8")


def library_model(name: str) -> LinearStructure:
    """A model of the library, its parameters at typical start values.

    Parameters
    ----------
    name
        One of :func:`model_names`.

    Raises
    ------
    ModelError
        There is no such model.

    Examples
    --------
    >>> library_model("axis.yaw").parameters.names
    ('N_yaw', 'N_spin', 'N_r', 'tau_yaw', 'T_motor')
    """
    return from_toml(library_text(name), where=f"the model {name}")
