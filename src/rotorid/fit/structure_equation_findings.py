"""What an engineer remarks on an equation-error fit: noise in its regressors, and what it could not estimate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.data.channel import Channel
from rotorid.data.findings import Finding
from rotorid.data.history import TimeHistory
from rotorid.fit.structure_equation_rows import EquationRows
from rotorid.models.parameter import ParameterSet
from rotorid.typing import FloatArray

_NOISE_BAND = (0.6, 0.95)
"""Of the Nyquist frequency: there a record shows its sensors and nothing of the vehicle."""

_NOTABLE_SHARE = 0.01
_LARGE_SHARE = 0.1
_SEED = 1


def left_findings(parameters: ParameterSet, left: Sequence[str], held: Sequence[str]) -> tuple[Finding, ...]:
    """What was not estimated, and why.

    Parameters
    ----------
    parameters
        With the values that were kept.
    left, held
        Free parameters that were not estimated, and those that states were simulated with.
    """
    simulated = "a state that no sensor shows is simulated with it"
    nowhere = "it stands in no equation whose states were all measured, or was not searched"
    return tuple(
        Finding(
            kind="not_in_measured_equations",
            severity="warning",
            where=name,
            message=f"{name} stays at its start value: {simulated if name in held else nowhere}.",
            numbers={"value": parameters[name].value},
        )
        for name in left
    )


def noise_findings(
    rows: EquationRows,
    theta: FloatArray,
    weights: FloatArray,
    inverse: FloatArray,
    covariance: FloatArray,
    moving: Sequence[int],
) -> tuple[Finding, ...]:
    """States that are noisy regressors, and parameters that their noise moves by more than a standard deviation.

    Parameters
    ----------
    rows, theta, weights
        Equations, free parameters, weights of the equations.
    inverse, covariance
        :math:`(J^T J)^{-1}` and the covariance of the estimated parameters.
    moving
        Indices of those among the free ones.
    """
    found = [
        Finding(
            kind="noisy_regressors",
            severity="warning" if share > _LARGE_SHARE else "info",
            where=state,
            message=f"About {100.0 * share:.2g} % of the power of {state} is noise of its sensor, which pulls the "
            "derivatives with respect to it toward zero.",
            numbers={"share": share},
        )
        for state, share in noise_shares(rows).items()
        if share > _NOTABLE_SHARE
    ]
    bias = noise_bias(rows, theta, weights, inverse, moving)
    for k, pull, std in zip(moving, bias.tolist(), np.sqrt(np.diag(covariance)).tolist(), strict=True):
        if abs(pull) > std:
            name = rows.map.parameters.free[k]
            found.append(
                Finding(
                    kind="biased_by_noise",
                    severity="warning",
                    where=name,
                    message=f"White noise of the sensors moves {name} = {theta[k]:.4g} by about {pull:.2g}, which is "
                    f"{abs(pull) / std:.2g} of its standard deviations.",
                    numbers={"value": theta[k], "bias": pull, "std": std},
                )
            )
    return tuple(found)


def noise_variances(rows: EquationRows) -> FloatArray:
    """Variance of white noise on each state of each record, as the highest frequencies show it, shape ``(r, x)``.

    Only for states that are measured; noise that is not white is another there than where the vehicle moves.
    """
    weights, found = rows.plan.weights, []
    for record in rows.records:
        power = np.abs(np.fft.rfft(record.outputs - record.outputs.mean(axis=1, keepdims=True))) ** 2
        share = np.arange(power.shape[1]) / (power.shape[1] - 1)
        high = (share > _NOISE_BAND[0]) & (share < _NOISE_BAND[1])
        # The median of an exponential distribution is log 2 of its mean, and single tones do not count.
        level = np.median(power[:, high], axis=1) / np.log(2.0) / record.samples
        found.append(weights**2 @ level)
    return np.array(found)


def _per_variance(rows: EquationRows, record: int) -> tuple[float, float]:
    """Mean squares in the domain of white noise with a variance of one, and of its slope."""
    history = rows.histories[record]
    noise = np.random.default_rng(_SEED).standard_normal((1, history.values.shape[1]))
    white = TimeHistory(
        values=noise, channels=(Channel(name="n", unit="1"),), sample_rate_hz=history.sample_rate_hz, start_s=0.0
    )
    level, slope = rows.domain.level(white, "n", 0.0), rows.domain.slope(white, "n")
    return float(level @ level), float(slope @ slope)


def noise_shares(rows: EquationRows) -> dict[str, float]:
    """Share of noise in the power of each measured state, in the domain of the fit."""
    variances = noise_variances(rows)
    noise, power = np.zeros(variances.shape[1]), np.zeros(variances.shape[1])
    for record in range(len(rows.records)):
        c = rows.columns(record, np.zeros(len(rows.map.structure.inputs)))
        noise += variances[record] * _per_variance(rows, record)[0]
        power += np.sum(c.levels**2, axis=1)
    return {
        rows.map.structure.states[k]: float(min(noise[k] / power[k], 1.0))
        for k in rows.plan.of("measured")
        if power[k] > 0.0
    }


def noise_bias(
    rows: EquationRows, theta: FloatArray, weights: FloatArray, inverse: FloatArray, moving: Sequence[int]
) -> FloatArray:
    r"""What white noise of the sensors moves the estimates by, to first order, shape ``(p,)``.

    .. math:: \delta\theta = -(J^T J)^{-1} \, E[J_\nu^T e_\nu], \qquad e_\nu = A \dot\nu - B \nu

    Parameters
    ----------
    rows, theta, weights, inverse, moving
        As for :func:`noise_findings`.
    """
    system, slopes = rows.map.tangent(theta)
    now, moves = rows.rows(system), rows.rows(slopes)
    pull = np.zeros(len(theta))
    for record, variance in enumerate(noise_variances(rows)):
        level, slope = _per_variance(rows, record)
        both = level * moves.B * now.B + slope * moves.A * now.A
        pull += np.einsum("kex,e,x->k", both, weights**2, variance)
    return np.asarray(-inverse @ pull[list(moving)])
