r"""Whether an output answers to the commands of other axes: a test by least squares that asks for no model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.data.history import TimeHistory
from rotorid.data.immutable import Immutable
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.typing import FloatArray

_LEAST_SAMPLES_PER_TERM = 3


@dataclass(frozen=True, kw_only=True)
class CrossTerms(Immutable):
    """What the commands of other axes add to the explanation of one output.

    Parameters
    ----------
    output, own, others
        Channels.
    own_share
        Share of the variance of the output that its own command explains.
    added_share
        Share of it that the others add.
    f_value
        Their F statistic.
    p_white
        Probability of a larger F where others do nothing, by the F distribution. It takes residuals for independent
        from sample to sample; they seldom are, and then it is far too small.
    p_shifted
        The same by experiment: the share of all cyclic shifts of the other commands, which destroy any answer to
        them and keep all spectra, with an F as large.
    """

    output: str
    own: str
    others: tuple[str, ...]
    own_share: float
    added_share: float
    f_value: float
    p_white: float
    p_shifted: float


def cross_terms(
    history: TimeHistory, *, output: str, own: str, others: Sequence[str], memory_s: float = 1.0
) -> CrossTerms:
    r"""Test whether an output depends on the commands of other axes.

    .. math:: y_k = c + \sum_{j=0}^{m} h_j u_{k-j} + \sum_i \sum_{j=0}^{m} g_{ij} w_{i,k-j} + e_k, \qquad
        F = \frac{(S_0 - S_1) / q}{S_1 / (n - r)}

    with S the residual sum of squares without and with the q terms of the other commands. Linear in everything: an
    effect that is a product, as of two tilts on the vertical thrust, is not seen.

    Parameters
    ----------
    history
        Holds the channels. All commands must move at once and independently: a command that follows another one, or
        the output, explains what is not its own.
    output, own, others
        The output, the command that it belongs to, and the commands to be tested.
    memory_s
        Length of the impulse responses, longer than the answers last.

    Raises
    ------
    UsageError
        A channel is missing.
    InsufficientDataError
        There are fewer than three samples for each term.

    References
    ----------
    Draper and Smith, *Applied Regression Analysis*, 3rd ed., section 6.1 (extra sum of squares). Shifted surrogates:
    Efron and Tibshirani, *An Introduction to the Bootstrap*, chapter 15 (permutation tests).

    Examples
    --------
    >>> from rotorid.data.channel import Channel
    >>> rng = np.random.default_rng(0)
    >>> u, w, e = rng.standard_normal((3, 400))
    >>> names = ("y", "z", "u", "w")
    >>> history = TimeHistory(values=np.stack([u + 0.3 * e, u + 0.2 * w + 0.3 * e, u, w]), sample_rate_hz=20.0,
    ...                       start_s=0.0, channels=tuple(Channel(name=name, unit="1") for name in names))
    >>> [cross_terms(history, output=y, own="u", others=["w"], memory_s=0.2).p_shifted < 0.01 for y in ("y", "z")]
    [False, True]
    """
    for name in (output, own, *others):
        if name not in history.names:
            raise UsageError(f"there is no channel {name!r}", needed=f"one of {', '.join(history.names)}")
    lags = round(memory_s * history.sample_rate_hz) + 1
    samples = history.values.shape[1] - lags + 1
    terms = 1 + lags * (1 + len(others))
    if samples < _LEAST_SAMPLES_PER_TERM * terms:
        raise InsufficientDataError(
            f"{max(samples, 0)} samples came for {terms} terms",
            needed=f"{_LEAST_SAMPLES_PER_TERM} for each term",
            remedy="shorten the memory or take a longer record",
        )
    y = history[output][lags - 1 :]
    basis, _ = np.linalg.qr(np.column_stack([np.ones(samples), _lagged(history[own], lags)]))
    rest = y - basis @ (basis.T @ y)
    moved = np.stack([history[name] for name in others])
    added = np.array([_explained(np.roll(moved, shift, axis=1), lags, basis, rest) for shift in range(moved.shape[1])])
    total, left = float(np.sum((y - y.mean()) ** 2)), float(rest @ rest)
    free = samples - terms
    # A shift by less than the memory, either way, still holds some of the answer.
    apart = added[lags:-lags]
    from scipy.stats import f

    f_value = (float(added[0]) / (terms - 1 - lags)) / ((left - float(added[0])) / free)
    return CrossTerms(
        output=output,
        own=own,
        others=tuple(others),
        own_share=1.0 - left / total,
        added_share=float(added[0]) / total,
        f_value=f_value,
        p_white=float(f.sf(f_value, terms - 1 - lags, free)),
        p_shifted=(1.0 + float(np.sum(apart >= added[0]))) / (1.0 + apart.size),
    )


def _explained(commands: FloatArray, lags: int, basis: FloatArray, rest: FloatArray) -> float:
    """Sum of squares that commands explain of what the basis leaves over."""
    terms = np.column_stack([_lagged(command, lags) for command in commands])
    terms -= basis @ (basis.T @ terms)
    fitted = terms @ np.linalg.lstsq(terms, rest, rcond=None)[0]
    return float(fitted @ rest)


def _lagged(u: FloatArray, lags: int) -> FloatArray:
    """Rows of present and past samples, shape ``(samples - lags + 1, lags)``."""
    return np.lib.stride_tricks.sliding_window_view(u, lags)[:, ::-1]
