"""What ``fleet.json`` holds, schema ``rotorid.fleet/1``: what a table of many logs says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal

from pydantic import Field

from rotorid import __version__
from rotorid.documents.base import Document
from rotorid.documents.review import QuantityDocument
from rotorid.fleets.analysis import FleetAnalysis, History
from rotorid.fleets.populations import Population
from rotorid.fleets.table import FAILED, TABLE, Failed
from rotorid.pipeline.summary import finite


class FailedLogDocument(Document):
    """A log, or a model of one of its flights, without an answer, and why; ``flight`` 0 and no model: the whole log."""

    log: str
    flight: int
    model: str
    kind: str
    reason: str


class PopulationDocument(Document):
    """One parameter over the fleet.

    ``normal`` is the range in which 95 % of further flights of further vehicles lie; ``model_std`` a typical stated
    model error, which is alike in all of them. Standard deviations are ``null`` where too few flew to tell.
    """

    unit: str
    mean: QuantityDocument
    between_std: QuantityDocument | None
    within_std: QuantityDocument | None
    normal: tuple[float, float]
    model_std: float
    vehicles: int
    flights: int


class ChangeDocument(Document):
    """A step of a parameter of one vehicle; ``at_flight`` is the first flight after it, from 1, in ``log``."""

    vehicle: str
    model: str
    parameter: str
    at_flight: int
    log: str
    before: QuantityDocument
    after: QuantityDocument
    probability: float


class CauseDocument(Document):
    """The steps of one vehicle at one log together, and what usually lies behind such a pattern."""

    vehicle: str
    at_flight: int
    log: str
    words: str
    usual: str


class DriftDocument(Document):
    """A slow change of one vehicle; ``slope`` is per flight."""

    vehicle: str
    model: str
    parameter: str
    slope: QuantityDocument
    probability: float


class OddVehicleDocument(Document):
    """A vehicle that lies apart from all others."""

    vehicle: str
    model: str
    parameter: str
    probability: float


class OddFlightDocument(Document):
    """A flight that lies apart from those before and after it."""

    vehicle: str
    model: str
    parameter: str
    flight: int
    log: str
    value: QuantityDocument
    expected: float
    probability: float


class OutliersDocument(Document):
    """What does not belong to the rest."""

    vehicles: list[OddVehicleDocument] = Field(default_factory=list)
    flights: list[OddFlightDocument] = Field(default_factory=list)


class DifferenceDocument(Document):
    """What one group of flights differs in from another; ``found`` where chance hardly does that."""

    model: str
    parameter: str
    group: str
    against: str
    difference: QuantityDocument
    relative: float | None
    probability: float
    found: bool


class FleetDocument(Document):
    """``fleet.json``: what a table of many logs says.

    Probabilities are those of chance alone, over all flights of the series; what is listed was chosen over the whole
    fleet so that at most 5 % of it is false.
    """

    schema_name: Annotated[Literal["rotorid.fleet/1"], Field(alias="schema")] = "rotorid.fleet/1"
    version: str = __version__
    command: list[str] = Field(default_factory=list)
    settings: dict[str, str | int | float | bool | list[str] | None] = Field(default_factory=dict)
    logs: int
    done: int
    resumed: int
    duplicates: int
    rows: int
    vehicles: int
    table: str = TABLE
    failed_table: str = FAILED
    failed: list[FailedLogDocument] = Field(default_factory=list)
    population: dict[str, dict[str, PopulationDocument]] = Field(default_factory=dict)
    changes: list[ChangeDocument] = Field(default_factory=list)
    causes: list[CauseDocument] = Field(default_factory=list)
    drifts: list[DriftDocument] = Field(default_factory=list)
    outliers: OutliersDocument = OutliersDocument()
    groups: list[DifferenceDocument] = Field(default_factory=list)


def fleet_document(
    analysis: FleetAnalysis,
    *,
    failed: Sequence[Failed],
    counts: Mapping[str, int],
    settings: Mapping[str, Any],
    command: Sequence[str] = (),
) -> FleetDocument:
    """What a fleet said as ``fleet.json`` holds it.

    Parameters
    ----------
    analysis
        Of its table.
    failed
        What gave no answer.
    counts
        ``logs``, ``done``, ``resumed``, ``duplicates``, ``rows``, ``vehicles``.
    settings
        What was asked.
    command
        Words of the command line.
    """
    population: dict[str, dict[str, PopulationDocument]] = {}
    for (model, parameter), one in analysis.populations.items():
        population.setdefault(model, {})[parameter] = _population(one)
    histories = analysis.histories
    return FleetDocument(
        logs=counts["logs"],
        done=counts["done"],
        resumed=counts["resumed"],
        duplicates=counts["duplicates"],
        rows=counts["rows"],
        vehicles=counts["vehicles"],
        command=list(command),
        settings=dict(settings),
        failed=[FailedLogDocument.model_validate(one) for one in failed],
        population=population,
        changes=[
            ChangeDocument(
                **_who(one),
                at_flight=change.at_flight,
                log=one.rows[change.at_flight - 1].log,
                before=QuantityDocument.model_validate(change.before),
                after=QuantityDocument.model_validate(change.after),
                probability=change.probability,
            )
            for one in histories
            for change in one.changes
        ],
        causes=[CauseDocument.model_validate(one) for one in analysis.causes],
        drifts=[
            DriftDocument(
                **_who(one),
                slope=QuantityDocument.model_validate(one.drift.slope),
                probability=one.drift.probability,
            )
            for one in histories
            if one.drift is not None
        ],
        outliers=OutliersDocument(
            vehicles=[
                OddVehicleDocument(**_who(one), probability=one.odd_vehicle)
                for one in histories
                if one.odd_vehicle is not None
            ],
            flights=[
                OddFlightDocument(
                    **_who(one),
                    flight=odd.flight,
                    log=one.rows[odd.flight - 1].log,
                    value=QuantityDocument.model_validate(odd.value),
                    expected=odd.expected,
                    probability=odd.probability,
                )
                for one in histories
                for odd in one.odd
            ],
        ),
        groups=[
            DifferenceDocument.model_validate({**one.__dict__, "relative": finite(one.relative)})
            for one in analysis.differences
        ],
    )


def _who(one: History) -> dict[str, str]:
    return {"vehicle": one.vehicle, "model": one.model, "parameter": one.parameter}


def _population(one: Population) -> PopulationDocument:
    def told(value: Any) -> QuantityDocument | None:
        if value is None:
            return None
        return QuantityDocument(
            value=value.value,
            std=finite(value.std),
            lower=finite(value.lower),
            upper=finite(value.upper),
            unit=value.unit,
        )

    return PopulationDocument(
        unit=one.mean.unit,
        mean=QuantityDocument.model_validate(one.mean),
        between_std=told(one.between),
        within_std=told(one.within),
        normal=(one.low, one.high),
        model_std=one.model_std,
        vehicles=one.vehicles,
        flights=one.flights,
    )
