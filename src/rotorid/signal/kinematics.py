"""Kinematics that every flight obeys: are the sensors consistent with it, and what follows from them."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from rotorid.data.channel import STANDARD_UNITS
from rotorid.data.findings import Finding
from rotorid.data.history import TimeHistory
from rotorid.errors import InsufficientDataError
from rotorid.signal.coherent import CrossSpectrum, coherent_lines, cross_spectrum
from rotorid.signal.reconstruct import (
    ACCELERATIONS,
    ATTITUDE,
    EARTH_VELOCITIES,
    RATES,
    VELOCITIES,
    derivative,
    gravity_in_body,
    has_channels,
    to_body,
    transport,
)
from rotorid.signal.skew import Relation, time_skew
from rotorid.typing import FloatArray

SCALE_TOLERANCE = 0.05
"""A scale further from one than this is worth a warning, when it is surely so."""

Verdict: TypeAlias = Literal["consistent", "inconsistent", "uncertain"]

_SURE = 3.0
_LARGEST_STD = 0.1
_LARGEST_CANCELLATION = 10.0
_REMARKED_CANCELLATION = 2.0
_SAME_LAG_S = 5e-5
_BLOCKS = 10
_HIGHEST_DEFAULT_RAD_S = 60.0
_FASTEST_RAD = 1.0
"""Up to this phase per sample the derivative of a cubic spline is right within 0.6 %."""


@dataclass(frozen=True, kw_only=True)
class KinematicCheck:
    r"""A sensor against what the kinematics expect of it: :math:`y(t) = s \, x(t - \tau) + b`.

    Parameters
    ----------
    channel
        What was measured.
    against
        Where the expected motion came from.
    scale, scale_std
        :math:`s` and one standard deviation.
    bias, bias_std
        Measured less expected mean, in the unit of the channel, and one standard deviation.
    lag_s, lag_std_s
        :math:`\tau`, positive when the sensor comes later, and one standard deviation.
    relation
        ``same`` as it should be; ``opposite`` for a wrong sign, which the scale then has too.
    coherence
        Mean coherence of the lines that were used.
    band_rad_s
        Their lowest and highest frequency.
    known_lag_s
        Least and most of the lag that filters explain.
    cancellation
        How many times as large as the expected motion its largest term is. Near hover ``ax`` and ``ay`` are small
        differences of gravity and acceleration, and an error of either comes out that much larger.
    verdict
        ``uncertain`` where the data do not allow one.
    """

    channel: str
    against: str
    scale: float
    scale_std: float
    bias: float
    bias_std: float
    lag_s: float
    lag_std_s: float
    relation: Relation
    coherence: float
    band_rad_s: tuple[float, float]
    known_lag_s: tuple[float, float] = (0.0, 0.0)
    cancellation: float = 1.0
    verdict: Verdict = "consistent"


@dataclass(frozen=True, kw_only=True, eq=False)
class _Expected:
    """What a sensor should show, from what, and the terms that it is the sum of; shapes ``(samples,)``."""

    values: FloatArray
    origin: str
    terms: tuple[FloatArray, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Kinematics:
    """All checks that a history allows, and the verdict on each."""

    checks: tuple[KinematicCheck, ...]
    findings: tuple[Finding, ...]


def kinematic_consistency(
    history: TimeHistory,
    *,
    channels: Collection[str] = (*RATES, *ACCELERATIONS),
    band_rad_s: tuple[float, float] | None = None,
    known_lag_s: Mapping[str, tuple[float, float]] | None = None,
) -> Kinematics:
    r"""Compare rates with the attitude, and specific force with velocity and attitude.

    .. math::

        p = \dot\phi - \dot\psi \sin\theta, \quad
        q = \dot\theta \cos\phi + \dot\psi \cos\theta \sin\phi, \quad
        r = \dot\psi \cos\theta \cos\phi - \dot\theta \sin\phi

        a = \dot V + \omega \times V - R^T(\phi, \theta, \psi) \, g \, e_3

    with the velocity :math:`V` in body axes, or :math:`a = R^T (\dot V_{earth} - g e_3)`. Scale and lag come from the
    coherent lines of the cross-spectrum. Noise on the expected side lowers the usual ratio :math:`S_{xy} / S_{xx}` and
    noise on the measured side raises :math:`S_{yy} / S_{xy}`; the scale is their geometric mean, and their distance
    enters its standard deviation.

    An attitude or velocity that a filter computed from the very sensors agrees with them by construction: then the
    check finds errors of units, signs, axes and stamps, and no error of the sensor. An accelerometer off the center of
    gravity by :math:`d` measures :math:`\dot\omega \times d` more. Near hover ``ax`` and ``ay`` are small differences
    of large terms, so a skew between velocity and attitude looks like a scale: there the tolerances grow by the ratio
    of the largest term to the sum, and beyond ten there is no verdict. Rates without all three angles are compared for
    small angles. The lag of a gyro behind its attitude is mostly that of its filter.

    Parameters
    ----------
    history
        Attitude or velocities beside the sensors, on one clock. What is missing is not checked.
    channels
        What to check, among ``p q r ax ay az``.
    band_rad_s
        Where to look; by default up to 60 rad/s, where filters of sensors hardly change the gain. Above one radian per
        sample, a third of the Nyquist frequency, derivatives are not exact, and lines there are never used.
    known_lag_s
        Channel to the least and most lag that its filters explain; by default none.

    Returns
    -------
    Kinematics
        A ``kinematic_inconsistency`` where the scale differs from one by more than 3 σ and 5 %, or the lag from what
        filters explain by more than 3 σ and one sample; else ``kinematic_consistency``; ``kinematics_unchecked`` where
        nothing moved coherently, the scale is known no better than within 10 %, or its terms cancel.

    Raises
    ------
    InsufficientDataError
        Attitude or velocities hold samples that are not finite.

    References
    ----------
    V. Klein and E. A. Morelli, *Aircraft System Identification: Theory and Practice*, 2006, chapter 10 (data
    compatibility).

    Examples
    --------
    >>> from rotorid.data.channel import Channel
    >>> rng = np.random.default_rng(0)
    >>> theta = np.cumsum(np.convolve(rng.standard_normal(6000), np.hanning(20), "same")) * 1e-4
    >>> q = 1.2 * derivative(theta, 100.0)
    >>> history = TimeHistory(
    ...     values=np.stack([theta, q]), sample_rate_hz=100.0, start_s=0.0,
    ...     channels=(Channel(name="theta", unit="rad"), Channel(name="q", unit="rad/s")),
    ... )
    >>> result = kinematic_consistency(history)
    >>> round(result.checks[0].scale, 3), result.findings[0].kind, result.findings[0].severity
    (1.2, 'kinematic_inconsistency', 'warning')
    """
    low, high = band_rad_s or (0.0, _HIGHEST_DEFAULT_RAD_S)
    band = (low, min(high, _FASTEST_RAD * history.sample_rate_hz))
    checks, findings = [], []
    for name, expected in _all_expected(history, channels).items():
        try:
            check = _check(history, name, expected, band, (known_lag_s or {}).get(name, (0.0, 0.0)))
        except InsufficientDataError as error:
            findings.append(_unchecked(name, error.came))
            continue
        checks.append(check)
        findings.append(_finding(check))
    return Kinematics(checks=tuple(checks), findings=tuple(findings))


def _all_expected(history: TimeHistory, channels: Collection[str]) -> Mapping[str, _Expected]:
    """What each sensor should show, and what that follows from."""
    wanted = [name for name in channels if name in history.names]
    rates = _expected_rates(history) if set(wanted) & set(RATES) else {}
    forces = _expected_forces(history) if set(wanted) & set(ACCELERATIONS) else {}
    return {name: values for name, values in (rates | forces).items() if name in wanted}


def _expected_rates(history: TimeHistory) -> dict[str, _Expected]:
    slopes = {
        name: derivative(np.unwrap(history[name]), history.sample_rate_hz) for name in ATTITUDE if name in history.names
    }
    if len(slopes) < len(ATTITUDE):
        return {
            rate: _Expected(values=slopes[angle], origin=f"a small {angle}")
            for rate, angle in zip(RATES, ATTITUDE, strict=True)
            if angle in slopes
        }
    phi, theta = history["phi"], history["theta"]
    d_phi, d_theta, d_psi = slopes.values()
    rates = {
        "p": d_phi - d_psi * np.sin(theta),
        "q": d_theta * np.cos(phi) + d_psi * np.cos(theta) * np.sin(phi),
        "r": d_psi * np.cos(theta) * np.cos(phi) - d_theta * np.sin(phi),
    }
    return {name: _Expected(values=values, origin="attitude") for name, values in rates.items()}


def _expected_forces(history: TimeHistory) -> dict[str, _Expected]:
    if has_channels(history, (*VELOCITIES, *RATES, "phi", "theta")):
        velocities = np.stack([history[name] for name in VELOCITIES])
        motion = derivative(velocities, history.sample_rate_hz) + transport(history)
        origin = "body velocities, rates and attitude"
    elif has_channels(history, (*EARTH_VELOCITIES, *ATTITUDE)):
        velocities = np.stack([history[name] for name in EARTH_VELOCITIES])
        motion, origin = (
            to_body(history, derivative(velocities, history.sample_rate_hz)),
            "earth velocities and attitude",
        )
    else:
        return {}
    return {
        name: _Expected(values=moved - gravity, origin=origin, terms=(moved, gravity))
        for name, moved, gravity in zip(ACCELERATIONS, motion, gravity_in_body(history), strict=True)
    }


def _pair(history: TimeHistory, name: str, expected: FloatArray) -> TimeHistory:
    channel = history.channels[history.names.index(name)]
    return replace(
        history,
        values=np.stack([expected, history[name]]),
        channels=(replace(channel, name=f"expected {name}"), channel),
    )


def _check(
    history: TimeHistory,
    name: str,
    expected: _Expected,
    band_rad_s: tuple[float, float],
    known_lag_s: tuple[float, float],
) -> KinematicCheck:
    pair = _pair(history, name, expected.values)
    reference = pair.names[0]
    skew = time_skew(pair, reference=reference, delayed=name, band_rad_s=band_rad_s)
    lines = coherent_lines(cross_spectrum(pair, reference, name, band_rad_s=band_rad_s), name)
    scale, scale_std = _scale(lines)
    if skew.relation == "opposite":
        scale = -scale
    mean = pair[reference].mean()
    difference = pair[name] - mean - scale * (pair[reference] - mean)
    blocks = [block.mean() for block in np.array_split(difference, _BLOCKS)]
    check = KinematicCheck(
        channel=name,
        against=expected.origin,
        scale=scale,
        scale_std=scale_std,
        bias=float(np.mean(difference)),
        bias_std=float(np.std(blocks, ddof=1) / math.sqrt(_BLOCKS)),
        lag_s=skew.seconds,
        lag_std_s=skew.std,
        relation=skew.relation,
        coherence=skew.coherence,
        band_rad_s=skew.band_rad_s,
        known_lag_s=known_lag_s,
        cancellation=_cancellation(history, name, expected, lines),
    )
    return replace(check, verdict=_verdict(check, 1.0 / history.sample_rate_hz))


def _cancellation(history: TimeHistory, name: str, expected: _Expected, lines: CrossSpectrum) -> float:
    """Amplitude of the largest term over that of the sum, where the lines that count are."""
    ratio = 1.0
    for term in expected.terms:
        spectrum = cross_spectrum(
            _pair(history, name, term), f"expected {name}", name, band_rad_s=tuple(lines.omega_rad_s[[0, -1]])
        )
        power = spectrum.first[np.isin(spectrum.omega_rad_s.round(9), lines.omega_rad_s.round(9))]
        ratio = max(ratio, math.sqrt(float(np.average(power / lines.first, weights=lines.weight))))
    return ratio


def _scale(lines: CrossSpectrum) -> tuple[float, float]:
    """Gain between the two sides, noise on either, and one standard deviation of it."""
    log_gain = 0.5 * np.log(lines.second / lines.first)
    weight = lines.weight
    mean = float(np.average(log_gain, weights=weight))
    spread = max(1.0, float(np.sum(weight * (log_gain - mean) ** 2)) / (log_gain.size - 1))
    # All noise on one side or all on the other is as far away as this, and nothing tells which.
    reach = float(np.average(-0.5 * np.log(np.minimum(lines.coherence, 1.0)), weights=weight))
    scale = math.exp(mean)
    return scale, scale * math.sqrt(spread / float(np.sum(weight)) + reach**2)


def _verdict(check: KinematicCheck, sample_s: float) -> Verdict:
    if check.scale_std > _LARGEST_STD * abs(check.scale) or check.cancellation > _LARGEST_CANCELLATION:
        return "uncertain"
    if check.relation != "same":
        return "inconsistent"
    off = abs(check.scale - 1.0)
    low, high = check.known_lag_s
    late = max(low - check.lag_s, check.lag_s - high, 0.0)
    scaled = off > SCALE_TOLERANCE * check.cancellation and off > _SURE * check.scale_std
    skewed = late > sample_s * check.cancellation and late > _SURE * check.lag_std_s
    return "inconsistent" if scaled or skewed else "consistent"


_KINDS: Mapping[Verdict, str] = {
    "consistent": "kinematic_consistency",
    "inconsistent": "kinematic_inconsistency",
    "uncertain": "kinematics_unchecked",
}


def _finding(check: KinematicCheck) -> Finding:
    verb = "gives" if check.against == "attitude" or check.against.startswith("a small") else "give"
    return Finding(
        kind=_KINDS[check.verdict],
        severity="warning" if check.verdict == "inconsistent" else "info",
        where=check.channel,
        message=(
            f"{check.channel} is {check.scale:.3f} ± {check.scale_std:.3f} times what {check.against} {verb}, "
            f"{1e3 * check.lag_s:.1f} ± {1e3 * check.lag_std_s:.1f} ms after it, with a bias of {check.bias:.3g} "
            f"{STANDARD_UNITS[check.channel]}.{''.join(_remarks(check))}"
        ),
        numbers={
            "scale": check.scale,
            "scale_std": check.scale_std,
            "bias": check.bias,
            "bias_std": check.bias_std,
            "lag_s": check.lag_s,
            "lag_std_s": check.lag_std_s,
            "cancellation": check.cancellation,
        },
    )


def _remarks(check: KinematicCheck) -> Iterator[str]:
    """What belongs beside the numbers, sentence by sentence."""
    low, high = check.known_lag_s
    if high > 0.0:
        spread = f"{1e3 * low:.1f} to {1e3 * high:.1f}" if high - low > _SAME_LAG_S else f"{1e3 * high:.1f}"
        yield f" Its known filters lag {spread} ms."
    if check.relation != "same":
        yield f" It looks like the {check.relation} of it."
    if check.verdict == "uncertain":
        reason = "its terms cancel" if check.cancellation > _LARGEST_CANCELLATION else "the scale is not known better"
        yield f" No verdict: {reason}."
    elif check.cancellation > _REMARKED_CANCELLATION:
        yield f" Its terms are {check.cancellation:.0f} times as large as their sum, and so are their errors."


def _unchecked(name: str, reason: str) -> Finding:
    return Finding(
        kind="kinematics_unchecked",
        severity="info",
        where=name,
        message=f"{name} was not checked against the kinematics: {reason.rstrip('.')}.",
    )
