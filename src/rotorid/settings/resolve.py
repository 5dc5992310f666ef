"""Which structure a user means."""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

from rotorid.data.findings import refusal
from rotorid.errors import InsufficientDataError, ModelError, RotoridError, UsageError
from rotorid.io.documents import read_text
from rotorid.models.black_box import black_box, black_box_pairs
from rotorid.models.library import (
    RATE_AXES,
    RESPONSE_MODELS,
    library_model,
    model_names,
    nonlinear_model,
    nonlinear_model_names,
    rate_model,
    response_model,
    response_pairs,
    transfer_function,
)
from rotorid.models.nonlinear import NonlinearStructure
from rotorid.models.parameter import ParameterSet, no_such
from rotorid.models.structure import LinearStructure
from rotorid.models.toml import from_toml, structure_from_toml
from rotorid.settings.settings import HOVER, IdentifySettings
from rotorid.settings.settings import MODEL as MOTORS

_TRANSFER = re.compile(r"transfer:(\d+)/(\d+)")
_BLACK_BOX = re.compile(r"black_box:(\d+|auto)(\+delay)?")

AUTO = "black_box:auto"
"""A black box whose order the records choose; until then it is one of first order."""


Model: TypeAlias = str | Path | LinearStructure | NonlinearStructure
"""A model as people name it: of the library, a TOML file, or a structure."""


def nonlinear_of(model: Model) -> NonlinearStructure | None:
    """The nonlinear structure behind a name, a TOML file or a structure; ``None`` where it is none.

    Raises
    ------
    ModelError
        The file is wrong.
    UsageError
        There is no such file.

    Examples
    --------
    >>> nonlinear_of("drag.linear").parameters.names, nonlinear_of("rate.roll")
    (('k_Dx', 'k_Dy'), None)
    """
    if isinstance(model, NonlinearStructure):
        return model
    if isinstance(model, LinearStructure):
        return None
    if str(model) in nonlinear_model_names():
        return nonlinear_model(str(model))
    path = Path(model)
    if path.suffix != ".toml":
        return None
    found = structure_from_toml(read_text(path, needed="a model.toml, as identify writes it"), where=path.name)
    return found if isinstance(found, NonlinearStructure) else None


def resolve_model(
    model: Model,
    *,
    inputs: Sequence[str] = (),
    outputs: Sequence[str] = (),
    decoupled: bool = False,
    logged: Sequence[str] = (),
) -> LinearStructure:
    """The structure behind a name, a TOML file or a structure.

    Parameters
    ----------
    model
        A name of the library, ``transfer:m/n``, ``black_box:N``, a TOML file or a structure.
    inputs, outputs, decoupled, logged
        See :func:`named_model`.

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
    if isinstance(model, LinearStructure):
        return model
    if (nonlinear := nonlinear_of(model)) is not None:
        raise UsageError(
            f"{nonlinear.name} came, which is nonlinear",
            needed="a linear structure",
            remedy="rotorid identify takes it by --model",
        )
    assert not isinstance(model, NonlinearStructure)
    path = Path(model)
    if path.suffix != ".toml":
        return named_model(str(model), inputs=inputs, outputs=outputs, decoupled=decoupled, logged=logged)
    structure = from_toml(read_text(path, needed="a model.toml, as identify writes it"), where=path.name)
    if inputs:
        raise _has_inputs(structure, inputs)
    return structure


def named_model(
    name: str,
    *,
    inputs: Sequence[str] = (),
    outputs: Sequence[str] = (),
    decoupled: bool = False,
    logged: Sequence[str] = (),
) -> LinearStructure:
    """The structure behind a name: of the library, ``response.*``, ``transfer:m/n`` or ``black_box:N``.

    Parameters
    ----------
    name
        Such as ``hover.longitudinal``.
    inputs, outputs
        Channels of a transfer function, a black box or a response model, which have none by themselves; those of a
        response model belong together in their order.
    decoupled
        Whether a black box is one for each input and its output, side by side.
    logged
        Channels of the logs, in which a response model or a black box without given channels finds its pairs.

    Raises
    ------
    ModelError
        There is no such model.
    UsageError
        A model without channels of its own came without any, or inputs for a model that has its own.
    InsufficientDataError
        The logs hold no pair of set-point and response.

    Examples
    --------
    >>> named_model("transfer:0/1", inputs=["roll_command"], outputs=["p"]).parameters.names
    ('b0', 'a0', 'tau')
    >>> named_model("response.first_order", logged=["phi", "phi_setpoint", "theta"]).parameters.names
    ('K_phi', 'T_phi')
    >>> named_model("black_box:2+delay", inputs=["u"], outputs=["y"]).parameters.names
    ('a0_1', 'a1_1', 'b_x1', 'b_x2', 'tau')
    """
    if match := _TRANSFER.fullmatch(name):
        _require_channels(name, inputs, outputs)
        return transfer_function(numerator=int(match[1]), denominator=int(match[2]), inputs=inputs, outputs=outputs)
    if match := _BLACK_BOX.fullmatch(name):
        if not inputs and logged:
            # From the set-points of the logs, each to its own answer.
            pairs = _pairs_of(name, inputs, outputs, logged)
            inputs, outputs, decoupled = tuple(u for u, _ in pairs), tuple(y for _, y in pairs), True
        _require_channels(name, inputs, outputs)
        order, delays = 1 if match[1] == "auto" else int(match[1]), match[2] is not None
        if decoupled:
            box = black_box_pairs(order, _paired(name, inputs, outputs), delays=delays)
        else:
            box = black_box(order, inputs, outputs, delays=delays)
        return replace(box, name=AUTO) if match[1] == "auto" else box
    if name in RESPONSE_MODELS:
        return response_model(name, _pairs_of(name, inputs, outputs, logged))
    if name not in (*RATE_AXES, *model_names()):
        raise _unknown(name)
    structure = rate_model(name) if name in RATE_AXES else library_model(name)
    if inputs:
        raise _has_inputs(structure, inputs)
    return structure


def finds_its_channels(model: Model, inputs: Sequence[str] = ()) -> bool:
    """Whether a model takes its channels or its rotors from the logs, so that it is known only when they are read.

    Examples
    --------
    >>> [finds_its_channels(name) for name in ("response.first_order", "black_box:2", "physical.hover", "rate.roll")]
    [True, True, True, False]
    """
    if inputs or isinstance(model, LinearStructure | NonlinearStructure):
        return False
    return str(model) in (*RESPONSE_MODELS, HOVER) or _BLACK_BOX.fullmatch(str(model)) is not None


def answers_setpoints(structure: LinearStructure) -> bool:
    """Whether a structure is a response model or a black box, which are fitted in the time domain by default."""
    return structure.name in RESPONSE_MODELS or black_box_order(structure) is not None


def black_box_order(structure: LinearStructure) -> int | None:
    """Order of a black box, one where it is still to be chosen; ``None`` for any other structure.

    Examples
    --------
    >>> black_box_order(named_model("black_box:3", inputs=["u"], outputs=["y"]))
    3
    """
    match = _BLACK_BOX.fullmatch(structure.name)
    if match is None:
        return None
    return 1 if match[1] == "auto" else int(match[1])


def _require_channels(name: str, inputs: Sequence[str], outputs: Sequence[str]) -> None:
    if not inputs or not outputs:
        raise UsageError(f"{name} came without channels", needed="--inputs and --outputs with their names")


def _paired(name: str, inputs: Sequence[str], outputs: Sequence[str]) -> tuple[tuple[str, str], ...]:
    if len(inputs) != len(outputs):
        raise UsageError(
            f"{len(inputs)} inputs and {len(outputs)} outputs came for {name}", needed="an output for each input"
        )
    return tuple(zip(inputs, outputs, strict=True))


def _pairs_of(
    name: str, inputs: Sequence[str], outputs: Sequence[str], logged: Sequence[str]
) -> tuple[tuple[str, str], ...]:
    if inputs:
        return _paired(name, inputs, outputs)
    pairs = tuple(pair for pair in response_pairs(logged) if not outputs or pair[1] in outputs)
    if not pairs:
        raise _no_pair(name, outputs, logged)
    return pairs


def _no_pair(name: str, outputs: Sequence[str], logged: Sequence[str]) -> RotoridError:
    needed = "a channel and its set-point, such as phi and phi_setpoint"
    remedy = "name them with --inputs and --outputs, or in the log with --map"
    if not logged:
        return UsageError(f"{name} came without channels", needed=needed, remedy=remedy)
    which = f" of {', '.join(outputs)}" if outputs else ""
    message = f"No logged channel{which} has a set-point beside it."
    finding = refusal("missing_channel", name, message)
    return InsufficientDataError(message, needed=needed, remedy=remedy, findings=[finding])


def _has_inputs(structure: LinearStructure, inputs: Sequence[str]) -> UsageError:
    return UsageError(
        f"the inputs {', '.join(inputs)} came with {structure.name}, which has {', '.join(structure.inputs)}",
        needed="--inputs with response.*, transfer:m/n or black_box:N alone",
        remedy="leave them out; inputs that were not excited take no part",
    )


_AXES = {
    **{axis: axis for axis in ("roll", "pitch", "yaw", "vertical")},
    "p": "roll",
    "q": "pitch",
    "r": "yaw",
    "az": "vertical",
    "thrust": "vertical",
    "heave": "vertical",
}
"""Axes as people name them, and the rate model of each."""


def _unknown(model: str) -> ModelError:
    if model == MOTORS:
        return ModelError(
            f"{MOTORS} came, which is no linear structure",
            needed="a linear structure",
            remedy=f"rotorid identify LOG --model {MOTORS}, in Python rotorid.identifying.identify_motors",
        )
    names = (*RATE_AXES, *model_names(), MOTORS, *RESPONSE_MODELS, *nonlinear_model_names())
    near = [f"rate.{_AXES[model.lower()]}"] if model.lower() in _AXES else []
    near = near or difflib.get_close_matches(model, (*names, "black_box:2"), n=1)
    return ModelError(
        f"there is no model {model!r}",
        needed=f"one of {', '.join(names)}, transfer:m/n, black_box:N, or a .toml file",
        remedy=f"did you mean {near[0]}?" if near else "",
    )


def require_known(structure: LinearStructure, settings: IdentifySettings) -> None:
    """Refuse a name that a structure does not have, before any log is read for it.

    Parameters
    ----------
    structure
        The whole model.
    settings
        Choices of the run: parameters, constants, inputs, outputs and responses ``output/input`` are looked up.

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
            remedy=error.remedy or "give other values",
        ) from None


def chosen_parameters(structure: LinearStructure | NonlinearStructure, settings: IdentifySettings) -> ParameterSet:
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
