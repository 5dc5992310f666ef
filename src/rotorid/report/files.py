"""Write what a verb answers into a folder, all files complete or none: results, responses, designs, simulations."""

from __future__ import annotations

import logging
import os
import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from rotorid.autopilots.registry import AUTOPILOTS, named
from rotorid.data.findings import Finding, warn
from rotorid.documents.base import Document
from rotorid.documents.base import to_json as to_json
from rotorid.errors import UsageError
from rotorid.io.files import write_atomically, write_npz
from rotorid.io.folders import ResultKind, Target, making

if TYPE_CHECKING:
    import numpy as np

    from rotorid.data.flight_plan import FlightPlan
    from rotorid.documents.bench import BenchDesignDocument
    from rotorid.documents.design import DesignDocument, SimulationDocument
    from rotorid.flying.bench_designs import BenchDesign, BenchSettings
    from rotorid.flying.designs import Designed
    from rotorid.flying.flown_models import FlownModel
    from rotorid.flying.settings import DesignSettings, SimulateSettings
    from rotorid.loops.responses import Responses
    from rotorid.plans.facts import FlightFacts
    from rotorid.proposing.check import CheckedTuning
    from rotorid.proposing.proposal import TuningProposal
    from rotorid.results.model import IdentifiedModel

_PROGRESS = logging.getLogger("rotorid.progress")

Content: TypeAlias = "Document | Mapping[str, Any] | str | bytes | Callable[[Path], None]"
"""Of a file: a document, as JSON; arrays by name, as NPZ; text or bytes as they are; or what writes it."""


def write_results(
    folder: Path, model: IdentifiedModel, *, title: str, truth: Mapping[str, float] | None = None
) -> None:
    """Write ``result.json``, ``responses.npz``, ``model.toml`` and ``report.html``, all or none.

    Parameters
    ----------
    folder
        Where they go; it is made when missing. Files of the same names are replaced.
    model
        What to write.
    title
        Heading of the report.
    truth
        True values of parameters, where they are known.
    """
    from rotorid.documents.result import response_arrays, result_document
    from rotorid.report.identification import render_report

    write_together(
        folder,
        {
            "result.json": result_document(model),
            "responses.npz": response_arrays(model.data),
            "model.toml": model.to_toml(),
            "report.html": render_report([model], title=title, truth=truth),
        },
    )


def write_together(folder: Path, files: Mapping[str, Content]) -> None:
    """Write several files into a folder: all complete, or none; their pages link to the other files.

    Parameters
    ----------
    folder
        Where they go; it is made when missing. Files of the same names are replaced, others stay.
    files
        Name of each file to its content, or to what writes it.

    Raises
    ------
    UsageError
        The folder cannot be written.
    """
    kind = ResultKind(mains=tuple(name for name in files if name.endswith(".json")))
    with making(Target(folder=folder, kind=kind, force=True, asked=str(folder))) as made:
        for name, content in files.items():
            _write(made.place / name, content)
        for page in (name for name in files if name.endswith(".html") and "/" not in name):
            link_files(made.place / page, [name for name in files if name != page])


def _write(path: Path, content: Content) -> None:
    if isinstance(content, Document):
        write_atomically(path, to_json(content))
    elif isinstance(content, Mapping):
        write_npz(path, content)
    elif isinstance(content, bytes | str):
        write_atomically(path, content)
    else:
        content(path)


def link_files(page: Path, names: Sequence[str]) -> None:
    """Add links to other files to a page that is written already."""
    from rotorid.report.frame import with_files

    write_atomically(page, with_files(page.read_bytes().decode(), names))


def result_kind(main: str) -> ResultKind:
    """How results with this main file are recognized: by the schema and the other files of the command."""
    return _KINDS.get(main) or ResultKind(
        mains=(main,), schema=f"rotorid.{Path(main).stem}", files=(f"{Path(main).stem}*", *_REPORT_FILES)
    )


def require_replaceable(file: Path, *, force: bool) -> None:
    """Refuse to overwrite a page or a picture that rotorid has not written.

    Raises
    ------
    UsageError
        There is a foreign file, or a folder.
    """
    if not os.path.lexists(file) or (force and not file.is_dir()):
        return
    if file.is_file():
        with file.open("rb") as opened:
            if _OURS.match(opened.read(2048)):
                return
    raise UsageError(
        f"{file} exists and was not written by rotorid",
        needed="an unused name",
        remedy="choose another, or add --force",
    )


_OURS = re.compile(
    rb"\x89PNG[\0-\xff]{0,1000}tEXtSoftware\0rotorid|<!DOCTYPE html>[\0-\xff]{0,1000}content=\"rotorid\""
)


def _of_plans(document: Mapping[str, Any]) -> dict[str, str | None]:
    """Files of the plans of a ``design.json``."""
    return {(Path(plan["folder"]) / name).as_posix(): None for plan in document["plans"] for name in plan["files"]}


def _of_logs(document: Mapping[str, Any]) -> dict[str, str | None]:
    """Logs of a ``simulation.json`` with their hashes."""
    return {log["file"]: log["sha256"] for log in document["logs"]}


def _of_export(document: Mapping[str, Any]) -> dict[str, str | None]:
    """Files of an ``export.json`` with their hashes."""
    return {file["name"]: file["sha256"] for file in document["files"]}


_REPORT_FILES = ("report.html", "responses.npz", "figures/*", "tables/*")
_MODEL = ("result.json", "model.toml", *_REPORT_FILES)
_IDENTIFIED = ResultKind(
    mains=("result.json", "results.json"), schema="rotorid.result", files=(*_MODEL, *(f"*/{name}" for name in _MODEL))
)
_KINDS: Mapping[str, ResultKind] = {
    "result.json": _IDENTIFIED,
    "results.json": _IDENTIFIED,
    "inspect.json": ResultKind(mains=("inspect.json",), schema="rotorid.inspect/", files=_REPORT_FILES),
    "review.json": ResultKind(
        mains=("review.json",),
        schema="rotorid.review",
        files=("review*", "logger_topics.txt", "*filters*.*", "figures/*"),
    ),
    "response.json": ResultKind(mains=("response.json",), schema="rotorid.response/", files=_REPORT_FILES),
    "verification.json": ResultKind(mains=("verification.json",), schema="rotorid.verify/", files=_REPORT_FILES),
    "compare.json": ResultKind(mains=("compare.json",), schema="rotorid.compare/", files=_REPORT_FILES),
    "flown.json": ResultKind(
        mains=("flown.json",), schema="rotorid.flown/", files=("flown.npz", "flight*.csv", *_REPORT_FILES)
    ),
    "tune.json": ResultKind(
        mains=("tune.json",),
        schema="rotorid.tune/",
        files=("tune.npz", "proposed.*", "thrust.*", "rollback.*", *_REPORT_FILES),
    ),
    "check.json": ResultKind(mains=("check.json",), schema="rotorid.tune_check/", files=_REPORT_FILES),
    "delay.json": ResultKind(mains=("delay.json",), schema="rotorid.delay/", files=("figures/*", "tables/*")),
    "design.json": ResultKind(
        mains=("design.json",), schema="rotorid.design/", files=("design.html", "*/flight-card.html"), listed=_of_plans
    ),
    "export.json": ResultKind(mains=("export.json",), schema="rotorid.export/", listed=_of_export),
    "simulation.json": ResultKind(
        mains=("simulation.json",), schema="rotorid.simulation/", files=("plan.json",), listed=_of_logs
    ),
    "demo": ResultKind(
        mains=("hover.lateral/result.json",),
        schema="rotorid.result/",
        files=("flight.ulg", "report.html", "overview.png", *(f"hover.*/{name}" for name in _MODEL)),
    ),
}


def write_overview_report(
    path: Path, models: Sequence[IdentifiedModel], *, title: str, truth: Mapping[str, float] | None = None
) -> None:
    """Write one report about several identifications."""
    from rotorid.report.frame import with_files
    from rotorid.report.identification import render_report

    page = render_report(models, title=title, truth=truth)
    reports = [f"{model.name}/report.html" for model in models]
    write_atomically(path, with_files(page, [name for name in reports if (path.parent / name).is_file()]))


def write_responses(folder: Path, result: Responses, *, title: str) -> None:
    """Write ``response.json``, ``responses.npz`` and ``report.html``, all or none.

    Parameters
    ----------
    folder
        Where they go; it is made when missing. Files of the same names are replaced.
    result
        What to write.
    title
        Heading of the report.
    """
    from rotorid.documents.response import response_document
    from rotorid.report.response import render_responses

    write_together(
        folder,
        {
            "response.json": response_document(result),
            "responses.npz": arrays(result),
            "report.html": render_responses(result, title=title),
        },
    )


def arrays(result: Responses) -> dict[str, np.ndarray]:
    """Arrays of ``responses.npz``; no pickles, names as plain text."""
    from rotorid.documents.response import loops_of
    from rotorid.documents.result import measured_arrays

    diagnostics = result.measured.diagnostics
    found = measured_arrays(result.response, result.measured.direct) | {
        "used": result.used,
        "window_share": diagnostics.share,
        "window_error": diagnostics.window_error,
        "multiple_coherence": diagnostics.multiple_coherence,
        "leakage": diagnostics.leakage,
        "input_coherence": diagnostics.input_coherence,
        "condition": diagnostics.condition,
    }
    for _, key, loop in loops_of(result.loops):
        if loop.loop is not None:
            found |= {
                f"{key}_loop_omega_rad_s": loop.loop.omega_rad_s,
                f"{key}_loop_values": loop.loop.values[0, 0],
                f"{key}_loop_random_error": loop.loop.random_error[0, 0],
            }
    return found


VEHICLE_FILE = "vehicle.toml"
"""What a plan was computed for, where that is none that has a name."""


def write_design(
    folder: Path,
    choices: DesignSettings,
    designed: Sequence[Designed],
    *,
    autopilot: str | None,
    command: Sequence[str],
) -> DesignDocument:
    """Write ``design.json`` and ``design.html``; of every plan ``plan.json``, samples, flight card, autopilot's files.

    Parameters
    ----------
    folder
        Where they go; each plan has a folder of its own where there are several.
    choices, designed
        What was asked for, and the answer.
    autopilot
        ``px4``, ``ardupilot`` or ``betaflight``; by default that of the vehicle.
    command
        What the user typed, for the document.
    """
    from rotorid.documents.design import design_document
    from rotorid.documents.vehicle import flown_vehicle_toml
    from rotorid.report.design import render_design

    flies = named(autopilot or choices.aircraft.autopilot.kind)
    words = flies.name if flies.has_plan_files else "other"
    require_autopilot(autopilot)
    findings: list[Finding] = list(choices.remarks)
    written: list[tuple[str, Sequence[str]]] = []
    together: dict[str, Content] = {}
    for plan in designed:
        place = plan.kind if len(designed) > 1 else ""
        files, remarks = _files(plan, choices, words, explicit=autopilot is not None)
        findings += remarks
        together |= {(Path(place) / name).as_posix(): content for name, content in files.items()}
        written.append((place, sorted(files)))
    if choices.vehicle_changed:
        together[VEHICLE_FILE] = flown_vehicle_toml(choices)
    document = design_document(choices, designed, written, findings=findings, autopilot=words, command=command)
    page = render_design(designed, choices, title=_title(designed, choices), document=document)
    write_together(folder, {**together, "design.html": page, "design.json": document})
    return document


def _title(designed: Sequence[Designed], choices: DesignSettings) -> str:
    return f"{'A flight plan' if len(designed) == 1 else f'{len(designed)} flight plans'} for {choices.entry.name}"


def require_autopilot(name: str | None) -> None:
    """Refuse an autopilot for which there are no files."""
    known = [autopilot.key for autopilot in AUTOPILOTS if autopilot.has_plan_files]
    if name is not None and name not in known:
        raise UsageError(f"unknown autopilot {name!r}", needed=f"one of {', '.join(known)}")


def _files(
    design: Designed, choices: DesignSettings, autopilot: str, *, explicit: bool
) -> tuple[dict[str, str | bytes], list[Finding]]:
    """Files of a plan by name; what an autopilot cannot fly is remarked on, and an error where it was asked for."""
    from rotorid.documents.design import plan_document
    from rotorid.flying.designs import beyond_limits, not_followed
    from rotorid.plans.csv import plan_csv
    from rotorid.plans.files import plan_files
    from rotorid.report.flight_card import flight_card

    plan, facts = design.planned.plan, _facts(design, choices, autopilot)
    files: dict[str, str | bytes] = {
        "plan.json": to_json(plan_document(plan)),
        **plan_csv(plan),
        **flight_card(plan, facts),
    }
    findings = [
        *design.findings,
        *beyond_limits(design, choices.plan.limits),
        *not_followed(design, choices.aircraft),
    ]
    if choices.firmware:
        findings += named(autopilot).plan_findings(plan, choices.firmware) or ()
    try:
        files |= plan_files(plan, facts)
    except UsageError as error:
        if explicit:
            raise
        findings.append(_unwritten(design.kind, f"No files for {autopilot} were written", error))
    return files, findings


def _unwritten(kind: str, what: str, error: UsageError) -> Finding:
    return warn("not_written", kind, f"{what}: {error}")


def _facts(design: Designed, choices: DesignSettings, autopilot: str) -> FlightFacts:
    from rotorid.flying.designs import computed_for
    from rotorid.plans.facts import HAND_CLIMB_M, FlightFacts, PredictedBound, throttle_by_hand

    reached = design.planned.reached
    height_m = max(choices.plan.wind.height_m, 3.0 * reached.height_m)
    by_hand = throttle_by_hand(design.planned.plan, autopilot)
    climb_m = max(reached.height_m, min(HAND_CLIMB_M, height_m / 3.0) if by_hand else 0.0)
    bounds = [
        PredictedBound(
            name=parameter.name,
            unit=parameter.unit,
            value=parameter.expected,
            std=parameter.std,
            model=predicted.model,
            given=parameter.value,
        )
        for predicted in design.told
        for parameter in (predicted.prediction.parameters if predicted.prediction is not None else ())
    ]
    return FlightFacts(
        vehicle=choices.entry.name,
        autopilot=autopilot,
        room_m=reached.position_m,
        height_m=height_m,
        climb_m=climb_m,
        tilt_rad=reached.tilt_rad,
        rate_rad_s=reached.rate_rad_s,
        motors=(max(reached.motor_low, 0.0), min(reached.motor_high, 1.0)),
        bounds=tuple(bounds),
        firmware=choices.firmware,
        computed_for=computed_for(choices),
    )


def write_simulation(
    folder: Path,
    choices: SimulateSettings,
    *,
    command: Sequence[str],
) -> SimulationDocument:
    """Fly all runs one after the other, and write their logs, ``plan.json`` and ``simulation.json`` into a folder.

    Parameters
    ----------
    folder
        Where they go; it is made when missing. Files of the same names are replaced.
    choices
        What is to be flown.
    command
        What the user typed, for the document.
    """
    from rotorid.documents.design import plan_document, simulation_document
    from rotorid.flying.simulation import SimulatedLog, fly_run, simulation_of, write_run

    logs: list[SimulatedLog] = []
    documents: list[SimulationDocument] = []

    def fly(number: int) -> Callable[[Path], None]:
        def write(path: Path) -> None:
            _PROGRESS.info(
                f"flying {choices.entry.name}" + (f", {number + 1} of {choices.runs}" if choices.runs > 1 else ""),
                extra={"done": number, "total": choices.runs},
            )
            logs.append(write_run(path, fly_run(choices, number), choices))

        return write

    def conclude(path: Path) -> None:
        documents.append(simulation_document(simulation_of(choices, logs, command=command)))
        write_atomically(path, to_json(documents[0]))

    # In the order of the mapping: the document needs the logs' hashes.
    files: dict[str, Content] = {name: fly(number) for number, name in enumerate(choices.file_names)}
    if choices.plan is not None:
        files["plan.json"] = plan_document(choices.plan)
    write_together(folder, {**files, "simulation.json": conclude})
    return documents[0]


def write_flown(folder: Path, flown: FlownModel, *, title: str) -> None:
    """Write ``flown.json``, ``flown.npz`` and ``report.html`` of a model that flew, and logs of a plan.

    Raises
    ------
    UsageError
        The folder cannot be written.
    """
    from rotorid.documents.flown import FLOWN, SIGNALS, flown_arrays, flown_document
    from rotorid.io.tables.csv import write_csv
    from rotorid.report.flown import render_flown

    page = render_flown(flown, title=title)
    files: dict[str, Content] = {
        log.file: partial(write_csv, time_s=log.time_s, columns=log.columns) for log in flown.logs
    }
    files |= {SIGNALS: flown_arrays(flown), FLOWN: flown_document(flown), "report.html": page}
    write_together(folder, files)


def write_tuning(folder: Path, proposal: TuningProposal, *, title: str, check_folder: str = "") -> None:
    """Write ``tune.json``, ``tune.npz``, ``report.html`` and the files of the autopilot with the way back.

    Parameters
    ----------
    folder
        Where they go.
    proposal
        What ``tune`` found.
    title
        Heading of the page.
    check_folder
        The folder as the user will type it, where it is known.

    Raises
    ------
    UsageError
        The folder cannot be written.
    """
    from rotorid.documents.tune import SIGNALS, TUNE, tune_arrays, tune_document
    from rotorid.report.tune import render_tune

    page = render_tune(proposal, title=title, check_folder=check_folder)
    own: dict[str, Content] = {SIGNALS: tune_arrays(proposal), TUNE: tune_document(proposal), "report.html": page}
    write_together(folder, {**own, **proposal.files, **proposal.rollback_files})


def write_tuning_check(folder: Path, found: CheckedTuning, *, title: str) -> None:
    """Write ``check.json`` and ``report.html`` of a flight with proposed gains.

    Parameters
    ----------
    folder
        Where they go.
    found
        What ``tune --check`` found.
    title
        Heading of the page.

    Raises
    ------
    UsageError
        The folder cannot be written.
    """
    from rotorid.documents.tune_check import CHECK, tune_check_document
    from rotorid.report.tune import render_check

    write_together(folder, {CHECK: tune_check_document(found), "report.html": render_check(found, title=title)})


def write_bench_design(folder: Path, design: BenchDesign, *, command: Sequence[str]) -> BenchDesignDocument:
    """Write ``design.json``, ``plan.json``, samples and the card of a plan for a rig into a folder."""
    from rotorid.documents.bench import bench_design_document
    from rotorid.documents.design import plan_document
    from rotorid.plans.csv import plan_csv
    from rotorid.report.bench_card import bench_card

    files: dict[str, Content] = {
        "plan.json": plan_document(design.plan),
        **plan_csv(design.plan),
        **bench_card(design),
    }
    document = bench_design_document(design, files=sorted(files), command=command)
    write_together(folder, {**files, "design.json": document})
    return document


def write_rig_simulation(
    folder: Path,
    *,
    seed: int,
    command: Sequence[str],
    plan: FlightPlan | None = None,
    settings: BenchSettings | None = None,
) -> SimulationDocument:
    """Move the rig on its pivot, and write its log and ``simulation.json`` into a folder."""
    from rotorid.documents.design import simulation_document
    from rotorid.flying.simulation import LOG_NAME, move_rig, rig_simulation, write_rig

    record = move_rig(seed, plan, settings=settings)
    documents: list[SimulationDocument] = []

    def conclude(path: Path) -> None:
        place = path.with_name(LOG_NAME)
        moved = rig_simulation(record, place, seed=seed, command=command, plan=plan, settings=settings)
        documents.append(simulation_document(moved))
        write_atomically(path, to_json(documents[0]))

    write_together(folder, {LOG_NAME: lambda path: write_rig(path, record), "simulation.json": conclude})
    return documents[0]
