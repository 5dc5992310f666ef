r"""Responses that were estimated apart, as one: windows chosen for each input, and records that lack some channels.

A pair of output and input is known from every part that holds it. Parts of different records err independently, so
their mean is weighed by variances,

.. math:: \hat H = \sum_i s_i H_i, \qquad s_i = \frac{\sigma_i^{-2}}{\sum_j \sigma_j^{-2}}, \qquad
    E[\delta H_f \, \delta H_g^*] = \sum_i s_{i,f} \, s_{i,g} \, C_{i,fg}

and errors of two outputs, or of the responses to two inputs, hang together only as far as one part holds both.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rotorid.data.response import Disturbance, FrequencyResponse
from rotorid.errors import UsageError
from rotorid.spectral.estimate import Diagnostics
from rotorid.typing import BoolArray, ComplexArray, FloatArray, IntArray

_LARGEST_ERROR = 1e3
_TINY = 1e-300
_SAME = 1e-9


def joined_responses(
    parts: Sequence[FrequencyResponse], *, inputs: Sequence[str], outputs: Sequence[str]
) -> FrequencyResponse:
    """One response of parts that were measured in different records, each of some outputs to some inputs.

    Where several parts know a pair, they are weighed by their variances. Points that none knows hold the nearest value
    that is known, with a coherence of zero and a thousandfold error; a pair that none knows has no numbers as values.

    Parameters
    ----------
    parts
        Their grids are parts of one common grid.
    inputs, outputs
        Channels of the whole.

    Returns
    -------
    FrequencyResponse
        Shape ``(y, u, f)`` over the union of the grids; ``joint`` where all parts are.

    Raises
    ------
    UsageError
        No part came, or one holds another channel.

    Notes
    -----
    Inputs that a record lacks are not accounted for in its part: what they did there in step with the others is in the
    response.

    Examples
    --------
    >>> known = {"omega_rad_s": [1.0, 2.0], "coherence": np.full((1, 1, 2), 0.9), "estimate": "direct"}
    >>> error = {"random_error": np.full((1, 1, 2), 0.1), "covariance": np.broadcast_to(0.02 * np.eye(2), (1, 1, 2, 2))}
    >>> pitch, roll = (
    ...     FrequencyResponse(values=np.ones((1, 1, 2)), inputs=(source,), outputs=(output,), **known, **error)
    ...     for output, source in (("q", "pitch_command"), ("p", "roll_command"))
    ... )
    >>> both = joined_responses([pitch, roll], inputs=["roll_command", "pitch_command"], outputs=["p", "q"])
    >>> np.isfinite(both.values[..., 0]).tolist()
    [[True, False], [False, True]]
    """
    if not parts:
        raise UsageError("got no response", needed="one or more to join")
    whole = _Whole.of(parts, tuple(inputs), tuple(outputs))
    shape = whole.shape
    variance = np.stack([whole.spread(part, np.maximum(_variance(part), _TINY), np.inf) for part in parts])
    known = np.isfinite(variance)
    weight = np.where(known, 1.0 / variance, 0.0)
    together = weight.sum(axis=0)
    covered = together > 0.0
    share = weight / np.where(covered, together, 1.0)
    values = _summed(share, [whole.spread(part, part.values, 0.0) for part in parts])
    coherence = _summed(share, [whole.spread(part, part.coherence, 0.0) for part in parts]).real
    covariance = np.zeros((*shape, shape[-1]), dtype=np.complex128)
    for part, own in zip(parts, share, strict=True):
        covariance += whole.spread_between(part) * own[..., :, None] * own[..., None, :]
    level = np.sqrt(np.einsum("yuff->yuf", covariance).real)
    error = np.where(covered, np.sqrt(0.5) * level / np.maximum(np.abs(values), _TINY), _LARGEST_ERROR)
    filled = _filled(values, covered)
    point = np.arange(shape[-1])
    covariance[..., point, point] += np.where(
        covered | np.isnan(filled), 0.0, 2.0 * (_LARGEST_ERROR * np.abs(filled)) ** 2
    )
    # The share of each part in the error of the whole.
    part_of = list(share * np.sqrt(np.where(known, variance, 0.0)) / np.where(level > 0.0, level, 1.0))
    joint = all(part.estimate == "joint" for part in parts)
    return FrequencyResponse(
        omega_rad_s=whole.omega_rad_s,
        values=filled,
        coherence=coherence,
        random_error=np.minimum(error, _LARGEST_ERROR),
        covariance=covariance,
        inputs=whole.inputs,
        outputs=whole.outputs,
        estimate="joint" if joint else "direct",
        instruments=_instruments(parts, whole.inputs) if joint else (),
        windows_s=_windows(parts),
        processing=("joined from records that hold some of its channels each",),
        output_correlation=whole.between_outputs(parts, part_of),
        input_correlation=whole.between_inputs(parts, part_of),
        sample_rate_hz=min((part.sample_rate_hz for part in parts if part.sample_rate_hz), default=None),
    )


def by_input(parts: Mapping[str, FrequencyResponse]) -> FrequencyResponse:
    """One response whose column of each input was estimated with windows of its own, all of the same records.

    Below what the windows of an input reach, its column is that of the longest windows.

    Parameters
    ----------
    parts
        Input to the responses of all outputs to all inputs with the windows chosen for it. Their grids are parts of one
        common grid.

    Notes
    -----
    Errors of the responses to two inputs hang together as they do on average over the estimates.
    """
    each = list(parts.values())
    longest = max(each, key=lambda part: part.omega_rad_s.size)
    whole = _Whole.of(each, longest.inputs, longest.outputs)
    values, covariance = longest.values.copy(), longest.covariance.copy()
    coherence, error = longest.coherence.copy(), longest.random_error.copy()
    outputs = None if longest.output_correlation is None else longest.output_correlation.copy()
    columns = [parts[name] for name in longest.inputs]
    for u, part in enumerate(columns):
        own = whole.points(part)
        values[:, u, own], coherence[:, u, own] = part.values[:, u], part.coherence[:, u]
        error[:, u, own] = part.random_error[:, u]
        # What the longest windows say below is another estimate.
        covariance[:, u, own[:, None] != own] = 0.0
        covariance[:, u, own[:, None] & own] = part.covariance[:, u].reshape(len(part.outputs), -1)
        if outputs is not None and part.output_correlation is not None:
            outputs[u][..., own] = part.output_correlation[u]
    one_each = [np.broadcast_to(np.where(whole.points(part), 1.0, 0.0), whole.shape) for part in each]
    return replace(
        longest,
        values=values,
        coherence=coherence,
        random_error=error,
        covariance=covariance,
        windows_s=_windows(each),
        output_correlation=outputs,
        input_correlation=whole.between_inputs(each, one_each),
        disturbance=_disturbance(whole, columns),
    )


def joined_diagnostics(
    parts: Sequence[tuple[FrequencyResponse, Diagnostics]],
    whole: FrequencyResponse,
    *,
    columns: Sequence[int] | None = None,
) -> Diagnostics:
    """What stands behind a joined response; where several parts know a pair, that of the one with the least error.

    Parameters
    ----------
    columns
        The part that each input was taken from, where that was decided by input.
    """
    frame = _Whole(whole.omega_rad_s, whole.inputs, whole.outputs)
    y, u, f = frame.shape
    lengths = whole.windows_s
    share, window_error = np.zeros((y, u, len(lengths), f)), np.full((y, u, len(lengths), f), np.nan)
    multiple, leakage = np.zeros((y, f)), np.zeros((y, u, f), dtype=np.complex128)
    coherence, condition = np.broadcast_to(np.eye(u)[..., None], (u, u, f)).copy(), np.ones(f)
    best = np.full((y, u, f), np.inf)
    for place, (part, diagnostics) in enumerate(parts):
        error = frame.spread(part, part.random_error, np.inf)
        taken = np.isfinite(error) & (error < best)
        if columns is not None:
            taken = np.isfinite(error) & (np.array(columns) == place)[None, :, None]
        best = np.where(taken, error, best)
        for row, length in enumerate(diagnostics.windows_s):
            window = lengths.index(length)
            share[:, :, window] = np.where(
                taken, frame.spread(part, diagnostics.share[:, :, row], 0.0), share[:, :, window]
            )
            single = frame.spread(part, diagnostics.window_error[:, :, row], np.nan)
            window_error[:, :, window] = np.where(taken, single, window_error[:, :, window])
        leakage = np.where(taken, frame.spread(part, diagnostics.leakage, 0.0), leakage)
        own, sources, points = frame.places(part)
        multiple[np.ix_(own, points)] = np.maximum(multiple[np.ix_(own, points)], diagnostics.multiple_coherence)
        coherence[np.ix_(sources, sources, points)] = diagnostics.input_coherence
        condition[points] = np.maximum(condition[points], diagnostics.condition)
    return Diagnostics(
        windows_s=lengths,
        share=share,
        window_error=window_error,
        multiple_coherence=multiple,
        leakage=leakage,
        input_coherence=coherence,
        condition=condition,
    )


class _Whole(NamedTuple):
    """Grid and channels of a joined response."""

    omega_rad_s: FloatArray
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    @classmethod
    def of(cls, parts: Sequence[FrequencyResponse], inputs: tuple[str, ...], outputs: tuple[str, ...]) -> _Whole:
        for part in parts:
            odd = [name for name in (*part.inputs, *part.outputs) if name not in (*inputs, *outputs)]
            if odd:
                raise UsageError(
                    f"got a response of {', '.join(odd)}", needed=f"responses of {', '.join((*outputs, *inputs))}"
                )
        every = np.sort(np.concatenate([part.omega_rad_s for part in parts]))
        distinct = np.diff(every, prepend=0.0) > _SAME * every
        return cls(every[distinct], inputs, outputs)

    @property
    def shape(self) -> tuple[int, int, int]:
        return len(self.outputs), len(self.inputs), self.omega_rad_s.size

    def places(self, part: FrequencyResponse) -> tuple[IntArray, IntArray, IntArray]:
        """Rows, columns and points of a part."""
        points = np.searchsorted(self.omega_rad_s, part.omega_rad_s * (1.0 - _SAME))
        rows = np.array([self.outputs.index(name) for name in part.outputs])
        return rows, np.array([self.inputs.index(name) for name in part.inputs]), points

    def points(self, part: FrequencyResponse) -> BoolArray:
        found = np.zeros(self.omega_rad_s.size, dtype=np.bool_)
        found[self.places(part)[2]] = True
        return found

    def spread(self, part: FrequencyResponse, values: np.ndarray, otherwise: float) -> np.ndarray:
        """Values of a part of shape ``(y, u, f)`` at their places in the whole."""
        placed = np.full(self.shape, otherwise, dtype=values.dtype)
        placed[np.ix_(*self.places(part))] = values
        return placed

    def spread_between(self, part: FrequencyResponse) -> ComplexArray:
        rows, columns, points = self.places(part)
        placed = np.zeros((*self.shape, self.shape[-1]), dtype=np.complex128)
        placed[np.ix_(rows, columns, points, points)] = part.covariance
        return placed

    def between_outputs(self, parts: Sequence[FrequencyResponse], part_of: Sequence[FloatArray]) -> ComplexArray:
        """Correlation of the errors of two outputs, shape ``(u, y, y, f)``, from the share of each part in them."""
        y, u, f = self.shape
        total = np.zeros((u, y, y, f), dtype=np.complex128)
        for part, share in zip(parts, part_of, strict=True):
            rows, columns, points = self.places(part)
            apart = np.eye(rows.size, dtype=np.complex128)[..., None]
            own = apart if part.output_correlation is None else part.output_correlation
            level = np.moveaxis(share[np.ix_(rows, columns, points)], 1, 0)
            total[np.ix_(columns, rows, rows, points)] += own * level[:, :, None] * level[:, None, :]
        diagonal = np.einsum("uyyf->uyf", total).real
        level = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
        total = total / level[:, :, None] / level[:, None, :]
        index = np.arange(y)
        total[:, index, index] = 1.0
        return total

    def between_inputs(self, parts: Sequence[FrequencyResponse], part_of: Sequence[FloatArray]) -> ComplexArray:
        """Correlation between frequencies and inputs, shape ``(u, u, f, f)``, from the share of each part in them."""
        _, u, f = self.shape
        total = np.zeros((u, u, f, f), dtype=np.complex128)
        for part, share in zip(parts, part_of, strict=True):
            rows, columns, points = self.places(part)
            level = np.sqrt(np.mean(share[np.ix_(rows, columns, points)] ** 2, axis=0))
            own = _own_correlation(part)
            total[np.ix_(columns, columns, points, points)] += own * level[:, None, :, None] * level[None, :, None, :]
        diagonal = np.einsum("uuff->uf", total).real
        level = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
        total = total / level[:, None, :, None] / level[None, :, None, :]
        source, point = np.indices((u, f))
        total[source, source, point, point] = 1.0
        return total


def _own_correlation(part: FrequencyResponse) -> ComplexArray:
    """Correlation of the errors of a part between frequencies and inputs, shape ``(u, u, f, f)``."""
    if part.input_correlation is not None:
        return part.input_correlation
    level = np.sqrt(np.maximum(np.einsum("yuff->yuf", part.covariance).real, _TINY))
    each = (part.covariance / (level[..., :, None] * level[..., None, :])).mean(axis=0)
    u, f = each.shape[:2]
    own = np.zeros((u, u, f, f), dtype=np.complex128)
    own[np.arange(u), np.arange(u)] = each
    return own


def _variance(part: FrequencyResponse) -> FloatArray:
    return np.asarray(np.einsum("yuff->yuf", part.covariance).real)


def _summed(share: FloatArray, values: Sequence[np.ndarray]) -> np.ndarray:
    return np.asarray(np.sum(share * np.stack(values), axis=0))


def _filled(values: ComplexArray, covered: BoolArray) -> ComplexArray:
    """Values with those of the nearest known point where none is known; no numbers where no point of a pair is."""
    filled = np.full(values.shape, np.nan, dtype=np.complex128)
    for y, u in np.argwhere(covered.any(axis=-1)):
        known = np.flatnonzero(covered[y, u])
        nearest = known[np.argmin(np.abs(np.arange(values.shape[-1])[:, None] - known), axis=1)]
        filled[y, u] = values[y, u, nearest]
    return filled


def _windows(parts: Sequence[FrequencyResponse]) -> tuple[float, ...]:
    return tuple(sorted({length for part in parts for length in part.windows_s}, reverse=True))


def _instruments(parts: Sequence[FrequencyResponse], inputs: Sequence[str]) -> tuple[str, ...]:
    """The instrument of each input, from the first part that has it."""
    found = {
        source: instrument
        for part in reversed(parts)
        for source, instrument in zip(part.inputs, part.instruments, strict=True)
    }
    return tuple(found[name] for name in inputs if name in found)


def _disturbance(whole: _Whole, columns: Sequence[FrequencyResponse]) -> Disturbance | None:
    """The mean of what the estimates say, at each frequency that any of them knows."""
    disturbances = [part.disturbance for part in columns]
    if any(disturbance is None for disturbance in disturbances):
        return None
    y, u, f = whole.shape
    densities = np.zeros((y + u, y + u, f), dtype=np.complex128)
    level, weak, count, freedom = np.zeros((y, f)), np.ones((y, u, f)), np.zeros(f), np.zeros(f)
    for source, (part, disturbance) in enumerate(zip(columns, disturbances, strict=True)):
        assert disturbance is not None
        points = whole.places(part)[2]
        densities[..., points] += disturbance.densities
        level[:, points] += disturbance.level
        weak[:, source, points] = disturbance.weak_instrument[:, source]
        count[points] += 1.0
        freedom[points] += disturbance.freedom
    return Disturbance(densities=densities / count, level=level / count, weak_instrument=weak, freedom=freedom)
