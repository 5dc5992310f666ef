"""Records on which a model is fitted in the time domain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from rotorid.data.history import TimeHistory
from rotorid.data.immutable import Immutable, read_only
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.typing import BoolArray, FloatArray

_ROUNDING = 1e-9


def moving(rows: FloatArray) -> BoolArray:
    """Which rows ``(c, n)`` spread by more than the rounding of numbers of their size, shape ``(c,)``.

    Examples
    --------
    >>> moving(np.array([[0.1, 0.1, 0.1 + 1e-17], [0.1, 0.1, 0.2], [0.0, 0.0, 0.0]])).tolist()
    [False, True, False]
    """
    return np.asarray(np.ptp(rows, axis=1) > _ROUNDING * np.abs(rows).max(axis=1))


@dataclass(frozen=True, kw_only=True, eq=False)
class TimeData(Immutable):
    """Inputs and measured outputs of one maneuver on one clock.

    Parameters
    ----------
    name
        Where they come from.
    inputs
        Shape ``(u, n)``, SI units, as differences from a trim.
    outputs
        Shape ``(y, n)``.
    sample_rate_hz
        Rate of both.
    before
        Inputs before the first sample, shape ``(u,)``; by default what the first sample shows.
    """

    name: str
    inputs: FloatArray
    outputs: FloatArray
    sample_rate_hz: float
    before: FloatArray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        inputs, outputs = (read_only(values, np.float64, ndim=2) for values in (self.inputs, self.outputs))
        if inputs.shape[1] != outputs.shape[1]:
            raise UsageError(f"{inputs.shape[1]} samples of the inputs and {outputs.shape[1]} of the outputs came")
        if not (np.isfinite(inputs).all() and np.isfinite(outputs).all()):
            raise UsageError(f"{self.name} holds samples that are no numbers", needed="records without gaps")
        before = read_only(self.before if self.before.size else inputs[:, 0], np.float64, ndim=1)
        self._set(inputs=inputs, outputs=outputs, before=before)

    @classmethod
    def of(cls, history: TimeHistory, *, inputs: tuple[str, ...], outputs: tuple[str, ...], name: str) -> TimeData:
        """Channels of a history; inputs as differences from their mean, exactly zero where one stands still."""
        u = np.stack([history[channel] for channel in inputs])
        y = np.stack([history[channel] for channel in outputs])
        # The mean of a constant is rounded: without this what is left of it would count as motion.
        u = np.where(moving(u)[:, None], u - u.mean(axis=1, keepdims=True), 0.0)
        return cls(name=name, inputs=u, outputs=y, sample_rate_hz=history.sample_rate_hz)

    @property
    def samples(self) -> int:
        return int(self.inputs.shape[1])

    @property
    def duration_s(self) -> float:
        return self.samples / self.sample_rate_hz

    def pieces(self, length_s: float) -> tuple[TimeData, ...]:
        """The record in pieces of about one length, each of which knows the inputs before it.

        Raises
        ------
        InsufficientDataError
            A piece would hold fewer than two samples.
        """
        count = max(1, round(self.duration_s / length_s))
        edges = np.linspace(0, self.samples, count + 1).round().astype(int)
        if np.diff(edges).min() < 2:
            raise InsufficientDataError(f"pieces of {length_s:g} s came", needed="pieces of at least two samples")
        return tuple(
            replace(
                self,
                inputs=self.inputs[:, start:stop],
                outputs=self.outputs[:, start:stop],
                before=self.inputs[:, start - 1] if start else self.before,
            )
            for start, stop in pairwise(edges)
        )


def require_records(
    records: Sequence[TimeData],
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    unknowns: Sequence[str],
    known: Sequence[str],
) -> None:
    """Refuse records that have other rows than a model has channels, and unknowns that there are not.

    Parameters
    ----------
    records
        What will be fitted.
    inputs, outputs
        Channels of the model.
    unknowns, known
        What is to be estimated beside the parameters, and what can be.

    Raises
    ------
    UsageError
        There is no record, one has other rows, or an unknown is none.
    """
    if not records:
        raise UsageError("no record came", needed="at least one")
    for record in records:
        if (len(record.inputs), len(record.outputs)) != (len(inputs), len(outputs)):
            raise UsageError(
                f"{record.name} has {len(record.inputs)} inputs and {len(record.outputs)} outputs",
                needed=f"the inputs {', '.join(inputs)} and the outputs {', '.join(outputs)}",
            )
    for unknown in unknowns:
        if unknown not in known:
            raise UsageError(f"the unknown {unknown!r} came", needed=f"of {', '.join(known)}")
