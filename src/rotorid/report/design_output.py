"""Write what a design answers: plans, their files for pilot and autopilot, and what they will tell; all or none."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from importlib.util import find_spec
from pathlib import Path

from rotorid import __version__
from rotorid.data.findings import Finding
from rotorid.data.flight_plan import FlightPlan
from rotorid.errors import UsageError
from rotorid.io.store import write_atomically
from rotorid.pipeline.assemble import finding_documents
from rotorid.pipeline.design import DesignChoices, Designed, Told, best_of, beyond_limits
from rotorid.pipeline.design_document import (
    DesignDocument,
    PlanSummaryDocument,
    PredictedParameterDocument,
    PredictedResponseDocument,
    PredictionDocument,
    ShortestDocument,
    TestInputDocument,
)
from rotorid.pipeline.document import ProvenanceDocument
from rotorid.pipeline.plan_document import plan_document
from rotorid.pipeline.simulation import vehicle_document
from rotorid.pipeline.simulation_document import ReachedDocument
from rotorid.report.design_page import render_design
from rotorid.report.flight_card import flight_card, flight_card_pdf
from rotorid.report.flight_facts import Autopilot, FlightFacts, PredictedBound, unit_of
from rotorid.report.output import to_json, write_together
from rotorid.report.plan_ardupilot import ardupilot_files
from rotorid.report.plan_betaflight import betaflight_files
from rotorid.report.plan_csv import plan_csv
from rotorid.report.plan_px4 import px4_files

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
        vehicle=vehicle_document(choices.vehicle, choices.aircraft, choices.changes),
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
        findings.append(Finding(kind="not_written", severity="info", where=one.kind, message=message))
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
    return Finding(kind="not_written", severity="warning", where=kind, message=f"{what}: {error}")


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
        reached=ReachedDocument(**asdict(planned.reached)),
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
