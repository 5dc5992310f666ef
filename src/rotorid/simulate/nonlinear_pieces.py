"""Where the corners of late inputs cut a sample interval: no step of an integrator may cross one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotorid.simulate.hold import WHOLE_SAMPLE, Hold
from rotorid.typing import FloatArray, IntArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Pieces:
    """The parts of a sample interval on which all late inputs are smooth; the same in every interval.

    Times count in samples. Derivatives have the directions of the delays as last axis.

    Parameters
    ----------
    starts, dstarts
        Where each piece begins, shape ``(m,)``, and its derivatives, shape ``(m, k)``.
    lengths, dlengths
        Likewise how long it is.
    lags
        How many samples old each input is, shape ``(m, u)``.
    pending
        One where the corner of an input is still to come, zero where it has passed, shape ``(m, u)``.
    fractions, dfractions
        Where the corner of each input is, shapes ``(u,)`` and ``(u, k)``.
    whole
        Whole samples of delay, shape ``(u,)``.
    """

    starts: FloatArray
    dstarts: FloatArray
    lengths: FloatArray
    dlengths: FloatArray
    lags: IntArray
    pending: FloatArray
    fractions: FloatArray
    dfractions: FloatArray
    whole: IntArray

    def between(self, u: FloatArray, before: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The inputs in each piece of each interval and their slopes per sample, each shape ``(n - 1, m, u)``."""
        samples = np.arange(u.shape[1] - 1)[:, None, None]
        held = _taken(u, before, samples - self.lags)
        return held, _taken(u, before, samples - self.lags + 1) - held

    def at_samples(self, u: FloatArray, before: FloatArray, *, hold: Hold) -> FloatArray:
        """The late inputs at the samples, just after their jumps, derivatives after the value: ``(n, u, 1 + k)``."""
        waiting = (self.fractions > 0.0).astype(np.int64)
        places = np.arange(u.shape[1])[:, None] - self.whole - waiting
        late = _taken(u, before, places)
        slopes = (_taken(u, before, places + 1) - late) * float(hold == "first")
        value = late + (waiting - self.fractions) * slopes
        return np.concatenate([value[..., None], -slopes[..., None] * self.dfractions], axis=-1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """The ``s`` steps of a method through a sample interval, of ``g`` stages each; the same in every interval.

    Parameters
    ----------
    pieces
        In which piece each step lies, shape ``(s,)``.
    lengths
        Of the steps in seconds, derivatives after the value, shape ``(s, 1 + k)``.
    ages
        Shares of a sample since the last sample of each input, shape ``(s, g, u, 1 + k)``; of no inputs where inputs do
        not ramp.
    """

    pieces: IntArray
    lengths: FloatArray
    ages: FloatArray


def planned(pieces: Pieces, times: FloatArray, *, substeps: int, interval_s: float, hold: Hold) -> Plan:
    """Lay steps into the pieces of a sample interval.

    Parameters
    ----------
    pieces
        The pieces.
    times
        When the stages of a step are, as shares of the step, shape ``(g,)``.
    substeps
        Steps of a whole interval; a piece takes its share of them, and at least one.
    interval_s
        The interval.
    hold
        What the inputs do between their samples.
    """
    counts = np.maximum(np.ceil(substeps * pieces.lengths - WHOLE_SAMPLE), 1.0).astype(np.int64)
    places = np.repeat(np.arange(counts.size), counts)
    numbers = np.concatenate([np.arange(count) for count in counts])
    starts, lengths, fractions = (
        np.column_stack(pair)
        for pair in (
            (pieces.starts, pieces.dstarts),
            (pieces.lengths, pieces.dlengths),
            (pieces.fractions, pieces.dfractions),
        )
    )
    lengths = lengths[places] / counts[places, None]
    passed = starts[places, None] + (numbers[:, None] + times)[..., None] * lengths[:, None]
    ages = passed[:, :, None] - fractions[slice(None) if hold == "first" else slice(0)]
    ages[..., 0] += pieces.pending[places, None, : ages.shape[2]]
    return Plan(pieces=places, lengths=lengths * interval_s, ages=ages)


def cut(delays: FloatArray, ddelays: FloatArray) -> Pieces:
    """Cut a sample interval at the corners of the late inputs.

    A delay of a whole number of samples has its corner at the start of the interval; a piece of no length stands there
    all the same when the delay can move, because its length moves.

    Parameters
    ----------
    delays
        In samples, shape ``(u,)``. A negative one is an input that arrives early.
    ddelays
        Their derivatives, shape ``(u, k)``.
    """
    lags = np.floor(delays + WHOLE_SAMPLE).astype(np.int64)
    fractions = np.maximum(delays - lags, 0.0)
    fractions[fractions < WHOLE_SAMPLE] = 0.0
    order = np.argsort(fractions, kind="stable")
    none = np.zeros((1, ddelays.shape[1]))
    corners = np.concatenate([[0.0], fractions[order], [1.0]])
    dcorners = np.concatenate([none, ddelays[order], none])
    lengths, dlengths = np.diff(corners), np.diff(dcorners, axis=0)
    rank = np.argsort(order)
    pending = (rank[None] >= np.arange(lengths.size)[:, None]).astype(np.int64)
    kept = (lengths > 0.0) | dlengths.any(axis=1)
    return Pieces(
        starts=corners[:-1][kept],
        dstarts=dcorners[:-1][kept],
        lengths=lengths[kept],
        dlengths=dlengths[kept],
        lags=(lags + pending)[kept],
        pending=pending[kept].astype(np.float64),
        fractions=fractions,
        dfractions=ddelays,
        whole=lags,
    )


def _taken(u: FloatArray, before: FloatArray, places: IntArray) -> FloatArray:
    """Samples ``places`` ``(..., u)`` of the inputs; before the first one ``before``, beyond the last one the last."""
    known = np.column_stack([before, u])
    return known[np.arange(len(u)), np.clip(places + 1, 0, u.shape[1])]
