r"""Inertia from acceleration on torque, and from torque on acceleration.

Torque computed from motor outputs has no noise of the gyros; acceleration has. A plain regression of one on the other
gives two answers for one inertia, whose ratio is the squared correlation:

.. math::

    I_{direct} = \frac{\sum \tau^2}{\sum \tau \dot p}, \qquad
    I_{reverse} = \frac{\sum \tau \dot p}{\sum \dot p^2} = r^2 \, I_{direct}

The second is too small by all that gusts and noise add to the acceleration; the first too, or too large, where a
controller answers to them, so that they appear in the torque. Both biases go: errors are whitened, what is left of
them, :math:`\epsilon`, is independent of the past and of the motors, which depend on the past alone, and the regression
of whitened acceleration on whitened torque is consistent. Torque on acceleration takes an instrument :math:`z`, what
the past of the motors, or an injected excitation, predicts the present torque,

.. math:: I_{reverse} = \frac{\sum z \tau}{\sum z \dot p}.

Both answers use different parts of the motion, and agree where the model is right.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rotorid.data.axes import RATES
from rotorid.data.base import Immutable
from rotorid.data.display import counted
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.quantity import TWO_SIDED_95, with_error
from rotorid.errors import UsageError
from rotorid.fitting.motors.fit import MotorFit
from rotorid.fitting.motors.problem import DAMPING, INERTIA, Axis, Filter
from rotorid.models.motors import SPIN_UP
from rotorid.typing import FloatArray

_PAST_S = (0.05, 0.07, 0.1, 0.14, 0.2, 0.28)
_MEMORY_S = 0.25
_WORTH_SAYING = 0.01
_TELLING = 0.5
_LEAST_SHARE = 1e-6


@dataclass(frozen=True, kw_only=True)
class InertiaRegression(Immutable):
    """One moment of inertia, by four regressions.

    Parameters
    ----------
    axis
        ``p``, ``q`` or ``r``.
    parameter
        ``I_xx``, ``I_yy``, ``I_zz``; ``I_zz/kappa`` where neither of the two is known.
    unit
        Of all values.
    plain
        By acceleration on torque, and by torque on acceleration, from differences of the measured rate.
    corrected
        The same two without their bias.
    deviations
        Standard deviations of the corrected ones, at the identified lag and delay.
    """

    axis: str
    parameter: str
    unit: str
    plain: tuple[float, float]
    corrected: tuple[float, float]
    deviations: tuple[float, float]

    @property
    def explained(self) -> float:
        """Share of the variance of the measured acceleration that torque explains; the ratio of the plain answers."""
        return self.plain[1] / self.plain[0]

    @property
    def biases(self) -> tuple[float, float]:
        """Differences between the plain results and the corrected ones, as a share."""
        return self.plain[0] / self.corrected[0] - 1.0, self.plain[1] / self.corrected[0] - 1.0

    @property
    def distance_sigmas(self) -> float:
        """Difference of the corrected answers in standard deviations of a difference."""
        return float((self.corrected[1] - self.corrected[0]) / np.hypot(*self.deviations))

    @property
    def telling(self) -> bool:
        """Whether the second answer is known well enough to confirm the first."""
        return self.deviations[1] < _TELLING * abs(self.corrected[1])

    @property
    def agrees(self) -> bool:
        """Whether the corrected answers agree within their intervals of 95 %."""
        return abs(self.distance_sigmas) <= TWO_SIDED_95


def inertia_regressions(
    fit: MotorFit, *, excitations: Sequence[FloatArray | None] = ()
) -> tuple[InertiaRegression, ...]:
    """Every inertia of a fit, regressed both ways, plain and corrected.

    Parameters
    ----------
    fit
        Of motors; thrust, lag and delay are taken from it.
    excitations
        For every record what was injected, shape ``(n,)`` or ``(signals, n)`` on its clock, which no feedback reaches;
        ``None``, and by default, the motors' own past is the instrument.

    Returns
    -------
    tuple of BothWays
        In the order of the axes that count in some record, without those that torque does not turn (``kappa`` of zero).

    Raises
    ------
    UsageError
        Excitations are not one for each record, of its length.

    Notes
    -----
    Deviations hold for any color that is left in the products of instrument and error (Newey and West, *A Simple,
    Positive Semi-Definite, Heteroskedasticity and Autocorrelation Consistent Covariance Matrix*, Econometrica 55(3),
    1987). Lag and delay are kept fixed. Where motors move without lag and slow excitation, their past predicts
    little, and the second answer is wide; see :attr:`InertiaRegression.telling`.
    """
    injected = list(excitations) or [None] * len(fit.problem.records)
    _require(fit, injected)
    equations = fit.problem.equations(fit.solution.theta, RATES)
    found = []
    for axis in RATES:
        rows = [
            _rows(fit, item, filters[axis], excitation, record.sample_rate_hz, record.rates[RATES.index(axis)])
            for record, filters, axes, excitation in zip(
                fit.problem.records, fit.problem.filters, equations, injected, strict=True
            )
            for item in axes
            if item.name == axis and axis in filters and _turned(fit, axis)
        ]
        if rows:
            found.append(_regressed(fit, axis, rows))
    return tuple(found)


def compare_regressions(found: Sequence[InertiaRegression]) -> list[Finding]:
    """Findings on plain and corrected regressions.

    Parameters
    ----------
    found
        Of :func:`inertia_regressions`.

    Examples
    --------
    >>> one = InertiaRegression(axis="p", parameter="I_xx", unit="kg m^2",
    ...                         plain=(0.0102, 0.004), corrected=(0.01, 0.012),
    ...                deviations=(0.0001, 0.0004))
    >>> [finding.kind for finding in compare_regressions([one])]
    ['noisy_acceleration', 'both_ways_disagree']
    """
    findings = []
    for regression in found:
        if max(map(abs, regression.biases)) > _WORTH_SAYING:
            findings.append(_noisy(regression))
        if not regression.agrees:
            findings.append(_disagreeing(regression))
    return findings


class _Rows(NamedTuple):
    """One record: what torque does (``plain_torque``) and what was measured, plain and whitened, and the instrument."""

    plain_torque: FloatArray
    plain_motion: FloatArray
    torque: FloatArray
    motion: FloatArray
    instrument: FloatArray
    memory: int


def _rows(
    fit: MotorFit, axis: Axis, shape: Filter, excitation: FloatArray | None, rate_hz: float, rate: FloatArray
) -> _Rows:
    names = fit.parameters.names
    value = fit.parameters[INERTIA[axis.name]].value
    # Torque by inertia is inverse to the inertia, and proportional to kappa by inertia.
    share = axis.slopes[names.index(INERTIA[axis.name])] * (value if axis.name == "r" else -value)
    damped = axis.predicted - share
    known = [rate[:-1]] if fit.parameters[DAMPING[axis.name]].status == "free" else []
    if axis.name == "r" and SPIN_UP in fit.parameters.free:
        known = [*known, axis.slopes[names.index(SPIN_UP)]]
    # Nearer than the lag of a motor the past is the present: the two regressions would be one.
    past = [round(lag_s * rate_hz) for lag_s in _PAST_S]
    lags = past if excitation is None else [0, *past]
    sources = share[None] if excitation is None else np.atleast_2d(excitation)[:, :-1]
    late = [np.concatenate([np.full(lag, row[0]), row[: row.size - lag]]) for row in sources for lag in lags]
    filtered = shape(np.stack([share, axis.measured - damped, *known, *late]))[:, max(past) :]
    filtered = filtered - filtered.mean(axis=1, keepdims=True)
    known_terms, regressors = filtered[2 : 2 + len(known)], filtered[2 + len(known) :]
    torque, motion, *others = _without_known(np.vstack([filtered[:2], regressors]), known_terms)
    return _Rows(
        plain_torque=share - share.mean(),
        plain_motion=axis.measured - damped - (axis.measured - damped).mean(),
        torque=torque,
        motion=motion,
        instrument=_explained_by(torque, np.stack(others)),
        memory=max(1, round(_MEMORY_S * rate_hz)),
    )


def _without_known(rows: FloatArray, known: FloatArray) -> FloatArray:
    """Rows without what damping and spin-up, whose size is not known, may explain of them."""
    if not known.size:
        return rows
    solved = np.linalg.lstsq(known.T, rows.T, rcond=None)[0]
    left: FloatArray = rows - solved.T @ known
    return left


def _explained_by(torque: FloatArray, regressors: FloatArray) -> FloatArray:
    """Torque explained by the instruments."""
    size = np.linalg.norm(regressors, axis=1, keepdims=True)
    scaled = regressors / np.where(size > 0.0, size, 1.0)
    fitted: FloatArray = np.linalg.lstsq(scaled.T, torque, rcond=_LEAST_SHARE)[0] @ scaled
    return fitted


def _regressed(fit: MotorFit, axis: str, rows: Sequence[_Rows]) -> InertiaRegression:
    parameter, unit, value = _stated(fit, axis)
    torque, motion = (np.concatenate([getattr(row, name) for row in rows]) for name in ("plain_torque", "plain_motion"))
    common = float(torque @ motion)
    plain = value * float(torque @ torque) / common, value * common / float(motion @ motion)
    direct = sum(row.torque @ row.torque for row in rows) / sum(row.torque @ row.motion for row in rows)
    moved = sum(float(row.instrument @ row.motion) for row in rows)
    reverse = sum(row.instrument @ row.torque for row in rows) / moved
    spread = np.sqrt(sum(_spread(row.torque * (row.motion - row.torque / direct), row.memory) for row in rows))
    through = np.sqrt(sum(_spread(row.instrument * (row.torque - reverse * row.motion), row.memory) for row in rows))
    size = sum(float(row.torque @ row.torque) for row in rows)
    return InertiaRegression(
        axis=axis,
        parameter=parameter,
        unit=unit,
        plain=plain,
        corrected=(float(value * direct), float(value * reverse)),
        deviations=(float(value * direct**2 * spread / size), float(value * through / abs(moved))),
    )


def _turned(fit: MotorFit, axis: str) -> bool:
    """Whether torque turns an axis at all; where it does not, no inertia follows."""
    names = (INERTIA[axis], "I_zz") if axis == "r" else (INERTIA[axis],)
    return all(fit.parameters[name].value != 0.0 for name in names if name in fit.parameters.names)


def _stated(fit: MotorFit, axis: str) -> tuple[str, str, float]:
    """Name, unit and identified value of an inertia."""
    parameters = fit.parameters
    if axis != "r":
        return INERTIA[axis], "kg m^2", parameters[INERTIA[axis]].value
    if "I_zz" in parameters.names:
        return "I_zz", "kg m^2", parameters["I_zz"].value
    return "I_zz/kappa", "kg m", 1.0 / parameters["kappa_per_I_zz"].value


def _spread(products: FloatArray, memory: int) -> float:
    """Variance of the sum of products that go together over some samples, by Newey and West."""
    total = float(products @ products)
    for lag in range(1, min(memory, products.size - 1) + 1):
        total += 2.0 * (1.0 - lag / (memory + 1.0)) * float(products[lag:] @ products[:-lag])
    return max(total, 0.0)


def _require(fit: MotorFit, injected: Sequence[FloatArray | None]) -> None:
    if len(injected) != len(fit.problem.records):
        raise UsageError(
            f"{counted(len(injected), 'excitation')} for {counted(len(fit.problem.records), 'record')}",
            needed="one for each record",
        )
    for record, signal in zip(fit.problem.records, injected, strict=True):
        if signal is not None and np.atleast_2d(signal).shape[-1] != record.samples:
            raise UsageError(
                f"an excitation of {np.atleast_2d(signal).shape[-1]} samples for {record.name}",
                needed=f"{record.samples}, as in the record",
            )


def _noisy(regression: InertiaRegression) -> Finding:
    direct, reverse = regression.biases
    return remark(
        "noisy_acceleration",
        regression.parameter,
        f"Plain regression would give {regression.parameter} {_off(direct)} from acceleration on torque and "
        f"{_off(reverse)} from torque on acceleration: torque explains {100.0 * regression.explained:.3g} % of "
        f"the measured acceleration, noise and gusts the rest. Corrected, they give {_pair(regression)}.",
        bias_direct=direct,
        bias_reverse=reverse,
        explained=regression.explained,
        direct=regression.corrected[0],
        reverse=regression.corrected[1],
        direct_std=regression.deviations[0],
        reverse_std=regression.deviations[1],
    )


def _disagreeing(regression: InertiaRegression) -> Finding:
    return warn(
        "both_ways_disagree",
        regression.parameter,
        f"Regression of acceleration on torque and of torque on acceleration gives {_pair(regression)} for "
        f"{regression.parameter}, {abs(regression.distance_sigmas):.1f} standard deviations apart, so slow and "
        "fast motion disagree. Lag, delay or damping differ from the model, or the motors did not receive the "
        "logged outputs.",
        direct=regression.corrected[0],
        reverse=regression.corrected[1],
        direct_std=regression.deviations[0],
        reverse_std=regression.deviations[1],
        apart=regression.distance_sigmas,
    )


def _off(share: float) -> str:
    return f"{100.0 * abs(share):.2g} % too {'large' if share > 0.0 else 'small'}"


def _pair(regression: InertiaRegression) -> str:
    (first, second), (near, far) = regression.corrected, regression.deviations
    return f"{with_error(first, near)} and {with_error(second, far)} {regression.unit}"
