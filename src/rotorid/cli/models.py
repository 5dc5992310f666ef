"""``rotorid models``: the names that ``--model`` takes, and models as TOML."""

from __future__ import annotations

import json as json_text
import sys
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from rotorid.cli.options import Json, Verbose, complete_from
from rotorid.settings.models import models_known
from rotorid.settings.option import Option
from rotorid.settings.parsing import NAMES

if TYPE_CHECKING:
    from rotorid.models.families import Family
    from rotorid.models.nonlinear import NonlinearStructure
    from rotorid.models.structure import LinearStructure

SCHEMA = "rotorid.models/1"


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


def models_command(
    name: Annotated[
        str | None,
        typer.Argument(
            autocompletion=complete_from(models_known),
            help="Model to print as TOML. [default: list all]",
        ),
    ] = None,
    inputs: Annotated[
        tuple[str, ...],
        Option("--inputs", "Channels of transfer:m/n and black_box:N.", text=NAMES, metavar="CHANNEL,..."),
    ] = (),
    outputs: Annotated[
        tuple[str, ...],
        Option("--outputs", "Channels of transfer:m/n and black_box:N.", text=NAMES, metavar="CHANNEL,..."),
    ] = (),
    json: Json = False,
    verbose: Verbose = False,
) -> None:
    """List the models of the library, or print one as TOML to start your own from."""
    from rotorid.models.families import FAMILIES

    if name is None:
        if json:
            models = [model.as_json() for family in FAMILIES for model in _listed(family)]
            _write({"schema": SCHEMA, "models": models})
        else:
            _print_list(verbose=verbose)
        return
    text, about, structure = _text(name, inputs, outputs)
    if json:
        _write({"schema": SCHEMA, "models": [{**_Listed(name, about, structure).as_json(), "toml": text}]})
    else:
        sys.stdout.write(text)


def _listed(family: Family) -> list[_Listed]:
    """A line for each model of a family, or one where its names hold numbers."""
    from rotorid.models.families import Channels

    names = family.names or (() if family.channels == "own" else (family.name,))
    make = family.make if family.channels == "own" else None
    return [_Listed(name, family.about(name), make(name, Channels()) if make else None) for name in names]


def _text(
    name: str, inputs: tuple[str, ...], outputs: tuple[str, ...]
) -> tuple[str, str, LinearStructure | NonlinearStructure]:
    """A model as TOML text, what it is, and its structure."""
    from rotorid.errors import UsageError
    from rotorid.models.families import Channels, family_of, named_model, without_channels
    from rotorid.models.toml import to_toml

    family = family_of(name)
    if family.make is None:
        raise UsageError(
            f"{name} depends on the motors of a log and cannot be printed",
            remedy=f"use rotorid identify LOG --model {name}, which writes {family.written}",
        )
    if (inputs or outputs) and family.channels == "own" and name in family.names:
        raise UsageError(
            f"{name} has its own inputs and outputs",
            remedy=f"use --inputs and --outputs with {without_channels()} only",
        )
    if family.text is not None and name in family.names:
        return family.text(name), family.about(name), family.make(name, Channels())
    structure = named_model(name, inputs=inputs, outputs=outputs)
    about = family.about(name)
    return f"# {about}\n\n{to_toml(structure, structure.parameters, {})}", about, structure


def _print_list(*, verbose: bool) -> None:
    from rich.table import Table

    from rotorid.cli.console import output_console
    from rotorid.models.families import FAMILIES

    table = Table(box=None, pad_edge=False)
    table.add_column("model", no_wrap=True)
    if verbose:
        table.add_column("inputs -> outputs", overflow="fold")
    table.add_column("parameters", justify="right")
    table.add_column("what it is", overflow="fold" if verbose else "ellipsis", no_wrap=not verbose)
    together = [_Listed(family.name, family.together) for family in FAMILIES if family.together]
    for model in [*(model for family in FAMILIES if not family.together for model in _listed(family)), *together]:
        structure = model.structure
        channels = "" if structure is None else f"{' '.join(structure.inputs)} -> {' '.join(structure.outputs)}"
        if structure is not None and len(channels) > _WIDEST:
            channels = f"{len(structure.inputs)} inputs -> {len(structure.outputs)} outputs"
        number = "" if structure is None else str(len(structure.parameters))
        about = model.about if verbose else model.about.partition(":")[0]
        table.add_row(model.name, *([channels] if verbose else []), number, about)
    console = output_console()
    console.print(table)
    if not verbose:
        console.print("-v shows inputs, outputs and more of each", style="dim")
    console.print("rotorid models NAME prints a model as TOML, to start your own from.", soft_wrap=True)


def _write(document: dict[str, object]) -> None:
    sys.stdout.write(json_text.dumps(document, indent=2) + "\n")
