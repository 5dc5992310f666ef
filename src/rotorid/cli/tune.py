"""``rotorid tune``: from a flight or its models to gains that hold, and to the files that bring them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rotorid.cli.command import carry_out
from rotorid.cli.console import default_folder, output_console, print_findings
from rotorid.cli.options import ForPaper, Map, Only, Output
from rotorid.data.quantities import QUANTITIES
from rotorid.errors import UsageError
from rotorid.proposing.settings import TuneSettings
from rotorid.settings.option import Option

if TYPE_CHECKING:
    from rich.table import Table

    from rotorid.documents.tune import AxisTuneDocument, TuneDocument
    from rotorid.documents.tune_check import TuneCheckDocument
    from rotorid.proposing.proposal import TuningProposal
    from rotorid.results.model import IdentifiedModel

_FURTHER_DATA = ("room_not_checked", "plant_of_choice", "thrust_range")
"""Kinds of remarks that say what a log, a result or a fit of motors adds to the gains, or what is missing of it."""


def tune_command(
    given: Annotated[
        list[Path],
        typer.Argument(
            metavar="RESULT|LOG...",
            help="Results of identify --model rate.*, and logs whose parameters say which gains flew; logs alone are "
            "identified.",
        ),
    ],
    *,
    settings: TuneSettings,
    check: Annotated[
        Path | None,
        Option(
            "--check", "Folder that tune wrote: whether these logs fly as it foretold.", "Judging", metavar="PROPOSAL"
        ),
    ] = None,
    map: Map = None,
    output: Output,
    paper: Annotated[ForPaper, Only("pdf")],
) -> None:
    """Propose gains that hold for every likely plant, and write files for the autopilot with a way back."""
    from rotorid.documents.tune import TUNE, refused_tune_document, tune_document
    from rotorid.proposing.proposal import refused_tuning, tune

    models, logs = _models_and_logs(given)
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
        compute=lambda records: tune(models, records, settings=settings),
        write=lambda folder, proposal: _write(folder, proposal, given),
        refused=lambda error, records: refused_tune_document(refused_tuning(error, records, settings)),
        document=tune_document,
        show=partial(_print, given=given),
    )


def _check(
    proposal: Path,
    models: Sequence[IdentifiedModel],
    logs: Sequence[Path],
    settings: TuneSettings,
    map: Path | None,
    output: Output,
    paper: ForPaper,
) -> None:
    """Compare a flight with what was foretold of it."""
    from rotorid.documents.tune_check import CHECK, load_foretold, refused_check_document, tune_check_document
    from rotorid.proposing.check import check_tuning
    from rotorid.proposing.proposal import refused_tuning
    from rotorid.report.files import write_tuning_check

    if not logs:
        raise UsageError("--check came without a log", needed="logs of the flight with the proposed gains")
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
            folder, found, title=f"{', '.join(path.name for path in logs)} beside {proposal.name}"
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


def _write(folder: Path, proposal: TuningProposal, given: Sequence[Path]) -> None:
    from rotorid.report.files import write_tuning

    write_tuning(folder, proposal, title=f"Gains from {', '.join(path.name for path in given)}")


def _print(document: TuneDocument, folder: Path, *, given: Sequence[Path], verbose: bool = False) -> None:
    """Gains flown and proposed, margins, the path to the goal, findings, where the files are."""
    from rich.table import Table

    from rotorid.documents.tune import LIMIT_IS_KEPT, path_sentence

    console = output_console()
    for axis, tuning in document.axes.items():
        table = Table(title=axis, title_justify="left", box=None, pad_edge=False)
        for name in ("parameter", "flown", "proposed"):
            table.add_column(name, justify="left" if name == "parameter" else "right")
        for name, gain in tuning.gains.items():
            text = "stays" if gain.flown == gain.proposed else f"{gain.proposed:.4g}"
            table.add_row(name, f"{gain.flown:.4g}", text)
        console.print(table)
        for line in _lines(tuning):
            console.print(line, highlight=False, markup=False)
        if tuning.path:
            console.print(_path_table(axis, tuning))
            console.print(path_sentence(tuning), highlight=False, markup=False)
    if (thrust := document.thrust) is not None and thrust.flown != thrust.proposed:
        line = (
            f"{thrust.parameter}: {thrust.flown:g} -> {thrust.proposed:g} would straighten thrust, by a file of its own"
        )
        console.print(line, highlight=False, markup=False)
    if document.robustness:
        limit = f"limit: {document.robustness}; {LIMIT_IS_KEPT}"
        console.print(limit, highlight=False, markup=False)
    for message in dict.fromkeys(finding.message for finding in document.findings if finding.kind in _FURTHER_DATA):
        console.print(f"note: {message}", highlight=False, markup=False)
    print_findings(document.findings, given, verbose=verbose)
    for name in (*document.files, *document.rollback_files):
        console.print(f"file: {folder / name}", soft_wrap=True, markup=False)
    console.print(f"report: {folder / 'report.html'}", soft_wrap=True, markup=False)


def _print_check(document: TuneCheckDocument, folder: Path, *, verbose: bool = False) -> None:
    """Figures foretold and measured, what came of it, and what to do next."""
    from rich.table import Table

    from rotorid.documents.tune_check import METHODS, compared_words

    console = output_console()
    for axis, checked in document.axes.items():
        table = Table(title=axis, title_justify="left", box=None, pad_edge=False)
        for name in ("figure", "foretold", "measured", "by", ""):
            table.add_column(name, justify="right" if name in ("foretold", "measured") else "left")
        for row in checked.figures:
            words = f"{_head(row.name)}, {'rate loop' if row.loop == 'rate' else 'with the angle loop'}"
            figure, result = QUANTITIES[row.name], compared_words(row)
            measured = (figure.with_ends(row.foretold), figure.with_ends(row.measured), METHODS[row.method])
            table.add_row(words, *measured, "" if result == "as foretold" else result)
        console.print(table)
        console.print(f"{checked.sentence} {checked.advice}", highlight=False, markup=False)
    print_findings(document.findings, verbose=verbose)
    console.print(f"report: {folder / 'report.html'}", soft_wrap=True, markup=False)


def _path_table(axis: str, tuning: AxisTuneDocument) -> Table:
    """Gains and foretold margins of each flight to the goal."""
    from rich.table import Table

    from rotorid.documents.tune import step_name

    names = list(tuning.path[0].gains)
    table = Table(title=f"path of {axis}", title_justify="left", box=None, pad_edge=False)
    table.add_column("flight")
    for name in (*names, *map(_head, _PATH), "attitude error"):
        table.add_column(name, justify="right")
    for step in tuning.path:
        table.add_row(
            step_name(step),
            *(f"{step.gains[name]:.4g}" for name in names),
            *(QUANTITIES[name].with_ends(step.whole[name]) if name in step.whole else "" for name in _PATH),
            f"{100.0 * step.attitude_ratio.value:.0f} %",
        )
    return table


_PATH = ("sensitivity_peak", "crossover_rad_s", "phase_margin_deg")
_COMPARED = ("sensitivity_peak", "phase_margin_deg", "crossover_rad_s")


def _head(name: str) -> str:
    row = QUANTITIES[name]
    return f"{row.before} in {row.unit}" if row.unit else row.before


def _lines(tuning: AxisTuneDocument) -> list[str]:
    """Why gains stay or what binds them, and margins of both loops before and after."""
    from rotorid.documents.tune import end_of

    lines = [f"{'bound' if tuning.changed else 'stays'}: {'; '.join(tuning.reasons)}"] if tuning.reasons else []
    where = end_of(tuning)
    for loop, before, after in (
        (f"rate loop{where and ', '}{where}", tuning.flown, tuning.proposed),
        ("with the angle loop", tuning.flown_whole, tuning.proposed_whole),
    ):
        texts = [
            f"{_head(name)} {QUANTITIES[name].with_ends(before[name]) if name in before else 'unknown'}"
            + (f" -> {QUANTITIES[name].with_ends(after[name])}" if tuning.changed else "")
            for name in _COMPARED
            if name in after
        ]
        lines.append(f"{loop}: {', '.join(texts)}")
    if tuning.changed:
        lines.append(
            f"attitude error under a disturbance: {100.0 * tuning.attitude_ratio.value:.0f} % of what it was; noise of "
            f"the command: {100.0 * tuning.noise_ratio:.0f} % of what it was"
        )
    return lines
