"""Known filters of the autopilot between the sensor that a model was fitted to and the one that it is judged on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rotorid.data.findings import Finding
from rotorid.data.record import FlightRecord
from rotorid.models.state_space import StateSpace
from rotorid.signal.autopilot_filters import known_filters
from rotorid.signal.known_filter import KnownFilter
from rotorid.typing import FloatArray

_WORTH_SAYING_S = 1e-4


def with_known_delays(
    system: StateSpace,
    record: FlightRecord,
    outputs: Sequence[str],
    *,
    fitted: Mapping[str, str],
    judged: Mapping[str, str],
) -> tuple[StateSpace, tuple[Finding, ...]]:
    """A model whose outputs are as late as the filters make them in the log it is judged on.

    Autopilots log one quantity before and after their filters. A model that was fitted to one of them shows the other
    too, later by the difference of the delays; below some third of a filter's cutoff that is all it does.

    Parameters
    ----------
    system
        The model as it was fitted.
    record
        The log it is judged on; its parameters tell the filters of both places.
    outputs
        Names of the outputs.
    fitted, judged
        Output to where it stands in the logs: those that were fitted, and this one.
    """
    delays = system.output_delays_s.copy()
    findings = []
    for row, name in enumerate(outputs):
        here, there = judged.get(name, ""), fitted.get(name, "")
        if not there or here == there:
            continue
        later_s = _delay_s(record, here) - _delay_s(record, there)
        if abs(later_s) < _WORTH_SAYING_S:
            continue
        delays[row] += later_s
        findings.append(_shifted(record, name, here, there, later_s))
    if not findings:
        return system, ()
    # An output cannot be early: what lies before all others is taken off the inputs, as far as they are late.
    early_s = min(float(delays.min()), 0.0)
    inputs = np.maximum(system.input_delays_s + early_s, 0.0)
    return replace(system, output_delays_s=delays - early_s, input_delays_s=inputs), tuple(findings)


def with_known_filters(
    system: StateSpace,
    record: FlightRecord,
    outputs: Sequence[str],
    *,
    read: Sequence[str],
    fitted: Mapping[str, str],
    judged: Mapping[str, str],
) -> StateSpace:
    """A model whose fed-back outputs pass the filters themselves, where :func:`with_known_delays` took their delays.

    In a loop that is closed beyond a third of a filter's cutoff the delay is not enough: the filter also attenuates,
    and a controller with a derivative is stable through it that would not be through the delay. Means over a few
    samples stay delays.

    Parameters
    ----------
    system
        The model, its outputs as late as :func:`with_known_delays` made them.
    record
        The log it is judged on.
    outputs
        Names of the outputs.
    read
        Those that a controller reads.
    fitted, judged
        Output to where it stands in the logs: those that were fitted, and this one.
    """
    for name in read:
        here, there = judged.get(name, ""), fitted.get(name, "")
        if not there or here == there:
            continue
        passed = known_filters(record, there)
        for one in known_filters(record, here):
            if len(one.denominator) > 1 and one not in passed:
                system = _through(system, outputs.index(name), one)
    return system


def _through(system: StateSpace, row: int, passed: KnownFilter) -> StateSpace:
    """A system with one output behind a filter, and as much earlier as the filter is late."""
    A, B, C, D = _analog(passed)
    order, states, count = len(A), system.F.shape[0], system.H0.shape[0]
    zero = np.zeros((states, order))
    H0, H1 = np.hstack([system.H0, np.zeros((count, order))]), np.hstack([system.H1, np.zeros((count, order))])
    H0[row], H1[row] = np.append(D * system.H0[row], C), np.append(D * system.H1[row], np.zeros(order))
    delays = system.output_delays_s.copy()
    delays[row] = max(delays[row] - passed.delay_s, 0.0)
    return StateSpace(
        M=np.block([[system.M, zero], [-np.outer(B, system.H1[row]), np.eye(order)]]),
        F=np.block([[system.F, zero], [np.outer(B, system.H0[row]), A]]),
        G=np.vstack([system.G, np.zeros((order, system.G.shape[1]))]),
        H0=H0,
        H1=H1,
        input_delays_s=system.input_delays_s,
        output_delays_s=delays,
    )


def _analog(passed: KnownFilter) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """The analog filter behind a digital one that was made of it by the bilinear transform."""
    from scipy.signal import tf2ss

    A, B, C, D = tf2ss(passed.numerator, passed.denominator)
    inverse = np.linalg.inv(np.eye(len(A)) + A)
    scale = 2.0 * np.sqrt(passed.rate_hz)
    return (
        2.0 * passed.rate_hz * (A - np.eye(len(A))) @ inverse,
        scale * (inverse @ B)[:, 0],
        scale * (C @ inverse)[0],
        float((D - C @ inverse @ B)[0, 0]),
    )


def _delay_s(record: FlightRecord, source: str) -> float:
    return sum(known.delay_s for known in known_filters(record, source))


def _shifted(record: FlightRecord, name: str, here: str, there: str, later_s: float) -> Finding:
    return Finding(
        kind="known_filter",
        severity="info",
        where=f"{record.source.name}: {name}",
        message=(
            f"The model was fitted to {name} from {there} and is judged on {here}, which the autopilot's filters make "
            f"{1e3 * abs(later_s):.1f} ms {'later' if later_s > 0.0 else 'earlier'}: the prediction is shifted by it."
        ),
        numbers={"delay_s": later_s},
    )
