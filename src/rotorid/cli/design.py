"""``rotorid design``: what to fly, how large, how long, and what the data will be able to tell."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rotorid.cli.console import print_findings, progress
from rotorid.cli.options import (
    Changes,
    Height,
    Json,
    LimitOptions,
    Out,
    Quiet,
    Seed,
    Turbulence,
    WindOption,
    axes_of,
    limits_of,
    named_numbers,
    shape_of,
    wind_of,
)

if TYPE_CHECKING:
    from rotorid.data.flight_plan import Shape
    from rotorid.documents.design import DesignDocument, PlanSummaryDocument, PredictionDocument
    from rotorid.pipeline.designs import DesignChoices, PlanChoices


def design_command(
    kinds: Annotated[
        list[str],
        typer.Argument(
            metavar="KIND...",
            help="sweep, log_sweep, multisine, binary, doublet, 2-1-1 or 3-2-1-1. Several are compared.",
        ),
    ],
    vehicle: Annotated[str, typer.Option("--vehicle", help="A vehicle of the library: see rotorid vehicles.")],
    axis: Annotated[str, typer.Option("--axis", help="roll, pitch, yaw, thrust, several by commas, or all.")] = "roll",
    band: Annotated[str, typer.Option("--band", help="LO:HI in rad/s.")] = "0.6:50",
    duration: Annotated[
        float | None,
        typer.Option("--duration", help="Seconds of each test input. [default: 60, of steps 0.3 for each unit]"),
    ] = None,
    repeats: Annotated[int, typer.Option("--repeats", help="How often each is flown.")] = 1,
    amplitude: Annotated[
        list[str] | None,
        typer.Option(
            "--amplitude", metavar="AXIS=VALUE", help="Instead of the largest one within the limits. Repeatable."
        ),
    ] = None,
    entry: Annotated[
        str | None,
        typer.Option(
            "--entry",
            help="command, rate_setpoint, attitude_setpoint or stick: where it is added. [default: what the autopilot "
            "can fly]",
        ),
    ] = None,
    doublets: Annotated[
        bool, typer.Option("--doublets", help="Two doublets of each axis at the end, to verify the model on.")
    ] = False,
    limit: LimitOptions = None,
    wind: WindOption = None,
    turbulence: Turbulence = 0.0,
    height: Height = 10.0,
    set: Changes = None,
    model: Annotated[
        list[str] | None,
        typer.Option("--model", help="What will be identified. [default: the rate model of each axis] Repeatable."),
    ] = None,
    prior: Annotated[
        Path | None, typer.Option("--prior", help="result.json of an earlier flight, or its folder: what is expected.")
    ] = None,
    gains: Annotated[
        Path | None, typer.Option("--gains", help="A log of your own autopilot, whose gains will fly.")
    ] = None,
    reach: Annotated[
        list[str] | None,
        typer.Option(
            "--reach", metavar="NAME=PERCENT", help="Find the shortest test input that reaches it. Repeatable."
        ),
    ] = None,
    for_: Annotated[
        str | None, typer.Option("--for", help="px4, ardupilot or betaflight: whose files. [default: the vehicle's]")
    ] = None,
    seed: Seed = 0,
    out: Out = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Plan a flight: test inputs as large as limits allow, what they will tell, files for pilot and autopilot."""
    from rotorid.io.registry import read
    from rotorid.pipeline.designs import DesignChoices, design, read_prior
    from rotorid.report.files import require_autopilot, to_json, write_design

    require_autopilot(for_)
    shapes = tuple(_shape(kind, vehicle) for kind in kinds)
    choices = DesignChoices(
        vehicle=vehicle,
        kinds=shapes,
        plan=_plan_choices(
            axes=axes_of(axis),
            band_rad_s=_band(band),
            duration_s=duration,
            repeats=repeats,
            amplitudes=named_numbers(amplitude, "--amplitude"),
            entry=entry,
            doublets=doublets,
            limits=limits_of(limit),
            wind=wind_of(wind, turbulence, height),
            seed=seed,
        ),
        models=tuple(model or ()),
        reach=named_numbers(reach, "--reach"),
        changes=named_numbers(set, "--set"),
        prior=None if prior is None else read_prior(prior),
        gains={} if gains is None else dict(read(gains).parameters),
        gains_source="" if gains is None else gains.name,
    )
    folder = out or Path("rotorid-out") / f"{vehicle}-design"
    with progress(quiet=quiet) as tell:
        designed = design(choices)
        tell("writing the files")
        command = ["rotorid", *sys.argv[1:]]
        document = write_design(folder, choices, designed, autopilot=for_, command=command)
    if json:
        sys.stdout.write(to_json(document))
    elif not quiet:
        _print(document, choices, folder)


def _shape(kind: str, vehicle: str) -> Shape:
    """The shape that a kind names; a plain sweep is the one that the autopilot can fly."""
    from rotorid.pipeline.designs import sweep_of
    from rotorid.vehicles.catalog import aircraft

    return sweep_of(aircraft(vehicle)) if kind == "sweep" else shape_of(kind)


def _plan_choices(*, duration_s: float | None, entry: str | None, **given: Any) -> PlanChoices:
    from typing import get_args

    from rotorid.data.flight_plan import Entry
    from rotorid.models.parameter import no_such
    from rotorid.pipeline.designs import PlanChoices

    if entry is not None and entry not in get_args(Entry):
        raise no_such("entry of a test input", entry, get_args(Entry))
    return PlanChoices(duration_s=duration_s, entry=entry, **given)  # type: ignore[arg-type]


def _band(text: str) -> tuple[float, float]:
    from rotorid.pipeline.settings import parse_band

    return parse_band(text)


def _print(document: DesignDocument, choices: DesignChoices, folder: Path) -> None:
    from rotorid.cli.console import output_console

    console = output_console()
    for plan in document.plans:
        _print_plan(plan)
        for prediction in plan.predictions:
            _print_prediction(prediction)
        for found in plan.shortest:
            console.print(f"{found.model}: {found.words}", markup=False, soft_wrap=True)
    if document.best:
        console.print("tells most: " + ", ".join(f"{name} {kind}" for name, kind in document.best.items()))
    print_findings(document.findings)
    place = folder / document.plans[0].folder
    console.print(f"plan: {place / 'plan.json'}", soft_wrap=True, markup=False)
    console.print(f"card: {place / 'flight-card.html'}", soft_wrap=True, markup=False)
    console.print(
        f"fly it in simulation: rotorid simulate {choices.vehicle} --plan {place / 'plan.json'}",
        soft_wrap=True,
        markup=False,
    )


def _print_plan(plan: PlanSummaryDocument) -> None:
    from rich.table import Table

    from rotorid.cli.console import output_console
    from rotorid.planning.amplitude import limit_words

    console = output_console()
    reached = plan.reached
    table = Table(title=plan.kind.replace("_", " "), title_justify="left", box=None, pad_edge=False)
    for name in ("axis", "shape", "added to", "from", "to in s", "amplitude", "unit", "limited by"):
        table.add_column(name, justify="right" if name in ("from", "to in s", "amplitude") else "left")
    for one in plan.inputs:
        table.add_row(
            one.axis,
            one.shape.replace("_", " "),
            one.entry,
            f"{one.start_s:.1f}",
            f"{one.stop_s:.1f}",
            f"{one.amplitude:.3g}",
            one.unit,
            limit_words([one.limited_by]),
        )
    console.print(table)
    console.print(
        f"{plan.duration_s:.0f} s in all; reaches {math.degrees(reached.tilt_rad):.0f}° of tilt, "
        f"{math.degrees(reached.rate_rad_s):.0f}°/s, {reached.position_m:.1f} m from the start, "
        f"{reached.height_m:.1f} m in height, motors {reached.motor_low:.2f} to {reached.motor_high:.2f}",
        markup=False,
        soft_wrap=True,
    )


def _print_prediction(prediction: PredictionDocument) -> None:
    from rich.table import Table

    from rotorid.cli.console import output_console

    console = output_console()
    if prediction.refused:
        console.print(f"{prediction.model}: {prediction.refused}", markup=False, soft_wrap=True)
        return
    table = Table(title=f"what it will tell: {prediction.model}", title_justify="left", box=None, pad_edge=False)
    for name in ("parameter", "expected", "± std", "unit", "%", "least %"):
        table.add_column(name, justify="left" if name in ("parameter", "unit") else "right")
    for name, one in prediction.parameters.items():
        least = 100.0 * one.lowest_std / abs(one.value) if one.value else math.inf
        table.add_row(
            name,
            f"{one.expected:.5g}",
            f"{one.std:.2g}",
            one.unit,
            "" if one.percent is None else f"{one.percent:.2g}",
            f"{least:.2g}" if math.isfinite(least) else "",
        )
    console.print(table)
    for pair, response in prediction.responses.items():
        if response.band_rad_s is None:
            console.print(f"{pair}: not usable", markup=False)
        else:
            low, high = response.band_rad_s
            console.print(
                f"{pair}: {low:.2g} to {high:.3g} rad/s, coherence {response.coherence:.2f}, error "
                f"{100.0 * (response.random_error or 0.0):.1f} %",
                markup=False,
            )
    print_findings(prediction.findings)
