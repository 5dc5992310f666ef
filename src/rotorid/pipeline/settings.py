"""What a user may choose about an identification; everything else follows from the data."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, TypeAlias, get_args

from rotorid.data.channel import AXES
from rotorid.data.immutable import Immutable
from rotorid.data.maneuver import Maneuver
from rotorid.errors import UsageError

EstimateChoice: TypeAlias = Literal["auto", "direct", "joint"]

DIRECT_COHERENCE = 0.6
JOINT_COHERENCE = 0.2
"""Limits below which a point is left out. A joint estimate is judged by instrument and output, whose coherence feedback
and other inputs lower without harm: its random error tells what a point is worth, down to about this value."""

LONGEST_WINDOW_S = 3600.0


@dataclass(frozen=True, kw_only=True)
class MeasureSettings(Immutable):
    """Choices about how responses are measured.

    Parameters
    ----------
    band_rad_s
        Band to look at; by default what was excited and is coherent.
    windows_s
        Window lengths; by default five by rule.
    coherence
        Least coherence of a point; by default 0.6 for a direct and 0.2 for a joint estimate.
    estimate
        ``auto`` takes the joint estimate whenever an instrument is logged.
    instruments
        Channels to use as instruments, one for each input, instead of the ones found.
    segments
        Intervals to use, instead of the excitations found.
    shifts
        Channel to seconds by which it is delayed before anything is estimated.
    seed
        For what is drawn at random; nothing is by default.
    """

    band_rad_s: tuple[float, float] | None = None
    windows_s: tuple[float, ...] = ()
    coherence: float | None = None
    estimate: EstimateChoice = "auto"
    instruments: tuple[str, ...] = ()
    segments: tuple[Maneuver, ...] = ()
    shifts: Mapping[str, float] = field(default_factory=dict)
    seed: int = 0

    def __post_init__(self) -> None:
        self._set(windows_s=tuple(self.windows_s), segments=tuple(self.segments), shifts=self.shifts)
        if self.band_rad_s is not None and not 0.0 < self.band_rad_s[0] < self.band_rad_s[1] < math.inf:
            raise UsageError(f"the band {self.band_rad_s[0]:g}:{self.band_rad_s[1]:g} is empty", needed="0 < LO < HI")
        for length in self.windows_s:
            if not 0.0 < length <= LONGEST_WINDOW_S:
                needed = f"lengths above 0 and up to {LONGEST_WINDOW_S:g} s"
                raise UsageError(f"a window of {length:g} s came", needed=needed)
        for segment in self.segments:
            if not (math.isfinite(segment.start_s) and math.isfinite(segment.stop_s)):
                raise UsageError(
                    f"a segment from {segment.start_s:g} to {segment.stop_s:g} s came",
                    needed="seconds on the log's own clock, as rotorid inspect shows them",
                )
        for name, seconds in self.shifts.items():
            if not math.isfinite(seconds):
                raise UsageError(f"a shift of {name} by {seconds:g} s came", needed="a finite number of seconds")
        require_seed(self.seed)
        if self.coherence is not None and not 0.0 <= self.coherence < 1.0:
            raise UsageError(f"a coherence of {self.coherence:g} came", needed="a number from 0 to below 1")
        if self.estimate not in get_args(EstimateChoice):
            raise UsageError(
                f"the estimate {self.estimate!r} came", needed=f"one of {', '.join(get_args(EstimateChoice))}"
            )
        if self.estimate == "direct" and self.instruments:
            raise UsageError("a direct estimate takes no instrument", remedy="leave out --instrument or --estimate")

    def least_coherence(self, *, joint: bool) -> float:
        """The limit in force."""
        if self.coherence is not None:
            return self.coherence
        return JOINT_COHERENCE if joint else DIRECT_COHERENCE

    def as_json(self) -> dict[str, str | int | float | bool | list[str] | list[float] | None]:
        """The choices for the provenance of a result."""
        return {
            "band_rad_s": list(self.band_rad_s) if self.band_rad_s else None,
            "windows_s": list(self.windows_s),
            "coherence": self.coherence,
            "estimate": self.estimate,
            "instruments": list(self.instruments),
            # All digits, so that the text gives the same run again.
            "segments": [f"{m.axis}:{float(m.start_s)!r}:{float(m.stop_s)!r}" for m in self.segments],
            "shifts": [f"{name}:{float(seconds)!r}" for name, seconds in self.shifts.items()],
        }


@dataclass(frozen=True, kw_only=True)
class ResponseSettings(MeasureSettings):
    """Choices of one run of ``response``.

    Parameters
    ----------
    band_rad_s, windows_s, coherence, estimate, instruments, segments, shifts, seed
        As in :class:`MeasureSettings`.
    correct_filters
        Take known filters of the autopilot off the outputs, so that a response is that of the vehicle alone.
    """

    correct_filters: bool = False

    def as_json(self) -> dict[str, str | int | float | bool | list[str] | list[float] | None]:
        """The choices for the provenance of a result."""
        return super().as_json() | {"correct_filters": self.correct_filters}


@dataclass(frozen=True, kw_only=True)
class IdentifySettings(MeasureSettings):
    """Choices of one run of ``identify``.

    Parameters
    ----------
    band_rad_s, windows_s, coherence, estimate, instruments, segments, shifts, seed
        As in :class:`MeasureSettings`.
    fix
        Parameters held at given values.
    """

    fix: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set(fix=self.fix)

    def as_json(self) -> dict[str, str | int | float | bool | list[str] | list[float] | None]:
        """The choices for the provenance of a result."""
        return super().as_json() | {"fix": [f"{name}={float(value)!r}" for name, value in self.fix.items()]}


def require_seed(seed: int) -> None:
    """Refuse a seed that no generator takes.

    Raises
    ------
    UsageError
        It is negative.
    """
    if seed < 0:
        raise UsageError(f"the seed {seed} came", needed="zero or a positive whole number")


def parse_segment(text: str) -> Maneuver:
    """Read ``AXIS:START:STOP``, seconds on the log's own clock.

    Examples
    --------
    >>> parse_segment("pitch:50:76").duration_s
    26.0
    """
    parts = text.split(":")
    wanted = "AXIS:START:STOP with an axis of roll, pitch, yaw, thrust and seconds on the log's own clock"
    if len(parts) != 3 or parts[0] not in AXES:
        raise UsageError(f"the segment {text!r} cannot be read", needed=wanted)
    try:
        start_s, stop_s = float(parts[1]), float(parts[2])
    except ValueError:
        raise UsageError(f"the segment {text!r} cannot be read", needed=wanted) from None
    if not start_s < stop_s:
        raise UsageError(f"the segment {text!r} stops before it starts", needed=wanted)
    return Maneuver(axis=parts[0], kind="other", start_s=start_s, stop_s=stop_s, origin="given")  # type: ignore[arg-type]


def parse_band(text: str) -> tuple[float, float]:
    """Read ``LO:HI`` in rad/s.

    Examples
    --------
    >>> parse_band("8:80")
    (8.0, 80.0)
    """
    try:
        low, high = (float(part) for part in text.split(":"))
    except ValueError:
        raise UsageError(f"the band {text!r} cannot be read", needed="LO:HI in rad/s, such as 1:60") from None
    return low, high


def parse_numbers(text: str) -> tuple[float, ...]:
    """Read ``S,S,...``."""
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise UsageError(f"the list {text!r} cannot be read", needed="numbers with commas between them") from None


def parse_fix(texts: tuple[str, ...]) -> dict[str, float]:
    """Read ``NAME=VALUE`` once or more."""
    fixed = {}
    for text in texts:
        name, _, value = text.partition("=")
        try:
            fixed[name.strip()] = float(value)
        except ValueError:
            raise UsageError(f"{text!r} cannot be read", needed="NAME=VALUE, such as L_p=-2") from None
    return fixed


def parse_shifts(texts: tuple[str, ...]) -> dict[str, float]:
    """Read ``CHANNEL:SECONDS`` once or more; each channel once.

    Examples
    --------
    >>> parse_shifts(("q:0.0037", "roll_command:-0.004"))
    {'q': 0.0037, 'roll_command': -0.004}
    """
    shifts: dict[str, float] = {}
    for text in texts:
        name, _, value = text.rpartition(":")
        try:
            seconds = float(value)
        except ValueError:
            seconds = math.nan
        if not name.strip() or not math.isfinite(seconds):
            raise UsageError(f"the shift {text!r} cannot be read", needed="CHANNEL:SECONDS, such as q:0.0037")
        if name.strip() in shifts:
            raise UsageError(f"two shifts of {name.strip()} came", needed="one for each channel", remedy="add them up")
        shifts[name.strip()] = seconds
    return shifts
