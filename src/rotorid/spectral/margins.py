"""Margins and bandwidths read off measured responses, each with its uncertainty; none that the flight does not show.

Gain and phase margins of a broken loop, rejection of disturbances of a sensitivity, and the bandwidth and phase delay
of an attitude response after ADS-33. Everything is read off a local fit over the logarithm of frequency
(:mod:`rotorid.spectral.derived`), inside the band in which the points can be trusted: a relative error of at most 0.3,
and a coherence of at least 0.3 for a joint estimate. A crossing outside is ``None``, and ``not_seen`` says where it
was looked for: nothing is extrapolated. What the end of the band says about it stands in ``bounds``. Standard
deviations follow by the delta method from the covariance between frequencies; what moves with a crossing (the phase at
a crossover that is uncertain itself) is counted in. They hold the scatter of the flight alone: not the last points of
a sweep that ends near the crossing, where its transient biases them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.quantity import TWO_SIDED_95
from rotorid.data.response import FrequencyResponse
from rotorid.spectral.derived import Estimated, Local, LogCurve, Row, crossings, log_curve
from rotorid.spectral.loops import sensitivity
from rotorid.typing import FloatArray

_TURN = 2.0 * math.pi
_SAME = 1e-9
_MINUS_3_DB = -3.0 * math.log(10.0) / 20.0


@dataclass(frozen=True, kw_only=True, slots=True)
class Bound:
    """What the end of a band says about a number that lies beyond.

    Parameters
    ----------
    value, std
        The bound and one standard deviation of it, in the unit of the number.
    at_least
        Whether the number is at least this, or at most.
    omega_rad_s
        The end of the band.
    """

    value: float
    std: float
    at_least: bool
    omega_rad_s: float


@dataclass(frozen=True, kw_only=True, slots=True)
class GainCrossover:
    """Where the magnitude of the loop passes one.

    Parameters
    ----------
    phase_margin_rad
        Phase above −180°, in (−π, π].
    delay_margin_s
        Additional delay that turns the loop to −1 here: the phase margin over the frequency, one turn more where the
        margin is negative.
    """

    omega_rad_s: Estimated
    phase_margin_rad: Estimated
    delay_margin_s: Estimated


@dataclass(frozen=True, kw_only=True, slots=True)
class PhaseCrossover:
    """Where the phase of the loop passes −180° or a whole turn from it.

    Parameters
    ----------
    gain_margin
        Factor that brings the loop to −1 here: above one the gain may rise by it, below one it may fall by it.
    """

    omega_rad_s: Estimated
    gain_margin: Estimated


@dataclass(frozen=True, kw_only=True)
class LoopMargins(Immutable):
    """All crossings of a loop, and the smallest margin of each kind.

    Parameters
    ----------
    gain_crossovers, phase_crossovers
        In order of frequency.
    phase_margin_rad, delay_margin_s
        The smallest over all gain crossovers.
    gain_margin_up, gain_margin_down
        The factor above one and that below one which are nearest to one.
    modulus_margin, modulus_omega_rad_s
        Least distance of the loop from −1, the inverse of the peak of the sensitivity, and where that is.
    not_seen
        Name of each field that is ``None``, and why.
    bounds
        Name of some of these fields to what the upper end of the band says: the phase margin is at most what is left
        where the gain is still above one, the gain margin at least what the gain has fallen by, where both go on
        falling; the modulus margin at most that where the sensitivity still rises.
    """

    gain_crossovers: tuple[GainCrossover, ...]
    phase_crossovers: tuple[PhaseCrossover, ...]
    phase_margin_rad: Estimated | None
    delay_margin_s: Estimated | None
    gain_margin_up: Estimated | None
    gain_margin_down: Estimated | None
    modulus_margin: Estimated | None
    modulus_omega_rad_s: Estimated | None
    not_seen: Mapping[str, str] = field(default_factory=dict)
    bounds: Mapping[str, Bound] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._set(not_seen=self.not_seen, bounds=self.bounds)


@dataclass(frozen=True, kw_only=True)
class DisturbanceRejection(Immutable):
    """How a loop holds against disturbances.

    Parameters
    ----------
    bandwidth_rad_s
        Where the sensitivity first rises through −3 dB, coming from low frequency.
    peak, peak_omega_rad_s
        Largest magnitude of the sensitivity, as a factor, and where it is.
    not_seen
        Name of each field that is ``None``, and why.
    bounds
        Name of some of these fields to what the upper end of the band says: where the sensitivity still rises there,
        its peak is at least that.
    """

    bandwidth_rad_s: Estimated | None
    peak: Estimated | None
    peak_omega_rad_s: Estimated | None
    not_seen: Mapping[str, str] = field(default_factory=dict)
    bounds: Mapping[str, Bound] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._set(not_seen=self.not_seen, bounds=self.bounds)


def loop_margins(loop: FrequencyResponse) -> LoopMargins:
    r"""Gain, phase, delay and modulus margins of a broken-loop response.

    .. math:: |L(j\omega_c)| = 1: \; \varphi_m = \pi + \angle L(j\omega_c), \; \tau_m = \varphi_m / \omega_c; \qquad
        \angle L(j\omega_\pi) = -\pi: \; k_m = 1 / |L(j\omega_\pi)|; \qquad s_m = \min_\omega |1 + L|

    Assumes that the closed loop was stable, as it was if it flew, and that smallest margins lie in the band seen. The
    modulus margin is the minimum of an uncertain curve: it comes out too small by the order of its standard deviation
    where the curve is flat. The place of a peak has a wide
    interval, which holds the truth more often than it says.

    Parameters
    ----------
    loop
        Broken-loop response, shape ``(1, 1, f)``, from :mod:`rotorid.spectral.loops`.

    Raises
    ------
    UsageError
        There is more than one response, or the grid begins at zero.

    References
    ----------
    Åström and Murray, *Feedback Systems* (2008), chapter 9.

    Examples
    --------
    An integrator with a delay of 0.1 s: crossover at 5 rad/s, 61.4° of phase and a factor of π there.

    >>> omega = np.geomspace(0.5, 50.0, 60)
    >>> loop = FrequencyResponse(
    ...     omega_rad_s=omega, values=(5.0 / (1j * omega) * np.exp(-0.1j * omega))[None, None],
    ...     coherence=np.ones((1, 1, 60)), random_error=np.zeros((1, 1, 60)), covariance=np.zeros((1, 1, 60, 60)),
    ...     inputs=("roll_command",), outputs=("roll_feedback",), estimate="joint",
    ... )
    >>> margins = loop_margins(loop)
    >>> round(math.degrees(margins.phase_margin_rad.value), 1), round(margins.gain_margin_up.value, 2)
    (61.4, 3.14)
    >>> margins.not_seen["gain_margin_down"]
    'no crossing of −180° with a gain above one in 0.5 to 50 rad/s'
    """
    curve = log_curve(loop)
    gains = tuple(_gain_crossover(curve, here) for here, _ in crossings(curve, 0.0, part="magnitude"))
    phases = tuple(_phase_crossover(curve, here) for here in _half_turns(curve))
    rejection = disturbance_rejection(sensitivity(loop))
    modulus = rejection.peak and _inverse(rejection.peak)
    up = [crossover.gain_margin for crossover in phases if crossover.gain_margin.value >= 1.0]
    down = [crossover.gain_margin for crossover in phases if crossover.gain_margin.value < 1.0]
    results = {
        "phase_margin_rad": min((c.phase_margin_rad for c in gains), key=lambda e: abs(e.value), default=None),
        "delay_margin_s": min((c.delay_margin_s for c in gains), key=lambda e: e.value, default=None),
        "gain_margin_up": min(up, key=lambda e: e.value, default=None),
        "gain_margin_down": max(down, key=lambda e: e.value, default=None),
        "modulus_margin": modulus,
        "modulus_omega_rad_s": rejection.peak_omega_rad_s,
    }
    gain = _missing("no crossing of gain one", curve)
    reasons = {
        "phase_margin_rad": gain,
        "delay_margin_s": gain,
        "gain_margin_up": _missing("no crossing of −180° with a gain below one", curve),
        "gain_margin_down": _missing("no crossing of −180° with a gain above one", curve),
        "modulus_margin": rejection.not_seen.get("peak", ""),
        "modulus_omega_rad_s": rejection.not_seen.get("peak", ""),
    }
    bounds = _margin_bounds(curve, results)
    if modulus is None and "peak" in rejection.bounds:
        peak = rejection.bounds["peak"]
        bounds["modulus_margin"] = Bound(
            value=1.0 / peak.value, std=peak.std / peak.value**2, at_least=False, omega_rad_s=peak.omega_rad_s
        )
    return LoopMargins(
        gain_crossovers=gains,
        phase_crossovers=phases,
        **results,
        not_seen=_reasons(results, reasons),
        bounds=bounds,
    )


def disturbance_rejection(response: FrequencyResponse) -> DisturbanceRejection:
    r"""Bandwidth and peak of a sensitivity.

    .. math:: 20 \log_{10} |S(j\omega_{DRB})| = -3, \qquad \max_\omega |S|

    Requirements are written for the attitude: give the response of the measured attitude to a disturbance that is added
    to it. The sensitivity at the plant's input is the same function only where nothing but the attitude is fed back;
    with a rate loop inside it says how the vehicle holds against moments.

    Parameters
    ----------
    response
        Sensitivity, shape ``(1, 1, f)``.

    Raises
    ------
    UsageError
        There is more than one response, or the grid begins at zero.

    References
    ----------
    Tischler, Berger, Ivler, Mansur, Cheung and Soong, *Practical Methods for Aircraft and Rotorcraft Flight Control
    Design* (2017).
    """
    curve = log_curve(response)
    bandwidth, why = _rejection_bandwidth(curve)
    top = _peak(curve)
    peak = place = None
    # Feedback that helps somewhere does harm elsewhere: the peak is above one, and a lower hill is none.
    if top is not None and top.value.real > 0.0:
        place = Estimated(value=top.omega_rad_s, std=top.omega_rad_s * _peak_reach(curve, top) / TWO_SIDED_95)
        height = math.exp(top.value.real)
        peak = Estimated(value=height, std=height * curve.std(top.weights))
    results = {"bandwidth_rad_s": bandwidth, "peak": peak, "peak_omega_rad_s": place}
    highest = _missing("no peak", curve)
    reasons = {"bandwidth_rad_s": why, "peak": highest, "peak_omega_rad_s": highest}
    return DisturbanceRejection(
        **results, not_seen=_reasons(results, reasons), bounds=_rejection_bounds(curve, results)
    )


def _margin_bounds(curve: LogCurve, results: Mapping[str, Estimated | None]) -> dict[str, Bound]:
    """What the upper end of the band says about margins that lie beyond, where gain and phase go on falling."""
    if not curve.bands:
        return {}
    end = curve.at(curve.bands[-1][1])
    omega, bounds = end.omega_rad_s, {}
    falls = end.slope.real < 0.0 and end.slope.imag < 0.0
    if falls and end.value.real > 0.0 and results["phase_margin_rad"] is None:
        margin, std = math.remainder(end.value.imag + math.pi, _TURN), curve.std(-1j * end.weights)
        if margin > 0.0:
            bounds["phase_margin_rad"] = Bound(value=margin, std=std, at_least=False, omega_rad_s=omega)
            bounds["delay_margin_s"] = Bound(value=margin / omega, std=std / omega, at_least=False, omega_rad_s=omega)
    if falls and end.value.real < 0.0 and results["gain_margin_up"] is None:
        margin = math.exp(-end.value.real)
        bounds["gain_margin_up"] = Bound(
            value=margin, std=margin * curve.std(end.weights), at_least=True, omega_rad_s=omega
        )
    return bounds


def _rejection_bounds(curve: LogCurve, results: Mapping[str, Estimated | None]) -> dict[str, Bound]:
    """A peak beyond the upper end of the band, or a bandwidth there."""
    if not curve.bands:
        return {}
    end, bounds = curve.at(curve.bands[-1][1]), {}
    omega = end.omega_rad_s
    highest = max(float(curve.grid(band)[1].real.max()) for band in curve.bands)
    x, logarithms = curve.grid(curve.bands[-1])
    top = curve.at(float(x[int(np.argmax(logarithms.real))]))
    if results["peak"] is None and top.value.real >= max(highest, 0.0) - _SAME and top.value.real > 0.0:
        height = math.exp(top.value.real)
        bounds["peak"] = Bound(value=height, std=height * curve.std(top.weights), at_least=True, omega_rad_s=omega)
    if results["bandwidth_rad_s"] is None and highest < _MINUS_3_DB:
        bounds["bandwidth_rad_s"] = Bound(value=omega, std=0.0, at_least=True, omega_rad_s=omega)
    return bounds


def _gain_crossover(curve: LogCurve, here: Local) -> GainCrossover:
    moved = -here.weights / here.slope.real
    omega = _omega(curve, here, moved)
    margin = math.remainder(here.value.imag + math.pi, _TURN)
    # The phase errs by itself (a turn by −j makes the imaginary part real) and with the crossover.
    phase = -1j * here.weights + here.slope.imag * moved
    delay_s = margin % _TURN / omega.value
    return GainCrossover(
        omega_rad_s=omega,
        phase_margin_rad=Estimated(value=margin, std=curve.std(phase)),
        delay_margin_s=Estimated(value=delay_s, std=curve.std(phase / omega.value - delay_s * moved)),
    )


def _half_turns(curve: LogCurve) -> tuple[Local, ...]:
    """Crossings of −180° and of all that is whole turns from it, in order of frequency."""
    if not curve.bands:
        return ()
    phase = curve.logarithms.imag
    turns = range(math.floor(phase.min() / _TURN) - 1, math.ceil(phase.max() / _TURN) + 1)
    found = [here for n in turns for here, _ in crossings(curve, math.pi + n * _TURN, part="phase")]
    return tuple(sorted(found, key=lambda here: here.x))


def _phase_crossover(curve: LogCurve, here: Local) -> PhaseCrossover:
    moved = 1j * here.weights / here.slope.imag
    margin = math.exp(-here.value.real)
    row = here.weights + here.slope.real * moved
    return PhaseCrossover(
        omega_rad_s=_omega(curve, here, moved),
        gain_margin=Estimated(value=margin, std=margin * curve.std(row)),
    )


def _rejection_bandwidth(curve: LogCurve) -> tuple[Estimated | None, str]:
    rises = [here for here, up in crossings(curve, _MINUS_3_DB, part="magnitude") if up]
    for low, high in curve.bands:
        if curve.at(low).value.real >= _MINUS_3_DB:
            # Below this band, or in the hole in front of it, the sensitivity may have risen and fallen unseen.
            return None, f"not seen: already above −3 dB at {math.exp(low):.3g} rad/s, where a band begins"
        inside = [here for here in rises if low <= here.x <= high]
        if inside:
            return _omega(curve, inside[0], -inside[0].weights / inside[0].slope.real), ""
    return None, _missing("no rise through −3 dB", curve)


_TO_END = 60
"""Places between a peak and the end of its band that are compared with it."""


def _peak(curve: LogCurve) -> Local | None:
    """The highest point of the curve, if it is not at the end of a band, and lies above its upper end beyond doubt.

    Where the end is as high within its error, the curve may rise on beyond it.
    """
    best: Local | None = None
    highest = -math.inf
    for band in curve.bands:
        x, logarithms = curve.grid(band)
        k = int(np.argmax(logarithms.real))
        if logarithms[k].real > highest:
            highest = float(logarithms[k].real)
            top = curve.at(float(x[k]))
            best = None if k in (0, x.size - 1) or not _falls_after(curve, top, band[1]) else top
    return best


def _falls_after(curve: LogCurve, top: Local, end: float) -> bool:
    """Whether the curve lies lower somewhere between a point and the end of its band, beyond doubt (95 %)."""
    x = np.linspace(top.x, end, _TO_END)[1:]
    found = [curve.at(float(place)) for place in x]
    return any(
        top.value.real - local.value.real > TWO_SIDED_95 * curve.std(local.weights - top.weights) for local in found
    )


def _peak_reach(curve: LogCurve, top: Local) -> float:
    r"""How far from the peak in :math:`\ln\omega` the curve is not lower beyond doubt (95 %).

    Of a flat peak neither the place nor the curvature is known well enough for the delta method.
    """
    (band,) = (band for band in curve.bands if band[0] <= top.x <= band[1])
    x, logarithms = curve.grid(band)
    _, rows = curve.near(x)
    drop = top.value.real - logarithms.real
    doubt = TWO_SIDED_95 * np.array([curve.std(row) for row in rows[:, 0] - top.weights])
    lower = drop > doubt
    left, right = x[lower & (x < top.x)], x[lower & (x > top.x)]
    low, high = left[-1] if left.size else x[0], right[0] if right.size else x[-1]
    return float(max(top.x - low, high - top.x))


def _omega(curve: LogCurve, here: Local, moved: Row) -> Estimated:
    return Estimated(value=here.omega_rad_s, std=here.omega_rad_s * curve.std(moved))


def _inverse(estimate: Estimated) -> Estimated:
    return Estimated(value=1.0 / estimate.value, std=estimate.std / estimate.value**2)


def _missing(what: str, curve: LogCurve) -> str:
    return (
        f"{what} in {curve.bands_text}" if curve.bands else f"{what}: no five points together with an error below 0.3"
    )


def _reasons(results: Mapping[str, Estimated | None], reasons: Mapping[str, str]) -> dict[str, str]:
    return {name: reasons[name] for name, result in results.items() if result is None}


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
    band = curve.bands_text if curve.bands else "any band with five points below an error of 0.3"
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
