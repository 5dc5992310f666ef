"""Which structure a user means."""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence
from pathlib import Path

from rotorid.errors import ModelError, UsageError
from rotorid.models.catalog import library_model, model_names
from rotorid.models.description import from_toml
from rotorid.models.parameter import ParameterSet
from rotorid.models.rate import RATE_AXES, rate_model
from rotorid.models.structure import LinearStructure
from rotorid.models.ties import no_such
from rotorid.models.transfer_function import transfer_function
from rotorid.pipeline.settings import IdentifySettings

_TRANSFER = re.compile(r"transfer:(\d+)/(\d+)")


def resolve_model(
    model: str | Path | LinearStructure, *, inputs: Sequence[str] = (), outputs: Sequence[str] = ()
) -> LinearStructure:
    """The structure behind a name, a TOML file or a structure.

    Parameters
    ----------
    model
        A name of the library, ``transfer:m/n``, a TOML file or a structure.
    inputs, outputs
        Channels of a transfer function, which has none by itself.

    Raises
    ------
    ModelError
        There is no such model, or the file is wrong.
    UsageError
        There is no such file, a transfer function came without channels, or inputs for a model that has its own.
    """
    if isinstance(model, LinearStructure):
        return model
    path = Path(model)
    if path.suffix != ".toml":
        return named_model(str(model), inputs=inputs, outputs=outputs)
    try:
        structure = from_toml(path.read_text(encoding="utf-8"), where=path.name)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is no UTF-8 text"
        raise UsageError(f"{path} cannot be read: {reason}", needed="a model.toml, as identify writes it") from error
    if inputs:
        raise _has_inputs(structure, inputs)
    return structure


def named_model(name: str, *, inputs: Sequence[str] = (), outputs: Sequence[str] = ()) -> LinearStructure:
    """The structure behind a name: of the library, or ``transfer:m/n``.

    Parameters
    ----------
    name
        Such as ``hover.longitudinal``.
    inputs, outputs
        Channels of a transfer function, which has none by itself.

    Raises
    ------
    ModelError
        There is no such model.
    UsageError
        A transfer function came without channels, or inputs for a model that has its own.

    Examples
    --------
    >>> named_model("transfer:0/1", inputs=["roll_command"], outputs=["p"]).parameters.names
    ('b0', 'a0', 'tau')
    """
    if match := _TRANSFER.fullmatch(name):
        return _transfer(int(match[1]), int(match[2]), inputs, outputs)
    if name not in (*RATE_AXES, *model_names()):
        raise _unknown(name)
    structure = rate_model(name) if name in RATE_AXES else library_model(name)
    if inputs:
        raise _has_inputs(structure, inputs)
    return structure


def _transfer(zeros: int, poles: int, inputs: Sequence[str], outputs: Sequence[str]) -> LinearStructure:
    if not inputs or not outputs:
        raise UsageError(
            f"transfer:{zeros}/{poles} came without channels", needed="--inputs and --outputs with their names"
        )
    return transfer_function(numerator=zeros, denominator=poles, inputs=inputs, outputs=outputs)


def _has_inputs(structure: LinearStructure, inputs: Sequence[str]) -> UsageError:
    return UsageError(
        f"the inputs {', '.join(inputs)} came with {structure.name}, which has {', '.join(structure.inputs)}",
        needed="--inputs with transfer:m/n alone",
        remedy="leave them out; inputs that were not excited take no part",
    )


def _unknown(model: str) -> ModelError:
    names = (*RATE_AXES, *model_names())
    near = difflib.get_close_matches(model, names, n=1)
    return ModelError(
        f"there is no model {model!r}",
        needed=f"one of {', '.join(names)}, transfer:m/n, or a .toml file",
        remedy=f"did you mean {near[0]}?" if near else "",
    )


def require_known(structure: LinearStructure, settings: IdentifySettings) -> None:
    """Refuse a name that a structure does not have, before any log is read for it.

    Parameters
    ----------
    structure
        The whole model.
    settings
        Choices of the run: parameters, constants, outputs and responses ``output/input`` are looked up.

    Raises
    ------
    ModelError
        A name is unknown, the nearest one is suggested; or a choice of parameters is impossible.
    UsageError
        Nothing is left free.
    """
    responses = [f"{output}/{source}" for output in structure.outputs for source in structure.inputs]
    for kind, given, known in (
        ("constant", settings.constants, structure.constants),
        ("response", settings.pairs, responses),
        ("response", settings.pair_weights, responses),
    ):
        for name in given:
            if name not in known:
                raise no_such(kind, name, known)
    if settings.outputs:
        structure.select(outputs=settings.outputs)
    at_trim = structure.with_constants(settings.constants)
    chosen = chosen_parameters(at_trim, settings)
    try:
        at_trim.matrices(chosen.values)
    except ModelError as error:
        raise ModelError(
            f"{structure.name} at its start values: {error.came}",
            needed=error.needed,
            remedy=error.remedy or "give other values",
        ) from None


def chosen_parameters(structure: LinearStructure, settings: IdentifySettings) -> ParameterSet:
    """Parameters of a structure as the user wants them: freed, held or tied.

    Raises
    ------
    ModelError
        A parameter does not exist, its value is out of bounds, or ties run in a circle.
    UsageError
        Nothing is left free.
    """
    parameters = structure.parameters
    for name in settings.free:
        parameters = parameters.free_again(name)
    for name, value in settings.fix.items():
        parameters = parameters.fix(name, value)
    for name, text in settings.ties.items():
        parameters = parameters.tie(name, text)
    if not parameters.free:
        raise UsageError("every parameter is fixed", needed="at least one that is free")
    return parameters
