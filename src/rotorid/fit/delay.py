r"""The delay between an input and an output, as a fraction of a sample, with an interval, and what it means.

A delay and lags of higher order look alike: in the band that data cover, :math:`e^{-\tau s} \approx 1 / (1 + \tau s)`.
A number of milliseconds therefore belongs to a model: it is the dead time that is left when a lag of a stated order has
taken its part of the phase, as the equivalent delay of handling-qualities work is. Orders are chosen among few, by an
information criterion, and the delay that each of the others would have stands beside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rotorid.data.findings import Finding
from rotorid.data.history import TimeHistory
from rotorid.data.immutable import Immutable
from rotorid.data.response import FrequencyResponse
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fit.delay_acausal import Acausal, steep_output
from rotorid.fit.delay_estimate import DelayEstimate, by_records, by_response, in_samples, whole_band
from rotorid.fit.delay_findings import acausal_finding, disagreement, lag_or_delay, unseen_finding
from rotorid.fit.delay_fit import Limits
from rotorid.fit.delay_model import InputHold, Order
from rotorid.typing import BoolArray

STABLE_ORDERS = (Order(0, 1), Order(0, 2), Order(1, 2))
"""Lags of a response that a controller made: first and second order, as low-order equivalent systems take them."""

AIRFRAME_ORDERS = (Order(0, 1), Order(0, 2), Order(1, 2), Order(2, 3))
"""Lags of an airframe inside a loop: rotors behind a damped rotation, or the slow modes of hover."""

LONGEST_S, EARLIEST_S = 0.3, -0.15
"""Delays of multirotors are below; negative ones are for outputs that were filtered."""

FASTEST_GROWTH_RAD_S = 10.0
"""No loop with the delay of a multirotor holds an airframe that diverges faster."""

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
        # A direct response stands beside the records, and compares only with the same lag.
        lags = orders if feedback and joint else tuple(o for o in orders if o == estimates[0].order)
        pooled = hold or input_hold(histories, input)
        if found := by_response(
            *response, limits=limits, orders=lags, filtered=filtered, hold=pooled, sample_s=sample_s
        ):
            estimates = [found, *estimates] if feedback and joint else [*estimates, found]
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
    """``held`` where the input rests from most samples to the next and moves in jumps: steps, binary signals."""
    steps = np.concatenate([np.abs(np.diff(history[input])) for history in histories])
    span = max(float(np.ptp(history[input])) for history in histories)
    jumps = float(steps[steps > _JUMP * span].sum())
    # A command at rest repeats too, however it is sent; only one that moves in jumps alone is surely held.
    still = float(np.mean(steps <= _STILL * span))
    return "held" if still > 0.5 and jumps > _IN_JUMPS * float(steps.sum()) else "smooth"


def same_rate(histories: Sequence[TimeHistory]) -> bool:
    """Whether records can share a frequency response."""
    rates = [history.sample_rate_hz for history in histories]
    return max(rates) <= _SAME_RATE * min(rates)


def _no_common_response(histories: Sequence[TimeHistory]) -> UsageError:
    rates = [history.sample_rate_hz for history in histories]
    return UsageError(
        f"records of {min(rates):.4g} to {max(rates):.4g} Hz came with a frequency response",
        needed="records of one rate, because a faster one would have to be resampled, which moves its delay",
        remedy="give the logs of each rate by themselves",
    )


def _require(histories: Sequence[TimeHistory], input: str, output: str) -> None:
    if not histories:
        raise InsufficientDataError("no record came", needed="at least one")
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
