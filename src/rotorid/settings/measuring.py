"""Choices about how responses are measured."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from rotorid.data.trust import DIRECT_COHERENCE, JOINT_COHERENCE, least_coherence
from rotorid.errors import UsageError
from rotorid.settings.option import (
    Option,
    Seed,
    Settings,
    Written,
    as_names,
    require_seed,
    require_words,
    require_workers,
)
from rotorid.settings.parsing import (
    BAND,
    FILTERS,
    INPUT_WINDOWS,
    NAMES,
    SECONDS,
    SEGMENTS,
    SHIFTS,
)

if TYPE_CHECKING:
    from rotorid.data.record import Maneuver
    from rotorid.data.sensor_filters import SensorFilter

EstimateChoice: TypeAlias = Literal["auto", "direct", "joint"]

CompositionChoice: TypeAlias = Literal["variance", "least_squares", "weights"]
"""How windows of several lengths are joined: with the least variance, by least squares over spectra and coherence as
CIFER does, or as the weighted mean from which that starts."""

TaperChoice: TypeAlias = Literal["hann", "half_sine"]

OVERLAP = 0.8
"""Of neighboring windows, unless another one is asked for."""

LARGEST_OVERLAP = 0.95

LONGEST_WINDOW_S = 3600.0

SensorFilters: TypeAlias = Annotated[
    "Mapping[str, tuple[SensorFilter, ...]]",
    Option(
        "--filter",
        "Filter that a channel has passed, such as az=lp:60; implies --correct-filters. Repeatable.",
        "Data",
        FILTERS,
    ),
    Written("given"),
]
"""Filters that the user gives, by channel."""


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
    filters
        Filters that channels have passed besides, by channel.
    """

    band_rad_s: Annotated[
        tuple[float, float] | None,
        Option(
            "--band",
            "Frequency band in rad/s, or with a unit: 0.5:15Hz. [default: the excited band]",
            "Responses",
            BAND,
        ),
    ] = None
    windows_s: Annotated[
        tuple[float, ...], Option("--windows", "Window lengths, in seconds.", "Responses", SECONDS)
    ] = ()
    input_windows_s: Annotated[
        Mapping[str, tuple[float, ...]],
        Option("--input-windows", "Window lengths for one input. Repeatable.", "Responses", INPUT_WINDOWS),
        Written("given"),
    ] = field(default_factory=dict)
    composition: Annotated[
        CompositionChoice,
        Option(
            "--composition", "How to combine windows of several lengths; least_squares is CIFER's method.", "Responses"
        ),
        Written("given"),
    ] = "variance"
    taper: Annotated[TaperChoice, Option("--taper", "Shape of the windows.", "Responses"), Written("given")] = "hann"
    overlap: Annotated[
        float, Option("--overlap", "Overlap of neighboring windows, 0 to 0.95.", "Responses"), Written("given")
    ] = OVERLAP
    coherence: Annotated[
        float | None,
        Option(
            "--coherence",
            f"Reject points below this coherence. [default: {DIRECT_COHERENCE:g} direct, {JOINT_COHERENCE:g} joint]",
            "Responses",
        ),
    ] = None
    estimate: Annotated[
        EstimateChoice,
        Option(
            "--estimate",
            "Estimator: direct, or joint with an instrument; auto is joint if one is logged.",
            "Responses",
        ),
    ] = "auto"
    instruments: Annotated[
        tuple[str, ...],
        Option(
            "--instrument",
            "Instruments of the joint estimate, one for each input.",
            "Responses",
            NAMES,
            metavar="CHANNEL,...",
        ),
    ] = ()
    segments: Annotated[
        "tuple[Maneuver, ...]",
        Option(
            "--segment",
            "Use this part of the log, in log seconds, instead of the maneuvers found. Repeatable.",
            "Data",
            SEGMENTS,
        ),
    ] = ()
    shifts: Annotated[
        Mapping[str, float],
        Option("--shift", "Delay a channel, if inspect finds its time stamps wrong. Repeatable.", "Data", SHIFTS),
    ] = field(default_factory=dict)
    seed: Seed = 0
    correct_filters: bool = False
    filters: "Mapping[str, tuple[SensorFilter, ...]]" = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._set(
            filters=self.filters,
            windows_s=tuple(self.windows_s),
            input_windows_s={name: tuple(lengths) for name, lengths in self.input_windows_s.items()},
            instruments=as_names(self.instruments),
            segments=tuple(self.segments),
            shifts=self.shifts,
        )
        if self.band_rad_s is not None and not 0.0 < self.band_rad_s[0] < self.band_rad_s[1] < math.inf:
            raise UsageError(
                f"the band {self.band_rad_s[0]:g} to {self.band_rad_s[1]:g} rad/s is empty", needed="0 < LO < HI"
            )
        for name, lengths in self.input_windows_s.items():
            if not lengths:
                raise UsageError(f"no window length for {name}", needed="at least one")
        for length in (*self.windows_s, *(length for lengths in self.input_windows_s.values() for length in lengths)):
            if not 0.0 < length <= LONGEST_WINDOW_S:
                needed = f"lengths above 0 and up to {LONGEST_WINDOW_S:g} s"
                raise UsageError(f"a window of {length:g} s is impossible", needed=needed)
        for segment in self.segments:
            if not (math.isfinite(segment.start_s) and math.isfinite(segment.stop_s)):
                raise UsageError(
                    f"the segment from {segment.start_s:g} to {segment.stop_s:g} s is not finite",
                    needed="seconds of the log, as rotorid inspect prints them",
                )
        for name, seconds in self.shifts.items():
            if not math.isfinite(seconds):
                raise UsageError(f"the shift of {name} is {seconds:g} s", needed="a finite number of seconds")
        require_seed(self.seed)
        if self.coherence is not None and not 0.0 <= self.coherence < 1.0:
            raise UsageError(f"--coherence {self.coherence:g} is out of range", needed="a number from 0 to below 1")
        require_words(self)
        if not 0.0 <= self.overlap <= LARGEST_OVERLAP:
            raise UsageError(
                f"--overlap {self.overlap:g} is out of range", needed=f"a number from 0 to {LARGEST_OVERLAP:g}"
            )
        if self.estimate == "direct" and self.instruments:
            raise UsageError(
                "a direct estimate has no instrument", remedy="leave out --instrument or --estimate direct"
            )

    def __hash__(self) -> int:
        # Mappings have no hash; what they hold is compared, and seldom differs alone.
        return hash((self.band_rad_s, self.windows_s, self.estimate, self.instruments, self.segments))

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
    filters
        Filters that channels have passed besides, by channel; they are taken off too.
    correct_sensors
        Estimate scale, bias, misalignment and place of rate gyros and accelerometer by the kinematics, and take them
        out before anything is measured.
    workers
        Processes that measure the coherence of each maneuver; ``None`` for this one alone. Numbers are the same.
    """

    correct_filters: Annotated[
        bool, Option("--correct-filters", "Remove known autopilot filters from the outputs.", "Data")
    ] = False
    filters: SensorFilters = field(default_factory=dict)
    correct_sensors: Annotated[
        bool,
        Option(
            "--correct-sensors",
            "Estimate and remove scale, bias, misalignment and position of the sensors.",
            "Data",
        ),
        Written("given"),
    ] = False
    workers: Annotated[
        int | None,
        Option("--workers", "Processes for logs with several maneuvers. [default: this one alone]", "Data"),
        Written("never"),
    ] = None

    def __post_init__(self) -> None:
        super().__post_init__()
        require_workers(self.workers)
