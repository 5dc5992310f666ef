"""Which models a log can support, and what to change where it cannot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeAlias

from pydantic import Field

from rotorid.data.channel import LOWEST_RATE_HZ
from rotorid.data.maneuver import Maneuver
from rotorid.data.record import FlightRecord
from rotorid.models.rate import RATE_AXES
from rotorid.pipeline.document_base import Document
from rotorid.pipeline.instruments import axis_of, find_instrument
from rotorid.pipeline.selection import RICH_KINDS
from rotorid.pipeline.support import LOWEST_TOP_RAD_S
from rotorid.typing import Axis

_LOGGING_ADVICE = {
    "ArduPilot DataFlash": "set LOG_BITMASK so that fast attitude (bit 0) and fast IMU (bit 18) are logged",
    "PX4 ULog": "set SDLOG_PROFILE to 25 (default, system identification and high rate)",
}
_OTHER_LOGGING = "log it, or name its source with --map"
_FLYING_ADVICE = {
    "ArduPilot DataFlash": "fly SYSTEMID mode with SID_AXIS {sid_axis}",
    "PX4 ULog": "sweep the {axis} stick, slow to fast, for a minute or more",
}
_OTHER_FLYING = "fly a {axis} sweep, slow to fast, for a minute or more, or name one with --segment"
_SID_AXIS = {"roll": 10, "pitch": 11, "yaw": 12, "thrust": 13}

_PerAxis: TypeAlias = Mapping[str, Sequence[Maneuver]]


class NeedDocument(Document):
    """One thing that a model needs, and whether the log has it."""

    need: str
    there: bool
    found: str


class SupportDocument(Document):
    """Whether a model can be identified from this log, and what to change if not."""

    possible: bool
    because: str
    remedy: str = ""
    instrument: str | None = None
    needs: list[NeedDocument] = Field(default_factory=list)


def supports(record: FlightRecord, found: _PerAxis, candidates: _PerAxis) -> dict[str, SupportDocument]:
    """Name of each rate model to whether the log supports it.

    Parameters
    ----------
    record
        The log.
    found, candidates
        Axis to excitations, and to stretches that may have been meant as such.
    """
    return {model: _support(record, axis.input, axis.output, found, candidates) for model, axis in RATE_AXES.items()}


def segment_of(axis: str, start_s: float, stop_s: float) -> str:
    """The value of ``--segment`` that takes an interval.

    Examples
    --------
    >>> segment_of("roll", 0.0, 17.5512)
    'roll:0.00:17.55'
    """
    return f"{axis}:{start_s:.2f}:{stop_s:.2f}"


def _support(record: FlightRecord, input: str, output: str, found: _PerAxis, candidates: _PerAxis) -> SupportDocument:
    name = axis_of(input)
    rates = {channel: _best_rate_hz(record, channel) for channel in (input, output)}
    rich = [maneuver for maneuver in found[name] if maneuver.kind in RICH_KINDS]
    tried = max(candidates[name], key=lambda maneuver: maneuver.duration_s, default=None)
    moved = rich or ([tried] if tried else [])
    instrument = find_instrument([(record, maneuver) for maneuver in moved], name) if moved else None
    verdict = _unlogged(record, rates) or _unflown(record, name, rich, found[name], tried)
    if verdict is None:
        estimate = f"joint estimate with {instrument}" if instrument else "direct estimate only; feedback may bias it"
        because = f"{len(rich)} rich excitation(s), {min(rates.values()):.0f} Hz, {estimate}"
        verdict = SupportDocument(possible=True, because=because, instrument=instrument)
    return verdict.model_copy(update={"needs": _needs(rates, name, rich, instrument)})


def _best_rate_hz(record: FlightRecord, channel: str) -> float:
    """Rate of the fastest topic that holds a channel; zero where none does."""
    return max((topic.sample_rate_hz for topic, _ in record.holding(channel)), default=0.0)


def _unlogged(record: FlightRecord, rates: Mapping[str, float]) -> SupportDocument | None:
    """The refusal of a log that lacks channels, or holds them too slowly."""
    advice = _LOGGING_ADVICE.get(record.source.format, _OTHER_LOGGING)
    missing = [name for name in rates if name not in record.channel_names]
    if missing:
        return SupportDocument(possible=False, because=f"the log lacks {' and '.join(missing)}", remedy=advice)
    slow = [f"{name} at {rate:.3g} Hz" for name, rate in rates.items() if rate < LOWEST_RATE_HZ]
    if slow:
        because = f"{' and '.join(slow)} is too slow; {LOWEST_RATE_HZ:.0f} Hz is the least"
        return SupportDocument(possible=False, because=because, remedy=advice)
    return None


def _unflown(
    record: FlightRecord, axis: Axis, rich: Sequence[Maneuver], found: Sequence[Maneuver], tried: Maneuver | None
) -> SupportDocument | None:
    """The refusal of a flight that does not excite an axis, or not fast enough; a candidate is pointed at."""
    if not rich:
        kinds = ", ".join(dict.fromkeys(maneuver.kind for maneuver in found))
        because = (
            f"only short maneuvers ({kinds}) excite this axis" if kinds else "no excitation of this axis was found"
        )
        flying = _FLYING_ADVICE.get(record.source.format, _OTHER_FLYING)
        remedy = flying.format(axis=axis, sid_axis=_SID_AXIS[axis])
        if tried is not None:
            remedy += f", or try --segment {segment_of(axis, tried.start_s, tried.stop_s)}"
        return SupportDocument(possible=False, because=because, remedy=remedy)
    tops = [maneuver.band_rad_s[1] for maneuver in rich if maneuver.band_rad_s and maneuver.kind == "sweep"]
    if len(tops) == len(rich) and max(tops) < LOWEST_TOP_RAD_S:
        because = f"the sweeps end at {max(tops):.2g} rad/s; a rate model needs {LOWEST_TOP_RAD_S:g} rad/s and more"
        return SupportDocument(possible=False, because=because, remedy="fly a sweep that goes faster")
    return None


def _needs(
    rates: Mapping[str, float], axis: Axis, rich: Sequence[Maneuver], instrument: str | None
) -> list[NeedDocument]:
    """What a rate model needs, each with what the log has of it; without the last, feedback may bias the model."""
    logged = [
        NeedDocument(
            need=f"{name} at {LOWEST_RATE_HZ:.0f} Hz or more",
            there=rate >= LOWEST_RATE_HZ,
            found=f"{rate:.3g} Hz" if rate else "not logged",
        )
        for name, rate in rates.items()
    ]
    tops = [maneuver.band_rad_s[1] for maneuver in rich if maneuver.band_rad_s]
    reach = f" up to {max(tops):.3g} rad/s" if tops else ""
    flown = ", ".join(dict.fromkeys(maneuver.kind.replace("_", " ") for maneuver in rich))
    return [
        *logged,
        NeedDocument(
            need=f"a sweep, multisine or random binary signal on {axis}",
            there=bool(rich),
            found=f"{len(rich)} ({flown}){reach}" if rich else "none found",
        ),
        NeedDocument(need="an instrument free of feedback", there=bool(instrument), found=instrument or "none found"),
    ]
