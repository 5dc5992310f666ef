r"""Whether inputs follow the errors of the outputs: then a controller was at work, and output error is biased.

.. math:: r_k = \frac{1}{N \sigma_e \sigma_u} \sum_t e_t u_{t+k}, \qquad Q = N \sum_{k=1}^{K} r_k^2 \sim \chi^2_K

for residuals and inputs that are both whitened by an autoregression of their own: without feedback no input knows
what the model could not explain before it. A zero-phase filter on the outputs looks the same. After Haugh, *Checking
the Independence of Two Covariance-Stationary Time Series*, 1976.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rotorid.data.findings import Finding, warn
from rotorid.flights.instruments import is_command
from rotorid.typing import FloatArray
from rotorid.uncertainty.colored import autoregression

_REACH_S, _LEAST_LAGS, _MOST_LAGS = 0.5, 5, 40
"""How far back inputs are compared with errors: half a second, in samples within these limits."""

_CHANCE = 1e-4
"""Probability without feedback, below which an input counts as following an error."""

_MOST_LEVELS = 8
"""An input of so few values is a test signal that is switched, which follows nothing."""

_SHARE, _SHARE_OF_SETPOINTS = 0.01, 0.05
"""Least share that counts. Resampled set-points are smeared over the samples around them by some percent."""


class Following(NamedTuple):
    """How an input follows an output's errors: share of its motion, and the chance of that without feedback."""

    output: str
    input: str
    share: float
    chance: float


def following(
    errors: Sequence[FloatArray],
    inputs: Sequence[FloatArray],
    *,
    input_names: Sequence[str],
    output_names: Sequence[str],
    sample_rate_hz: float,
) -> tuple[Following, ...]:
    """Every input against the past errors of every output; one of a few levels is a test signal, which follows nothing.

    A zero-phase filter on the outputs makes errors that know the inputs to come, which looks the same.

    Parameters
    ----------
    errors
        Output errors of each record, shape ``(y, n)``.
    inputs
        Inputs of the same records, shape ``(u, n)``.
    input_names, output_names
        Names of the rows.
    sample_rate_hz
        Of all records.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> error = rng.standard_normal(3000)
    >>> command = rng.standard_normal(3000)
    >>> command[2:] -= 0.5 * error[:-2]
    >>> found = following(
    ...     [error[None]], [command[None]], input_names=["roll_command"], output_names=["p"], sample_rate_hz=50.0
    ... )
    >>> round(found[0].share, 1), found[0].chance < 1e-6
    (0.2, True)
    """
    lags = int(np.clip(round(_REACH_S * sample_rate_hz), _LEAST_LAGS, _MOST_LAGS))
    found = []
    for y, output in enumerate(output_names):
        e = _whitened([error[y] for error in errors])
        for u, name in enumerate(input_names):
            if all(np.unique(column[u]).size <= _MOST_LEVELS for column in inputs):
                continue
            share, chance = _test(e, _whitened([column[u] for column in inputs]), lags)
            found.append(Following(output, name, share, chance))
    return tuple(found)


def _test(errors: Sequence[FloatArray], inputs: Sequence[FloatArray], lags: int) -> tuple[float, float]:
    from scipy.stats import chi2

    count = sum(error.size for error in errors)
    power = sum(float(error @ error) for error in errors) * sum(float(column @ column) for column in inputs)
    if power == 0.0:
        return 0.0, 1.0
    products = [
        sum(float(e[: e.size - lag] @ u[lag:]) for e, u in zip(errors, inputs, strict=True))
        for lag in range(1, lags + 1)
    ]
    share = float(np.sum(np.square(products))) / power
    # By chance alone every lag takes one part in N.
    return max(share - lags / count, 0.0), float(chi2.sf(count * share, lags))


def _whitened(parts: Sequence[FloatArray]) -> list[FloatArray]:
    """Records without what their own past explains."""
    centered = [part - part.mean() for part in parts]
    coefficients = autoregression([part[:, None] for part in centered]).coefficients[:, 0, 0]
    filtered = (np.convolve(part, np.concatenate([[1.0], -coefficients])) for part in centered)
    return [np.asarray(signal[: part.size]) for signal, part in zip(filtered, centered, strict=True)]


def judge_following(found: Sequence[Following]) -> tuple[Finding, ...]:
    """A warning for each input that follows the errors of an output: that of the output it follows most."""
    findings = []
    for name in dict.fromkeys(following.input for following in found):
        worst = max(
            (following for following in found if following.input == name), key=lambda following: following.share
        )
        least = _SHARE if is_command(name) else _SHARE_OF_SETPOINTS
        if worst.chance < _CHANCE and worst.share > least:
            findings.append(_biased(worst))
    return tuple(findings)


def _biased(following: Following) -> Finding:
    return warn(
        "closed_loop_bias",
        f"{following.output}/{following.input}",
        f"{following.input} follows the unexplained part of {following.output} (it explains "
        f"{100.0 * following.share:.0f} % more than its own past does), so a controller moved it. That biases "
        "plain output error; --method prediction_error models the noise and avoids the bias.",
        share=following.share,
        chance=following.chance,
    )
