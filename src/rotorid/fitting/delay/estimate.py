r"""The delay between an input and an output, as a fraction of a sample, with an interval, and what it means.

A delay and lags of higher order look alike: in the band that data cover, :math:`e^{-\tau s} \approx 1 / (1 + \tau s)`.
A number of milliseconds therefore belongs to a model: it is the dead time that is left when a lag of a stated order has
taken its part of the phase, as the equivalent delay of handling-qualities work is. Orders are chosen among few, by an
information criterion, and the delay that each of the others would have stands beside it.

A pair of channels is asked by the records, by its frequency response and in whole samples; where these disagree, or the
data do not suffice, a finding says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.quantity import TWO_SIDED_95, with_ends
from rotorid.data.record import TimeHistory
from rotorid.data.response import FrequencyResponse
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fitting.delay.checks import Acausal, delay_in_samples, steep_output
from rotorid.fitting.delay.fit import (
    NO_EVIDENCE,
    DelayedLag,
    DelayProblem,
    InputHold,
    Limits,
    Order,
    OrderFit,
    ResponseFit,
    ResponsePoints,
    fit_order,
    interval_s,
    simplest,
)
from rotorid.fitting.delay.record import RecordFit, record_spectra
from rotorid.typing import BoolArray, FloatArray

Method: TypeAlias = Literal["records", "response", "samples"]

HIGHER_ORDER = Order(0, 3)
"""Tried for comparison only: what a third lag would take from the delay."""

_FEWEST_LINES, _FEWEST_POINTS = 12, 8
_REWEIGHTINGS = 2
_AT_LIMIT_S = 1e-4
_SAME_WIDTH = 2.0
_STAMPS_SAMPLES, _STAMPS_S = 1.0, 2e-3
"""How far stamps alone may let an output run ahead: each is known within a sample."""


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
        Standard deviation and interval of 95 %: of what noise does within the model, and of a log also of what its
        clocks do. ``None`` for whole samples. The standard deviation is ``None`` too where the interval is not of its
        width, as beside poles that merge.
    std_random_s
        What noise does of it alone.
    order
        Of the lag beside which this is the delay.
    band_rad_s
        Band of the data; ``None`` for whole samples.
    orders
        Fits of all orders that were tried, under one spectrum of the noise, so that they compare.
    unseen
        Why the number is no delay; empty where it is one.
    """

    method: Method
    delay_s: float
    std_s: float | None = None
    interval_s: tuple[float, float] | None = None
    std_random_s: float | None = None
    order: Order | None = None
    band_rad_s: tuple[float, float] | None = None
    orders: tuple[OrderFit, ...] = ()
    unseen: str = ""

    @property
    def meaning(self) -> str:
        """Explanation of the number for a person."""
        if self.order is None:
            return "whole samples at which a second-order ARX model predicts best"
        source = "fitted to the records" if self.method == "records" else "fitted to the frequency response"
        return f"dead time plus a lag of {self.order.words}, {source}"

    def with_clocks(self, std_s: float) -> DelayEstimate:
        """The same estimate with known standard deviations of stamps and holds."""
        if self.interval_s is None:
            return self
        low_s, high_s = (abs(end - self.delay_s) for end in self.interval_s)
        clocks_s = TWO_SIDED_95 * std_s
        return replace(
            self,
            std_s=None if self.std_random_s is None else float(np.hypot(self.std_random_s, std_s)),
            interval_s=(
                self.delay_s - float(np.hypot(low_s, clocks_s)),
                self.delay_s + float(np.hypot(high_s, clocks_s)),
            ),
        )


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
            f"only {lines} spectral lines", needed=f"{_FEWEST_LINES} or more", remedy="use a longer record"
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
    return replace(found, unseen=f"{pair[1]} does not follow {pair[0]} more than noise would by chance")


def whole_band(
    histories: Sequence[TimeHistory], pair: tuple[str, str], *, holds: Sequence[InputHold], limits: Limits
) -> DelayEstimate:
    """The delay of a second-order model fitted to the whole band, all lines weighted alike as in the time domain."""
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
    """The delay by the frequency response, or ``None`` if too little of it is coherent."""
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
    std_s = _consistent(chosen.std_s, ends)
    return DelayEstimate(
        method=method,
        delay_s=chosen.delay_s,
        std_s=std_s,
        std_random_s=std_s,
        interval_s=ends,
        order=chosen.order,
        band_rad_s=band_rad_s,
        orders=tuple(sorted(fits, key=lambda fit: (fit.order.coefficients, fit.order.poles))),
        unseen=_at_limit(chosen.delay_s, ends, limits),
    )


def _consistent(std_s: float, ends: tuple[float, float]) -> float | None:
    """The standard deviation, where the interval is about as wide as that of a normal distribution."""
    ratio = 2.0 * TWO_SIDED_95 * std_s / max(ends[1] - ends[0], np.finfo(np.float64).tiny)
    return std_s if 1.0 / _SAME_WIDTH < ratio < _SAME_WIDTH else None


def _at_limit(delay_s: float, ends: tuple[float, float], limits: Limits) -> str:
    """The finding that the search ended at one of its limits."""
    least, most = limits.delays_s
    if min(delay_s, *ends) > least + _AT_LIMIT_S and max(delay_s, *ends) < most - _AT_LIMIT_S:
        return ""
    return (
        f"delays from {1e3 * ends[0]:.0f} to {1e3 * ends[1]:.0f} ms fit equally well, out of {1e3 * least:.0f} "
        f"to {1e3 * most:.0f} ms"
    )


def _lag(order: Order, scale_rad_s: float, hold: InputHold, sample_s: float) -> DelayedLag:
    return DelayedLag(order=order, scale_rad_s=scale_rad_s, hold=hold, sample_s=sample_s)


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


def contradicted(
    estimate: DelayEstimate, pair: tuple[str, str], *, feedback: bool, joint: bool, sample_s: float
) -> str:
    """Why an output that runs ahead of its input does so in the fit alone; empty where it does not run ahead.

    An output cannot answer before its input moves, but for a difference of stamps. What lets it seem to is feedback,
    which runs the other way, and zeros of a lag, which turn the phase as a negative delay does.

    Parameters
    ----------
    estimate
        With its interval.
    pair
        Input and output.
    feedback
        Whether the input contains feedback of the output.
    joint
        Whether an instrument kept it out.
    sample_s
        Sample interval of the data.
    """
    if estimate.interval_s is None:
        return ""
    low_s, high_s = estimate.interval_s
    stamps_s = max(_STAMPS_SAMPLES * sample_s, _STAMPS_S)
    if high_s >= (0.0 if feedback and not joint else -stamps_s):
        return ""
    input, output = pair
    came = (
        f"the estimate is {with_ends(1e3 * estimate.delay_s, 1e3 * low_s, 1e3 * high_s, 'ms')}, but {output} "
        f"cannot respond before {input} moves"
    )
    if feedback and not joint:
        return f"{came}: {input} contains feedback from {output}, in the opposite direction"
    if estimate.order is not None and estimate.order.zeros:
        return f"{came}: {_zeros(estimate)}"
    return f"{came}: their time stamps come from different clocks, or {output} passed a zero-phase filter"


def _zeros(estimate: DelayEstimate) -> str:
    plain = [fit for fit in estimate.orders if fit.order.zeros == 0]
    order = estimate.order.words if estimate.order else ""
    sentence = f"zeros of the lag ({order}) replace a delay"
    if not plain:
        return sentence
    best = min(plain, key=lambda fit: fit.criterion)
    return f"{sentence}, and without zeros the data fit worse ({1e3 * best.delay_s:.1f} ms)"


_CLEARLY_BETTER = 0.05

_WORDS = {"records": "the records", "response": "the frequency response"}


def unseen_finding(input: str, output: str, why: str) -> list[Finding]:
    """The finding on an estimate that shows no delay, and why."""
    if not why:
        return []
    return [
        warn(
            "no_delay",
            f"{output}/{input}",
            f"No delay from {input} to {output} was found: {why}. Use an input that moves {output} more, or a "
            "longer record.",
        )
    ]


def acausal_finding(
    filtered: Acausal | None, input: str, output: str, delay_s: float, as_filtered_s: float | None
) -> list[Finding]:
    """A filter without phase that went over the outputs alone."""
    if filtered is None or as_filtered_s is None:
        return []
    hidden_s = delay_s - as_filtered_s
    tail = f": the filter hides about {1e3 * hidden_s:.0f} ms" if hidden_s > 0.0 else ""
    return [
        warn(
            "acausal_output",
            f"{output}/{input}",
            f"Above {filtered.cutoff_rad_s:.3g} rad/s {output} falls by {filtered.fall_db:.0f} dB per octave, "
            "more than any vehicle, yet responds too early for a filter in flight. A zero-phase low-pass was "
            f"applied to {output} but not to {input}. Below {filtered.passed_rad_s:.3g} rad/s, where it has "
            f"little effect, the delay is {1e3 * delay_s:.0f} ms; a second-order model over the whole band finds "
            f"{1e3 * as_filtered_s:.0f} ms{tail}. Use the outputs as measured, or filter the inputs alike.",
            cutoff_rad_s=filtered.cutoff_rad_s,
            fall_db=filtered.fall_db,
            lead_s=filtered.lead_s,
            probability=filtered.probability,
            delay_whole_band_s=as_filtered_s,
            hidden_s=hidden_s,
        )
    ]


def lag_or_delay(
    input: str,
    output: str,
    order: Order | None,
    fits: Sequence[OrderFit],
    interval_s: tuple[float, float] | None,
) -> list[Finding]:
    """Another order that fits better and puts the delay elsewhere: what is called delay here may be lag."""
    if order is None or interval_s is None:
        return []
    chosen = next(fit for fit in fits if fit.order == order)
    better = [
        fit
        for fit in fits
        if fit.order.poles > order.poles
        and fit.criterion < chosen.criterion - _CLEARLY_BETTER * chosen.solution.cost
        and not interval_s[0] <= fit.delay_s <= interval_s[1]
    ]
    if not better:
        return []
    other = min(better, key=lambda fit: fit.criterion)
    return [
        remark(
            "delay_or_lag",
            f"{output}/{input}",
            f"A lag of {other.order.words} fits {output}/{input} better, with a delay of "
            f"{1e3 * other.delay_s:.1f} ms instead of {1e3 * chosen.delay_s:.1f} ms for {order.words}. The total "
            "is the same: what a low-order model calls delay is partly lag. Use each delay only with its own "
            "order.",
            delay_s=chosen.delay_s,
            other_delay_s=other.delay_s,
            other_poles=other.order.poles,
        )
    ]


def disagreement(
    input: str, output: str, estimates: Sequence[tuple[str, float, tuple[float, float] | None]]
) -> list[Finding]:
    """The finding on two estimates with the same lag whose intervals do not overlap."""
    with_interval = [(method, delay_s, ends) for method, delay_s, ends in estimates if ends is not None]
    if len(with_interval) < 2:
        return []
    (first, first_s, a), (second, second_s, b) = with_interval[:2]
    if a[0] <= b[1] and b[0] <= a[1]:
        return []
    return [
        warn(
            "delays_disagree",
            f"{output}/{input}",
            f"The delay is {with_ends(1e3 * first_s, 1e3 * a[0], 1e3 * a[1], 'ms')} from {_WORDS[first]} but "
            f"{with_ends(1e3 * second_s, 1e3 * b[0], 1e3 * b[1], 'ms')} from {_WORDS[second]}. Noise in the "
            "feedback, another band or a lag of another order causes this; use the first.",
            delay_s=first_s,
            other_delay_s=second_s,
        )
    ]


STABLE_ORDERS = (Order(0, 1), Order(0, 2), Order(1, 2))
"""Lags of a response that a controller made: first and second order, as low-order equivalent systems take them."""

AIRFRAME_ORDERS = (Order(0, 1), Order(0, 2), Order(1, 2), Order(2, 3))
"""Lags of an airframe inside a loop: rotors behind a damped rotation, or the slow modes of hover."""

LONGEST_S, EARLIEST_S = 0.3, -0.15
"""Delays of multirotors are below; negative ones are for outputs that were filtered."""

FASTEST_GROWTH_RAD_S = 10.0
"""No loop with the delay of a multirotor can stabilize an airframe that diverges faster."""

_SHORTEST_SHARE = 0.2
_SAME_RATE = 1.02
_STILL, _JUMP, _IN_JUMPS = 0.01, 0.2, 0.8


@dataclass(frozen=True, kw_only=True, eq=False)
class DelayAnalysis(Immutable):
    """Everything about the delay of one pair of channels.

    Parameters
    ----------
    input, output
        Channels.
    sample_s
        Sample interval of the data, the longest where records differ.
    hold
        How the input was taken to go on between its samples; ``mixed`` where records differ.
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
    hold: InputHold | Literal["mixed"]
    recommended: DelayEstimate
    others: tuple[DelayEstimate, ...]
    as_filtered: DelayEstimate | None
    findings: tuple[Finding, ...]

    def with_clocks(self, std_s: float) -> DelayAnalysis:
        """The same, for logs with known standard deviations of stamps and holds."""
        return replace(
            self,
            recommended=self.recommended.with_clocks(std_s),
            others=tuple(delay_estimate.with_clocks(std_s) for delay_estimate in self.others),
            as_filtered=self.as_filtered and self.as_filtered.with_clocks(std_s),
        )


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
        Records, each with a rate of its own.
    input, output
        Channels in them.
    hold
        Whether the input holds between its samples; by default judged for each record, by how often it repeats.
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
        A frequency response came for records of different rates: they have none in common.

    Notes
    -----
    A held input counts from its stamp. Where a log samples a command that was sent some time before, the delay comes
    out too short by that time, half a sample on average.
    """
    _require(histories, input, output)
    one_rate = same_rate(histories)
    if response is not None and not one_rate:
        raise _no_common_response(histories)
    holds = [hold or input_hold([history], input) for history in histories]
    limits = _limits(histories, airframe)
    sample_s = 1.0 / min(history.sample_rate_hz for history in histories)
    orders = tuple(orders) or (AIRFRAME_ORDERS if airframe else STABLE_ORDERS)
    filtered = None if feedback else steep_output(histories, input=input, output=output)
    highest_rad_s = min(highest_rad_s, filtered.passed_rad_s if filtered else np.inf)
    pair = input, output
    estimates = [by_records(histories, pair, holds=holds, limits=limits, orders=orders, highest_rad_s=highest_rad_s)]
    as_filtered = whole_band(histories, pair, holds=holds, limits=limits) if filtered else None
    if not (filtered and as_filtered and _without_phase(filtered, as_filtered, estimates[0])):
        as_filtered = None
    if response is not None:
        joint = response[0].estimate == "joint"
        # A direct response is compared with the records, with the same lag only.
        lags = orders if feedback and joint else tuple(o for o in orders if o == estimates[0].order)
        pooled = hold or input_hold(histories, input)
        if found := by_response(
            *response, limits=limits, orders=lags, filtered=filtered, hold=pooled, sample_s=sample_s
        ):
            estimates = [found, *estimates] if feedback and joint else [*estimates, found]
    if as_filtered is None and not estimates[0].unseen:
        by_joint = estimates[0].method == "response"
        why = contradicted(estimates[0], pair, feedback=feedback, joint=by_joint, sample_s=sample_s)
        estimates[0] = replace(estimates[0], unseen=why)
    # Records of different rates have no samples in common to count.
    whole = [in_samples(histories, input, output, limits.delays_s, feedback)] if one_rate else []
    findings = [
        *unseen_finding(input, output, estimates[0].unseen),
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
        hold=holds[0] if len(set(holds)) == 1 else "mixed",
        recommended=estimates[0],
        others=(*estimates[1:], *whole),
        as_filtered=as_filtered,
        findings=tuple(findings),
    )


def input_hold(histories: Sequence[TimeHistory], input: str) -> InputHold:
    """``held`` if the input is constant from most samples to the next and jumps: steps, binary signals."""
    steps = np.concatenate([np.abs(np.diff(history[input])) for history in histories])
    span = max(float(np.ptp(history[input])) for history in histories)
    jumps = float(steps[steps > _JUMP * span].sum())
    # An idle command repeats too; only one that moves in jumps is surely constant between samples.
    still = float(np.mean(steps <= _STILL * span))
    return "held" if still > 0.5 and jumps > _IN_JUMPS * float(steps.sum()) else "smooth"


def same_rate(histories: Sequence[TimeHistory]) -> bool:
    """Whether records can share a frequency response."""
    rates = [history.sample_rate_hz for history in histories]
    return max(rates) <= _SAME_RATE * min(rates)


def _no_common_response(histories: Sequence[TimeHistory]) -> UsageError:
    rates = [history.sample_rate_hz for history in histories]
    return UsageError(
        f"records of {min(rates):.4g} to {max(rates):.4g} Hz cannot give one frequency response",
        needed="records of one rate, because resampling changes the delay",
        remedy="give the logs of each rate separately",
    )


def _require(histories: Sequence[TimeHistory], input: str, output: str) -> None:
    if not histories:
        raise InsufficientDataError("no records were given", needed="at least one")
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
