"""The documents of planned and simulated flights: ``plan.json``, ``design.json`` and ``simulation.json``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from rotorid.data.findings import Finding, worst_first
from rotorid.data.flight_plan import Entry, FlightPlan, PlannedInput, Shape
from rotorid.documents.base import Document, FindingDocument, ManeuverDocument, ProvenanceDocument, checked
from rotorid.errors import UsageError
from rotorid.flying.designs import Designed, PlanPrediction, best_of, computed_for
from rotorid.flying.settings import DesignSettings
from rotorid.flying.simulation import Simulation, flown_vehicle
from rotorid.io import documents
from rotorid.results.provenance import Provenance
from rotorid.results.summary import finite
from rotorid.typing import Axis

_DIGITS = 9


class PlannedInputDocument(Document):
    """A test input: its form, and its samples from ``start_s`` on in the unit of what it is added to."""

    axis: Axis
    shape: Shape
    start_s: float
    stop_s: float
    amplitude: float
    band_rad_s: tuple[float, float] | None = None
    entry: Entry = "command"
    motor: str = ""
    motor_unit: str = ""
    settings: dict[str, float] = Field(default_factory=dict)
    sample_rate_hz: float
    values: list[float]


class PlanDocument(Document):
    """``plan.json``: the test inputs of a flight."""

    schema_name: Annotated[Literal["rotorid.plan/1"], Field(alias="schema")] = "rotorid.plan/1"
    name: str
    duration_s: float
    trim_s: float
    inputs: list[PlannedInputDocument]


def plan_document(plan: FlightPlan) -> PlanDocument:
    """A plan as its document; samples keep nine digits."""
    return PlanDocument(
        name=plan.name,
        duration_s=plan.duration_s,
        trim_s=plan.trim_s,
        inputs=[
            PlannedInputDocument(
                axis=planned.axis,
                shape=planned.shape,
                start_s=planned.start_s,
                stop_s=planned.stop_s,
                amplitude=planned.amplitude,
                band_rad_s=planned.band_rad_s,
                entry=planned.entry,
                motor=planned.motor,
                motor_unit=planned.motor_unit,
                settings=dict(planned.settings),
                sample_rate_hz=planned.sample_rate_hz,
                values=np.round(planned.values, _DIGITS).tolist(),
            )
            for planned in plan.inputs
        ],
    )


def plan_of(document: PlanDocument) -> FlightPlan:
    """The plan of a document."""
    inputs = tuple(
        PlannedInput(
            axis=planned.axis,
            shape=planned.shape,
            start_s=planned.start_s,
            values=np.array(planned.values),
            sample_rate_hz=planned.sample_rate_hz,
            amplitude=planned.amplitude,
            band_rad_s=planned.band_rad_s,
            entry=planned.entry,
            motor=planned.motor,
            motor_unit=planned.motor_unit,
            settings=planned.settings,
        )
        for planned in document.inputs
    )
    return FlightPlan(name=document.name, inputs=inputs, trim_s=document.trim_s)


def read_plan(path: Path) -> FlightPlan:
    """A plan from its file.

    Parameters
    ----------
    path
        The JSON file that ``design`` wrote.

    Raises
    ------
    UsageError
        The file cannot be read, or is no plan; the message names the first place that is wrong.
    """
    wanted = "a plan.json from rotorid design"
    text = documents.read_text(path, needed=wanted, most_bytes=documents.MOST_JSON_BYTES)
    try:
        plan = plan_of(checked(PlanDocument, documents.parse_json(text)))
    except documents.DocumentError as error:
        raise UsageError(f"{path} is not a plan: {error}", needed=wanted) from error
    return plan


class TruthDocument(Document):
    """A true value of the vehicle, by the name of the identified parameter."""

    value: float
    unit: str


class ReachedDocument(Document):
    """Extremes of a flight: true motion, outputs to the motors, share of the time with motors at a limit."""

    tilt_rad: float
    rate_rad_s: float
    position_m: float
    height_m: float
    motor_low: float
    motor_high: float
    saturated: float


class SimulatedLogDocument(Document):
    """A log that was written: its seed, the numbers drawn for it (``changed``), and what the flight reached."""

    file: str
    format: str
    sha256: str
    seed: int
    duration_s: float
    changed: dict[str, float] = Field(default_factory=dict)
    reached: ReachedDocument | None = None


class VehicleDocument(Document):
    """The vehicle. ``changed`` contains the values that the user changed."""

    name: str
    description: str
    source: str
    autopilot: str
    control_rate_hz: float | None = None
    changed: dict[str, float] = Field(default_factory=dict)


class SimulationDocument(Document):
    """``simulation.json``: the vehicle, true values, and the logs.

    ``truth`` contains the derivatives of the exact linear model about hover, in still air. ``maneuvers`` use the clock
    of the logs.
    """

    schema_name: Annotated[Literal["rotorid.simulation/1"], Field(alias="schema")] = "rotorid.simulation/1"
    vehicle: VehicleDocument
    logs: list[SimulatedLogDocument]
    maneuvers: list[ManeuverDocument] = Field(default_factory=list)
    truth: dict[str, TruthDocument]
    findings: list[FindingDocument] = Field(default_factory=list)
    provenance: ProvenanceDocument


def simulation_document(simulation: Simulation) -> SimulationDocument:
    """What ``rotorid simulate`` writes."""
    return SimulationDocument.model_validate(simulation)


class TestInputDocument(Document):
    """A test input: its size, and the limit that a larger one would exceed (empty where the size was given)."""

    axis: str
    shape: Shape
    entry: Entry
    start_s: float
    stop_s: float
    amplitude: float
    unit: str
    band_rad_s: tuple[float, float] | None = None
    limited_by: str = ""


class PredictedParameterDocument(Document):
    """The predicted estimate of a parameter.

    ``expected`` is the mean of the later estimates, ``std`` one standard deviation that the identification will state,
    ``percent`` the same relative to ``value``, ``std_random`` and ``std_model`` its parts, ``lowest_std`` the lower
    bound for any estimate from the same test inputs.
    """

    value: float
    unit: str
    expected: float
    std: float
    percent: float | None
    std_random: float
    std_model: float
    lowest_std: float
    cramer_rao_percent: float | None
    insensitivity_percent: float | None


class PredictedResponseDocument(Document):
    """The usable band of a response, and its quality there: medians over usable points."""

    band_rad_s: tuple[float, float] | None
    points: int
    coherence: float | None
    random_error: float | None


class PredictionDocument(Document):
    """The prediction of a plan for a model; ``refused`` is the reason where the data do not support it.

    ``inflation`` is the factor on standard deviations that comes of model errors and clocks, in the geometric mean;
    ``model_error`` what the structure misses in each response, relative.
    """

    model: str
    parameters: dict[str, PredictedParameterDocument] = Field(default_factory=dict)
    responses: dict[str, PredictedResponseDocument] = Field(default_factory=dict)
    inflation: float | None = None
    model_error: dict[str, float] = Field(default_factory=dict)
    refused: str = ""
    findings: list[FindingDocument] = Field(default_factory=list)


class ShortestDocument(Document):
    """The shortest duration of each test input that reaches the requested accuracy; ``null`` where none does."""

    model: str
    wanted_percent: dict[str, float]
    duration_s: float | None
    limiting: str
    words: str


class PlanSummaryDocument(Document):
    """A plan, its extremes in the simulator, its predictions, and the folder of its files."""

    kind: Shape
    folder: str
    duration_s: float
    inputs: list[TestInputDocument]
    reached: ReachedDocument
    predictions: list[PredictionDocument]
    shortest: list[ShortestDocument] = Field(default_factory=list)
    files: list[str] = Field(default_factory=list)


class DesignDocument(Document):
    """``design.json``: plans with their predictions, and the best plan for each parameter (``best``)."""

    schema_name: Annotated[Literal["rotorid.design/1"], Field(alias="schema")] = "rotorid.design/1"
    vehicle: VehicleDocument
    limits: dict[str, float]
    plans: list[PlanSummaryDocument]
    best: dict[str, str] = Field(default_factory=dict)
    findings: list[FindingDocument] = Field(default_factory=list)
    provenance: ProvenanceDocument


def design_document(
    choices: DesignSettings,
    designed: Sequence[Designed],
    written: Sequence[tuple[str, Sequence[str]]],
    *,
    findings: Sequence[Finding],
    autopilot: str,
    command: Sequence[str] = (),
) -> DesignDocument:
    """What ``rotorid design`` writes.

    Parameters
    ----------
    choices, designed
        The choices, and the designed plans.
    written
        The folder of each plan and the names of its files.
    findings
        Findings on plans and files.
    autopilot
        The autopilot of the files.
    """
    provenance = Provenance(
        command=tuple(command),
        settings={
            "turbulence_m_s": choices.plan.wind.turbulence_m_s,
            "wind_north_m_s": choices.plan.wind.north_m_s,
            "wind_east_m_s": choices.plan.wind.east_m_s,
            "prior": choices.prior.source if choices.prior is not None else None,
            "gains": choices.gains_source or None,
            "gyro_noise_rad_s": choices.gyro_noise_rad_s,
            "hover_throttle": choices.hover_throttle,
            "computed_for": computed_for(choices),
            "autopilot": autopilot,
        },
        seed=choices.plan.seed,
    )
    return DesignDocument(
        vehicle=VehicleDocument.model_validate(flown_vehicle(choices.entry, choices.aircraft, choices.changes)),
        limits=asdict(choices.plan.limits),
        plans=[_plan_summary(plan, *files) for plan, files in zip(designed, written, strict=True)],
        best=best_of(designed),
        findings=_findings(findings),
        provenance=ProvenanceDocument.model_validate(provenance),
    )


def _findings(findings: Sequence[Finding]) -> list[FindingDocument]:
    return [FindingDocument.model_validate(finding) for finding in worst_first(findings)]


def _plan_summary(designed: Designed, folder: str, files: Sequence[str]) -> PlanSummaryDocument:
    planned = designed.planned
    return PlanSummaryDocument(
        kind=designed.kind,
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
                unit=part.unit,
                band_rad_s=part.band_rad_s,
                limited_by=planned.limited_by(part),
            )
            for part in planned.plan.inputs
        ],
        reached=ReachedDocument.model_validate(planned.reached),
        predictions=[_prediction(predicted) for predicted in designed.told],
        shortest=[
            ShortestDocument(
                model=model,
                wanted_percent=dict(designed.wanted[model]),
                duration_s=found.duration_s,
                limiting=found.limiting,
                words=found.words,
            )
            for model, found in designed.shortest.items()
        ],
        files=list(files),
    )


def _prediction(predicted: PlanPrediction) -> PredictionDocument:
    prediction = predicted.prediction
    if prediction is None:
        return PredictionDocument(
            model=predicted.model, refused=predicted.refused, findings=_findings(predicted.findings)
        )
    return PredictionDocument(
        model=predicted.model,
        parameters={
            parameter.name: PredictedParameterDocument(
                value=parameter.value,
                unit=parameter.unit,
                expected=parameter.expected,
                std=parameter.std,
                percent=finite(parameter.percent),
                std_random=parameter.std_random,
                std_model=parameter.std_model,
                lowest_std=parameter.lowest_std,
                cramer_rao_percent=finite(parameter.cramer_rao_percent),
                insensitivity_percent=finite(parameter.insensitivity_percent),
            )
            for parameter in prediction.parameters
        },
        responses={
            f"{output}/{command}": _response(predicted, y, u)
            for y, output in enumerate(prediction.response.outputs)
            for u, command in enumerate(prediction.response.inputs)
        },
        inflation=prediction.inflation,
        model_error=dict(prediction.model_error),
        findings=_findings(prediction.findings),
    )


def _response(predicted: PlanPrediction, output: int, command: int) -> PredictedResponseDocument:
    prediction = predicted.prediction
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
