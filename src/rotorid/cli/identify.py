"""``rotorid identify``: logs in, a model with bounds, verified, out."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rotorid.cli.console import progress, say_refused
from rotorid.cli.measure_options import channel_names, measure_choices
from rotorid.cli.names import default_folder
from rotorid.cli.options import (
    Band,
    Coherence,
    CrossValidate,
    Decoupled,
    Estimate,
    Hold,
    Instrument,
    Json,
    Logs,
    Map,
    Method,
    Out,
    Pieces,
    Quiet,
    Seed,
    Segments,
    Shifts,
    Starts,
    Windows,
)

if TYPE_CHECKING:
    from rotorid.data.record import FlightRecord
    from rotorid.models.structure import LinearStructure
    from rotorid.pipeline.document import ResultDocument


def identify_command(
    logs: Logs,
    model: Annotated[
        str, typer.Option("--model", help="hover.longitudinal, rate.roll, ... (see rotorid models), or FILE.toml.")
    ],
    method: Method = "auto",
    band: Band = None,
    windows: Windows = None,
    coherence: Coherence = None,
    estimate: Estimate = "auto",
    instrument: Instrument = None,
    fix: Annotated[list[str] | None, typer.Option("--fix", help="NAME=VALUE to hold. Repeatable.")] = None,
    tie: Annotated[
        list[str] | None, typer.Option("--tie", help="NAME=EXPRESSION, a parameter that follows others. Repeatable.")
    ] = None,
    free: Annotated[
        list[str] | None, typer.Option("--free", help="NAME of a parameter that the model holds. Repeatable.")
    ] = None,
    constant: Annotated[
        list[str] | None, typer.Option("--constant", help="NAME=VALUE of a constant, such as the trim. Repeatable.")
    ] = None,
    outputs: Annotated[str | None, typer.Option("--outputs", help="CHANNEL,... to fit. [default: sensors]")] = None,
    inputs: Annotated[
        str | None, typer.Option("--inputs", help="CHANNEL,... of response.*, transfer:m/n and black_box:N.")
    ] = None,
    decoupled: Decoupled = False,
    pair: Annotated[
        list[str] | None, typer.Option("--pair", help="OUTPUT/INPUT[:LO:HI] to fit, and no others. Repeatable.")
    ] = None,
    weight: Annotated[
        list[str] | None, typer.Option("--weight", help="OUTPUT/INPUT=FACTOR on its cost. Repeatable.")
    ] = None,
    weights: Annotated[
        str, typer.Option("--weights", help="cifer, covariance (of all errors), or auto: by the number of outputs.")
    ] = "auto",
    reduce: Annotated[bool, typer.Option("--reduce", help="Drop step by step what the data do not show.")] = False,
    speed_damping: Annotated[
        str, typer.Option("--speed-damping", help="joint, or two_step: X_u and Y_v before all else.")
    ] = "joint",
    hold: Hold = "auto",
    starts: Starts = "default",
    pieces: Pieces = None,
    cross_validate: CrossValidate = None,
    segment: Segments = None,
    shift: Shifts = None,
    verify: Annotated[
        list[Path] | None, typer.Option("--verify", help="A log kept unseen, to judge the model on. Repeatable.")
    ] = None,
    map: Map = None,
    seed: Seed = 0,
    out: Out = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Identify a model from flight logs: responses, bounds, verification, report."""
    from rotorid.errors import InsufficientDataError
    from rotorid.io.registry import read
    from rotorid.pipeline.identify import identify, refused
    from rotorid.pipeline.resolve import finds_its_channels, require_known, resolve_model
    from rotorid.pipeline.settings import (
        IdentifySettings,
        parse_fix,
        parse_pairs,
        parse_ties,
    )
    from rotorid.pipeline.time_crossed import cross_validated, parse_kind
    from rotorid.report.output import to_json, write_results

    settings = IdentifySettings(
        **measure_choices(
            band=band,
            windows=windows,
            coherence=coherence,
            estimate=estimate,
            instrument=instrument,
            segment=segment,
            shift=shift,
            seed=seed,
        ),
        fix=parse_fix(tuple(fix or ())),
        ties=parse_ties(tuple(tie or ())),
        free=tuple(free or ()),
        constants=parse_fix(tuple(constant or ())),
        outputs=channel_names(outputs),
        pairs=parse_pairs(tuple(pair or ())),
        pair_weights=parse_fix(tuple(weight or ())),
        weights=weights,  # type: ignore[arg-type]
        reduce=reduce,
        speed_damping=speed_damping,  # type: ignore[arg-type]
        method=method,  # type: ignore[arg-type]
        hold=hold,  # type: ignore[arg-type]
        starts=starts,
        pieces_s=pieces,
    )
    kind = parse_kind(cross_validate)
    channels = channel_names(inputs), channel_names(outputs)
    wanted: str | LinearStructure = model
    if not finds_its_channels(model, channels[0]):
        wanted = resolve_model(model, inputs=channels[0], outputs=channels[1], decoupled=decoupled)
        require_known(wanted, settings)
    name = wanted if isinstance(wanted, str) else wanted.name
    folder = out or default_folder(logs[0], name)
    command = ["rotorid", *sys.argv[1:]]
    records: list[FlightRecord] = []
    try:
        with progress(quiet=quiet) as tell:
            for log in logs:
                tell(f"reading {log.name}")
                records.append(read(log, mapping=map))
            others = [read(log, mapping=map) for log in verify or ()]
            result = identify(records, wanted, settings=settings, verify=others, command=command, progress=tell)
            if kind is not None:
                result = cross_validated(result, records, wanted, kind=kind, settings=settings, progress=tell)
            tell("writing the report")
            write_results(folder, result, title=f"{name} from {', '.join(log.name for log in logs)}")
    except InsufficientDataError as error:
        document = refused(error, records, wanted, settings=settings, command=command)
        if json:
            sys.stdout.write(to_json(document))
        say_refused(error, document.findings, folder / "result.json", quiet=quiet)
        raise typer.Exit(1) from None
    if json:
        sys.stdout.write(to_json(result.document))
    elif not quiet:
        print_result(result.document, folder)


def print_result(document: ResultDocument, folder: Path) -> None:
    """A result for a person: parameters, cost, checks, findings, where the files are."""
    from rich.table import Table

    from rotorid.cli.console import output_console, print_findings

    console = output_console()
    table = Table(title=document.model, title_justify="left", box=None, pad_edge=False)
    for name, justify in (("parameter", "left"), ("value", "right"), ("± std", "right"), ("unit", "left")):
        table.add_column(name, justify=justify)  # type: ignore[arg-type]
    for name, justify in (("CR %", "right"), ("I %", "right"), ("", "left")):
        table.add_column(name, justify=justify)  # type: ignore[arg-type]
    for name, parameter in document.parameters.items():
        if parameter.status == "dropped":
            continue
        table.add_row(
            name,
            f"{parameter.value:.5g}",
            "" if parameter.std is None else f"{parameter.std:.2g}",
            parameter.unit,
            "" if parameter.cramer_rao_percent is None else f"{parameter.cramer_rao_percent:.0f}",
            "" if parameter.insensitivity_percent is None else f"{parameter.insensitivity_percent:.0f}",
            parameter.status,
        )
    console.print(table)
    dropped = [name for name, parameter in document.parameters.items() if parameter.status == "dropped"]
    if dropped:
        console.print(f"dropped: {', '.join(dropped)}")
    if document.cost is not None:
        for pair, cost in document.cost.pairs.items():
            low, high = cost.band_rad_s
            console.print(f"cost of {pair} {cost.value:.1f} over {low:.2g} to {high:.3g} rad/s (up to 50 is excellent)")
    if document.fit_percent:
        fits = ", ".join(f"{name} {percent:.1f} %" for name, percent in document.fit_percent.items())
        console.print(f"{document.method.replace('_', ' ')}, {document.hold}-order hold; explained: {fits}")
    for record, outputs in document.verification.records.items():
        scores = ", ".join(f"{name} TIC {s.tic:.2f}, fit {s.nrmse_fit_percent:.0f} %" for name, s in outputs.items())
        console.print(f"unseen {record}: {scores}")
    for record, cost_value in document.verification.frequency.items():
        console.print(f"unseen {record}: cost {cost_value:.1f}")
    if (crossed := document.cross_validation) is not None and crossed.mean_percent is not None:
        spread = "" if crossed.spread_percent is None else f" ± {crossed.spread_percent:.1f}"
        ahead = "" if crossed.horizon_s is None else f", {crossed.horizon_s:.2g} s ahead"
        console.print(f"cross-validated on unseen records{ahead}: {crossed.mean_percent:.1f}{spread} %")
        if crossed.best is not None:
            console.print(
                f"best record to identify on: {crossed.best.record}, {crossed.best.mean_percent:.1f} % (optimistic)"
            )
    for combination in document.identifiability:
        console.print(combination.words, markup=False)
    print_findings(document.findings)
    console.print(f"report: {folder / 'report.html'}", soft_wrap=True, markup=False)
