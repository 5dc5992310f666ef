"""``rotorid models``: what can stand behind ``--model``, and where a model of one's own begins."""

from __future__ import annotations

import json as json_text
import sys
from itertools import takewhile
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from rotorid.cli.options import Json, models_known, one_of
from rotorid.settings.settings import MODEL, parse_names

if TYPE_CHECKING:
    from rotorid.models.nonlinear import NonlinearStructure
    from rotorid.models.structure import LinearStructure

SCHEMA = "rotorid.models/1"

TRANSFER = "transfer:m/n"
_ABOUT_TRANSFER = "Any transfer function, m zeros over n poles, between channels named with --inputs and --outputs."
_ABOUT_MOTORS = "Inertia, thrust, motor lag and torque of the vehicle from its motor outputs, gyros and accelerometer."
BLACK_BOX = "black_box:N"
_ABOUT_BLACK_BOX = "Any state space of N states, between channels named with --inputs and --outputs; +delay for delays."
_ABOUT_RESPONSE = {
    "response.first_order": "Gain and time constant from each set-point to what it is of, as an autopilot flies it.",
    "response.second_order": "Gain, frequency and damping from each set-point to what it is of.",
    "response.second_order_zero": "The same with a zero.",
}
_ABOUT_RATE = "Rate of one axis after its command: gain, damping, motor lag, delay. From some 3 to 8 rad/s up."


class _Listed(NamedTuple):
    """One line of the list; channels and parameters of a transfer function are the user's."""

    name: str
    about: str
    structure: LinearStructure | NonlinearStructure | None = None

    def as_json(self) -> dict[str, object]:
        structure = self.structure
        return {
            "name": self.name,
            "about": self.about,
            "inputs": list(structure.inputs) if structure else None,
            "outputs": list(structure.outputs) if structure else None,
            "parameters": list(structure.parameters.names) if structure else None,
        }


_WIDEST = 100
"""Characters beyond which the list counts channels instead of naming them."""

_RESPONSES = _Listed(
    "response.*",
    "From each set-point to what it is of: first_order, second_order or second_order_zero, with _delay or without.",
)
"""How the list names six models in one line; they have the channels of the log."""


def models_command(
    name: Annotated[
        str | None,
        typer.Argument(
            autocompletion=one_of(models_known),
            help="A model, to print as the TOML text that --model reads. [default: list all]",
        ),
    ] = None,
    inputs: Annotated[
        str | None, typer.Option("--inputs", metavar="CHANNEL,...", help="Of a model without its own.")
    ] = None,
    outputs: Annotated[
        str | None, typer.Option("--outputs", metavar="CHANNEL,...", help="Of a model without its own.")
    ] = None,
    json: Json = False,
) -> None:
    """List the models of the library, or print one to begin a model of your own with."""
    if name is None:
        models = _library()
        if json:
            _write({"schema": SCHEMA, "models": [model.as_json() for model in models]})
        else:
            _print_list(models)
        return
    text, about, structure = _text(name, *(parse_names(text) if text else () for text in (inputs, outputs)))
    if json:
        _write({"schema": SCHEMA, "models": [{**_Listed(name, about, structure).as_json(), "toml": text}]})
    else:
        sys.stdout.write(text)


def _library() -> list[_Listed]:
    from rotorid.models.library import (
        RATE_AXES,
        RESPONSE_MODELS,
        library_model,
        library_text,
        model_names,
        nonlinear_library_text,
        nonlinear_model,
        nonlinear_model_names,
        rate_model,
    )

    return [
        *(_Listed(name, _ABOUT_RATE, rate_model(name)) for name in RATE_AXES),
        *(_Listed(name, _first_sentence(library_text(name)), library_model(name)) for name in model_names()),
        *(_Listed(name, _about_response(name)) for name in RESPONSE_MODELS),
        _Listed(MODEL, _ABOUT_MOTORS),
        *(
            _Listed(name, _first_sentence(nonlinear_library_text(name)), nonlinear_model(name))
            for name in nonlinear_model_names()
        ),
        _Listed(TRANSFER, _ABOUT_TRANSFER),
        _Listed(BLACK_BOX, _ABOUT_BLACK_BOX),
    ]


def _about_response(name: str) -> str:
    """What a response model is; it has the channels of the log, or those that are named."""
    plain = name.removesuffix("_delay")
    return _ABOUT_RESPONSE[plain] if plain == name else f"As {plain}, with a delay of each."


def _first_sentence(text: str) -> str:
    """The first sentence of the comment with which a model begins."""
    comment = takewhile(lambda line: line.startswith("#"), text.splitlines())
    sentence, dot, _ = " ".join(line.removeprefix("#").strip() for line in comment).partition(". ")
    return sentence + dot.strip()


def _text(
    name: str, inputs: tuple[str, ...], outputs: tuple[str, ...]
) -> tuple[str, str, LinearStructure | NonlinearStructure]:
    """A model as TOML text, what it is, and its structure."""
    from rotorid.errors import UsageError
    from rotorid.models.library import (
        RATE_AXES,
        RESPONSE_MODELS,
        library_text,
        model_names,
        nonlinear_library_text,
        nonlinear_model,
        nonlinear_model_names,
    )
    from rotorid.models.toml import from_toml, to_toml
    from rotorid.settings.resolve import named_model

    if name == MODEL:
        raise UsageError(
            f"{MODEL} came, which is no linear structure and has no text",
            remedy=f"rotorid identify LOG --model {MODEL} writes the linear model about hover that follows from it",
        )
    named = name.startswith(("transfer:", "black_box:", "response."))
    if (inputs or outputs) and not named:
        raise UsageError(
            f"--inputs and --outputs came with {name}",
            needed=f"them with response.*, {TRANSFER} or {BLACK_BOX} alone",
            remedy="the channels of other models stand in their text",
        )
    if name in model_names():
        text = library_text(name)
        return text, _first_sentence(text), from_toml(text, where=f"the model {name}")
    if name in nonlinear_model_names():
        text = nonlinear_library_text(name)
        return text, _first_sentence(text), nonlinear_model(name)
    structure = named_model(name, inputs=inputs, outputs=outputs)
    about = _ABOUT_RATE if name in RATE_AXES else _ABOUT_TRANSFER
    if name in RESPONSE_MODELS:
        about = _about_response(name)
    elif not name.startswith("transfer:") and named:
        about = _ABOUT_BLACK_BOX
    return f"# {about}\n\n{to_toml(structure, structure.parameters, {})}", about, structure


def _print_list(models: list[_Listed]) -> None:
    from rich.table import Table

    from rotorid.cli.console import output_console

    table = Table(box=None, pad_edge=False)
    for column in ("model", "inputs -> outputs"):
        table.add_column(column, overflow="fold")
    table.add_column("parameters", justify="right")
    table.add_column("what it is", overflow="fold")
    for model in [*(model for model in models if not model.name.startswith("response.")), _RESPONSES]:
        structure = model.structure
        channels = "" if structure is None else f"{' '.join(structure.inputs)} -> {' '.join(structure.outputs)}"
        if structure is not None and len(channels) > _WIDEST:
            channels = f"{len(structure.inputs)} inputs -> {len(structure.outputs)} outputs"
        table.add_row(model.name, channels, "" if structure is None else str(len(structure.parameters)), model.about)
    console = output_console()
    console.print(table)
    console.print("rotorid models NAME prints a model as TOML text, the beginning of one of your own.", soft_wrap=True)


def _write(document: dict[str, object]) -> None:
    sys.stdout.write(json_text.dumps(document, indent=2) + "\n")
