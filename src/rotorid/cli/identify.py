"""``rotorid identify``: logs in, a model with bounds, verified, out.

The work behind ``rotorid identify``, once its options are read.

A result of ``rotorid identify`` for a person.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from rotorid.cli.console import default_folder, output_console, print_findings, progress, say_refused
from rotorid.cli.options import (
    Arm,
    Band,
    Bootstrap,
    Coherence,
    CrossValidate,
    Curve,
    Decoupled,
    Estimate,
    Evaluations,
    Hold,
    Instrument,
    Json,
    Layout,
    Logs,
    Map,
    Method,
    Out,
    Pieces,
    Quiet,
    RotorDiameter,
    Search,
    Seed,
    Segments,
    Shifts,
    Starts,
    Windows,
    channel_names,
    measure_choices,
    motor_choices,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rich.table import Table

    from rotorid.data.record import FlightRecord
    from rotorid.documents.result import ParameterDocument, ResultDocument
    from rotorid.models.structure import LinearStructure
    from rotorid.pipeline.results import Identification
    from rotorid.pipeline.settings import IdentifySettings, MotorChoices
    from rotorid.verification.fixed_parameters import Kind


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


class Job(NamedTuple):
    """What is to be identified, from what, and where the answer goes.

    Parameters
    ----------
    logs, unseen
        Files to identify on, and to judge the model on.
    mapping
        What names the channels of other sources.
    model
        A structure, or the name of one that finds its channels in the logs.
    settings
        Choices of the run.
    motors
        Those of ``physical.motors``, ``None`` for another model.
    kind
        Of a cross-validation, ``None`` for none.
    folder
        For the files.
    json, quiet
        What to say.
    """

    logs: list[Path]
    unseen: list[Path]
    mapping: Path | None
    model: str | LinearStructure
    settings: IdentifySettings
    motors: MotorChoices | None
    kind: Kind | None
    folder: Path
    json: bool
    quiet: bool

    @property
    def name(self) -> str:
        """Of the model."""
        return self.model if isinstance(self.model, str) else self.model.name


def run_identify(job: Job) -> None:
    """Identify, write the files and say what was found.

    Raises
    ------
    typer.Exit
        With code 1: the data cannot support the model.
    """
    from rotorid.errors import InsufficientDataError
    from rotorid.pipeline.identification import refused
    from rotorid.report.files import to_json, write_results

    records: list[FlightRecord] = []
    try:
        with progress(quiet=job.quiet) as tell:
            result = _identified(job, records, tell)
            tell("writing the report")
            title = f"{job.name} from {', '.join(log.name for log in job.logs)}"
            write_results(job.folder, result, title=title)
    except InsufficientDataError as error:
        document = refused(error, records, job.model, settings=job.settings, command=_command())
        if job.json:
            sys.stdout.write(to_json(document))
        say_refused(error, document.findings, job.folder / "result.json", quiet=job.quiet)
        raise typer.Exit(1) from None
    if job.json:
        sys.stdout.write(to_json(result.document))
    elif not job.quiet:
        print_result(result.document, job.folder)


def _identified(job: Job, records: list[FlightRecord], tell: Callable[[str], None]) -> Identification:
    """The result; ``records`` fill up as they are read, so that a refusal can tell of them."""
    from rotorid.io.registry import read
    from rotorid.pipeline.cross_validation import cross_validated
    from rotorid.pipeline.identification import identify

    for log in job.logs:
        tell(f"reading {log.name}")
        records.append(read(log, mapping=job.mapping))
    unseen = [read(log, mapping=job.mapping) for log in job.unseen]
    if job.motors is not None:
        from rotorid.pipeline.motor_identification import identify_motors

        return identify_motors(records, job.motors, verify=unseen, command=_command())
    result = identify(records, job.model, settings=job.settings, verify=unseen, command=_command())
    if job.kind is None:
        return result
    # Folds are scored, and need no spread.
    once = replace(job.settings, bootstrap=None)
    return cross_validated(result, records, job.model, kind=job.kind, settings=once)


def _command() -> list[str]:
    return ["rotorid", *sys.argv[1:]]


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
    search: Search = None,
    evaluations: Evaluations = None,
    bootstrap: Bootstrap = None,
    pieces: Pieces = None,
    cross_validate: CrossValidate = None,
    layout: Layout = None,
    arm: Arm = None,
    curve: Curve = "auto",
    rotor_diameter: RotorDiameter = None,
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
    from rotorid.pipeline.cross_validation import parse_kind
    from rotorid.pipeline.settings import IdentifySettings

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
        **_written(fix=fix, tie=tie, constant=constant, pair=pair, weight=weight),
        free=tuple(free or ()),
        outputs=channel_names(outputs),
        weights=weights,  # type: ignore[arg-type]
        reduce=reduce,
        speed_damping=speed_damping,  # type: ignore[arg-type]
        method=method,  # type: ignore[arg-type]
        hold=hold,  # type: ignore[arg-type]
        starts=starts,
        search=search,
        evaluations=evaluations,
        bootstrap=bootstrap,
        pieces_s=pieces,
    )
    motors = motor_choices(
        model,
        settings,
        layout=layout,
        arm=arm,
        curve=curve,
        rotor_diameter=rotor_diameter,
        also={"cross validate": cross_validate, "inputs": inputs},
    )
    channels = channel_names(inputs), channel_names(outputs)
    wanted = model if motors else _wanted(model, *channels, settings, decoupled=decoupled)
    job = Job(
        logs=logs,
        unseen=verify or [],
        mapping=map,
        model=wanted,
        settings=settings,
        motors=motors,
        kind=parse_kind(cross_validate),
        folder=out or default_folder(logs[0], wanted if isinstance(wanted, str) else wanted.name),
        json=json,
        quiet=quiet,
    )
    run_identify(job)


def _written(
    *,
    fix: list[str] | None,
    tie: list[str] | None,
    constant: list[str] | None,
    pair: list[str] | None,
    weight: list[str] | None,
) -> dict[str, Any]:
    """Choices that are written as text, as fields of the settings."""
    from rotorid.pipeline.settings import parse_fix, parse_pairs, parse_ties

    return {
        "fix": parse_fix(tuple(fix or ())),
        "ties": parse_ties(tuple(tie or ())),
        "constants": parse_fix(tuple(constant or ())),
        "pairs": parse_pairs(tuple(pair or ())),
        "pair_weights": parse_fix(tuple(weight or ())),
    }


def _wanted(
    model: str, inputs: tuple[str, ...], outputs: tuple[str, ...], settings: IdentifySettings, *, decoupled: bool
) -> str | LinearStructure:
    """The structure, or the name of one that takes its channels from the logs."""
    from rotorid.pipeline.resolve import finds_its_channels, require_known, resolve_model

    if finds_its_channels(model, inputs):
        return model
    structure = resolve_model(model, inputs=inputs, outputs=outputs, decoupled=decoupled)
    require_known(structure, settings)
    return structure
