"""``fleet.json``, schema ``rotorid.fleet/1``: what many logs show of their vehicles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal

from pydantic import Field

from rotorid import __version__
from rotorid.documents.base import Document
from rotorid.documents.review import QuantityDocument, bounded_document
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
    """The steps of one vehicle at one log together, and the usual cause of such a pattern."""

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
    """A vehicle unlike all others."""

    vehicle: str
    model: str
    parameter: str
    probability: float


class OddFlightDocument(Document):
    """A flight unlike those before and after it."""

    vehicle: str
    model: str
    parameter: str
    flight: int
    log: str
    value: QuantityDocument
    expected: float
    probability: float


class OutliersDocument(Document):
    """Vehicles and flights unlike the rest."""

    vehicles: list[OddVehicleDocument] = Field(default_factory=list)
    flights: list[OddFlightDocument] = Field(default_factory=list)


class DifferenceDocument(Document):
    """The difference between two groups of flights; ``found`` where chance is an unlikely cause."""

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
    """Whether a vehicle changed in its ``flights``; ``why`` is the reason where there is not enough data."""

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


class OutOfBalanceDocument(Document):
    """A vehicle whose motors share the work less evenly than those of healthy vehicles, in ``flights``."""

    vehicle: str
    flights: int
    of_flights: int
    imbalance: QuantityDocument


class YawFlightDocument(Document):
    """One flight: its mean voltage, yaw drift or trim, and its slope, ``null`` where the voltage did not move."""

    vehicle: str
    log: str
    flight: int
    voltage_v: float
    value: QuantityDocument
    slope: QuantityDocument | None


class YawOverVoltageDocument(Document):
    """Yaw drift or trim over battery voltage.

    ``within`` is the slope within flights, ``between`` that between flights of a vehicle; ``null`` where there are not
    enough data, for the reason in ``why_within`` or ``why_between``.
    """

    parameter: str
    within: QuantityDocument | None
    between: QuantityDocument | None
    why_within: str = ""
    why_between: str = ""
    flights: list[YawFlightDocument] = Field(default_factory=list)


class FleetDocument(Document):
    """``fleet.json``: what many logs show of their vehicles.

    ``sentences`` are those of terminal and page, the answer first. Logs are ``done``, ``refused``, ``unreadable`` or
    ``duplicates``; ``skipped`` are names of other files in the same folders, which are no logs. Probabilities are those
    of chance alone, over all flights of the series. At most 5 % of what is listed is expected to be a false alarm.
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
    skipped: list[str] = Field(default_factory=list)
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
    out_of_balance: list[OutOfBalanceDocument] = Field(default_factory=list)
    yaw_over_voltage: list[YawOverVoltageDocument] = Field(default_factory=list)


def fleet_document(
    analysis: FleetAnalysis,
    *,
    failed: Sequence[Failed],
    counts: Counts,
    settings: Mapping[str, Any],
    command: Sequence[str] = (),
) -> FleetDocument:
    """The analysis of a fleet as ``fleet.json``.

    Parameters
    ----------
    analysis
        Of its table.
    failed
        What gave no answer.
    counts
        Of its logs.
    """
    population: dict[str, dict[str, PopulationDocument]] = {}
    for (model, parameter), item in analysis.populations.items():
        population.setdefault(model, {})[parameter] = _population(item)
    histories, verdicts = analysis.histories, verdicts_of(analysis)
    return FleetDocument(
        logs=counts.logs,
        done=counts.answered,
        refused=counts.refused,
        unreadable=counts.unreadable,
        resumed=counts.resumed,
        duplicates=counts.duplicates,
        skipped=list(counts.skipped),
        rows=counts.rows,
        vehicles=len(verdicts),
        sentences=list(sentences(analysis, counts)),
        checked=CheckedDocument.model_validate(checked(verdicts)),
        verdicts=[_verdict(verdict) for verdict in verdicts],
        several_vehicles=[SeveralVehiclesDocument.model_validate(vehicles) for vehicles in analysis.several],
        other_gains=[OtherGainsDocument.model_validate(gains) for gains in analysis.other_gains],
        command=list(command),
        settings=dict(settings),
        failed=[FailedLogDocument.model_validate(failure) for failure in failed],
        population=population,
        changes=[
            ChangeDocument(
                **_who(history),
                at_flight=change.at_flight,
                log=history.rows[change.at_flight - 1].log,
                before=QuantityDocument.model_validate(change.before),
                after=QuantityDocument.model_validate(change.after),
                probability=change.probability,
            )
            for history in histories
            for change in history.changes
        ],
        causes=[CauseDocument.model_validate(cause) for cause in analysis.causes],
        drifts=[
            DriftDocument(
                **_who(history),
                slope=QuantityDocument.model_validate(history.drift.slope),
                probability=history.drift.probability,
            )
            for history in histories
            if history.drift is not None
        ],
        outliers=OutliersDocument(
            vehicles=[
                OddVehicleDocument(**_who(history), probability=history.odd_vehicle)
                for history in histories
                if history.odd_vehicle is not None
            ],
            flights=[
                OddFlightDocument(
                    **_who(history),
                    flight=odd.flight,
                    log=history.rows[odd.flight - 1].log,
                    value=QuantityDocument.model_validate(odd.value),
                    expected=odd.expected,
                    probability=odd.probability,
                )
                for history in histories
                for odd in history.odd
            ],
        ),
        groups=[
            DifferenceDocument.model_validate({**difference.__dict__, "relative": finite(difference.relative)})
            for difference in analysis.differences
        ],
        out_of_balance=[
            OutOfBalanceDocument(
                vehicle=one.vehicle,
                flights=one.flights,
                of_flights=one.of_flights,
                imbalance=QuantityDocument.model_validate(one.imbalance),
            )
            for one in analysis.unbalanced
        ],
        yaw_over_voltage=[YawOverVoltageDocument.model_validate(one) for one in analysis.yaw],
    )


def _verdict(verdict: VehicleVerdict) -> VehicleVerdictDocument:
    return VehicleVerdictDocument(
        vehicle=verdict.vehicle,
        flights=verdict.flights,
        verdict=verdict.verdict,
        why=verdict.why,
        numbers=[
            CheckedNumberDocument(
                model=model, parameter=name, verdict=found, detectable_share=finite(verdict.detectable[model, name])
            )
            for (model, name), found in verdict.numbers.items()
        ],
    )


def _who(history: History) -> dict[str, str]:
    return {"vehicle": history.vehicle, "model": history.model, "parameter": history.parameter}


def _population(population: Population) -> PopulationDocument:
    return PopulationDocument(
        unit=population.mean.unit,
        mean=QuantityDocument.model_validate(population.mean),
        between_std=None if population.between is None else bounded_document(population.between),
        within_std=None if population.within is None else bounded_document(population.within),
        normal=None if population.low is None or population.high is None else (population.low, population.high),
        scale="log" if population.scale.logarithmic else "linear",
        model_std=population.model_std,
        vehicles=population.vehicles,
        flights=population.flights,
    )
