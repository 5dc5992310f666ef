"""A time history: channels on one uniform clock."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotorid.data.channel import Channel
from rotorid.data.immutable import Immutable, read_only
from rotorid.typing import FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class TimeHistory(Immutable):
    """Samples of several channels at one rate, without a gap.

    Parameters
    ----------
    values
        Shape ``(channels, samples)``, SI units.
    channels
        What the rows are.
    sample_rate_hz
        One rate for all.
    start_s
        Time of the first sample on the log's own clock.
    processing
        What was done to the data since they were read, oldest first.
    """

    values: FloatArray
    channels: tuple[Channel, ...]
    sample_rate_hz: float
    start_s: float
    processing: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        values = read_only(self.values, np.float64, ndim=2)
        if values.shape[0] != len(self.channels):
            raise ValueError(f"{len(self.channels)} channels were announced and {values.shape[0]} rows came")
        if not self.sample_rate_hz > 0.0:
            raise ValueError(f"the sample rate must be positive; {self.sample_rate_hz} Hz came")
        self._set(values=values, channels=tuple(self.channels), processing=tuple(self.processing))

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(channel.name for channel in self.channels)

    @property
    def time_s(self) -> FloatArray:
        """Stamps on the log's own clock, shape ``(samples,)``."""
        return self.start_s + np.arange(self.values.shape[1]) / self.sample_rate_hz

    @property
    def duration_s(self) -> float:
        return float(self.values.shape[1] / self.sample_rate_hz)

    def __getitem__(self, name: str) -> FloatArray:
        """Samples of one channel, shape ``(samples,)``."""
        try:
            row = self.names.index(name)
        except ValueError:
            raise KeyError(f"no channel {name!r}; there are {', '.join(self.names)}") from None
        samples: FloatArray = self.values[row]
        return samples
