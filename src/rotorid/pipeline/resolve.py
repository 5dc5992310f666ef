"""Which structure a user means."""

from __future__ import annotations

from pathlib import Path

from rotorid.errors import ModelError, UsageError
from rotorid.models.description import from_toml
from rotorid.models.parameter import ParameterSet
from rotorid.models.rate import RATE_AXES, rate_model
from rotorid.models.structure import LinearStructure
from rotorid.pipeline.settings import IdentifySettings


def resolve_model(model: str | Path | LinearStructure) -> LinearStructure:
    """The structure behind a name, a TOML file or a structure.

    Raises
    ------
    ModelError
        There is no such model, or the file is wrong.
    UsageError
        There is no such file.
    """
    if isinstance(model, LinearStructure):
        return model
    if isinstance(model, str) and model in RATE_AXES:
        return rate_model(model)
    path = Path(model)
    if path.suffix != ".toml":
        raise ModelError(f"there is no model {str(model)!r}", needed=f"one of {', '.join(RATE_AXES)}, or a .toml file")
    try:
        return from_toml(path.read_text(encoding="utf-8"), where=path.name)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is no UTF-8 text"
        raise UsageError(f"{path} cannot be read: {reason}", needed="a model.toml, as identify writes it") from error


def chosen_parameters(structure: LinearStructure, settings: IdentifySettings) -> ParameterSet:
    """Parameters of a structure with those held that the user fixed.

    Raises
    ------
    ModelError
        A fixed parameter does not exist, or its value is out of bounds.
    UsageError
        Nothing is left free.
    """
    parameters = structure.parameters
    for name, value in settings.fix.items():
        parameters = parameters.fix(name, value)
    if not parameters.free:
        raise UsageError("every parameter is fixed", needed="at least one that is free")
    return parameters
