"""The kinematics of a rigid body, which every flight obeys: check sensors with it, and reconstruct what nobody logged.

Rates, attitude, velocities and accelerations over-determine each other. Where two of them come from different sensors,
their ratio shows scale, sign and lag of one of them; where a channel is missing, it follows from the others, and is
marked so. Horizontal motion can be turned into a frame that goes with the heading.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from rotorid.data.axes import ATTITUDE, RATES
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.quantity import milliseconds, with_error
from rotorid.data.record import STANDARD_UNITS, Channel, TimeHistory
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.frames import earth_to_body, rates_from_attitude
from rotorid.signal.skew import CrossSpectrum, Relation, coherent_lines, cross_spectrum, time_skew
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

VELOCITIES = ("u", "v", "w")
ACCELERATIONS = ("ax", "ay", "az")
EARTH_VELOCITIES = ("velocity_north", "velocity_east", "velocity_down")

_OF_BODY_VELOCITY = (*EARTH_VELOCITIES, *ATTITUDE)
_OF_ACCELERATION = (*ACCELERATIONS, *RATES, "phi", "theta")
_OF_HEADING = ("velocity_forward", "velocity_right")
_POSITION_OF = {"velocity_north": "north", "velocity_east": "east", "velocity_down": "down"}
_OF_ONE_PLANE = {
    "u_dot": ("ax", "q", "theta", "u", "w"),
    "v_dot": ("ay", "p", "phi", "v"),
    "w_dot": ("az", "q", "theta", "u", "w"),
}
"""What gives an acceleration in a file of one plane, where the channels of the other hardly move and count as zero."""

_OF_PLANES = (*RATES, *VELOCITIES, "phi", "theta")
_AT_REST = "not logged, taken as zero"


def derivative(values: FloatArray, sample_rate_hz: float) -> FloatArray:
    r"""Zero-phase derivative along the last axis: that of the cubic spline through the samples.

    Its gain over that of :math:`d/dt` is :math:`3 \sin x / (x (2 + \cos x))` with :math:`x = \omega / f_s`: within
    0.04 % at half a radian per sample, 0.6 % at one, and zero at the Nyquist frequency.

    Parameters
    ----------
    values
        Shape ``(..., samples)``, two samples and more; angles without jumps.

    Raises
    ------
    InsufficientDataError
        There are fewer than two samples, or one is not finite.

    Examples
    --------
    >>> derivative(np.array([0.0, 1.0, 4.0, 9.0, 16.0]), 1.0).round(9).tolist()
    [0.0, 2.0, 4.0, 6.0, 8.0]
    """
    if values.shape[-1] < 2 or not np.isfinite(values).all():
        raise InsufficientDataError(
            f"cannot differentiate {values.shape[-1]} samples", needed="two and more, all finite"
        )
    from scipy.interpolate import CubicSpline

    time_s = np.arange(values.shape[-1]) / sample_rate_hz
    return np.asarray(CubicSpline(time_s, values, axis=-1)(time_s, 1))


def has_channels(history: TimeHistory, names: tuple[str, ...]) -> bool:
    """Whether a history holds all of these channels."""
    return set(names) <= set(history.names)


def to_body(history: TimeHistory, vectors: FloatArray) -> FloatArray:
    r"""Vectors over the earth in body axes: :math:`R^T(\phi, \theta, \psi) \, v`, by yaw, pitch and roll in this order.

    Parameters
    ----------
    history
        With ``phi theta psi``.
    vectors
        North, east, down; shape ``(3, samples)``.

    Returns
    -------
    FloatArray
        Forward, right, down; shape ``(3, samples)``.
    """
    return earth_to_body(np.stack([history[name] for name in ATTITUDE]), vectors)


def gravity_in_body(history: TimeHistory) -> FloatArray:
    """Gravity in body axes, shape ``(3, samples)``."""
    phi, theta = history["phi"], history["theta"]
    down = np.stack([-np.sin(theta), np.cos(theta) * np.sin(phi), np.cos(theta) * np.cos(phi)])
    return np.asarray(STANDARD_GRAVITY_M_S2 * down)


def transport(history: TimeHistory) -> FloatArray:
    """What turning axes add to the derivative of body velocities, shape ``(3, samples)``.

    Parameters
    ----------
    history
        With ``u``, ``v``, ``w``, ``p``, ``q`` and ``r``.
    """
    rates, velocities = (np.stack([history[name] for name in names]) for names in (RATES, VELOCITIES))
    return np.asarray(np.cross(rates, velocities, axis=0))


def ingredients(name: str, logged: Iterable[str]) -> tuple[str, ...]:
    """Channels of a log that a channel can be reconstructed from; empty for a channel that nothing gives.

    Parameters
    ----------
    logged
        What the log holds. Where it cannot give the channel, the answer names what would be needed all the same.

    Examples
    --------
    >>> ingredients("p_dot", ["p", "q"])
    ('p',)
    >>> ingredients("w", ["u", "v"])
    ('velocity_north', 'velocity_east', 'velocity_down', 'phi', 'theta', 'psi')
    >>> ingredients("battery_voltage", ["p"])
    ()
    """
    if name in VELOCITIES:
        return _OF_BODY_VELOCITY
    if name in _POSITION_OF:
        return (_POSITION_OF[name],)
    if name == "velocity_down_dot":
        return ("velocity_down",)
    if name in _OF_HEADING:
        horizontal = EARTH_VELOCITIES[:2]
        positions = tuple(_POSITION_OF[name] for name in horizontal)
        differentiated = not set(horizontal) <= set(logged) and set(positions) <= set(logged)
        return (*(positions if differentiated else horizontal), "psi")
    if name in [f"{rate}_dot" for rate in RATES]:
        return (name.removesuffix("_dot"),)
    if name in [f"{velocity}_dot" for velocity in VELOCITIES]:
        plane = _OF_ONE_PLANE[name]
        if set(plane) <= set(logged) and not set(_OF_ACCELERATION) <= set(logged):
            return plane
        velocities = VELOCITIES if set(VELOCITIES) <= set(logged) else _OF_BODY_VELOCITY
        return tuple(dict.fromkeys((*_OF_ACCELERATION, *velocities)))
    return ()


def reconstruct(history: TimeHistory) -> TimeHistory:
    r"""Add velocities and accelerations that follow from what was measured, where their ingredients are there.

    .. math::

        \dot u = a_x - g \sin\theta - q w + r v, \quad
        \dot v = a_y + g \cos\theta \sin\phi - r u + p w, \quad
        \dot w = a_z + g \cos\theta \cos\phi - p v + q u

    without their means, which are those of trim and bias. Where they were not logged, :math:`(u, v, w) = R^T (V_N, V_E,
    V_D)`, exact for any attitude; a skew between velocity and attitude mixes them. :math:`\dot p, \dot q, \dot r` are
    zero-phase derivatives
    (cubic spline; right within 0.6 % up to a third of the Nyquist frequency). Derivatives raise noise with frequency:
    filter all channels alike first. Specific force is that of the sensor's place; off the center of gravity the angular
    accelerations leak in. A mean acceleration that was flown, a long climb, goes with the trim. In a file of one plane
    (``ax az q theta u w`` or ``ay p phi v``) what moves in the other counts as zero.

    Parameters
    ----------
    history
        Rates for ``p_dot q_dot r_dot``; positions for the velocities over the earth; these and the heading for
        ``velocity_forward velocity_right``, these and all three angles for ``u v w``; specific force, rates, body
        velocities, ``phi`` and ``theta`` for ``u_dot v_dot w_dot``.

    Returns
    -------
    TimeHistory
        With further channels, whose ``source`` begins with "reconstructed from". Channels of these names that
        are already there stay as they are.

    Raises
    ------
    UsageError
        There is nothing that anything could be reconstructed from.

    Examples
    --------
    >>> history = TimeHistory(
    ...     values=np.sin(np.arange(0.0, 5.0, 0.01))[None], channels=(Channel(name="q", unit="rad/s"),),
    ...     sample_rate_hz=100.0, start_s=0.0,
    ... )
    >>> made = reconstruct(history)
    >>> made.channels[1].name, made.channels[1].unit, made.channels[1].source
    ('q_dot', 'rad/s^2', 'reconstructed from q')
    """
    given = history
    history = _with_velocities_of_positions(history)
    history = _with_heading_velocities(history)
    history = _with_body_velocities(history)
    made: dict[str, tuple[FloatArray, str]] = {}
    for name in (*RATES, "velocity_down"):
        if name in history.names:
            made[f"{name}_dot"] = derivative(history[name], history.sample_rate_hz), name
    if has_channels(history, (*ACCELERATIONS, *RATES, *VELOCITIES, "phi", "theta")):
        force = history.values[[history.names.index(name) for name in ACCELERATIONS]]
        accelerations = force + gravity_in_body(history) - transport(history)
        for name, row, sensor in zip(VELOCITIES, accelerations, ACCELERATIONS, strict=True):
            made[f"{name}_dot"] = row - row.mean(), f"{sensor}, attitude, rates and velocities; trim removed"
    made |= _accelerations_of_one_plane(history, made)
    made = {name: value for name, value in made.items() if name not in history.names}
    history = _with(history, made) if made else history
    if history is given:
        raise UsageError(
            f"nothing can be reconstructed from {', '.join(history.names)}",
            needed="rates, velocities with all angles, or specific force with rates, body velocities, phi and theta",
        )
    return history


def _accelerations_of_one_plane(
    history: TimeHistory, made: Mapping[str, tuple[FloatArray, str]]
) -> dict[str, tuple[FloatArray, str]]:
    """Accelerations along the body from the channels of one plane alone."""
    found = {}
    for name, plane in _OF_ONE_PLANE.items():
        if name in made or not has_channels(history, plane):
            continue
        none = np.zeros(history.values.shape[1])
        there = {other: history[other] if other in history.names else none for other in _OF_PLANES}
        phi, theta = there["phi"], there["theta"]
        gravity = {
            "u_dot": -np.sin(theta),
            "v_dot": np.cos(theta) * np.sin(phi),
            "w_dot": np.cos(theta) * np.cos(phi),
        }
        turning = {
            "u_dot": there["q"] * there["w"] - there["r"] * there["v"],
            "v_dot": there["r"] * there["u"] - there["p"] * there["w"],
            "w_dot": there["p"] * there["v"] - there["q"] * there["u"],
        }
        row = history[plane[0]] + STANDARD_GRAVITY_M_S2 * gravity[name] - turning[name]
        found[name] = row - row.mean(), f"{', '.join(plane)}, the other plane taken as at rest; trim removed"
    return found


def _with_velocities_of_positions(history: TimeHistory) -> TimeHistory:
    """Velocities over the earth as derivatives of positions, as far as they are not there."""
    made = {
        velocity: (derivative(history[position], history.sample_rate_hz), position)
        for velocity, position in _POSITION_OF.items()
        if velocity not in history.names and position in history.names
    }
    return _with(history, made) if made else history


def _with_heading_velocities(history: TimeHistory) -> TimeHistory:
    """Horizontal velocities turned by the heading, as far as they are not there."""
    missing = [name for name in _OF_HEADING if name not in history.names]
    if not missing or not has_channels(history, (*EARTH_VELOCITIES[:2], "psi")):
        return history
    cosine, sine = np.cos(history["psi"]), np.sin(history["psi"])
    north, east = history["velocity_north"], history["velocity_east"]
    rows = {"velocity_forward": cosine * north + sine * east, "velocity_right": cosine * east - sine * north}
    return _with(history, {name: (rows[name], "velocity_north, velocity_east and psi") for name in missing})


def _with_body_velocities(history: TimeHistory) -> TimeHistory:
    """Body velocities beside those over the earth, as far as they are not there."""
    missing = [name for name in VELOCITIES if name not in history.names]
    if not missing or not has_channels(history, _OF_BODY_VELOCITY):
        return history
    rows = to_body(history, np.stack([history[name] for name in EARTH_VELOCITIES]))
    origin = "velocity_north, velocity_east, velocity_down and attitude"
    return _with(history, {n: (row, origin) for n, row in zip(VELOCITIES, rows, strict=True) if n in missing})


def _with(history: TimeHistory, made: Mapping[str, tuple[FloatArray, str]]) -> TimeHistory:
    added = tuple(
        Channel(name=name, unit=STANDARD_UNITS[name], source=f"reconstructed from {origin}")
        for name, (_, origin) in made.items()
    )
    return replace(
        history,
        values=np.vstack([history.values, *(values for values, _ in made.values())]),
        channels=(*history.channels, *added),
        processing=(*history.processing, f"{', '.join(made)} reconstructed"),
    )


SCALE_TOLERANCE = 0.05
"""A scale further from one than this is worth a warning, when it is surely so."""

Verdict: TypeAlias = Literal["consistent", "inconsistent", "uncertain"]

_SURE = 3.0
"""Standard deviations beyond which a scale or a lag is surely off."""

_LARGEST_STD = 0.1
"""Relative standard deviation of a scale beyond which there is no verdict."""

_LARGEST_CANCELLATION = 10.0
"""Size of the terms over that of their sum beyond which there is no verdict."""

_REMARKED_CANCELLATION = 2.0
"""The same beyond which it is remarked on."""

_SAME_LAG_S = 5e-5
"""Known lags that lie nearer are said as one."""

_BLOCKS = 10

_HIGHEST_DEFAULT_RAD_S = 60.0
"""Highest frequency that is compared unless the user says otherwise."""

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
    >>> from rotorid.data.record import Channel
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


def expected_motion(history: TimeHistory, channels: Collection[str]) -> dict[str, FloatArray]:
    """What sensors would show at the center of gravity without errors, as far as the other channels say.

    Of a file of one plane the channels of the other count as zero: rates, velocities and angles that hardly move there.

    Parameters
    ----------
    history
        Angles for rates; velocities, rates and angles for specific force.
    channels
        Rates or specific forces.
    """
    rates = _expected_rates(history) if set(channels) & set(RATES) else {}
    forces = _expected_forces(_with_plane(history)) if set(channels) & set(ACCELERATIONS) else {}
    return {
        name: expected.values
        for name, expected in (rates | forces).items()
        if name in channels and name in history.names
    }


_PLANES = (("u", "w", "q", "theta"), ("v", "p", "phi"))


def _with_plane(history: TimeHistory) -> TimeHistory:
    """A history of one plane with zeros for the channels of the other."""
    if has_channels(history, _OF_PLANES) or has_channels(history, (*EARTH_VELOCITIES, *ATTITUDE)):
        return history
    if not any(has_channels(history, plane) for plane in _PLANES):
        return history
    missing = [name for name in _OF_PLANES if name not in history.names]
    channels = tuple(Channel(name=name, unit=STANDARD_UNITS[name], source=_AT_REST) for name in missing)
    return replace(
        history,
        values=np.vstack([history.values, np.zeros((len(missing), history.values.shape[1]))]),
        channels=(*history.channels, *channels),
        processing=(*history.processing, f"{', '.join(missing)} taken as zero"),
    )


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
    angles = np.stack([history[name] for name in ATTITUDE])
    rates = rates_from_attitude(angles, np.stack(list(slopes.values())))
    return {name: _Expected(values=values, origin="attitude") for name, values in zip(RATES, rates, strict=True)}


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
    # All noise on one side or all on the other is as far away as this, and nothing shows which.
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
    return (warn if check.verdict == "inconsistent" else remark)(
        _KINDS[check.verdict],
        check.channel,
        f"{check.channel} is {with_error(check.scale, check.scale_std)} times what {check.against} {verb}, "
        f"{milliseconds(check.lag_s, check.lag_std_s)} ms after it, with a bias of "
        f"{with_error(check.bias, check.bias_std)} {STANDARD_UNITS[check.channel]}.{''.join(_remarks(check))}",
        scale=check.scale,
        scale_std=check.scale_std,
        bias=check.bias,
        bias_std=check.bias_std,
        lag_s=check.lag_s,
        lag_std_s=check.lag_std_s,
        cancellation=check.cancellation,
    )


def _remarks(check: KinematicCheck) -> Iterator[str]:
    """Remarks on the numbers, sentence by sentence."""
    low, high = check.known_lag_s
    if high > 0.0:
        spread = f"{1e3 * low:.1f} to {1e3 * high:.1f}" if high - low > _SAME_LAG_S else f"{1e3 * high:.1f}"
        yield f" Its known filters lag {spread} ms."
    if check.relation != "same":
        yield f" The data look like its {check.relation}."
    if check.verdict == "uncertain":
        reason = "its terms cancel" if check.cancellation > _LARGEST_CANCELLATION else "the scale is not known better"
        yield f" No verdict: {reason}."
    elif check.cancellation > _REMARKED_CANCELLATION:
        yield f" Its terms are {check.cancellation:.0f} times as large as their sum, and so are their errors."


def _unchecked(name: str, reason: str) -> Finding:
    return remark("kinematics_unchecked", name, f"{name} was not checked against the kinematics: {reason.rstrip('.')}.")


_PLAIN: Mapping[tuple[str, str], tuple[str, str]] = {
    ("north", "east"): ("forward", "right"),
    ("velocity_north", "velocity_east"): ("velocity_forward", "velocity_right"),
}
EARTH_TO_HEADING: Mapping[tuple[str, str], tuple[str, str]] = {
    **_PLAIN,
    **{(f"{a}_setpoint", f"{b}_setpoint"): (f"{c}_setpoint", f"{d}_setpoint") for (a, b), (c, d) in _PLAIN.items()},
}
"""Horizontal channels in earth axes, and their names in the frame that turns with the heading."""


def to_heading(history: TimeHistory, *, yaw: str = "psi") -> TimeHistory:
    r"""Turn positions, velocities and their commands by the heading: what was north and east is forward and right.

    .. math::

        \begin{bmatrix} x_{fwd} \\ x_{right} \end{bmatrix} =
        \begin{bmatrix} \cos\psi & \sin\psi \\ -\sin\psi & \cos\psi \end{bmatrix}
        \begin{bmatrix} x_{north} \\ x_{east} \end{bmatrix}

    Takes a slow drift of the heading out of the motion, so that a pitch maneuver moves one channel only. The down axis
    stays, so tilt is not taken out: these are not ``u`` and ``v``. While the heading turns, the derivative of the
    turned position is not the turned velocity; they differ by the turn rate times the distance from the origin.

    Parameters
    ----------
    history
        Holds the heading and at least one pair of ``north``/``east`` or ``velocity_north``/``velocity_east``, or of
        their set-points. Every pair is turned and renamed; other channels stay.
    yaw
        Channel of the heading, rad.

    Raises
    ------
    UsageError
        The heading, any pair, or the partner of a channel is missing.

    References
    ----------
    The derotation by the measured yaw angle is common with motion capture; see the identification of the Parrot
    Bebop 2 with random binary signals, appendix "Yaw drift".

    Examples
    --------
    Flying east with the nose to the east is flying forward:

    >>> from rotorid.data.record import Channel
    >>> names = {"velocity_north": "m/s", "velocity_east": "m/s", "psi": "rad"}
    >>> history = TimeHistory(
    ...     values=np.array([[0.0], [2.0], [np.pi / 2.0]]), sample_rate_hz=100.0, start_s=0.0,
    ...     channels=tuple(Channel(name=name, unit=unit) for name, unit in names.items()),
    ... )
    >>> turned = to_heading(history)
    >>> turned.names, turned["velocity_forward"].round(6).tolist()
    (('velocity_forward', 'velocity_right', 'psi'), [2.0])
    """
    names = history.names
    if yaw not in names:
        raise UsageError(
            f"there is no heading {yaw} in the data",
            needed=f"one of {', '.join(names)}",
            remedy="log the attitude, or name its channel",
        )
    present = [pair for pair in EARTH_TO_HEADING if set(pair) & set(names)]
    lonely = [name for pair in present for name in pair if name not in names]
    if lonely or not present:
        raise UsageError(
            f"there is no {' and no '.join(lonely) or 'pair of horizontal channels'} in the data",
            needed="both of " + " or both of ".join(" and ".join(pair) for pair in present or EARTH_TO_HEADING),
        )
    cosine, sine = np.cos(history[yaw]), np.sin(history[yaw])
    values, channels = history.values.copy(), list(history.channels)
    for pair in present:
        first, second = (names.index(name) for name in pair)
        north, east = history.values[first], history.values[second]
        values[first], values[second] = cosine * north + sine * east, cosine * east - sine * north
        for row, name in zip((first, second), EARTH_TO_HEADING[pair], strict=True):
            origin = channels[row].source or channels[row].name
            channels[row] = replace(channels[row], name=name, source=f"{origin} turned by the heading")
    turned = ", ".join(name for pair in present for name in pair)
    return replace(
        history,
        values=values,
        channels=tuple(channels),
        processing=(*history.processing, f"{turned} turned by the heading {yaw}"),
    )
