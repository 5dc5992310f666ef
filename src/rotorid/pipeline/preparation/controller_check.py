r"""Whether the gains of a log made its commands.

What the gains make of set-point :math:`r` and rate :math:`y`, :math:`C_r r - C_{log} y`, is compared with the logged
command; where a blackbox holds the terms of the controller, each of them with its own path.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from rotorid.data.axes import RATE_OF
from rotorid.data.base import Immutable
from rotorid.data.record import FlightRecord, Intervals, TimeHistory
from rotorid.errors import InsufficientDataError
from rotorid.models.autopilots.betaflight import NAME as BETAFLIGHT
from rotorid.models.autopilots.betaflight import TOP
from rotorid.models.autopilots.settings import AxisController
from rotorid.models.controller import RateController
from rotorid.pipeline.preparation.controllers import acting_on
from rotorid.typing import Axis, BoolArray, ComplexArray, FloatArray

_SAME_TERM, _SAME_COMMAND = 0.1, 0.2
"""How far from one the logged P term, or the command, may lie over what the gains make of set-point and rate, for gains
that flew."""

_ALIKE = 0.9
"""Least correlation of the logged signal with what the gains make."""

_EXPLAINED_RAD_S = (3.0, 60.0)
"""Where that is looked at."""

_OF_NYQUIST = 0.3
"""Share of the Nyquist frequency of the log up to which it is."""

_FEWEST_SAMPLES = 1000
"""Of logged terms, which are not looked at in shorter stretches."""

_WINDOW_S = 4.0
"""Length of the windows of all spectra here."""

_MOVE = "Move the stick of this axis for 30 s: quick pairs to both sides of 5 to 10 degrees, one every second."


class Regression(NamedTuple):
    """A regression of a logged signal on what the gains make of the others."""

    slope: float
    correlation: float


@dataclass(frozen=True, kw_only=True)
class ControllerMatch(Immutable):
    """How the gains of a log explain its command: the whole, and each term by its letter where terms are logged."""

    whole: Regression
    terms: Mapping[str, Regression] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._set(terms=self.terms)

    @property
    def correlation(self) -> float:
        """Of the command with what the gains make."""
        return self.whole.correlation

    @property
    def made(self) -> bool:
        """Whether the gains are those that flew."""
        if "p" in self.terms:
            # The mix is what the motors had room for: only the terms are as the gains make them.
            own = self.terms["p"]
            return abs(own.slope - 1.0) <= _SAME_TERM and own.correlation >= _ALIKE and self.whole.slope > 0.0
        return abs(self.whole.slope - 1.0) <= _SAME_COMMAND and self.whole.correlation >= _ALIKE

    def refusal(self, axis: Axis) -> tuple[str, str]:
        """Why the gains do not count as those that flew, and what would help."""
        name, own = ("its P term", self.terms["p"]) if "p" in self.terms else ("it", self.whole)
        if "p" in self.terms and self.whole.slope <= 0.0:
            return (
                f"The {axis} command that the motors make does not follow the sum of the controller's terms.",
                "Margins need a quadrotor with the usual order of its motors.",
            )
        if own.correlation < _ALIKE:
            return (
                f"Set-point, rate and the gains in the log explain the logged {axis} command with a correlation of "
                f"{own.correlation:.2f} only, where {_ALIKE:g} is needed to take them for those that flew.",
                f"{_MOVE} Log faster. Gains that changed in flight, or a controller with other parts, have no margins "
                "here.",
            )
        return (
            f"The gains in the log do not make the logged {axis} command: {name} is {own.slope:.2f} times what "
            "set-point, rate and gains make.",
            "Give the log in which they flew. Gains that changed in flight, or a controller with other parts, have no "
            "margins here.",
        )


def match_controller(
    record: FlightRecord,
    axis: Axis,
    settings: AxisController,
    histories: Sequence[TimeHistory],
    *,
    intervals: Intervals,
) -> ControllerMatch | None:
    """What the gains make of set-point and rate, against the command; ``None`` where no set-point is logged.

    Parameters
    ----------
    record
        The log.
    axis
        ``roll``, ``pitch`` or ``yaw``.
    settings
        The controller by the parameters of the log.
    histories
        Command, rate and set-point on one clock.
    intervals
        Parts of the flights in which logged terms are looked at.
    """
    rate, command = RATE_OF[axis], f"{axis}_command"
    setpoint = f"{rate}_setpoint"
    if setpoint not in histories[0].names:
        return None
    own = settings.ends.get(TOP, settings.controller).rate_loop
    if settings.autopilot == BETAFLIGHT:
        logged = _as_logged(
            record, (rate, setpoint, command, *(f"{axis}_{letter}_term" for letter in "pid")), intervals
        )
        if logged:
            return _by_terms(logged, axis, own)
    omega, inside = _band(histories)
    if not omega.size:
        return None
    r, y, u = (window_spectra(histories, name)[:, inside] for name in (setpoint, rate, command))
    if f"{axis}_excitation" in histories[0].names:
        u = u - window_spectra(histories, f"{axis}_excitation")[:, inside]
    made = (
        own.setpoint_response(omega) * r - acting_on(record, own, source=_source(histories, rate)).response(omega) * y
    )
    # What is fed forward from the stick goes with the slope of the set-point.
    ahead = [1j * omega * r] if settings.autopilot == BETAFLIGHT else []
    return ControllerMatch(whole=_regressed(u, [made, *ahead], r))


def _by_terms(logged: Sequence[TimeHistory], axis: Axis, own: RateController) -> ControllerMatch | None:
    """Each logged term on its own path, and their sum on the command."""
    omega, inside = _band(logged)
    if not omega.size:
        return None
    rate = RATE_OF[axis]
    r, y, u = (window_spectra(logged, name)[:, inside] for name in (f"{rate}_setpoint", rate, f"{axis}_command"))
    terms = {
        letter: window_spectra(logged, f"{axis}_{letter}_term")[:, inside]
        for letter in "pidf"
        if f"{axis}_{letter}_term" in logged[0].names
    }
    of_error = {
        "p": replace(own, integral=0.0, derivative_s2=0.0) if own.proportional_s else None,
        "i": replace(own, proportional_s=0.0, derivative_s2=0.0) if own.integral else None,
    }
    paths = {letter: part.response(omega) * (r - y) for letter, part in of_error.items() if part is not None}
    if own.derivative_s2 > 0.0:
        paths["d"] = -own.derivative_response(omega) * y
    found = {letter: _regressed(terms[letter], [path], r) for letter, path in paths.items() if letter in terms}
    whole = _regressed(u, [sum(terms.values(), start=np.zeros_like(u))], r)
    return ControllerMatch(whole=whole, terms=found)


def _as_logged(record: FlightRecord, needed: Sequence[str], intervals: Intervals) -> list[TimeHistory]:
    """Channels as one topic holds them, a history for each part of the flights; none where it lacks one of the first.

    A blackbox writes all of its fields at the same steps of the loop, so that nothing has to be brought on one clock.
    """
    found = []
    for start_s, stop_s in intervals:
        for topic in record.topics:
            inside = (topic.time_s >= start_s) & (topic.time_s <= stop_s)
            names = [channel.name for channel in topic.channels]
            # Yaw flies without D, which is then not logged.
            if set(needed[:4]) <= set(names) and np.count_nonzero(inside) > _FEWEST_SAMPLES:
                rows = [row for row, name in enumerate(names) if name in needed or name.endswith("_f_term")]
                found.append(
                    TimeHistory(
                        values=topic.values[rows][:, inside],
                        channels=tuple(topic.channels[row] for row in rows),
                        sample_rate_hz=topic.sample_rate_hz,
                        start_s=start_s,
                    )
                )
                break
    return found


def _band(histories: Sequence[TimeHistory]) -> tuple[FloatArray, BoolArray]:
    """Frequencies at which a controller is checked, and which lines they are."""
    omega = window_frequencies(histories)
    top = min(_EXPLAINED_RAD_S[1], _OF_NYQUIST * math.pi * histories[0].sample_rate_hz)
    inside = (omega >= _EXPLAINED_RAD_S[0]) & (omega <= top)
    return omega[inside], inside


def _regressed(signal: ComplexArray, paths: Sequence[ComplexArray], by: ComplexArray) -> Regression:
    r"""Real slope of the first path, with the others beside it, and the correlation of what all make.

    All are taken as far as they go with the set-point, :math:`\overline{R^* X} / \sqrt{\overline{|R|^2}}` over the
    windows: noise that a slow log folds down is in the command and not in what is made of its rate.
    """
    size = np.sqrt(np.mean(np.abs(by) ** 2, axis=0))
    size[size == 0.0] = 1.0

    def along(values: ComplexArray) -> FloatArray:
        shared = np.mean(by.conj() * values, axis=0) / size
        return np.concatenate([shared.real, shared.imag])

    columns, target = np.stack([along(path) for path in paths], axis=1), along(signal)
    slopes = np.linalg.lstsq(columns, target, rcond=None)[0]
    made = columns @ slopes
    both = float(np.linalg.norm(made) * np.linalg.norm(target))
    return Regression(float(slopes[0]), float(made @ target) / both if both > 0.0 else 0.0)


def window_frequencies(histories: Sequence[TimeHistory]) -> FloatArray:
    """Frequencies in rad/s of :func:`window_spectra`."""
    rate_hz = histories[0].sample_rate_hz
    return np.asarray(2.0 * math.pi * np.fft.rfftfreq(_samples(histories), 1.0 / rate_hz))


def _samples(histories: Sequence[TimeHistory]) -> int:
    longest = max(int(history.values.shape[1]) for history in histories)
    return min(int(_WINDOW_S * histories[0].sample_rate_hz), longest)


def window_spectra(histories: Sequence[TimeHistory], name: str) -> ComplexArray:
    """Spectra of a channel in windows of four seconds that overlap by half, shape ``(windows, lines)``."""
    count = _samples(histories)
    taper = np.hanning(count)
    found = []
    for history in histories:
        values = history[name]
        sound = np.asarray(np.isfinite(history.values).all(axis=0))
        for start in range(0, values.size - count + 1, max(count // 2, 1)):
            part = slice(start, start + count)
            if sound[part].all():
                found.append(np.fft.rfft(taper * (values[part] - values[part].mean())))
    if not found:
        raise InsufficientDataError(
            f"no {count / histories[0].sample_rate_hz:.3g} s of {name} without missing samples came",
            needed="longer stretches of a flight",
            remedy="fly longer, or log without gaps",
        )
    return np.array(found, dtype=np.complex128)


def _source(histories: Sequence[TimeHistory], channel: str) -> str:
    """Where a channel stands in the log, as the longest stretch has it."""
    longest = max(histories, key=lambda history: history.duration_s)
    return next((found.source for found in longest.channels if found.name == channel), "")
