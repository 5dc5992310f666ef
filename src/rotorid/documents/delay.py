"""``delay.json``, schema ``rotorid.delay/1``: delays between channels."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from rotorid.documents.base import Document, FindingDocument, ManeuverDocument, ProvenanceDocument
from rotorid.fitting.delay.estimate import EARLIEST_S, LONGEST_S, DelayEstimate
from rotorid.fitting.delay.fit import OrderFit

if TYPE_CHECKING:
    from rotorid.identifying.delays import Delays, PairDelay
    from rotorid.results.provenance import Refused


class OrderDelayDocument(Document):
    """The delay fitted with a lag of one order; the least ``criterion`` fits best."""

    order: str
    zeros: int
    poles: int
    delay_s: float
    std_s: float | None = None
    criterion: float


class DelayEstimateDocument(Document):
    """A delay by one method: ``records``, ``response`` or ``samples``.

    ``std_s`` and ``interval_s`` (95 %) include noise within the model of ``order`` (``std_random_s`` alone) and the
    clocks of a log. They are ``null`` for whole samples, and ``std_s`` also where the interval does not have its width.
    ``orders`` are the delays with other lags.
    """

    method: Literal["records", "response", "samples"]
    delay_s: float
    delay_samples: float
    std_s: float | None = None
    interval_s: tuple[float, float] | None = None
    std_random_s: float | None = None
    order: str | None = None
    meaning: str
    band_rad_s: tuple[float, float] | None = None
    orders: list[OrderDelayDocument] = Field(default_factory=list)


class DelayPairDocument(Document):
    """The delay from one input to one output.

    ``recommended`` is the estimate to use, ``others`` are for comparison. ``whole_band`` is given where outputs were
    filtered without phase: the estimate of the whole band. ``feedback`` is whether the input contains feedback of the
    output, ``instrument`` the channel that removes its bias. Where records differ,
    ``sample_s`` is the longest sample interval among them and ``hold`` is ``mixed``. ``records`` has the delay of each
    of several logs, with a lag of the recommended order; ``null`` where a log shows none.
    """

    sample_s: float
    hold: Literal["held", "smooth", "mixed"]
    feedback: bool
    instrument: str | None = None
    recommended: DelayEstimateDocument
    others: list[DelayEstimateDocument]
    whole_band: DelayEstimateDocument | None = None
    records: dict[str, DelayEstimateDocument | None] = Field(default_factory=dict)
    maneuvers: list[ManeuverDocument]


class CommandRateDocument(Document):
    """Commands of one channel in one log: by the stamps ``rate_hz``, its ``jitter_s`` and ``longest_s`` interval.

    ``hold_s`` is the median time for which a value stays. ``delay_s`` of ``output`` is ``null`` where the log alone
    shows none.
    """

    record: str
    input: str
    output: str
    rate_hz: float
    jitter_s: float
    longest_s: float
    hold_s: float | None = None
    delay_s: float | None = None
    std_s: float | None = None


class DelayDocument(Document):
    """``delay.json``: delays by pair ``output/input``, and how often commands came."""

    schema_name: Annotated[Literal["rotorid.delay/1"], Field(alias="schema")] = "rotorid.delay/1"
    pairs: dict[str, DelayPairDocument] = Field(default_factory=dict)
    rates: list[CommandRateDocument] = Field(default_factory=list)
    findings: list[FindingDocument] = Field(default_factory=list)
    provenance: ProvenanceDocument


def delay_document(result: Delays | Refused) -> DelayDocument:
    """The document of delays; for a refusal only its findings."""
    pairs = {name: _pair(pair) for name, pair in getattr(result, "pairs", {}).items()}
    rates = [asdict(rate) for rate in getattr(result, "rates", ())]
    return DelayDocument.model_validate(
        {"pairs": pairs, "rates": rates, "findings": result.findings, "provenance": result.provenance}
    )


def _pair(pair: PairDelay) -> DelayPairDocument:
    estimates = {
        "recommended": _estimate(pair.recommended, pair.sample_s),
        "others": [_estimate(estimate, pair.sample_s) for estimate in pair.others],
        "whole_band": _estimate(pair.whole_band, pair.sample_s) if pair.whole_band else None,
        "records": {name: estimate and _estimate(estimate, pair.sample_s) for name, estimate in pair.alone.items()},
    }
    plain = {name: getattr(pair, name) for name in ("sample_s", "hold", "feedback", "instrument", "maneuvers")}
    return DelayPairDocument.model_validate(plain | estimates)


def _estimate(estimate: DelayEstimate, sample_s: float) -> DelayEstimateDocument:
    return DelayEstimateDocument(
        method=estimate.method,
        delay_s=estimate.delay_s,
        delay_samples=estimate.delay_s / sample_s,
        std_s=_known_std(estimate.std_s),
        interval_s=estimate.interval_s,
        std_random_s=_known_std(estimate.std_random_s),
        order=estimate.order.words if estimate.order else None,
        meaning=estimate.meaning,
        band_rad_s=estimate.band_rad_s,
        orders=[_order(fit) for fit in estimate.orders],
    )


def _order(fit: OrderFit) -> OrderDelayDocument:
    return OrderDelayDocument(
        order=fit.order.words,
        zeros=fit.order.zeros,
        poles=fit.order.poles,
        delay_s=fit.delay_s,
        std_s=_known_std(fit.std_s),
        criterion=fit.criterion,
    )


def _known_std(value: float | None) -> float | None:
    """A standard deviation, unless it is wider than all delays that were tried."""
    return value if value is not None and value < LONGEST_S - EARLIEST_S else None
