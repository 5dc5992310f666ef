"""``rotorid verify``: how well an identified model predicts other logs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rotorid.cli.command import carry_out
from rotorid.cli.console import default_folder
from rotorid.cli.options import ForPaper, Logs, Map, Output
from rotorid.settings.verifying import VerifySettings

if TYPE_CHECKING:
    from rotorid.documents.verify import VerifyDocument
    from rotorid.identifying.verification import Verified

FILE, REPORT = "verification.json", "report.html"


def verify_command(
    result: Annotated[Path, typer.Argument(help="A result of identify: its folder, result.json or model.toml.")],
    logs: Logs,
    *,
    settings: VerifySettings,
    map: Map = None,
    output: Output,
    paper: ForPaper,
) -> None:
    """Check how well an identified model predicts flights that it was not fitted to."""
    from rotorid.checking.candidate import read_candidate
    from rotorid.documents.verify import refused_verify_document, verify_document
    from rotorid.identifying.verification import refused_verification, verify
    from rotorid.report.publication import of_verification

    candidate = read_candidate(result)
    name = candidate.structure.name
    carry_out(
        logs,
        mapping=map,
        output=output,
        folder=default_folder(logs, f"verify-{name}"),
        file=FILE,
        compute=lambda records: verify(candidate, records, settings=settings),
        write=lambda folder, verified: _write(folder, verified, title=f"{name} on unseen flight"),
        refused=lambda error, records: refused_verify_document(
            refused_verification(error, records, candidate, settings=settings)
        ),
        document=verify_document,
        show=_print,
        paper=paper,
        publication=of_verification,
    )


def _write(folder: Path, verified: Verified, *, title: str) -> None:
    from rotorid.documents.verify import verify_document
    from rotorid.report.files import write_together
    from rotorid.report.verification import render_verification

    write_together(folder, {FILE: verify_document(verified), REPORT: render_verification(verified, title=title)})


def _print(document: VerifyDocument, folder: Path, *, verbose: bool = False) -> None:
    """Print the answer, scores of each maneuver, costs of each response, findings, and where the files are."""
    from rich.table import Table

    from rotorid.cli.console import print_findings, print_lines, print_table
    from rotorid.report.verification import j_rms_sentence, verification_summary

    print_lines(verification_summary(document), verbose=True)
    table = Table(box=None, pad_edge=False)
    for name in ("maneuver", "output"):
        table.add_column(name, justify="left")
    ahead = sorted({horizon.horizon_s for check in document.maneuvers for horizon in check.ahead})
    over = [f"TIC {horizon_s:.2g} s ahead" for horizon_s in ahead]
    for name in ("TIC", "fit %", *over, "good for s", "TIC closed loop", "verdict"):
        table.add_column(name, justify="left" if name == "verdict" else "right")
    rows = []
    for check in document.maneuvers:
        by_horizon = {horizon.horizon_s: horizon.outputs for horizon in check.ahead}
        for output, scores in check.scores.items():
            row_scores = [by_horizon.get(horizon_s, {}).get(output) for horizon_s in ahead]
            rows.append(
                (
                    f"{check.record}: {check.axis} {check.kind} at {check.start_s:.1f} s",
                    output if output in check.moved else f"({output})",
                    f"{scores.tic:.2f}",
                    f"{scores.nrmse_fit_percent:.0f}",
                    *("" if item is None else f"{item.tic:.2f}" for item in row_scores),
                    f"{check.holds_s[output]:.2g}" if output in check.holds_s else "",
                    f"{check.closed_loop.scores[output].tic:.2f}" if check.closed_loop else "",
                    check.verdict,
                )
            )
    if rows:
        print_table(table, rows, verbose=verbose, item="row")
    lines = []
    if any(check.verdict == "good" and 0.0 in check.holds_s.values() for check in document.maneuvers):
        lines.append(
            'The verdict is for the whole maneuver. Where "good for s" is 0, do not trust single predictions from one '
            "moment to the next."
        )
    aside = [check for check in document.maneuvers if set(check.scores) - set(check.moved)]
    if any(check.flight for check in aside):
        lines.append("Outputs in parentheses are not judged.")
    elif aside:
        lines.append("Outputs in parentheses moved too little to be judged.")
    # Accelerations of motors have none.
    if any(check.j_rms > 0.0 for check in document.maneuvers):
        lines.append(j_rms_sentence(document))
    for sweep in document.frequency:
        for pair, cost in sweep.pairs.items():
            low, high = cost.band_rad_s
            lines.append(
                f"{', '.join(sweep.records)}: {pair} cost {cost.value:.1f} over {low:.2g} to {high:.3g} rad/s "
                "(up to 100 is acceptable)"
            )
    print_lines(lines, verbose=verbose)
    print_findings(document.findings, verbose=verbose)
    print_lines([f"report: {folder / REPORT}", f"file: {folder / FILE}"], verbose=True)
