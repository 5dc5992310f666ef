"""``rotorid design``: what to fly, how large, how long, and how well it will measure parameters."""

from __future__ import annotations

import math
import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

from rotorid.cli.command import command_line, print_if_asked, target_of
from rotorid.cli.console import log_progress, print_findings, progress, say
from rotorid.cli.options import ForPaper, Only, Output, complete_from
from rotorid.cli.preferences import results_folder
from rotorid.cli.vehicles import Like, print_vehicle_remarks
from rotorid.data.display import listed
from rotorid.data.quantity import error_columns, percent, significant
from rotorid.errors import UsageError
from rotorid.flying.settings import (
    Air,
    AutopilotSettings,
    DesignSettings,
    PlanSettings,
    parse_shape,
    plan_settings,
    vehicle_names,
)
from rotorid.proposing.settings import TUNED_AXES
from rotorid.settings.option import Option, changed_options, options_given
from rotorid.settings.parsing import WORDS

if TYPE_CHECKING:
    from rotorid.documents.bench import BenchDesignDocument
    from rotorid.documents.design import DesignDocument, PlanSummaryDocument, PredictionDocument
    from rotorid.documents.vehicle import NamedVehicle
    from rotorid.flying.bench_designs import BenchSettings

_MOST_NAMED = 8
"""Parameters of a model that a line names."""

_KINDS = ("sweep", "log_sweep", "multisine", "binary", "doublet", "2-1-1", "3-2-1-1")

Kinds: TypeAlias = Annotated[
    list[str],
    typer.Argument(
        metavar="KIND...",
        autocompletion=complete_from(_KINDS),
        help="sweep, log_sweep, multisine, binary, doublet, 2-1-1 or 3-2-1-1. Several kinds are compared.",
    ),
]
Vehicle: TypeAlias = Annotated[
    tuple[str, ...],
    Option(
        "--vehicle",
        "Vehicle: a name (see rotorid vehicles), a file .toml, or a result of identify. Several results are combined. "
        "Repeatable.",
        "Vehicle and autopilot",
        WORDS,
        metavar="NAME|FILE.toml|RESULT",
        words=vehicle_names,
    ),
]


def design_command(
    kinds: Kinds,
    *,
    vehicle: Vehicle,
    like: Like = None,
    design: Annotated[dict[str, Any], DesignSettings],
    of_log: AutopilotSettings,
    plan: Annotated[dict[str, Any], PlanSettings],
    air: Air,
    output: Output,
    paper: Annotated[ForPaper, Only("pdf")],
) -> None:
    """Plan a test flight: what to fly, how long, how well it will measure, with a card for the pilot.

    Exit code 1 where no plan to fit a model supports it; the files are written, and findings give the reason.
    """
    from rotorid.data.trust import RICH_KINDS
    from rotorid.documents.vehicle import named_rig, named_vehicle
    from rotorid.flying.designs import design as plan_flights
    from rotorid.io.folders import making
    from rotorid.report.files import require_autopilot, to_json, write_design

    require_autopilot(of_log.autopilot)
    _require_one_band(of_log, plan)
    changes = design.pop("changes", None)
    if like is None and (bench := named_rig(vehicle, given=changes)) is not None:
        others = [*options_given(of_log).values(), *options_given(air).values()]
        _design_bench(bench, kinds, design, plan, others, vehicle, output)
        return
    named = named_vehicle(vehicle, like=like, given=changes)
    if not output.quiet:
        print_vehicle_remarks(named)
    choices = _as_flown(_settings(named, kinds, design, plan, air), of_log)
    if not output.quiet:
        # Warnings are printed with the other findings.
        for remark in (finding for finding in choices.remarks if finding.severity == "info"):
            say(remark.message)
    default = results_folder() / f"{choices.entry.name}-design"
    target = target_of(output, default, "design.json", paper)
    with progress(quiet=output.quiet):
        designed = plan_flights(choices)
        log_progress("writing the files")
        with making(target) as made:
            document = write_design(made.place, choices, designed, autopilot=of_log.autopilot, command=command_line())
            print_if_asked(made.place, paper)
    if output.json:
        sys.stdout.write(to_json(document))
    elif not output.quiet:
        _print(document, choices, vehicle, made.folder, verbose=output.verbose)
    # Doublets and steps verify a model; they are not flown to fit one.
    fitted = [plan for plan in designed if plan.planned.plan.inputs[0].maneuver.kind in RICH_KINDS]
    supported = {predicted.model for plan in fitted for predicted in plan.told if predicted.prediction is not None}
    if any(predicted.model not in supported for plan in fitted for predicted in plan.told):
        raise typer.Exit(1)


def _design_bench(
    bench: BenchSettings,
    kinds: Sequence[str],
    design: dict[str, Any],
    plan: dict[str, Any],
    others: Sequence[str],
    vehicle: Sequence[str],
    output: Output,
) -> None:
    """Sweeps of the motors of a rig, within the angle that it may reach."""
    from rotorid.flying.bench_designs import design_bench
    from rotorid.io.folders import making, target_folder
    from rotorid.report.files import result_kind, to_json, write_bench_design
    from rotorid.vehicles.catalog import RIG

    taken = {"axes", "band_rad_s", "duration_s", "limits", "amplitudes", "seed", "prior"}
    refused = [*others, *changed_options(PlanSettings, {k: v for k, v in plan.items() if k not in taken}).values()]
    refused += changed_options(DesignSettings, {k: v for k, v in design.items() if k not in taken}).values()
    if refused or list(kinds) != ["sweep"]:
        raise UsageError(
            f"{listed(refused or list(kinds))} cannot be used for a rig, which does not fly",
            needed="a sweep with --axis, --band, --duration, --amplitude, --limit tilt=DEG, --prior, --set or --seed",
        )
    given = {k: v for k, v in {**plan, "prior": design.get("prior")}.items() if k in taken and v is not None}
    if (limits := given.pop("limits", None)) is not None:
        given["limit_rad"] = limits.tilt_rad
    target = target_folder(
        output.out, results_folder() / f"{RIG}-design", result_kind("design.json"), force=output.force
    )
    with progress(quiet=output.quiet):
        found = design_bench(replace(bench, **given))
        with making(target) as made:
            document = write_bench_design(made.place, found, command=command_line())
    if output.json:
        sys.stdout.write(to_json(document))
    elif not output.quiet:
        prior = design.get("prior")
        words = [*(vehicle if prior is None else [prior.place]), *_set_words(bench.changes)]
        _print_bench(document, made.folder, words)


def _set_words(changes: Mapping[str, float]) -> list[str]:
    return [word for name, value in changes.items() for word in ("--set", f"{name}={value:.6g}")]


def _print_bench(document: BenchDesignDocument, folder: Path, rig: Sequence[str]) -> None:
    """What moves, how far, and what it measures."""
    from rotorid.cli.console import output_console

    lines = [f"Sweep {listed([one.motor for one in document.sweeps])} of {document.vehicle}."]
    for one in document.sweeps:
        unit = "of full output" if one.unit == "1" else one.unit
        lines.append(
            f"  {one.motor}  {one.axis}  {one.start_s:.0f} to {one.stop_s:.0f} s  ± {significant(one.amplitude)} {unit}"
        )
    reached, limit = (significant(math.degrees(angle)) for angle in (document.reached_rad, document.limit_rad))
    lines.append(f"Predicted angle: ± {reached}° (limit {limit}°), with a loop of about 1 rad/s around the rig.")
    known = [f"{name} ±{percent(row.percent)} %" for name, row in document.expected.items() if row.percent is not None]
    if known:
        lines.append(f"Expected error of {document.model}: {', '.join(known)}.")
    place = folder / "plan.json"
    lines += [
        f"plan: {place}, samples: {folder / 'plan.csv'}",
        f"card: {folder / 'bench-card.html'}",
    ]
    lines.append(f"fly it in simulation: {shlex.join(['rotorid', 'simulate', *rig, '--plan', str(place)])}")
    console = output_console()
    for line in lines:
        console.print(line, markup=False, soft_wrap=True, highlight=False)
    print_findings(document.findings, verbose=True, page="")


def _require_one_band(of_log: AutopilotSettings, plan: dict[str, Any]) -> None:
    """Refuse options that ``--for-tune`` replaces; its default axes are those of ``tune``."""
    if of_log.tuned is None:
        return
    if of_log.gains is not None or plan.get("band_rad_s") is not None:
        twice = "--gains" if of_log.gains is not None else "--band"
        raise UsageError(f"--for-tune and {twice} exclude each other", remedy="give one of them")
    plan.setdefault("axes", TUNED_AXES)


def _settings(
    named: NamedVehicle, kinds: Sequence[str], design: dict[str, Any], plan: dict[str, Any], air: Air
) -> DesignSettings:
    """The design of a vehicle; a plain sweep is the one that its autopilot can fly."""
    from rotorid.flying.designs import sweep_of
    from rotorid.planning.responses import answers_setpoints

    shapes = (sweep_of(named.entry.aircraft) if kind == "sweep" else parse_shape(kind) for kind in kinds)
    begun = DesignSettings(
        vehicle=named.entry,
        changes=named.changes,
        kinds=tuple(shapes),
        firmware=named.firmware,
        own=named.own,
        **design,
    )
    inputs, earlier = begun.inputs, begun.earlier
    if not inputs and earlier is not None and answers_setpoints(earlier.structure):
        # The axes of the earlier result.
        inputs = earlier.structure.inputs
    planned = plan_settings(named.entry, wind=air.wind, inputs=inputs, models=begun.models, **plan)
    return replace(begun, plan=planned)


def _as_flown(choices: DesignSettings, of_log: AutopilotSettings) -> DesignSettings:
    """A design with the gains, noise and wind of a log or a result."""
    if of_log.tuned is not None:
        return _for_tune(choices, of_log.tuned)
    if of_log.gains is None:
        return choices
    from rotorid.flying.flight_air import flown_as
    from rotorid.io.registry import read

    return flown_as(choices, read(of_log.gains))


def _for_tune(choices: DesignSettings, given: Path) -> DesignSettings:
    """The same design with the gains of a log or a result, and the band that ``tune`` needs."""
    from rotorid.documents.results import is_result, load_results
    from rotorid.io.registry import read
    from rotorid.planning.prior import read_prior
    from rotorid.proposing.bands import designed_for_tune

    if not is_result(given):
        return designed_for_tune(choices, record=read(given))
    models = load_results([given])
    # What begins at the motors is a vehicle, and no answer to commands.
    if choices.prior is None and len(models) == 1 and models[0].motors is None:
        choices = replace(choices, prior=read_prior(given))
    return designed_for_tune(choices, models=models)


def _simulation(choices: DesignSettings, vehicle: Sequence[str], folder: Path, place: Path) -> str:
    """The command that simulates a plan with its vehicle and wind."""
    from rotorid.report.files import VEHICLE_FILE

    changes = _set_words(choices.changes)
    like = ["--like", choices.own.like] if choices.own is not None and not choices.own.whole else []
    flies = [str(folder / VEHICLE_FILE)] if choices.vehicle_changed else [*vehicle, *like, *changes]
    wind = choices.plan.wind
    words = ["rotorid", "simulate", *flies, "--plan", str(place / "plan.json")]
    if wind.speed_m_s:
        words.append(f"--wind={wind.north_m_s:.3g},{wind.east_m_s:.3g}")
    if wind.turbulence_m_s:
        words += ["--turbulence", f"{wind.turbulence_m_s:.3g}"]
    if wind.height_m != Air().height_m:
        words += ["--height", f"{wind.height_m:.3g}"]
    return shlex.join(words)


def _print(
    document: DesignDocument, choices: DesignSettings, vehicle: Sequence[str], folder: Path, *, verbose: bool
) -> None:
    from rotorid.cli.console import output_console
    from rotorid.plans.files import file_use
    from rotorid.report.flight_card import WHOLE_ERROR

    console = output_console()

    def line(text: str) -> None:
        console.print(text, markup=False, soft_wrap=True, highlight=False)

    for plan in document.plans:
        axes = dict.fromkeys(test_input.axis for test_input in plan.inputs)
        line(f"Fly a {_kind(plan)} on {listed(list(axes))}, {plan.duration_s:.0f} s in all.")
        for prediction in plan.predictions:
            line(f"  {_accuracy(prediction)}")
        if any(not prediction.refused for prediction in plan.predictions):
            line(f"  Expected errors are {WHOLE_ERROR}.")
        for found in plan.shortest:
            line(f"  {found.model}: {found.words}")
    if document.best:
        kinds: dict[str, list[str]] = {}
        for name, kind in document.best.items():
            kinds.setdefault(kind.replace("_", " "), []).append(name)
        line("best for: " + "; ".join(f"{kind}: {', '.join(names)}" for kind, names in kinds.items()))
    console.print()
    for plan in document.plans:
        _print_plan(plan)
        for prediction in plan.predictions if verbose else ():
            _print_prediction(prediction)
    of_models = [finding for plan in document.plans for each in plan.predictions for finding in each.findings]
    print_findings([*document.findings, *of_models], verbose=verbose, page="design.html")
    place = folder / document.plans[0].folder
    for number, plan in enumerate(document.plans):
        line(f"{'card for the pilot' if number == 0 else 'card'}: {folder / plan.folder / 'flight-card.html'}")
        use = file_use(plan.files)
        if use.before:
            line(f"files for the vehicle: in {folder / plan.folder}")
            line(f"  {use.before}")
            line(f"  {use.after}")
    line(f"plan: {place / 'plan.json'}")
    line(f"page: {folder / 'design.html'}")
    line(f"fly it in simulation: {_simulation(choices, vehicle, folder, place)}")


def _kind(plan: PlanSummaryDocument) -> str:
    """The kind of a plan in words."""
    return plan.kind.replace("_", " ")


def _accuracy(prediction: PredictionDocument) -> str:
    """How well a plan measures the parameters of a model, in a line."""
    if prediction.refused:
        return f"{prediction.model}: not enough data: {prediction.refused}"
    known = {name: row.percent for name, row in prediction.parameters.items() if row.percent is not None}
    # The most accurate first.
    order = sorted(known, key=known.__getitem__)
    shown = ", ".join(f"{name} ±{known[name]:.2g} %" for name in order[:_MOST_NAMED])
    more = f" and {len(order) - _MOST_NAMED} more" if len(order) > _MOST_NAMED else ""
    return f"Expected error of {prediction.model}: {shown}{more}."


def _print_plan(plan: PlanSummaryDocument) -> None:
    from rich.table import Table

    from rotorid.cli.console import output_console
    from rotorid.planning.amplitude import limit_words
    from rotorid.report.flight_card import amplitude_words

    console = output_console()
    reached = plan.reached
    table = Table(title=plan.kind.replace("_", " "), title_justify="left", box=None, pad_edge=False)
    for name in ("axis", "shape", "added to", "from", "to in s", "amplitude", "limited by"):
        table.add_column(name, justify="right" if name in ("from", "to in s") else "left")
    for test_input in plan.inputs:
        table.add_row(
            test_input.axis,
            test_input.shape.replace("_", " "),
            test_input.entry,
            f"{test_input.start_s:.1f}",
            f"{test_input.stop_s:.1f}",
            amplitude_words(test_input),
            limit_words([test_input.limited_by]),
        )
    console.print(table)
    console.print(
        f"The flight reaches {math.degrees(reached.tilt_rad):.0f}° of tilt, {math.degrees(reached.rate_rad_s):.0f}°/s, "
        f"{reached.position_m:.1f} m from the start, {reached.height_m:.1f} m in height, and motor outputs of "
        f"{reached.motor_low:.2f} to {reached.motor_high:.2f}.",
        markup=False,
        soft_wrap=True,
    )


def _print_prediction(prediction: PredictionDocument) -> None:
    from rich.table import Table

    from rotorid.cli.console import output_console
    from rotorid.report.parts import FAR_SIGMAS

    console = output_console()
    if prediction.refused:
        return
    table = Table(title=f"predicted accuracy of {prediction.model}", title_justify="left", box=None, pad_edge=False)
    for name in ("parameter", "value", "expected", "± std", "unit", "error %", "least %", "off"):
        table.add_column(name, justify="left" if name in ("parameter", "unit") else "right")
    for name, parameter in prediction.parameters.items():
        least = 100.0 * parameter.lowest_std / abs(parameter.value) if parameter.value else math.inf
        off = abs(parameter.expected - parameter.value) / parameter.std if parameter.std > 0.0 else 0.0
        table.add_row(
            name,
            significant(parameter.value, digits=5),
            *error_columns(parameter.expected, parameter.std, digits=5),
            parameter.unit,
            "" if parameter.percent is None else f"{parameter.percent:.2g}",
            f"{least:.2g}" if math.isfinite(least) else "",
            f"{off:.0f} σ" if off > FAR_SIGMAS else "",
        )
    console.print(table)
    for pair, response in prediction.responses.items():
        if response.band_rad_s is None:
            console.print(f"{pair}: no usable points", markup=False)
        else:
            low, high = response.band_rad_s
            console.print(
                f"{pair}: {low:.2g} to {high:.3g} rad/s, coherence {response.coherence:.2f}, error "
                f"{100.0 * (response.random_error or 0.0):.1f} %",
                markup=False,
            )
