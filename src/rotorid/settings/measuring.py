"""Choices about how responses are measured, which every verb that measures has."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from rotorid.data.trust import DIRECT_COHERENCE, JOINT_COHERENCE, least_coherence
from rotorid.errors import UsageError
from rotorid.settings.option import Option, Seed, Settings, Written, as_names, require_seed, require_words
from rotorid.settings.parsing import (
    BAND,
    INPUT_WINDOWS,
    NAMES,
    SECONDS,
    SEGMENTS,
    SHIFTS,
)

if TYPE_CHECKING:
    from rotorid.data.record import Maneuver

EstimateChoice: TypeAlias = Literal["auto", "direct", "joint"]

CompositionChoice: TypeAlias = Literal["variance", "least_squares", "weights"]
"""How windows of several lengths are joined: with the least variance, by least squares over spectra and coherence as
CIFER does, or as the weighted mean from which that starts."""

TaperChoice: TypeAlias = Literal["hann", "half_sine"]

OVERLAP = 0.8
"""Of neighboring windows, unless another one is asked for."""

LARGEST_OVERLAP = 0.95

LONGEST_WINDOW_S = 3600.0


@dataclass(frozen=True, kw_only=True)
class MeasureSettings(Settings):
    """Choices about how responses are measured.

    Parameters
    ----------
    band_rad_s
        Band to look at; by default what was excited and is coherent.
    windows_s
        Window lengths; by default five by rule.
    input_windows_s
        Window lengths of the responses to one input, by input, in place of ``windows_s`` for it.
    composition
        How windows are joined: ``variance`` makes the stated error least, ``least_squares`` over spectra and coherence
        is CIFER's, ``weights`` the mean from which it starts.
    taper
        How windows fade: ``hann`` or ``half_sine``.
    overlap
        Share of a window that the next one covers too.
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
    correct_filters
        Take known filters of the autopilot off the outputs.
    """

    band_rad_s: Annotated[
        tuple[float, float] | None,
        Option("--band", "In rad/s, or LO:HIHz. [default: what was excited]", "Responses", BAND),
    ] = None
    windows_s: Annotated[
        tuple[float, ...], Option("--windows", "Window lengths in seconds.", "Responses", SECONDS)
    ] = ()
    input_windows_s: Annotated[
        Mapping[str, tuple[float, ...]],
        Option(
            "--input-windows", "Window lengths for the responses to one input. Repeatable.", "Responses", INPUT_WINDOWS
        ),
        Written("given"),
    ] = field(default_factory=dict)
    composition: Annotated[
        CompositionChoice,
        Option("--composition", "How windows are joined; least_squares is CIFER's way.", "Responses"),
        Written("given"),
    ] = "variance"
    taper: Annotated[TaperChoice, Option("--taper", "How windows fade.", "Responses"), Written("given")] = "hann"
    overlap: Annotated[
        float, Option("--overlap", "Share of a window that the next one covers too.", "Responses"), Written("given")
    ] = OVERLAP
    coherence: Annotated[
        float | None,
        Option(
            "--coherence",
            f"Least coherence of a point. [default: {DIRECT_COHERENCE:g} direct, {JOINT_COHERENCE:g} joint]",
            "Responses",
        ),
    ] = None
    estimate: Annotated[
        EstimateChoice,
        Option(
            "--estimate",
            "How responses are estimated: direct, or joint with an instrument; auto is joint where one is logged.",
            "Responses",
        ),
    ] = "auto"
    instruments: Annotated[
        tuple[str, ...],
        Option(
            "--instrument",
            "Channels to use as instruments, one for each input.",
            "Responses",
            NAMES,
            metavar="CHANNEL,...",
        ),
    ] = ()
    segments: Annotated[
        "tuple[Maneuver, ...]",
        Option("--segment", "A stretch to use instead of what is found, in log seconds. Repeatable.", "Data", SEGMENTS),
    ] = ()
    shifts: Annotated[
        Mapping[str, float],
        Option(
            "--shift", "What to delay a channel by, where inspect finds its stamps wrong. Repeatable.", "Data", SHIFTS
        ),
    ] = field(default_factory=dict)
    seed: Seed = 0
    correct_filters: bool = False

    def __post_init__(self) -> None:
        self._set(
            windows_s=tuple(self.windows_s),
            input_windows_s={name: tuple(lengths) for name, lengths in self.input_windows_s.items()},
            instruments=as_names(self.instruments),
            segments=tuple(self.segments),
            shifts=self.shifts,
        )
        if self.band_rad_s is not None and not 0.0 < self.band_rad_s[0] < self.band_rad_s[1] < math.inf:
            raise UsageError(f"the band {self.band_rad_s[0]:g}:{self.band_rad_s[1]:g} is empty", needed="0 < LO < HI")
        for name, lengths in self.input_windows_s.items():
            if not lengths:
                raise UsageError(f"no window of {name} came", needed="one length or more")
        for length in (*self.windows_s, *(length for lengths in self.input_windows_s.values() for length in lengths)):
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
        require_words(self)
        if not 0.0 <= self.overlap <= LARGEST_OVERLAP:
            raise UsageError(f"an overlap of {self.overlap:g} came", needed=f"a share from 0 to {LARGEST_OVERLAP:g}")
        if self.estimate == "direct" and self.instruments:
            raise UsageError("a direct estimate takes no instrument", remedy="leave out --instrument or --estimate")

    def least_coherence(self, *, joint: bool) -> float:
        """The limit in force."""
        return least_coherence(self.coherence, joint=joint)


@dataclass(frozen=True, kw_only=True)
class ResponseSettings(MeasureSettings):
    """Choices of one run of ``response``.

    Parameters
    ----------
    band_rad_s, windows_s, input_windows_s, composition, taper, overlap
        As in :class:`MeasureSettings`.
    coherence, estimate, instruments, segments, shifts, seed
        As in :class:`MeasureSettings`.
    correct_filters
        Take known filters of the autopilot off the outputs, so that a response is that of the vehicle alone.
    correct_sensors
        Estimate scale, bias, misalignment and place of rate gyros and accelerometer by the kinematics, and take them
        out before anything is measured.
    """

    correct_filters: Annotated[
        bool, Option("--correct-filters", "Take known filters of the autopilot off the outputs.", "Data")
    ] = False
    correct_sensors: Annotated[
        bool,
        Option(
            "--correct-sensors",
            "Take scale, bias, misalignment and place of the sensors out, as attitude and velocity tell them.",
            "Data",
        ),
        Written("given"),
    ] = False
