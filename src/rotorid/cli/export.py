"""``rotorid export``: an identified vehicle as files for simulators and tools."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rotorid.cli.command import command_line
from rotorid.cli.console import default_folder, fold, log_progress, output_console, print_findings, progress
from rotorid.cli.options import Output
from rotorid.data.display import counted
from rotorid.errors import UsageError
from rotorid.exports.settings import DrawSettings, ExportSettings, TargetSettings
from rotorid.settings.option import Option

if TYPE_CHECKING:
    from rotorid.documents.export import ComparedDocument, DrawsDocument, ExportDocument
    from rotorid.exports.target import Exported
    from rotorid.flying.vehicle_from_results import JoinedVehicle
    from rotorid.results.model import IdentifiedModel
    from rotorid.simulation.multirotor_flight import Aircraft

FILE = "export.json"


def export_command(
    results: Annotated[
        list[Path],
        typer.Argument(help="Results of identify. Several of one vehicle are combined."),
    ],
    *,
    what: TargetSettings,
    form: Annotated[dict[str, Any], ExportSettings],
    no_delay: Annotated[
        bool, Option("--no-delay", "Leave delays out: margins of the files are too large.", "What is written")
    ] = False,
    drawn: DrawSettings,
    output: Output,
) -> None:
    """Export an identified vehicle to a simulator or tool, and report what is kept and what is lost."""
    from rotorid.documents.base import to_json
    from rotorid.documents.results import load_results
    from rotorid.exports.exporting import export, joined
    from rotorid.io.folders import making, target_folder
    from rotorid.report.files import result_kind

    choices = _settings(form, no_delay=no_delay)
    default = default_folder(results, f"export-{what.to}")
    target = target_folder(output.out, default, result_kind(FILE), force=output.force)
    with progress(quiet=output.quiet):
        models = load_results(results)
        like = None if what.like is None else _similar(what.like)
        vehicle = joined(models, choices, given=what.given, layout=what.layout, like=like)
        exported = export(vehicle, what.to, choices)
        more, draws = _drawn(models, what, choices, drawn, like)
        files = _files(exported, more)
        document = _document(vehicle, exported, choices, files, draws, None if like is None else like.name)
        text = to_json(document)
        with making(target) as made:
            _write(made.place, {**files, FILE: text})
    if output.json:
        sys.stdout.write(text)
    elif not output.quiet:
        _print(document, made.folder, verbose=output.verbose)


def _settings(given: dict[str, Any], *, no_delay: bool) -> ExportSettings:
    """The chosen settings: one answer to what becomes of delays."""
    flags = {
        "--no-delay": no_delay,
        "--delay-as-lag": given.get("delay") is not None,
        "--pade": given.get("pade_order") is not None,
    }
    named = [name for name, was_given in flags.items() if was_given]
    if len(named) > 1:
        raise UsageError(f"{' and '.join(named)} exclude each other", remedy="give one of them")
    if no_delay:
        given["delay"] = "none"
    elif flags["--pade"]:
        given["delay"] = "states"
    return ExportSettings(**given)


def _similar(name: str) -> Aircraft:
    """The vehicle of the library, or of a file, that gives what is missing."""
    from rotorid.documents.vehicle import named_vehicle

    return named_vehicle([name]).entry.aircraft


def _drawn(
    models: Sequence[IdentifiedModel],
    what: TargetSettings,
    choices: ExportSettings,
    drawn: DrawSettings,
    like: Aircraft | None,
) -> tuple[Mapping[str, str | bytes], DrawsDocument | None]:
    """Files of further vehicles, drawn from the covariance of the results."""
    from rotorid.documents.export import DrawsDocument
    from rotorid.exports.exporting import draw_files, export_draws

    if not drawn.draws:
        return {}, None
    log_progress(f"drawing {drawn.draws} vehicles")
    vehicles, redrawn = export_draws(
        models, what.to, choices, drawn.draws, seed=drawn.seed, given=what.given, layout=what.layout, like=like
    )
    made = draw_files(vehicles, what.to, choices)
    return made.files, DrawsDocument(count=drawn.draws, seed=drawn.seed, redrawn=redrawn, start=made.start)


def _files(exported: Exported, drawn: Mapping[str, str | bytes]) -> dict[str, str | bytes]:
    """All files by their paths."""
    files = {**exported.files, **drawn}
    written: dict[str, str] = {FILE.lower(): FILE}
    for name in files:
        if (other := written.setdefault(name.lower(), name)) != name or name == FILE:
            raise UsageError(f"{name} and {other} would be the same file", remedy="choose another name with --name")
    return files


def _document(
    vehicle: JoinedVehicle,
    exported: Exported,
    choices: ExportSettings,
    files: Mapping[str, str | bytes],
    draws: DrawsDocument | None,
    like: str | None,
) -> ExportDocument:
    from rotorid.data.findings import worst_first
    from rotorid.documents.base import FindingDocument
    from rotorid.documents.export import (
        ComparedDocument,
        ExportDocument,
        KeptDelaysDocument,
        file_documents,
        number_documents,
    )
    from rotorid.exports.targets import target_named
    from rotorid.results.summary import finite

    findings = worst_first([*vehicle.findings, *exported.findings])
    # The usual numbers of a target that nothing was looked up for are its own matter.
    taken = {
        name: number for name, number in vehicle.numbers.items() if number.source == "default" and number.of == like
    }
    return ExportDocument(
        target=exported.target,
        name=choices.names,
        results=[model.name for model in vehicle.models],
        delay=choices.delay or (choices.model_delay if target_named(exported.target).states else "none"),
        pade_order=max((kept.pade_order for kept in exported.delays.values() if kept.pade_order), default=None),
        delays={name: KeptDelaysDocument.model_validate(kept) for name, kept in exported.delays.items()},
        sample_rate_hz=choices.sample_rate_hz,
        files=file_documents(files),
        quantities=[
            ComparedDocument(
                name=compared.name,
                unit=compared.unit,
                identified=compared.identified,
                exported=compared.exported,
                difference_percent=None if compared.held == "not" else finite(compared.difference_percent),
                held=compared.held,
                identified_std=compared.identified_std,
            )
            for compared in exported.compared
        ],
        numbers=number_documents(vehicle.numbers),
        given=number_documents({name: number for name, number in vehicle.numbers.items() if number.source == "given"}),
        defaults=number_documents({**taken, **exported.defaults}),
        left_out=list(exported.left_out),
        draws=draws,
        start=exported.start,
        findings=[FindingDocument.model_validate(finding) for finding in findings],
        command=command_line(),
    )


def _write(folder: Path, files: Mapping[str, str | bytes]) -> None:
    from rotorid.io.files import write_atomically

    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        write_atomically(folder / name, content)


_FIDELITY_WORDS = {"exact": "exact", "approximated": "approximated", "not": "[dim]lost[/dim]"}


def _print(document: ExportDocument, folder: Path, *, verbose: bool = False) -> None:
    """What was written, how to use it, what is kept and what is lost; with ``-v`` the table of all quantities."""
    from rich.table import Table

    from rotorid.exports.target import identified_text, percent_text

    console = output_console()

    def plain(text: str) -> None:
        console.print(text, markup=False, soft_wrap=True, highlight=False)

    names = [file.name for file in document.files if not file.name.startswith("draws/")]
    plain(f"Wrote {document.name} for {document.target}: {', '.join(names)}")
    plain(f"folder: {folder}")
    plain(f"\nuse it:\n{document.start}\n")
    for title, held in (("kept exactly", "exact"), ("approximated", "approximated"), ("lost", "not")):
        if rows := [_quantity(row) for row in document.quantities if row.held == held]:
            plain(f"{title}: {', '.join(fold(rows, verbose=verbose, most=_MOST_NAMED))}{_more(rows, verbose)}")
    for sentence in fold(document.left_out, verbose=verbose, most=_MOST_SENTENCES):
        plain(f"  {sentence}")
    for title, numbers in (("given", document.given), ("default", document.defaults)):
        texts = [
            f"{name} = {number.value:.5g}{'' if number.unit == '1' else f' {number.unit}'}"
            f"{f' ({number.of})' if number.of else ''}"
            for name, number in numbers.items()
        ]
        if texts:
            plain(f"{title}: {', '.join(fold(texts, verbose=verbose, most=_MOST_NAMED))}{_more(texts, verbose)}")
    if document.draws is not None:
        again = f" ({document.draws.redrawn} impossible draws were repeated)" if document.draws.redrawn else ""
        plain(f"drawn: {counted(document.draws.count, 'vehicle')} in draws{again}")
        if document.draws.start:
            plain(f"use them:\n{document.draws.start}")
    if verbose and document.quantities:
        table = Table(title="quantities", title_justify="left", box=None, pad_edge=False)
        for column in ("quantity", "identified", "exported", "unit", "difference", "kept"):
            table.add_column(column, justify="right" if column in ("identified", "exported", "difference") else "left")
        for row in document.quantities:
            percent = "" if row.difference_percent is None else percent_text(row.difference_percent)
            unit = "" if row.unit == "1" else row.unit
            was = identified_text(row.identified, row.identified_std)
            table.add_row(row.name, was, f"{row.exported:.5g}", unit, percent, _FIDELITY_WORDS[row.held])
        console.print(table)
    print_findings(document.findings, verbose=verbose, page=FILE)


_MOST_NAMED, _MOST_SENTENCES = 8, 8
"""Quantities of a line, and sentences, that a normal run prints."""


def _quantity(row: ComparedDocument) -> str:
    """The name of a quantity, with its change where it has one."""
    from rotorid.exports.target import percent_text

    if row.held != "approximated" or row.difference_percent is None:
        return row.name
    return f"{row.name} ({percent_text(row.difference_percent)})"


def _more(rows: Sequence[str], verbose: bool) -> str:
    """How many of a line were left out."""
    left = len(rows) - len(fold(rows, verbose=verbose, most=_MOST_NAMED))
    return f", and {left} more (-v shows all)" if left else ""
