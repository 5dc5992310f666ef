"""Kinematics that every flight obeys: are the sensors consistent with it, and what follows from them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from rotorid.data.channel import STANDARD_UNITS
from rotorid.data.findings import Finding
from rotorid.data.history import TimeHistory
from rotorid.errors import InsufficientDataError
from rotorid.signal.coherent import CrossSpectrum, coherent_lines, cross_spectrum
from rotorid.signal.reconstruct import (
    ACCELERATIONS,
    RATES,
    VELOCITIES,
    derivative,
    gravity_in_body,
    has_channels,
    transport,
)
from rotorid.signal.skew import Relation, time_skew
from rotorid.typing import FloatArray

SCALE_TOLERANCE = 0.05
"""A scale further from one than this is worth a warning, when it is surely so."""

_ATTITUDE = ("phi", "theta", "psi")
_EARTH_VELOCITIES = ("velocity_north", "velocity_east", "velocity_down")
_SURE = 3.0
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


@dataclass(frozen=True, kw_only=True)
class Kinematics:
    """All checks that a history allows, and the verdict on each."""

    checks: tuple[KinematicCheck, ...]
    findings: tuple[Finding, ...]


def kinematic_consistency(history: TimeHistory, *, band_rad_s: tuple[float, float] | None = None) -> Kinematics:
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
    of large terms, so a skew between velocity and attitude looks like a scale. Rates without all three angles are
    compared for small angles. The lag of a gyro behind its attitude is mostly that of its filter.

    Parameters
    ----------
    history
        Attitude or velocities beside the sensors, on one clock. What is missing is not checked.
    band_rad_s
        Where to look; by default up to 60 rad/s, where filters of sensors hardly change the gain. Above one radian per
        sample, a third of the Nyquist frequency, derivatives are not exact, and lines there are never used.

    Returns
    -------
    Kinematics
        A ``kinematic_inconsistency`` where the scale differs from one by more than 3 σ and 5 %, or the lag exceeds
        3 σ and one sample; else ``kinematic_consistency``; ``kinematics_unchecked`` where nothing moved coherently.

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
    expected, origins = _expected(history)
    low, high = band_rad_s or (0.0, _HIGHEST_DEFAULT_RAD_S)
    band = (low, min(high, _FASTEST_RAD * history.sample_rate_hz))
    checks, findings = [], []
    for name, values in expected.items():
        pair = _pair(history, name, values)
        try:
            check = _check(pair, name, origins[name], band)
        except InsufficientDataError as error:
            findings.append(_unchecked(name, error.came))
            continue
        checks.append(check)
        findings.append(_verdict(check, 1.0 / history.sample_rate_hz))
    return Kinematics(checks=tuple(checks), findings=tuple(findings))


def _expected(history: TimeHistory) -> tuple[Mapping[str, FloatArray], Mapping[str, str]]:
    """What each sensor should show, and what that follows from."""
    rates, rate_origins = _expected_rates(history)
    forces, force_origin = _expected_forces(history)
    expected = {name: values for name, values in (rates | forces).items() if name in history.names}
    return expected, rate_origins | dict.fromkeys(forces, force_origin)


def _expected_rates(history: TimeHistory) -> tuple[dict[str, FloatArray], dict[str, str]]:
    slopes = {
        name: derivative(np.unwrap(history[name]), history.sample_rate_hz)
        for name in _ATTITUDE
        if name in history.names
    }
    if len(slopes) < len(_ATTITUDE):
        small = {rate: slopes[angle] for rate, angle in zip(RATES, _ATTITUDE, strict=True) if angle in slopes}
        origins = {r: f"{a}, taken for small" for r, a in zip(RATES, _ATTITUDE, strict=True) if a in slopes}
        return small, origins
    phi, theta = history["phi"], history["theta"]
    d_phi, d_theta, d_psi = slopes.values()
    rates = {
        "p": d_phi - d_psi * np.sin(theta),
        "q": d_theta * np.cos(phi) + d_psi * np.cos(theta) * np.sin(phi),
        "r": d_psi * np.cos(theta) * np.cos(phi) - d_theta * np.sin(phi),
    }
    return rates, dict.fromkeys(rates, "attitude")


def _expected_forces(history: TimeHistory) -> tuple[dict[str, FloatArray], str]:
    if has_channels(history, (*VELOCITIES, *RATES, "phi", "theta")):
        velocities = np.stack([history[name] for name in VELOCITIES])
        forces = derivative(velocities, history.sample_rate_hz) + transport(history) - gravity_in_body(history)
        return dict(zip(ACCELERATIONS, forces, strict=True)), "body velocities, rates and attitude"
    if has_channels(history, (*_EARTH_VELOCITIES, *_ATTITUDE)):
        velocities = np.stack([history[name] for name in _EARTH_VELOCITIES])
        forces = _to_body(history, derivative(velocities, history.sample_rate_hz)) - gravity_in_body(history)
        return dict(zip(ACCELERATIONS, forces, strict=True)), "earth velocities and attitude"
    return {}, ""


def _to_body(history: TimeHistory, vectors: FloatArray) -> FloatArray:
    """Earth to body by yaw, pitch and roll, shape ``(3, samples)``."""
    for name, (i, j) in (("psi", (0, 1)), ("theta", (2, 0)), ("phi", (1, 2))):
        cosine, sine = np.cos(history[name]), np.sin(history[name])
        turned = vectors.copy()
        turned[i] = cosine * vectors[i] + sine * vectors[j]
        turned[j] = cosine * vectors[j] - sine * vectors[i]
        vectors = turned
    return vectors


def _pair(history: TimeHistory, name: str, expected: FloatArray) -> TimeHistory:
    channel = history.channels[history.names.index(name)]
    return replace(
        history,
        values=np.stack([expected, history[name]]),
        channels=(replace(channel, name=f"expected {name}"), channel),
    )


def _check(pair: TimeHistory, name: str, origin: str, band_rad_s: tuple[float, float]) -> KinematicCheck:
    reference = pair.names[0]
    skew = time_skew(pair, reference=reference, delayed=name, band_rad_s=band_rad_s)
    lines = coherent_lines(cross_spectrum(pair, reference, name, band_rad_s=band_rad_s), name)
    scale, scale_std = _scale(lines)
    if skew.relation == "opposite":
        scale = -scale
    mean = pair[reference].mean()
    difference = pair[name] - mean - scale * (pair[reference] - mean)
    blocks = [block.mean() for block in np.array_split(difference, _BLOCKS)]
    return KinematicCheck(
        channel=name,
        against=origin,
        scale=scale,
        scale_std=scale_std,
        bias=float(np.mean(difference)),
        bias_std=float(np.std(blocks, ddof=1) / math.sqrt(_BLOCKS)),
        lag_s=skew.seconds,
        lag_std_s=skew.std,
        relation=skew.relation,
        coherence=skew.coherence,
        band_rad_s=skew.band_rad_s,
    )


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


def _verdict(check: KinematicCheck, sample_s: float) -> Finding:
    off = abs(check.scale - 1.0)
    scaled = off > SCALE_TOLERANCE and off > _SURE * check.scale_std
    late = abs(check.lag_s) > sample_s and abs(check.lag_s) > _SURE * check.lag_std_s
    wrong = scaled or late or check.relation != "same"
    looks = "" if check.relation == "same" else f" It looks like the {check.relation} of it."
    return Finding(
        kind="kinematic_inconsistency" if wrong else "kinematic_consistency",
        severity="warning" if wrong else "info",
        where=check.channel,
        message=(
            f"{check.channel} is {check.scale:.3f} ± {check.scale_std:.3f} times what {check.against} give, "
            f"{1e3 * check.lag_s:.1f} ± {1e3 * check.lag_std_s:.1f} ms after it, with a bias of {check.bias:.3g} "
            f"{STANDARD_UNITS[check.channel]}.{looks}"
        ),
        numbers={
            "scale": check.scale,
            "scale_std": check.scale_std,
            "bias": check.bias,
            "bias_std": check.bias_std,
            "lag_s": check.lag_s,
            "lag_std_s": check.lag_std_s,
        },
    )


def _unchecked(name: str, reason: str) -> Finding:
    return Finding(
        kind="kinematics_unchecked",
        severity="info",
        where=name,
        message=f"{name} was not checked against the kinematics: {reason.rstrip('.')}.",
    )
