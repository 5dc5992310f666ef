"""What of a model the flown data can speak about: the inputs that were excited, and the outputs that are there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rotorid.data.findings import Finding
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.models.structure import LinearStructure
from rotorid.pipeline.building import require_channels
from rotorid.pipeline.instruments import axis_of, is_command
from rotorid.pipeline.selection import Selection
from rotorid.pipeline.settings import IdentifySettings

INERTIAL = ("p", "q", "r", "ax", "ay", "az")
"""Outputs that sensors measure. Attitude and speed of a log are estimates of a filter, with delays of its own."""

_SLOWEST_SHARE = 0.8


@dataclass(frozen=True, kw_only=True, eq=False)
class Scoped:
    """A structure cut to what can be fitted.

    Parameters
    ----------
    structure
        With the inputs and outputs that are left.
    findings
        What was left out, and why.
    """

    structure: LinearStructure
    findings: tuple[Finding, ...] = ()


def scoped(
    structure: LinearStructure, selection: Selection, records: Sequence[FlightRecord], settings: IdentifySettings
) -> Scoped:
    """Cut a structure to the inputs that were excited and the outputs that every record holds.

    Outputs are those that were asked for, or those that sensors measure; where the log has all channels at one rate,
    as data for identification have, the estimated ones too.

    Parameters
    ----------
    structure
        The whole model.
    selection
        Maneuvers that will be fitted.
    records
        Logs behind them.
    settings
        Choices of the run.

    Raises
    ------
    InsufficientDataError
        None of the outputs is in every record.
    ModelError
        An output was asked for that the model does not have.
    """
    flown = {maneuver.axis for _, maneuver in selection.fitted}
    excited = [name for name in structure.inputs if not is_command(name) or axis_of(name) in flown]
    outputs = settings.outputs or _outputs_there(structure, records)
    for record in records:
        require_channels(record, outputs)
    smaller = structure.select(outputs=outputs, inputs=excited)
    lost = [name for name in structure.parameters.names if name not in smaller.parameters.names]
    findings = [_not_excited(name, lost) for name in structure.inputs if name not in excited]
    return Scoped(structure=smaller, findings=(*findings, *_without(structure, smaller, lost, settings)))


def _outputs_there(structure: LinearStructure, records: Sequence[FlightRecord]) -> tuple[str, ...]:
    """Outputs that every record holds: of estimated ones those as fast as the sensors."""
    there = [name for name in structure.outputs if all(name in record.channel_names for record in records)]
    if not there:
        # Rather the sentence that names the missing channel and what it could be made of.
        for record in records:
            require_channels(record, [name for name in structure.outputs if name in INERTIAL][:1] or structure.outputs)
        raise InsufficientDataError(
            f"the logs hold no output of {structure.name}", needed=f"one of {', '.join(structure.outputs)}"
        )
    sensed = [name for name in there if name in INERTIAL]
    if not sensed:
        return tuple(there)
    fastest = min(max(_rate_hz(record, name) for name in sensed) for record in records)
    return tuple(
        name
        for name in there
        if name in INERTIAL or all(_same_topic(record, name, sensed, fastest) for record in records)
    )


def _same_topic(record: FlightRecord, name: str, sensed: Sequence[str], fastest_hz: float) -> bool:
    """Whether an estimated channel was logged together with the sensors: one topic, one clock, one rate."""
    topics = {id(topic) for other in sensed for topic, _ in record.holding(other)}
    return any(
        id(topic) in topics and topic.sample_rate_hz >= _SLOWEST_SHARE * fastest_hz for topic, _ in record.holding(name)
    )


def _rate_hz(record: FlightRecord, name: str) -> float:
    return max((topic.sample_rate_hz for topic, _ in record.holding(name)), default=0.0)


def _not_excited(name: str, lost: Sequence[str]) -> Finding:
    gone = f" Without it {', '.join(lost)} cannot be identified." if lost else ""
    return Finding(
        kind="no_excitation",
        severity="warning",
        where=name,
        message=f"No sweep or random binary signal of {name} came, so the model is fitted without that input.{gone}",
    )


def _without(
    structure: LinearStructure, smaller: LinearStructure, lost: Sequence[str], settings: IdentifySettings
) -> list[Finding]:
    """What to say about outputs that were passed over by themselves."""
    passed = [name for name in structure.outputs if name not in smaller.outputs]
    if settings.outputs or not passed:
        return []
    gone = f" With them go {', '.join(lost)}." if lost else ""
    return [
        Finding(
            kind="outputs_left_out",
            severity="info",
            where=", ".join(passed),
            message=(
                f"Fitted are {', '.join(smaller.outputs)}. The log does not hold {', '.join(passed)}, or as estimates "
                f"of a filter with a delay of its own; name them with --outputs to fit them too.{gone}"
            ),
        )
    ]
