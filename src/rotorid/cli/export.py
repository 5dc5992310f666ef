"""``rotorid export``: results of identifications in, files of simulators and tools out."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rotorid.cli.command import command_line
from rotorid.cli.console import (
    default_folder,
    log_progress,
    output_console,
    print_findings,
    print_lines,
    print_table,
    progress,
)
from rotorid.cli.options import Output
from rotorid.errors import UsageError
from rotorid.exports.settings import DrawSettings, ExportSettings, TargetSettings

if TYPE_CHECKING:
    from rotorid.documents.export import DrawsDocument, ExportDocument
    from rotorid.exports.target import Exported
    from rotorid.flying.vehicle_from_results import JoinedVehicle
    from rotorid.results.model import IdentifiedModel

FILE = "export.json"
_MOST_LINES = 3


def export_command(
    results: Annotated[
        list[Path],
        typer.Argument(help="Results of identify: folders or result.json; several are joined into one vehicle."),
    ],
    *,
    what: TargetSettings,
    form: Annotated[dict[str, Any], ExportSettings],
    drawn: DrawSettings,
    output: Output,
) -> None:
    """Write an identified vehicle for a simulator or a tool, and list what its files keep."""
    from rotorid.documents.base import to_json
    from rotorid.documents.results import load_results
    from rotorid.exports.exporting import export, joined
    from rotorid.io.folders import making, target_folder
    from rotorid.report.files import result_kind

    choices = _settings(form)
    default = default_folder(results, f"export-{what.to}")
    target = target_folder(output.out, default, result_kind(FILE), force=output.force)
    with progress(quiet=output.quiet):
        models = load_results(results)
        vehicle = joined(models, choices, given=what.given, layout=what.layout)
        exported = export(vehicle, what.to, choices)
        more, counted = _drawn(models, what, choices, drawn)
        files = _files(exported, more)
        document = _document(vehicle, exported, choices, files, counted)
        text = to_json(document)
        with making(target) as made:
            _write(made.place, {**files, FILE: text})
    if output.json:
        sys.stdout.write(text)
    elif not output.quiet:
        _print(document, made.folder, verbose=output.verbose)


def _settings(given: dict[str, Any]) -> ExportSettings:
    """What was chosen: an order makes states of the delay."""
    if "pade_order" in given:
        if "delay" in given:
            raise UsageError("--delay-as-lag and --pade exclude each other", remedy="use one of them")
        given["delay"] = "states"
    return ExportSettings(**given)


def _drawn(
    models: Sequence[IdentifiedModel], what: TargetSettings, choices: ExportSettings, drawn: DrawSettings
) -> tuple[list[Exported], DrawsDocument | None]:
    """Further vehicles, drawn from the covariance of the results."""
    from rotorid.documents.export import DrawsDocument
    from rotorid.exports.exporting import export_draws

    if not drawn.draws:
        return [], None
    log_progress(f"drawing {drawn.draws} vehicles")
    vehicles, redrawn = export_draws(
        models, what.to, choices, drawn.draws, seed=drawn.seed, given=what.given, layout=what.layout
    )
    return vehicles, DrawsDocument(count=drawn.draws, seed=drawn.seed, redrawn=redrawn)


def _files(exported: Exported, drawn: Sequence[Exported]) -> dict[str, str | bytes]:
    """All files by their paths, those of draws in numbered folders."""
    files = dict(exported.files)
    digits = len(str(len(drawn)))
    for number, item in enumerate(drawn, start=1):
        files |= {f"draws/{number:0{digits}}/{name}": content for name, content in item.files.items()}
    written: dict[str, str] = {FILE.lower(): FILE}
    for name in files:
        if (other := written.setdefault(name.lower(), name)) != name or name == FILE:
            raise UsageError(
                f"{name} and {other} would be one file", needed="names that differ", remedy="choose another with --name"
            )
    return files


def _document(
    vehicle: JoinedVehicle,
    exported: Exported,
    choices: ExportSettings,
    files: Mapping[str, str | bytes],
    draws: DrawsDocument | None,
) -> ExportDocument:
    from rotorid.data.findings import worst_first
    from rotorid.documents.base import FindingDocument
    from rotorid.documents.export import ComparedDocument, ExportDocument, file_documents, finite, number_documents

    findings = worst_first([*vehicle.findings, *exported.findings])
    return ExportDocument(
        target=exported.target,
        name=choices.names,
        results=[model.name for model in vehicle.models],
        delay=choices.delay,
        pade_order=choices.pade_order if choices.delay == "states" else None,
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
        defaults=number_documents(exported.defaults),
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


_FIDELITY_WORDS = {"exact": "exact", "approximated": "approximated", "not": "[dim]left out[/dim]"}


def _print(document: ExportDocument, folder: Path, *, verbose: bool = False) -> None:
    """Print what the files keep, what was given or taken from defaults, what was left out, and how to start."""
    from rich.table import Table

    from rotorid.exports.target import identified_text, percent_text

    console = output_console()

    def plain(text: str) -> None:
        console.print(text, markup=False, soft_wrap=True, highlight=False)

    table = Table(title=f"{document.name} to {document.target}", title_justify="left", box=None, pad_edge=False)
    for column, side in (("quantity", "left"), ("identified", "right"), ("exported", "right"), ("unit", "left")):
        table.add_column(column, justify=side)  # type: ignore[arg-type]
    table.add_column("difference", justify="right")
    table.add_column("kept")
    rows = []
    for row in document.quantities:
        percent = "" if row.difference_percent is None else percent_text(row.difference_percent)
        unit = "" if row.unit == "1" else row.unit
        was = identified_text(row.identified, row.identified_std)
        rows.append((row.name, was, f"{row.exported:.5g}", unit, percent, _FIDELITY_WORDS[row.held]))
    if rows:
        print_table(table, rows, verbose=verbose, item="quantity", page=FILE)
    for title, numbers in (("given", document.given), ("default", document.defaults)):
        lines = [
            f"{title}: {name} = {number.value:.5g}{'' if number.unit == '1' else f' {number.unit}'}"
            f"{f' ({number.of})' if number.of else ''}"
            for name, number in numbers.items()
        ]
        print_lines(lines, verbose=verbose, item=f"{title} value", most=_MOST_LINES, page=FILE)
    sentences = [f"left out: {sentence}" for sentence in document.left_out]
    print_lines(sentences, verbose=verbose, item="note", most=_MOST_LINES, page=FILE)
    if document.draws is not None:
        redrawn = document.draws.redrawn
        plain(f"drawn: {document.draws.count} vehicles in draws; {redrawn} implausible draws were repeated")
    print_findings(document.findings, verbose=verbose, most=_MOST_LINES, page=FILE)
    plain(f"\nstart:\n{document.start}")
    plain(f"files: {folder}")
