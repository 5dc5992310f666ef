"""The loop around an axis as the same flight shows it: the broken loop with its margins, sensitivity, attitude."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import NamedTuple

import numpy as np

from rotorid.data.findings import Finding, remark, warn
from rotorid.data.record import FlightRecord, TimeHistory
from rotorid.data.response import FrequencyResponse
from rotorid.errors import InsufficientDataError
from rotorid.fitting.delay.estimate import AIRFRAME_ORDERS, FASTEST_GROWTH_RAD_S, LONGEST_S
from rotorid.fitting.delay.fit import LateLag, Limits, ResponseFit, ResponsePoints, fit_order, simplest
from rotorid.pipeline.preparation.controllers import LoggedController, logged_controllers
from rotorid.pipeline.preparation.flights import Flight
from rotorid.pipeline.preparation.measure import Measured
from rotorid.pipeline.preparation.segments import histories
from rotorid.spectral.derived import Estimated, LogCurve, log_curve, selected, with_model_error
from rotorid.spectral.estimate import frequency_response
from rotorid.spectral.loops import injected_loop, sensitivity, series
from rotorid.spectral.margins import (
    AttitudeBandwidth,
    Bound,
    DisturbanceRejection,
    LoopMargins,
    attitude_bandwidth,
    disturbance_rejection,
    loop_margins,
)
from rotorid.typing import Axis, ComplexArray, FloatArray

ATTITUDE: Mapping[Axis, str] = {"roll": "phi", "pitch": "theta", "yaw": "psi"}
MODEL_ERROR = 0.007
"""Share of a measured loop that it errs by whatever the length of the flight, alike over an octave."""

_LARGEST_ERROR, _LEAST_COHERENCE = 0.3, 0.3
_RATE: Mapping[Axis, str] = {"roll": "p", "pitch": "q", "yaw": "r"}


@dataclass(frozen=True, kw_only=True, eq=False)
class Beyond:
    """What a model of the vehicle times the controller in the log says beyond the band; nothing of it was measured.

    Parameters
    ----------
    method
        How it was found, in words.
    up_to_rad_s
        How far it goes.
    numbers
        Margins that the band does not show, by the names of :attr:`AxisLoop.numbers`.
    """

    method: str
    up_to_rad_s: float
    numbers: Mapping[str, Estimated] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisLoop:
    """What a flight shows of the loop around one axis.

    Parameters
    ----------
    method
        How the broken loop was found, in words.
    loop
        The broken-loop response, or ``None``.
    margins, rejection
        What follows from it.
    attitude
        Bandwidth of the attitude's answer to its command.
    beyond
        What lies beyond the band by model and controller, where a margin does and both are known.
    """

    method: str
    loop: FrequencyResponse | None
    margins: LoopMargins | None
    rejection: DisturbanceRejection | None
    attitude: AttitudeBandwidth | None
    beyond: Beyond | None = None

    @property
    def band_rad_s(self) -> tuple[float, float] | None:
        """Lowest and highest frequency of the broken loop; ``None`` where it was not seen."""
        return None if self.loop is None else (float(self.loop.omega_rad_s[0]), float(self.loop.omega_rad_s[-1]))

    @property
    def numbers(self) -> dict[str, Estimated]:
        """What was seen, by names that hold their units: margins, rejection of disturbances, bandwidths."""
        found = {
            _public_name(part, item.name): value
            for part in self._parts
            for item in fields(part)
            if isinstance(value := getattr(part, item.name), Estimated)
        }
        if self.margins is not None and self.margins.gain_crossovers:
            found["crossover_rad_s"] = self.margins.gain_crossovers[-1].omega_rad_s
        return found

    @property
    def not_seen(self) -> dict[str, str]:
        """Names of what was not seen, to the reason."""
        return {_public_name(part, name): reason for part in self._parts for name, reason in part.not_seen.items()}

    @property
    def bounds(self) -> dict[str, Bound]:
        """Names of some of what was not seen, to what the end of the band says about it."""
        parts = [part for part in (self.margins, self.rejection) if part is not None]
        return {_public_name(part, name): bound for part in parts for name, bound in part.bounds.items()}

    @property
    def _parts(self) -> tuple[LoopMargins | DisturbanceRejection | AttitudeBandwidth, ...]:
        return tuple(part for part in (self.margins, self.rejection, self.attitude) if part is not None)


def _public_name(part: LoopMargins | DisturbanceRejection | AttitudeBandwidth, name: str) -> str:
    """Names of different parts next to each other."""
    if isinstance(part, DisturbanceRejection):
        return f"disturbance_rejection_{name}"
    return f"attitude_{name}" if isinstance(part, AttitudeBandwidth) else name


def axis_loop(axis: Axis, measured: Measured, flown: Sequence[Flight]) -> AxisLoop | None:
    """The loop around an axis, from whatever the flight offers; ``None`` where it offers nothing.

    An injection at the mixer gives the broken loop directly. Otherwise the measured rate response times the gains in
    the log, of the rate loop alone. The attitude's answer is that to its instrument, the stick or the set-point.

    Parameters
    ----------
    axis
        The axis.
    measured
        Responses of a command of this axis, and the data behind them.
    flown
        Records and maneuvers behind them.
    """
    records = histories(measured.segments)
    loop, method = _injected(axis, measured, flown, records) or _computed(axis, measured, flown) or (None, "")
    loop = loop and with_model_error(loop, MODEL_ERROR)
    attitude = _attitude(axis, measured, records)
    if loop is None and attitude is None:
        return None
    found = AxisLoop(
        method=method or "no injection at the mixer and no gains in the log: no broken loop",
        loop=loop,
        margins=loop_margins(loop) if loop else None,
        rejection=disturbance_rejection(sensitivity(loop)) if loop else None,
        attitude=attitude,
    )
    return replace(found, beyond=_beyond(axis, found, measured, flown)) if found.bounds else found


def _injected(
    axis: Axis, measured: Measured, flown: Sequence[Flight], records: Sequence[TimeHistory]
) -> tuple[FrequencyResponse, str] | None:
    excitation, response = f"{axis}_excitation", measured.response
    if excitation not in response.instruments:
        return None
    # What the system identification mode of ArduPilot logs enters the mixer one loop later.
    rates_hz = {_loop_rate_hz(record) for record, _ in flown}
    delay_s = 1.0 / rates_hz.pop() if len(rates_hz) == 1 and all(rates_hz) else 0.0
    loop = injected_loop(
        records,
        command=f"{axis}_command",
        excitation=excitation,
        omega_rad_s=response.omega_rad_s,
        windows_s=response.windows_s,
        injection_delay_s=delay_s,
    )
    return loop, f"measured with {excitation}, all loops closed"


def _loop_rate_hz(record: FlightRecord) -> float:
    return record.parameters.get("SCHED_LOOP_RATE", 0.0) if "SID_AXIS" in record.parameters else 0.0


def _computed(axis: Axis, measured: Measured, flown: Sequence[Flight]) -> tuple[FrequencyResponse, str] | None:
    response, rate = measured.response, _RATE.get(axis, "")
    if rate not in response.outputs or response.estimate != "joint" or len(response.inputs) > 1:
        return None
    parameters = flown[0][0].parameters
    controllers = logged_controllers(flown, measured, f"{axis}_command", rate)
    if len(controllers) != 1 or any(record.parameters != parameters for record, _ in flown):
        return None
    plant = selected(response, outputs=[rate], inputs=[f"{axis}_command"])
    gains = controllers[0].rate_loop.response(response.omega_rad_s)
    return series(plant, gains), "measured vehicle times the gains in the log, rate loop alone"


def _attitude(axis: Axis, measured: Measured, records: Sequence[TimeHistory]) -> AttitudeBandwidth | None:
    response, angle = measured.response, ATTITUDE.get(axis, "")
    commands = [name for name in response.instruments if name in (f"{axis}_stick", f"{angle}_setpoint")]
    if not commands or not all(angle in record.names for record in records):
        return None
    try:
        answer = frequency_response(
            records,
            inputs=commands[:1],
            outputs=[angle],
            omega_rad_s=response.omega_rad_s,
            windows_s=response.windows_s,
        )
    except InsufficientDataError:
        # A command that rests, or an attitude that does: the flight has no answer to show.
        return None
    return attitude_bandwidth(with_model_error(answer, MODEL_ERROR))


_BEYOND_RATIO = 6.0
"""How far over the end of the band the model is taken."""

_BEYOND_POINTS = 40
_TOP_OCTAVES = 1.0
_SAME_LOOP = 0.2
"""Rms of the logarithm of measured over computed loop below which the controller is the one that flew."""

_WRONG_PER_E_FOLD = 0.15
"""What a rate model is off by outside of its band, for each factor of e in frequency."""

_FEWEST_POINTS = 8
_WORDS = {
    "disturbance_rejection_peak": ("sensitivity peak", 0.0, "dB"),
    "phase_margin_rad": ("phase margin", 180.0 / np.pi, "°"),
    "gain_margin_up": ("gain margin", 0.0, "dB"),
}


def _beyond(axis: Axis, found: AxisLoop, measured: Measured, flown: Sequence[Flight]) -> Beyond | None:
    """Margins beyond the band, of a late lag fitted to the measured vehicle, and the controller in the log."""
    response, rate, command = measured.response, _RATE.get(axis, ""), f"{axis}_command"
    if found.loop is None or rate not in response.outputs or command not in response.inputs:
        return None
    controllers = logged_controllers(flown, measured, command, rate)
    vehicle = _late_lag(
        selected(response, outputs=[rate], inputs=[command]), measured.segments[0].history.sample_rate_hz
    )
    curve = log_curve(found.loop)
    if len(controllers) != 1 or vehicle is None or not curve.bands:
        return None
    end = curve.bands[-1][1]
    controller = _flown(controllers[0], vehicle, found.loop, end)
    if controller is None:
        return None
    top = np.exp(end) * _BEYOND_RATIO
    if controller.controller.step_s > 0.0:
        top = min(top, 0.5 * np.pi / controller.controller.step_s)
    omega = np.geomspace(np.exp(end), top, _BEYOND_POINTS + 1)[1:]
    if omega[0] >= omega[-1]:
        return None
    extended = _extended(
        found.loop, curve, omega, vehicle.loop(controller, omega) / vehicle.loop(controller, omega[:1])
    )
    whole = AxisLoop(
        method="",
        loop=extended,
        margins=loop_margins(extended),
        rejection=disturbance_rejection(sensitivity(extended)),
        attitude=None,
    )
    wanted = {*found.bounds, *found.not_seen} - set(found.numbers)
    return Beyond(
        method=f"a lag of {vehicle.model.order.words} fitted to the measured vehicle, times the controller in the log",
        up_to_rad_s=float(omega[-1]),
        numbers={name: number for name, number in whole.numbers.items() if name in wanted},
    )


class _Vehicle(NamedTuple):
    """A late lag with its coefficients."""

    model: LateLag
    theta: FloatArray

    def loop(self, controller: LoggedController, omega_rad_s: FloatArray) -> ComplexArray:
        return np.asarray(self.model.response(self.theta, omega_rad_s)[0] * controller.response(omega_rad_s))


def _late_lag(plant: FrequencyResponse, sample_rate_hz: float) -> _Vehicle | None:
    used = (plant.random_error <= _LARGEST_ERROR) & (plant.coherence >= _LEAST_COHERENCE)
    if np.count_nonzero(used) < _FEWEST_POINTS:
        return None
    points = ResponsePoints.of(plant, used, (0, 0))
    scale = float(np.sqrt(points.omega_rad_s[0] * points.omega_rad_s[-1]))
    limits = Limits(delays_s=(0.0, LONGEST_S), fastest_rad_s=FASTEST_GROWTH_RAD_S)
    models = [
        LateLag(order=order, scale_rad_s=scale, hold="smooth", sample_s=1.0 / sample_rate_hz)
        for order in AIRFRAME_ORDERS
        if 2 * points.omega_rad_s.size > order.coefficients + 1
    ]
    try:
        fits = [fit_order(ResponseFit(data=points, model=model), limits) for model in models]
    except InsufficientDataError:
        return None
    best = simplest(fits)
    return _Vehicle(next(model for model in models if model.order == best.order), best.solution.theta)


def _flown(
    controller: LoggedController, vehicle: _Vehicle, loop: FrequencyResponse, end: float
) -> LoggedController | None:
    """With the angle loop or without: which makes the measured loop in the last octave; ``None`` where none does."""
    x = np.log(loop.omega_rad_s)
    last = (x > end - _TOP_OCTAVES * np.log(2.0)) & (x <= end)
    omega, values = loop.omega_rad_s[last], loop.values[0, 0, last]
    tried = [
        (float(np.sqrt(np.mean(np.abs(np.log(values / vehicle.loop(one, omega))) ** 2))), one)
        for one in (controller, controller.rate_loop)
    ]
    off, best = min(tried, key=lambda item: item[0])
    return best if off <= _SAME_LOOP else None


def _extended(
    loop: FrequencyResponse, curve: LogCurve, omega_rad_s: FloatArray, course: ComplexArray
) -> FrequencyResponse:
    """The measured loop up to the end of its band, and from there on what a model makes of its end."""
    end = curve.at(curve.bands[-1][1])
    kept = loop.omega_rad_s <= end.omega_rad_s * (1.0 + 1e-9)
    trusted = np.exp(curve.x)
    values = np.concatenate([loop.values[0, 0, kept], np.exp(end.value) * course])
    measured, beyond = int(kept.sum()), omega_rad_s.size
    # The end errs as the points do that make it, and the model the more the farther it goes on.
    rows = np.zeros((measured + beyond, curve.x.size), dtype=np.complex128)
    rows[:measured] = (loop.omega_rad_s[kept][:, None] == trusted).astype(np.float64)
    rows[measured:] = end.weights
    relative = rows @ curve.covariance @ rows.conj().T
    away = np.concatenate([np.zeros(measured), np.log(omega_rad_s / end.omega_rad_s)])
    relative += 2.0 * _WRONG_PER_E_FOLD**2 * np.outer(away, away)
    covariance = relative * np.outer(values, values.conj())
    error = np.sqrt(0.5 * np.einsum("ff->f", relative).real)
    error[:measured] = loop.random_error[0, 0, kept]
    coherence = np.concatenate([loop.coherence[0, 0, kept], np.ones(beyond)])
    return replace(
        loop,
        omega_rad_s=np.concatenate([loop.omega_rad_s[kept], omega_rad_s]),
        values=values[None, None],
        coherence=coherence[None, None],
        random_error=error[None, None],
        covariance=covariance[None, None],
        output_correlation=None,
        input_correlation=None,
        disturbance=None,
        processing=(*loop.processing, f"beyond {end.omega_rad_s:.3g} rad/s model times controller"),
    )


def beyond_band(axis: Axis, loop: AxisLoop) -> tuple[Finding, ...]:
    """The remark that margins of an axis lie beyond the band, with what is known of them."""
    bounds = {name: bound for name, bound in loop.bounds.items() if name in _WORDS}
    if not bounds:
        return ()
    told = [_said(name, bound) for name, bound in bounds.items()]
    end = next(iter(bounds.values())).omega_rad_s
    known = loop.beyond.numbers if loop.beyond else {}
    further = [f"{_WORDS[name][0]} {_shown(name, known[name].value)}" for name in bounds if name in known]
    go_on = f" {_capital(_BY_MODEL)} {' and '.join(further)}; that was not measured." if further else ""
    make = remark if set(bounds) == {"gain_margin_up"} else warn
    numbers = {name: bound.value for name, bound in bounds.items()}
    numbers |= {f"{name}_by_model": known[name].value for name in bounds if name in known}
    return (
        make(
            "margin_beyond_band",
            axis,
            f"The {axis} loop is seen up to {end:.3g} rad/s, and {' and '.join(told)}.{go_on} Sweep to higher "
            "frequencies to see it.",
            omega_rad_s=end,
            **numbers,
        ),
    )


_BY_MODEL = "a model of the vehicle times the controller in the log gives beyond it"


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]


def _said(name: str, bound: Bound) -> str:
    sign, still = ("at least", "rising") if bound.at_least else ("at most", "falling")
    return f"its {_WORDS[name][0]} is {sign} {_shown(name, bound.value)}, still {still} there"


def _shown(name: str, value: float) -> str:
    _, factor, unit = _WORDS[name]
    number = factor * value if factor else 20.0 * np.log10(value)
    return f"{number:.1f}{'' if unit == '°' else ' '}{unit}"
