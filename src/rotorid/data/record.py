"""A flight record: what a log holds, in the vocabulary of the package, each topic on its own clock."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from rotorid.data.channel import Channel
from rotorid.data.findings import Finding
from rotorid.data.immutable import Immutable, read_only
from rotorid.data.maneuver import Maneuver
from rotorid.typing import FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Topic(Immutable):
    """Channels that share one clock.

    Parameters
    ----------
    name
        The log's own name of the topic.
    time_s
        Stamps, shape ``(samples,)``, seconds on the log's own clock; as logged, so they may repeat or step back.
    channels
        What the rows of ``values`` are.
    values
        Shape ``(channels, samples)``, SI units, FRD/NED.
    """

    name: str
    time_s: FloatArray
    channels: tuple[Channel, ...]
    values: FloatArray

    def __post_init__(self) -> None:
        time_s = read_only(self.time_s, np.float64, ndim=1)
        values = read_only(self.values, np.float64, ndim=2)
        if values.shape != (len(self.channels), time_s.size):
            raise ValueError(
                f"topic {self.name}: {len(self.channels)} channels on {time_s.size} stamps were announced and values "
                f"of shape {values.shape} came"
            )
        self._set(time_s=time_s, values=values, channels=tuple(self.channels))

    def row(self, name: str) -> int | None:
        """Row of the channel ``name``, or ``None``."""
        return next((index for index, channel in enumerate(self.channels) if channel.name == name), None)

    @property
    def sample_rate_hz(self) -> float:
        """Median rate of the stamps; zero for fewer than two samples."""
        steps = np.diff(self.time_s)
        steps = steps[steps > 0.0]
        return float(1.0 / np.median(steps)) if steps.size else 0.0


@dataclass(frozen=True, kw_only=True)
class Source(Immutable):
    """Where a record came from: enough to find the file again, and to know that it is the same one."""

    name: str
    format: str
    sha256: str
    firmware: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class FlightRecord(Immutable):
    """All of a log that the package has a name for.

    Parameters
    ----------
    source
        File name, format, hash, firmware.
    topics
        In order of preference: where two topics hold the same channel, the earlier one is used for as long as it lasts.
    parameters
        The autopilot's own parameters.
    declared
        Excitations that the log itself announces.
    instruments
        Axis to channels that excite it and contain no feedback, best first.
    findings
        What the reader had to remark.
    """

    source: Source
    topics: tuple[Topic, ...]
    parameters: Mapping[str, float] = field(default_factory=dict)
    declared: tuple[Maneuver, ...] = ()
    instruments: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()

    def __post_init__(self) -> None:
        self._set(
            topics=tuple(self.topics),
            parameters=self.parameters,
            declared=tuple(self.declared),
            instruments=self.instruments,
            findings=tuple(self.findings),
        )

    @property
    def channel_names(self) -> tuple[str, ...]:
        """Names of all channels, each once, in order of preference."""
        return tuple(dict.fromkeys(channel.name for topic in self.topics for channel in topic.channels))

    def holding(self, name: str) -> Iterator[tuple[Topic, int]]:
        """The topics that hold the channel ``name``, best first, with its row in each."""
        for topic in self.topics:
            row = topic.row(name)
            if row is not None:
                yield topic, row

    @property
    def start_s(self) -> float:
        """First stamp of any topic."""
        return min((float(topic.time_s[0]) for topic in self.topics if topic.time_s.size), default=0.0)

    @property
    def stop_s(self) -> float:
        """Last stamp of any topic."""
        return max((float(topic.time_s[-1]) for topic in self.topics if topic.time_s.size), default=0.0)
