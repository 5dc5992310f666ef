"""``rotorid tune``: new gains from a flight or its models, with files to load and to go back."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rotorid.cli.command import carry_out
from rotorid.cli.console import default_folder, output_console, print_findings
from rotorid.cli.options import ForPaper, Map, Only, Output
from rotorid.data.display import capital
from rotorid.errors import UsageError
from rotorid.proposing.settings import TuneSettings
from rotorid.settings.option import Option

if TYPE_CHECKING:
    from rich.table import Table

    from rotorid.data.record import FlightRecord
    from rotorid.documents.tune import AxisTuneDocument, TuneDocument
    from rotorid.documents.tune_check import TuneCheckDocument
    from rotorid.plot.curves import Frequency
    from rotorid.proposing.proposal import TuningProposal
    from rotorid.results.model import IdentifiedModel

_FURTHER_DATA = ("room_not_checked", "plant_of_choice", "thrust_range")
"""Kinds of notes on data that would change the gains: a log, a result, or a fit of the motors."""


def tune_command(
    given: Annotated[
        list[Path],
        typer.Argument(
            metavar="RESULT|LOG...",
            help="Logs, or results of identify (rate.*, axis.*, hover.*), or both. Logs must contain the flown gains.",
        ),
    ],
    *,
    settings: TuneSettings,
    check: Annotated[
        Path | None,
        Option(
            "--check",
            "Compare these logs with the prediction in this folder of an earlier tune.",
            "Judging",
            metavar="PROPOSAL",
        ),
    ] = None,
    judge: Annotated[
        Path | None,
        Option(
            "--judge",
            "Judge the gains in this file: .params, .param, diff, dump, or lines such as roll: P=0.1 D=0.002 or climb: "
            "P=3.",
            "Judging",
            metavar="FILE",
        ),
    ] = None,
    map: Map = None,
    output: Output,
    paper: Annotated[ForPaper, Only("pdf")],
) -> None:
    """Propose better gains from a flight, with files to load into the autopilot and to go back."""
    from rotorid.documents.tune import TUNE, refused_tune_document, tune_document
    from rotorid.proposing.judging import load_gains
    from rotorid.proposing.proposal import refused_tuning, tune

    models, logs = _models_and_logs(given)
    if check is not None and judge is not None:
        raise UsageError("--check and --judge exclude each other", remedy="give one of them")
    foreign = None if judge is None else load_gains(judge)
    verdicts: list[str] = []

    def compute(records: Sequence[FlightRecord]) -> TuningProposal:
        proposal = tune(models, records, settings=settings, judge=foreign)
        verdicts.extend([proposal.judged.verdict] if proposal.judged is not None else [])
        return proposal

    if check is not None:
        _check(check, models, logs, settings, map, output, paper)
        return
    carry_out(
        logs,
        mapping=map,
        output=output,
        paper=paper,
        folder=default_folder(logs or given, "tune"),
        file=TUNE,
        compute=compute,
        write=lambda folder, proposal: _write(folder, proposal, given, output.out),
        refused=lambda error, records: refused_tune_document(
            refused_tuning(error, records, settings), judging="" if foreign is None else foreign.name
        ),
        document=tune_document,
        show=partial(_print, given=given),
    )
    # Scripts fly only what may fly.
    if any(verdict not in ("fly", "gently") for verdict in verdicts):
        raise typer.Exit(1)


def _check(
    proposal: Path,
    models: Sequence[IdentifiedModel],
    logs: Sequence[Path],
    settings: TuneSettings,
    map: Path | None,
    output: Output,
    paper: ForPaper,
) -> None:
    """Compare a flight with its prediction."""
    from rotorid.documents.tune_check import CHECK, load_foretold, refused_check_document, tune_check_document
    from rotorid.proposing.check import check_tuning
    from rotorid.proposing.proposal import refused_tuning
    from rotorid.report.files import write_tuning_check

    if not logs:
        raise UsageError("--check without a log", remedy="add the log of the flight with the new gains")
    foretold = load_foretold(proposal)
    carry_out(
        logs,
        mapping=map,
        output=output,
        paper=paper,
        folder=default_folder(logs, "check"),
        file=CHECK,
        compute=lambda records: check_tuning(foretold, records, models, settings=settings),
        write=lambda folder, found: write_tuning_check(
            folder, found, title=f"{', '.join(path.name for path in logs)} compared with {proposal.name}"
        ),
        refused=lambda error, records: refused_check_document(refused_tuning(error, records, settings)),
        document=tune_check_document,
        show=_print_check,
    )


def _models_and_logs(given: Sequence[Path]) -> tuple[list[IdentifiedModel], list[Path]]:
    """Results, loaded, and logs."""
    from rotorid.documents.results import is_result, load_results

    results = [path for path in given if is_result(path)]
    return load_results(results), [path for path in given if path not in results]


def _write(folder: Path, proposal: TuningProposal, given: Sequence[Path], out: Path | None) -> None:
    from rotorid.report.files import write_tuning

    logs = ", ".join(path.name for path in given)
    title = f"Gains from {logs}" if proposal.judged is None else f"{proposal.judged.source} judged on {logs}"
    # Without --out the folder is numbered if its name is taken, which is known only when it is written.
    write_tuning(folder, proposal, title=title, check_folder="" if out is None else shlex.quote(str(out)))


def _print(document: TuneDocument, folder: Path, *, given: Sequence[Path], verbose: bool = False) -> None:
    """New gains and what they bring, margins with a scale, and how to load, check and go back."""
    from rich.table import Table

    from rotorid.autopilots import named
    from rotorid.report.filters import choice_lines
    from rotorid.report.tune_words import (
        axis_sentences,
        following,
        headline,
        is_checked,
        judged_sentences,
        limit_sentences,
        margin_lines,
        missed_sentences,
        moving_d_sentence,
        next_flight,
        stricter_sentence,
    )

    console = output_console()

    def line(text: str, *, wrap: bool = True) -> None:
        console.print(text, highlight=False, markup=False, soft_wrap=not wrap)

    for sentence in judged_sentences(document):
        line(sentence)
    if document.judged is not None:
        line("\nGains that rotorid proposes:" if document.changed else "")
    for sentence in headline(document):
        line(sentence)
    for sentence, limits in axis_sentences(document):
        line(sentence)
        if limits:
            line(f"  {capital(limits)}")
    table = Table(box=None, pad_edge=False)
    for name in ("axis", "margin", "today", "new gains", "fine"):
        table.add_column(name, justify="right" if name in ("today", "new gains") else "left")
    margins = margin_lines(document)
    for margin in margins:
        table.add_row(margin.axis, margin.name, margin.today, margin.new, margin.fine)
    console.print()
    console.print(table)
    for missed in missed_sentences(margins):
        line(f"look here: {missed}")
    if stricter := stricter_sentence(document):
        line(stricter)
    if moving := moving_d_sentence(document):
        line(moving)
    for choice in choice_lines(document):
        line(choice)
    for sentence in limit_sentences(document) if verbose and document.axes else ():
        line(sentence)
    console.print()
    if verbose:
        _print_details(document)
    kinds = _FURTHER_DATA if verbose else ()
    for message in dict.fromkeys(finding.message for finding in document.findings if finding.kind in kinds):
        line(f"note: {message}")
    print_findings(document.findings, given, verbose=verbose)
    if flight := next_flight(document):
        line(f"next: {flight}{' Then check that flight:' if is_checked(document) else ''}")
        if is_checked(document):
            line(f"  rotorid tune NEW_LOG --check {shlex.quote(str(folder))}", wrap=False)
    if further := following(document):
        line(f"  {further}")
    if document.files:
        line(f"load: {named(document.autopilot).loading}")
    for name in document.files:
        line(f"  {folder / name}", wrap=False)
    line("go back:")
    for name in document.rollback_files:
        line(f"  {folder / name}", wrap=False)
    line(f"report: {folder / 'report.html'}", wrap=False)


def _print_details(document: TuneDocument) -> None:
    """All parameters of each axis, the flights to the best gains, and the limits."""
    from rich.table import Table

    from rotorid.report.frame import frequency_of
    from rotorid.report.tune_words import balance_sentence, path_sentence

    console = output_console()
    for axis, tuning in document.axes.items():
        table = Table(title=axis, title_justify="left", box=None, pad_edge=False)
        for name in ("parameter", "today", "new"):
            table.add_column(name, justify="left" if name == "parameter" else "right")
        for name, gain in tuning.gains.items():
            text = "unchanged" if gain.flown == gain.proposed else f"{gain.proposed:.4g}"
            table.add_row(name, f"{gain.flown:.4g}", text)
        console.print(table)
        if balance := balance_sentence(axis, tuning):
            console.print(balance, highlight=False, markup=False)
        if tuning.path:
            console.print(_path_table(axis, tuning, frequency_of([document.autopilot])))
            console.print(path_sentence(tuning.path, axis), highlight=False, markup=False)
    if (thrust := document.thrust) is not None and thrust.flown != thrust.proposed:
        line = f"{thrust.parameter}: {thrust.flown:g} → {thrust.proposed:g} would linearize thrust (file thrust)"
        console.print(line, highlight=False, markup=False)


def _print_check(document: TuneCheckDocument, folder: Path, *, verbose: bool = False) -> None:
    """Whether the flight is as predicted, what to do next, and the margins, predicted and measured."""
    from rich.table import Table

    from rotorid.documents.tune_check import METHODS, compared_words
    from rotorid.report.frame import frequency_of
    from rotorid.report.tune_words import row_numbers, row_words
    from rotorid.tuning.kinds import loop_words

    console, unit = output_console(), frequency_of(document.provenance.inputs)
    for axis, checked in document.axes.items():
        console.print(f"{capital(axis)}: {checked.sentence} {checked.advice}", highlight=False, markup=False)
    console.print()
    table = Table(box=None, pad_edge=False)
    for name in ("axis", "margin", "predicted", "measured", *(("measured by",) if verbose else ()), "result"):
        table.add_column(name, justify="right" if name in ("predicted", "measured") else "left")
    for axis, checked in document.axes.items():
        for row in checked.figures:
            words = f"{row_words(row.name, unit)}, {loop_words(axis)[row.loop]}"
            numbers = (row_numbers(row.name, row.foretold, unit), row_numbers(row.name, row.measured, unit))
            table.add_row(axis, words, *numbers, *((METHODS[row.method],) if verbose else ()), compared_words(row))
    console.print(table)
    # The verdict of an axis is a finding too, with the same words.
    verdicts = {f"{capital(axis)}: {checked.sentence} {checked.advice}" for axis, checked in document.axes.items()}
    print_findings([finding for finding in document.findings if finding.message not in verdicts], verbose=verbose)
    console.print(f"report: {folder / 'report.html'}", soft_wrap=True, markup=False)


def _path_table(axis: str, tuning: AxisTuneDocument, unit: Frequency) -> Table:
    """Gains and predicted margins of each flight to the best gains."""
    from rich.table import Table

    from rotorid.report.tune_words import PATH_MARGINS, row_numbers, row_words, step_name

    names = list(tuning.path[0].gains)
    table = Table(
        title=f"flights to the best gains of {axis}, with angle loop", title_justify="left", box=None, pad_edge=False
    )
    table.add_column("flight")
    for name in (*names, *(row_words(name, unit) for name in PATH_MARGINS), "attitude error"):
        table.add_column(name, justify="right")
    for step in tuning.path:
        table.add_row(
            step_name(step),
            *(f"{step.gains[name]:.4g}" for name in names),
            *(row_numbers(name, step.whole[name], unit) if name in step.whole else "" for name in PATH_MARGINS),
            f"{100.0 * step.attitude_ratio.value:.0f} %",
        )
    return table
