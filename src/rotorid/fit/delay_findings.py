"""What a careful engineer would remark on an estimated delay."""

from __future__ import annotations

from collections.abc import Sequence

from rotorid.data.findings import Finding
from rotorid.fit.delay_acausal import Acausal
from rotorid.fit.delay_fit import OrderFit
from rotorid.fit.delay_model import Order

_CLEARLY_BETTER = 0.05

_WORDS = {"records": "the records", "response": "the frequency response"}


def unseen_finding(input: str, output: str, why: str) -> list[Finding]:
    """An estimate that tells no delay, and why."""
    if not why:
        return []
    return [
        Finding(
            kind="no_delay",
            severity="warning",
            where=f"{output}/{input}",
            message=(
                f"No delay of {output} behind {input} can be seen: {why}. Use an input that moves {output} more, or a "
                "longer record."
            ),
        )
    ]


def acausal_finding(
    filtered: Acausal | None, input: str, output: str, delay_s: float, as_filtered_s: float | None
) -> list[Finding]:
    """A filter without phase that went over the outputs alone."""
    if filtered is None or as_filtered_s is None:
        return []
    hidden_s = delay_s - as_filtered_s
    tail = f": the filter hides about {1e3 * hidden_s:.0f} ms from it" if hidden_s > 0.0 else ""
    return [
        Finding(
            kind="acausal_output",
            severity="warning",
            where=f"{output}/{input}",
            message=(
                f"Above {filtered.cutoff_rad_s:.3g} rad/s {output} falls by {filtered.fall_db:.0f} dB in an octave, as "
                "no vehicle does, and it answers too early for a filter in flight. A low-pass filter without phase "
                f"went over {output} and not over {input}. Below {filtered.passed_rad_s:.3g} rad/s, where it does "
                f"little, the delay is {1e3 * delay_s:.0f} ms; a model of second order on all of the band finds "
                f"{1e3 * as_filtered_s:.0f} ms{tail}. Use outputs as they were measured, or filter the inputs alike."
            ),
            numbers={
                "cutoff_rad_s": filtered.cutoff_rad_s,
                "fall_db": filtered.fall_db,
                "lead_s": filtered.lead_s,
                "probability": filtered.probability,
                "delay_whole_band_s": as_filtered_s,
                "hidden_s": hidden_s,
            },
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
        Finding(
            kind="delay_or_lag",
            severity="info",
            where=f"{output}/{input}",
            message=(
                f"A lag of {other.order.words} fits {output}/{input} better and leaves a delay of "
                f"{1e3 * other.delay_s:.1f} ms, where one of {order.words} leaves {1e3 * chosen.delay_s:.1f} ms. "
                "The total is the same: what a model of low order calls delay is partly lag. Use each delay with its "
                "own order."
            ),
            numbers={"delay_s": chosen.delay_s, "other_delay_s": other.delay_s, "other_poles": other.order.poles},
        )
    ]


def disagreement(
    input: str, output: str, estimates: Sequence[tuple[str, float, tuple[float, float] | None]]
) -> list[Finding]:
    """Two estimates beside one lag whose intervals do not touch."""
    with_interval = [(method, delay_s, ends) for method, delay_s, ends in estimates if ends is not None]
    if len(with_interval) < 2:
        return []
    (first, first_s, a), (second, second_s, b) = with_interval[:2]
    if a[0] <= b[1] and b[0] <= a[1]:
        return []
    return [
        Finding(
            kind="delays_disagree",
            severity="warning",
            where=f"{output}/{input}",
            message=(
                f"By {_WORDS[first]} the delay is {1e3 * first_s:.1f} ms ({1e3 * a[0]:.1f} to {1e3 * a[1]:.1f}), by "
                f"{_WORDS[second]} {1e3 * second_s:.1f} ms ({1e3 * b[0]:.1f} to {1e3 * b[1]:.1f}). Feedback of noise "
                "or another band does this, or a lag that is not of this order; the first is recommended."
            ),
            numbers={"delay_s": first_s, "other_delay_s": second_s},
        )
    ]
