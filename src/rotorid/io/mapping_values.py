"""What a mapping says, as values: where each channel of a foreign file stands, and on which clock."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from rotorid.data.channel import STANDARD_UNITS
from rotorid.data.maneuver import Kind
from rotorid.frames import SignedAngles
from rotorid.typing import Axis
from rotorid.units import parse_unit

PLACEHOLDER = "{experiment}"
"""Stands in a source for the name of each experiment."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Series:
    """One row of numbers in a foreign file: ``(number + offset) * scale``, then the unit is converted.

    Parameters
    ----------
    source
        Variable, struct field by dots, or column name.
    unit
        Unit of the numbers once offset and scale are applied; empty means SI.
    scale
        Sign and factor.
    offset
        Added first, in the numbers of the file: ``-1000.0`` for pulses that rest at 1000 µs.
    row, column
        Which one of a matrix, counted from zero; at most one of them.
    file
        Path of the file below the folder of the log; empty for the log itself.
    """

    source: str
    unit: str = ""
    scale: float = 1.0
    offset: float = 0.0
    row: int | None = None
    column: int | None = None
    file: str = ""

    def of_experiment(self, name: str) -> Series:
        """The same row in one of several experiments."""
        return replace(self, source=self.source.replace(PLACEHOLDER, name))


@dataclass(frozen=True, kw_only=True, slots=True)
class Clock:
    """Stamps for the channels that have none of their own: exactly one of the three.

    Parameters
    ----------
    time
        The stamps themselves.
    steps
        Differences of the stamps: from each sample to the next. The first stamp is zero.
    sample_rate_hz
        A uniform clock that starts at zero.
    """

    time: Series | None = None
    steps: Series | None = None
    sample_rate_hz: float | None = None

    def of_experiment(self, name: str) -> Clock:
        """The same clock in one of several experiments."""
        return replace(
            self,
            time=self.time and self.time.of_experiment(name),
            steps=self.steps and self.steps.of_experiment(name),
        )


@dataclass(frozen=True, kw_only=True, slots=True)
class MappedChannel:
    """A channel, where its samples stand, and its own stamps if it has some."""

    name: str
    samples: Series
    time: Series | None = None

    @property
    def si(self) -> str:
        """SI unit: that of the vocabulary, or of the unit that a name outside of it came with."""
        return STANDARD_UNITS.get(self.name) or parse_unit(self.samples.unit).si

    def of_experiment(self, name: str) -> MappedChannel:
        """The same channel in one of several experiments."""
        return replace(self, samples=self.samples.of_experiment(name), time=self.time and self.time.of_experiment(name))


@dataclass(frozen=True, kw_only=True, slots=True)
class MappedAttitude:
    """A quaternion that becomes ``phi``, ``theta`` and ``psi``.

    Parameters
    ----------
    parts
        Its w, x, y and z, from the body to the earth.
    angles
        Sign and offset that bring each angle from the frames of the file to FRD and NED.
    time
        Its own stamps, if it has some.
    """

    parts: tuple[Series, Series, Series, Series]
    angles: SignedAngles
    time: Series | None = None

    def of_experiment(self, name: str) -> MappedAttitude:
        """The same quaternion in one of several experiments."""
        w, x, y, z = (part.of_experiment(name) for part in self.parts)
        return replace(self, parts=(w, x, y, z), time=self.time and self.time.of_experiment(name))


@dataclass(frozen=True, kw_only=True, slots=True)
class Segment:
    """A part of the record to use, by time on the log's own clock or by sample of the first channel.

    With neither it is the whole record, or the whole of each experiment. ``signal`` is the channel in which the
    excitation shows and ``band_rad_s`` its lowest and highest frequency, where they are known.
    """

    axis: Axis
    kind: Kind = "other"
    start_s: float | None = None
    stop_s: float | None = None
    start_sample: int | None = None
    stop_sample: int | None = None
    signal: str = ""
    band_rad_s: tuple[float, float] | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class Experiments:
    """Several experiments in one file, which follow each other on one clock.

    Parameters
    ----------
    names
        What stands for ``{experiment}`` in the sources, in the order of time.
    spacing_s
        From the zero of one experiment's stamps to that of the next, s; zero where the stamps go on by themselves.
    """

    names: tuple[str, ...]
    spacing_s: float = 0.0


@dataclass(frozen=True, kw_only=True, slots=True)
class ChannelMapping:
    """What a mapping file says.

    Parameters
    ----------
    channels
        At least one, unless there is an attitude.
    clock
        Clock of the channels without their own.
    segments
        Parts of the record that were excited.
    attitude
        Quaternion behind the attitude angles.
    experiments
        Several experiments in one file.
    """

    channels: tuple[MappedChannel, ...]
    clock: Clock | None = None
    segments: tuple[Segment, ...] = ()
    attitude: MappedAttitude | None = None
    experiments: Experiments | None = None

    @property
    def files(self) -> tuple[str, ...]:
        """The files that hold the channels, each once; the log itself is the empty name."""
        owners = [channel.samples.file for channel in self.channels]
        owners += [self.attitude.parts[0].file] if self.attitude else []
        return tuple(dict.fromkeys(owners))

    def part(self, file: str) -> ChannelMapping:
        """What stands in one of the files, as the mapping of that file alone."""
        channels = (
            replace(
                channel, samples=replace(channel.samples, file=""), time=channel.time and replace(channel.time, file="")
            )
            for channel in self.channels
            if channel.samples.file == file
        )
        attitude = self.attitude
        if attitude is not None:
            w, x, y, z = (replace(series, file="") for series in attitude.parts)
            own = replace(attitude, parts=(w, x, y, z), time=attitude.time and replace(attitude.time, file=""))
            attitude = own if self.attitude and self.attitude.parts[0].file == file else None
        return replace(self, channels=tuple(channels), attitude=attitude, segments=() if file else self.segments)

    def each_experiment(self) -> Iterator[ChannelMapping]:
        """One mapping for each experiment; itself where there is but one."""
        if self.experiments is None:
            yield self
            return
        for name in self.experiments.names:
            yield replace(
                self,
                channels=tuple(channel.of_experiment(name) for channel in self.channels),
                clock=self.clock and self.clock.of_experiment(name),
                attitude=self.attitude and self.attitude.of_experiment(name),
                experiments=None,
            )
