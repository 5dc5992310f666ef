"""The loop around an axis as the same flight shows it: the broken loop with its margins, sensitivity, attitude."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import NamedTuple

import numpy as np

from rotorid.data.axes import ANGLE_OF, RATE_OF
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.record import FlightRecord, TimeHistory
from rotorid.data.response import FrequencyResponse
from rotorid.data.trust import RICH_KINDS
from rotorid.errors import InsufficientDataError
from rotorid.fitting.delay.estimate import AIRFRAME_ORDERS, FASTEST_GROWTH_RAD_S, LONGEST_S
from rotorid.fitting.delay.fit import LateLag, Limits, ResponseFit, ResponsePoints, fit_order, simplest
from rotorid.pipeline.preparation.controllers import LoggedController
from rotorid.pipeline.preparation.flights import Flight
from rotorid.pipeline.preparation.measure import Measured, logged_controllers
from rotorid.pipeline.preparation.segments import cut, histories, with_surroundings
from rotorid.signal.excitations import find_excitations
from rotorid.spectral.derived import Estimated, log_curve, selected, with_model_error
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
from rotorid.spectral.windows import band_of, grid_rad_s, margin_s, plan_of_records
from rotorid.typing import Axis, BoolArray, ComplexArray, FloatArray

MODEL_ERROR = 0.007
"""Share of a measured loop that it errs by whatever the length of the flight, alike over an octave."""

_LARGEST_ERROR, _LEAST_COHERENCE = 0.3, 0.3


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
        method=method or _no_loop(flown),
        loop=loop,
        margins=loop_margins(loop) if loop else None,
        rejection=disturbance_rejection(sensitivity(loop)) if loop else None,
        attitude=attitude,
    )
    return replace(found, beyond=_beyond(axis, found, measured, flown)) if found.bounds else found


def loop_by_injection(axis: Axis, records: Sequence[FlightRecord]) -> AxisLoop | None:
    """The loop around an axis by its injections at the mixer alone; ``None`` where a flight has none.

    It needs neither a model of the vehicle nor the gains of its controller, and no other instrument: what is wrong with
    an identified plant is not wrong here.

    Parameters
    ----------
    axis
        The axis.
    records
        Logs of one vehicle with one set of gains.

    Raises
    ------
    InsufficientDataError
        The injections are too short, or the command was not logged beside them.
    """
    command, excitation = f"{axis}_command", f"{axis}_excitation"
    flown = [
        Flight(record, maneuver)
        for record in records
        if _enters_the_mixer(record, excitation)
        for maneuver in find_excitations(record, axis)
        if maneuver.signal == excitation and maneuver.kind in RICH_KINDS
    ]
    if not flown:
        return None
    wider = with_surroundings(flown, margin_s([one.maneuver for one in flown]), (command, excitation))
    segments, _ = cut(wider, channels=(command, excitation))
    cut_out = histories(segments)
    band = band_of([one.maneuver for one in flown], cut_out[0].sample_rate_hz)
    plan = plan_of_records([one.duration_s for one in cut_out], band)
    loop = injected_loop(
        cut_out,
        command=command,
        excitation=excitation,
        omega_rad_s=grid_rad_s(band, plan),
        windows_s=plan.lengths_s,
        injection_delay_s=_injection_delay_s(flown),
    )
    loop = with_model_error(loop, MODEL_ERROR)
    return AxisLoop(
        method=f"measured with {excitation}, all loops closed",
        loop=loop,
        margins=loop_margins(loop),
        rejection=disturbance_rejection(sensitivity(loop)),
        attitude=None,
    )


def _enters_the_mixer(record: FlightRecord, excitation: str) -> bool:
    """Whether an excitation is a share of the command: one that enters as a rate or an angle has their unit."""
    rows = (topic.row(excitation) for topic in record.topics)
    return any(
        row is not None and topic.channels[row].unit == "1" for topic, row in zip(record.topics, rows, strict=True)
    )


def _injection_delay_s(flown: Sequence[Flight]) -> float:
    """What the system identification mode of ArduPilot logs enters the mixer one loop later."""
    rates_hz = {_loop_rate_hz(record) for record, _ in flown}
    return 1.0 / rates_hz.pop() if len(rates_hz) == 1 and all(rates_hz) else 0.0


def _gains_changed(flown: Sequence[Flight]) -> bool:
    return any(finding.kind == "parameters_changed" for record, _ in flown for finding in record.findings)


def _no_loop(flown: Sequence[Flight]) -> str:
    gains = "gains that changed in the log" if _gains_changed(flown) else "no gains in the log"
    return f"no injection at the mixer and {gains}: no broken loop"


def _injected(
    axis: Axis, measured: Measured, flown: Sequence[Flight], records: Sequence[TimeHistory]
) -> tuple[FrequencyResponse, str] | None:
    excitation, response = f"{axis}_excitation", measured.response
    if excitation not in response.instruments or not all(_enters_the_mixer(one.record, excitation) for one in flown):
        return None
    # Maneuvers of another instrument were flown without it.
    records = [record for record in records if excitation in record.names and np.ptp(record[excitation]) > 0.0]
    loop = injected_loop(
        records,
        command=f"{axis}_command",
        excitation=excitation,
        omega_rad_s=response.omega_rad_s,
        windows_s=response.windows_s,
        injection_delay_s=_injection_delay_s(flown),
    )
    return loop, f"measured with {excitation}, all loops closed"


def _loop_rate_hz(record: FlightRecord) -> float:
    return record.parameters.get("SCHED_LOOP_RATE", 0.0) if "SID_AXIS" in record.parameters else 0.0


def _computed(axis: Axis, measured: Measured, flown: Sequence[Flight]) -> tuple[FrequencyResponse, str] | None:
    response, rate = measured.response, RATE_OF.get(axis, "")
    if rate not in response.outputs or response.estimate != "joint" or len(response.inputs) > 1:
        return None
    parameters = flown[0][0].parameters
    controllers = logged_controllers(flown, measured, f"{axis}_command", rate)
    if len(controllers) != 1 or any(record.parameters != parameters for record, _ in flown):
        return None
    if _gains_changed(flown):
        return None
    plant = selected(response, outputs=[rate], inputs=[f"{axis}_command"])
    gains = controllers[0].rate_loop.response(response.omega_rad_s)
    return series(plant, gains), "measured vehicle times the gains in the log, rate loop alone"


def _attitude(axis: Axis, measured: Measured, records: Sequence[TimeHistory]) -> AttitudeBandwidth | None:
    response, angle = measured.response, ANGLE_OF.get(axis, "")
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

_BEYOND_POINTS = 800

_TOP_OCTAVE = (0.45, 0.85)
"""Share of the band's end between which a model is tied to the measurement: the last points hold the end of a sweep."""

_SAME_LOOP = 0.2
"""Rms of the logarithm of measured over computed loop below which the controller is the one that flew."""

_WRONG_PER_E_FOLD = 0.15
"""What a rate model is off by outside of its band, for each factor of e in frequency."""

_FEWEST_POINTS, _FEWEST_TIED = 8, 4
_WORDS = {
    "disturbance_rejection_peak": ("sensitivity peak", 0.0, "dB"),
    "phase_margin_rad": ("phase margin", 180.0 / np.pi, "°"),
    "gain_margin_up": ("gain margin", 0.0, "dB"),
}


def _beyond(axis: Axis, found: AxisLoop, measured: Measured, flown: Sequence[Flight]) -> Beyond | None:
    """Margins beyond the band, of a late lag fitted to the measured vehicle, and the controller in the log."""
    response, rate, command = measured.response, RATE_OF.get(axis, ""), f"{axis}_command"
    if found.loop is None or rate not in response.outputs or command not in response.inputs:
        return None
    controllers = logged_controllers(flown, measured, command, rate)
    vehicle = _late_lag(
        selected(response, outputs=[rate], inputs=[command]), measured.segments[0].history.sample_rate_hz
    )
    curve = log_curve(found.loop)
    if len(controllers) != 1 or vehicle is None or not curve.bands:
        return None
    end = float(np.exp(curve.bands[-1][1]))
    x = np.log(found.loop.omega_rad_s / end)
    tied = (
        np.isin(np.log(found.loop.omega_rad_s), curve.x) & (x >= np.log(_TOP_OCTAVE[0])) & (x <= np.log(_TOP_OCTAVE[1]))
    )
    if np.count_nonzero(tied) < _FEWEST_TIED:
        return None
    controller = _flown(controllers[0], vehicle, found.loop, tied)
    if controller is None:
        return None
    top = end * _BEYOND_RATIO
    if controller.controller.step_s > 0.0:
        top = min(top, 0.5 * np.pi / controller.controller.step_s)
    if top <= end:
        return None
    omega = np.geomspace(end * _TOP_OCTAVE[1], top, _BEYOND_POINTS)
    numbers = _margins_beyond(found.loop, tied, omega, lambda at: vehicle.loop(controller, at))
    wanted = set(found.not_seen) | {"crossover_rad_s"}
    return Beyond(
        method=f"a lag of {vehicle.model.order.words} fitted to the measured vehicle, times the controller in the log",
        up_to_rad_s=float(omega[-1]),
        numbers={name: number for name, number in numbers.items() if name in wanted - set(found.numbers)},
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
    controller: LoggedController, vehicle: _Vehicle, loop: FrequencyResponse, tied: BoolArray
) -> LoggedController | None:
    """With the angle loop or without: which makes the measured loop near its end; ``None`` where none does."""
    omega, values = loop.omega_rad_s[tied], loop.values[0, 0, tied]
    tried = [
        (float(np.sqrt(np.mean(np.abs(np.log(values / vehicle.loop(one, omega))) ** 2))), one)
        for one in (controller, controller.rate_loop)
    ]
    off, best = min(tried, key=lambda item: item[0])
    return best if off <= _SAME_LOOP else None


def _margins_beyond(
    loop: FrequencyResponse, tied: BoolArray, omega_rad_s: FloatArray, model: Callable[[FloatArray], ComplexArray]
) -> dict[str, Estimated]:
    r"""Margins of a model that is brought to the mean of what was measured near the end of the band.

    .. math:: L = L_{model} \, e^{a + b \ln(\omega / \omega_0)}

    with the complex level :math:`a` measured, and a complex :math:`b` of zero and 0.15: a model is off the more the
    farther it goes on. Deviations follow from a step of one deviation of each to either side.
    """
    H, x = loop.values[0, 0, tied], np.log(loop.omega_rad_s[tied])
    weight = 1.0 / loop.random_error[0, 0, tied] ** 2
    weight /= weight.sum()
    level = weight @ np.log(H / model(loop.omega_rad_s[tied]))
    relative = loop.covariance[0, 0][np.ix_(tied, tied)] / np.outer(H, H.conj())
    std = np.sqrt(0.5 * max(float(np.real(weight @ relative @ weight)), 0.0))
    away, course = np.log(omega_rad_s) - weight @ x, model(omega_rad_s) * np.exp(level)
    exact = _read(omega_rad_s, course)
    ways = [
        part * direction for part in (std * np.ones_like(away), _WRONG_PER_E_FOLD * away) for direction in (1.0, 1j)
    ]
    moved = [[_read(omega_rad_s, course * np.exp(sign * way)) for sign in (1.0, -1.0)] for way in ways]
    return {
        name: Estimated(
            value=value,
            std=float(np.sqrt(sum(0.25 * (up[name] - down[name]) ** 2 for up, down in moved))),
        )
        for name, value in exact.items()
        if all(name in one for pair in moved for one in pair)
    }


def _read(omega_rad_s: FloatArray, values: ComplexArray) -> dict[str, float]:
    """Margins of exact values on a close grid, as far as they are there, by the names of the loop's numbers."""
    found: dict[str, float] = {}
    x, gain = np.log(omega_rad_s), np.log(np.abs(values))
    for k in np.flatnonzero((gain[:-1] > 0.0) & (gain[1:] <= 0.0))[-1:]:
        share = gain[k] / (gain[k] - gain[k + 1])
        omega = float(np.exp(x[k] + share * (x[k + 1] - x[k])))
        # From the opposite of minus one, so that no turn lies between the two points.
        margin = float(np.angle(-values[k]) + share * np.angle(values[k + 1] / values[k]))
        found |= {"crossover_rad_s": omega, "phase_margin_rad": margin}
        # Below -180 degrees at its last crossover a loop is unstable: no delay and no factor brings it to -1.
        if margin <= 0.0:
            return found
        found["delay_margin_s"] = margin / omega
    turns = np.flatnonzero((values.imag[:-1] < 0.0) & (values.imag[1:] >= 0.0) & (values.real[:-1] < 0.0))
    for k in turns[:1]:
        share = values.imag[k] / (values.imag[k] - values.imag[k + 1])
        margin = float(np.exp(-(gain[k] + share * (gain[k + 1] - gain[k]))))
        found |= {"gain_margin_up": margin} if margin >= 1.0 else {"gain_margin_down": margin}
    distance = np.abs(1.0 + values)
    least = int(distance.argmin())
    if 0 < least < distance.size - 1 and distance[least] < 1.0:
        found |= {"modulus_margin": float(distance[least]), "modulus_omega_rad_s": float(omega_rad_s[least])}
        found |= {
            "disturbance_rejection_peak": float(1.0 / distance[least]),
            "disturbance_rejection_peak_omega_rad_s": float(omega_rad_s[least]),
        }
    return found


_BY_MODEL = "a model of the vehicle times the controller in the log gives beyond it"


def beyond_band(axis: Axis, loop: AxisLoop) -> tuple[Finding, ...]:
    """The remark that margins of an axis lie beyond the band, with what is known of them."""
    bounds = {name: bound for name, bound in loop.bounds.items() if name in _WORDS}
    if not bounds:
        return ()
    told = [_said(name, bound) for name, bound in bounds.items()]
    end = next(iter(bounds.values())).omega_rad_s
    known = loop.beyond.numbers if loop.beyond else {}
    further = [f"{_WORDS[name][0]} {_shown(name, known[name])}" for name in bounds if name in known]
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


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]


def _said(name: str, bound: Bound) -> str:
    sign, still = ("at least", "rising") if bound.at_least else ("at most", "falling")
    return f"its {_WORDS[name][0]} is {sign} {_shown(name, bound)}, still {still} there"


def _shown(name: str, one: Bound | Estimated) -> str:
    """A margin in the unit of paper, ± one standard deviation."""
    _, factor, unit = _WORDS[name]
    number = factor * one.value if factor else 20.0 * np.log10(one.value)
    std = one.std * (factor or 20.0 / (np.log(10.0) * one.value))
    return f"{number:.1f} ± {std:.1f}{'' if unit == '°' else ' '}{unit}"
