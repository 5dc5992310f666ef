"""Delays of one pair of channels by one method each: by the records, by the frequency response, in whole samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from rotorid.data.history import TimeHistory
from rotorid.data.immutable import Immutable
from rotorid.data.response import FrequencyResponse
from rotorid.errors import InsufficientDataError
from rotorid.fit.delay_acausal import Acausal
from rotorid.fit.delay_fit import (
    NO_EVIDENCE,
    NORMAL_95,
    DelayProblem,
    Limits,
    OrderFit,
    fit_order,
    interval_s,
    simplest,
)
from rotorid.fit.delay_model import InputHold, LateLag, Order
from rotorid.fit.delay_record import RecordFit, record_spectra
from rotorid.fit.delay_response import ResponseFit, ResponsePoints
from rotorid.fit.delay_samples import delay_in_samples
from rotorid.typing import BoolArray, FloatArray

Method: TypeAlias = Literal["records", "response", "samples"]

HIGHER_ORDER = Order(0, 3)
"""Tried for comparison only: what a third lag would take from the delay."""

_FEWEST_LINES, _FEWEST_POINTS = 12, 8
_REWEIGHTINGS = 2
_AT_LIMIT_S = 1e-4
_SAME_WIDTH = 2.0


@dataclass(frozen=True, kw_only=True, eq=False)
class DelayEstimate(Immutable):
    """A delay by one method.

    Parameters
    ----------
    method
        ``records``: a late lag on the Fourier transforms of the records; ``response``: on the frequency response;
        ``samples``: whole samples by ARX models.
    delay_s
        The estimate; negative where the output runs ahead.
    std_s, interval_s
        Standard deviation and interval of 95 %, of what noise does within the model; ``None`` for whole samples. The
        standard deviation is ``None`` too where the interval is not of its width, as beside poles that merge.
    order
        Of the lag beside which this is the delay.
    band_rad_s
        Band of the data; ``None`` for whole samples.
    orders
        Fits of all orders that were tried, under one spectrum of the noise, so that they compare.
    unseen
        Why the number tells no delay; empty where it does.
    """

    method: Method
    delay_s: float
    std_s: float | None = None
    interval_s: tuple[float, float] | None = None
    order: Order | None = None
    band_rad_s: tuple[float, float] | None = None
    orders: tuple[OrderFit, ...] = ()
    unseen: str = ""

    @property
    def meaning(self) -> str:
        """What the number is, for a person."""
        if self.order is None:
            return "whole samples by which an ARX model of second order predicts best"
        source = "fitted to the records" if self.method == "records" else "fitted to the frequency response"
        return f"dead time beside a lag of {self.order.words}, {source}"


def by_records(
    histories: Sequence[TimeHistory],
    pair: tuple[str, str],
    *,
    holds: Sequence[InputHold],
    limits: Limits,
    orders: Sequence[Order],
    highest_rad_s: float,
) -> DelayEstimate:
    """The delay from an input to an output by the records, up to a frequency.

    Raises
    ------
    InsufficientDataError
        The records are too short.
    """
    data = record_spectra(
        histories, input=pair[0], output=pair[1], holds=holds, delays_s=limits.delays_s, highest_rad_s=highest_rad_s
    )
    lines = data.count // 2
    if lines < _FEWEST_LINES:
        raise InsufficientDataError(
            f"{lines} lines of the spectrum came", needed=f"{_FEWEST_LINES} and more", remedy="use a longer record"
        )
    scale = float(np.sqrt(np.prod(data.band_rad_s)))

    def posed(order: Order, noise: tuple[FloatArray, ...]) -> RecordFit:
        return RecordFit(data=data, noise=noise, model=_lag(order, scale, data.parts[0].hold, data.parts[0].sample_s))

    # All orders are compared under one spectrum of the noise, that of the best among them.
    widest = max(orders, key=lambda order: order.coefficients)
    best = fit_order(posed(widest, data.white), limits)
    noise = posed(best.order, data.white).reweighted(best.solution.theta).noise
    tried = tuple(dict.fromkeys((*orders, HIGHER_ORDER)))
    fits = [fit_order(posed(order, noise), limits) for order in tried]
    best = min(fits, key=lambda fit: fit.criterion)
    noise = posed(best.order, noise).reweighted(best.solution.theta).noise
    fits = [fit_order(posed(fit.order, noise), limits, start=fit.solution.theta) for fit in fits]
    chosen = simplest([fit for fit in fits if fit.order in orders])
    for _ in range(_REWEIGHTINGS):
        problem = posed(chosen.order, noise).reweighted(chosen.solution.theta)
        noise = problem.noise
        chosen = fit_order(problem, limits, start=chosen.solution.theta)
    found = _estimate("records", problem, chosen, fits, limits, data.band_rad_s)
    parameters = chosen.criterion - chosen.solution.cost
    if found.unseen or problem.evidence() > parameters + NO_EVIDENCE:
        return found
    return replace(found, unseen=f"{pair[1]} does not follow {pair[0]} more than noise does by chance")


def whole_band(
    histories: Sequence[TimeHistory], pair: tuple[str, str], *, holds: Sequence[InputHold], limits: Limits
) -> DelayEstimate:
    """What a second order fitted to the whole band says, every line counting alike as least squares in time do."""
    data = record_spectra(histories, input=pair[0], output=pair[1], holds=holds, delays_s=limits.delays_s)
    scale = float(np.sqrt(np.prod(data.band_rad_s)))
    model = _lag(Order(0, 2), scale, data.parts[0].hold, data.parts[0].sample_s)
    flat = tuple(np.full(part.lines, float(np.mean(np.abs(part.output) ** 2))) for part in data.parts)
    problem = RecordFit(data=data, noise=flat, model=model)
    fit = fit_order(problem, limits)
    return _estimate("records", problem, fit, [fit], limits, data.band_rad_s)


def by_response(
    response: FrequencyResponse,
    used: BoolArray,
    *,
    limits: Limits,
    orders: Sequence[Order],
    filtered: Acausal | None,
    hold: InputHold,
    sample_s: float,
) -> DelayEstimate | None:
    """The delay by the frequency response, or ``None`` where too little of it is coherent."""
    if filtered is not None:
        used = used & (response.omega_rad_s <= filtered.passed_rad_s)
    if np.count_nonzero(used[0, 0]) < _FEWEST_POINTS:
        return None
    points = ResponsePoints.of(response, used, (0, 0))
    scale = float(np.sqrt(points.omega_rad_s.min() * points.omega_rad_s.max()))

    def posed(order: Order) -> DelayProblem:
        return ResponseFit(data=points, model=_lag(order, scale, hold, sample_s))

    possible = [order for order in orders if 2 * points.omega_rad_s.size > order.coefficients + 1]
    fits = [fit_order(posed(order), limits) for order in possible]
    chosen = simplest(fits)
    band = float(points.omega_rad_s[0]), float(points.omega_rad_s[-1])
    return _estimate("response", posed(chosen.order), chosen, fits, limits, band)


def _estimate(
    method: Method,
    problem: DelayProblem,
    chosen: OrderFit,
    fits: Sequence[OrderFit],
    limits: Limits,
    band_rad_s: tuple[float, float],
) -> DelayEstimate:
    ends = interval_s(problem, chosen, limits)
    return DelayEstimate(
        method=method,
        delay_s=chosen.delay_s,
        std_s=_consistent(chosen.std_s, ends),
        interval_s=ends,
        order=chosen.order,
        band_rad_s=band_rad_s,
        orders=tuple(sorted(fits, key=lambda fit: (fit.order.coefficients, fit.order.poles))),
        unseen=_at_limit(chosen.delay_s, ends, limits),
    )


def _consistent(std_s: float, ends: tuple[float, float]) -> float | None:
    """The standard deviation, where the interval is about as wide as that of a normal distribution."""
    ratio = 2.0 * NORMAL_95 * std_s / max(ends[1] - ends[0], np.finfo(np.float64).tiny)
    return std_s if 1.0 / _SAME_WIDTH < ratio < _SAME_WIDTH else None


def _at_limit(delay_s: float, ends: tuple[float, float], limits: Limits) -> str:
    """What to say where the search ended at one of its limits."""
    least, most = limits.delays_s
    if min(delay_s, *ends) > least + _AT_LIMIT_S and max(delay_s, *ends) < most - _AT_LIMIT_S:
        return ""
    return (
        f"delays from {1e3 * ends[0]:.0f} to {1e3 * ends[1]:.0f} ms fit alike, of those from {1e3 * least:.0f} to "
        f"{1e3 * most:.0f} ms that were tried"
    )


def _lag(order: Order, scale_rad_s: float, hold: InputHold, sample_s: float) -> LateLag:
    return LateLag(order=order, scale_rad_s=scale_rad_s, hold=hold, sample_s=sample_s)


def in_samples(
    histories: Sequence[TimeHistory], input: str, output: str, delays_s: tuple[float, float], feedback: bool
) -> DelayEstimate:
    """The delay in whole samples of records of one rate."""
    rate = histories[0].sample_rate_hz
    least, most = (int(np.floor(limit * rate)) for limit in delays_s)
    if feedback:
        # What comes back through a controller runs ahead of the command.
        least = 0
    samples = delay_in_samples(
        [history[input] - history[input].mean() for history in histories],
        [history[output] - history[output].mean() for history in histories],
        least=least,
        most=most,
    )
    return DelayEstimate(method="samples", delay_s=samples / rate)
