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
from rotorid.fleets.table import FAILED, TABLE, Counts, Failed
from rotorid.fleets.verdicts import VehicleVerdict, checked, sentences, verdicts_of
from rotorid.results.summary import finite
from rotorid.uncertainty.differences import NOTICEABLE_SHARE, Verdict


class FailedLogDocument(Document):
    """A log, or a model of one of its flights, without an answer, and why; ``flight`` 0 and no model: the whole log."""

    log: str
    flight: int
    model: str
    kind: str
    reason: str


class PopulationDocument(Document):
    """One parameter over the fleet.

    ``normal`` is the range in which 95 % of further flights of further vehicles lie (of a single vehicle, its own
    further flights), ``null`` for fewer than four flights and for two vehicles; ``model_std`` a typical stated model
    error, which is alike in all of them. Standard deviations are ``null`` where too few flew. On the scale ``log``
    spreads are shares of the mean, so that no range passes zero.
    """

    unit: str
    mean: QuantityDocument
    between_std: QuantityDocument | None
    within_std: QuantityDocument | None
    normal: tuple[float, float] | None
    scale: Literal["linear", "log"] = "linear"
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


class CheckedNumberDocument(Document):
    """One number of a vehicle; ``detectable_share`` is the change that would have been found, ``null`` where none."""

    model: str
    parameter: str
    verdict: Verdict
    detectable_share: float | None


class VehicleVerdictDocument(Document):
    """Whether a vehicle changed, as far as its ``flights`` decide that; ``why`` says why they do not."""

    vehicle: str
    flights: int
    verdict: Verdict
    why: str
    numbers: list[CheckedNumberDocument] = Field(default_factory=list)


class CheckedDocument(Document):
    """For how many vehicles and numbers a change could be looked for: the others are undecided, not unchanged."""

    vehicles: int = 0
    of_vehicles: int = 0
    numbers: int = 0
    of_numbers: int = 0
    changed: int = 0
    unchanged: int = 0
    noticeable_share: float = NOTICEABLE_SHARE


class SeveralVehiclesDocument(Document):
    """A name that logs of several vehicles had in common."""

    name: str
    vehicles: list[str]


class OtherGainsDocument(Document):
    """A log that was flown with other gains than the one before it; ``gains`` name to the value before and since."""

    vehicle: str
    log: str
    at_flight: int
    gains: dict[str, tuple[float, float]]


class FleetDocument(Document):
    """``fleet.json``: what a table of many logs says.

    ``sentences`` are those of terminal and page, the answer first. Logs are ``done``, ``refused``, ``unreadable`` or
    ``duplicates``. Probabilities are those of chance alone, over all flights of the series; what is listed was chosen
    over the whole fleet so that at most 5 % of it is false.
    """

    schema_name: Annotated[Literal["rotorid.fleet/1"], Field(alias="schema")] = "rotorid.fleet/1"
    version: str = __version__
    command: list[str] = Field(default_factory=list)
    settings: dict[str, str | int | float | bool | list[str] | None] = Field(default_factory=dict)
    logs: int
    done: int
    refused: int = 0
    unreadable: int = 0
    resumed: int
    duplicates: int
    rows: int
    vehicles: int
    sentences: list[str] = Field(default_factory=list)
    checked: CheckedDocument = CheckedDocument()
    verdicts: list[VehicleVerdictDocument] = Field(default_factory=list)
    several_vehicles: list[SeveralVehiclesDocument] = Field(default_factory=list)
    other_gains: list[OtherGainsDocument] = Field(default_factory=list)
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
    counts: Counts,
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
        Of its logs.
    settings
        What was asked.
    command
        Words of the command line.
    """
    population: dict[str, dict[str, PopulationDocument]] = {}
    for (model, parameter), one in analysis.populations.items():
        population.setdefault(model, {})[parameter] = _population(one)
    histories, verdicts = analysis.histories, verdicts_of(analysis)
    return FleetDocument(
        logs=counts.logs,
        done=counts.answered,
        refused=counts.refused,
        unreadable=counts.unreadable,
        resumed=counts.resumed,
        duplicates=counts.duplicates,
        rows=counts.rows,
        vehicles=len(verdicts),
        sentences=list(sentences(analysis, counts)),
        checked=CheckedDocument.model_validate(checked(verdicts)),
        verdicts=[_verdict(one) for one in verdicts],
        several_vehicles=[SeveralVehiclesDocument.model_validate(one) for one in analysis.several],
        other_gains=[OtherGainsDocument.model_validate(one) for one in analysis.other_gains],
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


def _verdict(one: VehicleVerdict) -> VehicleVerdictDocument:
    return VehicleVerdictDocument(
        vehicle=one.vehicle,
        flights=one.flights,
        verdict=one.verdict,
        why=one.why,
        numbers=[
            CheckedNumberDocument(
                model=model, parameter=name, verdict=found, detectable_share=finite(one.detectable[model, name])
            )
            for (model, name), found in one.numbers.items()
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
        normal=None if one.low is None or one.high is None else (one.low, one.high),
        scale="log" if one.scale.logarithmic else "linear",
        model_std=one.model_std,
        vehicles=one.vehicles,
        flights=one.flights,
    )
