"""The document that holds a flight plan: what ``rotorid design`` writes, and ``rotorid simulate --plan`` flies."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, ValidationError

from rotorid.data.flight_plan import Entry, FlightPlan, PlannedInput, Shape
from rotorid.errors import UsageError
from rotorid.pipeline.document_base import Document
from rotorid.typing import Axis

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
