"""The documents of planned and simulated flights: ``plan.json``, ``design.json`` and ``simulation.json``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field, ValidationError

from rotorid.data.flight_plan import Entry, FlightPlan, PlannedInput, Shape
from rotorid.documents.base import Document, FindingDocument, ManeuverDocument, ProvenanceDocument
from rotorid.errors import UsageError
from rotorid.typing import Axis

if TYPE_CHECKING:
    from rotorid.pipeline.simulation import Simulation

_LARGEST_FILE = 200_000_000
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
                axis=one.axis,
                shape=one.shape,
                start_s=one.start_s,
                stop_s=one.stop_s,
                amplitude=one.amplitude,
                band_rad_s=one.band_rad_s,
                entry=one.entry,
                settings=dict(one.settings),
                sample_rate_hz=one.sample_rate_hz,
                values=np.round(one.values, _DIGITS).tolist(),
            )
            for one in plan.inputs
        ],
    )


def plan_of(document: PlanDocument) -> FlightPlan:
    """The plan that a document holds."""
    inputs = tuple(
        PlannedInput(
            axis=one.axis,
            shape=one.shape,
            start_s=one.start_s,
            values=np.array(one.values),
            sample_rate_hz=one.sample_rate_hz,
            amplitude=one.amplitude,
            band_rad_s=one.band_rad_s,
            entry=one.entry,
            settings=one.settings,
        )
        for one in document.inputs
    )
    return FlightPlan(name=document.name, inputs=inputs, trim_s=document.trim_s)


def read_plan(path: Path) -> FlightPlan:
    """A plan from its file.

    Raises
    ------
    UsageError
        The file cannot be read, or is no plan; the message names the first place that is wrong.
    """
    try:
        if path.stat().st_size > _LARGEST_FILE:
            raise UsageError(f"{path} has {path.stat().st_size} bytes", needed=f"a plan of at most {_LARGEST_FILE}")
        document = PlanDocument.model_validate_json(path.read_bytes())
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror}", needed="a plan.json of rotorid design") from error
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"]) or "the file"
        raise UsageError(
            f"{path} is no plan: {place}: {first['msg']}", needed="a plan.json of rotorid design"
        ) from error
    return plan_of(document)


class TruthDocument(Document):
    """A number of the vehicle that flew, by the name that an identification would give it."""

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
    """What flew. ``changed`` holds what the user set otherwise than the source has it."""

    name: str
    description: str
    source: str
    autopilot: str
    control_rate_hz: float | None = None
    changed: dict[str, float] = Field(default_factory=dict)


class SimulationDocument(Document):
    """``simulation.json``: what flew, what was true, and the logs.

    ``truth`` holds the derivatives of the exact linear model about hover, in still air. ``maneuvers`` are on the clock
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
    """A test input: how large it is, and the limit that a larger one would pass (empty where none was looked for)."""

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
    """What a flight will tell about a parameter.

    ``expected`` is where the fit will end but for chance, ``std`` one standard deviation as an identification will
    state it, ``percent`` the same of ``value``, ``lowest_std`` what no estimate from the same test inputs falls below.
    """

    value: float
    unit: str
    expected: float
    std: float
    percent: float | None
    lowest_std: float
    cramer_rao_percent: float | None
    insensitivity_percent: float | None


class PredictedResponseDocument(Document):
    """Where a response will be usable, and how good it will be there: medians over its usable points."""

    band_rad_s: tuple[float, float] | None
    points: int
    coherence: float | None
    random_error: float | None


class PredictionDocument(Document):
    """What a plan will tell for a model; ``refused`` says why it could not support it.

    ``inflation`` is the factor on standard deviations that stands for a structure which does not fit what will fly.
    """

    model: str
    parameters: dict[str, PredictedParameterDocument] = Field(default_factory=dict)
    responses: dict[str, PredictedResponseDocument] = Field(default_factory=dict)
    inflation: float | None = None
    refused: str = ""
    findings: list[FindingDocument] = Field(default_factory=list)


class ShortestDocument(Document):
    """The least duration of each test input that reaches the accuracy asked for; ``null`` where none does."""

    model: str
    wanted_percent: dict[str, float]
    duration_s: float | None
    limiting: str
    words: str


class PlanSummaryDocument(Document):
    """A plan, what it reaches in the simulator, what it will tell, and the folder of its files."""

    kind: Shape
    folder: str
    duration_s: float
    inputs: list[TestInputDocument]
    reached: ReachedDocument
    predictions: list[PredictionDocument]
    shortest: list[ShortestDocument] = Field(default_factory=list)
    files: list[str] = Field(default_factory=list)


class DesignDocument(Document):
    """``design.json``: plans, what they will tell, and which of them tells most about each parameter (``best``)."""

    schema_name: Annotated[Literal["rotorid.design/1"], Field(alias="schema")] = "rotorid.design/1"
    vehicle: VehicleDocument
    limits: dict[str, float]
    plans: list[PlanSummaryDocument]
    best: dict[str, str] = Field(default_factory=dict)
    findings: list[FindingDocument] = Field(default_factory=list)
    provenance: ProvenanceDocument
