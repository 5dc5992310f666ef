"""Which structure a user means."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TypeAlias

from rotorid.errors import ModelError, UsageError
from rotorid.io.documents import read_text
from rotorid.models.families import Channels, Structure, family_of, has_inputs, linear, named_model, waits_for_logs
from rotorid.models.nonlinear import NonlinearStructure
from rotorid.models.parameter import ParameterSet, no_such
from rotorid.models.structure import LinearStructure
from rotorid.models.toml import structure_from_toml
from rotorid.settings.identifying import FIRST_RESPONSES, IdentifySettings

Model: TypeAlias = str | Path | LinearStructure | NonlinearStructure
"""A model as people name it: of the library, a TOML file, or a structure."""


def read_model(model: Model) -> str | Structure:
    """The structure behind a TOML file or the name of a nonlinear model; any other name and a structure as they are.

    Raises
    ------
    ModelError
        The file is wrong.
    UsageError
        There is no such file.

    Examples
    --------
    >>> read_model("drag.linear").parameters.names, read_model("rate.roll")
    (('k_Dx', 'k_Dy'), 'rate.roll')
    """
    if not isinstance(model, str | Path):
        return model
    family, path = family_of(model), Path(model)
    if family.nonlinear and family.make is not None:
        return family.make(str(model), Channels())
    if path.suffix != ".toml":
        return str(model)
    return structure_from_toml(read_text(path, needed="a model.toml, as identify writes it"), where=path.name)


def resolve_model(
    model: Model,
    *,
    inputs: Sequence[str] = (),
    outputs: Sequence[str] = (),
    decoupled: bool = False,
    logged: Sequence[str] = (),
) -> LinearStructure:
    """The linear structure behind a name, a TOML file or a structure.

    Parameters
    ----------
    model
        A name of the library, ``transfer:m/n``, ``black_box:N``, a TOML file or a structure.
    inputs, outputs, decoupled, logged
        See :class:`rotorid.models.families.Channels`.

    Raises
    ------
    ModelError
        There is no such model, or the file is wrong.
    UsageError
        There is no such file, a model without channels of its own came without any, or inputs for a model that has its
        own.
    InsufficientDataError
        The logs hold no pair of set-point and response.
    """
    read = read_model(model)
    if isinstance(read, str):
        return named_model(read, inputs=inputs, outputs=outputs, decoupled=decoupled, logged=logged)
    structure = linear(read)
    if inputs and structure is not model:
        raise has_inputs(structure, inputs)
    return structure


def asked_model(
    model: Model, *, inputs: Sequence[str] = (), outputs: Sequence[str] = (), decoupled: bool = False
) -> str | LinearStructure:
    """The linear structure behind a model, or the name of one that waits for the logs.

    Parameters
    ----------
    model, inputs, outputs, decoupled
        As for :func:`resolve_model`.

    Raises
    ------
    ModelError, UsageError
        As for :func:`resolve_model`.
    """
    if waits_for_logs(model, inputs):
        return str(model)
    return resolve_model(model, inputs=inputs, outputs=outputs, decoupled=decoupled)


def require_known(structure: LinearStructure, settings: IdentifySettings) -> None:
    """Raise for a name that the structure does not have, before any log is read.

    Parameters
    ----------
    structure
        The whole model.
    settings
        Choices of the run: parameters, constants, inputs, outputs and responses ``output/input`` are looked up.

    Raises
    ------
    ModelError
        A name is unknown (the error suggests the nearest one), or a choice of parameters is impossible.
    UsageError
        Nothing is left free.
    """
    responses = [f"{output}/{source}" for output in structure.outputs for source in structure.inputs]
    if settings.speed_damping != "joint":
        responses += ["/".join(FIRST_RESPONSES[name]) for name in FIRST_RESPONSES if name in structure.parameters.names]
    for kind, given, known in (
        ("constant", settings.constants, structure.constants),
        ("response", settings.pairs, responses),
        ("response", settings.pair_weights, responses),
        ("input", settings.input_windows_s, structure.inputs),
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
            remedy=error.remedy or "use other values",
        ) from None


def chosen_parameters(structure: LinearStructure | NonlinearStructure, settings: IdentifySettings) -> ParameterSet:
    """Parameters of a structure as the user chose them: freed, fixed or tied.

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
        raise UsageError("every parameter is fixed, so nothing can be fitted", remedy="leave out one --fix or --tie")
    return parameters
