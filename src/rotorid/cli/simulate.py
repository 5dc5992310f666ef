"""``rotorid simulate``: fly a vehicle in simulation and write its log, in the format of its autopilot."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

from rotorid.cli.command import carry_out, command_line
from rotorid.cli.console import default_folder, print_findings, print_table, progress
from rotorid.cli.options import ForPaper, Map, Only, Output, complete_from
from rotorid.cli.preferences import results_folder
from rotorid.cli.vehicles import Like, print_vehicle_remarks
from rotorid.errors import UsageError
from rotorid.flying.settings import Air, PlanSettings, SimulateSettings, plan_settings, vehicle_names
from rotorid.settings.flying import FlySettings
from rotorid.settings.option import Option, changed_options, options_given
from rotorid.settings.parsing import PATHS

if TYPE_CHECKING:
    from rotorid.data.flight_plan import Entry, FlightPlan
    from rotorid.documents.design import SimulationDocument
    from rotorid.documents.flown import FlownDocument
    from rotorid.results.model import IdentifiedModel

_NO_PLAN = "none"
EVERYDAY = "everyday"

_HOVER_S = 60.0
"""Length of a flight without a plan, unless the user says otherwise."""

_MOST_ROWS = 20


Vehicle: TypeAlias = Annotated[
    list[str],
    typer.Argument(
        metavar="VEHICLE...|RESULT...",
        autocompletion=complete_from(vehicle_names),
        help="A vehicle of the library (see rotorid vehicles), a vehicle file .toml, or results of identify.",
    ),
]
Plan: TypeAlias = Annotated[
    str | None,
    Option(
        "--plan",
        "plan.json of rotorid design, everyday (ordinary flying by stick) or none (hover). [default: a sweep and "
        "two doublets on every axis; for a vehicle behind set-points random binary signals on all]",
        "Flight",
        metavar="FILE|everyday|none",
        words=(EVERYDAY, _NO_PLAN),
    ),
]
ThroughLogs: TypeAlias = Annotated[
    tuple[Path, ...],
    Option(
        "--log",
        "Fly results of identify through the inputs of this log, and compare with what was measured. Repeatable.",
        "Through a log",
        PATHS,
    ),
]


def simulate_command(
    vehicle: Vehicle,
    *,
    like: Like = None,
    plan: Plan = None,
    log: ThroughLogs = (),
    map: Map = None,
    through: Annotated[dict[str, Any], FlySettings, Only("segments", "pieces_s")],
    flight: Annotated[dict[str, Any], SimulateSettings],
    air: Air,
    output: Output,
    paper: ForPaper,
) -> None:
    """Simulate a flight and write its log, or fly a model through a log."""
    of_flights = _of_flights(plan, flight, air)
    if log:
        _refuse(
            [*of_flights, *(["--like"] if like is not None else [])],
            "with --log",
            remedy="use only --map, --segment, --pieces and --seed with it: the model flies through the log's inputs",
        )
        settings = FlySettings(**through, seed=flight["seed"])
        _simulate_log(vehicle, log, map=map, settings=settings, output=output, paper=paper)
        return
    of_logs = [*(["--map"] if map is not None else []), *changed_options(FlySettings, through).values()]
    _refuse(of_logs, "without --log", remedy="add --log LOG to fly a model through a log")
    if plan not in (None, _NO_PLAN, EVERYDAY) and like is None and (models := _fliers(vehicle)):
        _refuse(
            _of_flights(None, {**flight, "runs": 1}, air),
            f"with {models[0].name}, which flies by itself",
            remedy="use only --plan, --runs and --seed; --like NAME simulates it as a vehicle, in wind",
        )
        _simulate_plan(
            models, Path(plan or ""), vehicle, seed=flight["seed"], runs=flight["runs"], output=output, paper=paper
        )
        return
    if paper.figures or paper.tables or paper.pdf:
        raise UsageError(
            "--figures, --tables and --pdf are not used for a simulated log", remedy="add --log, or use identify"
        )
    _fly_vehicle(vehicle, like, plan, flight, air, output, of_flights)


def _refuse(given: Sequence[str], where: str, *, remedy: str) -> None:
    """Refuse options that have no effect.

    Raises
    ------
    UsageError
        Some were given.
    """
    if given:
        raise UsageError(f"{', '.join(given)} cannot be used {where}", remedy=remedy)


def _of_flights(plan: str | None, flight: dict[str, Any], air: Air) -> list[str]:
    """Options of simulated flights that were given; a seed applies to all."""
    given = {name: value for name, value in flight.items() if name != "seed"}
    return [
        *(["--plan"] if plan is not None else []),
        *changed_options(SimulateSettings, given).values(),
        *options_given(air).values(),
    ]


def _fly_vehicle(
    vehicle: list[str],
    like: str | None,
    plan: str | None,
    flight: dict[str, Any],
    air: Air,
    output: Output,
    of_flights: Sequence[str],
) -> None:
    """Fly a vehicle, or run the rig, and write its log."""
    from rotorid.documents.vehicle import named_rig, named_vehicle
    from rotorid.io.folders import making, target_folder
    from rotorid.report.files import result_kind, to_json, write_rig_simulation, write_simulation

    kind = result_kind("simulation.json")
    if like is None and (bench := named_rig(vehicle, given=flight.get("changes"))) is not None:
        sweeps = plan if plan not in (None, _NO_PLAN, EVERYDAY) else None
        _refuse(
            [
                option
                for option in of_flights
                if option not in ("--plan", "--set") or (option == "--plan" and not sweeps)
            ],
            "for the rig, which does not fly",
            remedy="use only --seed, --set, --out and --plan FILE: it sweeps two motors for 120 s and writes CSV",
        )
        from rotorid.documents.design import read_plan
        from rotorid.vehicles.catalog import RIG

        swept = None if sweeps is None else read_plan(Path(sweeps))
        own = bench if bench.prior is not None or bench.changes else None
        with making(target_folder(output.out, results_folder() / RIG, kind, force=output.force)) as made:
            document = write_rig_simulation(
                made.place, seed=flight["seed"], command=command_line(), plan=swept, settings=own
            )
    else:
        named = named_vehicle(vehicle, like=like, given=flight.get("changes"))
        target = target_folder(output.out, results_folder() / named.entry.name, kind, force=output.force)
        if plan == _NO_PLAN and flight["duration_s"] is None:
            flight["duration_s"] = _HOVER_S
        # Checked before the plan is made, which takes a while.
        choices = SimulateSettings(
            vehicle=named.entry, wind=air.wind, tested=named.tested, **{**flight, "changes": named.changes}
        )
        if not output.quiet:
            print_vehicle_remarks(named)
        with progress(quiet=output.quiet):
            choices = replace(choices, plan=_plan(plan, choices))
            with making(target) as made:
                document = write_simulation(made.place, choices, command=command_line())
    if output.json:
        sys.stdout.write(to_json(document))
    elif not output.quiet:
        _print(document, made.folder, verbose=output.verbose)


def _models(results: list[str]) -> list[IdentifiedModel]:
    """Results that identify wrote.

    Raises
    ------
    UsageError
        One is none.
    """
    from rotorid.documents.result import load

    if wrong := [result for result in results if not Path(result).exists()]:
        raise UsageError(f"{wrong[0]} is no result of identify", needed="its folder or result.json, for --log")
    return [load(result) for result in results]


def _fliers(vehicle: list[str]) -> list[IdentifiedModel]:
    """Results that can fly a plan by themselves: by set-points, or by commands; none where vehicles are given."""
    from rotorid.documents.results import is_result, load_results
    from rotorid.flying.flown_models import flies_plans
    from rotorid.flying.model_from_results import joined_halves
    from rotorid.flying.model_logs import flies_under_control

    folders = [Path(path) for path in vehicle]
    if not all(is_result(folder) for folder in folders):
        return []
    models = load_results(folders)
    if len(models) == 1 and flies_under_control(models[0]):
        return models
    if len(models) == 2 and joined_halves(models) is not None:
        return models
    drags = [model for model in models if model.nonlinear is not None and not flies_plans(model)]
    others = [model for model in models if model not in drags]
    return models if others and all(map(flies_plans, others)) else []


def _simulate_log(
    results: list[str],
    logs: Sequence[Path],
    *,
    map: Path | None,
    settings: FlySettings,
    output: Output,
    paper: ForPaper,
) -> None:
    """Fly an identified model through logs, and write its outputs with the measured ones."""
    from rotorid.documents.flown import FLOWN, flown_document, refused_flown_document
    from rotorid.flying.flown_models import fly_log, one_model, refused_flight
    from rotorid.report.files import write_flown
    from rotorid.report.publication import of_simulated

    models = _models(results)
    name = one_model(models)[0].name
    title = f"{name} through {', '.join(log.name for log in logs)}"
    carry_out(
        logs,
        mapping=map,
        output=output,
        folder=default_folder(logs, f"flown-{name}"),
        file=FLOWN,
        compute=lambda records: fly_log(models, records, settings=settings),
        write=lambda folder, flown: write_flown(folder, flown, title=title),
        refused=lambda error, records: refused_flown_document(refused_flight(error, records, name, settings)),
        document=flown_document,
        show=_print_simulated,
        paper=paper,
        publication=of_simulated,
    )


def _simulate_plan(
    models: list[IdentifiedModel],
    plan: Path,
    results: list[str],
    *,
    seed: int,
    runs: int,
    output: Output,
    paper: ForPaper,
) -> None:
    """Fly an identified model through a plan, and write what it did, with logs that have noise."""
    from rotorid.documents.design import read_plan
    from rotorid.documents.flown import FLOWN, flown_document
    from rotorid.flying.flown_models import fly_plan
    from rotorid.report.files import write_flown
    from rotorid.report.publication import of_simulated

    wanted = read_plan(plan)
    carry_out(
        [],
        output=output,
        folder=results_folder() / f"flown-{Path(results[0]).resolve().name}",
        file=FLOWN,
        compute=lambda _: fly_plan(models, wanted, settings=FlySettings(seed=seed), runs=runs),
        write=lambda folder, flown: write_flown(folder, flown, title=f"{flown.model.name} through {wanted.name}"),
        refused=lambda error, _: error,
        document=flown_document,
        show=_print_simulated,
        paper=paper,
        publication=of_simulated,
    )


def _print_simulated(document: FlownDocument, folder: Path, *, verbose: bool = False) -> None:
    """Print how well each output is predicted, findings and where the files are."""
    from rich.table import Table

    from rotorid.cli.console import output_console

    console = output_console()
    table = Table(
        title=f"{document.model} through the {'plan' if document.logs else 'log'}",
        title_justify="left",
        box=None,
        pad_edge=False,
    )
    for name in ("flight", "seconds", "pieces", "output", "fit %", "TIC"):
        table.add_column(name, justify="left" if name in ("flight", "output") else "right")
    rows: list[tuple[str, ...]] = []
    for item in document.flights:
        flight = f"{item.record} from {item.start_s:.1f} s", f"{item.stop_s - item.start_s:.1f}", str(item.pieces)
        for output, scores in item.scores.items():
            rows.append((*flight, output, f"{scores.nrmse_fit_percent:.0f}", f"{scores.tic:.2f}"))
        if not item.scores:
            rows.append((*flight, "", "", ""))
    print_table(table, rows, verbose=verbose, item="output", most=_MOST_ROWS)
    print_findings(document.findings, verbose=verbose)
    console.print(f"report: {folder / 'report.html'}", soft_wrap=True, markup=False)
    console.print(f"signals: {folder / 'flown.npz'}", soft_wrap=True, markup=False)
    if document.logs:
        names = [log.file for log in document.logs]
        shown = names[0] if len(names) == 1 else f"{names[0]} to {names[-1]}"
        console.print(f"log with noise: {folder / shown}", soft_wrap=True, markup=False)


def _plan(given: str | None, flight: SimulateSettings) -> FlightPlan | None:
    """The plan that the user named, ordinary sticks, none, or test inputs and two doublets of each axis."""
    from rotorid.autopilots.registry import named
    from rotorid.documents.design import read_plan
    from rotorid.flying.designs import plan_for, sweep_of
    from rotorid.flying.simulation import EVERYDAY_S, everyday_plan
    from rotorid.simulation.multirotor_flight import changed

    craft = flight.aircraft

    if given == _NO_PLAN:
        return None
    if given == EVERYDAY:
        return everyday_plan(craft, duration_s=flight.duration_s or EVERYDAY_S, level=flight.stick, seed=flight.seed)
    if given is not None:
        return read_plan(Path(given))
    if flight.entry.interface is not None:
        wishes = plan_settings(flight.entry, shape="random_binary", doublets=True, wind=flight.wind, seed=flight.seed)
        return plan_for(changed(flight.entry.aircraft, flight.changes), wishes).plan
    # A pilot flies what an autopilot does not add to its commands: sticks are its instrument.
    entry: Entry | None = None if named(craft.autopilot.kind).entry == "command" else "stick"
    choices = PlanSettings(shape=sweep_of(craft), doublets=True, entry=entry, wind=flight.wind, seed=flight.seed)
    return plan_for(craft, choices).plan


def _print(document: SimulationDocument, folder: Path, *, verbose: bool = False) -> None:
    """Print the vehicle, what it reached, and where the logs are."""
    from rich.table import Table

    from rotorid.cli.console import output_console

    console = output_console()
    flew = document.vehicle
    console.print(f"{flew.name}: {flew.description}", markup=False, soft_wrap=True)
    table = Table(box=None, pad_edge=False)
    for name in (
        "log",
        "seconds",
        "tilt in deg",
        "rate in deg/s",
        "moved in m",
        "climbed in m",
        "motors",
        "limited in %",
    ):
        table.add_column(name, justify="left" if name == "log" else "right")
    rows: list[tuple[str, ...]] = []
    for log in document.logs:
        reached = log.reached
        if reached is None:
            rows.append((log.file, f"{log.duration_s:.1f}"))
            continue
        rows.append(
            (
                log.file,
                f"{log.duration_s:.1f}",
                f"{57.29578 * reached.tilt_rad:.1f}",
                f"{57.29578 * reached.rate_rad_s:.0f}",
                f"{reached.position_m:.1f}",
                f"{reached.height_m:.1f}",
                f"{reached.motor_low:.2f} to {reached.motor_high:.2f}",
                f"{100.0 * reached.saturated:.1f}",
            )
        )
    print_table(table, rows, verbose=verbose, item="log", most=_MOST_ROWS, page="simulation.json")
    print_findings(document.findings, verbose=verbose)
    console.print(f"log:   {folder / document.logs[0].file}", soft_wrap=True, markup=False)
    console.print(f"truth: {folder / 'simulation.json'}", soft_wrap=True, markup=False)
