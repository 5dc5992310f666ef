r"""The delay between an input and an output, as a fraction of a sample, with an interval, and what it means.

A delay and lags of higher order look alike: in the band that data cover, :math:`e^{-\tau s} \approx 1 / (1 + \tau s)`.
A number of milliseconds therefore belongs to a model: it is the dead time that is left when a lag of a stated order has
taken its part of the phase, as the equivalent delay of handling-qualities work is. Orders are chosen among few, by an
information criterion, and the delay that each of the others would have stands beside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from rotorid.data.findings import Finding
from rotorid.data.history import TimeHistory
from rotorid.data.immutable import Immutable
from rotorid.data.response import FrequencyResponse
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fit.delay_acausal import Acausal, steep_output
from rotorid.fit.delay_findings import acausal_finding, disagreement, lag_or_delay
from rotorid.fit.delay_fit import DelayProblem, Limits, OrderFit, fit_order, interval_s, simplest
from rotorid.fit.delay_model import InputHold, LateLag, Order
from rotorid.fit.delay_record import RecordFit, RecordSpectra, record_spectra
from rotorid.fit.delay_response import ResponseFit, ResponsePoints
from rotorid.fit.delay_samples import delay_in_samples
from rotorid.typing import BoolArray

Method: TypeAlias = Literal["records", "response", "samples"]

STABLE_ORDERS = (Order(0, 1), Order(0, 2), Order(1, 2))
"""Lags of a response that a controller made: first and second order, as low-order equivalent systems take them."""

AIRFRAME_ORDERS = (Order(0, 1), Order(0, 2), Order(1, 2), Order(2, 3))
"""Lags of an airframe inside a loop: rotors behind a damped rotation, or the slow modes of hover."""

HIGHER_ORDER = Order(0, 3)
"""Tried for comparison only: what a third lag would take from the delay."""

LONGEST_S, EARLIEST_S = 0.3, -0.15
"""Delays of multirotors are below; negative ones are for outputs that were filtered."""

FASTEST_GROWTH_RAD_S = 10.0
"""No loop with the delay of a multirotor holds an airframe that diverges faster."""

_SHORTEST_SHARE = 0.2
_FEWEST_LINES, _FEWEST_POINTS = 12, 8
_REWEIGHTINGS = 2
_STILL, _JUMP, _IN_JUMPS = 0.01, 0.2, 0.8


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
        Standard deviation and interval of 95 %, of what noise does within the model; ``None`` for whole samples.
    order
        Of the lag beside which this is the delay.
    band_rad_s
        Band of the data; ``None`` for whole samples.
    orders
        Fits of all orders that were tried, under one spectrum of the noise, so that they compare.
    """

    method: Method
    delay_s: float
    std_s: float | None = None
    interval_s: tuple[float, float] | None = None
    order: Order | None = None
    band_rad_s: tuple[float, float] | None = None
    orders: tuple[OrderFit, ...] = ()

    @property
    def meaning(self) -> str:
        """What the number is, for a person."""
        if self.order is None:
            return "whole samples by which an ARX model of second order predicts best"
        source = "fitted to the records" if self.method == "records" else "fitted to the frequency response"
        return f"dead time beside a lag of {self.order.words}, {source}"


@dataclass(frozen=True, kw_only=True, eq=False)
class DelayAnalysis(Immutable):
    """Everything about the delay of one pair of channels.

    Parameters
    ----------
    input, output
        Channels.
    sample_s
        Sample interval of the data.
    hold
        How the input was taken to go on between its samples.
    recommended
        The estimate to use.
    others
        The other ones, for comparison.
    as_filtered
        Where the outputs had been filtered without phase: what a fit of the whole band would have said.
    findings
        Remarks.
    """

    input: str
    output: str
    sample_s: float
    hold: InputHold
    recommended: DelayEstimate
    others: tuple[DelayEstimate, ...]
    as_filtered: DelayEstimate | None
    findings: tuple[Finding, ...]


def estimate_delay(
    histories: Sequence[TimeHistory],
    *,
    input: str,
    output: str,
    hold: InputHold | None = None,
    feedback: bool = False,
    airframe: bool = False,
    response: tuple[FrequencyResponse, BoolArray] | None = None,
    orders: Sequence[Order] = (),
    highest_rad_s: float = np.inf,
) -> DelayAnalysis:
    """Estimate the delay from an input to an output.

    The records themselves give the estimate where the input holds no feedback of the output. Where it does, gusts come
    back through the controller and bias it, and a joint frequency response is better. Delays are looked for from
    −150 ms to 300 ms, and less in short records.

    Parameters
    ----------
    histories
        Records of one rate.
    input, output
        Channels in them.
    hold
        Whether the input holds between its samples; by default judged by how often it repeats.
    feedback
        Whether the input contains feedback of the output.
    airframe
        Whether the output is that of a bare airframe, which may be unstable; otherwise a controller made it stable.
    response
        The frequency response of the pair and which of its points can be used, shape ``(1, 1, f)``; None to do without.
    orders
        Lags to choose among, instead of those that suit the pair.
    highest_rad_s
        Up to where the records are looked at; by default as far as the input has power.

    Raises
    ------
    InsufficientDataError
        The records are too short, or nothing moves.
    UsageError
        Records of different rates came.

    Notes
    -----
    A held input counts from its stamp. Where a log samples a command that was sent some time before, the delay comes
    out too short by that time, half a sample on average.
    """
    _require(histories, input, output)
    hold = hold or input_hold(histories, input)
    limits = _limits(histories, airframe)
    sample_s = 1.0 / histories[0].sample_rate_hz
    orders = tuple(orders) or (AIRFRAME_ORDERS if airframe else STABLE_ORDERS)
    filtered = None if feedback else steep_output(histories, input=input, output=output)
    highest_rad_s = min(highest_rad_s, filtered.passed_rad_s if filtered else np.inf)
    estimates = [_of_records(histories, input, output, hold, limits, orders, highest_rad_s)]
    as_filtered = _as_filtered(histories, input, output, hold, limits) if filtered else None
    if not (filtered and as_filtered and _without_phase(filtered, as_filtered, estimates[0])):
        as_filtered = None
    if response is not None:
        joint = response[0].estimate == "joint"
        # A direct response stands beside the records, and compares only with the same lag.
        lags = orders if feedback and joint else tuple(o for o in orders if o == estimates[0].order)
        if by_response := _of_response(*response, limits, lags, filtered, hold, sample_s):
            estimates = [by_response, *estimates] if feedback and joint else [*estimates, by_response]
    whole = _in_samples(histories, input, output, limits.delays_s, feedback)
    findings = [
        *acausal_finding(filtered, input, output, estimates[0].delay_s, as_filtered.delay_s if as_filtered else None),
        *lag_or_delay(input, output, estimates[0].order, estimates[0].orders, estimates[0].interval_s),
        *disagreement(
            input, output, [(e.method, e.delay_s, e.interval_s) for e in estimates if e.order == estimates[0].order]
        ),
    ]
    return DelayAnalysis(
        input=input,
        output=output,
        sample_s=sample_s,
        hold=hold,
        recommended=estimates[0],
        others=(*estimates[1:], whole),
        as_filtered=as_filtered,
        findings=tuple(findings),
    )


def input_hold(histories: Sequence[TimeHistory], input: str) -> InputHold:
    """``held`` where the input rests from most samples to the next and moves in jumps: steps, binary signals."""
    steps = np.concatenate([np.abs(np.diff(history[input])) for history in histories])
    span = max(float(np.ptp(history[input])) for history in histories)
    jumps = float(steps[steps > _JUMP * span].sum())
    # A command at rest repeats too, however it is sent; only one that moves in jumps alone is surely held.
    still = float(np.mean(steps <= _STILL * span))
    return "held" if still > 0.5 and jumps > _IN_JUMPS * float(steps.sum()) else "smooth"


def _require(histories: Sequence[TimeHistory], input: str, output: str) -> None:
    if not histories:
        raise InsufficientDataError("no record came", needed="at least one")
    rates = [history.sample_rate_hz for history in histories]
    if max(rates) > 1.02 * min(rates):
        raise UsageError(f"records of {min(rates):.4g} to {max(rates):.4g} Hz came", needed="records of one rate")
    for name in (input, output):
        if all(np.ptp(history[name]) == 0.0 for history in histories):
            raise InsufficientDataError(f"{name} does not move", needed="records in which input and output move")


def _limits(histories: Sequence[TimeHistory], airframe: bool) -> Limits:
    longest = max(history.duration_s for history in histories)
    latest, earliest = min(LONGEST_S, _SHORTEST_SHARE * longest), max(EARLIEST_S, -_SHORTEST_SHARE * longest)
    return Limits(delays_s=(earliest, latest), fastest_rad_s=FASTEST_GROWTH_RAD_S if airframe else 0.0)


def _without_phase(filtered: Acausal, whole_band: DelayEstimate, below: DelayEstimate) -> bool:
    """Whether a steep filter on the output had no phase: a causal one would have delayed the whole band the more."""
    least = below.interval_s[0] if below.interval_s else below.delay_s
    return filtered.ahead or whole_band.delay_s < min(least, below.delay_s)


def _of_records(
    histories: Sequence[TimeHistory],
    input: str,
    output: str,
    hold: InputHold,
    limits: Limits,
    orders: Sequence[Order],
    highest_rad_s: float,
) -> DelayEstimate:
    """The delay by the records, up to a frequency."""
    data = record_spectra(histories, input=input, output=output, delays_s=limits.delays_s, highest_rad_s=highest_rad_s)
    lines = data.count // 2
    if lines < _FEWEST_LINES:
        raise InsufficientDataError(
            f"{lines} lines of the spectrum came", needed=f"{_FEWEST_LINES} and more", remedy="use a longer record"
        )
    scale = _scale(np.concatenate([part.omega_rad_s for part in data.parts]))

    def posed(order: Order, of: RecordSpectra) -> RecordFit:
        model = LateLag(order=order, scale_rad_s=scale, hold=hold, sample_s=data.sample_s)
        return RecordFit(data=of, model=model)

    # All orders are compared under one spectrum of the noise, that of the best among them.
    widest = max(orders, key=lambda order: order.coefficients)
    best = fit_order(posed(widest, data), limits)
    data = posed(best.order, data).reweighted(best.solution.theta).data
    tried = tuple(dict.fromkeys((*orders, HIGHER_ORDER)))
    fits = [fit_order(posed(order, data), limits) for order in tried]
    best = min(fits, key=lambda fit: fit.criterion)
    data = posed(best.order, data).reweighted(best.solution.theta).data
    fits = [fit_order(posed(fit.order, data), limits, start=fit.solution.theta) for fit in fits]
    chosen = simplest([fit for fit in fits if fit.order in orders])
    for _ in range(_REWEIGHTINGS):
        problem = posed(chosen.order, data).reweighted(chosen.solution.theta)
        data = problem.data
        chosen = fit_order(problem, limits, start=chosen.solution.theta)
    omega = np.concatenate([part.omega_rad_s for part in data.parts])
    return _estimate("records", problem, chosen, fits, limits, (float(omega.min()), float(omega.max())))


def _as_filtered(
    histories: Sequence[TimeHistory], input: str, output: str, hold: InputHold, limits: Limits
) -> DelayEstimate:
    """What a second order fitted to the whole band says, every line counting alike as least squares in time do."""
    data = record_spectra(histories, input=input, output=output, delays_s=limits.delays_s)
    omega = np.concatenate([part.omega_rad_s for part in data.parts])
    model = LateLag(order=Order(0, 2), scale_rad_s=_scale(omega), hold=hold, sample_s=data.sample_s)
    flat = [replace(part, noise=np.full(part.noise.size, _power(part.output))) for part in data.parts]
    problem = RecordFit(data=data.with_parts(flat), model=model)
    fit = fit_order(problem, limits)
    return _estimate("records", problem, fit, [fit], limits, (float(omega.min()), float(omega.max())))


def _power(values: np.ndarray) -> float:
    return float(np.mean(np.abs(values) ** 2))


def _of_response(
    response: FrequencyResponse,
    used: BoolArray,
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
    scale = _scale(points.omega_rad_s)

    def posed(order: Order) -> DelayProblem:
        return ResponseFit(data=points, model=LateLag(order=order, scale_rad_s=scale, hold=hold, sample_s=sample_s))

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
    return DelayEstimate(
        method=method,
        delay_s=chosen.delay_s,
        std_s=chosen.std_s,
        interval_s=interval_s(problem, chosen, limits),
        order=chosen.order,
        band_rad_s=band_rad_s,
        orders=tuple(sorted(fits, key=lambda fit: (fit.order.coefficients, fit.order.poles))),
    )


def _in_samples(
    histories: Sequence[TimeHistory], input: str, output: str, delays_s: tuple[float, float], feedback: bool
) -> DelayEstimate:
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


def _scale(omega_rad_s: np.ndarray) -> float:
    return float(np.sqrt(omega_rad_s.min() * omega_rad_s.max()))
