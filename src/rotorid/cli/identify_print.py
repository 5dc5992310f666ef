"""A result of ``rotorid identify`` for a person."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from rotorid.cli.console import output_console, print_findings

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rich.table import Table

    from rotorid.pipeline.document import ParameterDocument, ResultDocument


def print_result(document: ResultDocument, folder: Path) -> None:
    """Parameters, cost, checks, findings, where the files are."""
    console = output_console()
    console.print(_table(document))
    for line in (*_motors(document), *_fit(document), *_repeated(document), *_verified(document)):
        console.print(line)
    for combination in document.identifiability:
        console.print(combination.words, markup=False)
    print_findings(document.findings)
    console.print(f"report: {folder / 'report.html'}", soft_wrap=True, markup=False)


def _table(document: ResultDocument) -> Table:
    from rich.table import Table

    again = document.bootstrap
    table = Table(title=document.model, title_justify="left", box=None, pad_edge=False)
    table.add_column("parameter")
    table.add_column("value", justify="right")
    table.add_column("± std", justify="right")
    if again is not None:
        table.add_column("bootstrap", justify="right")
    table.add_column("unit")
    for name in ("CR %", "I %"):
        table.add_column(name, justify="right")
    table.add_column("")
    for name, parameter in document.parameters.items():
        if parameter.status == "dropped":
            continue
        spread = [] if again is None else [f"{again.parameters[name].std:.2g}" if name in again.parameters else ""]
        table.add_row(name, *_numbers(parameter), *spread, parameter.unit, *_percents(parameter), parameter.status)
    return table


def _numbers(parameter: ParameterDocument) -> tuple[str, str]:
    return f"{parameter.value:.5g}", "" if parameter.std is None else f"{parameter.std:.2g}"


def _percents(parameter: ParameterDocument) -> tuple[str, str]:
    both = parameter.cramer_rao_percent, parameter.insensitivity_percent
    cramer_rao, insensitivity = ("" if percent is None else f"{percent:.0f}" for percent in both)
    return cramer_rao, insensitivity


def _motors(document: ResultDocument) -> Iterator[str]:
    """Thrust, and what set the scale of a vehicle."""
    if document.motors is None:
        return
    words = {
        "thrust_hover": "thrust of a rotor at the mean output",
        "thrust_slope": "its slope",
        "thrust_full": "at full output",
        "thrust_to_weight": "full thrust over weight",
    }
    told = [
        f"{words[name]} {one.value:.4g} ± {one.std:.2g}{'' if one.unit == '1' else ' ' + one.unit}"
        for name, one in document.motors.derived.items()
    ]
    yield ", ".join(told)
    yield f"rotors {document.motors.layout}, {document.motors.curve} thrust of {document.motors.source}"


def _fit(document: ResultDocument) -> Iterator[str]:
    """What was left out, and how well the rest fits."""
    if dropped := [name for name, parameter in document.parameters.items() if parameter.status == "dropped"]:
        yield f"dropped: {', '.join(dropped)}"
    if document.cost is not None:
        for pair, cost in document.cost.pairs.items():
            low, high = cost.band_rad_s
            yield f"cost of {pair} {cost.value:.1f} over {low:.2g} to {high:.3g} rad/s (up to 50 is excellent)"
    if document.fit_percent:
        fits = ", ".join(f"{name} {percent:.1f} %" for name, percent in document.fit_percent.items())
        yield f"{document.method.replace('_', ' ')}, {document.hold}-order hold; explained: {fits}"


def _repeated(document: ResultDocument) -> Iterator[str]:
    """Searches and bootstraps."""
    if (search := document.search) is not None:
        minima = "1 minimum" if len(search.minima) == 1 else f"{len(search.minima)} minima"
        yield (
            f"search by {search.name}: {search.evaluations} evaluations and {search.local_searches} local searches, "
            f"{minima}, the lowest at a cost of {search.minima[0].cost:.5g}"
        )
    if (again := document.bootstrap) is not None:
        left = sum(again.left_out.values())
        without = f", {left} without an answer" if left else ""
        yield f"bootstrap: standard deviations over {again.runs} refits to noise drawn anew{without}"


def _verified(document: ResultDocument) -> Iterator[str]:
    """What the model does on unseen data."""
    for record, outputs in document.verification.records.items():
        scores = ", ".join(f"{name} TIC {s.tic:.2f}, fit {s.nrmse_fit_percent:.0f} %" for name, s in outputs.items())
        yield f"unseen {record}: {scores}"
    for record, cost_value in document.verification.frequency.items():
        yield f"unseen {record}: cost {cost_value:.1f}"
    if (crossed := document.cross_validation) is not None and crossed.mean_percent is not None:
        spread = "" if crossed.spread_percent is None else f" ± {crossed.spread_percent:.1f}"
        ahead = "" if crossed.horizon_s is None else f", {crossed.horizon_s:.2g} s ahead"
        yield f"cross-validated on unseen records{ahead}: {crossed.mean_percent:.1f}{spread} %"
        if crossed.best is not None:
            yield f"best record to identify on: {crossed.best.record}, {crossed.best.mean_percent:.1f} % (optimistic)"
