"""Logs in, delays out: how late each output answers its input, as a fraction of a sample."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches

import numpy as np

from rotorid.data.findings import Finding, refusal, warn
from rotorid.data.record import STANDARD_UNITS, FlightRecord
from rotorid.data.response import FrequencyResponse
from rotorid.documents.delay import DelayDocument, DelayPairDocument, delay_pair_document
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fitting.delay.estimate import DelayAnalysis, estimate_delay, same_rate
from rotorid.pipeline.assemble import finding_documents, maneuver_document, provenance_document
from rotorid.pipeline.instruments import Flown, axes_of, find_instrument, is_command
from rotorid.pipeline.measure import measure
from rotorid.pipeline.results import Segment
from rotorid.pipeline.segments import cut, histories, other_sources
from rotorid.pipeline.selection import chosen_maneuvers, default_pairs, each_once
from rotorid.pipeline.settings import MeasureSettings
from rotorid.signal.clock import missing_channel
from rotorid.signal.excitations import excitation_signals
from rotorid.typing import BoolArray

_PROGRESS = logging.getLogger("rotorid.progress")


@dataclass(frozen=True, kw_only=True, eq=False)
class Delays:
    """A finished run of ``delay``.

    Parameters
    ----------
    document
        What ``delay.json`` holds.
    analyses
        The numbers behind it, by pair ``output/input``.
    """

    document: DelayDocument
    analyses: dict[str, DelayAnalysis]


def delays(
    records: Sequence[FlightRecord],
    *,
    input: str | None = None,
    output: str | None = None,
    settings: MeasureSettings | None = None,
    command: Sequence[str] = (),
) -> Delays:
    """Delays between channels of flight records: what ``rotorid delay`` does.

    The excitations of the pair's axis are used; where there are none, stretches that look like one, and else the whole
    record. Where the input contains feedback of the output and an instrument is logged, the joint frequency response
    gives the recommended estimate, otherwise the records themselves.

    Parameters
    ----------
    records
        Logs as :func:`rotorid.read` gives them.
    input, output
        Channels; without them every logged set-point that moves and its response, or the commands and their rates
        where no set-point is logged.
    settings
        Choices; everything has a default.
    command
        For the provenance of the result.

    Returns
    -------
    Delays
        The document of ``delay.json`` and the numbers behind it.

    Raises
    ------
    InsufficientDataError
        No pair gives a delay; the findings say why.
    UsageError
        A channel or an option is wrong.

    Examples
    --------
    >>> from rotorid.io.registry import read
    >>> result = delays([read("flight.ulg")], input="phi_setpoint", output="phi")  # doctest: +SKIP
    >>> result.document.pairs["phi/phi_setpoint"].recommended.delay_s  # doctest: +SKIP
    0.071
    """
    settings = settings or MeasureSettings()
    each_once(records)
    _require_known(settings.instruments, records)
    pairs = _pairs(records, input, output)
    found: dict[str, _Pair] = {}
    refusals: list[Finding] = []
    for source, answer in pairs:
        try:
            found[f"{answer}/{source}"] = _pair(records, source, answer, settings)
        except InsufficientDataError as error:
            if input is not None:
                raise
            refusals.append(_refusal(error, source, answer))
    unseen = [finding for pair in found.values() for finding in pair.findings if finding.kind == "no_delay"]
    if len(unseen) == len(found):
        refusals += unseen
        raise InsufficientDataError(
            "no pair of channels shows a delay",
            needed="a set-point that moves and its response",
            remedy="name another pair with --input and --output" if input else "name a pair with --input and --output",
            findings=refusals,
        )
    remarks = (
        *(finding for record in records for finding in record.findings),
        *(finding for pair in found.values() for finding in pair.findings),
        *refusals,
    )
    flown = dict.fromkeys(item for pair in found.values() for item in pair.flown)
    return Delays(
        document=DelayDocument(
            pairs={name: pair.document for name, pair in found.items()},
            findings=finding_documents(remarks),
            provenance=provenance_document(records, settings, command=command, flown=tuple(flown)),
        ),
        analyses={name: pair.analysis for name, pair in found.items()},
    )


def refused_delay(
    error: InsufficientDataError,
    records: Sequence[FlightRecord],
    *,
    settings: MeasureSettings,
    command: Sequence[str] = (),
) -> DelayDocument:
    """The document for data that show no delay: its findings say why, and no number is given."""
    findings = [*(f for record in records for f in record.findings), *error.findings]
    if not error.findings:
        findings.append(refusal("no_delay", "delay", str(error)))
    return DelayDocument(
        findings=finding_documents(findings), provenance=provenance_document(records, settings, command=command)
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Pair:
    analysis: DelayAnalysis
    document: DelayPairDocument
    findings: tuple[Finding, ...]
    flown: tuple[Flown, ...]


def _pairs(records: Sequence[FlightRecord], input: str | None, output: str | None) -> tuple[tuple[str, str], ...]:
    if (input is None) != (output is None):
        given = "an input" if output is None else "an output"
        raise UsageError(f"{given} came alone", needed="both --input and --output, or none of them")
    if input is None or output is None:
        return default_pairs(records)
    if input == output:
        raise UsageError(f"{input} came as input and as output", needed="different channels")
    _require_known((input, output), records)
    return ((input, output),)


def _require_known(names: Sequence[str], records: Sequence[FlightRecord]) -> None:
    known = {*STANDARD_UNITS, *(name for record in records for name in record.channel_names)}
    for name in names:
        if name not in known:
            close = ", ".join(get_close_matches(name, sorted(known), n=3))
            raise UsageError(
                f"there is no channel {name}",
                needed="names such as roll_command, p, az, or those of the mapping",
                remedy=f"did you mean {close}?" if close else "see the channels that rotorid inspect lists",
            )


def _pair(records: Sequence[FlightRecord], input: str, output: str, settings: MeasureSettings) -> _Pair:
    _PROGRESS.info(f"delay of {output} behind {input}")
    flown, remarks = chosen_maneuvers(records, input, output, settings)
    instrument = _instrument(flown, input, output, settings)
    feedback = instrument != input
    segments, cutting = _cut_apart(flown, input, output, settings)
    joint = settings.estimate != "direct" and feedback and instrument is not None
    one_rate = same_rate(histories(segments))
    if joint and not one_rate:
        raise _needs_one_rate(segments, input)
    response, cause = (
        _response(flown, input, output, instrument if joint else None, settings) if one_rate else (None, "")
    )
    analysis = estimate_delay(
        histories(segments),
        input=input,
        output=output,
        feedback=feedback,
        airframe=is_command(input),
        response=response,
        highest_rad_s=settings.band_rad_s[1] if settings.band_rad_s else np.inf,
    )
    by_joint = joint and analysis.recommended.method == "response"
    biased = [_biased(input, output, joint=joint, cause=cause)] if feedback and not by_joint else []
    return _Pair(
        analysis=analysis,
        document=delay_pair_document(
            analysis,
            feedback=feedback,
            instrument=instrument if feedback else None,
            maneuvers=[maneuver_document(record, maneuver) for record, maneuver in flown],
        ),
        findings=(*remarks, *cutting, *biased, *analysis.findings),
        flown=tuple(flown),
    )


def _cut_apart(
    flown: Sequence[Flown], input: str, output: str, settings: MeasureSettings
) -> tuple[tuple[Segment, ...], tuple[Finding, ...]]:
    """Maneuvers of each record by itself, at its own rate: resampling would move the delay."""
    segments: list[Segment] = []
    findings: list[Finding] = []
    for record in {id(record): record for record, _ in flown}.values():
        own = [item for item in flown if item[0] is record]
        found, remarks = cut(own, channels=(input, output), shifts=settings.shifts)
        segments += found
        findings += remarks
    findings += [one for one in other_sources(segments, segments, (input, output)) if one not in findings]
    return tuple(segments), tuple(findings)


def _needs_one_rate(segments: Sequence[Segment], input: str) -> UsageError:
    rates = [segment.history.sample_rate_hz for segment in segments]
    return UsageError(
        f"records of {min(rates):.4g} to {max(rates):.4g} Hz came for {input}, which contains feedback",
        needed="records of one rate, because it takes their joint frequency response",
        remedy="give the logs of each rate by themselves, or use --estimate direct",
    )


def _instrument(flown: Sequence[Flown], input: str, output: str, settings: MeasureSettings) -> str | None:
    """The channel that holds no feedback: the input itself, one that excites it, or ``None`` where none is known."""
    if settings.instruments:
        return _given_instrument(flown, output, settings.instruments)
    axis = axes_of((input,), (output,))[0]
    found = find_instrument(flown, axis)
    if found is not None:
        return found
    # A set-point of the outermost logged loop comes from a person or a program; a command from a controller.
    outside = excitation_signals(flown[0][0], axis)
    return input if not is_command(input) and outside and outside[0] == input else None


def _given_instrument(flown: Sequence[Flown], output: str, names: Sequence[str]) -> str:
    if len(names) != 1:
        raise UsageError(f"{len(names)} instruments for one input came", needed="one")
    (name,) = names
    if name == output:
        raise UsageError(
            f"{name} is the output itself",
            needed="an instrument: a channel that excites the input and contains no feedback",
            remedy="name another one, or use --estimate direct",
        )
    for record, _ in flown:
        if name not in record.channel_names:
            raise missing_channel(record, name, remedy="name a channel of the log with --instrument")
    return name


def _response(
    flown: Sequence[Flown], input: str, output: str, instrument: str | None, settings: MeasureSettings
) -> tuple[tuple[FrequencyResponse, BoolArray] | None, str]:
    """The frequency response of the pair, joint where there is an instrument, and its usable points; or why not."""
    chosen = replace(
        settings,
        instruments=(instrument,) if instrument else (),
        estimate="joint" if instrument else "direct",
    )
    try:
        measured = measure(flown, inputs=(input,), outputs=(output,), settings=chosen)
    except InsufficientDataError as error:
        # Too short for a window: the records themselves may still answer.
        return None, str(error).rstrip(".")
    used = measured.trusted_points(measured.response, settings.least_coherence(joint=instrument is not None))
    return ((measured.response, used), "") if np.any(used) else (None, "no point of it is coherent")


def _biased(input: str, output: str, *, joint: bool, cause: str) -> Finding:
    """What to say of records alone where the input contains feedback."""
    if joint:
        why = f"no joint frequency response could be used ({cause or 'too few of its points are coherent'})"
    else:
        why = "no excitation free of feedback is logged or asked for"
    return warn(
        "closed_loop_bias",
        f"{output}/{input}",
        f"{input} may contain feedback of {output} and {why}, so its delay is that of the records alone. In closed "
        "loop gusts and noise come back through the controller, which pulls the delay toward less than none.",
    )


def _refusal(error: InsufficientDataError, input: str, output: str) -> Finding:
    return warn("no_delay", f"{output}/{input}", str(error))
