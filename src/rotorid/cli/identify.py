"""``rotorid identify``: logs in, a model with bounds, verified, out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rotorid.cli.identify_run import Job, run_identify
from rotorid.cli.measure_options import channel_names, measure_choices
from rotorid.cli.motor_options import Arm, Curve, Layout, RotorDiameter, motor_choices
from rotorid.cli.names import default_folder
from rotorid.cli.options import (
    Band,
    Bootstrap,
    Coherence,
    CrossValidate,
    Decoupled,
    Estimate,
    Evaluations,
    Hold,
    Instrument,
    Json,
    Logs,
    Map,
    Method,
    Out,
    Pieces,
    Quiet,
    Search,
    Seed,
    Segments,
    Shifts,
    Starts,
    Windows,
)

if TYPE_CHECKING:
    from rotorid.models.structure import LinearStructure
    from rotorid.pipeline.settings import IdentifySettings


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
    from rotorid.pipeline.settings import IdentifySettings
    from rotorid.pipeline.time_crossed import parse_kind

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
