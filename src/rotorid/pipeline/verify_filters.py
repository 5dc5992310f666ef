"""Known filters of the autopilot between the sensor that a model was fitted to and the one that it is judged on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rotorid.data.findings import Finding
from rotorid.data.record import FlightRecord
from rotorid.models.state_space import StateSpace
from rotorid.signal.autopilot_filters import known_filters

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
