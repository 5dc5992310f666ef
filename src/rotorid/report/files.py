"""Write what an identification answers: all files complete, or none.

Write what a run of ``response`` answers: all files complete, or none.

Write what a design answers: plans, their files for pilot and autopilot, and what they will tell; all or none.

Write simulated flights: all logs and what was true of them, or none.
"""

from __future__ import annotations

import logging
import math
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from rotorid import __version__
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.flight_plan import FlightPlan
from rotorid.documents.base import ProvenanceDocument
from rotorid.documents.design import (
    DesignDocument,
    PlanSummaryDocument,
    PredictedParameterDocument,
    PredictedResponseDocument,
    PredictionDocument,
    ReachedDocument,
    ShortestDocument,
    SimulationDocument,
    TestInputDocument,
    VehicleDocument,
    plan_document,
    simulation_document,
)
from rotorid.documents.response import response_document
from rotorid.documents.result import measured_arrays, response_arrays, result_document
from rotorid.documents.result import to_json as to_json
from rotorid.errors import UsageError
from rotorid.io.files import write_atomically, write_npz
from rotorid.pipeline.assemble import finding_documents
from rotorid.pipeline.designs import Designed, Told, best_of, beyond_limits
from rotorid.pipeline.flight_settings import DesignChoices, SimulateChoices
from rotorid.pipeline.responses import Responses
from rotorid.pipeline.results import IdentifiedModel
from rotorid.pipeline.simulation import (
    LOG_NAME,
    SimulatedLog,
    flown_vehicle,
    fly_run,
    move_rig,
    rig_simulation,
    simulation_of,
    write_rig,
    write_run,
)
from rotorid.plans.ardupilot import ardupilot_files
from rotorid.plans.betaflight import betaflight_files
from rotorid.plans.csv import plan_csv
from rotorid.plans.facts import Autopilot, FlightFacts, PredictedBound, unit_of
from rotorid.plans.px4 import px4_files
from rotorid.report.design import render_design
from rotorid.report.flight_card import flight_card, flight_card_pdf
from rotorid.report.identification import render_report
from rotorid.report.response import render_responses

_PROGRESS = logging.getLogger("rotorid.progress")


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
    write_together(
        folder,
        {
            "result.json": lambda path: write_atomically(path, to_json(result_document(model))),
            "responses.npz": lambda path: write_npz(path, response_arrays(model.data)),
            "model.toml": lambda path: write_atomically(path, model.to_toml()),
            "report.html": lambda path: write_atomically(path, render_report([model], title=title, truth=truth)),
        },
    )


def write_together(folder: Path, files: Mapping[str, Callable[[Path], None]]) -> None:
    """Write several files into a folder: all complete, or none.

    The files are made in a temporary folder inside the target and moved there one by one when all of them are complete:
    no file is ever partial, and a run that fails leaves the files of the run before.

    Parameters
    ----------
    folder
        Where they go; it is made when missing. Files of the same names are replaced.
    files
        Name of each file to what writes it.

    Raises
    ------
    UsageError
        The folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        making = Path(tempfile.mkdtemp(prefix=".making-", dir=folder))
    except OSError as error:
        raise UsageError(
            f"{folder} cannot be written: {error.strerror}",
            needed="a folder to write to",
            remedy="choose it with --out",
        ) from error
    try:
        for name, write in files.items():
            write(making / name)
        for file in sorted(making.iterdir()):
            file.replace(folder / file.name)
    finally:
        shutil.rmtree(making)


def write_overview_report(
    path: Path, models: Sequence[IdentifiedModel], *, title: str, truth: Mapping[str, float] | None = None
) -> None:
    """Write one report about several identifications."""
    write_atomically(path, render_report(models, title=title, truth=truth))


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
    write_together(
        folder,
        {
            "response.json": lambda path: write_atomically(path, to_json(response_document(result))),
            "responses.npz": lambda path: write_npz(path, arrays(result)),
            "report.html": lambda path: write_atomically(path, render_responses(result, title=title)),
        },
    )


def arrays(result: Responses) -> dict[str, np.ndarray]:
    """Arrays of ``responses.npz``; no pickles, names as plain text."""
    diagnostics = result.measured.diagnostics
    found = measured_arrays(result.response, result.measured.beside) | {
        "used": result.used,
        "window_share": diagnostics.share,
        "window_error": diagnostics.window_error,
        "multiple_coherence": diagnostics.multiple_coherence,
        "leakage": diagnostics.leakage,
        "input_coherence": diagnostics.input_coherence,
        "condition": diagnostics.condition,
    }
    for axis, loop in result.loops.items():
        if loop.loop is not None:
            found |= {
                f"{axis}_loop_omega_rad_s": loop.loop.omega_rad_s,
                f"{axis}_loop_values": loop.loop.values[0, 0],
                f"{axis}_loop_random_error": loop.loop.random_error[0, 0],
            }
    return found


_AUTOPILOTS: Mapping[str, Autopilot] = {"px4": "PX4", "ardupilot": "ArduPilot", "betaflight": "Betaflight"}


def write_design(
    folder: Path,
    choices: DesignChoices,
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
    kind = autopilot or choices.aircraft.autopilot.kind
    words: Autopilot = _AUTOPILOTS.get(kind, "other")
    require_autopilot(autopilot)
    findings: list[Finding] = []
    summaries: list[PlanSummaryDocument] = []
    for one in designed:
        place = folder / one.kind if len(designed) > 1 else folder
        files, remarks = _files(one, choices, words, explicit=autopilot is not None)
        findings += remarks
        write_together(place, {name: _writer(content) for name, content in files.items()})
        summaries.append(_summary(one, "" if place == folder else one.kind, sorted(files)))
    document = DesignDocument(
        vehicle=VehicleDocument.model_validate(flown_vehicle(choices.vehicle, choices.aircraft, choices.changes)),
        limits=asdict(choices.plan.limits),
        plans=summaries,
        best=best_of(designed),
        findings=finding_documents(findings),
        provenance=ProvenanceDocument(
            version=__version__,
            command=list(command),
            inputs={},
            settings={
                "turbulence_m_s": choices.plan.wind.turbulence_m_s,
                "wind_north_m_s": choices.plan.wind.north_m_s,
                "wind_east_m_s": choices.plan.wind.east_m_s,
                "prior": choices.prior.source if choices.prior is not None else None,
                "gains": choices.gains_source or None,
                "autopilot": words,
            },
            seed=choices.plan.seed,
        ),
    )
    page = render_design(designed, choices, title=_title(designed, choices), document=document)
    write_together(folder, {"design.json": _writer(to_json(document)), "design.html": _writer(page)})
    return document


def _title(designed: Sequence[Designed], choices: DesignChoices) -> str:
    return f"{'A flight plan' if len(designed) == 1 else f'{len(designed)} flight plans'} for {choices.vehicle}"


def require_autopilot(name: str | None) -> None:
    """Refuse an autopilot for which there are no files."""
    if name is not None and name not in _AUTOPILOTS:
        raise UsageError(f"--for {name} came", needed=f"one of {', '.join(_AUTOPILOTS)}")


def _writer(content: str | bytes) -> Callable[[Path], None]:
    return lambda path: write_atomically(path, content)


def _files(
    one: Designed, choices: DesignChoices, autopilot: Autopilot, *, explicit: bool
) -> tuple[dict[str, str | bytes], list[Finding]]:
    """Files of a plan by name; what an autopilot cannot fly is remarked on, and an error where it was asked for."""
    plan, facts = one.planned.plan, _facts(one, choices, autopilot)
    card = flight_card(plan, facts)
    files: dict[str, str | bytes] = {"plan.json": to_json(plan_document(plan)), **plan_csv(plan), **card}
    findings = beyond_limits(one, choices.plan.limits)
    if find_spec("weasyprint") is None:
        message = "The flight card was not written as PDF, for weasyprint is not installed: pip install 'rotorid[pdf]'."
        findings.append(remark("not_written", one.kind, message))
    else:
        try:
            files |= {f"{Path(name).stem}.pdf": flight_card_pdf(html) for name, html in card.items()}
        except UsageError as error:
            findings.append(_unwritten(one.kind, "The flight card was not written as PDF", error))
    try:
        files |= _autopilot_files(autopilot, plan, facts)
    except UsageError as error:
        if explicit:
            raise
        findings.append(_unwritten(one.kind, f"No files for {autopilot} were written", error))
    return files, findings


def _autopilot_files(autopilot: Autopilot, plan: FlightPlan, facts: FlightFacts) -> dict[str, str]:
    if autopilot == "ArduPilot":
        return ardupilot_files(plan, facts)
    if autopilot == "PX4":
        return px4_files(plan, facts)
    return betaflight_files(plan, facts) if autopilot == "Betaflight" else {}


def _unwritten(kind: str, what: str, error: UsageError) -> Finding:
    return warn("not_written", kind, f"{what}: {error}")


def _facts(one: Designed, choices: DesignChoices, autopilot: Autopilot) -> FlightFacts:
    reached = one.planned.reached
    bounds = [
        PredictedBound(
            name=parameter.name,
            unit=parameter.unit,
            value=parameter.expected,
            std=parameter.std,
            model=told.model,
        )
        for told in one.told
        for parameter in (told.prediction.parameters if told.prediction is not None else ())
    ]
    return FlightFacts(
        vehicle=choices.vehicle,
        autopilot=autopilot,
        room_m=reached.position_m,
        height_m=max(choices.plan.wind.height_m, 3.0 * reached.height_m),
        climb_m=reached.height_m,
        tilt_rad=reached.tilt_rad,
        rate_rad_s=reached.rate_rad_s,
        motors=(max(reached.motor_low, 0.0), min(reached.motor_high, 1.0)),
        bounds=tuple(bounds),
    )


def _summary(one: Designed, folder: str, files: Sequence[str]) -> PlanSummaryDocument:
    planned = one.planned
    return PlanSummaryDocument(
        kind=one.kind,
        folder=folder,
        duration_s=planned.plan.duration_s,
        inputs=[
            TestInputDocument(
                axis=part.axis,
                shape=part.shape,
                entry=part.entry,
                start_s=part.start_s,
                stop_s=part.stop_s,
                amplitude=part.amplitude,
                unit=unit_of(part),
                band_rad_s=part.band_rad_s,
                limited_by=planned.limited_by(part),
            )
            for part in planned.plan.inputs
        ],
        reached=ReachedDocument.model_validate(planned.reached),
        predictions=[_prediction(told) for told in one.told],
        shortest=[
            ShortestDocument(
                model=model,
                wanted_percent=dict(one.wanted[model]),
                duration_s=found.duration_s,
                limiting=found.limiting,
                words=found.words,
            )
            for model, found in one.shortest.items()
        ],
        files=list(files),
    )


def _prediction(told: Told) -> PredictionDocument:
    prediction = told.prediction
    if prediction is None:
        return PredictionDocument(model=told.model, refused=told.refused)
    return PredictionDocument(
        model=told.model,
        parameters={
            one.name: PredictedParameterDocument(
                value=one.value,
                unit=one.unit,
                expected=one.expected,
                std=one.std,
                percent=_finite(one.percent),
                lowest_std=one.lowest_std,
                cramer_rao_percent=_finite(one.in_percent(one.cramer_rao)),
                insensitivity_percent=_finite(one.in_percent(one.insensitivity)),
            )
            for one in prediction.parameters
        },
        responses={
            f"{output}/{command}": _response(told, y, u)
            for y, output in enumerate(prediction.response.outputs)
            for u, command in enumerate(prediction.response.inputs)
        },
        inflation=prediction.inflation,
        findings=finding_documents(prediction.findings),
    )


def _response(told: Told, output: int, command: int) -> PredictedResponseDocument:
    import numpy as np

    prediction = told.prediction
    assert prediction is not None
    used = prediction.used[output, command]
    if not used.any():
        return PredictedResponseDocument(band_rad_s=None, points=0, coherence=None, random_error=None)
    omega = prediction.response.omega_rad_s[used]
    return PredictedResponseDocument(
        band_rad_s=(float(omega[0]), float(omega[-1])),
        points=int(used.sum()),
        coherence=float(np.median(prediction.response.coherence[output, command][used])),
        random_error=float(np.median(prediction.response.random_error[output, command][used])),
    )


def _finite(number: float) -> float | None:
    return number if math.isfinite(number) else None


def write_simulation(
    folder: Path,
    choices: SimulateChoices,
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
    logs: list[SimulatedLog] = []
    documents: list[SimulationDocument] = []

    def fly(number: int) -> Callable[[Path], None]:
        def write(path: Path) -> None:
            _PROGRESS.info(
                f"flying {choices.vehicle}" + (f", {number + 1} of {choices.runs}" if choices.runs > 1 else ""),
                extra={"done": number, "total": choices.runs},
            )
            logs.append(write_run(path, fly_run(choices, number), choices))

        return write

    def conclude(path: Path) -> None:
        documents.append(simulation_document(simulation_of(choices, logs, command=command)))
        write_atomically(path, to_json(documents[0]))

    # In the order of the mapping: the document needs the logs' hashes.
    files = {name: fly(number) for number, name in enumerate(choices.file_names)}
    if choices.plan is not None:
        text = to_json(plan_document(choices.plan))
        files["plan.json"] = lambda path: write_atomically(path, text)
    write_together(folder, {**files, "simulation.json": conclude})
    return documents[0]


def write_rig_simulation(folder: Path, *, seed: int, command: Sequence[str]) -> SimulationDocument:
    """Move the rig on its pivot, and write its log and ``simulation.json`` into a folder."""
    record = move_rig(seed)
    documents: list[SimulationDocument] = []

    def conclude(path: Path) -> None:
        moved = rig_simulation(record, path.with_name(LOG_NAME), seed=seed, command=command)
        documents.append(simulation_document(moved))
        write_atomically(path, to_json(documents[0]))

    write_together(folder, {LOG_NAME: lambda path: write_rig(path, record), "simulation.json": conclude})
    return documents[0]
