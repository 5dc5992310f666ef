r"""Scale, bias, misalignment and place of rate gyros and accelerometers, from the kinematics of a flight.

Attitude and velocity say what an ideal sensor at the center of gravity would have shown, :math:`t`. What a sensor
showed, :math:`m`, is corrected to it by a matrix close to one, a constant and, for an accelerometer, its place
:math:`r` before the center of gravity,

.. math:: t = (1 + D) \, m + c - K r, \qquad K = [\dot\omega]_\times + [\omega]_\times^2

The diagonal of :math:`D` is the error of scale with its sign turned, off the diagonal stands the misalignment. All are
found by regression over the Fourier lines of a band, where noise of either side is weighed by frequency, and :math:`c`
from the means. A lag, and a loss of amplitude with the square of frequency, as filters and smoothed estimates have,
are fitted along so that they pass for no error, and are not corrected. Where parts of the band still contradict each
other, the stated errors are wider by as much.

Attitude and velocity are believed: an estimate of them that was made of the wrong sensor alone shows no error. Noise of
the corrected sensors themselves makes :math:`1 + D` too small by their share of its power.

References
----------
Klein and Morelli, *Aircraft System Identification: Theory and Practice*, chapter 10 (data compatibility). Tischler and
Remple, *Aircraft and Rotorcraft System Identification*, chapter 6 (kinematic consistency).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rotorid.data.axes import RATES
from rotorid.data.base import Immutable, read_only
from rotorid.data.findings import Finding, remark
from rotorid.data.quantity import TWO_SIDED_95, with_error
from rotorid.data.record import TimeHistory
from rotorid.errors import InsufficientDataError
from rotorid.signal.kinematics import (
    ACCELERATIONS,
    derivative,
    expected_motion,
)
from rotorid.typing import FloatArray

PLACES = ("x", "y", "z")
"""Coordinates of an accelerometer before the center of gravity, forward, right, down."""

BAND_RAD_S = (0.5, 30.0)
LARGEST_STD = {"scale": 0.02, "misalignment": 0.02, "place": 0.005}
"""What is known worse than this (of one, radians, meters) was not excited, and is left as it is: a board is mounted by
eye to some 10 mm."""

_FASTEST_RAD = 0.5
_HANN_CORRELATION = 1.0 + 2.0 * ((2.0 / 3.0) ** 2 + (1.0 / 6.0) ** 2)
"""Neighboring lines under a Hann taper share data: so much the variance of a regression over all of them grows."""

_OF_FILTERS = ("lag", "curvature")
"""What a filter in front of one side does at low frequency: a delay, and an amplitude that falls with its square."""

_LOWEST_TOP_RAD_S = 10.0
"""Logged too slowly to reach it, velocities are smoothed so far that acceleration cannot be separated from them."""

_PARTS = 4
_NEIGHBORS = 15
_BLOCKS = 10
_TINY = 1e-30


@dataclass(frozen=True, kw_only=True)
class SensorTerm(Immutable):
    """One error of a sensor.

    Parameters
    ----------
    channel
        The sensor; ``accelerometer`` for its place.
    kind
        ``scale``, ``misalignment``, ``bias`` or ``place``.
    toward
        The channel that leaks in by a misalignment, or the coordinate of a place.
    value, std
        Scale as what the sensor shows too much, relative; misalignment in radians; bias in the unit of the channel;
        place in meters. One standard deviation.
    unit
        Of both.
    """

    channel: str
    kind: str
    toward: str = ""
    value: float
    std: float
    unit: str

    @property
    def name(self) -> str:
        """Such as ``scale of q``."""
        if self.kind == "misalignment":
            return f"{self.toward} in {self.channel}"
        return f"{self.toward or self.kind} of {self.channel}"


@dataclass(frozen=True, kw_only=True, eq=False)
class SensorCorrection(Immutable):
    """What to add to sensors.

    Parameters
    ----------
    matrix
        Sensor to the share of each sensor to add to it, :math:`D`.
    constant
        Sensor to what to add, :math:`c`.
    place_m
        Place of the accelerometer, meters forward, right and down of the center of gravity.
    terms
        The same as errors of sensors, with their standard deviations.
    left
        Errors that the flight does not excite, by name.
    unknowns
        Shares :math:`D` as pairs of a sensor and the one that is added to it, and coordinates of the place as
        ``("accelerometer", "x")`` ..., in the order of the covariance.
    covariance
        Of these, shape ``(n, n)``; rates and accelerometers err apart.
    """

    def __post_init__(self) -> None:
        self._set(unknowns=tuple(self.unknowns), covariance=read_only(self.covariance, np.float64, ndim=2))

    matrix: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    constant: Mapping[str, float] = field(default_factory=dict)
    place_m: Mapping[str, float] = field(default_factory=dict)
    terms: tuple[SensorTerm, ...] = ()
    left: tuple[str, ...] = ()
    unknowns: tuple[tuple[str, str], ...] = ()
    covariance: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))


def estimate_correction(
    histories: Sequence[TimeHistory], forces: Sequence[TimeHistory] | None = None
) -> SensorCorrection:
    """Errors of the sensors of several maneuvers together.

    Rates are compared with the attitude, then specific force with velocities, attitude and the corrected rates.

    Parameters
    ----------
    histories
        Rates and angles.
    forces
        Specific force, body or earth velocities, rates and angles, where these are at a slower rate; by default all
        stand in ``histories``.

    Raises
    ------
    InsufficientDataError
        Nothing can be compared.
    """
    rates = _triad(histories, RATES)
    others = histories if forces is None else forces
    moved = _triad([_rates_corrected(history, rates) for history in others], ACCELERATIONS)
    if not (rates.terms or rates.left or moved.terms or moved.left):
        raise InsufficientDataError(
            "sensors cannot be corrected without a rate and its angle, or a specific force with velocity and attitude",
            needed="attitude for the rates, velocities for the accelerometer",
            remedy="log attitude and velocity, or leave --correct-sensors out",
        )
    return SensorCorrection(
        matrix={**rates.matrix, **moved.matrix},
        constant={**rates.constant, **moved.constant},
        place_m=moved.place_m,
        terms=(*rates.terms, *moved.terms),
        left=(*rates.left, *moved.left),
        unknowns=(*rates.unknowns, *moved.unknowns),
        covariance=_blocks(rates.covariance, moved.covariance),
    )


def _blocks(first: FloatArray, second: FloatArray) -> FloatArray:
    """Both on the diagonal of one matrix."""
    whole = np.zeros((len(first) + len(second),) * 2)
    whole[: len(first), : len(first)] = first
    whole[len(first) :, len(first) :] = second
    return whole


def corrected_values(correction: SensorCorrection, channel: str, measured: Mapping[str, FloatArray]) -> FloatArray:
    """A sensor as it would have been without its errors.

    Parameters
    ----------
    correction
        What to add.
    measured
        All sensors at the same stamps, shape ``(n,)``; for an accelerometer corrected rates and their derivatives
        ``p_dot q_dot r_dot`` too. What is absent counts as zero.
    """
    values = measured[channel] + correction.constant.get(channel, 0.0)
    for name, share in correction.matrix.get(channel, {}).items():
        if name in measured:
            values = values + share * measured[name]
    if channel in ACCELERATIONS and correction.place_m:
        columns = _displacement(measured, values.shape)[ACCELERATIONS.index(channel)]
        for place, meters in correction.place_m.items():
            values = values - meters * columns[PLACES.index(place)]
    return np.asarray(values)


def correction_findings(correction: SensorCorrection) -> tuple[Finding, ...]:
    """What was corrected, each with its interval, and what was not."""
    findings = [
        remark(
            "sensor_corrected",
            term.name,
            f"{_capital(_words(term))}; it was taken out.",
            value=term.value,
            std=term.std,
            lower=term.value - TWO_SIDED_95 * term.std,
            upper=term.value + TWO_SIDED_95 * term.std,
        )
        for term in correction.terms
    ]
    if correction.left:
        names = ", ".join(correction.left)
        findings.append(
            remark("sensor_not_corrected", names, f"The flight does not show these sensor errors: {names}.")
        )
    return tuple(findings)


def _words(term: SensorTerm) -> str:
    if term.kind == "scale":
        return f"{term.channel} shows {_signed(100.0 * term.value, 100.0 * term.std)} % too much"
    if term.kind == "misalignment":
        return (
            f"{term.toward} leaks into {term.channel} by {_signed(math.degrees(term.value), math.degrees(term.std))}° "
            "of misalignment"
        )
    if term.kind == "bias":
        return f"{term.channel} has a bias of {_signed(term.value, term.std)} {term.unit}"
    where = f"{_signed(1e3 * term.value, 1e3 * term.std)} mm from the center of gravity along {term.toward}"
    return f"the accelerometer lies {where}"


def _signed(value: float, std: float) -> str:
    return f"{'+' if value > 0.0 else ''}{with_error(value, std)}"


def _capital(words: str) -> str:
    return words if words.split()[0] in (*RATES, *ACCELERATIONS) else words[0].upper() + words[1:]


def _rates_corrected(history: TimeHistory, correction: SensorCorrection) -> TimeHistory:
    measured = {name: history[name] for name in RATES if name in history.names}
    values = history.values.copy()
    for name in measured:
        values[history.names.index(name)] = corrected_values(correction, name, measured)
    return replace(history, values=values)


@dataclass(frozen=True, kw_only=True)
class _Lines:
    """A regression of one history: difference of each sensor, its columns, and the means, by sensor."""

    target: dict[str, np.ndarray]
    columns: dict[str, dict[str, np.ndarray]]
    difference: dict[str, FloatArray]
    parts: dict[str, dict[str, FloatArray]]
    omega_rad_s: FloatArray


def _triad(histories: Sequence[TimeHistory], sensors: tuple[str, ...]) -> SensorCorrection:
    """Errors of three sensors of one kind."""
    lines = [item for history in histories if (item := _lines(history, sensors)) is not None]
    if not lines:
        return SensorCorrection()
    channels = [name for name in sensors if any(name in line.target for line in lines)]
    unknowns = _unknowns(lines, channels)
    chosen = list(unknowns)
    while True:
        values, covariance = _regression(lines, channels, chosen)
        std = np.sqrt(np.diag(covariance))
        if np.isfinite(std).all():
            std = std * _disagreement(lines, channels, chosen, values)
        worth = np.array([std[row] / LARGEST_STD.get(_kind(name), np.inf) for row, name in enumerate(chosen)])
        if not worth.size or worth.max() <= 1.0:
            break
        chosen.pop(int(np.argmax(worth)))
    found = dict(zip(chosen, values, strict=True))
    known = dict(zip(chosen, std, strict=True))
    matrix: dict[str, dict[str, float]] = {}
    for channel, term in found:
        if term in sensors:
            matrix.setdefault(channel, {})[term] = float(found[channel, term])
    place = {term: float(value) for (_, term), value in found.items() if term in PLACES}
    constant, spread = {}, {}
    for channel in channels:
        constant[channel], spread[channel] = _constant(lines, channel, found, covariance, chosen)
    terms = _terms(matrix, constant, spread, place, known)
    left = [_named(unknown) for unknown in unknowns if unknown not in chosen]
    kept = [row for row, (_, term) in enumerate(chosen) if term not in _OF_FILTERS]
    wider = std / np.sqrt(np.diag(covariance).clip(min=_TINY))
    spread_of_all = (covariance * np.outer(wider, wider))[np.ix_(kept, kept)]
    return SensorCorrection(
        matrix=matrix,
        constant=constant,
        place_m=place,
        terms=terms,
        left=tuple(left),
        unknowns=tuple(chosen[row] for row in kept),
        covariance=spread_of_all,
    )


def _kind(unknown: tuple[str, str]) -> str:
    channel, term = unknown
    if term in PLACES:
        return "place"
    if term in _OF_FILTERS:
        return term
    return "scale" if channel == term else "misalignment"


def _terms(
    matrix: Mapping[str, Mapping[str, float]],
    constant: Mapping[str, float],
    spread: Mapping[str, float],
    place: Mapping[str, float],
    std: Mapping[tuple[str, str], float],
) -> tuple[SensorTerm, ...]:
    r"""The correction as errors of sensors: :math:`m = (1 + D)^{-1} (t + K r - c)`, of scale row by row."""
    channels = list(constant)
    unit = "rad/s" if set(channels) <= set(RATES) else "m/s^2"
    share = np.array([[matrix.get(row, {}).get(column, 0.0) for column in channels] for row in channels])
    shown = np.linalg.inv(np.eye(len(channels)) + share)
    bias = -shown @ np.array([constant[name] for name in channels])
    terms = []
    for row, channel in enumerate(channels):
        size = float(np.linalg.norm(shown[row]))
        if (channel, channel) in std:
            terms.append(
                SensorTerm(channel=channel, kind="scale", value=size - 1.0, std=std[channel, channel], unit="1")
            )
        for column, other in enumerate(channels):
            if other != channel and (channel, other) in std:
                value = float(shown[row, column]) / size
                terms.append(
                    SensorTerm(
                        channel=channel,
                        kind="misalignment",
                        toward=other,
                        value=value,
                        std=std[channel, other],
                        unit="rad",
                    )
                )
        terms.append(SensorTerm(channel=channel, kind="bias", value=float(bias[row]), std=spread[channel], unit=unit))
    terms += [
        SensorTerm(
            channel="accelerometer", kind="place", toward=name, value=value, std=std["accelerometer", name], unit="m"
        )
        for name, value in place.items()
    ]
    return tuple(terms)


def _named(unknown: tuple[str, str]) -> str:
    """Name of an unknown as that of its error."""
    channel, term = unknown
    kind = _kind(unknown)
    toward = "" if kind == "scale" else term
    return SensorTerm(channel=channel, kind=kind, toward=toward, value=0.0, std=0.0, unit="1").name


def _unknowns(lines: Sequence[_Lines], channels: Sequence[str]) -> list[tuple[str, str]]:
    names: dict[tuple[str, str], None] = {}
    for channel in channels:
        for line in lines:
            for term in line.columns.get(channel, {}):
                names["accelerometer" if term in PLACES else channel, term] = None
    return list(names)


def _lines(history: TimeHistory, sensors: tuple[str, ...]) -> _Lines | None:
    expected = expected_motion(history, sensors)
    if not expected:
        return None
    rate_hz, count = history.sample_rate_hz, history.values.shape[1]
    omega = 2.0 * np.pi * np.fft.rfftfreq(count, 1.0 / rate_hz)
    low = max(BAND_RAD_S[0], 4.0 * np.pi / history.duration_s)
    high = min(BAND_RAD_S[1], _FASTEST_RAD * rate_hz)
    inside = (omega >= low) & (omega <= high)
    if inside.sum() < _NEIGHBORS or high < _LOWEST_TOP_RAD_S:
        return None
    taper = np.hanning(count)
    scale = math.sqrt(2.0 / (rate_hz * np.sum(taper**2)))

    def spectrum(values: FloatArray) -> np.ndarray:
        return np.asarray(np.fft.rfft(taper * (values - values.mean()))[inside] * scale)

    there = {name: history[name] for name in sensors if name in history.names}
    measured = {name: history[name] for name in RATES if name in history.names}
    slopes = {f"{name}_dot": derivative(values, rate_hz) for name, values in measured.items()}
    place = _displacement({**measured, **slopes}, (count,)) if sensors is ACCELERATIONS and measured else None
    difference, parts = {}, {}
    for row, name in enumerate(sensors):
        if name not in expected:
            continue
        difference[name] = expected[name] - history[name]
        slope = derivative(history[name], rate_hz)
        own = dict(there) | {"lag": slope, "curvature": derivative(slope, rate_hz)}
        if place is not None:
            own |= {axis: -place[row, column] for column, axis in enumerate(PLACES) if place[row, column].any()}
        parts[name] = own
    return _Lines(
        target={name: spectrum(values) for name, values in difference.items()},
        columns={name: {term: spectrum(values) for term, values in own.items()} for name, own in parts.items()},
        difference=difference,
        parts=parts,
        omega_rad_s=np.asarray(omega[inside], dtype=np.float64),
    )


def _displacement(measured: Mapping[str, FloatArray], shape: tuple[int, ...]) -> FloatArray:
    r""":math:`[\dot\omega]_\times + [\omega]_\times^2`, shape ``(3, 3, n)``; rates that are absent are zero."""
    none = np.zeros(shape)
    p, q, r = (measured.get(name, none) for name in RATES)
    dp, dq, dr = (measured.get(f"{name}_dot", none) for name in RATES)
    return np.stack(
        [
            np.stack([-(q * q + r * r), p * q - dr, p * r + dq]),
            np.stack([p * q + dr, -(p * p + r * r), q * r - dp]),
            np.stack([p * r - dq, q * r + dp, -(p * p + q * q)]),
        ]
    )


def _regression(
    lines: Sequence[_Lines], channels: Sequence[str], unknowns: Sequence[tuple[str, str]]
) -> tuple[FloatArray, FloatArray]:
    """Values of the unknowns and their covariance, weighed by the noise that is left at each frequency."""
    rows = [(line, name) for line in lines for name in channels if name in line.target]
    designs = [_design(lines, name, unknowns) for lines, name in rows]
    noise = [np.full(lines.omega_rad_s.size, np.mean(np.abs(lines.target[name]) ** 2) + _TINY) for lines, name in rows]
    values: FloatArray = np.zeros(len(unknowns))
    covariance: FloatArray = np.zeros((len(unknowns), len(unknowns)))
    for _ in range(4):
        normal, right = np.zeros_like(covariance), np.zeros_like(values)
        for (item, name), design, level in zip(rows, designs, noise, strict=True):
            normal += 2.0 * ((design.conj() / level) @ design.T).real
            right += 2.0 * ((design.conj() / level) @ item.target[name]).real
        covariance = np.asarray(np.linalg.pinv(normal, hermitian=True), dtype=np.float64)
        values = covariance @ right
        # A direction without any excitation has an infinite variance, which the pseudoinverse would call zero.
        silent = np.diag(normal) <= 0.0
        covariance[silent, silent] = np.inf
        noise = [
            _level(np.abs(lines.target[name] - values @ design) ** 2, len(unknowns), len(rows))
            for (lines, name), design in zip(rows, designs, strict=True)
        ]
    return values, covariance * _HANN_CORRELATION


def _disagreement(
    lines: Sequence[_Lines], channels: Sequence[str], unknowns: Sequence[tuple[str, str]], values: FloatArray
) -> FloatArray:
    """Factor on the standard deviations of the unknowns, as far as parts of the band contradict each other.

    Estimated angles and velocities are smoothed, and leave more than noise.
    """
    squares, count = np.zeros(len(unknowns)), np.zeros(len(unknowns))
    # Filters are identified over the whole band; in a part of it they look like a scale.
    plain = [row for row, name in enumerate(unknowns) if name[1] not in _OF_FILTERS]
    chosen = [unknowns[row] for row in plain]
    of_filters = {name: value for name, value in zip(unknowns, values, strict=True) if name[1] in _OF_FILTERS}
    for part in range(_PARTS):
        own = [_part(line, part, of_filters) for line in lines]
        found, covariance = _regression(own, channels, chosen)
        variance = np.diag(covariance)
        usable = np.isfinite(variance) & (variance > 0.0)
        distance = (found - values[plain]) ** 2 / np.where(usable, variance, np.inf)
        squares[plain] += distance
        count[plain] += usable
    spread = squares / np.maximum(count - 1.0, 1.0)
    return np.sqrt(np.maximum(spread, 1.0))


def _part(lines: _Lines, part: int, of_filters: Mapping[tuple[str, str], float]) -> _Lines:
    """A part of the band with an equal share of its lines by logarithm, what filters do taken out of it."""
    edges = np.geomspace(lines.omega_rad_s[0], lines.omega_rad_s[-1] * (1.0 + 1e-9), _PARTS + 1)
    inside = (lines.omega_rad_s >= edges[part]) & (lines.omega_rad_s < edges[part + 1])
    target = {}
    for name, values in lines.target.items():
        filtered = sum(
            (value * lines.columns[name][term] for (channel, term), value in of_filters.items() if channel == name),
            np.zeros_like(values),
        )
        target[name] = (values - filtered)[inside]
    return replace(
        lines,
        target=target,
        columns={name: {term: row[inside] for term, row in own.items()} for name, own in lines.columns.items()},
        omega_rad_s=lines.omega_rad_s[inside],
    )


def _level(power: FloatArray, unknowns: int, rows: int) -> FloatArray:
    """Power of what is left over frequency, the mean over neighbors, with what the fit took out of it."""
    if not power.size:
        return power
    window = np.ones(min(2 * _NEIGHBORS + 1, power.size))
    mean = np.convolve(power, window, mode="same") / np.convolve(np.ones(power.size), window, mode="same")
    spent = max(1.0 - 0.5 * unknowns / max(rows, 1) / power.size, 0.5)
    return np.asarray(np.maximum(mean / spent, _TINY))


def _design(lines: _Lines, name: str, unknowns: Sequence[tuple[str, str]]) -> np.ndarray:
    none = np.zeros(lines.omega_rad_s.size, dtype=np.complex128)
    own = lines.columns[name]
    return (
        np.stack([own.get(term, none) if channel in (name, "accelerometer") else none for channel, term in unknowns])
        if unknowns
        else np.zeros((0, none.size), dtype=np.complex128)
    )


def _constant(
    lines: Sequence[_Lines],
    channel: str,
    found: Mapping[tuple[str, str], float],
    covariance: FloatArray,
    unknowns: Sequence[tuple[str, str]],
) -> tuple[float, float]:
    """What to add to a sensor, from the means of what is left, and its standard deviation."""
    left, slopes, spreads = [], [], []
    for line in lines:
        if channel not in line.difference:
            continue
        rest = line.difference[channel].copy()
        slope = np.zeros(len(unknowns))
        for place, (owner, term) in enumerate(unknowns):
            if owner in (channel, "accelerometer") and term in line.parts[channel]:
                rest -= found[owner, term] * line.parts[channel][term]
                slope[place] = float(np.mean(line.parts[channel][term]))
        blocks = [block.mean() for block in np.array_split(rest, _BLOCKS)]
        left.append(float(rest.mean()))
        slopes.append(slope)
        spreads.append(float(np.var(blocks, ddof=1)) / _BLOCKS + _TINY)
    weights = 1.0 / np.array(spreads)
    mean = float(np.average(left, weights=weights))
    slope = np.average(slopes, axis=0, weights=weights)
    scatter = float(np.average((np.array(left) - mean) ** 2, weights=weights)) / max(len(left) - 1, 1)
    variance = max(1.0 / float(weights.sum()), scatter if len(left) > 1 else 0.0)
    return mean, math.sqrt(variance + float(slope @ covariance @ slope))
