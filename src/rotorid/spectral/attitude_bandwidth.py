r"""Bandwidth and phase delay of an attitude response, after ADS-33."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from rotorid.data.immutable import Immutable
from rotorid.data.response import FrequencyResponse
from rotorid.spectral.log_curve import Estimated, Local, LogCurve, Row, crossings, log_curve
from rotorid.typing import FloatArray

_PHASE_LIMIT_RAD = -0.75 * math.pi
_SIX_DB = 6.0 * math.log(10.0) / 20.0
_FEWEST_POINTS = 3


@dataclass(frozen=True, kw_only=True)
class AttitudeBandwidth(Immutable):
    """How quickly an attitude follows its command.

    Parameters
    ----------
    omega_180_rad_s
        Where the phase first falls through −180°.
    phase_bandwidth_rad_s
        Where the phase first falls through −135°: 45° of phase margin for whoever closes a loop around it.
    gain_bandwidth_rad_s
        The highest frequency below ``omega_180_rad_s`` with 6 dB more gain than there.
    bandwidth_rad_s
        The smaller of the two.
    phase_delay_s
        From the phases at ω180 and at twice that.
    fitted_phase_delay_s
        From a straight line through the phase between them, which ADS-33 asks for where it is curved.
    not_seen
        Name of each field that is ``None``, and why.
    """

    omega_180_rad_s: Estimated | None
    phase_bandwidth_rad_s: Estimated | None
    gain_bandwidth_rad_s: Estimated | None
    bandwidth_rad_s: Estimated | None
    phase_delay_s: Estimated | None
    fitted_phase_delay_s: Estimated | None
    not_seen: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._set(not_seen=self.not_seen)


def attitude_bandwidth(response: FrequencyResponse) -> AttitudeBandwidth:
    r"""Bandwidth and phase delay of a response from stick or set-point to attitude.

    .. math:: \varphi(\omega_{BW}) = -135^\circ, \qquad
        \tau_p = -\frac{\varphi(2 \omega_{180}) + \pi}{2 \omega_{180}} = -\frac12 \frac{d\varphi}{d\omega}

    the second form for a straight phase. The lowest trusted point is taken to lie between 90° of lead and 270° of lag,
    which holds for attitude and for rate commands. For an attitude command the standard itself counts the phase
    bandwidth alone; a gain bandwidth below it warns of pilot-induced oscillation.

    Parameters
    ----------
    response
        Shape ``(1, 1, f)``, such as ``phi`` to ``roll_stick``.

    Raises
    ------
    UsageError
        There is more than one response, or the grid begins at zero.

    References
    ----------
    *Aeronautical Design Standard ADS-33E-PRF, Handling Qualities Requirements for Military Rotorcraft* (2000),
    section 3.3.2.1.

    Examples
    --------
    An attitude that follows at once but 0.1 s late: the phase is a straight line, and its delay half of that.

    >>> omega = np.geomspace(1.0, 80.0, 80)
    >>> late = FrequencyResponse(
    ...     omega_rad_s=omega, values=np.exp(-0.1j * omega)[None, None], coherence=np.ones((1, 1, 80)),
    ...     random_error=np.zeros((1, 1, 80)), covariance=np.zeros((1, 1, 80, 80)), inputs=("roll_stick",),
    ...     outputs=("phi",), estimate="direct",
    ... )
    >>> quality = attitude_bandwidth(late)
    >>> round(quality.phase_bandwidth_rad_s.value, 2), round(quality.phase_delay_s.value, 4)
    (23.56, 0.05)
    >>> quality.not_seen["gain_bandwidth_rad_s"]
    'no gain of 6 dB above that at −180° in 1 to 80 rad/s'
    """
    curve = log_curve(response)
    limit, half_turn = _first_fall(curve, _PHASE_LIMIT_RAD), _first_fall(curve, -math.pi)
    phase_bandwidth = None if limit is None else _omega(curve, limit, _phase_moved(limit))
    omega_180 = None if half_turn is None else _omega(curve, half_turn, _phase_moved(half_turn))
    gain_bandwidth = None if half_turn is None else _gain_bandwidth(curve, half_turn)
    both = [each for each in (phase_bandwidth, gain_bandwidth) if each is not None]
    results = {
        "omega_180_rad_s": omega_180,
        "phase_bandwidth_rad_s": phase_bandwidth,
        "gain_bandwidth_rad_s": gain_bandwidth,
        "bandwidth_rad_s": min(both, key=lambda each: each.value) if len(both) == 2 else None,
        "phase_delay_s": None if half_turn is None else _phase_delay(curve, half_turn),
        "fitted_phase_delay_s": None if half_turn is None else _fitted_delay(curve, half_turn),
    }
    band = curve.seen if curve.bands else "any band with five points below an error of 0.3"
    fall = f"no fall through −180° in {band}"
    twice = fall if half_turn is None else f"twice {half_turn.omega_rad_s:.3g} rad/s is not seen in {band}"
    reasons = {
        "omega_180_rad_s": fall,
        "phase_bandwidth_rad_s": f"no fall through −135° in {band}",
        "gain_bandwidth_rad_s": fall if half_turn is None else f"no gain of 6 dB above that at −180° in {band}",
        "bandwidth_rad_s": f"not both of gain and phase bandwidth are seen in {band}",
        "phase_delay_s": twice,
        "fitted_phase_delay_s": twice,
    }
    return AttitudeBandwidth(**results, not_seen={n: reasons[n] for n, result in results.items() if result is None})


def _first_fall(curve: LogCurve, level: float) -> Local | None:
    """The first crossing downward, unless the curve begins below the level."""
    if not curve.bands or curve.at(curve.bands[0][0]).value.imag <= level:
        return None
    return next((here for here, rising in crossings(curve, level, part="phase") if not rising), None)


def _phase_moved(here: Local) -> Row:
    return np.asarray(1j * here.weights / here.slope.imag)


def _gain_bandwidth(curve: LogCurve, half_turn: Local) -> Estimated | None:
    level = half_turn.value.real + _SIX_DB
    below = [here for here, _ in crossings(curve, level, part="magnitude") if here.x < half_turn.x]
    if not below:
        return None
    here = below[-1]
    # The level itself errs, by its own point and by the place of −180°.
    raised = half_turn.weights + half_turn.slope.real * _phase_moved(half_turn)
    return _omega(curve, here, (raised - here.weights) / here.slope.real)


def _phase_delay(curve: LogCurve, half_turn: Local) -> Estimated | None:
    x = half_turn.x + math.log(2.0)
    if not curve.covers(x):
        return None
    twice, moved = curve.at(x), _phase_moved(half_turn)
    delay_s = -(twice.value.imag + math.pi) / twice.omega_rad_s
    phase = -1j * twice.weights + twice.slope.imag * moved
    return Estimated(value=delay_s, std=curve.std(-phase / twice.omega_rad_s - delay_s * moved))


def _fitted_delay(curve: LogCurve, half_turn: Local) -> Estimated | None:
    """Half the slope of a weighted straight line through the phase of the points between ω180 and twice that."""
    stop = half_turn.x + math.log(2.0)
    inside = (curve.x >= half_turn.x) & (curve.x <= stop)
    # A hole in between is not bridged: both ends have to be in one band.
    one_band = any(low <= half_turn.x and stop <= high for low, high in curve.bands)
    if not one_band or inside.sum() < _FEWEST_POINTS:
        return None
    row: FloatArray = np.zeros(curve.x.size)
    omega = np.exp(curve.x[inside])
    centered = omega - omega.mean()
    row[inside] = -0.5 * centered / np.sum(centered**2)
    return Estimated(value=float(row @ curve.logarithms.imag), std=curve.std(-1j * row))


def _omega(curve: LogCurve, here: Local, moved: Row) -> Estimated:
    return Estimated(value=here.omega_rad_s, std=here.omega_rad_s * curve.std(moved))
